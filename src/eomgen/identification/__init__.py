"""A measured motion and what it says of a robot: forces; stiffness and damping with their confidence; what can be
found of masses and inertias.

Uses runtime, robot, description, state, motion, pipeline and analysis.
"""

from .estimates import Estimate, FitResult, FittedCoordinate
from .from_motion import ForcesResult, forces
from .identifiable import BaseParameters, base_parameters
from .inertial import IdentifyResult, Residuals, identify
from .least_squares import fit

__all__ = [
    "BaseParameters",
    "Estimate",
    "FitResult",
    "FittedCoordinate",
    "ForcesResult",
    "IdentifyResult",
    "Residuals",
    "base_parameters",
    "fit",
    "forces",
    "identify",
]
