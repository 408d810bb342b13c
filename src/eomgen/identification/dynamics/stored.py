"""Identified robots as .npz files, read again."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...description.recorded import robot_from_record
from ...errors import InputError
from ..identifiable import BaseParameters
from ..saved import check_shapes, check_whole, damage_named, declared_values, number_arrays, read_arrays
from .recorded import ARRAYS, KIND, PLAIN, TEXTS
from .result import IdentifyResult


def load_identification(path: Path | str) -> IdentifyResult:
    """The result that ``IdentifyResult.save`` wrote.

    Raises:
        InputError: the file cannot be read, or is no identification.
    """
    arrays, meta = read_arrays(KIND, path)
    with damage_named(path, KIND):
        texts = declared_values(BaseParameters, meta.get("base"), TEXTS, f"{path}: base")
        numbers = number_arrays(arrays, (*ARRAYS, "matrix"), str(path))
        chosen = number_arrays(arrays, ("chosen",), str(path), "iu")["chosen"]
        base = BaseParameters(**texts, chosen=chosen.astype(np.intp), matrix=numbers.pop("matrix"))
        result = IdentifyResult(
            robot=robot_from_record(meta.get("description", {}), str(path)),
            base=base,
            **numbers,
            **number_arrays(arrays, ("kept",), str(path), "b"),
            **declared_values(IdentifyResult, meta, PLAIN, str(path)),
        )
        _check(result, str(path))
        check_whole(result, str(path))
    return result


def _check(result: IdentifyResult, path: str) -> None:
    many, whole, samples = len(result.base), len(result.base.parameters), len(result.t)
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("base_values", "deviations", "described"), (many,))
    shapes |= dict.fromkeys(("drives", "fitted", "kept"), (samples, len(result.residuals))) | {"t": (samples,)}
    if len(result.base.names) != len(result.base.chosen):
        raise InputError(f"{path}: base: names: got {many}; allowed: {len(result.base.chosen)}, one for each of chosen")
    found = {name: getattr(result, name) for name in shapes} | {
        "matrix": result.base.matrix,
        "chosen": result.base.chosen,
    }
    check_shapes(found, shapes | {"matrix": (many, whole), "chosen": (many,)}, path)
    if many and not 0 <= result.base.chosen.min() <= result.base.chosen.max() < whole:
        raise InputError(f"{path}: array chosen has places up to {result.base.chosen.max()}; allowed: 0 to {whole - 1}")
