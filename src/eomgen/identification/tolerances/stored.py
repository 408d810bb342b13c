"""Accuracies by tolerances as .json files, read again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ...description.recorded import robot_from_record
from ..saved import damage_named, read_plain
from .budgeting import tolerance
from .recorded import KIND
from .result import ToleranceResult


def load_tolerance(path: Path | str) -> ToleranceResult:
    """The result that ``ToleranceResult.save`` wrote, computed anew from what was asked.

    Raises:
        InputError: the file cannot be read, or is no such result.
        DescriptionError: its robot or its table cannot be.
    """
    data = read_plain(KIND, path)
    with damage_named(path, "accuracy by tolerances"):
        found = tolerance(
            robot_from_record(data["description"], str(path)),
            dict(data["table"]),
            str(data["frame"]),
            poses=np.array(data["q"], dtype=np.float64),
            wrench=data["wrench"],
            confidence=data["confidence"],
        )
        if data["t"] is None:
            return found
        t = np.array(data["t"], dtype=np.float64)
        if t.shape != (len(found.q),) or not np.isfinite(t).all():
            raise ValueError(f"t of shape {t.shape}")
    return replace(found, t=t)
