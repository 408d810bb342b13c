"""Feed-forward of a motion as a result: samples for controllers, files, and a drive for integrations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from ..arrays import Array, Index
from ..errors import InputError
from ..names import show
from ..results.kinds import Kind, SavedColumns, declare
from ..results.stored import Stored
from ..robot.coordinates import force_unit_of, index_of, unit_of
from ..runtime.stepping.input_signals import DriveData, Signal, Track
from ..shown import Shown
from ..tabular import Rows, TableColumn, Tabular

DEGREES = (1, 3, 5)  # of splines through samples of drives


@dataclass(frozen=True, kw_only=True)
class FeedForward(Shown, Tabular, SavedColumns):
    """Positions, velocities and torques of drives by which links follow a motion without feedback.

    Attributes:
        robot: the robot's name.
        t: times, (T,), s.
        q, v, a: coordinates, motors among them, velocities and accelerations, (T, n).
        u: drives, (T, n), N or N m; zero at coordinates without one.
        coordinates: names, (n,).
        driven: names of the coordinates with a drive, (m,).
        residual: the largest force, N or N m, that drives leave at each coordinate, (n,): of Coulomb friction at links.
        jump_times: times, (J,), s, at which drives jump.
        jump_orders: the lowest time derivative of the motion that jumps there, (J,).
        notes: lines about what was assumed.
    """

    robot: str
    t: Annotated[Array, Stored(("T",), "s")]
    q: Annotated[Array, Stored(("T", "n"), "m, rad")]
    v: Annotated[Array, Stored(("T", "n"), "m/s, rad/s")]
    a: Annotated[Array, Stored(("T", "n"), "m/s^2, rad/s^2")]
    u: Annotated[Array, Stored(("T", "n"), "N, N m")]
    coordinates: Annotated[tuple[str, ...], Stored(("n",), of=str)]
    driven: Annotated[tuple[str, ...], Stored(("m",), of=str)]
    residual: Annotated[Array, Stored(("n",), "N, N m")]
    jump_times: Annotated[Array, Stored(("J",), "s")]
    jump_orders: Annotated[Array, Stored(("J",))]
    notes: tuple[str, ...] = ()

    def of(self, coordinate: str) -> tuple[Array, Array, Array, Array]:
        """Return position, velocity, acceleration and drive of a coordinate, (T,) each; InputError if there is none."""
        if coordinate not in self.coordinates:
            raise InputError(f"coordinate: {show(coordinate)} is unknown; known: {', '.join(self.coordinates)}")
        i = self.coordinates.index(coordinate)
        return self.q[:, i], self.v[:, i], self.a[:, i], self.u[:, i]

    def drive(self, degree: int = 5) -> SampledDrive:
        """Return the drives over time, as ``integrate`` takes them: a spline of this degree through their samples.

        Args:
            degree: 1, straight lines as a controller that interpolates makes them, 3 or 5.

        Raises:
            InputError: another degree, too few samples for it, or SciPy is not installed.
        """
        if degree not in DEGREES or len(self.t) <= degree:
            raise InputError(
                f"degree: {show(degree)} for {len(self.t)} samples; allowed: {', '.join(map(str, DEGREES))}, less than"
                " there are samples"
            )
        place = index_of(self.coordinates, self.driven)
        forces = self.u[:, place]
        if degree == 1:
            signal = Signal.through(self.t, forces)
        else:
            from ..motion.splines import Spline

            signal = Spline(self.t, forces, at_rest=False, degree=degree).as_signal()
        return SampledDrive(signal, np.asarray(place), len(self.coordinates))

    def as_rows(self) -> Rows:
        """Return a row per time: every coordinate with .rate and .acceleration, drives with .drive."""
        units = {"": "{}", ".rate": "{}/s", ".acceleration": "{}/s^2"}
        columns = []
        for name, values in self.columns().items():
            stem, suffix = next(((x, name[len(x) :]) for x in self.coordinates if name.startswith(x)), (name, ""))
            unit = units.get(suffix)
            if name != "t":
                unit = force_unit_of(stem) if unit is None else unit.format(unit_of(stem))
                columns.append(TableColumn(name, unit, values))
        return Rows("t", "s", self.t, columns, {"robot": self.robot})

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        columns = {name: x.tolist() for name, x in self.columns().items()}
        return {
            "robot": self.robot,
            "driven": list(self.driven),
            "columns": columns,
            "residual": dict(zip(self.coordinates, self.residual.tolist(), strict=True)),
            "jumps": [
                {"t": t, "order": round(order)}
                for t, order in zip(self.jump_times.tolist(), self.jump_orders.tolist(), strict=True)
            ],
            "notes": list(self.notes),
        }

    def lines(self) -> list[str]:
        """Return how far, how fast and how hard drives move, for people."""
        lines = [f"{self.robot}: feed-forward, {len(self.t)} samples from {self.t[0]:g} to {self.t[-1]:g} s", ""]
        lines.append(f"{'drive':<24}{'from':>12}{'to':>12}{'fastest':>12}{'largest force':>16}  unit")
        for name in self.driven:
            q, v, _, u = self.of(name)
            force = f"{np.abs(u).max():>16.5g}  {force_unit_of(name)}"
            lines.append(f"{name:<24}{q.min():>12.5g}{q.max():>12.5g}{np.abs(v).max():>12.5g}{force}")
        return lines + [f"note: {note}" for note in self.notes]

    def columns(self) -> dict[str, Array]:
        """Return columns by name, (T,) each, as ``read_motion`` reads them: t, NAME, .rate, .acceleration, .drive."""
        columns = {"t": self.t}
        for suffix, values in (("", self.q), (".rate", self.v), (".acceleration", self.a)):
            columns |= {f"{name}{suffix}": values[:, i] for i, name in enumerate(self.coordinates)}
        return columns | {f"{name}.drive": self.of(name)[3] for name in self.driven}


@dataclass(frozen=True, eq=False)
class SampledDrive:
    """Forces of drives over time, whatever the state, as a drive of ``integrate``.

    Attributes:
        signal: one column for each drive.
        place: of these among the coordinates, (m,).
        n: number of coordinates.
    """

    signal: Signal
    place: Index
    n: int
    batched = True

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        knots = self.signal.knots
        piece = int(np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2))
        ahead = float(np.clip(t, knots[0], knots[-1]) - knots[piece])
        u = np.zeros(q.shape)
        u[..., self.place] = ahead ** np.arange(self.signal.coefficients.shape[1]) @ self.signal.coefficients[piece]
        return u

    def load_data(self) -> DriveData:
        """Return the time-signal input for integrations in C."""
        return DriveData(torque=Track(self.signal, self.place))


def _check(result: FeedForward, path: str) -> None:
    """Refuse a file whose drives are no coordinates of it."""
    others = [name for name in result.driven if name not in result.coordinates]
    if others or len(result.t) < 1:
        raise InputError(f"{path}: driven has {show(others[0]) if others else 'no times'}; allowed: its coordinates")


declare(Kind("feedforward", FeedForward, check=_check))
