"""Operations of programs, one record each: all that passes, renderers, bounds and counts have to know of one.

A new operation is a record in the table of a graph or in OPERATIONS, and ``make operations`` for the C library.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from . import series
from .named import to_float

Rate = Callable[[Any, Sequence[Any], Any, Sequence[Any]], Any]
Taylor = Callable[[Any, Sequence[series.Series], series.Series, int], Any]
ANGULAR: Mapping[str, str] = MappingProxyType({"sin": "sine", "cos": "cosine"})  # one angle has both, in these arrays


@dataclass(frozen=True)
class Operation:
    """An operation on real scalars.

    Attributes:
        arguments: their names in C; none for constants and inputs, which are no operations of C.
        cost: what ``Program.count`` counts it as, "add", "mul", "div" or "sincos"; empty for what costs nothing, and
            for sine and cosine, which are counted by their angles.
        value: its value, of floats; of arithmetic, for anything that has it.
        numpy: its value on arrays; ``value`` is where None.
        fold: (graph, *x) -> what a function is without being computed, or None; ``Graph`` has methods for the others.
        rate: (graph, x, y, dx) -> dy, where y is its value at the arguments x; None where it is always zero.
        taylor: see ``series``; None where it is always zero, and for sine and cosine, which are expanded together.
        signs: with which it adds its arguments up; none where it is no sum.
        form: with ``str.format``, in C and Python; of a function in Python, where xp is a namespace such as numpy.
        function: of C, for one number and with the suffix _lanes for a vector of them; empty where C has an operator.
        c: what ``function`` returns, an expression of ``arguments`` in which EOM_C(...) is a literal of the precision.
        lanes: the same of vectors, with the statements in front; empty where it is ``c`` lane by lane.
        sympy: (sympy, *x) -> its expression, of a function; the module is an argument, so that programs import none.
        error: of the value that C computes, in units in the last place; 0 where it is exact.
        interval: (intervals, *x) -> interval of the value, and of the derivative by each argument but for sums and
            products; the module ``precision.intervals`` is an argument.
        barrier: what arguments have no bound: text with their ranges, and (*x) -> in which of the boxes.
        by_sign: whether it looks at the sign of its first argument, so that the exact one has to be known.
    """

    arguments: tuple[str, ...] = ()
    cost: str = ""
    value: Callable[..., Any] | None = None
    numpy: Callable[..., Any] | None = None
    fold: Callable[..., Any] | None = None
    rate: Rate | None = None
    taylor: Taylor | None = None
    signs: tuple[int, ...] = ()
    form: str = ""
    function: str = ""
    c: str = ""
    lanes: str = ""
    sympy: Callable[..., Any] | None = None
    error: float = 0.0
    interval: Callable[..., Any] | None = None
    barrier: tuple[str, Callable[..., Any]] | None = None
    by_sign: bool = False

    @property
    def arity(self) -> int:
        """Number of its arguments."""
        return len(self.arguments)

    @property
    def is_arithmetic(self) -> bool:
        """Whether it is an operator of C and Python."""
        return bool(self.form) and "xp." not in self.form and not self.function

    def compute(self, *numbers: float) -> float | None:
        """Return the value at these numbers; None where it is not defined or no float."""
        assert self.value is not None
        try:
            return to_float(self.value(*numbers))
        except (ArithmeticError, ValueError):
            return None


Operations = Mapping[str, Operation]
ROUNDED, CALLED, TURNED = 0.5, 2.0, 3.0  # errors: of arithmetic, of functions of a C library, of sine and cosine


def _larger(x: float, y: float) -> float:
    """Return y where it is larger, else x: not a number stays not a number in x."""
    return y if x < y else x


def _has_zero(x: Any) -> Any:
    return (x[0] <= 0.0) & (x[1] >= 0.0)


def _crosses_cut(y: Any, x: Any) -> Any:
    return _has_zero(y) & (x[0] <= 0.0)


def _masked(condition: str, x: str, y: str) -> str:
    """Write the lanes of x where a condition holds, else those of y."""
    return f"const bits holds = (bits)({condition}); return (lanes)((holds & (bits){x}) | (~holds & (bits){y}));"


_ZERO = "const lanes none = { EOM_C(0.0) };"
_SIGN_TEXT = "{op} at the sign of what is in {0}: rounding may decide it"
OPERATIONS: Operations = MappingProxyType(
    {
        "const": Operation(),
        "input": Operation(),
        "neg": Operation(
            ("x",),
            "add",
            operator.neg,
            rate=lambda g, x, y, dx: -dx[0],
            taylor=lambda g, x, z, k: -x[0][k],
            signs=(-1,),
            form="-{0}",
            interval=lambda iv, x: (iv.neg(x), ()),
        ),
        "sin": Operation(
            ("x",),
            value=math.sin,
            rate=lambda g, x, y, dx: g.sincos(x[0])[1] * dx[0],
            form="xp.sin({0})",
            error=TURNED,
            interval=lambda iv, x: (iv.sin(x), (iv.cos(x),)),
        ),
        "cos": Operation(
            ("x",),
            value=math.cos,
            rate=lambda g, x, y, dx: -(g.sincos(x[0])[0] * dx[0]),
            form="xp.cos({0})",
            error=TURNED,
            interval=lambda iv, x: (iv.cos(x), (iv.neg(iv.sin(x)),)),
        ),
        "add": Operation(
            ("x", "y"),
            "add",
            operator.add,
            rate=lambda g, x, y, dx: dx[0] + dx[1],
            taylor=lambda g, x, z, k: x[0][k] + x[1][k],
            signs=(1, 1),
            form="{0} + {1}",
            error=ROUNDED,
            interval=lambda iv, x, y: (iv.add(x, y), ()),
        ),
        "sub": Operation(
            ("x", "y"),
            "add",
            operator.sub,
            rate=lambda g, x, y, dx: dx[0] - dx[1],
            taylor=lambda g, x, z, k: x[0][k] - x[1][k],
            signs=(1, -1),
            form="{0} - {1}",
            error=ROUNDED,
            interval=lambda iv, x, y: (iv.sub(x, y), ()),
        ),
        "mul": Operation(
            ("x", "y"),
            "mul",
            operator.mul,
            rate=lambda g, x, y, dx: dx[0] * x[1] + x[0] * dx[1],
            taylor=series.product,
            form="{0}*{1}",
            error=ROUNDED,
            interval=lambda iv, x, y: (iv.mul(x, y), ()),
        ),
        "div": Operation(
            ("x", "y"),
            "div",
            operator.truediv,
            rate=lambda g, x, y, dx: (dx[0] - y * dx[1]) * (1.0 / x[1]),
            taylor=series.quotient,
            form="{0}/{1}",
            error=ROUNDED,
            interval=lambda iv, x, y: iv.quotient(x, y),
            barrier=("division by what is in {1}", lambda x, y: _has_zero(y)),
        ),
        "abs": Operation(  # its rate at 0 is that below
            ("x",),
            "add",
            abs,
            rate=lambda g, x, y, dx: g.choose(x[0], dx[0], -dx[0]),
            taylor=lambda g, x, z, k: g.choose(x[0][0], x[0][k], -x[0][k]),
            form="abs({0})",
            function="eom_abs",
            c="EOM_MATH(fabs)(x)",
            lanes=f"{_ZERO} return (lanes)((bits)x & ~(bits)-none);",
            sympy=lambda sympy, x: sympy.Abs(x),
            interval=lambda iv, x: iv.absolute(x),
        ),
        "max": Operation(  # where both are equal, the rate is that of the second, as step is 0 at 0
            ("x", "y"),
            "add",
            _larger,
            lambda x, y: np.where(x < y, y, x),
            fold=lambda g, x, y: x if g.is_same(x, y) else None,
            rate=lambda g, x, y, dx: dx[1] + g.call("step", x[0] - x[1]) * (dx[0] - dx[1]),
            taylor=lambda g, x, z, k: x[1][k] + g.call("step", x[0][0] - x[1][0]) * (x[0][k] - x[1][k]),
            form="xp.where({0} < {1}, {1}, {0})",
            function="eom_max",
            c="(x < y) ? y : x",
            lanes=_masked("x < y", "y", "x"),
            sympy=lambda sympy, x, y: sympy.Max(x, y),
            interval=lambda iv, x, y: iv.larger(x, y),
        ),
        "step": Operation(  # 1 where greater than 0, else 0
            ("x",),
            "add",
            lambda x: 1.0 if x > 0.0 else 0.0,
            lambda x: (x > 0.0).astype(x.dtype),
            form="xp.where({0} > 0.0, xp.ones_like({0}), xp.zeros_like({0}))",
            function="eom_heaviside",
            c="(x > EOM_C(0.0)) ? EOM_C(1.0) : EOM_C(0.0)",
            lanes=f"{_ZERO} return (lanes)((bits)(x > none) & (bits)(none + EOM_C(1.0)));",
            sympy=lambda sympy, x: sympy.Heaviside(x, 0),
            interval=lambda iv, x: iv.step(x),
            barrier=(_SIGN_TEXT, lambda x: (x[0] <= 0.0) & (x[1] > 0.0)),
            by_sign=True,
        ),
        "choose": Operation(  # the second where the first is greater than 0, else the third
            ("gate", "x", "y"),
            "add",
            lambda gate, x, y: x if gate > 0.0 else y,
            lambda gate, x, y: np.where(gate > 0.0, x, y),
            fold=lambda g, gate, x, y: x if g.is_same(x, y) else None,
            rate=lambda g, x, y, dx: g.choose(x[0], dx[1], dx[2]),
            taylor=lambda g, x, z, k: g.choose(x[0][0], x[1][k], x[2][k]),
            form="xp.where({0} > 0.0, {1}, {2})",
            function="eom_select",
            c="(gate > EOM_C(0.0)) ? x : y",
            lanes=f"{_ZERO} {_masked('gate > none', 'x', 'y')}",
            sympy=lambda sympy, gate, x, y: sympy.Piecewise((x, gate > 0), (y, True)),
            interval=lambda iv, gate, x, y: iv.choose(gate, x, y),
            barrier=(_SIGN_TEXT, lambda gate, x, y: (gate[0] <= 0.0) & (gate[1] > 0.0)),
            by_sign=True,
        ),
        "sqrt": Operation(
            ("x",),
            "div",
            math.sqrt,
            np.sqrt,
            rate=lambda g, x, y, dx: 0.5 * dx[0] * (1.0 / y),
            taylor=series.square_root,
            form="xp.sqrt({0})",
            function="eom_sqrt",
            c="EOM_MATH(sqrt)(x)",
            sympy=lambda sympy, x: sympy.sqrt(x),
            error=ROUNDED,
            interval=lambda iv, x: iv.square_root(x),
            barrier=("square root of what is in {0}, with an infinite slope at 0", lambda x: x[0] <= 0.0),
        ),
        "atan2": Operation(  # the angle of (x[1], x[0]), as in C
            ("y", "x"),
            "sincos",
            math.atan2,
            np.arctan2,
            rate=lambda g, x, y, dx: (x[1] * dx[0] - x[0] * dx[1]) / (x[0] * x[0] + x[1] * x[1]),
            taylor=series.angle,
            form="xp.arctan2({0}, {1})",
            function="eom_atan2",
            c="EOM_MATH(atan2)(y, x)",
            sympy=lambda sympy, x, y: sympy.atan2(x, y),
            error=CALLED,
            interval=lambda iv, y, x: iv.angle(y, x),
            barrier=("atan2 of {0} and {1}: across its cut, or at its origin", _crosses_cut),
        ),
        "exp": Operation(
            ("x",),
            "sincos",
            math.exp,
            np.exp,
            rate=lambda g, x, y, dx: y * dx[0],
            taylor=series.exponential,
            form="xp.exp({0})",
            function="eom_exp",
            c="EOM_MATH(exp)(x)",
            sympy=lambda sympy, x: sympy.exp(x),
            error=CALLED,
            interval=lambda iv, x: (iv.exp(x), (iv.exp(x),)),
        ),
        "log": Operation(
            ("x",),
            "sincos",
            math.log,
            np.log,
            rate=lambda g, x, y, dx: dx[0] * (1.0 / x[0]),
            taylor=series.logarithm,
            form="xp.log({0})",
            function="eom_log",
            c="EOM_MATH(log)(x)",
            sympy=lambda sympy, x: sympy.log(x),
            error=CALLED,
            interval=lambda iv, x: (iv.log(x), (iv.reciprocal(x),)),
            barrier=("logarithm of what is in {0}", lambda x: x[0] <= 0.0),
        ),
    }
)
CALLS: Operations = MappingProxyType({name: op for name, op in OPERATIONS.items() if op.function})
