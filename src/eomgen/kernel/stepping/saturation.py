"""Saturation of drives at their efforts: which these are, and where they cannot be clipped."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import ArrayError, InputError, UnknownNameError
from ...names import listed, nearest, show
from ...runtime.arrays import inputs_of, numbers_in
from ...runtime.calls import Calls
from .input_signals import InputSignals, ModelDrive

Array = NDArray[np.float64]
Saturate = bool | ArrayLike | Mapping[str, float] | None


def efforts_of(calls: Calls, saturate: Saturate) -> Array | None:
    """Return the greatest forces of drives, (n,), N or N m, infinite where there is none; None where none is clipped.

    Args:
        saturate: True for the efforts of the description where u is a force or torque, a mapping from coordinates to
            efforts, or efforts, (n,), infinite where there is no limit; False or None for none.

    Raises:
        InputError: there are no efforts, one is not above 0, or one is of a coordinate that has no drive to clip.
        ArrayError: another shape.
        UnknownNameError: there is no coordinate of a name.
    """
    if saturate is None or saturate is False:
        return None
    own = inputs_of(calls.raw.libraries.meta)
    described = {name: x for name, x in calls.raw.libraries.meta.get("efforts", {}).items() if own[name].is_force}
    requested = described if saturate is True else saturate
    if isinstance(requested, Mapping):
        efforts = np.full(calls.n, np.inf)
        for name, value in requested.items():
            if name not in calls.coordinates:
                known = f"{nearest(str(name), calls.coordinates)}; allowed: {listed(calls.coordinates)}"
                raise UnknownNameError(f"saturate: there is no coordinate {show(name)}{known}")
            efforts[calls.coordinates.index(name)] = _number(f"saturate: {name}", value)
    else:
        efforts = _array(calls, requested)
    check_efforts(calls, efforts, "saturate")
    if not np.isfinite(efforts).any():
        raise InputError(
            "saturate: no drive has a limit of its effort; allowed: a description with limits = { effort = ... }, or"
            " efforts by coordinate"
        )
    return efforts


def check_efforts(calls: Calls, effort: Array, label: str) -> None:
    """Refuse efforts that are none, and those of coordinates whose forces are not clipped.

    Raises:
        InputError: with the coordinate, what came and what is allowed.
    """
    own = inputs_of(calls.raw.libraries.meta)
    turning = [i for at, origin in calls.raw.turning.values() for i in _places(at, origin)]
    for i, value in enumerate(effort.tolist()):
        name = calls.coordinates[i]
        if not value > 0.0:
            raise InputError(f"{label}: {name} is {value!r}; allowed: a number above 0, infinity for none")
        if np.isfinite(value) and name in calls.prescribed:
            raise InputError(f"{label}: {name} has {value:g}, but its motion is prescribed; allowed: drives")
        if np.isfinite(value) and name in own and not own[name].is_force:
            what = f"its drive takes a {own[name].meaning}"
            raise InputError(f"{label}: {name} has {value:g}, but {what}; allowed: drives that take a force or torque")
        if np.isfinite(value) and i in turning:
            raise InputError(f"{label}: {name} has {value:g}, but its joint has 3-DOF rotation; allowed: other joints")


def with_efforts(loads: InputSignals | list[InputSignals], effort: Array | None) -> InputSignals | list[InputSignals]:
    """Return loads whose drives are clipped at these efforts, if there are any."""
    if effort is None:
        return loads
    if isinstance(loads, InputSignals):
        return replace(loads, drive=replace(loads.drive, effort=effort))
    return [replace(each, drive=replace(each.drive, effort=effort)) for each in loads]


def shared_drives(model: ModelDrive | None) -> tuple[str, ...]:
    """Return names of drives of which one could do what another one cannot; none where each has a task.

    Of a mechanism with more drives than freedoms the least forces are taken; with one that is clipped others might do
    more, and nothing says which.
    """
    if model is None or model.mechanism is None:
        return ()
    chart = np.asarray(model.mechanism.charts[0].chart)[: len(model.place)]
    freedoms = int(((chart <= 0.5) & (np.asarray(model.given) < 0)).sum())
    driven = np.flatnonzero(model.mechanism.driven)
    return tuple(model.calls.coordinates[i] for i in driven) if driven.size > freedoms else ()


def _places(at: int, origin: int) -> list[int]:
    return [at + i for i in range(3)] + ([origin + i for i in range(3)] if origin >= 0 else [])


def _number(label: str, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{label} is {show(value)}; allowed: a number above 0, N or N m") from None


def _array(calls: Calls, requested: Any) -> Array:
    allowed = f"True, efforts by coordinate, or numbers of shape ({calls.n},)"
    efforts = numbers_in("saturate", requested, allowed, finite=False)
    if efforts.shape != (calls.n,):
        raise ArrayError(f"saturate: got {show(requested)}; allowed: {allowed}")
    return efforts
