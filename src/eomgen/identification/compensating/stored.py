"""Compensations as .npz files, read again."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...errors import InputError
from ...scenario.recorded import scenario_from_record
from ..saved import check_shapes, check_whole, damage_named, declared_values, number_arrays, read_arrays
from .result import AXES, CompensationResult
from .written import ARRAYS, KIND, PLAIN


def load_compensation(path: Path | str) -> CompensationResult:
    """The result that ``CompensationResult.save`` wrote.

    Raises:
        InputError: the file cannot be read, or is no compensation.
    """
    arrays, meta = read_arrays(KIND, path)
    with damage_named(path, KIND):
        found = CompensationResult(
            **declared_values(CompensationResult, meta, (*PLAIN, "limits", "robustness"), str(path)),
            **number_arrays(arrays, ARRAYS, str(path)),
            scenario=scenario_from_record(meta.get("scenario", {}), f"{path}: scenario"),
        )
        _check(found, str(path))
        check_whole(found, str(path))
    return found


def _check(found: CompensationResult, path: str) -> None:
    many, whole = found.t.size, len(found.coordinates)
    shapes: dict[str, tuple[int, ...]] = {"t": (many,), "program": (many, whole), "corrected": (many, whole)}
    shapes |= {"times": (2 * many - 1,), "before": (2 * many - 1, 6), "after": (2 * many - 1, 6)}
    shapes |= {"beyond": (2 * many - 1, 6), "weights": (len(AXES),)}
    check_shapes({name: getattr(found, name) for name in shapes}, shapes, path)
    if (np.diff(found.t) <= 0.0).any():
        raise InputError(f"{path}: array t does not increase; allowed: increasing times")
