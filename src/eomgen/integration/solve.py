"""Numerical integration of a compiled kernel's equations of motion, explicit and implicit.

SciPy and SUNDIALS are imported when an integration with one of their methods begins, not with this file.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import InputError, IntegrationStopped
from ..identifiers import check_kind
from ..kernel.complete import Kernel
from ..kernel.stepping.methods import SUNDIALS, Method
from ..kernel.stepping.options import ErrorControl
from ..kernel.stepping.reading_inputs import input_signals
from ..progress import Progress, tells_at_prompt
from ..runtime.bound import WrenchLike
from ..runtime.internal_states import cut_apart
from ..state.vectors import DriveFunction, MotionFunction, WrenchFunction
from . import compiled, sundials
from .closed import ClosedSystem
from .contacts import ContactWatch
from .drives import begin_of, drive_of
from .plan import IntegratorOptions, IntegratorPlan, plan_integration
from .resting import rests
from .steps import Record, Samples, checked_times, fixed_step, output_times, reporter, rk4, sampled, tolerances
from .system import Advance, System
from .trajectory import Trajectory, trajectory_of
from .turning import ClosedTurningSystem, TurningSystem
from .until import Reached, Until


@tells_at_prompt("integrating")
def integrate(  # noqa: PLR0913
    kernel: Kernel,
    q0: ArrayLike,
    v0: ArrayLike,
    duration: float,
    *,
    drive: DriveFunction | ArrayLike | None = None,
    wrench: WrenchFunction | WrenchLike | None = None,
    prescribed: MotionFunction | None = None,
    method: Method = "auto",
    rtol: float = 1e-6,
    atol: ArrayLike | None = None,
    step: float | None = None,
    output_step: float | None = None,
    times: ArrayLike | None = None,
    progress: Progress | None = None,
    record: Record | None = None,
    until: Until | None = None,
    works: bool = False,
    z0: ArrayLike | None = None,
) -> Trajectory:
    """Integrate M(q) a + bias = generalized force + u from a state; loops are closed to 1e-12 throughout.

    Joints with 3-DOF rotation (``kernel.raw.turning``) switch charts of their Euler angles near beta = +-pi/2.  Drives
    and wrenches are evaluated in those of the description, and samples have them, too.

    Args:
        kernel: float64, with forward_dynamics and energy; implicit methods and ``atol=None`` need mass_matrix, and
            implicit ones residual_jacobian, or forward_dynamics_jacobian, or inverse_dynamics, of which they take
            finite differences; IDA inverse_dynamics in any case, and the first for its derivatives.  Of a robot with
            loops or couplings constrained_dynamics, constraint, constraint_jacobian, mass_matrix and residual in their
            place; implicit methods take forward_dynamics_jacobian there, and finite differences without it.
        q0, v0: the state at t = 0, (n,).
        z0: internal states at t = 0, (m,); zeros by default.
        duration: s.
        drive, wrench, prescribed: loads and prescribed motions, each described below.  C takes constant forces and
            wrenches, and objects with a method ``load_data`` (time-signal inputs), as those of scenarios and
            ``Harmonic`` have it: it returns a DriveData, a list of LinkWrench, or Waves of
            ``eomgen.kernel.stepping.input_signals``.
        drive: (t, q, v) -> u, (n,), N or N m, or that u where it is constant; default none.  With an attribute
            ``batched`` that is true it is called with q and v of shape (N, n), too, and returns (N, n).  With a method
            ``slopes``, (t, q, v) -> (du/dq, du/dv), (n, n) each, implicit methods take these instead of finite
            differences of it.
        wrench: as in the kernel's methods, rows of links, (links, 6), or by frame and link; or (t, q, v) -> that.
        prescribed: t -> (q, v, a) of the prescribed coordinates, (m,) each, in the order of ``kernel.prescribed``
            (``eomgen.motion.Harmonic``, say); v and a must be the derivatives of q.  What q0, v0 and drive say of them
            does not count.  The trajectory's u is there the force that the motion needs, so that the kernel must have
            inverse_dynamics.
        method: "rosenbrock", "tsit5" or "radau": the kernel's C (adaptive_rollout, radau_rollout), where it can
            follow drive, wrench and prescribed; "scipy:Radau", "scipy:BDF", "scipy:LSODA", "scipy:DOP853",
            "scipy:RK45", "CVODE", "IDA" (SUNDIALS', not for loops), or "rk4" with a fixed step.  "auto" switches
            between the first two by stiffness and cost, and "radau", too, where rtol is 1e-7 or less and there are
            springs, dampers or friction (see ``plan.turns_of``); where C cannot do it, "scipy:Radau" if there are
            springs, stiff dampers or friction (see ``plan.why_stiff``), else "scipy:DOP853".
        rtol, atol: tolerances; atol is a number or (2n,), first of q, then of v, behind which may be those of internal
            states (which a number leaves as they are); C takes what is below 1e-30 as 1e-30.  By default rtol times the
            size of each coordinate: ``coordinate_sizes``; of a velocity that friction resists at most the smoothing of
            that.
        step: of rk4, s; shortened so that it divides ``output_step``.  Default: half the shortest time constant, 1 /
            the angular frequency of a spring, or the decay time by 1 / e of a damper or friction; of internal states as
            they follow at the velocity of each sample.
        output_step: distance of the samples, s, shortened so that it divides the duration; default duration / 1000.
        times: of the samples, s, (T,), increasing; instead of ``output_step``.  q0, v0 are the state at the first,
            which need not be 0; the last must be the duration.
        progress: called with a fraction from 0 to 1 and a line of text.
        until: what the motion ends at, if that comes before the duration does: its last sample is there, and ``info``
            has the time as ended_at.  Not with SUNDIALS' methods.
        record: called with times of samples (k,) and states (k, 2n), behind which are internal states, as they are
            reached, the first one not among them.
        works: whether the trajectory's work integrals ``works`` are computed by the same steps, which they do not
            change.  By the kernel's C alone, without joints of 3-DOF rotation; the kernel must have generalized_force,
            and, of prescribed coordinates, inverse_dynamics (with loops residual).

    Returns:
        The samples.  With loops ``info`` also has gap and gap_rate, the greatest |g| and |J v| among them, the number
        of ``redundant`` constraints at the end, and the least ``margin`` to a singular pose with its time, margin_at
        (see ``ClosedSystem.margins``): below 1e-4 or so constraint forces are hardly determined.

    Raises:
        LoopError: the state at the first time violates the constraints.
        IntegrationStopped: the state diverges, a loop comes open, the step becomes too small, evaluations lead nowhere
            (see ``advance.Advance``), M is singular, or a drive, wrench or acceleration NaN or infinite, whatever
            ``kernel.checks`` says; an IntegrationError that names
            coordinate and time and has the last good state and the trajectory up to it.
        InputError: an argument is wrong, a prescribed coordinate has no motion, or SciPy is not installed.
    """
    check_kind("kernel", kernel, hasattr(kernel, "calls"), "a Kernel (of eomgen.build, or of a generated package)")
    system = system_of(kernel, drive_of(kernel, drive), wrench, prescribed)
    q, v = begin_of(kernel, q0, v0, z0)
    times = output_times(duration, output_step) if times is None else checked_times(times, duration, output_step)
    span = float(times[-1] - times[0])
    plan = plan_integration(system.kernel, IntegratorOptions(method, rtol, atol, step), system.loads, q, span)
    try:
        motion = integrate_by(plan, system, (q, v), times, progress=progress, record=record, until=until, works=works)
    except IntegrationStopped as stop:
        stop.set_apart(len(kernel.coordinates))
        if stop.trajectory is not None:
            stop.trajectory = stop.trajectory.apart(kernel)
        raise
    return motion.apart(kernel)


def integrate_by(
    plan: IntegratorPlan,
    system: System,
    state: tuple[Array, Array],
    times: Array,
    *,
    progress: Progress | None = None,
    record: Record | None = None,
    until: Until | None = None,
    works: bool = False,
) -> Trajectory:
    """Integrate a system by a plan that was made for its motion; result and errors as ``integrate``.

    Args:
        plan: the integrator.
        system: the equations of motion, not integrated before.
        state: q and v at the first time, internal states behind v; prescribed coordinates are put in place in these
            arrays, and C, which goes on where it ended, takes them as they are, others as assembled.
        times: of the samples, s, (T,).
        progress, record, until, works: as of ``integrate``.
    """
    kernel, method = system.kernel, plan.method
    if until is not None and method in SUNDIALS:
        raise InputError(f"until: {method} goes on to the duration; allowed: other methods")
    if works and (lacking := plan.no_works(kernel)):
        allowed = "allowed: integrations in C, without joints of 3-DOF rotation"
        raise InputError(f"works: {kernel.name}: {lacking}; {allowed}")
    began = time.perf_counter()
    report = reporter(progress, float(times[-1]))
    q, v = state
    closed = q.copy(), v.copy()
    y0 = system.begin(float(times[0]), *closed)
    system.prescribe(float(times[0]), q, v)
    if not plan.in_c:  # C closes what it comes to, and goes on where it ended, to the bit
        q[:], v[:] = closed
    system.advance = Advance(float(times[0]), float(times[-1]))
    watch = ContactWatch(kernel, until)
    samples = Samples(times, np.concatenate([q, v]), record)

    def run() -> None:
        if method == "rk4" or not (y0.size or plan.in_c):  # nothing is free to be integrated
            step = fixed_step(kernel, q, plan.step, times)
            rk4(system, y0, samples, step, report, watch, chosen=plan.step is not None)
            return
        control = ErrorControl(method, plan.rtol, tolerances(system, q, plan), plan.turns)
        if plan.in_c:
            data = input_signals(kernel.calls, *system.loads)
            compiled.compiled_states(system, data, samples, control, report, watch, works)
        else:
            solve = sundials.sundials_states if method in SUNDIALS else sampled
            solve(system, y0, samples, control, report, watch)

    def run_until() -> None:
        try:
            run()
        except Reached as reached:
            samples.end(reached)
            system.counts["ended_at"] = reached.t

    def described(t: Array, q: Array, v: Array) -> dict[str, Any]:
        margins = system.margins(q)
        near = {}
        if margins is not None:
            near = {"margin": float(margins.min()), "margin_at": float(t[int(margins.argmin())])}
        info = {**system.about(q, v[:, : kernel.n]), **near, "wall_s": time.perf_counter() - began}
        method = plan.leading(system.counts, float(times[-1] - times[0]))
        held = rests(kernel, t, q, *cut_apart(v, kernel.n))
        return {"method": method, "info": info, "contacts": tuple(watch.contacts), "rests": held}

    return trajectory_of(system, samples, run_until, described)


def system_of(
    kernel: Kernel,
    drive: DriveFunction | None,
    wrench: WrenchFunction | WrenchLike | None,
    prescribed: MotionFunction | None,
) -> System:
    """Return the equations of motion of a kernel as its coordinates need them, arguments as of ``integrate``."""
    plain, turning = (ClosedSystem, ClosedTurningSystem) if kernel.constraints else (System, TurningSystem)
    kind = turning if kernel.raw.turning else plain
    return kind(kernel, drive, wrench, prescribed)
