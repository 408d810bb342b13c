"""Input signals of motions that are differentiated, and the sums of derivatives by their numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...runtime.calls import Calls
from ...runtime.raw import FFI, Library
from .input_signals import InputSignals, Signal, Slopes, jump_times
from .packed_inputs import PackedInputs
from .reading_inputs import clipped_signals, count_of, place_adjoint, place_prescribed, read_signals

Array = NDArray[np.float64]


class DifferentiatedInputs:
    """Input signals of all states, or of each of them, in motions that are differentiated.

    Args:
        kind: of the motion's function, "gradient" or "sensitivity".
        source: as of ``Kernel.rollout``.

    Raises:
        InputError: loads that are not allowed, or a mechanism's drives, through which C has no derivatives.
    """

    def __init__(self, calls: Calls, kind: str, source: Any, effort: Array | None = None) -> None:
        read = clipped_signals(calls, read_signals(calls, source), effort)
        self._calls, self._kind, self.is_shared = calls, kind, isinstance(read, InputSignals)
        self._each = [read] if isinstance(read, InputSignals) else read
        self._sums = [_sums(loads) for loads in self._each]
        self._kept: list[Any] = []
        self._stops: list[Array] | None = None
        for loads in self._each:
            if loads.drive.model is not None and loads.drive.model.mechanism is not None:
                raise InputError(
                    f"rollout_{kind}: loads: drive.model.mechanism has no derivatives; allowed: models without loops"
                )

    def end_steps(self) -> None:
        """Let steps end at all knots of signals, as they do where the error chooses them."""
        self._stops = [jump_times(loads, every=True) for loads in self._each]

    def again(self) -> DifferentiatedInputs:
        """Return the same inputs, with sums of derivatives that begin at zero."""
        other = DifferentiatedInputs(self._calls, self._kind, self._each[0] if self.is_shared else self._each)
        other._stops = self._stops
        return other

    def count(self, states: int | None) -> int | None:
        """Return the number of states with that of their loads, see ``count_of``."""
        return count_of(states, None if self.is_shared else self._each)

    def of(self, state: int) -> InputSignals:
        """Return the loads of a state."""
        return self._each[state if len(self._each) > 1 else 0]

    def placed(self, state: int, q: NDArray[Any], v: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return the state at which the motion begins, with prescribed coordinates where their motions begin."""
        at = q[np.newaxis].copy(), v[np.newaxis].copy()
        place_prescribed(self._calls, self.of(state), *at)
        return at[0][0], at[1][0]

    def back(self, state: int, by_q: NDArray[Any], by_v: NDArray[Any]) -> None:
        """Go back from derivatives by a placed state to those by the initial one, in place."""
        sums = self._sums[state if len(self._sums) > 1 else 0]
        tracks = [x for name, x in sums.items() if name.startswith(TRACK)]
        place_adjoint(self._calls, self.of(state), by_q, by_v, tracks)

    def packed(self, library: Library, state: int, slopes: Slopes | None = None) -> Any:
        """Return ``NAME_loads`` of a state, which lives as long as this object."""
        stops = np.zeros(0) if self._stops is None else self._stops[state if len(self._stops) > 1 else 0]
        self._kept.append(PackedInputs(library, self._calls, self.of(state), slopes=slopes, stops=stops))
        return self._kept[-1].pointer

    def slopes(self, library: Library, state: int) -> Any:
        """Return ``NAME_load_slopes`` of a state, the sums of derivatives by its loads."""
        sums = self._sums[state if len(self._sums) > 1 else 0]
        fields = {
            field: FFI.from_buffer("double[]", sums[name].reshape(-1)) for name, field in FIELDS.items() if name in sums
        }
        for field, begin in (("tracks", TRACK), ("wrench", WRENCH)):
            rows = [FFI.from_buffer("double[]", x.reshape(-1)) for name, x in sums.items() if name.startswith(begin)]
            if rows:
                fields[field] = library.ffi.new("double *[]", rows)
            self._kept.append(rows)
        self._kept.append(fields)
        return library.new("load_slopes", **fields)

    def every(self) -> Iterator[tuple[str, Array]]:
        """Yield derivatives by each component of the loads, with its name and the state's number."""
        for state, sums in enumerate(self._sums):
            yield from ((name if self.is_shared else f"{name} of state {state}", x) for name, x in sums.items())

    def by_name(self) -> dict[str, Array | float] | list[dict[str, Array | float]]:
        """Return derivatives by the components of the loads, of all states' or in a list of each."""
        gradients = [{name: float(x) if x.ndim == 0 else x for name, x in sums.items()} for sums in self._sums]
        return gradients[0] if self.is_shared else gradients


FIELDS = {
    "drive.torque": "torque",
    "drive.program": "program",
    "drive.gains.kp": "kp",
    "drive.gains.kd": "kd",
    "drive.model.bandwidth": "bandwidth",
}
TRACK, WRENCH = "prescribed.tracks[", "wrench["


def _sums(loads: InputSignals) -> dict[str, Array]:
    """Return zeros for derivatives by the numbers of loads: coefficients of signals, gains, a bandwidth."""
    drive, sums = loads.drive, dict[str, Array]()

    def of(signal: Signal) -> Array:
        return np.zeros(np.shape(signal.coefficients))

    if drive.torque is not None:
        sums["drive.torque"] = of(drive.torque.signal)
    if drive.program is not None:
        sums["drive.program"] = of(drive.program.signal)
    if drive.gains is not None:
        sums |= {f"drive.gains.{name}": np.zeros(np.shape(getattr(drive.gains, name))) for name in ("kp", "kd")}
    if drive.model is not None and drive.model.bandwidth is not None:
        sums["drive.model.bandwidth"] = np.zeros(())
    if loads.prescribed is not None:
        sums |= {f"{TRACK}{k}]": of(track.signal) for k, track in enumerate(loads.prescribed.tracks)}
    return sums | {f"{WRENCH}{k}]": of(wrench.signal) for k, wrench in enumerate(loads.wrenches)}
