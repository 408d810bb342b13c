"""Sweeps against closed forms, SciPy's integrators and simulations; in other orders of work, and side by side."""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError
from eomgen.pipeline.cache import VARIABLE
from eomgen.robot import JointStiffness
from eomgen.robot.value import Robot
from eomgen.scenario.load import scenario_from_toml, scenario_from_values
from eomgen.simulation.result import SimulationResult
from eomgen.simulation.run import plan_of, run_scenario
from eomgen.sweep import job as jobs
from eomgen.sweep.contents import SampleRow
from eomgen.sweep.driver import KernelBundle, prepare, run, work
from eomgen.sweep.job import SampleRunner
from eomgen.sweep.plan import Plan, plan_from_toml
from eomgen.sweep.result import SweepResult
from eomgen.sweep.shipping import builds_of, pack, source_keys, unpack
from eomgen.sweep.store import ROWS, opened
from tests.support.commands import command
from tests.support.joint_table import frame_table, joint_table
from tests.support.optional import needs
from tests.support.refusals import refused
from tests.support.sliders import RELEASE, SLIDER, STIFF, slider
from tests.support.soak import soaked

pytestmark = [pytest.mark.usefixtures("unoptimised")]

ARM = f"""
name = "bending_arm"
links = [
  {{ name = "upper", mass = 3.0, com = [0.3, 0.0, 0.0], inertia = {{ xx = 0.01, yy = 0.1, zz = 0.1 }} }},
  {{ name = "fore", mass = 1.5, com = [0.2, 0.0, 0.0], inertia = {{ xx = 0.005, yy = 0.03, zz = 0.03 }} }},
]
{joint_table("shoulder", "base", "upper", "revolute")}
placement = {{ xyz = [0.0, 0.0, 0.5], rpy = [1.5707963, 0.0, 0.0] }}
alpha = {{ stiffness = 4e4, damping = 40.0 }}
{joint_table("elbow", "upper", "fore", "revolute")}
placement = {{ xyz = [0.6, 0.0, 0.0] }}
x = {{ stiffness = 5e5, damping = 500.0 }}
{frame_table("tcp", "fore", (0.4, 0.0, 0.0))}
"""
REACH_FILE = "duration = 0.4\n[motion]\ntype = 'point_to_point'\ngoal = { shoulder = 0.5, elbow = -0.4 }\n"
REACH = {"duration": 0.4, "motion": {"type": "point_to_point", "goal": {"shoulder": 0.5, "elbow": -0.4}}}
ARM_PLAN = """
samples = 40
seed = 5
design = "latin_hypercube"
record = ["tool_deviation_max", "drive_max", "coordinate_end", "reaction_max", "energy_residue"]
[[vary]]
parameter = "joints.shoulder.alpha.stiffness"
normal = { mean = 1.0, deviation = 0.2, low = 0.5, high = 1.5 }
relative = true
[[vary]]
parameter = "links.fore.mass"
uniform = { low = 1.0, high = 2.0 }
"""


def arm() -> Robot:
    return robot_from_toml(ARM)


@pytest.fixture(scope="module")
def without_wrappers() -> None:
    """Wrappers are compiled: other processes take what this one built."""


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> SweepResult:
    return run(arm(), REACH, plan_from_toml(ARM_PLAN), tmp_path_factory.mktemp("sweep") / "one", threads=1)


def same(a: SweepResult, b: SweepResult) -> bool:
    arrays = all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in ("index", "samples", "record"))
    return arrays and a.errors == b.errors


# What samples are


@pytest.mark.parametrize(("method", "tolerance"), [("auto", 1e-5), pytest.param("tsit5", 1e-5, marks=pytest.mark.soak)])
def test_a_mass_on_springs_of_many_stiffnesses(tmp_path: Path, method: str, tolerance: float) -> None:
    """q(T) = q0 exp(-d T) (cos w T + d/w sin w T), d = c / 2m, w^2 = k/m - d^2; also swept: c, m, q0 and T."""
    plan = plan_from_toml(
        "samples = 12\nrecord = ['coordinate_end']\n[engine]\ntype = 'rollout'\n"
        f"{STIFF}uniform = {{ low = 200.0, high = 2000.0 }}\n"
        "[[vary]]\nparameter = 'joints.rail.z.damping'\nuniform = { low = 0.0, high = 8.0 }\n"
        "[[vary]]\nparameter = 'links.mass.mass'\nnormal = { mean = 2.0, deviation = 0.3, low = 1.0 }\n"
        "[[vary]]\nscenario = 'initial.q.rail'\ngrid = { values = [0.1, -0.2] }\n"
        "[[vary]]\nscenario = 'duration'\ngrid = { low = 0.7, high = 0.9, count = 2 }\n"
    )
    result = run(slider(), {**RELEASE, "integrator": {"method": method}}, plan, tmp_path)
    assert result.index.size == 12 * 4
    assert not result.errors
    k, c, m, q0, T = result.samples.T
    d = c / (2.0 * m)
    w = np.sqrt(k / m - d**2)
    exact = q0 * np.exp(-d * T) * (np.cos(w * T) + d / w * np.sin(w * T))
    assert np.abs(result.of("coordinate_end.rail.z") - exact).max() < tolerance * 0.2


CONTROLS = {
    "computed_torque": {"control": {"type": "computed_torque", "bandwidth": 20.0}},
    "pd": {"control": {"type": "pd", "kp": 900.0, "kd": 60.0}},
    "pd with gravity": {"control": {"type": "pd", "kp": 400.0, "kd": 40.0, "gravity": True}},
    "loads": {
        "wrenches": [
            {"link": "fore", "force": [0.0, 15.0, 5.0], "axes": "link", "point": [0.4, 0, 0], "t0": 0.05, "t1": 0.125}
        ],
        "payloads": [{"link": "fore", "mass": 0.4, "point": [0.4, 0.0, 0.0], "t0": 0.1}],
    },
}


@pytest.mark.soak
@pytest.mark.parametrize("case", CONTROLS)
def test_rollouts_come_near_scipy(tmp_path: Path, case: str) -> None:
    scenario = {**REACH, "duration": 0.2, **CONTROLS[case]}
    change = "[[vary]]\nparameter = 'joints.shoulder.alpha.stiffness'\ngrid = { values = [2e4, 6e4] }\n"
    record = "record = ['tool_deviation_max', 'coordinate_end', 'drive_max']\n"
    check_beside_scipy(arm(), scenario, record + change, tmp_path)


def check_beside_scipy(robot: Robot, scenario: dict[str, object], plan: str, folder: Path) -> None:
    """Numbers of samples in C at the default tolerance beside those of SciPy's Radau at 1e-8."""
    found = []
    for engine, integrator in (("rollout", {}), ("integrate", {"method": "scipy:Radau", "rtol": 1e-8})):
        how = {**scenario, "integrator": integrator}
        result = run(robot, how, plan_from_toml(f"engine = {{ type = '{engine}' }}\n{plan}"), folder / engine)
        assert not result.errors
        found.append(result.record)
    assert np.abs(found[0] - found[1]).max() < 1e-4 * np.abs(found[1]).max()


@pytest.mark.parametrize(
    "control",
    [
        {"motion": REACH["motion"], "control": {"type": "computed_torque", "bandwidth": 20.0}},
        {"motion": REACH["motion"], "control": {"type": "pd", "kp": 300.0, "kd": 30.0}},
        {
            "initial": {"q": {"shoulder": 0.2}},
            "control": {"type": "torque", "coordinates": ["shoulder"], "rows": [[0.0, 0.1], [0.2, 0.3], [0.4, 0.2]]},
        },
    ],
    ids=["computed_torque", "pd", "torque"],
)
@pytest.mark.soak
def test_rollouts_drive_motors_as_scipy_does(tmp_path: Path, control: dict[str, object]) -> None:
    """Gears with backlash and friction, under all kinds of control."""
    change = "[[vary]]\nparameter = 'joints.shoulder.motor.stiffness'\ngrid = { values = [1e4, 4e4] }\n"
    plan = f"record = ['coordinate_end']\n{change}"
    check_beside_scipy(eomgen.load_robot("geared_arm"), {"duration": 0.15, **control}, plan, tmp_path)


LIMITED = "gamma = { limits = { velocity = 1.5, effort = 44.0 } }\nalpha = { stiffness = 4e4"


@pytest.mark.parametrize("saturate", [False, True])
def test_sweeps_say_which_limits_samples_exceed(tmp_path: Path, saturate: bool) -> None:
    """As the samples' motions do; drives that are clipped stay within theirs."""
    robot = robot_from_toml(ARM.replace("alpha = { stiffness = 4e4", LIMITED))
    scenario = {**REACH, "control": {"type": "computed_torque", "saturate": saturate}}
    change = "[[vary]]\nparameter = 'gravity.z'\ngrid = { values = [-9.81, -0.1] }\n"
    plan = plan_from_toml(f"engine = {{ type = 'rollout' }}\nrecord = ['coordinate_max']\n{change}")
    result = run(robot, scenario, plan, tmp_path)
    assert not result.errors
    job, _, _ = prepare(robot, scenario, plan)
    counts: dict[str, int] = {}
    for outcome in SampleRunner(job).motions(result.samples.tolist()):
        assert isinstance(outcome, SimulationResult)
        motion = outcome.trajectory
        assert outcome.links == tuple(link.name for link in robot.links)
        place = motion.coordinates.index("shoulder.gamma")
        for kind, x, limit in (("speed", motion.v, 1.5), ("effort", motion.u, 44.0)):
            if np.abs(x[:, place]).max() > limit * (1.0 + 1e-6):
                counts[f"shoulder.gamma {kind}"] = counts.get(f"shoulder.gamma {kind}", 0) + 1
    assert dict(result.exceeded) == counts
    assert counts["shoulder.gamma speed"] == 2
    assert ("shoulder.gamma effort" in counts) == (not saturate)
    assert any("exceed limits of the robot: shoulder.gamma speed in 2" in line for line in result.lines())
    assert result.as_dict()["exceeded"] == counts


@pytest.mark.soak
def test_samples_are_robots_of_their_own(tmp_path: Path, swept: SweepResult) -> None:
    """A sample's numbers are those of a simulation of a robot whose description says so; drives keep their model."""
    plan = plan_from_toml(
        "record = ['tool_deviation_max', 'drive_max', 'reaction_max', 'coordinate_end']\n[engine]\ntype = 'integrate'\n"
        "[[vary]]\nparameter = 'joints.shoulder.alpha.stiffness'\ngrid = { values = [1.5e4] }\n"
    )
    result = run(arm(), REACH, plan, tmp_path)
    changed = robot_from_toml(ARM.replace("stiffness = 4e4", "stiffness = 1.5e4"))
    single = run_scenario(changed, scenario_from_toml(REACH_FILE))
    deviation = np.linalg.norm(single.tool_deviation, axis=1).max()
    assert result.of("tool_deviation_max")[0] == pytest.approx(deviation, rel=1e-6)
    u = np.abs(single.trajectory.u).max(axis=0)[single.trajectory.coordinates.index("elbow.gamma")]
    assert result.of("drive_max.elbow.gamma")[0] == pytest.approx(u, rel=1e-6)
    kernel, motion = eomgen.build(changed), single.trajectory
    a = kernel.forward_dynamics(motion.q, motion.v, motion.u)
    force = np.linalg.norm(kernel.reactions(motion.q, motion.v, a)[:, 0, :3], axis=1).max()
    assert result.of("reaction_max.shoulder.force")[0] == pytest.approx(force, rel=1e-6)
    assert swept.of("energy_residue").max() < 0.02


@pytest.mark.soak
def test_drives_keep_the_nominal_model(tmp_path: Path) -> None:
    """A heavier forearm sags under drives that do not know of it, until they give what it needs."""
    deviations = ("alpha = { stiffness = 4e4, damping = 40.0 }\n", "x = { stiffness = 5e5, damping = 500.0 }\n")
    text = ARM.replace(deviations[0], "").replace(deviations[1], "")
    plan = plan_from_toml(
        "record = ['tracking_max', 'coordinate_end']\n[[vary]]\nparameter = 'links.fore.mass'\n"
        "grid = { values = [1.0, 2.0] }\nrelative = true\n"
    )
    scenario = {"duration": 0.5, "control": {"type": "computed_torque", "bandwidth": 10.0}}
    result = run(robot_from_toml(text), scenario, plan, tmp_path)
    assert result.of("tracking_max.elbow.gamma")[0] < 1e-9
    assert result.of("tracking_max.elbow.gamma")[1] > 1e-3
    kernel, heavy = (eomgen.build(robot_from_toml(text.replace("mass = 1.5", f"mass = {m}"))) for m in (1.5, 3.0))
    q = np.array([result.of(f"coordinate_end.{name}")[1] for name in kernel.coordinates])
    zero = np.zeros(2)
    needed = heavy.inverse_dynamics(q, zero, zero)
    assert kernel.inverse_dynamics(q, zero, -100.0 * q) == pytest.approx(needed, abs=1e-6)


# Who does what when


@pytest.mark.soak
def test_threads_change_nothing(tmp_path: Path, swept: SweepResult) -> None:
    assert not swept.errors
    assert swept.complete
    assert same(swept, run(arm(), REACH, plan_from_toml(ARM_PLAN), tmp_path, threads=8))


def _cannot_derive(folder: str) -> None:
    """A worker with a cache of its own, and without SymPy."""
    os.environ[VARIABLE] = folder
    sys.modules["sympy"] = None


def workers(count: int, folder: Path) -> ProcessPoolExecutor:
    """Fresh processes that find nothing in their cache, and can derive nothing."""
    fresh = {"mp_context": get_context("spawn"), "initializer": _cannot_derive, "initargs": (str(folder),)}
    return ProcessPoolExecutor(count, **fresh)


@pytest.mark.soak
def test_processes_that_get_their_kernels_sent(tmp_path: Path, swept: SweepResult) -> None:
    """Workers with an empty cache: source and binary travel, nobody derives or compiles."""
    empty = tmp_path / "cache"
    with workers(2, empty) as pool:
        result = run(arm(), REACH, plan_from_toml(ARM_PLAN), tmp_path / "sweep", executor=pool)
    assert same(swept, result)
    own = Path(os.environ[VARIABLE])
    for package in (empty / "packages").iterdir():
        for path in package.glob("*.so"):
            assert path.read_bytes() == (own / "packages" / package.name / path.name).read_bytes()
    assert any((empty / "packages").iterdir())


@pytest.mark.soak
def test_dask_changes_nothing(tmp_path: Path, swept: SweepResult) -> None:
    distributed = needs("distributed")
    local = {"n_workers": 2, "threads_per_worker": 2, "dashboard_address": None, "worker_dashboard_address": None}
    with (
        distributed.LocalCluster(**local) as cluster,
        distributed.Client(cluster) as client,
        client.get_executor() as executor,
    ):
        assert same(swept, run(arm(), REACH, plan_from_toml(ARM_PLAN), tmp_path, executor=executor))


@pytest.mark.soak
def test_other_machines_compile_what_they_are_sent(tmp_path: Path) -> None:
    """Where the C library is another one the binary is left out, and SymPy is not asked."""
    plan = f"samples = 2\nrecord = ['coordinate_end']\n{STIFF}uniform = {{ low = 300.0, high = 900.0 }}\n"
    job, design, _ = prepare(slider(), RELEASE, plan_from_toml(plan))
    builds = builds_of(job.robot, job.scenario(), job.kernels(job.scenario()))
    keys, samples = source_keys(builds), [design.values(i) for i in range(2)]
    expected = work(KernelBundle(job, builds, keys), None, [0, 1], samples)
    content = pickle.loads(pickle.dumps(pack(builds)))
    assert {kind for kind, _ in content.entries} == {"sources", "packages"}
    foreign = replace(content, machine=("Linux", "x86_64", "glibc", "2.0"))
    with workers(1, tmp_path) as pool:
        pool.submit(unpack, foreign, builds, keys).result()
        assert not (tmp_path / "packages").exists()
        assert pool.submit(work, KernelBundle(job, builds, keys), None, [0, 1], samples).result() == expected
    assert any((tmp_path / "packages").iterdir())
    refused(InputError, "another one", unpack, content, builds, ("0" * 64,))


@pytest.mark.soak
def test_a_killed_sweep_goes_on(tmp_path: Path, swept: SweepResult) -> None:
    """SIGKILL in the middle: what was done stays, byte by byte, and the rest is added."""
    (tmp_path / "arm.toml").write_text(ARM)
    (tmp_path / "plan.toml").write_text(ARM_PLAN.replace("samples = 40", "samples = 100"))
    (tmp_path / "reach.toml").write_text(REACH_FILE)
    out = tmp_path / "out"
    command = [sys.executable, "-m", "eomgen", "sweep", "arm.toml", "--scenario", "reach.toml", "--plan", "plan.toml"]
    command += ["-o", "out", "--threads", "2", "--no-plots"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL)
    while not (out / ROWS).exists() or (out / ROWS).stat().st_size < 4000:
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    before = (out / ROWS).read_bytes()
    half = SweepResult.load(out)
    assert 0 < half.index.size < 100
    assert not half.complete
    (out / ROWS).write_bytes(before + b'{"index": 99, "sam')  # what a writer leaves that dies within a line
    subprocess.run(command, cwd=tmp_path, check=True, stdout=subprocess.DEVNULL)
    after = (out / ROWS).read_bytes()
    assert after.startswith(before)
    whole = SweepResult.load(out)
    assert whole.complete
    assert len(after.splitlines()) == 100
    plan = plan_from_toml((tmp_path / "plan.toml").read_text())
    assert same(whole, run(arm(), tmp_path / "reach.toml", plan, tmp_path / "fresh"))


def test_an_interrupt_keeps_what_is_done(tmp_path: Path) -> None:
    plan = plan_from_toml(ARM_PLAN)

    def stop(fraction: float, text: str) -> None:
        if fraction > 0.3:
            assert "per s" in text
            assert "s left" in text
            raise KeyboardInterrupt

    refused(KeyboardInterrupt, "", run, arm(), REACH, plan, tmp_path, threads=2, progress=stop)
    some = SweepResult.load(tmp_path)
    assert 0 < some.index.size < 40
    asked: list[int] = []
    run(arm(), REACH, plan, tmp_path, threads=1, progress=lambda fraction, text: asked.append(int(fraction * 40)))
    assert asked[1] == some.index.size  # after "preparing": it begins where the other ended
    assert SweepResult.load(tmp_path).complete


def test_folders_of_something_else_are_refused(tmp_path: Path) -> None:
    plan = plan_from_toml(f"record = ['coordinate_end']\n{STIFF}grid = {{ values = [300.0, 400.0] }}\n")
    run(slider(), RELEASE, plan, tmp_path / "a")
    with pytest.raises(InputError, match="another plan, scenario or robot"):
        run(slider(), {**RELEASE, "duration": 0.8}, plan, tmp_path / "a")
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "letter.txt").write_text("dear")
    refused(InputError, "holds no sweep", run, slider(), RELEASE, plan, tmp_path / "b")
    refused(InputError, "holds no sweep", SweepResult.load, tmp_path / "b")
    manifest = json.loads((tmp_path / "a" / "sweep.json").read_text())
    with opened(tmp_path / "a", manifest), pytest.raises(InputError, match="another process"):
        run(slider(), RELEASE, plan, tmp_path / "a")


@pytest.mark.parametrize("engine", [pytest.param("integrate", marks=pytest.mark.soak), "rollout"])
def test_entries_of_matrices_vary(engine: str, tmp_path: Path) -> None:
    """Samples are simulations of robots of these numbers; one whose matrix is indefinite fails by its name alone."""
    robot = arm()
    matrix = JointStiffness({"x.x": 5e5, "x.gamma": 100.0, "gamma.gamma": 50.0})
    robot = replace(robot, joints=(robot.joints[0], replace(robot.joints[1], stiffness=matrix)))
    key = "joints.elbow.stiffness.x.gamma"
    plan = f"record = ['coordinate_end']\n[engine]\ntype = '{engine}'\n[[vary]]\nparameter = '{key}'\n"
    plan += "grid = { values = [-4000.0, 6000.0, 100.0, 4000.0] }\n"
    result = run(robot, REACH, plan_from_toml(plan), tmp_path)
    assert list(result.errors) == [1]
    assert "joints.elbow.stiffness" in result.errors[1]
    ends = []
    for i in (0, 2, 3):
        entries = {**matrix.entries, "x.gamma": float(result.samples[i, 0])}
        joint = replace(robot.joints[1], stiffness=JointStiffness(entries))
        scenario = scenario_from_values(REACH, source="scenario", folder=Path())
        motion = run_scenario(replace(robot, joints=(robot.joints[0], joint)), scenario).trajectory
        found = [result.of(f"coordinate_end.{name}")[i] for name in motion.coordinates]
        ends.append(motion.q[-1])
        assert found == pytest.approx(motion.q[-1].tolist(), rel=1e-2, abs=1e-6)
    assert np.ptp(ends, axis=0).max() > 1e-4


# Samples that fail


def test_failed_samples_do_not_stop_the_rest(tmp_path: Path) -> None:
    """One parameter is refused, one scenario value is, and one motion cannot go on; their rows say so."""
    plan = plan_from_toml(
        "record = ['coordinate_end']\n"
        f"{STIFF}grid = {{ values = [-5.0, 500.0, 9e29] }}\n"
        "[[vary]]\nscenario = 'duration'\ngrid = { values = [-1.0, 0.2, 0.3] }\n"
    )
    result = run(slider(), RELEASE, plan, tmp_path, threads=2)
    assert sorted(result.errors) == [0, 1, 2, 3, 6, 7, 8]
    assert "negative" in result.errors[1]
    assert "duration" in result.errors[3]
    assert "rail.z" in result.errors[7]
    expected = 0.1 * np.cos(np.sqrt(250.0) * np.array([0.2, 0.3]))
    assert result.of("coordinate_end.rail.z")[[4, 5]] == pytest.approx(expected, rel=1e-4)
    assert np.isnan(result.of("coordinate_end.rail.z")[7])
    assert "7 failed" in result.lines()[0]


def test_neighbours_of_a_failure_are_as_without_it(tmp_path: Path) -> None:
    """Samples of one batch: those that cannot go on change nothing of the others."""
    plan = "record = ['coordinate_end', 'tool_deviation_max']\n" + STIFF
    alone = run(slider(), RELEASE, plan_from_toml(plan + "grid = { values = [300.0, 700.0] }\n"), tmp_path / "a")
    more = plan_from_toml(plan + "grid = { values = [8e29, 300.0, 9e29, 700.0] }\n")
    among = run(slider(), RELEASE, more, tmp_path / "b")
    assert sorted(among.errors) == [0, 2]
    assert (among.record[[1, 3]] == alone.record).all()


def test_processes_on_the_command_line(tmp_path: Path) -> None:
    """The same table as with threads; one way at a time."""
    plan = "samples = 5\nrecord = ['coordinate_end']\n" + STIFF + "uniform = { low = 500.0, high = 900.0 }\n"
    scenario = "duration = 0.1\n[initial]\nq = { rail = 0.1 }\n"
    for name, text in (("r.toml", SLIDER), ("s.toml", scenario), ("p.toml", plan)):
        (tmp_path / name).write_text(text, encoding="ascii")
    words = (
        "sweep",
        tmp_path / "r.toml",
        "--scenario",
        tmp_path / "s.toml",
        "--plan",
        tmp_path / "p.toml",
        "--no-plots",
    )
    for way in ("threads", "processes"):
        command(*words, f"--{way}", 2, "-o", tmp_path / way)
    assert same(*(SweepResult.load(tmp_path / way) for way in ("threads", "processes")))
    said = command(*words, "--threads", 2, "--processes", 2, "-o", tmp_path / "x", code=1)
    assert "--threads and --processes are given together" in said
    assert "--processes: 0" in command(*words, "--processes", 0, "-o", tmp_path / "x", code=1)


# Side by side


HEAD = "seed = 5\nengine = { type = 'integrate' }\n"
COMPANY_PLAN = f"""{HEAD}
samples = 19
record = ["tool_deviation_max", "tool_rotation_max", "drive_max", "tracking_max", "coordinate_end", "reaction_max"]
[[vary]]
parameter = "joints.shoulder.alpha.stiffness"
normal = {{ mean = 1.0, deviation = 0.3, low = 0.2, high = 2.0 }}
relative = true
[[vary]]
parameter = "links.fore.mass"
uniform = {{ low = 0.3, high = 2.0 }}
"""
PUSHED = {"wrenches": CONTROLS["loads"]["wrenches"]}
CASES = {
    "computed torque": {**REACH, "duration": 0.1},
    "pd": {**REACH, "duration": 0.1, **CONTROLS["pd"]},
    "wrenches": {**REACH, "duration": 0.15, **PUSHED},
    "tsit5": {**REACH, "duration": 0.1, "integrator": {"method": "tsit5", "rtol": 1e-8}},
}
MASS = (
    f"{HEAD}samples = 9\nrecord = ['coordinate_end', 'coordinate_max']\n{STIFF}uniform = {{ low = 90, high = 900 }}\n"
)


def rows_of(robot: Robot, scenario: dict[str, Any], plan: Plan) -> tuple[SampleRunner, list[list[float]]]:
    job, design, _ = prepare(robot, scenario, plan)
    return SampleRunner(job), [list(design.values(i)) for i in range(len(design))]


def check_company(runner: SampleRunner, samples: list[list[float]], monkeypatch: pytest.MonkeyPatch) -> list[SampleRow]:
    """Rows of all samples, which are those of some of them, in other orders, and of each by itself in Python's loop."""
    indices = list(range(len(samples)))
    whole = runner.rows(indices, samples)
    for some in (indices[::-2], indices[3:5], indices[:1]):
        assert runner.rows(some, [samples[i] for i in some]) == [whole[i] for i in some]
    monkeypatch.setattr(jobs, "may_run_side_by_side", lambda *_: False)
    assert runner.rows(indices, samples) == whole
    return whole


@pytest.mark.parametrize("case", soaked(CASES, ("computed torque", "pd", "tsit5")))
def test_samples_are_what_they_are_alone(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    runner, samples = rows_of(arm(), CASES[case], plan_from_toml(COMPANY_PLAN))
    scenario, assembly = runner.nominal(())
    assert jobs.may_run_side_by_side(assembly, plan_of(assembly, scenario))
    found = check_company(runner, samples, monkeypatch)
    assert not any(row.error for row in found)
    assert len({row.record for row in found}) == len(found)
    (outcome,) = runner.outcomes(samples[:1])
    assert isinstance(outcome, jobs.Outcome)
    drives = [column.name for column in outcome.columns if column.name.startswith("drive_max")]
    assert drives == [f"drive_max.{name}" for name in assembly.driven], "in the order of the coordinates"


def test_masses_that_are_picked_up_and_samples_that_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parameters that change on the way; errors are those of the sample alone."""
    picked = {"link": "mass", "mass": 1.0, "point": [0.0, 0.0, 0.0], "t0": 0.13, "t1": 0.4}
    runner, samples = rows_of(slider(), {**RELEASE, "payloads": [picked]}, plan_from_toml(MASS))
    samples[4] = [1e300]
    found = check_company(runner, samples, monkeypatch)
    assert [bool(row.error) for row in found] == [i == 4 for i in range(9)]
    assert "rail.z" in found[4].error


@pytest.mark.soak
def test_loops_are_closed_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    text = f"{HEAD}samples = 11\nrecord = ['drive_max', 'coordinate_end']\n[[vary]]\nparameter = 'links.crank.mass'\n"
    plan = plan_from_toml(text + "normal = { mean = 1.0, deviation = 0.3, low = 0.2 }\nrelative = true\n")
    scenario = {"duration": 0.2, "motion": {"type": "point_to_point"}, "control": {"type": "pd", "kp": 50, "kd": 2}}
    runner, samples = rows_of(eomgen.load_robot("four_bar"), scenario, plan)
    assert not any(row.error for row in check_company(runner, samples, monkeypatch))


@pytest.mark.soak
def test_threads_and_processes_change_nothing(tmp_path: Path) -> None:
    plan, scenario = plan_from_toml(COMPANY_PLAN.replace("samples = 19", "samples = 37")), CASES["computed torque"]
    one = run(arm(), scenario, plan, tmp_path / "one", threads=1)
    assert not one.errors
    assert same(one, run(arm(), scenario, plan, tmp_path / "three", threads=3))
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        assert same(one, run(arm(), scenario, plan, tmp_path / "processes", executor=pool))


# Closed mechanisms


BARS = """
samples = 2
seed = 5
record = ["drive_max", "coordinate_end"]
[engine]
type = "rollout"
[[vary]]
parameter = "links.crank.mass"
normal = { mean = 1.0, deviation = 0.2 }
relative = true
"""
TURN = {"duration": 0.05, "motion": {"type": "point_to_point"}}


@pytest.mark.soak
def test_samples_of_a_four_bar_are_simulations(tmp_path: Path) -> None:
    result = run("four_bar", TURN, plan_from_toml(BARS), tmp_path)
    robot = eomgen.load_robot("four_bar")
    crank = robot.link("crank")
    for i, (mass,) in enumerate(result.samples.tolist()):
        scaled = replace(robot, links=tuple(replace(x, mass=mass) if x is crank else x for x in robot.links))
        alone = run_scenario(scaled, scenario_from_values(TURN, source="scenario", folder=Path()))
        ends = [result.of(f"coordinate_end.{name}")[i] for name in alone.trajectory.coordinates]
        assert ends == pytest.approx(alone.trajectory.q[-1].tolist(), rel=2e-2, abs=1e-9)
