"""Functions of a kernel as its methods call them: with wrenches, with loops closed or cut, direct or checked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...errors import UnknownNameError
from ...names import nearest_or_all, show
from ..arrays import flag, joint_lead
from ..calls import TREE, Calls
from ..direct import DirectFunctions
from ..raw import Array, RawFunction, RawKernel
from .wrenches import WrenchLike, wrench_rows

FRAME, WRENCH, CUT, OUT = "frame", "wrench", "cut", "out"  # names of arguments
PARTS = ("jet", "derivatives")  # kinds of functions, or of results, whose result is a tuple of arrays


@dataclass(frozen=True)
class CheckedFunction:
    """A function that is called in Python, which checks all arguments.

    Attributes:
        name: the function's.
        reads: number of the arrays that it reads.
        options: names of the arguments behind them.
        axes: axes of each array of a result that is a tuple of arrays, beginning with theirs; 0 of one array.
    """

    name: str
    reads: int
    options: tuple[str, ...]
    axes: int

    @classmethod
    def of(cls, raw: RawKernel, name: str) -> CheckedFunction:
        """Return the function of that name, which may be there for the open tree alone.

        Raises:
            UnknownNameError: the kernel was built without it.
        """
        function = raw.functions.get(name) or raw.functions.get(f"{TREE}{name}")
        if function is None:
            raise raw.missing(name)
        options = (*function.takes, CUT, OUT) if name not in raw.functions else options_of(function)
        in_parts = not {function.kind, function.writes}.isdisjoint(PARTS)
        return cls(name, len(function.reads), options, len(raw.shapes[function.writes]) * in_parts)

    def __call__(self, calls: Calls, *args: Any) -> Any:
        """Call it with the arrays and then the options, in their order."""
        options = dict(zip(self.options, args[self.reads :], strict=False))
        result = evaluate(calls, self.name, args[: self.reads], **options)
        return tuple(np.moveaxis(result, -self.axes, 0)) if self.axes else result


class BoundFunctions:
    """Functions as attributes and by their names, which take arrays and options in their order.

    Each is made when it is first looked up; from then on it is an attribute like others.

    Attributes:
        direct: functions of the extension module, or None before the first binding.
        is_direct: True if plain calls go through it.
    """

    def __init__(self, calls: Calls, direct: DirectFunctions | None = None) -> None:
        """Take a kernel's calls, and the functions of the extension module where its code was bound before."""
        self.calls, self.direct, self.is_direct = calls, direct, False

    def __getattr__(self, name: str) -> Callable[..., Array]:
        if name.startswith("__"):  # as copy and pickle ask for
            raise AttributeError(name)
        checked = CheckedFunction.of(self.calls.raw, name)
        bound: Callable[..., Array] = partial(checked, self.calls)
        if self.direct is not None and self.is_direct and name in self.calls.raw.functions:
            bound = self.direct.bound(checked, self.calls)
        setattr(self, name, bound)
        return bound

    def __getitem__(self, name: str) -> Callable[..., Array]:
        bound: Callable[..., Array] = getattr(self, name)
        return bound

    def bind(self, module: ModuleType) -> None:
        """Let plain calls go through an extension module; with augmented arrays inside those of the C."""
        if self.calls.augmented is not self.calls:
            return
        if self.direct is None or self.direct.module is not module:
            self.direct = DirectFunctions(module, self.calls.raw)
        parameters = self.calls.parameters
        if not isinstance(parameters.state, module.State):
            parameters.state = parameters.state.moved_to(module.State)
        self.is_direct = True
        for name in self.calls.raw.functions:
            vars(self).pop(name, None)


def options_of(function: RawFunction) -> tuple[str, ...]:
    """Return the names of the arguments behind the arrays of a function's method, in their order."""
    return (*((FRAME,) if function.is_framed else ()), *function.takes, OUT)


def evaluate(
    calls: Calls,
    name: str,
    values: Sequence[Any],
    *,
    frame: str | None = None,
    wrench: WrenchLike | None = None,
    z: ArrayLike | None = None,
    cut: bool = False,
    out: Array | None = None,
) -> Array:
    """Compute a function as the method of its name does; see ``Kernel`` for arguments and errors."""
    meta, function = calls.raw.libraries.meta, calls.raw.functions.get(name)
    is_closed = bool(meta.get("constraints"))
    if flag(CUT, cut) and is_closed:
        return evaluate(calls, calls.of_tree(name), values, wrench=wrench, z=z, out=out)
    if function is None:
        raise calls.raw.missing(name)
    if function.is_framed:
        return calls.run(name, out, values, (frame_number(meta["frames"], frame),))
    if WRENCH in function.reads:
        values = [wrench_rows(calls, values[0], x) if i else x for i, x in enumerate(values)]
    if wrench is not None and function.loaded and is_closed:
        loaded, external = function.loaded
        values = (*values, evaluate(calls, external, (values[0], wrench)))
        return evaluate(calls, loaded, values, wrench=wrench, z=z, out=out)
    if wrench is None or function.wrench is None:
        return calls.run(name, out, values, z=z)
    if not function.wrench.into:
        return calls.run_with_wrench(name, out, values, wrench_rows(calls, values[0], wrench), z)
    if calls.augmented is not calls:
        joined = calls.join_arguments(name, values, z)
        whole = evaluate(calls.augmented, name, joined, wrench=wrench)
        return calls.arrays.written(calls.split(whole, function.writes), out)
    return calls.run(name, out, _with_wrench(calls, function, values, wrench), z=z)


def _with_wrench(calls: Calls, function: RawFunction, values: Sequence[Any], wrench: WrenchLike) -> list[Any]:
    """Return arguments with the generalized forces of wrenches; of a prescribed coordinate stays its acceleration."""
    assert function.wrench is not None
    place = function.reads.index(function.wrench.into)
    external = evaluate(calls, function.wrench.function, (values[0], wrench))
    drives, lead = calls.array(function.wrench.into, values[place], external.shape[-1:])
    joint_lead(function.wrench.into, lead, external.shape[:-1])
    external[..., [calls.coordinates.index(x) for x in calls.prescribed]] = 0
    return [*values[:place], calls.arrays.beside_drives(drives, external), *values[place + 1 :]]


def frame_number(frames: Sequence[str], name: str | None) -> int:
    """Return the number of a frame or link.

    Raises:
        UnknownNameError: no frame or link of that name.
    """
    if not isinstance(name, str) or name not in frames:
        raise UnknownNameError(f"frame: {show(name)} is unknown{nearest_or_all(str(name), frames)}")
    return frames.index(name)
