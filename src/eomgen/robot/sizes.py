"""How large deviations are: what tolerances refer to, and which numbers of which springs say so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..names import parameter_name, parameter_path
from .laws import stiffness_of

Array = NDArray[np.float64]

REFERENCE_ACCELERATION = 10.0  # m/s^2, rad/s^2: about 1 g; what it does to a spring is the size of its deviation


def law_numbers(parameters: Mapping[str, float], coordinates: Sequence[str]) -> dict[str, dict[str, float]]:
    """Numbers of the forces of coordinates by their names in the table of laws, out of all parameters.

    Args:
        parameters: by name.
        coordinates: names, such as "elbow.alpha"; of a motor the numbers are those of its transmission.
    """
    return _numbers(parameters, coordinates, "joints")


def cut_numbers(parameters: Mapping[str, float], laws: Sequence[str]) -> dict[str, dict[str, float]]:
    """The same of cut joints' coordinates and of elastic couplings, by their names."""
    return _numbers(parameters, laws, "loops", "couplings")


def _numbers(parameters: Mapping[str, float], owners: Sequence[str], *kinds: str) -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = {name: {} for name in owners}
    if found:
        for name, owner, key in _places(tuple(parameters), tuple(owners), kinds):
            found[owner][key] = parameters[name]
    return found


@lru_cache(maxsize=64)
def _places(names: tuple[str, ...], owners: tuple[str, ...], kinds: tuple[str, ...]) -> list[tuple[str, str, str]]:
    """Parameters that are numbers of owners, with their owner and their name in the table of laws."""
    found, known = list[tuple[str, str, str]](), frozenset(owners)
    for name in names:
        kind, *path = parameter_path(name)
        if kind in kinds:
            length = 1 if kind == "couplings" else 2
            owner = parameter_name(*path[:length])
            if owner in known:
                found.append((name, owner, parameter_name(*path[length:])))
    return found


def table_stiffnesses(
    parameters: Mapping[str, float], coordinates: Sequence[str], knots: Mapping[str, Sequence[float]]
) -> Array:
    """Stiffness of every coordinate's own table, (n,), N/m or N m/rad; of a motor's that of its transmission.

    Args:
        parameters, coordinates: as of ``law_numbers``.
        knots: deviations of measured curves, by coordinate.
    """
    numbers = law_numbers(parameters, coordinates)
    return np.array([stiffness_of(numbers[name], knots.get(name, ())) for name in coordinates])


def deviation_sizes(stiffness: Array, inertia: Array) -> tuple[Array, Array]:
    """Sizes of coordinates and rates, (n,) each; m, rad, s.

    A coordinate with stiffness k and inertia m has w^2 = k / m; at 10 m/s^2 or rad/s^2 it gives way by 10 / w^2, often
    micrometres, and swings with rates of 10 / w.  Without a spring, or with a soft one, the size is 1.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        period = np.where((stiffness > 0.0) & (inertia > 0.0), np.sqrt(inertia / stiffness), np.inf)
    return np.minimum(1.0, REFERENCE_ACCELERATION * period**2), np.minimum(1.0, REFERENCE_ACCELERATION * period)
