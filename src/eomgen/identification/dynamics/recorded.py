"""Identified robots as .npz files, written: arrays, and everything else as one text of JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...robot.record import record_of
from ..saved import write_arrays

KIND = "identification"
ARRAYS = ("base_values", "deviations", "described", "t", "drives", "fitted")
TEXTS = ("robot", "terms", "parameters", "names", "without_effect")
PLAIN = ("parameters", "residuals", "further", "width", "warnings", "notes")


def write_record(result: Any, target: Path) -> Path:
    """Write a result as .npz, and return the path.

    Raises:
        InputError: another ending, or the file cannot be written.
    """
    base = result.base
    meta = {
        "description": record_of(result.robot),
        "base": {name: getattr(base, name) for name in TEXTS},
        "parameters": result.parameters,
        "residuals": {name: vars(found) for name, found in result.residuals.items()},
        "further": {name: vars(found) for name, found in result.further.items()},
        "width": result.width,
        "warnings": result.warnings,
        "notes": result.notes,
    }
    arrays: dict[str, Any] = {name: getattr(result, name) for name in ARRAYS}
    arrays |= {"chosen": base.chosen, "kept": result.kept, "matrix": base.matrix}
    return write_arrays(arrays, meta, KIND, target)
