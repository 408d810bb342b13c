"""Random closed mechanisms of 3 to 14 coordinates, each known by its number, in a state that closes them.

The tree's coordinates are chosen, and the frames of its cut joints put where they meet: closed by construction, up to
round-off.  Rates are of the null space of the constraint's Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from eomgen.robot.geometry import IDENTITY
from eomgen.robot.joint_types import CUTS
from eomgen.robot.model import FIXED_BODY, Model, build_model
from eomgen.robot.value import PRINCIPAL, Coordinate, Joint, Loop, Placement, Robot
from tests.oracles.closed_mechanisms import ROWS, ClosedOracle
from tests.oracles.force_laws import with_laws
from tests.support.linkages import FREE, bennett, bricard, hinge, threefold
from tests.support.random_motors import motor_state, with_motors
from tests.support.random_robots import Array, random_link, random_placement, random_robot, random_rotation
from tests.support.random_springs import with_springs
from tests.support.recuts import placed, pose

LEAST, NOTHING = 1e-3, 1e-10  # singular values by the greatest: those between are near-singular poses
MOST = 14  # coordinates
PLANAR = ("revolute", "revolute", "cylindrical", "spherical")
Pair = tuple[str, str]
Drawn = tuple[Robot, Array]
Layout = Callable[[np.random.Generator, Model], list[Pair] | None]


@dataclass(frozen=True)
class Mechanism:
    """A robot with loops in a closed state: q, v, u (n,) each; in u a prescribed coordinate has its acceleration.

    wrench: on links from outside, (6,) each, force and moment at the centre of mass in base axes.
    """

    family: str
    robot: Robot
    q: Array
    v: Array
    u: Array
    wrench: Mapping[str, Array] = field(default_factory=dict)


def mechanism(
    number: int,
    kinds: Sequence[str] = tuple(CUTS),
    *,
    plain: bool = False,
    wanted: Callable[[Robot], bool] = lambda robot: True,
) -> Mechanism:
    """The mechanism of that number; its family is that of the number.

    Args:
        kinds: of the cut joints, "revolute" among them unless it is plain.
        plain: a tree, with linear springs and dampers of joints alone and nothing prescribed.
        wanted: robots that it does not want are drawn again.
    """
    families = list(TREES if plain else FAMILIES)
    family = families[number % len(families)]
    for attempt in range(5000):
        rng = np.random.default_rng([2028, number, attempt])
        drawn = TREES[family](rng, kinds, plain) if family in TREES else FAMILIES[family](rng, kinds)
        found = None if drawn is None else _in_motion(rng, family, *drawn, 0 if plain else 2)
        if found is not None and wanted(found.robot):
            return replace(found, robot=replace(found.robot, name=f"closed{number}"))
    raise AssertionError(f"no mechanism {number}: {family}")


# ---- states


def _in_motion(rng: np.random.Generator, family: str, robot: Robot, q: Array, given: int) -> Mechanism | None:
    """The mechanism with rates and drives, up to ``given`` coordinates prescribed; None near singular poses."""
    robot, q = robot.without_states(), q[: len(build_model(robot).coordinates)]  # which the oracle does not know
    oracle = ClosedOracle(robot)
    g, J, _ = oracle.constraint(q, 0.0 * q)
    assert np.abs(g).max() <= 1e-13, "open by construction"
    if np.linalg.cond(oracle.tree.mass_matrix(q)) > 1e7:
        return None
    rank = _rank(oracle, q, J, np.ones(len(q), bool))
    if rank is None or rank == len(q):
        return None
    ways = np.linalg.svd(J)[2][rank:]
    v = ways.T @ rng.uniform(-1.0, 1.0, len(ways))
    v *= rng.uniform(0.5, 2.0) / np.abs(v).max()
    if not _all_move(oracle, J, v) and rng.random() < 0.9:
        return None
    bias = oracle.constraint(q, v)[2]
    left = np.linalg.svd(J)[0][:, rank:]
    if np.abs(left.T @ bias).max(initial=0.0) > 1e-10 * max(1.0, np.abs(bias).max()):
        return None  # a singular pose, which no motion goes through like this
    free = np.ones(len(q), bool)
    for i in rng.permutation(len(q))[: int(rng.integers(0, given + 1))]:
        tried = free.copy()
        tried[i] = False
        if _rank(oracle, q, J, tried) == rank:
            free = tried
    u = rng.uniform(-20.0, 20.0, len(q))
    u[~free] = rng.uniform(-2.0, 2.0, int((~free).sum()))
    links = build_model(robot).links if rng.random() < 0.4 else ()
    wrench = {name: rng.uniform(-10.0, 10.0, 6) for name in links if rng.random() < 0.5}
    return Mechanism(family, _with_given(robot, ~free), q, v, u, wrench)


def _rank(oracle: ClosedOracle, q: Array, J: Array, free: Array) -> int | None:
    """Rank of J, of free columns, in the kinetic metric; None near a singular pose."""
    M = oracle.tree.mass_matrix(q)[np.ix_(free, free)]
    S = np.linalg.svd(np.linalg.solve(np.linalg.cholesky(M), J[:, free].T), compute_uv=False)
    S = S / max(S.max(initial=0.0), 1e-300)
    if ((S > NOTHING) & (S < LEAST)).any():
        return None
    return int((S >= LEAST).sum())


def _all_move(oracle: ClosedOracle, J: Array, v: Array) -> bool:
    """Whether no loop is a structure that holds itself."""
    rows = iter(np.abs(J) * np.abs(v))
    loops = [sum(next(rows) for _ in ROWS[loop.type]) for loop in oracle.robot.loops]
    return bool(min(np.max(part) for part in loops) > 1e-2)


def _with_given(robot: Robot, given: Array) -> Robot:
    """The robot with these coordinates prescribed, motors among them."""
    flags, joints = iter(given.tolist()), []
    for joint in robot.joints:
        table = {name: replace(c, prescribed=next(flags)) for name, c in joint.coordinates.items()}
        motor = replace(joint.motor, prescribed=next(flags)) if joint.motor else None
        joints.append(replace(joint, coordinates=table, motor=motor))
    return replace(robot, joints=tuple(joints))


def closed_at(
    rng: np.random.Generator, robot: Robot, q: Array, cuts: Sequence[tuple[Pair, str]], *, planar: bool = False
) -> Robot:
    """The robot with cut joints (links, type) between frames that meet at q, with random freedoms moved."""
    bodies, own = ClosedOracle(robot).bodies, ClosedOracle(robot).tree.own
    loops = []
    for i, ((a, b), kind) in enumerate(cuts):
        first = _in_plane(rng) if planar else random_placement(rng)
        moved = {name: float(rng.uniform(-0.8, 0.8)) for name in FREE[kind]}
        if planar:
            moved = {"gamma": moved.get("gamma", 0.0)}
        at_a, at_b = (bodies.frame_pose(q[own], name) for name in (a, b))
        second = np.linalg.inv(at_b) @ at_a @ pose(first) @ _moved(moved)
        loops.append(Loop(f"cut{i + 1}", (a, b), kind, (first, placed(second))))
    return replace(robot, loops=tuple(loops))


def _moved(coordinates: Mapping[str, float]) -> Array:
    """T(x, y, z) Rx(alpha) Ry(beta) Rz(gamma), (4, 4)."""
    result = np.eye(4)
    for k, name in enumerate(("alpha", "beta", "gamma")):
        c, s = np.cos(coordinates.get(name, 0.0)), np.sin(coordinates.get(name, 0.0))
        turn, (i, j) = np.eye(4), ((k + 1) % 3, (k + 2) % 3)
        turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c
        result = result @ turn
    result[:3, 3] = [coordinates.get(name, 0.0) for name in "xyz"]
    return result


# ---- families


def _tree(layout: Layout) -> Callable[[np.random.Generator, Sequence[str], bool], Drawn | None]:
    """Random trees with cut joints of some kinds; laws, motors and springs in some, unless they are plain."""

    def draw(rng: np.random.Generator, kinds: Sequence[str], plain: bool) -> Drawn | None:
        robot = random_robot(
            rng, joints=(3, 7), max_size=MOST - 4, max_coordinates=6 if rng.random() < 0.3 else 2,
            tree=bool(rng.random() < 0.6), types=("revolute", "revolute", "prismatic", "fixed", "free"), rods=False,
        )  # fmt: skip
        pairs = layout(rng, build_model(robot))
        if not pairs:
            return None
        if not plain:
            robot = _equipped(rng, robot)
        if build_model(robot).size > MOST:
            return None
        q = motor_state(robot, int(rng.integers(1 << 30))).q
        cuts = [(pair if rng.random() < 0.5 else pair[::-1], str(rng.choice(list(kinds)))) for pair in pairs]
        return closed_at(rng, robot, q, cuts), q

    return draw


def _equipped(rng: np.random.Generator, robot: Robot) -> Robot:
    """The robot with forces of all kinds, motors or springs, or none of them."""
    seed, choice = int(rng.integers(1 << 30)), rng.random()
    if choice < 0.2:
        robot = with_laws(robot, seed)
    elif choice < 0.4 and any(joint.type in PRINCIPAL for joint in robot.joints):
        robot = with_motors(robot, seed, ("plain", "friction", "clearance"))
    elif choice < 0.5:
        robot = with_springs(robot, seed, ("linear", "zero damped"))
    return robot


def _to_base(rng: np.random.Generator, model: Model) -> list[Pair] | None:
    """The last link of a branch and the base."""
    return [(model.robot.base, model.bodies[-1].name)]


def _inside(rng: np.random.Generator, model: Model) -> list[Pair] | None:
    """Two links of a loop that leaves a joint towards the base outside."""
    pairs = [(a, b) for a, b in _pairs(model) if _common(model, a, b) != FIXED_BODY]
    return [_chosen(rng, model, pairs)] if pairs else None


def _nested(rng: np.random.Generator, model: Model) -> list[Pair] | None:
    """A loop to the base, and one over a part of its way."""
    chain = list(model.ancestors(len(model.bodies) - 1))[::-1]
    if len(chain) < 4:
        return None
    i, j = sorted(rng.choice(len(chain) - 1, 2, replace=False).tolist())
    inner = model.bodies[chain[i]].name, model.bodies[chain[j]].name
    return [inner, (model.robot.base, model.bodies[chain[-1]].name)] if j - i >= 2 else None


def _shared(rng: np.random.Generator, model: Model) -> list[Pair] | None:
    """Two or three loops through one link."""
    names = [model.robot.base, *(body.name for body in model.bodies)]
    shared = str(rng.choice(names))
    others = [str(name) for name in rng.permutation([name for name in names if name != shared])]
    return [(shared, name) for name in others[: int(rng.integers(2, 4))]]


def _in_a_row(rng: np.random.Generator, model: Model) -> list[Pair] | None:
    """A loop to the base, and another on what it carries."""
    chain = list(model.ancestors(len(model.bodies) - 1))[::-1]
    if len(chain) < 4:
        return None
    middle = int(rng.integers(1, len(chain) - 2))
    names = [model.bodies[chain[i]].name for i in (middle, -1)]
    return [(model.robot.base, names[0]), (names[0], names[1])]


def _pairs(model: Model) -> list[Pair]:
    names = [body.name for body in model.bodies]
    return [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]]


def _common(model: Model, a: str, b: str) -> int:
    """The last body that both links hang on or are."""
    first = list(model.ancestors(model.body_of[a]))
    return next((body for body in model.ancestors(model.body_of[b]) if body in first), FIXED_BODY)


def _chosen(rng: np.random.Generator, model: Model, pairs: list[Pair]) -> Pair:
    return pairs[int(rng.integers(len(pairs)))]


def _spatial(rng: np.random.Generator, kinds: Sequence[str]) -> Drawn:
    """A chain of revolute and prismatic joints in space whose last joint is cut: one degree of freedom, or two."""
    robot = random_robot(
        rng, counts=(1,) * int(rng.integers(6, 8)), types=("revolute", "revolute", "prismatic"), rigid=True,
        forces=bool(rng.random() < 0.5), rods=False,
    )  # fmt: skip
    q = motor_state(robot, int(rng.integers(1 << 30))).q
    return closed_at(rng, robot, q, [((robot.base, build_model(robot).bodies[-1].name), "revolute")]), q


def _planar(rng: np.random.Generator, kinds: Sequence[str]) -> Drawn | None:
    """A tree in a tilted plane with loops of joints that block the plane's normal, too: redundant."""
    count = int(rng.integers(3, 9))
    plane, names = random_rotation(rng), ["base"]
    joints, links = [], []
    for i in range(count):
        parent = names[-1] if rng.random() < 0.7 else str(rng.choice(names[-3:]))
        names = names[: names.index(parent) + 1]
        place = _in_plane(rng)
        if parent == "base":
            X = np.eye(4)
            X[:3, :3] = plane
            place = placed(X @ pose(place))
        table = {"gamma": Coordinate(stiffness=10.0 if rng.random() < 0.2 else None)}
        if rng.random() < 0.15:
            table |= {"x": Coordinate(stiffness=80.0, damping=1.0)}
        joints.append(Joint(f"joint{i + 1}", parent, f"link{i + 1}", "revolute", place, coordinates=table))
        links.append(random_link(rng, f"link{i + 1}", rods=False))
        names.append(f"link{i + 1}")
    gravity = tuple(float(x) for x in 9.81 * random_rotation(rng)[:, 0])
    robot = Robot("planar", gravity, tuple(links), tuple(joints))  # type: ignore[arg-type]
    model = build_model(robot)
    layout = LAYOUTS[str(rng.choice(list(LAYOUTS)))]
    pairs = layout(rng, model)
    if not pairs:
        return None
    q = rng.uniform(-1.5, 1.5, model.size)
    return closed_at(rng, robot, q, [(pair, _planar_kind(rng, kinds)) for pair in pairs], planar=True), q


def _planar_kind(rng: np.random.Generator, kinds: Sequence[str]) -> str:
    return str(rng.choice([kind for kind in PLANAR if kind in kinds]))


def _in_plane(rng: np.random.Generator) -> Placement:
    """A place in the plane, turned about its normal."""
    angle = float(rng.uniform(-np.pi, np.pi))
    return placed(_moved({"x": rng.uniform(-0.6, 0.6), "y": rng.uniform(-0.6, 0.6), "gamma": angle}))


def _parallelogram(rng: np.random.Generator, kinds: Sequence[str]) -> Drawn:
    """A bar on two to four parallel cranks, one more of them than two redundant in the plane, too."""
    count, length, turn = int(rng.integers(2, 5)), float(rng.uniform(0.2, 0.6)), _tilt(rng)
    feet = [np.array([0.5 * i + 0.2 * rng.random(), 0.4 * rng.random(), 0.0]) for i in range(count)]
    angle, end = float(rng.uniform(0.3, 2.8)), Placement((length, 0.0, 0.0))
    links = [random_link(rng, f"crank{i + 1}", rods=False) for i in range(count)]
    bar = random_link(rng, "bar", rods=False)
    joints, loops = [], []
    for i, foot in enumerate(feet):
        X = np.eye(4)
        X[:3, 3] = foot
        joints.append(hinge(f"foot{i + 1}", "base", f"crank{i + 1}", placed(turn @ X)))
        if i == 0:
            joints.append(hinge("pin1", "crank1", "bar", end))
        else:
            across = tuple(float(x) for x in foot - feet[0])
            kind = _planar_kind(rng, kinds)
            loops.append(Loop(f"pin{i + 1}", (f"crank{i + 1}", "bar"), kind, (end, Placement(across, IDENTITY))))  # type: ignore[arg-type]
    robot = Robot("parallel", (0.0, -9.81, 0.0), (links[0], bar, *links[1:]), tuple(joints), loops=tuple(loops))
    return robot, np.array([angle, -angle, *[angle] * (count - 1)])


def _bennett(rng: np.random.Generator, kinds: Sequence[str]) -> Drawn:
    """Bennett's linkage of random size, in a tilted frame."""
    alpha, beta = rng.uniform(0.3, 0.7), rng.uniform(0.9, 1.4)
    links = [random_link(rng, f"link{i + 1}", rods=False) for i in range(3)]
    theta = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 2.6))
    return bennett(float(rng.uniform(0.3, 0.8)), float(alpha), float(beta), theta, links, placed(_tilt(rng)))


def _bricard(rng: np.random.Generator, kinds: Sequence[str]) -> Drawn:
    """The threefold form of Bricard's mechanism, in a tilted frame."""
    robot = bricard(placed(_tilt(rng)))
    links = tuple(random_link(rng, link.name, rods=False) for link in robot.links)
    return replace(robot, links=links), threefold(float(rng.uniform(0.2, 2.0)))


def _tilt(rng: np.random.Generator) -> Array:
    """A turn of the whole mechanism, (4, 4)."""
    result = np.eye(4)
    result[:3, :3] = random_rotation(rng) if rng.random() < 0.7 else np.eye(3)
    return result


LAYOUTS: Mapping[str, Layout] = {
    "nested": _nested,
    "shared": _shared,
    "inside": _inside,
    "row": _in_a_row,
    "base": _to_base,
}
TREES = {f"tree, {name}": _tree(layout) for name, layout in LAYOUTS.items()}
FAMILIES: Mapping[str, Callable[..., Drawn | None]] = {
    "planar": _planar,
    **TREES,
    "bennett": _bennett,
    "spatial": _spatial,
    "parallelogram": _parallelogram,
    "bricard": _bricard,
}
