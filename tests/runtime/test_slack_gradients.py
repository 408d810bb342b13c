"""Gradients of implicit steps where something is slack: against differences of the same steps, and at slack itself.

Bodies stand side by side and know nothing of each other; each is held by one thing that can be slack.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import ArrayError
from eomgen.robot.value import Coordinate, Robot, Spring
from tests.support.builds import Build
from tests.support.refusals import refused
from tests.support.rollout_cases import CLOSED, KERNELS, Case, frozen
from tests.support.soak import across

pytestmark = pytest.mark.usefixtures("unoptimised")

METHODS = ("implicit", "rosenbrock")
NAMES = tuple(name for name in KERNELS if not name.startswith("explicit"))
SPRINGS = ("spring_forces", "cut_forces")
GAP = 0.015625  # half a clearance, m: places of all that becomes slack are exact in binary numbers
CART = """
[[links]]
name = "{0}_cart"
mass = {1}
com = [0.0, 0.0, 0.0]
inertia = {{ xx = 0.1, yy = 0.1, zz = 0.1 }}
[[joints]]
name = "{0}"
parent = "base"
child = "{0}_cart"
type = "prismatic"
z = {{ damping = 0.5 }}
"""
CUT = '[[loops]]\nname = "{0}_cut"\nlinks = ["base", "{0}_cart"]\ntype = "fixed"\n'
FREE = "alpha = {}\nbeta = {}\ngamma = {}\n"
COUPLING = '[[couplings]]\nname = "{0}_gear"\nof = "{0}.z"\nto = {{ "{0}_other.z" = -0.5 }}\n'
CABLE = '[[springs]]\nname = "{0}_rope"\nlinks = ["base", "{0}_cart"]\npoints = [[0.0, 0.0, {1}], [0.0, 0.0, 0.0]]\n'
TENSION = "free_length = 0.5\nstiffness = 3e3\ndamping = 2.0\ntension_only = true\nsmoothing = 1e-3\n"
CURVE = f"curve = [[-0.25, -80.0], [-{GAP}, 0.0], [{GAP}, 0.0], [0.25, 60.0]]\n"
PLAY = f"stiffness = 2e3, clearance = {GAP}, restitution_damping = 0.4, smoothing = 1e-3"
STOPS = f"stops = {{ lower = -{GAP}, upper = {GAP}, stiffness = 2e3, damping = 3.0, smoothing = 1e-3 }}\n"
HELD = {  # what holds a cart, where it becomes slack, and whether a second one hangs on it
    "cable": (CABLE.format("cable", -0.5 + GAP) + TENSION, False),
    "play": (COUPLING.format("play") + PLAY.replace(", ", "\n") + "\n", True),
    "apart": (COUPLING.format("apart") + STOPS, True),
    "flat": (COUPLING.format("flat") + CURVE, True),
    "cut": (CUT.format("cut") + f"x = {{}}\ny = {{}}\nz = {{ {PLAY} }}\n" + FREE, False),
    "parted": (CUT.format("parted") + f"x = {{}}\ny = {{}}\nz = {{ {STOPS.strip()} }}\n" + FREE, False),
    "level": (CUT.format("level") + f"x = {{}}\ny = {{}}\nz = {{ {CURVE.strip()} }}\n" + FREE, False),
}
PLACES = (  # numbers that say where something closes
    *("couplings.play_gear.clearance", "couplings.apart_gear.stops.upper", "loops.cut_cut.z.clearance"),
    *("loops.pin_cut.radial.clearance", "springs.cable_rope.free_length", "couplings.play_gear.smoothing"),
)
BEARING = f"radial = {{ {PLAY}, friction = {{ coefficient = 0.2, smoothing = 0.01 }} }}\n"
JOURNAL = CART.replace("z = {{", "x = {{ damping = 0.5 }}\nz = {{").format("pin", 1.0)
JOURNAL += CUT.format("pin") + "x = {}\ny = {}\nz = {}\n" + FREE + BEARING


def carts() -> Robot:
    """A cart for each of what can be slack, some with a second one, and a journal, whose cart moves along x and z."""
    text = f'name = "carts"\ngravity = [0.0, 0.0, 0.0]\ntunable = {list(PLACES)}\n'
    for name, (held, is_pair) in HELD.items():
        text += CART.format(name, 1.0) + (CART.format(f"{name}_other", 2.0) if is_pair else "") + held
    return robot_from_toml(text + JOURNAL)


def begin(kernel: eomgen.Kernel, place: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Deviations of all that becomes slack at ``GAP``, and their rates; pairs share them."""
    q, v = np.zeros(kernel.n), np.zeros(kernel.n)
    for i, name in enumerate(kernel.coordinates):
        share = {"pin.z": 0.0}.get(name, 0.5 if f"{name[:-2]}_other.z" in kernel.coordinates else 1.0)
        q[i], v[i] = share * place, share * rate
    return q, v


STATES = {  # deviation and rate at the beginning
    "slack": (0.5 * GAP, 0.1),
    "within the smoothing": (GAP + 4e-4, 0.01),
    "taut": (GAP + 4e-3, 0.1),
    "taut, on the other side": (-GAP - 4e-3, -0.1),
    "gets taut": (GAP - 1e-3, 0.47),
    "gets slack": (GAP + 2e-3, -0.47),
}


def case_of(built: Build, method: str, state: tuple[float, float] = (0.0, 0.0), **options: Any) -> Case:
    """Carts with a method, drives and a loss."""
    kernel = built(carts(), *NAMES, **options)
    q, v = begin(kernel, *state)
    case = Case(kernel, method, {"q": q, "v": v, "u": np.random.default_rng(5).uniform(-1.0, 1.0, kernel.n)}, power=1)
    case.inputs, case.parameters = ("q", "v"), tuple(x for x in kernel.parameters if "gravity" not in x)
    return case


@pytest.mark.parametrize(("where", "method"), across(STATES, METHODS))
def test_on_both_sides(where: str, method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """By coordinates and rates where motions begin, and by all numbers of what holds the carts."""
    frozen(monkeypatch)
    case = case_of(built, method, STATES[where])
    found = case.gradient()[1]
    for i, name in enumerate(case.kernel.coordinates):
        for given in case.inputs:
            wanted = case.slope(given, np.eye(case.kernel.n)[i], 1e-7)
            assert found[given][i] == pytest.approx(wanted, rel=1e-6, abs=1e-7), name
    for name in case.parameters:
        step = 1e-6 * max(abs(case.kernel.parameters[name]), 0.1)
        wanted = case.slope(name, np.ones(()), step)
        assert found[name] == pytest.approx(wanted, rel=1e-6, abs=1e-9 / step), name


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_at_slack_itself(side: float, method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """At rest where all of it just closes: derivatives of the slack side, on which nothing pulls."""
    frozen(monkeypatch)
    case, h = case_of(built, method, (side * GAP, 0.0)), 1e-6
    case.given["u"][:] = 0.0
    value, found = case.gradient()
    assert np.isfinite([found[name] for name in case.parameters]).all()
    for i in np.flatnonzero(case.given["q"]):
        e = -side * np.eye(case.kernel.n)[i]
        for given in case.inputs:
            wanted = (case.gradient(**{given: case.given[given] + h * e})[0] - value) / h
            assert found[given] @ e == pytest.approx(wanted, rel=1e-6, abs=1e-8), case.kernel.coordinates[i]


@pytest.mark.parametrize("method", METHODS)
def test_forwards_and_backwards(method: str, built: Build) -> None:
    """Sensitivities and gradients are the same derivatives, of many states as of each alone."""
    case = case_of(built, method)
    pairs = [begin(case.kernel, *state) for state in (*STATES.values(), (GAP, 0.0))]
    q, v = (np.array([pair[i] for pair in pairs]) for i in (0, 1))
    whole = case.gradient(q=q, v=v)[1]
    total = dict.fromkeys(case.parameters, 0.0)
    for k, (case.given["q"], case.given["v"]) in enumerate(pairs):
        alone = case.gradient()[1]
        assert all(np.array_equal(alone[name], whole[name][k]) for name in case.inputs)
        case.check_sensitivities(1e-9)
        total = {x: y + alone[x] for x, y in total.items()}
    assert all(whole[x] == pytest.approx(total[x], rel=1e-12, abs=1e-12) for x in case.parameters)


@pytest.mark.soak
@pytest.mark.parametrize("where", [*STATES, "at slack"])
def test_in_single_precision(where: str, built: Build) -> None:
    """Of steps of one length; those of double precision but for round-off."""
    state = (STATES | {"at slack": (0.75 * GAP, 0.0)})[where]
    double, single = (case_of(built, "implicit", state, dtype=dtype) for dtype in ("float64", "float32"))
    single.given = {name: x.astype(np.float32) for name, x in single.given.items()}
    wanted, found = (case.gradient()[1] for case in (double, single))
    for name in ("q", "v"):
        assert found[name].dtype == np.float32
        assert np.abs(found[name] - wanted[name]).max() <= 2e-3 * np.abs(wanted[name]).max()


def test_gradients_that_are_not_finite_are_refused_by_name(built: Build) -> None:
    """Not as numbers, nor as steps that are too long."""
    case = case_of(built, "implicit", (0.5 * GAP, 0.1))
    along = {"v": np.full((1, case.kernel.n), 1.7e308)}
    message = r"rollout_sensitivity: the derivative of .* along direction 0 is -?(inf|nan)"
    refused(ArrayError, message, case.sensitivity, along=along, parameters=())
    case.loss.weights[...] = 1.7e308
    message = r"rollout_gradient: the derivative by (q|v|u) at .*\.[xz] is -?(inf|nan)"
    with np.errstate(over="ignore"):
        refused(ArrayError, message, case.gradient, parameters=())


def worn_four_bar() -> Robot:
    """A rigid loop whose cut joint has play, and a cable: rigid rows and elastic ones, of which one is slack."""
    robot = eomgen.load_robot("four_bar")
    play = Coordinate(stiffness=50.0, clearance=0.3, restitution_damping=0.1)
    cable = Spring("rope", ("base", "coupler"), ((0.0, -0.2, 0.0), (0.1, 0.0, 0.0)), 0.4, 500.0, 1.0, tension_only=True)
    pin = replace(robot.loops[0], coordinates={"gamma": play}, offset=(*(None,) * 5, -0.9))
    return replace(robot, loops=(pin,), springs=(cable,))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("name", "guess"),
    [
        pytest.param("balanced_arm", (0.0, 0.5, 1.0), marks=pytest.mark.soak),
        pytest.param("balanced_arm", (0.0, 1.0, 0.4), marks=pytest.mark.soak),
        ("four_bar", (1.0, -0.5, 1.4)),
        ("four_bar", (2.8, -0.5, 2.5)),
    ],
)
def test_mechanisms(
    name: str, guess: tuple[float, ...], method: str, built: Build, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cable beside other springs, in space; play and a cable beside rigid rows. By states, and by drives."""
    frozen(monkeypatch)
    is_closed, h = name == "four_bar", 3e-5
    robot = worn_four_bar() if is_closed else eomgen.load_robot(name)
    kernel = built(robot, *NAMES, *((*CLOSED, *SPRINGS) if is_closed else ()))
    q, v, u = np.array(guess), np.zeros(kernel.n), np.array([0.5, 0.3, -0.2])
    if is_closed:
        q = kernel.assemble(q, ["joint1.gamma"])
        v = kernel.project_velocity(q, [2.0, 0.0, 0.0], ["joint1.gamma"])
    case = Case(kernel, method, {"q": q, "v": v, "u": u}, power=1)
    found = case.gradient()[1]
    for name in case.inputs:
        slopes = ([case.slope(name, e, step) for e in np.eye(kernel.n)] for step in (h, 2.0 * h))
        wanted = np.array([4.0, -1.0]) @ list(slopes) / 3.0
        assert np.abs(found[name] - wanted).max() <= 1e-6 * np.abs(wanted).max(), name


def net() -> Robot:
    """A body that many cables to carts hold, each second one slack: its accelerations stay unknowns of the rows."""
    text = 'name = "net"\ngravity = [0.0, 0.0, 0.0]\n' + CART.replace("z = {{", "x = {{}}\ny = {{}}\nz = {{").format(
        "body", 3.0
    )
    for k in range(8):
        at, angle = f"cart{k}", 0.25 * np.pi * k
        place = f"placement = {{ xyz = [{np.cos(angle):.12g}, {np.sin(angle):.12g}, {0.3 * (-1) ** k}] }}\n"
        text += CART.format(at, 1.0).replace("z = {", f"{place}z = {{")
        ends = f'links = ["body_cart", "{at}_cart"]\npoints = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]\n'
        text += f'[[springs]]\nname = "rope{k}"\n{ends}' + TENSION.replace("0.5", "1.04" if k % 2 else "1.05")
    return robot_from_toml(text)


@pytest.mark.soak
@pytest.mark.parametrize("method", METHODS)
def test_a_body_that_many_hold(method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    frozen(monkeypatch)
    kernel, rng, h = built(net(), *NAMES, "spring_forces"), np.random.default_rng(6), 1e-6
    q, v, u = 3e-3 * rng.normal(size=kernel.n), 0.1 * rng.normal(size=kernel.n), rng.normal(size=kernel.n)
    tensions = kernel.spring_forces(q, v)[:, 1]
    assert 0 < np.count_nonzero(tensions) < tensions.size
    case = Case(kernel, method, {"q": q, "v": v, "u": u}, power=1)
    found = case.gradient()[1]
    for e in rng.normal(size=(3, 2, kernel.n)):
        for name, direction in zip("qv", e, strict=True):
            assert found[name] @ direction == pytest.approx(case.slope(name, direction, h), rel=1e-6)
