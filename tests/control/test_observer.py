"""Extended Kalman filters: against a textbook's, in C, consistency; of closed mechanisms; what is refused."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

import eomgen
from eomgen.control import Measurement, Observer, Uncertainty, observer, write_observer
from eomgen.control.filter_coordinates import AllCoordinates
from eomgen.control.filter_steps import FilterSteps
from eomgen.control.kalman_filter import filter_model, steps_of
from eomgen.control.observability import common_observability
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError, IntegrationError, LoopError, UnknownNameError
from tests.loops.test_elastic_cuts import coupled
from tests.support.commands import command
from tests.support.joint_table import joint_table
from tests.support.observer_code import CompiledObserver
from tests.support.refusals import refused
from tests.support.soak import WHOLE, soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]
GAMMA = "encoder:joint1.gamma"
STIFFNESS = "joints.joint1.x.stiffness"
DT = 1e-3
VERTICAL = f"""
name = "rod"
gravity = [0.0, 0.0, -9.81]
[[links]]
name = "link1"
mass = 1.0
com = [0.5, 0.0, 0.0]
inertia = {{ xx = 0.0, yy = 0.08, zz = 0.08 }}
{joint_table("joint1", "base", "link1", "revolute")}
"""


class Textbook:
    """An extended Kalman filter with matrices by central differences, of readings of coordinates; independent."""

    def __init__(self, x: Array, P: Array, step: Any, places: list[int], R: Array, Q: Array) -> None:
        self.x, self.P, self.step, self.Q = x, P, step, Q
        self.H, self.R = np.eye(len(x))[places], R

    def predict(self, u: Array) -> None:
        size = np.maximum(np.abs(self.x), 1e-2) * 1e-5
        pairs = [(self.step(self.x + h, u), self.step(self.x - h, u)) for h in np.diag(size)]
        F = np.array([(a - b) / (2 * h) for (a, b), h in zip(pairs, size, strict=True)]).T
        self.x, self.P = self.step(self.x, u), F @ self.P @ F.T + self.Q

    def update(self, y: Array) -> float:
        S = self.H @ self.P @ self.H.T + self.R
        K = self.P @ self.H.T @ np.linalg.inv(S)
        error = y - self.H @ self.x
        self.x = self.x + K @ error
        keep = np.eye(len(self.x)) - K @ self.H
        self.P = keep @ self.P @ keep.T + K @ self.R @ K.T
        return float(error @ np.linalg.inv(S) @ error)


def close(found: Array, expected: Array, P: Array, within: float) -> None:
    """Compare covariances by the states' deviations."""
    scale = np.sqrt(np.diag(P))
    assert np.abs((found - expected) / np.outer(scale, scale)).max() < within


@pytest.mark.parametrize("form", ["covariance", "square_root"])
def test_filter_is_that_of_textbooks(form: Any) -> None:
    """State, covariance and innovations with a wrench and a parameter, whose derivatives are differences there."""
    known = Uncertainty(acceleration=0.3, wrench=2.0, wrench_drift=5.0, parameter=0.2, parameter_drift=0.1)
    made = observer(
        "one_link", f"{GAMMA},tachometer:joint1.x", dt=DT, states=(STIFFNESS, "wrench:link1"), uncertainty=known,
        form=form, unobservable="allow",
    )  # fmt: skip
    kernel = eomgen.build("one_link", kernels=("rollout", "external_force"))
    value = kernel.parameters[STIFFNESS]

    def step(x: Array, u: Array) -> Array:
        kernel.parameters[STIFFNESS] = x[10]
        force = u + kernel.functions.external_force(x[:2], x[4:10].reshape(1, 6))
        q, v = kernel.rollout(x[:2], x[2:4], force, DT, 1, method="implicit")
        return np.concatenate([q[1], v[1], x[4:]])

    noise = np.sqrt(DT) * np.array([0.3, 0.3])
    G = np.zeros((11, 9))
    G[:2, :2], G[2:4, :2] = DT * np.diag(noise), np.diag(noise)
    G[4:, 2:] = np.sqrt(DT) * np.diag([5.0] * 6 + [0.1 * value])
    start = np.diag(np.array([1e-2] * 2 + [0.1] * 2 + [2.0] * 6 + [0.2 * value]) ** 2)
    R = np.diag(np.array(made.filter.measurement.noise) ** 2)
    book = Textbook(np.array([0.0] * 10 + [value]), start, step, [1, 2], R, G @ G.T)
    rng = np.random.default_rng(3)
    for _ in range(12):
        u, y = rng.normal(size=2), rng.normal(size=2) * [1e-2, 1e-1]
        made.predict(u)
        book.predict(u)
        assert made.update(y) == pytest.approx(book.update(y), rel=1e-5)
        scale = np.sqrt(np.diag(book.P))
        assert np.abs((made.state - book.x) / scale).max() < 1e-4  # whose derivatives are differences
        close(made.covariance, book.P, book.P, 1e-5)


def test_both_forms_are_one_filter_and_the_root_survives_float32() -> None:
    """Precise sensors after a vague beginning: plain float32 loses the covariance's sign, its root does not."""
    m = Measurement.of("one_link", f"{GAMMA},tachometer:joint1.gamma", noise={"encoder": 1e-6, "tachometer": 1e-4})
    known = Uncertainty(position=1.0, velocity=10.0, acceleration=1e-3)
    kernel = eomgen.build("one_link", kernels=("rollout", "external_force"))
    q, v = kernel.rollout([0.0, 0.5], [0.0, 1.0], [0.0, 0.0], DT, 100, method="implicit")
    rng = np.random.default_rng(0)
    y = np.column_stack([q[1:, 1] + 1e-6 * rng.normal(size=100), v[1:, 1] + 1e-4 * rng.normal(size=100)])

    def run(form: Any, dtype: str) -> Observer:
        made = observer(m.robot, m, dt=DT, form=form, dtype=dtype, uncertainty=known)
        for row in y:
            made.predict([0.0, 0.0])
            made.update(row)
        return made

    plain, root, narrow = run("covariance", "float64"), run("square_root", "float64"), run("square_root", "float32")
    P = root.covariance
    close(plain.covariance, P, P, 1e-5)
    assert np.abs(plain.state - root.state).max() < 1e-9
    close(narrow.covariance, P, P, 1e-3)
    assert np.abs((narrow.state - root.state) / np.sqrt(np.diag(P))).max() < 1.0
    assert np.abs(root.q - q[-1]).max() < 1e-5
    refused(IntegrationError, "square-root form", run, "covariance", "float32")


@pytest.mark.soak
def test_linear_steps_have_the_derivatives_of_general_ones() -> None:
    """By the residual's derivatives and constant stiffness, and by tangents along all directions."""
    made = observer("one_link", GAMMA, dt=1e-2)
    steps = made._steps
    assert made.is_linear
    general = eomgen.build("one_link", kernels=("implicit_sensitivity",))
    other = FilterSteps(general, AllCoordinates(2), 1e-2, (), (), None)
    rng = np.random.default_rng(1)
    q, v = rng.normal(size=(2, 2))
    acting = made._acting(rng.normal(size=2))
    for found, expected in zip(steps.advance(q, v, acting), other.advance(q, v, acting), strict=True):
        assert np.allclose(found, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


@pytest.mark.soak
def test_c_reads_every_sensor(tmp_path: Path) -> None:
    """Readings that depend on accelerations, poses and biases, with a wrench and a parameter; and without these."""
    sensors = ("pose:tcp", "imu:tcp", GAMMA, "gyroscope:link1", "position:tcp")
    m = Measurement.of("one_link", sensors, drift={"imu:tcp.fx": 1e-2, "gyroscope": 1e-3})
    compare_with_c("one_link", m, (STIFFNESS, "wrench:link1"), "square_root", "float64", tmp_path / "estimated")
    m = Measurement.of("one_link", ("torque:joint1.gamma", GAMMA), drift={"encoder": 1e-3})
    compare_with_c("one_link", m, (), "covariance", "float64", tmp_path / "plain", lost=1e8)


@pytest.mark.parametrize("dtype", soaked(["float64", "float32"], ["float32"]))
def test_masses_stay_above_0(dtype: str, tmp_path: Path) -> None:
    """A reading that a negative mass would explain: the estimate is projected, by name, and the filter goes on."""
    robot, name, u = robot_from_toml(VERTICAL), "links.link1.mass", np.array([1.0])
    robot = replace(robot, tunable=(*robot.tunable, name))
    model = filter_model(robot, GAMMA, dt=DT, states=(name,), uncertainty=Uncertainty(parameter=1.0), dtype=dtype)
    made = Observer(model, steps_of(model))
    code = CompiledObserver(made, tmp_path)
    code.setup(made.q, made.v)
    said, least = [], []
    for step in range(40):
        made.predict(u)
        code.predict(u.astype(dtype))
        y = np.array([-0.5 * np.sign(np.sin(step)) * 0.1 * step], dtype)
        made.update(y)
        code.update(y)
        said += made.at_bounds
        least.append(made.estimate(name))
        assert code.state[2] == pytest.approx(made.state[2], rel=1e-3 if dtype == "float32" else 1e-9)
    assert name in said
    assert min(least) == pytest.approx(1e-3)


HOSTILE = (  # form, dtype, measurements, further states
    ("covariance", "float64", GAMMA, ()),
    ("square_root", "float32", f"{GAMMA},imu:tcp", (STIFFNESS, "wrench:link1")),
)


@pytest.mark.parametrize(("form", "dtype", "measure", "states"), HOSTILE)
def test_numbers_that_overflow_leave_the_estimate(
    form: Any, dtype: str, measure: str, states: tuple[str, ...], tmp_path: Path
) -> None:
    """In Python and in C: drives and readings of any size are taken or refused, and what is kept is finite."""
    made = observer("one_link", measure, dt=DT, states=states, form=form, dtype=dtype, unobservable="allow")
    code = CompiledObserver(made, tmp_path)
    rng, n = np.random.default_rng(11), made.kernel.n
    readings, most = len(made.filter.measurement.readings), float(np.log10(np.finfo(dtype).max))
    seen: dict[str, int] = {"Python": 0, "C": 0}
    for case in range(120):
        if case % 12 == 0:  # what was taken may be large
            made.begin(np.zeros(n))
            code.setup(np.zeros(n), np.zeros(n))
            code.predict(np.zeros(n))
        u, y = (rng.choice([-1.0, 1.0], k) * 10.0 ** rng.uniform(-2.0, most, k) for k in (n, readings))
        for call, status, given in ((made.predict, code.predict, u), (made.update, code.update, y)):
            kept = [
                *made.state,
                *made.covariance.ravel(),
                *made.normalized_innovation,
                *made.kernel.parameters.values(),
            ]
            try:
                call(given)
            except (InputError, ArithmeticError):
                seen["Python"] += 1
                after = [*made.state, *made.covariance.ravel(), *made.normalized_innovation]
                assert [*after, *made.kernel.parameters.values()] == kept
            assert np.isfinite(made.state).all()
            assert np.isfinite(made.covariance).all()
            before, drives = (
                [*code.state, *code.covariance.ravel(), *code.struct.normalized],
                [*getattr(code.struct, "u", ())],
            )
            answer = status(given)
            if answer < 0 or (status == code.predict and answer > 0):
                seen["C"] += 1
                assert answer in (-2, -1) or status == code.predict
                assert [*code.state, *code.covariance.ravel(), *code.struct.normalized] == before
                assert [*getattr(code.struct, "u", ())] == drives
            assert np.isfinite(code.state).all()
            assert np.isfinite(code.covariance).all()
    assert min(seen.values()) > 20
    code.setup(np.zeros(n), np.zeros(n))
    assert [code.predict(np.full(n, np.nan)), code.update(np.full(readings, np.nan))] == [-2, -2]


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_c_is_python(compiler: str, tmp_path: Path) -> None:
    """Both forms, a precision each; linear steps, and general ones with a wrench and a parameter."""
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    cases = (("float64", "covariance", ()), ("float32", "square_root", (STIFFNESS, "wrench:link1")))
    for number, (dtype, form, states) in enumerate(cases):
        sensors = f"{GAMMA},tachometer:joint1.x"
        compare_with_c("one_link", sensors, states, form, dtype, tmp_path / f"{number}", compiler)


def compare_with_c(
    robot: str,
    measure: str | Measurement,
    states: tuple[str, ...],
    form: str,
    dtype: str,
    folder: Path,
    compiler: str = "cc",
    lost: float = 1e5,
) -> None:
    """Take the same steps and measurements in C and in Python; ``lost``: by round-off, in units of it.

    Beside further states the first coordinate has noise of its own.
    """
    model = filter_model(robot, measure, dt=DT, states=states, form=form, dtype=dtype)
    made = Observer(model, steps_of(model))
    code = CompiledObserver(made, folder, (compiler,))
    code.setup(made.q, made.v)
    rng, n, eps = np.random.default_rng(2), model.model.size, float(np.finfo(dtype).eps)
    moved = 1e-3 if states else 0.0
    made._noise[0] = moved
    code.struct.noise[0] = moved if form == "square_root" else moved**2
    for _ in range(10):
        u = rng.normal(size=n).astype(dtype)
        made.predict(u)
        assert code.predict(u) == 0
        y = model.measurement.noisy(made.predicted()[0], rng).astype(dtype)
        assert code.update(y) == pytest.approx(made.update(y), rel=lost * eps, abs=lost * eps)
        P = made.covariance.astype(float)
        close(code.covariance, P, P, lost * eps)
        assert np.abs((code.state - made.state) / np.sqrt(np.diag(P))).max() < lost * eps


def test_readings_of_sensors_have_the_derivatives_of_differences() -> None:
    """Those that depend on accelerations, with a wrench, a parameter and a bias; innovations lack the biases."""
    m = Measurement.of("one_link", ("imu:tcp", GAMMA), drift={"imu:tcp.fx": 1e-2})
    made = observer(m.robot, m, dt=DT, states=(STIFFNESS, "wrench:link1"), unobservable="allow")
    assert made.states[-2:] == (STIFFNESS, "bias of imu:tcp.fx")
    rng = np.random.default_rng(5)
    made.predict(rng.normal(size=2))
    start = np.concatenate([rng.normal(size=10), [3e3, 0.2]])

    def readings(x: Array) -> Array:
        made.state = x.copy()
        made._write_parameters(x)
        found, _ = made.predicted()
        return np.asarray(found + np.eye(len(found))[0] * x[-1])

    steps = np.diag([1e-5] * 10 + [1.0, 0.1])
    differences = [(readings(start + h) - readings(start - h)) / (2 * h.sum()) for h in steps]
    readings(start)
    found, H = made.predicted()
    assert np.allclose(H, np.array(differences).T, rtol=1e-6, atol=1e-6 * np.abs(H).max())
    made.update(found + np.eye(len(found))[0] * 0.2)
    assert np.allclose(made.state, start)
    assert np.allclose(made.normalized_innovation, 0.0)


def test_states_that_nothing_tells_are_named() -> None:
    """A rod on a vertical axis whose speed alone is measured: nothing tells its angle."""
    robot = robot_from_toml(VERTICAL)
    with pytest.raises(InputError, match=r"rod: measurements tell 1 of 2 states; .* 1 directions .*'joint1.gamma'"):
        observer(robot, "tachometer:joint1.gamma", dt=DT)
    told = observer(robot, "tachometer:joint1.gamma", dt=DT, unobservable="allow").observability([0.3], [0.1])
    assert (told.rank, told.unobservable, told.is_complete) == (1, ("joint1.gamma",), False)
    assert np.allclose(np.abs(told.directions), [[1.0, 0.0]])
    assert told.lines()[:2] == ["rank 1 of 2 states", "  unobservable: +0.01 of joint1.gamma"]
    assert told.lines()[2].startswith(
        "error: observability Gramian over 1 s: condition above 1e+26; 1 direction known hardly"
    )
    assert observer(robot, "encoder:joint1.gamma", dt=DT).observability([[0.3], [0.2]]).is_complete
    with pytest.raises(InputError, match=r"measurements tell 5 of 10 states; .* of 'wrench:link1.fz'"):
        observer("one_link", GAMMA, dt=DT, states=("wrench:link1",))


@pytest.mark.quick
def test_observability_of_a_double_integrator_is_that_of_its_closed_form() -> None:
    """Its position is measured: sums of 1, k and k^2 make the Gramian, and the covariance after T."""
    (p, v, noise, dt), N = (1e-2, 0.1, 1e-3, 1e-3), 800
    F, H = np.array([[1.0, dt], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    given = {"scale": np.array([p, v]), "deviations": np.array([noise]), "dt": dt, "horizon": N * dt}
    found = common_observability(("q", "v"), [(F, H)], **given)
    sums = np.array([[N, dt * N * (N + 1) / 2], [dt * N * (N + 1) / 2, dt**2 * N * (N + 1) * (2 * N + 1) / 6]])
    W = sums * np.outer([p, v], [p, v]) / noise**2
    low, high = (np.trace(W) + sign * np.hypot(W[0, 0] - W[1, 1], 2.0 * W[0, 1]) for sign in (-1.0, 1.0))
    assert found.condition == pytest.approx(high / low, rel=1e-9)
    end = np.array([[1.0, N * dt * v / p], [0.0, 1.0]])
    P = end @ np.linalg.inv(np.eye(2) + W) @ end.T
    assert np.allclose(found.remaining.T @ found.remaining, P, rtol=1e-9)
    assert np.allclose(found.deviations, np.sqrt(np.diag(P)) * [p, v], rtol=1e-9)
    assert (found.rank, found.horizon, found.severity, found.poor) == (2, pytest.approx(0.8), "note", 0)
    vague = common_observability(("q", "v"), [(F, H)], **{**given, "deviations": np.array([1e2])})
    assert (vague.condition, vague.severity) == (pytest.approx(found.condition), "warning")
    assert (
        vague.lines()[2]
        == "  standard deviation after 0.8 s: +0.0806 of q, +0.0992 of v (8.12 of that at the beginning)"
    )
    unstable = common_observability(("q", "v"), [(1e30 * F, H)], **given)
    assert 0.0 <= unstable.horizon < 0.8
    ways = [(F, H), (F @ F, H[:, ::-1])]  # half of the time each
    both = common_observability(("q", "v"), ways, **given)
    Phi, S = np.eye(2), np.zeros((2, 2))
    for k in range(N):
        A, C = ways[2 * k // N]
        Phi = A @ Phi
        S += (C @ Phi).T @ (C @ Phi)
    eigenvalues = np.linalg.eigvalsh(S * np.outer([p, v], [p, v]) / noise**2)
    assert both.condition == pytest.approx(eigenvalues[1] / eigenvalues[0], rel=1e-9)


def test_one_encoder_of_an_elastic_arm_leaves_other_motors_unknown(tmp_path: Path) -> None:
    """All states are observable, and hardly: the motors without an encoder drift, which the command says."""
    arguments = ("--measure", "encoder:waist.motor", "--horizon", 0.5, "-o", tmp_path)
    text = command("observer", "geared_arm", *arguments)
    assert "rank 12 of 12 states\nwarning: observability Gramian over 0.5 s: condition" in text
    assert "known hardly better than at the beginning\n  standard deviation after 0.5 s: " in text
    assert "horizon: 0.0 s; allowed" in command("observer", "geared_arm", *arguments[:2], "--horizon", 0, code=1)
    one = observer("geared_arm", "encoder:waist.motor", dt=DT).observability()
    assert one.severity == "warning"
    assert one.condition == np.inf
    assert {one.states[np.abs(row).argmax()] for row in one.remaining[: one.poor]} == {"shoulder.motor", "elbow.motor"}
    every = ("encoder:waist.motor", "encoder:shoulder.motor", "encoder:elbow.motor")
    told = observer("geared_arm", every, dt=DT).observability()
    assert (told.severity, told.poor) == ("note", 0)
    assert told.condition < 1e20


def test_what_cannot_be_used_is_refused_by_name() -> None:
    for message, keywords in (
        (r"dt: 0.0 s", {"dt": 0.0}),
        (r"form: 'triangle' is unknown; allowed: covariance, square_root", {"form": "triangle"}),
        (r"states: 'gravity.q' is no parameter.*did you mean", {"states": ("gravity.q",)}),
        (r"states: 'link9' is no link that moves", {"states": ("wrench:link9",)}),
        (r"states: gravity.y stands twice", {"states": ("gravity.y", "gravity.y")}),
        (r"states: 'gravity.y'; allowed: a sequence", {"states": "gravity.y"}),
        (r"wrenches act beside torque:joint1.gamma", {"states": ("wrench:link1",), "measure": "torque:joint1.gamma"}),
        (r"shaken_arm: it has prescribed", {"robot": "shaken_arm", "measure": "encoder:waist.gamma"}),
    ):
        given: dict[str, Any] = {"robot": "one_link", "measure": GAMMA, "dt": DT, **keywords}
        with pytest.raises((InputError, UnknownNameError), match=message):
            filter_model(given.pop("robot"), given.pop("measure"), **given)
    for message, numbers in (
        ("position is 0.0", {"position": 0.0}),
        ("wrench is -1", {"wrench": -1}),
        ("acceleration is", {"acceleration": [1.0, -1.0]}),
        ("parameter is nan", {"parameter": float("nan")}),
    ):
        refused(InputError, message, Uncertainty, **numbers)
    with pytest.raises(InputError, match="position has 3 numbers; allowed: one, or 2"):
        observer("one_link", GAMMA, dt=DT, uncertainty=Uncertainty(position=[1.0] * 3))
    made = observer("one_link", GAMMA, dt=DT)
    for call in (lambda: made.predict([1.0]), lambda: made.update([1.0, 2.0]), lambda: made.begin([np.nan, 0.0])):
        refused(InputError, "allowed: \\(", call)
    refused(UnknownNameError, "is no state", made.estimate, "joint1.gama")


@pytest.mark.soak
def test_innovations_are_those_of_the_noise_that_is_told() -> None:
    """200 runs of an elastic arm with random drives: their sums of squares are chi-square."""
    m = Measurement.of("one_link", f"{GAMMA},tachometer:joint1.gamma", noise={"encoder": 1e-4, "tachometer": 1e-2})
    known = Uncertainty(position=1e-3, velocity=1e-2, acceleration=0.5)
    made = observer(m.robot, m, dt=DT, uncertainty=known)
    runs, steps, N = 200, 100, 4
    innovation, error = np.zeros((runs, steps)), np.zeros(runs)
    for run in range(runs):
        rng = np.random.default_rng(run)
        made.begin([0.0, 0.4], [0.0, 0.0])
        start = np.concatenate([made.q, made.v]) + made.filter.deviations() * rng.normal(size=N)
        q, v = start[:2], start[2:]
        for k in range(steps):
            u = np.array([0.0, 2.0 * np.sin(0.1 * k)])
            ends = made.kernel.rollout(q, v, u, DT, 1, method="implicit")
            kick = np.sqrt(DT) * 0.5 * rng.normal(size=2)
            q, v = ends[0][1] + DT * kick, ends[1][1] + kick
            made.predict(u)
            innovation[run, k] = made.update(np.array([q[1], v[1]]) + rng.normal(size=2) * m.noise)
        difference = made.state - np.concatenate([q, v])
        error[run] = difference @ np.linalg.solve(made.covariance, difference)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 2 * runs * steps)
    assert low < innovation.sum() < high
    low, high = stats.chi2.ppf([0.0005, 0.9995], N * runs)
    assert low < error.sum() < high
    assert stats.kstest(innovation.ravel(), "chi2", args=(2,)).pvalue > 1e-3


@pytest.mark.soak
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_c_of_large_filters_is_python(dtype: str, tmp_path: Path) -> None:
    """72 states with 12 measurements by linear steps, and wrenches of a six-axis arm by general ones."""
    joints = [f"joint{i}.gamma" for i in range(1, 7)]
    encoders = [f"encoder:{x}" for x in joints]
    both = ",".join([*encoders, *(f"tachometer:{x}" for x in joints)])
    for form in ("covariance", "square_root"):
        compare_with_c("one_link", GAMMA, (STIFFNESS,), form, dtype, tmp_path / f"rod_{form}")
        if (form, dtype) != ("covariance", "float32"):  # which loses the sign of variances here
            lost = 1e5 if form == "square_root" else 1e8
            for robot, sensors, states in (
                ("ur5", ",".join(encoders), ("wrench:link6",)),
                ("puma560_elastic", both, ()),
            ):
                compare_with_c(robot, sensors, states, form, dtype, tmp_path / f"{robot}_{form}", lost=lost)


@pytest.mark.soak
@pytest.mark.parametrize(("dtype", "form"), [("float64", "covariance"), ("float32", "square_root")])
def test_c_of_a_six_axis_arm_reads_every_sensor(dtype: str, form: str, tmp_path: Path) -> None:
    """Torques, IMUs with biases on two links and a pose; then a wrench and a parameter beside an IMU."""
    encoders = [f"encoder:joint{i}.gamma" for i in range(1, 7)]
    torques = [x.replace("encoder", "torque") for x in encoders]
    lost = 1e8 if form == "covariance" else 1e5
    drift = {"imu:link3": 1e-3, "gyroscope": 1e-4}
    m = Measurement.of("ur5", [*encoders, "imu:link3", "pose:tcp", *torques, "gyroscope:tcp"], drift=drift)
    compare_with_c("ur5", m, (), form, dtype, tmp_path / "torques", lost=lost)
    m = Measurement.of("ur5", [*encoders, "imu:tcp", "pose:link4"], drift={"imu:tcp.fx": 1e-3})
    compare_with_c("ur5", m, ("wrench:link6", "gravity.z"), form, dtype, tmp_path / "wrench", lost=lost)


# Closed mechanisms


STEP = 2e-3
FREE = ("joint1.gamma",)
MEASURED = "encoder:joint3.gamma,tachometer:joint2.gamma"
KERNELS = ("rollout", "constraint", "constraint_jacobian", "cut_poses", "mass_matrix")  # of the truth
FOUR_BAR = Path(str(eomgen.__file__)).parent / "robots" / "four_bar.toml"


def placed(kernel: eomgen.Kernel, x: Array) -> tuple[Array, Array]:
    """All coordinates and velocities of the crank's."""
    q = kernel.assemble(np.array([x[0], -0.5, 1.4]), fixed=FREE)
    return q, kernel.project_velocity(q, np.array([x[1], 0.0, 0.0]), fixed=FREE)


def moved(kernel: eomgen.Kernel, x: Array, force: Any) -> Array:
    """Take a step of a four-bar linkage in the crank's angle and velocity, by the kernel's own functions."""
    q, v = placed(kernel, x)
    ends = kernel.rollout(q, v, force(q), STEP, 1, method="implicit")
    return np.array([ends[0][1, 0], ends[1][1, 0]])


def test_filter_of_a_linkage_is_that_of_textbooks() -> None:
    """A crank's angle and velocity, a wrench on the coupler and gravity: derivatives are differences there."""
    known = Uncertainty(acceleration=0.3, wrench=2.0, wrench_drift=5.0, parameter=0.2, parameter_drift=0.1)
    made = observer(
        "four_bar", f"{MEASURED},imu:tcp", dt=STEP, states=("gravity.y", "wrench:coupler"), uncertainty=known,
        unobservable="allow",
    )  # fmt: skip
    assert made.states[:3] == ("joint1.gamma", "d/dt joint1.gamma", "wrench:coupler.fx")
    names = (*KERNELS, "external_force", "measurement", "forward_dynamics")
    kernel = eomgen.build(made.filter.measurement.robot, kernels=names)
    g = kernel.parameters["gravity.y"]
    begins = made.q
    wrench = np.zeros((3, 6))

    def force(x: Array, u: Array) -> Any:
        kernel.parameters["gravity.y"] = x[8]
        wrench[1] = x[2:8]
        return lambda q: u + kernel.functions.external_force(q, wrench)

    class ByDifferences(Textbook):
        """Readings follow from the crank's state."""

        def readings(self, x: Array, u: Array) -> Array:
            q, v = placed(kernel, x)
            return np.asarray(kernel.functions.measurement(q, v, kernel.forward_dynamics(q, v, force(x, u)(q))))

        def look(self, u: Array) -> Array:
            size = np.maximum(np.abs(self.x), 1e-2) * 1e-5
            pairs = [(self.readings(self.x + h, u), self.readings(self.x - h, u)) for h in np.diag(size)]
            self.H = np.array([(a - b) / (2 * h) for (a, b), h in zip(pairs, size, strict=True)]).T
            return self.readings(self.x, u)

    def step(x: Array, u: Array) -> Array:
        return np.concatenate([moved(kernel, x[:2], force(x, u)), x[2:]])

    kick = np.sqrt(STEP) * 0.3
    G = np.zeros((9, 8))
    G[0, 0], G[1, 0] = STEP * kick, kick
    G[2:, 1:] = np.sqrt(STEP) * np.diag([5.0] * 6 + [0.1 * abs(g)])
    start = np.diag(np.array([1e-2, 0.1] + [2.0] * 6 + [0.2 * abs(g)]) ** 2)
    R = np.diag(np.array(made.filter.measurement.noise) ** 2)
    book = ByDifferences(np.array([begins[0], *[0.0] * 7, g]), start, step, [0], R, G @ G.T)
    rng = np.random.default_rng(3)
    for _ in range(4):
        u = np.array([rng.normal(), 0.0, 0.0])
        made.predict(u)
        book.predict(u)
        error = rng.normal(size=8) * made.filter.measurement.noise
        y = book.look(u) + error
        S = book.H @ book.P @ book.H.T + R
        K = book.P @ book.H.T @ np.linalg.inv(S)
        assert made.update(y) == pytest.approx(error @ np.linalg.inv(S) @ error, rel=1e-4)
        book.x, book.P = book.x + K @ error, book.P - K @ S @ K.T
        scale = np.sqrt(np.diag(book.P))
        assert np.abs((made.state - book.x) / scale).max() < 1e-4  # whose derivatives are differences
        close(made.covariance, book.P, book.P, 1e-4)
        assert np.abs(kernel.functions.constraint(made.q)).max() < 1e-11
        assert np.abs(kernel.functions.constraint_jacobian(made.q) @ made.v).max() < 1e-11


def consistency(made: Observer, runs: int, steps: int) -> tuple[Array, Array]:
    """Return sums of squares of normalized innovations, (runs, steps), and of errors at the end, (runs,)."""
    kernel, noise = eomgen.build("four_bar", kernels=KERNELS), np.array(made.filter.measurement.noise)
    innovation, error = np.zeros((runs, steps)), np.zeros(runs)
    for run in range(runs):
        rng = np.random.default_rng(run)
        made.begin(made.filter.model.home, np.zeros(3))
        x = made.state + made.filter.deviations() * rng.normal(size=2)
        for k in range(steps):
            u = np.array([2.0 * np.sin(0.1 * k), 0.0, 0.0])
            x = moved(kernel, x, lambda q, u=u: u)
            kick = np.sqrt(STEP) * 0.5 * rng.normal()
            x += np.array([STEP * kick, kick])
            made.predict(u)
            q, v = placed(kernel, x)
            innovation[run, k] = made.update(np.array([q[2], v[1]]) + rng.normal(size=2) * noise)
        apart = made.state - x
        error[run] = apart @ np.linalg.solve(made.covariance, apart)
    return innovation, error


@pytest.mark.soak
def test_one_run_has_the_innovations_of_its_noise() -> None:
    """60 steps from a wrong beginning, in float32 beside float64."""
    m = Measurement.of("four_bar", MEASURED, noise={"encoder": 1e-4, "tachometer": 1e-2})
    known = Uncertainty(position=1e-3, velocity=1e-2, acceleration=0.5)
    made = observer(m.robot, m, dt=STEP, uncertainty=known)
    innovation, error = consistency(made, 1, 60)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 2 * 60)
    assert low < innovation.sum() < high
    assert error[0] < stats.chi2.ppf(0.9995, 2)
    narrow = observer(m.robot, m, dt=STEP, uncertainty=known, dtype="float32")
    made.begin(made.filter.model.home)
    for k in range(10):
        for each in (made, narrow):
            each.predict([1.0, 0.0, 0.0])
            each.update([1.438 + 1e-4 * k, 0.0])
    assert narrow.state.dtype == narrow.q.dtype == np.float32
    P = made.covariance
    assert np.abs((narrow.state - made.state) / np.sqrt(np.diag(P))).max() < 0.05
    close(narrow.covariance, P, P, 1e-3)


@pytest.mark.soak
def test_innovations_of_a_linkage_are_those_of_the_noise_that_is_told() -> None:
    """Many runs of a four-bar linkage whose rocker is measured: their sums of squares are chi-square."""
    m = Measurement.of("four_bar", MEASURED, noise={"encoder": 1e-4, "tachometer": 1e-2})
    made = observer(m.robot, m, dt=STEP, uncertainty=Uncertainty(position=1e-3, velocity=1e-2, acceleration=0.5))
    runs, steps = 200 if WHOLE else 70, 100
    innovation, error = consistency(made, runs, steps)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 2 * runs * steps)
    assert low < innovation.sum() < high
    low, high = stats.chi2.ppf([0.0005, 0.9995], 2 * runs)
    assert low < error.sum() < high
    assert stats.kstest(innovation.ravel(), "chi2", args=(2,)).pvalue > 1e-3


def test_rigid_couplings_as_rows_of_the_constraint_have_the_filter_of_followers() -> None:
    """Two arms by a gear, whose second one is a coordinate or none."""
    robot = coupled("")
    first, second = (observer(x, "encoder:a.gamma", dt=STEP) for x in (robot, robot.with_constraints()))
    assert first.states == second.states == ("a.gamma", "d/dt a.gamma")
    rng = np.random.default_rng(6)
    for _ in range(5):
        u, y = rng.normal(), rng.normal()
        first.predict([u])
        second.predict([u, 0.0])
        assert second.update([1e-3 * y]) == pytest.approx(first.update([1e-3 * y]), rel=1e-9)
        assert np.allclose(second.state, first.state, rtol=1e-9, atol=1e-12)
        close(second.covariance, first.covariance, first.covariance, 1e-9)
    assert second.q[1] == pytest.approx(0.1 - 2.0 * first.q[0])


def test_begins_and_poses_are_assembled() -> None:
    """Dependent coordinates are guesses; a state far from closing is refused; looking elsewhere changes nothing."""
    made = observer("four_bar", "encoder:joint3.gamma", dt=STEP)
    made.begin([1.3, -0.6, 1.5], [2.0, 0.0, 0.0])
    q, v = made.q, made.v
    assert (q[0], v[0]) == (1.3, 2.0)
    assert np.abs(made.kernel.functions.constraint(q)).max() < 1e-11
    assert np.abs(made.kernel.functions.constraint_jacobian(q) @ v).max() < 1e-11
    assert made.observability([[0.6, -0.5, 1.4], [2.0, -0.5, 1.4]]).is_complete
    assert np.array_equal(made.q, q)
    assert np.array_equal(made.v, v)
    made.predict([0.0, 0.0, 0.0])
    made.state[0] = 60.0
    made.begin([1.3, -0.6, 1.5])
    assert made.estimate("d/dt joint1.gamma") == 0.0


def test_what_mechanisms_refuse(tmp_path: Path) -> None:
    text = FOUR_BAR.read_text(encoding="utf-8")
    robot = robot_from_toml(text.replace("driven =", 'tunable = ["loops.joint4.placements.0.xyz.0"]\ndriven ='))
    name = next(x for x in eomgen.build(robot, kernels=("mass_matrix",)).parameters if x.startswith("loops."))
    short = robot_from_toml(text.replace("placement = { xyz = [0.5,", "placement = { xyz = [3.5,"))
    made = observer("four_bar", MEASURED, dt=STEP)
    in_c = r"observer of four_bar: it has closed loops.*allowed: in C robots without"
    free = r"observer of delta: it has joints with 3-DOF rotation; allowed: robots"
    closes = r"states: loops.joint4.* changes how the loops of four_bar close"
    for call, error, message in (
        (lambda: observer(robot, MEASURED, dt=STEP, states=(name,)), InputError, closes),
        (lambda: observer("delta", "encoder:arm1.gamma", dt=STEP), InputError, free),
        (lambda: write_observer(made, tmp_path), InputError, in_c),
        (lambda: observer(short, MEASURED, dt=STEP), LoopError, None),
    ):
        refused(error, message, call)
