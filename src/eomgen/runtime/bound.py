"""Functions of a kernel as its methods call them: checked, with wrenches, with loops closed or cut."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import UnknownNameError
from ..names import nearest_or_all, show
from .arrays import flag, joint_lead
from .calls import TREE, Calls
from .parameters import kernel_of
from .raw import Array, RawFunction, RawKernel
from .wrenches import WrenchLike, wrench_rows

FRAME, WRENCH, Z, CUT, OUT = "frame", "wrench", "z", "cut", "out"  # names of arguments
PARTS = ("jet", "derivatives")  # kinds of functions, or of results, whose result is a tuple of arrays


@dataclass(frozen=True)
class CheckedFunction:
    """A function that is called in Python, which checks all arguments.

    Attributes:
        name: the function's.
        labels: names of its arguments, arrays and options, in their order.
        positional: how many of them may be given without their names.
        axes: axes of each array of a result that is a tuple of arrays, beginning with theirs; 0 of one array.
    """

    name: str
    labels: tuple[str, ...]
    positional: int
    axes: int

    @classmethod
    def of(cls, raw: RawKernel, name: str) -> CheckedFunction:
        """Return the function of that name, which may be there for the open tree alone.

        Raises:
            UnknownNameError: the kernel was built without it.
        """
        function = function_of(raw, name)
        if function is None:
            raise raw.missing(name)
        options = (*((FRAME,) if function.is_framed else ()), *sorted(function.takes, key=lambda x: x != Z))
        labels = (*function.arguments, *options, *((CUT,) if name not in raw.functions else ()), OUT)
        return cls(name, labels, len(labels), axes_of_parts(raw, function))

    def __call__(self, calls: Calls, /, *args: Any, **options: Any) -> Any:
        """Call it with a kernel's ``Calls``, arrays and options."""
        function = function_of(calls.raw, self.name)
        if function is None:
            raise calls.raw.missing(self.name)
        given = dict(zip(self.labels, args, strict=False)) | options
        result = evaluate(calls, self.name, [given.pop(x) for x in function.arguments], **given)
        return tuple(np.moveaxis(result, -self.axes, 0)) if self.axes else result


def axes_of_parts(raw: RawKernel, function: RawFunction | None) -> int:
    """Return the axes of each array of a function's result, see ``CheckedFunction``; 0 without a function."""
    in_parts = function is not None and not {function.kind, function.writes}.isdisjoint(PARTS)
    return len(raw.shapes[function.writes]) if function is not None and in_parts else 0


def function_of(raw: RawKernel, name: str) -> RawFunction | None:
    """Return the function of that name, which may be there for the open tree alone; None where there is none."""
    return raw.functions.get(name) or raw.functions.get(f"{TREE}{name}")


class CalledInPython(partial[Any]):
    """A ``CheckedFunction`` for a kernel's calls."""

    def __init__(self, checked: CheckedFunction, calls: Calls) -> None:
        self.checked = checked
        self.__name__ = checked.name

    def __repr__(self) -> str:
        return f"<{self.checked.name} of {self.args[0].raw.name}>"

    def __get__(self, instance: Any, owner: type | None = None) -> CalledInPython:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        calls: Calls = self.args[0]
        _, made = calls.parameters.__reduce__()
        return _method_again, (self.checked.name, calls.threads, calls.checks, made)


def _method_again(name: str, threads: int, checks: bool, made: tuple[Any, ...]) -> Any:
    """Return a method of a kernel that is made again, of one that was pickled."""
    kernel = kernel_of(*made)
    kernel.threads, kernel.checks = threads, checks
    return getattr(kernel if hasattr(type(kernel), name) else kernel.functions, name)


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
    values, forces = with_wrench(calls, name, values, wrench)
    return calls.run(name, out, calls.arguments(name, values, z, forces))


def with_wrench(calls: Calls, name: str, values: Sequence[Any], wrench: WrenchLike) -> tuple[list[Any], Array | None]:
    """Return arguments with the generalized forces of wrenches, and forces beside drives with states.

    Of a prescribed coordinate its acceleration stays.
    """
    function = calls.raw.functions[name]
    assert function.wrench is not None
    place = function.arguments.index(function.wrench.into)
    external = evaluate(calls, function.wrench.function, (values[0], wrench))
    drives, lead = calls.array(function.wrench.into, values[place], external.shape[-1:])
    joint_lead(function.wrench.into, lead, external.shape[:-1])
    external[..., [calls.coordinates.index(x) for x in calls.prescribed]] = 0
    total, forces = calls.arrays.beside_drives(drives, external)
    return [*values[:place], total, *values[place + 1 :]], forces


def frame_number(frames: Sequence[str], name: str | None) -> int:
    """Return the number of a frame or link.

    Raises:
        UnknownNameError: no frame or link of that name.
    """
    if not isinstance(name, str) or name not in frames:
        raise UnknownNameError(f"frame: {show(name)} is unknown{nearest_or_all(str(name), frames)}")
    return frames.index(name)
