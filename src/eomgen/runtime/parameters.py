"""Run-time parameters of a compiled kernel, by name.

A generated package carries a copy of this file.
"""

from __future__ import annotations

import difflib
import threading
from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from .kernel import Kernel

Array = NDArray[Any]


class Setup:
    """Parameters and what is computed from them; replaced as a whole, so that a running call keeps its own."""

    def __init__(self, ffi: Any, lib: Any, name: str, pointer: str, values: Array, hoisted: int) -> None:
        self.values = values
        self.computed = np.zeros(max(hoisted, 1), values.dtype)
        self.pointer = ffi.from_buffer(pointer, self.computed)
        padded = values if values.size else np.zeros(1, values.dtype)
        getattr(lib, f"{name}_setup")(ffi.from_buffer(pointer, padded), self.pointer)


class Parameters(MutableMapping[str, float]):
    """Run-time parameters by name; assigning computes what depends on them alone.

    ``update`` sets several at once.  Masses, stiffnesses, dampings, armatures, clearances, free lengths and friction
    forces are at least 0, what is divided by 1e-12; that an inertia stays one that a body can have is up to the caller.

    least: the least value of each parameter that has one.
    """

    def __init__(self, kernel: Kernel, values: Mapping[str, float], least: Mapping[str, float], hoisted: int) -> None:
        self._kernel, self._least, self._hoisted = kernel, least, hoisted
        self._slots = {name: slot for slot, name in enumerate(values)}
        self._lock = threading.Lock()
        self._set(np.array(list(values.values()), kernel.dtype))

    def copy_for(self, kernel: Kernel) -> Parameters:
        """The same names and values for another kernel of the same code; neither sees the other's assignments."""
        other = Parameters.__new__(Parameters)
        other._kernel, other._least, other._hoisted, other._slots = kernel, self._least, self._hoisted, self._slots
        other._lock = threading.Lock()
        other._setup = self._setup  # replaced as a whole on assignment
        return other

    def _set(self, values: Array) -> None:
        kernel = self._kernel
        self._setup = Setup(kernel._ffi, kernel._lib, kernel.name, kernel._pointer, values, self._hoisted)

    def __getitem__(self, name: str) -> float:
        return float(self._setup.values[self._slot(name)])

    def __setitem__(self, name: str, value: float) -> None:
        self.update({name: value})

    def __delitem__(self, name: str) -> None:
        raise InputError(f"parameters: {name!r} cannot be removed; assign another value")

    def __contains__(self, name: object) -> bool:
        return name in self._slots

    def get(self, name: str, default: Any = None) -> Any:
        """The value, or the default where there is no parameter of that name."""
        return self[name] if name in self._slots else default

    def __iter__(self) -> Iterator[str]:
        return iter(self._slots)

    def __len__(self) -> int:
        return len(self._slots)

    def __repr__(self) -> str:
        return f"Parameters({dict(self)})"

    def update(self, *args: Any, **kwargs: float) -> None:
        """Set several parameters at once; all of them, or none if one is refused.

        Raises:
            UnknownNameError: not a run-time parameter of this kernel.
            InputError: not a finite number, or negative where that cannot be.
        """
        wanted: dict[int, float] = {}
        for name, value in dict(*args, **kwargs).items():
            slot = self._slot(name)
            if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
                raise InputError(f"parameters: {name} = {value!r} is not a number")
            if not np.isfinite(value):
                raise InputError(f"parameters: {name} = {value!r} is not finite")
            least = self._least.get(name)
            if least is not None and value < least:
                wrong = "too small" if least > 0.0 else "negative"
                raise InputError(f"parameters: {name} = {value!r} is {wrong}; at least {least:g} is allowed")
            wanted[slot] = float(value)
        with self._lock:  # assignments of other threads are kept
            values = self._setup.values.copy()
            values[list(wanted)] = list(wanted.values())
            self._set(values)

    def _slot(self, name: str) -> int:
        try:
            return self._slots[name]
        except (KeyError, TypeError):
            pass
        raise UnknownNameError(
            f"parameters: {name!r} is not a run-time parameter of {self._kernel.name}"
            f"{nearest(str(name), list(self._slots))}; list other numbers of the description under `tunable`"
        )


def nearest(name: str, known: Sequence[str]) -> str:
    close = difflib.get_close_matches(name, known, 1)
    if close:
        return f"; did you mean {close[0]!r}?"
    return f"; known: {', '.join(known)}" if known else "; there are none"
