"""Setup program of device source -> the array h: values precomputed from the parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..program.operations import OPERATIONS


def setup_values(setup: Mapping[str, Any], parameters: Sequence[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the array h of all kernels, each operation rounded once; one 0 where they read none.

    Args:
        setup: the entry "setup" of NAME_simt.json.
        parameters: values in their order, then 1 for each 3-DOF rotation whose chart is switched, else 0.
        dtype: of the kernels.
    """
    computed: list[Any] = []
    with np.errstate(all="ignore"):
        for op, *args in setup["values"]:
            if op in ("p", "const"):
                computed.append(dtype.type(parameters[args[0]] if op == "p" else args[0]))
                continue
            numbers = [computed[place] for place in args]
            operation = OPERATIONS[op]
            if operation.is_arithmetic:  # which NumPy's numbers round as devices do
                assert operation.value is not None
                computed.append(operation.value(*numbers))
            else:
                found = operation.compute(*map(float, numbers))
                computed.append(dtype.type(math.nan if found is None else found))
    return np.array([computed[place] for place in setup["h"]] or [0.0], dtype)
