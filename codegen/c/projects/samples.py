"""Equations -> NAME_samples.c: a C99 program that tests a robot's compiled functions in random states.

The numbers are those of the self-test of packages (``expected.py``): programs evaluated in NumPy, with tolerances that
are estimated from their rounding errors.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eomgen._version import __version__
from eomgen.runtime.rollouts import FIXED

from ...kernels.equations import Equations
from ...kernels.signatures import Function, functions, signatures_of
from ..expected import ITERATED, ROUNDING, STEP, expected_numbers, within
from ..scalar_types import SCALARS
from ..source import environment

Array = NDArray[Any]

NOT_COMPARED = -1.0  # tolerance of a number that rounding leaves open
UP = 1.01  # tolerances are written with three digits
WIDTH = 112  # columns of rows of numbers


def render_samples(equations: Equations, states: int) -> str:
    """Write the test program.

    Args:
        equations: of the robot's package.
        states: how many random states it calls every function in.
    """
    model, dtype, scalar = equations.model, equations.dtype, SCALARS[equations.dtype]
    expected = expected_numbers(equations, states)
    known = functions(equations.kernels, signatures_of(model))
    tested = [x for x in known if x.name in expected and x.kind != "adaptive"]
    read = dict.fromkeys(array for x in tested for array in x.signature.reads if not x.is_rollout)
    read |= dict.fromkeys(array for x in tested if x.is_rollout for array in ("q", "u", "forces") if array in expected)
    context = {
        "name": model.name,
        "version": __version__,
        "real": scalar.name,
        "states": states,
        "setup": "turned_setup" if model.turning else "setup",
        "p": _row([scalar.literal(x) for x in expected["p"]] or [scalar.literal(0.0)]),
        "inputs": {name: _table([[scalar.literal(x) for x in row] for row in expected[name]]) for name in read},
        "sizes": {name: max(expected[name].shape[1], 1) for name in read},
        "h": _compared(expected["h"], expected["h near"], dtype),
        "hoisted": len(expected["h"]),
        "frames": expected["frames"].tolist(),
        "checks": [_check(x, expected, equations) for x in tested],
        "left_out": [x.name for x in known if x not in tested],
        "rates": model.size,
        "step": scalar.literal(STEP[dtype]),
        "methods": 1 + max(FIXED.values()),
        "rounding": repr(ROUNDING * float(np.finfo(dtype).eps)),
        "not_compared": repr(NOT_COMPARED),
    }
    return environment().get_template("kernel/samples.c.jinja").render(context)


def _check(function: Function, expected: Mapping[str, Array], equations: Equations) -> dict[str, Any]:
    """Return what the template writes of one function."""
    name, size = function.name, math.prod(equations.interface["shapes"][function.signature.writes])
    wanted, near = expected[name], expected[f"{name} near"]
    if function.is_rollout:
        near = near + ITERATED * float(np.finfo(equations.dtype).eps) * np.abs(wanted).max(axis=-1, keepdims=True)
    count, places = wanted.shape[-1], expected.get(f"{name} places")
    found: dict[str, Any] = {
        "name": name,
        "function": function,
        "size": max(size, 1),
        "count": count,
        "columns": 1 if places is not None else equations.interface["shapes"][function.signature.writes][-1],
        "status": ", ".join(map(str, expected[f"{name} status"].tolist())),
        "terms": 0,
        **_compared(wanted.reshape(-1, count), near.reshape(-1, count), equations.dtype),
    }
    if places is not None:
        found |= {
            "terms": places.shape[1],
            "places": _table([[str(x) for x in row] for row in places.tolist()]),
            "weights": _row([repr(float(x)) for x in expected[f"{name} weights"]]),
        }
    return found


def _compared(wanted: Array, near: Array, dtype: str) -> dict[str, str]:
    """Write expected numbers, zeros where they are not compared, and tolerances, a row for each state."""
    allowed = np.atleast_2d(within(wanted, near, dtype))
    numbers = np.where(np.isinf(allowed), 0.0, np.atleast_2d(wanted))
    tolerances = [[_short(x) for x in row] for row in allowed]
    return {"wanted": _table([[repr(float(x)) for x in row] for row in numbers]), "allowed": _table(tolerances)}


def _short(tolerance: float) -> str:
    return repr(NOT_COMPARED) if math.isinf(tolerance) else f"{UP * tolerance:.2e}"


def _row(numbers: list[str]) -> str:
    """Write numbers between braces, in lines."""
    lines = textwrap.fill(", ".join(numbers or ["0"]), WIDTH, break_long_words=False, break_on_hyphens=False)
    return f"{{\n{textwrap.indent(lines, '        ')}\n    }}"


def _table(rows: list[list[str]]) -> str:
    return "{ " + ", ".join(_row(row) for row in rows) + " }"
