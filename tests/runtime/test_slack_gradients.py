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
from tests.runtime.test_rollout_gradients import frozen
from tests.support.builds import Build
from tests.support.soak import across

pytestmark = pytest.mark.usefixtures("unoptimised")

STEPS, DT = 8, 2e-3
METHODS: dict[str, dict[str, Any]] = {
    "implicit": {"dt": DT, "steps": STEPS},
    "rosenbrock": {"duration": STEPS * DT, "samples": STEPS},
}
KERNELS = ("rollout", "adaptive_rollout", *(f"{x}_{y}" for x in METHODS for y in ("gradient", "sensitivity")))
CLOSED = ("constraint", "constraint_jacobian", "mass_matrix", "cut_poses", "spring_forces", "cut_forces")
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


class Loss:
    """Weighted coordinates and rates of all samples."""

    def __init__(self, n: int) -> None:
        self.weights = np.random.default_rng(4).uniform(-1.0, 1.0, (2, STEPS + 1, n))

    def __call__(self, t: np.ndarray, q: np.ndarray, v: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        of_q, of_v = (np.broadcast_to(x, q.shape) for x in self.weights)
        return float((of_q * q + of_v * v).sum()), of_q.copy(), of_v.copy()


STATES = {  # deviation and rate at the beginning
    "slack": (0.5 * GAP, 0.1),
    "within the smoothing": (GAP + 4e-4, 0.01),
    "taut": (GAP + 4e-3, 0.1),
    "taut, on the other side": (-GAP - 4e-3, -0.1),
    "gets taut": (GAP - 1e-3, 0.47),
    "gets slack": (GAP + 2e-3, -0.47),
}


class Case:
    """Carts with a method, drives and a loss."""

    def __init__(self, built: Build, method: str, *, driven: bool = True, **options: Any) -> None:
        self.kernel, self.method = built(carts(), *KERNELS, **options), method
        self.loss, n = Loss(self.kernel.n), self.kernel.n
        self.u = np.random.default_rng(5).uniform(-1.0, 1.0, n) if driven else np.zeros(n)
        self.parameters = tuple(x for x in self.kernel.parameters if "gravity" not in x)

    def gradient(self, q: np.ndarray, v: np.ndarray, kernel: eomgen.Kernel | None = None) -> tuple[Any, dict[str, Any]]:
        """The value and its gradient."""
        how = {"method": self.method, "parameters": self.parameters, **METHODS[self.method]}
        numbers = (x.astype(self.kernel.raw.dtype) for x in (q, v, self.u))
        return (kernel or self.kernel).rollout_gradient(*numbers, loss=self.loss, **how)

    def value(self, q: np.ndarray, v: np.ndarray) -> float:
        """The value alone."""
        return float(self.gradient(q, v)[0])


@pytest.mark.parametrize(("where", "method"), across(STATES, METHODS))
def test_on_both_sides(where: str, method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """By coordinates and rates where motions begin, and by all numbers of what holds the carts."""
    frozen(monkeypatch)
    case, h = Case(built, method), 1e-7
    q, v = begin(case.kernel, *STATES[where])
    found, names = case.gradient(q, v)[1], case.kernel.coordinates
    for name, e in zip(names, np.eye(len(names)), strict=True):
        by_q = (case.value(q + h * e, v) - case.value(q - h * e, v)) / (2.0 * h)
        by_v = (case.value(q, v + h * e) - case.value(q, v - h * e)) / (2.0 * h)
        assert found["q"] @ e == pytest.approx(by_q, rel=1e-6, abs=1e-7), name
        assert found["v"] @ e == pytest.approx(by_v, rel=1e-6, abs=1e-7), name
    for name in case.parameters:
        x = case.kernel.parameters[name]
        step = 1e-6 * max(abs(x), 0.1)
        ends = [case.gradient(q, v, case.kernel.with_parameters({name: x + s * step}))[0] for s in (1, -1)]
        wanted = (ends[0] - ends[1]) / (2.0 * step)
        assert found[name] == pytest.approx(wanted, rel=1e-6, abs=1e-9 / step), name


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_at_slack_itself(side: float, method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """At rest where all of it just closes: derivatives of the slack side, on which nothing pulls."""
    frozen(monkeypatch)
    case, h = Case(built, method, driven=False), 1e-6
    q, v = begin(case.kernel, side * GAP, 0.0)
    deviating = q != 0.0
    found, value = case.gradient(q, v)[1], case.value(q, v)
    assert np.isfinite([found[name] for name in case.parameters]).all()
    for i in np.flatnonzero(deviating):
        e = -side * np.eye(case.kernel.n)[i]
        for given, beside in (("q", (q + h * e, v)), ("v", (q, v + h * e))):
            wanted = (case.value(*beside) - value) / h
            assert found[given] @ e == pytest.approx(wanted, rel=1e-6, abs=1e-8), case.kernel.coordinates[i]


@pytest.mark.parametrize("method", METHODS)
def test_forwards_and_backwards(method: str, built: Build) -> None:
    """Sensitivities and gradients are the same derivatives, of many states as of each alone."""
    case = Case(built, method)
    kernel, n = case.kernel, case.kernel.n
    pairs = [begin(kernel, *state) for state in (*STATES.values(), (GAP, 0.0))]
    q, v = (np.array([pair[i] for pair in pairs]) for i in (0, 1))
    whole = case.gradient(q, v)[1]
    total = dict.fromkeys(case.parameters, 0.0)
    directions = {"q": np.vstack([np.eye(n), np.zeros((n, n))]), "v": np.vstack([np.zeros((n, n)), np.eye(n)])}
    for k, (one, rate) in enumerate(pairs):
        alone = case.gradient(one, rate)[1]
        assert np.array_equal(alone["q"], whole["q"][k])
        assert np.array_equal(alone["v"], whole["v"][k])
        how = {"method": method, "parameters": case.parameters, "along": directions, **METHODS[method]}
        _, (dq, dv) = kernel.rollout_sensitivity(one, rate, case.u, **how)
        of_q, of_v = case.loss.weights
        carried = np.einsum("tdn,tn->d", dq, of_q) + np.einsum("tdn,tn->d", dv, of_v)
        wanted = np.concatenate([alone["q"], alone["v"], [alone[x] for x in case.parameters]])
        assert np.allclose(carried, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())
        for x in case.parameters:
            total[x] += alone[x]
    assert all(whole[x] == pytest.approx(total[x], rel=1e-12, abs=1e-12) for x in case.parameters)


@pytest.mark.soak
@pytest.mark.parametrize("where", [*STATES, "at slack"])
def test_in_single_precision(where: str, built: Build) -> None:
    """Of steps of one length; those of double precision but for round-off."""
    double, single = Case(built, "implicit"), Case(built, "implicit", dtype="float32")
    q, v = begin(double.kernel, *(STATES | {"at slack": (0.75 * GAP, 0.0)})[where])
    wanted, found = (case.gradient(q, v)[1] for case in (double, single))
    for name in ("q", "v"):
        assert found[name].dtype == np.float32
        assert np.abs(found[name] - wanted[name]).max() <= 2e-3 * np.abs(wanted[name]).max()


def test_gradients_that_are_not_finite_are_refused_by_name(built: Build) -> None:
    """Not as numbers, nor as steps that are too long."""
    case = Case(built, "implicit")
    q, v = begin(case.kernel, 0.5 * GAP, 0.1)
    huge = Loss(case.kernel.n)
    huge.weights[...] = 1.7e308
    how: dict[str, Any] = {"method": "implicit", "dt": DT, "steps": STEPS}
    with (
        np.errstate(over="ignore"),
        pytest.raises(ArrayError, match=r"rollout_gradient: the derivative by (q|v|u) at .*\.[xz] is -?(inf|nan)"),
    ):
        case.kernel.rollout_gradient(q, v, case.u, loss=huge, **how)
    with pytest.raises(ArrayError, match=r"rollout_sensitivity: the derivative of .* along direction 0 is -?(inf|nan)"):
        case.kernel.rollout_sensitivity(q, v, case.u, along={"v": np.full((1, case.kernel.n), 1.7e308)}, **how)


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
    kernel = built(robot, *KERNELS, *(CLOSED if is_closed else ()))
    q, v, u = np.array(guess), np.zeros(kernel.n), np.array([0.5, 0.3, -0.2])
    if is_closed:
        q = kernel.assemble(q, ["joint1.gamma"])
        v = kernel.project_velocity(q, [2.0, 0.0, 0.0], ["joint1.gamma"])
    how, loss = {"method": method, **METHODS[method]}, Loss(kernel.n)
    found = kernel.rollout_gradient(q, v, u, loss=loss, **how)[1]
    for label, given in (("u", u),) if is_closed else (("q", q), ("v", v), ("u", u)):
        wanted = []
        for e in h * np.eye(kernel.n):
            ends = ({"q": q, "v": v, "u": u} | {label: given + s * e} for s in (1, -1, 2, -2))
            values = [kernel.rollout_gradient(x["q"], x["v"], x["u"], loss=loss, **how)[0] for x in ends]
            wanted.append((8.0 * (values[0] - values[1]) - (values[2] - values[3])) / (12.0 * h))
        assert np.abs(found[label] - wanted).max() <= 1e-6 * np.abs(wanted).max(), label


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
    kernel, rng, h = built(net(), *KERNELS, "spring_forces"), np.random.default_rng(6), 1e-6
    q, v, u = 3e-3 * rng.normal(size=kernel.n), 0.1 * rng.normal(size=kernel.n), rng.normal(size=kernel.n)
    tensions = kernel.spring_forces(q, v)[:, 1]
    assert 0 < np.count_nonzero(tensions) < tensions.size
    how, loss = {"method": method, **METHODS[method]}, Loss(kernel.n)
    found = kernel.rollout_gradient(q, v, u, loss=loss, **how)[1]
    for e in rng.normal(size=(3, 2, kernel.n)):
        ends = [kernel.rollout_gradient(q + s * h * e[0], v + s * h * e[1], u, loss=loss, **how)[0] for s in (1, -1)]
        wanted = (ends[0] - ends[1]) / (2.0 * h)
        assert found["q"] @ e[0] + found["v"] @ e[1] == pytest.approx(wanted, rel=1e-6)
