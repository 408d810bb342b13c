"""Detection of integrations whose time does not advance."""

from __future__ import annotations

import numpy as np

from ..errors import IntegrationError

WORK = 10_000  # evaluations between two looks: a hundred times what a jump or an impact takes
LEAST = 1e-7  # of the span by which they lead on; with less all of it would take 1e11 of them, that is weeks


class Advance:
    """Watches the times at which the equations of motion are evaluated, whatever method asks for them.

    A method evaluates at the time that it has reached and ahead of it, so that the earliest of many evaluations is
    where it stood.  How large states, velocities and forces are does not matter: they may be right.  What is judged is
    ``WORK`` evaluations that lead on by less than ``LEAST`` of the span.  Stiff motions and series of impacts stay far
    from that: an impact of 1 us in a motion of 1000 s is 1e-9 of it and takes some hundred evaluations.

    Args:
        first, last: times of the span, s.
    """

    def __init__(self, first: float, last: float) -> None:
        self.first, self.last = first, last
        self._calls, self._earliest, self._before = 0, np.inf, -np.inf

    def look(self, t: float) -> None:
        """Note an evaluation at t, s.

        Raises:
            IntegrationError: there is hardly any progress.
        """
        self._calls += 1
        self._earliest = min(self._earliest, t)
        if self._calls < WORK:
            return
        led, least = self._earliest - self._before, LEAST * (self.last - self.first)
        if not led >= least:
            left = self.last - self._earliest
            raise IntegrationError(
                f"{WORK} evaluations led on by {max(led, 0.0):.3g} s, and {left:.6g} s are left; is a force, a rate or"
                " a stiffness too large? allowed: smaller ones, an implicit method for stiff springs, or a shorter"
                " duration"
            )
        self._calls, self._earliest, self._before = 0, np.inf, self._earliest
