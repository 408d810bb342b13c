"""Motions that excite as .npz files, read again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ..identifiable import BaseParameters
from ..saved import damage_named, read_arrays
from .excited import ARRAYS, KIND, PLAIN, Compared, ExciteResult
from .fourier import FourierSeries

_SERIES = ("offset", "sines", "cosines")


def load_excitation(path: Path | str) -> ExciteResult:
    """The result that ``ExciteResult.save`` wrote.

    Raises:
        InputError: the file cannot be read, or is no such file.
    """
    arrays, meta = read_arrays(KIND, path)
    with damage_named(path, "motion of excite"):
        numbers: dict[str, Any] = {name: np.asarray(arrays[name], dtype=np.float64) for name in (*ARRAYS, *_SERIES)}
        plain: dict[str, Any] = {name: meta[name] for name in PLAIN}
        for name in ("limited", "units", "notes"):
            plain[name] = tuple(map(str, plain[name]))
        for name in ("condition", "deviation"):
            plain[name] = Compared(**{key: float(value) for key, value in plain[name].items()})
        names = tuple(map(str, meta["coordinates"]))
        series = FourierSeries(names, float(meta["duration"]), *(numbers.pop(name) for name in _SERIES))
        found = ExciteResult(**plain, **numbers, series=series, base=_base(meta["base"]))
        _check(found, str(path))
    return found


def _base(given: dict[str, Any]) -> BaseParameters:
    texts: dict[str, Any] = {
        name: tuple(map(str, given[name])) for name in ("terms", "parameters", "names", "without_effect")
    }
    return BaseParameters(
        robot=str(given["robot"]),
        **texts,
        chosen=np.array(given["chosen"], dtype=np.intp),
        matrix=np.array(given["matrix"], dtype=np.float64),
    )


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
        if array.shape != shapes[name] or (name != "limits" and not np.isfinite(array).all()):
            raise InputError(f"{path}: array {name} has shape {array.shape}; allowed: {shapes[name]}, finite numbers")
    if len(harmonics) != 1 or not harmonics[0] or len(found.units) != limits:
        raise InputError(f"{path}: is no motion of excite; allowed: what its save wrote")
