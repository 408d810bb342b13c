"""Numerical integration of a compiled kernel's equations of motion, explicit and implicit.

SciPy and SUNDIALS are imported when an integration with one of their methods begins, not with this file.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..names import show
from ..progress import Progress
from ..runtime.kernel import Kernel
from ..runtime.stepping.given_loads import loads_of
from ..runtime.stepping.loaded import AUTO
from ..runtime.stepping.options import ErrorControl
from ..state.springs import any_spring, fastest_rates
from ..state.vectors import DriveFunction, MotionFunction, WrenchFunction, state_vector
from . import compiled, sundials
from .advance import Advance
from .closed import ClosedSystem
from .contacts import ContactWatch
from .drives import drive_of
from .steps import (
    SCIPY_IMPLICIT,
    Record,
    Samples,
    Steps,
    checked_times,
    fixed_step,
    output_times,
    reporter,
    rk4,
    sampled,
    tolerances,
)
from .system import System
from .trajectory import FiniteMotion, Trajectory, trajectory_of
from .turning import ClosedTurningSystem, TurningSystem
from .until import Reached, Until

Array = NDArray[np.float64]

IN_C = compiled.METHODS
EXPLICIT_IN_PYTHON = ("DOP853", "RK45", "rk4")
EXPLICIT = ("tsit5", *EXPLICIT_IN_PYTHON)
STIFF = 1000.0  # time constants in a motion: an explicit method takes 2000 evaluations, and an implicit one not more
METHODS = (AUTO, *IN_C, *SCIPY_IMPLICIT, *sundials.METHODS, *EXPLICIT_IN_PYTHON)


def integrate(  # noqa: PLR0913
    kernel: Kernel,
    q0: ArrayLike,
    v0: ArrayLike,
    duration: float,
    *,
    drive: DriveFunction | ArrayLike | None = None,
    wrench: WrenchFunction | ArrayLike | None = None,
    prescribed: MotionFunction | None = None,
    method: str = "auto",
    rtol: float = 1e-6,
    atol: ArrayLike | None = None,
    step: float | None = None,
    output_step: float | None = None,
    times: ArrayLike | None = None,
    progress: Progress | None = None,
    record: Record | None = None,
    until: Until | None = None,
    works: bool = False,
) -> Trajectory:
    """Integrate M(q) a + bias = generalized force + u from a state; loops are closed to 1e-12 throughout.

    Joints that turn freely (``kernel.raw.turning``) pass beta = +-pi/2 in other angles.  Drives and wrenches are asked
    in those of the description, and samples are told so.

    Args:
        kernel: float64, with forward_dynamics and energy; implicit methods and ``atol=None`` need mass_matrix, and
            implicit ones residual_jacobian, or forward_dynamics_jacobian, or inverse_dynamics, of which they take
            finite differences; IDA inverse_dynamics in any case, and the first for its derivatives.  Of a robot with
            loops or couplings constrained_dynamics, constraint, constraint_jacobian, mass_matrix and residual in their
            place; implicit methods take forward_dynamics_jacobian there, and finite differences without it.
        q0, v0: the state at t = 0, (n,).
        duration: s.
        drive, wrench, prescribed: what acts, and what moves by itself; each is described below.  C follows forces and
            wrenches that stay, and objects with a method ``load_data``, as those of scenarios and ``Harmonic`` have it:
            it gives a DriveData, a list of LinkWrench, or Waves of ``eomgen.runtime.stepping.loads``.
        drive: (t, q, v) -> u, (n,), N or N m, or that u where it stays; none if not given.  With an attribute
            ``batched`` that is true it is called with q and v of shape (N, n), too, and returns (N, n).  With a method
            ``slopes``, (t, q, v) -> (du/dq, du/dv), (n, n) each, implicit methods take these instead of finite
            differences of it.
        wrench: (links, 6) as in the kernel's methods, or (t, q, v) -> that.
        prescribed: t -> (q, v, a) of the prescribed coordinates, (m,) each, in the order of ``kernel.prescribed``
            (``eomgen.motion.Harmonic``, say); v and a must be the derivatives of q.  What q0, v0 and drive say of them
            does not count.  The trajectory's u is there the force that the motion needs, so that the kernel must have
            inverse_dynamics.
        method: "rosenbrock" or "tsit5": the kernel's own C (adaptive_rollout), where it can follow drive, wrench and
            prescribed; "Radau", "BDF", "LSODA", "DOP853", "RK45" (all
            SciPy's), "CVODE", "IDA" (SUNDIALS', not for loops), or "rk4" with a fixed step.  "auto" is both in C
            in turn, whichever leads on further for its cost; where C cannot do it, Radau if there are springs, stiff
            dampers or friction (see ``why_stiff``), else DOP853.
        rtol, atol: tolerances; atol is a number or (2n,), first of q, then of v.  By default rtol times the size of
            each coordinate: ``coordinate_sizes``; of a rate that friction resists at most the smoothing of that.
        step: of rk4, s; shortened so that it divides ``output_step``.  Default: half the time in which the fastest
            spring turns by 1 rad, or a damper or friction slows down by a factor e.
        output_step: distance of the samples, s, shortened so that it divides the duration; default duration / 1000.
        times: of the samples, s, (T,), increasing; instead of ``output_step``.  The state given is that at the first,
            which need not be 0; the last must be the duration.
        progress: called with a fraction from 0 to 1 and a line of text.
        until: what the motion ends at, if that comes before the duration does: its last sample is there, and ``info``
            has the time as ended_at.  Not with SUNDIALS' methods.
        record: called with times of samples (k,) and states (k, 2n) as they are reached, the first one not among them.
        works: whether ``works`` of the trajectory are integrated by the same steps, which they do not change.  By the
            kernel's own C alone, where no joint turns freely; the kernel must have generalized_force, and, of
            prescribed coordinates, inverse_dynamics (with loops residual).

    Returns:
        The samples.  With loops ``info`` also has gap and gap_rate, the greatest |g| and |J v| among them, the number
        of ``redundant`` constraints at the end, and the least ``margin`` to a singular pose with its time, margin_at
        (see ``ClosedSystem.margins``): below 1e-4 or so constraint forces are hardly determined.

    Raises:
        LoopError: the state at the first time is open.
        IntegrationStopped: the state diverges, a loop comes open, the step becomes too small, evaluations lead nowhere
            (see ``advance.Advance``), M is singular, or a drive, wrench or acceleration NaN or infinite, whatever
            ``kernel.checks`` says; an IntegrationError that names
            coordinate and time and has the last good state and the trajectory up to it.
        InputError: an argument is wrong, a prescribed coordinate has no motion, or SciPy is not installed.
    """
    drive = drive_of(kernel, drive)
    system = system_of(kernel, drive, wrench, prescribed)
    q, v = (state_vector(label, x, kernel.coordinates) for label, x in (("q0", q0), ("v0", v0)))
    times = output_times(duration, output_step) if times is None else checked_times(times, duration, output_step)
    loads = (drive, wrench, prescribed)
    in_c = compiled.why_not(kernel, *loads)
    method, _ = explained_method(kernel, method, q, float(times[-1] - times[0]), in_c)
    if until is not None and method in sundials.METHODS:
        raise InputError(f"until: {method} goes on to the duration; allowed: other methods")
    if works and (lacking := compiled.no_works(kernel, method, in_c)):
        allowed = "allowed: integrations in C, of joints that do not turn freely"
        raise InputError(f"works: {kernel.name}: {lacking}; {allowed}")
    runs_in_c = method in (*IN_C, AUTO)
    began = time.perf_counter()
    report = reporter(progress, float(times[-1]))
    closed = q.copy(), v.copy()
    y0 = system.begin(float(times[0]), *closed)
    system.prescribe(float(times[0]), q, v)
    if not runs_in_c:  # C closes what it comes to, and goes on where it ended, to the bit
        q[:], v[:] = closed
    system.advance = Advance(float(times[0]), float(times[-1]))
    watch = ContactWatch(kernel, until)
    samples = Samples(times, np.concatenate([q, v]), record)

    def run() -> None:
        if method == "rk4" or not (y0.size or runs_in_c):  # nothing is free to be integrated
            rk4(system, y0, samples, fixed_step(kernel, q, step, times), report, watch)
            return
        absolute = tolerances(system, q, rtol, atol)
        if runs_in_c:
            data = loads_of(kernel.calls, *loads)
            control = ErrorControl(method, rtol, absolute)
            compiled.compiled_states(system, data, samples, control, report, watch, works)
            return
        if method in sundials.METHODS:
            sundials.sundials_states(system, y0, samples, method, rtol, absolute, report, watch)
        else:
            sampled(Steps(method, rtol, absolute, float(times[-1])), system, y0, samples, report, watch)

    def run_until() -> None:
        try:
            run()
        except Reached as reached:
            samples.end(reached)
            system.counts["ended_at"] = reached.t

    def info(motion: FiniteMotion) -> dict[str, float]:
        margins = system.margins(motion.q)
        near = {}
        if margins is not None:
            near = {"margin": float(margins.min()), "margin_at": float(motion.t[int(margins.argmin())])}
        return {**system.about(motion.q, motion.v), **near, "wall_s": time.perf_counter() - began}

    def name() -> str:
        return compiled.leading(method, system.counts, float(times[-1] - times[0]))

    return trajectory_of(system, samples, run_until, name, watch, info)


def system_of(
    kernel: Kernel,
    drive: DriveFunction | None,
    wrench: WrenchFunction | ArrayLike | None,
    prescribed: MotionFunction | None,
) -> System:
    """The equations of motion of a kernel as its coordinates need them, arguments as of ``integrate``."""
    plain, turning = (ClosedSystem, ClosedTurningSystem) if kernel.constraints else (System, TurningSystem)
    kind = turning if kernel.raw.turning else plain
    return kind(kernel, drive, wrench, prescribed)


def choose_method(kernel: Kernel, method: str = "auto", q: Array | None = None, duration: float = 1.0) -> str:
    """The method that ``integrate`` takes for loads that are data; arguments and errors as ``explained_method``."""
    return explained_method(kernel, method, q, duration)[0]


def explained_method(
    kernel: Kernel,
    method: str = "auto",
    q: Array | None = None,
    duration: float = 1.0,
    in_c: str | None = None,
) -> tuple[str, str]:
    """The method that ``integrate`` takes, and why, in words, if "auto" is asked for.

    Args:
        kernel: with the parameters that it has now.
        method: that is asked for.
        q: coordinates at the beginning, (n,); 0 if not given.
        duration: of the motion, s.
        in_c: why the kernel's own C cannot do it, empty where it can; by default of loads that are data.

    Raises:
        InputError: the method is unknown, or does not keep loops closed, or is the kernel's own where that cannot be.
    """
    slow = compiled.why_not(kernel) if in_c is None else in_c
    if kernel.constraints and method in sundials.METHODS:
        allowed = ", ".join(name for name in METHODS if name not in sundials.METHODS)
        raise InputError(
            f"method: {kernel.name} has loops or couplings, which {method!r} does not keep closed; allowed: {allowed}"
        )
    if method in IN_C and slow:
        allowed = ", ".join(name for name in METHODS if name not in IN_C)
        raise InputError(f"method: {kernel.name}: {method!r} integrates in C, but {slow}; allowed: {allowed}")
    if method != "auto" or not slow:
        return method_of(method, stiff=False, in_c=not slow), ""
    stiff = why_stiff(kernel, q, duration)
    why = stiff or "nothing has a stiffness, nor stiff dampers or friction"
    return method_of(method, bool(stiff), in_c=False), f"because {why}; not in C: {slow}"


def why_stiff(kernel: Kernel, q: Array | None = None, duration: float = 1.0) -> str:
    """The reason for an implicit method, in words; empty where there is none.  Arguments as ``choose_method``.

    That is any spring, and dampers and friction where they slow something down a ``STIFF`` part of the duration, by the
    largest slopes of their laws and the inertia at q: explicit steps are as short as that as long as the motion lasts,
    whatever moves.  Without the kernels that implicit methods need, dampers and friction are left to explicit ones.
    """
    if any_spring(kernel):
        return "there are springs"
    if not ({"mass_matrix"} if kernel.constraints else {"mass_matrix", "inverse_dynamics"}) <= set(kernel.operations):
        return ""
    try:
        slowing = fastest_rates(kernel, np.zeros(kernel.n) if q is None else q)[1]
    except np.linalg.LinAlgError:  # integration will say so
        return ""
    return f"dampers or friction take effect within {1.0 / slowing:.2g} s" if slowing * duration > STIFF else ""


def method_of(asked: str, stiff: bool, *, in_c: bool) -> str:
    """The method asked for; for "auto" itself in C, else an implicit one where something is stiff (``why_stiff``).

    Raises:
        InputError: the method is unknown.
    """
    if not isinstance(asked, str) or asked not in METHODS:
        raise InputError(f"method: {show(asked)} is unknown; allowed: {', '.join(METHODS)}")
    if asked != "auto" or in_c:
        return asked
    return "Radau" if stiff else "DOP853"
