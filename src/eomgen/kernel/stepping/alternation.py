"""Automatic stiffness switching: of adaptive methods the one with the most progress for its cost steps next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...runtime.raw import Array
from .adaptive import KEPT_NUMBERS
from .methods import COST, EVALUATIONS, RADAU
from .options import TURNS

EVALUATION, ELIMINATION = 2.0, 8.0  # of Radau IIA: an evaluation with its share of solves, and all its factors
TRIAL = 24  # steps by which a method shows what it is worth
LONG_TRIAL = 8  # those of Radau IIA, which are long,
RUN_UP = 4  # behind so many in which they become so
FEW, MANY = 8, 64  # trials' lengths that the better one then goes on for, longer and longer
FRESH = (0.0, 0.0, 1.0, 1.0)  # what steps of Radau IIA begin with, before what counts their work


@dataclass(frozen=True)
class Turn:
    """Steps of a state by one method.

    Attributes:
        steps: how many, rejected ones too.
        led: time by which they led on, s.
        evaluations: of accelerations.
        cost: in evaluations.
    """

    steps: int
    led: float
    evaluations: int
    cost: float


def implicit_spans(turns: Sequence[str], spans: Mapping[str, float]) -> dict[str, float]:
    """Return the time that implicit methods integrated, s, of that of each method, by names for reports."""
    totals = {"implicit_s": sum(spans[name] for name in turns if name != "tsit5")}
    return totals | ({"radau_s": spans[RADAU]} if RADAU in turns else {})


class Spent:
    """Counter of a state's work: made before a turn, and asked behind it.

    Args:
        progress: of the state, in C.
        begin: time at the first sample, s, which a state that has not begun does not know.
        row: what steps of Radau IIA leave to the next call, if they take turns.
    """

    def __init__(self, progress: Any, begin: float, row: Array | None) -> None:
        self._progress, self._row = progress, row
        self._steps, self._t = progress.steps + progress.rejected, progress.t if progress.sample else begin
        self._counts = (0, 0) if row is None else (int(row[4]), int(row[5]))

    def until_now(self, method: str) -> Turn:
        """Return the work of a method since then."""
        steps = int(self._progress.steps + self._progress.rejected - self._steps)
        led = float(self._progress.t - self._t)
        if method != RADAU or self._row is None:
            return Turn(steps, led, EVALUATIONS[method] * steps, float(COST[method] * steps))
        evaluations, eliminations = (int(self._row[4 + k]) - self._counts[k] for k in range(2))
        return Turn(steps, led, evaluations, EVALUATION * evaluations + ELIMINATION * eliminations)


class Alternation:
    """Automatic stiffness switching: the method with the most progress for its cost; others are tried now and then.

    What stiffness costs an explicit method, and accuracy an implicit one of low order, shows on the way alone; all is
    counted, in steps and evaluations, so that a motion is the same on every machine.

    Args:
        turns: the methods; the first one begins.

    Attributes:
        method: that takes the next steps.
        steps: how many of them.
    """

    def __init__(self, turns: Sequence[str] = TURNS) -> None:
        self._turns = tuple(turns)
        self._worth: dict[str, float] = {}
        self._next: dict[str, float] = {}
        self._untried = list(self._turns[1:])  # before one is chosen
        self._better, self._length = "", FEW
        self._before = self._turns[0]  # the method of the last steps
        self._led, self._cost = 0.0, 0.0
        self.method, self.steps = self._turns[0], TRIAL
        self._is_trial, self._runs_up = True, False

    def took(self, turn: Turn) -> None:
        """Count a turn's progress and cost; choose a method anew at its end."""
        self._led, self._cost, self.steps = self._led + turn.led, self._cost + turn.cost, self.steps - turn.steps
        if self.steps > 0:
            return
        if self._runs_up:
            self._begin(self.method, runs_up=False)
            return
        self._worth[self.method] = self._led / self._cost
        if not self._is_trial:
            self._untried = [name for name in self._turns if name != self.method]
        if self._untried:
            self._begin(self._untried.pop(0))
            return
        better = max(self._worth, key=lambda name: self._worth[name])
        self._length = min(2 * self._length, MANY) if better == self._better else FEW
        self._better = better
        self._begin(better, self._length, runs_up=better != self.method)

    def hand_over(self, progress: Any, row: Array | None) -> None:
        """Set a state's step size to that of its next method's last turn, without the past of other methods.

        Args:
            progress, row: as of ``Spent``.
        """
        if row is None or self.method == self._before:
            return
        self._next[self._before] = progress.next
        progress.next = self._next.get(self.method, progress.next)
        if self.method == RADAU:
            row[: len(FRESH)], row[KEPT_NUMBERS:] = FRESH, 0.0
        self._before = self.method

    def _begin(self, method: str, trials: int = 0, *, runs_up: bool = True) -> None:
        """Begin a turn of so many trials' lengths, or a trial."""
        self.method, self._led, self._cost, self._is_trial = method, 0.0, 0.0, not trials
        self._runs_up = runs_up and method == RADAU
        self.steps = RUN_UP if self._runs_up else max(trials, 1) * (LONG_TRIAL if method == RADAU else TRIAL)
