"""Numbers that were measured, or are set beside measurements: the one place where they come in from files and arrays.

They have the limits of descriptions (``limits``), whatever file they stand in, so that no product of a few of them
overflows.  ``csv_columns`` holds its blocks to the same limits.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from functools import wraps
from math import isfinite
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np

from ..arrays import Array, Mask
from ..errors import InputError
from ..limits import LARGEST
from ..names import show

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

ALLOWED = f"a finite number of magnitude up to {LARGEST:g}"
ALLOWED_DIVISOR = f"a positive number from {1.0 / LARGEST:g} to {LARGEST:g}"
_ALIKE = "SI units, and standard deviations and weights of similar size"
SHORTEST = 1e-12  # s between two samples: less is no measurement, and rates of what changes there would overflow


def within_limits(values: Any, *, blanks: bool = False) -> Mask:
    """Tell which numbers are within the limits; NaN is, where ``blanks`` says so."""
    with np.errstate(invalid="ignore"):
        good = np.abs(values) <= LARGEST
    return np.asarray(good | np.isnan(values) if blanks else good)


def is_divisor(values: Any) -> Mask:
    """Tell which numbers can be divided by: deviations, weights and the like, positive and not too small."""
    with np.errstate(invalid="ignore"):
        return np.asarray((values >= 1.0 / LARGEST) & (values <= LARGEST))


def checked_numbers(name: str, values: Any, place: Callable[[int], str], *, blanks: bool = False) -> Array:
    """Convert numbers of a file or of a caller to float64, of the same shape.

    Args:
        name: of the column or array, for messages.
        values: of integers or floats of any width.
        place: what a message calls the place of a row.
        blanks: whether NaN may be there, where nothing was measured.

    Raises:
        InputError: they are no numbers, not finite, or beyond the limits, with the first that is wrong.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        raise InputError(f"{place(0)}: array {show(name)} has dtype {array.dtype}; allowed: numbers")
    with np.errstate(over="ignore"):  # of longer floats; what becomes infinite is refused
        numbers = array.astype(np.float64, copy=False)
    good = within_limits(numbers, blanks=blanks)
    if not good.all():
        row = np.argwhere(~good)[0].tolist()
        value = numbers[tuple(row)]
        raise InputError(f"{place(row[0] if row else 0)}: column {show(name)}: {value:g}; allowed: {ALLOWED}")
    return numbers


def answers_in_numbers(argument: str) -> Callable[[Callable[Arguments, Result]], Callable[Arguments, Result]]:
    """Decorate an analysis of measured numbers: what cannot be solved, or is not finite, becomes an InputError.

    Numbers within the limits can still differ so much that round-off is all that is left of some.

    Args:
        argument: name of the parameter that has what was measured: a path, several, or a value with a ``source``.
    """

    def decorate(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
        signature = inspect.signature(function)

        @wraps(function)
        def analysed(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
            def refusal(what: str) -> InputError:
                source = _source(signature.bind(*arguments, **options).arguments.get(argument))
                return InputError(f"{source}: {what}; allowed: {_ALIKE}")

            try:
                result = function(*arguments, **options)
            except np.linalg.LinAlgError as error:
                raise refusal(f"numbers differ too much in size for double precision ({error})") from None
            for name, value in _numbers_of(result.as_dict(), ""):  # type: ignore[attr-defined]
                if not isfinite(value):
                    raise refusal(f"{name} comes out as {value}: numbers are too large, or differ too much in size")
            return result

        return analysed

    return decorate


def _source(origin: Any) -> str:
    if isinstance(origin, (str, Path)):
        return str(origin)
    if isinstance(origin, (list, tuple)) and origin:
        return _source(origin[0])
    return str(getattr(origin, "source", "") or "what was measured")


def _numbers_of(values: Any, name: str) -> Iterator[tuple[str, float]]:
    """Yield floats of plain values, with the keys that lead to them."""
    if isinstance(values, Mapping):
        for key, value in values.items():
            yield from _numbers_of(value, f"{name}.{key}" if name else str(key))
    elif isinstance(values, (list, tuple)):
        for i, value in enumerate(values):
            yield from _numbers_of(value, f"{name}[{i}]")
    elif isinstance(values, float):
        yield name, values
