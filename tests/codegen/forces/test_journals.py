"""Journals in round bearings: against formulas with branches, own integrations, and the laws of mechanics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eomgen
from eomgen.analysis.at_rest import rest
from eomgen.analysis.holding import fixation_of, floating_cuts
from eomgen.analysis.options import KERNELS
from eomgen.description.load import robot_from_toml
from eomgen.integration.plan import choose_method, why_stiff
from eomgen.integration.solve import integrate
from eomgen.robot.elements.journal import Radial, SlidingFriction
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, Coordinate, Joint, Link, Loop, Placement, Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.result import load_result
from eomgen.state.springs import fastest_rates
from tests.oracles.journals import generalized, random_journals, step_matrix, without
from tests.support.added_forces import (
    NAMES,
    check_closed_form,
    check_forces,
    check_same,
    check_single_precision,
    check_slopes,
    check_step,
    implicit_step,
    products,
    stacked,
)
from tests.support.builds import Build
from tests.support.closeness import close
from tests.support.joint_table import joint_table, link_table, loop_table
from tests.support.programs import answer
from tests.support.random_robots import (
    Array,
    State,
    random_robot,
    random_state,
    seeds,
    some_prescribed,
    with_random_loops,
)
from tests.support.random_springs import with_springs

TYPES = ("revolute", "prismatic", "fixed", "free")
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
    robot = worn(seed)
    states = [random_state(robot, seed + i) for i in range(9)]
    forces, energies = zip(*(generalized(robot, s.q, s.v) for s in states), strict=True)
    assert any(np.abs(force).max() > 1.0 for force in forces)
    check_forces(robot, without(robot), states, forces, energies, built)


@pytest.mark.parametrize("seed", seeds(2120, 1, 15))
def test_slopes_are_those_of_the_forces(seed: int) -> None:
    robot = worn(seed, (1, 2))
    for i in range(2):
        check_slopes(robot, random_state(robot, seed + i))


def test_closed_form_has_them() -> None:
    robot = random_journals(random_robot(2131, joints=(1, 1), types=("revolute",), max_coordinates=1), 2131)
    check_closed_form(robot, random_state(robot, 1))


def looped(seed: int) -> Robot:
    return with_random_loops(worn(seed, (2, 2)), seed, ("spherical",))


def has_full_rank(robot: Robot) -> bool:
    """Whether a random state, which is open, could be closed in all directions: then its rates can."""
    J = answer(robot, "constraint_jacobian", random_state(robot, 1)).reshape(-1, build_model(robot).size)
    return bool(np.linalg.matrix_rank(J, 1e-2) == len(J))


@pytest.mark.parametrize("kind", ["alone", "prescribed", "springs", "loops"])
@pytest.mark.parametrize("seed", seeds(2140, 1, 12))
def test_an_implicit_step_is_the_linear_system(seed: int, kind: str) -> None:
    """(M + slopes) a = u + forces ahead - bias, with what the robot without journals has beside them."""
    robot, dt = worn(seed, (1, 2) if kind == "alone" else (2, 2)), 0.02
    if kind == "loops":
        robot = next(robot for robot in map(looped, range(seed, seed + 100)) if has_full_rank(robot))
    else:
        robot = {"prescribed": some_prescribed, "springs": with_springs}.get(kind, lambda robot, _: robot)(robot, seed)
    states = (random_state(robot, seed + i) for i in range(50))
    s = next(s for s in states if np.abs(step_matrix(robot, s.q, s.v, dt)[0]).max() > 1e-3)
    matrix, force = step_matrix(robot, s.q, s.v, dt)
    check_step(robot, without(robot), s, dt, lambda a: force - matrix @ a, 1e-5 if kind == "loops" else 1e-6)


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
    assert choose_method(kernel) == "scipy:Radau"
    q0, v0 = np.array([2e-4, 0.0, 0.0]), np.array([0.02, 0.0, 30.0])
    found = integrate(kernel, q0, v0, 0.06, method="scipy:DOP853", rtol=1e-10, output_step=2e-3)
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
    found = integrate(kernel, *start, 0.05, method="scipy:DOP853", rtol=1e-10)
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
    heavy = kernel.replaced(parameters={"gravity.y": -9810.0})
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


def test_what_journals_cost() -> None:
    """Multiplications of the force, and nothing at all where there is no journal."""
    plane, tilting = ("x", "y"), ("x", "y", "alpha", "beta")
    for radial, names, most in ((replace(FULL, length=None), plane, 40), (FULL, tilting, 100)):
        assert 0 < products(rotor(radial, *names)) - products(rotor(None, *names)) <= most


ROOT = Path(__file__).parents[3]
CUT_FULL = Radial(0.05, 2e3, 0.5, 0.4, None, SlidingFriction(0.3, 0.2, 0.1))
PLANE = replace(CUT_FULL, length=None)
SIX = dict.fromkeys(COORDINATES, Coordinate())


def placed() -> Placement:
    return Placement.from_rpy((0.1, -0.2, 0.3), (0.4, 0.5, -0.3))


def pair(radial: Radial) -> tuple[Robot, Robot]:
    """A body on a joint with a journal; and floating, with the journal in a cut joint: the same coordinates."""
    link = Link("body", 2.0, (0.1, 0.0, 0.05), (0.1, 0.12, 0.09, 0.01, 0.0, 0.0))
    at = replace(placed(), rpy=None)
    free = Joint("root", "base", "body", "free", at, coordinates=SIX)
    of_tree = Robot("of_tree", (0.0, 0.0, -9.81), (link,), (replace(free, radial=radial),))
    loop = Loop("pin", ("base", "body"), "fixed", (at, Placement()), SIX, radial=radial)
    return of_tree, replace(of_tree, name="of_cut", joints=(free,), loops=(loop,))


def cut_states(count: int) -> list[State]:
    """States in which journals touch at one end, or both, or none."""
    rng = np.random.default_rng(7)
    return [State(rng.normal(0.0, 0.15, 6), *rng.normal(size=(3, 6))) for _ in range(count)]


@pytest.mark.soak
@pytest.mark.parametrize("radial", [CUT_FULL, PLANE], ids=["length", "plane"])
def test_it_is_the_journal_of_a_joint(radial: Radial, built: Build) -> None:
    """Forces, energy and reactions, one state at a time, several on vectors, and in single precision."""
    tree, cut = pair(radial)
    ours, theirs = built(cut, *NAMES, "loop_reactions"), built(tree, *NAMES)
    assert ours.cut_laws == tuple(f"pin.{name}" for name in radial.felt)
    check_same(ours, theirs, many := cut_states(9))
    q, v = stacked(many)
    assert np.abs(theirs.generalized_force(q, v) - theirs.generalized_force(q, 0.0 * v)).max() > 1.0
    check_single_precision(theirs, cut, (q, v), built, 1e-3)


@pytest.mark.soak
def test_motions_are_those_of_a_joint(built: Build) -> None:
    """All kinds of steps; contacts with their angle and end."""
    radial = replace(CUT_FULL, friction=SlidingFriction(0.1, 0.2, 1e-2))
    kernels = [built(robot, *NAMES, "rollout", "adaptive_rollout") for robot in pair(radial)]
    q0, v0, u = np.array([0.02, 0.0, 0.0, 0.1, -0.05, 0.0]), np.array([0.3, 0.1, 0.0, 0.2, 0.1, 3.0]), np.zeros(6)
    for way in (
        {"dt": 1e-3, "steps": 200, "every": 20},
        {"dt": 1e-3, "steps": 200, "every": 20, "method": "implicit"},
        {"duration": 0.2, "samples": 10, "rtol": 1e-7, "method": "rosenbrock"},
    ):
        theirs, ours = (kernel.rollout(q0, v0, u, **way)[0] for kernel in kernels)
        assert np.abs(theirs[:, 0]).max() > 0.03
        assert np.abs(ours - theirs).max() < 1e-5
    assert why_stiff(kernels[1]) == why_stiff(kernels[0]) != ""
    fast = [fastest_rates(kernel, q0)[0] for kernel in kernels]
    assert fast[1] == pytest.approx(fast[0], rel=0.2)
    theirs, ours = (integrate(kernel, q0, v0, 0.2, rtol=1e-8, output_step=0.01) for kernel in kernels)
    assert np.abs(ours.q - theirs.q).max() < 1e-6
    assert len(ours.contacts) == len(theirs.contacts) > 0
    for one, other in zip(ours.contacts, theirs.contacts, strict=True):
        assert (one.coordinate, other.coordinate) == ("pin.radial", "root.radial")
        assert (one.side, one.closes) == (other.side, other.closes)
        assert [one.t, one.rate, one.angle] == pytest.approx([other.t, other.rate, other.angle], abs=1e-4)


CRANK = (ROOT / "examples" / "slider_crank.toml").read_text(encoding="utf-8")
OTHERWISE = (
    CRANK[: CRANK.index('[[joints]]\nname = "pin"')].replace(
        '"pin.gamma" = 3.141592653589793', '"crankpin.gamma" = 0.0'
    )
    + f"""
{joint_table("crankpin", "crank", "rod", "revolute")}
placement = {{ xyz = [0.05, 0.0, 0.0] }}
{loop_table("pin", "slider", "rod", "revolute")}
placements = [{{ rpy = [0.0, -1.5707963267948966, 0.0] }}, {{ xyz = [0.12, 0.0, 0.0] }}]
x = {{}}
y = {{}}
radial = {{ clearance = 5e-4, stiffness = 4e8, restitution_damping = 0.15 }}
"""
)


def otherwise() -> Robot:
    """The slider-crank with a worn pin, cut there; its rod begins at the crank."""
    return replace(robot_from_toml(OTHERWISE), name="slider_crank_otherwise")


def test_a_slider_crank_cut_at_its_worn_pin(built: Build) -> None:
    """The motion of the mechanism that is cut at the crank pin: until impacts have made a difference of them."""
    theirs, ours = built(eomgen.load_robot(ROOT / "examples" / "slider_crank.toml")), built(otherwise())
    speed = 5000.0 * 2 * np.pi / 60
    q = theirs.assemble(np.array([0.0, 0.17, 0.0, 0.0, np.pi]))
    v = theirs.project_velocity(q, np.array([speed, 0, 0, 0, 0.0]), fixed=("motor.gamma", "pin.x", "pin.y"))
    names = list(ours.coordinates)
    assert sorted(names) == ["crankpin.gamma", "guide.z", "motor.gamma"]
    start, rates = np.zeros(3), np.zeros(3)
    start[names.index("guide.z")] = q[1]
    rates[names.index("motor.gamma")], rates[names.index("guide.z")] = v[0], v[1]
    rates[names.index("crankpin.gamma")] = -speed - 0.05 * speed / 0.12
    found = theirs.rollout(q, v, np.zeros(5), 1e-6, 2000, every=10)
    mine = ours.rollout(start, rates, np.zeros(3), 1e-6, 2000, every=10)
    slider = mine[0][:, names.index("guide.z")]
    assert np.hypot(found[0][:, 2], found[0][:, 3]).max() > 5e-4  # it touches
    assert np.abs(slider - found[0][:, 1]).max() < 1e-9
    a = ours.forward_dynamics(*mine, np.zeros(3))[:, names.index("guide.z")]
    wanted = theirs.forward_dynamics(*found, np.zeros(5))[:, 1]
    assert np.abs(wanted).max() > 2e4
    assert np.abs(a - wanted).max() < 1e-3 * np.abs(wanted).max()
    s = ours.functions.cut_forces(*mine)[..., 0]
    assert np.abs(np.abs(s[:, :2]) - np.abs(found[0][:, 2:4])).max() < 1e-8


SWING = f"""
name = "swing"
gravity = [0.0, -9.81, 0.0]
driven = []
tunable = ["loops.pin.radial.clearance"]
{link_table("bar", 1.0, (0.25, 0.0, 0.0), (1e-3, 0.02, 0.02))}
{joint_table("hinge", "base", "bar", "revolute")}
{loop_table("pin", "base", "bar", "revolute")}
placements = [{{ xyz = [0.5, 0.0, 0.0] }}, {{ xyz = [0.5, 0.0, 0.0] }}]
x = {{}}
y = {{}}
radial = {{ clearance = 1e-3, stiffness = 1e6, restitution_damping = 0.5 }}
"""


@pytest.mark.soak
@pytest.mark.usefixtures("unoptimised")
def test_a_simulation_falls_through_the_play(tmp_path: Path) -> None:
    """The bar's end drops by the clearance, bounces below, and its energy balances; the file knows the contact."""
    robot = robot_from_toml(SWING)
    kernel = eomgen.build(robot, flags=("-O0",))
    assert floating_cuts(kernel, np.zeros(1)) == ["pin.x", "pin.y"]
    scenario = scenario_from_toml("duration = 0.06\noutput_step = 1e-4\n[integrator]\nrtol = 1e-8\n")
    result = eomgen.run_scenario(robot, scenario)
    first = result.trajectory.contacts[0]
    assert (first.coordinate, first.side, first.closes) == ("pin.radial", 0, True)
    assert first.angle == pytest.approx(-np.pi / 2, abs=1e-2)
    fall = 9.81 * 0.25 / (0.02 + 0.25**2)  # rad/s^2
    assert first.t == pytest.approx(np.sqrt(2 * 1e-3 / 0.5 / fall), rel=1e-2)
    assert result.balance.relative_residue < 1e-4
    again = load_result(result.save(tmp_path / "motion.npz"))
    assert again.trajectory.contacts == result.trajectory.contacts


@pytest.mark.usefixtures("unoptimised")
def test_it_rests_on_the_bearing() -> None:
    """The end's weight, half of the bar's, on the contact; the reaction of the cut joint says so."""
    robot = robot_from_toml(SWING)
    q = eomgen.analysis.deflection(robot, pose=[-0.0021]).q
    depth = np.sqrt(2.0 * 5e-5 * 0.5 * 9.81 / 1e6)  # within the smoothing, d = x^2 / (2 w)
    assert -0.5 * np.sin(q[0]) == pytest.approx(1e-3 + depth, rel=1e-4)
    kernel = eomgen.build(robot, flags=("-O0",))
    still = np.zeros(1)
    reaction = kernel.loop_reactions(q, still, still)[0]
    assert np.hypot(*reaction[:2]) == pytest.approx(0.5 * 9.81, rel=1e-4)


@pytest.mark.parametrize("radial", [CUT_FULL, PLANE], ids=["length", "plane"])
def test_implicit_steps_and_slopes_are_those_of_a_joint(radial: Radial) -> None:
    """Rows beside the tree, where a joint has a block."""
    tree, cut = pair(radial)
    for s in cut_states(4):
        assert close(implicit_step(cut, s, 0.02), implicit_step(tree, s, 0.02), 1e-6)
        check_slopes(cut, s, 1e-9, of=tree)
