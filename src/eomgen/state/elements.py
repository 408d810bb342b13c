"""Numbers of force elements as a kernel has them now."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..names import component_name
from ..robot.elements import KINDS
from ..runtime.kernel import Kernel

Numbers = dict[str, dict[str, float]]  # by owner, then by their names in its table


def element_numbers(kernel: Kernel, family: str) -> Numbers:
    """Give the numbers of one family of forces, such as "bearings", by owner and by their names in its table.

    Args:
        family: one of ``robot.parameter_names.FAMILIES``.
    """
    values, owners = kernel.parameters.state.values, kernel.elements.get(family, {})
    return {owner: {key: float(values[place]) for key, place in places.items()} for owner, places in owners.items()}


def element_slopes(kernel: Kernel) -> tuple[Array, Array]:
    """Give the largest stiffness and damping along each of ``Kernel.element_rows``, (rows,) each; N/m, N m/rad."""
    found: dict[str, tuple[float, float]] = {}
    for table, kind in KINDS.items():
        for owner, numbers in element_numbers(kernel, table).items():
            found |= {component_name(owner, row): pair for row, pair in kind.slopes(numbers).items()}
    pairs = np.array([found[name] for name in kernel.element_rows]).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]
