"""Poses to measure, from the robot to the chosen ones.

ranges, places -> candidates -> Information -> bound, exchange -> PosesResult
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ...arrays import Array, Index
from ...description import RobotLike, as_robot
from ...errors import InputError, UnknownNameError
from ...motion.exceeding import excess_notes, excesses
from ...names import nearest_or_all, show
from ...progress import StageReport, no_report, tells_at_prompt
from ...robot.model import build_model, tool_of
from ..calibration.identifiability import Identifiable, identifiable
from ..calibration.result import CalibrationResult, load_calibration
from ..calibration.solve import Task, links_of, problem_of, two_sizes
from ..estimating import SOLVED
from ..geometry.error_model import SIZES
from ..geometry.observations import ORIENTATION, at_rows, usual_noise
from ..geometry.poses import MeasuredPoses, read_poses
from ..geometry.solve import Fit, Problem, algebraic_rank, normed_triangle
from ..geometry.stations import Chain, chain_of, check_rigid
from .continuous import CLOSE, bound_of
from .exchange import chosen_by
from .information import CRITERIA, Information, PoseCriterion, criterion_of, inverse
from .proposals import DISTANCE, MEASURES, WIDTHS, Measure, joined, proposed
from .result import PosesResult
from .sampling import Where, boxes_from, ranges_of, sampled, where_from

NOISE = (5e-5, 1e-4)  # m and rad: a good tracker
CANDIDATES = 1000
MOST = 20_000  # candidates
_WORKSPACE = 500  # poses that stand for it


@dataclass(frozen=True)
class _Offer:
    """Candidates: all rows, measured ones first, candidates, then the workspace; the problem; their information.

    V: directions that show, (p, P) in expected sizes.
    """

    poses: MeasuredPoses
    problem: Problem
    information: Information
    V: Array
    first: int


@tells_at_prompt("choosing poses")
def poses(  # noqa: PLR0913
    robot: RobotLike,
    *,
    count: int = 30,
    frame: str | Sequence[str] | None = None,
    measure: Measure = "pose",
    frames: Mapping[str, str] | None = None,
    ranges: Mapping[str, Sequence[float]] | None = None,
    boxes: ArrayLike | None = None,
    reach: Sequence[float] | None = None,
    device: ArrayLike | None = None,
    angle: float | None = None,
    axis: str = "z",
    criterion: PoseCriterion = "D",
    workspace: ArrayLike | None = None,
    after: MeasuredPoses | Path | str | None = None,
    rotation: str = "rotvector",
    fit: CalibrationResult | Path | str | None = None,
    noise: ArrayLike | None = None,
    fixed: Iterable[str] = (),
    stiffness: Iterable[str] = (),
    sizes: Sequence[float] = SIZES,
    candidates: int = CANDIDATES,
    seed: int = 0,
    progress: StageReport | None = None,
) -> PosesResult:
    """Return poses to measure, so that ``calibrate`` finds as much as it can from them.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        count: poses to choose, each another one.
        frame: what is measured, a frame, a link, or several; by default "tcp" or the end of the robot.
        measure: "pose", "position" or "distance" (from the device) of these frames.
        frames: link of frames that the description does not have, {"probe": "link6"}.
        ranges: ends of coordinates, by name, in place of the joints' limits, m or rad.
        boxes: lower and upper corner, (2, 3) or (B, 2, 3), m: one of them holds every frame; base frame.
        reach: least and greatest distance of the frames from the base's origin, m.
        device: place of the measuring device, (3,), m, base frame.
        angle: between the frames' axis and the direction to the device at most, rad.
        axis: that axis, "x", "y", "z", "-x", "-y" or "-z".
        criterion: "D", the determinant of the information, or "V", the expected error of the tool over the workspace.
        workspace: boxes where the tool's error counts, as ``boxes``; by default wherever the ranges lead.
        after: poses that were measured already, from ``read_poses``, or the path of a file; they count.
        rotation: how that file writes orientations: "rotvector", "rpy" or "quaternion".
        fit: a first calibration, or its file: its noise is taken.
        noise: standard deviations of lengths (m) and rotations (rad); those of ``fit``, or 0.05 mm and 0.1 mrad.
        fixed, stiffness, sizes: which parameters there are, as ``calibrate`` takes them.
        candidates: poses to choose from.
        seed: of their random numbers; the same seed, the same poses.
        progress: called with a line of text when a stage begins.

    Raises:
        InputError: an option cannot be used, no pose is where it has to be, or the poses are too few.
        UnknownNameError: there is no frame, link, parameter or coordinate of a name.
    """
    robot, report = as_robot(robot), progress or no_report
    check_rigid(robot)
    if robot.loops or robot.couplings:
        raise InputError(f"poses: {robot.name} has loops or couplings; allowed: robots that are trees")
    for label, value, allowed in (("criterion", criterion, CRITERIA), ("measure", measure, MEASURES)):
        if value not in allowed:
            raise InputError(f"{label}: {show(value)}; allowed: {', '.join(allowed)}")
    _whole("seed", seed, 0)
    _whole("count", count, 1)
    _whole("candidates", candidates, count, MOST)
    deviations = usual_noise(noise if noise is not None else _noise_of(fit))
    task = Task(
        robot=robot,
        links=links_of(robot, frames or {}),
        known=dict.fromkeys(build_model(robot).frames, True) | dict.fromkeys(frames or {}, False),
        noise=deviations,
        covariance={},
        loss=None,
        fixed=tuple(fixed),
        stiffness=tuple(stiffness),
        sizes=two_sizes(sizes),
    )
    chosen_frames = _frames(task, frame, frames or {})
    chain = chain_of(robot, {name: task.links[name] for name in chosen_frames})
    span = ranges_of(robot, chain, ranges or {})
    where = where_from(boxes, reach, device, angle, axis)
    report("drawing candidates")
    rng = np.random.default_rng(seed)
    q = sampled(chain, span, where, candidates, count, rng, "")
    inside = Where(boxes=boxes_from("workspace", workspace))
    of_tool = sampled(chain, span, inside, _WORKSPACE, 1, rng, "workspace")
    before = _measured(task, after, rotation)
    base, series = _base(task, before, where, measure)
    more = proposed(chain, span, np.vstack([q, of_tool]), base, series, measure, deviations)
    report("evaluating their information")
    offer = _offer(task, before, more, len(q), chain, deviations)
    _refuse_too_few(offer, count, WIDTHS[measure] * len(chosen_frames))
    information, judge = offer.information, criterion_of(criterion, offer.information)
    report("finding the bound")
    possible, gap = bound_of(information, judge, count)
    report("choosing")
    chosen, is_best = chosen_by(information, judge, count, possible, rng)
    times = np.bincount(chosen, minlength=len(q)).astype(np.float64)
    A = information.total(times)
    shown = _shown(task, offer, chosen)
    scales = offer.problem.model.sizes[offer.problem.active]
    covariance = inverse(A)
    parameters = [offer.problem.model.parameters[i] for i in offer.problem.active]
    notes = [f"{len(q)} candidates satisfy all limits of places"] if len(q) < candidates else []
    open_ones = [f"the bound is known to {gap:.1g} alone"] if gap > CLOSE else []
    open_ones += [] if is_best else ["further exchanges of poses would be better"]
    notes += excess_notes("the choice of poses", excesses(robot, span.names, q=q[chosen]))
    return PosesResult(
        robot=robot.name,
        coordinates=span.names,
        q=q[chosen],
        frames=chosen_frames,
        measure=measure,
        series=series,
        criterion=criterion,
        efficiency=judge.efficiency(judge.value(A), possible, information.size),
        gap=gap,
        value=judge.value(A),
        bound=possible,
        size=information.size,
        rank=shown.rank,
        rank_above_noise=shown.rank_above_noise,
        names=tuple(parameter.name for parameter in parameters),
        deviations=scales * np.sqrt(np.einsum("pi,pq,qi->i", offer.V, covariance, offer.V)),
        units=tuple(parameter.unit for parameter in parameters),
        merged=shown.merged,
        weak=shown.weak,
        error=information.error(covariance),
        error_before=information.error(inverse(information.start)),
        measured=offer.first,
        candidates=len(q),
        noise=deviations,
        seed=seed,
        notes=tuple(notes),
        status="; ".join(open_ones) or SOLVED,
    )


def _frames(task: Task, frame: str | Sequence[str] | None, attached: Mapping[str, str]) -> tuple[str, ...]:
    """Return names of the frames to measure; by default the attached ones, or the robot's tool."""
    if frame is None:
        return tuple(attached) or (tool_of(task.robot, None),)
    names = (frame,) if isinstance(frame, str) else tuple(frame)
    for name in names:
        if name not in task.links:
            raise UnknownNameError(f"frame: there is no frame {name!r}{nearest_or_all(name, task.links)}")
    if not names or len(set(names)) < len(names):
        raise InputError(f"frame: {show(names)}; allowed: names, each once")
    return names


def _noise_of(fit: CalibrationResult | Path | str | None) -> tuple[float, float]:
    """Return the largest noise of lengths and of rotations of a calibration, estimated or stated."""
    if fit is None:
        return NOISE
    calibration = fit if isinstance(fit, CalibrationResult) else load_calibration(fit)
    turns = [value for name, value in calibration.noise.items() if name.endswith(ORIENTATION)]
    lengths = [value for name, value in calibration.noise.items() if not name.endswith(ORIENTATION)]
    return max(lengths, default=NOISE[0]), max(turns, default=NOISE[1])


def _measured(task: Task, after: MeasuredPoses | Path | str | None, rotation: str) -> MeasuredPoses | None:
    if after is None or isinstance(after, MeasuredPoses):
        return after
    columns, principal = build_model(task.robot).coordinates, task.robot.principal_coordinates
    return read_poses(after, columns, tuple(task.links), rotation=rotation, principal=principal)


def _base(task: Task, before: MeasuredPoses | None, where: Where, measure: str) -> tuple[Array, int]:
    """Return the pose of the base before the device, (4, 4), and the series that further poses belong to.

    It is the last one that was measured, or the first where nothing was.
    """
    if before is not None:
        series = int(before.series[-1])
        return problem_of(task, before, careful=False)[0].model.bases[series], series
    if measure == DISTANCE and where.device is None:
        raise InputError("measure: 'distance' without a device; allowed: with device")
    base = np.eye(4)
    if where.device is not None:
        base[:3, 3] = -where.device
    return base, 0


def _offer(
    task: Task, before: MeasuredPoses | None, more: MeasuredPoses, many: int, chain: Chain, noise: tuple[float, float]
) -> _Offer:
    """Return information of the first ``many`` of the proposed rows; the others stand for the workspace."""
    first = 0 if before is None else len(before.q)
    whole = more if before is None else joined(before, more, noise)
    problem, x = problem_of(task, whole, careful=False)
    model, seen = problem.model, problem.seen
    scaled = at_rows(model, problem.rows, seen, x)[1][:, problem.active] * model.sizes[problem.active]
    S = seen.whiten(scaled, seen.sigma)
    shown = S[seen.row < first + many]
    V = _shown_directions(shown)
    order = np.argsort(seen.row, kind="stable")
    start = int(np.searchsorted(seen.row[order], first))
    numbers = (len(order) - start) // len(more.q)
    Y = (S[order[start : start + many * numbers]] @ V.T).reshape(many, numbers, -1)
    old = S[order[:start]] @ V.T
    state = model.at(x, problem.rows.part(np.arange(first + many, len(whole.q))))
    parts = [
        (state.sensitivities(model.chain.tools[name])[:, :3, problem.active] * model.sizes[problem.active]) @ V.T
        for name in chain.tools
    ]
    T = np.concatenate(parts).reshape(-1, len(V))
    rows = len(T) // 3
    information = Information(np.eye(len(V)) + old.T @ old, Y, T.T @ T / rows)
    return _Offer(whole, problem, information, V, first)


def _shown_directions(S: Array) -> Array:
    """Return directions that sensitivities show at all, (p, P), whatever their noise."""
    R, norms = normed_triangle(S)
    return np.asarray(np.linalg.svd(R * norms)[2][: algebraic_rank(S)])


def _refuse_too_few(offer: _Offer, count: int, numbers: int) -> None:
    """Raise InputError where the chosen poses and those before cannot show what the candidates can."""
    seen, size = offer.problem.seen, offer.information.size
    known = int((seen.row < offer.first).sum())
    if known + count * numbers < size:
        least = int(np.ceil((size - known) / numbers))
        raise InputError(
            f"count: {count} poses with {numbers} numbers each for {size} combinations that are identifiable; allowed:"
            f" {least} poses or more, or fewer parameters (fixed)"
        )


def _shown(task: Task, offer: _Offer, chosen: Index) -> Identifiable:
    """Return identifiability, ranks and poorly observable directions of the chosen poses with those before."""
    kept = np.concatenate([np.arange(offer.first), offer.first + chosen])
    problem, x = problem_of(task, offer.poses.part(kept), careful=False)
    none = np.zeros(problem.seen.group.size)
    covariance = np.zeros((len(x), len(x)))
    return identifiable(problem, Fit(x, problem.seen.sigma, none + 1.0, none, covariance, 0.0, 0.0, 0.0, none))


def _whole(label: str, value: int, least: int, most: int | None = None) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < least or (most is not None and value > most):
        span = f"from {least} on" if most is None else f"{least} to {most}"
        raise InputError(f"{label}: {show(value)}; allowed: a whole number {span}")
