"""Errors of single precision as they are observed: programs in both precisions, at random states of the ranges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..codegen.program.ir import Program
from ..codegen.program.numeric import evaluate_lanes
from ..robot.model import Model
from .intervals import Array
from .ranges import Deflection, Range, random_states

STATES = 256


def observed_errors(
    model: Model,
    single: Program,
    double: Program,
    ranges: Mapping[str, Sequence[Range]],
    gears: Sequence[Deflection],
    size: int,
) -> tuple[Array, Array]:
    """Return largest errors of outputs in single precision, and their largest magnitudes in double, (size,) each.

    Args:
        model: the robot's.
        single, double: the kernel's programs, from the parameters on, for both precisions.
        ranges: of all that they read; of a parameter at its value both ends are the value.
        gears: how far they are deflected.
        size: number of outputs; those that are not written, or not finite, count as 0.
    """
    narrow = random_states(ranges, gears, STATES, "float32")
    parameters = [*model.parameters.values(), *[0.0] * len(model.turning)]
    wide = dict(narrow)
    wide["p"] = [
        np.full(STATES, value) if lower == upper == np.float32(value) else row
        for value, row, (lower, upper) in zip(parameters, narrow.get("p", ()), ranges.get("p", ()), strict=True)
    ]
    with np.errstate(all="ignore"):
        exact = _out(double, wide, "float64")
        given = {array: [row.astype(np.float32) for row in rows] for array, rows in narrow.items()}
        computed = _out(single, given, "float32")
        error = np.abs(computed - exact)
    error, scale = (np.where(np.isfinite(x), x, 0.0).max(axis=1, initial=0.0) for x in (error, np.abs(exact)))
    found, sizes = np.zeros(size), np.zeros(size)
    found[: len(error)], sizes[: len(scale)] = error, scale
    return found, sizes


def _out(program: Program, inputs: Mapping[str, Any], dtype: str) -> Array:
    written = evaluate_lanes(program, inputs, dtype)
    return written.get("out", np.zeros((0, STATES))).astype(np.float64)
