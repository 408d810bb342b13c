"""Programs of kernels, evaluated in Python's arithmetic."""

from __future__ import annotations

import numpy as np

from eomgen.codegen.kernels.accelerations import CONSTRAINED, SOLVERS
from eomgen.codegen.kernels.derivation import Derivation
from eomgen.codegen.kernels.equations import derive, derive_cheapest
from eomgen.codegen.program.ir import evaluate
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.support.random_robots import Array, State


def answer(robot: Robot, kernel: str, state: State | None = None, **given: Array) -> Array:
    """Return a kernel's outputs, (outputs,), from its program; ``state`` gives q, v, a and u."""
    model = build_model(robot)
    arrays = ({} if state is None else {x: getattr(state, x) for x in "qvau"}) | given
    inputs = {name: list(map(float, array)) for name, array in arrays.items()}
    inputs["p"] = [*model.parameters.values(), *[0.0] * len(model.turning)]
    found = evaluate(derive(model, kernel), inputs)
    return np.array([found[key] for key in sorted(found) if key[0] == "out"])


def by_solvers(robot: Robot, kernel: str, **given: Array) -> dict[str, Array]:
    """Return what a kernel gives, accelerations first, by each solver that suits a robot; there is one at least."""
    model = build_model(robot)
    inputs = {name: list(map(float, array)) for name, array in given.items()}
    inputs["p"] = [*model.parameters.values(), *[0.0] * len(model.turning)]
    found = {}
    for solver, variant in (CONSTRAINED if model.constraints else SOLVERS).items():
        if variant.suits(Derivation(model)):
            values = evaluate(derive_cheapest(model, kernel, solver)[0], inputs)
            found[solver] = np.array([values[key] for key in sorted(values) if key[0] == "out"])
    assert found
    return found
