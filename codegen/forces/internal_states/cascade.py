"""Drives of coordinates: controllers in cascade, a winding or a lag, as signals with their slopes.

    loop      x = kp e + ki I - D,  e = reference - measured,  y = x within its limits,
              I' = e + (y - x) / (ki T_t),    D = kd times the rate of what is measured, smoothed by a filter;
    winding   L i' = V - R i - k v,           force k i;
    lag       T F' = command - F.

The term of I' that leads back while the output is at its limit is back-calculation: K. J. Astrom, T. Hagglund, "PID
Controllers: Theory, Design, and Tuning", Instrument Society of America (1995), section 3.5.  A limit is exact: what is
beyond it has the slope 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from eomgen.robot.internal_states.drives import (
    CURRENT_LIMIT,
    INDUCTANCE,
    LAG,
    RESISTANCE,
    TORQUE_CONSTANT,
    VOLTAGE_LIMIT,
    has_winding,
    is_limited,
    loops_of,
    number_key,
)

from ...tree.spatial import Scalar, is_zero
from ..scalar_functions import Functions

Numbers = Mapping[str, Scalar]


@dataclass(frozen=True)
class Signal:
    """A value and its slopes by what it depends on: "s", "v", "u", and states by their names."""

    value: Scalar
    slopes: Mapping[str, Scalar]

    @classmethod
    def of(cls, name: str, value: Scalar) -> Signal:
        """Return what others depend on."""
        return cls(value, {name: 1.0})

    def __add__(self, other: Signal) -> Signal:
        slopes = dict(self.slopes)
        for name, slope in other.slopes.items():
            slopes[name] = slopes[name] + slope if name in slopes else slope
        return Signal(self.value + other.value, slopes)

    def __sub__(self, other: Signal) -> Signal:
        return self + other.times(-1.0)

    def times(self, factor: Scalar) -> Signal:
        """Return the signal times a number."""
        slopes = {name: factor * slope for name, slope in self.slopes.items()}
        return Signal(factor * self.value, {name: slope for name, slope in slopes.items() if not is_zero(slope)})

    def slope(self, name: str) -> Scalar:
        """Return the slope by what has that name."""
        return self.slopes.get(name, 0.0)

    def within(self, low: Signal, high: Signal, f: Functions) -> Signal:
        """Return the signal between two others; beyond them it has their slopes."""
        above, below = f.step(self.value - high.value), f.step(low.value - self.value)
        inside = (1.0 - above) - below
        whole = self.times(inside) + high.times(above) + low.times(below)
        return Signal(f.max(low.value, f.min(high.value, self.value)), whole.slopes)

    def limited(self, limit: Scalar, f: Functions) -> Signal:
        """Return the signal between -limit and limit."""
        return self.within(Signal(-1.0 * limit, {}), Signal(limit, {}), f)


@dataclass(frozen=True)
class Driven:
    """Action of a drive: force on its coordinate, voltage (0 without a winding), and rates of its states, by name."""

    force: Signal
    voltage: Signal
    rates: Mapping[str, Signal]


class Cascade:
    """A drive at the deviation s and the velocity v of its coordinate, with its states by name and its input u."""

    def __init__(self, numbers: Numbers, s: Scalar, v: Scalar, z: Mapping[str, Scalar], f: Functions) -> None:
        self.numbers, self.f = numbers, f
        self.states = {name: Signal.of(name, value) for name, value in z.items()}
        self.measured = {"position": Signal.of("s", s), "velocity": Signal.of("v", v)}
        if has_winding(numbers):
            self.measured["current"] = self.states["current"]
        self.rates: dict[str, Signal] = {}

    def driven(self, u: Signal) -> Driven:
        """Return what the drive does with an input."""
        loops, nothing = loops_of(self.numbers), Signal(0.0, {})
        signal = self._limits_behind(u, ("", *loops), 0)
        for place, loop in enumerate(loops):
            signal = self._loop(loop, signal, ("", *loops), place + 1)
        if has_winding(self.numbers):
            self.rates["current"] = self._current(signal)
            return Driven(self.states["current"].times(self.numbers[TORQUE_CONSTANT]), signal, self.rates)
        if LAG in self.numbers:
            force = self.states["force"]
            self.rates["force"] = (signal - force).times(1.0 / self.numbers[LAG])
            return Driven(force, nothing, self.rates)
        for name, state in self.states.items():
            self.rates.setdefault(name, state.times(-1.0))  # "input", which stays 0
        return Driven(signal, nothing, self.rates)

    def _current(self, voltage: Signal) -> Signal:
        numbers = self.numbers
        left = voltage - self.states["current"].times(numbers[RESISTANCE])
        left = left - self.measured["velocity"].times(numbers[TORQUE_CONSTANT])
        return left.times(1.0 / numbers[INDUCTANCE])

    def _loop(self, loop: str, reference: Signal, loops: Sequence[str], place: int) -> Signal:
        """Return the output of a loop within its limits; its states get their rates."""
        error = reference - self.measured[loop]
        output = error.times(self._number(loop, "kp")) if self._has(loop, "kp") else Signal(0.0, {})
        if self._has(loop, "kd"):
            output = output - self._rate(loop).times(self._number(loop, "kd"))
        integral = f"integral_{loop}"
        if self._has(loop, "ki"):
            output = output + self.states[integral].times(self._number(loop, "ki"))
        limited = output.limited(self._number(loop, "limit"), self.f) if self._has(loop, "limit") else output
        limited = self._limits_behind(limited, loops, place)
        if self._has(loop, "ki"):
            back = limited - output
            if is_limited(self.numbers, loop):
                error = error + back.times(1.0 / (self._number(loop, "ki") * self._number(loop, "tracking_time")))
            self.rates[integral] = error
        return limited

    def _rate(self, loop: str) -> Signal:
        """Return the rate of what a loop measures: the velocity is known, others are smoothed differences."""
        name = f"filter_{loop}"
        if not self._has(loop, "filter"):
            return self.measured["velocity"]
        state, inverse = self.states[name], 1.0 / self._number(loop, "filter")
        measured = self.measured["velocity" if loop == "position" else loop]
        self.rates[name] = (measured - state).times(inverse)
        return state if loop == "position" else self.rates[name]

    def _limits_behind(self, signal: Signal, loops: Sequence[str], place: int) -> Signal:
        """Return what comes behind a place in the chain takes of a signal: a current or a voltage within its limits."""
        numbers, f = self.numbers, self.f
        behind = loops[place + 1] if place + 1 < len(loops) else ""
        if behind == "current" and CURRENT_LIMIT in numbers:
            return signal.limited(numbers[CURRENT_LIMIT], f)
        if behind or not has_winding(numbers):
            return signal
        if CURRENT_LIMIT in numbers and "current" not in loops:
            induced = self.measured["velocity"].times(numbers[TORQUE_CONSTANT])
            most = Signal(numbers[RESISTANCE] * numbers[CURRENT_LIMIT], {})
            signal = signal.within(induced - most, induced + most, f)
        return signal.limited(numbers[VOLTAGE_LIMIT], f) if VOLTAGE_LIMIT in numbers else signal

    def _has(self, loop: str, name: str) -> bool:
        return number_key(loop, name) in self.numbers

    def _number(self, loop: str, name: str) -> Scalar:
        return self.numbers[number_key(loop, name)]
