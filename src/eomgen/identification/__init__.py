"""Identification from measurements: stiffness, masses, friction, offsets; accuracy, tolerances and corrections.

Uses runtime, robot, results, forms, description, state, motion, integration, scenario, pipeline, analysis, simulation
and sweep.
"""

from ..lazily import public_names
from .calibration.result import CalibrationResult, load_calibration
from .calibration.solve import calibrate
from .choosing.result import PosesResult, load_poses
from .choosing.solve import poses
from .compensating.result import CompensationResult, load_compensation
from .compensating.solve import compensate
from .dynamics.result import Further, IdentifyResult, Residuals, load_identification
from .dynamics.solve import identify
from .exciting.result import ExciteResult, load_excitation
from .exciting.solve import excite
from .from_motion import ForcesResult, forces
from .geometry.covariances import read_covariances
from .geometry.poses import Measured, MeasuredPoses, poses_from_columns, read_poses
from .identifiable import BaseParameters, base_parameters
from .iso_9283.result import AccuracyResult, load_accuracy
from .iso_9283.solve import accuracy
from .stiffness.result import Estimate, FitResult, FittedCoordinate, FittedEntry, FittedMatrix, load_fit
from .stiffness.solve import fit
from .tolerances.allocation import Allocation
from .tolerances.result import ToleranceResult
from .tolerances.solve import load_tolerance, tolerance

__all__ = [
    "AccuracyResult",
    "Allocation",
    "BaseParameters",
    "CalibrationResult",
    "CompensationResult",
    "Estimate",
    "ExciteResult",
    "FitResult",
    "FittedCoordinate",
    "FittedEntry",
    "FittedMatrix",
    "ForcesResult",
    "Further",
    "IdentifyResult",
    "Measured",
    "MeasuredPoses",
    "PosesResult",
    "Residuals",
    "ToleranceResult",
    "accuracy",
    "base_parameters",
    "calibrate",
    "compensate",
    "excite",
    "fit",
    "forces",
    "identify",
    "load_accuracy",
    "load_calibration",
    "load_compensation",
    "load_excitation",
    "load_fit",
    "load_identification",
    "load_poses",
    "load_tolerance",
    "poses",
    "poses_from_columns",
    "read_covariances",
    "read_poses",
    "tolerance",
]


def __dir__() -> list[str]:
    return public_names(globals(), __all__)
