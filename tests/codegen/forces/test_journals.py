"""Journals in round bearings: against formulas with branches, own integrations, and the laws of mechanics."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eomgen
from eomgen.analysis.at_rest import rest
from eomgen.analysis.holding import fixation_of
from eomgen.analysis.options import KERNELS
from eomgen.codegen.closed_form.trace import closed_form
from eomgen.codegen.kernels.equations import derive, derive_equations
from eomgen.codegen.kernels.operation_counts import operations
from eomgen.codegen.program.ir import evaluate
from eomgen.integration.plan import choose_method
from eomgen.integration.solve import integrate
from eomgen.robot.elements.journal import Radial, SlidingFriction
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Joint, Link, Robot
from tests.oracles.complex_step import complex_steps
from tests.oracles.journals import generalized, random_journals, step_matrix, without
from tests.support.builds import Build
from tests.support.closeness import close
from tests.support.random_robots import (
    Array,
    random_robot,
    random_state,
    seeds,
    some_prescribed,
    with_random_loops,
)
from tests.support.random_springs import with_springs

TYPES = ("revolute", "prismatic", "fixed", "free")
NAMES = ("inverse_dynamics", "generalized_force", "forward_dynamics", "energy", "residual_jacobian")
FULL = Radial(2e-5, 1e8, 0.03, 0.5, None, SlidingFriction(0.1, 0.01))


def worn(seed: int, joints: tuple[int, int] = (1, 3)) -> Robot:
    return random_journals(random_robot(seed, joints=joints, types=TYPES, max_coordinates=3), seed)


def rotor(radial: Radial | None, *deviations: str, gravity: float = 0.0, **given: Any) -> Robot:
    """A disc, 2 kg, whose journal stands in a bearing of the base, axis horizontal."""
    link = Link("disc", 2.0, (0.0, 0.0, 0.0), (1e-3, 1e-3, 2e-3, 0.0, 0.0, 0.0))
    names = deviations or ("x", "y")
    table = {name: Coordinate(**given.get(name, {})) for name in (*names, "gamma")}
    joint = Joint("pin", "base", "disc", "revolute", coordinates=table, radial=radial)
    return Robot("rotor", (0.0, -gravity, 0.0), (link,), (joint,))


@pytest.mark.parametrize("seed", seeds(2100, 1, 10))
def test_forces_are_the_formulas(seed: int, built: Build) -> None:
    """What journals add to a robot without them, one state at a time, several on vectors, and in single precision."""
    robot = worn(seed)
    kernel, bare = built(robot, *NAMES), built(without(robot), *NAMES)
    single = built(robot, "generalized_force", dtype="float32")
    states = [random_state(robot, seed + i) for i in range(9)]
    found = [generalized(robot, s.q, s.v) for s in states]
    assert any(np.abs(force).max() > 1.0 for force, _ in found)
    for s, (force, energy) in zip(states, found, strict=True):
        assert close(kernel.inverse_dynamics(s.q, s.v, s.a), bare.inverse_dynamics(s.q, s.v, s.a) - force)
        assert close(kernel.energy(s.q, s.v), bare.energy(s.q, s.v) + [0.0, energy])
        wanted = bare.forward_dynamics(s.q, s.v, s.u + force)
        assert close(kernel.forward_dynamics(s.q, s.v, s.u), wanted, 1e-8)
    q, v = (np.array([getattr(s, x) for s in states]) for x in "qv")
    wanted = bare.generalized_force(q, v) + [force for force, _ in found]
    assert close(kernel.generalized_force(q, v), wanted)
    few = (q.astype(np.float32), v.astype(np.float32))
    assert close(single.generalized_force(*few), kernel.generalized_force(*(x.astype(float) for x in few)), 1e-4)


@pytest.mark.parametrize("seed", seeds(2120, 1, 15))
def test_slopes_are_those_of_the_forces(seed: int) -> None:
    robot = worn(seed, (1, 2))
    model, jacobian = build_model(robot), derive(build_model(robot), "residual_jacobian")
    for i in range(2):
        s = random_state(robot, seed + i)
        inputs = {"q": s.q, "v": s.v, "a": s.a, "u": s.u, "p": list(model.parameters.values())}
        blocks = np.array(list(evaluate(jacobian, inputs).values())).reshape(3, model.size, model.size)
        for block, name in zip(blocks, "qva", strict=True):
            assert close(block, complex_steps(robot, s, name), 1e-10)


def test_closed_form_has_them() -> None:
    robot = random_journals(random_robot(2131, joints=(1, 1), types=("revolute",), max_coordinates=1), 2131)
    model, s = build_model(robot), random_state(robot, 1)
    inputs = {"q": s.q, "v": s.v, "a": s.a, "u": s.u, "p": list(model.parameters.values())}
    residual, potential = closed_form(model).function("residual", "potential")(s.q, s.v, s.a, s.u)
    assert close(np.array(list(evaluate(derive(model, "residual"), inputs).values())), residual)
    assert close(np.array(evaluate(derive(model, "energy"), inputs)["out", 1]), potential)


def looped(seed: int) -> Robot:
    return with_random_loops(worn(seed, (2, 2)), seed, ("spherical",))


def has_full_rank(robot: Robot) -> bool:
    """Whether a random state, which is open, could be closed in all directions: then its rates can."""
    model = build_model(robot)
    inputs = {"q": random_state(robot, 1).q, "p": list(model.parameters.values())}
    J = np.array(list(evaluate(derive(model, "constraint_jacobian"), inputs).values())).reshape(-1, model.size)
    return bool(np.linalg.matrix_rank(J, 1e-2) == len(J))


@pytest.mark.parametrize("kind", ["alone", "prescribed", "springs", "loops"])
@pytest.mark.parametrize("seed", seeds(2140, 1, 12))
def test_an_implicit_step_is_the_linear_system(seed: int, kind: str) -> None:
    """(M + slopes) a = u + forces ahead - bias, with what the robot without journals has beside them."""
    robot, dt = worn(seed, (1, 2) if kind == "alone" else (2, 2)), 0.02
    if kind == "prescribed":
        robot = some_prescribed(robot, seed)
    elif kind == "springs":
        robot = with_springs(robot, seed)
    elif kind == "loops":
        robot = next(robot for robot in map(looped, range(seed, seed + 100)) if has_full_rank(robot))
    model, states = build_model(robot), (random_state(robot, seed + i) for i in range(50))
    s = next(s for s in states if np.abs(step_matrix(robot, s.q, s.v, dt)[0]).max() > 1e-3)
    parameters = list(model.parameters.values())
    base = {"q": s.q, "v": s.v, "u": s.u, "added": np.zeros(model.size), "dt": [dt, dt * dt], "p": parameters}
    found = evaluate(derive(model, "implicit_step"), base)
    a = np.array([found["out", i] for i in range(model.size)])
    matrix, force = step_matrix(robot, s.q, s.v, dt)
    bare = build_model(without(robot))
    u = np.where(np.isin(np.arange(model.size), model.prescribed), s.u, s.u + force - matrix @ a)
    push = {**base, "u": u, "p": list(bare.parameters.values())}
    wanted = evaluate(derive(bare, "implicit_step"), push)
    assert close(a, np.array([wanted["out", i] for i in range(model.size)]), 1e-5 if kind == "loops" else 1e-6)


def test_a_round_bearing_is_no_box(built: Build) -> None:
    """Both coordinates at 0.99 c touch; each by itself, and half of it in both, does not."""
    c = FULL.clearance
    kernel = built(rotor(replace(FULL, length=None)), "generalized_force", "energy")
    inside = np.array([[0.99 * c, 0, 0], [0, -0.99 * c, 0], [0.7 * c, 0.7 * c, 0], [0, 0, 1.0]])
    assert np.all(kernel.generalized_force(inside, np.ones((4, 3))) == 0.0)
    assert np.all(kernel.energy(inside, np.zeros((4, 3))) == 0.0)
    corner = kernel.generalized_force(np.array([0.99 * c, 0.99 * c, 0.0]), np.zeros(3))
    depth = c * (np.sqrt(2) * 0.99 - 1.0) - 0.5 * c / 20
    assert corner[:2] == pytest.approx([-1e8 * depth / np.sqrt(2)] * 2)


def test_across_one_axis_it_is_a_clearance(built: Build) -> None:
    """Forces, slopes and energy of motion along x alone; and no spring in y."""
    numbers = {"clearance": 2e-5, "stiffness": 1e8, "restitution_damping": 30.0}
    names = ("generalized_force", "residual_jacobian", "energy")
    round_one = built(rotor(Radial(**numbers)), *names)
    box = built(rotor(None, x=numbers), *names)
    q, v = np.zeros((41, 3)), np.zeros((41, 3))
    q[:, 0], v[:, 0] = np.linspace(-4e-5, 4e-5, 41), np.sin(np.arange(41)) * 0.05
    assert close(round_one.generalized_force(q, v), box.generalized_force(q, v))
    assert close(round_one.energy(q, v), box.energy(q, v))
    found, wanted = (np.array(kernel.residual_jacobian(q, v, 0 * q)[:2])[..., 0, 0] for kernel in (round_one, box))
    assert close(found, wanted)


@pytest.mark.soak
def test_a_dropped_journal_moves_as_integrated_otherwise(built: Build) -> None:
    """Two bodies, the bearing's and the journal's, with the force between them in branches: 1e-6 of the clearance."""
    radial = Radial(1e-3, 1e5, None, 0.8, None, SlidingFriction(0.2, 0.01, 1e-3))
    kernel = built(rotor(radial, gravity=9.81), "forward_dynamics", "energy", "mass_matrix", "inverse_dynamics")
    assert choose_method(kernel) == "Radau"
    q0, v0 = np.array([2e-4, 0.0, 0.0]), np.array([0.02, 0.0, 30.0])
    found = integrate(kernel, q0, v0, 0.06, method="DOP853", rtol=1e-10, output_step=2e-3)
    inverse = np.array([1 / 2.0, 1 / 2.0, 1 / 2e-3])

    def slopes(_: float, y: Array) -> Array:
        q, v = np.zeros(6), np.zeros(6)
        q[[0, 1, 5]], v[[0, 1, 5]] = y[:3], y[3:]
        force = generalized(rotor(radial), y[:3], y[3:])[0] + [0.0, -2.0 * 9.81, 0.0]
        return np.concatenate([y[3:], inverse * force])

    own = solve_ivp(slopes, (0.0, 0.06), [*q0, *v0], "DOP853", t_eval=found.t, rtol=1e-10, atol=1e-14)
    assert np.abs(found.q - own.y[:3].T).max() < 1e-6 * np.abs(found.q).max()
    assert np.abs(found.q[:, :2] - own.y[:2].T).max() < 1e-6 * radial.clearance
    assert found.v[-1, 2] < 29.0  # it was braked


@pytest.mark.soak
def test_a_tilting_journal_keeps_its_energy(built: Build) -> None:
    """Without losses energy stays; with restitution and friction it falls, and power is what the forces say."""
    radial = Radial(1e-3, 1e5, 0.05)
    robot = rotor(radial, "x", "y", "z", "alpha", "beta", gravity=9.81)
    names = ("forward_dynamics", "energy", "generalized_force", "mass_matrix")
    kernel = built(robot, *names)
    start = np.array([0.0, 0.0, 0.0, 2e-3, -1e-3, 0.0]), np.array([0.05, 0.0, 0.0, 0.5, 1.0, 5.0])
    found = integrate(kernel, *start, 0.05, method="DOP853", rtol=1e-10)
    total = found.energy.sum(axis=1)
    assert np.abs(total - total[0]).max() < 1e-7 * np.ptp(found.energy[:, 0])
    assert {(contact.coordinate, contact.side) for contact in found.contacts} == {("pin.radial", 1), ("pin.radial", -1)}
    lossy = built(rotor(replace(FULL, clearance=1e-3), "x", "y", "z", "alpha", "beta"), *names)
    rng = np.random.default_rng(5)
    q, v = 2e-3 * rng.normal(size=(200, 6)), rng.normal(size=(200, 6))
    taken = ((lossy.generalized_force(q, 0 * v) - lossy.generalized_force(q, v)) * v).sum(axis=1)
    assert np.all(taken >= 0.0)
    assert taken.max() > 1.0


def test_it_rests_on_the_line_of_centres(built: Build) -> None:
    """At e = c + w / 2 + F / k in the direction of the load, wherever it began, and reports the angle."""
    kernel = built(rotor(Radial(2e-5, 1e8), gravity=9.81), *KERNELS)
    kernel.parameters["gravity.x"] = 5.0
    robot = rotor(Radial(2e-5, 1e8), gravity=9.81)
    load = np.array([5.0, -9.81]) * 2.0
    depth = np.sqrt(2.0 * 1e-6 * np.hypot(*load) / 1e8)
    wanted = load / np.hypot(*load) * (2e-5 + depth)  # within the smoothing, d = x^2 / (2 w)
    assert depth < 1e-6
    for begin in ([1e-5, 1e-5, 0.0], [0.0, 0.0, 0.0]):
        fixed = fixation_of(robot, kernel)
        found = rest(kernel, np.array(begin), fixed)
        assert found.q[:2] == pytest.approx(wanted, rel=1e-9)
    kernel.parameters["gravity.x"] = 0.0
    heavy = kernel.with_parameters({"gravity.y": -9810.0})
    down = rest(heavy, np.zeros(3), fixation_of(robot, heavy)).q
    assert down[:2] == pytest.approx([0.0, -(2e-5 + 0.5e-6 + 2.0 * 9810.0 / 1e8)], rel=1e-9, abs=1e-12)


def test_contacts_have_an_angle_and_an_end(built: Build) -> None:
    """A disc that falls along a slanted gravity touches in its direction; turned about y, first at the lower end."""
    robot = rotor(Radial(1e-4, 1e6, 0.03), "x", "y", "alpha", "beta")
    kernel = built(robot, "forward_dynamics", "energy", "mass_matrix", "inverse_dynamics", "residual_jacobian")
    kernel.parameters.update({"gravity.x": 3.0, "gravity.y": -4.0})
    found = integrate(kernel, np.zeros(5), np.zeros(5), 0.008, rtol=1e-8)
    first, second = found.contacts[:2]
    assert {first.side, second.side} == {1, -1}
    for contact in (first, second):
        assert (contact.coordinate, contact.closes) == ("pin.radial", True)
        assert contact.angle == pytest.approx(np.arctan2(-4.0, 3.0), abs=1e-5)
        assert contact.rate == pytest.approx(np.sqrt(2.0 * 5.0 * 1e-4), rel=1e-3)
    tilted = integrate(kernel, np.array([0, 0, 0, 2e-3, 0.0]), np.zeros(5), 0.008, method="CVODE", rtol=1e-8)
    assert tilted.contacts[0].side == 1  # towards +x at z > 0


def test_numbers_are_parameters(built: Build) -> None:
    """All of them, with effect at once, and within their ranges."""
    kernel = built(rotor(FULL, "x", "y", "alpha", "beta"), "generalized_force")
    prefix = "joints.pin.radial."
    assert {name for name in kernel.parameters if name.startswith(prefix)} == {prefix + key for key in FULL.law()}
    q, v = np.array([1e-4, 0, 1e-3, 0, 0]), np.array([0.1, 0, 0, 0, 3.0])
    for name, factor in {"clearance": 2, "stiffness": 3, "length": 2, "friction.coefficient": 0.5}.items():
        before, value = kernel.generalized_force(q, v), kernel.parameters[prefix + name]
        kernel.parameters[prefix + name] = factor * value
        changed = replace(FULL, **{name: factor * value}) if "." not in name else FULL
        if "." in name:
            assert FULL.friction is not None
            changed = replace(FULL, friction=replace(FULL.friction, coefficient=factor * value))
        wanted = generalized(rotor(replace(changed, smoothing=1e-6), "x", "y", "alpha", "beta"), q, v)[0]
        assert close(kernel.generalized_force(q, v), wanted)
        assert not np.allclose(kernel.generalized_force(q, v), before)
        kernel.parameters[prefix + name] = value
    with pytest.raises(eomgen.EomgenError, match=r"joints\.pin\.radial\.stiffness.*at least 0"):
        kernel.parameters[prefix + "stiffness"] = -1.0


def test_what_it_costs() -> None:
    """Multiplications of the force, and nothing at all where there is no journal."""

    def products(robot: Robot) -> int:
        return operations(derive_equations(build_model(robot), ("inverse_dynamics",)))["inverse_dynamics"]["mul"]

    plane, tilting = ("x", "y"), ("x", "y", "alpha", "beta")
    for radial, names, most in ((replace(FULL, length=None), plane, 40), (FULL, tilting, 100)):
        assert 0 < products(rotor(radial, *names)) - products(rotor(None, *names)) <= most


@pytest.mark.soak
def test_implicit_rollouts_follow_it(built: Build) -> None:
    """Of first order: half the step, half the error, in a bearing that the journal rolls through."""
    radial = Radial(1e-4, 1e7, None, 0.2, None, SlidingFriction(0.1, 0.01))
    robot = rotor(radial, gravity=9.81, x={"damping": 20.0}, y={"damping": 20.0}, gamma={"damping": 0.01})
    kernel = built(robot, "rollout", *NAMES, "mass_matrix")
    q0, v0 = np.array([5e-5, -9e-5, 0.0]), np.zeros(3)
    wanted = integrate(kernel, q0, v0, 0.02, rtol=1e-9, output_step=0.02).q[-1]
    errors = []
    for steps in (500, 1000, 2000):
        q = kernel.rollout(q0, v0, np.zeros(3), 0.02 / steps, steps, method="implicit")[0][-1]
        errors.append(np.abs(q - wanted)[:2].max())
    assert errors[0] > 1.6 * errors[1] > 2.5 * errors[2]
    assert errors[2] < 2e-2 * radial.clearance
    slow = kernel.rollout(q0, v0, np.zeros(3), 1e-3, 2000, method="implicit")[0][-1]
    assert np.hypot(*slow[:2]) == pytest.approx(1e-4 + np.sqrt(2 * 5e-6 * 2.0 * 9.81 / 1e7), rel=1e-6)
