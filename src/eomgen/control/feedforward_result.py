"""Feed-forward of a motion as a result: samples for controllers, files, and a drive for integrations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import InputError
from ..kernel.stepping.input_signals import Gains, Signal
from ..motion.splines import Spline
from ..names import listed, show
from ..results.kinds import Kind, SavedColumns, declare
from ..results.stored import Stored
from ..robot.coordinates import force_unit_of, index_of, unit_of
from ..robot.value import MOTOR
from ..runtime.arrays import numbers_in
from ..scenario.value import Scenario
from ..shown import Shown
from ..simulation.sampled_drive import SampledDrive
from ..tabular import Rows, TableColumn, Tabular

DEGREES = (1, 3, 5)  # of splines through samples of drives
SHOWN = 4  # coordinates that a line names


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
        outputs: what follows the motion where deviations have no drive; () where all links do.
        inverted: names of coordinates without a drive that a stable inversion found, with all others; () without one.
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
    outputs: Annotated[tuple[str, ...], Stored(otherwise=())] = ()
    inverted: Annotated[tuple[str, ...], Stored(otherwise=())] = ()

    def of(self, coordinate: str) -> tuple[Array, Array, Array, Array]:
        """Return position, velocity, acceleration and drive of a coordinate, (T,) each; InputError if there is none."""
        if not isinstance(coordinate, str) or coordinate not in self.coordinates:
            raise InputError(f"coordinate: {show(coordinate)} is unknown; known: {', '.join(self.coordinates)}")
        i = self.coordinates.index(coordinate)
        return self.q[:, i], self.v[:, i], self.a[:, i], self.u[:, i]

    def drive(self, degree: int = 5, kp: ArrayLike = 0.0, kd: ArrayLike = 0.0) -> SampledDrive:
        """Return the drives over the time since the first sample, as ``integrate`` takes them: splines of samples.

        Args:
            degree: 1, straight lines as a controller that interpolates makes them, 3 or 5.
            kp, kd: of a PD law about the drives' own coordinates: N/m or N m/rad, and times s, one or one for each.

        Raises:
            InputError: another degree, too few samples for it, gains that are none, or SciPy is not installed.
        """
        if not isinstance(degree, int) or degree not in DEGREES or len(self.t) <= degree:
            raise InputError(
                f"degree: {show(degree)} for {len(self.t)} samples; allowed: {', '.join(map(str, DEGREES))}, less than"
                " there are samples"
            )
        place = np.asarray(index_of(self.coordinates, self.driven))
        gains = Gains(*(_gain(name, x, place.size) for name, x in (("kp", kp), ("kd", kd))))
        t = self.t - self.t[0]

        def through(samples: Array) -> Signal:
            if degree == 1:
                return Signal.through(t, samples)
            return Spline(t, samples, at_rest=False, degree=degree).as_signal()

        places = through(self.q[:, place]) if gains.kp.any() or gains.kd.any() else None
        return SampledDrive(through(self.u[:, place]), place, places, np.ones(place.size), gains)

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
            "outputs": list(self.outputs),
            "inverted": list(self.inverted),
            "notes": list(self.notes),
        }

    def lines(self) -> list[str]:
        """Return how far, how fast and how hard drives move, for people."""
        lines = [f"{self.robot}: feed-forward, {len(self.t)} samples from {self.t[0]:g} to {self.t[-1]:g} s"]
        lines += [*(f"  {way}" for way in self.ways()), ""]
        lines.append(f"{'drive':<24}{'from':>12}{'to':>12}{'fastest':>12}{'largest force':>16}  unit")
        for name in self.driven:
            q, v, _, u = self.of(name)
            force = f"{np.abs(u).max():>16.5g}  {force_unit_of(name)}"
            lines.append(f"{name:<24}{q.min():>12.5g}{q.max():>12.5g}{np.abs(v).max():>12.5g}{force}")
        return lines + [f"note: {note}" for note in self.notes]

    def ways(self) -> list[str]:
        """Return how coordinates were found, in lines."""
        if self.inverted:
            return [
                f"by stable inversion: all coordinates; no drive have {listed(self.inverted, SHOWN)}",
                f"what follows the motion: {', '.join(self.outputs)}",
            ]
        motors = [name for name in self.driven if name.endswith(f".{MOTOR}")]
        return [f"by springs and dampers of elastic gears: {', '.join(motors)}"] if motors else []

    def columns(self) -> dict[str, Array]:
        """Return columns by name, (T,) each, as ``read_motion`` reads them: t, NAME, .rate, .acceleration, .drive."""
        columns = {"t": self.t}
        for suffix, values in (("", self.q), (".rate", self.v), (".acceleration", self.a)):
            columns |= {f"{name}{suffix}": values[:, i] for i, name in enumerate(self.coordinates)}
        return columns | {f"{name}.drive": self.of(name)[3] for name in self.driven}


def _gain(name: str, values: ArrayLike, size: int) -> Array:
    """Return a gain of every drive, (size,)."""
    gains = numbers_in(name, values, "numbers from 0 on")
    if gains.shape not in ((), (size,)) or not (gains >= 0.0).all():
        raise InputError(f"{name}: {show(values)}; allowed: a number from 0 on, or one for each of {size} drives")
    return np.asarray(np.broadcast_to(gains, (size,)))


def left_out(scenario: Scenario) -> tuple[str, ...]:
    """Return a note about what of a scenario is not in a feed-forward; () without any."""
    left = [key for key in ("wrenches", "payloads") if getattr(scenario, key)]
    return (f"{' and '.join(left)} of the scenario are not in the feed-forward",) if left else ()


def _check(result: FeedForward, path: str) -> None:
    """Refuse a file whose drives are no coordinates of it."""
    others = [name for name in result.driven if name not in result.coordinates]
    if others or len(result.t) < 1:
        raise InputError(f"{path}: driven has {show(others[0]) if others else 'no times'}; allowed: its coordinates")


declare(Kind("feedforward", FeedForward, check=_check))
