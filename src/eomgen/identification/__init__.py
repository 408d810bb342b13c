"""What measurements say of a robot: forces, stiffness and damping of motions; offsets and placements of poses.

Uses runtime, robot, forms, description, state, motion, pipeline and analysis.
"""

from .calibration.calibrating import calibrate
from .calibration.result import CalibrationResult
from .calibration.stored import load_calibration
from .estimates import Estimate, FitResult, FittedCoordinate
from .from_motion import ForcesResult, forces
from .geometry.poses import Measured, MeasuredPoses, poses_from_columns, read_poses
from .least_squares import fit
from .tolerances.allocation import Allocation
from .tolerances.budgeting import tolerance
from .tolerances.result import ToleranceResult

__all__ = [
    "Allocation",
    "CalibrationResult",
    "Estimate",
    "FitResult",
    "FittedCoordinate",
    "ForcesResult",
    "Measured",
    "MeasuredPoses",
    "ToleranceResult",
    "calibrate",
    "fit",
    "forces",
    "load_calibration",
    "poses_from_columns",
    "read_poses",
    "tolerance",
]
