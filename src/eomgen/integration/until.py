"""Terminal events of motions: a coordinate, or the distance of a frame from a point, reaches a value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import InputError
from ..kernel.complete import Kernel
from ..names import listed, nearest, show
from ..robot.coordinates import unit_of
from ..runtime.arrays import numbers_in

HALVINGS = 52  # of a step, to the last bit of a time
CORRECTIONS = 6  # of a time, by secants


def bisected(low: float, high: float, is_before: Callable[[float], bool]) -> float:
    """Return the time between two at which something changes, s, to the last bit, from behind."""
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_before(middle) else (low, middle)
    return high


@dataclass(eq=False)
class Reached(Exception):
    """The end of a motion that has reached its terminal event.

    Attributes:
        t: s.
        state: there, (q, v, z).
        at: t -> the state before; None where samples before are taken.
        begins: time and state at the beginning of the step.
        until: what is reached.
    """

    t: float
    state: Array
    at: Callable[[float], Array] | None
    begins: tuple[float, Array]
    until: Until

    def exactly(self, move: Callable[[float, Array, float], Array]) -> Reached:
        """Refine the event by steps to its time, instead of a polynomial between two steps' ends.

        Args:
            move: t, state there, and a later time -> the state then.
        """
        (t0, y0), t = self.begins, self.t
        before, gap0, state = t0, float(self.until.of(y0[np.newaxis])[0]), self.state
        for _ in range(CORRECTIONS):
            state = move(t0, y0, t)
            gap = float(self.until.of(state[np.newaxis])[0])
            change = -gap * (t - before) / (gap - gap0) if gap != gap0 else 0.0
            if abs(change) <= 4.0 * np.spacing(t) or not t0 < t + change:
                break
            before, gap0, t = t, gap, t + change
        else:
            state = move(t0, y0, t)
        return Reached(t, state, None, self.begins, self.until)


@dataclass(frozen=True, eq=False)
class Until:
    """A terminal event: a number of the motion's states reaches a value, from either side.

    Attributes:
        text: what is reached, for notes.
        n: number of coordinates.
        beyond: (q, v), (N, n) each, v with internal states behind -> how far the number is beyond the value, (N,).
    """

    text: str
    n: int
    beyond: Callable[[Array, Array], Array]

    @classmethod
    def coordinate(cls, kernel: Kernel, name: str, value: float) -> Until:
        """Return the event that a coordinate, or an internal state by its name, reaches a value, m or rad.

        Raises:
            InputError: there is no coordinate or state of that name, or the value is not finite.
        """
        names = kernel.calls.rate_names
        if name not in names:
            raise InputError(f"until: {show(name)}{nearest(name, names)} is no coordinate; allowed: {listed(names)}")
        _refuse_not_finite("value", value)
        i = names.index(name)
        if name in kernel.internal_states:
            unit = kernel.internal_state_units[kernel.internal_states.index(name)]
            return cls(f"{name} = {value:g} {unit}", kernel.n, lambda q, v: v[:, i] - value)
        return cls(f"{name} = {value:g} {unit_of(name)}", kernel.n, lambda q, v: q[:, i] - value)

    @classmethod
    def distance(cls, kernel: Kernel, frame: str, point: ArrayLike, distance: float) -> Until:
        """Return the event that a frame's or link's origin is at a distance, m, from a point, (3,), m, base frame.

        Raises:
            InputError: there is no such frame, a number is not finite, or the distance is not greater than 0.
        """
        if frame not in kernel.frames:
            raise InputError(
                f"until: {show(frame)}{nearest(frame, kernel.frames)} is no frame; allowed: {listed(kernel.frames)}"
            )
        allowed = "three finite numbers, m"
        place = numbers_in("until: point", point, allowed)
        if place.shape != (3,):
            raise InputError(f"until: point: got {show(point)}; allowed: {allowed}")
        _refuse_not_finite("distance", distance)
        if not distance > 0.0:
            raise InputError(f"until: distance: got {distance!r}; allowed: a distance in m greater than 0")

        def beyond(q: Array, v: Array) -> Array:
            origin = np.asarray(kernel.frame_pose(np.ascontiguousarray(q), frame))[:, :3, 3]
            return np.asarray(np.linalg.norm(origin - place, axis=1) - distance)

        return cls(f"{frame} at {distance:g} m from {place.tolist()}", kernel.n, beyond)

    def look(self, times: Array, states: Array, at: Callable[[float], Array]) -> None:
        """Look for the value between successive states, (k, size), at times, (k,), s.

        Args:
            times, states: of the ends of steps.
            at: t -> the state between.

        Raises:
            Reached: it is there.
        """
        side = self.of(states) >= 0.0
        if (side[1:] == side[:-1]).all():
            return
        k = int((side[1:] != side[:-1]).argmax())
        begin, end = float(times[k]), float(times[k + 1])
        t = bisected(begin, end, lambda t: bool((self.of(at(t)[np.newaxis])[0] >= 0.0) == side[k]))
        raise Reached(t, at(t), at, (begin, states[k]), self)

    def of(self, states: Array) -> Array:
        """Return the number less the value in states (q, v, z), (N, size), (N,)."""
        return self.beyond(states[:, : self.n], states[:, self.n :])


def _refuse_not_finite(label: str, number: float) -> None:
    if not np.isfinite(number):
        raise InputError(f"until: {label}: got {number!r}; allowed: finite numbers")
