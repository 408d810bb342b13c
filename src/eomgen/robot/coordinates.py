"""Names of coordinates, motions and forces: their order, their units, and their places in arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..names import component_name, joint_of, kind_of, parameter_name, split_component
from .value import ANGULAR, LINEAR, MOTOR, Robot

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

UNITS = {"x": "m", "y": "m", "z": "m", "alpha": "rad", "beta": "rad", "gamma": "rad", MOTOR: "rad"}
MODE = "mode"  # and a number: kinds of modal coordinates, whose mode shapes have units of their own
LINKS = "links"  # owners of modes, in names of parameters
MOTIONS = ("x", "y", "z", "rx", "ry", "rz")  # of a frame: displacement (m) and rotation vector (rad)
QUATERNION = ("qw", "qx", "qy", "qz")  # of a joint's rotation, unit, scalar first
FORCES = ("fx", "fy", "fz", "mx", "my", "mz")  # of a wrench: force (N) and moment (N m)


def is_kind(kind: str) -> bool:
    """Return whether a coordinate may be of a kind: "x", "gamma", "motor", "mode12"."""
    number = kind.removeprefix(MODE)
    return kind in UNITS or (kind != number and number.isascii() and number.isdecimal() and number[0] != "0")


def is_mode(name: str) -> bool:
    """Return whether a coordinate is a mode of a link that bends, by its name: "arm.mode1"."""
    return kind_of(name).startswith(MODE)


def number_name(owner: str, name: str, key: str) -> str:
    """Name the run-time parameter of a coordinate's number: "joints.joint1.x.stiffness", "links.arm.modes.1.damping".

    Args:
        owner: "joints", "loops" or "couplings"; "links" of modes.
        name: of the coordinate.
        key: of its number.
    """
    if owner != LINKS:
        return parameter_name(owner, name, key)
    link, kind = split_component(name)
    return parameter_name(LINKS, link, "modes", kind.removeprefix(MODE), key)


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
