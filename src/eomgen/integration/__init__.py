"""A kernel over time: the system of equations, steps, solvers, contacts, loops that stay closed.

Uses runtime, robot, state and loops; never the generator or the pipeline, so that it builds nothing behind your back.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .contacts import Contact
    from .methods import METHODS
    from .plan import choose_method
    from .resting import Rest, rests
    from .solve import integrate
    from .trajectory import Trajectory
    from .until import Until

__all__ = ["METHODS", "Contact", "Rest", "Trajectory", "Until", "choose_method", "integrate", "rests"]

_MODULES = {
    "Contact": "contacts",
    "METHODS": "methods",
    "Rest": "resting",
    "Trajectory": "trajectory",
    "Until": "until",
    "choose_method": "plan",
    "integrate": "solve",
    "rests": "resting",
}


if not TYPE_CHECKING:  # or type checkers would take every name to be there
    __getattr__ = attributes(__name__, _MODULES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
