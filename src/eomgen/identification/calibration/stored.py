"""Calibrations as .npz files, read again: arrays, and everything else as one text of JSON."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...description.recorded import robot_from_record
from ...errors import InputError
from ...limits import LARGEST_FOUND
from ...motion.measured_numbers import ALLOWED_DIVISOR, is_divisor
from ...names import listed, show
from ...robot.model import build_model
from ...robot.value import COORDINATES, Robot
from ..geometry.closing import closing_of
from ..geometry.error_model import COMPLIANCE, DRIVE, OFFSET, PLACEMENT, ZERO, ErrorModel, Quantity
from ..geometry.observations import ORIENTATION, POSITION
from ..geometry.stations import chain_of
from ..saved import damage_named, declared_value, declared_values, number_arrays, read_arrays
from .diagnosing import Diagnosis
from .recorded import ARRAYS, KIND, PLAIN
from .result import CalibrationResult
from .variants import VARIANTS, Gain, Gains

Array = NDArray[np.float64]

_KINDS = (PLACEMENT, ZERO, OFFSET, COMPLIANCE, DRIVE)
_NUMBER = re.compile(r"-?[0-9]{1,18}")
_HARMONIC = re.compile(r"[0-9]{1,20}(?:\.[0-9]{1,20})?(?:e[+-]?[0-9]{1,3})?")


def load_calibration(path: Path | str) -> CalibrationResult:
    """The result that ``CalibrationResult.save`` wrote.

    Raises:
        InputError: the file cannot be read, or is no calibration.
    """
    arrays, meta = read_arrays(KIND, path)
    with damage_named(path, KIND):
        robot: Robot = robot_from_record(meta.get("description", {}), str(path))
        plain = declared_values(CalibrationResult, meta, PLAIN, str(path))
        quantities = declared_value(tuple[Quantity, ...], meta, "quantities", str(path))
        for quantity in quantities:
            _check_quantity(quantity, str(path))
        tools = _poses(meta, "tools", str(path))
        if set(tools) != set(plain["frames"]):
            raise InputError(f"{path}: tools: got {listed(tools)}; allowed: those of frames, {listed(plain['frames'])}")
        frames = {name: (link, tools[name]) for name, link in plain["frames"].items()}
        bases = {_series(number, str(path)): pose for number, pose in _poses(meta, "bases", str(path)).items()}
        chain, tree = chain_of(robot, frames), build_model(robot)
        closing = None
        if robot.is_closed:
            every = [(k, c) for k in range(len(chain.stations)) for c in range(6)]
            closing = closing_of(tree, chain, every, str(path))
        model = ErrorModel(robot, chain, quantities, bases, closing)
        diagnosis = Diagnosis()
        if "diagnosis" in meta:
            names = [field.name for field in fields(Diagnosis)]
            diagnosis = Diagnosis(**declared_values(Diagnosis, meta["diagnosis"], names, f"{path}: diagnosis"))
        found: dict[str, Any] = {
            "gains": _gains(meta, plain["residuals"], str(path)),
            "diagnosis": diagnosis,
            "model": model,
        }
        if "is_explained" in meta:
            found["is_explained"] = declared_value(bool, meta, "is_explained", str(path))
        result = CalibrationResult(**plain, **number_arrays(arrays, ARRAYS, str(path)), **found)
        _check(result, str(path))
        result.lines()
    return result


def _gains(meta: Mapping[str, Any], residuals: Mapping[str, Any], path: str) -> Gains:
    """Gains by variant and kind; files of before have that of the full one alone, of positions where there are any."""
    if "gains" in meta:
        found: Gains = declared_value(Mapping[str, Mapping[str, Gain]], meta, "gains", path)
        return found
    gain = declared_value(Gain | None, meta, "gain", path)
    kind = next(kind for kind in (POSITION, ORIENTATION) if kind in residuals["full"]["fitted"])
    return {} if gain is None else {"full": {kind: gain}}


def _poses(meta: Mapping[str, Any], name: str, path: str) -> dict[str, Array]:
    rows = declared_value(Mapping[str, tuple[tuple[float, ...], ...]], meta, name, path)
    for key, pose in rows.items():
        if [len(row) for row in pose] != [4] * 4:
            raise InputError(f"{path}: {name}.{show(key)}: got other numbers; allowed: a pose, 4 rows of 4")
    return {key: np.array(pose, dtype=np.float64) for key, pose in rows.items()}


def _series(number: str, path: str) -> int:
    if not _NUMBER.fullmatch(number):
        raise InputError(f"{path}: bases: got {show(number)}; allowed: numbers of series")
    return int(number)


def _check_quantity(quantity: Quantity, path: str) -> None:
    harmonic = quantity.factor[3:] if quantity.factor.startswith(("cos", "sin")) else ""
    if harmonic and not _HARMONIC.fullmatch(harmonic):
        raise InputError(f"{path}: quantities: {show(quantity.name)}: factor: got {show(quantity.factor)}")
    for key, value, allowed in (
        ("kind", quantity.kind, _KINDS),
        ("coordinate", str(quantity.coordinate), tuple(map(str, range(len(COORDINATES))))),
    ):
        if value not in allowed:
            raise InputError(
                f"{path}: quantities: {show(quantity.name)}: {key}: got {show(value)}; allowed: {listed(allowed)}"
            )


def _check(result: CalibrationResult, path: str) -> None:
    many, whole = len(result.names), len(result.model.quantities)
    shapes: dict[str, tuple[int, ...]] = {"values": (many,), "described": (many,), "deviations": (many,), "x": (whole,)}
    shapes["covariance"] = (whole, whole)
    for name, shape in shapes.items():
        array = getattr(result, name)
        good = np.abs(array) <= LARGEST_FOUND
        if name not in ("x", "covariance"):  # of merged ones, and of stiffness that is infinite
            good |= ~np.isfinite(array)
        if array.shape != shape or not good.all():
            raise InputError(f"{path}: array {name} has shape {array.shape}; allowed: {shape}, finite numbers")
    for key, good, allowed in (
        ("names", many > 0, "one or more"),
        ("units", len(result.units) == many, f"{many}, one for each of names"),
        ("confidence", 0.0 < result.confidence < 1.0, "a number between 0 and 1"),
        ("variant", result.variant in VARIANTS, listed(VARIANTS)),
        ("residuals", _is_whole(result.residuals), "fitted and held_out of the variants, full among them"),
        ("noise", all(map(is_divisor, result.noise.values())), f"of each, {ALLOWED_DIVISOR}"),
    ):
        if not good:
            raise InputError(f"{path}: {key}: got {show(str(getattr(result, key)))}; allowed: {allowed}")
    stations = len(result.model.chain.stations)
    for quantity in result.model.quantities:
        if not 0 <= quantity.station < stations:
            raise InputError(
                f"{path}: {show(quantity.name)} is of station {quantity.station}; allowed: 0 to {stations - 1}"
            )


def _is_whole(residuals: Mapping[str, Mapping[str, Mapping[str, float]]]) -> bool:
    parts = [residuals[name] for name in VARIANTS if name in residuals]
    kinds = set(residuals.get("full", {}).get("fitted", {}))
    known, norms = {"fitted", "held_out"}, {"fitted_norm", "held_out_norm"}
    return "full" in residuals and all(
        known <= set(part) <= known | norms and kinds.issubset(part["fitted"]) for part in parts
    )
