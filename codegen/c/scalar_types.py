"""The C types of numbers: their literals, vectors of them, and the numbers of their sines and cosines."""

from __future__ import annotations

from collections.abc import Sequence
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
    apart: whether the states of a vector have parameters of their own.
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
        """Vectors of these numbers, named as in ``kernel/batches.c.jinja``; apart: see above."""
        return replace(self, name="lanes", spread="ALL", inner=self.name, apart=apart)

    def whole(self, text: str) -> str:
        """A number where a value of this type has to stand."""
        return f"{self.spread}({text})" if self.spread else text

    def literal(self, number: float) -> str:
        """A literal that reads back as the same number.

        Raises:
            InputError: the number is too large for a float.
        """
        if not self.suffix:
            return repr(float(number))
        if abs(number) > float(np.finfo(np.float32).max):
            raise InputError(f"dtype: float32 cannot hold {number!r}, a number of the description; use float64")
        return str(np.float32(number)) + self.suffix


@dataclass(frozen=True)
class Turn:
    """Numbers of the sines and cosines of ``kernel/vectors.jinja`` for one type, as literals of C.

    integer: of the same width.  shift: what brings a number's units into the lowest bits.  quarter: pi/2 in parts,
    products of all but the last exact.  sine, cosine: coefficients of powers of z = r^2, the lowest first, in
    sin r = r + r z (...), cos r = 1 - z (1/2 - z (...)).  sign: from bit 1 to the sign.
    """

    integer: str
    error: str
    source: str
    limit: str
    per_quarter: str
    shift: str
    quarter: tuple[str, ...]
    sine: tuple[str, ...]
    cosine: tuple[str, ...]
    sign: int

    @staticmethod
    def horner(coefficients: Sequence[str]) -> str:
        """A polynomial in z."""
        text = coefficients[-1]
        for number in reversed(coefficients[:-1]):
            text = f"{number} + z*({text})" if text != coefficients[-1] else f"{number} + z*{text}"
        return text


TURNS = {
    "float64": Turn(
        "long long",
        "2.5",
        "fdlibm (Sun Microsystems 1993)",
        "1e6",
        "0.63661977236758134308",
        "0x1.8p52",
        ("0x1.921fb544p+0", "0x1.0b4611a6p-34", "0x1.3198a2e037073p-69"),
        (
            "-1.66666666666666324348e-01",
            "8.33333333332248946124e-03",
            "-1.98412698298579493134e-04",
            "2.75573137070700676789e-06",
            "-2.50507602534068634195e-08",
            "1.58969099521155010221e-10",
        ),
        (
            "4.16666666666666019037e-02",
            "-1.38888888888741095749e-03",
            "2.48015872894767294178e-05",
            "-2.75573143513906633035e-07",
            "2.08757232129817482790e-09",
            "-1.13596475577881948265e-11",
        ),
        62,
    ),
    "float32": Turn(
        "int",
        "2.5",
        "the Cephes library (S. L. Moshier)",
        "5e3f",
        "0.636619772f",
        "0x1.8p23f",
        ("0x1.92p+0f", "0x1.fb4p-12f", "0x1.444p-24f", "0x1.68c234p-39f"),
        ("-1.6666654611e-1f", "8.3321608736e-3f", "-1.9515295891e-4f"),
        ("4.166664568298827e-2f", "-1.388731625493765e-3f", "2.443315711809948e-5f"),
        30,
    ),
}
SCALARS = {"float64": Scalar("double", ""), "float32": Scalar("float", "f")}
