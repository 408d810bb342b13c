"""Random robots whose links bend, with everything else that a robot can have: laws, motors, drives, springs, loops."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from eomgen.codegen.kernels.steps.tolerances import coordinate_sizes
from eomgen.errors import InputError
from eomgen.robot.coordinates import coordinate_names
from eomgen.robot.elements import Bushing
from eomgen.robot.model import build_model
from eomgen.robot.value import PRINCIPAL, Coordinate, Coupling, Robot
from tests.oracles.force_laws import with_drives, with_laws
from tests.support.bending_robots import Bending, bent
from tests.support.programs import answer
from tests.support.random_motors import with_motors
from tests.support.random_robots import (
    Array,
    State,
    random_placement,
    random_robot,
    random_state,
    some_prescribed,
    with_offsets,
    with_random_loops,
)
from tests.support.random_springs import with_springs

PARTS = ("laws", "drives", "motors", "prescribed", "offsets", "followers", "springs", "bushings", "loops")
TYPES = ("revolute", "prismatic", "fixed", "free")


@dataclass(frozen=True, eq=False)
class Mixture:
    """A robot whose links bend, with the parts that it was drawn with."""

    robot: Robot
    parts: frozenset[str]

    def state(self, seed: int) -> State:
        """Draw a state, as ``random_state`` does: modes up to 0.2."""
        return random_state(self.robot, seed)


def mixture(
    seed: int, parts: Sequence[str] | None = None, joints: tuple[int, int] = (2, 3), modes: Sequence[int] = (0, 1, 2)
) -> Mixture:
    """Draw a tree whose links bend, with some parts of ``PARTS``.

    Args:
        seed: the same gives the same robot.
        parts: those that it has; about a third of all if None.
        joints: least and greatest number of joints that move.
        modes: numbers to draw from, 0 of a link that stays rigid.
    """
    rng = np.random.default_rng([seed, 43])
    drawn = PARTS if parts is None else tuple(parts)
    has = {part for part in drawn if parts is not None or rng.random() < 0.35}
    for number in range(seed, seed + 100_000, 1000):
        robot = random_robot(number, joints, 3, tree=True, types=TYPES, rods=False, name=f"mixture{seed}")
        principal = any(joint.type in PRINCIPAL for joint in robot.joints)
        size = sum(len(joint.coordinates) for joint in robot.joints)
        if size > 2 and size < 9 and (principal or not has & {"motors", "drives"}):
            made = _equipped(robot, number, has, modes)
            with suppress(InputError):  # a bushing's angles are at their pole
                coordinate_sizes(build_model(made))
                return Mixture(made, frozenset(has))
    raise AssertionError(seed)


def _equipped(robot: Robot, seed: int, has: set[str], modes: Sequence[int]) -> Robot:
    rng = np.random.default_rng([seed, 44])
    if "laws" in has:
        robot = with_laws(robot, seed)
    if "drives" in has:
        robot = with_drives(robot, seed)
    if "motors" in has:
        robot = _with_motors(robot, seed)
    if "prescribed" in has:
        robot = _prescribed(robot, seed)
    if "offsets" in has:
        robot = with_offsets(robot, seed, active_angles=True)
    bending = bent(robot, seed, modes)
    if "followers" in has:
        bending = _with_follower(bending, rng)
    made = bending.robot
    if "springs" in has:
        made = with_springs(made, seed, tuple(rng.choice(["linear", "cable", "curve", "damper"], 2, replace=False)))
    if "bushings" in has:
        made = replace(made, elements=(*made.elements, _bushing(rng, made)))
    if "loops" in has:
        made = _with_loop(made, seed)
    return made


def _with_loop(robot: Robot, seed: int) -> Robot:
    """Close a loop of independent rows that leaves a freedom; return the robot as it is if none of twenty does."""
    for number in range(seed, seed + 20):
        kind = ("revolute", "spherical", "prismatic")[number % 3]
        made = with_random_loops(robot, number, [kind])
        model = build_model(made)
        free = [i for i in range(len(model.coordinates)) if i not in model.prescribed]
        q = Mixture(made, frozenset()).state(seed).q
        J = answer(made, "constraint_jacobian", q=q).reshape(-1, len(model.coordinates))
        if np.linalg.matrix_rank(J[:, free], 1e-3) == len(J) < len(free):
            return made
    return robot


def _prescribed(robot: Robot, seed: int) -> Robot:
    """Prescribe some coordinates that have no drives."""
    joints = [
        replace(
            joint,
            coordinates={
                k: replace(c, prescribed=c.prescribed and not _driven(c)) for k, c in joint.coordinates.items()
            },
        )
        for joint in some_prescribed(robot, seed).joints
    ]
    return replace(robot, joints=tuple(joints))


def _driven(coordinate: Coordinate) -> bool:
    return any(key.startswith("drive") for key in coordinate.further)


def _with_motors(robot: Robot, seed: int) -> Robot:
    """Let joints whose principal coordinates have no drives have motors."""
    motors = {x.name: x.motor for x in with_motors(robot, seed, ("plain", "friction", "bristles", "clearance")).joints}
    joints = []
    for joint in robot.joints:
        driven = any(map(_driven, joint.coordinates.values()))
        joints.append(joint if driven else replace(joint, motor=motors[joint.name]))
    return replace(robot, joints=tuple(joints))


def _with_follower(bending: Bending, rng: np.random.Generator) -> Bending:
    """Let a coordinate that has no drive, motor or motion of its own follow a mode and another coordinate."""
    robot = bending.plain
    modes = [f"{x.name}.{kind}" for x in robot.links if x.modes is not None for kind in x.modes.names]
    able = [
        f"{joint.name}.{kind}"
        for joint in robot.joints
        for kind, c in joint.coordinates.items()
        if not c.prescribed and joint.motor is None and not _driven(c)
    ]
    for follower in rng.permutation(able).tolist():
        others = [name for name in coordinate_names(robot) if name not in (follower, *modes)]
        to = {str(rng.choice(modes)): float(rng.uniform(-1.0, 1.0))}
        to |= {name: float(rng.uniform(-1.0, 1.0)) for name in rng.permutation(others)[:1].tolist()}
        plain = replace(robot, couplings=(Coupling("follows", follower, to, float(rng.uniform(-0.2, 0.2))),))
        made = replace(bending, plain=plain)
        if follower in made.robot.followers:
            return made
    return bending


def _bushing(rng: np.random.Generator, robot: Robot) -> Bushing:
    """Draw a bushing between links, nodes among them, that move against each other; its frames are apart."""
    body_of = build_model(robot).body_of
    links = [robot.base, *(link.name for link in robot.links)]
    pairs = [(a, b) for a in links for b in links if body_of[a] != body_of[b]]
    stiffness, damping = (tuple(map(float, rng.uniform(low, high, 6))) for low, high in ((5.0, 50.0), (0.1, 2.0)))
    links = pairs[int(rng.integers(len(pairs)))]
    return Bushing("mount", links, (random_placement(rng), random_placement(rng)), stiffness, damping)


def arrays(s: State, *labels: str) -> dict[str, Array]:
    """Return some of the arrays of a state by their names."""
    return {label: getattr(s, label) for label in labels}
