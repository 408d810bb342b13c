"""Arguments and results of formulas of laws with internal states."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from ...tree.spatial import Scalar
from ..element import StateSlopes
from ..scalar_functions import Functions


@dataclass(frozen=True)
class LawArguments:
    """Arguments of a law: the numbers of its coordinate's laws, deviation s, rate v, states z (k,), their inertias.

    s: m or rad; v: per s.  f: functions of the scalars.
    """

    numbers: Mapping[str, Scalar]
    s: Scalar
    v: Scalar
    z: Sequence[Scalar]
    inertias: Sequence[Scalar]
    f: Functions


@dataclass(frozen=True)
class StateEffect:
    """Resisting force (N, N m), rates of the states (k,), slopes of both, and the energy (J) that s alone stores."""

    force: Scalar
    rates: Sequence[Scalar]
    slopes: StateSlopes
    energy: Scalar = 0.0

    def state_rows(self, states: Sequence[int]) -> Iterator[tuple[int, Scalar]]:
        """Give what resists states, by their indices: minus their rates times their inertias."""
        for k, w, rate in zip(states, self.slopes.inertias, self.rates, strict=True):
            yield k, -1.0 * (w * rate)
