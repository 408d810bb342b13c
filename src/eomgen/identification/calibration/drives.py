"""Error terms of drives, each only if the data show it: gain, eccentricity, backlash, coupling, drift with warmth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...optional import optional_import
from ...progress import StageReport
from ..geometry.error_model import Quantity, drive_terms
from ..geometry.observations import at_rows
from ..geometry.solving import Fit, Problem, fitted, whitened

Array = NDArray[np.float64]

CHANCE = 1e-3  # that any term is taken up where there is none
_MOST = 16  # terms that are taken up
_NEW = 1e-4  # of a column's size: what must be left of it beside the others


def with_drives(problem: Problem, fit: Fit, loss: str | None, report: StageReport) -> tuple[Problem, Fit, list[str]]:
    """The problem with the terms that explain more than chance does, its fit, and a note for each of them.

    They are taken up one after the other, the most significant first, by the F test of what it explains; the number of
    terms that are tried is taken into account.
    """
    groups = list(drive_terms(problem.model.chain, problem.rows))
    notes = []
    for _ in range(_MOST):
        found = _best(problem, fit, groups) if groups else None
        if found is None:
            break
        group, probability = groups.pop(found[0]), found[1]
        problem = _extended(problem, group)
        report(f"fitting {group[0].name}")
        fit = fitted(problem, np.concatenate([fit.x, np.zeros(len(group))]), loss=loss)
        names = " and ".join(term.name for term in group)
        notes.append(f"the data show {names} (by chance with a probability of {max(probability, 1e-300):.1g})")
    return problem, fit, notes


def _extended(problem: Problem, group: tuple[Quantity, ...]) -> Problem:
    many = len(problem.model.quantities)
    return replace(
        problem,
        model=problem.model.with_quantities(group),
        active=np.concatenate([problem.active, np.arange(many, many + len(group))]),
    )


def _best(problem: Problem, fit: Fit, groups: list[tuple[Quantity, ...]]) -> tuple[int, float] | None:
    """Index of the most significant group and its probability by chance; None if none is significant."""
    with optional_import("SciPy", "calibrate needs"):
        from scipy.special import fdtrc
    terms = tuple(term for group in groups for term in group)
    whole = _extended(problem, terms)
    x = np.concatenate([fit.x, np.zeros(len(terms))])
    r, A = at_rows(whole.model, whole.rows, whole.seen, x)
    white, S = whitened(whole, fit, r, A)
    known, new = S[:, problem.active], S[:, len(fit.x) :]
    U, values, _ = np.linalg.svd(known, full_matrices=False)
    U = U[:, values > 1e-9 * values[0]]
    left, white = new - U @ (U.T @ new), white - U @ (U.T @ white)
    total = float(white @ white)
    best: tuple[int, float] | None = None
    first = 0
    for index, group in enumerate(groups):
        columns = slice(first, first + len(group))
        first += len(group)
        T, sizes = left[:, columns], np.linalg.norm(new[:, columns], axis=0)
        if (np.linalg.norm(T, axis=0) <= _NEW * sizes).any() or fit.freedoms <= len(group) + 1:
            continue
        Q = np.linalg.qr(T)[0]
        explained = float(((Q.T @ white) ** 2).sum())
        noise = max(total - explained, 1e-300) / (fit.freedoms - len(group))
        probability = float(fdtrc(len(group), fit.freedoms - len(group), explained / len(group) / noise))
        if best is None or probability < best[1]:
            best = index, probability
    return best if best is not None and best[1] * len(groups) < CHANCE else None
