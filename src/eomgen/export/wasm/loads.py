"""Loads that are data -> plain values that the JavaScript of a kernel takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from eomgen.errors import InputError
from eomgen.runtime.kernel import Kernel
from eomgen.runtime.stepping.loads import (
    DriveData,
    LinkWrench,
    LoadData,
    ModelDrive,
    Signal,
    Track,
    Waves,
    jump_times,
)


def plain_loads(kernel: Kernel, loads: LoadData) -> dict[str, Any]:
    """``loads`` of adaptiveRollout and simulator: plain values for JSON, whose numbers keep their bits.

    Drives that know a model need a kernel exported with ``model=True``.

    Args:
        kernel: of the robot that they act on.
        loads: what a Python rollout takes.

    Raises:
        InputError: the drives' model has loops.
    """
    found: dict[str, Any] = _times(first=loads.first, last=loads.last)
    stops = jump_times(loads)
    if stops.size:
        found["stops"] = _numbers(stops)
    if loads.drive.torque is not None:
        found["torque"] = _track(loads.drive.torque)
    if loads.drive.program is not None:
        found["program"] = _program(loads.drive, loads.drive.program)
    if loads.drive.model is not None:
        found["model"] = _model(loads.drive.model)
    if loads.given is not None:
        found["given"] = _given(loads.given, kernel.prescribed)
    if loads.wrenches:
        found["wrenches"] = [_wrench(wrench, kernel.links) for wrench in loads.wrenches]
    return found


def _times(**times: float) -> dict[str, float]:
    """Finite times, by name."""
    return {name: float(time) for name, time in times.items() if np.isfinite(time)}


def _numbers(values: ArrayLike) -> list[float]:
    return [float(x) for x in np.asarray(values, dtype=np.float64).ravel()]


def _whole(values: ArrayLike) -> list[int]:
    return [int(x) for x in np.asarray(values).ravel()]


def _signal(signal: Signal) -> dict[str, Any]:
    _, powers, columns = signal.coefficients.shape
    inner = {} if signal.profile is None else {"profile": _signal(signal.profile)}
    numbers = {"knots": _numbers(signal.knots), "coefficients": _numbers(signal.coefficients)}
    return {**numbers, "degree": powers - 1, "columns": columns, **inner}


def _track(track: Track) -> dict[str, Any]:
    return {"signal": _signal(track.signal), "place": _whole(track.place)}


def _program(drive: DriveData, program: Track) -> dict[str, Any]:
    gains = {} if drive.gains is None else {"kp": _numbers(drive.gains.kp), "kd": _numbers(drive.gains.kd)}
    ratio = {} if drive.ratio is None else {"ratio": _numbers(drive.ratio)}
    return {**_track(program), **ratio, **gains}


def _model(model: ModelDrive) -> dict[str, Any]:
    if model.mechanism is not None:
        raise InputError(
            "loads: the drives' model has loops or couplings; allowed in WebAssembly: one without, or gains"
        )
    return {
        "place": _whole(model.place),
        "ratio": _numbers(model.ratio),
        "column": _whole(model.column),
        "given": _whole(model.given),
        "bandwidth": model.bandwidth,
        "parameters": {name: float(value) for name, value in model.calls.parameters.items()},
    }


def _given(given: Waves, prescribed: Sequence[str]) -> dict[str, Any]:
    return {
        "place": list(prescribed),
        "waves": _numbers(given.wave),
        "tracks": [_track(track) for track in given.tracks],
    }


def _wrench(wrench: LinkWrench, links: Sequence[str]) -> dict[str, Any]:
    return {
        "link": links[wrench.link],
        "signal": _signal(wrench.signal),
        "arm": _numbers(wrench.arm),
        "turns": bool(wrench.turns),
        **_times(t0=wrench.t0, t1=wrench.t1),
    }
