"""Rigid mechanisms with closed loops along a reference trajectory: their path, and their inverse dynamics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array, Index, Mask
from ..errors import LoopError
from ..kernel.complete import Kernel
from ..kernel.stepping.input_signals import ChartData, MechanismData
from ..loops.turning import TurningChart
from ..motion.point_to_point import Program
from ..names import joint_of
from ..robot.coordinates import index_of
from ..state.vectors import MotionFunction, prescribed_mask

FINE = 0.05  # rad or m, between two states of a path that is assembled from one to the next
LEAST, MOST, LOOKED_AT = 200, 20_000, 2_000  # of them, and how many are looked at to see how far the reference goes
AGREES = 1e-9  # m or rad: references of more drives than freedoms that contradict each other do by more


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A rigid mechanism with loops whose coordinates all depend on the driven ones.

    Attributes:
        rigid: its kernel, with residual, mass_matrix and the constraint.
        driven: indices of the driven coordinates, in the order of the reference, (k,).
        chart: its independent coordinates are some of the driven ones.
    """

    rigid: Kernel
    driven: Index
    chart: TurningChart

    @cached_property
    def mask(self) -> Mask:
        """Which coordinates are driven, (n,)."""
        return np.isin(np.arange(self.rigid.n), self.driven)

    def forces(self, q: Array, v: Array, a: Array) -> Array:
        """Compute actuator forces of a motion (inverse dynamics), (n,) or (N, n); 0 at coordinates without a drive.

        With redundant actuation the minimum-norm ones.

        Args:
            q, v, a: states near assembly; driven and prescribed coordinates count, the others are solved for.

        Raises:
            LoopError: it does not close there.
        """
        u, index = np.zeros_like(q), np.sort(self.driven)
        for group in self.chart.follow(q, v, a):
            chart, solution = group.chart, group.assembled
            q_closed, v_closed, a_closed = (np.ascontiguousarray(x) for x in solution[:3])
            r = group.kernel.residual(q_closed, v_closed, a_closed, np.zeros_like(q_closed))
            r_bound = r[..., np.newaxis, chart.bound]
            needed = (
                r[..., chart.free] + (r_bound @ solution.slopes[..., chart.free])[..., 0, :]
            )  # the loops do no work
            forces = np.zeros_like(q_closed)
            if np.array_equal(index, chart.free):  # the independent coordinates are all of the driven ones
                forces[..., chart.free] = needed
            else:
                basis = chart.tangent_basis(solution.slopes)[..., self.driven, :]
                forces[..., self.driven] = (needed[..., np.newaxis, :] @ np.linalg.pinv(basis))[..., 0, :]
            u[group.rows] = forces
        return u

    def load_data(self) -> MechanismData:
        """Return the model for integrations in C, with the charts that were needed so far: those of its path, say."""
        joints = self.chart.joints
        charts = [
            ChartData(chart.kernel.calls, [name in turned for name in joints], chart.choice)
            for turned, chart in self.chart.charts.items()
        ]
        return MechanismData(charts, list(joints.values()), self.mask)

    def path(self, program: Program, prescribed: MotionFunction | None, duration: float) -> Path:
        """Assemble the mechanism along a reference, from the chart's state on.

        Raises:
            LoopError: it cannot follow; says when.
        """
        looked = program.at(np.linspace(0.0, duration, LOOKED_AT))[0]
        length = float(np.abs(np.diff(looked, axis=0)).max(axis=1, initial=0.0).sum())
        times = np.linspace(0.0, duration, int(np.clip(length / FINE, LEAST, MOST)) + 1)
        states = np.empty((times.size, self.rigid.n))
        for k, t in enumerate(times.tolist()):
            states[k] = self._at(program, prescribed, t)
        self._at(program, prescribed, 0.0, states[0])
        return Path(self, program, prescribed, times, states)

    def _at(self, program: Program, prescribed: MotionFunction | None, t: float, guess: Array | None = None) -> Array:
        """Assemble the mechanism at a time, (n,), from the chart's last state, which is moved there."""
        q = np.zeros(self.rigid.n) if guess is None else guess.copy()
        wanted = program.at(t)[0]
        q[self.driven] = wanted
        if prescribed is not None:
            q[prescribed_mask(self.rigid)] = np.asarray(prescribed(t)[0])
        try:
            closed = self.chart.go_on(q, near=guess is not None)
        except LoopError as error:
            raise LoopError(
                f"{error}; the reference leads there at t = {t:.4g} s", loop=error.loop, gap=error.gap
            ) from None
        off = float(np.abs(closed[self.driven] - wanted).max())
        if off > AGREES:
            name = self.rigid.coordinates[self.driven[int(np.abs(closed[self.driven] - wanted).argmax())]]
            loop = joint_of(self.rigid.constraints[0])
            raise LoopError(
                f"{self.rigid.name}: loop {loop} opens on the reference at t = {t:.4g} s: {name} is off by {off:.3g};"
                f" allowed: references of more than {self.chart.free.size} drives that do not contradict each other, or"
                " fewer coordinates in 'driven'",
                loop=loop,
                gap=off,
            )
        return closed


@dataclass(frozen=True, eq=False)
class Path:
    """States of a mechanism along its reference trajectory.

    Attributes:
        mechanism: the mechanism.
        program: reference of its driven coordinates.
        prescribed: of its prescribed ones; None without any.
        t: times, (T,), s.
        q: states, (T, n).
    """

    mechanism: Mechanism
    program: Program
    prescribed: MotionFunction | None
    t: Array
    q: Array

    def at(self, times: Array) -> Array:
        """Assemble the mechanism at times, (K,), within the path: (K, n)."""
        kernel = self.mechanism.rigid
        q = np.column_stack([np.interp(times, self.t, column) for column in self.q.T])
        q[:, self.mechanism.driven] = self.program.at(times)[0]
        if self.prescribed is not None:
            q[:, prescribed_mask(kernel)] = [self.prescribed(t)[0] for t in times.tolist()]
        fixed = [kernel.coordinates[i] for i in self.mechanism.chart.free]
        return np.asarray(kernel.assemble(q, fixed))


def mechanism_of(rigid: Kernel, driven: Sequence[str], start: Mapping[str, float]) -> Mechanism:
    """Return the mechanism where a reference of its driven coordinates begins.

    Args:
        rigid: kernel of the rigid robot.
        driven: names of the driven coordinates, in the order of the reference.
        start: coordinates near which the loops close, by name; the driven and the prescribed ones stay.

    Raises:
        LoopError: the loops do not close near there, or the drives do not hold the mechanism.
    """
    q = np.array([start.get(name, 0.0) for name in rigid.coordinates])
    q = rigid.assemble(q, driven)
    index = index_of(rigid.coordinates, driven)
    return Mechanism(rigid, np.asarray(index, dtype=np.intp), TurningChart(rigid, q, list(index)))
