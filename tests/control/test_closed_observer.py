"""Extended Kalman filters of closed mechanisms: against a textbook's, consistency, precisions, what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

import eomgen
from eomgen.control import Measurement, Observer, Uncertainty, observer, write_observer
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError, LoopError
from tests.control.test_observer import Textbook, close
from tests.loops.test_elastic_cuts import coupled
from tests.support.soak import WHOLE

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]
DT = 2e-3
FREE = ("joint1.gamma",)
MEASURED = "encoder:joint3.gamma,tachometer:joint2.gamma"
KERNELS = ("rollout", "constraint", "constraint_jacobian", "cut_poses", "mass_matrix")  # of the truth
FOUR_BAR = Path(str(eomgen.__file__)).parent / "robots" / "four_bar.toml"


def moved(kernel: eomgen.Kernel, x: Array, force: Any) -> Array:
    """Take a step of a four-bar linkage in the crank's angle and velocity, by the kernel's own functions."""
    q = kernel.assemble(np.array([x[0], -0.5, 1.4]), held=FREE)
    v = kernel.project_velocity(q, np.array([x[1], 0.0, 0.0]), held=FREE)
    ends = kernel.rollout(q, v, force(q), DT, 1, method="implicit")
    return np.array([ends[0][1, 0], ends[1][1, 0]])


def placed(kernel: eomgen.Kernel, x: Array) -> tuple[Array, Array]:
    """All coordinates and velocities of the crank's."""
    q = kernel.assemble(np.array([x[0], -0.5, 1.4]), held=FREE)
    return q, kernel.project_velocity(q, np.array([x[1], 0.0, 0.0]), held=FREE)


def test_filter_is_that_of_textbooks() -> None:
    """A crank's angle and velocity, a wrench on the coupler and gravity: derivatives are differences there."""
    known = Uncertainty(acceleration=0.3, wrench=2.0, wrench_drift=5.0, parameter=0.2, parameter_drift=0.1)
    made = observer(
        "four_bar", f"{MEASURED},imu:tcp", dt=DT, states=("gravity.y", "wrench:coupler"), uncertainty=known,
        unobservable="allow",
    )  # fmt: skip
    assert made.states[:3] == ("joint1.gamma", "d/dt joint1.gamma", "wrench:coupler.fx")
    kernel = eomgen.build(
        made.filter.measurement.robot, kernels=(*KERNELS, "external_force", "measurement", "forward_dynamics")
    )
    g = kernel.parameters["gravity.y"]
    begins = made.q
    wrench = np.zeros((3, 6))

    def force(x: Array, u: Array) -> Any:
        kernel.parameters["gravity.y"] = x[8]
        wrench[1] = x[2:8]
        return lambda q: u + kernel.external_force(q, wrench)

    class ByDifferences(Textbook):
        """Readings follow from the crank's state."""

        def readings(self, x: Array, u: Array) -> Array:
            q, v = placed(kernel, x)
            return np.asarray(kernel.measurement(q, v, kernel.forward_dynamics(q, v, force(x, u)(q))))

        def look(self, u: Array) -> Array:
            size = np.maximum(np.abs(self.x), 1e-2) * 1e-5
            pairs = [(self.readings(self.x + h, u), self.readings(self.x - h, u)) for h in np.diag(size)]
            self.H = np.array([(a - b) / (2 * h) for (a, b), h in zip(pairs, size, strict=True)]).T
            return self.readings(self.x, u)

    def step(x: Array, u: Array) -> Array:
        return np.concatenate([moved(kernel, x[:2], force(x, u)), x[2:]])

    kick = np.sqrt(DT) * 0.3
    G = np.zeros((9, 8))
    G[0, 0], G[1, 0] = DT * kick, kick
    G[2:, 1:] = np.sqrt(DT) * np.diag([5.0] * 6 + [0.1 * abs(g)])
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
        assert np.abs(kernel.constraint(made.q)).max() < 1e-11
        assert np.abs(kernel.constraint_jacobian(made.q) @ made.v).max() < 1e-11


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
            kick = np.sqrt(DT) * 0.5 * rng.normal()
            x += np.array([DT * kick, kick])
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
    made = observer(m.robot, m, dt=DT, uncertainty=known)
    innovation, error = consistency(made, 1, 60)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 2 * 60)
    assert low < innovation.sum() < high
    assert error[0] < stats.chi2.ppf(0.9995, 2)
    narrow = observer(m.robot, m, dt=DT, uncertainty=known, dtype="float32")
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
def test_innovations_are_those_of_the_noise_that_is_told() -> None:
    """Many runs of a four-bar linkage whose rocker is measured: their sums of squares are chi-square."""
    m = Measurement.of("four_bar", MEASURED, noise={"encoder": 1e-4, "tachometer": 1e-2})
    made = observer(m.robot, m, dt=DT, uncertainty=Uncertainty(position=1e-3, velocity=1e-2, acceleration=0.5))
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
    first, second = (observer(x, "encoder:a.gamma", dt=DT) for x in (robot, robot.with_constraints()))
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
    made = observer("four_bar", "encoder:joint3.gamma", dt=DT)
    made.begin([1.3, -0.6, 1.5], [2.0, 0.0, 0.0])
    q, v = made.q, made.v
    assert (q[0], v[0]) == (1.3, 2.0)
    assert np.abs(made.kernel.constraint(q)).max() < 1e-11
    assert np.abs(made.kernel.constraint_jacobian(q) @ v).max() < 1e-11
    assert made.observability([[0.6, -0.5, 1.4], [2.0, -0.5, 1.4]]).is_complete
    assert np.array_equal(made.q, q)
    assert np.array_equal(made.v, v)
    made.predict([0.0, 0.0, 0.0])
    made.state[0] = 60.0
    made.begin([1.3, -0.6, 1.5])
    assert made.estimate("d/dt joint1.gamma") == 0.0


def test_what_cannot_be_used_is_refused_by_name(tmp_path: Path) -> None:
    text = FOUR_BAR.read_text(encoding="utf-8")
    robot = robot_from_toml(text.replace("driven =", 'tunable = ["loops.joint4.placements.0.xyz.0"]\ndriven ='))
    name = next(x for x in eomgen.build(robot, kernels=("mass_matrix",)).parameters if x.startswith("loops."))
    with pytest.raises(InputError, match=r"states: loops.joint4.* changes how the loops of four_bar close"):
        observer(robot, MEASURED, dt=DT, states=(name,))
    with pytest.raises(InputError, match=r"observer of delta: it has joints with 3-DOF rotation; allowed: robots"):
        observer("delta", "encoder:arm1.gamma", dt=DT)
    made = observer("four_bar", MEASURED, dt=DT)
    with pytest.raises(InputError, match=r"observer of four_bar: it has closed loops.*allowed: in C robots without"):
        write_observer(made, tmp_path)
    short = robot_from_toml(text.replace("placement = { xyz = [0.5,", "placement = { xyz = [3.5,"))
    with pytest.raises(LoopError):
        observer(short, MEASURED, dt=DT)
