"""A kernel over time: the system of equations, steps, solvers, contacts, loops that stay closed.

Uses runtime, robot, state and loops; never the generator or the pipeline, so that it builds nothing behind your back.
"""

from .contacts import Contact
from .solve import METHODS, choose_method, integrate
from .trajectory import Trajectory

__all__ = ["METHODS", "Contact", "Trajectory", "choose_method", "integrate"]
