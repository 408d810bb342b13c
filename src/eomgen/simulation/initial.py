"""Initial state of a scenario."""

from __future__ import annotations

from collections.abc import Container
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import IntegrationError, LoopError
from ..kernel.by_name import follower_matrix
from ..kernel.complete import Kernel
from ..loops.equilibrium import closed_equilibrium
from ..robot.coordinates import force_unit_of, index_of
from ..robot.mechanism import leading_home
from ..robot.parameter_names import CUT_BEARINGS, CUTS
from ..robot.value import Robot
from ..runtime.internal_states import cut_apart
from ..scenario.value import Scenario
from ..state.drives import has_drives, inputs_with, settled
from ..state.motors import shafts, turn_motors
from ..state.springs import clearances, journals_in_play, law_numbers, stiffnesses
from .assembly import Assembly, by_coordinate, initial_internal_states, names_in_scenarios
from .loads import loaded_parameters


def initial_state(robot: Robot, scenario: Scenario, assembly: Assembly) -> tuple[Array, Array, tuple[str, ...]]:
    """Return q, and v with internal states behind it, at t = 0, and the names of the coordinates that nothing holds.

    Those of a feed-forward where the scenario says nothing else.
    """
    initial, kernel = scenario.initial, assembly.kernel
    if assembly.begin is not None and not (initial and (initial.equilibrium or initial.q or initial.v)):
        q, v = (np.array(x) for x in assembly.begin)
        return q, np.append(v, np.zeros(len(kernel.internal_states))), ()
    home = leading_home(robot)
    q, v = np.array([home.get(name, 0.0) for name in kernel.coordinates]), np.zeros(kernel.calls.rates)
    driven = index_of(kernel.coordinates, assembly.driven)
    if assembly.program is not None:
        q[driven], v[driven] = (x for x in assembly.program.at(0.0)[:2])
    for name, value in assembly.initial_q.items():
        q[kernel.coordinates.index(name)] = value
    for name, value in initial_internal_states(robot, scenario, kernel.internal_states).items():
        v[kernel.calls.rate_names.index(name)] = value
    velocities = by_coordinate(robot, scenario, "v", initial.v if initial else {})
    for name, value in velocities.items():
        v[kernel.coordinates.index(name)] = value
    for x, said in ((q, {*assembly.initial_q, *_motors_at_home(robot, assembly)}), (v, velocities)):
        turn_motors(kernel, x, said)
    if assembly.prescribed is not None:
        prescribed = index_of(kernel.coordinates, kernel.prescribed)
        q[prescribed], v[prescribed], _ = assembly.prescribed(0.0)
    if kernel.constraints or assembly.path is not None:
        q, v = _closed(assembly, q, v, velocities)
        for x, said in ((q, {*assembly.initial_q, *_motors_at_home(robot, assembly)}), (v, velocities)):
            turn_motors(kernel, x, said)
    balanced = initial.equilibrium if initial else None
    if not (assembly.program is not None and not velocities if balanced is None else balanced):
        return q, v, ()
    fixed = initial.held if initial else ()
    for name in fixed:
        if name not in names_in_scenarios(robot):
            scenario.refuse("initial.held", name, kernel.coordinates)
    loose = _loose(robot, assembly)
    settles = has_drives(kernel) and not (initial and initial.z)
    servos = set(_servos(kernel))
    if settles:  # what controls a position finds it
        servos = {name for name in servos if kernel.inputs[name].meaning != "reference of position"}
    still = {*loose, *servos, *(names_in_scenarios(robot)[name] for name in fixed)}
    q = _balanced(robot, scenario, assembly, (q, v[kernel.n :]), still)
    if settles:
        v, lost = _settled(scenario, assembly, q, v)
        loose = (*loose, *lost)
    return q, v, loose


def _servos(kernel: Kernel) -> tuple[str, ...]:
    """Return the coordinates whose drives take something else than forces."""
    return tuple(name for name, x in kernel.inputs.items() if not x.is_force and name not in kernel.prescribed)


def _settled(scenario: Scenario, assembly: Assembly, q: Array, v: Array) -> tuple[Array, tuple[str, ...]]:
    """Return v with states of drives that hold the robot where it is, and the coordinates of drives that do not."""
    kernel, zero, wrenches = assembly.kernel, np.zeros(assembly.kernel.n), assembly.wrenches
    velocities, z = cut_apart(v, kernel.n)
    u, wrench = assembly.drive.standstill()(0.0, q, zero), None if wrenches is None else wrenches(0.0, q, zero)
    try:
        forces = kernel.inverse_dynamics(q, velocities, zero, z=z, wrench=wrench)
    except LoopError:  # these drives cannot hold it
        return v, _servos(kernel)
    try:
        return settled(kernel, q, v, u, forces)
    except IntegrationError as error:
        if not scenario.source:
            raise
        raise IntegrationError(f"{scenario.label('initial')}: {error}") from None


def _closed(assembly: Assembly, q: Array, v: Array, velocities: Container[str]) -> tuple[Array, Array]:
    """Assemble the state; coordinates of the reference and the scenario stay, as far as they are independent."""
    kernel, path = assembly.kernel, assembly.path
    fixed = [name for name in kernel.coordinates if name in assembly.initial_q]
    still = [name for name in kernel.coordinates if name in velocities]
    if path is not None:
        rigid, chart = path.mechanism.rigid, path.mechanism.chart
        for name, value in zip(rigid.coordinates, path.q[0].tolist(), strict=True):
            if name not in assembly.initial_q:
                q[kernel.coordinates.index(name)] = value
        moved = [rigid.coordinates[i] for i in chart.free]
        fixed, still = list(dict.fromkeys((*fixed, *moved))), list(dict.fromkeys((*still, *moved)))
    if not kernel.constraints:  # the loops are elastic
        return q, v
    q, (velocities, z) = kernel.assemble(q, fixed), cut_apart(v, kernel.n)
    return q, np.append(kernel.project_velocity(q, velocities, still), z)


def _motors_at_home(robot: Robot, assembly: Assembly) -> set[str]:
    """Return motors whose angles are those of the description's home, since nothing puts their joints elsewhere."""
    if assembly.program is not None:
        return set()
    return {
        motor
        for motor, joint in assembly.kernel.motors.items()
        if motor in robot.home and joint not in assembly.initial_q
    }


def _loose(robot: Robot, assembly: Assembly) -> tuple[str, ...]:
    """Return the names of deviations that nothing holds, as in a clearance; a motor takes up its gear's backlash."""
    kernel = assembly.kernel
    motors = shafts(kernel)
    stiff = dict(zip(kernel.coordinates, stiffnesses(kernel).tolist(), strict=True))
    moved = {*kernel.prescribed, *(motors.get(name, name) for name in assembly.driven)}
    if robot.is_closed:  # which hold what has no stiffness
        moved |= {name for name, k in stiff.items() if k == 0.0}
    played = {kernel.motors.get(name, name) for name in clearances(law_numbers(kernel))} | journals_in_play(kernel)
    for name, row in zip(kernel.follower_names, follower_matrix(kernel)[0], strict=True):
        played |= {kernel.coordinates[i] for i in np.flatnonzero(row)} if name in played else set()
    return tuple(name for name, k in stiff.items() if (k == 0.0 or name in played) and name not in moved)


def _balanced(
    robot: Robot, scenario: Scenario, assembly: Assembly, begin: tuple[Array, Array], still: set[str]
) -> Array:
    """Solve the static equilibrium near q under drives and wrenches at t = 0; clearances start in their middle.

    Args:
        begin: q, (n,), and the internal states, (m,), which stay.
        still: coordinates that are held.
    """
    kernel, drive, wrenches, (q, z) = assembly.kernel, assembly.drive.standstill(), assembly.wrenches, begin
    zero = np.zeros(kernel.n)
    kernel.parameters.update(loaded_parameters(robot, scenario, 0.0))

    def forces(qs: Array) -> Array:
        u = drive(0.0, qs, np.zeros_like(qs))
        if wrenches is None:
            return u
        if qs.ndim == 1:
            pull = wrenches(0.0, qs, zero)
        else:
            pull = np.array([wrenches(0.0, x, zero) for x in qs])
        return inputs_with(kernel, u, kernel.functions.external_force(qs, pull))

    states = z if z.size else None
    try:
        tight = _without_clearances(kernel)
        if tight is None:
            return closed_equilibrium(kernel, q, u=forces, fixed=still, z=states)
        q = closed_equilibrium(tight, q, u=forces, fixed=still, z=states)
        with suppress(IntegrationError):  # where something floats in its clearance, that is as good as any other place
            q = closed_equilibrium(kernel, q, u=forces, fixed=still, z=states)
        return q
    except IntegrationError as error:
        overloaded = _overloaded(robot, scenario, assembly, (q, z), still)
        if not overloaded and not scenario.source:
            raise
        raise IntegrationError(f"{scenario.label('initial')}: {overloaded or error}") from None


def _overloaded(
    robot: Robot, scenario: Scenario, assembly: Assembly, begin: tuple[Array, Array], still: set[str]
) -> str:
    """Say which clipped drives cannot hold the robot at the start; "" where others are to blame."""
    drive: Any = assembly.drive
    effort: Array | None = getattr(drive, "effort", None)
    if effort is None:
        return ""
    free = replace(assembly, drive=replace(drive, effort=None))
    try:
        posture = _balanced(robot, scenario, free, begin, still)
    except IntegrationError:
        return ""
    names = assembly.kernel.coordinates
    u = free.drive.standstill()(0.0, posture, np.zeros_like(posture))
    overloaded = [
        f"{names[i]} would have to do {u[i]:.4g} {force_unit_of(names[i])}, its effort is {effort[i]:.4g}"
        for i in np.flatnonzero(np.abs(u) > effort)
    ]
    allowed = "allowed: another start, initial.equilibrium = false, or without control.saturate"
    return f"{robot.name}: no static equilibrium within the efforts of its drives: {'; '.join(overloaded)}; {allowed}"


def _without_clearances(kernel: Kernel) -> Kernel | None:
    """Return the kernel without clearances of loop joints and couplings, which have no coordinate; None if it is so."""
    names, cuts = tuple(kernel.parameters), kernel.elements.get(CUTS, {})
    bearings = kernel.elements.get(CUT_BEARINGS, {})
    gaps = [names[places["clearance"]] for places in (*cuts.values(), *bearings.values()) if "clearance" in places]
    open_gaps = [name for name in gaps if kernel.parameters[name]]
    return kernel.replaced(parameters=dict.fromkeys(open_gaps, 0.0)) if open_gaps else None
