"""Corrections by iterated simulation: what the tool is off by is taken from the reference, until nothing gets better.

An iteration turns the tool's error by the pseudo-inverse of its Jacobian into one of the joints, and that by the
inverse of the drives' law on the rigid model into a change of the reference (iterative learning control with a model's
inverse).  Iterations are mixed as Anderson's method does, so that what the model does not know is learnt as well.  They
begin with few knots, whose splines pass nothing fast, and go on with twice as many as long as that helps.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...arrays import Array
from ...errors import IntegrationError
from ...progress import Progress
from ...shown import prefixed
from ...simulation.controls import JointPD
from ...simulation.result import SimulationResult
from .bounds import within_limits
from .reach import Reach, in_tool_axes, tool_error
from .setting import Setting, places_of
from .splines import Basis, regular

INTERVALS, MOST_INTERVALS = 16, 256  # between knots, to begin with and at most
SAMPLES = 2  # of the reference, in an interval at least
BETTER, LAST = 0.8, 0.95  # of an error: what counts as better, and where knots cannot be set closer
PATIENCE, AT_LAST = 3, 4  # iterations without anything better, before knots are set closer, and before it ends
FINER = 0.95  # of an error that closer knots have to come to, or it ends
MEMORY = 6  # iterations that are mixed
WORSE = 1.5  # times the best error, from which on shorter steps are taken from the best iterate
SHORTEST = 0.1
EXACT = 1e-10  # m, weighted: nothing is left to be done


@dataclass(frozen=True, eq=False)
class Learnt:
    """Best iterate of learning.

    Attributes:
        wanted: correction of the reference's samples that another iteration would take, (T, m), whatever limits say.
        taken: the correction, (T, m); limits have taken what leads beyond them.
        history: weighted rms of the error that can be undone, m, of every simulation that came to its end, the first
            without correction.
        intervals: between the knots of the best one.
    """

    wanted: Array
    taken: Array
    history: tuple[float, ...]
    intervals: int


def reach_along(setting: Setting, motion: SimulationResult) -> Reach:
    """Return effects of changes of the reference on the tool along a motion, at and between the samples."""
    kernel = setting.assembly.kernel
    slopes = np.asarray(kernel.frame_jacobian(motion.trajectory.q, setting.frame))[:, :, setting.index]
    return Reach(in_tool_axes(slopes, setting.want) * setting.movable, setting.weights)


def error_of(setting: Setting, motion: SimulationResult) -> Array:
    """Return the tool's error at the reference's samples and between them, (2 T - 1, 6)."""
    return tool_error(setting.want, motion.pose)


@dataclass
class _Point:
    """An iterate: coefficients (N, m), its motion, error that can be undone, and the step that follows."""

    x: Array
    taken: Array
    motion: SimulationResult
    cost: float
    step: Array


@dataclass
class _Mixing:
    """Anderson's method: the next iterate from the last ones and their steps."""

    points: list[Array] = field(default_factory=list)
    steps: list[Array] = field(default_factory=list)

    def next(self, x: Array, step: Array, share: float) -> Array:
        """Return the next iterate."""
        self.points, self.steps = [*self.points, x][-MEMORY:], [*self.steps, step][-MEMORY:]
        if len(self.points) == 1:
            return x + share * step
        dX = np.array([(b - a).ravel() for a, b in zip(self.points, self.points[1:], strict=False)]).T
        dF = np.array([(b - a).ravel() for a, b in zip(self.steps, self.steps[1:], strict=False)]).T
        mixed = np.linalg.lstsq(dF, step.ravel(), rcond=1e-6)[0]
        return np.asarray(x + share * step - ((dX + share * dF) @ mixed).reshape(x.shape))


def learn(setting: Setting, iterations: int, report: Progress) -> Learnt:
    """Return the correction with which the simulated tool follows best.

    Args:
        setting: the task.
        iterations: simulations at most.
        report: told how far it has come.
    """
    search = _Search(setting)
    for tried in range(iterations):
        if search.best.cost <= EXACT or (search.is_stale and not search.refine()):
            break
        left = f"{prefixed(search.best.cost, 'm')}, weighted, left"
        report((tried + 1) / (iterations + 1), f"simulation {tried + 1}: {left}")
        search.go_on()
    best, wanted = search.best, search.basis.values @ (search.best.x + search.best.step)
    return Learnt(wanted, best.taken, tuple(search.history), search.intervals)


class _Search:
    """The best iterate so far, and how it goes on from the last one.

    history: errors of all simulations that came to their end.  intervals: between the knots of the best iterate.
    """

    def __init__(self, setting: Setting) -> None:
        self._setting = setting
        self.basis = Basis(setting.t, max(1, min(INTERVALS, (setting.t.size - 1) // SAMPLES)), _resting(setting))
        x = np.zeros((self.basis.values.shape[1], len(setting.index)))
        self.best = self._point = _point(setting, self.basis, x, setting.before, np.zeros_like(setting.original))
        self.history, self.intervals = [self.best.cost], self.basis.intervals
        self._before = np.inf  # the best error with knots as they were before
        self._begin()

    def _begin(self, share: float = 1.0) -> None:
        """Begin at the best iterate, with a share of the step that follows."""
        self._point, self._mixing, self._share = self.best, _Mixing(), share
        if share == 1.0:
            self._stale = 0

    @property
    def _finer(self) -> int:
        """Intervals between closer knots; as many as there are where that is all."""
        most = min(2 * self.basis.intervals, MOST_INTERVALS, (self._setting.t.size - 1) // SAMPLES)
        return max(self.basis.intervals, most)

    @property
    def is_stale(self) -> bool:
        """Whether it gets no better with these knots."""
        patience = PATIENCE if self._finer > self.basis.intervals else AT_LAST
        return self._stale >= patience or self._share < SHORTEST

    def go_on(self) -> None:
        """Simulate the next iterate; go back to the best one where it is much worse, or no motion."""
        setting = self._setting
        x = self._mixing.next(self._point.x, self._point.step, self._share)
        taken = within_limits(setting, self.basis.values @ x)
        enough = BETTER if self._finer > self.basis.intervals else LAST
        try:
            motion = setting.run(setting.original + taken)
        except IntegrationError:
            self._stale += 1
            self._begin(0.5 * self._share)
            return
        point = self._point = _point(setting, self.basis, x, motion, taken)
        self.history.append(point.cost)
        self._stale = 0 if point.cost < enough * self.best.cost else self._stale + 1
        if point.cost < self.best.cost:
            self.best, self.intervals = point, self.basis.intervals
        elif point.cost > WORSE * self.best.cost:
            self._begin(0.5 * self._share)

    def refine(self) -> bool:
        """Set knots closer; False where that is all, or brought nothing the last time."""
        finer, best = self._finer, self.best
        if finer <= self.basis.intervals or best.cost > FINER * self._before:
            return False
        self._before = best.cost
        self.basis = Basis(self._setting.t, finer, _resting(self._setting))
        self.best = _point(self._setting, self.basis, self.basis.fit(best.taken), best.motion, best.taken)
        self._begin()
        return True


def _resting(setting: Setting) -> tuple[bool, bool]:
    """Return whether the reference rests at its first and at its last sample."""
    assert setting.assembly.program is not None
    rates = np.abs(setting.assembly.program.at(setting.t)[1])
    still = rates[[0, -1]].max(axis=1, initial=0.0) <= 1e-9 * max(1.0, float(rates.max(initial=0.0)))
    return bool(still[0]), bool(still[1])


def _point(setting: Setting, basis: Basis, x: Array, motion: SimulationResult, taken: Array) -> _Point:
    reach = reach_along(setting, motion)
    error = error_of(setting, motion)
    left = reach.reached(error)
    cost = float(np.sqrt((left**2).sum(axis=1).mean()))
    step = _commanded(setting, basis, basis.fit(reach.undoing(error)[::2]), motion)
    return _Point(x, taken, motion, cost, step)


def _commanded(setting: Setting, basis: Basis, change: Array, motion: SimulationResult) -> Array:
    """Return the change of the reference by which drives change the joints so, coefficients (N, m) each.

    Computed torque on the rigid model makes them one.  A PD law kp p + kd p' has to bring up what accelerates masses.
    """
    drive = setting.assembly.drive
    if not isinstance(drive, JointPD):
        return change
    kernel, (places, ratios) = setting.assembly.kernel, places_of(setting.assembly.kernel, setting)
    q = np.ascontiguousarray(motion.trajectory.q[::2])
    zero, a = np.zeros_like(q), np.zeros_like(q)
    rows, column = places.T
    a[:, rows] = ratios * (basis.accelerations @ change)[:, column]
    z = None if motion.trajectory.z is None else motion.trajectory.z[::2]
    moving, still = (np.asarray(kernel.inverse_dynamics(q, zero, x, z=z)) for x in (a, zero))
    force = moving - still
    needed = drive.kp * (basis.values @ change) + drive.kd * (basis.rates @ change)
    for j, share in zip(column.tolist(), (ratios * force[:, rows]).T, strict=True):
        needed[:, j] += share
    lead = np.zeros_like(change)
    for j, (kp, kd) in enumerate(zip(drive.kp, drive.kd, strict=True)):
        law = kp * basis.values + kd * basis.rates
        if kp > 0.0:
            lead[:, j] = np.linalg.solve(regular(law.T @ law), law.T @ needed[:, j])
    return lead
