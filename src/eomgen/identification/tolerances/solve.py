"""From a table of tolerances to the accuracy of a tool at poses.

table -> Contribution -> Exact -> sensitivities -> covariance, regions, worst cases, shares -> ToleranceResult
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...arrays import Array, Mask
from ...description import RobotLike, as_robot
from ...description.recorded import robot_from_record
from ...errors import ArrayError, InputError, UnknownNameError
from ...limits import LARGEST, is_usable
from ...motion.files import MeasuredMotion, measured_motion
from ...motion.measured_numbers import ALLOWED, answers_in_numbers, within_limits
from ...names import component_name, joint_of, kind_of, listed, nearest_or_all, show
from ...progress import StageReport, no_report, tells_at_prompt
from ...results.contents import Contents
from ...results.kinds import Kind, declare
from ...robot.model import Model, build_model, tool_of
from ...robot.record import record_of
from ...robot.value import COORDINATES, MOTOR, Robot
from ..geometry.error_model import Rows
from ..geometry.loop_constraints import closed_readings, closing_of
from ..geometry.stations import Chain, chain_of, matrix_of
from .bending import BendingExact, bending_exact, contributions_of_bending, refused_of_bending
from .contributions import Contribution, Exact, contributions_of, model_of
from .correlations import groups_of, plain_correlations, read_correlations, root_of
from .regions import mixed_quantiles, quantile_of_normal, radii, worst_deviations, worst_directions
from .result import PARTS, ToleranceResult, check_whole, shares_of
from .table import CORRELATIONS, Table, Tolerance, read_table
from .vertices import farthest

ALONG = 200  # samples of a motion, at most
MOST_POSES = 10_000
COVERAGE = 3.0  # standard deviations that a worst case goes up to without a bound
LINEAR = 0.01  # of the worst case: what a linear prediction may be off without a warning
VERTICES = 8  # contributors whose 2^8 vertices are looked at
EVEN = 0.3  # of a variance: one uniform distribution that a sum is no longer normal with
_LINE = 1e-12  # of the greatest variance: no motion across
_EVERY = 20  # poses at which the linear prediction is compared
_SOFTEST = 0.2  # of a stiffness: its greatest standard deviation


@answers_in_numbers("table")
@tells_at_prompt("looking at tolerances")
def tolerance(  # noqa: PLR0913
    robot: RobotLike,
    table: Mapping[str, Any] | Path | str,
    frame: str | None = None,
    *,
    poses: ArrayLike | Mapping[str, float] | None = None,
    random: int = 0,
    along: MeasuredMotion | Path | str | None = None,
    seed: int = 0,
    wrench: ArrayLike | None = None,
    confidence: float = 0.95,
    progress: StageReport | None = None,
) -> ToleranceResult:
    """Return accuracy of a frame by the tolerances of offsets, placements, lengths, stiffness, clearances and drives.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        table: path of a .toml file, or a mapping of the same form, {"joints.joint2.offset.z": {"bound": 1e-4}}:
            "deviation" (normal) or "bound" (uniformly distributed within it), optionally "relative", "cost" and
            "fixed"; and optionally "correlations", [{"names": [...], "coefficient": 0.6}, {"names": [...],
            "matrix": [[...]]}] of normal ones.
        frame: frame or link to look at; by default the tool.
        poses: values of the moving joints' coordinates, (k,) or (N, k), m and rad, or values by name, others at home;
            by default home.  Of a mechanism with loops those of the drives.
        random: number of poses within the joints' limits instead; a joint without limits that turns goes all around.
        along: a motion instead, or its path: a .csv or .npz, such as that of a simulation; up to 200 samples of it.
        seed: of the random poses.
        wrench: force (N) and moment (N m) on the frame, (6,), base frame; beside gravity.
        confidence: probability of regions.
        progress: called with a line of text when a stage begins.

    Raises:
        DescriptionError: the table names what is not there, or a value cannot be used.
        InputError: another argument cannot be used, or a mechanism does not close.
        UnknownNameError: there is no frame or coordinate of a name.
    """
    robot, report = _without_followers(as_robot(robot)), progress or no_report
    frame = tool_of(robot, frame)
    if not (is_usable(confidence) and 0.0 < confidence < 1.0):
        raise InputError(f"confidence: {show(confidence)}; allowed: a number between 0 and 1")
    if isinstance(random, bool) or not isinstance(random, (int, np.integer)):
        raise InputError(f"random: {show(random)}; allowed: a whole number of poses")
    if sum((poses is not None, bool(random), along is not None)) > 1:
        raise InputError("poses, random and along: more than one of them; allowed: one")
    report("reading tolerances")
    model = build_model(robot)
    names = _coordinates(robot, model)
    t = None
    if random:
        q = _random_poses(robot, names, random, seed)
    elif along is not None:
        t, q = _motion(model, names, along)
    else:
        q = _checked_poses(model, names, poses)
    exact, known = _known(robot, model, frame, names, q, wrench, report)
    read = read_table(table, tuple(known), refused_of_bending(robot))
    chosen = tuple(known[entry.name] for entry in read.entries)
    exact = replace(exact, contributions=chosen)
    entries = [_sized(read, entry, one) for entry, one in zip(read.entries, chosen, strict=True)]
    result = _result(exact, frame, names, q, entries, read_correlations(read), confidence, report)
    return result if t is None else replace(result, t=t)


def tolerance_quantities(robot: RobotLike, frame: str | None = None) -> dict[str, str]:
    """Return the units of all quantities that a table may name, by name; arguments as of ``tolerance``."""
    robot = _without_followers(as_robot(robot))
    model = build_model(robot)
    names = _coordinates(robot, model)
    q = _checked_poses(model, names, None)
    _, contributions = _known(robot, model, tool_of(robot, frame), names, q, None, no_report)
    return {name: known.unit for name, known in contributions.items()}


def _known(
    robot: Robot,
    model: Model,
    frame: str,
    names: tuple[str, ...],
    q: Array,
    wrench: ArrayLike | None,
    report: StageReport,
) -> tuple[Exact | BendingExact, dict[str, Contribution]]:
    """Return the exact model at the poses, without contributions, and all that a table may name."""
    if any(link.modes is not None for link in robot.links):
        load = None if wrench is None else _wrench(wrench)
        bent = bending_exact(robot, frame, (names, q), load, report)
        return bent, contributions_of_bending(bent)
    exact = _exact(robot, model, frame, names, q, wrench)
    return exact, contributions_of(exact.model)


def _without_followers(robot: Robot) -> Robot:
    """Return the robot with its rigid couplings as constraints, but where links bend, whose nodes are followers."""
    return robot if any(link.modes is not None for link in robot.links) else robot.with_constraints()


def _coordinates(robot: Robot, model: Model) -> tuple[str, ...]:
    """Return names of the coordinates that say where a robot is.

    Of a tree those of all moving joints, else of all drives.
    """
    if not robot.is_closed:
        return tuple(
            component_name(joint.name, joint.principal)
            for joint in robot.joints
            if joint.coordinates and joint.principal
        )
    driven = [model.coordinates[i] for i in (*model.driven, *model.prescribed)]
    return tuple(_of_joint(robot, name) for name in driven)


def _of_joint(robot: Robot, name: str) -> str:
    """Return the coordinate of the joint that a motor turns."""
    if kind_of(name) != MOTOR:
        return name
    return component_name(joint_of(name), robot.joint(joint_of(name)).principal)


def _checked_poses(model: Model, names: Sequence[str], poses: ArrayLike | Mapping[str, float] | None) -> Array:
    home = dict(zip(model.coordinates, model.home, strict=True))
    start = np.array([float(home.get(name, 0.0)) for name in names])
    if poses is None:
        return start[np.newaxis]
    if isinstance(poses, Mapping):
        for name, value in poses.items():
            if name not in names:
                raise UnknownNameError(f"poses: there is no coordinate {show(name)}{nearest_or_all(str(name), names)}")
            if not isinstance(value, (int, float)) or not abs(value) <= LARGEST:
                raise InputError(f"poses: {name}: {show(value)}; allowed: {ALLOWED}")
            start[names.index(name)] = float(value)
        return start[np.newaxis]
    try:
        states = np.asarray(poses, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ArrayError(f"poses: {show(poses)}; allowed: numbers") from None
    shape = f"({len(names)},) or (N, {len(names)})"
    is_shaped = states.ndim in (1, 2) and states.shape[-1] == len(names) and states.size > 0
    if not is_shaped or not within_limits(states).all():
        what = f"finite numbers of shape {shape}, up to {LARGEST:g}: {listed(names)}"
        raise ArrayError(f"poses: got shape {states.shape}; allowed: {what}")
    states = states.reshape(-1, len(names))
    if len(states) > MOST_POSES:
        raise ArrayError(f"poses: {len(states)} rows; allowed: up to {MOST_POSES}")
    return states


def _random_poses(robot: Robot, names: Sequence[str], count: int, seed: int) -> Array:
    check_whole("random", count, 1, MOST_POSES)
    check_whole("seed", seed, 0, 2**63)
    limits = []
    for name in names:
        ends = robot.joint(joint_of(name)).limits
        if ends is None and kind_of(name) in COORDINATES[:3]:
            raise InputError(f"random: {name} has no limits; allowed: limits of all joints that slide")
        limits.append(ends or (-np.pi, np.pi))
    low_ends, high_ends = np.array(limits, dtype=np.float64).reshape(-1, 2).T
    return np.random.default_rng(seed).uniform(low_ends, high_ends, (count, len(names)))


def _motion(model: Model, names: Sequence[str], along: MeasuredMotion | Path | str) -> tuple[Array, Array]:
    motion = measured_motion(model.robot, along, model.coordinates)
    missing = [name for name in names if name not in motion.measured]
    if missing:
        raise InputError(f"along: {motion.source}: {missing[0]} is missing; allowed: all of {listed(names)}")
    q = motion.q[:, [motion.coordinates.index(name) for name in names]]
    chosen = np.unique(np.linspace(0, len(q) - 1, min(len(q), ALONG)).round().astype(np.intp))
    return np.asarray(motion.t[chosen]), np.asarray(q[chosen])


def _exact(robot: Robot, model: Model, frame: str, names: Sequence[str], q: Array, wrench: ArrayLike | None) -> Exact:
    """Return the exact model at the poses, without contributions."""
    frames = {one.name: (one.link, matrix_of(one.placement)) for one in robot.frames}
    chain = chain_of(robot, {frame: frames.get(frame, (frame, np.eye(4)))})
    places = _places(chain, names)
    readings = np.zeros((len(q), len(chain.stations), 6))
    for (k, c), values in zip(places, q.T, strict=True):
        readings[:, k, c] = values
    closing = None
    if robot.is_closed:
        closing = closing_of(model, chain, places, "poses")
        readings = closed_readings(chain, closing, model, readings, [f"poses: row {row}" for row in range(len(q))])
    tool = chain.tools[frame]
    loads = {} if wrench is None else {tool: np.tile(_wrench(wrench), (len(q), 1))}
    rows = Rows(readings, np.zeros(len(q), dtype=np.int64), loads, np.zeros(readings.shape[:2]), None)
    return Exact(model_of(robot, chain, closing), rows, tool, ())


def _places(chain: Chain, names: Sequence[str]) -> list[tuple[int, int]]:
    station = {s.name: k for k, s in enumerate(chain.stations) if s.joint is not None}
    return [(station[joint_of(name)], COORDINATES.index(kind_of(name))) for name in names]


def _wrench(requested: ArrayLike) -> Array:
    try:
        wrench = np.asarray(requested, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        wrench = np.zeros(0)
    if wrench.shape != (6,) or not within_limits(wrench).all():
        raise ArrayError(f"wrench: {show(str(requested))}; allowed: 6 finite numbers up to {LARGEST:g}, N and N m")
    return wrench


def _sized(table: Table, entry: Tolerance, one: Contribution) -> tuple[Tolerance, float, float]:
    """Return the entry, its standard deviation and its bound, in the parameter's unit."""
    scale = 1.0
    if entry.relative:
        if not one.described:
            raise table.refusal(entry.name, "is relative, but nothing is described; allowed: a size")
        scale = abs(one.described)
    if entry.bound is not None:
        deviation, bound = scale * entry.bound / np.sqrt(3.0), scale * entry.bound
    else:
        deviation = scale * (entry.deviation or 0.0)
        bound = COVERAGE * deviation
    if one.is_stiffness and one.described is not None:
        most = one.described if entry.bound is not None else _SOFTEST * one.described
        if not (bound if entry.bound is not None else deviation) < most:
            got = bound if entry.bound is not None else deviation
            raise table.refusal(entry.name, f"{got:g} {one.unit}; allowed: below {most:g}, or the stiffness may vanish")
    return entry, deviation, bound


def _result(
    exact: Exact | BendingExact,
    frame: str,
    names: tuple[str, ...],
    q: Array,
    entries: Sequence[tuple[Tolerance, float, float]],
    correlation: Array,
    confidence: float,
    report: StageReport,
) -> ToleranceResult:
    deviations, bounds = (np.array([entry[i] for entry in entries]) for i in (1, 2))
    report("looking at sensitivities")
    S = exact.sensitivities(bounds)
    scaled, reach = S * deviations, S * bounds
    correlated = groups_of(correlation)
    apart = scaled @ root_of(correlation) if correlated else scaled  # by independent numbers of variance 1
    covariance = apart @ apart.transpose(0, 2, 1)
    report("looking for worst cases")
    ends = {name: [farthest(row[at]) for row in reach] for name, at in PARTS.items()}
    lengths = {name: np.array([length for length, _ in vertices]) for name, vertices in ends.items()}
    worst_pose = int(lengths["position"].argmax())
    signs = ends["position"][worst_pose][1]
    report("comparing with the exact model")
    exact_worst = _at_vertices(exact, reach[worst_pose, :3], bounds, signs, worst_pose)
    off, bent = _nonlinear(exact, S, bounds, ends, lengths)
    shares = {name: shares_of(scaled[:, at], correlation) for name, at in PARTS.items()}
    is_even = np.array([entry.bound is not None for entry, _, _ in entries])
    regions = {
        name: _regions(covariance[:, at, at], apart[:, at], reach[:, at], is_even, lengths[name], confidence)
        for name, at in PARTS.items()
    }
    notes = []
    if off > LINEAR:
        which = f", most of all {listed(bent)}" if bent else ""
        notes.append(
            f"not linear: the exact model is off the linear one by {100 * off:.2g} % of the worst case{which};"
            " draw samples of the exact model instead (ToleranceResult.sample)"
        )
    if correlated:
        notes.append(
            f"{sum(map(len, correlated))} of {len(entries)} tolerances are correlated: worst cases go up to the bounds"
            " of each, as if they were not"
        )
    notes += _of_bounds(entries, shares)
    for name, (_, _, ended) in regions.items():
        if ended:
            notes.append(
                f"{name}: at {ended} of {len(q)} poses the region of normal numbers passes what bounds allow, and ends"
                " there"
            )
    if max(float(x.max()) for x in lengths.values()) == 0.0:
        notes.append(f"nothing in the table moves {frame}")
    chosen = exact.contributions
    return ToleranceResult(
        robot=exact.robot.name,
        frame=frame,
        coordinates=names,
        q=q,
        names=tuple(one.name for one in chosen),
        units=tuple(one.unit for one in chosen),
        described=np.array([np.nan if one.described is None else one.described for one in chosen]),
        deviations=deviations,
        bounds=bounds,
        correlation=correlation,
        sensitivities=S,
        covariance=covariance,
        confidence=float(confidence),
        radius={name: radius for name, (_, radius, _) in regions.items()},
        direction={name: least for name, (least, _, _) in regions.items()},
        worst=np.abs(reach).sum(axis=2),
        farthest=lengths,
        worst_pose=worst_pose,
        exact_worst=exact_worst,
        shares=shares,
        nonlinearity=off,
        notes=tuple(notes),
        exact=exact,
        tolerances=tuple(entry[0] for entry in entries),
    )


def _regions(
    covariance: Array, scaled: Array, reach: Array, is_even: Mask, farthest_of_all: Array, confidence: float
) -> tuple[Array, Array, int]:
    """Return half intervals along the directions of greatest displacement or rotation, radii of regions, (N,) each.

    Radii are those of normal numbers between two bounds that hold for every distribution: no sphere is smaller than the
    interval along one direction, and none need be larger than the farthest that uniform numbers reach with the sphere
    of the normal ones around it.  Where all motion is along one line the interval is the sphere.

    Args:
        covariance: of displacement or rotation, (N, 3, 3).
        scaled, reach: sensitivities times standard deviations, correlated ones by independent numbers, and times
            bounds, (N, 3, K).
        is_even: which parameters are uniformly distributed within their bounds, (K,); the others are normal.
        farthest_of_all: greatest displacements with all at their bounds, (N,).
        confidence: probability of intervals and regions.

    Returns:
        also at how many poses regions end at what bounds allow.
    """
    sphere = radii(covariance, confidence)
    if not is_even.any():
        return np.asarray(quantile_of_normal(confidence) * worst_deviations(covariance)), sphere, 0
    normal, even = scaled[..., ~is_even], reach[..., is_even]
    along = worst_directions(covariance)[:, np.newaxis]
    least = mixed_quantiles(np.linalg.norm((along @ normal)[:, 0], axis=1), (along @ even)[:, 0], confidence)
    most = farthest_of_all
    if not is_even.all():
        within = np.array([farthest(row)[0] for row in even])
        most = within + radii(normal @ normal.transpose(0, 2, 1), confidence)
    variances = np.linalg.eigvalsh(covariance)
    on_a_line = variances[:, 1] <= _LINE * variances[:, 2]
    ended = (sphere > most * (1.0 + 1e-12)) & ~on_a_line
    return least, np.where(on_a_line, least, np.minimum(np.maximum(sphere, least), most)), int(ended.sum())


def _of_bounds(entries: Sequence[tuple[Tolerance, float, float]], shares: Mapping[str, Array]) -> Iterator[str]:
    """Yield a note where one uniform distribution makes so much that sums are not normal."""
    is_even = np.array([entry.bound is not None for entry, _, _ in entries])
    for kind in PARTS:
        k = int(np.where(is_even, shares[kind], -1.0).argmax())  # no share of a uniform one is negative
        share, entry = float(shares[kind][k]), entries[k][0]
        if is_even[k] and share > EVEN:
            yield (
                f"{kind}: {entry.name}, uniform within its bound, makes {100 * share:.3g} % of the variance; spheres"
                " are those of normal numbers, as far as bounds allow; intervals along a direction are exact"
            )


def _at_vertices(exact: Exact | BendingExact, reach: Array, bounds: Array, signs: Array, pose: int) -> float:
    """Return the greatest displacement by the exact model, m, at all vertices of the main contributors."""
    main = np.argsort(-np.linalg.norm(reach, axis=0), kind="stable")[:VERTICES]
    corners = np.array(list(product((1.0, -1.0), repeat=len(main)))).T
    farthest = 0.0
    for others in (signs, -signs):
        y = np.repeat((others * bounds)[:, np.newaxis], corners.shape[1], axis=1)
        y[main] = corners * bounds[main, np.newaxis]
        motions = exact.motions(y, np.full(corners.shape[1], pose, dtype=np.intp))
        farthest = max(farthest, float(np.linalg.norm(motions[:, :3], axis=1).max()))
    return farthest


def _nonlinear(
    exact: Exact | BendingExact,
    S: Array,
    bounds: Array,
    ends: Mapping[str, Sequence[tuple[float, Array]]],
    lengths: Mapping[str, Array],
) -> tuple[float, list[str]]:
    """Return the greatest error of the linear model as a share of the worst case, and single causes above LINEAR.

    At both bounds of every contribution by itself, and of all at the worst vertices of position and turn.
    """
    count = len(bounds)
    poses = np.unique(np.linspace(0, len(S) - 1, min(len(S), _EVERY)).round().astype(np.intp))
    poses = np.union1d(poses, [int(lengths["position"].argmax())])
    greatest, causes = 0.0, np.zeros(count)
    for pose in poses.tolist():
        vertices = [ends[kind][pose][1] for kind in PARTS]
        y = np.hstack(
            [np.diag(bounds), -np.diag(bounds), *((s * bounds)[:, np.newaxis] for v in vertices for s in (v, -v))]
        )
        left = exact.motions(y, np.full(y.shape[1], pose, dtype=np.intp)) - (S[pose] @ y).T
        for kind, at in PARTS.items():
            whole = float(lengths[kind].max())
            if whole > 0.0:
                off = np.linalg.norm(left[:, at], axis=1) / whole
                greatest = max(greatest, float(off.max()))
                causes = np.maximum(causes, np.maximum(off[:count], off[count : 2 * count]))
    order = [k for k in np.argsort(-causes, kind="stable") if causes[k] > LINEAR]
    return greatest, [exact.contributions[k].name for k in order[:3]]


def _record(result: ToleranceResult) -> dict[str, Any]:
    """Return what was asked, from which everything else follows."""
    return {
        "description": record_of(result.exact.robot),
        "table": {entry.name: entry.as_table() for entry in result.tolerances},
        CORRELATIONS: plain_correlations(result.names, result.correlation),
        "frame": result.frame,
        "q": result.q,
        "t": result.t,
        "wrench": result.exact.wrench,
        "confidence": result.confidence,
    }


_ASKED: Mapping[str, Any] = {
    "table": Mapping[str, Mapping[str, Any]],
    "frame": str,
    "q": tuple[tuple[float, ...], ...],
    "wrench": tuple[float, ...] | None,
    "confidence": float,
    "t": tuple[float, ...] | None,
}


def _read(file: Contents) -> ToleranceResult:
    asked = {name: file.value(kind, name) for name, kind in _ASKED.items()}
    related: Any = ()  # files from before there were correlations have none
    if CORRELATIONS in file.plain:
        related = file.value(tuple[Mapping[str, Any], ...], CORRELATIONS)
    result = tolerance(
        robot_from_record(file.plain.get("description", {}), file.path),
        {**asked["table"], CORRELATIONS: related},
        asked["frame"],
        poses=np.array(asked["q"], dtype=np.float64),
        wrench=asked["wrench"],
        confidence=asked["confidence"],
    )
    if asked["t"] is None:
        return result
    t = np.array(asked["t"], dtype=np.float64)
    if t.shape != (len(result.q),) or not np.isfinite(t).all():
        raise ValueError(f"t of shape {t.shape}")
    return replace(result, t=t)


load_tolerance = declare(
    Kind(
        "tolerance",
        ToleranceResult,
        ending=".json",
        what="accuracy by tolerances",
        rebuilt=tuple(field.name for field in fields(ToleranceResult)),
        record=_record,
        read=_read,
        is_finite=False,
    )
)
"""Read the result that ``ToleranceResult.save`` wrote, computed anew; InputError says what in the file is wrong."""
