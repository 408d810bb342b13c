"""Programs on many states at once in the arithmetic of C, and beside it what rounding does to their results.

Every value is an array of lanes: states first, then copies of the first states, in which every step is rounded at
random.  IEEE arithmetic leaves no choice in +, -, *, / and square roots; where a compiler may fuse a product with a
sum, results differ about as much as those of the copies do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..program.ir import Program
from ..program.operations import VALUES
from .stored import MEASURED, STATES

Array = NDArray[Any]

COPIES = 4  # of each of the first states
SAFETY = 16.0  # how much more than copies of a state differ is allowed
_UNITS = 8.0  # in the last place that a step of a copy is off by at most
_ROWS = 256  # of random roundings, which are taken in turn
_OPERATORS: Mapping[str, Callable[..., Any]] = {
    "neg": np.negative,
    "abs": np.abs,
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "sqrt": np.sqrt,
}
_EXACT = ("neg", "abs", "max", "step", "choose")  # operations that do not round


def with_copies(states: Array) -> Array:
    """Spread values in states (..., states) over lanes (..., lanes)."""
    return np.concatenate([states, np.repeat(states[..., :MEASURED], COPIES, axis=-1)], axis=-1)


def spread(lanes: Array) -> Array:
    """Return by how much the copies of a state differ from it (..., MEASURED), of values (..., lanes).

    Infinity where rounding decides whether a value is finite; what is not finite in all of them does not differ.
    """
    states, copies = lanes[..., :MEASURED, None], lanes[..., len(STATES) :].reshape(*lanes.shape[:-1], MEASURED, COPIES)
    finite = np.isfinite(states) & np.isfinite(copies)
    other = np.where(np.isfinite(states) == np.isfinite(copies), 0.0, np.inf)
    with np.errstate(invalid="ignore"):
        differences: Array = np.where(finite, np.abs(copies - states), other).max(axis=-1)
    return differences


class Arithmetic:
    """Runs programs on lanes of a dtype; sines and cosines are those of the C library."""

    def __init__(self, dtype: str, seed: int = 0) -> None:
        self.dtype = np.dtype(dtype)
        rng, copies = np.random.default_rng(seed), MEASURED * COPIES
        off = _UNITS * float(np.finfo(self.dtype).eps) * rng.uniform(-1.0, 1.0, (_ROWS, copies))
        self._rounding = np.concatenate([np.ones((_ROWS, len(STATES))), 1.0 + off], axis=1).astype(self.dtype)
        self._turns: dict[tuple[str, bytes], tuple[Array, Array]] = {}

    def run(self, program: Program, inputs: Mapping[str, Any], *, rounding: bool = True) -> dict[str, Array]:
        """Return arrays (size, lanes) that the program writes, by their names; numbers for all lanes may go in, too.

        ``rounding`` is False for lanes that are states alone, however many.
        """
        values: list[Any] = []
        number, rows = self.dtype.type, list(self._rounding)
        for index, (op, args, leaf) in enumerate(program.instructions):
            operator = _OPERATORS.get(op)
            if operator is not None:
                value = operator(values[args[0]], values[args[1]]) if len(args) == 2 else operator(values[args[0]])
            elif op == "input":
                values.append(inputs[leaf[0]][leaf[1]])
                continue
            elif op == "const":
                values.append(number(leaf))
                continue
            elif op in ("sin", "cos"):
                value = self.turn(values[args[0]])[op == "cos"]
            else:
                value = self._called(op, [values[arg] for arg in args])
            values.append(value * rows[index % _ROWS] if rounding and op not in _EXACT else value)
        return _arrays(program, values, rows[0].size, self.dtype)

    def value(self, op: str, args: Sequence[Any]) -> Any:
        """Return the result of an operation that is no sine and no cosine."""
        operator = _OPERATORS.get(op)
        return operator(*args) if operator is not None else self._called(op, list(args))

    @staticmethod
    def has_no_choice(program: Program) -> bool:
        """Whether IEEE arithmetic says every bit of its results, if its sines and cosines are rounded correctly."""
        known = {*_OPERATORS, *_EXACT, "sin", "cos", "const", "input"}
        return all(instruction.op in known for instruction in program.instructions)

    def turn(self, x: Any) -> tuple[Array, Array]:
        """Return sines and cosines; the same arrays for the same angles."""
        angles = np.asarray(x, self.dtype)
        key = str(angles.dtype), angles.tobytes()
        if key not in self._turns:
            pairs = [
                (math.sin(a), math.cos(a)) if math.isfinite(a) else (math.nan,) * 2 for a in angles.ravel().tolist()
            ]
            sine, cosine = np.array(pairs).T.astype(angles.dtype).reshape(2, *angles.shape)
            self._turns[key] = (sine, cosine)
        return self._turns[key]

    def _called(self, op: str, args: list[Any]) -> Array:
        """Call an operation that NumPy has no ufunc of, or rounds in another way: number by number."""
        columns = np.broadcast_arrays(*args)
        numbers = [_value(op, row) for row in zip(*(column.ravel().tolist() for column in columns), strict=True)]
        return np.array(numbers).astype(self.dtype).reshape(columns[0].shape)


def _value(op: str, numbers: tuple[float, ...]) -> float:
    """Compute a value as C has it where Python raises."""
    try:
        return float(VALUES[op](*numbers))
    except OverflowError:
        return math.inf
    except ValueError:
        return math.nan


def _arrays(program: Program, values: Sequence[Any], lanes: int, dtype: np.dtype[Any]) -> dict[str, Array]:
    widths = [np.shape(values[index])[0] for index in program.outputs.values() if np.ndim(values[index])]
    sizes: dict[str, int] = {}
    for array, place in program.outputs:
        sizes[array] = max(sizes.get(array, 0), place + 1)
    arrays = {array: np.zeros((size, max(widths, default=lanes)), dtype) for array, size in sizes.items()}
    for (array, place), index in program.outputs.items():
        arrays[array][place] = values[index]
    return arrays
