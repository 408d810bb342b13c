"""Input signals as users hand them over, data or objects that have some, read and checked before C follows them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import ArrayError, InputError
from ...names import listed, show
from ...runtime.arrays import numbers_in
from ...runtime.bound import place_of_wrench, wrench_numbers, wrench_rows
from ...runtime.calls import Calls
from .input_signals import DriveData, InputSignals, LinkWrench, ModelDrive, Signal, Track, Waves
from .saturation import check_efforts, shared_drives, with_efforts

Array = NDArray[np.float64]

InputsLike = InputSignals | Mapping[str, Any]  # of a state

KEYS = ("drive", "wrench", "prescribed")
OWN = "or an object whose load_data() gives that"


def signals_of(source: Any) -> Any:
    """Return the data of an object that has some, by its method ``load_data``; None of another one."""
    signals: Callable[[], Any] | None = getattr(source, "load_data", None)
    return None if signals is None else signals()


def input_signals(calls: Calls, drive: Any = None, wrench: Any = None, prescribed: Any = None) -> InputSignals:
    """Return loads of what ``integrate`` takes by these names, and ``rollout``.

    Args:
        drive: a DriveData, or an object whose ``load_data()`` gives it.
        wrench: LinkWrenches, an object whose ``load_data()`` gives them, or wrenches that stay, (links, 6) or by frame
            or link.
        prescribed: Waves, or an object whose ``load_data()`` gives them.

    Raises:
        InputError: one is something else; what is in them is left to ``check_signals``.
    """
    spans = [(getattr(x, "first", -np.inf), getattr(x, "last", np.inf)) for x in (drive, wrench)]
    first, last = max(x for x, _ in spans), min(x for _, x in spans)
    forces = DriveData() if drive is None else _one(drive, DriveData, "drive")
    waves = None if prescribed is None else _one(prescribed, Waves, "prescribed")
    return InputSignals(forces, _wrenches(calls, wrench), waves, first, last)


def _one(source: Any, kind: type[Any], label: str) -> Any:
    """Return the data of an object, or what is data itself."""
    signals = source if isinstance(source, kind) else signals_of(source)
    if not isinstance(signals, kind):
        raise InputError(f"loads: {label}: got {show(source)}; allowed: {kind.__name__}, {OWN}")
    return signals


def _wrenches(calls: Calls, source: Any) -> Sequence[LinkWrench]:
    """Return wrenches as data; of wrenches that stay what they are those of links that have one."""
    wrenches = source if signals_of(source) is None else signals_of(source)
    if wrenches is None:
        return []
    if isinstance(wrenches, Mapping):
        return link_wrenches(calls, wrenches)
    if isinstance(wrenches, (list, tuple)) and all(isinstance(wrench, LinkWrench) for wrench in wrenches):
        return wrenches
    links = len(calls.raw.libraries.meta["links"])
    allowed = f"LinkWrenches, finite numbers of shape ({links}, 6), wrenches by frame or link, {OWN}"
    rows = numbers_in("loads: wrench", wrenches, allowed)
    if rows.shape != (links, 6):
        raise ArrayError(f"loads: wrench: got {show(source)}; allowed: {allowed}")
    return [LinkWrench(link, Signal.constant(row)) for link, row in enumerate(rows) if row.any()]


def read_signals(calls: Calls, source: Any) -> InputSignals | list[InputSignals]:
    """Return loads of a rollout: of all states, or a list with those of each.

    Args:
        source: InputSignals, a mapping from names of ``KEYS`` to what ``input_signals`` takes, or a sequence of these.

    Raises:
        InputError: they are something else, or do not fit the robot.
    """
    if isinstance(source, (list, tuple)):
        if not source:
            raise InputError("rollout: loads = []; allowed: loads of one state at least")
        return [_read(calls, signals) for signals in source]
    return _read(calls, source)


def _read(calls: Calls, source: Any) -> InputSignals:
    if isinstance(source, Mapping):
        for key in source:
            if key not in KEYS:
                raise InputError(f"rollout: loads: {show(key)} is unknown; allowed: {', '.join(KEYS)}")
        source = input_signals(calls, **source)
    if not isinstance(source, InputSignals):
        raise InputError(
            f"rollout: loads = {show(source)}; allowed: InputSignals, a mapping from {', '.join(KEYS)}, or a list of"
            " these, one for every state"
        )
    check_signals(calls, source)
    return source


def count_of(states: int | None, loads: InputSignals | Sequence[InputSignals] | None) -> int | None:
    """Return the number of states, of their loads too where each has different ones; None for a single one.

    Raises:
        ArrayError: another number of loads than of states.
    """
    if loads is None or isinstance(loads, InputSignals):
        return states
    if states not in (None, 1) and len(loads) not in (1, states):
        raise ArrayError(f"rollout: {len(loads)} states in loads, but {states} in other arrays")
    return max(states or 1, len(loads))


def clipped_signals(
    calls: Calls, loads: InputSignals | list[InputSignals], effort: Array | None
) -> InputSignals | list[InputSignals]:
    """Return loads that were read, their drives clipped at these efforts, if there are any; checked once more."""
    clipped = with_efforts(loads, effort)
    for signals in ([clipped] if isinstance(clipped, InputSignals) else clipped) if effort is not None else ():
        check_signals(calls, signals)
    return clipped


def check_signals(calls: Calls, loads: InputSignals) -> None:
    """Refuse loads that do not fit a robot: C follows them without looking.

    Raises:
        InputError: shapes, places or numbers are not allowed; says which.
    """
    drive, waves = loads.drive, loads.prescribed
    moved = () if waves is not None else calls.prescribed  # without motions their drives are accelerations
    free = [i for i, name in enumerate(calls.coordinates) if name not in moved]
    _check_times("first and last", loads.first, loads.last)
    if drive.torque is not None:
        _check_track("drive.torque", drive.torque, free)
    if drive.program is not None:
        _check_track("drive.program", drive.program, free)
        columns = drive.program.signal.columns
        if drive.ratio is not None:
            _check_numbers("drive.ratio", drive.ratio, (columns,), nonzero=True)
        for label in ("kp", "kd") if drive.gains is not None else ():
            _check_numbers(f"drive.gains.{label}", getattr(drive.gains, label), (columns,))
    elif drive.gains is not None or drive.model is not None:
        _refuse("drive.program", None, "a Track that gains and model follow")
    if drive.effort is not None:
        _check_efforts(calls, drive)
    if drive.model is not None:
        _check_model(calls, drive.model, drive.program, 0 if waves is None else len(waves.wave))
    if waves is not None:
        count = len(calls.prescribed)
        if count == 0:
            _refuse("prescribed", waves, "nothing, as no coordinate is prescribed")
        _check_numbers("prescribed.wave", waves.wave, (count, 4))
        for k, track in enumerate(waves.tracks):
            _check_track(f"prescribed.tracks[{k}]", track, range(count))
    for k, wrench in enumerate(loads.wrenches):
        _check_wrench(f"wrench[{k}]", wrench, len(calls.raw.libraries.meta["links"]))


def _refuse(label: str, got: object, allowed: str) -> None:
    raise InputError(f"loads: {label}: got {show(got)}; allowed: {allowed}")


def _check_numbers(label: str, values: ArrayLike, shape: tuple[int, ...], *, nonzero: bool = False) -> Array:
    """Return the numbers, finite and of the shape, in which -1 stands for any length from 1 on."""
    named = ", ".join("any" if x < 0 else str(x) for x in shape)
    kind = "finite numbers, none 0," if nonzero else "finite numbers"
    allowed = f"{kind} of shape ({named}{',' if len(shape) == 1 else ''})"
    numbers = numbers_in(f"loads: {label}", values, allowed)
    fits = numbers.ndim == len(shape) and all(
        x == wanted or (wanted < 0 < x) for x, wanted in zip(numbers.shape, shape, strict=True)
    )
    if not fits or (nonzero and not numbers.all()):
        _refuse(label, values, allowed)
    return numbers


def _check_times(label: str, first: Any, last: Any) -> None:
    """Refuse what is no pair of times, which may be infinite."""
    times = numbers_in(f"loads: {label}", [first, last], "times, s", finite=False)
    if times.shape != (2,) or np.isnan(times).any():
        _refuse(label, (first, last), "times, s")


def _check_places(label: str, places: Any, allowed: Sequence[int], count: int) -> None:
    """Refuse places that are not so many whole numbers among those that are allowed."""
    try:
        indices = np.asarray(places)
    except ValueError:  # rows of different lengths
        indices = np.zeros(0)
    if indices.shape != (count,) or indices.dtype.kind not in "iu" or not np.isin(indices, list(allowed)).all():
        _refuse(label, places, f"{count} whole numbers among {', '.join(map(str, allowed))}")


def _check_signal(label: str, signal: Any, columns: int = -1, *, inner: bool = False) -> None:
    if not isinstance(signal, Signal):
        _refuse(label, signal, "a Signal")
    if not isinstance(signal.coefficients, np.ndarray):
        _refuse(f"{label}.coefficients", signal.coefficients, "a NumPy array")
    coefficients = _check_numbers(f"{label}.coefficients", signal.coefficients, (-1, -1, columns))
    knots = _check_numbers(f"{label}.knots", signal.knots, (len(coefficients) + 1,))
    if not (np.diff(knots) > 0.0).all():
        _refuse(f"{label}.knots", signal.knots, "numbers that increase")
    if signal.profile is not None:
        if inner:
            _refuse(f"{label}.profile", signal.profile, "none of a profile itself")
        _check_signal(f"{label}.profile", signal.profile, 1, inner=True)


def _check_track(label: str, track: Any, allowed: Sequence[int]) -> None:
    if not isinstance(track, Track):
        _refuse(label, track, "a Track")
    _check_signal(f"{label}.signal", track.signal)
    _check_places(f"{label}.place", track.place, allowed, track.signal.columns)
    if len(set(np.asarray(track.place).tolist())) < track.signal.columns:
        _refuse(f"{label}.place", track.place, "each place once")


def _check_model(calls: Calls, model: ModelDrive, program: Track | None, motions: int) -> None:
    """Refuse a model whose coordinates are not some of the robot's."""
    size, columns = model.calls.n, 0 if program is None else program.signal.columns
    if model.calls.dtype != np.float64:
        _refuse("drive.model.calls", model.calls.dtype, "float64")
    _check_places("drive.model.place", model.place, range(calls.n), size)
    _check_numbers("drive.model.ratio", model.ratio, (size,), nonzero=True)
    _check_places("drive.model.column", model.column, range(-1, columns), size)
    _check_places("drive.model.given", model.given, range(-1, max(motions, 1)), size)
    if model.bandwidth is not None and not 0.0 < model.bandwidth < np.inf:
        _refuse("drive.model.bandwidth", model.bandwidth, "a finite number greater than 0, rad/s")


def _check_efforts(calls: Calls, drive: DriveData) -> None:
    """Refuse efforts that are none, or of drives of which nothing says what others do where they are clipped."""
    allowed = f"numbers of shape ({calls.n},)"
    efforts = numbers_in("loads: drive.effort", drive.effort, allowed, finite=False)
    if efforts.shape != (calls.n,):
        _refuse("drive.effort", drive.effort, allowed)
    check_efforts(calls, efforts, "loads: drive.effort")
    shared = shared_drives(drive.model)
    if shared:
        _refuse("drive.effort", drive.effort, f"none: {listed(shared)} are more drives than freedoms")


def _check_wrench(label: str, wrench: LinkWrench, links: int) -> None:
    _check_places(f"{label}.link", [wrench.link], range(links), 1)
    _check_signal(f"{label}.signal", wrench.signal, 6)
    _check_numbers(f"{label}.arm", wrench.arm, (3,))
    _check_times(f"{label}.t0 and t1", wrench.t0, wrench.t1)


def place_prescribed(calls: Calls, loads: InputSignals | Sequence[InputSignals], q: Array, v: Array) -> None:
    """Put prescribed coordinates of states, (N, n), where their motions begin, at t = 0."""
    places = [calls.coordinates.index(name) for name in calls.prescribed]
    every = [loads] * len(q) if isinstance(loads, InputSignals) else loads
    for signals, x, rate in zip(every, q, v, strict=True):
        if signals.prescribed is None:
            continue
        amplitude, frequency, phase, offset = signals.prescribed.wave.T
        begins = offset + amplitude * np.sin(phase), amplitude * frequency * np.cos(phase)
        for track in signals.prescribed.tracks:
            for column, value in zip(begins, _signal_at(track.signal, 0.0), strict=True):
                column[track.place] = value
        x[places], rate[places] = begins


def place_adjoint(calls: Calls, loads: InputSignals, q: Array, v: Array, slopes: Sequence[Array]) -> None:
    """Go back from derivatives by a placed state, (n,) each, which become zero where its motions are prescribed.

    Args:
        q, v: the derivatives, which are written to.
        slopes: of the coefficients of each track's signal, what theirs are added to.
    """
    if loads.prescribed is None:
        return
    places = np.array([calls.coordinates.index(name) for name in calls.prescribed])
    by = q[places].astype(np.float64), v[places].astype(np.float64)
    q[places], v[places] = 0.0, 0.0
    for track, slope in zip(reversed(loads.prescribed.tracks), reversed(slopes), strict=True):
        piece, value, rate = _weights_at(track.signal, 0.0)
        slope[piece] += np.outer(value, by[0][track.place]) + np.outer(rate, by[1][track.place])
        for x in by:  # what tracks in front have there does not count
            x[track.place] = 0.0


def _weights_at(signal: Signal, t: float) -> tuple[int, Array, Array]:
    """Return the piece of a signal at a time, and how its coefficients make columns and their rates."""
    speed = 1.0
    if signal.profile is not None:
        t, speed = (float(x[0]) for x in _signal_at(signal.profile, t))
    knots = np.asarray(signal.knots)
    k = int(np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2))
    ahead, powers = np.clip(t, knots[0], knots[-1]) - knots[k], np.arange(signal.coefficients.shape[1])
    rates = np.zeros(powers.size)
    rates[1:] = powers[1:] * ahead ** (powers[1:] - 1) if knots[0] <= t <= knots[-1] else 0.0
    return k, ahead**powers, speed * rates


def _signal_at(signal: Signal, t: float) -> tuple[Array, Array]:
    """Return columns of a signal and their rates at a time."""
    k, value, rate = _weights_at(signal, t)
    coefficients = signal.coefficients[k]
    return value @ coefficients, rate @ coefficients


def link_wrenches(calls: Calls, wrench: Mapping[str, ArrayLike]) -> list[LinkWrench]:
    """Return wrenches that stay, by frame or link, as data for integrations in C; errors as of ``wrench_rows``."""
    wrenches = []
    for name, value in wrench.items():
        place, numbers = place_of_wrench(calls, name), wrench_numbers(calls, name, value)
        if numbers.shape != (6,):
            raise ArrayError(f"wrench: {name}: got shape {numbers.shape}; allowed: six finite numbers, (6,)")
        arm = np.zeros(3) if place.arm is None else place.arm.astype(np.float64)
        wrenches.append(LinkWrench(place.link, Signal.constant(numbers), arm))
    return wrenches


class NamedWrenches:
    """Wrenches that stay, by frame or link, as integrations take them: (t, q, v) -> (links, 6)."""

    def __init__(self, calls: Calls, wrench: Mapping[str, ArrayLike]) -> None:
        """Keep checked wrenches; errors as of ``wrench_rows``."""
        self._calls, self._wrench = calls, dict(wrench)
        self._data = link_wrenches(calls, wrench)

    def __call__(self, t: float, q: Array, v: Array) -> ArrayLike:
        """Return the rows of links, (links, 6), in a state."""
        rows = wrench_rows(self._calls, q, self._wrench)
        assert rows is not None
        return rows

    def load_data(self) -> list[LinkWrench]:
        """Return them as data for integrations in C."""
        return self._data
