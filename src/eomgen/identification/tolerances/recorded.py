"""Accuracies by tolerances as .json files, written: what was asked, from which everything else follows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...robot.record import record_of
from ..saved import write_plain
from .contributions import Exact
from .correlations import plain_correlations
from .table import Tolerance

KIND = "tolerance"


def write_record(result: Any, target: Path) -> Path:
    """Write the robot, the table, poses and wrench of a result as .json, and return the path.

    Raises:
        InputError: another ending, or the file cannot be written.
    """
    exact: Exact = result.exact
    loads = exact.rows.loads.get(exact.tool)
    meta = {
        "description": record_of(exact.model.robot),
        "table": {given.name: _entry(given) for given in result.tolerances},
        "correlations": plain_correlations(result.names, result.correlation),
        "frame": result.frame,
        "q": result.q.tolist(),
        "t": None if result.t is None else result.t.tolist(),
        "wrench": None if loads is None else np.asarray(loads)[0].tolist(),
        "confidence": result.confidence,
    }
    return write_plain(meta, KIND, target)


def _entry(given: Tolerance) -> dict[str, float | bool]:
    """A tolerance as a table has it."""
    size = {"deviation": given.deviation} if given.deviation is not None else {"bound": given.bound}
    plain: dict[str, Any] = {**size, "relative": given.relative, "cost": given.cost, "fixed": given.is_fixed}
    return plain
