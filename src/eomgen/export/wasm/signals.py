"""Loads that are data -> plain values that the JavaScript of a kernel takes."""

from __future__ import annotations

from typing import Any

import numpy as np

from eomgen.errors import InputError
from eomgen.kernel.complete import Kernel
from eomgen.kernel.stepping.input_signals import InputSignals
from eomgen.kernel.stepping.packed_inputs import plain_inputs

LARGEST = float(np.finfo(np.float64).max)  # in the place of infinity, which JSON does not have


def plain_loads(kernel: Kernel, loads: InputSignals) -> dict[str, Any]:
    """Return ``loads`` of adaptiveRollout and simulator: plain values for JSON, whose numbers keep their bits.

    Drives that know a model need a kernel exported with ``model=True``.

    Args:
        kernel: of the robot that they act on.
        loads: what a Python rollout takes.

    Raises:
        InputError: the drives' model has loops.
    """
    plain: dict[str, Any] = as_json(plain_inputs(kernel.calls, loads))
    if "effort" in plain:
        plain["effort"] = plain["effort"][: kernel.n]
    model = loads.drive.model
    if model is not None:
        if model.mechanism is not None:
            raise InputError(
                "loads: the drives' model has loops or couplings; allowed in WebAssembly: one without, or gains"
            )
        plain["model"]["parameters"] = {name: float(value) for name, value in model.calls.parameters.items()}
    return plain


def as_json(plain: Any) -> Any:
    """Return plain values with flat lists in the place of arrays, and numbers that JSON has."""
    if isinstance(plain, dict):
        return {key: as_json(value) for key, value in plain.items()}
    if isinstance(plain, (list, tuple)):
        return [as_json(value) for value in plain]
    if isinstance(plain, np.ndarray):
        numbers = plain.ravel()
        return (np.clip(numbers, -LARGEST, LARGEST) if numbers.dtype.kind == "f" else numbers).tolist()
    return plain.item() if isinstance(plain, np.generic) else plain
