"""Streams: a writer that is killed leaves what it had written; a whole one equals the result."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.errors import InputError
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.run import run_scenario
from eomgen.simulation.stream import MotionStream
from tests.support.commands import command
from tests.support.optional import needs
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")

needs("zarr")

SHAKE = "\n".join(
    f"[[prescribed]]\ntype = 'harmonic'\ncoordinate = 'mount.{name}'\namplitude = 0.02\nfrequency = 1.0"
    for name in ("x", "y", "z", "alpha", "beta", "gamma")
)


def same(found: object, result: eomgen.SimulationResult) -> None:
    for name in ("t", "q", "v"):
        assert np.array_equal(getattr(found, name), getattr(result.trajectory, name)), name


def test_a_stream_has_what_the_result_has(tmp_path: Path) -> None:
    """Over several pieces, with prescribed coordinates."""
    text = (
        "duration = 0.3\noutput_step = 1e-3\n[control]\ntype = 'computed_torque'\n"
        f"[[wrenches]]\nlink = 'link3'\nforce = [1, 0, 0]\nt0 = 0.0995\nt1 = 0.2\n{SHAKE}\n"
    )
    result = run_scenario(eomgen.load_robot("shaken_arm"), scenario_from_toml(text), stream=tmp_path / "run.zarr")
    found = eomgen.load_stream(tmp_path / "run.zarr")
    assert found.complete
    assert found.coordinates == result.trajectory.coordinates
    same(found, result)
    assert found.meta["robot_hash"] == result.robot_hash
    assert found.meta["scenario"] == dict(result.scenario)
    for name in ("mount.x", "elbow.gamma.rate"):
        ours, theirs = found.series(name), result.series(name)
        assert (ours.unit, ours.values.tolist()) == (theirs.unit, theirs.values.tolist())
    refused(InputError, r"'elbow\.x' is unknown", found.series, "elbow.x")
    with pytest.raises(InputError, match=r"run\.zarr: is not empty"):
        run_scenario(eomgen.load_robot("shaken_arm"), scenario_from_toml(text), stream=tmp_path / "run.zarr")


def test_a_stream_of_a_closed_mechanism(tmp_path: Path) -> None:
    """All coordinates, closed, over several pieces; from the stream alone, too."""
    text = (
        "duration = 0.2\noutput_step = 2e-3\n[control]\ntype = 'torque'\ncoordinates = ['joint1']\n"
        "rows = [[0.0, 5.0], [0.2, -5.0]]\n[[wrenches]]\nlink = 'coupler'\nforce = [0, 30, 0]\nt0 = 0.0505\nt1 = 0.1\n"
    )
    robot = eomgen.load_robot("four_bar")
    result = run_scenario(robot, scenario_from_toml(text), stream=tmp_path / "run.zarr")
    found = eomgen.load_stream(tmp_path / "run.zarr")
    assert found.complete
    same(found, result)
    kernel = eomgen.build(robot)
    assert np.abs(kernel.functions.constraint(found.q)).max() <= 1e-11
    assert np.abs(np.einsum("tmn,tn->tm", kernel.functions.constraint_jacobian(found.q), found.v)).max() <= 1e-11


def test_a_stream_of_a_motion_that_ends_early(tmp_path: Path) -> None:
    """As far as whole output steps; it says that the duration was not reached."""
    text = "duration = 0.2\noutput_step = 0.01\n[initial]\nv = { joint1 = -1.0 }\n[control]\ntype = 'none'\n"
    text += "[until]\ncoordinate = 'joint1'\nvalue = -0.055\n"
    result = run_scenario(eomgen.load_robot("one_link"), scenario_from_toml(text), stream=tmp_path / "run.zarr")
    found = eomgen.load_stream(tmp_path / "run.zarr")
    assert not found.complete
    assert 3 < found.t.size == result.trajectory.t.size - 1
    for name in ("t", "q", "v"):
        assert np.array_equal(getattr(found, name), getattr(result.trajectory, name)[:-1]), name


HOW = "output_step = 0.01\n[initial]\nv = { joint1 = 1.0 }\n[integrator]\nmethod = 'rk4'\nstep = 1e-3\n"
LONG = """
import sys, eomgen
from eomgen.simulation import run_scenario
from eomgen.scenario import scenario_from_toml
run_scenario(eomgen.load_robot("one_link"), scenario_from_toml("duration = 2e3\\n" + sys.argv[2]), stream=sys.argv[1])
"""


@pytest.mark.soak
def test_a_killed_simulation_leaves_what_it_had(tmp_path: Path) -> None:
    """SIGKILL in the middle; what is there equals an undisturbed run of that length."""
    folder = tmp_path / "run.zarr"
    writer = subprocess.Popen([sys.executable, "-c", LONG, str(folder), HOW])
    try:
        while not (folder / "t" / "c" / "1").exists():
            assert writer.poll() is None
            time.sleep(0.05)
    finally:
        writer.send_signal(signal.SIGKILL)
        writer.wait()
    assert writer.returncode == -signal.SIGKILL
    found = eomgen.load_stream(folder)
    assert not found.complete
    assert 256 < found.t.size < 200_000
    assert np.isfinite(found.q).all()
    assert np.isfinite(found.v).all()
    assert np.allclose(np.diff(found.t), 0.01)
    count = min(found.t.size, 301)
    text = f"duration = {found.t[count - 1]}\n{HOW}"
    whole = run_scenario(eomgen.load_robot("one_link"), scenario_from_toml(text))
    assert np.abs(found.q[:count] - whole.trajectory.q).max() < 1e-9


def test_what_is_no_stream(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("x")
    for folder in (tmp_path / "none", tmp_path):
        refused(InputError, "is no stream of a simulation", eomgen.load_stream, folder)
    refused(InputError, "cannot be written", MotionStream, tmp_path / "file", ["a.x"], 3, {})
    monkeypatch.setitem(sys.modules, "zarr", None)
    refused(InputError, r'pip install "eomgen\[sweep\]"', eomgen.load_stream, tmp_path)


def test_command(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text("duration = 0.05\n")
    words = ("simulate", "one_link", "--no-plots", "-o", tmp_path, "--stream", tmp_path / "z")
    command(*words, "--scenario", tmp_path / "s.toml")
    assert eomgen.load_stream(tmp_path / "z").complete
    assert "--stream: given without --scenario" in command(*words, code=1)
