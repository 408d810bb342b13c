"""Robot and Scenario -> CompensationResult: a path is compensated until the simulated tool follows the rigid one's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...description import RobotLike, as_robot
from ...errors import InputError
from ...integration.steps import output_times
from ...limits import LARGEST, SMALLEST, is_usable
from ...motion.exceeding import excess_notes, excesses
from ...names import listed, nearest, show
from ...progress import Progress, no_progress, tells_at_prompt
from ...robot.model import build_model, tool_of
from ...robot.value import Robot
from ...scenario.load import load_scenario
from ...scenario.value import Initial, Scenario, Section
from ...shown import prefixed
from ...simulation.assembly import BANDWIDTH, Assembly, assemble, default_control, names_in_scenarios
from ...simulation.controls import ReferenceControl
from ...simulation.result import SimulationResult
from ...state.motors import shafts
from .bounds import held_back, within_limits
from .learning import error_of, learn, reach_along
from .resting import at_rest
from .result import AXES, CompensationResult, HeldBack, Variant, sizes
from .robust import variants
from .setting import Setting, setting_of

MODES = ("static", "dynamic")
WEIGHTS = (1.0, 1.0, 1.0, 0.1, 0.1, 0.1)  # of the tool's axes: a turn of 1 rad counts as much as 0.1 m
MOST_SAMPLES, FEWEST_SAMPLES = 100_000, 24
HALVINGS = 6  # of the correction's size, where drives have limits
BETWEEN = 1.5  # times the peak at the samples, from which on that between them is told


@tells_at_prompt("compensating")
def compensate(  # noqa: PLR0913
    robot: RobotLike,
    scenario: Scenario | Path | str | None = None,
    *,
    frame: str | None = None,
    mode: str = "dynamic",
    step: float | None = None,
    weights: Mapping[str, float] | None = None,
    accelerations: bool = False,
    iterations: int = 30,
    rates: Mapping[str, float] | None = None,
    drives: Mapping[str, float] | None = None,
    robustness: float | None = None,
    draws: int = 3,
    seed: int = 0,
    progress: Progress | None = None,
) -> CompensationResult:
    """Compensate a scenario's path until the simulated tool goes where the rigid robot's would.

    "static" looks for the correction sample by sample, in static equilibrium under gravity, wrenches and payloads of
    that time, held by the drives.  "dynamic" repeats the simulation, takes from the reference what the tool is off by,
    and keeps the best of all iterates.  Both say what the tracking error of a simulation of the compensated path is.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        scenario: with a reference trajectory; a Scenario, the name of a built-in one, or a path.  By default the
            motion of ``simulate``.
        frame: whose origin and axes are to follow; default that of the scenario.
        mode: "static" or "dynamic".
        step: between samples of the compensated path, s; default the scenario's output step.
        weights: of errors along the tool's axes x, y, z (1) and about them, rx, ry, rz (m/rad, 0.1); axes with 0 are
            not corrected.
        accelerations: of "static": what accelerates the masses along the reference bends the robot, too.
        iterations: of "dynamic": simulations at most.
        rates: greatest rates that corrections may lead to, rad/s or m/s, by joint or driven coordinate.
        drives: greatest forces of drives that corrections may lead to, N m or N, by joint or driven coordinate, at the
            motor where there is one.
        robustness: a share by which stiffnesses are wrong, 0.2 say: such robots are simulated without and with the
            correction.
        draws, seed: of such robots whose stiffnesses are wrong to both sides by chance.
        progress: called with a fraction from 0 to 1 and a line of text.

    Raises:
        InputError: an argument is wrong, the scenario has no reference trajectory, loops are to be closed, nothing is
            to be corrected, or a static correction is asked for of a robot with servo drives.
        ReachError: the tool cannot follow the path.
        IntegrationError: there is no static equilibrium, or a motion does not come to its end.
    """
    arm, report = as_robot(robot), progress or no_progress
    _check(mode, iterations, robustness, draws)
    if arm.loops or arm.own_couplings:
        raise InputError(
            f"{arm.name}: has loops or couplings, by which its other joints follow the driven ones; allowed: robots"
            " without them"
        )
    if mode == MODES[0]:
        _refuse_servo_drives(arm)
    planned = _scenario(scenario)
    if frame is not None:
        tool_of(arm, frame)  # refuses a name that is none, before anything is built
    tool = tool_of(arm, planned.frame, planned.label("frame") if planned.source else "frame")
    t = _samples(planned, step)
    assembly = assemble(arm, planned, tool, report)
    _check_program(arm, planned, assembly)
    assert assembly.shown is not None
    numbers = _weights(weights)
    limited = _by_coordinate("rates", rates, arm, assembly)
    forces = _by_coordinate("drives", drives, arm, assembly)
    report(0.0, "the program as it is")
    setting = setting_of(arm, frame or tool, planned, assembly, t, limited, numbers)
    wanted, taken, history, notes = _corrected(setting, mode, accelerations, iterations, report)
    motion = setting.run(setting.original + taken)
    taken, motion, note = _within_drives(setting, taken, motion, forces)
    after, before = error_of(setting, motion), error_of(setting, setting.before)
    drawn: tuple[Variant, ...] = ()
    if robustness is not None:
        drawn = tuple(variants(setting, setting.original + taken, robustness, draws, seed, report))
    reach = reach_along(setting, motion)
    x = motion.trajectory
    beyond = excesses(arm, x.coordinates, t=x.t, q=x.q, v=x.v, u=x.u)
    return CompensationResult(
        robot=arm.name,
        frame=setting.frame,
        mode=mode,
        coordinates=assembly.driven,
        t=t,
        program=np.asarray(assembly.shown.at(t)[0]),
        corrected=setting.original + taken,
        times=setting.before.trajectory.t,
        before=before,
        after=after,
        beyond=reach.beyond(after),
        weights=numbers,
        history=history,
        rank=reach.rank,
        shares=tuple(reach.shares.tolist()),
        limits=tuple(_held_back(setting, wanted, after)),
        robustness=drawn,
        scenario=_followed(planned, setting.frame, assembly, t),
        notes=(
            *(*notes, *note, *_notes(setting, before, after, planned)),
            *excess_notes("the motion of the compensated path", beyond),
        ),
    )


def _check(mode: str, iterations: int, robustness: float | None, draws: int) -> None:
    if mode not in MODES:
        raise InputError(f"mode: {show(mode)} is unknown; allowed: {', '.join(MODES)}")
    if iterations < 1:
        raise InputError(f"iterations: {iterations}; allowed: 1 or more")
    if robustness is not None and not 0.0 < robustness < 1.0:
        raise InputError(f"robustness: {robustness!r}; allowed: a share between 0 and 1, 0.2 say")
    if draws < 0:
        raise InputError(f"draws: {draws}; allowed: 0 or more")


def _refuse_servo_drives(robot: Robot) -> None:
    """Raise InputError where inputs of drives are no forces, which static equilibria balance."""
    model = build_model(robot)
    if model.drives:
        raise InputError(
            f"mode: 'static': {listed(model.coordinates[i] for i in model.drives)} of {robot.name} have servo drives,"
            " whose inputs are no forces at rest; allowed: 'dynamic', which simulates them"
        )


def _scenario(scenario: Scenario | Path | str | None) -> Scenario:
    if scenario is None:
        return Scenario(2.0, motion=Section("point_to_point"))
    return scenario if isinstance(scenario, Scenario) else load_scenario(scenario)


def _samples(scenario: Scenario, step: float | None) -> Array:
    """Return times of the compensated path's samples."""
    t = output_times(scenario.duration, scenario.output_step if step is None else step)
    if not FEWEST_SAMPLES <= t.size <= MOST_SAMPLES:
        raise InputError(
            f"step: {t[1] - t[0]:.3g} s makes {t.size} samples of {scenario.duration:g} s; allowed: {FEWEST_SAMPLES} to"
            f" {MOST_SAMPLES}"
        )
    return t


def _check_program(robot: Robot, scenario: Scenario, assembly: Assembly) -> None:
    """Raise InputError where nothing is programmed, or where the tool cannot be off the reference."""
    if assembly.program is None:
        scenario.fail("motion", "nothing is programmed that could be corrected; allowed: a scenario with a motion")
    kind = default_control(robot) if scenario.control is None else scenario.control.type
    if kind == "feedforward":
        scenario.fail("control", "feed-forward knows of deviations itself; allowed: pd, computed_torque or reference")
    computed = kind == "computed_torque"
    if assembly.facts.is_rigid and computed and not scenario.wrenches and not scenario.payloads:
        raise InputError(
            f"{robot.name}: no joint deviates, and its drives know its masses: there is nothing to correct; allowed: a"
            " robot with stiffness in its joints or transmissions, loads, or drives of control.type 'pd'"
        )


def _weights(weights: Mapping[str, float] | None) -> Array:
    by_axis = dict(zip(AXES, WEIGHTS, strict=True))
    for name, value in (weights or {}).items():
        if name not in by_axis:
            raise InputError(f"weights: {show(str(name))}{nearest(str(name), AXES)}; allowed: {', '.join(AXES)}")
        if not (is_usable(value) and value >= 0.0):
            raise InputError(
                f"weights: {name} = {show(value)}; allowed: 0, or a number from {SMALLEST:g} to {LARGEST:g}"
            )
        by_axis[name] = float(value)
    if not any(by_axis.values()):
        raise InputError("weights: all are 0, so that nothing is to be corrected; allowed: one greater than 0, or more")
    return np.array(list(by_axis.values()))


def _by_coordinate(
    label: str, requested: Mapping[str, float] | None, robot: Robot, assembly: Assembly
) -> dict[str, float]:
    """Return limits by the full names of driven coordinates."""
    places, limits = names_in_scenarios(robot), {}
    for name, value in (requested or {}).items():
        full = places.get(str(name), "")
        if full not in assembly.driven:
            hint = nearest(str(name), assembly.driven)
            raise InputError(f"{label}: {show(str(name))} is not driven{hint}; allowed: {listed(assembly.driven)}")
        if not (is_usable(value) and value > 0.0):
            raise InputError(f"{label}: {name} = {show(value)}; allowed: a number from {SMALLEST:g} to {LARGEST:g}")
        limits[full] = float(value)
    return limits


def _corrected(
    setting: Setting, mode: str, accelerations: bool, iterations: int, report: Progress
) -> tuple[Array, Array, tuple[float, ...], list[str]]:
    """Return corrections without and with limits, (T, m) each, the history of simulations, and notes."""
    if mode == "static":
        taken, wanted = at_rest(setting, accelerations, report)
        loads = "gravity, wrenches, payloads" + (" and what accelerates the masses" if accelerations else "")
        return wanted, taken, (), [f"static: the robot bends under {loads} as at rest; what swings is left"]
    learned = learn(setting, iterations, report)
    span = 1e3 * (setting.t[-1] - setting.t[0]) / learned.intervals
    notes = [f"knots of the correction are {span:.3g} ms apart"]
    if len(learned.history) > iterations:
        notes.append(f"it ended with {iterations} simulations, as allowed; more may lead further")
    return learned.wanted, learned.taken, learned.history, notes


def _within_drives(
    setting: Setting, taken: Array, motion: SimulationResult, limits: Mapping[str, float]
) -> tuple[Array, SimulationResult, list[str]]:
    """Return the greatest share of a correction within effort limits, its simulation, and a note about it."""
    kernel = setting.assembly.kernel
    motors = shafts(kernel)
    places = {name: kernel.coordinates.index(motors.get(name, name)) for name in limits}

    def beyond(result: SimulationResult) -> list[str]:
        peaks, first = np.abs(result.trajectory.u).max(axis=0), np.abs(setting.before.trajectory.u).max(axis=0)
        return [name for name, i in places.items() if peaks[i] > max(limits[name], first[i])]

    names = beyond(motion)
    if not names:
        return taken, motion, []
    low, high, best, held = 0.0, 1.0, setting.run(setting.original), names
    for _ in range(HALVINGS):
        share = 0.5 * (low + high)
        trial = setting.run(setting.original + share * taken)
        held = beyond(trial) or held
        low, high, best = (low, share, best) if beyond(trial) else (share, high, trial)
    return low * taken, best, [f"limits of drives ({listed(held)}) leave {100.0 * low:.0f} % of the correction"]


def _held_back(setting: Setting, wanted: Array, after: Array) -> list[HeldBack]:
    """Return coordinates whose limits take something from the correction that was wanted, (T, m)."""
    held = held_back(wanted, within_limits(setting, wanted)) & setting.movable
    step, corrections = float(setting.t[1] - setting.t[0]), []
    for name, column in zip(setting.assembly.driven, held.T, strict=True):
        if column.any():
            position, orientation = sizes(after[::2][column])[1]
            corrections.append(HeldBack(name, float(column.sum()) * step, position, orientation))
    return corrections


def _followed(scenario: Scenario, frame: str, assembly: Assembly, t: Array) -> Scenario:
    """Return the scenario of the compensated path, without its motion: that says where driven coordinates begin."""
    initial = scenario.initial
    if initial is not None:
        initial = Initial(
            {name: value for name, value in assembly.initial_q.items() if name not in assembly.driven},
            initial.v,
            initial.equilibrium,
            initial.held,
        )
    control = scenario.control or Section(
        "reference" if isinstance(assembly.drive, ReferenceControl) else "computed_torque"
    )
    if control.type == "computed_torque":
        control = Section(control.type, {"bandwidth": BANDWIDTH, **control.values})
    step = float(t[1] - t[0])
    return replace(
        scenario, output_step=step, frame=frame, initial=initial, motion=None, control=control, source="", text=""
    )


def _notes(setting: Setting, before: Array, after: Array, scenario: Scenario) -> list[str]:
    notes = []
    if scenario.until is not None:
        notes.append("errors are those up to the duration, whatever [until] ends before")
    (peak, _), (between, _) = (sizes(after[offset::2])[1] for offset in (0, 1))
    if between > BETWEEN * peak:
        notes.append(
            f"between its samples the tool is off by up to {prefixed(between, 'm')}, at them {prefixed(peak, 'm')}"
        )
    if sizes(after)[0][0] >= sizes(before)[0][0]:
        notes.append("the position gets no better: what is left is out of reach, or swings faster than samples follow")
    if not setting.movable.all():
        names = [name for name, moves in zip(setting.assembly.driven, setting.movable, strict=True) if not moves]
        notes.append(f"not corrected, of a free joint or without a gain: {listed(names)}")
    return notes
