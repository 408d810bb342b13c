"""C functions of operations, and coefficients of sines and cosines: ``clib/operations.h``, and device source code.

python -m eomgen.codegen.c.functions > src/eomgen/clib/operations.h
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..program.operations import OPERATIONS, Operations
from .scalar_types import SCALARS, Scalar
from .source import environment
from .wrapping import wrapped


@dataclass(frozen=True)
class Coefficients:
    """Numbers of the sines and cosines of one precision, which ``eom_sin_cos`` of ``clib/lanes.h`` takes.

    error: of a result, in units in the last place.
    farthest: larger angles are left to the C library.
    shift: what brings a number's units into the lowest bits.
    quarter: pi/2 in parts, products of all but the last exact.
    sine, cosine: of powers of z = r^2, the lowest first, in sin r = r + r z (...), cos r = 1 - z (1/2 - z (...)).
    """

    error: float
    farthest: float
    per_quarter: float
    shift: float
    quarter: tuple[float, ...]
    sine: tuple[float, ...]
    cosine: tuple[float, ...]


COEFFICIENTS = {
    "float64": Coefficients(
        2.5,
        1e6,
        0.63661977236758134308,
        float.fromhex("0x1.8p52"),
        tuple(map(float.fromhex, ("0x1.921fb544p+0", "0x1.0b4611a6p-34", "0x1.3198a2e037073p-69"))),
        (
            -1.66666666666666324348e-01,
            8.33333333332248946124e-03,
            -1.98412698298579493134e-04,
            2.75573137070700676789e-06,
            -2.50507602534068634195e-08,
            1.58969099521155010221e-10,
        ),
        (
            4.16666666666666019037e-02,
            -1.38888888888741095749e-03,
            2.48015872894767294178e-05,
            -2.75573143513906633035e-07,
            2.08757232129817482790e-09,
            -1.13596475577881948265e-11,
        ),
    ),
    "float32": Coefficients(
        2.5,
        5e3,
        0.636619772,
        float.fromhex("0x1.8p23"),
        tuple(map(float.fromhex, ("0x1.92p+0", "0x1.fb4p-12", "0x1.444p-24", "0x1.68c234p-39"))),
        (-1.6666654611e-1, 8.3321608736e-3, -1.9515295891e-4),
        (4.166664568298827e-2, -1.388731625493765e-3, 2.443315711809948e-5),
    ),
}


def sine_constants(dtype: str, z: str = "z") -> dict[str, Any]:
    """Return the numbers of sines and cosines as C; polynomials of z as Horner has them."""
    table, scalar = COEFFICIENTS[dtype], SCALARS[dtype]

    def polynomial(numbers: Sequence[float]) -> str:
        first, *others = numbers
        return f"({scalar.literal(first)} + {z}*{polynomial(others)})" if others else scalar.literal(first)

    return {
        "per_quarter": scalar.literal(table.per_quarter),
        "shift": scalar.literal(table.shift),
        "quarter": [scalar.literal(piece) for piece in table.quarter],
        "sine": polynomial(table.sine),
        "cosine": polynomial(table.cosine),
        "farthest": scalar.literal(table.farthest),
    }


def device_functions(operations: Operations, scalar: Scalar) -> list[dict[str, Any]]:
    """Return names, arguments and values of the functions of operations, with literals of the precision."""

    def written(c: str) -> str:
        return re.sub(r"\bEOM_C\(([^()]*)\)", lambda found: scalar.literal(float(found[1])), c)

    called = (operation for operation in operations.values() if operation.function)
    return [{"name": x.function, "arguments": x.arguments, "value": written(x.c)} for x in called]


def operations_header(operations: Operations = OPERATIONS) -> str:
    """Return ``clib/operations.h``."""
    called = [operation for operation in operations.values() if operation.function]
    sines = {dtype: sine_constants(dtype, "(z)") for dtype in ("float32", "float64")}
    for numbers in sines.values():  # a macro has "\\" at the end of a line
        numbers |= {name: " \\\n    ".join(textwrap.wrap(numbers[name], 90)) for name in ("sine", "cosine")}
    return wrapped(environment().get_template("kernel/operations.h.jinja").render(functions=called, sines=sines))


if __name__ == "__main__":
    print(operations_header(), end="")
