"""The C types of numbers: their literals, and vectors of them."""

from __future__ import annotations

import math
import re
import textwrap
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np

from eomgen.errors import InputError

from ..tree.traced import Traced, origin_of
from .wrapping import COLUMNS

UNKNOWN = "constant of the equations: a threshold, or a coefficient of a series"

LARGEST = 64  # denominator of a factor of a formula
DIGITS = 4  # of literals that stand in expressions; longer ones are named


class Constants:
    """Named constants of a robot's files: numbers of more than DIGITS digits, with what each comes from."""

    def __init__(self) -> None:
        self._names: dict[str, str] = {}
        self._origins: dict[str, str] = {}

    def named(self, literal: str, number: float) -> str:
        """Return a literal, or its name where it is long; it is that of the size of ``number``."""
        if len(re.sub(r"e.*|[^\d]", "", literal).strip("0")) <= DIGITS:
            return literal
        name = self._names.setdefault(literal, f"EOM_C{len(self._names)}")
        if name not in self._origins:
            positive = -number if number < 0.0 else number
            origin = origin_of(positive) if isinstance(positive, Traced) else _ratio(positive)
            if origin:
                self._origins[name] = origin
        return name

    def definitions(self, code: str) -> str:
        """Return macros of the constants that are used in a file's code."""
        used = set(re.findall(r"\bEOM_C\d+\b", code))
        return "".join(
            _definition(name, literal, self._origins.get(name, UNKNOWN))
            for literal, name in self._names.items()
            if name in used
        )


def _ratio(number: float) -> str:
    """Write a factor of a formula, such as 1 / 6, as a quotient; return nothing of another number."""
    ratio = Fraction(number).limit_denominator(LARGEST)
    return f"{float(ratio.numerator)} / {float(ratio.denominator)}" if float(ratio) == number else ""


def _definition(name: str, literal: str, origin: str) -> str:
    line = f"#define {name} {literal} /* {origin} */"
    if len(line) <= COLUMNS:
        return f"{line}\n"
    comment = textwrap.fill(f"/* {origin}", COLUMNS - 3, subsequent_indent=" * ", break_long_words=False)
    return f"{comment} */\n#define {name} {literal}\n"


@dataclass(frozen=True)
class Scalar:
    """The C type of numbers: double, or float with its literals and functions; or vectors of them.

    name: the type.
    suffix: of literals and of the functions of <math.h>.
    spread: macro that makes a vector of a number; empty where numbers are no vectors.
    inner: type of the numbers in a vector; empty where they are none.
    apart: whether each state of a vector has other parameters.
    constants: long literals of values, which are named in front of the code; None where they are written in place.
    """

    name: str
    suffix: str
    spread: str = ""
    inner: str = ""
    apart: bool = False
    constants: Constants | None = field(default=None, compare=False)

    @property
    def number(self) -> str:
        """The type of one number."""
        return self.inner or self.name

    @property
    def shared(self) -> str:
        """The type of what depends on parameters alone."""
        return self.name if self.apart else self.number

    def lanes(self, *, apart: bool = False) -> Scalar:
        """Return vectors of these numbers, named as in ``clib/lanes.h``; apart: see above."""
        return replace(self, name="lanes", spread="EOM_ALL_LANES", inner=self.name, apart=apart)

    def whole(self, text: str) -> str:
        """Write a number where a value of this type has to stand."""
        return f"{self.spread}({text})" if self.spread else text

    def constant(self, number: float) -> str:
        """Write a constant of a program: its literal, or the name of a long one."""
        if self.constants is None or not math.isfinite(number):
            return self.literal(number)
        name = self.constants.named(self.literal(abs(float(number))), number)
        return f"-{name}" if math.copysign(1.0, number) < 0.0 else name

    def literal(self, number: float) -> str:
        """Write a literal that reads back as the same number.

        Raises:
            InputError: the number is too large for a float.
        """
        if not self.suffix:
            return repr(float(number))
        if abs(number) > float(np.finfo(np.float32).max):
            raise InputError(f"dtype: float32 cannot hold {number!r}, a number of the description; use float64")
        shortest = float(str(np.float32(number)))  # which Python writes: NumPy's exponents depend on its version
        return repr(shortest) + self.suffix


SCALARS = {"float64": Scalar("double", ""), "float32": Scalar("float", "f")}
