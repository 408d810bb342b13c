"""A scenario meets a robot: kernels are built, names resolved, drives and motions made."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..codegen.kernels.groups import (
    CLOSED_SIMULATION,
    ELECTRIC_DRIVES,
    ENERGY_BALANCE,
    EXTERNAL_WRENCHES,
    FRAME_POSES,
    IMPLICIT_STEPS,
    INERTIA,
    RIGID_MODEL,
    SIMULATED_BATCHES,
    SIMULATED_STATES,
    SIMULATION,
    kernel_group,
)
from ..codegen.kernels.signatures import BATCHES, SINGLES
from ..errors import InputError
from ..integration.plan import may_take_radau, turns_of
from ..integration.until import Until
from ..kernel.complete import Kernel
from ..kernel.stepping.input_signals import Gains
from ..kernel.stepping.methods import AUTO, EXPLICIT_METHODS, IN_C, RADAU
from ..kernel.stepping.options import rollout_of
from ..kernel.stepping.saturation import efforts_of
from ..motion.point_to_point import Program
from ..motion.splines import Standstill, signal_of
from ..motion.timetable import TimeTable
from ..names import DriveInput, joint_of, listed, nearest
from ..pipeline.ahead import Ahead, build_function
from ..pipeline.building import build, build_groups
from ..pipeline.mechanisms import mechanism_kernels
from ..progress import Progress
from ..robot.coordinates import coordinate_names, index_of
from ..robot.internal_states.drives import LOOPS, loops_of
from ..robot.mechanism import coordinate_of, drive_of, following_text, leading_coordinate, leading_home
from ..robot.model import build_model, program_coordinates
from ..robot.record import record_of, robot_hash
from ..robot.value import Robot
from ..runtime.internal_states import split_state
from ..scenario.value import Scenario, Section
from ..state.motors import shafts
from ..state.springs import any_spring
from .controls import (
    ComputedTorque,
    Control,
    JointMotion,
    JointPD,
    MixedControl,
    NoControl,
    ReferenceControl,
    TableTorque,
    actuators,
)
from .feedforward_control import Reference, feedforward_start
from .loads import Wrenches, check_loads, with_payload_parameters
from .mechanism import Mechanism, Path, mechanism_of
from .references import PrescribedMotion, make_reference
from .sampled_drive import SampledDrive

BANDWIDTH = 30.0  # rad/s, of drives by computed torque
FOLLOWING = ("pd", "computed_torque", "reference", "feedforward")  # controls that follow a motion, or hold the pose
REFERENCES = ("reference of position", "reference of velocity")  # that drives take


@dataclass(frozen=True)
class Facts:
    """Record of a robot and its scenario for the results of all its motions, made once.

    description: the robot's record.  scenario: its values.  is_rigid: whether no joint deviates.
    """

    description: Mapping[str, Any]
    robot_hash: str
    scenario: Mapping[str, Any]
    is_rigid: bool


@dataclass(frozen=True)
class Assembly:
    """A scenario for one robot: kernel, driven coordinates, reference trajectory, drives, wrenches, prescribed motion.

    initial_q: initial positions by coordinate, as the scenario has them.  path: of the rigid mechanism along the
    reference, where there are loops.  until: terminal event, if any.  wanted: the reference that the drives' one
    corrects (``program`` is a compensated path then).  begin: q and v with which a feed-forward begins.  notes: about
    the drives.
    """

    kernel: Kernel
    driven: tuple[str, ...]
    initial_q: Mapping[str, float]
    program: Program | None
    drive: Control
    wrenches: Wrenches | None
    prescribed: PrescribedMotion | None
    path: Path | None
    until: Until | None
    facts: Facts
    wanted: Program | None = None
    begin: tuple[Array, Array] | None = None
    notes: tuple[str, ...] = ()

    @property
    def shown(self) -> Program | None:
        """The reference that results are compared with."""
        return self.program if self.wanted is None else self.wanted


def assemble(
    robot: Robot,
    scenario: Scenario,
    tool: str,
    report: Progress,
    kernels: tuple[str, ...] | None = None,
    ahead: Ahead | None = None,
) -> Assembly:
    """Scenario -> Assembly; DescriptionError or another InputError where they do not fit.

    Args:
        robot, scenario, report: as of ``run_scenario``.
        tool: that of paths.
        kernels: are built, in one library; without names each is when it is called.
        ahead: begins to build those that the scenario's integrator calls, without ``kernels``.
    """
    model = build_model(robot)
    names = [model.coordinates[i] for i in model.prescribed]
    check_loads(scenario, robot)
    known = model.coordinates, names, robot.principal_coordinates
    prescribed = PrescribedMotion(scenario, *known) if names or scenario.prescribed else None
    driven = program_coordinates(robot)
    usual = default_control(robot)
    hold = scenario.motion is not None or any(_position_loops(robot))
    control = scenario.control or Section(usual if hold else "none")
    if not driven and control.type in FOLLOWING:
        raise InputError(
            f"{robot.name}: no joint has a principal coordinate, so there is nothing to drive; "
            "eomgen.integration.integrate integrates free motions"
        )
    if control.type in FOLLOWING:
        _refuse_undriven(robot, driven)
    if scenario.motion is not None and control.type in ("none", "torque"):
        scenario.fail(
            "motion", f"nothing follows it under control.type = {control.type!r}; allowed: {', '.join(FOLLOWING)}"
        )
    initial_q = by_coordinate(robot, scenario, "q", scenario.initial.q if scenario.initial else {})
    changing = with_payload_parameters(robot, scenario)
    kernel = _kernel(changing, scenario, kernels, report)
    if ahead is not None and kernels is None and not robot.is_closed:
        _begin(ahead, kernel, kernels_of(robot, scenario), turns_of(kernel, scenario.integrator))

    @cache
    def rigid() -> Kernel:
        if is_rigid(robot) and not scenario.payloads:  # drives do not know of payloads
            return kernel
        return build(
            robot.rigid(), kernels=rigid_kernels(robot), progress=lambda text: report(0.0, f"rigid model: {text}")
        )

    start = {**leading_home(robot), **initial_q}
    if prescribed is not None:
        start |= dict(zip(names, prescribed(0.0)[0].tolist(), strict=True))
    program: Program | None = None
    wanted: Program | None = None
    if scenario.motion is not None and scenario.motion.type == "program":
        program = scenario.motion.get("program")
    elif scenario.motion is not None:
        program = make_reference(scenario, robot, driven, rigid, tool, start)
        wanted = _wanted(scenario, robot, lambda whole: make_reference(whole, robot, driven, rigid, tool, start))
    elif control.type in FOLLOWING:
        program = Standstill(np.array([start.get(name, 0.0) for name in driven]))
    path = None
    if robot.is_closed and program is not None:
        moved = None if prescribed is None else _joint_motion(kernel, rigid(), prescribed)
        begin = start | dict(zip(driven, program.at(0.0)[0].tolist(), strict=True))
        if moved is not None:
            begin |= dict(zip(rigid().prescribed, moved(0.0)[0].tolist(), strict=True))
        path = mechanism_of(rigid(), driven, begin).path(program, moved, scenario.duration)
    mechanism = None if path is None else path.mechanism
    context = _DriveContext(driven, program, prescribed, mechanism)
    drive = _drive(robot, scenario, control, kernel, rigid, context)
    begun: tuple[Array, Array] | None = None
    notes: tuple[str, ...] = ()
    if control.type == "feedforward":
        kp, kd = (_gains(robot, scenario, key, control.get(key, 0.0), driven) for key in ("kp", "kd"))
        if program is None or scenario.motion is None:
            scenario.fail("motion", "there is none; allowed: a motion for feed-forward")
        moved_by = Reference(program, driven)
        drive, begun, notes = feedforward_start(robot, scenario, control, kernel, moved_by, Gains(kp, kd))
    if control.get("saturate"):
        drive = _saturated(scenario, kernel, driven, drive, mechanism)
    wrenches = Wrenches(scenario, robot, kernel) if scenario.wrenches else None
    facts = Facts(record_of(robot), robot_hash(robot), scenario.as_dict(), is_rigid(robot))
    until = _until(scenario, robot, kernel)
    return Assembly(
        kernel, driven, initial_q, program, drive, wrenches, prescribed, path, until, facts, wanted, begun, notes
    )


def _wanted(scenario: Scenario, robot: Robot, make: Callable[[Scenario], Program]) -> Program | None:
    """Return the reference that a sampled one corrects; None where it names none."""
    motion = scenario.motion
    if motion is None or motion.get("wanted") is None:
        return None
    if robot.is_closed:
        scenario.fail("motion.wanted", f"{robot.name} has loops or couplings; allowed: robots without them")
    return make(replace(scenario, motion=Section(motion.type, {"file": motion.get("wanted")})))


def is_rigid(robot: Robot) -> bool:
    """Return whether a robot has no deviations: nothing moves but what its rigid robot has, too."""
    rigid = robot.rigid()
    return all(getattr(rigid, key) == getattr(robot, key) for key in ("joints", "loops", "couplings"))


def rigid_kernels(robot: Robot) -> tuple[str, ...]:
    """Return the names of the rigid robot's kernels that drives and references call."""
    rigid = robot.rigid()
    closing = mechanism_kernels(rigid)
    return (*kernel_group(rigid, FRAME_POSES), *closing) if closing else kernel_group(rigid, RIGID_MODEL)


def _kernel(robot: Robot, scenario: Scenario, kernels: tuple[str, ...] | None, report: Progress) -> Kernel:
    """Return a kernel with these functions in one library, or one whose functions are built when they are called."""
    if kernels is not None:
        return build(robot, kernels=kernels, progress=lambda text: report(0.0, text))
    report(0.0, f"building kernels of {robot.name}")
    if robot.is_closed:  # which few of its many kernels are called depends on the integrator
        return build(robot)
    groups = {SINGLES: SIMULATED_STATES, BATCHES: SIMULATED_BATCHES}
    works = SINGLES if _may_run_in_c(scenario) else BATCHES  # where the energy balance asks
    further = {works: ENERGY_BALANCE}
    wrenches = EXTERNAL_WRENCHES if scenario.wrenches else ()
    return build_groups(
        robot, {half: kernel_group(robot, group, wrenches, further.get(half, ())) for half, group in groups.items()}
    )


def _begin(ahead: Ahead, kernel: Kernel, kernels: tuple[str, ...], turns: tuple[str, ...]) -> None:
    """Begin to build what the integrator will call, the longest build first.

    turns: methods that "auto" takes in C.
    """
    rollouts = [name for name in kernels if name in kernel.raw.rollouts]
    if len(rollouts) > 1:  # one of them takes all steps
        rollouts = [rollout_of(RADAU if RADAU in turns else AUTO)]
    jacobians = [name for name in IMPLICIT_STEPS if name in kernels and any_spring(kernel)]
    for name in (*rollouts, *jacobians):
        kernel.raw.libraries.about(name)  # which derives it
    singles = [partial(build_function, kernel, name) for name in (*rollouts, *INERTIA, *jacobians)]
    ahead.begin(*singles, partial(build_function, kernel, kernel.inverse_dynamics, batch=True))


def _refuse_undriven(robot: Robot, moved: tuple[str, ...]) -> None:
    """Raise InputError if a reference moves coordinates of a tree without an actuator in the description."""
    if robot.driven is None or robot.is_closed:
        return
    drives = {drive_of(robot, leading_coordinate(robot, name)) for name in robot.driven}
    without = [name for name in moved if drive_of(robot, name) not in drives]
    if without:
        raise InputError(
            f"{robot.name}: nothing drives {listed(without)}, which a controlled motion moves; allowed: a robot whose"
            " 'driven' names them, or control.type 'none' or 'torque'"
        )


def _refuse_tied(robot: Robot) -> None:
    """Raise InputError if a tree's couplings hold coordinates of its rigid robot, which lacks their deviations."""
    rigid = robot.rigid()
    ties = [x.name.removesuffix("_rigid") for x in rigid.couplings if x.is_constraint]
    if ties and rigid.is_closed and not robot.is_closed:
        raise InputError(
            f"{robot.name}: without deviations, as drives know the robot, the coupling {listed(ties)} ties coordinates"
            " that they move; allowed: control.type 'none' or 'torque', or 'pd' without gravity"
        )


def kernels_of(robot: Robot, scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the kernels that the scenario's integrator may call."""
    rollouts = _rollouts(scenario)
    closing = mechanism_kernels(robot)
    drives = ELECTRIC_DRIVES if build_model(robot).drives else ()
    if closing:
        return (*closing, *kernel_group(robot, CLOSED_SIMULATION, drives), *rollouts)
    if drives or rollouts or scenario.integrator.method in EXPLICIT_METHODS:
        return (*kernel_group(robot, SIMULATION, drives), *rollouts)
    return kernel_group(robot, SIMULATION, IMPLICIT_STEPS)


def _rollouts(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the kernels whose C may integrate the scenario."""
    if not _may_run_in_c(scenario):
        return ()
    further = (rollout_of(RADAU),) if may_take_radau(scenario.integrator) else ()
    return (rollout_of(scenario.integrator.method), *further)


def _may_run_in_c(scenario: Scenario) -> bool:
    """Return whether the kernel's C integrates the scenario, as far as that is known before there is a kernel."""
    motion = scenario.motion
    by_python = motion is not None and motion.type == "program" and signal_of(motion.get("program")) is None
    return scenario.integrator.method in (*IN_C, AUTO) and not by_python


def with_kernel(assembly: Assembly, robot: Robot, scenario: Scenario, kernel: Kernel) -> Assembly:
    """Return the assembly for a kernel of other parameters; program and drives stay, with the model that they know."""
    wrenches = Wrenches(scenario, robot, kernel) if scenario.wrenches else None
    return replace(assembly, kernel=kernel, wrenches=wrenches, until=_until(scenario, robot, kernel))


def _until(scenario: Scenario, robot: Robot, kernel: Kernel) -> Until | None:
    """Return the scenario's terminal event; DescriptionError where the robot has no such coordinate or frame."""
    section = scenario.until
    if section is None:
        return None
    places = names_in_scenarios(robot)
    try:
        if section.type == "coordinate":
            name = section.get("coordinate")
            return Until.coordinate(kernel, places.get(name, name), section.get("value"))
        return Until.distance(kernel, *(section.get(key) for key in ("frame", "point", "distance")))
    except InputError as error:
        scenario.fail("until", str(error).removeprefix("until: "))


def by_coordinate(robot: Robot, scenario: Scenario, key: str, values: Mapping[str, float]) -> dict[str, float]:
    """Return numbers of ``[initial]`` by the full names of coordinates, none of them prescribed."""
    places = names_in_scenarios(robot)
    positions: dict[str, float] = {}
    for name, value in values.items():
        where = f"initial.{key}.{name}"
        if name not in places:
            said = following_text(robot, name) or f"no coordinate of that name{nearest(name, places)}"
            scenario.fail(where, f"{said}; allowed: {', '.join(places)}")
        full = places[name]
        if full in positions:
            scenario.fail(where, f"{full} stands twice; allowed: once")
        if robot.coordinates[full].prescribed:
            scenario.fail(where, f"{full} is prescribed, and [[prescribed]] says where it begins; allowed: others")
        positions[full] = value
    return positions


def initial_internal_states(robot: Robot, scenario: Scenario, internal_states: tuple[str, ...]) -> dict[str, float]:
    """Return numbers of ``initial.z`` by the full names of internal states, which begin with a coordinate's."""
    owners = names_in_scenarios(robot)
    short: dict[str, list[str]] = {}
    for name, full in owners.items():
        short.setdefault(full, []).append(name)
    places = {name: name for name in internal_states}
    for full in internal_states:
        owner, *_ = split_state(full)
        places |= {name + full.removeprefix(owner): full for name in short.get(owner, ())}
    states: dict[str, float] = {}
    for name, value in (scenario.initial.z if scenario.initial else {}).items():
        where = f"initial.z.{name}"
        if name not in places:
            allowed = ", ".join(places) or f"none, as no law of {robot.name} has a state"
            scenario.fail(where, f"no state of that name{nearest(name, places)}; allowed: {allowed}")
        if places[name] in states:
            scenario.fail(where, f"{places[name]} stands twice; allowed: once")
        states[places[name]] = value
    return states


def names_in_scenarios(robot: Robot) -> dict[str, str]:
    """Return full names of coordinates by what a scenario may call them: their joint alone if they are principal.

    Followers of rigid couplings are not among them.
    """
    followers = robot.followers
    names = {name: name for name in coordinate_names(robot) if name not in followers}
    return names | {joint: full for joint, full in robot.principal_coordinates.items() if full in names}


class _DriveContext(NamedTuple):
    """Driven coordinates and their reference, prescribed motions, and the mechanism that both move."""

    driven: tuple[str, ...]
    program: Program | None
    prescribed: PrescribedMotion | None
    mechanism: Mechanism | None


def _drive(
    robot: Robot,
    scenario: Scenario,
    control: Section,
    kernel: Kernel,
    rigid: Callable[[], Kernel],
    context: _DriveContext,
) -> Control:
    driven, program = context.driven, context.program
    if control.type == "torque":
        return _torque(robot, scenario, control.get("table"), kernel)
    if program is None or control.type == "feedforward":  # which is made of all of the scenario
        return NoControl()
    meant = _inputs(scenario, control, kernel, driven)
    reference = ReferenceControl(program, actuators(kernel, driven), np.array([x.unit.endswith("/s") for x in meant]))
    if control.type == "reference":
        return reference
    forces = _force_control(robot, scenario, control, kernel, rigid, context)
    servos = np.array([not x.is_force for x in meant])
    if not servos.any():
        return forces
    by_servos, places = set(np.array(driven)[servos].tolist()), names_in_scenarios(robot)
    for key in ("kp", "kd"):
        gains = control.get(key, 0.0)
        for name in gains if isinstance(gains, Mapping) else ():
            if places.get(name) in by_servos:
                scenario.fail(f"control.{key}.{name}", "its drive takes a reference; allowed: drives of forces")
    return MixedControl(forces, reference, reference.actuators.index[servos])


def _force_control(
    robot: Robot,
    scenario: Scenario,
    control: Section,
    kernel: Kernel,
    rigid: Callable[[], Kernel],
    context: _DriveContext,
) -> JointPD | ComputedTorque:
    driven, program, prescribed, mechanism = context
    assert program is not None
    if control.type == "pd":
        kp, kd = (_gains(robot, scenario, key, control.get(key), driven) for key in ("kp", "kd"))
        if not control.get("gravity", False):
            return JointPD(program, actuators(kernel, driven), kp, kd)
        _refuse_tied(robot)
        whole = actuators(kernel, rigid().coordinates)
        return JointPD(program, actuators(kernel, driven), kp, kd, rigid(), whole, mechanism)
    _refuse_tied(robot)
    joint_motion = None if prescribed is None else _joint_motion(kernel, rigid(), prescribed)
    whole = actuators(kernel, rigid().coordinates)
    return ComputedTorque(rigid(), program, whole, control.get("bandwidth", BANDWIDTH), joint_motion, mechanism)


def _position_loops(robot: Robot) -> list[bool]:
    """Return which drives of the driven coordinates control positions by themselves."""
    laws = (coordinate_of(robot, drive_of(robot, name)).law() for name in program_coordinates(robot))
    return [loops_of(law)[:1] == (LOOPS[0],) for law in laws]


def default_control(robot: Robot) -> str:
    """Return the control by which drives follow a motion: references where all control positions by themselves."""
    loops = _position_loops(robot)
    return "reference" if loops and all(loops) else "computed_torque"


def _inputs(scenario: Scenario, control: Section, kernel: Kernel, driven: tuple[str, ...]) -> list[DriveInput]:
    """Return what u means at the driven coordinates; DescriptionError where the control has nothing for one of them.

    Beside drives that take forces those that take a reference get it under any control of forces.
    """
    motors = shafts(kernel)
    meant = [kernel.inputs[motors.get(name, name)] for name in driven]
    some_force, some_reference = any(x.is_force for x in meant), any(x.meaning in REFERENCES for x in meant)
    for name, one in zip(driven, meant, strict=True):
        is_reference = one.meaning in REFERENCES
        if is_reference if control.type == "reference" else one.is_force or (is_reference and some_force):
            continue
        forces = "pd, computed_torque"
        if one.is_force:
            allowed = f"{forces}, under which drives that take a reference get it" if some_reference else forces
        else:
            allowed = "reference" if is_reference else "a torque table"
        scenario.fail("control", f"{name} takes a {one.meaning}, {one.unit}; allowed: {allowed}")
    return meant


def _saturated(
    scenario: Scenario, kernel: Kernel, driven: tuple[str, ...], drive: Control, mechanism: Mechanism | None
) -> Control:
    """Return the drives, clipped at their efforts; DescriptionError without any, or where others could stand in."""
    try:
        effort = efforts_of(kernel.calls, True)
    except InputError as error:
        scenario.fail("control.saturate", str(error).removeprefix("saturate: "))
    if mechanism is not None and mechanism.driven.size > mechanism.chart.free.size and _distributes_forces(drive):
        scenario.fail(
            "control.saturate",
            f"{listed(driven)} are more drives than the {mechanism.chart.free.size} freedoms of the loops, and nothing"
            " says what others do where one is clipped; allowed: pd without gravity, or fewer coordinates in 'driven'",
        )
    changed: Any = drive
    return drive if isinstance(drive, NoControl) else replace(changed, effort=effort)


def _distributes_forces(drive: Control) -> bool:
    """Return whether a model of the robot distributes forces among drives."""
    if isinstance(drive, MixedControl):
        return _distributes_forces(drive.forces)
    return isinstance(drive, ComputedTorque | SampledDrive) or (isinstance(drive, JointPD) and drive.rigid is not None)


def _torque(robot: Robot, scenario: Scenario, table: TimeTable, kernel: Kernel) -> TableTorque:
    """Return drives of a table's columns by coordinate; a joint's name alone stands for its motor, if there is one."""
    places = names_in_scenarios(robot)
    places |= {joint_of(motor): motor for motor in kernel.motors}
    free = [name for name in places if places[name] not in kernel.prescribed]
    for name in table.columns:
        if name not in free:
            scenario.refuse("control", name, free, "cannot be driven")
    return TableTorque(table, index_of(kernel.coordinates, [places[name] for name in table.columns]))


def _joint_motion(kernel: Kernel, rigid: Kernel, prescribed: PrescribedMotion) -> JointMotion:
    """Return the motion of the rigid robot's prescribed coordinates; that of a prescribed motor over its ratio."""
    motors = shafts(kernel)
    names = [name if name in kernel.prescribed else motors[name] for name in rigid.prescribed]
    index = [kernel.prescribed.index(name) for name in names]
    ratio = np.array([kernel.ratio(name) if name in kernel.motors else 1.0 for name in names])

    return JointMotion(prescribed, np.array(index, dtype=np.intp), ratio)


def _gains(
    robot: Robot, scenario: Scenario, key: str, gain: Mapping[str, float] | float, driven: tuple[str, ...]
) -> Array:
    """Return a gain of every driven coordinate, (p,); 0 for those that a table does not name."""
    if not isinstance(gain, Mapping):
        return np.full(len(driven), float(gain))
    gains, places = np.zeros(len(driven)), names_in_scenarios(robot)
    for name, value in gain.items():
        if places.get(name) not in driven:
            scenario.fail(
                f"control.{key}.{name}", f"is not driven{nearest(name, driven)}; allowed: {', '.join(driven)}"
            )
        gains[driven.index(places[name])] = value
    return gains
