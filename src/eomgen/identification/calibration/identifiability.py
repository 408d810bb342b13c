"""Identifiability from measured poses: ranks, quantities that merge with others and why, directions lost in noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ..geometry.error_model import COMPLIANCE, PLACEMENT, ErrorModel, Quantity, Rows
from ..geometry.observations import ORIENTATION, Block, Observations, at_rows
from ..geometry.solve import Fit, Problem, algebraic_rank, normed_triangle, whitened
from ..geometry.stations import Chain, located

GENERIC = 80  # random rows that show what a kind of measurement can show at all
_DEPENDENT = 1e-8  # of a normed column: what is left of it beside those before it
_PART = 1e-5  # of the greatest coefficient: what counts as merged
_NAMED = 3  # quantities of a weak direction, or that one merges with
_NO_LOAD, _UNSEEN = "no load of these poses acts on it", "it moves nothing that was measured"
_ALONE = {_NO_LOAD: "no load of these poses acts on them", _UNSEEN: "they move nothing that was measured"}
_ALONG = 1e-9  # m or rad: how far axes may be off to be parallel, or one


@dataclass(frozen=True)
class Identifiable:
    """Ranks, why quantities are not identifiable by name, and weak directions with their standard deviations."""

    rank: int
    rank_above_noise: int
    merged: dict[str, str]
    weak: tuple[tuple[str, float], ...]


def identifiable(problem: Problem, fit: Fit) -> Identifiable:
    """Ranks, merged quantities and weak directions of a problem: at the described robot, by the noise of a fit.

    Axes that are parallel there need not be in the fit, by less than it can see.
    """
    model = problem.model
    r, A = at_rows(model, problem.rows, problem.seen, model.nominal)
    S = whitened(problem, fit, r, A)[1][:, problem.active]
    quantities = [model.quantities[i] for i in problem.active]
    rank = algebraic_rank(S)
    R, norms = normed_triangle(S)
    values, V = np.linalg.svd(R * norms)[1:]
    weak = tuple(_weak(quantities, V[k], float(values[k])) for k in range(rank) if values[k] <= 1.0)
    return Identifiable(rank, int((values[:rank] > 1.0).sum()), _merged(problem, quantities, S), weak)


def possible_rank(problem: Problem) -> int:
    """Rank that many random poses of the same kinds of measurements would have."""
    return algebraic_rank(generic_sensitivities(problem))


def generic_sensitivities(problem: Problem) -> Array:
    """Sensitivities, (m, p), of the active quantities at random poses within limits, measured in the same way."""
    rng = np.random.default_rng(0)
    model, given = problem.model, problem.rows
    chosen = rng.integers(len(given.series), size=GENERIC)
    rows = given.part(chosen)
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
    """InputError where there are fewer numbers than can be found from such measurements."""
    wanted, many = possible_rank(problem), problem.seen.group.size
    if many < wanted:
        rows = len(problem.rows.series)
        raise InputError(
            f"{source}: {rows} rows with {many} numbers for {wanted} unknowns: fewer poses than unknowns; allowed:"
            f" {int(np.ceil(rows * wanted / many))} rows or more, or fewer quantities (fixed)"
        )


def _weak(quantities: Sequence[Quantity], direction: Array, value: float) -> tuple[str, float]:
    """A direction by its largest parts, and the standard deviation of the first of them along it."""
    largest = np.argsort(-np.abs(direction))
    first = largest[0]
    kept = [i for i in largest[:_NAMED] if abs(direction[i]) > 0.2 * abs(direction[first])]
    parts = [quantities[first].name]
    for i in kept[1:]:
        share = direction[i] * quantities[i].size / (direction[first] * quantities[first].size)
        parts.append(f"{share:+.2g} {quantities[i].name}")
    return " ".join(parts), float(quantities[first].size * abs(direction[first]) / max(value, 1e-300))


def _merged(problem: Problem, quantities: Sequence[Quantity], S: Array) -> dict[str, str]:
    """Why quantities are not identifiable: those that others do the work of, in the order of the names."""
    found, partners = _dependent(S)
    always = set(found)
    if found and problem.model.closing is None:  # random poses of a mechanism need not close
        always = set(_dependent(generic_sensitivities(problem))[0])
    texts = {}
    for i, others in zip(found, partners, strict=True):
        quantity = quantities[i]
        if not others:
            texts[quantity.name] = _NO_LOAD if quantity.kind == COMPLIANCE else _UNSEEN
            continue
        with_ = ", ".join(quantities[k].name for k in others[:_NAMED])
        more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
        why = _reason(problem.model, quantity, [quantities[k] for k in others])
        why = why if i in always else "these poses do not tell them apart"
        texts[quantity.name] = f"with {with_}{more}: {why}"
    return texts


def merged_rows(merged: Mapping[str, str]) -> list[tuple[str, str]]:
    """Quantities that are not identifiable with their reasons, in the order given; those that show nothing in one row.

    merged: reason by name, as in ``Identifiable``.
    """
    found = [(name, why) for name, why in merged.items() if why not in _ALONE]
    for why, together in _ALONE.items():
        names = [name for name, reason in merged.items() if reason == why]
        if len(names) > 1:
            found.append((f"{len(names)} quantities", f"{together} (their names: --json, as_dict)"))
        else:
            found += [(name, why) for name in names]
    return found


def _dependent(S: Array) -> tuple[list[int], list[list[int]]]:
    """Columns that depend on those before them, and for each these, largest part first."""
    R, norms = normed_triangle(S)
    kept, found, partners = list[int](), list[int](), list[list[int]]()
    basis = np.zeros((R.shape[0], 0))
    for i in range(R.shape[1]):
        left = R[:, i] - basis @ (basis.T @ R[:, i])
        left -= basis @ (basis.T @ left)
        size = float(np.linalg.norm(left))
        if norms[i] > 0.0 and size > _DEPENDENT:
            kept.append(i)
            basis = np.hstack([basis, (left / size)[:, np.newaxis]])
            continue
        found.append(i)
        if norms[i] == 0.0 or not kept:
            partners.append([])
            continue
        parts = np.abs(np.linalg.lstsq(R[:, kept], R[:, i], rcond=None)[0])
        order = np.argsort(-parts)
        partners.append([kept[k] for k in order if parts[k] > _PART * parts[order[0]]])
    return found, partners


def _reason(model: ErrorModel, quantity: Quantity, others: Sequence[Quantity]) -> str:
    """Why a quantity does what others do, in a few words."""
    tools = {station: frame for frame, station in model.chain.tools.items()}
    stations = {other.station for other in others}
    if quantity.kind == COMPLIANCE:
        return "these loads do not tell them apart"
    if stations == {0} or (0 in stations and quantity.kind != PLACEMENT and stations <= {0, quantity.station}):
        return "the placement of the base does the same"
    if quantity.station in tools:
        last = max((k for k in stations if k not in tools), default=0)
        return f"offsets of {model.chain.stations[last].name} do the same" if last else "the base does the same"
    placed = [tools[k] for k in stations if k in tools]
    if placed:
        return f"the placement of {placed[0]} does the same"
    between = [k for k in stations if k not in (0, quantity.station) and k not in tools]
    if len(between) == 1 and quantity.station:
        relation = _relation(model.chain, quantity.station, between[0])
        if relation:
            return relation
    return "together they move the same"


def _relation(chain: Chain, first: int, second: int) -> str:
    """How the axes of two joints lie with all coordinates at 0: "parallel axes", "one axis", "axes that meet" or ""."""
    at = located(chain, np.zeros((1, len(chain.stations), 6)), np.eye(4)[np.newaxis])
    a, b = at.R[first, 0, :, 2], at.R[second, 0, :, 2]
    between = at.p[second, 0] - at.p[first, 0]
    across = np.cross(a, b)
    if np.linalg.norm(across) < _ALONG:
        return "one axis" if np.linalg.norm(np.cross(a, between)) < _ALONG else "parallel axes"
    return "axes that meet" if abs(across @ between) < _ALONG else ""
