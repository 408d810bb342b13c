"""Calibrations as .npz files, read again: arrays, and everything else as one text of JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...description.recorded import robot_from_record
from ...errors import InputError
from ...names import show
from ...robot.model import build_model
from ...robot.value import COORDINATES, Robot
from ..geometry.closing import closing_of
from ..geometry.error_model import COMPLIANCE, DRIVE, OFFSET, PLACEMENT, ZERO, ErrorModel, Quantity
from ..geometry.observations import ORIENTATION, POSITION
from ..geometry.stations import chain_of
from ..saved import damage_named, read_arrays
from .diagnosing import Diagnosis, diagnosis_from
from .recorded import ARRAYS, KIND, PLAIN
from .result import CalibrationResult
from .variants import Gain, Gains

_KINDS = (PLACEMENT, ZERO, OFFSET, COMPLIANCE, DRIVE)


def load_calibration(path: Path | str) -> CalibrationResult:
    """The result that ``CalibrationResult.save`` wrote.

    Raises:
        InputError: the file cannot be read, or is no calibration.
    """
    arrays, meta = read_arrays(KIND, path)
    with damage_named(path, KIND):
        robot: Robot = robot_from_record(meta["description"], str(path))
        quantities = tuple(_quantity(entry) for entry in meta["quantities"])
        frames = {name: (link, np.array(meta["tools"][name], dtype=float)) for name, link in meta["frames"].items()}
        bases = {int(number): np.array(pose, dtype=float) for number, pose in meta["bases"].items()}
        chain, tree = chain_of(robot, frames), build_model(robot)
        closing = None
        if robot.is_closed:
            every = [(k, c) for k in range(len(chain.stations)) for c in range(6)]
            closing = closing_of(tree, chain, every, str(path))
        model = ErrorModel(robot, chain, quantities, bases, closing)
        arrays_found: dict[str, Any] = {name: np.asarray(arrays[name], dtype=np.float64) for name in ARRAYS}
        plain = {name: meta[name] for name in PLAIN}
        for name in ("names", "units", "notes"):
            plain[name] = tuple(map(str, plain[name]))
        for name in ("weak", "mistrusted"):
            plain[name] = tuple((entry[0], entry[1]) for entry in plain[name])
        diagnosis = diagnosis_from(meta["diagnosis"]) if "diagnosis" in meta else Diagnosis()
        plain["is_explained"] = bool(meta.get("is_explained", True))
        result = CalibrationResult(**plain, **arrays_found, gains=_gains(meta), diagnosis=diagnosis, model=model)
        _check(result, str(path))
    return result


def _gains(meta: dict[str, Any]) -> Gains:
    """Gains by variant and kind; files of before have that of the full one alone, of positions where there are any."""
    if "gains" in meta:
        return {name: {kind: Gain(**x) for kind, x in gains.items()} for name, gains in meta["gains"].items()}
    kind = next(kind for kind in (POSITION, ORIENTATION) if kind in meta["residuals"]["full"]["fitted"])
    return {} if meta["gain"] is None else {"full": {kind: Gain(**meta["gain"])}}


def _quantity(entry: dict[str, Any]) -> Quantity:
    quantity = Quantity(**entry)
    harmonic = float(quantity.factor[3:] or 1.0) if quantity.factor.startswith(("cos", "sin")) else 1.0
    if quantity.kind not in _KINDS or not (0 <= quantity.coordinate < len(COORDINATES) and np.isfinite(harmonic)):
        raise ValueError(f"quantity {quantity.name}")
    return quantity


def _check(result: CalibrationResult, path: str) -> None:
    many, whole = len(result.names), len(result.model.quantities)
    shapes: dict[str, tuple[int, ...]] = {"values": (many,), "described": (many,), "deviations": (many,), "x": (whole,)}
    shapes["covariance"] = (whole, whole)
    for name, shape in shapes.items():
        array = getattr(result, name)
        if array.shape != shape or (name in ("x", "covariance") and not np.isfinite(array).all()):
            raise InputError(f"{path}: array {name} has shape {array.shape}; allowed: {shape}, finite numbers")
    stations = len(result.model.chain.stations)
    for quantity in result.model.quantities:
        if not 0 <= quantity.station < stations:
            raise InputError(
                f"{path}: {show(quantity.name)} is of station {quantity.station}; allowed: 0 to {stations - 1}"
            )
