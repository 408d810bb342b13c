"""Motions that excite as .npz files, read again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...limits import LARGEST_FOUND
from ..dynamics.recorded import TEXTS
from ..identifiable import BaseParameters
from ..saved import damage_named, declared_value, declared_values, number_arrays, read_arrays
from .excited import ARRAYS, KIND, PLAIN, Compared, ExciteResult
from .fourier import FourierSeries

_SERIES = ("offset", "sines", "cosines")
COMPARED = ("condition", "deviation")


def load_excitation(path: Path | str) -> ExciteResult:
    """The result that ``ExciteResult.save`` wrote.

    Raises:
        InputError: the file cannot be read, or is no such file.
    """
    arrays, meta = read_arrays(KIND, path)
    with damage_named(path, "motion of excite"):
        numbers = number_arrays(arrays, (*ARRAYS, *_SERIES), str(path))
        compared = {name: declared_value(Compared, meta, name, str(path), np.inf) for name in COMPARED}
        plain = declared_values(ExciteResult, meta, set(PLAIN).difference(COMPARED), str(path))
        names = declared_value(tuple[str, ...], meta, "coordinates", str(path))
        duration = declared_value(float, meta, "duration", str(path))
        if not duration > 0.0:
            raise InputError(f"{path}: duration: got {duration:g}; allowed: a time in s greater than 0")
        series = FourierSeries(names, duration, *(numbers.pop(name) for name in _SERIES))
        found = ExciteResult(**plain, **compared, **numbers, series=series, base=_base(meta.get("base"), str(path)))
        _check(found, str(path))
        found.lines()
    return found


def _base(given: Any, path: str) -> BaseParameters:
    texts = declared_values(BaseParameters, given, TEXTS, f"{path}: base")
    chosen = declared_value(tuple[int, ...], given, "chosen", f"{path}: base")
    rows = declared_value(tuple[tuple[float, ...], ...], given, "matrix", f"{path}: base")
    many, whole = len(texts["names"]), len(texts["parameters"])
    if len(chosen) != many or [len(row) for row in rows] != [whole] * many:
        raise InputError(
            f"{path}: base: matrix and chosen are of other sizes; allowed: {many} names of {whole} parameters"
        )
    if not all(0 <= place < whole for place in chosen):
        raise InputError(f"{path}: base: chosen: got {max(chosen)}; allowed: 0 to {whole - 1}")
    matrix = np.array(rows, dtype=np.float64).reshape(many, whole)
    return BaseParameters(**texts, chosen=np.array(chosen, dtype=np.intp), matrix=matrix)


def _check(found: ExciteResult, path: str) -> None:
    many, samples, base, limits = len(found.coordinates), len(found.t), len(found.base), len(found.limited)
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("q", "v", "a", "u"), (samples, many))
    shapes |= {"t": (samples,), "noise": (many,), "sizes": (base,), "deviations": (base,)}
    shapes |= {"limits": (limits, 2), "extremes": (limits, 2)}
    own = {name: getattr(found, name) for name in shapes}
    harmonics = found.series.sines.shape[1:]
    own |= {name: getattr(found.series, name) for name in _SERIES}
    shapes |= {"offset": (many,), "sines": (many, *harmonics), "cosines": (many, *harmonics)}
    for name, array in own.items():
        good = ~np.isnan(array) if name == "limits" else np.abs(array) <= LARGEST_FOUND
        if array.shape != shapes[name] or not good.all():
            raise InputError(f"{path}: array {name} has shape {array.shape}; allowed: {shapes[name]}, finite numbers")
    if len(harmonics) != 1 or not harmonics[0] or len(found.units) != limits:
        raise InputError(f"{path}: is no motion of excite; allowed: what its save wrote")
