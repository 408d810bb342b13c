"""What measurements say of a robot: forces, stiffness and damping of motions; offsets and placements of poses.

Uses runtime, robot, forms, description, state, motion, pipeline and analysis.
"""

from .calibration.calibrating import calibrate
from .calibration.result import CalibrationResult
from .calibration.stored import load_calibration
from .choosing.choosing import poses
from .choosing.chosen import PosesResult
from .estimates import Estimate, FitResult, FittedCoordinate
from .from_motion import ForcesResult, forces
from .geometry.poses import Measured, MeasuredPoses, poses_from_columns, read_poses
from .least_squares import fit

__all__ = [
    "CalibrationResult",
    "Estimate",
    "FitResult",
    "FittedCoordinate",
    "ForcesResult",
    "Measured",
    "MeasuredPoses",
    "PosesResult",
    "calibrate",
    "fit",
    "forces",
    "load_calibration",
    "poses",
    "poses_from_columns",
    "read_poses",
]
