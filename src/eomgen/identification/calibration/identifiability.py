"""Identifiability from measured poses: ranks, linearly dependent parameters and why, directions lost in noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ..geometry.error_model import COMPLIANCE, PLACEMENT, ErrorModel, ErrorParameter, Rows
from ..geometry.observations import ORIENTATION, Block, Observations, at_rows
from ..geometry.solve import HIDDEN, Fit, Problem, algebraic_rank, normed_triangle, whitened
from ..geometry.stations import Chain, located
from .variants import only_fitted

GENERIC = 80  # random rows that show what a kind of measurement can show at all
_DEPENDENT = 1e-8  # of a normed column: what is left of it beside those before it
_PART = 1e-5  # of the greatest coefficient: what counts as dependent
_NAMED = 3  # parameters of a poorly observable direction, or that one depends on
_NO_LOAD, _UNSEEN = "no load of these poses acts on it", "it moves nothing that was measured"
_TURNS = "moving them together turns the residuals, and makes none larger"
_SHARE = 0.05  # of the largest part of an unseen direction: what is named
_ALONE = {_NO_LOAD: "no load of these poses acts on them", _UNSEEN: "they move nothing that was measured"}
_TURNED = 2.0  # times all residuals: what a turn of them by 1 rad, an expected size of bases, may show at most
_FLAT = 0.1  # of the second derivative of the linearised problem: a sum of squares with less does not see a direction
_LOOKED = 3  # times that directions are looked for which residuals do not show
_WORSE = 1e-2  # share that residuals may grow by where unseen directions stay as described
_SAME = 0.999  # least cosine of the angles between spans that are one
_STEP = 1e-4  # of an expected size
_ALONG = 1e-9  # m or rad: how far axes may be off to be parallel, or one


@dataclass(frozen=True)
class Identifiable:
    """Ranks, why parameters are not identifiable, poorly observable directions with standard deviations."""

    rank: int
    rank_above_noise: int
    merged: dict[str, str]
    weak: tuple[tuple[str, float], ...]


def identifiable(problem: Problem, fit: Fit) -> Identifiable:
    """Return ranks, linearly dependent parameters and poorly observable directions of a problem.

    Sensitivities are those of the described robot, noise is that of a fit.

    Axes that are parallel there need not be in the fit, by less than it can see.
    """
    model = problem.model
    r, A = at_rows(model, problem.rows, problem.seen, model.nominal)
    S = problem.projected(whitened(problem, fit, r, A)[1][:, problem.active])
    parameters = [model.parameters[i] for i in problem.active]
    rank = algebraic_rank(S)
    R, norms = normed_triangle(S)
    values, V = np.linalg.svd(R * norms)[1:]
    weak = tuple(_weak(parameters, V[k], float(values[k])) for k in range(rank) if values[k] <= 1.0)
    return Identifiable(rank, int((values[:rank] > 1.0).sum()), _unidentifiable(problem, parameters, S), weak)


def unseen_directions(problem: Problem, fit: Fit) -> Array:
    """Return directions in expected sizes, (k, P), along which a fit could move without larger residuals.

    A turn of all residuals, as about a line through all places that were measured, changes their components, and looks
    as if it showed in them; but it does not change the sum of squares.  Its second derivative is 0 then, where that of
    the linearised problem is not.
    """
    active, sizes = problem.active, problem.model.sizes[problem.active]

    def at(x: Array) -> tuple[Array, Array]:
        r, A = at_rows(problem.model, problem.rows, problem.seen, x)
        white, S = whitened(problem, fit, r, A)
        return white, S[:, active]

    white, S = at(fit.x)
    R, norms = normed_triangle(S)
    values, V = np.linalg.svd(R * norms)[1:]
    tried = np.flatnonzero((values > HIDDEN) & (values < _TURNED * np.linalg.norm(white)))
    slope, curvatures = S.T @ white, np.zeros((tried.size, tried.size))
    for column, k in enumerate(tried):
        x = fit.x.copy()
        x[active] += _STEP * V[k] * sizes
        new, T = at(x)
        curvatures[:, column] = V[tried] @ (slope - T.T @ new) / _STEP
    scale = values[tried]
    shares, vectors = np.linalg.eigh(0.5 * (curvatures + curvatures.T) / np.outer(scale, scale))
    directions = np.zeros((tried.size, len(problem.model.parameters)))
    directions[:, active] = (vectors / scale[:, np.newaxis]).T @ V[tried]
    flat = directions[shares < _FLAT]
    return np.asarray(flat / np.linalg.norm(flat, axis=1, keepdims=True))


def without_unseen(problem: Problem, start: Array, fit: Fit, loss: str | None) -> tuple[Problem, Fit]:
    """Return a problem without the directions that its residuals do not show, and its fit.

    These change with the values on a curve, so that they are looked for again.
    """
    for _ in range(_LOOKED):
        unseen = unseen_directions(problem, fit)
        if not len(unseen) or (problem.unseen is not None and _same_span(unseen, problem.unseen)):
            break
        tried = replace(problem, unseen=unseen)
        other = only_fitted(tried, start, loss)
        if not _size(tried, other.residuals, fit) <= (1.0 + _WORSE) * _size(problem, fit.residuals, fit):
            break  # they show after all
        problem, fit = tried, other
    return problem, fit


def _size(problem: Problem, residuals: Array, fit: Fit) -> float:
    """Return the length of residuals, (M,), whitened by the noise of a fit."""
    return float(np.linalg.norm(np.sqrt(fit.trust) * problem.seen.whiten(residuals, fit.sigma)))


def _same_span(one: Array, other: Array) -> bool:
    """Return whether directions, (k, P) each, span nearly the same."""
    if one.shape != other.shape:
        return False
    bases = (np.linalg.qr(directions.T)[0] for directions in (one, other))
    Q, P = bases
    return bool(np.linalg.svd(Q.T @ P, compute_uv=False).min() > _SAME)


def possible_rank(problem: Problem) -> int:
    """Rank that many random poses of the same kinds of measurements would have."""
    return algebraic_rank(generic_sensitivities(problem))


def generic_sensitivities(problem: Problem) -> Array:
    """Give sensitivities, (m, p), of the active parameters at random poses within limits, measured in the same way."""
    rng = np.random.default_rng(0)
    model, measured = problem.model, problem.rows
    chosen = rng.integers(len(measured.series), size=GENERIC)
    rows = measured.part(chosen)
    readings = rows.readings.copy()
    for k, station in enumerate(model.chain.stations):
        if station.principal is None or station.joint is None:
            continue
        turn = station.principal >= 3
        limits, wide = station.joint.limits, np.pi if turn else model.chain.reach
        low, high = limits if limits is not None and limits[0] < limits[1] else (-wide, wide)
        readings[:, k, station.principal] = rng.uniform(low, high, GENERIC)
    direction = rng.choice([-1.0, 1.0], size=rows.direction.shape)
    rows = Rows(readings, np.sort(rows.series), rows.loads, direction, rows.temperature)
    empty = np.zeros(0, dtype=np.intp)
    blocks = []
    for block in problem.seen.blocks:
        value = np.eye(3) if block.kind == ORIENTATION else np.zeros(3 if block.width == 3 else ())
        there = np.arange(1, GENERIC)
        blocks.append(Block(block.frame, block.kind, there, np.tile(value, (there.size, *(1,) * value.ndim))))
    seen = Observations(tuple(blocks), empty, empty, empty, np.zeros(0), np.zeros(0), ())
    return at_rows(model, rows, seen, model.nominal)[1][:, problem.active] * model.sizes[problem.active]


def refuse_too_few(problem: Problem, source: str) -> None:
    """Raise InputError where there are fewer numbers than parameters that such measurements can determine."""
    wanted, many = possible_rank(problem), problem.seen.group.size
    if many < wanted:
        rows = len(problem.rows.series)
        raise InputError(
            f"{source}: {rows} rows with {many} numbers for {wanted} unknowns: fewer poses than unknowns; allowed:"
            f" {int(np.ceil(rows * wanted / many))} rows or more, or fewer parameters (fixed)"
        )


def _weak(parameters: Sequence[ErrorParameter], direction: Array, value: float) -> tuple[str, float]:
    """Return a direction by its largest parts, and the standard deviation of the first of them along it."""
    largest = np.argsort(-np.abs(direction))
    first = largest[0]
    kept = [i for i in largest[:_NAMED] if abs(direction[i]) > 0.2 * abs(direction[first])]
    parts = [parameters[first].name]
    for i in kept[1:]:
        share = direction[i] * parameters[i].size / (direction[first] * parameters[first].size)
        parts.append(f"{share:+.2g} {parameters[i].name}")
    return " ".join(parts), float(parameters[first].size * abs(direction[first]) / max(value, 1e-300))


def _unidentifiable(problem: Problem, parameters: Sequence[ErrorParameter], S: Array) -> dict[str, str]:
    """Return why parameters are not identifiable: those that others do the work of, in the order of the names.

    Of every unseen direction the parameter that moves most in it is one of them.
    """
    leading = _leading(problem)
    order = [i for i in range(len(parameters)) if i not in leading] + list(leading)
    found = _dependent(S[:, order])
    named = {order[i]: [order[k] for k in others] for i, others in zip(*found, strict=True)}
    dependent, partners = sorted(named), [named[i] for i in sorted(named)]
    always = set(dependent)
    if dependent and problem.model.closing is None:  # random poses of a mechanism need not close
        always = set(_dependent(generic_sensitivities(problem))[0])
    texts = {}
    for i, others in zip(dependent, partners, strict=True):
        parameter = parameters[i]
        if i in leading:
            texts[parameter.name] = f"with {', '.join(parameters[k].name for k in leading[i])}: {_TURNS}"
            continue
        if not others:
            texts[parameter.name] = _NO_LOAD if parameter.kind == COMPLIANCE else _UNSEEN
            continue
        with_ = ", ".join(parameters[k].name for k in others[:_NAMED])
        more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
        why = _reason(problem.model, parameter, [parameters[k] for k in others])
        why = why if i in always else "linearly dependent at these poses"
        texts[parameter.name] = f"with {with_}{more}: {why}"
    return texts


def _leading(problem: Problem) -> dict[int, list[int]]:
    """Return the active parameter that moves most in each unseen direction, and those that move most with it."""
    if problem.unseen is None:
        return {}
    N, leading = problem.unseen[:, problem.active].copy(), dict[int, list[int]]()
    for _ in range(len(N)):
        row, column = np.unravel_index(int(np.abs(N).argmax()), N.shape)
        parts = np.abs(N[row])
        order = np.argsort(-parts)[1 : _NAMED + 1]
        leading[int(column)] = [int(k) for k in order if parts[k] > _SHARE * parts[column]]
        N = N - np.outer(N[:, column] / N[row, column], N[row])
        N[:, list(leading)] = 0.0
    return leading


def unidentifiable_rows(merged: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return parameters that are not identifiable with their reasons, in their order.

    Those that show nothing share one row.

    merged: reason by name, as in ``Identifiable``.
    """
    rows = [(name, why) for name, why in merged.items() if why not in _ALONE]
    for why, text in _ALONE.items():
        names = [name for name, reason in merged.items() if reason == why]
        if len(names) > 1:
            rows.append((f"{len(names)} parameters", f"{text} (their names: --json, as_dict)"))
        else:
            rows += [(name, why) for name in names]
    return rows


def _dependent(S: Array) -> tuple[list[int], list[list[int]]]:
    """Return columns that depend on those before them, and for each these, largest coefficient first."""
    R, norms = normed_triangle(S)
    kept, dependent, partners = list[int](), list[int](), list[list[int]]()
    basis = np.zeros((R.shape[0], 0))
    for i in range(R.shape[1]):
        left = R[:, i] - basis @ (basis.T @ R[:, i])
        left -= basis @ (basis.T @ left)
        size = float(np.linalg.norm(left))
        if norms[i] > 0.0 and size > _DEPENDENT:
            kept.append(i)
            basis = np.hstack([basis, (left / size)[:, np.newaxis]])
            continue
        dependent.append(i)
        if norms[i] == 0.0 or not kept:
            partners.append([])
            continue
        parts = np.abs(np.linalg.lstsq(R[:, kept], R[:, i], rcond=None)[0])
        order = np.argsort(-parts)
        partners.append([kept[k] for k in order if parts[k] > _PART * parts[order[0]]])
    return dependent, partners


def _reason(model: ErrorModel, parameter: ErrorParameter, others: Sequence[ErrorParameter]) -> str:
    """Return why a parameter does what others do, in a few words."""
    tools = {station: frame for frame, station in model.chain.tools.items()}
    stations = {other.station for other in others}
    if parameter.kind == COMPLIANCE:
        return "linearly dependent under these loads"
    if stations == {0} or (0 in stations and parameter.kind != PLACEMENT and stations <= {0, parameter.station}):
        return "the placement of the base does the same"
    if parameter.station in tools:
        last = max((k for k in stations if k not in tools), default=0)
        return f"offsets of {model.chain.stations[last].name} do the same" if last else "the base does the same"
    placed = [tools[k] for k in stations if k in tools]
    if placed:
        return f"the placement of {placed[0]} does the same"
    between = [k for k in stations if k not in (0, parameter.station) and k not in tools]
    if len(between) == 1 and parameter.station:
        relation = _relation(model.chain, parameter.station, between[0])
        if relation:
            return relation
    return "together they move the same"


def _relation(chain: Chain, first: int, second: int) -> str:
    """Return how the axes of two joints lie with all coordinates at 0.

    It is "parallel axes", "one axis", "axes that meet" or "".
    """
    at = located(chain, np.zeros((1, len(chain.stations), 6)), np.eye(4)[np.newaxis])
    a, b = at.R[first, 0, :, 2], at.R[second, 0, :, 2]
    between = at.p[second, 0] - at.p[first, 0]
    across = np.cross(a, b)
    if np.linalg.norm(across) < _ALONG:
        return "one axis" if np.linalg.norm(np.cross(a, between)) < _ALONG else "parallel axes"
    return "axes that meet" if abs(across @ between) < _ALONG else ""
