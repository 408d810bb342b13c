"""Calibrations as .npz files, written: arrays, and everything else as one text of JSON."""

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
ARRAYS = ("values", "described", "deviations", "x", "covariance")
PLAIN = (
    *("robot", "rows", "names", "units", "confidence", "rank", "rank_above_noise", "merged", "weak", "residuals"),
    *("variant", "noise", "is_noise_known", "freedoms", "chi2", "prior", "mistrusted", "notes", "source", "frames"),
)


def write_record(result: Any, target: Path) -> Path:
    """Write a result as .npz, and return the path.

    Raises:
        InputError: another ending, or the file cannot be written.
    """
    if target.suffix != ".npz":
        raise InputError(f"output: {show_path(str(target))}; allowed: a path that ends in .npz")
    model = result.model
    meta: dict[str, Any] = {name: getattr(result, name) for name in PLAIN}
    meta["merged"], meta["noise"], meta["frames"] = dict(result.merged), dict(result.noise), dict(result.frames)
    meta |= {
        "kind": "calibration",
        "format": FORMAT,
        "gain": None if result.gain is None else vars(result.gain),
        "description": record_of(model.robot),
        "quantities": [vars(quantity) for quantity in model.quantities],
        "bases": {str(number): pose.tolist() for number, pose in model.bases.items()},
        "tools": {name: model.tool_on_link(name, link).tolist() for name, link in result.frames.items()},
    }
    arrays: dict[str, Any] = {name: getattr(result, name) for name in ARRAYS}
    arrays["meta"] = np.array(json.dumps(meta))
    return write_atomically(target, lambda stream: np.savez_compressed(stream, **arrays))
