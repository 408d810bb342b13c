"""Operations of programs, one row each: value, derivative, and what C, SymPy and the counts make of it."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

Rate = Callable[[Any, Sequence[Any], Any, Sequence[Any]], Any]


@dataclass(frozen=True)
class Operation:
    """An operation on real scalars.

    Attributes:
        arity: number of its arguments; 0 for constants and inputs, which are no operations of C.
        cost: what ``Program.count`` counts it as, "add", "mul", "div" or "sincos"; empty for what costs nothing, and
            for sine and cosine, which are counted by their angles.
        value: its value, of floats; of arithmetic, for anything that has it.
        rate: (graph, x, y, dx) -> dy, where y is its value at the arguments x; None where it is always zero.
        function: the function of ``clib/lanes.h`` that C calls, for one number and with the suffix _lanes for a
            vector of them; empty where C has an operator, or a function of <math.h>.
        sympy: (sympy, *x) -> its expression, of a function; the module is an argument, so that programs import none.
        idempotent: whether op(x, x) is x.
        numpy: its value on arrays; ``value`` is where None.
    """

    arity: int
    cost: str = ""
    value: Callable[..., Any] | None = None
    rate: Rate | None = None
    function: str = ""
    sympy: Callable[..., Any] | None = None
    idempotent: bool = False
    numpy: Callable[..., Any] | None = None

    def compute(self, *numbers: float) -> float | None:
        """Return the value at these numbers; None where it is not defined or no float."""
        assert self.value is not None
        try:
            return float(self.value(*numbers))
        except (ArithmeticError, ValueError):
            return None


def _larger(x: float, y: float) -> float:
    """Return y where it is larger, else x: not a number stays not a number in x."""
    return y if x < y else x


OPERATIONS: Mapping[str, Operation] = MappingProxyType(
    {
        "const": Operation(0),
        "input": Operation(0),
        "neg": Operation(1, "add", operator.neg, lambda g, x, y, dx: -dx[0]),
        "sin": Operation(1, value=math.sin, rate=lambda g, x, y, dx: g.sincos(x[0])[1] * dx[0]),
        "cos": Operation(1, value=math.cos, rate=lambda g, x, y, dx: -(g.sincos(x[0])[0] * dx[0])),
        "add": Operation(2, "add", operator.add, lambda g, x, y, dx: dx[0] + dx[1]),
        "sub": Operation(2, "add", operator.sub, lambda g, x, y, dx: dx[0] - dx[1]),
        "mul": Operation(2, "mul", operator.mul, lambda g, x, y, dx: dx[0] * x[1] + x[0] * dx[1]),
        "div": Operation(2, "div", operator.truediv, lambda g, x, y, dx: (dx[0] - y * dx[1]) * (1.0 / x[1])),
        "sqrt": Operation(
            1,
            "div",
            math.sqrt,
            lambda g, x, y, dx: 0.5 * dx[0] * (1.0 / y),
            "root",
            lambda sympy, x: sympy.sqrt(x),
            numpy=np.sqrt,
        ),
        "abs": Operation(  # its rate at 0 is that below
            1,
            "add",
            abs,
            lambda g, x, y, dx: g.choose(x[0], dx[0], -dx[0]),
            "magnitude",
            lambda sympy, x: sympy.Abs(x),
        ),
        "max": Operation(  # where both are equal, the rate is that of the second, as step is 0 at 0
            2,
            "add",
            _larger,
            lambda g, x, y, dx: dx[1] + g.call("step", x[0] - x[1]) * (dx[0] - dx[1]),
            "larger",
            lambda sympy, x, y: sympy.Max(x, y),
            idempotent=True,
            numpy=lambda x, y: np.where(x < y, y, x),
        ),
        "step": Operation(  # 1 where greater than 0, else 0
            1,
            "add",
            lambda x: 1.0 if x > 0.0 else 0.0,
            None,
            "positive",
            lambda sympy, x: sympy.Heaviside(x, 0),
            numpy=lambda x: (x > 0.0).astype(x.dtype),
        ),
        "choose": Operation(  # the second where the first is greater than 0, else the third
            3,
            "add",
            lambda gate, x, y: x if gate > 0.0 else y,
            lambda g, x, y, dx: g.choose(x[0], dx[1], dx[2]),
            "chosen",
            lambda sympy, gate, x, y: sympy.Piecewise((x, gate > 0), (y, True)),
            numpy=lambda gate, x, y: np.where(gate > 0.0, x, y),
        ),
        "exp": Operation(
            1,
            "sincos",
            math.exp,
            lambda g, x, y, dx: y * dx[0],
            "exponential",
            lambda sympy, x: sympy.exp(x),
            numpy=np.exp,
        ),
        "log": Operation(
            1,
            "sincos",
            math.log,
            lambda g, x, y, dx: dx[0] * (1.0 / x[0]),
            "logarithm",
            lambda sympy, x: sympy.log(x),
            numpy=np.log,
        ),
        "atan2": Operation(  # the angle of (x[1], x[0]), as in C
            2,
            "sincos",
            math.atan2,
            lambda g, x, y, dx: (x[1] * dx[0] - x[0] * dx[1]) / (x[0] * x[0] + x[1] * x[1]),
            "bearing",
            lambda sympy, x, y: sympy.atan2(x, y),
            numpy=np.arctan2,
        ),
    }
)
ARITY = {name: op.arity for name, op in OPERATIONS.items()}
CALLS: Mapping[str, Operation] = MappingProxyType({name: op for name, op in OPERATIONS.items() if op.function})
VALUES: Mapping[str, Callable[..., Any]] = MappingProxyType(
    {name: op.value for name, op in OPERATIONS.items() if op.value is not None}
)
ARRAYS: Mapping[str, Callable[..., Any]] = MappingProxyType(
    {name: op.numpy or value for name, op in OPERATIONS.items() if (value := op.value) is not None}
)
