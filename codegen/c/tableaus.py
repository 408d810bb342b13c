"""Coefficients of explicit and Rosenbrock methods as C, rendered from the table of methods.

python -m eomgen.codegen.c.tableaus src/eomgen/clib
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eomgen.kernel.stepping.methods import EXPLICIT, ROSENBROCK, TABLE, IntegrationMethod, Rows, tableaus

from .wrapping import wrapped

STAGES = 6  # EOM_EXPLICIT_STAGES and EOM_ROSENBROCK_STAGES of clib/methods.h, for which workspaces have room
KINDS = {EXPLICIT: "EOM_EXPLICIT_KIND", ROSENBROCK: "EOM_ROSENBROCK_KIND"}

Exact = NDArray[Any]


def exact(rows: Rows, stages: int) -> Exact:
    """Return rows of coefficients as a square matrix of fractions, whose sums are the same on every machine."""
    matrix = np.array([[Fraction(0)] * stages for _ in range(stages)], dtype=object)
    for i, row in enumerate(rows):
        matrix[i, : len(row)] = [Fraction(x) for x in row]
    return matrix


def transformed(method: IntegrationMethod) -> tuple[Exact, Exact, Exact, Exact]:
    """Return a, c, b and the error's weights of a Rosenbrock method without products with its matrix, as floats.

    With u = gamma k of all stages: (1 / (gamma h) - A) u_i = f(y + sum a_ij u_j) + sum c_ij / h u_j, and the step
    is sum b_i u_i (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, IV.7).
    """
    n = len(method.gamma)
    alpha, gamma = exact(method.a, n), exact(method.gamma, n)
    weights, error = (np.array([Fraction(x) for x in row], dtype=object) for row in (method.weights, method.error))
    inverse = exact((), n)
    for j in range(n):
        inverse[j, j] = 1 / gamma[j, j]
        for i in range(j + 1, n):
            inverse[i, j] = -sum(gamma[i, k] * inverse[k, j] for k in range(j, i)) / gamma[i, i]
    c = np.diag(np.diagonal(inverse)) - inverse
    coefficients = (alpha @ inverse, c, weights @ inverse, error @ inverse)
    a, c, b, wrong = (x.astype(np.float64) for x in coefficients)
    return a, c, b, wrong


def _numbers(values: Iterable[float], *, scalars: bool = True) -> str:
    numbers = [repr(float(x)) for x in values] or ["0.0"]
    return "{ " + ", ".join(f"EOM_C({x})" if scalars else x for x in numbers) + " }"


def _rows(rows: Iterable[Sequence[float]], *, scalars: bool = True) -> str:
    lines = "".join(f"            {_numbers(row, scalars=scalars)},\n" for row in rows)
    return f"{{\n{lines}        }}"


def _shares(rows: Rows) -> str:
    """Return the sums of rows: the end of a step is 1 to the bit, since inputs may jump there."""
    sums = [float(sum(map(Fraction, row))) for row in rows]
    return _numbers((1.0 if abs(x - 1.0) < 1e-14 else x for x in sums), scalars=False)


def _struct(fields: dict[str, str]) -> str:
    return "    {\n" + "".join(f"        {text}, /* {name} */\n" for name, text in fields.items()) + "    },\n"


def _explicit(method: IntegrationMethod) -> str:
    rows = [*method.a, method.b] if method.b else list(method.a)
    stages = len(rows) - 1
    return _struct(
        {
            "stages": str(stages),
            "a": _rows(rows),
            "error": _numbers(method.error),
            "shares": _shares([*rows[:stages], (1.0,)]),
        }
    )


def _rosenbrock(method: IntegrationMethod) -> str:
    a, c, b, error = transformed(method)
    stages = len(b)
    begins = [int(i > 0 and not any(row)) for i, row in enumerate(method.a)]
    return _struct(
        {
            "stages": str(stages),
            "diagonal": f"EOM_C({method.gamma[0][0]!r})",
            "a": _rows(a[i, :i].tolist() for i in range(stages)),
            "c": _rows(c[i, :i].tolist() for i in range(stages)),
            "b": _numbers(b),
            "error": _numbers(error),
            "shares": _shares(method.a),
            "begins": "{ " + ", ".join(map(str, begins)) + " }",
        }
    )


def _error_control(method: IntegrationMethod) -> str:
    works = method.within or [[weight] for weight in method.weights]
    return _struct(
        {
            "kind": KINDS.get(method.stability, "EOM_RADAU_KIND"),
            "stages": str(len(method.a) - (method.stability == EXPLICIT) if method.a else len(works)),
            "powers": str(len(works)),
            "degree": str(max(map(len, method.within), default=0)),
            "exponent": repr(1.0 / (method.embedded + 1)),
            "works": _rows(works, scalars=False),
            "errors": _numbers(method.error, scalars=False),
        }
    )


def render_tableaus(table: Sequence[IntegrationMethod] = TABLE) -> dict[str, str]:
    """Return the texts of clib/explicit_tableaus.h and clib/tableaus.h by these names.

    Raises:
        ValueError: a method has more stages than there is room for.
    """
    explicit, rosenbrock = (tableaus(kind, table) for kind in (EXPLICIT, ROSENBROCK))
    for method in (*explicit, *rosenbrock):
        if len(method.a) > STAGES + (method.stability == EXPLICIT and not method.b):
            raise ValueError(f"{method.name}: allowed: {STAGES} stages; workspaces of clib/eom.h have room for no more")
    adaptive = [row for row in table if row.library == "C" and row.embedded]
    numbers = {row.name: i for i, row in enumerate(adaptive)}
    files = {}
    families = (
        ("explicit_tableaus.h", "explicit", explicit, _explicit),
        ("tableaus.h", "rosenbrock", rosenbrock, _rosenbrock),
    )
    for file, kind, rows, write in families:
        each = " ".join(f"DO({numbers[row.name]}, {i})" for i, row in enumerate(rows) if row.embedded)
        files[file] = [
            f"/* {file}: coefficients of methods, which make methods renders from eomgen's table; see methods.h. */\n",
            f"\n/* {', '.join(row.name for row in rows)} */\n",
            f"static const EOM({kind}_method) eom_{kind}_methods[] = {{\n",
            *map(write, rows),
            "};\n\n/* Numbers of those with error control, and their places above. */\n",
            f"#define EOM_EACH_{kind.upper()}(DO) {each}\n",
        ]
    files["tableaus.h"] += [
        f"\n/* {', '.join(numbers)} */\n",
        "static const eom_error_control eom_error_controls[] = {\n",
        *map(_error_control, adaptive),
        "};\n",
    ]
    return {file: wrapped("".join(text)) for file, text in files.items()}


if __name__ == "__main__":
    for name, content in render_tableaus().items():
        Path(sys.argv[1], name).write_text(content, encoding="ascii")
