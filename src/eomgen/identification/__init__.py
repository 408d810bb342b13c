"""A measured motion and what it says of a robot: forces; stiffness and damping with their confidence.

Uses runtime, robot, description, state, motion, pipeline and analysis.
"""

from .estimates import Estimate, FitResult, FittedCoordinate
from .from_motion import ForcesResult, forces
from .least_squares import fit

__all__ = ["Estimate", "FitResult", "FittedCoordinate", "ForcesResult", "fit", "forces"]
