"""Stiffness and damping of joints from a measured motion and known drives.

With N a basis of the motions that loops, couplings and unknown drives allow, their forces do no work along it, and

    N^T sum_i d_i (a_i s_i + b_i s_i_dot) = N^T y,    y = u - (M q_ddot + bias - Q_G),

is linear in the parameters; d_i = ds_i/dq is a unit vector, or of a loop joint's coordinate its row.  A motion does not
determine what lies in the null space of these columns.  In a tree N is the unit matrix: every coordinate has an
equation, a s + b s_dot = y, and is fitted by itself.

Three things keep noise out of the result: all terms pass the same filters, the first of which gives derivatives of
eighth order of what it returns; the width of the second is, for each parameter, the one with the smallest standard
error; and, in a tree, what white noise of the coordinate itself adds to the normal equations on average (errors in
variables) is taken off them.  Standard errors do not hold what noise does through terms that are not linear in the
motion: the tests see up to 1e-4 of a value.

The derivatives of y by the parameters are s and s_dot as they are measured, so that a fit is two batches of the kernel
without any difference: 0.1 s for 2,000 samples of the PUMA with 36 coordinates.  ``parameter_jacobian`` gives the same
columns, of parameters that the description has, in 0.5 s more, and after 0.5 s of a compiler.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from ...codegen.kernels.groups import CUT_LAWS, FRAME_POSES, INERTIA, INVERSE_DYNAMICS, kernel_group
from ...description import RobotLike, as_robot
from ...errors import InputError, UnknownNameError
from ...kernel.complete import Kernel
from ...limits import is_usable
from ...motion.files import MeasuredMotion, measured_motion
from ...motion.measured_numbers import answers_in_numbers
from ...motion.smoothing import Differentiator, noise_deviation
from ...names import component_name, joint_of, listed, nearest, show, split_component
from ...pipeline.building import build
from ...pipeline.mechanisms import mechanism_kernels
from ...progress import StageReport, no_report, tells_at_prompt
from ...robot.coordinates import LINKS, is_mode, number_name
from ...robot.model import Model, build_model
from ...robot.value import MOTOR, Robot
from ...state.springs import cut_numbers
from ..closed_motions import closed_motion
from ..estimating import FIRST, HALF_WIDTHS, SIGNAL, evenly_sampled, least_samples
from ..relations import refuse_followers
from .beams import beam_notes
from .equations import Moved, Sought, deviation_of, known_rows, moved_by, of_mechanism, of_tree
from .frame_pairs import pairs_of
from .matrix_entries import OF_JOINTS, Entry, MatrixNumbers, entries_sought
from .matrix_fitting import doubts_about, fitted_matrices
from .output_error import fit_numbers, numbers_sought
from .result import KEYS, Estimate, FitResult, FittedCoordinate, FittedMatrix, doubts

Motion = MeasuredMotion | Path | str


@answers_in_numbers("motion")
@tells_at_prompt("fitting")
def fit(  # noqa: PLR0913
    robot: RobotLike,
    motion: Motion | Sequence[Motion],
    *,
    coordinates: Sequence[str] = (),
    matrices: Sequence[str] | None = None,
    parameters: Sequence[str] | None = None,
    bandwidth: float = 0.0,
    confidence: float = 0.95,
    kernel: Kernel | None = None,
    progress: StageReport | None = None,
) -> FitResult:
    """Return stiffness and damping of each coordinate from motion and known drives.

    Of deviations, and of modes of links that bend, both are fitted; without a drive in the motion they have none.  Of
    principal coordinates, whose drive must be known, those that the description gives; transmissions of motors are not
    fitted.  A motion with samples at unequal distances in time is resampled, with a note; what noise
    there is should be white and independent
    between coordinates.

    Of robots with loops and couplings those that the description gives are fitted, of loop joints and elastic couplings
    too, or those that are asked for: all together along what the loops leave free, so that the loops'
    forces need not be known.  A drive that is not in the motion takes its coordinate out of the equations.  There what
    noise adds on average is not taken off.

    Of matrices between a joint's coordinates those entries are fitted that the description gives, or that are asked
    for; all of a joint together, from the forces in all of its coordinates.  So are those of loop joints and of
    bushings between two frames, from the forces in all coordinates that move these frames; of such coordinates in a
    tree, what the description gives is fitted beside them.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.  Masses, geometry,
            gravity and point-to-point springs count, its coordinates' stiffness and damping do not.
        motion: from ``read_motion`` or ``motion_from_columns``, or the path of a file; with ``parameters`` several.
        coordinates: names of those to fit; all that can be if empty.
        matrices: names of entries to fit, "joints.joint2.stiffness.x.beta", or of whole matrices,
            "joints.joint2.stiffness", "loops.cut.damping", "bushings.mount.stiffness"; ``*`` stands for any word.  By
            default the entries that the description gives, or none where there are ``coordinates``.
        parameters: names of run-time parameters to find by simulations, "joints.joint1.gamma.friction.coulomb", or
            what they begin with; ``*`` stands for any word.
        bandwidth: rad/s, with which these simulations are led along the motion by gains, for robots that do not stay
            near to it under their drives alone; 0 for none.
        confidence: of the intervals, between 0 and 1; Student's t over blocks of time.
        kernel: of that robot, float64, with ``fitting_kernels``; built if None.

    Raises:
        InputError: the file or an argument cannot be used, samples are too few or have gaps, or they leave a
            mechanism's coordinates open.
        LoopError: loops do not close near a sample.
    """
    robot = as_robot(robot).with_constraints()
    if not (is_usable(confidence) and 0.0 < confidence < 1.0):
        raise InputError(f"confidence: {show(confidence)}; allowed: a number between 0 and 1")
    if not (is_usable(bandwidth) and bandwidth >= 0.0):
        raise InputError(f"bandwidth: {show(bandwidth)}; allowed: a number of rad/s, at least 0")
    internal_states = build_model(robot).internal_states
    if parameters is not None or internal_states:
        _refuse_beside(internal_states, coordinates, matrices, parameters)
        names = numbers_sought(robot, parameters)
        report, motions = progress or no_report, _each(motion)
        return fit_numbers(
            robot, motions, names, confidence=confidence, bandwidth=bandwidth, kernel=kernel, progress=report
        )
    if bandwidth:
        raise InputError(f"bandwidth: {bandwidth!r}; allowed: with parameters, which are found by simulations")
    if kernel is None:
        kernel = build(robot, kernels=fitting_kernels(robot), progress=progress or (lambda _: None))
    refuse_followers(robot, kernel)
    [*others, last] = _each(motion)
    if others:
        raise InputError(f"motion: got {len(others) + 1} of them; allowed: one, or several with parameters")
    even = evenly_sampled(measured_motion(robot, last, kernel.coordinates))
    motion, step = even.motion, even.step
    model = build_model(robot)
    moved = _moved(kernel, model, motion, step)
    noise = dict(zip(kernel.coordinates, noise_deviation(motion.q).tolist(), strict=True))
    sought, warnings = _sought(model, kernel, motion, coordinates, moved.following)
    numbers = MatrixNumbers.of(kernel)
    entries = entries_sought(robot, () if matrices is None and coordinates else matrices)
    between = moved_by(kernel, moved, entries)
    entries, blind = _seen(model, kernel, motion, entries, {*motion.measured, *moved.following}, between)
    sought = _beside_matrices(robot, sought, entries)
    if not coordinates:
        sought = _described_ones(robot, sought, between)
    if blind:
        warnings.append(f"not fitted, as no measured coordinate with a known drive has them: {listed(blind)}")
    if not motion.driven:
        driven = [kernel.coordinates[i] for i in model.driven]
        such = f" such as {component_name(driven[0], 'drive')}" if driven else ""
        what = f"forces that drive {', '.join(driven)} are unknown" if driven else "nothing is driven"
        warnings.insert(0, f"the motion has no drives: no columns{such}; {what}")
    if robot.is_closed:
        still = [item for item in sought if not _moves(kernel, moved, item, noise)]
        warnings += [f"{item.name} does not move enough to say anything" for item in still]
        sought = [item for item in sought if item not in still]
        everything: list[Sought | Entry] = [*sought, *entries]
        systems = iter([of_mechanism(kernel, model, motion, moved, everything, noise)] if everything else [])
    else:
        systems = of_tree(kernel, model, motion, moved, sought, entries, between, noise)
    described, fitted, open_names = dict(robot.numbers()), list[FittedCoordinate](), list[str]()
    found = list[FittedMatrix]()
    for equations in systems:
        able = [half for half in HALF_WIDTHS if len(motion.t) >= least_samples(FIRST + half)]
        solutions = [equations.system.solved(half, moved.half + half) for half in able]
        own = [(place, item) for place, (item, _) in enumerate(equations.places) if isinstance(item, Entry)]
        found += fitted_matrices(own, solutions, numbers, confidence, step)
        open_names += [entry.name for place, entry in own if not np.isfinite(solutions[0].values[place])]
        for item in equations.sought:
            estimates: dict[str, Estimate | None] = dict.fromkeys(KEYS)
            for column in item.columns:
                place = equations.places.index((item, column))
                best = min(solutions, key=lambda one: float(one.variances[place]))
                if np.isfinite(best.values[place]):
                    before = described.get(item.parameter(column)) or 0.0
                    estimates[KEYS[column]] = best.estimate(place, confidence, before, step)
                elif equations.system.of_one is None:
                    open_names.append(component_name(item.name, KEYS[column]))
            if any(estimates.values()):
                entry = FittedCoordinate(item.name, **estimates, noise=noise.get(item.name, 0.0), owner=item.owner)
                warnings += doubts(entry)
                fitted.append(entry)
            elif equations.system.of_one is not None:
                rms = float(np.sqrt(np.mean(motion.q[:, kernel.coordinates.index(item.name)] ** 2)))
                said = f"rms {rms:.2g}, its noise {noise[item.name]:.2g}"
                warnings.append(f"{item.name} does not move enough to say anything: {said}")
    if open_names:
        warnings.append(f"the motion and its drives do not determine {listed(open_names)}, or not one beside another")
    warnings += [text for matrix in found for text in doubts_about(matrix)]
    notes = even.notes
    notes += _closed_notes(motion, bool(kernel.constraints)) if robot.is_closed else _notes(motion)
    notes += tuple(_taken_in(matrix) for matrix in found if matrix.taken_in)
    by_name = {
        number_name(entry.owner, entry.coordinate, key): estimate
        for entry in fitted
        for key in KEYS
        if (estimate := getattr(entry, key)) is not None
    }
    notes += tuple(beam_notes(robot, by_name))
    return FitResult(robot.name, confidence, tuple(fitted), tuple(warnings), notes, tuple(found))


def _each(motion: Motion | Sequence[Motion]) -> list[Motion]:
    """Return motions, one or several, as a list; InputError for none."""
    if isinstance(motion, (MeasuredMotion, Path, str)):
        return [motion]
    motions: list[Motion] = list(motion) if isinstance(motion, (list, tuple)) else [cast("Motion", motion)]
    if not motions:
        raise InputError("motion: got none; allowed: one at least")
    return motions


def _refuse_beside(
    internal_states: Sequence[str],
    coordinates: Sequence[str],
    matrices: Sequence[str] | None,
    parameters: Sequence[str] | None,
) -> None:
    """Raise InputError for what is found from forces where simulations are asked for, or internal states need them."""
    for label, value in (("coordinates", coordinates), ("matrices", matrices)):
        if value:
            reason = (
                f"laws have states ({listed(internal_states)})" if parameters is None else "parameters are asked for"
            )
            raise InputError(
                f"{label}: {listed(value)}, and {reason}, so that numbers are found by simulations; allowed: names of"
                " parameters alone"
            )


def _taken_in(matrix: FittedMatrix) -> str:
    names = listed([component_name(matrix.joint, name) for name in matrix.taken_in])
    return f"{matrix.name} is the whole {matrix.key}: with it the tables of {names} have none"


def fitting_kernels(robot: Robot) -> tuple[str, ...]:
    """Return names of the kernels that a fit calls."""
    laws = CUT_LAWS if robot.is_closed else ()
    pairs = FRAME_POSES if pairs_of(robot) else ()
    further = kernel_group(robot, INVERSE_DYNAMICS, INERTIA, laws, pairs)
    return tuple(dict.fromkeys((*further, *mechanism_kernels(robot))))


def _moved(kernel: Kernel, model: Model, motion: MeasuredMotion, step: float) -> Moved:
    """Return the motion with its loops closed; velocities and accelerations are a file's, or derivatives.

    The narrowest filter gives the derivatives, so that it hardly bends what is not linear in the motion.  Of a tree it
    is in front of all that a file has.
    """
    narrow, half = Differentiator(FIRST, step), FIRST
    is_whole = motion.v is not None and motion.a is not None
    if is_whole and model.robot.is_closed:
        q, v, a, u, half = motion.q, motion.v, motion.a, motion.u, 0
    else:
        q, u = narrow(motion.q), narrow(motion.u)
        v = narrow(motion.q, 1) if motion.v is None else narrow(motion.v)
        if motion.a is not None:
            a = narrow(motion.a)
        else:
            a = narrow(motion.q, 2) if motion.v is None else narrow(motion.v, 1)
    assert v is not None
    assert a is not None
    following: tuple[str, ...] = ()
    if kernel.constraints:
        q, v, a, following = closed_motion(kernel, model, motion.measured, q, v, a)
    return Moved(q, v, a, u, half, narrow.weights, following, pairs_of(model.robot))


def _sought(
    model: Model, kernel: Kernel, motion: MeasuredMotion, asked: Sequence[str], following: Sequence[str]
) -> tuple[list[Sought], list[str]]:
    """Return coordinates to fit, and warnings about those that cannot be.

    Of a tree's deviations both parameters are fitted; elsewhere those that are described, or asked for.
    """
    numbers, known = dict(model.robot.numbers()), (*kernel.coordinates, *kernel.cut_laws)
    for name in asked:
        if name not in known:
            raise UnknownNameError(f"coordinates: {name!r} is unknown{nearest(name, known)}")
    driven = [kernel.coordinates[i] for i in model.driven]
    sought, warnings = [], []
    for name in asked or known:
        if name in model.robot.modal_coordinates:
            owner = LINKS
        else:
            owner = OF_JOINTS if name in kernel.coordinates else "loops" if "." in name else "couplings"
        described = [c for c, key in enumerate(KEYS) if numbers.get(number_name(owner, name, key)) is not None]
        if model.robot.is_closed:
            columns = tuple(described) or ((0, 1) if asked else ())
            reason = _reason(model.robot, kernel, motion, name, following, driven) if columns else ""
        else:
            columns = tuple(described) if _is_principal(model.robot, name) else (0, 1)
            reason, columns = _reason_in_tree(model.robot, motion, name, columns, is_asked=bool(asked))
        if reason:
            warnings.append(f"{name} {reason}")
        elif columns:
            sought.append(Sought(owner, name, columns))
    return sought, warnings


def _is_principal(robot: Robot, name: str) -> bool:
    if is_mode(name):
        return False
    joint, short = split_component(name)
    return robot.joint(joint).principal == short


def _is_transmitted(robot: Robot, name: str) -> bool:
    """Return whether a coordinate hangs on the transmission between a motor and its joint."""
    if is_mode(name):
        return False
    joint, short = split_component(name)
    moved = robot.joint(joint)
    return moved.motor is not None and short in (MOTOR, moved.principal)


_TRANSMITTED = "hangs on a transmission between motor and joint, which is not fitted"
_UNMEASURED = "was not measured, and counts as zero"
_UNMEASURED_MODE = f"{_UNMEASURED}; parameters are found without, by simulations"


def _reason_in_tree(
    robot: Robot, motion: MeasuredMotion, name: str, columns: tuple[int, ...], *, is_asked: bool
) -> tuple[str, tuple[int, ...]]:
    """Say why a tree's coordinate cannot be fitted, "" if it can or nobody asked; and the columns that are left."""
    if _is_transmitted(robot, name):
        return (_TRANSMITTED if is_asked else ""), ()
    if name not in motion.measured:
        return (_UNMEASURED_MODE if is_mode(name) else _UNMEASURED), ()
    if not columns:
        return ("is a principal coordinate without stiffness or damping in the description" if is_asked else ""), ()
    if _is_principal(robot, name) and name not in motion.driven:
        return f"is a principal coordinate, and its drive is not known: a column {name}.drive", ()
    return "", columns


def _reason(
    robot: Robot, kernel: Kernel, motion: MeasuredMotion, name: str, following: Sequence[str], driven: Sequence[str]
) -> str:
    """Say why a coordinate of a mechanism cannot be fitted; "" if it can."""
    if name not in kernel.coordinates:
        plain = "clearance" not in cut_numbers(kernel)[name] and name not in kernel.knots
        return "" if plain else "has a law that is not linear, which is not fitted"
    if _is_transmitted(robot, name):
        return _TRANSMITTED
    if name in kernel.prescribed:
        return "is prescribed: what moves it takes its forces, too"
    if name in driven and name not in motion.driven:
        return f"has a drive that is not known: a column {name}.drive"
    if name not in motion.measured and name not in following:
        return _UNMEASURED
    return ""


def _moves(kernel: Kernel, moved: Moved, item: Sought, noise: dict[str, float]) -> bool:
    """Return whether a coordinate moves more than its noise does."""
    s, _, _ = deviation_of(kernel, moved, item)
    return bool(np.mean(s**2) > (1.0 + SIGNAL) * noise.get(item.name, 0.0) ** 2 + 1e-30)


def _seen(
    model: Model,
    kernel: Kernel,
    motion: MeasuredMotion,
    entries: Sequence[Entry],
    moving: set[str],
    between: set[str],
) -> tuple[tuple[Entry, ...], list[str]]:
    """Return the entries that have a share in equations that can be written, and the names of the others.

    Args:
        model, kernel, motion: of the fit.
        entries: sought.
        moving: coordinates that are known.
        between: those that move the frames of loop joints and bushings of which entries are.
    """
    rows = set(known_rows(model, kernel, motion)) if not model.robot.is_closed else set(kernel.coordinates)

    def is_seen(entry: Entry) -> bool:
        if entry.owner != OF_JOINTS:
            return bool(rows & between) and bool(moving & between)
        return any(row in rows and by in moving for row, by in entry.pairs)

    return tuple(filter(is_seen, entries)), [entry.name for entry in entries if not is_seen(entry)]


def _beside_matrices(robot: Robot, sought: Sequence[Sought], entries: Sequence[Entry]) -> list[Sought]:
    """Return coordinates without what entries stand for, and of a joint with damping as a whole without their own.

    Coordinates' own damping is fitted beside that where it is described.
    """
    whole = {(entry.owner, entry.ends[0], entry.column) for entry in entries if len(entry.ends) == 1}
    joints, described = {entry.joint for entry in entries if entry.owner == OF_JOINTS}, dict(robot.numbers())
    left = list[Sought]()
    for item in sought:
        joint = joint_of(item.name) if item.owner == OF_JOINTS else ""
        damped = joint in joints and robot.joint(joint).damping is not None
        gone = [column for column in item.columns if (item.owner, item.name, column) in whole]
        if damped and not described.get(item.parameter(1)):
            gone.append(1)
        columns = tuple(column for column in item.columns if column not in gone)
        left += [replace(item, columns=columns)] if columns else []
    return left


def _described_ones(robot: Robot, sought: Sequence[Sought], between: set[str]) -> list[Sought]:
    """Return coordinates, of those that move bushings whose entries are sought what the description gives alone."""
    described, left = dict(robot.numbers()), list[Sought]()
    for item in sought:
        given = tuple(column for column in item.columns if described.get(item.parameter(column)) is not None)
        columns = given if item.in_tree and item.name in between else item.columns
        left += [replace(item, columns=columns)] if columns else []
    return left


def _notes(motion: MeasuredMotion) -> tuple[str, ...]:
    how = (
        "derivatives: central differences of eighth order behind a bell of 9 samples"
        if motion.a is None
        else "rates and accelerations from the file"
    )
    still = [name for name in motion.coordinates if name not in motion.driven]
    notes = [f"{how}; all terms filtered alike; what white noise adds on average is taken off"]
    if still:
        notes.append(f"without a drive in the file, taken as zero: {', '.join(still)}")
    return tuple(notes)


def _closed_notes(motion: MeasuredMotion, is_closed: bool) -> tuple[str, ...]:
    """Return notes about a mechanism; ``is_closed``: whether loops or couplings of it are rigid."""
    how = (
        "rates and accelerations: from the file"
        if motion.v is not None and motion.a is not None
        else "derivatives: central differences of eighth order behind a bell of 9 samples"
    )
    if not is_closed:
        return (f"{how}; nothing is rigid in loops and couplings; what white noise adds on average is taken off",)
    return (
        f"{how}; loops closed at every sample; balanced along what loops and couplings leave free",
        "noise of the motion makes stiffness look softer: what it adds is not taken off",
    )
