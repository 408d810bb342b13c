"""Accelerations of many states of a motion at once, in coordinates in which its equations are regular."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from ...arrays import Array, Index
from ...errors import ArrayError, LoopError, SingularError
from ...loops.chart import STEEP, Chart
from ...runtime.kernel import Kernel
from ...state.springs import rate_step
from ...state.turning import Turns
from ...state.vectors import Q_STEP, prescribed_mask
from ..system import System


class ManyLoads:
    """Drives, wrenches and prescribed motions of a system at many times, in described coordinates.

    Args:
        system: the equations of motion; where C integrated it, drives and prescribed motions are evaluated there.
    """

    def __init__(self, system: System) -> None:
        self.kernel, self._system = system.kernel, system

    def at(self, times: Array, q: Array, v: Array) -> tuple[Array, ArrayLike | None]:
        """Return u, (N, n), with accelerations of prescribed coordinates, and wrenches; writes the former into q, v."""
        system = self._system
        u = self._drives(times, q, v) if system.loaded is None else system.loaded.drives(times, q, v)
        wrench = system.loads[1]
        if not callable(wrench):
            return u, system.wrench(float(times[0]), q, v)
        rows = [System.wrench(system, *state) for state in zip(times.tolist(), q, v, strict=True)]
        return u, None if rows[0] is None else np.array(rows)

    def _drives(self, times: Array, q: Array, v: Array) -> Array:
        """Return u state by state, or time by time where several states have the same."""
        system, u = self._system, np.zeros_like(q)
        fixed = prescribed_mask(self.kernel)
        if system.loads[0] is None and not fixed.any():
            return u
        changes = np.flatnonzero(np.diff(times)) + 1
        for begin, end in pairwise([0, *changes.tolist(), times.size]):
            t, rows = float(times[begin]), slice(begin, end)
            accelerations = np.zeros(0)
            for i in range(begin, end if fixed.any() else begin):
                accelerations = system.prescribe(t, q[i], v[i])
            u[rows] = System.drives(system, t, q[rows], v[rows])
            u[rows, fixed] = accelerations
        return u


class Stretch:
    """A stretch of a motion, in coordinates y that determine its states and are regular there.

    These are the coordinates that are not prescribed; of joints with 3-DOF rotation those of their regular chart, of
    closed mechanisms independent ones.  States of laws have rates alone.

    Args:
        loads: of the motion.
        turned: joints in their other chart.
        times: of the nodes from the first on, s, (N,).
        nodes: described (q, v) there, (N, 2n).

    Attributes:
        times: of the nodes of the stretch, s, (K + 1,).
        y, rate: there, (K + 1, f) each.
    """

    def __init__(self, loads: ManyLoads, turned: frozenset[str], times: Array, nodes: Array) -> None:
        self._loads, self._turns = loads, Turns(loads.kernel)
        self._turns.take(turned)
        self.kernel = self._turns.here.with_checks(False)
        n = self.kernel.n
        self._near = nodes[:, :n].copy()
        self._states = self._turns.on(nodes)
        self._chart: Chart | None = None
        self._still = np.arange(n) >= len(self.kernel.coordinates)  # states of laws
        self._fixed = prescribed_mask(self.kernel)
        if self.kernel.constraints:
            self._chart = Chart(self._turns.here, self._states[0, :n])
            self._states = self._states[: self._regular_nodes()]
            self._free = self._chart.free
        else:
            self._free = np.flatnonzero(~self._fixed)
        self.times = times[: len(self._states)]
        self.y, self.rate = self.reduced(nodes[: len(self._states)])
        self._steps = Q_STEP, rate_step(loads.kernel)

    def _regular_nodes(self) -> int:
        """Return the number of nodes as far as the independent coordinates are good ones, two at least."""
        assert self._chart is not None
        n = self.kernel.n
        slopes = self._chart.follow(self._states[:, :n], near=True).slopes
        for i, (state, slope) in enumerate(zip(self._states, slopes, strict=True)):
            self._chart.use(state[:n].copy(), slope)
            if i > 0 and self._chart.steepness > STEEP:
                return i + 1
        return len(self._states)

    def reduced(self, states: Array) -> tuple[Array, Array]:
        """Return y and its rates, (N, f) each, of described states, (N, 2n), that follow on each other."""
        n, here = self.kernel.n, self._turns.on(states)
        q, v = here[:, :n], here[:, n:]
        y = np.where(self._still, 0.0, q)[:, self._free]
        return np.ascontiguousarray(y), np.ascontiguousarray(v[:, self._free])

    def described(self, times: Array, y: Array, rate: Array) -> Array:
        """Return described states, (N, 2n), that follow on each other."""
        return self._back(times, np.hstack(self._whole(times, y, rate)))

    def _back(self, times: Array, states: Array) -> Array:
        """Return described states, (N, 2n), with the angles that are next to those of the node before."""
        if not self._turns.turned:
            return states
        described, rows = np.empty_like(states), self._rows(times)
        for row in np.unique(rows).tolist():
            described[rows == row] = self._turns.back(states[rows == row], self._near[row])
        return described

    def _rows(self, times: Array) -> Index:
        """Return the numbers of the nodes before these times, (N,), one before the last at most."""
        return np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, max(self.times.size - 2, 0))

    def _whole(self, times: Array, y: Array, rate: Array) -> tuple[Array, Array]:
        """Return q and v of the stretch's kernel, (N, n) each; prescribed coordinates are as at the nodes."""
        q, v = self._between(times)
        q[:, self._free], v[:, self._free] = y, rate
        if self._chart is not None:
            followed = self._chart.follow(q, v, near=True)
            q, v = followed.q, followed.v
        q[:, self._still] = 0.0
        return np.ascontiguousarray(q), np.ascontiguousarray(v)

    def _between(self, times: Array) -> tuple[Array, Array]:
        """Return q and v, (N, n) each, interpolated between the nodes."""
        n, states = self.kernel.n, self._states
        row = self._rows(times)
        h = (self.times[row + 1] - self.times[row])[:, np.newaxis]
        x = (times - self.times[row])[:, np.newaxis] / h
        a, b = states[row], states[row + 1]
        q = a[:, :n] * (1.0 - x) + b[:, :n] * x
        q += (
            x
            * (1.0 - x)
            * ((1.0 - x) * (h * a[:, n:] - b[:, :n] + a[:, :n]) - x * (h * b[:, n:] - b[:, :n] + a[:, :n]))
        )
        return q, a[:, n:] * (1.0 - x) + b[:, n:] * x

    def between(self, times: Array) -> tuple[Array, Array]:
        """Return y and its rates, (N, f) each, interpolated between the nodes."""
        q, v = self._between(times)
        return np.where(self._still, 0.0, q)[:, self._free], v[:, self._free]

    def accelerations(self, times: Array, y: Array, rate: Array) -> Array:
        """Return y'', (N, f), at times, s, (N,); NaN where there is none."""
        try:
            q, v = self._whole(times, y, rate)
            if self._fixed.any():
                q, v = self._prescribed(times, q, v)
            n, told = self.kernel.n, (q, v)
            if self._turns.turned:
                described = self._back(times, np.hstack([q, v]))
                told = np.ascontiguousarray(described[:, :n]), np.ascontiguousarray(described[:, n:])
            u, wrench = self._loads.at(times, *told)
            if self._turns.turned:
                u = self._turns.forces(u, told[0], q)
            a = self.kernel.forward_dynamics(q, v, u, wrench=wrench)
        except (LoopError, ArrayError, SingularError):
            return np.full_like(y, np.nan)
        return np.asarray(a)[:, self._free]

    def _prescribed(self, times: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Return q and v of the stretch's kernel, (N, n) each, with prescribed motions as they are at these times."""
        n, described = self.kernel.n, self._back(times, np.hstack([q, v]))
        told = np.ascontiguousarray(described[:, :n]), np.ascontiguousarray(described[:, n:])
        self._loads.at(times, *told)
        here = self._turns.on(np.hstack(told))
        q, v = np.ascontiguousarray(here[:, :n]), np.ascontiguousarray(here[:, n:])
        if self._chart is not None:
            followed = self._chart.follow(q, v, near=True)
            q, v = np.ascontiguousarray(followed.q), np.ascontiguousarray(followed.v)
        return q, v

    def slopes(self, times: Array, y: Array, rate: Array) -> tuple[Array, Array]:
        """Differentiate accelerations by y and its rates, (N, f, f) each, by finite differences."""
        f = y.shape[1]
        steps = [step * np.maximum(1.0, np.abs(x)) for step, x in zip(self._steps, (y, rate), strict=True)]
        each = np.arange(f)
        ys, rates = (np.repeat(x[:, np.newaxis], 2 * f + 1, axis=1) for x in (y, rate))
        ys[:, 1 + each, each] += steps[0]
        rates[:, 1 + f + each, each] += steps[1]
        a = self.accelerations(np.repeat(times, 2 * f + 1), ys.reshape(-1, f), rates.reshape(-1, f))
        a = a.reshape(times.size, 2 * f + 1, f)
        change = np.swapaxes(a[:, 1:] - a[:, :1], 1, 2)
        return change[:, :, :f] / steps[0][:, np.newaxis], change[:, :, f:] / steps[1][:, np.newaxis]


def turned_joints(kernel: Kernel, q: Array) -> list[frozenset[str]]:
    """Return names of the joints to be in their other chart in each described state, (N, n)."""
    rows: list[frozenset[str]] = [frozenset()] * len(q)
    turns = Turns(kernel)
    for places in turns.regular(q):
        for i in places.tolist():
            rows[i] = turns.turned
    return rows
