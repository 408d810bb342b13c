"""WebAssembly of kernels under node and wasmtime: the kernel's bits, motions under loads that are data, errors."""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import BuildError, InputError
from eomgen.export.wasm import compile as compiling
from eomgen.export.wasm import plain_loads
from eomgen.export.wasm.pack import make_wasm
from eomgen.kernel.stepping.input_signals import DriveData, Gains, InputSignals, LinkWrench, Signal, Track
from eomgen.kernel.stepping.reading_inputs import input_signals
from eomgen.progress import no_progress
from eomgen.robot import JointStiffness
from eomgen.robot.model import tool_of
from eomgen.robot.value import Robot
from eomgen.scenario.load import load_scenario, scenario_from_toml
from eomgen.scenario.value import Scenario
from eomgen.simulation.assembly import assemble
from tests.oracles.force_laws import with_drives, with_laws
from tests.support.bending_exports import BENDING
from tests.support.bristles import bent, bristle_linkage, law_changes, servo_arm, stateful_arm
from tests.support.optional import needs
from tests.support.random_robots import random_robot
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")
needs("ziglang")
NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="node is not installed")
LARGEST = 250_000  # bytes of a module of six degrees of freedom, with rollouts
RUNNER = """
import { readFileSync } from "node:fs";
const { load } = await import(process.argv[2]);
const kernel = await load();
const calls = JSON.parse(readFileSync(0, "utf8"));
const hex = (x) => Buffer.from(x.buffer, x.byteOffset, x.byteLength).toString("hex");
const found = calls.map(([name, ...given]) => {
  try {
    const plain = given.map((value) => (value === null ? undefined : value));
    const x = name === "advance" ? kernel.simulator(...plain.slice(1)).advance(plain[0]) : kernel[name](...plain);
    if (x === kernel) return "set";
    if (ArrayBuffer.isView(x)) return hex(x);
    return { t: x.t.length ? hex(x.t) : x.t, q: hex(x.q), v: hex(x.v), z: hex(x.z), steps: x.steps };
  } catch (error) {
    return { error: error.message, kind: error.constructor.name, coordinate: error.coordinate };
  }
});
console.log(JSON.stringify(found));
"""


def with_node(folder: Path, name: str, calls: list[list[Any]]) -> list[Any]:
    """What the module's script answers to calls: hexadecimal bytes of arrays, or errors."""
    (folder / "runner.mjs").write_text(RUNNER, encoding="ascii")
    found: list[Any] = answer_of(folder, "runner.mjs", f"./{name}.mjs", given=json.dumps(calls))
    return found


def answer_of(folder: Path, *words: str, given: str = "", timeout: float | None = None) -> Any:
    """What a script of node in a folder prints, from JSON; one that takes longer than a timeout, s, fails."""
    result = subprocess.run(
        [str(NODE), *words], input=given, capture_output=True, text=True, cwd=folder, check=False, timeout=timeout
    )
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


def laws(seed: int) -> Robot:
    """A random tree with forces of every kind, every other one with servo drives."""
    robot = random_robot(seed, joints=(2, 3), tree=True, types=("revolute", "prismatic"), max_coordinates=3)
    robot = with_laws(robot, seed)
    return with_drives(robot, seed) if seed % 2 else robot


def states(kernel: Any, seed: int = 3) -> dict[str, np.ndarray]:
    """Small states: nothing is near a singular one, and no spring drowns the rest."""
    rng = np.random.default_rng(seed)
    found = {name: rng.uniform(-0.3, 0.3, kernel.n) for name in "qvau"}
    found |= {"wrench": rng.uniform(-1.0, 1.0, (len(kernel.links), 6))}
    found |= {name: rng.uniform(-0.3, 0.3, kernel.n) for name in ("jerk", "snap", "u1", "u2")}
    behind = {name: kernel.raw.shapes[name] for name in ("z", "forces") if name in kernel.raw.shapes}
    return found | {name: rng.uniform(-0.3, 0.3, shape) for name, shape in behind.items()}


def compare_functions(
    folder: Path, robot: Robot, dtype: str = "float64", exact: bool = True, kernels: Sequence[str] = ()
) -> int:
    """All functions of a state, to the bit or to round-off of the largest number; how many there are."""
    made = make_wasm(robot, kernels=kernels, dtype=dtype)
    made.write(folder)
    kernel = eomgen.build(robot, dtype=dtype)
    x = {name: np.asarray(array, dtype).astype(np.float64) for name, array in states(kernel).items()}
    if kernel.raw.libraries.meta.get("constraints"):
        x["q"], x["v"] = (np.asarray(y, np.float64) for y in (kernel.assemble(x["q"]), 0.0 * x["v"]))
    calls, expected = [], []
    for name, function in made.description["functions"].items():
        if function["kind"] in ("rollout", "adaptive"):
            continue
        camel = name.split("_")[0] + "".join(word.title() for word in name.split("_")[1:])
        arrays = [np.asarray(x[r], dtype).reshape(kernel.raw.shapes[r]) for r in function["reads"] if r in x]
        if len(arrays) < len(function["reads"]):
            continue
        for frame in [None] if function["kind"] != "frames" else range(len(kernel.frames)):
            try:
                answer = kernel.calls.run(name, None, arrays, () if frame is None else (frame,), whole=True)
            except eomgen.LoopError:
                continue  # random accelerations open loops
            extra = [] if frame is None else [frame]
            calls.append([camel, *(array.ravel().tolist() for array in arrays), *extra])
            expected.append((name, answer.tobytes().hex()))
    for (name, answer), got in zip(expected, with_node(folder, robot.name, calls), strict=True):
        if exact:
            assert got == answer, name
        x, y = (np.frombuffer(bytes.fromhex(text), dtype).astype(np.float64) for text in (got, answer))
        np.testing.assert_allclose(x, y, rtol=0.0, atol=64.0 * np.finfo(dtype).eps * np.abs(y).max(), err_msg=name)
    return len(expected)


def compare_rollouts(folder: Path, robot: Robot, duration: float = 0.02, *, exact: bool = True) -> None:
    """Compare every method, with and without a controller, to the bit; not ``exact``: adaptive ones to round-off.

    Lengths of adaptive steps are powers, whose last digit is that of the C library.
    """
    kernel = eomgen.build(robot)
    x = states(kernel)
    q, v, u = x["q"], x["v"], 0.1 * x["u"]
    if kernel.raw.libraries.meta.get("constraints"):
        q, v = kernel.assemble(q), 0.0 * v
    target = np.repeat(q[None], 4, axis=0) + 0.01
    calls, expected = [], []
    start = [q.tolist(), v.tolist()]
    for controlled in (False, True):
        how = {"kp": 40.0, "kd": 4.0} if controlled else {}
        for method in ("rk4", "implicit"):
            aim = {"target": target[0]} if controlled else {}
            plain = {key: value.tolist() for key, value in aim.items()}
            given: dict[str, Any] = {"dt": 1e-5, "steps": 8, "every": 4, "method": method, **how}
            calls.append(["rollout", *start, u.tolist(), {**given, **plain}])
            expected.append(kernel.rollout(q, v, u, **given, **aim))
        for method in ("rosenbrock", "tsit5"):
            aim = {"target": target} if controlled else {}
            plain = {key: value.ravel().tolist() for key, value in aim.items()}
            given = {"duration": duration, "samples": 4, "rtol": 1e-5, "method": method, **how}
            calls.append(["adaptiveRollout", *start, u.tolist(), {**given, **plain}])
            expected.append(kernel.rollout(q, v, u, **given, **aim))
    for call, answer, got in zip(calls, expected, with_node(folder, robot.name, calls), strict=True):
        assert "error" not in got, (call, got)
        for name, array in zip("qv", answer, strict=True):
            if exact or call[0] == "rollout":
                assert got[name] == array.tobytes().hex(), (call[0], call[-1], name)
            found = np.frombuffer(bytes.fromhex(got[name])).reshape(array.shape)
            np.testing.assert_allclose(found, array, rtol=0.0, atol=1e-10 * np.abs(array).max(), err_msg=name)
        if call[0] == "adaptiveRollout":
            assert got["steps"] == answer.steps


@needs_node
def test_under_node_functions_and_rollouts_have_the_same_bits(tmp_path: Path) -> None:
    robot = eomgen.load_robot("one_link")
    assert compare_functions(tmp_path, robot) >= 12
    compare_rollouts(tmp_path, robot)


@pytest.mark.soak
@needs_node
@pytest.mark.parametrize("make", [stateful_arm, bristle_linkage, servo_arm])
def test_internal_states_are_arrays_of_their_own(make: Callable[[], Robot], tmp_path: Path) -> None:
    """Arguments as of the C, options and results of motions; messages name coordinates and states."""
    robot = make()
    assert compare_functions(tmp_path, robot, exact=False) >= 12
    kernel, made = eomgen.build(robot), make_wasm(robot)
    made.write(tmp_path)
    description, nz = made.description, len(kernel.internal_states)
    assert tuple(description["internal_states"]) == kernel.internal_states
    if robot.name == "servo_arm":  # of which a drive takes a position, and the other one a voltage
        assert description["inputs"]["j2.motor"] == {"meaning": "voltage", "unit": "V", "force": 1}
        header = kernel.raw.source("h")
        assert "j1.gamma: reference of position, rad; 0\n" in header
        assert "j2.motor: voltage, V; 1\n" in header
    else:
        assert description["inputs"] == {}
    q, v, u, z = (np.array(description["home"]), *bent(kernel)[1:])
    v = 0.0 * v if robot.is_closed else v
    Q, V, U, Z = (x.tolist() for x in (q, v, u, z))
    methods: dict[str, dict[str, Any]] = {
        "rk4": {"dt": 1e-4, "steps": 60},
        "implicit": {"dt": 1e-4, "steps": 60},
        "tsit5": {"duration": 6e-3, "rtol": 1e-8},
        "rosenbrock": {"duration": 6e-3, "rtol": 1e-8},
    }
    calls = [
        ["rollout" if "dt" in how else "adaptiveRollout", Q, V, U, {**how, "method": method, "z": Z}]
        for method, how in methods.items()
    ]
    calls += [["advance", 6e-3, Q, V, {**how, "method": method, "u": U, "z": Z}] for method, how in methods.items()]
    answers = with_node(tmp_path, robot.name, calls)
    for (method, how), got, pieces in zip(methods.items(), answers[:4], answers[4:], strict=True):
        motion = kernel.rollout(q, v, u, z=z, method=method, **how)
        for name, last in zip("qvz", (motion[0][-1], motion[1][-1], motion.z[-1]), strict=True):
            np.testing.assert_allclose(np.frombuffer(bytes.fromhex(pieces[name])), last, rtol=1e-9, atol=1e-12)
        for name, wanted in zip("qvz", (*motion, motion.z), strict=True):
            found = np.frombuffer(bytes.fromhex(got[name])).reshape(wanted.shape)
            np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12, err_msg=method)
    if description["inputs"]:  # forces beside drives change velocities as accelerations say
        forces, dt = np.array([0.4, -0.3]), 1e-8
        how = {"dt": dt, "steps": 1, "z": Z}
        calls = [["rollout", Q, V, U, {**how, **more}] for more in ({"forces": forces.tolist()}, {})]
        ends = [np.frombuffer(bytes.fromhex(got["v"]))[kernel.n :] for got in with_node(tmp_path, robot.name, calls)]
        a, without = (kernel.calls.run("forward_dynamics", None, (q, v, z, u, x)) for x in (forces, 0.0 * forces))
        np.testing.assert_allclose((ends[0] - ends[1]) / dt, a - without, rtol=1e-4, atol=1e-4)
        assert np.abs(a - without).max() > 1.0
    bad = {
        f"z[{kernel.internal_states[-1]}]": ["forwardDynamics", Q, V, [*Z[:-1], "heavy"], U],
        f"z: expected {nz} numbers": ["rollout", Q, V, U, {"dt": 1e-4, "steps": 1, "z": Z[1:]}],
        f"u: expected {kernel.n} numbers": ["rollout", Q, V, U + Z, {"dt": 1e-4, "steps": 1}],
    }
    for said, got in zip(bad, with_node(tmp_path, robot.name, list(bad.values())), strict=True):
        assert said in got["error"]
    if not robot.is_closed:  # the rigid robot that drives know has no states
        assert make_wasm(robot, kernels=("energy",), model=True).description["model"]["coordinates"] == [
            name for name in kernel.coordinates if name.endswith("gamma")
        ]


@pytest.mark.soak
@needs_node
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_time_derivatives_have_the_same_bits(dtype: str, tmp_path: Path) -> None:
    names = ("inverse_dynamics_jet2", "forward_dynamics_jet2", "forward_dynamics_jacobian_jet1", "frame_pose_jet1")
    assert compare_functions(tmp_path, eomgen.load_robot("one_link"), dtype, kernels=names) == len(names)
    short = ["inverseDynamicsJet2", *4 * [[0.1, 0.2]], [0.1]]
    assert "snap: expected 2 numbers, got 1" in with_node(tmp_path, "one_link", [short])[0]["error"]


@needs_node
def test_errors_name_what_is_wrong(tmp_path: Path) -> None:
    eomgen.export_wasm("one_link", tmp_path)
    z = [0.0, 0.0]
    track = {"signal": {"knots": [0, 1], "coefficients": [0.0], "degree": 0, "columns": 1}, "place": [1]}
    calls_refused: list[tuple[list[Any], str]] = [
        (["forwardDynamics", [0.0], z, z], "q: expected 2 numbers, got 1"),
        (["forwardDynamics", z, [0.0, "heavy"], z], 'v[joint1.gamma] = "heavy" is not a finite number'),
        (["set", {"gravity.w": 1.0}], "parameter gravity.w is unknown; allowed: gravity.x"),
        (["set", {"gravity.x": "heavy"}], 'gravity.x = "heavy" is not allowed; a finite number is'),
        (
            ["set", {"joints.joint1.x.stiffness": -1.0}],
            "joints.joint1.x.stiffness = -1 is not allowed; a number from 0 on is",
        ),
        (["framePose", z, "hand"], "frame hand is unknown; allowed: tcp, base, link1"),
        (["rollout", z, z, z, {"dt": 0.0, "steps": 1}], "dt = 0 is not allowed"),
        (
            ["rollout", z, z, z, {"dt": 1e-3, "steps": 1, "method": "euler"}],
            "method: euler is unknown; allowed: rk4, implicit",
        ),
        (["rollout", z, z, z, {"dt": 10.0, "steps": 100}], "at step "),
        (["adaptiveRollout", z, z, z, {"duration": 1.0, "rtol": 2.0}], "rtol = 2 is not allowed"),
        (["adaptiveRollout", z, z, z, {"duration": 1.0, "kp": 3.0}], "given together"),
        (["rollout", [0.1, 0.3], [1.0, 2.0], z, {"dt": 0.5, "steps": 4000}], "take a shorter dt"),
        (
            ["rollout", z, z, z, {"dt": 1e-3, "steps": 1, "kp": [1.0, 1.0], "target": z}],
            "kp[joint1.x] = 1 is not allowed; 0 is",
        ),
        (
            ["rollout", z, z, z, {"dt": 1e-3, "steps": 1, "kp": -1.0, "target": z}],
            "kp[joint1.gamma] = -1 is not allowed",
        ),
        (
            ["adaptiveRollout", z, z, z, {"duration": 1.0, "loads": {"program": track, "model": {}}}],
            "a model is not in this module",
        ),
        (
            ["simulator", z, z, {"method": "rk4", "loads": {"torque": track}}],
            "loads act with the methods rosenbrock, tsit5",
        ),
        (["energy", z, [1e200, 1e200]], "energy: the result is not finite"),
    ]
    answers = with_node(tmp_path, "one_link", [call for call, _ in calls_refused])
    for (call, message), got in zip(calls_refused, answers, strict=True):
        assert message in got["error"], (call, got)


@needs_node
def test_what_is_no_finite_number_is_refused_everywhere(tmp_path: Path) -> None:
    """Also null and texts of digits; what is refused changes nothing, and a motion from NaN on does not hang."""
    eomgen.export_wasm("one_link", tmp_path)
    shutil.copy(Path(__file__).with_name("odd_numbers.mjs"), tmp_path)
    assert answer_of(tmp_path, "odd_numbers.mjs", timeout=60) == {"taken": [], "refused": 3, "stays": True}


@needs_node
def test_matrices_stay_positive_semidefinite(tmp_path: Path) -> None:
    """Entries are looked at together: what is refused changes nothing."""
    robot = eomgen.load_robot("one_link")
    joint = replace(robot.joints[0], stiffness=JointStiffness({"x.x": 9.0, "x.gamma": 2.0, "gamma.gamma": 4.0}))
    eomgen.export_wasm(replace(robot, joints=(joint,)), tmp_path, kernels=("generalized_force",))
    prefix, q, v = "joints.joint1.stiffness", [0.1, 0.2], [0.0, 0.0]
    calls: list[list[Any]] = [
        ["generalizedForce", q, v],
        ["set", {f"{prefix}.x.gamma": 7.0}],
        ["set", {f"{prefix}.x.x": 0.0}],
        ["set", {f"{prefix}.x.x": -1.0}],
        ["generalizedForce", q, v],
        ["set", {f"{prefix}.x.gamma": 7.0, f"{prefix}.x.x": 13.0}],
        ["set", {f"{prefix}.x.gamma": 0.0}],
        ["set", {f"{prefix}.x.x": 0.0, f"{prefix}.gamma.gamma": 0.0}],
        ["generalizedForce", q, v],
    ]
    first, *calls_refused, same, taken, less, none, last = with_node(tmp_path, robot.name, calls)
    assert [taken, less, none] == ["set"] * 3
    for answer, said in zip(calls_refused, ("negative energy", "negative energy", "0 on is"), strict=True):
        assert prefix in answer["error"]
        assert said in answer["error"]
    assert same == first
    moved = np.subtract(*(np.frombuffer(bytes.fromhex(answer)) for answer in (first, last)))
    np.testing.assert_allclose(moved, [-(9.0 * 0.1 + 2.0 * 0.2), -(2.0 * 0.1 + 4.0 * 0.2)], rtol=1e-12)


@needs_node
def test_numbers_of_laws_go_together_as_in_python(tmp_path: Path) -> None:
    robot = stateful_arm()
    kernel = eomgen.build(robot, kernels=("energy",))
    eomgen.export_wasm(robot, tmp_path, kernels=("energy",))
    changes, first = law_changes(kernel), dict(kernel.parameters)
    answers = with_node(tmp_path, robot.name, [["set", x] for values, _ in changes for x in (values, first)])
    for (values, taken), got in zip(changes, answers[::2], strict=True):
        assert (got == "set") == taken, (values, got)
        assert taken or "is not allowed; " in got["error"]


def test_under_wasmtime_it_needs_nothing_and_has_the_same_bits() -> None:
    wasmtime = needs("wasmtime")
    made = make_wasm("one_link", kernels=("forward_dynamics",))
    engine = wasmtime.Engine()
    module = wasmtime.Module(engine, made.binary)
    assert not module.imports
    store = wasmtime.Store(engine)
    exports = wasmtime.Instance(store, module, []).exports(store)
    memory, base = exports["memory"], exports["__heap_base"].value(store)
    kernel = eomgen.build("one_link")
    x = states(kernel)
    place = base
    addresses = {}
    arrays = {"p": np.array(list(made.description["parameters"].values())), "h": np.zeros(64)}
    for name, array in (arrays | {key: x[key] for key in "qvu"} | {"out": np.zeros(2)}).items():
        memory.write(store, array.tobytes(), place)
        addresses[name], place = place, place + array.nbytes
    exports["one_link_setup"](store, addresses["p"], addresses["h"])
    status = exports["one_link_forward_dynamics"](store, *(addresses[key] for key in ("h", "q", "v", "u", "out")))
    found = memory.read(store, addresses["out"], addresses["out"] + 16)
    assert status == 0
    assert bytes(found) == kernel.forward_dynamics(x["q"], x["v"], x["u"]).tobytes()
    assert struct.unpack("<4sI", made.binary[:8]) == (b"\0asm", 1)


def test_what_cannot_be_exported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="kernels: 'thoughts' is unknown"):
        eomgen.export_wasm("one_link", tmp_path, kernels=("thoughts",))
    with pytest.raises(InputError, match=r"kernels: radau_rollout is not .* by rk4, implicit, rosenbrock, tsit5$"):
        eomgen.export_wasm("one_link", tmp_path, kernels=("adaptive_rollout", "radau_rollout"))
    monkeypatch.setattr(compiling.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(compiling.shutil, "which", lambda name: None)
    refused(BuildError, r"eomgen\[compiler\]", eomgen.export_wasm, "one_link", tmp_path)
    assert not list(tmp_path.iterdir())


BUILTIN = ("ur5", "puma560", "puma560_elastic", "four_bar", "delta", "worn_arm", "shaken_arm")
RIGID = {"joints": (2, 4), "tree": True, "max_coordinates": 3}
SAME: dict[str, tuple[Callable[[], Robot], float]] = {  # what makes a robot, and for how long it moves, s
    **{name: (partial(eomgen.load_robot, name), 2e-3) for name in BUILTIN},
    **{name: (make, 1e-3) for name, make in BENDING.items()},
    **{f"random {seed}": (partial(random_robot, seed, **RIGID), 1e-3) for seed in range(4)},
}


@pytest.mark.soak(most=6)
@needs_node
@pytest.mark.parametrize("name", SAME)
def test_robots_have_the_same_bits(name: str, tmp_path: Path) -> None:
    make, duration = SAME[name]
    robot = make()
    compare_functions(tmp_path, robot)
    if name != "shaken_arm":  # whose prescribed coordinates take accelerations
        compare_rollouts(tmp_path, robot, duration, exact=name != "worn_arm")
    if name in ("ur5", "puma560"):
        assert (tmp_path / f"{name}.wasm").stat().st_size < LARGEST


@pytest.mark.soak
@needs_node
@pytest.mark.parametrize("seed", range(6))
def test_random_robots_agree(seed: int, tmp_path: Path) -> None:
    """Laws with powers and exponentials are as exact as the library of each side is."""
    compare_functions(tmp_path, laws(seed), ("float64", "float32")[seed % 2], exact=False)


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
    for method, numbers in answer_of(tmp_path, "run.mjs").items():
        whole, pieces, (t, at) = np.array(numbers[:4]), np.array(numbers[4:8]), numbers[8:]
        assert at == pytest.approx(t, rel=1e-12)
        if method in ("rk4", "implicit"):
            assert whole.tolist() == pieces.tolist(), method
        np.testing.assert_allclose(pieces, whole, rtol=1e-6, atol=1e-8, err_msg=method)


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
    refused(InputError, "model: four_bar has loops or couplings", eomgen.export_wasm, "four_bar", tmp_path, model=True)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(TSC is None, reason="tsc is not installed")
def test_typescript_takes_the_declarations(tmp_path: Path) -> None:
    eomgen.export_wasm("one_link", tmp_path)
    (tmp_path / "use.mts").write_text(TYPED, encoding="ascii")
    how = ["--strict", "--noEmit", "--target", "es2022", "--module", "nodenext", "--lib", "es2022,dom"]
    ran = subprocess.run([str(TSC), *how, "use.mts"], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert ran.returncode == 0, ran.stdout
