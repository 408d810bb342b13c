"""What measurements say of a robot: forces; stiffness and damping with their confidence; accuracy by ISO 9283.

Uses runtime, robot, forms, description, state, motion, pipeline, analysis, simulation and sweep.
"""

from .estimates import Estimate, FitResult, FittedCoordinate
from .from_motion import ForcesResult, forces
from .iso_9283.evaluate import accuracy
from .iso_9283.result import AccuracyResult, load_accuracy
from .least_squares import fit

__all__ = [
    "AccuracyResult",
    "Estimate",
    "FitResult",
    "FittedCoordinate",
    "ForcesResult",
    "accuracy",
    "fit",
    "forces",
    "load_accuracy",
]
