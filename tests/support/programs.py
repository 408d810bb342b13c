"""Programs of kernels in Python's arithmetic, and stages of implicit methods by them and by dense matrices."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from eomgen.codegen.kernels.accelerations import CONSTRAINED, SOLVERS
from eomgen.codegen.kernels.derivation import Derivation
from eomgen.codegen.kernels.equations import derive, derive_cheapest
from eomgen.codegen.kernels.stages import derive_pair_stage, derive_stage
from eomgen.codegen.program.ir import Program, evaluate
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Robot
from tests.support.random_robots import Array, State


def answer(robot: Robot, kernel: str, state: State | None = None, **given: Array) -> Array:
    """Return a kernel's outputs, (outputs,), from its program; ``state`` gives what it reads."""
    model = build_model(robot)
    arrays = ({} if state is None else {x: getattr(state, x) for x in ("q", "v", "a", "u", "z", "forces")}) | given
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


def run(program: Program, inputs: Mapping[str, list[float]]) -> Array:
    found = evaluate(program, inputs)
    return np.array([value for (name, _), value in sorted(found.items()) if name == "out"], dtype=float)


def dense_stage(matrices: tuple[Array, Array, Array], c: complex, r: Array, s: Array) -> Any:
    """Solve (M + c B + c^2 K) w = -((c B + c^2 K) r + c K s); of a complex c r and s are pairs, else of row 0 each."""
    (M, B, K), is_pair = matrices, isinstance(c, complex)
    rates, shifts = (x[0] + 1j * x[1] if is_pair else x[0] for x in (r, s))
    return np.linalg.solve(M + c * B + c * c * K, -((c * B + c * c * K) @ rates + c * K @ shifts))


def staged(model: Model, state: Mapping[str, Any], c: complex, r: Array, s: Array) -> Any:
    """The same by the programs of a stage."""
    is_pair, n, rates = isinstance(c, complex), len(model.coordinates), model.size
    first, second = (derive_pair_stage if is_pair else derive_stage)(Derivation(model)).values()
    names = (
        ("pair_times", "pair_rates", "pair_shifts", "pair_kept") if is_pair else ("times", "rates", "shifts", "kept")
    )
    times = [c.real, (c * c).real, c.imag, (c * c).imag] if is_pair else [c, c * c]
    inputs = {"kp": [0.0] * n, "kd": [0.0] * n, **state, "spans": [abs(c), abs(c) ** 2]}
    inputs |= {names[0]: times, names[1]: [*r.ravel()] if is_pair else [*r[0]]}
    inputs[names[2]] = [*s[:, :n].ravel()] if is_pair else [*s[0, :n]]
    found = run(second, inputs | {names[3]: run(first, inputs).tolist()})
    return found[:rates] + 1j * found[rates:] if is_pair else found
