"""Joints of one MJCF body, in their order, as joints of up to six coordinates.

MuJoCo lets the joints of a body act one after the other, each about the axes that those before it have turned.  That is
a joint's motion of eq. (3) where slides come before hinges, the hinges meet in one point, and the axes are those of one
right-handed triad in the order x y z alpha beta gamma.  Longest runs of joints that are so become one joint each.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from eomgen.robot.elements.joint_damping import JointDamping
from eomgen.robot.geometry import axis_turn
from eomgen.robot.value import ANGULAR, COORDINATES, LINEAR, PRINCIPAL, Coordinate

from .poses import Array, tidy, triple

_CLOSE = 1e-12  # of unit vectors and metres


@dataclass(frozen=True)
class Moving:
    """A hinge, slide, ball or free joint of the file.

    axis: unit vector in its body's axes; anchor: a point that does not move, m, in its body; both in the reference
    position.  offset: added to the coordinate, m or rad.  limited: whether MuJoCo keeps it within its limits.
    effort: greatest force of its actuators, N or N m.
    damping: of a ball or free joint.
    """

    index: int
    name: str
    kind: str
    axis: Array
    anchor: Array
    coordinate: Coordinate = field(default_factory=Coordinate)
    offset: float | None = None
    limits: tuple[float, float] | None = None
    limited: bool = False
    effort: float | None = None
    damping: JointDamping | None = None


@dataclass(frozen=True)
class Group:
    """Joints that become one: ``names`` are their coordinates in it, ``turn`` has its axes as columns."""

    joints: tuple[Moving, ...]
    names: tuple[str, ...]
    turn: Array

    @property
    def anchor(self) -> Array:
        """The joint's origin in the body, m: where its hinges meet."""
        return next((joint.anchor for joint in self.joints if joint.kind != "slide"), np.zeros(3))

    @property
    def type(self) -> str:
        """Type of the joint, by its principal coordinate; "free" where all six move and none has a spring."""
        if len(self.names) == len(COORDINATES) and not any(joint.coordinate.stiffness for joint in self.joints):
            return "free"
        if self.joints[0].kind == "ball":
            return "fixed"
        return next((kind for kind, principal in PRINCIPAL.items() if principal in self.names), "fixed")

    @property
    def by_coordinate(self) -> dict[str, Moving]:
        """The file's joint of each coordinate; one for all of a ball or free joint."""
        joints = self.joints if len(self.joints) == len(self.names) else self.joints * len(self.names)
        return dict(zip(self.names, joints, strict=True))

    @property
    def stem(self) -> str:
        """NAME, where its coordinates are called NAME.x, NAME.alpha and so on; "" otherwise."""
        stems = {joint.name.rpartition(".")[0] for joint in self.joints}
        ends = tuple(joint.name.rpartition(".")[2] for joint in self.joints)
        return stems.pop() if len(stems) == 1 and ends == self.names else ""


def groups(joints: Sequence[Moving]) -> Iterator[Group]:
    """Yield the joints of a body as few joints of several coordinates."""
    rest = list(joints)
    while rest:
        if rest[0].kind in ("free", "ball"):
            names = COORDINATES if rest[0].kind == "free" else ANGULAR
            yield Group((rest.pop(0),), names, np.eye(3))
            continue
        for count in range(min(len(rest), 6), 0, -1):
            made = _group(rest[:count])
            if made is not None:
                break
        assert made is not None  # one joint alone is one
        yield made
        del rest[:count]


def _group(joints: Sequence[Moving]) -> Group | None:
    """Return the joints as one, if they fit; else None."""
    kinds = [joint.kind for joint in joints]
    if not set(kinds) <= {"slide", "hinge"} or kinds != sorted(kinds, reverse=True):
        return None  # a slide behind a hinge moves along turned axes
    slides, hinges = kinds.count("slide"), kinds.count("hinge")
    if slides > 3 or hinges > 3:
        return None
    anchors = [joint.anchor for joint in joints if joint.kind == "hinge"]
    if any(np.abs(anchor - anchors[0]).max() > _CLOSE for anchor in anchors):
        return None
    hint = tuple(joint.name.rpartition(".")[2] for joint in joints)
    choices = [first + second for first in combinations(LINEAR, slides) for second in combinations(ANGULAR, hinges)]
    last = "gamma" if hinges else "z"
    for names in sorted(choices, key=lambda names: (names != hint, names[-1] != last)):
        turn = _triad(names, [joint.axis for joint in joints])
        if turn is not None:
            return Group(tuple(joints), names, turn)
    return None


def _triad(names: Sequence[str], axes: Sequence[Array]) -> Array | None:
    """Return the right-handed triad, as columns, with these axes at the names' coordinates; None without one."""
    axis_at: dict[int, Array] = {}
    for name, axis in zip(names, axes, strict=True):
        place = COORDINATES.index(name) % 3
        if np.abs(axis_at.setdefault(place, axis) - axis).max() > _CLOSE:
            return None
    if len(axis_at) == 1:
        ((place, axis),) = axis_at.items()
        return np.roll(np.array(axis_turn(triple(axis))), place - 2, axis=1)
    if len(axis_at) == 2:
        a, b = sorted(axis_at)
        third = np.cross(axis_at[a], axis_at[b])
        axis_at[3 - a - b] = third if (b - a) == 1 else -third
    turn = np.column_stack([axis_at[place] for place in range(3)])
    if np.abs(turn.T @ turn - np.eye(3)).max() > _CLOSE or np.linalg.det(turn) < 0.0:
        return None
    return tidy(turn)
