"""Identified robots as .npz files, read again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...description.recorded import robot_from_record
from ...errors import InputError
from ..identifiable import BaseParameters
from ..saved import check_shapes, damage_named, read_arrays
from .recorded import ARRAYS, KIND
from .result import Further, IdentifyResult, Residuals


def load_identification(path: Path | str) -> IdentifyResult:
    """The result that ``IdentifyResult.save`` wrote.

    Raises:
        InputError: the file cannot be read, or is no identification.
    """
    arrays, meta = read_arrays(KIND, path)
    with damage_named(path, KIND):
        base = BaseParameters(
            robot=str(meta["base"]["robot"]),
            terms=_texts(meta["base"]["terms"]),
            parameters=_texts(meta["base"]["parameters"]),
            chosen=np.asarray(arrays["chosen"], dtype=np.intp),
            matrix=np.asarray(arrays["matrix"], dtype=np.float64),
            names=_texts(meta["base"]["names"]),
            without_effect=_texts(meta["base"]["without_effect"]),
        )
        found: dict[str, Any] = {name: np.asarray(arrays[name], dtype=np.float64) for name in ARRAYS}
        result = IdentifyResult(
            robot=robot_from_record(meta["description"], str(path)),
            base=base,
            **found,
            kept=np.asarray(arrays["kept"], dtype=np.bool_),
            parameters={str(name): float(value) for name, value in meta["parameters"].items()},
            residuals={str(name): Residuals(**entry) for name, entry in meta["residuals"].items()},
            further={str(name): Further(**entry) for name, entry in meta["further"].items()},
            width=float(meta["width"]),
            warnings=_texts(meta["warnings"]),
            notes=_texts(meta["notes"]),
        )
        _check(result, str(path))
    return result


def _texts(values: list[Any]) -> tuple[str, ...]:
    return tuple(map(str, values))


def _check(result: IdentifyResult, path: str) -> None:
    many, whole, samples = len(result.base), len(result.base.parameters), len(result.t)
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("base_values", "deviations", "described"), (many,))
    shapes |= dict.fromkeys(("drives", "fitted", "kept"), (samples, len(result.residuals))) | {"t": (samples,)}
    found = {name: getattr(result, name) for name in shapes} | {
        "matrix": result.base.matrix,
        "chosen": result.base.chosen,
    }
    check_shapes(found, shapes | {"matrix": (many, whole), "chosen": (many,)}, path)
    if many and not 0 <= result.base.chosen.min() <= result.base.chosen.max() < whole:
        raise InputError(f"{path}: array chosen has places up to {result.base.chosen.max()}; allowed: 0 to {whole - 1}")
