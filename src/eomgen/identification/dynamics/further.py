"""Parameters that forces are not linear in: gains of drives, a delay, Stribeck's friction; by Gauss-Newton.

About their present values each of them is one more column beside those of the base parameters: of a gain what its drive
should be by all parameters, not what was measured, so that noise of the drive is in no column; of the delay the rate of
that; of Stribeck's law its slopes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Array
from ...names import component_name
from ...robot.coordinates import force_unit_of, unit_of
from ..identifiable import regrouped
from .result import Further

STRIBECK, GAINS, DELAY = FURTHER = ("stribeck", "gains", "delay")
FRACTIONS = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0)  # of the rms of a rate, where Stribeck's rate is looked for first
LONGEST = 0.7  # step of a logarithm: a factor of 2
DEVIATIONS = 2.0  # of what static friction is more, below which there is none
HARDLY = 0.2  # of a gain: a deviation that leaves it open
SHAPES = LORENTZIAN, GAUSSIAN = "lorentzian", "gaussian"
SLOWEST, FASTEST = 0.5 * FRACTIONS[0], 1.5 * FRACTIONS[-1]  # of the rms of a rate: Stribeck's rate lies between
EDGE = (
    1e-3  # relative, next to an end of these: the curve cannot be distinguished from Coulomb and viscous friction there
)
NEIGHBOURS = 3  # on each side of the place that a sample is interpolated at


@dataclass(frozen=True)
class State:
    """Present values: delay (s), gains of drives, (d,), Stribeck's static less Coulomb friction and rate, (k,) each."""

    delay: float
    gains: Array
    breakaway: Array
    rates: Array


@dataclass(frozen=True)
class Sought:
    """Parameters to look for beside base parameters.

    Attributes:
        terms: among FURTHER.
        coordinates: names of all.
        drives: indices of the coordinates whose drive was measured, d of them.
        free_gains: those among ``drives``, by place, whose gain is identifiable.
        rubbing: indices of the coordinates whose friction is sought, k of them.
        matrix: (n, r), forces at all coordinates to the rows that are known.
        step: of the samples, s.
        shape: of Stribeck's curve, among SHAPES.
        rms: of the rates of ``rubbing``, (k,).
    """

    terms: tuple[str, ...]
    coordinates: tuple[str, ...]
    drives: tuple[int, ...]
    free_gains: tuple[int, ...]
    rubbing: tuple[int, ...]
    matrix: Array
    step: float
    shape: str
    rms: Array

    def start(self) -> State:
        """Return the value at which the search begins."""
        return State(0.0, np.ones(len(self.drives)), np.zeros(len(self.rubbing)), np.ones(len(self.rubbing)))

    def names(self) -> list[str]:
        """Return names of the columns of ``columns``."""
        names = ["delay"] if DELAY in self.terms else []
        names += [component_name(self.coordinates[self.drives[k]], "gain") for k in self.free_gains]
        if STRIBECK in self.terms:
            for key in ("breakaway", self.rate_name):
                names += [component_name(self.coordinates[i], key) for i in self.rubbing]
        return names

    @property
    def rate_name(self) -> str:
        """Name of the rate of Stribeck's curve, by its shape."""
        return "stribeck" if self.shape == LORENTZIAN else GAUSSIAN

    def _share(self, x: Array) -> tuple[Array, Array]:
        """Give how much of static friction's excess is left at a rate over Stribeck's, and its slope by the latter's
        logarithm."""
        if self.shape == LORENTZIAN:
            share = 1.0 / (1.0 + x**2)
            return share, 2.0 * (x * share) ** 2
        share = np.exp(-np.minimum(x**2, 700.0))
        return share, 2.0 * x**2 * share

    def columns(self, state: State, predicted: Array, slopes: Array, v: Array) -> Array:
        """Return columns of steps of all, (T, r, e).

        Args:
            state: about which.
            predicted: forces of the rows by all parameters, (T, r).
            slopes: rates of these, (T, r), N/s or N m/s.
            v: rates, (T, n).
        """
        parts = [-slopes[..., None]] if DELAY in self.terms else []
        if self.free_gains:
            parts.append(self.gain_columns(predicted)[..., list(self.free_gains)])
        if STRIBECK in self.terms:
            x = v[:, self.rubbing] / state.rates
            sign, onto = np.sign(v[:, self.rubbing]), self.matrix[list(self.rubbing)].T
            share, slope = self._share(x)
            parts.append((sign * share)[:, None, :] * onto)
            parts.append((sign * state.breakaway * slope)[:, None, :] * onto)
        return np.concatenate(parts, axis=-1)

    def gain_columns(self, predicted: Array) -> Array:
        """Return columns of relative changes of all gains, (T, r, d)."""
        onto = self.matrix[list(self.drives)]  # (d, r)
        drives = predicted @ np.linalg.pinv(onto)
        return np.asarray(-drives[:, None, :] * onto.T)

    def friction(self, state: State, v: Array) -> Array:
        """Return resistance by Stribeck's law beyond Coulomb friction, along all coordinates, (T, n)."""
        friction = np.zeros_like(v)
        if STRIBECK in self.terms:
            rates = v[:, self.rubbing]
            friction[:, self.rubbing] = np.sign(rates) * state.breakaway * self._share(rates / state.rates)[0]
        return friction

    def drives_of(self, state: State, u: Array) -> Array:
        """Return drives, (T, n), N or N m, of what was measured of them: with their gains, and without their delay."""
        drives = np.array(u)
        drives[:, list(self.drives)] *= state.gains
        return shifted(drives, state.delay / self.step)

    def stepped(self, state: State, steps: Array) -> State:
        """Return the state after steps of what ``columns`` is of."""
        left = list(steps)
        delay, gains = state.delay, np.array(state.gains)
        if DELAY in self.terms:
            delay += float(left.pop(0))
        for k in self.free_gains:
            gains[k] *= float(np.clip(1.0 + left.pop(0), 0.5, 2.0))
        if STRIBECK not in self.terms:
            return replace(state, delay=delay, gains=gains)
        many = len(self.rubbing)
        logarithms = np.clip(left[many:], -LONGEST, LONGEST)
        rates = np.clip(state.rates * np.exp(logarithms), SLOWEST * self.rms, FASTEST * self.rms)
        return State(delay, gains, state.breakaway + left[:many], rates)

    def narrowed(self, state: State, deviations: Array) -> tuple[Sought, State]:
        """Go on with coordinates alone whose static friction is more than Coulomb friction.

        Those whose Stribeck velocity is at an end of what the motion can tell are left out, too.

        Args:
            state: with all of ``rubbing``.
            deviations: of its ``breakaway``, (k,).
        """
        shown = state.breakaway > DEVIATIONS * deviations
        slow, fast = state.rates <= SLOWEST * self.rms * (1.0 + EDGE), state.rates >= FASTEST * self.rms * (1.0 - EDGE)
        shown &= ~(slow | fast)
        rubbing = tuple(i for i, there in zip(self.rubbing, shown, strict=True) if there)
        terms = self.terms if rubbing else tuple(term for term in self.terms if term != STRIBECK)
        left = replace(state, breakaway=state.breakaway[shown], rates=state.rates[shown])
        return replace(self, terms=terms, rubbing=rubbing, rms=self.rms[shown]), left

    def further(self, state: State, deviations: Sequence[float]) -> dict[str, Further]:
        """Return values with standard deviations of the steps that ``columns`` is of."""
        values: list[tuple[float, float, str]] = [(state.delay, 1.0, "s")] if DELAY in self.terms else []
        for k in self.free_gains:
            unit = force_unit_of(self.coordinates[self.drives[k]])
            values.append((float(state.gains[k]), float(state.gains[k]), f"{unit} per unit in the file"))
        if STRIBECK in self.terms:
            names = [self.coordinates[i] for i in self.rubbing]
            values += [(float(x), 1.0, force_unit_of(name)) for x, name in zip(state.breakaway, names, strict=True)]
            values += [(float(x), float(x), f"{unit_of(name)}/s") for x, name in zip(state.rates, names, strict=True)]
        pairs = zip(self.names(), values, deviations, strict=True)
        return {name: Further(value, abs(size) * float(d), unit) for name, (value, size, unit), d in pairs}


def told_apart(R: Array, base: int) -> tuple[int, ...]:
    """Return the index of the drives whose gains are identifiable beside base parameters and gains before them.

    Args:
        R: triangle of the columns of base parameters and of the gains of all drives, by what some values of the former
            make of the rows, exactly, with all forces that are known.
        base: how many base parameters there are.
    """
    size = np.linalg.norm(R, axis=0)
    chosen, _ = regrouped(R / np.where(size == 0.0, 1.0, size))
    return tuple(int(k) - base for k in chosen if k >= base)


def shifted(x: Array, samples: float) -> Array:
    """Return columns at times that are so many samples later, (T, k): polynomials of fifth degree; held at the ends."""
    if samples == 0.0:
        return x
    whole = int(np.floor(samples))
    offsets = np.arange(1 - NEIGHBOURS, NEIGHBOURS + 1)
    fraction = samples - whole
    weights = [
        np.prod([(fraction - other) / (place - other) for other in offsets if other != place]) for place in offsets
    ]
    rows = np.arange(len(x))[:, None] + whole + offsets
    return np.asarray(np.einsum("j,tjk->tk", np.array(weights), x[np.clip(rows, 0, len(x) - 1)]))


def further_doubts(asked: Sought, sought: Sought, further: dict[str, Further]) -> list[str]:
    """Return warnings about what is not identifiable, what the motion hardly shows, and gains that are negative.

    Args:
        asked: what was asked for.
        sought: what of it there is.
        further: its values.
    """
    warnings = []
    for k, i in enumerate(sought.drives if GAINS in sought.terms else ()):
        name = component_name(sought.coordinates[i], "gain")
        if k not in sought.free_gains:
            warnings.append(
                f"{name} depends linearly on masses, inertias, friction and gains of other drives, and stays 1: links"
                " whose numbers are known are a measure"
            )
        elif further[name].deviation > HARDLY * abs(further[name].value):
            warnings.append(f"{name} is hardly shown: {further[name].value:.3g} +- {further[name].deviation:.2g}")
        elif further[name].value < 0.0:
            warnings.append(f"{name} is negative; is the drive's sign right?")
    rubbing = sought.rubbing if STRIBECK in sought.terms else ()
    lost = [asked.coordinates[i] for i in asked.rubbing if i not in rubbing] if STRIBECK in asked.terms else []
    return [*warnings, *(f"{name}: the motion shows no Stribeck friction" for name in lost)]
