"""The table of formulas of laws with internal states."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from eomgen.robot.internal_states.drives import DRIVE
from eomgen.robot.laws import states_of
from eomgen.robot.model import Model

from ...tree.bound import Bound
from ...tree.spatial import Scalar
from ..scalar_functions import Functions
from .bouc_wen import hysteresis
from .branches import maxwell
from .bristles import lugre
from .formula import LawArguments, StateEffect

STATE_FORMULAS: Mapping[str, Callable[[LawArguments], StateEffect]] = {  # by the names of the laws
    "friction": lugre,
    "hysteresis": hysteresis,
    "maxwell": maxwell,
}


@dataclass(frozen=True)
class StateLaw:
    """A law with internal states: its name, numbers with those of laws beside it, indices of its states, (k,)."""

    name: str
    numbers: Mapping[str, Scalar]
    states: tuple[int, ...]
    bound: Bound

    def effect(self, s: Scalar, rate: Scalar, v: Sequence[Scalar], f: Functions) -> StateEffect:
        """Return what it does at the deviation s and its rate; states are among the velocities v, (n,)."""
        inertias = [self.bound.armature[k] for k in self.states]
        x = LawArguments(self.numbers, s, rate, [v[k] for k in self.states], inertias, f)
        return STATE_FORMULAS[self.name](x)


def state_laws(model: Model, bound: Bound, prefix: str, numbers: Mapping[str, Scalar]) -> list[StateLaw]:
    """Return the laws with internal states among those whose parameters have a prefix; drives are ``drives.Drives``."""
    names = dict.fromkeys(name for name, _ in states_of(numbers) if name != DRIVE) if numbers else ()
    return [StateLaw(name, numbers, model.state_places[prefix, name], bound) for name in names]
