"""Which number of a table a run-time parameter is: its unit and its range."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from ..names import parameter_name, parameter_path
from .elements import KINDS
from .laws import BASIC, IN_BEARINGS, IN_MOTION, JOINT_DAMPING, NUMBERS, RADIAL, Number

_OF_COORDINATES: Mapping[str, Number] = MappingProxyType({**{number.key: number for number in BASIC}, **NUMBERS})


def number_of(parameter: str) -> Number | None:
    """Give the table's number that a run-time parameter is; None of what is no force."""
    kind, *path = parameter_path(parameter)
    if kind not in ("joints", "loops", "couplings", *KINDS):
        return None
    if kind in ("joints", "loops") and path[1] == RADIAL:
        return IN_BEARINGS.get(parameter_name(*path[2:]))
    if kind == "joints" and path[1] == JOINT_DAMPING:
        return IN_MOTION.get(parameter_name(*path[2:]))
    key = parameter_name(*path[2 if kind in ("joints", "loops") else 1 :])
    table = KINDS[kind].NUMBERS if kind in KINDS else _OF_COORDINATES
    return table.get(key) or table.get(key.partition(".")[0])


def least_of(parameter: str) -> float | None:
    """Give the least value that a run-time parameter may have; None where any number will do."""
    if parameter.startswith("links.") and parameter.endswith(".mass"):
        return 0.0
    number = number_of(parameter)
    return None if number is None else number.least
