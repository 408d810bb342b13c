"""Files and folders of results: which kind they are of, and the result that they hold, whatever its kind.

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
        from . import analysis as analysis  # it declares its kinds

        kind = bare_kind(place) or ""
    if not kind and place.suffix != JSON:
        return load_simulation(path)
    from . import identification as identification  # likewise, also those of analysis
    from .control import feedforward_result as feedforward_result
    from .control.inversion import result as result

    if kind not in KINDS:
        allowed = listed(sorted(KINDS), len(KINDS))
        raise InputError(f"{path}: is no result that eomgen wrote (kind: {show(kind)}); allowed: those of {allowed}")
    return read(KINDS[kind], path)


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
