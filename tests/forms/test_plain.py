"""Values of declared types out of what JSON holds."""

from __future__ import annotations

import types
from dataclasses import make_dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.errors import InputError
from eomgen.forms.plain import value_of

pytestmark = pytest.mark.quick


class Alias:
    """What NumPy 2.5 calls NDArray where Python has type statements: a name with the type behind it."""

    __name__ = "NDArray"
    __value__ = np.ndarray[Any, np.dtype[np.float64]]

    def __getitem__(self, items: Any) -> types.GenericAlias:
        return types.GenericAlias(self, items)


@pytest.mark.parametrize("array", [NDArray[np.float64], Alias()[(np.float64,)]], ids=["class", "name"])
def test_arrays_are_read_as_numpy_names_them(array: Any) -> None:
    kind = make_dataclass("Rows", [("x", array)])
    assert value_of(kind, {"x": [0.0, 1.5]}, "file").x == (0.0, 1.5)
    assert value_of(kind, {"x": [[0.0, 1.5], [2.0, 3.0]]}, "file").x == ((0.0, 1.5), (2.0, 3.0))
    with pytest.raises(InputError, match=r"file: x: got rows of different lengths"):
        value_of(kind, {"x": [[0.0], [1.0, 2.0]]}, "file")
    with pytest.raises(InputError, match=r"file: x\[1\]: got 'a'; allowed: a value of type float"):
        value_of(kind, {"x": [0.0, "a"]}, "file")
