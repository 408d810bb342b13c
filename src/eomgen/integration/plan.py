"""Choice of a motion's integrator, made once before it: method, reason, whether it is C, tolerances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import EomgenError, InputError
from ..identifiers import check_kind
from ..kernel.complete import Kernel
from ..kernel.stepping.methods import AUTO, IN_C, METHODS, RADAU, SUNDIALS
from ..kernel.stepping.options import NARROW, NARROW_TURNS, TURNS, rollout_of
from ..kernel.stepping.reading_inputs import signals_of
from ..limits import LARGEST, is_usable
from ..names import show
from ..runtime.bound import WrenchLike
from ..state.springs import any_spring, damping_matrix, fastest_rates
from ..state.vectors import DriveFunction, MotionFunction, WrenchFunction

REAL_TIME = 300.0  # rad/s or 1/s: eigenvalues above which steps of some ms, in pace with a clock, are implicit
STIFF = 1000.0  # time constants in a motion: an explicit method takes 2000 evaluations, and an implicit one not more
_NONE = (None, None, None)


@dataclass(frozen=True, eq=False)
class IntegratorOptions:
    """Method, tolerances and step of ``integrate``, checked where they are made; None is its default.

    Raises:
        InputError: the method is none of METHODS, or a number is not allowed.
    """

    method: str = AUTO
    rtol: float = 1e-6
    atol: ArrayLike | None = None
    step: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.method, str) or self.method not in METHODS:
            raise InputError(f"method: {show(self.method)} is unknown; allowed: {', '.join(METHODS)}")
        if not (is_usable(self.rtol) and 1e-13 <= self.rtol < 1.0):
            raise InputError(f"rtol: {show(self.rtol)}; allowed: from 1e-13 to less than 1")
        if self.step is not None and not (is_usable(self.step) and self.step > 0.0):
            raise InputError(f"step: {show(self.step)} s; a step is a time above 0, up to {LARGEST:g}")


@dataclass(frozen=True, eq=False)
class IntegratorPlan(IntegratorOptions):
    """Integrator of a motion; its method is the chosen one, "auto" automatic stiffness switching in C.

    Attributes:
        asked: the method that was asked for.
        reason: why "auto" came to a method in Python, in words; "" where it did not.
        not_in_c: why the kernel's C cannot integrate the motion; "" where it can.
        turns: the methods of "auto" in C.
    """

    asked: str = AUTO
    reason: str = ""
    not_in_c: str = ""
    turns: tuple[str, ...] = TURNS

    @property
    def in_c(self) -> bool:
        """Whether the kernel's C integrates."""
        return self.method in (*IN_C, AUTO)

    def leading(self, info: Mapping[str, float], duration: float) -> str:
        """Return the method that advanced for most of a duration, s, with stiffness switching; else the method."""
        if self.method != AUTO:
            return self.method
        implicit = info.get("implicit_s", 0.0)
        if 2.0 * implicit > duration:
            return RADAU if 2.0 * info.get("radau_s", 0.0) > implicit else "rosenbrock"
        return "tsit5"

    def no_works(self, kernel: Kernel) -> str:
        """Say what a kernel's motion lacks to have work integrals; "" where nothing is missing."""
        if not self.in_c:
            because = f", because {self.not_in_c}" if self.not_in_c else ""
            return f"{self.method} integrates in Python{because}"
        return f"{', '.join(kernel.raw.turning)} is a joint of 3-DOF rotation" if kernel.raw.turning else ""


def plan_integration(
    kernel: Kernel,
    wanted: IntegratorOptions,
    loads: tuple[DriveFunction | ArrayLike | None, WrenchFunction | WrenchLike | None, MotionFunction | None] = _NONE,
    q: Array | None = None,
    duration: float = 1.0,
) -> IntegratorPlan:
    """Choose the integrator of a motion; "auto" is the kernel's C where it can follow the loads.

    Where it cannot, "auto" is "scipy:Radau" if something is stiff (``why_stiff``), else "scipy:DOP853".

    Args:
        kernel: with the parameters that it has now.
        wanted: the integrator that is asked for.
        loads: drive, wrench and prescribed motion, as of ``integrate``.
        q: coordinates at the beginning, (n,); default 0.
        duration: of the motion, s.

    Raises:
        InputError: the method does not keep loops closed, or is one of C where that cannot be.
    """
    method, slow = wanted.method, why_not_in_c(kernel, *loads, method=wanted.method)
    if kernel.constraints and method in SUNDIALS:
        allowed = ", ".join(name for name in METHODS if name not in SUNDIALS)
        raise InputError(
            f"method: {kernel.name} has loops or couplings, which {method!r} does not keep closed; allowed: {allowed}"
        )
    if method in IN_C and slow:
        allowed = ", ".join(name for name in METHODS if name not in IN_C)
        raise InputError(f"method: {kernel.name}: {method!r} integrates in C, but {slow}; allowed: {allowed}")
    taken, reason = method, ""
    if method == AUTO and slow:
        stiff = why_stiff(kernel, q, duration)
        why = stiff or "nothing has a stiffness, nor stiff dampers or friction"
        taken, reason = "scipy:Radau" if stiff else "scipy:DOP853", f"because {why}; not in C: {slow}"
    turns = turns_of(kernel, wanted)
    return IntegratorPlan(taken, wanted.rtol, wanted.atol, wanted.step, method, reason, slow, turns)


def may_take_radau(wanted: IntegratorOptions) -> bool:
    """Return whether "auto" may take Radau IIA, too, as far as the options say."""
    return wanted.method == AUTO and wanted.rtol <= NARROW


def turns_of(kernel: Kernel, wanted: IntegratorOptions) -> tuple[str, ...]:
    """Return the methods in C between which "auto" switches, the first one first, by the robot and options alone.

    Radau IIA is one of them at tolerances that are worth its compilation, where stability may hold an explicit method
    back: of a robot with springs, dampers or friction.
    """
    if not (may_take_radau(wanted) and rollout_of(RADAU) in kernel.raw.rollouts):
        return TURNS
    return NARROW_TURNS if any_spring(kernel) or damping_matrix(kernel).any() else TURNS


def choose_method(kernel: Kernel, method: str = "auto", q: Array | None = None, duration: float = 1.0) -> str:
    """Return the method that ``integrate`` takes with time-signal inputs.

    Args:
        kernel: with the parameters that it has now.
        method: that is asked for.
        q: coordinates at the beginning, (n,); default 0.
        duration: of the motion, s.

    Raises:
        InputError: the method is unknown, or does not keep loops closed, or is one of C where that cannot be.
    """
    check_kind("kernel", kernel, hasattr(kernel, "calls"), "a Kernel (of eomgen.build, or of a generated package)")
    return plan_integration(kernel, IntegratorOptions(method), q=q, duration=duration).method


def why_not_in_c(
    kernel: Kernel,
    drive: DriveFunction | ArrayLike | None = None,
    wrench: WrenchFunction | WrenchLike | None = None,
    prescribed: MotionFunction | None = None,
    *,
    method: str = AUTO,
) -> str:
    """Say what a motion lacks to be integrated by a method of the kernel's C; empty where nothing is missing."""
    if rollout_of(method) not in kernel.raw.rollouts:
        return f"the kernel was built without {rollout_of(method)}"
    if kernel.dtype != np.float64:
        return f"the kernel is {kernel.dtype}"
    for label, function in (("drive", drive), ("wrench", wrench), ("prescribed", prescribed)):
        if callable(function) and signals_of(function) is None:
            return f"the {label} is a function that only Python can call"
    return ""


def stiff_in_real_time(kernel: Kernel, q: Array) -> bool:
    """Return whether fixed steps in real time must be implicit at q, (n,): eigenvalues there are above REAL_TIME.

    Explicit steps are then as short as that all the time.  Where M is singular at q, eigenvalues are not known, and
    steps are implicit; so they are where laws have states.
    """
    if kernel.internal_states:  # whose laws follow the faster, the faster the motion is
        return True
    try:
        return max(fastest_rates(kernel, q)) > REAL_TIME
    except (np.linalg.LinAlgError, EomgenError):
        return True


def why_stiff(kernel: Kernel, q: Array | None = None, duration: float = 1.0) -> str:
    """Say why a method must be implicit; empty where none need be.  Arguments as of ``choose_method``.

    Stiff is any spring, any internal state, and dampers and friction whose time constant, by the largest slopes of
    their laws and the inertia at q, is below 1 / ``STIFF`` of the duration: explicit steps are as short as that as long
    as the motion lasts, whatever moves.  Without the kernels that implicit methods need, dampers and friction are left
    to explicit ones.
    """
    if kernel.internal_states:
        return "laws have states, which follow fast motions in no time"
    if any_spring(kernel):
        return "there are springs"
    if not kernel.raw.has(kernel.mass_matrix) or not (kernel.constraints or kernel.raw.has(kernel.inverse_dynamics)):
        return ""
    try:
        slowing = fastest_rates(kernel, np.zeros(kernel.n) if q is None else q)[1]
    except np.linalg.LinAlgError:  # integration will say so
        return ""
    return f"dampers or friction take effect within {1.0 / slowing:.2g} s" if slowing * duration > STIFF else ""
