"""Functions of a kernel as methods of a class, each with the signature and the docstring that are declared there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import update_wrapper
from types import MethodType
from typing import Any, TypeVar, cast

import numpy as np

from ..runtime.arrays import joint_lead
from ..runtime.bound import OUT, CalledInPython, CheckedFunction, Z, axes_of_parts, function_of
from ..runtime.calls import Calls
from ..runtime.direct import BoundFunctions
from ..runtime.raw import Array, RawKernel

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
    """Return the decorator of methods that call a function of C; ``otherwise`` as of ``DeclaredFunction``."""

    def declare(function: Declared) -> Declared:
        DECLARED[function.__name__] = function, otherwise
        return cast("Declared", KernelMethod(function))

    return declare


@dataclass(frozen=True)
class DeclaredFunction(CheckedFunction):
    """A function that is called as a method declares it.

    Attributes:
        declared: the function with its signature and docstring, which does nothing.
        otherwise: the argument that is the result where no drive has internal states.
    """

    declared: Callable[..., Any]
    otherwise: str

    @classmethod
    def of(cls, raw: RawKernel, name: str) -> DeclaredFunction:
        """Return the function of a method of that name, which the kernel may have been built without."""
        declared, otherwise = DECLARED[name]
        code, axes = declared.__code__, axes_of_parts(raw, function_of(raw, name))
        labels = code.co_varnames[1 : code.co_argcount + code.co_kwonlyargcount]
        return cls(name, labels, code.co_argcount - 1, axes, declared, otherwise)

    def __call__(self, calls: Calls, /, *args: Any, **options: Any) -> Any:
        """Call it with a kernel's ``Calls``, arrays and options; TypeError of a wrong call."""
        self.declared(calls, *args, **options)
        if self.otherwise and not calls.arrays.has_drives:
            return _argument(calls, self.otherwise, dict(zip(self.labels, args, strict=False)) | options)
        return super().__call__(calls, *args, **options)


class DeclaredFunctions(BoundFunctions):
    """Functions by their names; those that are declared as methods show what the methods show."""

    def called_in_python(self, name: str) -> CalledInPython:
        """Return the function of that name, which checks its arguments; UnknownNameError where there is none."""
        if name not in DECLARED:
            return super().called_in_python(name)
        called = CalledInPython(DeclaredFunction.of(self.calls.raw, name), self.calls)
        update_wrapper(called, MethodType(DECLARED[name][0], self.calls))
        return called


def _argument(calls: Calls, name: str, given: Mapping[str, Any]) -> Array:
    """Return an argument by coordinate as a function would that reads all that are given, which are checked."""
    calls.refuse_z(given.get(Z))
    lead: tuple[int, ...] = ()
    arrays = {}
    for label in (x for x in given if x not in (Z, OUT)):
        arrays[label], own = calls.array(label, given[label], (calls.n,))
        lead = joint_lead(label, own, lead)
    return calls.arrays.written(np.array(np.broadcast_to(arrays[name], (*lead, calls.n))), given.get(OUT))
