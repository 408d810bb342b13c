"""Functions of a kernel as its methods call them: with wrenches, with loops closed or cut, direct or checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, update_wrapper
from types import MethodType, ModuleType
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from ..errors import UnknownNameError
from ..names import nearest_or_all, show
from .arrays import flag, joint_lead
from .calls import TREE, Calls
from .direct import DirectFunctions
from .parameters import kernel_of
from .raw import Array, RawFunction, RawKernel
from .wrenches import WrenchLike, wrench_rows

FRAME, WRENCH, Z, CUT, OUT = "frame", "wrench", "z", "cut", "out"  # names of arguments
PARTS = ("jet", "derivatives")  # kinds of functions, or of results, whose result is a tuple of arrays
Declared = TypeVar("Declared", bound=Callable[..., Any])


class KernelMethod:
    """A method of a class: the function of its name in ``BoundFunctions``.

    Those of the extension module become attributes of the object itself, so that the next call costs no look-up in
    Python.  Signature and docstring are those of the function that it is made of, which does nothing.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        update_wrapper(self, function)
        self.__func__ = function

    def __get__(self, owner: Any, kind: type) -> Any:
        if owner is None:
            return self
        name = self.__func__.__name__
        bound = owner._bound[name]  # noqa: SLF001  (of the class that has the method)
        if not isinstance(bound, CalledInPython) and getattr(type(owner), name) is self:  # not of a base class
            vars(owner)[name] = bound
        return bound

    def __call__(self, owner: Any, *args: Any, **options: Any) -> Any:
        """Call it as a function whose first argument is the kernel."""
        return self.__get__(owner, type(owner))(*args, **options)


DECLARED: dict[str, tuple[Callable[..., Any], str]] = {}  # functions that methods are made of, and their ``otherwise``


def kernel_method(otherwise: str = "") -> Callable[[Declared], Declared]:
    """Return the decorator of methods that call a function of C; ``otherwise`` as of ``CheckedFunction``."""

    def declare(function: Declared) -> Declared:
        DECLARED[function.__name__] = function, otherwise
        return cast("Declared", KernelMethod(function))

    return declare


@dataclass(frozen=True)
class CheckedFunction:
    """A function that is called in Python, which checks all arguments.

    Attributes:
        name: the function's.
        labels: names of its arguments, arrays and options, in their order.
        positional: how many of them may be given without their names.
        axes: axes of each array of a result that is a tuple of arrays, beginning with theirs; 0 of one array.
        declared: of a method the function with its signature and docstring, which does nothing.
        otherwise: the argument that is the result where no drive has internal states.
    """

    name: str
    labels: tuple[str, ...]
    positional: int
    axes: int
    declared: Callable[..., Any] | None = None
    otherwise: str = ""

    @classmethod
    def of(cls, raw: RawKernel, name: str) -> CheckedFunction:
        """Return the function of that name, which may be there for the open tree alone; a method may have none.

        Raises:
            UnknownNameError: the kernel was built without it, and no method has its name.
        """
        function = _function(raw, name)
        in_parts = function is not None and not {function.kind, function.writes}.isdisjoint(PARTS)
        axes = len(raw.shapes[function.writes]) if function is not None and in_parts else 0
        if name in DECLARED:
            declared, otherwise = DECLARED[name]
            code = declared.__code__
            labels = code.co_varnames[1 : code.co_argcount + code.co_kwonlyargcount]
            return cls(name, labels, code.co_argcount - 1, axes, declared, otherwise)
        if function is None:
            raise raw.missing(name)
        options = (*((FRAME,) if function.is_framed else ()), *sorted(function.takes, key=lambda x: x != Z))
        labels = (*function.arguments, *options, *((CUT,) if name not in raw.functions else ()), OUT)
        return cls(name, labels, len(labels), axes)

    def __call__(self, calls: Calls, /, *args: Any, **options: Any) -> Any:
        """Call it with a kernel's ``Calls``, arrays and options."""
        if self.declared is not None:
            self.declared(calls, *args, **options)  # raises the TypeError of a wrong call
        given = dict(zip(self.labels, args, strict=False)) | options
        function = _function(calls.raw, self.name)
        if self.otherwise and not calls.arrays.has_drives:
            return _argument(calls, self.otherwise, given)
        if function is None:
            raise calls.raw.missing(self.name)
        result = evaluate(calls, self.name, [given.pop(x) for x in function.arguments], **given)
        return tuple(np.moveaxis(result, -self.axes, 0)) if self.axes else result


def _function(raw: RawKernel, name: str) -> RawFunction | None:
    """Return the function of that name, which may be there for the open tree alone; None where there is none."""
    return raw.functions.get(name) or raw.functions.get(f"{TREE}{name}")


class CalledInPython(partial[Any]):
    """A ``CheckedFunction`` for a kernel's calls; it shows what the kernel's method of its name shows."""

    def __init__(self, checked: CheckedFunction, calls: Calls) -> None:
        self.checked = checked
        self.__name__ = checked.name
        if checked.declared is not None:
            update_wrapper(self, MethodType(checked.declared, calls))

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


def _argument(calls: Calls, name: str, given: Mapping[str, Any]) -> Array:
    """Return an argument by coordinate as a function would that reads all that are given, which are checked."""
    calls.refuse_z(given.get(Z))
    lead: tuple[int, ...] = ()
    arrays = {}
    for label in (x for x in given if x not in (Z, OUT)):
        arrays[label], own = calls.array(label, given[label], (calls.n,))
        lead = joint_lead(label, own, lead)
    return calls.arrays.written(np.array(np.broadcast_to(arrays[name], (*lead, calls.n))), given.get(OUT))


class BoundFunctions:
    """Functions as attributes and by their names.

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
        bound: Callable[..., Array] = CalledInPython(checked, self.calls)
        if self.direct is not None and self.is_direct and name in self.calls.raw.functions:
            bound = self.direct.bound(checked, bound, self.calls.parameters.state)
        setattr(self, name, bound)
        return bound

    def __getitem__(self, name: str) -> Callable[..., Array]:
        bound: Callable[..., Array] = getattr(self, name)
        return bound

    def has(self, name: str) -> bool:
        """Whether there is a function of that name, which may be there for the open tree alone."""
        return _function(self.calls.raw, name) is not None

    def names(self) -> list[str]:
        """List the names of functions, without those of the open tree."""
        return [name for name in self.calls.raw.functions if not name.startswith(TREE)]

    def bind(self, module: ModuleType) -> None:
        """Let plain calls go through an extension module."""
        if self.direct is None or self.direct.module is not module:
            self.direct = DirectFunctions(module, self.calls.raw)
        parameters = self.calls.parameters
        if not isinstance(parameters.state, module.State):
            parameters.state = parameters.state.moved_to(module.State)
        self.is_direct = True
        for name in self.calls.raw.functions:
            vars(self).pop(name, None)


class MethodsOfFunctions:
    """Base of classes whose methods are functions of a kernel.

    Attributes:
        is_direct: True if an extension module takes plain calls: arrays of the kernel's dtype and of exactly its
            shapes.  They go to the C without checks in Python.  All others, and all errors, are those of the calls in
            Python, so that nothing but their time depends on it.  It is False where Python's or NumPy's headers were
            missing.
    """

    def __init__(self, bound: BoundFunctions) -> None:
        """Take a kernel's functions."""
        self._bound = bound

    @property
    def is_direct(self) -> bool:
        """Whether plain calls go through an extension module."""
        return self._bound.is_direct


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
