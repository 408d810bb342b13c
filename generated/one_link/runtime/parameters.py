"""Run-time parameters of a compiled kernel, by name.

A generated package carries a copy of this file.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator, Mapping, MutableMapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, UnknownNameError
from ..names import nearest_or_all, show
from .raw import RawKernel, Setup

Array = NDArray[Any]


class Parameters(MutableMapping[str, float]):
    """Run-time parameters by name; assigning computes what depends on them alone.

    ``update`` sets several at once.  Masses, stiffnesses, dampings, armatures, clearances, free lengths and friction
    forces are at least 0, what is divided by 1e-12; that an inertia stays one that a body can have is up to the caller.

    Attributes:
        setup: the values as arrays, and what functions of C read of them; replaced as a whole on assignment.
    """

    def __init__(self, raw: RawKernel, slots: Mapping[str, int], least: Mapping[str, float], setup: Setup) -> None:
        self._raw, self._slots, self._least, self._lock = raw, slots, least, threading.Lock()
        self.setup = setup

    @classmethod
    def of(cls, raw: RawKernel, values: Mapping[str, float], least: Mapping[str, float]) -> Parameters:
        """Parameters of a compiled module, whose order is that of the values.

        Args:
            least: the least value of each parameter that has one.
        """
        slots = {name: slot for slot, name in enumerate(values)}
        return cls(raw, slots, least, Setup(np.array(list(values.values()), raw.dtype)))

    def copy(self) -> Parameters:
        """The same names and values for the same code; neither sees the other's assignments."""
        return Parameters(self._raw, self._slots, self._least, self.setup)  # which is replaced as a whole on assignment

    def __getitem__(self, name: str) -> float:
        return float(self.setup.values[self._slot(name)])

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
            InputError: not a finite number, a whole one that the dtype cannot hold exactly, or negative where that
                cannot be.
        """
        wanted: dict[int, float] = {}
        for name, value in dict(*args, **kwargs).items():
            slot = self._slot(name)
            held = self._held(name, value)
            least = self._least.get(name)
            if least is not None and value < least:
                wrong = "too small" if least > 0.0 else "negative"
                raise InputError(f"parameters: {name} = {show(value)} is {wrong}; at least {least:g} is allowed")
            wanted[slot] = held
        with self._lock:  # assignments of other threads are kept
            values = self.setup.values.copy()
            values[list(wanted)] = list(wanted.values())
            self.setup = Setup(values)

    def _held(self, name: str, value: Any) -> float:
        """The number as the kernel's dtype has it, of whole numbers without rounding."""
        if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
            raise InputError(f"parameters: {name} = {show(value)} is not a number")
        dtype = self._raw.dtype
        if isinstance(value, np.generic) and not isinstance(value, np.longdouble):
            value = value.item()
        if not abs(value) < math.inf:
            raise InputError(f"parameters: {name} = {show(value)} is not finite")
        most = float(np.finfo(dtype).max)
        if abs(value) > most:
            raise InputError(f"parameters: {name} = {show(value)} is beyond {dtype}; at most {most:.3g} is allowed")
        held = float(dtype.type(value))
        rounded = held if isinstance(value, int) else float(value)
        if rounded != value:
            raise InputError(f"parameters: {name} = {show(value)} is a number that {dtype} cannot hold exactly")
        return held

    def _ipython_key_completions_(self) -> list[str]:
        return list(self._slots)

    def _slot(self, name: str) -> int:
        try:
            return self._slots[name]
        except (KeyError, TypeError):
            pass
        raise UnknownNameError(
            f"parameters: {name!r} is not a run-time parameter of {self._raw.name}"
            f"{nearest_or_all(str(name), self._slots)}; list other numbers of the description under `tunable`"
        )
