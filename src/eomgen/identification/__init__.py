"""What measurements say of a robot: stiffness, masses, friction, offsets; accuracy, tolerances and corrections.

Uses runtime, robot, results, forms, description, state, motion, integration, scenario, pipeline, analysis, simulation
and sweep.
"""

from .calibration.calibrating import calibrate
from .calibration.result import CalibrationResult, load_calibration
from .choosing.choosing import poses
from .choosing.chosen import PosesResult, load_poses
from .compensating.correcting import compensate
from .compensating.result import CompensationResult, load_compensation
from .dynamics.result import Further, IdentifyResult, Residuals, load_identification
from .estimates import Estimate, FitResult, FittedCoordinate, load_fit
from .exciting.designing import excite
from .exciting.excited import ExciteResult, load_excitation
from .from_motion import ForcesResult, forces
from .geometry.covariances import read_covariances
from .geometry.poses import Measured, MeasuredPoses, poses_from_columns, read_poses
from .identifiable import BaseParameters, base_parameters
from .inertial import identify
from .iso_9283.evaluate import accuracy
from .iso_9283.result import AccuracyResult, load_accuracy
from .least_squares import fit
from .tolerances.allocation import Allocation
from .tolerances.budgeting import load_tolerance, tolerance
from .tolerances.result import ToleranceResult

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
