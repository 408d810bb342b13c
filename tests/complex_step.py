"""Derivatives of programs by complex steps: exact to round-off, without a difference."""

from __future__ import annotations

import cmath

import numpy as np
from random_robots import Array, State

from eomgen.codegen.equations import derive
from eomgen.codegen.ir import evaluate
from eomgen.model import build_model
from eomgen.robot import Robot

COMPLEX = {
    "sqrt": cmath.sqrt,
    "max": lambda x, y: y if complex(x).real < complex(y).real else x,
    "step": lambda x: float(complex(x).real > 0.0),
}


def complex_steps(robot: Robot, s: State, label: str) -> Array:
    """Derivative of the residual's program, a column at a time, without a difference."""
    model = build_model(robot)
    program, n = derive(model, "residual"), model.size
    block = np.zeros((n, n))
    for j in range(n):
        values: dict[str, list[complex]] = {x: [complex(y) for y in getattr(s, x)] for x in "qvau"}
        values["p"] = [complex(x) for x in model.parameters.values()]
        values[label][j] += 1e-30j
        found = evaluate(program, values, lambda x: (cmath.sin(x), cmath.cos(x)), COMPLEX)
        block[:, j] = [complex(found[key]).imag * 1e30 for key in sorted(found)]
    return block
