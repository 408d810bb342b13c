"""Drives, reference trajectories and loads of a robot as plain values: wrenches, payloads, prescribed motions, too.

A scenario says it, or a default one that holds the robot where it stands.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...arrays import Array, Index
from ...codegen.kernels.groups import INERTIA
from ...errors import EomgenError, InputError, LoopError
from ...kernel.stepping.input_signals import DriveData, ModelDrive, Track, Waves
from ...kernel.stepping.packed_inputs import plain_model, plain_prescribed, plain_signal, plain_track, plain_wrench
from ...motion.ends import default_ends, principal_limits
from ...motion.splines import signal_of
from ...names import joint_of
from ...pipeline.building import build
from ...progress import Progress
from ...robot.coordinates import index_of, unit_of
from ...robot.internal_states.drives import CURRENT_LIMIT, VOLTAGE_LIMIT, input_of, loops_of
from ...robot.mechanism import coordinate_of, drive_of, leading_home
from ...robot.model import build_model, program_coordinates
from ...robot.value import Robot
from ...scenario.value import Initial, Scenario, Section
from ...simulation.assembly import REFERENCES, Assembly, assemble, rigid_kernels
from ...simulation.controls import Control, NoControl, ReferenceControl
from ...simulation.initial import initial_state
from ...simulation.loads import loaded_parameters
from ..wasm.signals import as_json

STIFF = 15.0  # rad/s: what gains of default drives make of the rigid robot
CLOSED_PART = 0.35  # of a default motion, for mechanisms: far from where they are singular
WAY, PAUSE = 1.6, 0.7  # s, of the default motion to and fro
SHAKE = {"m": 0.01, "rad": 0.01}  # amplitude of prescribed motions without another one
SHAKE_RATE = 1.5  # Hz, likewise
TURN = 1.5  # m or rad, to either side of a position that a servo drive is given
INPUTS = {"voltage": 24.0, "velocity": 1.0, "current": 5.0}  # V, m/s or rad/s, A: of drives without a limit
HELD = 1.0  # s, of a scenario whose robot is only held


def default_scenario(robot: Robot) -> Scenario:
    """Return a scenario without a motion: drives with gains hold the robot near where default motions begin."""
    driven = program_coordinates(robot)
    model = build_model(robot)
    motions = tuple(
        Section(
            "harmonic",
            {"coordinate": name, "amplitude": SHAKE[unit_of(name)], "frequency": SHAKE_RATE, "offset": 0.0},
        )
        for name in (model.coordinates[i] for i in model.prescribed)
    )
    if not driven:
        return Scenario(HELD, prescribed=motions)
    start, _ = default_ends(robot, driven)
    initial = None if robot.is_closed else Initial(q=dict(zip(driven, start.tolist(), strict=True)))
    return Scenario(HELD, initial=initial, control=_default_control(robot, driven, start), prescribed=motions)


def _default_control(robot: Robot, driven: tuple[str, ...], start: Array) -> Section:
    """Return what holds the robot: references of servo drives, or gains where drives are forces; else nothing."""
    laws = {name: coordinate_of(robot, drive_of(robot, name)).law() for name in driven}
    meanings = {input_of(law, name).meaning for name, law in laws.items()}
    if meanings <= set(REFERENCES):
        return Section("reference", {})
    if not meanings <= {"force", "torque"}:
        return Section("none", {})
    gains = default_gains(robot, driven, start)
    return Section("pd", {"kp": gains[0], "kd": gains[1], "gravity": True})


def default_gains(robot: Robot, driven: tuple[str, ...], start: Array) -> tuple[dict[str, float], dict[str, float]]:
    """Return kp and kd by driven coordinate: critical damping at STIFF with the inertia that a drive feels."""
    inertia: Array
    if robot.is_closed:
        kernel = build(robot.rigid())
        q = kernel.assemble([leading_home(robot).get(name, 0.0) for name in kernel.coordinates])
        nothing, index = np.zeros(kernel.n), index_of(kernel.coordinates, driven)
        rest = kernel.forward_dynamics(q, nothing, nothing)
        moved = [kernel.forward_dynamics(q, nothing, np.eye(kernel.n)[i])[i] - rest[i] for i in index]
        inertia = 1.0 / np.maximum(np.array(moved), 1e-9)
    else:
        kernel = build(robot.rigid(), kernels=(*INERTIA, *rigid_kernels(robot)))
        at = dict(zip(driven, start, strict=True))
        M = kernel.mass_matrix([at.get(name, 0.0) for name in kernel.coordinates])
        inertia = np.diag(M)[index_of(kernel.coordinates, driven)]
    inertias = [_rounded(x) for x in inertia]
    kp = {name: _rounded(STIFF**2 * m) for name, m in zip(driven, inertias, strict=True)}
    return kp, {name: _rounded(2.0 * STIFF * m) for name, m in zip(driven, inertias, strict=True)}


def _rounded(value: float) -> float:
    """Round to two digits, for numbers that are shown and typed."""
    return float(f"{max(float(value), 1e-6):.2g}")


def acting_on(
    robot: Robot, scenario: Scenario, tool: str, report: Progress, notes: list[str]
) -> tuple[dict[str, Any], Assembly]:
    """Return the start, drives, reference trajectory and loads of a scenario as JSON holds them, and its assembly.

    Args:
        robot: of the kernel.
        scenario: of files, of a result, or ``default_scenario``.
        tool: frame of tool paths.
        report: told how far it is.
        notes: lines about what the page does otherwise are added.

    Raises:
        InputError: the scenario does not fit the robot, or has a program that only Python can ask.
        LoopError: loops do not close at the start.
    """
    if scenario.control is not None and scenario.control.type == "feedforward":
        scenario.fail("control", "feed-forward is not on a page; allowed: none, pd, reference or computed_torque")
    assembly = assemble(robot, scenario, tool, report)
    report(0.0, "static equilibrium at the start")
    q0, v0, loose = initial_state(robot, scenario, assembly)
    if loose:
        notes.append(f"nothing holds {', '.join(loose)}, so not in balance at the start")
    kernel = assembly.kernel
    data = _data_of(assembly.drive)
    if data is not None and data.effort is not None:
        raise InputError(
            f"{scenario.label('control.saturate')}: drives that are clipped are not in a page; allowed: without"
        )
    if data is None:
        raise InputError(
            f"{scenario.label('motion')}: is a reference trajectory that only Python can ask; allowed on a page: those"
            " that scenario files have"
        )
    acting: dict[str, Any] = {
        "start": {"t": 0.0, "q": q0.tolist(), "v": v0[: kernel.n].tolist(), "z": v0[kernel.n :].tolist()},
        "control": _control(scenario, assembly),
        "drive": "none",
        "program": None,
        "torque": None,
        "model": None,
        "compensates": False,
        "drives": [],
        "inputs": _inputs(robot, assembly, q0),
        "cycle": None,
        "holding": None,
        "prescribed": None,
    }
    if data.torque is not None:
        acting["torque"] = as_json(plain_track(data.torque))
        acting["drive"] = "program"
    if data.program is not None:
        ratio = np.ones(len(assembly.driven)) if data.ratio is None else data.ratio
        assert assembly.program is not None
        first = assembly.program.at(0.0)[0]
        gains = _gains_of(robot, data, assembly, first)
        acting["drives"] = _drives(robot, assembly, data.program.place, ratio, gains, first)
        if isinstance(assembly.drive, ReferenceControl):
            for drive, takes_velocity in zip(acting["drives"], assembly.drive.of_velocity.tolist(), strict=True):
                drive["rate"] = takes_velocity
        acting["program"] = as_json(plain_signal(data.program.signal))
        acting["drive"] = "target" if scenario.motion is None else "program"
        begin, goal = default_ends(robot, assembly.driven)
        goal = first + (CLOSED_PART if robot.is_closed else 1.0) * (goal - begin)
        acting["cycle"] = {"start": first.tolist(), "goal": goal.tolist(), "duration": WAY, "pause": PAUSE}
        if data.model is not None:
            _add_model(acting, data.model, assembly, q0, notes)
    wrenches = assembly.wrenches.load_data() if assembly.wrenches else []
    acting["wrenches"] = as_json([plain_wrench(x, kernel.links) for x in wrenches])
    acting["events"] = _events(robot, scenario)
    if assembly.prescribed is not None:
        acting["prescribed"] = _given(assembly.prescribed.load_data(), kernel.coordinates, kernel.prescribed)
    if scenario.until is not None:
        notes.append("the scenario ends early where it says so under 'until'; the page goes on")
    return acting, assembly


def _data_of(drive: Control) -> DriveData | None:
    """Return time signals of drives; of servo drives the reference, which the page hands to them."""
    if not isinstance(drive, ReferenceControl):
        return drive.load_data()
    signal, actuators = signal_of(drive.motion), drive.actuators
    return None if signal is None else DriveData(program=Track(signal, actuators.index), ratio=actuators.ratios)


def _control(scenario: Scenario, assembly: Assembly) -> str:
    """Return which law of drives the page runs: "pd", "model" (computed torque), "reference" or "none"."""
    if assembly.program is None:
        return "none"
    if isinstance(assembly.drive, ReferenceControl):
        return "reference"
    kind = "computed_torque" if scenario.control is None else scenario.control.type
    return "pd" if kind == "pd" or assembly.path is not None else "model"


def _gains_of(robot: Robot, data: Any, assembly: Assembly, first: Array) -> tuple[Array, Array]:
    """Return gains at the joints of what is driven; of a closed mechanism under computed torque default ones."""
    if data.gains is not None:
        return np.asarray(data.gains.kp), np.asarray(data.gains.kd)
    if not robot.is_closed:
        nothing = np.zeros(len(assembly.driven))
        return nothing, nothing
    kp, kd = default_gains(robot, assembly.driven, first)
    return np.array([kp[name] for name in assembly.driven]), np.array([kd[name] for name in assembly.driven])


def _drives(
    robot: Robot, assembly: Assembly, place: Index, ratio: Array, gains: tuple[Array, Array], first: Array
) -> list[dict[str, Any]]:
    """Return drives with their sliders; ``first``: where their program begins, (d,)."""
    kernel, drives = assembly.kernel, []
    start, goal = default_ends(robot, assembly.driven)
    names = [joint_of(name) for name in assembly.driven]
    for i, name in enumerate(assembly.driven):
        unit = unit_of(name)
        label = name if names.count(joint_of(name)) > 1 else joint_of(name)
        low, high = _limits(robot, name, float(first[i]), abs(float(goal[i] - start[i])) or 0.5)
        drives.append(
            {
                "name": name,
                "label": label,
                "joint": kernel.coordinates.index(name),
                "place": int(place[i]),
                "ratio": float(ratio[i]),
                "unit": unit,
                "kp": float(gains[0][i]),
                "kd": float(gains[1][i]),
                "start": float(first[i]),
                "low": low,
                "high": high,
            }
        )
    return drives


def _inputs(robot: Robot, assembly: Assembly, q0: Array) -> list[dict[str, Any]]:
    """Return inputs of servo drives that nothing else gives, voltages and currents among them, with their sliders."""
    kernel = assembly.kernel
    if not isinstance(assembly.drive, NoControl):
        return []
    return [
        {"label": f"{name}: {one.meaning}", "place": place, "unit": one.unit, **_ends_of(robot, name, float(q0[place]))}
        for place, (name, one) in enumerate(kernel.inputs.items())
        if not one.is_force and name not in kernel.prescribed
    ]


def _ends_of(robot: Robot, name: str, at: float) -> dict[str, float]:
    """Return where the slider of a drive's input begins and ends: at its limits, where it has some."""
    numbers = coordinate_of(robot, name).law()
    outer = loops_of(numbers)[:1]
    if outer == ("position",):
        return {"start": at, "low": at - TURN, "high": at + TURN}
    key = {(): VOLTAGE_LIMIT, ("current",): CURRENT_LIMIT}.get(outer, "")
    most = numbers.get(key, INPUTS[outer[0] if outer else "voltage"])
    return {"start": 0.0, "low": -most, "high": most}


def _limits(robot: Robot, name: str, at: float, span: float) -> tuple[float, float]:
    """Return the ends of a target's slider: its limits, where there are any that are not too far apart."""
    low, high = principal_limits(robot, name)
    share = 2.0 * CLOSED_PART if robot.is_closed else 4.0
    if robot.is_closed or not high - low <= 4.0 * np.pi:
        low, high = max(low, at - share * span), min(high, at + share * span)
    return float(min(low, at)), float(max(high, at))


def _add_model(acting: dict[str, Any], model: ModelDrive, assembly: Assembly, q0: Array, notes: list[str]) -> None:
    """Add drives by a model: the rigid robot's, or of a mechanism with loops the forces that hold it at the start."""
    if model.mechanism is not None:
        kernel = assembly.kernel
        try:
            u = np.asarray(assembly.drive.standstill()(0.0, q0, np.zeros(kernel.n)))
        except (LoopError, EomgenError):
            u = np.zeros(kernel.n)
        for drive in acting["drives"]:
            u[drive["place"]] -= drive["kp"] / drive["ratio"] * (drive["start"] - q0[drive["place"]] / drive["ratio"])
        places = [drive["place"] for drive in acting["drives"]]
        acting["holding"] = np.where(np.isin(np.arange(kernel.n), places), u, 0.0).tolist()
        what = "computed torque" if model.bandwidth else "what gravity takes all along"
        notes.append(f"the mechanism has loops: in place of {what}, drives have gains and what holds it at the start")
        return
    rigid = model.calls
    acting["model"] = {**as_json(plain_model(model)), "driven": index_of(rigid.coordinates, assembly.driven).tolist()}
    acting["compensates"] = True


def _given(waves: Waves, coordinates: tuple[str, ...], names: tuple[str, ...]) -> dict[str, Any]:
    tracked = sorted({int(i) for track in waves.tracks for i in track.place})
    units = [unit_of(name) for name in names]
    most = [max(5.0 * abs(float(row[0])), 3.0 * SHAKE[unit]) for row, unit in zip(waves.wave, units, strict=True)]
    return {
        "names": list(names),
        **as_json(plain_prescribed(waves, index_of(coordinates, names).tolist())),
        "tracked": tracked,
        "units": units,
        "most": most,
    }


def _events(robot: Robot, scenario: Scenario) -> list[dict[str, Any]]:
    """Return the events at which links pick up and put down, with parameters from then on."""
    if not scenario.payloads:
        return []
    times = {0.0, *(load.t0 for load in scenario.payloads), *(x.t1 for x in scenario.payloads if x.t1 is not None)}
    return [{"t": t, "parameters": loaded_parameters(robot, scenario, t)} for t in sorted(times) if t >= 0.0]
