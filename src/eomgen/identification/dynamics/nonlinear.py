"""Parameters that forces are not linear in, found by Gauss-Newton with base parameters beside their steps."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ...arrays import Array
from .further import FRACTIONS, GAINS, SHAPES, STRIBECK, Sought, State, told_apart
from .regression import Data, Solution

GAINED = 1e-7  # of a logarithm of residuals, by which a step must leave less
PARTS = (1.0, 0.5, 0.25, 0.125)  # of a step, the first that leaves less is taken
ROOT = "sqrt|v|"  # a curve of friction that is told, and no law
STEPS, SETTLED = 20, 1e-2  # of Gauss-Newton: most of them, and deviations that the last one moves by at most


def iterated(data: Data, sought: Sought, half: int) -> tuple[Data, Solution, Sought, State]:
    """Find what forces are not linear in, by Gauss-Newton; Stribeck's friction where there is some.

    Returns:
        The data there, the solution, whose last values are further steps, which are identifiable, and its values.
    """
    state = sought.start()
    solution = Solution.of(data, half)
    if GAINS in sought.terms:
        predicted = data.predicted(solution)
        gains = data.beside(lambda at: sought.gain_columns(predicted[at]))
        sought = replace(sought, free_gains=told_apart(gains.triangle(np.ones_like(data.resting)), len(data.base)))
        state = _first_gains(data, sought, state)
    if STRIBECK in sought.terms:
        sought, state = _first_friction(data, sought, state, half)
    here, many = data.at(sought, state), data.count
    if not sought.names():
        return here, solution, sought, state
    solution = Solution.of(here, half)
    damped = STRIBECK in sought.terms
    for _ in range(STEPS):
        here = data.at(sought, state)
        solution = Solution.of(here.with_steps(sought, state, solution), half)
        steps = solution.values[many:]
        if (np.abs(steps) <= SETTLED * np.sqrt(solution.variances[many:])).all():
            break
        if not damped:
            state = sought.stepped(state, steps)
        elif (nearer := _nearer(data, sought, state, steps, half)) is not None:
            state = nearer
        else:
            break
    if STRIBECK in sought.terms:
        deviations = np.sqrt(
            solution.variances[solution.values.size - 2 * len(sought.rubbing) :][: len(sought.rubbing)]
        )
        fewer, _ = sought.narrowed(state, deviations)
        if len(fewer.rubbing) < len(sought.rubbing):
            return iterated(data, fewer, half)
    return here, solution, sought, state


def _nearer(data: Data, sought: Sought, state: State, steps: Array, half: int) -> State | None:
    """Take the longest of some parts of a step that leaves less; None where none does."""
    before = _left_of(Solution.of(data.at(sought, state), half).fitted)
    for share in PARTS:
        trial = sought.stepped(state, share * steps)
        if _left_of(Solution.of(data.at(sought, trial), half).fitted) < before - GAINED:
            return trial
    return None


def _left_of(residuals: Array) -> float:
    """Sum of the logarithms of rows' residuals: what weights that follow them make least."""
    return float(np.log(np.maximum(residuals, 1e-300)).sum())


def shaped(data: Data, asked: Sought, half: int) -> tuple[tuple[Data, Solution, Sought, State], list[str], list[str]]:
    """Find what forces are not linear in, with the shape of Stribeck's curve that is best on blocks held out.

    Args:
        data, half: as of ``iterated``.
        asked: what is sought; ``shape`` empty for the best of SHAPES.

    Returns:
        What ``iterated`` returns, and warnings and notes about the curve.
    """
    if STRIBECK not in asked.terms:
        return iterated(data, asked, half), [], []
    by_shape = {
        shape: iterated(data, replace(asked, shape=shape), half) for shape in SHAPES if asked.shape in ("", shape)
    }
    drive = data.drive_sizes()
    left = {shape: _left_of(one[1].held_out / drive) for shape, one in by_shape.items() if STRIBECK in one[2].terms}
    less = tuple(term for term in asked.terms if term != STRIBECK)
    plain = iterated(data, replace(asked, terms=less, rubbing=(), rms=asked.rms[:0], shape=SHAPES[0]), half)
    without = _left_of(plain[1].held_out / drive)
    if not left:
        return plain, [], []
    best = min(left, key=lambda shape: left[shape])
    notes = [_compared(data, plain[0], asked, half, left, without)]
    if left[best] >= without:
        return plain, [f"Stribeck friction is left out: {best} is no better on blocks that were held out"], notes
    return by_shape[best], [], notes


def _compared(data: Data, here: Data, asked: Sought, half: int, left: dict[str, float], without: float) -> str:
    """Say what each curve of friction leaves of the drives in blocks held out, and which leaves least."""
    v, onto = here.v[:, asked.rubbing], asked.matrix[list(asked.rubbing)].T
    root = Solution.of(here.beside(lambda at: (np.sign(v[at]) * np.sqrt(np.abs(v[at])))[:, None, :] * onto), half)
    drive = data.drive_sizes()
    all_left = {**left, ROOT: _left_of(root.held_out / drive), "dry and viscous alone": without}
    many, base = len(data.names), here.count
    shares = ", ".join(f"{name} {100.0 * np.exp(x / many):.3g} %" for name, x in all_left.items())
    best = min(all_left, key=lambda name: all_left[name])
    sizes = ", ".join(
        f"{asked.coordinates[i]} {x:.4g} +- {d:.2g}"
        for i, x, d in zip(asked.rubbing, root.values[base:], np.sqrt(root.variances[base:]), strict=True)
    )
    return f"friction curves, held out, of the drives: {shares}; {best} fits best ({ROOT}: {sizes}, SI units)"


def _first_gains(data: Data, sought: Sought, state: State) -> State:
    """Return gains that leave least of the drives' size, whatever the base parameters; a little off by noise.

    The least of |Y beta + k - C g| relative to |C g| and |k|, so that gains of 0 are no answer.
    """
    drives, parts = list(sought.drives), []
    for i in drives:
        alone = np.zeros_like(data.motion.u)
        alone[:, i] = data.motion.u[:, i]
        parts.append(data.measured(alone))
    laws = data.laws if len(sought.free_gains) == len(drives) else np.zeros_like(data.laws)
    parts.append(-laws)
    both = data.beside(lambda at: np.stack([x[at] for x in parts], axis=-1))
    R = both.triangle(~data.resting, data.drive_sizes()[:, None])
    size, many = np.linalg.norm(R, axis=0), data.count
    size[size == 0.0] = 1.0
    left = (R / size)[many:, many:][:, : len(drives) + bool(laws.any())]
    best = np.linalg.svd(left)[2][-1] / size[many : many + left.shape[1]]
    measure = best[-1] if laws.any() else best[min(set(range(len(drives))).difference(sought.free_gains), default=0)]
    gains = np.array(state.gains)
    for k in sought.free_gains:
        gains[k] = best[k] / measure if measure and best[k] else 1.0
    return replace(state, gains=gains)


def _first_friction(data: Data, sought: Sought, state: State, half: int) -> tuple[Sought, State]:
    """Return Stribeck friction of each coordinate at the best of some rates, by the rows that it acts in."""
    rms = sought.rms
    onto, many = sought.matrix[list(sought.rubbing)] != 0.0, len(sought.rubbing)
    left, values, variances = [], [], []
    for fraction in FRACTIONS:
        tried = replace(state, rates=fraction * rms)
        here = data.at(sought, tried)
        only = replace(sought, terms=(STRIBECK,), free_gains=())
        solution = Solution.of(here.beside(partial(_static, only, tried, data.v)), half)
        left.append([np.log(np.maximum(solution.fitted[row], 1e-300)).sum() for row in onto])
        values.append(solution.values[data.count :])
        variances.append(solution.variances[data.count :])
    best = np.argmin(np.array(left), axis=0)
    breakaway, variance = (np.array(x)[best, np.arange(many)] for x in (values, variances))
    start = replace(state, breakaway=breakaway, rates=np.array(FRACTIONS)[best] * rms)
    return sought.narrowed(start, np.sqrt(variance))


def _static(sought: Sought, state: State, v: Array, at: slice) -> Array:
    """Give columns of static friction beyond Coulomb friction at some samples, (t, r, k), from rates at all, (T, n)."""
    none = np.zeros((0, 0))
    return sought.columns(state, none, none, v[at])[..., : len(sought.rubbing)]
