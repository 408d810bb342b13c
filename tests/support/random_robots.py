"""Random small robots with physically possible links: shared by the tests that compare two ways of deriving.

Every robot is a plain ``eomgen.robot.Robot`` built from a NumPy generator, so a failing case is known by its seed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.robot.coordinates import MODE
from eomgen.robot.geometry import IDENTITY, Matrix
from eomgen.robot.laws import states_of
from eomgen.robot.model import build_model
from eomgen.robot.value import (
    ANGULAR,
    COORDINATES,
    MOTOR,
    PRINCIPAL,
    Coordinate,
    Frame,
    Joint,
    Link,
    Loop,
    Placement,
    Robot,
)

Array = NDArray[np.float64]
RIGHT_ANGLES = (0.0, np.pi / 2, -np.pi / 2, np.pi)


@dataclass(frozen=True)
class State:
    """Positions (m, rad), velocities, accelerations and drives of all coordinates, each of shape (n,).

    Attributes:
        z: internal states, (m,).
        rates: of internal states, (m,), of sizes like theirs.
        forces: beside drives with states, (drives,).
    """

    q: Array
    v: Array
    a: Array
    u: Array
    z: Array = field(default_factory=lambda: np.zeros(0))
    rates: Array = field(default_factory=lambda: np.zeros(0))
    forces: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Choices:
    """What random robots are drawn from.

    Attributes:
        max_size: greatest number of coordinates of the robot; joints that would exceed it keep as many as there is
            room for, and at least one (a free joint counts as six).
        tree: branches instead of a chain.
        types: joint types to draw from; "fixed" is a joint whose deviations alone move (any subset of the six).
        rigid: no deviations, only principal coordinates.
        forces: random stiffness and damping on about half of the coordinates, otherwise none.
        armature: random armature on about a third of the coordinates, otherwise none.
        name: the robot's name.
        counts: numbers of active coordinates, 0 to 6, joint by joint, in the place of joints, max_coordinates and
            max_size.
        rods: thin rods among the links, whose inertia is singular; oracles may refuse them.
    """

    max_size: int | None = None
    tree: bool = False
    types: Sequence[str] = ("revolute", "prismatic", "fixed")
    rigid: bool = False
    forces: bool = True
    armature: bool = True
    name: str = "random_robot"
    counts: Sequence[int] | None = None
    rods: bool = True


def random_robot(
    seed: int | np.random.Generator, joints: tuple[int, int] = (1, 3), max_coordinates: int = 6, **choices: Any
) -> Robot:
    """A random robot; the same seed gives the same robot.

    Args:
        seed: an integer or a NumPy generator (which is advanced).
        joints: least and greatest number of joints that move (a joint that is fixed altogether may come on top).
        max_coordinates: greatest number of active coordinates in one joint; a free joint has six all the same.
        **choices: fields of ``Choices``.
    """
    choose = Choices(**choices)
    rng = np.random.default_rng(seed)
    count = int(rng.integers(joints[0], joints[1] + 1)) if choose.counts is None else len(choose.counts)
    room = choose.max_size if choose.max_size is not None else 6 * count
    made: list[Joint] = []
    links: list[Link] = []
    path = ["base"]  # from the base to the newest link; parents from this path keep the depth-first order
    for i in range(count):
        if choose.counts is None:
            kind = str(rng.choice(list(choose.types)))
            spare = room - (count - 1 - i)
            active = _active(rng, kind, max(1, min(max_coordinates, spare)), choose.rigid)
            room -= len(active)
        else:
            kind, active = _counted(rng, choose.types, choose.counts[i], choose.rigid)
        if choose.tree and len(path) > 1:
            path = path[: int(rng.integers(1, len(path) + 1))]
        made.append(
            _joint(rng, f"joint{i + 1}", path[-1], f"link{i + 1}", kind, active, choose.forces, choose.armature)
        )
        links.append(random_link(rng, f"link{i + 1}", choose.rods))
        path.append(f"link{i + 1}")
        if rng.random() < 0.15:  # a link that is welded on: the model merges it
            made.append(Joint(f"weld{i + 1}", path[-1], f"tool{i + 1}", "fixed", random_placement(rng)))
            links.append(random_link(rng, f"tool{i + 1}", choose.rods))
            path.append(f"tool{i + 1}")
    frames = (Frame("tcp", links[-1].name, random_placement(rng)),)
    gravity = _triple(9.81 * random_rotation(rng)[:, 0])
    return Robot(choose.name, gravity, tuple(links), tuple(made), frames)


def with_random_loops(robot: Robot, seed: int | np.random.Generator, types: Sequence[str]) -> Robot:
    """The robot with a loop per type between random links that move against each other."""
    rng = np.random.default_rng(seed)
    body_of = build_model(robot).body_of
    links = [robot.base, *(link.name for link in robot.links)]
    pairs = [(a, b) for a in links for b in links if body_of[a] != body_of[b]]
    loops = []
    for i, kind in enumerate(types):
        a, b = pairs[int(rng.integers(len(pairs)))]
        loops.append(Loop(f"loop{i + 1}", (a, b), kind, (random_placement(rng), random_placement(rng))))
    return replace(robot, loops=tuple(loops))


def seeds(first: int, quick: int, all_of_them: int) -> list[Any]:
    """Seeds of a test from the first on: the quick ones always, others in ``make soak``."""
    further = range(first + quick, first + all_of_them)
    return [*range(first, first + quick), *(pytest.param(seed, marks=pytest.mark.soak) for seed in further)]


def random_state(robot: Robot, seed: int | np.random.Generator) -> State:
    """A random state: any principal coordinate, deviations up to 0.3, no beta near the singular +-pi/2."""
    rng = np.random.default_rng(seed)
    return with_internal_states(robot, state_of_coordinates(robot, rng), rng)


def with_internal_states(robot: Robot, s: State, rng: np.random.Generator) -> State:
    """The state with random ones of laws, of their sizes, and forces beside drives; as it is without any."""
    laws = [c.law() for joint in robot.joints for c in joint.all_coordinates.values()]
    sizes = np.array([state.size(law) for law in laws for _, state in states_of(law)])
    if not sizes.size:
        return s
    z, rates, forces = rng.uniform(-0.8, 0.8, (3, sizes.size))
    return replace(s, z=z * sizes, rates=rates * sizes, forces=forces[: len(build_model(robot).drives)])


def state_of_coordinates(robot: Robot, rng: np.random.Generator) -> State:
    """A random state of coordinates alone, without those of motors where no link bends."""
    if robot.modal_coordinates:  # in the order of q, where nodes' coordinates follow modes
        spans = [span(robot, name) for name in build_model(robot).coordinates]
    else:
        spans = [span(robot, f"{joint.name}.{kind}") for joint in robot.joints for kind in joint.coordinates]
    q = rng.uniform(-1.0, 1.0, len(spans)) * np.array(spans)
    v, a, u = (rng.uniform(-2.0, 2.0, len(spans)) for _ in range(3))
    return State(q, v, a, u)


def span(robot: Robot, name: str) -> float:
    """Return how far a coordinate goes: modes and deviations little, angles beta not to +-pi/2."""
    owner, kind = name.split(".")
    if kind.startswith(MODE):
        return 0.2
    joint = robot.joint(owner)
    wide = kind in (PRINCIPAL.get(joint.type), MOTOR) or joint.type == "free"
    return {"beta": 1.2}.get(kind, 3.0) if wide else 0.3


def random_link(rng: np.random.Generator, name: str, rods: bool = True) -> Link:
    """A link whose pseudo-inertia is positive definite; sometimes with com and axes that prune, or a thin rod."""
    style = rng.random()
    moments = rng.uniform(0.002, 0.1, 3)  # principal second moments, kg m^2: any three that are >= 0 make a body
    com = rng.uniform(-0.3, 0.3, 3)
    axes = random_rotation(rng)
    if style < 0.3:  # diagonal tensor, com on an axis
        axes, com = np.eye(3), com * (np.arange(3) == rng.integers(3))
    elif style < 0.4 and rods:  # thin rod along its own axis: semi-definite
        moments[1:] = 0.0
    J = axes @ np.diag(moments) @ axes.T
    inertia = np.trace(J) * np.eye(3) - J
    xx, yy, zz, xy, xz, yz = (float(inertia[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    return Link(name, float(rng.uniform(0.5, 8.0)), _triple(com), (xx, yy, zz, xy, xz, yz))


def random_rotation(rng: np.random.Generator) -> Array:
    """A uniformly distributed rotation matrix, shape (3, 3)."""
    basis, upper = np.linalg.qr(rng.standard_normal((3, 3)))
    basis = basis * np.sign(np.diag(upper))
    return np.asarray(basis * np.linalg.det(basis), dtype=np.float64)


def random_placement(rng: np.random.Generator) -> Placement:
    """A placement: modified DH or roll-pitch-yaw with right angles, or generic."""
    xyz = _triple(rng.uniform(-0.6, 0.6, 3) * (rng.random(3) < 0.7))
    style = rng.random()
    if style < 0.3:
        a, d = (float(t) for t in rng.uniform(-0.5, 0.5, 2) * (rng.random(2) < 0.7))
        return Placement.from_dh(a, float(rng.choice(RIGHT_ANGLES)), d, float(rng.choice((0.0, np.pi / 2, 0.4))))
    if style < 0.6:
        return Placement.from_rpy(xyz, _triple(rng.choice(RIGHT_ANGLES, 3)))
    return Placement.from_rpy(xyz, _triple(rng.uniform(-1.5, 1.5, 3)))


def _active(rng: np.random.Generator, kind: str, most: int, rigid: bool) -> tuple[str, ...]:
    if kind == "free":
        return COORDINATES
    principal = PRINCIPAL.get(kind)
    if rigid:
        return (principal,) if principal else ("gamma",)
    return _chosen(rng, principal, int(rng.integers(1, most + 1)))


def _counted(rng: np.random.Generator, types: Sequence[str], count: int, rigid: bool) -> tuple[str, tuple[str, ...]]:
    """A type that may have so many active coordinates, and these; a joint without any is fixed."""
    if count == 0:
        return "fixed", ()
    kind = str(rng.choice([name for name in types if name != "free" or count == len(COORDINATES)]))
    if kind == "free" or rigid:
        return kind, _active(rng, kind, count, rigid)
    return kind, _chosen(rng, PRINCIPAL.get(kind), count)


def _chosen(rng: np.random.Generator, principal: str | None, count: int) -> tuple[str, ...]:
    """So many coordinates, the principal one among them."""
    chosen = [principal] if principal else []
    others = [name for name in COORDINATES if name != principal]
    chosen += [str(name) for name in rng.permutation(others)][: count - len(chosen)]
    return tuple(name for name in COORDINATES if name in chosen)


def _joint(
    rng: np.random.Generator,
    name: str,
    parent: str,
    child: str,
    kind: str,
    active: Sequence[str],
    forces: bool,
    armature: bool,
) -> Joint:
    def draw(wanted: bool, chance: float, low: float, high: float) -> float | None:
        drawn = rng.random() < chance, float(rng.uniform(low, high))
        return drawn[1] if wanted and drawn[0] else None

    table = {
        coordinate: Coordinate(
            stiffness=draw(forces, 0.5, 10.0, 200.0),
            damping=draw(forces, 0.5, 0.1, 5.0),
            armature=draw(armature, 0.3, 0.01, 0.5),
        )
        for coordinate in active
    }
    turn: Matrix = IDENTITY
    if rng.random() < 0.3:  # as a URDF's joint axis gives it
        turn = _matrix(random_rotation(rng))
    return Joint(name, parent, child, kind, random_placement(rng), turn, table)


def _triple(values: Array) -> tuple[float, float, float]:
    a, b, c = (float(value) for value in values)
    return (a, b, c)


def _matrix(values: Array) -> Matrix:
    a, b, c = (_triple(row) for row in values)
    return (a, b, c)


def with_offsets(robot: Robot, seed: int, *, active_angles: bool = False) -> Robot:
    """Random offsets in about half of all coordinates; ``active_angles``: of the angles, in active ones alone."""
    rng = np.random.default_rng(seed)
    joints = []
    for joint in robot.joints:
        drawn = [float(x) if rng.random() < 0.6 else None for x in rng.uniform(-0.4, 0.4, 6)]
        for i, name in enumerate(COORDINATES):
            if active_angles and name in ANGULAR and name not in joint.coordinates:
                drawn[i] = None
        joints.append(replace(joint, offset=tuple(drawn)))
    return replace(robot, joints=tuple(joints))


def some_prescribed(robot: Robot, seed: int) -> Robot:
    """The robot with about a third of its coordinates prescribed, at least one, and at least one free."""
    rng = np.random.default_rng(seed)
    names = [(joint.name, key) for joint in robot.joints for key in joint.coordinates]
    count = int(rng.integers(1, max(2, len(names) // 2 + 1)))
    chosen = {names[i] for i in rng.permutation(len(names))[: min(count, len(names) - 1)]}
    joints = tuple(
        replace(
            joint,
            coordinates={k: replace(c, prescribed=(joint.name, k) in chosen) for k, c in joint.coordinates.items()},
        )
        for joint in robot.joints
    )
    return replace(robot, joints=joints)


def random_states(robot: Robot, seed: int, count: int) -> tuple[Array, Array, Array, Array]:
    """Return q, v, a and u of random states, (count, n) each."""
    rng = np.random.default_rng(seed)
    states = [random_state(robot, rng) for _ in range(count)]
    q, v, a, u = (np.array([getattr(state, name) for state in states]) for name in "qvau")
    return q, v, a, u


def loaded_free_joint() -> Robot:
    """Return a body on a joint that does not turn freely: something acts on its angles."""
    robot = random_robot(1045, joints=(1, 1), types=("free",), armature=False, forces=False)
    joint = robot.joint("joint1")
    loaded = replace(joint, coordinates={**joint.coordinates, "gamma": Coordinate(preload=0.0)})
    return replace(robot, name="loaded", joints=tuple(loaded if x is joint else x for x in robot.joints))
