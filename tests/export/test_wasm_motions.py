"""Motions as WebAssembly, under node: loads that are data, motions by pieces, what ends early, types."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import InputError
from eomgen.export.wasm import plain_loads
from eomgen.export.wasm.pack import make_wasm
from eomgen.progress import no_progress
from eomgen.robot.model import tool_of
from eomgen.runtime.stepping.input_signals import DriveData, Gains, InputSignals, LinkWrench, Signal, Track
from eomgen.runtime.stepping.reading_inputs import input_signals
from eomgen.scenario.load import load_scenario, scenario_from_toml
from eomgen.scenario.value import Scenario
from eomgen.simulation.assembly import assemble
from tests.support.optional import needs

from .test_wasm import needs_node, with_node

pytestmark = pytest.mark.usefixtures("unoptimised")

needs("ziglang")
TSC = shutil.which("tsc")

SIMULATED = """
import { load } from "./NAME.mjs";
const kernel = await load();
const [q, v] = [[0.01, 0.2], [0.1, -0.3]];
const how = { kp: 3, kd: 0.2, target: [0, 0.5] };
const found = {};
for (const method of ["rk4", "implicit"]) {
  const whole = kernel.rollout(q, v, null, { dt: 1e-4, steps: 60, every: 60, method, ...how });
  const simulator = kernel.simulator(q, v, { dt: 1e-4, method, ...how });
  for (const duration of [1e-3, 2.5e-4, 2.75e-3, 2e-3]) simulator.advance(duration);
  found[method] = [...whole.q.slice(2), ...whole.v.slice(2), ...simulator.q, ...simulator.v, 6e-3, simulator.t];
}
for (const method of ["rosenbrock", "tsit5"]) {
  const whole = kernel.adaptiveRollout(q, v, null, { duration: 0.1, rtol: 1e-9, method, ...how });
  const simulator = kernel.simulator([0, 0], [0, 0], { rtol: 1e-9, method, ...how }).reset(q, v);
  kernel.rollout(q, v, null, { dt: 1e-4, steps: 20000, every: 1 }); // the memory grows
  for (let i = 0; i < 5; ++i) simulator.advance(0.02);
  found[method] = [...whole.q.slice(2), ...whole.v.slice(2), ...simulator.q, ...simulator.v, 0.1, simulator.t];
}
console.log(JSON.stringify(found));
"""

TYPED = """
import { load, description, type Kernel } from "./one_link.mjs";
const kernel: Kernel = await load();
kernel.set({ "gravity.z": -3 });
const a: Float64Array = kernel.forwardDynamics(new Float64Array(2), [0, 0], [0, 0], new Float64Array(2));
const { t, q, steps } = kernel.adaptiveRollout(a, a, undefined, { duration: 1, method: "tsit5", kp: 3, target: a });
const sim = kernel.simulator(a, a, { method: "implicit", dt: 1e-3 }).advance(0.1);
console.log(sim.t, t, steps, description.home, description.model?.coordinates, kernel.framePose(q, "tcp"));
// @ts-expect-error: no such frame
kernel.framePose(q, "hand");
// @ts-expect-error: no such parameter
kernel.set({ "gravity.w": 1 });
// @ts-expect-error: no such method
kernel.rollout(a, a, a, { dt: 1, steps: 1, method: "euler" });
"""


def compare(folder: Path, kernel: Any, loads: InputSignals, state: Any, model: bool, **how: Any) -> None:
    """A motion in Python and under node, to round-off: powers and sines of loads are those of either library."""
    make_wasm(how.pop("robot"), model=model).write(folder)
    how = {"duration": 0.05, "samples": 5, "rtol": 1e-6, "method": "rosenbrock", **how}
    expected = kernel.rollout(*state, **how, loads=loads)
    given = {**how, "loads": plain_loads(kernel, loads)}
    (found,) = with_node(folder, kernel.name, [["adaptiveRollout", *(x.tolist() for x in state), None, given]])
    assert "error" not in found, found
    assert found["steps"] == expected.steps
    for name, array in zip("qv", expected, strict=True):
        got = np.frombuffer(bytes.fromhex(found[name])).reshape(array.shape)
        np.testing.assert_allclose(got, array, rtol=1e-9, atol=1e-11 * max(1.0, np.abs(array).max()))
    free = kernel.rollout(*state, **how)
    assert np.abs(free[0][-1] - expected[0][-1]).max() > 1e-6  # the loads do something


@needs_node
def test_loads_over_time_act_as_in_python(tmp_path: Path) -> None:
    kernel = eomgen.build("one_link")
    ramp = Signal.through([0.0, 0.02, 0.06], [[0.0], [1.0], [0.5]])
    track = Track(Signal(np.array([0.0, 1.0]), np.array([[[0.1], [0.4], [-0.2]]]), profile=ramp), np.array([1]))
    gains = Gains(np.array([30.0]), np.array([2.0]))
    torque = Track(Signal.through([0.0, 0.03, 0.05], [[0.0], [4.0], [-1.0]]), np.array([0]))
    push = LinkWrench(0, Signal.constant([1.0, -2.0, 0.0, 0.0, 0.0, 0.5]), np.array([0.1, 0.2, 0.0]), 0.01, 0.03, True)
    loads = InputSignals(DriveData(torque=torque, program=track, gains=gains), [push])
    state = np.array([1e-3, 0.1]), np.array([0.0, 0.2])
    compare(tmp_path, kernel, loads, state, False, robot="one_link")


@needs_node
def test_drives_saturate_as_in_python(tmp_path: Path) -> None:
    """Limits of drives go through JSON, infinite ones, too, and change the motion."""
    kernel = eomgen.build("one_link")
    program = Track(Signal.through([0.0, 0.05], [[0.0], [1.0]]), np.array([1]))
    drive = DriveData(program=program, gains=Gains(np.array([300.0]), np.array([10.0])))
    state = np.array([1e-3, 0.1]), np.array([0.0, 0.2])
    loads, how = InputSignals(replace(drive, effort=np.array([np.inf, 4.0]))), {"duration": 0.05, "samples": 5}
    free = kernel.rollout(*state, **how, method="rosenbrock", loads=InputSignals(drive))
    saturated = kernel.rollout(*state, **how, method="rosenbrock", loads=loads)
    assert np.abs(free[0] - saturated[0]).max() > 1e-4
    compare(tmp_path, kernel, loads, state, False, robot="one_link")


@needs_node
def test_motions_by_pieces_are_the_same_motions(tmp_path: Path) -> None:
    """Steps of one length to the bit, chosen ones within tolerances; parameters and the memory may change between."""
    eomgen.export_wasm("one_link", tmp_path)
    (tmp_path / "run.mjs").write_text(SIMULATED.replace("NAME", "one_link"), encoding="ascii")
    ran = subprocess.run(
        [str(shutil.which("node")), "run.mjs"], capture_output=True, text=True, cwd=tmp_path, check=False
    )
    assert ran.returncode == 0, ran.stderr
    for method, numbers in json.loads(ran.stdout).items():
        whole, pieces, (t, at) = np.array(numbers[:4]), np.array(numbers[4:8]), numbers[8:]
        assert at == pytest.approx(t, rel=1e-12)
        if method in ("rk4", "implicit"):
            assert whole.tolist() == pieces.tolist(), method
        np.testing.assert_allclose(pieces, whole, rtol=1e-6, atol=1e-8, err_msg=method)


@needs_node
def test_what_ends_early_says_where_and_what_is_not_allowed(tmp_path: Path) -> None:
    eomgen.export_wasm("one_link", tmp_path)
    z = [0.0, 0.0]
    track = {"signal": {"knots": [0, 1], "coefficients": [0.0], "degree": 0, "columns": 1}, "place": [1]}
    calls: list[list[Any]] = [
        ["rollout", [0.1, 0.3], [1.0, 2.0], z, {"dt": 0.5, "steps": 4000}],
        ["rollout", z, z, z, {"dt": 1e-3, "steps": 1, "kp": [1.0, 1.0], "target": z}],
        ["rollout", z, z, z, {"dt": 1e-3, "steps": 1, "kp": -1.0, "target": z}],
        ["adaptiveRollout", z, z, z, {"duration": 1.0, "loads": {"program": track, "model": {}}}],
        ["simulator", z, z, {"method": "rk4", "loads": {"torque": track}}],
        ["energy", z, [1e200, 1e200]],
    ]
    expected = (
        "take a shorter dt",
        "kp[joint1.x] = 1 is not allowed; 0 is",
        "kp[joint1.gamma] = -1 is not allowed",
        "a model is not in this module",
        "loads act with the methods rosenbrock, tsit5",
        "energy: the result is not finite",
    )
    for call, message, got in zip(calls, expected, with_node(tmp_path, "one_link", calls), strict=True):
        assert message in got["error"], (call, got)


@pytest.mark.soak
@needs_node
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("puma560_elastic", ""),
        ("shaken_arm", "shaken_platform"),
        ("geared_arm", '[motion]\ntype = "point_to_point"\nduration = 0.1\n[control]\ntype = "computed_torque"\n'),
    ],
)
def test_scenarios_run_as_in_python(name: str, text: str, tmp_path: Path) -> None:
    """Computed torque of elastic gears, a platform that shakes, gains with gravity: what a page is given as data."""
    robot = eomgen.load_robot(name)
    scenario = _scenario(name, text)
    assembly = assemble(robot, scenario, tool_of(robot, None, "tool"), no_progress)
    kernel = assembly.kernel
    loads = input_signals(kernel.calls, assembly.drive, assembly.wrenches, assembly.prescribed)
    state = np.zeros(kernel.n), np.zeros(kernel.n)
    compare(tmp_path, kernel, loads, state, True, robot=robot)


def _scenario(name: str, text: str) -> Scenario:
    if text.isidentifier():
        return load_scenario(text)
    if text:
        return scenario_from_toml("duration = 0.1\n" + text)
    return load_scenario("puma560_circle")


def test_a_model_with_loops_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="model: four_bar has loops or couplings"):
        eomgen.export_wasm("four_bar", tmp_path, model=True)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(TSC is None, reason="tsc is not installed")
def test_typescript_takes_the_declarations(tmp_path: Path) -> None:
    eomgen.export_wasm("one_link", tmp_path)
    (tmp_path / "use.mts").write_text(TYPED, encoding="ascii")
    how = ["--strict", "--noEmit", "--target", "es2022", "--module", "nodenext", "--lib", "es2022,dom"]
    ran = subprocess.run([str(TSC), *how, "use.mts"], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert ran.returncode == 0, ran.stdout
