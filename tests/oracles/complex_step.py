"""Derivatives of programs by complex steps: exact to round-off, without a difference."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping

import numpy as np

from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.ir import evaluate
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.support.random_robots import Array, State

COMPLEX = {
    "sqrt": cmath.sqrt,
    "abs": lambda x: x if complex(x).real > 0.0 else -x,
    "max": lambda x, y: y if complex(x).real <= complex(y).real else x,
    "step": lambda x: float(complex(x).real > 0.0),
    "choose": lambda gate, x, y: x if complex(gate).real > 0.0 else y,
    "exp": cmath.exp,
    "log": cmath.log,
    "atan2": lambda y, x: bearing(complex(y), complex(x)),
}


def bearing(y: complex, x: complex) -> complex:
    """Angle of the point (x, y), of steps whose squares vanish."""
    turn = (x.real * y.imag - y.real * x.imag) / (x.real**2 + y.real**2)
    return complex(math.atan2(y.real, x.real), turn)


def complex_steps(robot: Robot, s: State, label: str) -> Array:
    """Derivative of the residual's program by q, v, z, a or u, (n, numbers)."""
    return complex_jacobian(robot, "residual", {x: getattr(s, x) for x in "qvzau"}, label)


def complex_jacobian(robot: Robot, kernel: str, arrays: Mapping[str, Array], label: str) -> Array:
    """Derivative of a kernel's program by one of its arrays, (outputs, numbers), a column at a time."""
    model = build_model(robot)
    program, columns = derive(model, kernel), []
    for j in range(arrays[label].size):
        values = {name: [complex(x) for x in np.ravel(array)] for name, array in arrays.items()}
        values["p"] = [*map(complex, model.parameters.values()), *[0j] * len(model.turning)]
        values[label][j] += 1e-30j
        found = evaluate(program, values, lambda x: (cmath.sin(x), cmath.cos(x)), COMPLEX)
        columns.append([complex(found[key]).imag * 1e30 for key in sorted(found) if key[0] == "out"])
    return np.array(columns).T
