"""A kernel over time: the system of equations, steps, solvers, contacts, loops that stay closed.

Uses runtime, robot, state and loops; never the generator or the pipeline, so that it builds nothing behind your back.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .contacts import Contact as Contact
    from .methods import METHODS as METHODS
    from .plan import choose_method as choose_method
    from .resting import Rest as Rest
    from .resting import rests as rests
    from .solve import integrate as integrate
    from .trajectory import Trajectory as Trajectory
    from .until import Until as Until
else:  # or type checkers would take every name to be there
    __getattr__, __dir__, __all__ = attributes(
        __name__,
        "contacts: Contact",
        "methods: METHODS",
        "plan: choose_method",
        "resting: Rest rests",
        "solve: integrate",
        "trajectory: Trajectory",
        "until: Until",
    )
