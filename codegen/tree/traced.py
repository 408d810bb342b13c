"""Numbers that know by which formula they come from numbers of the description, for comments in generated code.

They are floats: arithmetic with floats gives the same bits, and with nodes of a program it is the program's.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..program.named import Named

Term = tuple[Any, ...]  # a name; or an operator and two numbers

LONGEST = 8  # numbers in a formula that is written out
MOST_KEYS = 12  # of numbers that a longer one comes from


class Traced(Named):
    """A float with its origin: the key of a number of the description, or an operator and what it was applied to."""

    __slots__ = ()
    term: Term

    def __new__(cls, number: float, *term: Any) -> Traced:
        """Make a number; ``term``: a name, or an operator of "+-*/" and two numbers."""
        made = super().__new__(cls, number)
        made.term = term
        return made

    def __add__(self, other: Any) -> Any:
        return _made(float(self) + other, "+", self, other) if isinstance(other, (int, float)) else NotImplemented

    def __radd__(self, other: Any) -> Any:
        return _made(other + float(self), "+", other, self) if isinstance(other, (int, float)) else NotImplemented

    def __sub__(self, other: Any) -> Any:
        return _made(float(self) - other, "-", self, other) if isinstance(other, (int, float)) else NotImplemented

    def __rsub__(self, other: Any) -> Any:
        return _made(other - float(self), "-", other, self) if isinstance(other, (int, float)) else NotImplemented

    def __mul__(self, other: Any) -> Any:
        return _made(float(self) * other, "*", self, other) if isinstance(other, (int, float)) else NotImplemented

    def __rmul__(self, other: Any) -> Any:
        return _made(other * float(self), "*", other, self) if isinstance(other, (int, float)) else NotImplemented

    def __truediv__(self, other: Any) -> Any:
        return _made(float(self) / other, "/", self, other) if isinstance(other, (int, float)) else NotImplemented

    def __rtruediv__(self, other: Any) -> Any:
        return _made(other / float(self), "/", other, self) if isinstance(other, (int, float)) else NotImplemented

    def __neg__(self) -> float:
        if len(self.term) > 1 and self.term[0] == "-" and self.term[1] == 0.0:
            positive: float = self.term[2]
            return positive
        return _made(-float(self), "-", 0.0, self)

    def __reduce__(self) -> tuple[Any, ...]:
        return Traced, (float(self), *self.term)


def _made(number: float, op: str, x: float, y: float) -> float:
    """Return the result of an operation: x or y itself where the other one, a plain number, changes nothing.

    A number that vanishes needs no formula: programs have none.
    """
    number, neutral = float(number), 1.0 if op in "*/" else 0.0
    if number == 0.0:
        return number
    for one, other, holds in ((x, y, True), (y, x, op in "+*")):
        if isinstance(one, Traced) and not isinstance(other, Traced) and holds:
            if other == neutral:
                return one
            if other == -1.0 and op in "*/":
                return -one
    return Traced(number, op, x, y)


def origin_of(number: float) -> str:
    """Return the formula of a number by keys of the description, to the bit; of a long one what it comes from."""
    if _size(number, LONGEST) <= LONGEST:
        return _formula(number)
    keys = list(dict.fromkeys(_keys(number)))
    rest = f" and {len(keys) - MOST_KEYS} more" if len(keys) > MOST_KEYS else ""
    return f"sums of products of {', '.join(keys[:MOST_KEYS])}{rest}"


def _size(number: float, most: int) -> int:
    """Count the numbers in a formula, up to one more than most."""
    if not isinstance(number, Traced) or len(number.term) == 1:
        return 1
    first = _size(number.term[1], most)
    return first if first > most else first + _size(number.term[2], most - first)


def _formula(number: float) -> str:
    """Write a formula, with brackets where rounding depends on the order."""
    if not isinstance(number, Traced):
        return repr(float(number))
    if len(number.term) == 1:
        return str(number.term[0])
    op, x, y = number.term
    left, right = _formula(x), _formula(y)
    if op in "*/":
        left, right = (f"({part})" if " + " in part or " - " in part else part for part in (left, right))
        right = f"({right})" if right[0] != "(" and (" * " in right or " / " in right) else right
        return f"{left} {op} {right}"
    if " + " in right or " - " in right:
        right = f"({right})"
    return f"-{right}" if op == "-" and not isinstance(x, Traced) and x == 0.0 else f"{left} {op} {right}"


def _keys(number: float) -> Iterator[str]:
    """Yield the names of the numbers that one comes from, in the order of its formula."""
    open_numbers, seen = [number] if isinstance(number, Traced) else [], set[int]()
    while open_numbers:
        one = open_numbers.pop()
        if id(one) in seen:
            continue
        seen.add(id(one))
        if len(one.term) == 1:
            yield str(one.term[0])
        else:
            open_numbers += [x for x in reversed(one.term[1:]) if isinstance(x, Traced)]
