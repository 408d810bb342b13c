"""The variants of a calibration beside each other, fitted and held out: which explains poses that it has not seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Index, Mask
from ...errors import InputError
from ...names import listed, show
from ...optional import optional_import
from ...progress import StageReport
from ..geometry.error_model import PLACEMENT, ZERO, ErrorParameter
from ..geometry.observations import ORIENTATION, POSITION, at_rows
from ..geometry.solve import ROUGH, Fit, Problem, algebraic_rank, fitted, roughly, whitened

Rms = dict[str, float]
Gains = Mapping[str, Mapping[str, "Gain"]]

Variant = Literal["placement", "zeros", "full", "prior"]
VARIANTS: tuple[str, ...] = get_args(Variant)
KINDS: Mapping[str, tuple[str, ...]] = {"placement": (PLACEMENT,), "zeros": (PLACEMENT, ZERO), "full": ()}  # (): all
PRIORS = tuple(10.0 ** (k / 2.0) for k in range(-4, 5))  # sizes that are tried, in expected ones
_WIDE = 1e3  # expected sizes of what has no prior in a ridge
_ROUND_OFF = 1e-6  # of a gain: variants that are equal differ by no more
INNER = 10  # folds, at most, in which a prior is chosen for what is held out
NO_GAIN = "no significant gain"


@dataclass(frozen=True)
class Gain:
    """Held-out error of placement alone over that of another variant, with its interval."""

    ratio: float
    low: float
    high: float

    @property
    def is_significant(self) -> bool:
        """Whether the interval is above 1."""
        return self.low > 1.0 + _ROUND_OFF

    @property
    def is_loss(self) -> bool:
        """Whether the interval is below 1: the variant is worse where it has not looked."""
        return self.high < 1.0 - _ROUND_OFF


@dataclass(frozen=True)
class Variants:
    """Fits by variant, their residuals, what was held out, the size of the prior, and the gains.

    residuals: by variant, then "fitted" and "held_out" (rms of components), "fitted_norm" and "held_out_norm" (rms of
        vectors), then "position" (m) and "orientation" (rad).
    held_out: differences of numbers whose rows were left out, (M,), by variant; none without folds.
    gains: over placement alone, by variant, then by kind.
    """

    fits: Mapping[str, Fit]
    residuals: Mapping[str, Mapping[str, Rms]]
    held_out: Mapping[str, Array]
    prior: float | None
    gains: Gains


def variants_of(
    problem: Problem, start: Array, loss: str | None, units: Index, folds: int, confidence: float, report: StageReport
) -> Variants:
    """Fit all variants and hold out poses.

    Args:
        problem: the full one.
        start: first values, (P,).
        loss: see ``fitted``.
        units: of each row of the file, the number of what is left out together, (R,), from 0.
        folds: contiguous parts of the units, each held out once; 0: none.
        confidence: of the gains' intervals.
        report: called with a line of text when a variant begins.
    """
    report("fitting")
    fits = _fits(problem, start, loss)
    full = fits["full"]
    report("choosing a prior")
    parts = fold_rows(units, problem.rows.series, folds if folds else 10)
    size = _chosen_prior(problem, full, parts)
    fits["prior"] = _with_prior(problem, full, size)
    held = {name: np.full(problem.seen.group.size, np.nan) for name in VARIANTS} if folds else {}
    S = at_rows(problem.model, problem.rows, problem.seen, start)[1]
    for k, fold in enumerate(parts if folds else ()):
        report(f"holding out poses, part {k + 1} of {len(parts)}")
        out = problem.seen.part(fold)
        is_placed = _placed(problem, S, fold)[out]
        for name, differences in _held_out(problem, start, loss, k, parts).items():
            held[name][out] = np.where(is_placed, differences, np.nan)
    residuals = {name: residuals_of(problem, fits[name].residuals, held.get(name), full.trust) for name in VARIANTS}
    return Variants(fits, residuals, held, size, _gains(problem, held, full.trust, units, confidence))


def residuals_of(problem: Problem, fitted: Array, held: Array | None, trust: Array) -> dict[str, Rms]:
    """Return rms of residuals, fitted and held out, (M,) each, of components and of whole vectors; see ``Variants``."""
    residuals = {}
    for kind, differences in (("fitted", fitted), ("held_out", held)):
        residuals[kind] = {} if differences is None else rms(problem, differences, trust)
        residuals[f"{kind}_norm"] = {} if differences is None else rms(problem, differences, trust, whole=True)
    return residuals


def only_fitted(problem: Problem, start: Array, loss: str | None) -> Fit:
    """Return the full fit alone, from placement on."""
    return fitted(problem, roughly(_restricted(problem, PLACEMENT), start), loss=loss)


def roughly_placed(problem: Problem, start: Array) -> Array:
    """Return values, (P,), with base and tool transforms alone after a few steps, enough to distinguish readings."""
    return roughly(_restricted(problem, PLACEMENT), start, ROUGH // 2)


def rms(problem: Problem, differences: Array, trust: Array, *, whole: bool = False) -> Rms:
    """Return the root of the mean square of what was measured less what is predicted, by kind: m and rad.

    whole: of whole vectors, such as the distance between two points; else of their components.
    """
    values = {}
    kinds = problem.seen.kinds
    widths = np.array([block.width for block in problem.seen.blocks])[problem.seen.group]
    for kind in (POSITION, ORIENTATION):
        inside = (kinds == kind) & np.isfinite(differences)
        weight = (trust / widths if whole else trust)[inside].sum()
        if weight > 0.0:
            values[kind] = float(np.sqrt((trust[inside] * differences[inside] ** 2).sum() / weight))
    return values


def medians_of(problem: Problem, variants: Variants, variant: str) -> Rms:
    """Return the median length of the vectors that a variant leaves, by kind, m and rad.

    It is the greater one of the fitted and the held-out residuals.
    """
    medians: Rms = {}
    kinds = problem.seen.kinds
    for differences in (variants.fits[variant].residuals, variants.held_out.get(variant)):
        for group, block in enumerate(problem.seen.blocks):
            inside = problem.seen.group == group
            if differences is None or not np.isfinite(differences[inside]).any():
                continue
            lengths = np.linalg.norm(differences[inside].reshape(-1, block.width), axis=1)
            kind = str(kinds[inside][0])
            medians[kind] = max(medians.get(kind, 0.0), float(np.nanmedian(lengths)))
    return medians


def fold_rows(units: Index, series: NDArray[np.int64], folds: int) -> list[Mask]:
    """Return rows of every fold, (R,) each: parts of the units one behind the other, as even as possible.

    Every series is divided by itself, so that the other folds say where its device stands.

    Args:
        units: of each row, the number of what is left out together, from 0.
        series: of each row.
        folds: how many; as many as units where these are fewer.
    """
    many = int(units.max()) + 1
    of_unit = series[np.unique(units, return_index=True)[1]]
    fold_of = np.arange(many)
    for k, number in enumerate(np.unique(of_unit).tolist() if folds < many else ()):
        inside = np.flatnonzero(of_unit == number)
        fold_of[inside] = (np.arange(inside.size) * folds // inside.size + k) % folds
    return [fold_of[units] == k for k in np.unique(fold_of).tolist()]


def series_notes(problem: Problem, variants: Variants) -> list[str]:
    """Return notes about how rows of several series were held out."""
    numbers = sorted(problem.model.bases)
    if not variants.held_out or len(numbers) < 2:
        return []
    missing = np.unique(problem.rows.series[problem.seen.row[np.isnan(variants.held_out["full"])]]).tolist()
    notes = [f"rows are held out of each of {len(numbers)} series; the other rows of a series say where its device is"]
    if missing:
        notes.append(
            f"of series {listed([str(x) for x in missing])} rows are not held out: the others do not say where"
            " the device is"
        )
    return notes


def folds_from(folds: object) -> int:
    """Return the number of folds of an option: a whole number, or "loo" for as many as there are poses.

    Raises:
        InputError: it is neither 0 nor at least 2.
    """
    if folds == "loo":
        return 1 << 30
    if isinstance(folds, bool) or not isinstance(folds, int) or folds < 0 or folds == 1:
        raise InputError(f"folds: {show(folds)}; allowed: 0 (none), a whole number from 2 on, or 'loo'")
    return folds


def problem_of_variant(problem: Problem, variant: str, prior: float | None) -> Problem:
    """Return the problem that a variant is the fit of; ``prior``: the size that was chosen for it."""
    if variant == "prior" and prior is not None:
        return replace(problem, prior=_prior(problem, prior))
    kinds = KINDS[variant]
    return _restricted(problem, *kinds) if kinds else problem


def _restricted(problem: Problem, *kinds: str) -> Problem:
    """Return the problem with the active parameters of these kinds alone; drives' terms come with the full one."""
    chosen = [i for i in problem.active if problem.model.parameters[i].kind in kinds]
    return replace(problem, active=np.array(chosen, dtype=np.intp))


def _prior(problem: Problem, size: float) -> Array:
    """Return standard deviations of all parameters, (P,).

    Of bases and of frames that are attached there is no prior.
    """
    model, large = problem.model, (problem.model.chain.reach, 1.0)  # of lengths and angles
    free = np.array([q.kind == PLACEMENT and q.size > 0.5 * large[q.coordinate // 3] for q in model.parameters])
    return np.where(free, _WIDE * model.sizes, size * model.sizes)


def _chosen_prior(problem: Problem, fit: Fit, folds: Sequence[Mask]) -> float:
    """Return the size of the prior that predicts held-out numbers best, by the problem linearised at its full fit."""
    r, A = at_rows(problem.model, problem.rows, problem.seen, fit.x)
    white, S = whitened(problem, fit, r, A)
    S = S[:, problem.active]
    z = ((fit.x - problem.model.nominal) / problem.model.sizes)[problem.active]
    y = white + S @ z
    inside = np.ones(y.size, dtype=bool)
    if problem.kept is not None:
        inside[:] = False
        inside[problem.kept] = True
    G, g = S[inside].T @ S[inside], S[inside].T @ y[inside]
    errors = np.zeros(len(PRIORS))
    for fold in folds:
        test = inside & fold[problem.seen.row]
        if not test.any():
            continue
        T = S[test]
        N, n = G - T.T @ T, g - T.T @ y[test]
        for k, size in enumerate(PRIORS):
            held = (problem.model.sizes / _prior(problem, size))[problem.active]
            estimate = np.linalg.solve(N + np.diag(held**2), n)
            errors[k] += float(((y[test] - T @ estimate) ** 2).sum())
    return float(PRIORS[int(errors.argmin())])


def _fits(problem: Problem, start: Array, loss: str | None) -> dict[str, Fit]:
    """Return the fits of all variants but the prior's, each from where the one before it ended."""
    fits, x = dict[str, Fit](), start
    for name in KINDS:
        fits[name] = fitted(problem_of_variant(problem, name, None), x, loss=loss)
        x = fits[name].x
    return fits


def _with_prior(problem: Problem, full: Fit, size: float) -> Fit:
    """Return the fit with a prior of a size, with noise and weights of the full one."""
    return fitted(problem_of_variant(problem, "prior", size), full.x, sigma=full.sigma, trust=full.trust)


def _held_out(problem: Problem, start: Array, loss: str | None, k: int, folds: Sequence[Mask]) -> dict[str, Array]:
    """Return differences of the numbers of a fold, by variant, none where nothing else was measured.

    All that they depend on is of the other folds: noise, weights, values to begin with, and the size of the prior.
    """
    kept, out = problem.seen.part(~folds[k]), problem.seen.part(folds[k])
    if not (kept.size and out.size):
        return {}
    others = replace(problem, kept=kept)
    fits = _fits(others, start, loss)
    inner = _together([other for other in folds if other is not folds[k]], INNER)
    fits["prior"] = _with_prior(others, fits["full"], _chosen_prior(others, fits["full"], inner))
    return {name: fit.residuals[out] for name, fit in fits.items()}


def _placed(problem: Problem, S: Array, fold: Mask) -> Mask:
    """Return of every number, (M,), whether rows outside a fold place the base before the device of its series.

    S: sensitivities, (M, P).
    """
    is_placed, series = np.ones(len(S), dtype=bool), problem.rows.series[problem.seen.row]
    out = fold[problem.seen.row]
    for number in np.unique(series[out]).tolist():
        inside = series == number
        of_base = [i for i in problem.active if _is_base(problem.model.parameters[i], number)]
        columns = (S * problem.model.sizes)[:, of_base]
        is_placed[inside] = algebraic_rank(columns[inside & ~out]) == algebraic_rank(columns[inside])
    return is_placed


def _is_base(parameter: ErrorParameter, number: int) -> bool:
    return parameter.kind == PLACEMENT and parameter.station == 0 and parameter.series == number


def _together(folds: Sequence[Mask], most: int) -> list[Mask]:
    """Return the folds, neighbours put together where there are more than so many."""
    parts = np.array_split(np.arange(len(folds)), min(most, len(folds)))
    return [np.any([folds[k] for k in group], axis=0) for group in parts]


def _gains(problem: Problem, held: Mapping[str, Array], trust: Array, units: Index, confidence: float) -> Gains:
    """Return by how much variants beat placement alone where they have not looked, by variant and kind."""
    kinds = problem.seen.kinds
    by_frame: dict[str, dict[str, Gain]] = {}
    for name in VARIANTS[1:] if held else ():
        known = np.isfinite(held["placement"]) & np.isfinite(held[name])
        gains = {
            kind: _gain(held["placement"], held[name], trust, units[problem.seen.row], inside, confidence)
            for kind in (POSITION, ORIENTATION)
            if (inside := (kinds == kind) & known).any()
        }
        by_frame[name] = {kind: gain for kind, gain in gains.items() if gain is not None}
    return {name: gains for name, gains in by_frame.items() if gains}


def _gain(before: Array, after: Array, trust: Array, unit: Index, inside: Mask, confidence: float) -> Gain | None:
    """Return the ratio of the rms of two sets of held-out differences, (M,), with its interval.

    The interval is that of the jackknife over units; None where it cannot be told.
    """
    with optional_import("SciPy", "calibrate needs"):
        from scipy.special import stdtrit
    there, place = np.unique(unit[inside], return_inverse=True)
    many = there.size
    sums = [
        np.bincount(place, trust[inside] * differences[inside] ** 2, minlength=many) for differences in (before, after)
    ]
    if many < 3 or not all(differences.sum() > 0.0 for differences in sums):
        return None
    whole = [np.maximum(differences.sum() - differences, 1e-300) for differences in sums]
    each = 0.5 * np.log(whole[0] / whole[1])
    middle = 0.5 * float(np.log(sums[0].sum() / sums[1].sum()))
    error = float(np.sqrt((many - 1) / many * ((each - each.mean()) ** 2).sum()))
    half = float(stdtrit(many - 1, 0.5 + 0.5 * confidence)) * error
    return Gain(*(float(np.exp(value)) for value in (middle, middle - half, middle + half)))
