"""Drives whose forces are samples over time, on request with a PD law about the coordinates that go with them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array, Index
from ..kernel.stepping.input_signals import DriveData, Gains, Signal, Track
from .controls import clipped


@dataclass(frozen=True, eq=False)
class SampledDrive:
    """Forces of m drives over time, u = u(t) + kp (q_d - q) + kd (v_d - v), as a drive of ``integrate``.

    Of a motor with a ratio its coordinate over the ratio counts, and it gets the feedback over the ratio.

    Attributes:
        forces: N or N m, a column for each drive.
        index: of the drives among the coordinates, (m,).
        places: where their coordinates should be, over the ratios; None without feedback.
        ratio: of gears, (m,), or ones.
        gains: kp and kd.
        effort: greatest forces of drives, (n,), as of ``clipped``.
    """

    forces: Signal
    index: Index
    places: Signal | None
    ratio: Array
    gains: Gains
    effort: Array | None = None
    batched = True

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        u = np.zeros(q.shape)
        joint: Array | float = 0.0
        if self.places is not None:
            place, rate = _at(self.places, t)
            off, too_slow = place - q[..., self.index] / self.ratio, rate - v[..., self.index] / self.ratio
            joint = self.gains.kp * off + self.gains.kd * too_slow
        u[..., self.index] = _at(self.forces, t)[0] + joint / self.ratio
        return clipped(u, self.effort)

    def slopes(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return derivatives by q and v, (n, n) each."""
        slopes = np.zeros((2, q.size, q.size))
        if self.places is not None:
            square = self.ratio**2
            slopes[:, self.index, self.index] = -self.gains.kp / square, -self.gains.kd / square
        if self.effort is not None:  # what is clipped does not answer to the state
            slopes[:, np.abs(replace(self, effort=None)(t, q, v)) > self.effort] = 0.0
        return slopes[0], slopes[1]

    def standstill(self) -> SampledDrive:
        """Return the drives as they are at the first time, and their reference standing there."""
        first = float(self.forces.knots[0])
        places = None if self.places is None else Signal.constant(_at(self.places, first)[0])
        return replace(self, forces=Signal.constant(_at(self.forces, first)[0]), places=places)

    def load_data(self) -> DriveData:
        """Return the time-signal input for integrations in C."""
        torque = Track(self.forces, self.index)
        if self.places is None:
            return DriveData(torque=torque, effort=self.effort)
        program = Track(self.places, self.index)
        return DriveData(torque=torque, program=program, ratio=self.ratio, gains=self.gains, effort=self.effort)


def _at(signal: Signal, t: float) -> tuple[Array, Array]:
    """Return columns of a signal at a time and their rates, (columns,) each; constant outside of its knots."""
    knots, coefficients = signal.knots, signal.coefficients
    piece = int(np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2))
    ahead = float(np.clip(t, knots[0], knots[-1]) - knots[piece])
    powers = np.arange(coefficients.shape[1])
    rate = (powers[1:] * ahead ** powers[:-1]) @ coefficients[piece, 1:]
    return ahead**powers @ coefficients[piece], rate if knots[0] <= t <= knots[-1] else np.zeros_like(rate)
