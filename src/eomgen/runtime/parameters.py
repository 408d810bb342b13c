"""Run-time parameters of a compiled kernel, by name."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, MutableMapping, Sequence
from typing import Any

import numpy as np

from ..errors import InputError, UnknownNameError
from ..names import nearest_or_all, show
from .raw import Array, RawKernel, Setup


class State:
    """Parameters and choices that a kernel's calls take; the extension module has the same in C.

    Attributes:
        values: of the parameters, and behind them how joints are turned; replaced as a whole and never written to.
    """

    def __init__(
        self, values: Array, make: Callable[[Array], Setup] = Setup, checks: bool = True, threads: int = 1
    ) -> None:
        """Keep values, and what makes ``setup`` of them."""
        self.values, self.checks, self.threads = values, checks, threads
        self._make, self._lock = make, threading.Lock()
        self._setup: Setup | None = None
        self._successor: State | None = None

    @property
    def setup(self) -> Setup:
        """The values as functions of C read them: the same object until an assignment."""
        setup = self._setup
        if setup is not None:
            return setup
        with self._lock:
            self._setup = self._setup or self._make(self.values)
            return self._setup

    def assign(self, *pairs: float) -> None:
        """Replace the values by others that differ in some slots, at once: slot, number, slot, number, ..."""
        with self._lock:  # assignments of other threads are kept
            if self._successor is not None:
                self._successor.assign(*pairs)
                return
            values = self.values.copy()
            values[list(map(int, pairs[::2]))] = pairs[1::2]
            self.values, self._setup = values, None

    def moved_to(self, kind: Callable[..., State]) -> State:
        """Return a state of another type in its place, which gets the assignments that come here later."""
        with self._lock:
            if self._successor is None:
                self._successor = kind(self.values, self._make, self.checks, self.threads)
            return self._successor

    def copy(self) -> State:
        """Return a state with the same values, checks and threads; neither sees what becomes of the other."""
        with self._lock:
            other = State(self.values, self._make, self.checks, self.threads)
            other._setup = self._setup
            return other


class Parameters(MutableMapping[str, float]):
    """Run-time parameters by name; assigning computes what depends on them alone.

    ``update`` sets several at once. Masses, stiffnesses, dampings, armatures, clearances, free lengths and friction
    forces are at least 0, what is divided by 1e-12, matrices of stiffness and damping stay positive semidefinite, and
    numbers of laws go together as in descriptions: hysteresis and bristles give no energy back.  That an inertia stays
    one that a body can have is up to the caller.

    They can be copied and pickled without the kernel that they are of.

    Attributes:
        state: what calls take: the values, and how they are made.
    """

    def __init__(self, raw: RawKernel, again: tuple[Callable[..., Any], tuple[Any, ...]] | None = None) -> None:
        """Make the parameters of a compiled module, with the values of its description.

        Args:
            raw: the compiled module.
            again: a function and its arguments that make the same kernel in another process; none can be pickled
                without.
        """
        meta = raw.libraries.meta
        values: Mapping[str, float] = meta["parameters"]
        self._raw, self._again = raw, again
        self._slots = {name: slot for slot, name in enumerate(values)}
        self._least: Mapping[str, float] = meta.get("least", {})
        self._most = float(np.finfo(raw.dtype).max)
        self._conditions: Mapping[str, Any] = {}
        if meta.get("matrices") or meta.get("conditions"):
            from .parameter_conditions import conditions_of

            self._conditions = conditions_of(meta, raw.dtype)
        self._alone = {**self._least, **dict.fromkeys(self._conditions, math.inf)}  # these are never set alone
        self.state = State(np.array([*values.values(), *(0.0 for _ in raw.turning)], raw.dtype))

    def copy(self) -> Parameters:
        """Return the same names and values for the same code; neither sees the other's assignments."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        other.state = self.state.copy()
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
        return _parameters_of, (*self._again, dict(self), turned)

    def turn(self, joints: Collection[str]) -> None:
        """Turn the coordinates of these joints with 3-DOF rotation, and those of no others.

        The axes y, z and x of the joint's frame stand in the place of x, y and z, so that its angles are not singular
        where those of the description are.  That is so for forward_dynamics, forward_dynamics_jacobian,
        inverse_dynamics, mass_matrix, residual_jacobian and external_force; with loops not for inverse_dynamics, but
        for residual, the constraint, its Jacobian and bias, constrained_dynamics, settling and following.  It is for
        integrations, which choose by ``RawKernel.turning``; ``rollout`` does it by itself.

        Raises:
            UnknownNameError: a joint without 3-DOF rotation.
        """
        for name in joints:
            if name not in self._raw.turning:
                raise UnknownNameError(f"joints: {name!r} has no 3-DOF rotation; known: {', '.join(self._raw.turning)}")
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
        if known and self._alone.get(name, -self._most) <= value <= self._most:  # as in nearly all assignments
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
                cannot be; a matrix of stiffness or damping would not be positive semidefinite; or numbers of a law do
                not go together.
        """
        held: dict[str, float] = {}
        try:
            values = dict(*args, **kwargs)
        except (TypeError, ValueError):
            raise InputError(f"parameters: {show(args[0])}; allowed: a mapping from names to numbers") from None
        for name, value in values.items():
            self._slot(name)
            held[name] = self._held(name, value)
            least = self._least.get(name)
            if least is not None and value < least:
                wrong = "too small" if least > 0.0 else "negative"
                raise InputError(f"parameters: {name} = {show(value)} is {wrong}; at least {least:g} is allowed")
        if not self._conditions.keys().isdisjoint(held):
            from .parameter_conditions import refuse_faults

            refuse_faults(self._conditions, values, lambda name: held[name] if name in held else self[name])
        if held:
            self.state.assign(*(x for name, number in held.items() for x in (self._slots[name], number)))

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


def kernel_of(
    make: Callable[..., Any], args: tuple[Any, ...], values: Mapping[str, float], turned: Sequence[str]
) -> Any:
    """Make a kernel again, whose parameters have the values and the turned joints of a pickle."""
    kernel = make(*args)
    changed = {name: value for name, value in values.items() if kernel.parameters[name] != value}
    if changed:
        kernel.parameters.update(changed)
    kernel.parameters.turn(turned)
    return kernel


def _parameters_of(*pickled: Any) -> Parameters:
    """Return the parameters of a kernel that is made again."""
    made: Parameters = kernel_of(*pickled).parameters
    return made
