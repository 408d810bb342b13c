"""Options of rollouts with error control as records: which steps are taken."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...errors import ArrayError, InputError
from ...names import show
from ...runtime.arrays import flag, numbers_in
from ...runtime.calls import Calls
from ...runtime.raw import Array
from ...runtime.rollouts import FIXED, LONGEST, FixedSteps, as_number, most_rows, whole_number
from .methods import ADAPTIVE, AUTO, RADAU

ROLLOUTS = {RADAU: "radau_rollout"}  # the kernel of a method, where it is not adaptive_rollout
TURNS = ("tsit5", "rosenbrock")  # methods of AUTO,
NARROW_TURNS = (*TURNS, RADAU)  # those at narrow tolerances,
NARROW = 1e-7  # which begin here: wider ones are not worth the time that it takes to compile Radau IIA
LEAST = {"float64": 1e-13, "float32": 1e-5}  # relative tolerances that round-off lets steps reach


def rollout_of(method: str) -> str:
    """Return the name of the kernel that a method is of."""
    return ROLLOUTS.get(method, "rollout" if method in FIXED else "adaptive_rollout")


@dataclass(frozen=True)
class ErrorControl:
    """A method that chooses its steps by their errors, with its tolerances.

    Attributes:
        method: of ADAPTIVE, or AUTO.
        rtol, atol: the error of a step is at most atol + rtol times the size of each number; atol of q, then of v,
            (2n,).
        turns: the methods of AUTO.
    """

    method: str
    rtol: float
    atol: Array
    turns: tuple[str, ...] = TURNS

    @property
    def methods(self) -> tuple[str, ...]:
        """Return the methods that take steps."""
        return self.turns if self.method == AUTO else (self.method,)

    @property
    def kernel(self) -> str:
        """Return the name of the kernel that takes steps by all of them."""
        return rollout_of(RADAU if RADAU in self.methods else self.method)


def method_for(method: str | None, duration: float | None) -> str:
    """Return the method that is asked for, or a default: stable adaptive steps where there is a duration, else rk4."""
    return method if method is not None else "rk4" if duration is None else "rosenbrock"


@dataclass(frozen=True)
class StepOptions(FixedSteps):
    """Steps of a rollout: so many of one length, or those that error control chooses in a duration.

    Attributes:
        method: "rk4", "implicit", "rosenbrock", "tsit5" or "radau".
        dt: length of a step, s.
        steps: their number.
        every: one of so many steps is stored.
        duration: of a motion with error control, s.
        samples: of it, beside the beginning; 1 by default.
        rtol, atol: tolerances, as of ``Kernel.rollout``.

    Raises:
        InputError: the method is unknown, or an option belongs to other methods.
    """

    duration: float | None = None
    samples: int | None = None
    rtol: float = 1e-6
    atol: ArrayLike | None = None

    of_fixed_steps: ClassVar[Mapping[str, Any]] = {"dt": None, "steps": None, "every": 1}
    of_error_control: ClassVar[Mapping[str, Any]] = {"duration": None, "samples": None, "atol": None}
    arguments: ClassVar[tuple[str, str]] = ("dt, steps and every", "duration, samples and tolerances")

    def __post_init__(self) -> None:
        if not isinstance(self.method, str) or (self.method not in FIXED and self.method not in ADAPTIVE):
            known = ", ".join((*FIXED, *ADAPTIVE))
            raise InputError(f"rollout: method {show(self.method)} is unknown; allowed: {known}")
        for name, default in (self.of_fixed_steps if self.is_adaptive else self.of_error_control).items():
            value = getattr(self, name)
            if value is not default and value is not None and not (isinstance(value, int) and value == default):
                wanted, others = self.arguments[:: -1 if self.is_adaptive else 1]
                raise InputError(
                    f"rollout: {name} is given; allowed: {wanted} with method={self.method!r}, not {others}"
                )

    @property
    def is_adaptive(self) -> bool:
        """True if the method chooses its steps."""
        return self.method in ADAPTIVE

    def times(self, calls: Calls, count: int | None) -> Array:
        """Return the times of samples, s, (samples + 1,), which are equally far apart; arguments as ``fixed_steps``.

        Raises:
            InputError: the duration or the number of samples is not allowed, or there is no room for them.
        """
        samples = whole_number("samples", 1 if self.samples is None else self.samples, most_rows(calls, count))
        length = as_number(self.duration)
        if not 0.0 < length <= LONGEST:
            allowed = f"a number above 0, of up to {LONGEST:g}, is allowed"
            raise InputError(f"rollout: duration = {show(self.duration)} is not a length of time; {allowed}")
        try:
            return np.linspace(0.0, length, samples + 1)
        except MemoryError:
            size = f"{samples + 1} samples take {8e-9 * samples:.3g} GB for their times alone"
            raise InputError(f"rollout: {size}, more than there is; allowed: fewer samples") from None

    def error_control(self, calls: Calls, meta: Mapping[str, Any]) -> ErrorControl:
        """Return the method with tolerances of every coordinate and rate, in the kernel's dtype.

        Args:
            meta: of the library with its steps, which knows the sizes of coordinates.

        Raises:
            InputError: a tolerance is not allowed.
            ArrayError: atol has another shape.
        """
        least, rtol, atol = LEAST[str(calls.dtype)], self.rtol, self.atol
        if not least <= as_number(rtol) < 1.0:
            raise InputError(f"rollout: rtol = {show(rtol)} is not allowed; a number from {least:g} to below 1 is")
        if atol is None:
            tolerances = float(rtol) * np.array(meta["sizes"])
            for i, name in meta["rubbing"]:
                tolerances[calls.n + i] = min(tolerances[calls.n + i], calls.parameters[name])
            return ErrorControl(self.method, float(rtol), tolerances.astype(calls.dtype))
        if calls.internal_states:
            atol = joined_tolerances(calls, atol, float(rtol) * np.array(meta["sizes"]))
        wanted = numbers_in("rollout: atol", atol, f"a number or ({2 * calls.n},)", finite=False)
        try:
            tolerances = np.broadcast_to(wanted, (calls.n + calls.rates,)).astype(calls.dtype)
        except ValueError:
            raise ArrayError(f"rollout: atol: expected a number or ({2 * calls.n},), got {show(atol)}") from None
        if not ((tolerances > 0.0) & (tolerances < np.inf)).all():
            raise InputError(f"rollout: atol = {show(atol)} is not allowed; finite numbers above 0 are")
        return ErrorControl(self.method, float(rtol), tolerances)


@dataclass(frozen=True)
class InputStepOptions(StepOptions):
    """Steps of a rollout with what else acts over time, which is for error control alone."""

    loads: Any = None
    works: bool = False

    of_error_control: ClassVar[Mapping[str, Any]] = {**StepOptions.of_error_control, "loads": None, "works": False}
    arguments: ClassVar[tuple[str, str]] = (StepOptions.arguments[0], "duration, samples, tolerances, loads and works")

    def __post_init__(self) -> None:
        if self.works is not False:
            object.__setattr__(self, "works", flag("rollout: works", self.works))
        super().__post_init__()


def joined_tolerances(calls: Calls, atol: ArrayLike, defaults: Array) -> Array:
    """Return absolute tolerances of q, of v, then of m internal states, (2 n + m,).

    Args:
        atol: a number, or numbers of q, then of v, (2 n,), behind which may be those of z.
        defaults: for internal states whose tolerances are not given, (2 n + m,).

    Raises:
        ArrayError: another shape.
    """
    n, m = calls.n, len(calls.internal_states)
    shapes = f"({2 * n},)" + (f", with tolerances of internal states ({2 * n + m},)" if m else "")
    given = numbers_in("atol", atol, f"a number or shape {shapes}", finite=False)
    if given.shape not in ((), (2 * n,), (2 * n + m,)):
        raise ArrayError(f"atol: expected a number or shape {shapes}, got shape {given.shape}")
    tolerances = np.array(defaults, np.float64)
    tolerances[: max(given.size, 2 * n)] = given
    return tolerances
