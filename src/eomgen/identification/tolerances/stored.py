"""Accuracies by tolerances as .json files, read again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ...description.recorded import robot_from_record
from ...errors import InputError
from ...files import read_regular
from ...forms.plain import parse_json
from ...names import show
from .budgeting import tolerance
from .recorded import FORMAT
from .result import ToleranceResult

_MOST_BYTES, _MOST_MEMORY = 64 * 2**20, 512 * 2**20


def load_tolerance(path: Path | str) -> ToleranceResult:
    """The result that ``ToleranceResult.save`` wrote, computed anew from what was asked.

    Raises:
        InputError: the file cannot be read, or is no such result.
        DescriptionError: its robot or its table cannot be.
    """
    try:
        text = read_regular(Path(path), _MOST_BYTES).decode("utf-8")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    data = parse_json(text, str(path), _MOST_MEMORY)
    if not isinstance(data, dict) or data.get("kind") != "tolerance" or data.get("format") != FORMAT:
        raise InputError(f"{path}: is no accuracy by tolerances; allowed: what its save wrote")
    try:
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
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: is damaged ({show(str(error))}); allowed: what its save wrote") from None
    return replace(found, t=t)
