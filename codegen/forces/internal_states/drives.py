"""Drives with electricity and controllers on their coordinates: rows, slopes, implicit shares, and what they take.

The input u of a drive stands in arrays of drives at its coordinate; a force beside it at the place of the drive's first
state.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import ClassVar

from eomgen.robot.internal_states.drives import RESISTANCE, TORQUE_CONSTANT, has_winding

from ...tree.composite import Rows
from ...tree.spatial import Scalar
from ..element import ForceElement, ImplicitShare, Slopes, StateSite, StateSlopes, add_to
from .cascade import Cascade, Driven, Signal

NO_GAINS: Mapping[int, tuple[Scalar, Scalar]] = MappingProxyType({})
Places = tuple[int, tuple[int, ...]]  # indices of a coordinate and of the states of its drive


class Drives(ForceElement):
    """Drives of all coordinates that have such a law."""

    IS_DRIVE: ClassVar[bool] = True

    def resist(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give minus the forces on coordinates, and minus the rates of states times their inertias."""
        yield from self._rows(self.at.q, v, self.at.inputs)

    def passive(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give what windings do without a voltage: force, resistance and induced voltage."""
        for i, states in self.at.model.drives.items():
            numbers = self.at.bound.laws[i].numbers
            if has_winding(numbers):
                current, constant = v[states[-1]], numbers[TORQUE_CONSTANT]
                yield i, -1.0 * (constant * current)
                yield states[-1], numbers[RESISTANCE] * current + constant * v[i]

    def driving(self, v: Sequence[Scalar]) -> Iterator[tuple[int, Scalar]]:
        """Give forces on coordinates, and voltages on windings' currents less what the motion induces.

        Their power by v is what the drives take in.
        """
        for (i, states), drive in self._drives(self.at.q, v, self.at.inputs):
            yield i, drive.force.value
            numbers = self.at.bound.laws[i].numbers
            if has_winding(numbers):
                yield states[-1], drive.voltage.value - numbers[TORQUE_CONSTANT] * v[i]

    def add_slopes(self, slopes: Slopes) -> None:
        """Add slopes of forces and of states' rates."""
        for (i, states), drive in self._drives(slopes.q, slopes.v, self.at.inputs):
            for row, factor, signal in self._signals(i, states, drive):
                slopes.add((row, i), factor * signal.slope("s"), factor * signal.slope("v"))
                for k, name in zip(states, self._names(i), strict=True):
                    if name in signal.slopes:
                        slopes.add((row, k), 0.0, factor * signal.slopes[name])

    def input_slopes(self, v: Sequence[Scalar]) -> Rows:
        """Return derivatives of what ``resist`` gives by the inputs, columns by their coordinates."""
        rows: Rows = {}
        for (i, states), drive in self._drives(self.at.q, v, self.at.inputs):
            for row, factor, signal in self._signals(i, states, drive):
                if "u" in signal.slopes:
                    add_to(rows, (row, i), factor * signal.slopes["u"])
        return rows

    def advance(self, share: ImplicitShare) -> None:
        """Push forces, and what drives the states."""
        for i, force in self._rows(share.q, share.v, share.inputs):
            share.push(i, force)

    def add_diagonal(self, share: ImplicitShare) -> None:
        """Add slopes of forces and of states' rates."""
        for (i, states), drive in self._drives(share.q, share.v, share.inputs, share.gains):
            share.in_internal_states(StateSite({i: 1.0}, states, coordinate=i), self._block(i, states, drive))

    def _block(self, i: int, states: Sequence[int], drive: Driven) -> StateSlopes:
        names = self._names(i)
        rates = [drive.rates[name] for name in names]
        force = drive.force.times(-1.0)
        couplings = {
            (row, column): rate.slopes[name]
            for row, rate in enumerate(rates)
            for column, name in enumerate(names)
            if name in rate.slopes
        }
        return StateSlopes(
            f_v=force.slope("v"),
            f_z=[force.slope(name) for name in names],
            g_v=[rate.slope("v") for rate in rates],
            g_s=[rate.slope("s") for rate in rates],
            g_z=couplings,
            inertias=[self.at.bound.armature[k] for k in states],
            f_s=force.slope("s"),
        )

    def _rows(
        self, q: Sequence[Scalar], v: Sequence[Scalar], inputs: Mapping[int, Scalar]
    ) -> Iterator[tuple[int, Scalar]]:
        for (i, states), drive in self._drives(q, v, inputs):
            for row, factor, signal in self._signals(i, states, drive):
                yield row, factor * signal.value

    def _signals(self, i: int, states: Sequence[int], drive: Driven) -> Iterator[tuple[int, Scalar, Signal]]:
        """Give the rows of a drive: the index of each, and the signal with its factor."""
        yield i, -1.0, drive.force
        for k, name in zip(states, self._names(i), strict=True):
            yield k, -1.0 * self.at.bound.armature[k], drive.rates[name]

    def _drives(
        self,
        q: Sequence[Scalar],
        v: Sequence[Scalar],
        inputs: Mapping[int, Scalar],
        gains: Mapping[int, tuple[Scalar, Scalar]] = NO_GAINS,
    ) -> Iterator[tuple[Places, Driven]]:
        for i, states in self.at.model.drives.items():
            z = {name: v[k] for k, name in zip(states, self._names(i), strict=True)}
            numbers = self.at.bound.laws[i].numbers
            slopes = {"u": 1.0}
            if i in gains:
                slopes |= {name: -1.0 * gain for name, gain in zip("sv", gains[i], strict=True)}
            drive = Cascade(numbers, q[i], v[i], z, self.at.functions)
            yield (i, states), drive.driven(Signal(inputs[i], slopes))

    def _names(self, i: int) -> list[str]:
        """Return the names of the states of the drive on coordinate i, in their order."""
        model = self.at.model
        first = len(model.coordinates)
        return [model.states[k - first].state.name for k in model.drives[i]]
