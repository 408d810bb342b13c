"""The C types of numbers: their literals, and vectors of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from eomgen.errors import InputError


@dataclass(frozen=True)
class Scalar:
    """The C type of numbers: double, or float with its literals and functions; or vectors of them.

    name: the type.
    suffix: of literals and of the functions of <math.h>.
    spread: macro that makes a vector of a number; empty where numbers are no vectors.
    inner: type of the numbers in a vector; empty where they are none.
    apart: whether each state of a vector has other parameters.
    """

    name: str
    suffix: str
    spread: str = ""
    inner: str = ""
    apart: bool = False

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
        return replace(self, name="lanes", spread="ALL", inner=self.name, apart=apart)

    def whole(self, text: str) -> str:
        """Write a number where a value of this type has to stand."""
        return f"{self.spread}({text})" if self.spread else text

    def literal(self, number: float) -> str:
        """Write a literal that reads back as the same number.

        Raises:
            InputError: the number is too large for a float.
        """
        if not self.suffix:
            return repr(float(number))
        if abs(number) > float(np.finfo(np.float32).max):
            raise InputError(f"dtype: float32 cannot hold {number!r}, a number of the description; use float64")
        return str(np.float32(number)) + self.suffix


SCALARS = {"float64": Scalar("double", ""), "float32": Scalar("float", "f")}
