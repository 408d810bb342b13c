"""Names of coordinates, motions and forces: their order, their units, and their places in arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..names import component_name, joint_of, kind_of
from .value import ANGULAR, LINEAR, MOTOR, Robot

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

UNITS = {"x": "m", "y": "m", "z": "m", "alpha": "rad", "beta": "rad", "gamma": "rad", MOTOR: "rad"}
MODE = "mode"  # and a number: kinds of modal coordinates, whose mode shapes have units of their own
MOTIONS = ("x", "y", "z", "rx", "ry", "rz")  # of a frame: displacement (m) and rotation vector (rad)
QUATERNION = ("qw", "qx", "qy", "qz")  # of a joint's rotation, unit, scalar first
FORCES = ("fx", "fy", "fz", "mx", "my", "mz")  # of a wrench: force (N) and moment (N m)


def is_kind(kind: str) -> bool:
    """Return whether a coordinate may be of a kind: "x", "gamma", "motor", "mode12"."""
    number = kind.removeprefix(MODE)
    return kind in UNITS or (kind != number and number.isascii() and number.isdecimal() and number[0] != "0")


def unit_of(name: str) -> str:
    """Return the unit of a coordinate, or of a component of a frame's motion, by its name: "m", "rad" or "1"."""
    kind = kind_of(name)
    return "m" if kind in LINEAR else "1" if kind.startswith(MODE) else "rad"


def owner_of(name: str) -> str:
    """Return whose coordinate it is: the joint's name, or "arm.modes" of a link "arm" that bends."""
    return f"{joint_of(name)}.{MODE}s" if kind_of(name).startswith(MODE) else joint_of(name)


def force_unit_of(name: str) -> str:
    """Return the unit of a generalized force of a coordinate, or of a wrench's component: "N", "N m" or "J"."""
    kind = kind_of(name)
    return "N" if kind in (*LINEAR, *FORCES[:3]) else "J" if kind.startswith(MODE) else "N m"


def coordinate_names(robot: Robot) -> tuple[str, ...]:
    """Return the names of all coordinates, motors among them, in the order of q."""
    return tuple(robot.coordinates)


def rotating_joints(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the joints whose alpha, beta and gamma are all among these coordinates, in their order."""
    known = set(names)
    joints = dict.fromkeys(map(joint_of, names))
    return tuple(joint for joint in joints if known.issuperset(component_name(joint, angle) for angle in ANGULAR))


def index_of(names: Sequence[str], wanted: Sequence[str]) -> NDArray[np.intp]:
    """Return the indices of the wanted coordinates among the names."""
    import numpy as np  # which keys, schemas and the names above do without

    return np.array([names.index(name) for name in wanted], dtype=np.intp)
