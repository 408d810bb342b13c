"""Methods of kernels through the extension module ``_direct``: plain calls go from Python to the C at once.

``direct.c`` beside this file is its source, with its headers, and says which calls are plain; all others go to the
methods in Python.  A generated package carries a copy of this file, of its source, and of the module where it could be
compiled.
"""

from __future__ import annotations

import importlib
import itertools
import threading
import weakref
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import FunctionType, ModuleType
from typing import Any, NamedTuple, Protocol

import numpy as np

from .chunking import states_at_once
from .raw import Array, Library, RawKernel, Setup

NAME = "_direct"
ROLES = {
    "frame": "frame",
    "out": "out",
    "wrench": "nothing",
    "z": "nothing",
    "cut": "cut",
}  # of parameters that are not read


class Added(NamedTuple):
    """Contribution of wrenches to a method's result.

    Attributes:
        function: of q and the wrenches, whose result is added.
        sign: 1 or -1.
        into: the argument that it is added to, with sign 1, where it is not the result.
    """

    function: str
    sign: float
    into: str = ""


WRENCHED: Mapping[str, Added] = {
    "generalized_force": Added("external_force", 1.0),
    "residual": Added("external_force", -1.0),
    "inverse_dynamics": Added("external_force", -1.0),
    "forward_dynamics": Added("external_force", 1.0, "u"),
    "reactions": Added("external_reactions", 1.0),
    "tree_inverse_dynamics": Added("external_force", -1.0),
    "tree_reactions": Added("external_reactions", 1.0),
    "reactions_under_load": Added("external_reactions", 1.0),
    "coupling_forces": Added("external_coupling_forces", 1.0),
}
DRIVING = ("inverse_dynamics", "reactions")  # where loops are closed, they call other functions for wrenches


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


class Bindable(Protocol):
    """A kernel whose methods can be bound to an extension module."""

    def bind(self, module: ModuleType) -> None:
        """Let plain calls go through the module."""


class ExtensionBinding:
    """The extension module that kernels' calls go through, for kernels that are made before it and after it.

    Attributes:
        module: it, or None while it is not there, or where none can be had.
    """

    def __init__(self, module: ModuleType | None = None, *, expected: bool = False) -> None:
        """Keep a module, or none; ``expected``: whether one is still to come."""
        self.module, self._expected, self._lock = module, expected, threading.Lock()
        self._waiting: weakref.WeakSet[Any] = weakref.WeakSet()

    def take(self, kernel: Bindable) -> None:
        """Bind a kernel to the module, now or when it comes."""
        if self.module is None and self._expected:
            with self._lock:
                if self.module is None and self._expected:
                    self._waiting.add(kernel)
                    return
        if self.module is not None:
            kernel.bind(self.module)

    def settle(self, module: ModuleType | None) -> None:
        """Bind all kernels that wait; without a module they stay as they are."""
        with self._lock:
            self.module, self._expected = module, False
            waiting, self._waiting = list(self._waiting), weakref.WeakSet()
        for kernel in waiting if module is not None else ():
            kernel.bind(module)


def packaged() -> ExtensionBinding:
    """Return the binding of the generated package that carries this file: to the module beside it, if that loads."""
    try:
        return ExtensionBinding(importlib.import_module(f".{NAME}", __package__))
    except (ImportError, RuntimeError):  # not compiled, or for another Python, NumPy or system
        return ExtensionBinding()


class DirectFunctions:
    """The module's ``Function`` of every method that calls the function of its name, for all kernels of a package.

    Each is armed with the address of its code for one state, and of that for many, after a first call of that kind,
    which may have compiled it.

    Attributes:
        module: the extension module.
        methods: the ``Function`` of each method.
    """

    def __init__(
        self,
        module: ModuleType,
        raw: RawKernel,
        methods: Mapping[str, FunctionType],
        frames: tuple[str, ...],
        prescribed: Sequence[int],
    ) -> None:
        """Make those of methods.

        Args:
            methods: of a kernel, by name; those that call no function are left out.
            frames: names of the frames by their numbers.
            prescribed: numbers of the coordinates whose motion is prescribed; to their drives wrenches add nothing.
        """
        self.module, self._raw = module, raw
        self._frames = {
            name: number for number, name in reversed(list(enumerate(frames)))
        }  # the first of a name counts
        self._prescribed = tuple(prescribed)
        self._arming = partial(_arm, raw, {}, itertools.count())
        self._jets: dict[str, Any] = {}
        self.methods = tuple(
            self._of_method(name, methods[name])
            for name in raw.libraries.meta["functions"]
            if name in methods and calls_its_function(raw, name)
        )

    def _of_method(self, name: str, method: FunctionType) -> Any:
        code, loops = method.__code__, bool(self._raw.libraries.meta.get("constraints"))
        parameters = code.co_varnames[1 : code.co_argcount + code.co_kwonlyargcount]
        entry = self._raw.libraries.meta["functions"][name]
        reads = tuple(entry["reads"])
        added = WRENCHED.get(name, Added("", 1.0))
        under_load = "" if loops and name in DRIVING else name
        return self.module.Function(
            name=name,
            method=method,
            arming=self._arming,
            dtype=self._raw.dtype,
            places=tuple(_place(label, reads, self._raw, under_load) for label in parameters),
            positional=code.co_argcount - 1,
            result=self._raw.shapes[entry["writes"]],
            in_parts=entry["writes"] == "derivatives",
            cut_must_be_false=loops and "cut" in parameters,
            frames=self._frames,
            added=(added.sign, reads.index(added.into), self._prescribed) if added.into else (added.sign, -1, ()),
        )

    def jet(self, name: str) -> Any:
        """Return the ``Function`` of time derivatives, which gives each order as an array; it reads arrays alone."""
        if name not in self._jets:
            function, raw = self._raw.functions[name], self._raw
            inner = len(raw.shapes[function.writes])

            def in_python(kernel: Any, *arrays: Any) -> tuple[Array, ...]:
                return tuple(np.moveaxis(kernel.calls.run(name, None, arrays), -inner, 0))

            self._jets[name] = self.module.Function(
                name=name,
                method=in_python,
                arming=self._arming,
                dtype=raw.dtype,
                places=tuple((label, "read", raw.shapes[label]) for label in function.reads),
                positional=len(function.reads),
                result=raw.shapes[function.writes],
                in_parts=True,
                cut_must_be_false=False,
                frames=self._frames,
                added=(1.0, -1, ()),
            )
        return self._jets[name]


def calls_its_function(raw: RawKernel, name: str) -> bool:
    """Return whether the method of that name calls the function of that name alone, if there is one."""
    several = name == "constraint_forces" and "followers" in raw.libraries.meta
    return name in raw.functions and not several


def _place(label: str, reads: tuple[str, ...], raw: RawKernel, name: str) -> tuple[str, str, tuple[int, ...]]:
    """Return the name, role and shape of a parameter of a method, as the module takes them."""
    role = "read" if label in reads else ROLES.get(label, "beside")
    added = WRENCHED.get(name) if label == "wrench" else None
    beside = added is not None and added.into and raw.libraries.meta.get("inputs")  # where forces stand elsewhere
    if added is not None and added.function in raw.functions and not beside:
        role = "wrench"
    return label, role, raw.shapes[label] if role in ("read", "beside", "wrench") else ()


def _arm(
    raw: RawKernel, libraries: dict[Library, int], new: itertools.count[int], function: Any, kind: str, many: bool
) -> None:
    """Tell a ``Function`` where its "main" code is, or that of wrenches, "added": for one state, or for many."""
    code = raw.functions[function.name if kind == "main" else WRENCHED[function.name].function]
    address, library, work = code.address(batch=many), code.where(batch=many), code.operations
    number = libraries[library] if library in libraries else libraries.setdefault(library, next(new))
    setup = library.address(library.setup)
    function.arm(kind, many, library, number, address, setup, library.hoisted, float(work), states_at_once(work))
