"""A chart of a closed mechanism that its joints' singular angles do not end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import EllipsisType

import numpy as np

from ..arrays import Array, Index
from ..kernel.complete import Kernel
from ..kernel.turning import singular_joints
from ..state.turning import Turns
from .chart import Chart, Followed


@dataclass(frozen=True)
class ChartRows:
    """Rows of a batch with the same singular angles: their kernel, chart and assembled states."""

    rows: Index | EllipsisType
    kernel: Kernel
    chart: Chart
    assembled: Followed


class TurningChart:
    """Charts of one mechanism whose joints have 3-DOF rotations; states as described.

    Independent coordinates are of joints that stay as they are.

    Attributes:
        kernel: as described.
        free: indices of the independent coordinates where it began, (f,).
    """

    def __init__(self, kernel: Kernel, q: Array, free: Sequence[int]) -> None:
        """Begin with the best chart about an assembled state.

        Args:
            kernel: of a robot with loops.
            q: an assembled state, (n,).
            free: indices of the coordinates out of which the independent ones are to be.

        Raises:
            LoopError: these do not hold all the others.
        """
        self.kernel, self._among = kernel, list(free)
        self._turns = Turns(kernel, np.isin(np.arange(kernel.n), self._among))
        self._charts: dict[frozenset[str], Chart] = {}
        self._turned, self._told = frozenset[str](), q
        self.free = self._begin(q).free

    @property
    def joints(self) -> Mapping[str, tuple[int, int]]:
        """Places of alpha and of x of the joints that may be turned."""
        return self._turns.joints

    @property
    def charts(self) -> Mapping[frozenset[str], Chart]:
        """Charts so far, by the joints whose angles they switch; the first is that of the beginning."""
        return self._charts

    def go_on(self, q: Array, *, near: bool = False) -> Array:
        """Assemble a state, (n,), and go on from it; return it.

        Args:
            q: (n,); what is not dependent stays.
            near: whether the dependent coordinates are a guess; otherwise they follow from the state used last.

        Raises:
            LoopError: it does not close there.
        """
        if near:
            self._begin(q)
        self._turns.take(self._turned)
        chart = self._here(q)
        here, slopes = chart.assemble(self._turns.q_on(q) if near else q, near=near)
        self._told = self._turns.q_back(here, self._told)
        chart.use(here, slopes)
        if singular_joints(here, self._turns.joints):
            self._begin(self._told)
        return self._told

    def follow(self, q: Array, v: Array, a: Array) -> Iterator[ChartRows]:
        """Yield states near closure, (n,) or (T, n), whose dependent coordinates, velocities and accelerations follow.

        Raises:
            LoopError: one does not close near there.
        """
        if q.ndim == 1:
            self._turns.take(singular_joints(q, self._turns.joints))
            here = self._turns.q_on(q)
            chart = self._here(here)
            yield ChartRows(..., self._turns.here, chart, chart.follow(here, v, a, near=True))
            return
        for rows in self._turns.regular(q):
            here = self._turns.q_on(q[rows])
            chart = self._here(here[0])
            yield ChartRows(rows, self._turns.here, chart, chart.follow(here, v[rows], a[rows], near=True))

    def _begin(self, q: Array) -> Chart:
        """Return the chart that is good about a described state near closure, about which it is used next."""
        self._turns.take(singular_joints(q, self._turns.joints))
        self._turned, self._told, here = self._turns.turned, q, self._turns.q_on(q)
        chart = self._here(here)
        chart.use(*chart.assemble(here, near=True))
        return chart

    def _here(self, q: Array) -> Chart:
        """Return the chart of the joints that are turned now.

        Where there is none yet, it is made about a state in their coordinates.
        """
        turned = self._turns.turned
        if turned not in self._charts:
            self._charts[turned] = Chart(self._turns.here, q, free=self._among)
        return self._charts[turned]
