"""Stages of implicit methods by their programs, and by dense matrices."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eomgen.codegen.kernels.derivation import Derivation
from eomgen.codegen.kernels.stages import derive_pair_stage, derive_stage
from eomgen.codegen.program.ir import Program, evaluate
from eomgen.robot.model import Model

Array = NDArray[np.float64]


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
    is_pair, n = isinstance(c, complex), model.size
    first, second = (derive_pair_stage if is_pair else derive_stage)(Derivation(model)).values()
    names = (
        ("pair_times", "pair_rates", "pair_shifts", "pair_kept") if is_pair else ("times", "rates", "shifts", "kept")
    )
    times = [c.real, (c * c).real, c.imag, (c * c).imag] if is_pair else [c, c * c]
    inputs = {"kp": [0.0] * n, "kd": [0.0] * n, **state, "spans": [abs(c), abs(c) ** 2]}
    inputs |= {names[0]: times, names[1]: [*r.ravel()] if is_pair else [*r[0]]}
    inputs[names[2]] = [*s.ravel()] if is_pair else [*s[0]]
    found = run(second, inputs | {names[3]: run(first, inputs).tolist()})
    return found[:n] + 1j * found[n:] if is_pair else found
