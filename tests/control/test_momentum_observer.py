"""Momentum observers: external forces of simulated motions, Pinocchio's numbers, collisions under noise, and the C."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.control import Measurement, MomentumObserver
from eomgen.control.momentum_observer import links_alone
from eomgen.errors import InputError, SingularError, UnknownNameError
from eomgen.robot.value import PRINCIPAL
from tests.control.test_sensing import HYSTERETIC
from tests.loops.test_elastic_cuts import coupled
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.observer_code import CompiledMomentumObserver
from tests.support.optional import needs
from tests.support.random_motors import geared_robot, motor_state
from tests.support.random_robots import Array, random_robot, random_state
from tests.support.refusals import refused

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

KERNELS = ("generalized_momentum", "generalized_force", "forward_dynamics", "external_force")
GAIN, DT = 50.0, 1e-3
TREE = random_robot(4, joints=(3, 3), tree=True, types=("revolute", "prismatic"), rigid=True)
GEARED = geared_robot(3, joints=(2, 2))


def moved(kernel: eomgen.Kernel, state: tuple[Array, Array], u: Array, wrench: Array | None) -> tuple[Array, Array]:
    """The state after a sample by the classical Runge-Kutta method, in four steps."""
    q, v = state
    h = DT / 4

    def a(x: Array, w: Array) -> Array:
        return kernel.forward_dynamics(x, w, u, wrench=wrench)

    for _ in range(4):
        k1 = a(q, v)
        k2 = a(q + h / 2 * v, v + h / 2 * k1)
        k3 = a(q + h / 2 * v + h * h / 4 * k1, v + h / 2 * k2)
        k4 = a(q + h * v + h * h / 2 * k2, v + h * k3)
        q, v = q + h * v + h * h / 6 * (k1 + k2 + k3), v + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return q, v


def test_forces_come_with_the_time_constant(built: Build) -> None:
    """A wrench on the last link from a time on, under drives that change: r is J^T F behind a filter with 1 / K."""
    kernel = built(TREE, *KERNELS)
    n = kernel.n
    observer = MomentumObserver(TREE, GAIN, DT, threshold=0.5, kernel=kernel)
    rng = np.random.default_rng(1)
    state = rng.uniform(-0.5, 0.5, n), np.zeros(n)
    wrench = np.zeros((len(kernel.links), 6))
    found, expected, told = list[Array](), list[Array](), list[bool]()
    for k in range(300):
        wrench[-1] = np.array([3.0, -2.0, 1.0, 0.5, 0.2, -0.3]) * (k >= 100)
        u = 2.0 * np.sin(0.01 * k + np.arange(n))
        before = state
        state = moved(kernel, state, u, wrench)
        if k == 0:
            observer.start(*before)
        found.append(observer.step(*state, u))
        expected.append(kernel.functions.external_force(0.5 * (before[0] + state[0]), wrench))
        told.append(bool(observer.collisions))
    r, tau = np.array(found), np.array(expected)
    size = np.abs(tau).max()
    assert np.abs(r[:100]).max() <= 1e-4 * size  # of the mean over a sample
    assert not any(told[:100])
    assert any(told[100:110])  # within 10 ms
    filtered, keep = np.zeros(n), np.exp(-GAIN * DT)
    for now, force in zip(r, tau, strict=True):
        filtered = keep * filtered + (1.0 - keep) * force
        assert np.abs(now - filtered).max() <= 2e-4 * size
    assert np.abs(r[120] - tau[120]).max() > 0.2 * np.abs(tau[120]).max()  # after one time constant
    assert np.abs(r[-1] - tau[-1]).max() <= 0.1 * size  # after ten; tau moves on


def test_the_formula_in_pinocchios_numbers(built: Build) -> None:
    """A step from its mass matrix, Coriolis matrix and gravity; of several states at once as of each."""
    pin = needs("pinocchio")
    robot = replace(TREE, springs=(), elements=())
    kernel, oracle = built(robot, *KERNELS), PinocchioOracle(robot)
    gain = np.array([20.0, 50.0, 80.0])[: kernel.n]
    observer = MomentumObserver(robot, list(gain), DT, kernel=kernel)
    rng = np.random.default_rng(5)
    ends = [rng.uniform(-1.0, 1.0, (2, 4, kernel.n)) for _ in range(2)]
    u = rng.uniform(-1.0, 1.0, (4, kernel.n))

    def look(q: Array, v: Array) -> tuple[Array, Array]:
        M = pin.crba(oracle.model, oracle.data, q)
        M = np.triu(M) + np.triu(M, 1).T + np.diag(oracle.armature)
        gravity = pin.computeGeneralizedGravity(oracle.model, oracle.data, q)
        springs = oracle.stiffness * q + oracle.damping * v
        return M @ v, oracle.coriolis_matrix(q, v).T @ v - gravity - springs

    observer.start(*ends[0])
    found = observer.step(*ends[1], u)
    for i in range(4):
        (p0, f0), (p1, f1) = (look(*end[:, i]) for end in ends)
        expected = (1.0 - np.exp(-gain * DT)) * ((p1 - p0) / DT - 0.5 * (f0 + f1) - u[i])
        assert np.abs(found[i] - expected).max() <= 1e-10 * (1.0 + np.abs(expected).max())


def test_elastic_gears_with_encoders_on_both_sides_and_with_torque_sensors(built: Build) -> None:
    """A force on the links alone is found there and not at motors; from torques of the joints on the links' model."""
    joint = next(joint for joint in GEARED.joints if joint.motor is not None)
    principal = f"{joint.name}.{PRINCIPAL[joint.type]}"
    m = Measurement.of(GEARED, f"torque:{principal}")
    kernel, s = built(m.robot, *KERNELS, "measurement"), motor_state(GEARED, 3)
    names, n = kernel.coordinates, kernel.n
    of_links = links_alone(GEARED)
    of_sensed = built(of_links, "generalized_momentum", "generalized_force")
    sensed = MomentumObserver(GEARED, GAIN, DT, torque_sensors=True, kernel=of_sensed)
    links = [names.index(name) for name in sensed.coordinates]
    motors = [i for i in range(n) if i not in links]
    assert [names[i] for i in motors] == [f"{joint.name}.motor"]
    observer = MomentumObserver(GEARED, GAIN, DT, kernel=kernel)
    state, u, external = (0.1 * s.q, 0.0 * s.v), 0.1 * s.u, np.zeros(n)
    external[links] = np.arange(1.0, 1.0 + len(links))
    at = names.index(principal)

    def torque(q: Array, v: Array) -> float:
        """What the joint carries: what moves the links, less what acts from outside on the coordinate."""
        return float(kernel.functions.measurement(q, v, kernel.forward_dynamics(q, v, u + external))[0]) - external[at]

    observer.start(*state)
    sensed.start(*(x[links] for x in state))
    for _ in range(200):
        ends, state = state, moved(kernel, state, u + external, None)
        r = observer.step(*state, u)
        measured = u.copy()
        measured[at] = 0.5 * (torque(*ends) + torque(*state))
        at_joints = sensed.step(*(x[links] for x in state), measured[links])
    reached = 1.0 - np.exp(-200 * GAIN * DT)
    assert np.abs(r[links] - reached * external[links]).max() <= 1e-3 * external.max()
    assert np.abs(r[motors]).max() <= 1e-3 * external.max()
    assert np.abs(at_joints - reached * external[links]).max() <= 1e-3 * external.max()


def closed_motion(kernel: eomgen.Kernel, held: tuple[str, ...], q: Array, u: Array) -> Iterator[tuple[Array, Array]]:
    """States of a mechanism under constant drives, by the classical Runge-Kutta method, closed in each stage."""

    def close(q: Array, v: Array) -> tuple[Array, Array]:
        q = kernel.assemble(q, fixed=held)
        return q, kernel.project_velocity(q, v, fixed=held)

    def slope(q: Array, v: Array) -> tuple[Array, Array]:
        q, v = close(q, v)
        return v, kernel.forward_dynamics(q, v, u)

    q, v = close(q, np.full(kernel.n, 2.0))
    while True:
        yield q, v
        first = slope(q, v)
        second = slope(q + DT / 2 * first[0], v + DT / 2 * first[1])
        third = slope(q + DT / 2 * second[0], v + DT / 2 * second[1])
        last = slope(q + DT * third[0], v + DT * third[1])
        dq, dv = (a + 2.0 * b + 2.0 * c + d for a, b, c, d in zip(first, second, third, last, strict=True))
        q, v = close(q + DT / 6 * dq, v + DT / 6 * dv)


@pytest.mark.soak
def test_forces_on_closed_mechanisms_are_those_along_their_coordinate(tmp_path: Path) -> None:
    """A four-bar linkage turning under forces on all coordinates: r is their work along it, filtered; in C, too."""
    observer = MomentumObserver("four_bar", GAIN, DT, threshold=1e-6)
    assert observer.coordinates == ("joint1.gamma",)
    kernel = eomgen.build("four_bar", kernels=("forward_dynamics", "constraint", "cut_poses", "mass_matrix"))
    rng = np.random.default_rng(8)
    u, tau = rng.normal(size=(2, kernel.n))
    motion = closed_motion(kernel, observer.coordinates, np.array([0.5, 0.0, 0.0]), u + tau)
    code = CompiledMomentumObserver(observer, tmp_path)
    found, keep = 0.0, np.exp(-GAIN * DT)
    before = next(motion)
    observer.start(*before)
    code.start(*before)
    for _ in range(30):
        now = next(motion)
        work = (now[0] - before[0]) @ tau  # of a step, by its independent coordinate
        found = keep * found + (1.0 - keep) * work / (now[0][0] - before[0][0])
        r, before = observer.step(*now, u), now
        assert r[0] == pytest.approx(found, rel=1e-4)
        assert code.step(*now, u) == 1
        assert code.external[0] == pytest.approx(r[0], rel=1e-10)
    assert observer.collisions == ("joint1.gamma",)
    refused(InputError, r"u: got the shape \(1,\); allowed: \(..., 3\)", observer.step, *before, u[:1])
    with pytest.raises(SingularError, match=r"'joint1.gamma' do not hold the other coordinates in this state"):
        observer.step(np.zeros(kernel.n), np.zeros(kernel.n), u)


def test_rigid_couplings_as_rows_of_the_constraint_have_the_forces_of_followers(tmp_path: Path) -> None:
    """Two arms by a gear, whose second one is a coordinate or none; in C, too."""
    robot = coupled("")
    first, second = (MomentumObserver(x, GAIN, DT) for x in (robot, robot.with_constraints()))
    assert first.coordinates == second.coordinates == ("a.gamma",)
    code = CompiledMomentumObserver(second, tmp_path)
    rng = np.random.default_rng(9)
    for k in range(6):
        q, v, u = rng.normal(size=3)
        both = np.array([q, 0.1 - 2.0 * q]), np.array([v, -2.0 * v])
        if k == 0:
            code.start(*both)
        r = first.step([q], [v], [u])
        assert second.step(*both, [u, 0.0]) == pytest.approx(r, rel=1e-10)
        if k > 0:
            assert code.step(*both, [u, 0.0]) == 0
            assert code.external[0] == pytest.approx(r[0], rel=1e-10)
    assert abs(r[0]) > 1.0


def test_closed_mechanisms_in_float32_are_those_in_float64(tmp_path: Path) -> None:
    """A four-bar linkage in random velocities, with rates in float32; in C, too."""
    wide, narrow = (MomentumObserver("four_bar", GAIN, DT, dtype=dtype) for dtype in ("float64", "float32"))
    kernel, code = wide.kernel, CompiledMomentumObserver(narrow, tmp_path)
    rng = np.random.default_rng(10)
    for k in range(6):
        q = kernel.assemble([1.0 + 0.1 * k, -0.5, 1.4], fixed=wide.coordinates)
        v = kernel.project_velocity(q, rng.normal(size=3), fixed=wide.coordinates)
        u = rng.normal(size=3)
        r, found = wide.step(q, v, u), narrow.step(*(x.astype(np.float32) for x in (q, v, u)))
        assert found.dtype == np.float32
        assert np.abs(found - r).max() <= 1e-4 * np.abs(r).max(initial=1.0)
        if k == 0:
            code.start(q, v)
        else:
            assert code.step(q, v, u) == 0
            assert np.abs(code.external - found).max() <= 1e-4 * np.abs(r).max(initial=1.0)
    assert np.abs(r).max() > 1.0


def test_noise_of_encoders_is_no_collision(built: Build) -> None:
    """Rates with noise of 1e-3: below the threshold while nothing touches, in each of several motions at once."""
    kernel, rng = built(TREE, *KERNELS), np.random.default_rng(2)
    s = random_state(TREE, 1)
    observer = MomentumObserver(TREE, GAIN, DT, threshold=2.0, kernel=kernel)
    q, v = np.tile(0.3 * s.q, (20, 1)), np.zeros((20, kernel.n))
    observer.start(q, v)
    for k in range(100):
        u = kernel.generalized_force(q, v) * -1.0
        q, v = moved(kernel, (q, v), u, None)
        observer.step(q, v + 1e-3 * rng.normal(size=v.shape), u)
        assert observer.collisions == (), k
    observer.step(q, v + 1.0, u)
    assert observer.collisions


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_the_c_has_the_bits_of_python(dtype: str, built: Build, tmp_path: Path) -> None:
    """With all warnings as errors; it says on which coordinate the force is beyond its threshold."""
    names = ("generalized_momentum", "generalized_force")
    kernel = built(TREE, *names, dtype=dtype)
    observer = MomentumObserver(TREE, 30.0, DT, threshold={kernel.coordinates[-1]: 1.0}, dtype=dtype, kernel=kernel)
    code, n = CompiledMomentumObserver(observer, tmp_path), kernel.n
    rng = np.random.default_rng(4)
    q, v, u = rng.uniform(-1.0, 1.0, (3, 6, n)).astype(dtype)
    code.start(q[0], v[0])
    observer.start(q[0], v[0])
    for k in range(1, 6):
        beyond = code.step(q[k], v[k], u[k])
        found = observer.step(q[k], v[k], u[k])
        assert found.dtype == dtype
        assert np.array_equal(code.external, found)
        assert (beyond == n) == bool(observer.collisions)
    assert beyond == n  # random samples are no motion
    fast, struct = np.full(n, np.finfo(dtype).max), bytes(code.ffi.buffer(code.struct))
    for bad in ((q[0], v[0], np.full(n, np.inf)), (q[0], fast, u[0]), (q[0], v[0], np.full(n, np.nan))):
        assert code.step(*bad) == -2
        with pytest.raises(InputError), np.errstate(all="ignore"):
            observer.step(*bad)
    assert code.start(q[0], fast) == -2
    assert bytes(code.ffi.buffer(code.struct)) == struct
    code.step(q[0], v[0], u[0])
    assert np.array_equal(code.external, observer.step(q[0], v[0], u[0]))  # both go on from where they were


def test_what_cannot_be_observed_is_refused_by_name() -> None:
    for options, error, message in (
        ({"robot": "shaken_arm"}, InputError, r"is prescribed, by forces that are not known"),
        ({"gain": 0.0}, InputError, r"gain: joint1.x has 0.0; allowed: a number above 0"),
        ({"gain": float("inf")}, InputError, r"gain: joint1.x has inf"),
        ({"gain": [1.0]}, InputError, r"gain: got 1 numbers; allowed: one, or 2"),
        (
            {"gain": {"joint1.x": 1.0}},
            InputError,
            r"gain: 'joint1.gamma' has none; allowed: a number for each coordinate",
        ),
        ({"dt": 0.0}, InputError, r"dt: got 0.0; allowed: a number above 0, s"),
        ({"threshold": -1.0}, InputError, r"threshold: joint1.x has -1.0"),
        ({"threshold": {"joint1.y": 1.0}}, UnknownNameError, r"threshold: 'joint1.y' is no coordinate"),
    ):
        refused(error, message, MomentumObserver, **{"robot": "one_link", "gain": GAIN, "dt": DT, **options})


def test_internal_states_are_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"laws have states \(.*\), which are not measured; allowed: robot.without_s"):
        MomentumObserver(HYSTERETIC, GAIN, DT)
    assert MomentumObserver(HYSTERETIC.without_states(), GAIN, DT).coordinates == ("joint1.gamma", "joint1.motor")
    assert MomentumObserver(HYSTERETIC, GAIN, DT, torque_sensors=True).coordinates == ("joint1.gamma",)


def test_a_folder_of_sources_has_the_observer(tmp_path: Path) -> None:
    """Its C lies beside the robot's."""
    observer = MomentumObserver("one_link", GAIN, DT)
    package = observer.write(tmp_path)
    assert package == tmp_path / "one_link"
    for name, text in observer.sources().items():
        assert (package / name).read_text(encoding="ascii") == text


@pytest.mark.soak
def test_a_package_with_the_observer_is_imported(tmp_path: Path) -> None:
    MomentumObserver("one_link", GAIN, DT).write(tmp_path)
    code = "import one_link; print(one_link.functions.generalized_momentum([0.1, 0.2], [1.0, 2.0]).shape)"
    found = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True, capture_output=True, text=True)
    assert found.stdout == "(2, 2)\n"
