"""Accuracies by tolerances as .json files, written: what was asked, from which everything else follows."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...files import write_atomically
from ...names import show_path
from ...robot.record import record_of
from .contributions import Exact
from .table import Tolerance

FORMAT = 1


def write_record(result: Any, target: Path) -> Path:
    """Write the robot, the table, poses and wrench of a result as .json, and return the path.

    Raises:
        InputError: another ending, or the file cannot be written.
    """
    if target.suffix != ".json":
        raise InputError(f"output: {show_path(str(target))}; allowed: a path that ends in .json")
    exact: Exact = result.exact
    loads = exact.rows.loads.get(exact.tool)
    meta = {
        "kind": "tolerance",
        "format": FORMAT,
        "description": record_of(exact.model.robot),
        "table": {given.name: _entry(given) for given in result.tolerances},
        "frame": result.frame,
        "q": result.q.tolist(),
        "t": None if result.t is None else result.t.tolist(),
        "wrench": None if loads is None else np.asarray(loads)[0].tolist(),
        "confidence": result.confidence,
    }
    text = json.dumps(meta, indent=1, allow_nan=False)
    return write_atomically(target, lambda stream: stream.write(text.encode("ascii")))


def _entry(given: Tolerance) -> dict[str, float | bool]:
    """A tolerance as a table has it."""
    size = {"deviation": given.deviation} if given.deviation is not None else {"bound": given.bound}
    plain: dict[str, Any] = {**size, "relative": given.relative, "cost": given.cost, "fixed": given.is_fixed}
    return plain
