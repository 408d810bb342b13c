"""Calibrations as .npz files, written: arrays, and everything else as one text of JSON."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...robot.record import record_of
from ..saved import write_arrays

KIND = "calibration"
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
    model = result.model
    meta: dict[str, Any] = {name: getattr(result, name) for name in PLAIN}
    meta["merged"], meta["noise"], meta["frames"] = dict(result.merged), dict(result.noise), dict(result.frames)
    meta |= {
        "gains": {name: {kind: vars(x) for kind, x in gains.items()} for name, gains in result.gains.items()},
        "is_explained": result.is_explained,
        "diagnosis": asdict(result.diagnosis),
        "description": record_of(model.robot),
        "quantities": [vars(quantity) for quantity in model.quantities],
        "bases": {str(number): pose.tolist() for number, pose in model.bases.items()},
        "tools": {name: model.tool_on_link(name, link).tolist() for name, link in result.frames.items()},
    }
    return write_arrays({name: getattr(result, name) for name in ARRAYS}, meta, KIND, target)
