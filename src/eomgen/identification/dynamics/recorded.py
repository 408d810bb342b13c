"""Identified robots as .npz files, written: arrays, and everything else as one text of JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...files import write_atomically
from ...names import show_path
from ...robot.record import record_of

FORMAT = 1
ARRAYS = ("base_values", "deviations", "described", "t", "drives", "fitted")


def write_record(result: Any, target: Path) -> Path:
    """Write a result as .npz, and return the path.

    Raises:
        InputError: another ending, or the file cannot be written.
    """
    if target.suffix != ".npz":
        raise InputError(f"output: {show_path(str(target))}; allowed: a path that ends in .npz")
    base = result.base
    meta = {
        "format": FORMAT,
        "kind": "identification",
        "description": record_of(result.robot),
        "base": {name: getattr(base, name) for name in ("robot", "terms", "parameters", "names", "without_effect")},
        "parameters": result.parameters,
        "residuals": {name: vars(found) for name, found in result.residuals.items()},
        "further": {name: vars(found) for name, found in result.further.items()},
        "width": result.width,
        "warnings": result.warnings,
        "notes": result.notes,
    }
    arrays: dict[str, Any] = {name: getattr(result, name) for name in ARRAYS}
    arrays |= {"chosen": base.chosen, "kept": result.kept, "matrix": base.matrix, "meta": np.array(json.dumps(meta))}
    return write_atomically(target, lambda stream: np.savez_compressed(stream, **arrays))
