"""Robot -> Model: the ordered tree of moving bodies, their coordinates, and the run-time parameters.

A body is a set of links that fixed joints hold together; its frame is its joint's frame after the motion, so the
principal axis is its z axis.  Numbers stay in the Robot: the generator binds them (``eomgen.codegen.tree.bound``) as
constants or, for the names in ``Model.parameters``, as run-time parameters.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NoReturn

from ..errors import DescriptionError, UnknownNameError
from ..identifiers import IDENTIFIER_RULE, ROBOT_RULE, check_kind, is_identifier, is_robot_name, parameter_path
from ..lazily import kept
from ..names import component_name, joint_of, kind_of, listed, parameter_name, show
from .coordinates import coordinate_names
from .elements import MATRICES
from .elements.joint_element import missing_table
from .geometry import JointFacts
from .internal_states.drives import DRIVE
from .internal_states.states import OwnedState
from .joint_types import CUTS, rigid_components
from .laws import ARMATURE, states_of
from .mechanism import coordinate_of, driven_coordinates, leading_home, mechanism_conflict, position_limits
from .numbers import Conflict
from .parameter_names import following_modes, number_of
from .rules import coordinate_conflict, cut_conflict, motor_conflict, unmoved
from .value import ANGULAR, COORDINATES, LINEAR, MOTOR, Coordinate, Coupling, Joint, Loop, Robot

FIXED_BODY = -1  # links on the base without a moving joint


@dataclass(frozen=True)
class Body:
    """A moving body: ``parent`` is a body's index or FIXED_BODY, ``first`` the index of its first coordinate.

    ``active`` names the active coordinates of its joint in canonical order, but for followers; ``links`` the links it
    is made of, the joint's child first.  A joint's motor moves no body: its coordinate is behind these
    (``Model.motors``).  ``modes`` are the indices of the modal coordinates of a body that bends, behind those.
    """

    joint: str
    parent: int
    first: int
    active: tuple[str, ...]
    links: tuple[str, ...]
    modes: range = range(0)

    @property
    def name(self) -> str:
        """Name of the joint's child link."""
        return self.links[0]

    @property
    def indices(self) -> range:
        """Indices of the joint's coordinates in q, without its motor's."""
        return range(self.first, self.first + len(self.active))


@dataclass(frozen=True)
class Model:
    """The tree that equations are derived for.

    ``bodies`` are in depth-first order; ``coordinates`` are the names ("joint1.x", ...) in the order of q;
    ``links`` are the links that move; ``body_of`` has the index of each link's body; ``parameters`` maps the run-time
    parameters to their values in the description.
    ``followers`` has the couplings of followers, as ``Robot.followers``; none where followers are coordinates
    (``with_followers``).  ``facts`` are what SymPy derived of joints, by their active coordinates; the generator
    derives those that are missing.
    """

    robot: Robot
    bodies: tuple[Body, ...]
    coordinates: tuple[str, ...]
    links: tuple[str, ...]
    body_of: Mapping[str, int]
    parameters: Mapping[str, float]
    followers: Mapping[str, Coupling] = field(default_factory=dict)
    facts: Mapping[tuple[str, ...], JointFacts] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The robot's name."""
        return self.robot.name

    @property
    def size(self) -> int:
        """n + m, the number of what has a rate: coordinates and, behind them, internal states (``internal_states``)."""
        return len(self.coordinates) + len(self.internal_states)

    @cached_property
    def internal_states(self) -> tuple[str, ...]:
        """Names of the internal states, such as "joint1.gamma.friction.z": velocities of inertias without a link."""
        return tuple(state.name for state in self.states)

    @cached_property
    def states(self) -> tuple[OwnedState, ...]:
        """Internal states in the order of their names: of coordinates, transmissions, loop joints and couplings."""
        laws = ((prefix, kind, coordinate.law()) for prefix, kind, coordinate in self.robot.coordinate_laws())
        return tuple(
            OwnedState(prefix, law, numbers, state, kind in LINEAR)
            for prefix, kind, numbers in laws
            for law, state in states_of(numbers)
        )

    @cached_property
    def state_places(self) -> dict[tuple[str, str], tuple[int, ...]]:
        """Indices of states, by the prefix of their law's parameters and its name."""
        places: dict[tuple[str, str], tuple[int, ...]] = {}
        for k, x in enumerate(self.states, len(self.coordinates)):
            places[x.prefix, x.law] = (*places.get((x.prefix, x.law), ()), k)
        return places

    @cached_property
    def drives(self) -> dict[int, tuple[int, ...]]:
        """Index of every coordinate with a drive, with those of the drive's states."""
        keys = {i: (parameter_name("joints", name), DRIVE) for i, name in enumerate(self.coordinates)}
        return {i: self.state_places[key] for i, key in keys.items() if key in self.state_places}

    @cached_property
    def states_of_drives(self) -> tuple[int, ...]:
        """Indices of the states of drives."""
        return tuple(k for states in self.drives.values() for k in states)

    @property
    def velocities(self) -> tuple[str, ...]:
        """Names of all that has a velocity in arrays of the state: coordinates, then internal states."""
        return (*self.coordinates, *self.internal_states)

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of all frames: the description's, then all links, the base first."""
        names = [frame.name for frame in self.robot.frames]
        links = [self.robot.base, *(link.name for link in self.robot.links)]
        return tuple(names + [name for name in links if name not in names])

    @property
    def constraints(self) -> tuple[str, ...]:
        """Names of the components of g(q) = 0, in their order: of loops ("loop1.x", ...), then rigid couplings.

        Couplings that make followers are not among them.
        """
        cut = (
            component_name(loop.name, component.name)
            for loop in self.robot.loops
            for component in rigid_components(loop)
        )
        return (*cut, *(coupling.name for coupling in self.rigid_couplings))

    @property
    def rigid_couplings(self) -> tuple[Coupling, ...]:
        """Couplings that are rows of the constraint."""
        return tuple(x for x in self.robot.couplings if x.law is None and x.of not in self.followers)

    @cached_property
    def tree(self) -> Model:
        """The model in which followers are coordinates, and their couplings rows of the constraint."""
        return replace(build_model(self.robot, with_followers=True), facts=self.facts) if self.followers else self

    @property
    def leading_couplings(self) -> tuple[Coupling, ...]:
        """Couplings that make followers, in the order of the description."""
        return tuple(x for x in self.robot.couplings if x.law is None and x.of in self.followers)

    @cached_property
    def leaders(self) -> dict[str, tuple[str, ...]]:
        """Leaders of each follower, directly or through other followers; in the order of q."""
        leaders: dict[str, tuple[str, ...]] = {}
        for name, coupling in self.followers.items():
            names = {leader for x in coupling.others for leader in leaders.get(x, (x,))}
            leaders[name] = tuple(x for x in self.coordinates if x in names)
        return leaders

    @property
    def cut_laws(self) -> tuple[tuple[str, str, Coordinate], ...]:
        """Force laws of deflections that are no coordinates of the tree: (owner, coordinate, properties), in order.

        Coordinates of loop joints, by the loop's name and the coordinate's; then elastic couplings, by their names and
        "".  Those without a number, set or tunable, have no force and are not among them, unless a journal or a matrix
        depends on them.
        """
        known = {parameter_path(name)[:3] for name in self.parameters}
        known |= {("loops", x.name, name) for x in self.robot.loops for y in x.elements.values() for name in y.felt}
        for kind, owner, *path in map(parameter_path, self.parameters):  # entries of matrices that are 0
            known |= {(kind, owner, name) for name in path[1:] if path[0] in MATRICES and kind == "loops"}
        cut = [(loop.name, name, law) for loop in self.robot.loops for name, law in loop.coordinates.items()]
        coupled = [
            (coupling.name, "", coupling.law)
            for coupling in self.robot.couplings
            if coupling.law is not None
            and any(("couplings", coupling.name, key.partition(".")[0]) in known for key in coupling.law.numbers())
        ]
        return (*(item for item in cut if ("loops", *item[:2]) in known), *coupled)

    @property
    def principal(self) -> tuple[int, ...]:
        """Indices of the coordinates that are their joints' principal ones."""
        kinds = {joint.name: joint.principal for joint in self.robot.joints}
        return tuple(
            body.first + place
            for body in self.bodies
            for place, name in enumerate(body.active)
            if name == kinds[body.joint]
        )

    @property
    def motors(self) -> dict[int, int]:
        """Index of every motor's coordinate, with that of the principal coordinate that it drives."""
        principal = {joint_of(self.coordinates[index]): index for index in self.principal}
        return {
            index: principal[joint_of(name)] for index, name in enumerate(self.coordinates) if kind_of(name) == MOTOR
        }

    @property
    def driven(self) -> tuple[int, ...]:
        """Indices of the actuated coordinates, see ``mechanism.driven_coordinates``."""
        return tuple(map(self.coordinates.index, driven_coordinates(self.robot, self.coordinates)))

    @property
    def home(self) -> tuple[float, ...]:
        """The description's home, (n,), m or rad; a motor without one follows its joint."""
        home = leading_home(self.robot)
        values = [home.get(name, 0.0) for name in self.coordinates]
        for index, principal in self.motors.items():
            motor = self.robot.joint(joint_of(self.coordinates[index])).motor
            assert motor is not None
            if self.coordinates[index] not in home:
                values[index] = motor.ratio * values[principal]
        return tuple(values)

    @property
    def prescribed(self) -> tuple[int, ...]:
        """Indices of the prescribed coordinates."""
        return tuple(i for i, name in enumerate(self.coordinates) if coordinate_of(self.robot, name).prescribed)

    @cached_property
    def turning(self) -> tuple[int, ...]:
        """Indices of the bodies with 3-DOF rotation: free joints and balls, with nothing on their coordinates.

        Such a joint and its damping do not depend on the choice of angles, so that integrations switch the chart of
        its Euler angles where they are singular.  Whatever acts on a coordinate, moves it or refers to one of its
        angles keeps the joint as it is described: laws, armatures, motors, journals, matrices, prescribed motions,
        couplings, offsets of angles.
        """
        coupled = {x for coupling in self.robot.couplings for x in (coupling.of, *coupling.to)}
        return tuple(k for k, body in enumerate(self.bodies) if self._turns(body, coupled))

    def _turns(self, body: Body, coupled: set[str]) -> bool:
        joint, plain = self.robot.joint(body.joint), Coordinate()
        if body.active != (COORDINATES if joint.is_free else ANGULAR):
            return False
        if joint.motor is not None or any(not element.is_isotropic for element in joint.elements.values()):
            return False
        if any(coordinate != plain for coordinate in joint.coordinates.values()) or any(joint.offset[3:]):
            return False
        acting = [f"joints.{joint.name}.{name}." for name in body.active]  # numbers that may come at run time
        acting += [f"joints.{joint.name}.offset.{name}" for name in ANGULAR]
        tuned = any(name.startswith(tuple(acting)) for name in self.parameters)
        return not tuned and not any(component_name(joint.name, name) in coupled for name in body.active)

    def offset_angles(self, joint: str) -> tuple[str, ...]:
        """Return angles of a joint that are not active but have an offset."""
        active = self.robot.joint(joint).coordinates
        return tuple(
            name for name in ANGULAR if name not in active and f"joints.{joint}.offset.{name}" in self.parameters
        )

    def ancestors(self, body: int) -> Iterator[int]:
        """Yield the body and its ancestors, towards the base."""
        while body != FIXED_BODY:
            yield body
            body = self.bodies[body].parent

    def children(self, body: int) -> list[int]:
        """Return the bodies whose parent is the body."""
        return [k for k, other in enumerate(self.bodies) if other.parent == body]


@kept
def build_model(robot: Robot, *, with_followers: bool = False) -> Model:
    """Order the tree, merge what fixed joints hold together, and list the parameters; once for each robot.

    Args:
        robot: the robot.
        with_followers: whether followers are coordinates, and their couplings rows of the constraint.

    Raises:
        DescriptionError: no coordinate is active, so there is nothing to move; or a name is no identifier (the reader
            lets none through, but a Robot can be made without it), or forces that do not go together.
    """
    check_kind("robot", robot, isinstance(robot, Robot), "a Robot (from load_robot)")
    _check_names(robot)
    _check_modes(robot)
    _check_forces(robot)
    bodies: list[Body] = []
    coordinates: list[str] = []
    body_of = {robot.base: FIXED_BODY}
    links: list[list[str]] = []
    bending = {link.name: link.modes for link in robot.links if link.modes is not None}
    followers = {} if with_followers else robot.followers
    for joint in robot.joints:  # depth first: a parent comes before its children
        parent = body_of[joint.parent]
        if joint.coordinates:
            kinds = [kind for kind in joint.all_coordinates if component_name(joint.name, kind) not in followers]
            active = tuple(kind for kind in kinds if kind != MOTOR)
            body_of[joint.child] = len(bodies)
            first = len(coordinates)
            coordinates.extend(component_name(joint.name, kind) for kind in kinds)
            modes = bending[joint.child].names if joint.child in bending else ()
            own = range(len(coordinates), len(coordinates) + len(modes))
            bodies.append(Body(joint.name, parent, first, active, (joint.child,), own))
            links.append([joint.child])
            coordinates.extend(component_name(joint.child, kind) for kind in modes)
        else:
            if joint.child in bending:
                allowed = "a joint that moves, so that it is a body of its own"
                _refuse(
                    robot, f"links.{joint.child}.modes", f"the joint {show(joint.name)} is rigid; allowed: {allowed}"
                )
            body_of[joint.child] = parent
            if parent != FIXED_BODY:
                links[parent].append(joint.child)
    if not bodies:
        allowed = "give at least one joint a type other than fixed, or a deviation"
        _refuse(robot, "joints", f"the robot has no active coordinate; {allowed}")
    _check_loops(robot, body_of)
    _check_elements(robot, body_of)
    conflict = mechanism_conflict(robot)
    if conflict is not None:
        _refuse(robot, *conflict)
    if not coordinates:
        fixed = f"rigid couplings hold all coordinates ({listed(followers)})"
        _refuse(robot, "couplings", f"nothing is left to move: {fixed}; allowed: couplings that leave one")
    merged = tuple(replace(body, links=tuple(names)) for body, names in zip(bodies, links, strict=True))
    moving = tuple(link.name for link in robot.links if body_of[link.name] != FIXED_BODY)
    return Model(robot, merged, tuple(coordinates), moving, body_of, _parameters(robot), followers)


def turned_name(joint: str) -> str:
    """Return the name of the number that says which chart a joint of ``Model.turning`` has: 0 as described, or 1.

    It is no parameter: integrations choose it.
    """
    return parameter_name("joints", joint, "turned")


def with_offset_angles(model: Model) -> tuple[Model, tuple[int, ...]]:
    """Return the model with followers, and angles with an offset, as prescribed coordinates.

    Behind it stand the indices in it of the original model's coordinates.
    """
    joints = []
    for joint in model.robot.joints:
        extra = model.offset_angles(joint.name) if joint.coordinates else ()
        more = {name: Coordinate(prescribed=True) for name in extra}
        joints.append(replace(joint, coordinates={**joint.coordinates, **more}))
    whole = build_model(replace(model.robot, joints=tuple(joints)), with_followers=True)
    whole = replace(whole, facts=model.facts)
    return whole, tuple(whole.coordinates.index(name) for name in model.coordinates)


def _check_names(robot: Robot) -> None:
    """Refuse names that are no identifiers: they go into C and Python."""
    named = [("links", robot.base, is_identifier), ("name", robot.name, is_robot_name)]
    for key in ("links", "joints", "frames", "loops", "couplings"):
        named += [(key, item.name, is_identifier) for item in getattr(robot, key)]
    named += [(element.TABLE, element.name, is_identifier) for element in robot.link_elements]
    for where, name, is_allowed in named:
        if not is_allowed(name):
            rule = ROBOT_RULE if where == "name" else IDENTIFIER_RULE
            raise DescriptionError(f"got {show(name)}; allowed: {rule}", where=where, source=robot.source)


def _check_modes(robot: Robot) -> None:
    """Refuse modes of links that no link can have."""
    for link in robot.links:
        conflict = link.modes.conflict() if link.modes is not None else None
        if conflict is not None:
            _refuse(robot, f"links.{link.name}.modes.{conflict[0]}", conflict[1])
    bound = following_modes(robot, robot.tunable)
    if bound is not None:
        _refuse(robot, "tunable", f"{show(bound[0])}: {bound[1]}")


def _check_loops(robot: Robot, body_of: Mapping[str, int]) -> None:
    """Refuse a loop between links that do not move against each other, and what no reader has seen."""
    for loop in robot.loops:
        where = f"loops.{loop.name}"
        if loop.type not in CUTS:
            _refuse(robot, f"{where}.type", f"got {show(loop.type)}; allowed: {', '.join(CUTS)}")
        _check_pair(robot, body_of, loop.links, f"{where}.links")
        conflicts = {name: cut_conflict(coordinate) for name, coordinate in loop.coordinates.items()}
        if loop.damping is not None and (loop.damping.linear, loop.damping.angular) != (None, None):
            _refuse(robot, f"{where}.damping", "it is isotropic; allowed: a matrix, ratio or loss_factor")
        _refuse_first(robot, where, conflicts | _element_conflicts(loop))


def _check_elements(robot: Robot, body_of: Mapping[str, int]) -> None:
    """Refuse a force element between links that do not move against each other, and what no reader has seen."""
    for element in robot.link_elements:
        _check_pair(robot, body_of, element.links, f"{element.prefix}.links")
        _refuse_first(robot, element.prefix, {"": element.conflict()})


def _check_pair(robot: Robot, body_of: Mapping[str, int], links: tuple[str, str], where: str) -> None:
    """Refuse unknown links, and links that do not move against each other."""
    first, second = links
    for name in links:
        if name not in body_of:
            _refuse(robot, where, f"got {show(name)}; allowed: {', '.join(body_of)}")
    if body_of[first] == body_of[second]:
        _refuse(robot, where, unmoved(first, second))


def _check_forces(robot: Robot) -> None:
    """Refuse numbers of force laws that do not go together, whoever made the Robot."""
    for joint in robot.joints:
        conflicts = {name: coordinate_conflict(coordinate) for name, coordinate in joint.coordinates.items()}
        if joint.motor is not None:
            conflicts[MOTOR] = motor_conflict(joint.motor, joint.type, joint.coordinates)
        _refuse_first(robot, f"joints.{joint.name}", conflicts | _element_conflicts(joint))


def _element_conflicts(owner: Joint | Loop) -> dict[str, Conflict | None]:
    elements = owner.elements
    return {x: element.conflict(owner.coordinates) or missing_table(elements, x) for x, element in elements.items()}


def _refuse_first(robot: Robot, where: str, conflicts: Mapping[str, Conflict | None]) -> None:
    """Refuse the first conflict of those by their tables below a place."""
    for table, conflict in conflicts.items():
        if conflict is not None:
            _refuse(robot, ".".join(filter(None, (where, table, conflict[0]))), conflict[1])


def _refuse(robot: Robot, where: str, message: str) -> NoReturn:
    raise DescriptionError(message, where=where, source=robot.source or robot.name)


def _parameters(robot: Robot) -> dict[str, float]:
    """Return the run-time parameters: gravity, offsets and numbers of forces that are set, and those in ``tunable``."""

    def always(name: str) -> bool:
        kind, *path = parameter_path(name)
        number = number_of(name)
        return kind == "gravity" or "offset" in path[1:2] or (number is not None and number.key != ARMATURE)

    values = dict(robot.numbers())
    chosen = {name for name, value in values.items() if value is not None and always(name)}.union(robot.tunable)
    return {name: value or 0.0 for name, value in values.items() if name in chosen}


def rigid_coordinates(robot: Robot) -> tuple[str, ...]:
    """Return the names of the coordinates of the rigid robot, in their order, without followers.

    Loops may need deviations, so that equations of the rigid robot cannot be derived; its coordinates are named all
    the same.
    """
    rigid = robot.rigid()
    followers = rigid.followers
    return tuple(name for name in coordinate_names(rigid) if name not in followers)


def movable_coordinates(robot: Robot) -> tuple[str, ...]:
    """Return the names of those coordinates of the rigid robot that are not prescribed."""
    rigid = robot.rigid()
    return tuple(name for name in rigid_coordinates(robot) if not coordinate_of(rigid, name).prescribed)


def program_coordinates(robot: Robot) -> tuple[str, ...]:
    """Return the names of the coordinates of a reference: those of the rigid robot that are not prescribed.

    A drive moves each of them, itself or through its motor (``Model.driven``); of free joints all six are among them.
    Where there are loops or couplings, they are those with a drive alone, and the others follow.
    """
    names = movable_coordinates(robot)
    return tuple(driven_coordinates(robot.rigid(), names)) if robot.is_closed else names


def movable_limits(robot: Robot) -> dict[str, tuple[float, float]]:
    """Return limits, m or rad, between which inverse kinematics moves coordinates, by name; infinite without any.

    They are those that a reference moves, but for the coordinates of free joints, and in a closed mechanism the others
    of the rigid robot, which follow.  Deviations are not among them.
    """
    driven = program_coordinates(robot)
    limits = {name: ends for name in driven if (ends := position_limits(robot, name)) is not None}
    if robot.is_closed and driven:
        limits |= {name: (-math.inf, math.inf) for name in movable_coordinates(robot) if name not in driven}
    return limits


def tool_of(robot: Robot, tool: str | None, label: str = "frame") -> str:
    """Return the tool frame; by default "tcp", the first frame, a link called so, or the end of the longest chain."""
    known = build_model(robot).frames
    if tool is not None and (not isinstance(tool, str) or tool not in known):
        raise UnknownNameError(f"{label}: {show(tool)} is unknown; known: {', '.join(known)}")
    depth = {robot.base: 0}
    for joint in robot.joints:
        depth[joint.child] = depth[joint.parent] + bool(joint.coordinates)
    candidates = ["tcp"] if "tcp" in known else [frame.name for frame in robot.frames]
    candidates += [name for name in known if name.endswith(("tcp", "tool0"))]
    return tool or (candidates[0] if candidates else max(depth, key=lambda name: depth[name]))


def open_tree(robot: Robot) -> str:
    """Say, for reports on a robot's tree, that its loops and couplings are open there; "" where it has none."""
    followed = [coupling.name for coupling in robot.followers.values()]
    loops = [loop.name for loop in robot.loops]
    couplings = [coupling.name for coupling in robot.couplings if coupling.name not in followed]
    said = [f"the loops are cut ({listed(loops)})"] if loops else []
    said += [f"the couplings are left out ({listed(couplings)})"] if couplings else []
    return f"{' and '.join(said)}: all figures are those of the open tree" if said else ""
