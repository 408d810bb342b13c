"""Operations of every kernel's C: those of its program, or of the programs that its template calls.

Of a frame's pose or Jacobian: those of the frame that needs most, from the base to it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from eomgen.robot.model import Model

from ..solve.factorised import solve_operations
from .equations import Equations
from .signatures import KERNELS

Counts = dict[str, int]  # "mul", "add", "div", "sincos"

OWN: Mapping[str, Callable[[Model], Counts]] = {  # of templates, beside the programs that they call
    "forward_dynamics_jacobian": solve_operations,
}


def operations(equations: Equations) -> dict[str, Counts]:
    """Multiplications, additions, divisions and sine-cosine pairs of every kernel's C, and of the parameters' setup."""
    counts = {name: _of_kernel(equations, name) for name in KERNELS if name in equations.kernels}
    return {**counts, "parameters": equations.setup.count()}


def _of_kernel(equations: Equations, name: str) -> Counts:
    if name in equations.shares:
        return equations.shares[name].count()
    if name in equations.programs:
        return equations.programs[name].count()
    if KERNELS[name].columns_of:
        column = equations.programs[KERNELS[name].columns_of].count()
        return {key: equations.model.size * number for key, number in column.items()}
    closed = KERNELS[name].closed if equations.model.constraints else ()
    parts = [equations.programs[program].count() for program in closed or KERNELS[name].counts]
    parts += [OWN[name](equations.model)] if name in OWN else []
    return {key: sum(part[key] for part in parts) for key in parts[0]}
