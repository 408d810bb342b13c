"""Files of links that bend, of any grade: constants, modes of nodes, or finite elements, which are reduced at once.

Finite elements are reduced here up to a size that takes a second or two; the result is kept by their content, as one
robot is read many times.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..identifiers import plain_path
from ..npz import read_npz
from .bending_body import BendingBody
from .element_files import NAMES, elements_of, has_elements
from .files import body_of_arrays
from .units import SI, in_si

MOST_UNKNOWNS = 6_000  # rows of finite elements that are reduced where a robot is read: a second
MOST_COUNT = 50  # modes beside those of interfaces there
_KEPT = 8  # reduced links
_reduced: dict[bytes, BendingBody] = {}  # by content


@dataclass(frozen=True, kw_only=True, eq=False)
class HowToTake:
    """How a file is taken into a link.

    Attributes:
        count: of finite elements: modes beside those of interfaces; None: what the file says.
        units: of finite elements, a name of ``UNITS``; None: SI.
        rotation: (3, 3), axes of the file in those of the link, columns.
        origin: (3,), m, origin of the file's axes in the link's frame.
    """

    count: int | None = None
    units: str | None = None
    rotation: ArrayLike | None = None
    origin: ArrayLike | None = None


def read_link(path: Path | str, how: HowToTake | None = None) -> BendingBody:
    """Read a link that bends from a file of constants, of modes of nodes, or of finite elements.

    Raises:
        InputError: the file cannot be read or taken; the message has the file, the array, the place and what is
            allowed.
    """
    how = HowToTake() if how is None else how
    arrays = read_npz(path)
    if has_elements(arrays):
        body = _reduced_once(path, arrays, how)
    else:
        for name, value in (("count", how.count), ("units", how.units)):
            if value is not None:
                raise InputError(f"{plain_path(path)}: {name} is for finite elements; allowed: none, as it has modes")
        body = body_of_arrays(path, arrays)
    if how.rotation is None and how.origin is None:
        return body
    rotation = np.eye(3) if how.rotation is None else how.rotation
    return body.placed(rotation, np.zeros(3) if how.origin is None else how.origin)


def _reduced_once(path: Path | str, arrays: Mapping[str, NDArray[Any]], how: HowToTake) -> BendingBody:
    """Return the reduced link of arrays of finite elements, kept by their content."""
    if "dofs" in arrays and arrays["dofs"].shape[:1] > (MOST_UNKNOWNS,):
        raise _too_large(path, f"its matrices have {len(arrays['dofs'])} rows; allowed: up to {MOST_UNKNOWNS}")
    content = hashlib.sha256(repr((how.count, how.units)).encode())
    for name in sorted(set(NAMES) & arrays.keys()):
        content.update(f"{name} {arrays[name].dtype} {arrays[name].shape}".encode())
        content.update(np.ascontiguousarray(arrays[name]).reshape(-1).view(np.uint8).data)
    key = content.digest()
    if key not in _reduced:
        body = _reduce(path, arrays, how)
        while len(_reduced) >= _KEPT:
            _reduced.pop(next(iter(_reduced)), None)
        _reduced[key] = body
    return _reduced[key]


def _reduce(path: Path | str, arrays: Mapping[str, NDArray[Any]], how: HowToTake) -> BendingBody:
    """Reduce arrays of finite elements; errors begin with the path."""
    from .reduction import reduce  # SciPy, which other files are read without

    try:
        elements = in_si(elements_of(arrays), how.units or SI)
        elements = elements if how.count is None else replace(elements, count=how.count)
        if elements.count <= MOST_COUNT:
            return reduce(elements).body()
    except InputError as error:
        raise InputError(f"{plain_path(path)}: {error}") from None
    raise _too_large(path, f"got {elements.count} modes beside those of interfaces; allowed: up to {MOST_COUNT}")


def _too_large(path: Path | str, message: str) -> InputError:
    """Return the error of a reduction that would take long, with the command that is meant for it."""
    command = f"eomgen reduce {plain_path(Path(path).name)} -o {plain_path(f'{Path(path).stem}_modes.npz')}"
    return InputError(
        f"{plain_path(path)}: {message} where a robot is read, or the modes that this command writes: {command}"
    )
