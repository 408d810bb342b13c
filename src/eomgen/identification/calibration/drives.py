"""Error terms of drives, each only if the data show it: gain, harmonics, backlash, coupling, drift with warmth."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Array
from ...optional import optional_import
from ...progress import StageReport
from ..geometry.error_model import ErrorParameter, drive_terms
from ..geometry.observations import at_rows
from ..geometry.solve import Fit, Problem, fitted, whitened

CHANCE = 1e-3  # that any term is taken up where there is none
_MOST = 16  # terms that are taken up
EXACT = 1e-2  # standard deviations: residuals that are smaller on the whole are round-off of exact numbers
_NEW = 1e-4  # of a column's size: what must be left of it beside the others


def with_drives(problem: Problem, fit: Fit, loss: str | None, report: StageReport) -> tuple[Problem, Fit, list[str]]:
    """Return the problem with the terms that explain more than chance does, its fit, and a note for each of them.

    They are taken up one after the other, the most significant first, by the F test of what it explains; the number of
    terms that are tried is taken into account.
    """
    groups = list(drive_terms(problem.model, problem.rows))
    notes = []
    for _ in range(_MOST):
        best = _best(problem, fit, groups) if groups else None
        if best is None:
            break
        group, probability = groups.pop(best[0]), best[1]
        problem = extended(problem, group)
        report(f"fitting {group[0].name}")
        fit = fitted(problem, np.concatenate([fit.x, np.zeros(len(group))]), loss=loss)
        names = " and ".join(term.name for term in group)
        notes.append(f"the data show {names} (by chance with a probability of {max(probability, 1e-300):.1g})")
    return problem, fit, notes


def is_round_off(white: Array) -> bool:
    """Return whether whitened residuals, (M,), are round-off of exact numbers, in which nothing can show."""
    return float(np.mean(white**2)) < EXACT**2


def extended(problem: Problem, group: tuple[ErrorParameter, ...]) -> Problem:
    """Return the problem with further parameters, which are active."""
    many, unseen = len(problem.model.parameters), problem.unseen
    return replace(
        problem,
        unseen=None if unseen is None else np.pad(unseen, ((0, 0), (0, len(group)))),
        model=problem.model.with_quantities(group),
        active=np.concatenate([problem.active, np.arange(many, many + len(group))]),
    )


def with_columns(
    problem: Problem, fit: Fit, groups: Sequence[tuple[ErrorParameter, ...]]
) -> tuple[Array, Array, list[Array]]:
    """Return whitened differences, (M,), and sensitivities, (M, P), of a fit, and columns of further parameters."""
    terms = tuple(term for group in groups for term in group)
    whole = extended(problem, terms)
    r, A = at_rows(whole.model, whole.rows, whole.seen, np.concatenate([fit.x, np.zeros(len(terms))]))
    white, S = whitened(whole, fit, r, A)
    ends = np.cumsum([len(fit.x), *(len(group) for group in groups)])
    return white, S, [S[:, first:last] for first, last in itertools.pairwise(ends.tolist())]


@dataclass(frozen=True)
class Explained:
    """The group of columns that explains most: its index, probability by chance, values, and a basis of it, (M, k)."""

    index: int
    probability: float
    values: Array
    Q: Array


def best_group(
    left: Array, U: Array, groups: Sequence[Array], freedoms: float, inflations: Sequence[float] = ()
) -> Explained | None:
    """Return the most significant group of columns, by the F test of what it explains.

    None where none is identifiable.

    Args:
        left: whitened residuals without what is in U, (M,).
        U: orthonormal basis of what is fitted already, (M, p).
        groups: whitened columns, (M, k) each.
        freedoms: of the residuals.
        inflations: by how much each group explains more by chance than with independent errors; 1 by default.
    """
    with optional_import("SciPy", "calibrate needs"):
        from scipy.special import fdtrc
    total = float(left @ left)
    best: Explained | None = None
    for index, new in enumerate(groups):
        many = new.shape[1]
        T, sizes = new - U @ (U.T @ new), np.linalg.norm(new, axis=0)
        if (np.linalg.norm(T, axis=0) <= _NEW * sizes).any() or freedoms <= many + 1:
            continue
        Q, R = np.linalg.qr(T)
        if (np.abs(np.diagonal(R)) <= _NEW * sizes).any():
            continue
        explained = float(((Q.T @ left) ** 2).sum())
        noise = max(total - explained, 1e-300) / (freedoms - many)
        by_chance = inflations[index] if inflations else 1.0
        probability = float(fdtrc(many, freedoms - many, explained / many / noise / by_chance))
        if best is None or probability < best.probability:
            best = Explained(index, probability, np.linalg.solve(R, Q.T @ left), Q)
    return best


def _best(problem: Problem, fit: Fit, groups: list[tuple[ErrorParameter, ...]]) -> tuple[int, float] | None:
    """Return the index of the most significant group and its probability by chance; None if none is significant."""
    white, S, columns = with_columns(problem, fit, groups)
    if is_round_off(white):
        return None
    U, values, _ = np.linalg.svd(S[:, problem.active], full_matrices=False)
    U = U[:, values > 1e-9 * values[0]]
    best = best_group(white - U @ (U.T @ white), U, columns, fit.freedoms)
    if best is None or best.probability * len(groups) >= CHANCE:
        return None
    return best.index, best.probability
