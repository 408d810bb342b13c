"""NaN and infinity: named by kernels unless that is turned off, by integrators always, with what was good saved."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.cli.entry import main
from eomgen.errors import ArrayError, InputError, IntegrationStopped, SingularError
from eomgen.integration.solve import integrate
from eomgen.motion.point_to_point import Harmonic
from eomgen.robot.value import Robot
from eomgen.simulation.run import simulate
from tests.oracles.by_singular_values import ClosedLoops
from tests.support.builds import Build
from tests.support.optional import needs
from tests.support.refusals import refused
from tests.support.soak import soaked

pytestmark = pytest.mark.quick

METHODS = ("rk4", "scipy:RK45", "scipy:DOP853", "scipy:Radau", "scipy:BDF", "scipy:LSODA", "CVODE", "IDA")
KERNELS = (
    "forward_dynamics",
    "inverse_dynamics",
    "residual_jacobian",
    "mass_matrix",
    "energy",
    "external_force",
    "rollout",
)
Q, V = np.array([0.001, 0.3]), np.array([0.0, 0.5])
AT = 0.05  # s, when a number turns bad
Drive = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


@pytest.fixture
def kernel(built: Build) -> eomgen.Kernel:
    return built(eomgen.load_robot("one_link"), *KERNELS)


def given_x() -> Robot:
    """one_link on a slide that is shaken."""
    robot = eomgen.load_robot("one_link")
    joint = robot.joints[0]
    given = {**joint.coordinates, "x": replace(joint.coordinates["x"], prescribed=True)}
    return replace(robot, joints=(replace(joint, coordinates=given),))


def turning(bad: float, i: int, at: float = AT) -> Drive:
    """A drive whose number i is bad from a time on."""

    def drive(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        u = -0.2 * v
        if t >= at:
            u[..., i] = bad
        return u

    return drive


def check_kept(error: IntegrationStopped, whole: eomgen.integration.Trajectory, tolerance: float) -> None:
    """The trajectory ends in the last good state, is finite, and is what it would have been."""
    kept = error.trajectory
    assert kept.t[-1] == error.t
    assert np.array_equal(kept.q[-1], error.q)
    assert np.array_equal(kept.v[-1], error.v)
    for name in ("q", "v", "u", "energy"):
        assert np.isfinite(getattr(kept, name)).all(), name
        assert len(getattr(kept, name)) == len(kept.t)
    same = np.isin(kept.t, whole.t)
    assert same[:-1].all()
    expected = whole.q[: same.sum()]
    assert np.abs(kept.q[same] - expected).max() <= tolerance


# Kernels


def test_checks_can_be_turned_off(kernel: eomgen.Kernel) -> None:
    bad = np.array([np.nan, 0.0])
    assert kernel.checks is True
    caught = refused(ArrayError, r"^v: joint1\.x is nan; numbers must be finite$", kernel.inverse_dynamics, Q, bad, V)
    assert caught.coordinate == "joint1.x"
    kernel.checks = False
    assert np.isnan(kernel.energy(Q, bad)[0])
    assert np.isnan(kernel.energy(np.tile(Q, (5, 1)), bad)[:, 0]).all()
    other = kernel.replaced()
    assert other.checks is False
    other.checks = True
    assert kernel.checks is False
    refused(ArrayError, r"q: expected float64 of shape \(2,\)", kernel.energy, np.zeros(3), V)
    refused(ArrayError, "complex128", kernel.energy, np.zeros(2, complex), V)
    for wrong in (0, None, "no"):
        with pytest.raises(InputError, match=r"checks: .* is neither True nor False"):
            kernel.checks = wrong  # type: ignore[assignment]


def test_results_do_not_depend_on_the_checks(kernel: eomgen.Kernel) -> None:
    found = []
    for checks in (True, False):
        kernel.checks = checks
        states = np.linspace(-1.0, 1.0, 26).reshape(13, 2)
        found.append((kernel.forward_dynamics(Q, V, V), kernel.mass_matrix(states), kernel.rollout(Q, V, V, 1e-3, 9)))
    assert all(np.array_equal(x, y) for x, y in zip(found[0][:2], found[1][:2], strict=True))
    assert np.array_equal(found[0][2], found[1][2])


def test_where_nan_leaves_no_inverse_it_is_named(kernel: eomgen.Kernel) -> None:
    """The pivot of NaN is none; the state is to blame, not the mass matrix."""
    kernel.checks = False
    q = np.tile(Q, (4, 1))
    q[2, 1] = np.nan
    refused(ArrayError, r"^q: joint1\.gamma is nan; numbers must be finite$", kernel.forward_dynamics, q[2], V, V)
    with pytest.raises(ArrayError, match=r"^q: joint1\.gamma in state 2 is nan; numbers must be finite$"):
        kernel.forward_dynamics(q, V, V)


# Integrators


@pytest.mark.parametrize("bad", soaked([np.nan, np.inf, -np.inf], [np.nan]))
@pytest.mark.parametrize("method", METHODS)
def test_a_drive_that_turns_bad(method: str, bad: float, kernel: eomgen.Kernel) -> None:
    """At a known time, in one coordinate: both are named with the checks on and off, and the motion is kept."""
    i = METHODS.index(method) % 2
    options: dict[str, Any] = {"method": method, "rtol": 1e-8, "step": 1e-3, "output_step": 0.01}
    whole = integrate(kernel, Q, V, 0.1, drive=turning(0.0, 0, at=1.0), **options)
    for checks in (True, False):
        kernel.checks = checks
        caught = refused(IntegrationStopped, "", integrate, kernel, Q, V, 0.1, drive=turning(bad, i), **options)
        error, name = caught, kernel.coordinates[i]
        assert error.coordinate == name
        assert f"drive: {name} is {bad} at t = 0.0" in str(error)
        assert str(error).startswith(f"one_link, t = {error.t:.6g} s: {method} cannot go on")
        assert AT - 0.011 <= error.t < AT  # what steps to samples stops at the last one
        check_kept(error, whole, 1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_other_things_that_turn_bad(method: str, built: Build) -> None:
    """Wrenches, prescribed motions, and accelerations of forces that are finite."""
    kernel = built(eomgen.load_robot("one_link"), *KERNELS)
    options: dict[str, Any] = {"method": method, "step": 1e-3}

    def wrench(t: float, _q: np.ndarray, _v: np.ndarray) -> np.ndarray:
        return np.array([[0.0, 0.0, 0.0, 0.0, 0.0, np.nan if t > AT else 0.1]])

    with pytest.raises(IntegrationStopped, match=r"wrench: moment\.z of link link1 is nan at t = 0\.0[56]") as caught:
        integrate(kernel, Q, V, 0.1, wrench=wrench, **options)
    assert caught.value.trajectory.t[-1] == caught.value.t <= AT
    with pytest.raises(IntegrationStopped) as caught:  # 1 / inertia is 3
        integrate(kernel, Q, V, 0.1, drive=turning(1.7e308, 1), **options)
    assert caught.value.t < AT
    assert np.isfinite(caught.value.trajectory.q).all()
    shaken, motion = built(given_x(), *KERNELS), Harmonic([0.01], 3.0)

    def prescribed(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        q, v, a = motion(t)
        return q, v, a if t < AT else a * np.inf

    with pytest.raises(IntegrationStopped, match=r"prescribed: .* at t = 0\.0[56]") as caught:
        integrate(shaken, Q, V, 0.1, prescribed=prescribed, **options)
    assert caught.value.coordinate == "joint1.x"
    assert caught.value.trajectory.t[-1] == caught.value.t < AT


def test_a_drive_that_is_bad_at_a_sample_alone(kernel: eomgen.Kernel) -> None:
    """Where no step of the integrator looks: samples whose drives are not finite are none."""

    def drive(t: float, _q: np.ndarray, _v: np.ndarray) -> np.ndarray:
        return np.full(2, np.nan if t == 0.06 else 0.0)

    with pytest.raises(IntegrationStopped, match=r"t = 0\.05 s: .*drive: joint1\.x is nan at t = 0\.06 s") as caught:
        integrate(kernel, Q, V, 0.1, drive=drive, method="scipy:DOP853", times=[0.0, 0.05, 0.06, 0.1])
    assert caught.value.trajectory.t.tolist() == [0.0, 0.05]
    with pytest.raises(ArrayError, match=r"drive: joint1\.gamma is inf at t = 0 s"):
        integrate(kernel, Q, V, 0.1, drive=turning(np.inf, 1, at=0.0), method="scipy:Radau")
    kernel.checks = False
    with pytest.raises(ArrayError, match=r"wrench: force\.x of link link1 is nan"):
        integrate(kernel, Q, V, 0.1, wrench=np.full((1, 6), np.nan))


def test_a_trouble_that_was_overcome_is_not_blamed(kernel: eomgen.Kernel) -> None:
    """A trial step that failed early has nothing to do with a drive that is bad much later."""
    tried = []

    def drive(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        u = np.zeros(2)
        if not tried and t > 0.01:
            tried.append(t)
            u[0] = np.nan
        if t > 0.08:
            u[1] = np.inf
        return u

    with pytest.raises(IntegrationStopped, match=r"drive: joint1\.gamma is inf at t = 0\.08") as caught:
        integrate(kernel, Q, V, 0.1, drive=drive, method="scipy:DOP853")
    assert tried
    assert "nan" not in str(caught.value)


@pytest.mark.soak
def test_a_mechanism_with_loops(built: Build) -> None:
    mechanism = ClosedLoops(eomgen.build(eomgen.load_robot("four_bar"), flags=("-O0",)))
    q = mechanism.consistent_positions(np.full(mechanism.kernel.n, 0.5), held=["joint1.gamma"])
    v = np.zeros(mechanism.kernel.n)
    options = {"method": "rk4", "step": 1e-3, "output_step": 0.01}
    whole = integrate(mechanism.kernel, q, v, 0.1, drive=turning(0.0, 0, at=1.0), **options)
    with pytest.raises(IntegrationStopped, match=r"four_bar, t = 0\.049 s: .*drive: joint2\.gamma is nan") as caught:
        integrate(mechanism.kernel, q, v, 0.1, drive=turning(np.nan, 1), **options)
    check_kept(caught.value, whole, 0.0)
    assert caught.value.trajectory.info["gap"] < 1e-12


# Rollouts


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("count", [None, 11])
@pytest.mark.parametrize("method", ["rk4", "implicit"])
def test_drives_of_a_rollout_that_turn_bad(method: str, count: int | None, dtype: str, built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"), *KERNELS, dtype=dtype)
    steps, bad, state = 20, 7, 9
    lead = () if count is None else (count,)
    u = np.zeros((*lead, steps, 2), dtype)
    q, v = Q.astype(dtype), V.astype(dtype)
    whole = kernel.rollout(q, v, u, 1e-3, steps, method=method, every=2)
    u[(state, bad, 1) if lead else (bad, 1)] = np.nan
    place = f"u: joint1.gamma in step {bad}" + (f" in state {state}" if lead else "") + " is nan"
    refused(ArrayError, place, kernel.rollout, q, v, u, 1e-3, steps, method=method, every=2)
    kernel.checks = False
    caught = refused(IntegrationStopped, place, kernel.rollout, q, v, u, 1e-3, steps, method=method, every=2)
    error = caught
    assert error.coordinate == "joint1.gamma"
    assert "of state 9" in str(error) or not lead
    assert error.t == pytest.approx(6e-3)
    for found, expected, last in zip(error.stored, whole, (error.q, error.v), strict=True):
        one, good = (found[state], expected[state]) if lead else (found, expected)
        assert np.array_equal(one[:4], good[:4])
        assert np.array_equal(one[3], last)
        assert np.isnan(one[4:]).all()
    if lead:
        with pytest.raises(ArrayError, match=r"q0: joint1\.x in state 3 is inf"):
            kernel.rollout(np.where(np.arange(count or 0)[:, None] == 3, np.inf, q), v, u, 1e-3, steps)


def test_a_rollout_that_diverges_keeps_the_others(kernel: eomgen.Kernel) -> None:
    """rk4 with steps that are too long for one of three states."""
    push = np.zeros((3, 2))
    push[1] = 1e300
    with pytest.raises(IntegrationStopped, match=r"joint1\.(x|gamma) .*after step \d+ of state 1|state 1") as caught:
        kernel.rollout(np.tile(Q, (3, 1)), V, push, 1e-3, 50)
    error = caught.value
    assert error.t < 0.05
    whole = kernel.rollout(Q, V, push[0], 1e-3, 50)
    for found, expected in zip(error.stored, whole, strict=True):
        if np.isfinite(found[0]).all():
            assert np.abs(found[0] - expected).max() < 1e-12


def test_a_rollout_still_names_what_is_singular(built: Build) -> None:
    robot = eomgen.load_robot("one_link")
    point = replace(robot.links[0], mass=0.0, inertia=(0.0,) * 6)
    kernel = built(replace(robot, name="no_mass", links=(point,)), *KERNELS)
    kernel.checks = False
    refused(SingularError, r"joint1\.x", kernel.rollout, Q, V, np.zeros(2), 1e-3, 5)


# Simulations and their files


class Program:
    """Still, until its acceleration is no number."""

    start = np.zeros(1)

    def at(self, t: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        t = np.asarray(t, dtype=np.float64)
        still = np.zeros((*t.shape, 1))
        return still, still, np.where(t[..., np.newaxis] >= 0.1, np.nan, still)


@pytest.mark.soak
def test_a_simulation_that_is_stopped_keeps_its_result(tmp_path: Path) -> None:
    with pytest.raises(IntegrationStopped, match=r"joint1\.gamma is nan") as caught:
        simulate(eomgen.load_robot("one_link"), duration=0.2, motion=Program())
    error = caught.value
    found = eomgen.load_result(error.result.save(tmp_path / "r.npz"))
    for result in (error.result, found):
        assert result.stopped == {
            "reason": str(error),
            "t": error.t,
            "coordinate": "joint1.gamma",
            "q": error.q.tolist(),
            "v": error.v.tolist(),
        }
        assert 0.099 < result.trajectory.t[-1] <= error.t <= 0.1
        assert np.isfinite(result.trajectory.u).all()
        assert result.balance.work.shape == (len(result.trajectory.t), 5)
        assert result.balance.relative_residue < 1e-3
        assert f"  stopped too early: {error}" in result.summary_lines()
        assert json.loads(json.dumps(result.summary()))["stopped"]["coordinate"] == "joint1.gamma"
    other = pickle.loads(pickle.dumps(error))
    assert (str(other), other.t, other.coordinate) == (str(error), error.t, error.coordinate)


DIVERGING = """
duration = 2.0
output_step = 0.1
[initial]
q = { "joint1.x" = 0.01 }
[control]
type = "none"
[integrator]
method = "rk4"
step = 0.05
[[wrenches]]
link = "link1"
force = [0.0, 1.0, 0.0]
t0 = 0.15
t1 = 0.2
"""


def test_the_command_saves_what_was_good(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """rk4 with a step that is too long for the spring: exit status 1, and a file that says that it was stopped."""
    needs("zarr")
    (tmp_path / "s.toml").write_text(DIVERGING, encoding="utf-8")
    arguments = ["simulate", "one_link", "--scenario", str(tmp_path / "s.toml"), "-o", str(tmp_path / "out")]
    streamed = ["--stream", str(tmp_path / "stream")]
    assert main([*arguments, *streamed]) == 1
    said = capsys.readouterr()
    assert "rk4" in said.err
    assert f"wrote {tmp_path / 'out' / 'trajectory.npz'}: the motion until it stopped" in said.err
    found = eomgen.load_result(tmp_path / "out" / "trajectory.npz")
    assert found.stopped["reason"] in said.err
    assert found.trajectory.t.size > 3  # beyond the piece that ends when the wrench sets in
    assert np.allclose(np.diff(found.trajectory.t), 0.1)
    assert np.isfinite(found.trajectory.q).all()
    assert found.trajectory.t[-1] <= found.stopped["t"] < 2.0
    stream = eomgen.load_stream(tmp_path / "stream")
    assert not stream.complete
    rows = found.trajectory.t.size
    assert stream.t.size >= rows
    assert np.array_equal(stream.q[:rows], found.trajectory.q)
