"""Drives with electricity and controllers: numbers of a coordinate's table ``drive``, their rules, states and inputs.

A drive takes an input u at its coordinate in the place of a force:

    reference -> [position loop] -> [velocity loop] -> [current loop] -> winding or lag -> force on the coordinate.

What is in the description is in the chain.  The outermost loop that there is takes u as its reference; without a loop
u is the voltage of the winding, or the force that lags.  A loop hands its output to the next one that there is, as the
reference, and the last one to the winding as its voltage, or it is the force itself.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import partial

from ...names import DriveInput, kind_of, plain_input
from ..geometry import LINEAR
from ..numbers import Conflict, Number, Values, divisor
from .states import OwnedState, State

LOOPS = ("position", "velocity", "current")  # from the outside
DRIVE = "drive"
LAG, RESISTANCE, INDUCTANCE, TORQUE_CONSTANT = (
    f"drive.{key}" for key in ("lag", "winding.resistance", "winding.inductance", "winding.torque_constant")
)
WINDING = (RESISTANCE, INDUCTANCE, TORQUE_CONSTANT)
CURRENT_LIMIT, VOLTAGE_LIMIT = "drive.current_limit", "drive.voltage_limit"
GAINS = ("kp", "ki", "kd")
MEASURED = {"position": ("m", "rad"), "velocity": ("m/s", "rad/s"), "current": ("A", "A")}
INTEGRALS = {"position": ("m s", "rad s"), "velocity": ("m", "rad"), "current": ("A s", "A s")}
SHORT = 1e-5  # s: far below the time constants of drives
ERROR, WHILE = 0.1, 0.01  # m, rad, m/s, rad/s, or a share of the current, and s: a loop's integral of an ordinary error


def number_key(loop: str, name: str) -> str:
    """Return the name of a loop's number: "drive.controller.velocity.kp"."""
    return f"drive.controller.{loop}.{name}"


def has_winding(numbers: Collection[str]) -> bool:
    """Tell whether a drive has a winding."""
    return any(key in numbers for key in WINDING)


def loops_of(numbers: Collection[str]) -> tuple[str, ...]:
    """Return the loops of a drive's controller, from the outside."""
    return tuple(loop for loop in LOOPS if any(key.startswith(number_key(loop, "")) for key in numbers))


def has_drive(numbers: Collection[str]) -> bool:
    """Tell whether a coordinate has a drive with an input of its own."""
    return any(key.startswith(f"{DRIVE}.") for key in numbers)


def input_of(numbers: Collection[str], coordinate: str) -> DriveInput:
    """Return what u means at a coordinate whose law has these numbers; without a servo drive it is a force."""
    loops = loops_of(numbers)
    if loops:
        return DriveInput(f"reference of {loops[0]}", MEASURED[loops[0]][0 if kind_of(coordinate) in LINEAR else 1])
    return DriveInput("voltage", "V") if has_winding(numbers) else plain_input(coordinate)


def is_limited(numbers: Collection[str], loop: str) -> bool:
    """Tell whether anything limits the output of a loop: its limit, or what comes behind it."""
    loops = loops_of(numbers)
    behind = loops[loops.index(loop) + 1 :]
    if number_key(loop, "limit") in numbers:
        return True
    if behind:
        return behind[0] == "current" and CURRENT_LIMIT in numbers
    return has_winding(numbers) and (VOLTAGE_LIMIT in numbers or CURRENT_LIMIT in numbers)


def tracking_time(loop: str, numbers: Values) -> float | None:
    """Return the default of a loop's time of anti-windup, s: the loop's integral time; None where it has no use."""
    kp, ki = (numbers.get(number_key(loop, name), 0.0) for name in ("kp", "ki"))
    return kp / ki if kp and ki and is_limited(numbers, loop) else None


def drive_conflict(numbers: Values) -> Conflict | None:
    """Return the key and the message of a drive's numbers that do not go together; None if all do."""
    return next(_conflicts(numbers), None)


def _conflicts(numbers: Values) -> Iterator[Conflict]:
    winding, loops = has_winding(numbers), loops_of(numbers)
    if not winding and not loops and LAG not in numbers:
        yield DRIVE, "there is nothing in it; allowed: one or more of lag, winding, controller"
    missing = [key for key in WINDING if key not in numbers]
    if winding and missing:
        named = ", ".join(key.rpartition(".")[2] for key in WINDING)
        yield missing[0], f"it is missing; allowed: a winding with all of {named}"
    if winding and LAG in numbers:
        yield LAG, "there is a winding, whose current lags behind its voltage; allowed: one of both"
    for key in (CURRENT_LIMIT, VOLTAGE_LIMIT):
        if key in numbers and not winding:
            yield key, "there is no winding; allowed: with winding"
    if CURRENT_LIMIT in numbers and "current" not in loops and numbers.get(RESISTANCE) == 0.0:
        allowed = "with a resistance greater than 0, or with controller.current"
        yield CURRENT_LIMIT, f"the winding has no resistance, so that no voltage would be within it; allowed: {allowed}"
    if "current" in loops and not winding:
        yield "drive.controller.current", "there is no winding, whose current it would control; allowed: with winding"
    for loop in loops:
        yield from _loop_conflicts(numbers, loop)


def _loop_conflicts(numbers: Values, loop: str) -> Iterator[Conflict]:
    kp, ki, kd, smoothing, track = (numbers.get(number_key(loop, name)) for name in (*GAINS, "filter", "tracking_time"))
    where = f"drive.controller.{loop}"
    if kp is None and ki is None and kd is None:
        yield where, f"there is no gain; allowed: with one or more of {', '.join(GAINS)}"
    if kd is not None and smoothing is None and loop != "position":
        allowed = "with filter, a time in s, as the derivative is not measured"
        yield f"{where}.kd", f"there is no filter; allowed: {allowed}"
    if smoothing is not None and kd is None:
        yield f"{where}.filter", "there is no kd, whose derivative it smooths; allowed: with kd"
    if track is not None and ki is None:
        yield f"{where}.tracking_time", "there is no ki, whose integral it leads back; allowed: with ki"
    if track is not None and not is_limited(numbers, loop):
        yield f"{where}.tracking_time", "nothing limits the output of this loop; allowed: with limit"
    if ki is not None and track is None and is_limited(numbers, loop):
        allowed = "with kp, from which kp / ki follows, or with tracking_time in s"
        yield f"{where}.ki", f"there is no kp and no tracking_time; allowed: {allowed}"


def short_time_notes(states: Iterable[OwnedState]) -> tuple[str, ...]:
    """Return lines about time constants of drives, by their states, that are too short for integrations."""
    keys = (LAG, *(number_key(loop, "filter") for loop in LOOPS))
    drives = {state.prefix: state.numbers for state in states if state.law == DRIVE}
    times = [(f"{prefix}.{key}", numbers.get(key)) for prefix, numbers in drives.items() for key in keys]
    times += [
        (f"{prefix}.drive.winding: inductance / resistance", numbers[INDUCTANCE] / numbers[RESISTANCE])
        for prefix, numbers in drives.items()
        if numbers.get(RESISTANCE)
    ]
    return tuple(
        f"{place} = {time:g} s: integrations take many steps below {SHORT:g} s; allowed: a longer one, or none"
        for place, time in times
        if time is not None and time < SHORT
    )


def drive_states(numbers: Collection[str]) -> tuple[State, ...]:
    """Return the states of a drive, from the outside to the winding or the lag: no loop of them has a pivot that is 0.

    A drive without others has the state "input", which is and stays 0: its place is that of a force beside it.
    """
    names = [
        f"{what}_{loop}"
        for loop in loops_of(numbers)
        for what, key in (("filter", "filter"), ("integral", "ki"))
        if number_key(loop, key) in numbers
    ]
    if has_winding(numbers):
        names.append("current")
    elif LAG in numbers:
        names.append("force")
    return tuple(STATES[name] for name in names or ["input"])


def _integral_size(loop: str, numbers: Values) -> float:
    """Return the ordinary size of a loop's integral: that of an error for a while, within what the limit allows."""
    kp, ki = (numbers.get(number_key(loop, name), 0.0) for name in ("kp", "ki"))
    scale = _current_size(numbers) if loop == "current" else 1.0
    return min(ERROR * scale * max(kp / ki, WHILE), _limit(numbers, loop) / ki)


def _limit(numbers: Values, loop: str) -> float:
    """Return the limit of a loop's output as far as a number says it, infinite without any."""
    loops = loops_of(numbers)
    behind = loops[loops.index(loop) + 1 :]
    keys = [number_key(loop, "limit")]
    if behind:
        keys += [CURRENT_LIMIT] if behind[0] == "current" else []
    elif has_winding(numbers):
        keys.append(VOLTAGE_LIMIT)
    return min((numbers[key] for key in keys if key in numbers), default=math.inf)


def _current_size(numbers: Values) -> float:
    """Return the ordinary size of a winding's current, A: its limit, or what the limit of the voltage allows, or 1."""
    limits = [numbers[CURRENT_LIMIT]] if CURRENT_LIMIT in numbers else []
    if VOLTAGE_LIMIT in numbers and numbers.get(RESISTANCE):
        limits.append(numbers[VOLTAGE_LIMIT] / numbers[RESISTANCE])
    return min(limits, default=1.0)


def _one(numbers: Values) -> float:
    return 1.0


def _states() -> Iterator[State]:
    """Yield all states that drives may have."""
    for loop in LOOPS:
        unit = MEASURED["velocity" if loop == "position" else loop]
        size = _current_size if loop == "current" else _one
        yield State(name=f"filter_{loop}", unit=unit, size=size, is_bounded=False)
        size = partial(_integral_size, loop)
        yield State(name=f"integral_{loop}", unit=INTEGRALS[loop], size=size, is_bounded=False)
    yield State(
        name="current",
        unit=("A", "A"),
        size=_current_size,
        is_bounded=False,
        inertia=lambda numbers: numbers[INDUCTANCE],
    )
    yield State(name="force", unit=("N", "N m"), size=_one, is_bounded=False)
    yield State(name="input", unit=("1", "1"), size=_one, is_bounded=False)


STATES: Mapping[str, State] = {state.name: state for state in _states()}


def drive_numbers() -> tuple[Number, ...]:
    """Return all numbers of drives, in the order of descriptions."""
    numbers = [
        divisor(LAG, "time constant with which the force follows what asks for it; without winding", ("s", "s")),
        Number(RESISTANCE, "of the winding", ("ohm", "ohm")),
        divisor(INDUCTANCE, "of the winding, greater than 0", ("H", "H")),
        divisor(
            TORQUE_CONSTANT,
            "force per current, and voltage that the motion induces per velocity; a gear's ratio is in it",
            ("N/A", "N m/A"),
        ),
        divisor(
            CURRENT_LIMIT,
            "of the current: of the current loop's reference; without that loop the voltage stays where the current"
            " within it leads",
            ("A", "A"),
        ),
        divisor(VOLTAGE_LIMIT, "greatest voltage in both directions", ("V", "V")),
    ]
    for loop in LOOPS:
        error = "position error" if loop == "position" else f"{loop} error"
        numbers += [
            Number(number_key(loop, "kp"), f"output per {error}", ("1", "1")),
            divisor(number_key(loop, "ki"), f"output per {error} and second; greater than 0", ("1/s", "1/s")),
            Number(number_key(loop, "kd"), f"output per rate of the measured {loop}, against it", ("s", "s")),
            divisor(number_key(loop, "filter"), "time constant that smooths that rate", ("s", "s")),
            divisor(number_key(loop, "limit"), "greatest output in both directions", ("1", "1")),
            divisor(
                number_key(loop, "tracking_time"),
                "time constant of anti-windup by back-calculation; default kp / ki",
                ("s", "s"),
                default=partial(tracking_time, loop),
            ),
        ]
    return tuple(numbers)
