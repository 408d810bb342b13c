"""Bind a model's numbers: bodies with placements and pseudo-inertias over any kind of scalar.

The scalar is what ``value`` returns for a name: a float, a SymPy expression, or a node of a program.  All three know
``+ - *``, and sine and cosine come from ``sincos``, so that one source serves the numerical reference, closed-form
equations and generated code.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from eomgen.errors import InputError
from eomgen.names import component_name, joint_of, kind_of
from eomgen.robot.coordinates import MODE
from eomgen.robot.elements import KINDS, MATRICES
from eomgen.robot.elements.joint_damping import JOINT_DAMPING
from eomgen.robot.elements.joint_stiffness import JOINT_STIFFNESS
from eomgen.robot.elements.journal import RADIAL
from eomgen.robot.geometry import IDENTITY, snap
from eomgen.robot.laws import active_laws
from eomgen.robot.model import FIXED_BODY, Model, turned_name
from eomgen.robot.value import (
    ANGULAR,
    COORDINATES,
    INERTIA_KEYS,
    LINEAR,
    MOTOR,
    Coordinate,
    Joint,
    Link,
    Placement,
    Robot,
    load_dependent,
)
from eomgen.robot.value.coupling import PER_RADIAN
from eomgen.robot.value.modes import DIAGONALS, coupling_name

from .modal import Bent, Modal, constants_of
from .spatial import (
    ZERO,
    ExactPose,
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
    subtract,
    transpose,
    vec3,
)

Cuts = tuple[tuple[tuple[int, Pose], tuple[int, Pose]], ...]  # per loop, on both links: the body, the cut frame in it

NEAR = 8.0  # a frame moves where masses behind it are so many times nearer to the parent's frame


@dataclass(frozen=True)
class BoundBody:
    """A body with its numbers: placement of its joint frame in the parent body's frame, and its pseudo-inertia.

    modal: constants of a body that bends, whose pseudo-inertia is that while nothing bends.  bent: the same where q
    is (``bending``), with the pseudo-inertia of then.  shares: of a node's coordinates in the modes of the body that it
    stands on, both by their indices.
    """

    placement: Pose
    inertia: PseudoInertia
    modal: Modal | None = None
    bent: Bent | None = None
    shares: Mapping[int, Mapping[int, Scalar]] = field(default_factory=dict)


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

    ``numbers``: ``LinkElement.law``; the optional ones are always there, 0 by default.
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
class BoundModalCouplings:
    """Entries of K and D of a link's modes beside the diagonal, by pairs of indices (i, j), i < j.

    Both have the same pairs, 0.0 where one has no such entry.
    """

    link: str
    stiffness: Mapping[tuple[int, int], Scalar]
    damping: Mapping[tuple[int, int], Scalar]


@dataclass(frozen=True)
class BoundCoupling:
    """value(of) - sum of ratio * coordinate - offset, which vanishes or has a law; coordinates by their indices.

    bends: by pairs of indices (i, j), i <= j, the second derivative of what a follower's value has of their product.
    """

    jacobian_row: Mapping[int, Scalar]
    offset: Scalar
    law: BoundLaw | None
    bends: Mapping[tuple[int, int], float] = field(default_factory=dict)

    def residual(self, q: Sequence[Scalar]) -> Scalar:
        """Return by how much the coordinates are off."""
        return along(self.jacobian_row, q) - self.offset


@dataclass(frozen=True)
class Bound:
    """A model with its numbers, in the model's order; ``links`` and ``frames`` hold (body, pose in that body).

    ``coms`` are the links' centres of mass in their bodies' frames, ``cuts`` per loop the cut frame on both links;
    ``laws``, ``armature`` and ``angle_offsets`` (added to an angle before it turns, rad) are per coordinate, the first
    two then of internal states (``Model.internal_states``), whose inertia w makes w z^2 / 2 the energy that they store.
    ``at_rest`` is the first moment (kg m, base frame) of mass that regrouping moved to the base: its weight is a
    constant of the potential energy.
    ``transmissions`` holds, by the index of a motor's coordinate, what is between it and its joint; its inertia is an
    armature.
    ``elements`` are force elements between two links, by the tables that list them.
    ``cut_offsets`` holds per loop what its six coordinates keep to, ``cut_laws`` the forces of some of them by the
    loop's number and the coordinate's name; ``couplings`` are those of coordinates; ``journals`` stand in bearings,
    ``cut_journals`` in those of cut joints, by the loop's number.
    ``joint_damping`` is that of joints as wholes, ``joint_stiffness`` that of their stiffness matrices;
    ``cut_matrices`` are both of cut joints, by the loop's number and their tables.
    ``modal_couplings`` are those of links whose modes work on each other.
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
    joint_stiffness: tuple[BoundJointElement, ...] = ()
    cut_matrices: Mapping[tuple[int, str], BoundJointElement] = field(default_factory=dict)
    modal_couplings: tuple[BoundModalCouplings, ...] = ()


def bind(
    model: Model,
    value: Callable[[str, float], Scalar],
    sincos: Callable[[Scalar], tuple[Scalar, Scalar]],
    *,
    near: bool = False,
    named: Callable[[float, str], Scalar] = lambda number, _: number,
) -> Bound:
    """Bind bodies of the model with every number passed through ``value(name, number)``.

    Args:
        value: turns a named number into a scalar.
        sincos: sine and cosine of a scalar (used for rotations whose angles are parameters).
        near: whether frames move that are far from the masses behind them (``_far_joints``).
        named: takes a number that comes from several of the description, and says from which: entries of rotations and
            of products of poses.
    """
    binder = _Binder(model, value, sincos, named)
    robot = model.robot
    poses: dict[str, tuple[int, Pose]] = {robot.base: (FIXED_BODY, Pose(IDENTITY, ZERO))}
    placements: list[Pose] = []
    far = _far_joints(robot) if near else {}
    for joint in robot.joints:
        body, parent = poses[joint.parent]
        placement = binder.placed(f"joints.{joint.name}.placement", joint.placement)
        axes, back = Pose(joint.axis_turn, ZERO), Pose(transpose(joint.axis_turn), ZERO)
        if joint.coordinates:
            if joint.name in far:
                parent = parent.exact()
            placed = parent @ placement @ axes @ binder.shift(joint)
            if joint.name in far and isinstance(placed, ExactPose):
                placed, translation = placed.split(far[joint.name])
                back = translation @ back
            placements.append(binder.turned(joint, binder.rounded(placed, f"placement of {joint.name} in its parent")))
            poses[joint.child] = (len(placements) - 1, back)
            continue
        placed = parent.exact() @ placement
        if any(f"joints.{joint.name}.offset.{name}" in model.parameters for name in COORDINATES):
            placed = placed @ axes @ binder.shift(joint) @ binder.turn(joint) @ back
        poses[joint.child] = (body, placed)
    inertias = [PseudoInertia((ZERO,) * 3, ZERO, 0.0)] * len(placements)
    coms: dict[str, tuple[int, Vec]] = {}
    for link in robot.links:
        body, pose = poses[link.name]
        if body != FIXED_BODY:
            inertia, com = binder.pseudo_inertia(link.name, pose)
            inertias[body] = inertias[body] + inertia
            coms[link.name] = (body, com)
    laws, armature = binder.laws()
    return Bound(
        bodies=tuple(
            BoundBody(p, h, binder.modal(robot.link(body.name), poses[body.name][1]))
            for p, h, body in zip(placements, inertias, model.bodies, strict=True)
        ),
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
        joint_stiffness=binder.joint_elements(JOINT_STIFFNESS),
        cut_matrices=binder.cut_matrices(),
        modal_couplings=binder.modal_couplings(),
    )


def _far_joints(robot: Robot) -> dict[str, tuple[int, ...]]:
    """Return the axes along which frames move to their parents' frames, by joints, where masses behind are near those.

    Distances are those where all coordinates are 0.  A frame may move anywhere if its joint has no rotation, and along
    z if it rotates about z only.  Otherwise second moments that regrouping moves to the parent cancel with placements.
    """
    poses, origins = {robot.base: Pose(IDENTITY, ZERO)}, {robot.base: ZERO}
    for joint in robot.joints:
        poses[joint.child] = poses[joint.parent] @ Pose(joint.placement.rotation, joint.placement.xyz)
    masses = dict.fromkeys(poses, 0.0) | {link.name: link.mass for link in robot.links}
    firsts = dict.fromkeys(poses, ZERO)
    for link in robot.links:
        pose = poses[link.name]
        firsts[link.name] = scale(link.mass, add(matvec(pose.rotation, link.com), pose.origin))
    for joint in reversed(robot.joints):
        masses[joint.parent] += masses[joint.child]
        firsts[joint.parent] = add(firsts[joint.parent], firsts[joint.child])
    far: dict[str, tuple[int, ...]] = {}
    for joint in robot.joints:
        child = joint.child
        origins[child] = poses[child].origin if joint.coordinates else origins[joint.parent]
        turns = set(ANGULAR) & set(joint.coordinates)
        bends = joint.name in robot.nodes or robot.link(child).modes is not None
        if bends or not joint.coordinates or not turns <= {"gamma"} or masses[child] <= 0.0:
            continue
        axes = (2,) if turns else (0, 1, 2)
        back = transpose(matmul(poses[child].rotation, joint.axis_turn))
        centre = matvec(back, subtract(scale(1.0 / masses[child], firsts[child]), origins[child]))
        shift = matvec(back, subtract(origins[joint.parent], origins[child]))
        if math.hypot(*(centre[i] - shift[i] for i in axes)) * NEAR < math.hypot(*(centre[i] for i in axes)):
            far[joint.name] = axes
            moved = vec3(x if i in axes else 0.0 for i, x in enumerate(shift))
            origins[child] = add(origins[child], matvec(transpose(back), moved))
    return far


class _Binder:
    """Reads named numbers of one model through ``value``."""

    def __init__(
        self,
        model: Model,
        value: Callable[[str, float], Scalar],
        sincos: Callable[[Scalar], Any],
        named: Callable[[float, str], Scalar],
    ) -> None:
        self.model, self.value, self.sincos, self.named = model, value, sincos, named

    def rounded(self, pose: Pose, what: str) -> Pose:
        """Round a pose; numbers that have lost their names on the way get one."""
        pose = pose.rounded()
        rotation = mat3(vec3(self._named(x, f"{what}, rotation") for x in row) for row in pose.rotation)
        return Pose(rotation, vec3(self._named(x, f"{what}, {'xyz'[i]}") for i, x in enumerate(pose.origin)))

    def _named(self, number: Scalar, what: str) -> Scalar:
        return self.named(number, what) if type(number) is float and number not in (0.0, 1.0, -1.0) else number

    def modal(self, link: Link, pose: Pose) -> Modal | None:
        """Return the constants of a link's modes in its body's axes; None of a rigid one."""
        return None if link.modes is None else constants_of(link.name, link.modes, pose.rotation, self._named)

    def triple(self, prefix: str, numbers: Sequence[float], keys: Sequence[str] = "xyz") -> Vec:
        return vec3(self.value(f"{prefix}.{key}", number) for key, number in zip(keys, numbers, strict=True))

    def offset(self, joint: Joint, name: str) -> Scalar:
        """Return the constant that is added to one of a joint's six coordinates."""
        number = joint.offset[COORDINATES.index(name)] or 0.0
        return self.value(f"joints.{joint.name}.offset.{name}", number)

    def shift(self, joint: Joint) -> Pose:
        """Return the offsets of x, y and z: they come first, so that they belong to the placement."""
        return Pose(IDENTITY, vec3(self.offset(joint, name) for name in LINEAR))

    def turned(self, joint: Joint, placement: Pose) -> Pose:
        """Place a joint; where its number "turned" is 1, its axes y, z and x stand in the place of x, y, z.

        The joint's angles are then others, which are regular where the usual ones are singular (``Model.turning``).
        """
        c = self.value(turned_name(joint.name), 0.0)
        if is_zero(c):
            return placement
        unturned = 1.0 - c
        return placement @ Pose(((unturned, 0.0, c), (c, unturned, 0.0), (0.0, c, unturned)), ZERO)

    def turn(self, joint: Joint) -> Pose:
        """Rotate by the offsets of the angles of a joint that does not move, Rx Ry Rz."""
        x, y, z = (about(axis, *self._turn(self.offset(joint, name))) for axis, name in enumerate(ANGULAR))
        return Pose(matmul(matmul(x, y), z), ZERO)

    def angle_offsets(self) -> tuple[Scalar, ...]:
        """Return constant offsets of the angles, 0 for translations, one per coordinate.

        Raises:
            InputError: a joint that moves has an offset in an angle that is no coordinate of this model.
        """
        for body in self.model.bodies:
            for name in self.model.offset_angles(body.joint):
                raise InputError(
                    f"joints.{body.joint}.offset.{name}: the closed form and the textbook's algorithms know no offset"
                    " of an angle that is not active; give the angle a table, or leave the offset out"
                )
        robot = self.model.robot
        offsets = {
            component_name(joint.name, name): self.offset(joint, name) for joint in robot.joints for name in ANGULAR
        }
        return tuple(offsets.get(name, 0.0) for name in robot.coordinates)

    def placed(self, prefix: str, placement: Placement) -> Pose:
        """Return the pose of a placement whose numbers have names that begin with ``prefix``."""
        rotation: Mat = mat3(vec3(self._named(x, f"{prefix}, rotation") for x in row) for row in placement.rotation)
        if placement.rpy is not None and any(f"{prefix}.rpy.{i}" in self.model.parameters for i in range(3)):
            rotation = self._rotation(self.triple(f"{prefix}.rpy", placement.rpy, "012"))
        return Pose(rotation, self.triple(f"{prefix}.xyz", placement.xyz, "012"))

    def _rotation(self, rpy: Vec) -> Mat:
        (sr, cr), (sp, cp), (sy, cy) = (self._turn(angle) for angle in rpy)
        return (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )

    def _turn(self, angle: Scalar) -> tuple[Scalar, Scalar]:
        """Return sine and cosine; of a number as the description reads it, so that right angles prune."""
        return (snap(math.sin(angle)), snap(math.cos(angle))) if isinstance(angle, float) else self.sincos(angle)

    def pseudo_inertia(self, name: str, pose: Pose) -> tuple[PseudoInertia, Vec]:
        """Return H of a link that stands at ``pose`` in its body, and its centre of mass there.

        J = 1/2 tr(I) 1 - I is that about the centre of mass, so that nothing but origins cancels in H.
        """
        link = self.model.robot.link(name)
        mass = self.value(f"links.{name}.mass", link.mass)
        com = Pose(IDENTITY, self.triple(f"links.{name}.com", link.com))
        at = self.rounded(pose @ com, f"centre of mass of {name} in its body")
        numbers = dict(zip(INERTIA_KEYS, link.inertia, strict=True))
        xx, yy, zz, xy, xz, yz = self._values(f"links.{name}.inertia", numbers).values()
        about_com = (
            ((yy + zz - xx) * 0.5, -xy, -xz),
            (-xy, (xx + zz - yy) * 0.5, -yz),
            (-xz, -yz, (xx + yy - zz) * 0.5),
        )
        return congruence(at, PseudoInertia(about_com, ZERO, mass)), at.origin

    def frames(self, poses: dict[str, tuple[int, Pose]]) -> dict[str, tuple[int, Pose]]:
        frames = {name: (body, self.rounded(pose, f"link {name} in its body")) for name, (body, pose) in poses.items()}
        for frame in self.model.robot.frames:
            body, pose = poses[frame.link]
            placed = pose @ self.placed(f"frames.{frame.name}.placement", frame.placement)
            frames[frame.name] = (body, self.rounded(placed, f"frame {frame.name} in its body"))
        return {name: frames[name] for name in self.model.frames}

    def cuts(self, poses: dict[str, tuple[int, Pose]]) -> Cuts:
        """Return the bodies of each loop's links, with the cut frame in each."""
        cuts = []
        for loop in self.model.robot.loops:
            sides = []
            for i, (link, placement) in enumerate(zip(loop.links, loop.placements, strict=True)):
                body, pose = poses[link]
                placed = pose @ self.placed(f"loops.{loop.name}.placements.{i}", placement)
                sides.append((body, self.rounded(placed, f"loop {loop.name} in the body of {link}")))
            cuts.append((sides[0], sides[1]))
        return tuple(cuts)

    def cut_offsets(self) -> tuple[tuple[Scalar, ...], ...]:
        """Return the offsets that the six coordinates of each cut joint keep to."""
        offsets = []
        for loop in self.model.robot.loops:
            numbers = {name: number or 0.0 for name, number in zip(COORDINATES, loop.offset, strict=True)}
            offsets.append(tuple(self._values(f"loops.{loop.name}.offset", numbers).values()))
        return tuple(offsets)

    def cut_laws(self) -> dict[tuple[int, str], BoundLaw]:
        """Bind the forces of cut joints' coordinates."""
        with_law = {(owner, name) for owner, name, _ in self.model.cut_laws}
        laws = {}
        for number, loop in enumerate(self.model.robot.loops):
            carriers = load_dependent(loop.coordinates)
            for name, coordinate in loop.coordinates.items():
                if (loop.name, name) in with_law:
                    law = self._bound_law(f"loops.{loop.name}.{name}", coordinate)
                    pressing = tuple(COORDINATES.index(other) for other in carriers.get(name, ()))
                    laws[number, name] = replace(law, carriers=pressing)
        return laws

    def couplings(self) -> tuple[BoundCoupling, ...]:
        """Bind the couplings of coordinates."""
        couplings, place = [], self.model.coordinates.index
        acting = {owner for owner, name, _ in self.model.cut_laws if not name}
        for coupling in self.model.robot.couplings:
            prefix = f"couplings.{coupling.name}"
            row: dict[int, Scalar] = {place(coupling.of): 1.0}
            for name, ratio in coupling.to.items():
                if coupling.pitch is None:
                    row[place(name)] = -1.0 * self.value(f"{prefix}.ratio.{name}", ratio)
                else:
                    row[place(name)] = -PER_RADIAN * self.value(coupling.pitch_name, coupling.pitch)
            offset = self.value(f"{prefix}.offset", coupling.offset or 0.0)
            if coupling.law is None:
                bends = {
                    (place(one), place(other)): self._named(bend, f"{prefix}, second derivative by {one} and {other}")
                    for one, other, bend in coupling.bends
                }
                couplings.append(BoundCoupling(row, offset, None, bends))
            elif coupling.name in acting:
                couplings.append(BoundCoupling(row, offset, self._bound_law(prefix, coupling.law)))
        return tuple(couplings)

    def joint_elements(self, table: str) -> tuple[BoundJointElement, ...]:
        """Bind the force elements of joints as wholes that one table lists, in the order of the joints."""
        elements = []
        for body in self.model.bodies:
            element = self.model.robot.joint(body.joint).elements.get(table)
            if element is not None:
                law = {key: number or 0.0 for key, number in element.numbers(body.active)}
                numbers = self._values(f"joints.{body.joint}.{table}", law)
                index = dict(zip(body.active, body.indices, strict=True))
                elements.append(BoundJointElement(body.joint, index, numbers))
        return tuple(elements)

    def cut_journals(self) -> dict[int, BoundJointElement]:
        """Bind the journals in bearings of cut joints."""
        journals = {}
        for number, loop in enumerate(self.model.robot.loops):
            if loop.radial is not None:
                numbers = self._values(f"loops.{loop.name}.{RADIAL}", loop.radial.law())
                index = {name: place for place, name in enumerate(loop.radial.felt)}
                journals[number] = BoundJointElement(loop.name, index, numbers)
        return journals

    def cut_matrices(self) -> dict[tuple[int, str], BoundJointElement]:
        """Bind the stiffness and damping matrices of cut joints; places are those among their coordinates."""
        matrices = {}
        for number, loop in enumerate(self.model.robot.loops):
            for table in MATRICES:
                if table in loop.elements:
                    law = {key: x or 0.0 for key, x in loop.elements[table].numbers(tuple(loop.coordinates))}
                    index = {name: place for place, name in enumerate(loop.coordinates)}
                    numbers = self._values(f"loops.{loop.name}.{table}", law)
                    matrices[number, table] = BoundJointElement(loop.name, index, numbers)
        return matrices

    def modal_couplings(self) -> tuple[BoundModalCouplings, ...]:
        """Bind what couples modes beside the diagonals of K and D, which are constants."""
        bound = list[BoundModalCouplings]()
        for body in self.model.bodies:
            modes = self.model.robot.link(body.name).modes
            between = {} if modes is None else {key: modes.couplings(key) for key in DIAGONALS}
            pairs = sorted({pair for entries in between.values() for pair in entries})
            if pairs:
                K, D = (
                    {
                        (body.modes[k], body.modes[j]): self.value(coupling_name(body.name, key, k, j), x)
                        for k, j in pairs
                        for x in (entries.get((k, j), 0.0),)
                    }
                    for key, entries in between.items()
                )
                bound.append(BoundModalCouplings(body.name, K, D))
        return tuple(bound)

    def _values(self, prefix: str, law: Mapping[str, float]) -> dict[str, Scalar]:
        """Return the numbers of a law, parameters where they are tunable."""
        return {key: self.value(f"{prefix}.{key}", number) for key, number in law.items()}

    def _bound_law(self, prefix: str, coordinate: Coordinate) -> BoundLaw:
        stiffness = 0.0 if _is_bent(coordinate) else self.value(f"{prefix}.stiffness", coordinate.stiffness or 0.0)
        damping = self.value(f"{prefix}.damping", coordinate.damping or 0.0)
        return BoundLaw(stiffness, damping, self._law(prefix, coordinate), self._knots(prefix, _deviations(coordinate)))

    def _knots(self, prefix: str, deviations: Iterable[float]) -> tuple[float, ...]:
        return tuple(self._named(x, f"{prefix}.curve.{i}.deviation") for i, x in enumerate(deviations))

    def elements(self, table: str, poses: dict[str, tuple[int, Pose]]) -> tuple[BoundElement, ...]:
        """Bind the force elements of one table, each with its ends in the bodies' frames."""
        elements = []
        for element in self.model.robot.link_elements:
            if table != element.TABLE:
                continue
            ends = []
            for link, (key, end) in zip(element.links, element.ends().items(), strict=True):
                body, pose = poses[link]
                name = f"{element.prefix}.{key}"
                at = self.placed(name, end) if isinstance(end, Placement) else Pose(IDENTITY, self.triple(name, end))
                ends.append((body, self.rounded(pose @ at, f"{name} in its body")))
            law = {**dict.fromkeys(KINDS[table].ALWAYS, 0.0), **element.law()}
            numbers = self._values(element.prefix, law)
            knots = self._knots(element.prefix, element.knots())
            elements.append(BoundElement(element.name, element.links, (ends[0], ends[1]), numbers, knots))
        return tuple(elements)

    def laws(self) -> tuple[tuple[BoundLaw, ...], tuple[Scalar, ...]]:
        """Bind forces and armatures of all coordinates; a motor's spring and damper are its transmission's."""
        place = self.model.coordinates.index
        numbers = [self._law(prefix, coordinate) for _, prefix, coordinate in self._coordinates()]
        carriers = {
            f"joints.{joint.name}.{name}": tuple(place(component_name(joint.name, x)) for x in others)
            for joint in self.model.robot.joints
            for name, others in load_dependent(joint.coordinates).items()
        }
        laws, armatures = list[BoundLaw](), list[Scalar]()
        for (name, prefix, coordinate), law in zip(self._coordinates(), numbers, strict=True):
            knots = self._knots(prefix, _deviations(coordinate))
            if name == MOTOR:
                laws.append(BoundLaw(0.0, 0.0, law, knots))
                armatures.append(self.value(f"{prefix}.inertia", coordinate.armature or 0.0))
                continue
            keys = ("stiffness", "damping", "armature")
            k, c, armature = (self.value(f"{prefix}.{key}", getattr(coordinate, key) or 0.0) for key in keys)
            laws.append(BoundLaw(0.0 if _is_bent(coordinate) else k, c, law, knots, carriers.get(prefix, ())))
            armatures.append(armature)
        for x in self.model.states:  # their forces are laws of others
            laws.append(BoundLaw(0.0, 0.0))
            inertia = x.state.inertia
            armatures.append(1.0 if inertia is None else inertia(self._values(x.prefix, x.numbers)))
        return tuple(laws), tuple(armatures)

    def transmissions(self) -> dict[int, BoundTransmission]:
        """Bind the transmissions between motors and joints, by the index of a motor's coordinate."""
        transmissions: dict[int, BoundTransmission] = {}
        for index, principal in self.model.motors.items():
            name = self.model.coordinates[index]
            motor = self.model.robot.joint(joint_of(name)).motor
            assert motor is not None
            law = self._bound_law(f"joints.{name}", motor.transmission)
            inverse = 1.0 / self.value(f"joints.{name}.ratio", motor.ratio)
            transmissions[index] = BoundTransmission(principal, inverse, law)
        return transmissions

    def _law(self, prefix: str, coordinate: Coordinate) -> dict[str, Scalar]:
        law = self._values(prefix, coordinate.law())
        if _is_bent(coordinate):
            law["stiffness"] = self.value(f"{prefix}.stiffness", coordinate.stiffness or 0.0)
        return law

    def _coordinates(self) -> Iterator[tuple[str, str, Coordinate]]:
        """Yield kinds of coordinates, the prefixes of their parameters, and their properties, in the order of q."""
        for name, coordinate in self.model.robot.coordinates.items():
            owner, kind = joint_of(name), kind_of(name)
            if name in self.model.robot.modal_coordinates:
                yield kind, f"links.{owner}.modes.{kind.removeprefix(MODE)}", coordinate
            else:
                yield kind, f"joints.{owner}.{kind}", coordinate


def _deviations(coordinate: Coordinate) -> Iterator[float]:
    """Yield those of a coordinate's curve."""
    return (deviation for deviation, _ in coordinate.curve or ())


def _is_bent(coordinate: Coordinate) -> bool:
    """Whether the stiffness is not that of one straight line."""
    return any(law.takes_stiffness for law in active_laws(coordinate.law()))
