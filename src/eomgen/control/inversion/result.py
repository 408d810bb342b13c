"""Results of stable inversions: drives and all coordinates over time, with which outputs follow a motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Index
from ...errors import InputError
from ...kernel.stepping.input_signals import DriveData, Gains, Track
from ...limits import LARGEST, is_usable
from ...motion.splines import Spline
from ...names import show
from ...results.kinds import Kind, Saved, declare
from ...results.stored import Stored
from ...robot.coordinates import force_unit_of, index_of, unit_of
from ...shown import Shown, prefixed
from ...tabular import Rows, TableColumn, Tabular

Complex = NDArray[np.complex128]


class InverseDrive:
    """Drives of a stable inversion over the time since its first sample, with a PD law about its coordinates.

    As ``integrate`` takes them: called with t, q and v of (n,) or (N, n), and followed by a kernel's C.
    """

    batched = True

    def __init__(self, result: StableInversion, bandwidth: float) -> None:
        self._index: Index = np.asarray(index_of(result.coordinates, result.drives), dtype=np.intp)
        t = result.t - result.t[0]
        self._force = Spline(t, result.u, at_rest=False)
        self._place = Spline(t, result.q[:, self._index], at_rest=False)
        self._gains = Gains(bandwidth**2 * result.inertia, 2.0 * bandwidth * result.inertia)

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        place, rate, _ = self._place.at(t)
        u = np.zeros_like(q)
        off, too_slow = place - q[..., self._index], rate - v[..., self._index]
        u[..., self._index] = self._force.at(t)[0] + self._gains.kp * off + self._gains.kd * too_slow
        return u

    def slopes(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return derivatives by q and v, (n, n) each."""
        slopes = np.zeros((2, q.size, q.size))
        slopes[:, self._index, self._index] = -self._gains.kp, -self._gains.kd
        return slopes[0], slopes[1]

    def load_data(self) -> DriveData:
        """Return the time-signal input for integrations in C."""
        force, place = Track(self._force.as_signal(), self._index), Track(self._place.as_signal(), self._index)
        return DriveData(torque=force, program=place, ratio=np.ones(self._index.size), gains=self._gains)


@dataclass(frozen=True, kw_only=True)
class StableInversion(Shown, Tabular, Saved):
    """Drives and motion of all coordinates by which outputs follow a motion, at T samples; z finite zeros.

    Attributes:
        robot: its name.
        outputs: what follows the motion, m names.
        drives: coordinates at which drives act, m.
        coordinates: of the robot, n.
        t: times of the samples, (T,), s; the motion itself begins at 0 and ends at ``duration``.
        duration: of the motion, s.
        q, v: coordinates and velocities, (T, n).
        u: forces of drives, (T, m), N or N m.
        inertia: of the drives' coordinates at the first sample, (m,), kg or kg m^2.
        zeros: from drives to outputs at the beginning, (z,), rad/s; those that samples resolve.
        history: greatest change of a coordinate in each of Newton's iterations, m or rad.
        change: of a coordinate when steps were halved last, m or rad, of a motor over its ratio; 0 of a given step.
        residual: greatest force that coordinates without a drive lack at the samples, N or N m.
        between: greatest displacement of one by what they lack halfway between the samples, over their stiffness at
            the first one, m or rad; those without a stiffness do not count.
        ends: greatest distance of a coordinate from static equilibrium at the first and the last sample, m or rad.
        notes: lines about what was assumed and what remains.
    """

    robot: str
    outputs: tuple[str, ...]
    drives: tuple[str, ...]
    coordinates: tuple[str, ...]
    t: Annotated[Array, Stored(("T",), "s")]
    duration: float
    q: Annotated[Array, Stored(("T", "n"), "m, rad")]
    v: Annotated[Array, Stored(("T", "n"), "m/s, rad/s")]
    u: Annotated[Array, Stored(("T", "m"), "N, N m")]
    inertia: Annotated[Array, Stored(("m",), "kg, kg m^2")]
    zeros: Annotated[Complex, Stored(("z",), "rad/s", of=complex)]
    history: tuple[float, ...]
    residual: float
    between: float
    ends: tuple[float, float]
    notes: tuple[str, ...]
    change: Annotated[float, Stored(otherwise=0.0)] = 0.0

    method = "collocation by splines of degree 5, Newton's method, the bounded motion of least norm"

    def drive(self, bandwidth: float = 0.0) -> InverseDrive:
        """Return the drives for ``integrate``, whose time begins at the first sample: t - t[0].

        Args:
            bandwidth: of a PD law about the drives' own coordinates, rad/s, critically damped; 0 for none.

        Raises:
            InputError: the bandwidth is none.
        """
        if not (is_usable(bandwidth) and bandwidth >= 0.0):
            raise InputError(f"bandwidth: {show(bandwidth)} rad/s; allowed: 0, or a number up to {LARGEST:g}")
        return InverseDrive(self, float(bandwidth))

    @cached_property
    def rates(self) -> tuple[float, float]:
        """Slowest decay (negative) and slowest growth of the zeros, 1/s; 0 where there is none."""
        real = self.zeros.real
        return float(real[real < 0.0].max(initial=-np.inf)), float(real[real > 0.0].min(initial=np.inf))

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {
            "robot": self.robot,
            "outputs": list(self.outputs),
            "drives": list(self.drives),
            "samples": int(self.t.size),
            "first": float(self.t[0]),
            "last": float(self.t[-1]),
            "duration": self.duration,
            "largest_force": dict(zip(self.drives, np.abs(self.u).max(axis=0).tolist(), strict=True)),
            "zeros": [[z.real, z.imag] for z in self.zeros.tolist()],
            "method": self.method,
            "history": list(self.history),
            "change": self.change,
            "residual": self.residual,
            "between": self.between,
            "ends": list(self.ends),
            "notes": list(self.notes),
        }

    def as_rows(self) -> Rows:
        """Return a row per time: positions, velocities and forces of the drives."""
        index = index_of(self.coordinates, self.drives)
        columns = []
        for place, values, unit in (("q", self.q[:, index], ""), ("v", self.v[:, index], "/s")):
            columns += [
                TableColumn(f"{place}.{name}", unit_of(name) + unit, x)
                for name, x in zip(self.drives, values.T, strict=True)
            ]
        columns += [
            TableColumn(f"u.{name}", force_unit_of(name), x) for name, x in zip(self.drives, self.u.T, strict=True)
        ]
        return Rows("t", "s", self.t, columns, {"robot": self.robot})

    def lines(self) -> list[str]:
        """Return what was found, for people."""
        stable, unstable = (int((sign * self.zeros.real > 0.0).sum()) for sign in (-1, 1))
        zeros = f"{stable} stable, {unstable} unstable"
        if self.zeros.size:
            zeros += f", real parts from {self.zeros.real.min():.4g} to {self.zeros.real.max():.4g} 1/s"
        halved = f"; the last halving changed coordinates by {self.change:.2g} m or rad" if self.change else ""
        lines = [
            f"{self.robot}: stable inversion, {self.t.size} samples from {self.t[0]:g} to {self.t[-1]:g} s",
            f"  outputs: {', '.join(self.outputs)}",
            f"  method: {self.method}; {len(self.history)} iterations",
            f"  steps of {prefixed(2.0 * (self.t[-1] - self.t[0]) / (self.t.size - 1), 's', 4)}{halved}",
            f"  zeros that samples resolve: {zeros}",
            f"  left at the samples {self.residual:.3g} N or N m; between them {self.between:.3g} m or rad",
            f"  from rest by {self.ends[0]:.3g} m or rad at the first sample, {self.ends[1]:.3g} at the last",
        ]
        for name, force in zip(self.drives, np.abs(self.u).max(axis=0).tolist(), strict=True):
            lines.append(f"  {name}: up to {prefixed(force, force_unit_of(name), 4)}")
        return lines + [f"note: {note}" for note in self.notes]


def _sizes(result: StableInversion) -> dict[str, int]:
    return {
        "T": result.t.size,
        "n": len(result.coordinates),
        "m": len(result.drives),
        "z": result.zeros.size,
    }


def _check(result: StableInversion, path: str) -> None:
    if (np.diff(result.t) <= 0.0).any():
        raise InputError(f"{path}: array t does not increase; allowed: increasing times")
    if len(result.outputs) != len(result.drives) or not set(result.drives) <= set(result.coordinates):
        raise InputError(f"{path}: outputs or drives do not go with its coordinates; allowed: as many of both")


load_stable_inversion = declare(Kind("stable_inversion", StableInversion, sizes=_sizes, check=_check))
"""Read the result that ``StableInversion.save`` wrote; InputError says what in the file is wrong."""
