"""Bind a model's numbers: bodies with placements and pseudo-inertias over any kind of scalar.

The scalar is what ``value`` returns for a name: a float, a SymPy expression, or a node of a program.  All three know
``+ - *``, and sine and cosine come from ``sincos``, so that one source serves the numerical reference, closed-form
equations and generated code.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from eomgen.errors import InputError
from eomgen.names import component_name, joint_of
from eomgen.robot.elements import KINDS
from eomgen.robot.elements.joint_damping import JOINT_DAMPING
from eomgen.robot.elements.journal import RADIAL
from eomgen.robot.geometry import IDENTITY, snap
from eomgen.robot.laws import given_laws
from eomgen.robot.model import FIXED_BODY, Model, turned_name
from eomgen.robot.value import ANGULAR, COORDINATES, INERTIA_KEYS, LINEAR, MOTOR, Coordinate, Joint, Placement, loaded

from .spatial import (
    ZERO,
    Mat,
    Pose,
    PseudoInertia,
    Scalar,
    Vec,
    about,
    add,
    along,
    congruence,
    is_zero,
    mat3,
    matmul,
    matvec,
    scale,
    transpose,
    vec3,
)

Cuts = tuple[tuple[tuple[int, Pose], tuple[int, Pose]], ...]  # per loop, on both links: the body, the cut frame in it


@dataclass(frozen=True)
class BoundBody:
    """A body with its numbers: placement of its joint frame in the parent body's frame, and its pseudo-inertia."""

    placement: Pose
    inertia: PseudoInertia


@dataclass(frozen=True)
class BoundLaw:
    """The force of one coordinate, of a joint or elsewhere: a straight line, and whatever laws add to it.

    stiffness, damping: of the straight line.  numbers: of laws (``Coordinate.law``, with "stiffness" where that is not
    a straight line's); knots: deviations of the curve.  carriers: what presses on it where its friction depends on
    that, by the indices of coordinates; of a cut joint's by their places in ``COORDINATES``.
    """

    stiffness: Scalar
    damping: Scalar
    numbers: Mapping[str, Scalar] = field(default_factory=dict)
    knots: tuple[float, ...] = ()
    carriers: tuple[int, ...] = ()


@dataclass(frozen=True)
class BoundTransmission:
    """The spring between a motor and the coordinate with the index ``principal``, in units of the joint's side.

    ``inverse_ratio`` is 1 / ratio.
    """

    principal: int
    inverse_ratio: Scalar
    law: BoundLaw


@dataclass(frozen=True)
class BoundElement:
    """A force element between two links: per end (body, pose in its frame), its numbers, and its elongations.

    ``numbers``: ``LinkElement.law``; the optional ones are always there, 0 where none is given.
    """

    name: str
    links: tuple[str, str]
    ends: tuple[tuple[int, Pose], tuple[int, Pose]]
    numbers: Mapping[str, Scalar]
    knots: tuple[float, ...] = ()


@dataclass(frozen=True)
class BoundJointElement:
    """A force element of a joint as a whole: its name, indices of its coordinates by their names, ``JointElement.law``.

    Of a cut joint ``index`` are places among those of its coordinates that its journal feels.
    """

    joint: str
    index: Mapping[str, int]
    numbers: Mapping[str, Scalar]


@dataclass(frozen=True)
class BoundCoupling:
    """value(of) - sum of ratio * coordinate - offset, which vanishes or has a law; coordinates by their indices."""

    arms: Mapping[int, Scalar]
    offset: Scalar
    law: BoundLaw | None

    def gap(self, q: Sequence[Scalar]) -> Scalar:
        """Return by how much the coordinates are off."""
        return along(self.arms, q) - self.offset


@dataclass(frozen=True)
class Bound:
    """A model with its numbers, in the model's order; ``links`` and ``frames`` hold (body, pose in that body).

    ``coms`` are the links' centres of mass in their bodies' frames, ``cuts`` per loop the cut frame on both links;
    ``laws``, ``armature`` and ``angle_offsets`` (added to an angle before it turns, rad) are per coordinate.
    ``at_rest`` is the first moment (kg m, base frame) of mass that regrouping moved to the base: its weight is a
    constant of the potential energy.
    ``transmissions`` holds, by the index of a motor's coordinate, what is between it and its joint; its inertia is an
    armature.
    ``elements`` are force elements between two links, by the tables that list them.
    ``cut_offsets`` holds per loop what its six coordinates keep to, ``cut_laws`` the forces of some of them by the
    loop's number and the coordinate's name; ``couplings`` are those of coordinates; ``journals`` stand in bearings,
    ``cut_journals`` in those of cut joints, by the loop's number.
    ``joint_damping`` is that of joints whatever their coordinates.
    """

    gravity: Vec
    bodies: tuple[BoundBody, ...]
    frames: dict[str, tuple[int, Pose]]
    coms: dict[str, tuple[int, Vec]]
    laws: tuple[BoundLaw, ...]
    armature: tuple[Scalar, ...]
    angle_offsets: tuple[Scalar, ...]
    at_rest: Vec = ZERO
    cuts: Cuts = ()
    transmissions: Mapping[int, BoundTransmission] = field(default_factory=dict)
    elements: Mapping[str, tuple[BoundElement, ...]] = field(default_factory=dict)
    cut_offsets: tuple[tuple[Scalar, ...], ...] = ()
    cut_laws: Mapping[tuple[int, str], BoundLaw] = field(default_factory=dict)
    couplings: tuple[BoundCoupling, ...] = ()
    journals: tuple[BoundJointElement, ...] = ()
    cut_journals: Mapping[int, BoundJointElement] = field(default_factory=dict)
    joint_damping: tuple[BoundJointElement, ...] = ()


def bind(
    model: Model,
    value: Callable[[str, float], Scalar],
    sincos: Callable[[Scalar], tuple[Scalar, Scalar]],
) -> Bound:
    """Bind bodies of the model with every number passed through ``value(name, number)``.

    Args:
        value: turns a named number into a scalar.
        sincos: sine and cosine of a scalar (used for rotations whose angles are parameters).
    """
    binder = _Binder(model, value, sincos)
    robot = model.robot
    poses: dict[str, tuple[int, Pose]] = {robot.base: (FIXED_BODY, Pose(IDENTITY, ZERO))}
    placements: list[Pose] = []
    for joint in robot.joints:
        body, parent = poses[joint.parent]
        placed = parent @ binder.placed(f"joints.{joint.name}.placement", joint.placement)
        axes, back = Pose(joint.axis_turn, ZERO), Pose(transpose(joint.axis_turn), ZERO)
        if joint.coordinates:
            placements.append(binder.turned(joint, placed @ axes @ binder.shift(joint)))
            poses[joint.child] = (len(placements) - 1, back)
        elif any(f"joints.{joint.name}.offset.{name}" in model.parameters for name in COORDINATES):
            poses[joint.child] = (body, placed @ axes @ binder.shift(joint) @ binder.turn(joint) @ back)
        else:
            poses[joint.child] = (body, placed)
    inertias = [PseudoInertia((ZERO,) * 3, ZERO, 0.0)] * len(placements)
    coms: dict[str, tuple[int, Vec]] = {}
    for link in robot.links:
        body, pose = poses[link.name]
        if body != FIXED_BODY:
            inertia, com = binder.pseudo_inertia(link.name)
            inertias[body] = inertias[body] + congruence(pose, inertia)
            coms[link.name] = (body, add(matvec(pose.rotation, com), pose.origin))
    laws, armature = binder.laws()
    return Bound(
        bodies=tuple(BoundBody(p, h) for p, h in zip(placements, inertias, strict=True)),
        coms=coms,
        laws=laws,
        armature=armature,
        angle_offsets=binder.angle_offsets(),
        cuts=binder.cuts(poses),
        frames=binder.frames(poses),
        transmissions=binder.transmissions(),
        gravity=binder.triple("gravity", robot.gravity),
        elements={table: binder.elements(table, poses) for table in KINDS},
        cut_offsets=binder.cut_offsets(),
        cut_laws=binder.cut_laws(),
        couplings=binder.couplings(),
        journals=binder.joint_elements(RADIAL),
        cut_journals=binder.cut_journals(),
        joint_damping=binder.joint_elements(JOINT_DAMPING),
    )


class _Binder:
    """Reads named numbers of one model through ``value``."""

    def __init__(self, model: Model, value: Callable[[str, float], Scalar], sincos: Callable[[Scalar], Any]) -> None:
        self.model, self.value, self.sincos = model, value, sincos

    def triple(self, prefix: str, numbers: Sequence[float], keys: Sequence[str] = "xyz") -> Vec:
        return vec3(self.value(f"{prefix}.{key}", number) for key, number in zip(keys, numbers, strict=True))

    def offset(self, joint: Joint, name: str) -> Scalar:
        """The constant that is added to one of a joint's six coordinates."""
        number = joint.offset[COORDINATES.index(name)] or 0.0
        return self.value(f"joints.{joint.name}.offset.{name}", number)

    def shift(self, joint: Joint) -> Pose:
        """The offsets of x, y and z: they come first, so that they belong to the placement."""
        return Pose(IDENTITY, vec3(self.offset(joint, name) for name in LINEAR))

    def turned(self, joint: Joint, placement: Pose) -> Pose:
        """The placement of a joint; where its number "turned" is 1, its axes y, z and x stand in the place of x, y, z.

        The joint's angles are then others, which are not singular where its own are (``Model.turning``).
        """
        c = self.value(turned_name(joint.name), 0.0)
        if is_zero(c):
            return placement
        own = 1.0 - c
        return placement @ Pose(((own, 0.0, c), (c, own, 0.0), (0.0, c, own)), ZERO)

    def turn(self, joint: Joint) -> Pose:
        """The offsets of the angles of a joint that does not move, Rx Ry Rz."""
        x, y, z = (about(axis, *self._turn(self.offset(joint, name))) for axis, name in enumerate(ANGULAR))
        return Pose(matmul(matmul(x, y), z), ZERO)

    def angle_offsets(self) -> tuple[Scalar, ...]:
        """Constant offsets of the angles, 0 for translations, one per coordinate.

        Raises:
            InputError: a joint that moves has an offset in an angle that is no coordinate of this model.
        """
        for body in self.model.bodies:
            for name in self.model.offset_angles(body.joint):
                raise InputError(
                    f"joints.{body.joint}.offset.{name}: the closed form and the textbook's algorithms know no offset"
                    " of an angle that is not active; give the angle a table, or leave the offset out"
                )
        return tuple(
            self.offset(joint, name) if name in ANGULAR else 0.0
            for joint in self.model.robot.joints
            for name in joint.all_coordinates
        )

    def placed(self, prefix: str, given: Placement) -> Pose:
        """The pose of a placement whose numbers have names that begin so."""
        rotation: Mat = given.rotation
        if given.rpy is not None and any(f"{prefix}.rpy.{i}" in self.model.parameters for i in range(3)):
            rotation = self._rotation(self.triple(f"{prefix}.rpy", given.rpy, "012"))
        return Pose(rotation, self.triple(f"{prefix}.xyz", given.xyz, "012"))

    def _rotation(self, rpy: Vec) -> Mat:
        (sr, cr), (sp, cp), (sy, cy) = (self._turn(angle) for angle in rpy)
        return (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )

    def _turn(self, angle: Scalar) -> tuple[Scalar, Scalar]:
        """Sine and cosine; of a number as the description reads it, so that right angles prune."""
        return (snap(math.sin(angle)), snap(math.cos(angle))) if isinstance(angle, float) else self.sincos(angle)

    def pseudo_inertia(self, name: str) -> tuple[PseudoInertia, Vec]:
        """H of a link in its own frame, and its centre of mass: J = 1/2 tr(I) 1 - I about the origin."""
        link = self.model.robot.link(name)
        mass = self.value(f"links.{name}.mass", link.mass)
        com = self.triple(f"links.{name}.com", link.com)
        numbers = dict(zip(INERTIA_KEYS, link.inertia, strict=True))
        xx, yy, zz, xy, xz, yz = self._values(f"links.{name}.inertia", numbers).values()
        about_com = (
            ((yy + zz - xx) * 0.5, -xy, -xz),
            (-xy, (xx + zz - yy) * 0.5, -yz),
            (-xz, -yz, (xx + yy - zz) * 0.5),
        )
        first = scale(mass, com)
        second = mat3(tuple(about_com[i][j] + first[i] * com[j] for j in range(3)) for i in range(3))
        return PseudoInertia(second, first, mass), com

    def frames(self, poses: dict[str, tuple[int, Pose]]) -> dict[str, tuple[int, Pose]]:
        found = dict(poses)
        for frame in self.model.robot.frames:
            body, pose = poses[frame.link]
            found[frame.name] = (body, pose @ self.placed(f"frames.{frame.name}.placement", frame.placement))
        return {name: found[name] for name in self.model.frames}

    def cuts(self, poses: dict[str, tuple[int, Pose]]) -> Cuts:
        """The bodies of each loop's links, with the cut frame in each."""
        found = []
        for loop in self.model.robot.loops:
            sides = []
            for i, (link, placement) in enumerate(zip(loop.links, loop.placements, strict=True)):
                body, pose = poses[link]
                sides.append((body, pose @ self.placed(f"loops.{loop.name}.placements.{i}", placement)))
            found.append((sides[0], sides[1]))
        return tuple(found)

    def cut_offsets(self) -> tuple[tuple[Scalar, ...], ...]:
        """Offsets that the six coordinates of each cut joint keep to."""
        found = []
        for loop in self.model.robot.loops:
            numbers = {name: number or 0.0 for name, number in zip(COORDINATES, loop.offset, strict=True)}
            found.append(tuple(self._values(f"loops.{loop.name}.offset", numbers).values()))
        return tuple(found)

    def cut_laws(self) -> dict[tuple[int, str], BoundLaw]:
        """Forces of cut joints' coordinates."""
        given = {(owner, name) for owner, name, _ in self.model.cut_laws}
        found = {}
        for number, loop in enumerate(self.model.robot.loops):
            carriers = loaded(loop.coordinates)
            for name, coordinate in loop.coordinates.items():
                if (loop.name, name) in given:
                    law = self._bound_law(f"loops.{loop.name}.{name}", coordinate)
                    pressing = tuple(COORDINATES.index(other) for other in carriers.get(name, ()))
                    found[number, name] = replace(law, carriers=pressing)
        return found

    def couplings(self) -> tuple[BoundCoupling, ...]:
        """Couplings of coordinates."""
        found, place = [], self.model.coordinates.index
        acting = {owner for owner, name, _ in self.model.cut_laws if not name}
        for coupling in self.model.robot.couplings:
            prefix = f"couplings.{coupling.name}"
            arms: dict[int, Scalar] = {place(coupling.of): 1.0}
            for name, ratio in coupling.to.items():
                arms[place(name)] = -1.0 * self.value(f"{prefix}.ratio.{name}", ratio)
            offset = self.value(f"{prefix}.offset", coupling.offset or 0.0)
            if coupling.law is None:
                found.append(BoundCoupling(arms, offset, None))
            elif coupling.name in acting:
                found.append(BoundCoupling(arms, offset, self._bound_law(prefix, coupling.law)))
        return tuple(found)

    def joint_elements(self, table: str) -> tuple[BoundJointElement, ...]:
        """Force elements of joints as wholes, of the kind that has this table, in the order of the joints."""
        found = []
        for body in self.model.bodies:
            given = self.model.robot.joint(body.joint).elements.get(table)
            if given is not None:
                numbers = self._values(f"joints.{body.joint}.{table}", given.law())
                index = dict(zip(body.active, body.indices, strict=True))
                found.append(BoundJointElement(body.joint, index, numbers))
        return tuple(found)

    def cut_journals(self) -> dict[int, BoundJointElement]:
        """Journals in bearings of cut joints."""
        found = {}
        for number, loop in enumerate(self.model.robot.loops):
            if loop.radial is not None:
                numbers = self._values(f"loops.{loop.name}.{RADIAL}", loop.radial.law())
                index = {name: place for place, name in enumerate(loop.radial.felt)}
                found[number] = BoundJointElement(loop.name, index, numbers)
        return found

    def _values(self, prefix: str, law: Mapping[str, float]) -> dict[str, Scalar]:
        """Numbers of a law, where they stand among the parameters."""
        return {key: self.value(f"{prefix}.{key}", number) for key, number in law.items()}

    def _bound_law(self, prefix: str, given: Coordinate) -> BoundLaw:
        stiffness = 0.0 if _is_bent(given) else self.value(f"{prefix}.stiffness", given.stiffness or 0.0)
        damping = self.value(f"{prefix}.damping", given.damping or 0.0)
        return BoundLaw(stiffness, damping, self._law(prefix, given), _knots(given))

    def elements(self, table: str, poses: dict[str, tuple[int, Pose]]) -> tuple[BoundElement, ...]:
        """The force elements of one table, each with its ends in the bodies' frames."""
        found = []
        for element in self.model.robot.link_elements:
            if table != element.TABLE:
                continue
            ends = []
            for link, (key, end) in zip(element.links, element.ends().items(), strict=True):
                body, pose = poses[link]
                name = f"{element.prefix}.{key}"
                at = self.placed(name, end) if isinstance(end, Placement) else Pose(IDENTITY, self.triple(name, end))
                ends.append((body, pose @ at))
            given = {**dict.fromkeys(KINDS[table].ALWAYS, 0.0), **element.law()}
            numbers = self._values(element.prefix, given)
            found.append(BoundElement(element.name, element.links, (ends[0], ends[1]), numbers, element.knots()))
        return tuple(found)

    def laws(self) -> tuple[tuple[BoundLaw, ...], tuple[Scalar, ...]]:
        """Forces and armatures of all coordinates; the spring and damper of a motor's table are its transmission's."""
        place = self.model.coordinates.index
        numbers = [self._law(prefix, given) for _, prefix, given in self._coordinates()]
        carriers = {
            f"joints.{joint.name}.{name}": tuple(place(component_name(joint.name, x)) for x in others)
            for joint in self.model.robot.joints
            for name, others in loaded(joint.coordinates).items()
        }
        laws, armatures = list[BoundLaw](), list[Scalar]()
        for (name, prefix, given), law in zip(self._coordinates(), numbers, strict=True):
            if name == MOTOR:
                laws.append(BoundLaw(0.0, 0.0, law, _knots(given)))
                armatures.append(self.value(f"{prefix}.inertia", given.armature or 0.0))
                continue
            keys = ("stiffness", "damping", "armature")
            k, c, armature = (self.value(f"{prefix}.{key}", getattr(given, key) or 0.0) for key in keys)
            laws.append(BoundLaw(0.0 if _is_bent(given) else k, c, law, _knots(given), carriers.get(prefix, ())))
            armatures.append(armature)
        return tuple(laws), tuple(armatures)

    def transmissions(self) -> dict[int, BoundTransmission]:
        """Transmissions between motors and joints, by the index of a motor's coordinate."""
        found: dict[int, BoundTransmission] = {}
        for index, principal in self.model.motors.items():
            name = self.model.coordinates[index]
            motor = self.model.robot.joint(joint_of(name)).motor
            assert motor is not None
            law = self._bound_law(f"joints.{name}", motor.transmission)
            inverse = 1.0 / self.value(f"joints.{name}.ratio", motor.ratio)
            found[index] = BoundTransmission(principal, inverse, law)
        return found

    def _law(self, prefix: str, given: Coordinate) -> dict[str, Scalar]:
        law = self._values(prefix, given.law())
        if _is_bent(given):
            law["stiffness"] = self.value(f"{prefix}.stiffness", given.stiffness or 0.0)
        return law

    def _coordinates(self) -> Iterator[tuple[str, str, Coordinate]]:
        for joint in self.model.robot.joints:
            for name, given in joint.all_coordinates.items():
                yield name, f"joints.{joint.name}.{name}", given


def _knots(given: Coordinate) -> tuple[float, ...]:
    """Deviations of a coordinate's curve."""
    return tuple(deviation for deviation, _ in given.curve or ())


def _is_bent(given: Coordinate) -> bool:
    """Whether the stiffness is not that of one straight line."""
    return any(law.takes_stiffness for law in given_laws(given.law()))
