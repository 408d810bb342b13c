"""Fields of results as files hold them: shapes, units and what is allowed, declared beside their types."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..forms.plain import field_types, printable
from ..limits import LARGEST_FOUND
from ..names import listed, show

ALLOWED = "allowed: what its save wrote"
REQUIRED = object()
_DTYPES: Mapping[type, tuple[str, Any, str]] = {  # kinds of NumPy's types, the one that is read, words
    float: ("fiu", np.float64, "numbers"),
    int: ("iu", np.intp, "numbers"),
    bool: ("b", np.bool_, "truth values"),
    complex: ("c", np.complex128, "complex numbers"),
    str: ("U", np.str_, "texts"),
}


@dataclass(frozen=True)
class Stored:
    """Declare how files hold a field of a result, as in ``q: Annotated[Array, Stored(("T", "n"), "m, rad")]``.

    Attributes:
        shape: numbers, and letters that stand for one size in all fields of a result; of names, how many there are.
        unit: of its numbers; "" where they have none.
        of: type of its entries: float, int, bool, complex or str.
        largest: magnitude of its numbers; infinity allows all but NaN.
        unknown: whether numbers that are not finite are allowed beside those.
        otherwise: its value for files of older versions, which are without it; by default files have it.
    """

    shape: tuple[str | int, ...] = ()
    unit: str = ""
    of: type = float
    largest: float = LARGEST_FOUND
    unknown: bool = False
    otherwise: Any = REQUIRED

    def read(self, array: NDArray[Any], where: str) -> Any:
        """Return an array of a file in the type that is declared: texts as a tuple, a single one as it is.

        Raises:
            InputError: it has entries of another type; the message begins with ``where``.
        """
        kinds, dtype, what = _DTYPES[self.of]
        if array.dtype.kind not in kinds and (array.size or self.of is not str):
            raise InputError(f"{where} has dtype {show(str(array.dtype))}; allowed: {what}")
        if self.of is str:
            if array.ndim != len(self.shape):
                raise InputError(f"{where} has shape {array.shape}; allowed: that of {listed(map(str, self.shape))}")
            return printable(str(array)) if not self.shape else tuple(printable(str(x)) for x in array.ravel().tolist())
        return np.asarray(array, dtype=dtype)

    def expected_shape(self, shape: tuple[int, ...], sizes: dict[str, int]) -> tuple[str | int, ...]:
        """Return the shape that sizes by letter ask for; letters without a size take it from the shape that came."""
        if len(shape) == len(self.shape):
            for letter, size in zip(self.shape, shape, strict=True):
                if isinstance(letter, str):
                    sizes.setdefault(letter, size)
        return tuple(sizes.get(x, x) if isinstance(x, str) else x for x in self.shape)

    def check(self, array: NDArray[Any], sizes: dict[str, int], where: str) -> None:
        """Check shape and numbers of an array.

        Raises:
            InputError: it has another shape, or a number that is not allowed; the message begins with ``where``.
        """
        wanted = self.expected_shape(array.shape, sizes)
        good = np.abs(array) <= self.largest
        if self.unknown:
            good |= ~np.isfinite(array)
        if array.shape != wanted or not good.all():
            unit = f" in {self.unit}" if self.unit else ""
            raise InputError(f"{where} has shape {array.shape}; allowed: {wanted}, finite numbers{unit}")


def stored_fields(result: type) -> dict[str, Stored]:
    """Return how files hold the fields of a result, by name: those of arrays, and others for which that is declared."""
    hints = field_types(result, annotated=True).items()
    return {name: item for name, hint in hints for item in get_args(hint) if isinstance(item, Stored)}
