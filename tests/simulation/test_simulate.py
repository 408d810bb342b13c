"""Integrators against closed forms and laws, static equilibrium, simulated motions, their files and plots."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen import ArrayError, InputError, IntegrationError, SingularError, UnknownNameError
from eomgen.errors import IntegrationStopped
from eomgen.integration.solve import choose_method, integrate
from eomgen.integration.system import System
from eomgen.motion.ends import default_motion
from eomgen.pictures.simulation import plot_result
from eomgen.robot.value import COORDINATES, Coordinate, Joint, Link, Robot
from eomgen.simulation.archive import load_result
from eomgen.simulation.run import simulate
from eomgen.state.equilibrium import static_equilibrium
from eomgen.state.springs import coordinate_sizes, stiffnesses
from tests.support.builds import Build
from tests.support.random_robots import random_placement

pytestmark = pytest.mark.usefixtures("unoptimised")

NEEDED = ("forward_dynamics", "inverse_dynamics", "mass_matrix", "energy")
MASS, STIFFNESS, DAMPING = 2.0, 800.0, 4.0


def oscillator(damping: float | None = DAMPING, gravity: float = 0.0) -> Robot:
    """A mass on a spring along z: w = 20 rad/s, and 5 percent of critical damping."""
    link = Link("mass", MASS, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    joint = Joint("slide", "base", "mass", "prismatic", coordinates={"z": Coordinate(STIFFNESS, damping)})
    return Robot("oscillator", (0.0, 0.0, gravity), (link,), (joint,))


def elastic_arm(seed: int = 5, damping: float = 1.0) -> Robot:
    """Two revolute joints of six coordinates, all with springs; about 1 to 20 Hz."""
    rng = np.random.default_rng(seed)
    table = {name: Coordinate(400.0, damping or None) for name in COORDINATES}
    links, joints = [], []
    for i, parent in ((1, "base"), (2, "link1")):
        com = tuple(float(x) for x in rng.uniform(-0.2, 0.2, 3))
        a, b, c = (float(x) for x in rng.uniform(0.02, 0.1, 3))
        links.append(Link(f"link{i}", float(rng.uniform(1.0, 4.0)), com, (b + c, a + c, a + b, 0.0, 0.003, -0.002)))
        joints.append(Joint(f"joint{i}", parent, f"link{i}", "revolute", random_placement(rng), coordinates=table))
    return Robot(f"arm{seed}", (0.0, 3.0, -9.0), tuple(links), tuple(joints))


def closed_form(t: np.ndarray, q0: float, v0: float) -> np.ndarray:
    decay = DAMPING / (2.0 * MASS)
    w = np.sqrt(STIFFNESS / MASS - decay**2)
    return np.exp(-decay * t) * (q0 * np.cos(w * t) + (v0 + decay * q0) / w * np.sin(w * t))


@pytest.mark.parametrize(
    ("method", "options", "bound"),
    [
        ("DOP853", {"rtol": 1e-10}, 1e-9),
        ("RK45", {"rtol": 1e-9}, 1e-8),
        ("Radau", {"rtol": 1e-8}, 1e-8),
        ("BDF", {"rtol": 1e-8}, 1e-6),
        ("LSODA", {"rtol": 1e-9}, 1e-7),
        ("rk4", {"step": 1e-4}, 1e-10),
        ("auto", {"rtol": 1e-8}, 1e-8),
    ],
)
def test_oscillator_equals_its_closed_form(method: str, options: dict[str, float], bound: float, built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    motion = integrate(kernel, [0.1], [0.5], 1.0, method=method, **options)
    assert motion.t.shape == (1001,)
    assert motion.q.shape == motion.v.shape == motion.u.shape == (1001, 1)
    assert np.abs(motion.of("slide.z") - closed_form(motion.t, 0.1, 0.5)).max() <= bound
    energy = 0.5 * MASS * motion.v[:, 0] ** 2, 0.5 * STIFFNESS * motion.q[:, 0] ** 2
    assert np.allclose(motion.energy, np.transpose(energy), rtol=1e-12, atol=1e-15)
    assert motion.method == ("Radau" if method == "auto" else method)
    assert min(motion.info["steps"], motion.info["evaluations"]) > 0


@pytest.mark.parametrize("method", ["DOP853", "Radau", "rk4"])
def test_times_of_samples_are_free(method: str, built: Build) -> None:
    """The state given is that at the first time, drives see the times themselves; what is recorded is the samples."""
    kernel = built(oscillator(), *NEEDED)
    times = np.array([0.3, 0.31, 0.5, 0.77, 1.0])
    seen: list[tuple[np.ndarray, np.ndarray]] = []
    options = {"method": method, "rtol": 1e-9, "step": 1e-4, "drive": lambda t, _q, _v: [np.cos(3.0 * t)]}
    record = lambda t, y: seen.append((t.copy(), y.copy()))  # noqa: E731
    part = integrate(kernel, [0.1], [0.5], 1.0, times=times, record=record, **options)
    shifted = {**options, "drive": lambda t, _q, _v: [np.cos(3.0 * (t + 0.3))]}
    whole = integrate(kernel, [0.1], [0.5], 0.7, output_step=0.01, **shifted)
    assert np.array_equal(part.t, times)
    assert np.abs(part.q - whole.q[[0, 1, 20, 47, 70]]).max() < 1e-7
    assert np.array_equal(np.concatenate([t for t, _ in seen]), times[1:])
    assert np.array_equal(np.concatenate([y for _, y in seen]), np.hstack([part.q, part.v])[1:])


def test_default_fixed_step_resolves_the_spring(built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    motion = integrate(kernel, [0.1], [0.0], 0.5, method="rk4", output_step=0.1)
    assert motion.t.tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    assert np.abs(motion.q[:, 0] - closed_form(motion.t, 0.1, 0.0)).max() < 1e-7


def test_rk4_is_of_order_four(built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    ends = [
        integrate(kernel, [0.1], [0.5], 1.0, method="rk4", step=h, output_step=1.0).q[-1, 0] for h in (8e-3, 4e-3, 2e-3)
    ]
    errors = np.abs(np.array(ends) - closed_form(np.array(1.0), 0.1, 0.5))
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.abs(orders - 4.0).max() < 0.25


@pytest.mark.parametrize(("method", "rtol"), [("DOP853", 1e-11), ("Radau", 1e-10)])
def test_energy_is_conserved_without_damping(method: str, rtol: float, built: Build) -> None:
    robot = elastic_arm(damping=0.0)
    kernel = built(robot, *NEEDED)
    rng = np.random.default_rng(0)
    q0, v0 = rng.uniform(-0.1, 0.1, kernel.n), rng.uniform(-0.5, 0.5, kernel.n)
    motion = integrate(kernel, q0, v0, 1.0, method=method, rtol=rtol, output_step=0.01)
    total = motion.energy.sum(axis=1)
    assert np.abs(total - total[0]).max() <= 1e-9 * motion.energy[:, 0].max()
    assert motion.energy[:, 0].max() > 3.0 * motion.energy[:, 0].min()


def test_dampers_and_drives_account_for_the_energy(built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    motion = integrate(kernel, [0.1], [0.0], 1.0, drive=lambda t, _q, _v: [3.0 * np.sin(15.0 * t)], rtol=1e-9)
    power = motion.u[:, 0] * motion.v[:, 0] - DAMPING * motion.v[:, 0] ** 2
    work = np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(motion.t))
    assert motion.energy[-1].sum() - motion.energy[0].sum() == pytest.approx(work, abs=1e-5)


def test_implicit_equals_explicit(built: Build) -> None:
    kernel = built(elastic_arm(), *NEEDED)
    q0, v0 = np.full(kernel.n, 0.02), np.full(kernel.n, -0.1)
    motions = [
        integrate(kernel, q0, v0, 0.5, method=method, rtol=rtol, output_step=0.01)
        for method, rtol in (("DOP853", 1e-11), ("Radau", 1e-9), ("BDF", 1e-9), ("LSODA", 1e-10))
    ]
    for motion in motions[1:]:
        assert np.abs(motion.q - motions[0].q).max() < 1e-6
        assert motion.info["jacobians"] > 0 or motion.method == "LSODA"  # which takes none while nothing is stiff


def test_a_wrench_acts_as_its_generalized_force(built: Build) -> None:
    kernel = built(elastic_arm(), *NEEDED, "external_force")
    wrench = np.random.default_rng(1).uniform(-5.0, 5.0, (len(kernel.links), 6))
    zero = np.zeros(kernel.n)
    options = {"method": "DOP853", "output_step": 0.05, "rtol": 1e-10}
    given = integrate(kernel, zero, zero, 0.3, wrench=wrench, **options)
    called = integrate(kernel, zero, zero, 0.3, wrench=lambda _t, _q, _v: wrench, **options)
    as_drive = integrate(kernel, zero, zero, 0.3, drive=lambda _t, q, _v: kernel.external_force(q, wrench), **options)
    assert (given.q == called.q).all()
    assert np.abs(given.q - as_drive.q).max() < 1e-9
    implicit = integrate(kernel, zero, zero, 0.3, wrench=wrench, method="Radau", output_step=0.05, rtol=1e-8)
    assert np.abs(given.q - implicit.q).max() < 1e-6


@pytest.mark.parametrize("batched", [True, False])
def test_jacobian_is_the_derivative(batched: bool, built: Build) -> None:
    kernel = built(elastic_arm(), *NEEDED)
    drive = Spring()
    drive.batched = batched
    system = System(kernel, drive, None)
    y = np.random.default_rng(2).uniform(-0.3, 0.3, 2 * kernel.n)
    central = np.empty((y.size, y.size))
    for i, e in enumerate(1e-5 * np.eye(y.size)):
        central[:, i] = (system.derivative(0.1, y + e) - system.derivative(0.1, y - e)) / 2e-5
    assert np.abs(system.jacobian(0.1, y) - central).max() <= 1e-5 * np.abs(central).max()


class Spring:
    """A drive that depends on time and state, of one state or a batch."""

    batched = True

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -3.0 * q + 0.5 * np.roll(q, 1, axis=-1) - 0.7 * v + t


def test_sizes_of_coordinates(built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    sizes, rates = coordinate_sizes(kernel, np.zeros(1))
    assert sizes == pytest.approx(10.0 / 400.0)
    assert rates == pytest.approx(10.0 / 20.0)
    kernel.parameters["joints.slide.z.stiffness"] = 0.0
    assert [x.tolist() for x in coordinate_sizes(kernel, np.zeros(1))] == [[1.0], [1.0]]
    assert not stiffnesses(kernel).any()
    assert choose_method(kernel) == "DOP853"


# Static equilibrium


def test_a_spring_under_gravity_hangs_where_it_must(built: Build) -> None:
    kernel = built(oscillator(gravity=-9.81), *NEEDED)
    q, u = static_equilibrium(kernel, [0.3])
    assert q == pytest.approx(-9.81 * MASS / STIFFNESS, rel=1e-12)
    assert u == [0.0]
    q, _ = static_equilibrium(kernel, [0.0], u=[9.81 * MASS])
    assert q == pytest.approx(0.0, abs=1e-15)
    q, u = static_equilibrium(kernel, [0.3], held=["slide.z"])
    assert q == [0.3]
    assert u == pytest.approx(STIFFNESS * 0.3 + 9.81 * MASS)


@pytest.mark.parametrize("seed", range(5, 9))
def test_static_equilibrium_has_no_acceleration(seed: int, built: Build) -> None:
    kernel = built(elastic_arm(seed), *NEEDED, "residual", "external_force")
    zero = np.zeros(kernel.n)
    wrench = np.random.default_rng(seed).uniform(-2.0, 2.0, (len(kernel.links), 6))
    for held in ((), ("joint1.gamma", "joint2.gamma")):
        q, u = static_equilibrium(kernel, zero, wrench=wrench, held=held)
        assert np.abs(kernel.residual(q, zero, zero, u, wrench=wrench)).max() < 1e-11 * 400.0
        assert np.abs(kernel.forward_dynamics(q, zero, u, wrench=wrench)).max() < 1e-8
        free = [name not in held for name in kernel.coordinates]
        assert not u[free].any()
        assert np.abs(q).max() > 1e-3


def test_equilibrium_under_a_drive_that_depends_on_the_state(built: Build) -> None:
    kernel = built(elastic_arm(), *NEEDED)
    q, u = static_equilibrium(kernel, np.zeros(kernel.n), u=lambda q: 1.0 - 50.0 * q)
    assert u == pytest.approx(1.0 - 50.0 * q)
    assert np.abs(kernel.forward_dynamics(q, np.zeros(kernel.n), u)).max() < 1e-8


def test_what_nothing_holds_is_named(built: Build) -> None:
    robot = oscillator(gravity=-9.81)
    loose = replace(robot, joints=(replace(robot.joints[0], coordinates={"x": Coordinate(10.0), "z": Coordinate()}),))
    with pytest.raises(IntegrationError, match=r"nothing holds slide\.z"):
        static_equilibrium(built(loose, *NEEDED), [0.0, 0.0])
    with pytest.raises(UnknownNameError, match=r"held: 'slide\.y' is unknown"):
        static_equilibrium(built(loose, *NEEDED), [0.0, 0.0], held=["slide.y"])
    with pytest.raises(ArrayError, match="u: expected forces of shape"):
        static_equilibrium(built(loose, *NEEDED), [0.0, 0.0], u=lambda _q: np.zeros(5), held=["slide.z"])


# Motions that cannot go on


def runaway(_t: float, q: np.ndarray, _v: np.ndarray) -> np.ndarray:
    """A drive that throws the mass to infinity in finite time."""
    return 1e3 * q**3


@pytest.mark.parametrize("method", ["rk4", "DOP853", "RK45", "Radau", "BDF", "LSODA"])
def test_divergence_names_coordinate_and_time(method: str, built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    with pytest.raises(IntegrationStopped, match=r"oscillator, t = 0\.\d+ s: .*slide\.z") as caught:
        integrate(kernel, [2.0], [0.0], 1.0, drive=runaway, method=method, step=1e-3)
    error = caught.value
    assert isinstance(error, IntegrationError)
    assert error.coordinate == "slide.z"
    assert 0.0 < error.t < 0.2
    assert np.isfinite(error.q).all()
    assert np.isfinite(error.v).all()
    assert error.q[0] > 2.0


def test_a_state_that_cannot_move_is_refused(built: Build) -> None:
    """A point mass on a revolute axis: nothing that the joint could turn."""
    robot = oscillator()
    point = replace(robot.links[0], inertia=(0.0,) * 6)
    joint = replace(robot.joints[0], type="revolute", coordinates={"gamma": Coordinate()})
    kernel = built(replace(robot, name="point_robot", links=(point,), joints=(joint,)), *NEEDED)
    with pytest.raises(SingularError, match=r"slide\.gamma"):
        integrate(kernel, [0.0], [0.0], 1.0)


def test_a_drive_that_fails_later(built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    with pytest.raises(IntegrationStopped, match=r"drive: slide\.z is nan at t = 0\.5"):
        integrate(kernel, [0.1], [0.0], 1.0, drive=lambda t, _q, _v: [np.nan if t > 0.5 else 0.0])
    with pytest.raises(ArrayError, match="drive: expected forces of shape"):
        integrate(kernel, [0.1], [0.0], 1.0, drive=lambda _t, _q, _v: [1.0, 2.0])
    with pytest.raises(ZeroDivisionError):
        integrate(kernel, [0.1], [0.0], 1.0, drive=lambda _t, _q, _v: [1 / 0])


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"method": "euler"}, "method: 'euler' is unknown; allowed: auto, Radau"),
        ({"duration": 0.0}, "duration: 0.0 s"),
        ({"duration": np.nan}, "duration: nan s"),
        ({"output_step": -1.0}, "output_step: -1.0 s"),
        ({"method": "rk4", "step": 0.0}, "step: 0.0 s"),
        ({"rtol": 0.0}, "rtol: 0.0; allowed"),
        ({"rtol": 2.0}, "rtol: 2.0; allowed"),
        ({"atol": -1.0}, "atol: "),
        ({"atol": [1.0, 1.0, 1.0]}, "atol: expected a number or shape"),
        ({"times": [0.0, 0.5, 0.4, 1.0]}, "times: allowed: two or more finite times, increasing"),
        ({"times": [1.0]}, "times: allowed: two or more"),
        ({"times": [0.0, 0.5]}, "times: end at 0.5 s; allowed: at the duration, 1 s"),
        ({"times": [0.0, 1.0], "output_step": 0.1}, "times and output_step are both given"),
        ({"q0": [0.0, 0.0]}, r"q0: expected float64 of shape \(1,\)"),
        ({"v0": [np.nan]}, "v0: slide.z is nan"),
        ({"v0": "fast"}, "v0: expected 1 numbers"),
    ],
)
def test_arguments_that_are_refused(changes: dict[str, object], text: str, built: Build) -> None:
    arguments: dict[str, object] = {"q0": [0.0], "v0": [0.0], "duration": 1.0, **changes}
    with pytest.raises(InputError, match=text):
        integrate(built(oscillator(), *NEEDED), **arguments)  # type: ignore[arg-type]


def test_single_precision_is_refused(built: Build) -> None:
    with pytest.raises(InputError, match="needs a float64 kernel"):
        integrate(built(oscillator(), *NEEDED, dtype="float32"), [0.0], [0.0], 1.0)


# Simulated motions


@pytest.fixture(scope="module")
def elastic() -> eomgen.SimulationResult:
    """The elastic PUMA on a short motion."""
    seen: list[float] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CFLAGS", "-O0")  # as in the tests
        result = simulate(eomgen.load_robot("puma560_elastic"), duration=0.8, progress=lambda f, text: seen.append(f))
    assert seen[-1] == 1.0
    assert seen == sorted(seen)
    assert len(seen) > 20
    return result


def test_the_elastic_puma(elastic: eomgen.SimulationResult) -> None:
    motion = elastic.trajectory
    assert motion.q.shape == (1001, 36)
    assert motion.method == "Radau"
    assert "implicit" in elastic.notes[0]
    assert elastic.program_coordinates == tuple(f"joint{i}.gamma" for i in range(1, 7))
    assert elastic.deviations.shape == (1001, 30)
    assert 20e-6 < np.linalg.norm(elastic.tool_deviation, axis=1).max() < 500e-6
    driven = np.array([name.endswith("gamma") for name in motion.coordinates])
    assert not motion.u[:, ~driven].any()
    assert np.abs(elastic.tracking_error).max() < 1e-4
    # in balance at the start: nothing rings
    kernel = eomgen.build(eomgen.load_robot("puma560_elastic"), kernels=("forward_dynamics",))
    assert not motion.v[0].any()
    assert np.abs(kernel.forward_dynamics(motion.q[0], motion.v[0], motion.u[0])).max() < 1e-9


def test_the_default_tolerance_is_tight_enough(elastic: eomgen.SimulationResult) -> None:
    tight = simulate(eomgen.load_robot("puma560_elastic"), duration=0.8, rtol=1e-8)
    error = np.linalg.norm(tight.pose[:, :3, 3] - elastic.pose[:, :3, 3], axis=1).max()
    assert error < 1e-3 * np.linalg.norm(tight.tool_deviation, axis=1).max()
    assert np.abs(tight.deviations - elastic.deviations).max() < 1e-3 * np.abs(tight.deviations).max()


def test_result_file(elastic: eomgen.SimulationResult, tmp_path: Path) -> None:
    path = elastic.save(tmp_path / "new" / "trajectory.npz")
    assert [entry.name for entry in path.parent.iterdir()] == ["trajectory.npz"]
    again = load_result(path)
    assert again.summary() == elastic.summary()
    assert again.summary_lines() == elastic.summary_lines()
    for name in ("t", "q", "v", "u", "energy"):
        assert (getattr(again.trajectory, name) == getattr(elastic.trajectory, name)).all()
    assert (again.pose == elastic.pose).all()
    json.dumps(again.summary(), allow_nan=False)
    with np.load(path) as data:  # readable without eomgen
        assert data["coordinates"][0] == "joint1.x"
        assert data["units"][:4].tolist() == ["m", "m", "m", "rad"]
        assert json.loads(str(data["meta"]))["versions"]["eomgen"] == eomgen.__version__
    path.write_bytes(path.read_bytes()[:5000])
    for bad in (path, tmp_path / "none.npz", Path(__file__)):
        with pytest.raises(InputError, match=bad.name):
            load_result(bad)
    with pytest.raises(InputError, match="cannot be written"):
        elastic.save(Path(__file__) / "trajectory.npz")


def test_plots(elastic: eomgen.SimulationResult, tmp_path: Path) -> None:
    written = plot_result(elastic, tmp_path / "plots")
    assert [path.name for path in written] == ["tool.png", "deviations.png", "tracking.png", "energy.png"]
    for path in written:
        assert path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
        assert path.stat().st_size > 20_000


def test_a_rigid_robot_has_no_deviations(tmp_path: Path) -> None:
    result = simulate(eomgen.load_robot("puma560"), duration=0.5, goal={"joint1": 0.2, "joint3.gamma": 1.0})
    assert result.trajectory.method == "DOP853"
    assert result.deviations.shape == (1001, 0)
    assert np.linalg.norm(result.tool_deviation, axis=1).max() < 1e-6
    end = dict(zip(result.program_coordinates, result.program_q[-1], strict=True))
    assert (end["joint1.gamma"], end["joint3.gamma"]) == (0.2, 1.0)
    assert result.summary()["linear_max"] is None
    assert [path.name for path in plot_result(result, tmp_path)] == [
        "tool.png",
        "tracking.png",
        "energy.png",
    ]


def test_free_joints_are_held_and_loose_coordinates_named() -> None:
    robot = elastic_arm()
    first = replace(robot.joints[0], type="free", coordinates={name: Coordinate() for name in COORDINATES})
    last = replace(robot.joints[1], coordinates={"x": Coordinate(), "z": Coordinate(1e4, 10.0), "gamma": Coordinate()})
    result = simulate(replace(robot, name="floating", joints=(first, last)), duration=0.2, goal=[0.1])
    assert np.abs(result.program_q[:, :6]).max() == 0.0
    assert any(note.startswith("free joint joint1") for note in result.notes)
    assert any(note.endswith("joint2.x") for note in result.notes)
    assert result.tool == "link2"


def test_default_motions_stay_inside_the_limits() -> None:
    for name in eomgen.builtin_robots():
        robot = eomgen.load_robot(name)
        if robot.loops:
            continue  # simulate refuses these
        rigid = robot.rigid()
        names = [
            f"{joint.name}.{key}"
            for joint in rigid.joints
            for key, coordinate in joint.coordinates.items()
            if not coordinate.prescribed
        ]
        motion = default_motion(robot, 1.0, names)
        for joint_name, begin, end in zip(names, motion.start, motion.goal, strict=True):
            low, high = robot.joint(joint_name.partition(".")[0]).limits or (-np.inf, np.inf)
            assert low < begin < high
            assert low < end < high
            assert begin != end


@pytest.mark.parametrize(
    ("limits", "start"),
    [((-1.0, 1.0), 0.0), ((1.0, 3.0), 1.2), ((-3.0, -1.0), -1.2), ((0.5, np.inf), None), ((-np.inf, -0.5), None)],
)
def test_default_motion_with_limits(limits: tuple[float, float], start: float | None) -> None:
    robot = eomgen.load_robot("one_link")
    robot = replace(robot, joints=(replace(robot.joints[0], limits=limits),))
    motion = default_motion(robot, 1.0, ["joint1.gamma"])
    assert limits[0] <= min(motion.start[0], motion.goal[0])
    assert max(motion.start[0], motion.goal[0]) <= limits[1]
    assert start is None or motion.start[0] == pytest.approx(start)
    assert motion.start[0] != motion.goal[0]


@pytest.mark.parametrize(
    ("options", "kind", "text"),
    [
        ({"goal": [1.0, 2.0]}, InputError, r"goal: expected 1 numbers \(joint1.gamma\), got 2"),
        ({"goal": 1.0}, InputError, "goal: expected 1 numbers"),
        ({"goal": {"joint2": 1.0}}, UnknownNameError, "goal: 'joint2' is no principal coordinate"),
        ({"goal": {"joint1.x": 1.0}}, UnknownNameError, "known: joint1.gamma"),
        ({"start": {"joint1": "far"}}, InputError, "start: joint1 = 'far' is not a number"),
        ({"start": [np.nan]}, InputError, "start: joint1.gamma = nan is not finite"),
        ({"goal": [2.0]}, InputError, "goal: joint1.gamma = 2 rad; its limits are -1 to 1 rad"),
        ({"duration": -1.0}, InputError, "duration: -"),
        ({"bandwidth": 0.0}, InputError, "bandwidth: 0.0 rad/s"),
        ({"method": "euler"}, InputError, "method: 'euler'"),
        ({"tool": "hand"}, UnknownNameError, "tool: 'hand' is unknown; known: tcp"),
    ],
)
def test_simulations_that_are_refused(options: dict[str, object], kind: type[Exception], text: str) -> None:
    robot = eomgen.load_robot("one_link")
    robot = replace(robot, joints=(replace(robot.joints[0], limits=(-1.0, 1.0)),))
    with pytest.raises(kind, match=text):
        simulate(robot, **options)  # type: ignore[arg-type]


def test_nothing_to_drive_is_said() -> None:
    robot = eomgen.load_robot("one_link")
    fixed = replace(robot.joints[0], type="fixed", coordinates={"x": Coordinate(1e4)})
    with pytest.raises(InputError, match="no joint has a principal coordinate"):
        simulate(replace(robot, name="no_drive", joints=(fixed,)))


# Optional libraries


def test_import_needs_neither_scipy_nor_matplotlib() -> None:
    code = """
import sys
import eomgen.simulation.run, eomgen.pictures.simulation
print([m for m in ('scipy', 'matplotlib') if m in sys.modules])"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_missing_libraries_are_named(
    built: Build, elastic: eomgen.SimulationResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("scipy", "matplotlib"):
        monkeypatch.setitem(sys.modules, name, None)
    kernel = built(oscillator(), *NEEDED)
    with pytest.raises(InputError, match=r'needs SciPy: pip install "eomgen\[sim\]"'):
        integrate(kernel, [0.1], [0.0], 0.1)
    with pytest.raises(InputError, match=r'need Matplotlib: pip install "eomgen\[sim\]"'):
        plot_result(elastic, tmp_path)
    assert integrate(kernel, [0.1], [0.0], 0.1, method="rk4").t[-1] == 0.1
