"""Operations of every kernel's C: those of its program, or of the programs that its template calls.

Of a frame's pose or Jacobian: those of the frame that needs most, from the base to it.
"""

from __future__ import annotations

from eomgen.robot.model import Model

from ..kernels.blocks import row_blocks
from ..kernels.closed_motion import CLOSING, row_kinds
from ..kernels.equations import Equations
from ..kernels.signatures import KERNELS
from ..solve.factorised import coordinates_in_front, solve_operations
from ..solve.rows import DERIVING

Counts = dict[str, int]  # "mul", "add", "div", "sincos"


def _closing_operations(model: Model, widths: list[int], refinements: int) -> Counts:
    """Count those of the derivatives of closed accelerations in C, beside the tree's: see ``accelerations_by.jinja``.

    ``widths``: of the rows of the constraint that do not vanish, the coordinates that may move them.
    """
    m, n, factors = len(widths), model.size, sum(len(chain) for chain in coordinates_in_front(model))
    triangle, passes, columns = m * (m - 1) // 2, refinements + 1, 3 * n
    second = sum(len(block.columns) ** 2 for block in row_blocks(model))
    per_column = sum(widths) + m * n + passes * 2 * triangle + refinements * m * m
    couples = (
        2 * m * factors
        + sum((r + 1) * width for r, width in enumerate(widths))
        + m * (m * m - 1) // 6
        + columns * per_column
    )
    return {
        "mul": couples + 2 * m,
        "add": couples + second + 4 * m + columns * passes * 2 * m,
        "div": m * n + triangle + columns * passes * 2 * m,
        "sincos": 0,
    }


def operations(equations: Equations) -> dict[str, Counts]:
    """Count multiplications, additions, divisions, sine-cosine pairs of every kernel's C and the parameters' setup."""
    counts = {name: _of_kernel(equations, name) for name in KERNELS.compiled if name in equations.kernels}
    return {**counts, "parameters": equations.setup.count()}


def _of_kernel(equations: Equations, name: str) -> Counts:
    if name in equations.shares:
        return equations.shares[name].count()
    if name in equations.programs:
        return equations.programs[name].count()
    if KERNELS[name].columns_of:
        column = equations.programs[KERNELS[name].columns_of].count()
        return {key: len(equations.model.coordinates) * number for key, number in column.items()}
    closed = KERNELS[name].closed if equations.model.constraints else ()
    counted = closed or KERNELS[name].counts or KERNELS[name].calls
    parts = [equations.programs[program].count() for program in counted]
    if KERNELS[name].writes == "derivatives":  # which the template solves for
        parts.append(solve_operations(equations.model))
    if CLOSING in closed:
        kinds = row_kinds(equations.model, equations.programs[CLOSING])
        wide = [len(block.columns) for block in row_blocks(equations.model) for _ in range(block.rows)]
        widths = [width for width, kind in zip(wide, kinds, strict=True) if kind >= 0]
        parts.append(_closing_operations(equations.model, widths, DERIVING[equations.dtype].refinements))
    return {key: sum(counts[key] for counts in parts) for key in parts[0]}
