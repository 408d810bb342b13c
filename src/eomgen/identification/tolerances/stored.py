"""Accuracies by tolerances as .json files, read again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...description.recorded import robot_from_record
from ..saved import damage_named, declared_value, read_plain
from .budgeting import tolerance
from .recorded import KIND
from .result import ToleranceResult
from .table import CORRELATIONS

_KEYS: Mapping[str, Any] = {
    "table": Mapping[str, Mapping[str, Any]],
    "correlations": tuple[Mapping[str, Any], ...],
    "frame": str,
    "q": tuple[tuple[float, ...], ...],
    "wrench": tuple[float, ...] | None,
    "confidence": float,
    "t": tuple[float, ...] | None,
}


def load_tolerance(path: Path | str) -> ToleranceResult:
    """The result that ``ToleranceResult.save`` wrote, computed anew from what was asked.

    Raises:
        InputError: the file cannot be read, or is no such result.
        DescriptionError: its robot or its table cannot be.
    """
    data = {CORRELATIONS: [], **read_plain(KIND, path)}  # files from before there were any
    with damage_named(path, "accuracy by tolerances"):
        given = {name: declared_value(kind, data, name, str(path)) for name, kind in _KEYS.items()}
        found = tolerance(
            robot_from_record(data.get("description", {}), str(path)),
            {**given["table"], CORRELATIONS: given["correlations"]},
            given["frame"],
            poses=np.array(given["q"], dtype=np.float64),
            wrench=given["wrench"],
            confidence=given["confidence"],
        )
        if given["t"] is None:
            return found
        t = np.array(given["t"], dtype=np.float64)
        if t.shape != (len(found.q),) or not np.isfinite(t).all():
            raise ValueError(f"t of shape {t.shape}")
    return replace(found, t=t)
