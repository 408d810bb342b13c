"""Evaluation of programs on NumPy arrays, a state in every lane, in the arithmetic of a dtype."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .ir import Program

Array = NDArray[Any]
SinCos = Callable[[Any], tuple[Any, Any]]

OPERATORS: Mapping[str, Callable[..., Any]] = MappingProxyType(
    {
        "neg": np.negative,
        "abs": np.abs,
        "add": np.add,
        "sub": np.subtract,
        "mul": np.multiply,
        "div": np.divide,
        "sqrt": np.sqrt,
        "max": lambda x, y: np.where(x < y, y, x),
        "step": lambda x: (x > 0.0).astype(x.dtype),
        "choose": lambda gate, x, y: np.where(gate > 0.0, x, y),
        "exp": np.exp,
        "log": np.log,
        "atan2": np.arctan2,
    }
)
EXACT = ("neg", "abs", "max", "step", "choose", "input", "const")  # operations that do not round


def sine_and_cosine(x: Any) -> tuple[Array, Array]:
    """Return the sines and cosines of x, computed in double precision and rounded to the dtype of x."""
    wide = np.asarray(x, np.float64)
    return np.sin(wide).astype(x.dtype), np.cos(wide).astype(x.dtype)


def evaluate_lanes(
    program: Program,
    inputs: Mapping[str, Any],
    dtype: str,
    *,
    rounding: Array | None = None,
    sincos: SinCos = sine_and_cosine,
) -> dict[str, Array]:
    """Evaluate a program in many states at once.

    Args:
        program: what is evaluated.
        inputs: arrays of the dtype by name, (size, lanes), or (size,) for numbers that are the same in all lanes.
        dtype: "float64" or "float32".
        rounding: factors (rows, lanes) near 1: the result of instruction i is multiplied by row i modulo rows, as if it
            had been rounded less accurately (Monte Carlo arithmetic).  None: results are as they are.
        sincos: function that returns the sines and cosines of an array, in its dtype.

    Returns:
        Arrays (size, lanes) that the program writes, by name, with the dtype.
    """
    lanes = max((np.size(row) for rows in inputs.values() for row in rows[:1]), default=1)
    rows = None if rounding is None else list(rounding.astype(dtype))
    number, turned, values = np.dtype(dtype).type, dict[int, Any](), list[Any]()
    for index, (op, args, leaf) in enumerate(program.instructions):
        given = [values[arg] for arg in args]
        if op == "input":
            value = inputs[leaf[0]][leaf[1]]
        elif op == "const":
            value = number(leaf)
        elif op in ("sin", "cos"):
            if args[0] not in turned:
                turned[args[0]] = sincos(given[0])
            value = turned[args[0]][op == "cos"]
        else:
            value = OPERATORS[op](*given)
        if rows is not None and op not in EXACT:
            value = value * rows[index % len(rows)]
        values.append(value)
    sizes: dict[str, int] = {}
    for array, place in program.outputs:
        sizes[array] = max(sizes.get(array, 0), place + 1)
    arrays = {array: np.zeros((size, lanes), dtype) for array, size in sizes.items()}
    for (array, place), index in program.outputs.items():
        arrays[array][place] = values[index]
    return arrays
