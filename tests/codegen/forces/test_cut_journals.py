"""Journals in bearings of cut joints: against the same journals in joints of the tree, and through all rooms."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.analysis.holding import floating_cuts
from eomgen.codegen.closed_form.trace import closed_form
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.ir import evaluate
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError
from eomgen.export.fmu.variables import parameter_unit
from eomgen.export.mujoco import left_out
from eomgen.integration import integrate
from eomgen.integration.plan import why_stiff
from eomgen.pipeline.costs import RobotInfo
from eomgen.robot.elements.journal import Radial, SlidingFriction
from eomgen.robot.model import build_model
from eomgen.robot.parameter_names import least_of
from eomgen.robot.record import record_of, robot_of
from eomgen.robot.value import COORDINATES, Coordinate, Joint, Link, Loop, Placement, Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.result import load_result
from eomgen.state.springs import fastest_rates
from tests.oracles.complex_step import complex_steps
from tests.support.builds import Build
from tests.support.closeness import close
from tests.support.random_robots import State

ROOT = Path(__file__).parents[3]
NAMES = ("inverse_dynamics", "generalized_force", "forward_dynamics", "energy", "residual_jacobian", "mass_matrix")
FULL = Radial(0.05, 2e3, 0.5, 0.4, None, SlidingFriction(0.3, 0.2, 0.1))
PLANE = replace(FULL, length=None)
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


def states(count: int) -> list[State]:
    """States in which journals touch at one end, or both, or none."""
    rng = np.random.default_rng(7)
    return [State(rng.normal(0.0, 0.15, 6), *rng.normal(size=(3, 6))) for _ in range(count)]


def inputs_of(robot: Robot, s: State) -> dict[str, object]:
    model = build_model(robot)
    numbers = [*model.parameters.values(), *(0.0 for _ in model.turning)]
    return {"q": s.q, "v": s.v, "a": s.a, "u": s.u, "p": numbers}


@pytest.mark.soak
@pytest.mark.parametrize(
    "radial", [pytest.param(FULL, id="length"), pytest.param(PLANE, id="plane", marks=pytest.mark.soak)]
)
def test_it_is_the_journal_of_a_joint(radial: Radial, built: Build) -> None:
    """Forces, energy and reactions, one state at a time, several on vectors, and in single precision."""
    tree, cut = pair(radial)
    ours, theirs = built(cut, *NAMES, "loop_reactions"), built(tree, *NAMES)
    assert ours.cut_laws == tuple(f"pin.{name}" for name in radial.felt)
    many = states(9)
    forces = []
    for s in many:
        assert close(ours.inverse_dynamics(s.q, s.v, s.a), theirs.inverse_dynamics(s.q, s.v, s.a))
        assert close(ours.forward_dynamics(s.q, s.v, s.u), theirs.forward_dynamics(s.q, s.v, s.u), 1e-8)
        assert close(ours.energy(s.q, s.v), theirs.energy(s.q, s.v))
        forces.append(theirs.generalized_force(s.q, s.v) - theirs.generalized_force(s.q, s.v * 0.0))
    assert np.abs(forces).max() > 1.0
    q, v = (np.array([getattr(s, x) for s in many]) for x in "qv")
    assert close(ours.generalized_force(q, v), theirs.generalized_force(q, v))
    few = (q.astype(np.float32), v.astype(np.float32))
    single = built(cut, "generalized_force", dtype="float32").generalized_force(*few)
    assert close(single, theirs.generalized_force(*(x.astype(float) for x in few)), 1e-3)


@pytest.mark.parametrize("radial", [FULL, PLANE], ids=["length", "plane"])
def test_slopes_are_those_of_the_forces(radial: Radial) -> None:
    tree, cut = pair(radial)
    for s in states(3):
        found = evaluate(derive(build_model(cut), "residual_jacobian"), inputs_of(cut, s))
        blocks = np.array(list(found.values())).reshape(3, 6, 6)
        for block, name in zip(blocks, "qva", strict=True):
            assert close(block, complex_steps(tree, s, name), 1e-9)


@pytest.mark.parametrize("radial", [FULL, PLANE], ids=["length", "plane"])
def test_an_implicit_step_is_that_of_a_joint(radial: Radial) -> None:
    """Rows beside the tree, where a joint has a block."""
    tree, cut = pair(radial)
    for s in states(4):
        found = []
        for robot in (tree, cut):
            more = {"added": np.zeros(6), "dt": [0.02, 4e-4]}
            values = evaluate(derive(build_model(robot), "implicit_step"), {**inputs_of(robot, s), **more})
            found.append(np.array([values["out", i] for i in range(6)]))
        assert close(found[1], found[0], 1e-6)


@pytest.mark.soak
def test_motions_are_those_of_a_joint(built: Build) -> None:
    """All kinds of steps; contacts with their angle and end."""
    radial = replace(FULL, friction=SlidingFriction(0.1, 0.2, 1e-2))
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
    + """
[[joints]]
name = "crankpin"
parent = "crank"
child = "rod"
type = "revolute"
placement = { xyz = [0.05, 0.0, 0.0] }
[[loops]]
name = "pin"
links = ["slider", "rod"]
type = "revolute"
placements = [{ rpy = [0.0, -1.5707963267948966, 0.0] }, { xyz = [0.12, 0.0, 0.0] }]
x = {}
y = {}
radial = { clearance = 5e-4, stiffness = 4e8, restitution_damping = 0.15 }
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
    v = theirs.project_velocity(q, np.array([speed, 0, 0, 0, 0.0]), held=("motor.gamma", "pin.x", "pin.y"))
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
    s = ours.cut_forces(*mine)[..., 0]
    assert np.abs(np.abs(s[:, :2]) - np.abs(found[0][:, 2:4])).max() < 1e-8


LOOSE = """
name = "swing"
gravity = [0.0, -9.81, 0.0]
driven = []
tunable = ["loops.pin.radial.clearance"]
[[links]]
name = "bar"
mass = 1.0
com = [0.25, 0.0, 0.0]
inertia = { xx = 1e-3, yy = 0.02, zz = 0.02 }
[[joints]]
name = "hinge"
parent = "base"
child = "bar"
type = "revolute"
[[loops]]
name = "pin"
links = ["base", "bar"]
type = "revolute"
placements = [{ xyz = [0.5, 0.0, 0.0] }, { xyz = [0.5, 0.0, 0.0] }]
x = {}
y = {}
radial = { clearance = 1e-3, stiffness = 1e6, restitution_damping = 0.5 }
"""
REFUSED = {
    "\nx = {}": ("", ["loops.pin.radial", "x does not move", "x, y have tables"]),
    "y = {}": ("y = { stiffness = 1e3, clearance = 1e-3 }", ["loops.pin.radial", "y has a clearance, too"]),
    "stiffness = 1e6": ("stiffness = 0.0", ["loops.pin.radial.stiffness", "0.0", "greater than 0"]),
    "stiffness = 1e6,": ("stiffness = 1e6, length = 0.1,", ["alpha does not move", "x, y, alpha, beta have tables"]),
    "= 0.5 }\n": (
        "= 0.5, friction = { coefficient = 0.1, radius = 0.01 } }\n",
        ["gamma does not move", "loop joint: with a table"],
    ),
}


@pytest.mark.parametrize("old", REFUSED)
def test_what_is_wrong_is_refused(old: str) -> None:
    new, said = REFUSED[old]
    with pytest.raises(DescriptionError) as caught:
        robot_from_toml(LOOSE.replace(old, new), source="my.toml")
    assert all(word in str(caught.value) for word in said), caught.value


def test_it_is_read_kept_and_named() -> None:
    robot = robot_from_toml(LOOSE)
    (loop,) = robot.loops
    assert loop.radial == Radial(1e-3, 1e6, None, 0.5)
    assert robot_of(json.loads(json.dumps(record_of(robot)))) == robot == pickle.loads(pickle.dumps(robot))
    bare = replace(robot, loops=(replace(loop, radial=None),))
    assert "radial" not in record_of(bare)["loops"][0]
    assert build_model(robot).cut_laws == (("pin", "x", Coordinate()), ("pin", "y", Coordinate()))
    assert robot.rigid().loops[0].radial is None
    assert robot.rigid().tunable == ()
    wrong = replace(robot, loops=(replace(loop, coordinates={}),))
    with pytest.raises(DescriptionError, match=r"loops\.pin\.radial: x does not move"):
        build_model(wrong)
    name = "loops.pin.radial.restitution_damping"
    assert (parameter_unit(robot, name), least_of(name)) == ("s/m", 0.0)
    info = RobotInfo(build_model(robot), {}, (), {}, {})
    assert info.as_dict()["journals"] == {"pin.radial": loop.radial.law()}
    assert any(line.startswith("  radial: clearance 0.001") for line in info.lines())
    assert "loops.pin.radial: without clearance" in left_out(robot)
    with pytest.raises(InputError, match=r"no journals of cut joints \(pin\)"):
        closed_form(build_model(robot))


@pytest.mark.soak
@pytest.mark.usefixtures("unoptimised")
def test_a_simulation_falls_through_the_play(tmp_path: Path) -> None:
    """The bar's end drops by the clearance, bounces below, and its energy balances; the file knows the contact."""
    robot = robot_from_toml(LOOSE)
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
    robot = robot_from_toml(LOOSE)
    q = eomgen.analysis.deflection(robot, pose=[-0.0021]).q
    depth = np.sqrt(2.0 * 5e-5 * 0.5 * 9.81 / 1e6)  # within the smoothing, d = x^2 / (2 w)
    assert -0.5 * np.sin(q[0]) == pytest.approx(1e-3 + depth, rel=1e-4)
    kernel = eomgen.build(robot, flags=("-O0",))
    still = np.zeros(1)
    reaction = kernel.loop_reactions(q, still, still)[0]
    assert np.hypot(*reaction[:2]) == pytest.approx(0.5 * 9.81, rel=1e-4)
