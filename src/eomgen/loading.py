"""Results of all kinds, read from files and folders.

Uses results, simulation, analysis, sweep, identification and control.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from .errors import InputError
from .files import as_path
from .names import listed, show
from .results.beside import STREAM, SWEEP, TRAJECTORY
from .results.contents import JSON
from .results.kinds import KINDS, bare_kind, kind_of, read
from .simulation.result import load_result as load_simulation

CSV = ".csv"


def load_result(path: Path | str) -> Any:
    """Load the result of a file or a folder that eomgen wrote, whatever its kind; its type says what it is.

    Args:
        path: a file that a result's ``save`` wrote, or the folder of a simulation, a sweep or a stream.

    Returns:
        a ``SimulationResult``, ``SweepResult``, ``StreamedMotion``, or a result of ``eomgen.analysis``,
        ``eomgen.identification`` or ``eomgen.control``.

    Raises:
        InputError: nothing is there, it is no result, or a damaged one; says what in it is wrong, and what is allowed.
    """
    place = as_path(path)
    if os.path.isdir(place):
        return _of_folder(place)
    if place.suffix == CSV:
        return load_simulation(place)  # which says what reads it
    kind = kind_of(place)
    if kind is None:
        _bare_results()
        kind = bare_kind(place) or ""
    if not kind and place.suffix != JSON:
        return load_simulation(path)
    _bare_results()
    _results()
    if kind not in KINDS:
        allowed = listed(sorted(KINDS), len(KINDS))
        raise InputError(f"{path}: is no result that eomgen wrote (kind: {show(kind)}); allowed: those of {allowed}")
    return read(KINDS[kind], path)


def _bare_results() -> tuple[type, ...]:
    """Return classes of results whose files do not name their kind; the modules that define them declare it."""
    from .analysis.compliance import ComplianceMap
    from .analysis.frequency import Response
    from .analysis.matrices import StateSpace

    return ComplianceMap, Response, StateSpace


def _results() -> tuple[Any, ...]:
    """Return classes of other results, or what loads them; the modules that define them declare their kinds."""
    from .control.feedforward_result import FeedForward
    from .control.inversion.result import StableInversion
    from .identification.calibration.result import CalibrationResult
    from .identification.choosing.result import PosesResult
    from .identification.compensating.result import CompensationResult
    from .identification.dynamics.result import IdentifyResult
    from .identification.exciting.result import ExciteResult
    from .identification.from_motion import ForcesResult
    from .identification.iso_9283.result import AccuracyResult
    from .identification.stiffness.result import FitResult
    from .identification.tolerances.solve import load_tolerance

    measured = AccuracyResult, CalibrationResult, CompensationResult, FitResult, ForcesResult, IdentifyResult
    return FeedForward, StableInversion, ExciteResult, PosesResult, load_tolerance, *measured


def _of_folder(folder: Path) -> Any:
    if os.path.exists(folder / TRAJECTORY):
        return load_simulation(folder / TRAJECTORY)
    if os.path.exists(folder / SWEEP):
        from .sweep.result import SweepResult

        return SweepResult.load(folder)
    if os.path.exists(folder / STREAM):
        from .simulation.stream import load_stream

        return load_stream(folder)
    allowed = f"a folder that eomgen wrote, with {TRAJECTORY}, {SWEEP} or {STREAM}"
    raise InputError(f"{folder}: holds no result; allowed: {allowed}")
