"""Global error of an integrated motion, estimated from the same motion by two narrower tolerances.

With A the motion, and B and C motions from the same state by tolerances 30 and 1000 times narrower, the error of A is
A - C to within the error of C, which B - C exceeds where the three converge.  The estimate is valid where A - B and
A - C agree, and by how much they do not is said (L. F. Richardson, The deferred approach to the limit, Phil. Trans. R.
Soc. A 226, 1927; L. F. Shampine and L. S. Baca, Global error estimates for ODEs based on extrapolation methods, SIAM J.
Sci. Stat. Comput. 6, 1985).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import InputError, IntegrationStopped
from ..identifiers import check_kind
from ..kernel.complete import Kernel
from ..names import component_name, listed
from ..robot.coordinates import index_of, rotating_joints, unit_of
from ..robot.value import ANGULAR
from ..runtime.bound import WrenchLike
from ..shown import Shown, prefixed
from ..state.vectors import DriveFunction, MotionFunction, WrenchFunction
from .drives import drive_of
from .plan import IntegratorOptions, IntegratorPlan, plan_integration
from .solve import integrate_by, system_of
from .system import System
from .trajectory import Trajectory

AGREES = 0.3  # of the estimate: by how much that of the wider reference may differ
NARROWER = 1000.0  # times, the tolerance of the narrower reference; of the other the root of that
NARROWEST = 1e-13  # rtol, of integrators
REFERENCES = (1e-8, 1e-10, 1e-12)  # rtol, for a motion whose tolerance is not known
ROUND_OFF = 4.0 * float(np.finfo(np.float64).eps)  # of a coordinate: errors below it are none

Begin = Callable[[], System]  # the equations of motion, not integrated before


@dataclass(frozen=True, kw_only=True)
class GlobalError(Shown):
    """Estimated global error of a motion: what was computed less the same motion by a tolerance 1000 times narrower.

    Attributes:
        coordinates: names, (n,).
        q_error, v_error: of coordinates and velocities, (T, n).
        z_error: of internal states, (T, states); None without any.
        tool_error: of the tool's position, (T, 3), m, base frame; None where no tool is known.
        tool_rotation_error: angle by which the tool is turned wrongly, (T,), rad; None without a tool.
        unresolved: part of the largest error by which the estimate by one 30 times narrower differs, from 0 to
            1; 1 where there is none.
    """

    coordinates: tuple[str, ...]
    q_error: Array
    v_error: Array
    z_error: Array | None = None
    tool_error: Array | None = None
    tool_rotation_error: Array | None = None
    unresolved: float = 0.0

    @property
    def is_resolved(self) -> bool:
        """Whether the estimate is valid: those of both narrower tolerances agree to 30 %."""
        return self.unresolved <= AGREES

    @property
    def tool_max(self) -> float | None:
        """Largest error of the tool's position, m; None without a tool."""
        return None if self.tool_error is None else float(np.linalg.norm(self.tool_error, axis=1).max())

    def largest(self, unit: str) -> tuple[str, float] | None:
        """Return the coordinate of this unit, "m" or "rad", with the largest error, and that; None without any."""
        columns = [i for i, name in enumerate(self.coordinates) if unit_of(name) == unit]
        if not columns:
            return None
        sizes = np.abs(self.q_error[:, columns]).max(axis=0)
        return self.coordinates[columns[int(sizes.argmax())]], float(sizes.max())

    def columns(self, tool: str) -> dict[str, tuple[str, Array]]:
        """Return unit and values over time by name: NAME.error of coordinates, and of the tool's position."""
        errors = zip(self.coordinates, self.q_error.T, strict=True)
        columns = {f"{name}.error": (unit_of(name), error) for name, error in errors}
        return columns if self.tool_error is None else {**columns, f"{tool}.error": ("m", self.tool_error)}

    def summary(self) -> dict[str, object]:
        """Return the largest errors, as plain numbers that JSON can hold; m, rad."""
        largest = {unit: self.largest(unit) for unit in ("m", "rad")}
        rotation = self.tool_rotation_error
        return {
            "tool": self.tool_max,
            "tool_rotation": None if rotation is None else float(rotation.max()),
            **{unit: None if entry is None else list(entry) for unit, entry in largest.items()},
            "unresolved": self.unresolved,
        }

    def line(self) -> str:
        """Return the largest errors in a line of text."""
        what = []
        if self.tool_error is not None and self.tool_rotation_error is not None:
            turned = prefixed(float(self.tool_rotation_error.max()), "rad")
            what.append(f"tool off by {prefixed(self.tool_max or 0.0, 'm')} and {turned}")
        for unit in ("m", "rad"):
            entry = self.largest(unit)
            what += [] if entry is None else [f"{entry[0]} by {prefixed(entry[1], unit)}"]
        text = f"error of integration (estimated, at most): {', '.join(what)}"
        if self.is_resolved:
            return text
        return f"{text}; not reliable: estimates by two narrower tolerances differ by {100.0 * self.unresolved:.0f} %"


class ReferenceMotions:
    """Motions from the same state as one whose error is estimated, by narrower tolerances, piece by piece.

    Args:
        plans: of the wider and the narrower reference.
    """

    def __init__(self, plans: tuple[IntegratorPlan, IntegratorPlan]) -> None:
        self._plans = plans
        self._states: list[Array] = []  # q, v where the references got to
        self._size, self._open = np.zeros(0), np.zeros(0)  # largest errors of coordinates, and differences of both
        self._reach = np.zeros(0)  # largest coordinates
        self._lost = plans[0].rtol <= plans[1].rtol

    def unresolved(self, names: tuple[str, ...]) -> float:
        """Return the part of the largest error that is open, from 0 to 1, of coordinates by these names."""
        if self._lost:
            return 1.0
        parts = [0.0]
        for unit in {unit_of(name) for name in names}:
            columns = [i for i, name in enumerate(names) if unit_of(name) == unit]
            size, opened, reach = (float(x[columns].max()) for x in (self._size, self._open, self._reach))
            if opened > ROUND_OFF * reach:
                parts.append(opened / size if size > opened else 1.0)
        return max(parts)

    def extend(self, begin: Begin, times: Array, states: Array) -> Array:
        """Return errors of the samples of the next piece, (T, 2n), which begins with the last sample of the one before.

        Args:
            begin: makes the equations of motion of the piece.
            times: of the samples, s, (T,).
            states: described (q, v) there, (T, 2n).
        """
        if not self._states:
            self._states = [states[0], states[0]]
            self._size, self._open, self._reach = np.zeros((3, begin().n))
        wide, narrow = (self._follow(i, begin, times) for i in range(2))
        reached = min(len(wide), len(narrow))
        self._lost |= reached < times.size
        coordinates = begin().kernel.coordinates
        errors = np.zeros_like(states)
        errors[:reached] = _less(states[:reached], narrow[:reached], coordinates)
        errors[reached:] = errors[max(reached - 1, 0)]
        between = _less(states[:reached], wide[:reached], coordinates) - errors[:reached]
        self._size, self._open, self._reach = (
            np.maximum(largest, np.abs(values[:, : largest.size]).max(axis=0, initial=0.0))
            for largest, values in ((self._size, errors), (self._open, between), (self._reach, states))
        )
        return errors

    def _follow(self, which: int, begin: Begin, times: Array) -> Array:
        """Return the states of a reference at these times, (K, 2n), as far as it gets."""
        if self._lost:
            return np.zeros((0, self._states[which].size))
        state = self._states[which].copy()
        system = begin()
        q, v = np.split(state, [system.n])
        finer = _halved(times, which + 1)
        try:
            motion = integrate_by(self._plans[which], system, (q, v), finer)
        except IntegrationStopped as stop:
            if stop.trajectory is None:
                return np.zeros((0, state.size))
            motion = stop.trajectory
        self._states[which] = np.concatenate([motion.q[-1], motion.v[-1]])
        reached = int((motion.t == finer[: motion.t.size]).sum())
        return np.hstack([motion.q, motion.v])[:reached][:: 2 ** (which + 1)]


def references(plan: IntegratorPlan, planned: Callable[[float], IntegratorPlan]) -> ReferenceMotions:
    """Return the references of a motion by a plan: by tolerances 30 and 1000 times narrower, of rk4 by "auto".

    Args:
        plan: of the motion.
        planned: plans the same motion by "auto" at a relative tolerance.
    """
    if plan.method == "rk4":
        return ReferenceMotions((planned(REFERENCES[0]), planned(REFERENCES[1])))
    narrow = max(plan.rtol / NARROWER, NARROWEST)
    return ReferenceMotions((_by(plan, float(np.sqrt(plan.rtol * narrow))), _by(plan, narrow)))


def _halved(times: Array, rounds: int) -> Array:
    """Return times with the middles between them, so many times: of closed mechanisms no step is longer."""
    for _ in range(rounds):
        times = np.insert(times, np.arange(1, times.size), 0.5 * (times[1:] + times[:-1]))
    return times


def _by(plan: IntegratorPlan, rtol: float) -> IntegratorPlan:
    atol = None if plan.atol is None else np.asarray(plan.atol) * (rtol / plan.rtol)
    return replace(plan, rtol=rtol, atol=atol)


def _less(states: Array, reference: Array, coordinates: tuple[str, ...]) -> Array:
    """Return described states less those of a reference, (T, size).

    Of the angles that mean a rotation of three degrees of freedom those of the reference are taken that are nearest.
    """
    near, half = reference.copy(), len(coordinates)
    for joint in rotating_joints(coordinates):
        places = index_of(coordinates, [component_name(joint, angle) for angle in ANGULAR])
        here, same = states[:, places], reference[:, places]
        other = np.pi + same * [1.0, -1.0, 1.0]
        ways = np.stack([same, other])
        ways += 2.0 * np.pi * np.round((here - ways) / (2.0 * np.pi))
        chosen = np.abs(ways - here).sum(axis=2).argmin(axis=0)
        near[:, places] = ways[chosen, np.arange(len(here))]
        near[chosen == 1, half + places[1]] *= -1.0
    return np.asarray(states - near)


def global_error(
    kernel: Kernel,
    trajectory: Trajectory,
    *,
    drive: DriveFunction | ArrayLike | None = None,
    wrench: WrenchFunction | WrenchLike | None = None,
    prescribed: MotionFunction | None = None,
) -> GlobalError:
    """Estimate the global error of a motion of a kernel, whoever integrated it, beside motions by narrow tolerances.

    What it takes for exact are the first sample, the times, and the laws as they are described.  References are
    integrated by "auto" at rtol 1e-8 and 1e-10, and at 1e-12 where these do not agree.

    Args:
        kernel: as of ``integrate``.
        trajectory: of that kernel with two samples at least.
        drive, wrench, prescribed: under which it moved, as of ``integrate``.

    Raises:
        InputError: the trajectory is not of the kernel, or an argument is wrong.
        ArrayError: a load at the first sample has another shape, or is not finite.
        LoopError: the first sample violates the constraints.
    """
    check_kind("kernel", kernel, hasattr(kernel, "calls"), "a Kernel (of eomgen.build, or of a generated package)")
    check_kind(
        "trajectory", trajectory, isinstance(trajectory, Trajectory), "a Trajectory, of eomgen.integration.integrate"
    )
    if trajectory.coordinates != kernel.coordinates or (trajectory.internal_states or ()) != kernel.internal_states:
        got, allowed = listed(trajectory.coordinates), listed(kernel.coordinates)
        raise InputError(f"trajectory: is of {got}; allowed: a motion of {kernel.name}, of {allowed}")
    drive = drive_of(kernel, drive)

    def begin() -> System:
        return system_of(kernel, drive, wrench, prescribed)

    q, v = trajectory.q, trajectory.rates
    span = float(trajectory.t[-1] - trajectory.t[0])
    loads = begin().loads
    plans = [plan_integration(kernel, IntegratorOptions(rtol=rtol), loads, q[0], span) for rtol in REFERENCES]
    for pair in pairwise(plans):
        motions = ReferenceMotions(pair)
        errors = motions.extend(begin, trajectory.t, np.hstack([q, v]))
        estimate = error_of(kernel, errors, motions)
        if estimate.is_resolved:
            break
    return estimate


def error_of(kernel: Kernel, errors: Array, motions: ReferenceMotions) -> GlobalError:
    """Return errors of a kernel's states, (T, size), beside its references, with those of internal states apart."""
    q, v, z = (np.ascontiguousarray(x) for x in np.split(errors, [kernel.n, 2 * kernel.n], axis=1))
    return GlobalError(
        coordinates=kernel.coordinates,
        q_error=q,
        v_error=v,
        z_error=z if kernel.internal_states else None,
        unresolved=motions.unresolved(kernel.coordinates),
    )
