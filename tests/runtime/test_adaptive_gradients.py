"""Derivatives of steps with error control: those of the motion, of stiff robots or refused, also where loads jump."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError, SingularError
from eomgen.kernel.stepping.input_signals import DriveData, Gains, InputSignals, LinkWrench, Signal, Track, jump_times
from eomgen.kernel.stepping.methods import ADAPTIVE as METHODS
from eomgen.robot.value import Coordinate, Friction, Robot
from tests.support.builds import Build
from tests.support.random_robots import Array, random_robot, random_state, some_prescribed
from tests.support.refusals import refused
from tests.support.rollout_cases import (
    ALL,
    CLOSED,
    JOINTS,
    LOADED,
    assembled,
    loads_of,
    numbers,
    prescribed_robot,
    put,
)
from tests.support.sliders import mass_on_rail, massless_tip
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

T = 0.3
TIGHT = {"tsit5": 1e-11, "rosenbrock": 1e-10}
NAMES = ("forward_dynamics", "forward_dynamics_parameter_adjoint", "adaptive_rollout")
BACK = ("explicit_gradient", "rosenbrock_gradient", "explicit_sensitivity", "rosenbrock_sensitivity")
REFUSED = r"tsit5: \d+ of \d+ steps are near the limit of its stability.*take rosenbrock"


def last(t: Array, q: Array, v: Array) -> tuple[float, Array, Array]:
    """The last coordinates, with their derivatives."""
    dq = np.zeros_like(q)
    dq[..., -1, :] = 1.0
    return float(q[..., -1, :].sum()), dq, np.zeros_like(v)


@pytest.fixture(scope="module")
def block(built: Build) -> eomgen.Kernel:
    return built(mass_on_rail(friction=Friction(coulomb=6.0)), *NAMES, *BACK)


@pytest.mark.parametrize(("speed", "force"), [(0.0, 0.0), (0.0, 3.0), (1e-4, 3.0)])
def test_a_mass_that_friction_holds_is_refused(speed: float, force: float, block: eomgen.Kernel) -> None:
    """Alone, as one of many, and carried forwards; rosenbrock takes it."""
    how: dict[str, Any] = {"duration": 1e-4, "samples": 1}
    with pytest.raises(InputError, match=f"rollout_gradient: {REFUSED}"):
        block.rollout_gradient([0.0], [speed], [force], loss=last, method="tsit5", **how)
    with pytest.raises(InputError, match=f"rollout_gradient: {REFUSED}"):
        block.rollout_gradient([[0.0], [0.0]], [[1.0], [speed]], [force], loss=last, method="tsit5", **how)
    with pytest.raises(InputError, match=f"rollout_sensitivity: {REFUSED}"):
        block.rollout_sensitivity([0.0], [speed], [force], method="tsit5", along={"v": np.eye(1)}, **how)
    _, by = block.rollout_gradient([0.0], [speed], [force], loss=last, method="rosenbrock", **how)
    assert abs(by["v"][0]) < 1e-4


def test_a_mass_that_slides_is_not(block: eomgen.Kernel) -> None:
    value, by = block.rollout_gradient([0.0], [1.0], [3.0], loss=last, method="tsit5", duration=0.1, samples=3)
    assert value == pytest.approx(0.1 - 1.5 * 0.01 / 2, rel=1e-6)
    assert by["q"] == pytest.approx([1.0])
    assert by["v"] == pytest.approx([0.1])


@pytest.mark.parametrize("dtype", soaked(("float64", "float32"), ("float64",)))
def test_refused_or_those_of_the_motion(dtype: str, built: Build) -> None:
    """A damped oscillator of any stiffness, against the exponential of its matrix."""
    kernel = built(mass_on_rail(stiffness=1.0, damping=1.0), *NAMES, *BACK, dtype=dtype)
    rng, near, errors = np.random.default_rng(5), 0, list[str]()
    rtol = 1e-6 if dtype == "float64" else 1e-4
    for _ in range(60):
        k, c = (float(10.0 ** rng.uniform(0, top)) for top in (8.0, 6.0))
        kernel.parameters["joints.rail.z.stiffness"], kernel.parameters["joints.rail.z.damping"] = k, c
        T = min(0.3, 3000.0 / (c + np.sqrt(k)))
        flow = expm(T * np.array([[0.0, 1.0], [-k / 2.0, -c / 2.0]]))
        start = (rng.uniform(-1.0, 1.0, 2) * [1.0, np.sqrt(k)] * (rng.random() < 0.7)).astype(dtype)
        how: dict[str, Any] = {"method": "tsit5", "duration": T, "samples": 2, "rtol": rtol}
        try:
            _, by = kernel.rollout_gradient(start[:1], start[1:], loss=last, **how)
            _, (dq, dv) = kernel.rollout_sensitivity(start[:1], start[1:], along={"v": np.eye(1, dtype=dtype)}, **how)
        except InputError as error:
            errors.append(str(error))
            continue
        wanted = np.array([flow[0, 0], flow[0, 1], flow[0, 1], flow[1, 1]])
        found = np.array([by["q"][0], by["v"][0], dq[-1, 0, 0], dv[-1, 0, 0]])
        sizes = np.array([1.0, 1.0 / np.sqrt(k), 1.0 / np.sqrt(k), 1.0])
        near += int(k > 1e4)
        assert np.abs((found - wanted) / sizes).max() < 0.1, (k, c, T, found, wanted)
    assert all("near the limit of its stability" in text for text in errors)
    assert 5 <= len(errors) <= 30
    assert near > 5


@pytest.mark.soak
def test_a_motion_that_is_sensitive_by_itself_is_not(built: Build) -> None:
    """A double pendulum whose derivatives grow a thousandfold, at loose and at tight tolerances."""
    text = "".join(
        f'[[links]]\nname = "l{i}"\nmass = 1.0\ncom = [0.5, 0.0, 0.0]\ninertia = {{ xx = 0.01, yy = 0.1, zz = 0.1 }}\n'
        f'[[joints]]\nname = "j{i}"\nparent = "{"base" if i == 1 else "l1"}"\nchild = "l{i}"\ntype = "revolute"\n'
        f"placement = {{ xyz = [{float(i - 1)}, 0.0, 0.0] }}\n"
        for i in (1, 2)
    )
    kernel = built(robot_from_toml(f'name = "double"\ngravity = [0.0, -9.81, 0.0]\n{text}'), *NAMES, *BACK)
    for rtol in (1e-3, 1e-6, 1e-9):
        how: dict[str, Any] = {"method": "tsit5", "duration": 12.0, "samples": 3, "rtol": rtol}
        _, by = kernel.rollout_gradient([2.5, 0.4], [0.0, 0.0], loss=last, **how)
        assert np.abs(by["q"]).max() > 1e3
        kernel.rollout_sensitivity([2.5, 0.4], [0.0, 0.0], along={"q": np.eye(2)}, **how)


def test_contacts_are_not(built: Build) -> None:
    """A mass that bounces between stops: steps across a contact look stiff, and derivatives are those of the motion."""
    numbers = {"stiffness": 1e5, "smoothing": 1e-3, "lower": -0.05, "upper": 0.05}
    kernel = built(mass_on_rail(further={f"stops.{name}": x for name, x in numbers.items()}), *NAMES, *BACK)
    how: dict[str, Any] = {"method": "tsit5", "duration": 0.5, "samples": 5, "rtol": 1e-9}
    _, by = kernel.rollout_gradient([0.0], [1.0], loss=last, **how)
    h = 1e-6
    ends = [kernel.rollout([0.0], [1.0 + x], method="tsit5", duration=0.5, rtol=1e-12)[0][-1, 0] for x in (h, -h)]
    assert by["v"][0] == pytest.approx((ends[0] - ends[1]) / (2.0 * h), rel=0.05)


def test_long_motions_are_looked_at_part_by_part(monkeypatch: pytest.MonkeyPatch, block: eomgen.Kernel) -> None:
    """Of steps that are not all kept."""
    monkeypatch.setattr("eomgen.kernel.stepping.gradients.KEPT", 100)
    with pytest.raises(InputError, match=REFUSED):
        block.rollout_gradient([0.0], [0.0], [3.0], loss=last, method="tsit5", duration=1e-4, samples=1)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(920, 936))
def test_random_robots_of_any_stiffness(seed: int, built: Build) -> None:
    """Moving and at rest: refused, or as rosenbrock has them."""
    rng = np.random.default_rng(seed)
    robot = random_robot(seed, joints=(1, 2), types=("revolute", "prismatic", "fixed"), max_coordinates=3)
    robot = robot.with_coordinates({joint.name: stiffened(rng, joint.coordinates) for joint in robot.joints})
    kernel, state = built(robot, *NAMES, *BACK), random_state(robot, seed)
    for q, v in ((1e-2 * state.q, 1e-2 * state.v), np.zeros((2, kernel.n))):
        how: dict[str, Any] = {"loss": last, "duration": 1e-3, "samples": 1}
        _, wanted = kernel.rollout_gradient(q, v, method="rosenbrock", rtol=1e-8, **how)
        try:
            _, found = kernel.rollout_gradient(q, v, method="tsit5", **how)
        except InputError as error:
            assert "take rosenbrock" in str(error)  # noqa: PT017
            continue
        np.testing.assert_allclose(found["q"], wanted["q"], atol=0.05 * np.abs(wanted["q"]).max())
        np.testing.assert_allclose(found["v"], wanted["v"], atol=0.05 * np.abs(wanted["v"]).max() + 1e-6)


def stiffened(rng: np.random.Generator, table: Mapping[str, Coordinate]) -> dict[str, Coordinate]:
    """Coordinates with springs and dampers up to a million times as stiff."""
    found = {}
    for name, given in table.items():
        k, c = (10.0 ** rng.uniform(0.0, top) for top in (6.0, 5.0))
        stiffness = None if given.stiffness is None else given.stiffness * k
        found[name] = replace(given, stiffness=stiffness, damping=None if given.damping is None else given.damping * c)
    return found


def bent(rng: np.random.Generator, columns: int, size: float, degree: int = 1) -> Signal:
    """Straight lines between samples at odd times; with a degree of 0, or of 3, values jump there."""
    times = np.concatenate([[-0.1], np.sort(rng.uniform(0.0, T, 4)), [0.8 * T + 0.1 * T * rng.random(), 0.6]])
    times = np.sort(times)
    if degree == 1:
        return Signal.through(times, size * rng.uniform(-1.0, 1.0, (times.size, columns)))
    shape = (times.size - 1, degree + 1, columns)
    return Signal(times, size * rng.uniform(-1.0, 1.0, shape) / T ** np.arange(degree + 1)[:, None])


def bent_loads(kernel: eomgen.Kernel, seed: int) -> InputSignals:
    return loads_of(kernel, seed, curve=bent, window=(0.07, 0.21))


@pytest.mark.soak
@pytest.mark.parametrize("method", TIGHT)
@pytest.mark.parametrize("robot", [eomgen.load_robot("one_link"), prescribed_robot()], ids=["one_link", "prescribed"])
def test_gradients_are_those_of_the_motion(robot: Robot, method: str, built: Build) -> None:
    """By all numbers of loads, against differences of rollouts whose steps are their own."""
    compare(built(robot, *ALL), method, 5)


@pytest.mark.soak
@pytest.mark.parametrize("method", TIGHT)
@pytest.mark.parametrize("seed", range(8))
def test_so_they_are_of_random_robots(seed: int, method: str, built: Build) -> None:
    robot = random_robot(7100 + seed, joints=(1, 3), types=JOINTS)
    compare(built(some_prescribed(robot, seed) if seed % 2 else robot, *ALL), method, seed)


def compare(kernel: eomgen.Kernel, method: str, seed: int) -> None:
    """Gradients of a rollout under loads that jump against differences, and sensitivities against gradients."""
    rng, loads = np.random.default_rng(11), bent_loads(kernel, seed)
    q, v = rng.uniform(-0.3, 0.3, (2, kernel.n))
    weights = rng.uniform(-1.0, 1.0, (2, 3, kernel.n))
    how: dict[str, Any] = {"method": method, "duration": T, "samples": 2, "rtol": TIGHT[method]}

    def loss(t: Array, x: Array, rate: Array) -> tuple[float, Array, Array]:
        return float((weights[0] * x + weights[1] * rate).sum()), weights[0], weights[1]

    value, found = kernel.rollout_gradient(q, v, loss=loss, loads=loads, **how)
    for name, by in found["loads"].items():
        x = numbers(loads, name)
        direction, h = rng.uniform(-1.0, 1.0, x.shape) * np.maximum(np.abs(x), 1e-3), 1e-3
        ends = []
        for s in (2.0, 1.0, -1.0, -2.0):
            moved = put(loads, name, x + s * h * direction)
            ends.append(loss(np.zeros(3), *kernel.rollout(q, v, loads=moved, **how))[0])
        wanted = (8.0 * (ends[1] - ends[2]) - (ends[0] - ends[3])) / (12.0 * h)
        assert (by * direction).sum() == pytest.approx(wanted, rel=1e-6, abs=1e-6 * max(abs(value), 1e-2)), name
    along = rng.uniform(-1.0, 1.0, (1, kernel.n))
    _, (dq, dv) = kernel.rollout_sensitivity(q, v, loads=loads, along={"v": along}, **how)
    assert (weights[0] * dq[:, 0] + weights[1] * dv[:, 0]).sum() == pytest.approx(
        (found["v"] * along[0]).sum(), rel=1e-9
    )


@pytest.mark.parametrize("method", METHODS)
def test_motions_are_scipys(method: str, built: Build) -> None:
    """A mass under a force that jumps, against integrations from jump to jump; few steps are tried in vain."""
    kernel = built(mass_on_rail(damping=3.0, stiffness=50.0), *ALL, "radau_rollout", "generalized_force")
    signal = bent(np.random.default_rng(3), 1, 20.0, 0)
    loads = InputSignals(DriveData(torque=Track(signal, np.array([0]))))
    inside = [t for t in jump_times(loads) if 0.0 < t < T]
    y, times = np.array([0.1, -0.2]), np.array([0.0, *inside, T])
    for begin, end in itertools.pairwise(times):
        force = signal.coefficients[np.searchsorted(signal.knots, 0.5 * (begin + end)) - 1, 0, 0]

        def rate(_: float, x: Array, force: float = force) -> list[float]:
            return [x[1], (force - 50.0 * x[0] - 3.0 * x[1]) / 2.0]

        y = solve_ivp(rate, (begin, end), y, rtol=1e-12, atol=1e-14).y[:, -1]
    found = kernel.rollout([0.1], [-0.2], loads=loads, method=method, duration=T, samples=1, rtol=1e-9, works=True)
    assert [float(x[-1, 0]) for x in found] == pytest.approx(y, rel=1e-7)
    assert found.rejected <= 2 * times.size
    assert found.works[-1, 0] - found.works[-1, 3] == pytest.approx(
        y[1] ** 2 - 0.04 + 25.0 * (y[0] ** 2 - 0.01), rel=1e-6
    )


@pytest.mark.soak
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_every_lane_has_jumps_of_its_own(dtype: str, method: str, built: Build) -> None:
    """Many states, each with other knots: the bits, works and steps of a state alone."""
    kernel = built(prescribed_robot(), *ALL, "radau_rollout", "generalized_force", dtype=dtype)
    model = kernel if dtype == "float64" else built(prescribed_robot(), *ALL)
    rng = np.random.default_rng(3)
    q, v = rng.uniform(-0.3, 0.3, (2, 11, kernel.n)).astype(dtype)
    loads = [bent_loads(model, seed) for seed in range(11)]
    loads[4] = InputSignals()
    how: dict[str, Any] = {"method": method, "duration": T, "samples": 4, "rtol": 1e-4, "works": True}
    whole = kernel.rollout(q, v, loads=loads, **how)
    assert np.ptp(whole.steps) > 0
    for i in range(11):
        alone = kernel.rollout(q[i], v[i], loads=loads[i], **how)
        assert alone.steps == whole.steps[i]
        assert np.array_equal(alone.works, whole.works[i])
        assert all(np.array_equal(x[i], y) for x, y in zip(whole, alone, strict=True))


@pytest.mark.soak
def test_mechanisms(built: Build) -> None:
    """Loops are closed where steps end: gains whose program bends, against differences."""
    kernel = built(eomgen.load_robot("four_bar"), *LOADED, *CLOSED)
    rng = np.random.default_rng(1)
    gains = Gains(np.array([30.0]), np.array([2.0]))
    loads = InputSignals(DriveData(program=Track(bent(rng, 1, 0.3), np.array([0])), gains=gains))
    q, v = assembled(kernel).values()
    how: dict[str, Any] = {"method": "tsit5", "duration": T, "samples": 2, "rtol": 1e-11}
    _, found = kernel.rollout_gradient(q, v, loss=last, loads=loads, **how)
    x = numbers(loads, "drive.program")
    direction, h = rng.uniform(-1.0, 1.0, x.shape), 1e-4
    ends = [kernel.rollout(q, v, loads=put(loads, "drive.program", x + s * h * direction), **how)[0] for s in (1, -1)]
    wanted = float((ends[0][-1] - ends[1][-1]).sum()) / (2.0 * h)
    assert (found["loads"]["drive.program"] * direction).sum() == pytest.approx(wanted, rel=1e-6)


def test_times_at_which_loads_jump() -> None:
    """Values, rates and accelerations, on both sides of a knot; what rests outside; windows; profiles."""
    place, rng = np.array([0]), np.random.default_rng(0)

    def times(signal: Signal, **how: Any) -> list[float]:
        return jump_times(InputSignals(DriveData(torque=Track(signal, place))), **how).tolist()

    assert times(Signal.constant([1.0])) == []
    assert times(Signal.constant([1.0]), every=True) == []
    assert times(Signal.through([0.0, 1.0, 2.0, 3.0], [[0.0], [1.0], [2.0], [2.0]])) == [0.0, 2.0]
    assert times(Signal.through([0.0, 1.0, 2.0, 3.0], [[0.0], [1.0], [2.0], [2.0]]), every=True) == [0.0, 1.0, 2.0, 3.0]
    steps = Signal(np.array([0.0, 1.0, 2.0]), np.array([[[1.0]], [[1.0 + 1e-6]]]))
    assert times(steps) == [1.0]
    whole = np.polynomial.Polynomial(rng.uniform(-1.0, 1.0, 4))  # a cubic in three pieces
    knots = np.array([0.0, 0.3, 0.7, 1.1])
    pieces = [[whole.deriv(i)(x) / [1, 1, 2, 6][i] if i else whole(x) for i in range(4)] for x in knots[:-1]]
    smooth = Signal(knots, np.array(pieces)[:, :, np.newaxis])
    assert times(smooth) == [0.0, 1.1]
    profile = Signal(np.array([0.0, 2.0]), np.array([[[0.0], [0.0], [1.0]]]))  # t^2
    found = times(replace(Signal.through([0.0, 1.0, 4.0, 9.0], [[0.0], [1.0], [0.0], [0.0]]), profile=profile))
    assert found == pytest.approx([0.0, 1.0, 2.0], abs=1e-12)
    there_and_back = Signal(np.array([0.0, 2.0]), np.array([[[0.0], [2.0], [-1.0]]]))  # to 1 and back
    found = times(replace(Signal.through([-1.0, 0.5, 3.0], [[0.0], [1.0], [0.0]]), profile=there_and_back))
    assert found == pytest.approx([0.0, 1.0 - np.sqrt(0.5), 1.0 + np.sqrt(0.5), 2.0], abs=1e-12)
    wrench = LinkWrench(0, Signal.constant(np.ones(6)), t0=0.25, t1=0.5)
    assert jump_times(InputSignals(wrenches=[wrench], first=0.1)).tolist() == [0.1, 0.25, 0.5]


def test_a_path_over_a_profile(built: Build) -> None:
    """Knots of a path come where its profile leads to them."""
    kernel = built(mass_on_rail(damping=3.0), *ALL)
    profile = Signal(np.array([0.0, 1.0]), np.array([[[0.0], [1.0], [3.0]]]))
    path = replace(Signal.through([0.0, 0.07, 0.2, 0.5, 2.0], [[0.0], [0.1], [-0.1], [0.3], [0.0]]), profile=profile)
    gains = Gains(np.array([400.0]), np.array([20.0]))
    loads = InputSignals(DriveData(program=Track(path, np.array([0])), gains=gains))
    how: dict[str, Any] = {"method": "tsit5", "duration": T, "samples": 1, "rtol": 1e-11}
    _, found = kernel.rollout_gradient([0.1], [0.0], loss=last, loads=loads, **how)
    x, rng = path.coefficients, np.random.default_rng(1)
    direction = rng.uniform(-1.0, 1.0, x.shape)
    ends = [
        kernel.rollout([0.1], [0.0], loads=put(loads, "drive.program", x + s * 1e-4 * direction), **how)[0][-1, 0]
        for s in (1, -1)
    ]
    by = found["loads"]["drive.program"]
    assert (by * direction).sum() == pytest.approx((ends[0] - ends[1]) / 2e-4, rel=1e-6)


def test_stiff_robots_are_refused_under_loads(built: Build) -> None:
    """A mass that friction holds against a force that jumps."""
    kernel = built(mass_on_rail(friction=Friction(coulomb=6.0)), *ALL)
    loads = InputSignals(DriveData(torque=Track(bent(np.random.default_rng(2), 1, 1.0, 0), np.array([0]))))
    with pytest.raises(InputError, match="take rosenbrock"):
        kernel.rollout_gradient([0.0], [0.0], loss=last, loads=loads, method="tsit5", duration=1e-4, samples=1)


def test_a_motion_without_accelerations_has_no_gradient(built: Build) -> None:
    """Of a link without mass; in steps of all methods that have derivatives."""
    kernel = built(massless_tip(), "rollout", *NAMES, *BACK, "mass_matrix")
    for method in ("rk4", "tsit5", "rosenbrock"):
        how: dict[str, Any] = {"dt": 1e-3, "steps": 3} if method == "rk4" else {"duration": 1e-2, "samples": 1}
        refused(
            SingularError,
            r"k\.gamma",
            kernel.rollout_gradient,
            [0.3, 0.5],
            [0.0, -5.0],
            loss=last,
            method=method,
            **how,
        )
