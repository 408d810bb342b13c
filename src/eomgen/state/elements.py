"""Numbers of force elements as a kernel has them now."""

from __future__ import annotations

from ..runtime.kernel import Kernel

Numbers = dict[str, dict[str, float]]  # by owner, then by their names in its table


def element_numbers(kernel: Kernel, family: str) -> Numbers:
    """Give the numbers of one family of forces, such as "bearings", by owner and by their names in its table.

    Args:
        family: one of ``robot.parameter_names.FAMILIES``.
    """
    values, owners = kernel.parameters.state.values, kernel.elements.get(family, {})
    return {owner: {key: float(values[place]) for key, place in places.items()} for owner, places in owners.items()}
