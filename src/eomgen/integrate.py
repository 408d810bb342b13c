"""Numerical integration of a compiled kernel's equations of motion, explicit and implicit.

SciPy and SUNDIALS are imported when an integration with one of their methods begins, not with this file.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import sundials
from .contacts import Contact, ContactWatch
from .errors import ArrayError, InputError
from .kernel import Kernel
from .stepping import (
    IMPLICIT,
    Progress,
    Record,
    Samples,
    checked_times,
    fixed_step,
    output_times,
    reporter,
    rk4,
    sampled,
    start_solver,
    tolerances,
)
from .stiffness import stiffnesses
from .system import Drive, IntegrationStopped, Prescribed, System, Wrench, state_vector

Array = NDArray[np.float64]

EXPLICIT = ("DOP853", "RK45", "rk4")
METHODS = ("auto", *IMPLICIT, *sundials.METHODS, *EXPLICIT)

__all__ = ["EXPLICIT", "METHODS", "IntegrationStopped", "Trajectory", "choose_method", "integrate"]


@dataclass(frozen=True)
class Trajectory:
    """A motion, sampled at equal distances in time (where it was stopped, the last sample may be nearer).

    Attributes:
        t: times, (T,), s.
        q, v: coordinates and rates, (T, n).
        u: drives, (T, n), N or N m.
        energy: kinetic and potential energy, (T, 2), J.
        coordinates: names, (n,).
        method: the method that was used.
        info: numbers of steps (0: not known), evaluations (of forward or inverse dynamics) and jacobians; wall_s, s.
        contacts: when clearances closed and opened, by time.
    """

    t: Array
    q: Array
    v: Array
    u: Array
    energy: Array
    coordinates: tuple[str, ...]
    method: str
    info: Mapping[str, float] = field(default_factory=dict)
    contacts: tuple[Contact, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "info", MappingProxyType(dict(self.info)))

    def of(self, coordinate: str) -> Array:
        """One coordinate over time, (T,), m or rad; InputError if there is none of that name."""
        if coordinate not in self.coordinates:
            raise InputError(f"coordinate: {coordinate!r} is unknown; known: {', '.join(self.coordinates)}")
        return self.q[:, self.coordinates.index(coordinate)]


def integrate(
    kernel: Kernel,
    q0: ArrayLike,
    v0: ArrayLike,
    duration: float,
    *,
    drive: Drive | None = None,
    wrench: Wrench | ArrayLike | None = None,
    prescribed: Prescribed | None = None,
    method: str = "auto",
    rtol: float = 1e-6,
    atol: ArrayLike | None = None,
    step: float | None = None,
    output_step: float | None = None,
    times: ArrayLike | None = None,
    progress: Progress | None = None,
    record: Record | None = None,
) -> Trajectory:
    """Integrate M(q) a + bias = generalized force + u from a state.

    Args:
        kernel: float64, with forward_dynamics and energy; implicit methods and ``atol=None`` need mass_matrix, and
            implicit ones inverse_dynamics.
        q0, v0: the state at t = 0, (n,).
        duration: s.
        drive: (t, q, v) -> u, (n,), N or N m; none if not given.  With an attribute ``batched`` that is true it is
            called with q and v of shape (N, n), too, and returns (N, n).  With a method ``slopes``, (t, q, v) ->
            (du/dq, du/dv), (n, n) each, implicit methods take these instead of finite differences of it.
        wrench: (links, 6) as in the kernel's methods, or (t, q, v) -> that.
        prescribed: t -> (q, v, a) of the prescribed coordinates, (m,) each, in the order of ``kernel.prescribed``
            (``eomgen.motion.Harmonic``, say); v and a must be the derivatives of q.  What q0, v0 and drive say of them
            does not count.  The trajectory's u is there the force that the motion needs, so that the kernel must have
            inverse_dynamics.
        method: "auto" (Radau if any coordinate or spring has a stiffness, else DOP853), "Radau", "BDF", "LSODA",
            "DOP853", "RK45" (all SciPy's), "CVODE", "IDA" (SUNDIALS'), or "rk4" with a fixed step.
        rtol, atol: tolerances; atol is a number or (2n,), first of q, then of v.  By default rtol times the size of
            each coordinate: ``coordinate_sizes``.
        step: of rk4, s; shortened so that it divides ``output_step``.  Default: half the time in which the fastest
            spring turns by 1 rad, or a damper between two points slows down by a factor e.
        output_step: distance of the samples, s, shortened so that it divides the duration; default duration / 1000.
        times: of the samples, s, (T,), increasing; instead of ``output_step``.  The state given is that at the first,
            which need not be 0; the last must be the duration.
        progress: called with a fraction from 0 to 1 and a line of text.
        record: called with times of samples (k,) and states (k, 2n) as they are reached, the first one not among them.

    Raises:
        IntegrationStopped: the state diverges, the step becomes too small, M singular, or a drive, wrench or
            acceleration NaN or infinite, whatever ``kernel.checks`` says; an IntegrationError that names coordinate
            and time and has the last good state and the trajectory up to it.
        InputError: an argument is wrong, a prescribed coordinate has no motion, or SciPy is not installed.
    """
    system = System(kernel, drive, wrench, prescribed)
    q0, v0 = (state_vector(label, x, kernel.coordinates) for label, x in (("q0", q0), ("v0", v0)))
    times = output_times(duration, output_step) if times is None else checked_times(times, duration, output_step)
    method = choose_method(kernel, method)
    began = time.perf_counter()
    report = reporter(progress, float(times[-1]))
    y0 = np.concatenate([q0, v0])
    watch = ContactWatch(kernel)
    samples = Samples(times, y0, record)

    def run() -> None:
        if method == "rk4":
            rk4(system, samples, fixed_step(kernel, q0, step, times), report, watch=watch)
            return
        absolute = tolerances(system, y0, rtol, atol)
        if method in sundials.METHODS:
            sundials.sundials_states(system, samples, method, rtol, absolute, report, watch)
        else:
            sampled(start_solver(system, y0, times, method, rtol, absolute), system, samples, report, watch)

    def info(_motion: Motion) -> dict[str, float]:
        return {**system.counts, "wall_s": time.perf_counter() - began}

    return trajectory_of(system, samples, run, method, watch, info)


@dataclass(frozen=True)
class Motion:
    """What of a motion is finite: t (T,), q, v and u (T, n)."""

    t: Array
    q: Array
    v: Array
    u: Array


def trajectory_of(
    system: System,
    samples: Samples,
    run: Callable[[], None],
    method: str,
    watch: ContactWatch,
    info: Callable[[Motion], dict[str, float]],
) -> Trajectory:
    """The trajectory of the samples that ``run`` fills; ``info`` is what is said of it.

    Raises:
        IntegrationStopped: from ``run``, or because forces at a sample are not finite; with the trajectory until then.
    """
    stop: IntegrationStopped | None = None
    try:
        run()
        times, states = samples.times, samples.states
    except IntegrationStopped as error:
        stop = error
        times, states = samples.until(error)
    motion, trouble = _with_forces(system, times, states)
    last = motion.t.size - 1
    if trouble is not None and stop is None:
        if last < 0:
            raise trouble
        system.trouble = trouble
        stop = system.stopped("the forces cannot be evaluated at the next sample", float(times[last]), states[last])
    trajectory = None
    if last >= 0:
        energy = np.asarray(system.kernel.energy(motion.q, motion.v))
        about, contacts = info(motion), tuple(watch.found)
        names = system.kernel.coordinates
        trajectory = Trajectory(motion.t, motion.q, motion.v, motion.u, energy, names, method, about, contacts)
    if stop is not None:
        stop.trajectory = trajectory
        raise stop from (stop.__cause__ or trouble)
    assert trajectory is not None  # nothing stopped, so that there are all samples
    return trajectory


def _with_forces(system: System, times: Array, states: Array) -> tuple[Motion, ArrayError | None]:
    """The motion with drives and forces of prescribed coordinates, as far as they are finite, and why no further."""
    n, trouble = system.n, None
    q, v = np.ascontiguousarray(states[:, :n]), np.ascontiguousarray(states[:, n:])
    u, end = np.empty_like(q), times.size
    for i, t in enumerate(times.tolist()):
        try:
            system.prescribe(t, q[i], v[i])
            u[i] = system.forces(t, q[i], v[i])
        except ArrayError as error:
            end, trouble = i, error
            break
    return Motion(times[:end], q[:end], v[:end], u[:end]), trouble


def choose_method(kernel: Kernel, method: str = "auto") -> str:
    """The method that ``integrate`` takes: "auto" becomes Radau if anything has a stiffness, else DOP853.

    Raises:
        InputError: the method is unknown.
    """
    if method not in METHODS:
        raise InputError(f"method: {method!r} is unknown; allowed: {', '.join(METHODS)}")
    if method != "auto":
        return method
    stiff = bool(stiffnesses(kernel).any()) or any(
        kernel.parameters.get(f"springs.{name}.stiffness", 0.0) or name in kernel.knots for name in kernel.springs
    )
    return "Radau" if stiff else "DOP853"
