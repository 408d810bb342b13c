"""Identification of stiffness, masses, friction and offsets; accuracy, tolerances, corrections.

Uses runtime, kernel, robot, results, forms, description, state, motion, integration, scenario, codegen (kernels),
pipeline, analysis, simulation and sweep.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from .calibration.result import CalibrationResult as CalibrationResult
    from .calibration.result import load_calibration as load_calibration
    from .calibration.solve import calibrate as calibrate
    from .choosing.result import PosesResult as PosesResult
    from .choosing.result import load_poses as load_poses
    from .choosing.solve import poses as poses
    from .compensating.result import CompensationResult as CompensationResult
    from .compensating.result import load_compensation as load_compensation
    from .compensating.solve import compensate as compensate
    from .dynamics.result import Further as Further
    from .dynamics.result import IdentifyResult as IdentifyResult
    from .dynamics.result import Residuals as Residuals
    from .dynamics.result import load_identification as load_identification
    from .dynamics.solve import identify as identify
    from .exciting.result import ExciteResult as ExciteResult
    from .exciting.result import load_excitation as load_excitation
    from .exciting.solve import excite as excite
    from .from_motion import ForcesResult as ForcesResult
    from .from_motion import forces as forces
    from .geometry.covariances import read_covariances as read_covariances
    from .geometry.poses import Measured as Measured
    from .geometry.poses import MeasuredPoses as MeasuredPoses
    from .geometry.poses import poses_from_columns as poses_from_columns
    from .geometry.poses import read_poses as read_poses
    from .identifiable import BaseParameters as BaseParameters
    from .identifiable import base_parameters as base_parameters
    from .iso_9283.result import AccuracyResult as AccuracyResult
    from .iso_9283.result import load_accuracy as load_accuracy
    from .iso_9283.solve import accuracy as accuracy
    from .stiffness.result import Estimate as Estimate
    from .stiffness.result import FitResult as FitResult
    from .stiffness.result import FittedCoordinate as FittedCoordinate
    from .stiffness.result import FittedEntry as FittedEntry
    from .stiffness.result import FittedMatrix as FittedMatrix
    from .stiffness.result import load_fit as load_fit
    from .stiffness.solve import fit as fit
    from .tolerances.allocation import Allocation as Allocation
    from .tolerances.result import ToleranceResult as ToleranceResult
    from .tolerances.solve import load_tolerance as load_tolerance
    from .tolerances.solve import tolerance as tolerance
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
