"""Pages about results of measurements and of deflection: each kind has a function that returns its Report, in PAGES."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ...analysis.statics import Deflection
from ...errors import InputError
from ...identification.calibration.result import CalibrationResult
from ...identification.choosing.result import PosesResult
from ...identification.compensating.result import CompensationResult
from ...identification.dynamics.result import IdentifyResult
from ...identification.exciting.result import ExciteResult
from ...identification.from_motion import ForcesResult
from ...identification.iso_9283.result import AccuracyResult
from ...identification.stiffness.result import FitResult
from ...identification.tolerances.result import ToleranceResult
from ...names import listed, show
from ..report import Report
from .accuracy import accuracy_page
from .calibration import calibration_page
from .choosing import poses_page
from .compensation import compensation_page
from .deflected import deflection_page
from .excitation import excitation_page
from .motions import fit_page, forces_page, identify_page
from .tolerances import tolerance_page

PAGES: Mapping[type, Callable[[Any], Report]] = {
    AccuracyResult: accuracy_page,
    CalibrationResult: calibration_page,
    CompensationResult: compensation_page,
    Deflection: deflection_page,
    ExciteResult: excitation_page,
    FitResult: fit_page,
    ForcesResult: forces_page,
    IdentifyResult: identify_page,
    PosesResult: poses_page,
    ToleranceResult: tolerance_page,
}


def page_of(result: Any) -> Report:
    """The page about a result of measurements.

    Raises:
        InputError: there is no page of such a thing, or Matplotlib is not installed.
    """
    if type(result) not in PAGES:
        allowed = listed(sorted(kind.__name__ for kind in PAGES))
        raise InputError(f"report: got {show(type(result).__name__)}; allowed: SimulationResult, {allowed}")
    return PAGES[type(result)](result)
