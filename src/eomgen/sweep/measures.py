"""Measures that a sweep records of a sample's motion, by name and in the order of columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..codegen.kernels.groups import JOINT_REACTIONS
from ..errors import InputError
from ..kernel.complete import Kernel
from ..motion.exceeding import excesses
from ..names import joint_of
from ..robot.coordinates import index_of, rotating_joints, unit_of
from ..robot.value import Robot
from ..scenario.value import Scenario
from ..simulation.assembly import Assembly
from ..simulation.result import SimulationResult
from ..simulation.side_by_side import DRIVES, POSE, WRENCHES
from ..state.motors import shafts
from ..state.turning import quaternion_columns
from .plan import Plan

NEEDS = {"reaction_max": JOINT_REACTIONS}  # kernels beside those of a simulation
READS = {  # fields of results that not all motions have, by recorded name
    "tool_deviation_max": (POSE,),
    "tool_deviation_rms": (POSE,),
    "tool_deviation_end": (POSE,),
    "tool_rotation_max": (POSE,),
    "drive_max": (DRIVES,),
    "drive_rms": (DRIVES,),
    "reaction_max": (DRIVES, WRENCHES),
}
BALANCED = "energy_residue"  # which takes work integrals, of each motion by itself
KINDS = (("linear", "m"), ("angular", "rad"))


@dataclass(frozen=True)
class Column:
    """A recorded number: its name, such as "drive_max.joint1.gamma", and its unit."""

    name: str
    unit: str


def check_record(plan: Plan, scenario: Scenario, assembly: Assembly) -> None:
    """Raise the plan's DescriptionError where something to record has no meaning in the scenario."""
    if "tracking_max" in plan.record and assembly.program is None:
        plan.fail("record", "tracking_max: there is no reference; allowed: with a motion, pd or computed_torque")
    if "reaction_max" in plan.record and scenario.payloads:
        plan.fail("record", "reaction_max: the scenario has payloads, whose masses change; allowed: without them")
    if not assembly.kernel.internal_states and (
        states := [name for name in ("state_max", "state_end") if name in plan.record]
    ):
        plan.fail("record", f"{states[0]}: no law has a state; allowed: of robots with such laws")
    if "quaternion_end" in plan.record and not rotating_joints(assembly.kernel.coordinates):
        plan.fail("record", "quaternion_end: no joint has alpha, beta and gamma; allowed: with a free or ball joint")


def measure(result: SimulationResult, assembly: Assembly, names: Sequence[str]) -> tuple[tuple[Column, ...], Array]:
    """Return columns and numbers of a motion."""
    numbers: list[tuple[str, str, float]] = []
    for name in names:
        numbers += _READERS[name](name, result, assembly)
    return tuple(Column(name, unit) for name, unit, _ in numbers), np.array([value for _, _, value in numbers])


Measured = list[tuple[str, str, float]]


def exceeded_limits(robot: Robot, result: SimulationResult) -> tuple[str, ...]:
    """Return the limits of a robot that a motion exceeds, as far as it knows its drives: "joint1.gamma speed", say."""
    motion, u = result.trajectory, result.trajectory.u.copy()
    others = [unit not in ("N", "N m") for unit in motion.input_units or ()]
    u[:, np.flatnonzero(others)] = 0.0  # inputs of drives that are no forces do not tell of these
    beyond = excesses(robot, motion.coordinates, q=motion.q, v=motion.v, u=u)
    return tuple(f"{excess.coordinate} {excess.kind}" for excess in beyond)


def _tool(name: str, result: SimulationResult, _: Assembly) -> Measured:
    distance = np.linalg.norm(result.tool_deviation, axis=1)
    kind = name.rpartition("_")[2]
    value = {"max": distance.max(), "rms": _rms(distance), "end": distance[-1]}[kind]
    return [(name, "m", float(value))]


def _rms(values: Array) -> float:
    """Return the root mean square over equal distances in time."""
    return float(np.sqrt((values**2).mean()))


def _rotation(name: str, result: SimulationResult, _: Assembly) -> Measured:
    return [(name, "rad", float(result.tool_rotation.max()))]


def _drives(name: str, result: SimulationResult, assembly: Assembly) -> Measured:
    motion, largest = result.trajectory, []
    motors = shafts(assembly.kernel)
    for coordinate in (motors.get(x, x) for x in assembly.driven):
        u = motion.u[:, motion.coordinates.index(coordinate)]
        value = np.abs(u).max() if name == "drive_max" else _rms(u)
        largest.append((f"{name}.{coordinate}", assembly.kernel.inputs[coordinate].unit, float(value)))
    return largest


def _tracking(name: str, result: SimulationResult, _: Assembly) -> Measured:
    largest = np.abs(result.tracking_error).max(axis=0)
    return [(f"{name}.{x}", unit_of(x), float(e)) for x, e in zip(result.program_coordinates, largest, strict=True)]


def _deviations(name: str, result: SimulationResult, _: Assembly) -> Measured:
    """Return the largest linear and the largest angular deviation of each joint."""
    largest_by_joint: dict[tuple[str, str], float] = {}
    largest = np.abs(result.deviations).max(axis=0)
    for coordinate, value in zip(result.deviation_coordinates, largest.tolist(), strict=True):
        for kind, unit in KINDS:
            if unit_of(coordinate) == unit:
                key = (f"{name}.{joint_of(coordinate)}.{kind}", unit)
                largest_by_joint[key] = max(largest_by_joint.get(key, 0.0), value)
    return [(*key, value) for key, value in largest_by_joint.items()]


def _coordinates(name: str, result: SimulationResult, _: Assembly) -> Measured:
    q = result.trajectory.q
    values = np.abs(q).max(axis=0) if name == "coordinate_max" else q[-1]
    names = result.trajectory.coordinates
    return [(f"{name}.{x}", unit_of(x), value) for x, value in zip(names, values.tolist(), strict=True)]


def _states(name: str, result: SimulationResult, assembly: Assembly) -> Measured:
    """Return the largest size of each internal state, or what it is at the end."""
    z, kernel = result.trajectory.z, assembly.kernel
    assert z is not None
    values = np.abs(z).max(axis=0) if name == "state_max" else z[-1]
    each = zip(kernel.internal_states, kernel.internal_state_units, values.tolist(), strict=True)
    return [(f"{name}.{x}", unit, value) for x, unit, value in each]


def _quaternions(name: str, result: SimulationResult, _: Assembly) -> Measured:
    """Return components at the end; signs are continued from sample time to sample time, alike in all samples."""
    columns = quaternion_columns(result.trajectory.coordinates, result.trajectory.q)
    return [(f"{name}.{x}", "", float(values[-1])) for x, values in columns.items()]


def _reactions(name: str, result: SimulationResult, assembly: Assembly) -> Measured:
    motion, kernel = result.trajectory, assembly.kernel
    q, v, u, z = motion.q, motion.v, motion.u.copy(), motion.z
    if assembly.prescribed is not None:
        prescribed = index_of(kernel.coordinates, kernel.prescribed)
        u[:, prescribed] = [assembly.prescribed(t)[2] for t in motion.t.tolist()]
    a = kernel.forward_dynamics(q, v, u, z, wrench=result.wrench)
    wrenches = kernel.reactions(q, v, a, wrench=result.wrench, z=z)
    force, moment = (
        np.linalg.norm(components, axis=2).max(axis=0) for components in (wrenches[..., :3], wrenches[..., 3:])
    )
    rows: Measured = []
    for joint, f, m in zip(kernel.joints, force.tolist(), moment.tolist(), strict=True):
        rows += [(f"{name}.{joint}.force", "N", f), (f"{name}.{joint}.moment", "N m", m)]
    return rows


def _residue(name: str, result: SimulationResult, _: Assembly) -> Measured:
    if result.balance is None:
        raise InputError(f"{name}: the motion has no energy balance")
    return [(name, "", result.balance.relative_residue)]


_READERS: dict[str, Callable[[str, SimulationResult, Assembly], Measured]] = {
    "tool_deviation_max": _tool,
    "tool_deviation_rms": _tool,
    "tool_deviation_end": _tool,
    "tool_rotation_max": _rotation,
    "drive_max": _drives,
    "drive_rms": _drives,
    "tracking_max": _tracking,
    "deviation_max": _deviations,
    "reaction_max": _reactions,
    "coordinate_max": _coordinates,
    "coordinate_end": _coordinates,
    "state_max": _states,
    "state_end": _states,
    "quaternion_end": _quaternions,
    "energy_residue": _residue,
}


def rigid_pose(kernel: Kernel, result: SimulationResult) -> Array:
    """Return the tool's pose of the nominal robot on its reference without deviations, (T, 4, 4)."""
    q = np.zeros_like(result.trajectory.q)
    q[:, index_of(kernel.coordinates, result.program_coordinates)] = result.program_q
    prescribed = index_of(kernel.coordinates, kernel.prescribed)
    q[:, prescribed] = result.trajectory.q[:, prescribed]
    return np.asarray(kernel.frame_pose(q, result.tool))
