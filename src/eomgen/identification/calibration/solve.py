"""Calibration of a robot by measured poses, from the file to the result.

file -> MeasuredPoses -> ErrorModel -> Problem -> placed -> fitted -> Variants -> CalibrationResult
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ...arrays import Array
from ...description import RobotLike, as_robot
from ...errors import InputError, UnknownNameError
from ...identifiers import is_identifier
from ...limits import is_usable
from ...motion.measured_numbers import answers_in_numbers
from ...names import component_name, listed, nearest_or_all, show, split_component
from ...optional import optional_import
from ...progress import StageReport, no_report, tells_at_prompt
from ...robot.elements.joint_stiffness import JOINT_STIFFNESS
from ...robot.joint_types import CUTS
from ...robot.model import Model, build_model
from ...robot.value import COORDINATES, MOTOR, Joint, Loop, Robot
from ..estimating import SOLVED
from ..geometry.blocks import FORCE
from ..geometry.compliances import Chosen, compliances_of, is_below
from ..geometry.error_model import (
    COMPLIANCE,
    FRAMES,
    JOINTS,
    LOOPS,
    SIZES,
    ErrorModel,
    ErrorParameter,
    model_parameters,
    rows_of,
)
from ..geometry.loop_constraints import (
    LoopConstraints,
    closed_readings,
    closed_robot,
    closing_of,
    held_by_loops,
    joint_at,
)
from ..geometry.observations import ENCODER, ORIENTATION, POSITION, Block, at_rows, observations_of, two_divisors
from ..geometry.placing import placed
from ..geometry.poses import MeasuredPoses, read_poses
from ..geometry.solve import LOSSES, Fit, Loss, Problem, whitened
from ..geometry.stations import Chain, chain_of, matrix_of
from ..stiffness.matrix_entries import OF_BUSHINGS, entries_sought
from .as_described import described_values, indefinite_notes
from .calibrated import OF_LINK
from .diagnosing import Diagnosis, diagnosed, diagnosis_notes
from .drives import with_drives
from .identifiability import Identifiable, identifiable, refuse_too_few, without_unseen
from .misreadings import Left, judged, left_of
from .result import CalibrationResult
from .serial import Serial
from .traps import (
    at_once,
    design_effect,
    far_off,
    implausible,
    odd_angles,
    refuse_impossible,
    refuse_no_length,
    suspicion_of,
)
from .variants import (
    VARIANTS,
    Rms,
    Variant,
    Variants,
    folds_from,
    medians_of,
    only_fitted,
    problem_of_variant,
    residuals_of,
    series_notes,
    variants_of,
)
from .written import WrittenFit, merged_values, written_fits, written_note

FOLDS = 10
LACK = 1e-3  # probability of a reduced chi-square by chance, below which the fit lacks something
TURN = 0.1  # rad: median of what is left of orientations that nothing explains
OFF = 0.03  # of the reach: median of what is left of positions that nothing explains
_SUSPECT = 0.15  # of both: what is left where other readings are tried
_ROWS, _ROWS_CLOSED = 32, 12  # rows that readings are tried with
_SOFT = 1e-3  # rad or m: what a stiffness that nothing is said of is expected to deflect in all
_LIGHT = 1e-3  # of the largest force, or moment: a load that is less does not say how soft a coordinate may be


@dataclass(frozen=True)
class Task:
    """The task: the robot, measured frames with link, pose and whether it is described, and all options."""

    robot: Robot
    links: Mapping[str, tuple[str, Array]]
    known: Mapping[str, bool]
    noise: ArrayLike | None
    covariance: Mapping[str, ArrayLike]
    loss: str | None
    fixed: tuple[str, ...]
    stiffness: tuple[str, ...]
    sizes: tuple[float, float]


@answers_in_numbers("poses")
@tells_at_prompt("calibrating")
def calibrate(  # noqa: PLR0913
    robot: RobotLike,
    poses: MeasuredPoses | Path | str,
    *,
    frames: Mapping[str, str] | None = None,
    rotation: str = "rotvector",
    noise: ArrayLike | None = None,
    covariance: Mapping[str, ArrayLike] | None = None,
    loss: Loss | None = None,
    folds: int | str = FOLDS,
    fixed: Iterable[str] = (),
    stiffness: Iterable[str] = (),
    drives: bool = False,
    variant: Variant = "full",
    sizes: Sequence[float] = SIZES,
    confidence: float = 0.95,
    force: bool = False,
    progress: StageReport | None = None,
) -> CalibrationResult:
    """Return offsets, placements and stiffness of a robot from poses, positions or distances of its frames.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        poses: from ``read_poses``, or the path of a .csv or .npz file.
        frames: link of every measured frame that the description does not have, {"probe": "link6"}.
        rotation: how the file writes orientations: "rotvector", "rpy" or "quaternion".
        noise: standard deviations of lengths (m) and rotations (rad) where the file has none; estimated by default.
        covariance: of a frame's errors, (3, 3) or (6, 6), by its name: of position, or of position and turn; for every
            row one as (R, 3, 3) or (R, 6, 6).  From files by ``read_covariances``.
        loss: "huber", "cauchy" or "tukey": samples count the less, the more they are off.
        folds: parts of the poses that are held out, one after the other, contiguous within each series; "loo": every
            pose; 0: none, and the full variant alone.
        fixed: names of parameters that stay as described, or beginnings of them ("joints.joint1", "frames").
        stiffness: coordinates ("joint2.gamma") that are elastic though the description does not say so, and entries of
            stiffness matrices ("joints.joint2.stiffness.x.beta", or "joints.joint2.stiffness" for all of them, ``*``
            for any word; "loops.cut.stiffness" of loop joints).  Of a joint with such names all other entries stay as
            described, with the tables of the coordinates that they hang together with.  Otherwise those with a
            stiffness in the description are fitted in any case.
        drives: whether to look for terms of drives: gain, eccentricity, backlash, coupling, drift with warmth.
        variant: "placement", "zeros", "full" or "prior": the one that values are of.
        sizes: by how much offsets are expected to be off: as a share of the robot's reach, and rad.
        confidence: of intervals.
        force: whether to calibrate although another reading of the file explains it much better, which is noted then.
        progress: called with a line of text when a stage begins.

    Raises:
        InputError: a file or an option cannot be used, or the file shows one of the known mistakes.
        UnknownNameError: there is no frame, link, parameter or coordinate of a name.
    """
    robot, report = as_robot(robot).with_constraints(), progress or no_report
    count = folds_from(folds)
    task = Task(
        robot=robot,
        links=links_of(robot, frames or {}),
        known=dict.fromkeys(build_model(robot).frames, True) | dict.fromkeys(frames or {}, False),
        noise=noise,
        covariance=covariance or {},
        loss=_one_of("loss", loss, (None, *LOSSES)),
        fixed=tuple(fixed),
        stiffness=tuple(stiffness),
        sizes=two_sizes(sizes),
    )
    _one_of("variant", variant, VARIANTS)
    if variant != "full" and not count:
        raise InputError(f"variant: {show(variant)} without folds; allowed: full, or folds from 2 on")
    if not (is_usable(confidence) and 0.0 < confidence < 1.0):
        raise InputError(f"confidence: {show(confidence)}; allowed: a number between 0 and 1")
    report("reading poses")
    if not isinstance(poses, MeasuredPoses):
        columns = build_model(robot).coordinates
        names, places = tuple(task.links), robot.principal_coordinates
        poses = read_poses(poses, columns, names, rotation=rotation, encoders=robot.is_closed, principal=places)
    problem, start = problem_of(task, poses, careful=True)
    units, notes = at_once(poses), list[str]()
    suspicion = suspicion_of(poses, problem.model.chain, problem.rows)
    if suspicion:
        report("looking for mistakes")
        notes += _other_readings(task, poses, problem, {}, is_explained=True, force=force)
        if not force:
            raise InputError(suspicion)
        notes += [f"suspicious, and taken as it is: {suspicion}"]
    report("fitting")
    fit = only_fitted(problem, start, loss)
    if drives:
        problem, fit, more = with_drives(problem, fit, loss, report)
        notes += more
        start = problem.model.nominal  # each variant begins with what is described: terms of drives are of the full one
    problem, fit = without_unseen(problem, start, fit, loss)
    if count:
        variants = variants_of(problem, start, loss, units, count, confidence, report)
    else:
        parts = {"full": residuals_of(problem, fit.residuals, None, fit.trust)}
        variants = Variants({"full": fit}, parts, {}, None, {})
    report("looking for mistakes")
    full, medians = variants.fits["full"], medians_of(problem, variants, variant)
    limits = {POSITION: OFF * problem.model.chain.reach, ORIENTATION: TURN}
    is_explained = all(value <= limits[kind] for kind, value in medians.items())
    if any(value > _SUSPECT * limits[kind] for kind, value in medians.items()):
        notes += _other_readings(task, poses, problem, medians, is_explained=is_explained, force=force)
    huge = implausible(problem, variants.fits[variant])
    is_explained = is_explained and not huge
    effect, together = design_effect(poses, problem.seen, full, units)
    notes += [
        *together,
        *series_notes(problem, variants),
        *_notes(task, problem),
        *(huge or far_off(problem, variants.fits[variant])),
    ]
    report("looking at what is identifiable")
    shown = identifiable(problem, full)
    report("looking at residuals")
    diagnosis, serial = diagnosed(problem, full, shown.rank, loss, is_serial=effect == 1.0)
    fit = variants.fits[variant]
    sure, freedoms = effect * fit.covariance, full.freedoms / effect
    if serial is not None:
        sure, freedoms = _widened(problem, fit, serial), serial.freedoms
        with np.errstate(invalid="ignore"):
            ratios = np.diagonal(sure) / np.diagonal(fit.covariance)
        diagnosis = replace(diagnosis, widened=float(np.sqrt(np.nanmax(ratios))))
    notes += diagnosis_notes(diagnosis, poses, problem, shown.rank)
    uncertainty = _Uncertainty(variant, sure, freedoms, diagnosis, confidence)
    result = _result(task, poses, problem, variants, shown, uncertainty, notes)
    return replace(result, is_explained=is_explained)


def _other_readings(
    task: Task, poses: MeasuredPoses, problem: Problem, medians: Rms, *, is_explained: bool, force: bool
) -> list[str]:
    """Return notes about other readings of the file; InputError where one explains it, without ``force``."""
    simple = replace(task, noise=None, covariance={}, stiffness=())
    closing, closed = problem.model.closing, None
    if closing is not None:
        closed = closing, {q.tobytes(): x for q, x in zip(poses.q, problem.rows.readings, strict=True)}
    most = _ROWS_CLOSED if task.robot.is_closed else _ROWS

    def again(other: MeasuredPoses) -> Left:
        has_travel = any(np.isfinite(measured.travel).any() for measured in other.frames.values())
        if len(other.q) > most and not has_travel:
            other = other.part(np.linspace(0, len(other.q) - 1, most).round().astype(np.intp))
        frames = {name: replace(measured, sigma={}) for name, measured in other.frames.items()}
        return left_of(*problem_of(simple, replace(other, frames=frames), careful=False, closed=closed))

    judgement = judged(poses, again, is_closed=task.robot.is_closed)
    as_read = f"as it is read, a calibration of base and tool alone leaves {judgement.as_read}"
    if judgement.cause:
        (text, left), *tied = judgement.cause
        more = f"; these poses do not distinguish it from: {'; '.join(name for name, _ in tied)}" if tied else ""
        said = f"{poses.source}: {as_read}; read as {text}: {left}{more}"
        if not force:
            raise InputError(
                f"{said}; allowed: m and rad, axes of one device, orientations as --rotation (rotation=) says, or"
                " --force (force=True)"
            )
        return [said]
    if is_explained:
        return []
    others = [(text, left) for text, left in judgement.others if left.is_like(judgement.as_read)]
    best = "; ".join(f"{text}: {left}" for text, left in others[:3])
    large = ", ".join(f"{value:.3g} {'m' if kind == POSITION else 'rad'} of {kind}" for kind, value in medians.items())
    return [
        f"what was measured is not explained: the fit leaves {large} (medians of vectors); {as_read}, and other"
        f" readings of the file no less: {best}"
    ]


def _widened(problem: Problem, fit: Fit, serial: Serial) -> Array:
    """Return the covariance of a fit's values, (P, P), with errors that go on from row to row."""
    r, A = at_rows(problem.model, problem.rows, problem.seen, fit.x)
    S = whitened(problem, fit, r, A)[1] / problem.model.sizes
    return serial.widened(fit.covariance, S, estimated=bool(np.isnan(problem.seen.sigma).any()))


def links_of(robot: Robot, frames: Mapping[str, str]) -> dict[str, tuple[str, Array]]:
    """Return the link and pose on it of every frame that may have been measured."""
    links = {robot.base: robot.base, **{link.name: link.name for link in robot.links}}
    poses = {name: (name, np.eye(4)) for name in links}
    poses |= {frame.name: (frame.link, matrix_of(frame.placement)) for frame in robot.frames}
    for name, link in frames.items():
        if link not in links:
            raise UnknownNameError(f"frames: {name}: there is no link {link!r}{nearest_or_all(link, links)}")
        if not is_identifier(name) or name in poses:
            raise InputError(f"frames: {show(name)}; allowed: an identifier that no frame or link has yet")
        poses[name] = link, np.eye(4)
    return poses


def problem_of(
    task: Task,
    poses: MeasuredPoses,
    *,
    careful: bool,
    closed: tuple[LoopConstraints, Mapping[bytes, Array]] | None = None,
) -> tuple[Problem, Array]:
    """Return the problem to fit, and first values.

    careful: whether mistakes that show before a fit are refused.  closed: loops, and readings that close them by the
    bytes of a row of coordinates, where they are known already.
    """
    robot = task.robot
    measured = {name: task.links[name] for name in poses.frames}
    chain = chain_of(robot, measured)
    asked = _chosen(task, chain, poses)
    compliances = list(compliances_of(chain, robot, asked))
    columns = _columns(robot, chain, poses, is_loaded=bool(compliances))
    rows = rows_of(chain, robot, poses, columns)
    if careful:
        refuse_impossible(poses, chain)
    closing = None
    if closed is not None:
        closing = closed[0]
        rows = replace(rows, readings=np.array([closed[1][q.tobytes()] for q in poses.q]))
    elif robot.is_closed:
        odd = odd_angles(poses, chain, rows) if careful else ""
        if odd:  # they need not close
            raise InputError(odd)
        read = [place[:2] for place in columns.values()]
        tree, closing = _closing(robot, chain, compliances, read, poses.source)
        held = _held_ones(task, tree, chain, closing, compliances)
        if held:
            compliances = list(compliances_of(chain, robot, asked, rigid=held))
            tree, closing = _closing(robot, chain, compliances, read, poses.source)
        places = [poses.place(row) for row in range(len(poses.q))]
        rows = replace(rows, readings=closed_readings(chain, closing, tree, rows.readings, places))
    series = sorted(set(poses.series.tolist()))
    known = {name: task.known[name] for name in measured}
    where = robot if closing is None else closing.robot  # with loop joints rigid in what they deflect by
    parameters = tuple(model_parameters(where, chain, series, known, task.sizes))
    bases = {number: np.eye(4) for number in series}
    model = ErrorModel(robot, chain, (*parameters, *compliances), bases, closing)
    encoders = _encoders(poses, columns, closing)
    if not encoders and not any(m.is_measured for m in poses.frames.values()):
        raise InputError(
            f"{poses.source}: nothing is measured; allowed: columns of frames, or of passive coordinates beside drives"
        )
    seen = observations_of(poses, task.noise, task.covariance, encoders)
    model = placed(model, rows, seen, {name: known[name] for name in known if poses.frames[name].is_measured})
    model = _sized(model, Problem(model, rows, seen, np.zeros(0, dtype=np.intp)))
    chosen = [i for i, parameter in enumerate(model.parameters) if not asked.stays(parameter)]
    for name in task.fixed:
        if not any(is_below(parameter.name, (name,)) for parameter in model.parameters):
            names = [parameter.name for parameter in model.parameters]
            raise UnknownNameError(f"fixed: there is no parameter {name!r}{nearest_or_all(name, names)}")
    problem = Problem(model, rows, seen, np.array(chosen, dtype=np.intp))
    if careful and closing is None:
        refuse_too_few(problem, poses.source)
        refuse_no_length(problem, poses.source)
    return problem, model.nominal


def _encoders(
    poses: MeasuredPoses, columns: Mapping[str, tuple[int, int, float]], closing: LoopConstraints | None
) -> list[Block]:
    """Return readings of passive coordinates of a closed mechanism: its loops say what they should be."""
    passive = () if closing is None else closing.passive
    rows = np.arange(len(poses.q))
    return [
        Block(name, ENCODER, rows, factor * poses.q[:, poses.coordinates.index(name)], (k, c))
        for name, (k, c, factor) in columns.items()
        if (k, c) in passive
    ]


def _columns(robot: Robot, chain: Chain, poses: MeasuredPoses, *, is_loaded: bool) -> dict[str, tuple[int, int, float]]:
    """Return station, coordinate and factor of every column of coordinates; InputError where a joint's is missing.

    is_loaded: whether loads move what was measured, so that joints count that move loads alone.
    """
    station = {s.name: k for k, s in enumerate(chain.stations) if s.joint is not None}
    columns = {}
    for name in poses.coordinates:
        owner, kind = split_component(name)
        at = chain.stations[station[owner]]
        if kind == MOTOR:
            assert at.joint is not None
            assert at.joint.motor is not None
            assert at.principal is not None
            if component_name(owner, COORDINATES[at.principal]) in poses.coordinates:
                raise InputError(f"{poses.source}: {name} and its joint's coordinate are both there; allowed: one")
            columns[name] = station[owner], at.principal, 1.0 / at.joint.motor.ratio
        else:
            columns[name] = station[owner], COORDINATES.index(kind), 1.0
    read = {place[:2] for place in columns.values()}
    tools = [k for name, k in chain.tools.items() if poses.frames[name].is_measured or is_loaded]
    moving = {k for tool in tools for k in chain.ancestors(tool)}
    for name, k in station.items():
        principal = chain.stations[k].principal
        if k in moving and principal is not None and (k, principal) not in read and not robot.is_closed:
            column = component_name(name, COORDINATES[principal])
            raise InputError(
                f"{poses.source}: the column {column} is missing; allowed: all joints that move what was measured"
            )
    return columns


def _chosen(task: Task, chain: Chain, poses: MeasuredPoses) -> Chosen:
    """Return what is asked for: coordinates, and entries of stiffness matrices of joints and loop joints."""
    names = [component_name(s.name, kind) for s in chain.stations if s.joint for kind in COORDINATES]
    names += [component_name(loop.name, x.name) for loop in task.robot.loops for x in CUTS[loop.type]]
    entries = [name for name in task.stiffness if name.startswith((f"{JOINTS}.", f"{LOOPS}.", f"{OF_BUSHINGS}."))]
    for name in task.stiffness:
        if name not in names and name not in entries:
            raise UnknownNameError(f"stiffness: there is no coordinate {name!r}{nearest_or_all(name, names)}")
    couplings: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for entry in entries_sought(task.robot, entries, "stiffness", rigid=True):
        if entry.key != JOINT_STIFFNESS:
            raise InputError(f"stiffness: {entry.name} is a damping; allowed: entries of stiffness matrices")
        if entry.owner == OF_BUSHINGS:
            raise InputError(
                f"stiffness: {entry.name} is of a bushing; allowed: entries of joints and loop joints (fit finds those"
                " of bushings, from motions and their drives)"
            )
        couplings.setdefault((entry.owner, entry.joint), []).append((entry.one, entry.other))
    return Chosen(poses.coordinates, task.stiffness, couplings, task.fixed)


def _closing(
    robot: Robot, chain: Chain, compliances: Sequence[ErrorParameter], read: Sequence[tuple[int, int]], source: str
) -> tuple[Model, LoopConstraints]:
    """Return the tree of a closed mechanism, and what closes it where elastic coordinates of loop joints are rigid."""
    tree = build_model(closed_robot(robot, chain, compliances))
    return tree, closing_of(tree, chain, read, source)


def _held_ones(
    task: Task, tree: Model, chain: Chain, closing: LoopConstraints, compliances: Sequence[ErrorParameter]
) -> list[tuple[int, int]]:
    """Return stations and coordinates of a closed mechanism whose deflections passive coordinates cannot take up.

    Raises:
        InputError: a coordinate that is asked for follows from the loops, or is held by them.
    """
    ends = [(q.station, c) for q in compliances for c in (q.coordinate, q.other) if c is not None]
    places = list(dict.fromkeys(ends))
    held = held_by_loops(tree, chain, closing, places)
    for k, c in places:
        name = component_name(joint_at(chain, task.robot, k), COORDINATES[c])
        if name in task.stiffness and (k, c) in (*closing.passive, *held):
            why = "follows from the drives" if (k, c) in closing.passive else "is held by the loops, too"
            raise InputError(
                f"stiffness: {name} {why}; allowed: drives of {task.robot.name}, and coordinates whose deflections the"
                " passive ones can take up"
            )
    return held


def _sized(model: ErrorModel, problem: Problem) -> ErrorModel:
    """Return model with expected sizes of compliances that the description says nothing of, by the loads there are."""
    if not any(parameter.size == 0.0 for parameter in model.parameters):
        return model
    state = model.at(model.nominal, problem.rows)
    forces = np.abs(model.forces(state.located, problem.rows)).max(axis=0)
    single = {(q.station, q.coordinate): q.size for q in model.parameters if q.factor == FORCE and q.is_diagonal}

    def size(k: int, c: int) -> float:
        least = _LIGHT * float(forces[:, 3 * (c // 3) : 3 * (c // 3) + 3].max())  # a load that is none shows nothing
        return single.get((k, c)) or _SOFT / max(float(forces[k, c]), least, 1e-3)

    def sized(q: ErrorParameter) -> ErrorParameter:
        other = q.coordinate if q.other is None else q.other
        return replace(q, size=float(np.sqrt(size(q.station, q.coordinate) * size(q.station, other))))

    return replace(model, parameters=tuple(q if q.size else sized(q) for q in model.parameters))


def _notes(task: Task, problem: Problem) -> list[str]:
    """Return notes about what a result leaves out, and what counts beside frames."""
    notes = [
        f"{name} is a link: its estimated place is written as {name}{OF_LINK}, and the link stays where it is described"
        for name in problem.model.chain.tools
        if name in {task.robot.base, *(link.name for link in task.robot.links)}
        and any(problem.model.parameters[i].name.startswith(f"{FRAMES}.{name}.") for i in problem.active)
    ]
    encoders = [block.frame for block in problem.seen.blocks if block.kind == ENCODER]
    if encoders:
        notes.append(f"encoders of passive coordinates count as measured: {listed(encoders)}")
    model = problem.model
    fitted = {(q.station, c) for q in model.parameters if q.kind == COMPLIANCE for c in (q.coordinate, q.other)}
    if fitted and task.robot.springs:
        notes.append("point-to-point springs are left out of the loads")
    if fitted and task.robot.elements:
        notes.append(f"bushings are left out of the loads: {listed([x.name for x in task.robot.elements])}")
    joints: dict[int, Joint | Loop] = {k: s.joint for k, s in enumerate(model.chain.stations) if s.joint is not None}
    joints |= {first: loop for loop, (first, _) in zip(task.robot.loops, model.chain.cuts, strict=True)}
    left = [
        component_name(joint.name, kind)
        for k, joint in joints.items()
        for kind in COORDINATES
        if _is_elastic(joint, kind) and (k, COORDINATES.index(kind)) not in fitted
    ]
    if left and model.closing is not None:
        notes.append(f"stiffness of {listed(left)} is not fitted: the loops hold these coordinates, too")
    bent = [
        component_name(joint.name, kind)
        for joint in task.robot.joints
        for kind, coordinate in joint.coordinates.items()
        if coordinate.law() and coordinate.has_stiffness
    ]
    if bent:
        notes.append(f"of {listed(bent)} the linear stiffness alone counts")
    return notes


def _is_elastic(joint: Joint | Loop, kind: str) -> bool:
    """Return whether the description gives a coordinate of a joint or a loop joint a stiffness."""
    coordinate, matrix = joint.coordinates.get(kind), joint.stiffness
    own = coordinate is not None and coordinate.stiffness is not None and coordinate.stiffness > 0.0
    return own or (matrix is not None and kind in matrix.held)


@dataclass(frozen=True)
class _Uncertainty:
    """Uncertainty of the values of a variant: what ``CalibrationResult`` has under the same names."""

    variant: str
    covariance: Array
    freedoms: float
    diagnosis: Diagnosis
    confidence: float


def _result(
    task: Task,
    poses: MeasuredPoses,
    problem: Problem,
    variants: Variants,
    shown: Identifiable,
    uncertainty: _Uncertainty,
    notes: list[str],
) -> CalibrationResult:
    model, fit, full = problem.model, variants.fits[uncertainty.variant], variants.fits["full"]
    values, described, deviations = described_values(task.links, task.known, model, fit.x, uncertainty.covariance)
    notes += indefinite_notes(model, fit.x)
    chosen = problem.active
    by_name = {q.name: float(value) for q, value in zip(model.parameters, values, strict=True)}
    variant = problem_of_variant(problem, uncertainty.variant, variants.prior)
    written = written_fits(variant, fit, by_name, task.loss)
    apart = [_in_file(task, model, one, values, deviations)[:, chosen] for one in written.values()]
    notes += [written_note(problem, form, one) for form, one in written.items()]
    names = tuple(model.parameters[i].name for i in chosen)
    fits = {uncertainty.variant: fit, **{f"what is written as .{form}": one.fit for form, one in written.items()}}
    open_ones = [f"{name}: {one.status}" for name, one in fits.items() if one.status != SOLVED]
    is_known = not np.isnan(problem.seen.sigma).any()
    if not (is_known or uncertainty.diagnosis.is_checked):
        deviations = np.full_like(deviations, np.nan)
    chi2 = full.chi2 / full.freedoms if is_known and full.freedoms > 0.0 else None
    if chi2 is not None:
        notes += _lack_of_fit(full)
    return CalibrationResult(
        robot=task.robot.name,
        frames={name: task.links[name][0] for name in model.chain.tools},
        rows=len(poses.q),
        names=names,
        units=tuple(model.parameters[i].unit for i in chosen),
        values=values[chosen],
        described=described[chosen],
        deviations=deviations[chosen],
        rank=shown.rank,
        rank_above_noise=shown.rank_above_noise,
        merged=shown.merged,
        weak=shown.weak,
        residuals=variants.residuals,
        noise=_noise(problem, full),
        is_noise_known=is_known,
        chi2=chi2,
        prior=variants.prior,
        gains=variants.gains,
        mistrusted=_down_weighted(problem, full),
        notes=tuple(notes),
        model=model,
        x=fit.x,
        source=poses.source,
        status="; ".join(open_ones) or SOLVED,
        written={form: residuals_of(problem, one.fit.residuals, None, one.fit.trust) for form, one in written.items()},
        written_values=np.array(apart).reshape(len(written), 2, len(chosen)),
        **vars(uncertainty),
    )


def _in_file(task: Task, model: ErrorModel, written: WrittenFit, values: Array, deviations: Array) -> Array:
    """Return values and deviations as a file has them, (2, P); of what it cannot have those of the fit with it."""
    own, _, deviations_of_own = described_values(task.links, task.known, model, written.fit.x, written.fit.covariance)
    return np.stack([merged_values(values, own, written), merged_values(deviations, deviations_of_own, written)])


def _noise(problem: Problem, fit: Fit) -> dict[str, float]:
    """Return the root of the mean square of the standard deviations of what was measured, by frame and kind."""
    noise = {}
    for group, block in enumerate(problem.seen.blocks):
        places = problem.seen.group == group
        noise[component_name(block.frame, block.kind)] = float(np.sqrt(np.mean(fit.sigma[places] ** 2)))
    return noise


def _down_weighted(problem: Problem, fit: Fit) -> tuple[tuple[int, float], ...]:
    rows: dict[int, float] = {}
    for i in np.flatnonzero(fit.trust < 0.5):
        row = int(problem.seen.row[i])
        rows[row] = min(rows.get(row, 1.0), float(fit.trust[i]))
    return tuple(sorted(rows.items(), key=lambda entry: entry[1]))


def _lack_of_fit(fit: Fit) -> list[str]:
    """Return a note where known noise does not explain what is left."""
    with optional_import("SciPy", "calibrate needs"):
        from scipy.special import chdtrc
    probability = float(chdtrc(fit.freedoms, fit.chi2))
    if probability >= LACK:
        return []
    ratio = fit.chi2 / fit.freedoms
    return [
        f"lack of fit: reduced chi-square {ratio:.3g}, by chance with a probability of {probability:.1g}; the model"
        " lacks something that the poses show (drives, stiffness), or the noise is larger than stated"
    ]


def _one_of(label: str, value: str | None, allowed: Sequence[str | None]) -> str | None:
    if value not in allowed:
        named = ", ".join(name for name in allowed if name is not None)
        raise InputError(f"{label}: {show(value)}; allowed: {named}")
    return value


def two_sizes(sizes: ArrayLike) -> tuple[float, float]:
    """Return expected sizes of offsets: of the reach, and rad; ArrayError if they are none."""
    return two_divisors("sizes", sizes, "of the reach and rad")
