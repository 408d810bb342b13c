"""The kinds of results of measurements: what loads one that was saved, and what makes a page of it.

A new kind has a function that makes a Report of it, and an entry of PAGES.  Where it can be saved, its file says which
kind it is (by ``kind``, in the text ``meta`` of an .npz), and SAVED has the function that loads it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ...errors import InputError
from ...files import read_regular
from ...forms.plain import parse_json
from ...identification.calibration.result import CalibrationResult
from ...identification.calibration.stored import load_calibration
from ...identification.choosing.chosen import PosesResult, load_poses
from ...identification.compensating.result import CompensationResult
from ...identification.compensating.stored import load_compensation
from ...identification.dynamics.result import IdentifyResult
from ...identification.dynamics.stored import load_identification
from ...identification.estimates import FitResult, load_fit
from ...identification.exciting.excited import ExciteResult
from ...identification.exciting.stored import load_excitation
from ...identification.iso_9283.result import AccuracyResult, load_accuracy
from ...identification.tolerances.result import ToleranceResult
from ...identification.tolerances.stored import load_tolerance
from ...names import listed, show
from ...npz import most_bytes, read_npz
from ..report import Report
from .accuracy import accuracy_page
from .calibration import calibration_page
from .choosing import poses_page
from .compensation import compensation_page
from .excitation import excitation_page
from .motions import fit_page, identify_page
from .tolerances import tolerance_page

PAGES: Mapping[type, Callable[[Any], Report]] = {
    AccuracyResult: accuracy_page,
    CalibrationResult: calibration_page,
    CompensationResult: compensation_page,
    ExciteResult: excitation_page,
    FitResult: fit_page,
    IdentifyResult: identify_page,
    PosesResult: poses_page,
    ToleranceResult: tolerance_page,
}
SAVED: Mapping[str, Callable[[Path], Any]] = {
    "accuracy": load_accuracy,
    "calibration": load_calibration,
    "compensation": load_compensation,
    "excitation": load_excitation,
    "fit": load_fit,
    "identification": load_identification,
    "poses": load_poses,
    "tolerance": load_tolerance,
}


def page_of(found: Any) -> Report:
    """The page about a result of measurements.

    Raises:
        InputError: there is no page of such a thing, or Matplotlib is not installed.
    """
    if type(found) not in PAGES:
        allowed = listed(sorted(kind.__name__ for kind in PAGES))
        raise InputError(f"report: got {show(type(found).__name__)}; allowed: SimulationResult, {allowed}")
    return PAGES[type(found)](found)


def load_measured(path: Path) -> Any | None:
    """The result of measurements that was saved in a file; None where it is of no kind, such as a simulation.

    Raises:
        InputError: the file cannot be read, or is a damaged one of its kind.
    """
    kind = _kind_of(path)
    return None if kind is None or kind not in SAVED else SAVED[kind](path)


def _kind_of(path: Path) -> str | None:
    """Kind that a file says it is of; None where it says none."""
    if path.suffix == ".json":
        try:
            text = read_regular(path, most_bytes()).decode("utf-8")
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    else:
        meta = read_npz(path, ("meta",)).get("meta")
        text = str(meta) if meta is not None and meta.dtype.kind == "U" and meta.shape == () else ""
    values = parse_json(text, str(path), 2 * most_bytes()) if text else {}
    kind = values.get("kind") if isinstance(values, dict) else None
    return kind if isinstance(kind, str) else None
