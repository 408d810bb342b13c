"""Programs in exact arithmetic: derivations over rational numbers, and their values modulo a prime at random points.

Two programs that compute the same rational functions of their inputs, of sines and cosines, and of the values of
other functions agree modulo a prime at every point; two that do not agree at a random one with a probability of about
their degree by the prime (Schwartz, Zippel), less than 1e-12 here.  No rounding hides a term that was lost.

Sine and cosine are rational points of the circle; ``exp``, ``log`` and ``atan2`` are free symbols, equal where their
arguments are, and so is ``sqrt`` where the residue has no root: whoever asks takes another point then.  What a sign
decides (``max``, ``step``, ``choose``), a float beside the residue decides.
"""

from __future__ import annotations

import hashlib
import math
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from fractions import Fraction
from functools import cache
from typing import Any
from unittest import mock

from eomgen.codegen.kernels import derivation as derivation_module
from eomgen.codegen.kernels.derivation import Derivation
from eomgen.codegen.kernels.derivatives import whole
from eomgen.codegen.kernels.signatures import knows_turns
from eomgen.codegen.kernels.writers import VARIANTS, WRITERS
from eomgen.codegen.program import forward_mode, passes, reverse_mode, taylor
from eomgen.codegen.program.ir import Graph, Node, Program, Value, evaluate, finish
from eomgen.codegen.tree import bound as bound_module
from eomgen.codegen.tree.bound import Bound
from eomgen.codegen.tree.spatial import Mat, Pose
from eomgen.robot.model import Model

PRIME = 2**61 - 1
Scalars = Callable[[float], Any]


@cache
def _meant(number: float) -> Fraction:
    """Return what a float is; 1/3 where it is nearest to that, because programs of time derivatives mean such."""
    simple = Fraction(number).limit_denominator(720)
    return simple if float(simple) == number else Fraction(number)


class Exact(float):
    """A rational number that is a float for whoever looks at its size."""

    __slots__ = ("fraction",)
    fraction: Fraction

    def __new__(cls, number: float | Fraction) -> Exact:
        if isinstance(number, Exact):
            return number
        exact = number if isinstance(number, Fraction) else _meant(number)
        self = super().__new__(cls, float(exact))
        self.fraction = exact
        return self

    def __hash__(self) -> int:
        return hash(self.fraction)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, int | float) and self.fraction == Exact(other).fraction

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __neg__(self) -> Exact:
        return Exact(-self.fraction)

    def __abs__(self) -> Exact:
        return Exact(abs(self.fraction))


def _between_fractions(name: str, turned: bool) -> Callable[[Exact, Any], Any]:
    operation = getattr(operator, name)

    def compute(self: Exact, other: Any) -> Any:
        if not isinstance(other, int | float):
            return NotImplemented
        one, two = self.fraction, Exact(other).fraction
        return Exact(operation(two, one) if turned else operation(one, two))

    return compute


for _name in ("add", "sub", "mul", "truediv"):
    setattr(Exact, f"__{_name}__", _between_fractions(_name, turned=False))
    setattr(Exact, f"__r{_name}__", _between_fractions(_name, turned=True))


class ExactGraph(Graph):
    """A graph that folds as any other does, over rational numbers; functions of numbers stay, but for max and step."""

    def constant(self, number: float) -> Node:
        return self._node("const", (), Exact(number))

    def number(self, x: Node) -> float | None:
        op, _, leaf = self.instructions[x.index]
        return Exact(leaf) if op == "const" else None

    def sincos(self, x: Value) -> tuple[Value, Value]:
        if not isinstance(x, Node):
            if x == 0.0:
                return Exact(0), Exact(1)
            x = self.constant(x)
        return self._node("sin", (x.index,)), self._node("cos", (x.index,))

    def call(self, op: str, *args: Value) -> Value:
        numbers = [self.number(x) if isinstance(x, Node) else Exact(x) for x in args]
        if op in SIGNED and None not in numbers:
            return Exact(SIGNED[op](*numbers))
        if op == "choose" and numbers[0] is not None:
            return args[1] if numbers[0] > 0.0 else args[2]
        nodes = [x if isinstance(x, Node) else self.constant(x) for x in args]
        if op == "max" and len({x.index for x in nodes}) == 1:
            return args[0]
        return self._node(op, tuple(x.index for x in nodes))

    def _binary(self, op: str, x: Node, y: Node) -> Value:
        a, b = self.number(x), self.number(y)
        if a is None or b is None:
            return self._node(op, (x.index, y.index))
        return Exact(BETWEEN[op](a, b))


class PlainGraph(Graph):
    """A graph that folds nothing and shares nothing: every operation of the recursion is a value of its own."""

    def constant(self, number: float) -> Node:
        return self._node("const", (), Exact(number))

    def number(self, x: Node) -> float | None:
        return None

    def sincos(self, x: Value) -> tuple[Value, Value]:
        angle = self._at(x)
        return self._node("sin", (angle,)), self._node("cos", (angle,))

    def call(self, op: str, *args: Value) -> Value:
        return self._node(op, tuple(map(self._at, args)))

    def choose(self, gate: Value, x: Value, y: Value) -> Value:
        return self.call("choose", gate, x, y)

    def add(self, x: Value, y: Value) -> Value:
        return self._node("add", (self._at(x), self._at(y)))

    def sub(self, x: Value, y: Value) -> Value:
        return self._node("sub", (self._at(x), self._at(y)))

    def mul(self, x: Value, y: Value) -> Value:
        return self._node("mul", (self._at(x), self._at(y)))

    def div(self, x: Value, y: Value) -> Value:
        return self._node("div", (self._at(x), self._at(y)))

    def neg(self, x: Value) -> Value:
        return self._node("neg", (self._at(x),))

    def _at(self, x: Value) -> int:
        return (x if isinstance(x, Node) else self.constant(x)).index

    def _node(self, op: str, args: tuple[int, ...], leaf: Any = None) -> Node:
        if op == "input":
            return super()._node(op, args, leaf)
        self._interned.clear()
        return super()._node(op, args, leaf)


class Residue:
    """A rational number modulo PRIME, its size as a float, and its derivative along one direction modulo PRIME."""

    __slots__ = ("rate", "residue", "size")

    def __init__(self, residue: int, size: float, rate: int = 0) -> None:
        self.residue, self.size, self.rate = residue % PRIME, size, rate % PRIME

    def __add__(self, other: Any) -> Residue:
        o = residue(other)
        return Residue(self.residue + o.residue, self.size + o.size, self.rate + o.rate)

    def __sub__(self, other: Any) -> Residue:
        o = residue(other)
        return Residue(self.residue - o.residue, self.size - o.size, self.rate - o.rate)

    def __rsub__(self, other: Any) -> Residue:
        return residue(other) - self

    def __mul__(self, other: Any) -> Residue:
        o = residue(other)
        rate = self.rate * o.residue + self.residue * o.rate
        return Residue(self.residue * o.residue, self.size * o.size, rate)

    def __truediv__(self, other: Any) -> Residue:
        o = residue(other)
        inverse = pow(o.residue, -1, PRIME)
        value = self.residue * inverse % PRIME
        return Residue(value, self.size / o.size if o.size else math.nan, (self.rate - value * o.rate) * inverse)

    def __rtruediv__(self, other: Any) -> Residue:
        return residue(other) / self

    def __neg__(self) -> Residue:
        return Residue(-self.residue, -self.size, -self.rate)

    __radd__, __rmul__ = __add__, __mul__

    def is_positive(self) -> bool:
        """Whether it is greater than 0; what vanishes modulo PRIME is not, whatever rounding left."""
        return self.residue != 0 and self.size > 0.0


@cache
def _of_number(number: float) -> Residue:
    exact = Exact(number).fraction
    return Residue(exact.numerator * pow(exact.denominator, -1, PRIME), float(exact))


def residue(x: Any) -> Residue:
    """Return a number as a residue."""
    return x if isinstance(x, Residue) else _of_number(x)


def _symbol(name: str, *args: Residue) -> int:
    """Return a residue that stands for the value of a function at these arguments."""
    text = f"{name} {[x.residue for x in args]}"
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=16).digest(), "big") % PRIME


_HALF = pow(2, -1, PRIME)
_SCALE = _symbol("angle")


def _sincos(x: Residue | float) -> tuple[Residue, Residue]:
    """Return a rational point of the circle: odd in x and even in x, and (0, 1) at 0; t is a multiple of x."""
    x = residue(x)
    t = _SCALE * x.residue % PRIME
    inverse = pow(1 + t * t, -1, PRIME)
    sin, cos = 2 * t * inverse % PRIME, (1 - t * t) * inverse % PRIME
    angle = x.size if math.isfinite(x.size) else 0.0
    return Residue(sin, math.sin(angle), cos * x.rate), Residue(cos, math.cos(angle), -sin * x.rate)


def _sized(compute: Callable[..., float], *args: Residue) -> float:
    try:
        return compute(*(x.size for x in args))
    except (ArithmeticError, ValueError):
        return math.nan


def _sqrt(x: Residue) -> Residue:
    if x.residue == 0:
        return Residue(0, 0.0)
    root = pow(x.residue, (PRIME + 1) // 4, PRIME)  # PRIME is 3 modulo 4
    value = root if root * root % PRIME == x.residue else _symbol("sqrt", x)
    return Residue(value, _sized(math.sqrt, x), x.rate * _HALF * pow(value, -1, PRIME))


def _exp(x: Residue) -> Residue:
    value = _symbol("exp", x) if x.residue else 1
    return Residue(value, _sized(math.exp, x), value * x.rate)


def _log(x: Residue) -> Residue:
    value = _symbol("log", x) if x.residue != 1 else 0
    return Residue(value, _sized(math.log, x), x.rate * pow(x.residue, -1, PRIME))


def _atan2(y: Residue, x: Residue) -> Residue:
    value = _symbol("atan2", y, x) if y.residue or not x.is_positive() else 0
    square = pow(x.residue * x.residue + y.residue * y.residue, -1, PRIME)
    return Residue(value, _sized(math.atan2, y, x), (x.residue * y.rate - y.residue * x.rate) * square)


SIGNED: Mapping[str, Callable[..., Any]] = {
    "abs": lambda x: x if x > 0.0 else -x,
    "max": lambda x, y: y if y - x > 0.0 else x,
    "step": lambda x: 1.0 if x > 0.0 else 0.0,
}
BETWEEN: Mapping[str, Callable[..., Any]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
}
FUNCTIONS: Mapping[str, Callable[..., Residue]] = {
    "abs": lambda x: x if x.is_positive() else -x,
    "max": lambda x, y: y if (y - x).is_positive() else x,
    "step": lambda x: residue(1.0 if x.is_positive() else 0.0),
    "choose": lambda gate, x, y: x if gate.is_positive() else y,
    "sqrt": _sqrt,
    "exp": _exp,
    "log": _log,
    "atan2": _atan2,
}


def values(program: Program, inputs: Mapping[str, Sequence[Any]]) -> dict[tuple[str, int], Residue]:
    """Return the outputs of a program as residues."""
    calls = {op: _taking(function) for op, function in FUNCTIONS.items()}
    found = evaluate(program, inputs, _sincos, calls)
    return {key: residue(value) for key, value in found.items()}


def _taking(function: Callable[..., Residue]) -> Callable[..., Residue]:
    return lambda *args: function(*map(residue, args))


class Orthogonal:
    """Rotation matrices near given ones whose rational entries are orthogonal without any rounding."""

    def __init__(self) -> None:
        self.known: dict[Mat, Mat] = {}

    def __call__(self, R: Mat) -> Mat:
        """Return the matrix of the quaternion nearest to that of R, its components as they are."""
        if R not in self.known:
            w, x, y, z = _quaternion(R)
            square = w * w + x * x + y * y + z * z
            exact = (
                (w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)),
                (2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)),
                (2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z),
            )
            self.known[R] = tuple(tuple(Exact(entry / square) for entry in row) for row in exact)
            self.known[tuple(zip(*R, strict=True))] = tuple(zip(*self.known[R], strict=True))
        return self.known[R]


def _quaternion(R: Mat) -> list[Fraction]:
    """Return a multiple of the quaternion of a rotation as rational numbers, the largest component 1."""
    trace = R[0][0] + R[1][1] + R[2][2]
    squares = [1.0 + trace, *(1.0 + 2.0 * R[i][i] - trace for i in range(3))]
    largest = max(range(4), key=squares.__getitem__)
    antisymmetric = (R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1])
    if largest == 0:
        column = [squares[0], *antisymmetric]
    else:
        i = largest - 1
        column = [antisymmetric[i], *(R[i][j] + R[j][i] for j in range(3))]
        column[largest] = squares[largest]
    return [Fraction(x / squares[largest]) for x in column]


@contextmanager
def _derivations(graph: type[Graph], orthogonal: Orthogonal) -> Iterator[None]:
    """Let derivations run over rational numbers in graphs of this kind, in the frames of the description."""
    plain = graph is PlainGraph

    def bind(model: Model, value: Callable[[str, float], Any], sincos: Any, **_: bool) -> Bound:
        made = getattr(sincos, "__self__", None)

        def lifted(number: Any) -> Any:
            if isinstance(number, Node):
                return number
            return made.constant(number) if plain else Exact(number)

        def named(name: str, number: float) -> Any:
            if name.endswith(".free_length") and number == 0.0:  # its energy needs no length, which REST keeps off 0
                return Exact(0)
            return lifted(value(name, number))

        def pose(rotation: Mat, origin: Any) -> Pose:
            if all(type(x) in (int, float) for row in rotation for x in row):
                rotation = tuple(tuple(map(lifted, row)) for row in orthogonal(rotation))
            return Pose(rotation, origin)

        with (
            mock.patch.object(bound_module, "Pose", pose),
            mock.patch.object(Pose, "exact", lambda pose: pose),  # all numbers are exact already
            mock.patch.object(bound_module._Binder, "_turn", lambda binder, angle: binder.sincos(angle)),
        ):
            return bound_module.bind(model, named, sincos)

    with ExitStack() as patched:
        for module in (derivation_module, passes, whole, forward_mode, reverse_mode, taylor):
            patched.enter_context(mock.patch.object(module, "Graph", graph))
        patched.enter_context(mock.patch.object(derivation_module, "bind", bind))
        patched.enter_context(mock.patch.object(derivation_module, "choose_frames", lambda model, bound: bound))
        yield


@contextmanager
def over_rationals(orthogonal: Orthogonal) -> Iterator[None]:
    """Let all that is derived here be folded and shared over rational numbers, not over floats."""
    with _derivations(ExactGraph, orthogonal):
        yield


def recursion(model: Model, kernel: str, orthogonal: Orthogonal) -> Program:
    """Derive a kernel of ``WRITERS`` or ``VARIANTS`` with nothing regrouped, folded, shared, pruned or factored."""
    with _derivations(PlainGraph, orthogonal):
        d = Derivation(model, regrouped=False, turned=knows_turns(kernel, model))
        write = WRITERS.get(kernel)
        if write is None:
            suited = (x for x in VARIANTS[kernel].values() if x.prescribes or not d.model.prescribed)
            write = next(x for x in suited if x.suits(d)).write
        return finish(d.graph, kernel, write(d))
