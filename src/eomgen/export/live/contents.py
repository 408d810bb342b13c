"""Everything that a page knows: the robot's geometry, its parameters, what acts on it, a motion that was recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arrays import Array
from ...codegen.kernels.groups import LIVE_PAGE
from ...codegen.kernels.interface import places_of_forces
from ...errors import EomgenError, InputError
from ...integration.plan import stiff_in_real_time
from ...kernel.complete import Kernel
from ...names import kind_of
from ...pictures.framing import ROUND_OFF, SHOWN_ANGLE, SHOWN_PART, STEP, drawn_points, first_factor
from ...pictures.scene import extent, program_positions
from ...progress import Progress
from ...robot.coordinates import unit_of
from ...robot.model import build_model, rigid_coordinates, tool_of
from ...robot.parameter_names import is_entry
from ...robot.value import ANGULAR, MOTOR, Robot
from ...scenario.recorded import scenario_from_record
from ...scenario.value import Scenario
from ...simulation.assembly import Assembly, is_rigid
from ...simulation.loads import body_parameters, with_payload_parameters
from ...simulation.result import SimulationResult
from ...state.springs import stiffnesses
from .acting import acting_on, default_scenario
from .geometry import geometry_of, packed, tool_place
from .sliders import parameter_sliders, scales_of

PERIOD, FINE_PERIOD = 4e-3, 2e-3  # s, in which drives and loads are held; of drives and loads that change fast
RTOL = 1e-4  # relative tolerance of steps
QUINTIC = 5.7735  # largest acceleration of a motion's quintic profile, of its length over its duration squared
MORE = 100.0  # times further they can be exaggerated
MOST_SAMPLES = 4000  # of a recording
VIEWED = 50  # of them, that the first view is to show
GRAVITY = 9.81  # m/s^2, by which forces of pushes are weighed
KERNELS = LIVE_PAGE


@dataclass(frozen=True)
class Contents:
    """Parts of a page.

    Attributes:
        robot: whose kernel the page has, with the parameters that are moved.
        rigid: the robot that drives know; None where they know none, the same as ``robot`` where it is rigid.
        values: all that is data, as JSON holds it.
    """

    robot: Robot
    rigid: Robot | None
    values: dict[str, Any]


def contents_of(robot: Robot, scenario: Scenario | None, result: SimulationResult | None, report: Progress) -> Contents:
    """Collect what a page about a robot, in a scenario or from a result on, shows and does.

    Raises:
        InputError: the scenario does not fit, or has a program that only Python can ask.
        LoopError: loops do not close at the start.
    """
    notes: list[str] = []
    tool = result.tool if result is not None else tool_of(robot, scenario.frame if scenario else None)
    acting, assembly, acts = _acting(robot, scenario, result, tool, report, notes)
    kernel, model = assembly.kernel, build_model(robot)
    link, point = tool_place(robot, tool)
    tunable = _tunable(robot, acts, link if link in model.links else None)
    values, deviations = dict(build_model(tunable).parameters), _deviations(robot, assembly)
    start = np.array(acting["start"]["q"])
    ends = [start, _at_goal(start, acting)] if result is None else list(_few(result.trajectory.q))
    report(0.0, "shapes of the robot")
    drawn, missing = geometry_of(robot, kernel.coordinates, np.array(ends))
    payload = link if link in model.links else None
    hidden = set(body_parameters(robot.link(payload))) - set(kernel.parameters) if payload else set()
    changed = {name for event in acting["events"] for name in event["parameters"]}
    entries = set(filter(is_entry, values))  # of matrices, which are more than single numbers
    sliders = parameter_sliders(tunable, values, frozenset(hidden | changed | entries))
    factor = 1.0  # what is exaggerated in a mechanism would tear its loops
    if not robot.is_closed:
        factor = first_factor(result, robot) if result else _factor(robot, kernel, start, deviations, acting)
    stiff = stiff_in_real_time(kernel, start)
    moving = sum(robot.link(name).mass for name in model.links)
    fine = acting["control"] in ("model", "reference") or acting["prescribed"] or acting["wrenches"] or acting["torque"]
    rigid = None if acting["model"] is None else robot.rigid()
    contents = {
        **acting,
        **drawn,
        "name": robot.name,
        "coordinates": list(kernel.coordinates),
        "units": [unit_of(name) for name in kernel.coordinates],
        "beside": places_of_forces(model),
        "states": [
            {"name": name, "unit": unit}
            for name, unit in zip(kernel.internal_states, kernel.internal_state_units, strict=True)
        ],
        "deviations": deviations,
        "closed": bool(robot.is_closed),
        "moving": list(kernel.links),
        "com": {name: list(robot.link(name).com) for name in kernel.links},
        "tool": tool,
        "push": {"link": payload, "point": point} if payload else None,
        "payload": {"link": payload, "point": point, "most": _rounded(0.5 * moving)} if payload else None,
        "force": _rounded(max(0.5 * GRAVITY * moving, 1e-3)),
        "parameters": sliders,
        "scales": scales_of(sliders),
        "exaggeration": factor,
        "most": max(MORE * factor, 1e3),
        "plot": _plot(kernel, deviations),
        "period": FINE_PERIOD if fine else PERIOD,
        "method": "rosenbrock" if stiff else "tsit5",
        "rtol": RTOL,
        "recorded": None if result is None else _recorded(result, acting, assembly),
        "notes": [*robot.notes, *missing, *notes],
        "about": _about(kernel),
    }
    return Contents(tunable, rigid, contents)


def _acting(
    robot: Robot,
    scenario: Scenario | None,
    result: SimulationResult | None,
    tool: str,
    report: Progress,
    notes: list[str],
) -> tuple[dict[str, Any], Assembly, Scenario]:
    """Return values of what acts, its assembly and scenario; default ones where a result has none that goes on."""
    if result is not None and result.scenario:
        try:
            kept = scenario_from_record(result.scenario, "the result's scenario")
            return *acting_on(robot, kept, tool, report, notes), kept
        except EomgenError as error:
            notes.append(f"what goes on from the recording is held by default drives: {error}")
    acts = scenario or default_scenario(robot)
    acting, assembly = acting_on(robot, acts, tool, report, notes)
    if scenario is None and result is None and acting["cycle"] is not None:
        acting["drive"] = "cycle"
    if scenario is None:
        acting["program"] = None
    return acting, assembly, acts


def _tunable(robot: Robot, scenario: Scenario, payload: str | None) -> Robot:
    """Return the robot with the parameters of links that pick something up, the tool's among them."""
    changing = with_payload_parameters(robot, scenario)
    if payload is None:
        return changing
    names = dict.fromkeys((*changing.tunable, *body_parameters(robot.link(payload))))
    return Robot(**{**vars(changing), "tunable": tuple(names)})


def _deviations(robot: Robot, assembly: Assembly) -> list[int]:
    """Return places of the coordinates that no drive, prescribed motion or loop moves; motors are none."""
    rigid = set(rigid_coordinates(robot)) if not is_rigid(robot) else set(assembly.kernel.coordinates)
    names = assembly.kernel.coordinates
    return [i for i, name in enumerate(names) if name not in rigid and kind_of(name) != MOTOR]


def _at_goal(q: Array, acting: dict[str, Any]) -> Array:
    """Return the pose of the robot at the other end of its default motion."""
    goal = np.array(q)
    if acting["cycle"] is not None:
        for drive, value in zip(acting["drives"], acting["cycle"]["goal"], strict=True):
            goal[drive["joint"]] = value
    return goal


def _few(q: Array) -> Array:
    rows = np.unique(np.linspace(0, len(q) - 1, min(len(q), VIEWED)).astype(np.intp))
    return np.asarray(q[rows], dtype=np.float64)


def _factor(robot: Robot, kernel: Kernel, q: Array, deviations: list[int], acting: dict[str, Any]) -> float:
    """Return the exaggeration that makes the deviations at rest and in the default motion visible; at least 1."""
    if not deviations:
        return 1.0
    names, share = kernel.coordinates, 0.0
    for bent in (q, q + _in_motion(robot, kernel, q, deviations, acting)):
        stiff = bent.copy()
        stiff[deviations] = 0.0
        moved = drawn_points(robot, names, bent) - drawn_points(robot, names, stiff)
        place = float(np.linalg.norm(moved, axis=-1).max()) / extent(robot)
        angle = max((abs(float(bent[i])) for i in deviations if kind_of(names[i]) in ANGULAR), default=0.0)
        share = max(share, place / SHOWN_PART, angle / SHOWN_ANGLE)
    if share < ROUND_OFF:
        return 1.0
    return _rounded(float(10.0 ** max(STEP * np.floor(-np.log10(share) / STEP), 0.0)))


def _in_motion(robot: Robot, kernel: Kernel, q: Array, deviations: list[int], acting: dict[str, Any]) -> Array:
    """Return deflections of the deviations' springs, (n,), under the largest accelerations of the default motion."""
    deflection, cycle = np.zeros_like(q), acting["cycle"]
    if cycle is None:
        return deflection
    a, still = np.zeros(kernel.n), np.zeros(kernel.n)
    for drive, first, last in zip(acting["drives"], cycle["start"], cycle["goal"], strict=True):
        a[drive["joint"]] = QUINTIC * (last - first) / cycle["duration"] ** 2
    rest = np.zeros(len(kernel.internal_states))
    force = kernel.inverse_dynamics(q, still, a, z=rest) - kernel.inverse_dynamics(q, still, still, z=rest)
    stiffness = stiffnesses(kernel)
    for i in deviations:
        deflection[i] = force[i] / stiffness[i] if stiffness[i] > 0.0 else 0.0
    return deflection


def _plot(kernel: Kernel, deviations: list[int]) -> str:
    """Return the plot that a page begins with beside the tool's: the first deviations that are angles, or the first."""
    names = [kernel.coordinates[i] for i in deviations]
    turning = [name for name in names if unit_of(name) == "rad"]
    if not names:
        return "positions"
    first = (turning or names)[min(1, len(turning or names) - 1)]
    kind = {"rad": "rotations", "m": "translations"}.get(unit_of(first), "modes")
    return f"{first.partition('.')[0]}.{kind}"


def _recorded(result: SimulationResult, acting: dict[str, Any], assembly: Assembly) -> dict[str, str]:
    """Return the motion of a result, in so many samples that a page holds them easily."""
    motion = result.trajectory
    rows = np.unique(np.linspace(0, motion.t.size - 1, min(motion.t.size, MOST_SAMPLES)).astype(np.intp))
    if motion.coordinates != assembly.kernel.coordinates:
        raise InputError(f"the result has coordinates of another robot than {assembly.kernel.name}")
    z = np.zeros((motion.t.size, 0)) if motion.z is None else motion.z
    program = program_positions(result)[rows][:, [drive["joint"] for drive in acting["drives"]]]
    return {
        "t": packed(motion.t[rows]),
        "q": packed(motion.q[rows]),
        "v": packed(motion.v[rows]),
        "z": packed(z[rows]),
        "program": packed(program),
    }


def _about(kernel: Kernel) -> str:
    """Count coordinates, internal states and moving links in words."""
    count = len(kernel.internal_states)
    states = f" {count} state{'s' * (count != 1)} of laws," if count else ""
    return f"{kernel.name}: {len(kernel.coordinates)} coordinates,{states} {len(kernel.links)} moving links."


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")
