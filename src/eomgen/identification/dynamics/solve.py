"""Masses, inertias and friction from a measured motion and its drives: base parameters by least squares.

    Y_b(q, v, a) beta = u - laws(q, v)

over time, one row per coordinate whose force is known, each weighted by its noise.  All terms pass the same
filters, as in ``fit``.  Where a drive stands still in a filter's window its Coulomb friction is unknown, and its row is
left out.  What noise of the motion adds to the columns on average is not taken off.  ``consistent`` then chooses links
that have these base parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import Array, Mask
from ...codegen.kernels.groups import IDENTIFICATION
from ...description import RobotLike, as_robot
from ...errors import InputError
from ...kernel.complete import Kernel
from ...motion.files import MeasuredMotion, measured_motion
from ...motion.measured_numbers import answers_in_numbers
from ...motion.smoothing import STENCIL
from ...names import component_name, joint_of, kind_of, listed, show, split_component
from ...pipeline.building import build
from ...progress import StageReport, tells_at_prompt
from ...robot.coordinates import LINKS, is_mode, number_name
from ...robot.model import build_model
from ...robot.value import MOTOR, Friction, Robot
from ..consistent import INERTIAL, Sizes, nearest_bodies, with_parameters
from ..estimating import SOLVED, evenly_sampled
from ..identifiable import LINEAR, TERMS, TRANSMISSIONS, BaseParameters, combinations, parameter_names
from ..relations import Relations, anchored, completed, refuse_followers, refuse_internal_states, relations_of
from ..stiffness.beams import beam_notes
from ..stiffness.result import Estimate
from .further import FURTHER, GAINS, GAUSSIAN, SHAPES, STRIBECK, Sought, further_doubts
from .nonlinear import shaped
from .regression import FILTERS, Data, Solution, chosen_filter
from .result import IdentifyResult
from .shafts import at_shafts, without_drives
from .traps import offset_warnings, other_readings, refuse_impossible, spoiled, uncovered_friction

ALL_TERMS = (*LINEAR, *FURTHER)
APART = 0.05  # of a drive: residuals from which on joint offsets are looked at
HIDDEN = 0.5  # of the square of a column: noise behind which a parameter is not identifiable
UNSETTLED = 0.1  # of a standard deviation, by which the last step moves at most
SPREAD = 0.5  # relative, of the description's numbers of single links


@answers_in_numbers("motion")
@tells_at_prompt("identifying")
def identify(  # noqa: PLR0913
    robot: RobotLike,
    motion: MeasuredMotion | Path | str,
    *,
    terms: Sequence[str] = TERMS,
    known: Sequence[str] = (),
    half: int | None = None,
    shape: str | None = None,
    spread: float = SPREAD,
    kernel: Kernel | None = None,
    progress: StageReport | None = None,
) -> IdentifyResult:
    """Return base parameters of a robot from a motion and its drives.

    Geometry and gravity are the description's, and so are springs and all other laws of coordinates but for those that
    are sought: damping, Coulomb friction and preload of coordinates with a drive or in a rigid coupling.  A motion
    with samples at unequal distances in time is resampled, with a note; coordinates that couplings make of measured
    ones need not be in it.  Forces are known where a drive is in the motion, and are 0 at measured coordinates without
    a drive.  Friction with bristles counts as it slides, and keeps them.  Of a drive with states what the motion has as
    the drive is the force on its coordinate, or its current makes it, where the motion has that (NAME.drive.current).

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        motion: from ``read_motion`` or ``motion_from_columns``, or the path of a file.
        terms: what is sought, among ALL_TERMS: those of ``base_parameters``; "stribeck" (static friction and Stribeck's
            rate, beside "dry"), "gains" (N or N m per unit of what the file has as drives, such as currents), "delay"
            (s, by how much the drives in the file are late).
        known: names of links whose mass, centre of mass and inertia are the description's: gains need such a measure.
            Those of links that bend are, too; what is fixed to their nodes is sought.
        half: half width of the second filter, samples, 0 for none; the best of FILTERS on blocks held out if None.
        shape: of Stribeck's curve, "lorentzian", 1 / (1 + (v / rate)^2), or "gaussian", exp(-(v / rate)^2); the one
            that is better on blocks held out if None.
        spread: how far the description's numbers of single links are off, relative to themselves; what base parameters
            leave open stays near to them.
        kernel: of ``without_sought(robot, terms)``, float64, with regressor and inverse_dynamics; built if None.

    Raises:
        InputError: the file or an argument cannot be used, samples are too few or have gaps, they are in other units,
            no force is known, or the robot has loops or elastic couplings.
    """
    described = as_robot(robot)
    robot = without_drives(described.with_constraints())
    linear = _linear(terms)
    if not 0.0 < spread < np.inf:
        raise InputError(f"spread: {show(spread)}; allowed: a number above 0")
    if half is not None and (isinstance(half, bool) or not isinstance(half, int) or half < 0):
        raise InputError(f"half: {show(half)}; allowed: a whole number from 0")
    if shape is not None and shape not in SHAPES:
        raise InputError(f"shape: {show(shape)}; allowed: {', '.join(SHAPES)}")
    relations = relations_of(robot, known)
    if kernel is None:
        bare = without_sought(robot, terms)
        kernel = build(bare, kernels=IDENTIFICATION, progress=progress or (lambda _: None))
    refuse_followers(robot, kernel)
    such = "those of friction at drives, with the term dry; fit finds numbers of all laws with internal states"
    refuse_internal_states(kernel, such)
    if TRANSMISSIONS in linear:
        relations = anchored(relations)
    parameter_names(kernel, linear, relations)
    recorded = at_shafts(described, measured_motion(robot, motion, kernel.coordinates))
    recorded, idle = _without_idle_drives(robot, recorded)
    even = evenly_sampled(recorded)
    step = even.step
    refuse_impossible(robot, even.motion, step)
    motion = completed(robot, even.motion)
    if TRANSMISSIONS in linear:
        _check_transmissions(relations, motion)
    forces = _known(robot, motion, relations)
    moving = np.isin(relations.rows, motion.measured)
    base = combinations(kernel, linear, moving, forces, relations)
    widths = FILTERS if half is None else (half,)
    bad, spoilt = spoiled(completed(robot, recorded))
    bad = even.reached(bad)
    data = Data(kernel, motion, base, forces, step, bad)
    shown, warnings = data.shown(base)
    warnings = spoilt + warnings
    if len(shown) < len(base):
        data.base = shown
    width, alternatives = chosen_filter(data, widths)
    asked = _further(data, terms, _shape(described, shape))
    (data, best, sought, state), more, curves = shaped(data, asked, width)
    warnings += more
    drawn = _described(robot, kernel, shown)
    many = len(shown)
    hidden = [name for name, share in zip(shown.names, best.noise_share, strict=False) if share > HIDDEN]
    values, variances = best.values[:many], best.variances[:many]
    deviations = np.sqrt(variances)
    sizes = Sizes(shown, values, deviations, drawn)
    is_open = deviations > sizes.deviations(shown, spread)
    impossible = _impossible(shown, values, deviations, is_open)
    links = nearest_bodies(shown, values, best.root, drawn, sizes, spread, impossible)
    parameters = dict(zip(shown.parameters, links.theta.tolist(), strict=True))
    further = sought.further(state, np.sqrt(best.variances[many:]).tolist())
    for name in (*hidden, *impossible):  # is no answer
        parameters.pop(name, None)
    warnings += (
        [f"{name}: noise of the angles hides the deflection; the description's value stays" for name in hidden]
        + [f"{name}: is below 0 and not identifiable; the description's value stays" for name in impossible]
        + _doubts(shown, values, deviations)
        + further_doubts(asked, sought, further)
        + (uncovered_friction(data, best, sought, state) if STRIBECK in terms else [])
        + other_readings(data, best)
    )
    if float((best.fitted / data.drive_sizes()).max()) > APART:

        def left_of(other: MeasuredMotion) -> float:
            again = Data(kernel, other, shown, forces, step, bad)
            return float(np.log(np.maximum(Solution.of(again, width).fitted, 1e-300)).sum())

        warnings += offset_warnings(motion, robot, left_of)
    parameters |= {
        name: x.value for name, x in further.items() if name.endswith((".breakaway", ".stribeck", f".{GAUSSIAN}"))
    }
    of_robot = shown.matrix @ links.theta
    moved = float(np.abs(best.root @ (of_robot - values)).max())
    of_rows = best.left_of(np.concatenate([of_robot, np.zeros(best.values.size - many)]))
    unexcited = tuple(np.array(shown.names)[is_open].tolist())
    warnings += [f"not excited by the motion, near to the description: {listed(unexcited)}"] if unexcited else []
    problems = [] if best.is_converged else ["weights of rows and residuals do not become consistent"]
    problems += _unsettled(sought, best) + ([] if links.status == SOLVED else [links.status])
    notes = [
        *idle,
        *even.notes,
        *_notes(kernel, motion, data),
        alternatives,
        *beam_notes(described, _modal_estimates(shown, values, deviations, drawn)),
        f"physically consistent links: base values off by {moved:.2g} deviations at most",
    ]
    t, drives, fitted, kept = data.over_time(best)
    return IdentifyResult(
        robot=with_parameters(described, parameters),
        base=shown,
        base_values=values,
        deviations=deviations,
        described=shown.matrix @ drawn,
        parameters=parameters,
        residuals=data.residuals(best, of_rows),
        of_robot=of_robot,
        status="; ".join(problems) or SOLVED,
        unexcited=unexcited,
        width=2 * (data.half + best.half) * step,
        warnings=tuple(warnings),
        notes=(*notes, *curves),
        further=further,
        t=t,
        drives=drives,
        fitted=fitted,
        kept=kept,
    )


def _linear(terms: Sequence[str]) -> tuple[str, ...]:
    """Select the terms that forces are linear in."""
    for term in terms:
        if term not in ALL_TERMS:
            raise InputError(f"terms: {show(term)}; allowed: {', '.join(ALL_TERMS)}")
    if STRIBECK in terms and "dry" not in terms:
        raise InputError("terms: stribeck without dry; allowed: both, or dry alone")
    return tuple(term for term in terms if term in LINEAR)


def _check_transmissions(relations: Relations, motion: MeasuredMotion) -> None:
    for rotor, joint, _ in relations.motors:
        missing = [motion.coordinates[i] for i in (rotor, joint) if motion.coordinates[i] not in motion.measured]
        if missing:
            raise InputError(
                f"{motion.source}: transmissions: there is no column {missing[0]}; allowed: columns of both"
                f" {motion.coordinates[rotor]} and {motion.coordinates[joint]}, the angle of the shaft and the joint's"
            )


def _shape(robot: Robot, shape: str | None) -> str:
    """Return the shape of Stribeck's curve, "" for the better one; bristles slide by a Gaussian one alone."""
    frictions = [coordinate.friction for joint in robot.joints for coordinate in joint.all_coordinates.values()]
    if not any(friction is not None and friction.bristle_stiffness is not None for friction in frictions):
        return shape or ""
    if shape not in (None, GAUSSIAN):
        raise InputError(f"shape: {show(shape)}; allowed: {GAUSSIAN}, of friction with bristles")
    return GAUSSIAN


def _further(data: Data, terms: Sequence[str], shape: str) -> Sought:
    """Give what is sought beside base parameters: gains of drives that act in a row, friction of what moves there."""
    motion, matrix = data.motion, data.relations.onto[:, data.known]
    drives = [i for i, name in enumerate(motion.coordinates) if name in motion.driven and matrix[i].any()]
    names = tuple(term for term in FURTHER if term in terms)
    if GAINS in names and np.linalg.matrix_rank(matrix[drives]) < len(drives):
        raise InputError(f"{motion.source}: more drives than rows whose forces are known; allowed: terms without gains")
    rubbing = tuple(i for i in data.relations.rubbing if matrix[i].any())
    rms = np.sqrt(np.mean(data.v[:, rubbing] ** 2, axis=0))
    rms = np.where(rms == 0.0, 1.0, rms)
    return Sought(names, motion.coordinates, tuple(drives), (), rubbing, matrix, data.step, shape, rms)


def _unsettled(sought: Sought, solution: Solution) -> list[str]:
    """Say which parameters that forces are not linear in still moved at the last step."""
    many = len(sought.names())
    steps, deviations = solution.values[-many or len(solution.values) :], np.sqrt(solution.variances)[-many:]
    moving = [name for name, x, d in zip(sought.names(), steps, deviations, strict=False) if abs(x) > UNSETTLED * d]
    return [f"not settled: {listed(moving)}"] if moving else []


def without_sought(robot: Robot, terms: Sequence[str]) -> Robot:
    """Return the robot without what is sought of damping, Coulomb friction, preload and transmissions.

    These are of coordinates with a drive or in a rigid coupling; all of the latter are coordinates of it.  Drives with
    states are forces.
    """
    robot = without_drives(robot.with_constraints())
    model = build_model(robot)
    driven = {model.coordinates[i] for i in model.driven}
    driven |= {name for coupling in robot.own_couplings if coupling.law is None for name in (coupling.of, *coupling.to)}
    lost: dict[str, Any] = {"damping": None} if "viscous" in terms else {}
    lost |= {"preload": None} if "offset" in terms else {}
    joints = []
    for joint in robot.joints:
        coordinates = {
            name: replace(coordinate, **lost, friction=_known_friction(coordinate.friction, terms))
            if component_name(joint.name, name) in driven
            else coordinate
            for name, coordinate in joint.coordinates.items()
        }
        motor = joint.motor
        if motor is not None and component_name(joint.name, MOTOR) in driven:
            motor = replace(motor, friction=_known_friction(motor.friction, terms))
        if motor is not None and TRANSMISSIONS in terms:
            motor = replace(motor, transmission=replace(motor.transmission, stiffness=0.0, damping=None))
        joints.append(replace(joint, coordinates=coordinates, motor=motor))
    gone = {f"joints.{name}.{key}" for name in driven for key in (*lost, "friction")}
    if TRANSMISSIONS in terms:
        gone |= {f"joints.{joint.name}.{MOTOR}.{key}" for joint in robot.joints for key in ("stiffness", "damping")}
    left = [name for name in robot.tunable if not name.startswith(tuple(gone))]
    return replace(robot, joints=tuple(joints), tunable=tuple(left))


def _known_friction(friction: Friction | None, terms: Sequence[str]) -> Friction | None:
    """Give what of a coordinate's friction is not sought."""
    if friction is None:
        return None
    viscous = None if "viscous" in terms else friction.viscous
    if "dry" not in terms:
        return replace(friction, viscous=viscous)
    return Friction(viscous=viscous, smoothing=friction.smoothing) if viscous else None


def _without_idle_drives(robot: Robot, motion: MeasuredMotion) -> tuple[MeasuredMotion, list[str]]:
    """Return the motion without drives that are 0 at all times, of coordinates that nothing drives, and a note.

    Results of simulations have a drive for each coordinate.
    """
    model = build_model(robot)
    drives = {model.coordinates[i] for i in (*model.driven, *model.prescribed)}
    columns = zip(motion.coordinates, motion.u.T, strict=True)
    idle = [name for name, u in columns if name in motion.driven and name not in drives and not u.any()]
    if not idle:
        return motion, []
    left = tuple(name for name in motion.driven if name not in idle)
    return replace(motion, driven=left), [f"drives that are 0 and drive nothing, left out: {', '.join(idle)}"]


def _known(robot: Robot, motion: MeasuredMotion, relations: Relations) -> Mask:
    """Return rows in which all forces are known, (f,).

    Known are the drives in the motion, and, as 0, the forces of measured coordinates that have no drive.
    """
    model = build_model(robot)
    driven = {model.coordinates[i] for i in (*model.driven, *model.prescribed)}
    free = [name for name in motion.measured if name not in driven]
    known = np.isin(model.coordinates, [*motion.driven, *free]) & np.isin(model.coordinates, motion.measured)
    rows = ~relations.rows_of(~known)
    if not rows.any() or not motion.driven:
        missing = sorted(driven.difference(motion.driven))
        allowed = f"columns such as {component_name(missing[0], 'drive')}" if missing else "measured coordinates, too"
        raise InputError(f"{motion.source}: no drive is known; allowed: {allowed}")
    return np.asarray(rows, dtype=np.bool_)


def _described(robot: Robot, kernel: Kernel, base: BaseParameters) -> Array:
    """Return the description's values of all parameters, (p,)."""
    theta = dict(zip(kernel.regressor_names, kernel.regressor_values.tolist(), strict=True))
    relations = base.relations
    assert relations is not None
    for name in (kernel.coordinates[i] for i in relations.rubbing):
        joint = robot.joint(joint_of(name))
        coordinate = joint.motor.rotor if joint.motor and kind_of(name) == MOTOR else joint.coordinates[kind_of(name)]
        dry = coordinate.friction
        is_alone = kind_of(name) != MOTOR  # a rotor's damping is its transmission's
        theta[f"{name}.viscous"] = (coordinate.damping or 0.0) * is_alone + (dry.viscous or 0.0 if dry else 0.0)
        theta[f"{name}.dry"] = dry.coulomb if dry else 0.0
        theta[f"{name}.offset"] = coordinate.preload or 0.0
    for rotor, _, _ in relations.motors:
        name = kernel.coordinates[rotor]
        motor = robot.joint(joint_of(name)).motor
        assert motor is not None
        theta[f"{name}.stiffness"] = motor.transmission.stiffness or 0.0
        theta[f"{name}.damping"] = motor.transmission.damping or 0.0
    for name in robot.modal_coordinates:
        mode = robot.coordinates[name]
        theta[f"{name}.stiffness"], theta[f"{name}.damping"] = mode.stiffness or 0.0, mode.damping or 0.0
    return np.array([theta[name] for name in base.parameters])


def _modal_estimates(base: BaseParameters, values: Array, deviations: Array, drawn: Array) -> dict[str, Estimate]:
    """Return stiffness and damping of modes that stand alone in a combination, by names of run-time parameters."""
    estimates = {}
    for place, row, x, d in zip(base.chosen.tolist(), base.matrix, values.tolist(), deviations.tolist(), strict=True):
        name, key = split_component(base.parameters[place])
        if is_mode(name) and np.count_nonzero(row) == 1:
            described = float(drawn[place])
            estimates[number_name(LINKS, name, key)] = Estimate(x, d, x - 2.0 * d, x + 2.0 * d, described, 0.0, 0.0)
    return estimates


def _doubts(base: BaseParameters, values: Array, deviations: Array) -> list[str]:
    """Return warnings about parameters that the motion hardly shows, and about friction that drives."""
    hardly = [name for name, x, d in zip(base.names, values, deviations, strict=True) if abs(x) < 2.0 * d]
    doubts = [f"within two standard deviations of zero: {listed(hardly)}"] if hardly else []
    for name, x, d in zip(base.names, values, deviations, strict=True):
        if name.endswith((".viscous", ".dry")) and x < -2.0 * d:
            doubts.append(f"{name} is negative; is the drive's sign right?")
    return doubts


def _impossible(base: BaseParameters, values: Array, deviations: Array, is_open: Mask) -> list[str]:
    """Return parameters that stand alone, are positive in every robot, and are measured below 0."""
    alone = np.count_nonzero(base.matrix, axis=1) == 1
    below = base.chosen[alone & (values < -2.0 * deviations) & ~is_open]
    names = [base.parameters[place] for place in below]
    return [name for name in names if name.rpartition(".")[2] not in (*INERTIAL, "offset")]


def _notes(kernel: Kernel, motion: MeasuredMotion, data: Data) -> tuple[str, ...]:
    bell = 2 * (data.half - STENCIL) + 1
    how = f"central differences of eighth order behind a bell of {bell} samples" if data.half else "from the file"
    notes = [f"rates and accelerations: {how}; all terms filtered alike; rows weighted by their residuals"]
    held = [name for name in kernel.coordinates if name not in motion.measured]
    if held:
        notes.append(f"not in the file, held at zero: {', '.join(held)}")
    if data.relations.sums is not None:
        behind = [kernel.coordinates[joint] for _, joint, _ in data.relations.motors]
        notes.append(
            f"rows of {listed(behind)} have the forces of the motors in front of them, too: those of rigid gears"
        )
    if data.resting.any():
        notes.append(f"standstill left out: {100 * data.resting.mean():.3g} % of all samples of drives")
    return tuple(notes)
