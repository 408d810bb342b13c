"""Parameters of force elements as a kernel has them now, and damping of joints as wholes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..arrays import Array
from ..names import component_name, parameter_name
from ..robot.elements import KINDS
from ..robot.elements.joint_damping import MOVED
from ..robot.parameter_names import MOTIONS
from ..runtime.kernel import Kernel

Numbers = dict[str, dict[str, float]]  # by owner, then by their names in its table


def element_numbers(kernel: Kernel, family: str) -> Numbers:
    """Give the numbers of one family of forces, such as "bearings", by owner and by their names in its table.

    Args:
        family: one of ``robot.parameter_names.FAMILIES``.
    """
    values, owners = kernel.parameters.state.values, kernel.elements.get(family, {})
    return {owner: {key: float(values[place]) for key, place in places.items()} for owner, places in owners.items()}


def element_slopes(kernel: Kernel) -> tuple[Array, Array]:
    """Give the largest stiffness and damping along each of ``Kernel.element_rows``, (rows,) each; N/m, N m/rad."""
    slopes: dict[str, tuple[float, float]] = {}
    for table, kind in KINDS.items():
        for owner, numbers in element_numbers(kernel, table).items():
            slopes |= {component_name(owner, row): pair for row, pair in kind.slopes(numbers).items()}
    pairs = np.array([slopes[name] for name in kernel.element_rows]).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def damping_diagonal(kernel: Kernel) -> Array:
    """Return the damping of every coordinate by joint dampers, (n,), N s/m or N m s/rad."""
    diagonal = np.zeros(kernel.n)
    for _, damping, index in _dampers(kernel):
        diagonal[list(index.values())] += damping
    return diagonal


def damping_forces(kernel: Kernel, q: Array, v: Array) -> Array:
    """Return the generalized forces of joint dampers against the motion in states, (T, n) each; (T, n)."""
    forces = np.zeros_like(v)
    for joint, damping, index in _dampers(kernel):
        places = list(index.values())
        forces[:, places] += damping * v[:, places]
        if {"alpha", "gamma"} <= index.keys():
            beta = kernel.parameters.get(parameter_name("joints", joint, "offset", "beta"), 0.0)
            sine = np.sin(beta + (q[:, index["beta"]] if "beta" in index else 0.0))
            alpha, gamma = index["alpha"], index["gamma"]
            forces[:, alpha] += damping * sine * v[:, gamma]
            forces[:, gamma] += damping * sine * v[:, alpha]
    return forces


def _dampers(kernel: Kernel) -> Iterator[tuple[str, float, dict[str, int]]]:
    """Yield joints with such a damping, its number, and the indices of what it slows down, by their short names."""
    for joint, numbers in element_numbers(kernel, MOTIONS).items():
        for key, damping in numbers.items():
            names = {name: component_name(joint, name) for name in MOVED[key]}
            places = {name: kernel.coordinates.index(x) for name, x in names.items() if x in kernel.coordinates}
            yield joint, damping, places
