"""Run-time parameters of a compiled kernel, by name."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, MutableMapping, Sequence
from typing import Any

import numpy as np

from ..errors import InputError, UnknownNameError
from ..names import nearest_or_all, show
from .direct import State
from .raw import RawKernel, Setup


class Parameters(MutableMapping[str, float]):
    """Run-time parameters by name; assigning computes what depends on them alone.

    ``update`` sets several at once. Masses, stiffnesses, dampings, armatures, clearances, free lengths and friction
    forces are at least 0, what is divided by 1e-12; that an inertia stays one that a body can have is up to the
    caller.

    They can be copied and pickled without the kernel that they are of.

    Attributes:
        state: what calls take: the values, and how they are made.
    """

    _again: tuple[Callable[..., Any], tuple[Any, ...]] | None = None  # see ``of``

    def __init__(
        self, raw: RawKernel, slots: Mapping[str, int], least: Mapping[str, float], most: float, state: State
    ) -> None:
        self._raw, self._slots, self._least, self._most, self.state = raw, slots, least, most, state

    @classmethod
    def of(
        cls,
        raw: RawKernel,
        values: Mapping[str, float],
        least: Mapping[str, float],
        again: tuple[Callable[..., Any], tuple[Any, ...]] | None = None,
    ) -> Parameters:
        """Make the parameters of a compiled module.

        Args:
            raw: the compiled module.
            values: by name, in the order of the slots.
            least: the least value of those that have one.
            again: a function and its arguments that make the same kernel in another process; none can be pickled
                without.
        """
        slots = {name: slot for slot, name in enumerate(values)}
        state = State(np.array([*values.values(), *(0.0 for _ in raw.turning)], raw.dtype))
        made = cls(raw, slots, least, float(np.finfo(raw.dtype).max), state)
        made._again = again
        return made

    def copy(self) -> Parameters:
        """Return the same names and values for the same code; neither sees the other's assignments."""
        other = Parameters(self._raw, self._slots, self._least, self._most, self.state.copy())
        other._again = self._again
        return other

    __copy__ = copy

    def __deepcopy__(self, memo: dict[int, Any]) -> Parameters:
        return self.copy()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle what makes the same kernel again, and the values: no code, no pointers."""
        if self._again is None:
            raise InputError(
                f"parameters: those of {self._raw.name}, a kernel that was put together by hand, cannot be pickled;"
                " allowed: parameters of kernels of eomgen.build and of generated packages, or dict(parameters)"
            )
        turned = [name for name, x in zip(self._raw.turning, self.state.values[len(self) :], strict=True) if x]
        return parameters_of, (*self._again, dict(self), turned)

    def turn(self, joints: Collection[str]) -> None:
        """Let these joints be turned, of those with 3-DOF rotation (``RawKernel.turning``), and the others not."""
        turned = [float(name in joints) for name in self._raw.turning]
        self.state.assign(*(x for k, number in enumerate(turned) for x in (len(self._slots) + k, number)))

    @property
    def setup(self) -> Setup:
        """The values as arrays, and what functions of C read of them; replaced as a whole on assignment."""
        return self.state.setup

    def __getitem__(self, name: str) -> float:
        return float(self.state.values[self._slot(name)])

    def __setitem__(self, name: str, value: float) -> None:
        known = type(value) is float and type(name) is str and name in self._slots
        if known and self._least.get(name, -self._most) <= value <= self._most:  # as in nearly all assignments
            self.state.assign(self._slots[name], value)
        else:
            self.update({name: value})

    def __delitem__(self, name: str) -> None:
        raise InputError(f"parameters: {name!r} cannot be removed; assign another value")

    def __contains__(self, name: object) -> bool:
        return name in self._slots

    def get(self, name: str, default: Any = None) -> Any:
        """Return the value, or the default where there is no parameter of that name."""
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
        wanted: list[float] = []
        try:
            values = dict(*args, **kwargs)
        except (TypeError, ValueError):
            raise InputError(f"parameters: {show(args[0])}; allowed: a mapping from names to numbers") from None
        for name, value in values.items():
            slot = self._slot(name)
            held = self._held(name, value)
            least = self._least.get(name)
            if least is not None and value < least:
                wrong = "too small" if least > 0.0 else "negative"
                raise InputError(f"parameters: {name} = {show(value)} is {wrong}; at least {least:g} is allowed")
            wanted += (slot, held)
        if wanted:
            self.state.assign(*wanted)

    def _held(self, name: str, value: Any) -> float:
        """Return the number as the kernel's dtype has it, of whole numbers without rounding."""
        if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
            raise InputError(f"parameters: {name} = {show(value)} is not a number")
        dtype = self._raw.dtype
        if isinstance(value, np.generic) and not isinstance(value, np.longdouble):
            value = value.item()
        if not abs(value) < math.inf:
            raise InputError(f"parameters: {name} = {show(value)} is not finite")
        if abs(value) > self._most:
            raise InputError(
                f"parameters: {name} = {show(value)} is beyond {dtype}; at most {self._most:.3g} is allowed"
            )
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


def parameters_of(
    make: Callable[..., Any], args: tuple[Any, ...], values: Mapping[str, float], turned: Sequence[str]
) -> Parameters:
    """Make a kernel again and return its parameters, with the values and the turned joints of a pickle."""
    made: Parameters = make(*args).parameters
    changed = {name: value for name, value in values.items() if made[name] != value}
    if changed:
        made.update(changed)
    made.turn(turned)
    return made
