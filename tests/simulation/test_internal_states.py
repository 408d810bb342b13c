"""Simulations of robots whose laws have states, and of mixtures: beginnings, pieces, files, streams, sweeps, stops."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError, IntegrationStopped
from eomgen.motion import read_motion
from eomgen.robot.value import Robot
from eomgen.scenario import scenario_from_toml
from eomgen.scenario.recorded import scenario_from_record
from eomgen.simulation.result import SimulationResult, simulated_robot
from eomgen.simulation.run import plan_of, run_scenario
from eomgen.sweep import job as jobs
from eomgen.sweep.driver import prepare
from eomgen.sweep.job import SampleRunner
from eomgen.sweep.plan import plan_from_toml
from tests.support.bending_mixtures import mixture
from tests.support.bristles import block, gear_text
from tests.support.joint_table import frame_table, joint_table, link_table
from tests.support.optional import needs
from tests.support.random_robots import seeds
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")

BRISTLES = 'model = "lugre", coulomb = {}, static = {}, stribeck = 0.01, bristle_stiffness = 1e4, bristle_damping = 1.0'
NAMES = ("shoulder.gamma.friction.z", "elbow.beta.friction.z", "elbow.gamma.friction.z")
PUSHED = """
duration = 0.2
output_step = 2e-3
[initial]
equilibrium = false
q = { shoulder = 0.2, elbow = -0.4 }
z = { shoulder.friction.z = 3e-5, "elbow.beta.friction.z" = -2e-5 }
[control]
type = "pd"
kp = 50.0
kd = 5.0
[[wrenches]]
link = "fore"
force = [0.0, 20.0, 0.0]
t0 = 0.05
t1 = 0.11
"""


@pytest.fixture(scope="module")
def robot() -> Robot:
    """Two links with bristles, also in a deviation of the second joint."""
    beta = f"beta = {{ stiffness = 2e3, damping = 2.0, friction = {{ {BRISTLES.format(0.2, 0.3)} }} }}"
    gamma = f"gamma = {{ friction = {{ {BRISTLES.format(0.5, 0.7)} }} }}"
    text = 'name = "bristled"\ngravity = [0.0, -9.81, 0.0]\n'
    laws = ("upper", "shoulder", "base", gamma), ("fore", "elbow", "upper", f"{beta}\n{gamma}")
    for link, joint, parent, law in laws:
        text += f"""
{link_table(link, 1.0, (0.2, 0.0, 0.0), (0.01, 0.02, 0.02))}
{joint_table(joint, parent, link, "revolute")}
placement = {{ xyz = [0.3, 0.0, 0.0] }}
{law}
"""
    return robot_from_toml(text + frame_table("tcp", "fore", (0.4, 0.0, 0.0)))


@pytest.fixture(scope="module")
def result(robot: Robot) -> SimulationResult:
    return run_scenario(robot, scenario_from_toml(PUSHED))


def test_beginnings_and_pieces(result: SimulationResult, robot: Robot) -> None:
    """States begin where the scenario says, go on where a wrench sets in, and the energies balance."""
    motion = result.trajectory
    assert motion.internal_states == NAMES
    assert motion.z[0].tolist() == [3e-5, -2e-5, 0.0]
    assert (np.abs(np.diff(motion.z, axis=0)).max(axis=0) < 1e-4).all()
    assert result.balance.relative_residue < 1e-4
    exact = scenario_from_toml(PUSHED + "[integrator]\nmethod = 'scipy:DOP853'\nrtol = 1e-8\n")
    other = run_scenario(robot, exact).trajectory
    assert motion.q == pytest.approx(other.q, abs=1e-5)
    assert motion.z == pytest.approx(other.z, abs=1e-7)
    scenario = scenario_from_record(result.scenario, "here")
    assert dict(scenario.initial.z) == {"shoulder.friction.z": 3e-5, "elbow.beta.friction.z": -2e-5}


def test_series_tables_and_files(result: SimulationResult, tmp_path: Path) -> None:
    motion, name = result.trajectory, NAMES[1]
    series = result.series(name)
    assert (series.unit, series.values.tolist()) == ("rad", motion.z[:, 1].tolist())
    assert set(NAMES) <= set(result.names)
    assert (motion.of(name) == series.values).all()
    for rows in (result.as_rows(), motion.as_rows()):
        column = next(column for column in rows.columns if column.name == name)
        assert (column.unit, column.values.tolist()) == ("rad", series.values.tolist())
    again = eomgen.load_result(result.save(tmp_path / "motion.npz"))
    assert again.trajectory.internal_states == NAMES
    assert again.series(name).values.tolist() == series.values.tolist()
    older = {"internal_states": "memory", "internal_state_units": "memory_units"}  # names in files of older versions
    with np.load(tmp_path / "motion.npz") as arrays:
        np.savez(tmp_path / "older.npz", **{older.get(key, key): arrays[key] for key in arrays.files})
    assert eomgen.load_result(tmp_path / "older.npz").trajectory.internal_states == NAMES
    assert set(read_motion(tmp_path / "older.npz", motion.coordinates).states) == set(NAMES)
    assert simulated_robot(again).name == "bristled"
    refused(InputError, r"elbow\.gamma\.friction\.z", motion.of, "elbow.gamma.friction.y")
    with np.load(tmp_path / "motion.npz") as archive:
        arrays = dict(archive)
    for key, value, said in (
        ("internal_states", np.array(["a.x.friction.z", *NAMES[1:]]), "array internal_states"),
        ("internal_states", np.array(["elbow.gamma", *NAMES[1:]]), "array internal_states"),
        ("internal_states", np.array([*NAMES[:2], NAMES[1]]), "array internal_states"),
        ("internal_state_units", np.array(["rad", "<b>", "rad"]), "internal_state_units"),
        ("z", arrays["z"][:, :2], "array z"),
        ("z", np.where(arrays["z"] == 0.0, np.nan, arrays["z"]), "array z"),
        ("z", None, "internal_states, internal_state_units and z"),
    ):
        changed = {**arrays, key: value}
        np.savez(tmp_path / "bad.npz", **{name: x for name, x in changed.items() if x is not None})
        refused(InputError, said, eomgen.load_result, tmp_path / "bad.npz")


def test_states_of_followers_are_kept(tmp_path: Path) -> None:
    """A gear's follower has bristles, and is no coordinate."""
    law = f"friction = {{ {BRISTLES.format(0.2, 0.3)} }}"
    result = run_scenario(robot_from_toml(gear_text(law)), scenario_from_toml("duration = 0.01"))
    again = eomgen.load_result(result.save(tmp_path / "motion.npz")).trajectory
    assert again.internal_states == ("j1.gamma.friction.z", "j2.gamma.friction.z")
    assert again.coordinates == ("j1.gamma",)


def test_streams_have_states(result: SimulationResult, robot: Robot, tmp_path: Path) -> None:
    needs("zarr")
    motion = run_scenario(robot, scenario_from_toml(PUSHED), stream=tmp_path / "run.zarr").trajectory
    found = eomgen.load_stream(tmp_path / "run.zarr")
    assert found.complete
    assert found.internal_states == NAMES
    for name in ("t", "q", "v", "z"):
        assert np.array_equal(getattr(found, name), getattr(motion, name)), name
    assert found.series(NAMES[0]).values.tolist() == result.series(NAMES[0]).values.tolist()
    refused(InputError, r"elbow\.gamma\.friction\.z", found.series, "friction.z")
    attributes = tmp_path / "run.zarr" / "zarr.json"
    attributes.write_text(attributes.read_text().replace("shoulder.gamma.friction.z", "shoulder.gamma"))
    refused(InputError, "attributes: internal_states", eomgen.load_stream, tmp_path / "run.zarr")


def test_equilibria_keep_states(robot: Robot) -> None:
    """Bristles that are bent push where the static equilibrium is looked for, and stay bent: what is found rests."""
    initial = 'equilibrium = true\nheld = ["shoulder", "elbow"]\nz = { elbow.beta.friction.z = 1e-5 }\n'
    motion = run_scenario(robot, scenario_from_toml(f"duration = 0.01\n[initial]\n{initial}")).trajectory
    assert motion.z[0].tolist() == [0.0, 1e-5, 0.0]
    beta = motion.of("elbow.beta")
    assert beta[0] == pytest.approx(-0.1 / 2e3, rel=1e-6)  # 1e4 N m/rad bristles against 2e3 N m/rad
    pushed = scenario_from_toml(PUSHED.replace("equilibrium = false\n", ""))
    assert run_scenario(robot, pushed).trajectory.of(NAMES[0])[0] == 3e-5


@pytest.mark.parametrize(
    ("z", "said"),
    [
        ("elbow.friction.y = 1.0", r"initial\.z\.elbow\.friction\.y: no state of that name.*elbow\.friction\.z"),
        ("elbow.friction.z = 1.0, elbow.gamma.friction.z = 1.0", "stands twice"),
        ("wrist.friction.z = 1.0", "no state of that name"),
    ],
)
def test_states_of_no_law_are_refused(z: str, said: str, robot: Robot) -> None:
    refused(InputError, said, run_scenario, robot, scenario_from_toml(f"duration = 0.1\n[initial]\nz = {{ {z} }}\n"))


def test_motions_end_at_a_state(robot: Robot) -> None:
    text = f'{PUSHED}[until]\ncoordinate = "{NAMES[2]}"\nvalue = 2e-5\n'
    motion = run_scenario(robot, scenario_from_toml(text)).trajectory
    assert motion.t[-1] < 0.2
    assert motion.of(NAMES[2])[-1] == pytest.approx(2e-5, rel=1e-9)


@pytest.mark.parametrize("step", [1e-4, 1e-3])
def test_what_stops_a_motion_is_kept(step: float, tmp_path: Path) -> None:
    """The block at 1 m/s by rk4 with steps that are too long for its bristles."""
    fast = "duration = 0.01\noutput_step = 0.002\n[initial]\nv = { slide.z = 1.0 }\n"
    text = f'{fast}[integrator]\nmethod = "rk4"\nstep = {step}\n'
    with pytest.raises(IntegrationStopped, match=r"slide\.z\.friction\.z is .* cannot exceed") as caught:
        run_scenario(block(), scenario_from_toml(text))
    stop: IntegrationStopped = caught.value
    assert (len(stop.q), len(stop.v), len(stop.z)) == (1, 1, 1)
    stopped = eomgen.load_result(stop.result.save(tmp_path / "stopped.npz"))
    assert stopped.stopped["coordinate"] == "slide.z.friction.z"
    assert stopped.stopped["z"] == [0.0]
    assert run_scenario(block(), scenario_from_toml(text.replace(f"step = {step}\n", ""))).trajectory.z is not None


PLAN = """
samples = 5
seed = 1
engine = { type = "integrate" }
record = ["state_max", "state_end", "coordinate_end", "reaction_max"]
[[vary]]
parameter = "joints.elbow.gamma.friction.coulomb"
uniform = { low = 0.3, high = 0.6 }
[[vary]]
scenario = "initial.z.shoulder.friction.z"
uniform = { low = 0.0, high = 3e-5 }
"""


def test_sweeps_record_states(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Side by side as alone, to the bit."""
    scenario = {
        "duration": 0.05,
        "initial": {"q": {"shoulder": 0.2}, "z": {"shoulder": {"friction": {"z": 1e-5}}}, "equilibrium": False},
        "control": {"type": "pd", "kp": 50.0, "kd": 5.0},
    }
    job, design, _ = prepare(robot, scenario, plan_from_toml(PLAN))
    runner, samples = SampleRunner(job), [list(design.values(i)) for i in range(len(design))]
    chosen, assembly = runner.nominal(())
    assert jobs.may_run_side_by_side(assembly, plan_of(assembly, chosen))
    whole = runner.rows(list(range(5)), samples)
    assert not any(row.error for row in whole)
    assert len({row.record for row in whole}) == 5
    monkeypatch.setattr(jobs, "may_run_side_by_side", lambda *_: False)
    assert runner.rows(list(range(5)), samples) == whole
    plain = 'record = ["state_max"]\n[[vary]]\nparameter = "gravity.y"\ngrid = { values = [1.0] }'
    refused(InputError, "state_max: no law has a state", prepare, "one_link", {"duration": 0.1}, plan_from_toml(plain))


def test_summaries_say_where_bristles_hold(robot: Robot) -> None:
    text = "duration = 0.3\n[initial]\nq = { shoulder = -1.5707963, elbow = 0.0 }\n"
    result = run_scenario(robot, scenario_from_toml(text))
    assert any("friction of elbow.gamma: held it" in line for line in result.summary_lines())


MIXED = """
duration = 0.05
[control]
type = "none"
[integrator]
method = "{}"
rtol = 1e-7
"""
FREE = ("laws", "motors", "offsets", "followers", "springs", "bushings")  # a motion that nobody has to describe


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(900, 0, 24))
def test_energies_balance_and_results_are_read_again(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    robot = mixture(seed, tuple(x for x in FREE if rng.random() < 0.5)).robot
    method = ("rosenbrock", "tsit5", "radau")[seed % 3]
    found = eomgen.run_scenario(robot, scenario_from_toml(MIXED.format(method)))
    assert found.balance.relative_residue < 1e-5
    again = eomgen.load_result(found.save(tmp_path / "result.npz"))
    assert np.array_equal(again.trajectory.q, found.trajectory.q)
    assert np.array_equal(again.trajectory.v, found.trajectory.v)
