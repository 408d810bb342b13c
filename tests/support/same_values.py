"""Results compared field by field, arrays to the bit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Any

import numpy as np


def compare_values(ours: Any, theirs: Any, name: str = "result") -> None:
    """Assert that two values are of one type and equal, and so are all fields and items of theirs."""
    assert type(ours) is type(theirs), name
    if isinstance(ours, np.ndarray):
        assert (ours.dtype, ours.shape, ours.tobytes()) == (theirs.dtype, theirs.shape, theirs.tobytes()), name
    elif is_dataclass(ours):
        for key, value in vars(ours).items():
            compare_values(value, vars(theirs)[key], f"{name}.{key}")
    elif isinstance(ours, Mapping):
        assert list(ours) == list(theirs), name
        for key, value in ours.items():
            compare_values(value, theirs[key], f"{name}[{key!r}]")
    elif isinstance(ours, (tuple, list)):
        assert len(ours) == len(theirs), name
        for k, (one, other) in enumerate(zip(ours, theirs, strict=True)):
            compare_values(one, other, f"{name}[{k}]")
    else:
        assert ours == theirs or ours is theirs, name
