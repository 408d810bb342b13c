"""The state of a scenario at its beginning."""

from __future__ import annotations

from collections.abc import Container
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import IntegrationError
from ..loops.equilibrium import closed_equilibrium
from ..robot.coordinates import force_unit_of, index_of
from ..robot.mechanism import leading_home
from ..robot.parameter_names import CUT_BEARINGS, CUTS
from ..robot.value import Robot
from ..runtime.kernel import Kernel
from ..scenario.value import Scenario
from ..state.motors import shafts, turn_motors
from ..state.springs import clearances, journals_in_play, law_numbers, stiffnesses
from .assembly import Assembly, by_coordinate, names_in_scenarios
from .loads import loaded_parameters


def initial_state(robot: Robot, scenario: Scenario, assembly: Assembly) -> tuple[Array, Array, tuple[str, ...]]:
    """q and v at t = 0, and the names of the coordinates that nothing holds."""
    initial, kernel = scenario.initial, assembly.kernel
    home = leading_home(robot)
    q, v = np.array([home.get(name, 0.0) for name in kernel.coordinates]), np.zeros(kernel.n)
    driven = index_of(kernel.coordinates, assembly.driven)
    if assembly.program is not None:
        q[driven], v[driven] = (x for x in assembly.program.at(0.0)[:2])
    for name, value in assembly.given.items():
        q[kernel.coordinates.index(name)] = value
    rates = by_coordinate(robot, scenario, "v", initial.v if initial else {})
    for name, value in rates.items():
        v[kernel.coordinates.index(name)] = value
    for x, said in ((q, {*assembly.given, *_motors_at_home(robot, assembly)}), (v, rates)):
        turn_motors(kernel, x, said)
    if assembly.prescribed is not None:
        given = index_of(kernel.coordinates, kernel.prescribed)
        q[given], v[given], _ = assembly.prescribed(0.0)
    if kernel.constraints or assembly.path is not None:
        q, v = _closed(assembly, q, v, rates)
        for x, said in ((q, {*assembly.given, *_motors_at_home(robot, assembly)}), (v, rates)):
            turn_motors(kernel, x, said)
    balanced = initial.equilibrium if initial else None
    if not (assembly.program is not None and not rates if balanced is None else balanced):
        return q, v, ()
    held = initial.held if initial else ()
    for name in held:
        if name not in names_in_scenarios(robot):
            scenario.refuse("initial.held", name, kernel.coordinates)
    loose = _loose(robot, assembly)
    still = {*loose, *(names_in_scenarios(robot)[name] for name in held)}
    return _balanced(robot, scenario, assembly, q, still), v, loose


def _closed(assembly: Assembly, q: Array, v: Array, rates: Container[str]) -> tuple[Array, Array]:
    """The state with its loops closed; what the program and the scenario say stays, as far as it is independent."""
    kernel, path = assembly.kernel, assembly.path
    held = [name for name in kernel.coordinates if name in assembly.given]
    still = [name for name in kernel.coordinates if name in rates]
    if path is not None:
        rigid, chart = path.mechanism.rigid, path.mechanism.chart
        for name, value in zip(rigid.coordinates, path.q[0].tolist(), strict=True):
            if name not in assembly.given:
                q[kernel.coordinates.index(name)] = value
        moved = [rigid.coordinates[i] for i in chart.free]
        held, still = list(dict.fromkeys((*held, *moved))), list(dict.fromkeys((*still, *moved)))
    if not kernel.constraints:  # the loops are elastic
        return q, v
    q = kernel.close(q, held)
    return q, kernel.close_rates(q, v, still)


def _motors_at_home(robot: Robot, assembly: Assembly) -> set[str]:
    """Motors whose angles are those of the description's home, since nothing puts their joints elsewhere."""
    if assembly.program is not None:
        return set()
    return {
        motor for motor, joint in assembly.kernel.motors.items() if motor in robot.home and joint not in assembly.given
    }


def _loose(robot: Robot, assembly: Assembly) -> tuple[str, ...]:
    """Names of the deviations that nothing holds; inside a clearance nothing does, and of a joint with backlash the
    motor takes up its side.
    """
    kernel = assembly.kernel
    motors = shafts(kernel)
    moved = {*kernel.prescribed, *(motors.get(name, name) for name in assembly.driven)}
    if robot.is_closed:  # which hold what has no stiffness
        moved |= {name for name, k in zip(kernel.coordinates, stiffnesses(kernel), strict=True) if k == 0.0}
    played = {kernel.motors.get(name, name) for name in clearances(law_numbers(kernel))} | journals_in_play(kernel)
    for name, row in zip(kernel.follower_names, kernel.follower_matrix()[0], strict=True):
        played |= {kernel.coordinates[i] for i in np.flatnonzero(row)} if name in played else set()
    return tuple(
        name
        for name, k in zip(kernel.coordinates, stiffnesses(kernel), strict=True)
        if (k == 0.0 or name in played) and name not in moved
    )


def _balanced(robot: Robot, scenario: Scenario, assembly: Assembly, q: Array, still: set[str]) -> Array:
    """Equilibrium near q under the drives and wrenches at t = 0; a coordinate with clearance starts in its middle."""
    kernel, drive, wrenches = assembly.kernel, assembly.drive.resting(), assembly.wrenches
    at_rest = np.zeros(kernel.n)
    kernel.parameters.update(loaded_parameters(robot, scenario, 0.0))

    def forces(qs: Array) -> Array:
        u = drive(0.0, qs, np.zeros_like(qs))
        if wrenches is None:
            return u
        if qs.ndim == 1:
            return u + kernel.external_force(qs, wrenches(0.0, qs, at_rest))
        return u + kernel.external_force(qs, np.array([wrenches(0.0, x, at_rest) for x in qs]))

    try:
        taut = _taut(kernel)
        if taut is None:
            return closed_equilibrium(kernel, q, u=forces, held=still)
        q = closed_equilibrium(taut, q, u=forces, held=still)
        with suppress(IntegrationError):  # where something floats in its play, that is as good as any other place
            q = closed_equilibrium(kernel, q, u=forces, held=still)
        return q
    except IntegrationError as error:
        weak = _too_weak(robot, scenario, assembly, q, still)
        if not weak and not scenario.source:
            raise
        raise IntegrationError(f"{scenario.label('initial')}: {weak or error}") from None


def _too_weak(robot: Robot, scenario: Scenario, assembly: Assembly, q: Array, still: set[str]) -> str:
    """Say which drives that are clipped cannot hold the robot at the start; nothing where others are to blame."""
    drive: Any = assembly.drive
    effort: Array | None = getattr(drive, "effort", None)
    if effort is None:
        return ""
    free = replace(assembly, drive=replace(drive, effort=None))
    try:
        held = _balanced(robot, scenario, free, q, still)
    except IntegrationError:
        return ""
    names = assembly.kernel.coordinates
    u = free.drive.resting()(0.0, held, np.zeros_like(held))
    weak = [
        f"{names[i]} would have to do {u[i]:.4g} {force_unit_of(names[i])}, its effort is {effort[i]:.4g}"
        for i in np.flatnonzero(np.abs(u) > effort)
    ]
    allowed = "allowed: another start, initial.equilibrium = false, or without control.saturate"
    return f"{robot.name}: no static equilibrium within the efforts of its drives: {'; '.join(weak)}; {allowed}"


def _taut(kernel: Kernel) -> Kernel | None:
    """The kernel without play in cut joints and couplings, which no coordinate of its own can be held in; or None."""
    names, cuts = tuple(kernel.parameters), kernel.elements.get(CUTS, {})
    bearings = kernel.elements.get(CUT_BEARINGS, {})
    gaps = [names[places["clearance"]] for places in (*cuts.values(), *bearings.values()) if "clearance" in places]
    play = [name for name in gaps if kernel.parameters[name]]
    return kernel.with_parameters(dict.fromkeys(play, 0.0)) if play else None
