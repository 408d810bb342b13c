"""Tendons and equality constraints of a compiled model: springs, couplings and loops of a Draft.

MuJoCo's constraints are soft, by a spring and a damper of its solver; here they are rigid couplings and loops.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from eomgen.names import listed, show
from eomgen.robot.joint_types import JOINT_TYPES
from eomgen.robot.value import Coordinate, Coupling, Loop, Spring

from .bodies import Bodies, Names
from .compiled import text_of
from .poses import Pose, rotation_from_quaternion, triple

_FORCES = ("stiffness", "damping", "frictionloss", "armature", "springyield")
_AGREES = 1e-9  # m or rad: allowed difference of a reference position from its coupling
_PREFIX = "couplings."  # of tendons that the export writes for couplings


class Constraints:
    """Reads tendons that have forces, and constraints that are active, into the draft of the bodies."""

    def __init__(self, bodies: Bodies) -> None:
        self.bodies, self.model, self.draft = bodies, bodies.model, bodies.draft
        self.names = Names([])

    def read(self) -> None:
        """Read both.

        Raises:
            DescriptionError: a constraint or a tendon with forces has no equal here.
        """
        off = self.model.disabled & {"mjDSBL_EQUALITY", "mjDSBL_CONSTRAINT"}
        for index in range(self.model.count("equality")):
            if self.model["eq_active0"][index] and not off:
                self._equality(index)
        made = [*self.draft.couplings, *self.draft.loops]
        if made:
            what = "equality constraints, which are soft in MuJoCo, are read as rigid"
            self.draft.notes.append(f"{what}: {listed(made)}")
            self.draft.home = _consistent_home(self.bodies.start(), self.draft.couplings.values())
        limited = []
        for index in range(self.model.count("tendon")):
            self._tendon(index)
            if self.model["tendon_limited"][index]:
                limited.append(self.model.names["tendon"][index] or f"tendon number {index + 1}")
        if limited:
            self.draft.notes.append(f"nothing stops at the limits of tendons: {listed(limited)}")

    def _equality(self, index: int) -> None:
        kind, line = self.model.words["eq_type"][index], self.model.lines["equality"][index]
        name = self.names.fresh(self.model.names["equality"][index] or kind)
        if kind in ("joint", "tendon"):
            self.draft.couplings[name] = self._coupled(index, kind, name)
            self.bodies.written[f"couplings.{name}"] = line
        elif kind in ("connect", "weld"):
            self.draft.loops[name] = self._loop(index, kind, name)
            self.bodies.written[f"loops.{name}"] = line
        else:
            allowed = "joint, connect, weld, tendon, or without it, or with active='false'"
            message = f"<{kind}> constrains the motion softly, which has no equal here; allowed: {allowed}"
            self.model.fail("equality", index, message)

    def _coupled(self, index: int, kind: str, name: str) -> Coupling:
        """Return the coupling y - y0 = a + b (x - x0) of two joints or fixed tendons, 0: of the reference position."""
        first, second = (int(self.model[key][index]) for key in ("eq_obj1id", "eq_obj2id"))
        a, b, *further = self.model["eq_data"][index][:5]
        if any(further) and second >= 0:
            message = f"polycoef is {text_of([a, b, *further])}; allowed: a constant and a linear term"
            self.model.fail("equality", index, message)
        of = self._length(index, kind, first)
        to = self._length(index, kind, second) if second >= 0 else ({}, 0.0)
        factors = dict(of[0])
        for coordinate, factor in to[0].items():
            factors[coordinate] = factors.get(coordinate, 0.0) - b * factor
        return self._coupling(index, name, factors, a + of[1] - b * to[1])

    def _length(self, index: int, kind: str, number: int) -> tuple[dict[str, float], float]:
        """Return factors of coordinates in what a constraint couples, and its value in the reference position."""
        if kind == "joint":
            coordinate, start = self.bodies.coordinates[number]
            return {coordinate: 1.0}, start
        if not self._is_fixed(number):
            name = self.model.names["tendon"][number]
            self.model.fail("equality", index, f"tendon {show(name)} is no <fixed> one; allowed: fixed tendons")
        return self._factors(number), float(self.model["tendon_length0"][number])

    def _coupling(
        self, index: int, name: str, factors: Mapping[str, float], value: float, law: Coordinate | None = None
    ) -> Coupling:
        """Return the coupling: sum of factor * coordinate = value; its first coordinate follows the others.

        law: of the sum.
        """
        factors = {coordinate: factor for coordinate, factor in factors.items() if factor}
        if not factors:
            kind = "equality" if law is None else "tendon"
            self.model.fail(kind, index, "no coordinate counts; allowed: coefficients that are not 0")
        (of, scale), *others = factors.items()
        if law is not None:
            law = Coordinate(
                stiffness=law.stiffness and law.stiffness * scale**2,
                damping=law.damping and law.damping * scale**2,
                cubic=law.cubic and law.cubic * scale**4,
            )
        ratios = {coordinate: -factor / scale for coordinate, factor in others}
        return Coupling(name, of, ratios, float(value / scale) or None, law)

    def _loop(self, index: int, kind: str, name: str) -> Loop:
        """Return the loop of a connect (a ball joint) or a weld (a fixed joint)."""
        data, ends = self.model["eq_data"][index], []
        by_sites = self.model.words["eq_objtype"][index] == "site"
        poses = [Pose(np.eye(3), data[:3]), Pose(np.eye(3), data[3:6])]
        if kind == "weld" and not by_sites:  # first is body2's point in MuJoCo
            poses = [Pose(rotation_from_quaternion(data[6:10]), data[3:6]), Pose(np.eye(3), data[:3])]
        for key, pose in zip(("eq_obj1id", "eq_obj2id"), poses, strict=True):
            body = int(self.model[key][index])
            if by_sites:
                pose, body = self.model.pose("site_", body), int(self.model["site_bodyid"][body])
            if kind == "connect":  # how its frames are turned does not matter
                pose = Pose(np.eye(3), pose.xyz)
            ends.append((self.bodies.links[body], pose.placement()))
        (first, at_first), (second, at_second) = ends
        if first == second:
            self.model.fail("equality", index, f"both ends are on {first!r}; allowed: two different bodies")
        at_origin = (x for x, row in JOINT_TYPES.items() if row.equality == kind and row.points == (0.0,))
        return Loop(name, (first, second), next(at_origin), (at_first, at_second))

    def _wraps(self, tendon: int) -> range:
        first, count = (int(self.model[f"tendon_{key}"][tendon]) for key in ("adr", "num"))
        return range(first, first + count)

    def _is_fixed(self, tendon: int) -> bool:
        return all(self.model.words["wrap_type"][wrap] == "joint" for wrap in self._wraps(tendon))

    def _factors(self, tendon: int) -> dict[str, float]:
        """Return factors of coordinates in the length of a fixed tendon."""
        factors: dict[str, float] = {}
        for wrap in self._wraps(tendon):
            coordinate, _ = self.bodies.coordinates[int(self.model["wrap_objid"][wrap])]
            factors[coordinate] = factors.get(coordinate, 0.0) + float(self.model["wrap_prm"][wrap])
        return factors

    def _tendon(self, index: int) -> None:
        """Read a tendon that has forces: a spring between two points, or an elastic coupling."""
        if not any(any(self.model.numbers(f"tendon_{key}", index)) for key in _FORCES):
            return
        for key in _FORCES[2:]:
            if (number := self.model.numbers(f"tendon_{key}", index)[0]) != 0.0:
                message = f"{key} is {number:g}, which is not supported; allowed: stiffness and damping"
                self.model.fail("tendon", index, message)
        lower, upper = self.model.numbers("tendon_lengthspring", index)
        if lower != upper:
            message = f"springlength is {text_of([lower, upper])}, with a slack range; allowed: one length"
            self.model.fail("tendon", index, message)
        text = self.model.names["tendon"][index]
        if not self._is_fixed(index):
            self._spring(index, text, lower)
            return
        stiffness, cubic = self.model.law("tendon", index, "tendon_stiffness", index)
        damping, _ = self.model.law("tendon", index, "tendon_damping", index, cubic=False)
        if stiffness or cubic or damping:
            law = Coordinate(stiffness or None, damping or None, cubic=cubic or None)
            name = self.names.fresh(text.removeprefix(_PREFIX) or "tendon")
            self.draft.couplings[name] = self._coupling(index, name, self._factors(index), lower, law)
            self.bodies.written[f"couplings.{name}"] = self.model.lines["tendon"][index]

    def _spring(self, index: int, text: str, length: float) -> None:
        """Read a tendon that is a straight line between two sites."""
        along = self._wraps(index)
        if len(along) != 2 or any(self.model.words["wrap_type"][wrap] != "site" for wrap in along):
            message = "it has forces and is no straight line between two sites"
            self.model.fail("tendon", index, f"{message}; allowed: <fixed>, or <spatial> with two <site>")
        sites = [int(self.model["wrap_objid"][wrap]) for wrap in along]
        first, second = (int(self.model["site_bodyid"][site]) for site in sites)
        stiffness, damping = (
            self.model.law("tendon", index, key, index, cubic=False)[0]
            for key in ("tendon_stiffness", "tendon_damping")
        )
        if self.bodies.carriers[first] == self.bodies.carriers[second] or not (stiffness or damping):
            return  # its length is constant, or it does nothing
        name = self.names.fresh(text or "tendon")
        points = triple(self.model["site_pos"][sites[0]]), triple(self.model["site_pos"][sites[1]])
        links = self.bodies.links[first], self.bodies.links[second]
        self.draft.elements[name] = Spring(name, links, points, length, stiffness or None, damping or None)


def _consistent_home(start: dict[str, float], couplings: Iterable[Coupling]) -> dict[str, float]:
    """Return the reference position without coordinates that couplings put elsewhere."""
    gone: set[str] = set()
    rules = list(couplings)
    for _ in rules:
        for x in rules:
            there = sum((ratio * start.get(name, 0.0) for name, ratio in x.to.items()), x.offset or 0.0)
            if abs(start.get(x.of, 0.0) - there) > _AGREES or not gone.isdisjoint(x.to):
                gone.add(x.of)
    return {name: value for name, value in start.items() if name not in gone}
