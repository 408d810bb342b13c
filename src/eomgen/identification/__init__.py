"""What measurements say of a robot: forces; stiffness and damping; masses, inertias and friction; accuracy by ISO 9283.

Uses runtime, robot, forms, description, state, motion, pipeline, analysis, simulation and sweep.
"""

from .estimates import Estimate, FitResult, FittedCoordinate
from .from_motion import ForcesResult, forces
from .identifiable import BaseParameters, base_parameters
from .inertial import IdentifyResult, Residuals, identify
from .iso_9283.evaluate import accuracy
from .iso_9283.result import AccuracyResult, load_accuracy
from .least_squares import fit

__all__ = [
    "AccuracyResult",
    "BaseParameters",
    "Estimate",
    "FitResult",
    "FittedCoordinate",
    "ForcesResult",
    "IdentifyResult",
    "Residuals",
    "accuracy",
    "base_parameters",
    "fit",
    "forces",
    "identify",
    "load_accuracy",
]
