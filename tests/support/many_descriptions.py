"""Checks of one of the many robots: Pinocchio, MuJoCo, other forms of the generator, and other descriptions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eomgen.codegen.kernels import equations
from eomgen.codegen.kernels.accelerations import FACTORISED, SOLVERS, STRAIGHT_SOLVE
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.passes import run_passes
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import LINEAR, Coordinate, Joint, Link, Placement, Robot
from tests.oracles.mujoco_models import MujocoRobot
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.figures import Figures
from tests.support.many_robots import Array, Subject, derived, differences, run, size_of, times
from tests.support.random_robots import random_rotation

LIMIT = 1e-12  # relative to the max-norm of the state's result
INCH, POUND, MINUTE = 0.0254, 0.45359237, 60.0


def check_descriptions(s: Subject, figures: Figures) -> None:
    """Inverse dynamics and reactions are those of the robot, whatever its description."""
    rng = np.random.default_rng(s.model.size)
    reactions = s.kernel.reactions(s.q, s.v, s.a)
    arrays = {"q": s.q, "v": s.v, "a": s.a}

    moved = build_model(on_another_base(s.robot, rng))
    compare(s, figures, "another base frame", *dynamics(moved, arrays), reactions)

    turned = build_model(reordered(s.robot, rng))
    places = [turned.coordinates.index(name) for name in s.model.coordinates]
    back = [s.model.coordinates.index(name) for name in turned.coordinates]
    drives, wrenches = dynamics(turned, {name: x[:, back] for name, x in arrays.items()})
    joints = [[body.joint for body in turned.bodies].index(body.joint) for body in s.model.bodies]
    compare(s, figures, "another order of links", drives[:, places], wrenches[:, joints], reactions)

    inches = build_model(in_units(s.robot))
    size = np.array([1.0 if name.rpartition(".")[2] in LINEAR else INCH for name in s.model.coordinates])
    unit = {"q": INCH / size, "v": INCH / size / MINUTE, "a": INCH / size / MINUTE**2}
    drives, wrenches = dynamics(inches, {name: x / unit[name] for name, x in arrays.items()})
    newton = POUND * INCH / MINUTE**2
    compare(s, figures, "other units", drives * newton * size, wrenches * newton * np.repeat([1, INCH], 3), reactions)


def dynamics(model: Model, arrays: dict[str, Array]) -> tuple[Array, Array]:
    """Inverse dynamics (states, n) and reactions (states, joints, 6)."""
    drives, wrenches = (run(derive(model, name), model, arrays) for name in ("inverse_dynamics", "reactions"))
    return drives, wrenches.reshape(len(wrenches), -1, 6)


def compare(s: Subject, figures: Figures, label: str, drives: Array, wrenches: Array, reactions: Array) -> None:
    figures.at_most(f"inverse dynamics, {label}", differences(drives, s.drives, s.forces), LIMIT)
    figures.at_most(f"reactions, {label}", differences(wrenches, reactions, size_of(reactions)), LIMIT)


def on_another_base(robot: Robot, rng: np.random.Generator) -> Robot:
    """Everything seen from a frame that is moved and turned."""
    R, x = random_rotation(rng), rng.uniform(-1.0, 1.0, 3)

    def placed(old: Placement) -> Placement:
        return Placement(tuple(R @ old.xyz + x), tuple(map(tuple, R @ np.array(old.rotation))))  # type: ignore[arg-type]

    joints = [replace(j, placement=placed(j.placement)) if j.parent == robot.base else j for j in robot.joints]
    return replace(robot, gravity=tuple(R @ robot.gravity), joints=tuple(joints))  # type: ignore[arg-type]


def reordered(robot: Robot, rng: np.random.Generator) -> Robot:
    """Links in any order, branches in another one; depth first all the same."""
    joints: list[Joint] = []

    def follow(link: str) -> None:
        children = [joint for joint in robot.joints if joint.parent == link]
        for joint in reversed(children):
            joints.append(joint)
            follow(joint.child)

    follow(robot.base)
    links = tuple(robot.links[i] for i in rng.permutation(len(robot.links)))
    return replace(robot, links=links, joints=tuple(joints))


def in_units(robot: Robot) -> Robot:
    """The same robot in inches, pounds and minutes."""

    def link(old: Link) -> Link:
        com = tuple(c / INCH for c in old.com)
        inertia = tuple(i / (POUND * INCH**2) for i in old.inertia)
        return Link(old.name, old.mass / POUND, com, inertia)  # type: ignore[arg-type]

    def coordinate(name: str, old: Coordinate) -> Coordinate:
        mass = POUND if name in LINEAR else POUND * INCH**2
        units = {"stiffness": mass / MINUTE**2, "damping": mass / MINUTE, "armature": mass}
        given = {key: getattr(old, key) for key in units}
        return Coordinate(**{key: None if x is None else x / units[key] for key, x in given.items()})

    def placed(old: Placement) -> Placement:
        return replace(old, xyz=tuple(x / INCH for x in old.xyz))  # type: ignore[arg-type]

    joints = tuple(
        replace(
            joint,
            placement=placed(joint.placement),
            coordinates={name: coordinate(name, old) for name, old in joint.coordinates.items()},
        )
        for joint in robot.joints
    )
    frames = tuple(replace(frame, placement=placed(frame.placement)) for frame in robot.frames)
    gravity = tuple(g * MINUTE**2 / INCH for g in robot.gravity)
    return replace(robot, gravity=gravity, links=tuple(map(link, robot.links)), joints=joints, frames=frames)  # type: ignore[arg-type]


EPSILON = float(np.finfo(float).eps)


def check_oracles(s: Subject, figures: Figures) -> None:
    """M, inverse dynamics and reactions of all states; a batch, and the first states one by one."""
    pinocchio, mujoco = PinocchioOracle(s.robot), MujocoRobot(s.robot)
    reactions = s.kernel.reactions(s.q, s.v, s.a)
    for name, oracle in (("Pinocchio", pinocchio), ("MuJoCo", mujoco)):
        M = np.array([oracle.mass_matrix(q) for q in s.q])
        figures.at_most(f"mass matrix, {name}", differences(s.M, M), LIMIT)
        drives = np.array([oracle.inverse_dynamics(*state) for state in zip(s.q, s.v, s.a, strict=True)])
        figures.at_most(f"inverse dynamics, {name}", differences(s.drives, drives, s.forces), LIMIT)
        wrenches = np.array([oracle.reactions(*state) for state in zip(s.q, s.v, s.a, strict=True)])
        figures.at_most(f"reactions, {name}", differences(reactions, wrenches), LIMIT)
    a = np.array([pinocchio.forward_dynamics(*state) for state in zip(s.q, s.v, s.u, strict=True)])
    check_accelerations(s, s.kernel.forward_dynamics(s.q, s.v, s.u), a, "forward dynamics, Pinocchio", figures)
    check_singles(s, figures, reactions)


def check_singles(s: Subject, figures: Figures, reactions: Array) -> None:
    """States one by one: the same bits, but where the compiler may fuse."""
    for i in (0, len(s.q) // 2, len(s.q) - 1):
        q, v, a = s.q[i], s.v[i], s.a[i]
        pairs = (
            (s.kernel.mass_matrix(q), s.M[i], None),
            (s.kernel.inverse_dynamics(q, v, a), s.drives[i], s.forces[i : i + 1]),
            (s.kernel.reactions(q, v, a), reactions[i], None),
        )
        for one, many, size in pairs:
            if s.form == "fused":
                figures.at_most("single states, fused", differences(one[None], many[None], size), LIMIT)
            else:
                assert np.array_equal(one, many), "a state alone has other bits than in a batch"


def check_forms(s: Subject, figures: Figures) -> None:
    """Folded and run-time parameters, frames as described and as they cost least: what is not compiled."""
    kept = s.kept
    n = len(s.q), s.model.size, s.model.size
    for label, model in (("folded", s.model), ("parameters", kept)):
        for frames, regrouped in (("described", False), ("cheapest", True)):
            if regrouped and label in s.form:
                continue  # this is what was compiled
            name = f"{label}, {frames} frames"
            M = run(derived(model, "mass_matrix", regrouped), model, {"q": s.q}).reshape(n)
            figures.at_most(f"mass matrix, {name}", differences(M, s.M), LIMIT)
            program = derived(model, "inverse_dynamics", regrouped)
            drives = run(program, model, {"q": s.q, "v": s.v, "a": s.a})
            figures.at_most(f"inverse dynamics, {name}", differences(drives, s.drives, s.forces), LIMIT)
        program = derived(model, "reactions", False)
        found = run(program, model, {"q": s.q, "v": s.v, "a": s.a})
        figures.at_most(f"reactions, {label}", differences(found, flat(s.kernel.reactions(s.q, s.v, s.a))), LIMIT)
        for solver in SOLVERS:
            if solver == FACTORISED and (model is kept or model.size > STRAIGHT_SOLVE):
                continue  # n^3 operations, which the generator does not write out
            if label in s.form and s.model.size > STRAIGHT_SOLVE:
                continue  # this is what was compiled
            program = run_passes(equations.derive_cheapest(model, "forward_dynamics", solver)[0])
            a = run(program, model, {"q": s.q, "v": s.v, "u": s.u})
            expected = s.kernel.forward_dynamics(s.q, s.v, s.u)
            check_accelerations(s, a, expected, f"forward dynamics, {label}, {solver}", figures)


def check_accelerations(s: Subject, found: Array, expected: Array, label: str, figures: Figures) -> None:
    """Within 100 cond(M) eps, times how much larger than M a the forces are that cancel on the right side."""
    cond = np.linalg.cond(s.M)
    cancelling = np.maximum(1.0, np.maximum(s.forces, size_of(s.u)) / size_of(times(s.M, expected)))
    error = size_of(found - expected) / size_of(expected)
    figures.at_most(f"{label} / (cond eps)", float((error / (cond * EPSILON * cancelling)).max()), 100.0)


def flat(values: Array) -> Array:
    return values.reshape(len(values), -1)
