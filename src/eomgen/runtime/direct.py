"""Functions of kernels through the extension module ``_direct``: plain calls go from methods to the C at once.

``direct.c`` beside this file is its source, with its headers, and says which calls are plain; all others go to the
functions in Python.  A generated package carries a copy of this file, of its source, and of the module where it could
be compiled.
"""

from __future__ import annotations

import importlib
import itertools
import threading
import weakref
from collections.abc import Callable
from functools import partial
from types import ModuleType
from typing import Any, Protocol

from .arrays import axes_with_states
from .chunking import states_at_once
from .raw import Array, Library, RawKernel, Setup

NAME = "_direct"


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
    """Functions of a kernel that can be bound to an extension module: see ``methods.bound.BoundFunctions``."""

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

    def take(self, functions: Bindable) -> None:
        """Bind the functions of a kernel to the module, now or when it comes."""
        if self.module is None and self._expected:
            with self._lock:
                if self.module is None and self._expected:
                    self._waiting.add(functions)
                    return
        if self.module is not None:
            functions.bind(self.module)

    def settle(self, module: ModuleType | None) -> None:
        """Bind all functions that wait; without a module they stay as they are."""
        with self._lock:
            self.module, self._expected = module, False
            waiting, self._waiting = list(self._waiting), weakref.WeakSet()
        for functions in waiting if module is not None else ():
            functions.bind(module)


def packaged() -> ExtensionBinding:
    """Return the binding of the generated package that carries this file: to the module beside it, if that loads."""
    try:
        return ExtensionBinding(importlib.import_module(f".{NAME}", __package__))
    except (ImportError, RuntimeError):  # not compiled, or for another Python, NumPy or system
        return ExtensionBinding()


class Checked(Protocol):
    """A function that is called in Python: see ``methods.bound.CheckedFunction``."""

    @property
    def name(self) -> str:
        """Name of the function."""

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of its arguments, in their order."""

    @property
    def positional(self) -> int:
        """How many of them may be given without their names."""

    @property
    def axes(self) -> int:
        """Axes of each array of a result that is a tuple of arrays, beginning with theirs; 0 of one array."""


class DirectFunctions:
    """The module's ``Function`` of every function that methods call, for all kernels of a package.

    Each is armed with the address of its code for one state, and of that for many, after a first call of that kind,
    which may have compiled it.

    Attributes:
        module: the extension module.
    """

    def __init__(self, module: ModuleType, raw: RawKernel) -> None:
        """Make those of a package, none of them yet."""
        self.module, self._raw, meta = module, raw, raw.libraries.meta
        numbered = reversed(list(enumerate(meta["frames"])))  # the first of a name counts
        self._frames = {name: number for number, name in numbered}
        self._prescribed = tuple(meta["coordinates"].index(name) for name in meta["prescribed"])
        self._arming = partial(_arm, raw, {}, itertools.count())
        self._made: dict[str, Any] = {}

    def bound(self, checked: Checked, called: Callable[..., Any], state: State) -> Callable[..., Any]:
        """Return a function of a kernel with that state: plain calls go to the C, all others to ``called``."""
        function = self._made.get(checked.name)
        if function is None:
            if len(self._raw.functions[checked.name].reads) > self.module.ARRAYS:
                return called
            function = self._made.setdefault(checked.name, self._function(checked))
        bound: Callable[..., Any] = self.module.bind(function, called, state)
        return bound

    def _function(self, checked: Checked) -> Any:
        raw, function = self._raw, self._raw.functions[checked.name]
        has_loops = bool(raw.libraries.meta.get("constraints"))
        term, numbers = function.wrench, {x: i for i, x in enumerate(function.reads)}
        into = checked.labels.index(term.into) if term and term.into else -1
        labels = (*checked.labels, *(x for x in numbers if x not in checked.labels))  # behind all: forces beside drives
        return self.module.Function(
            name=checked.name,
            arming=self._arming,
            dtype=raw.dtype,
            places=tuple((x, *self._role(x, checked, has_loops), numbers.get(x, -1)) for x in labels),
            positional=checked.positional,
            result=raw.shapes[function.writes],
            states=(axes_with_states(function.writes), len(raw.libraries.meta.get("internal_states", ()))),
            in_parts=bool(checked.axes),
            cut_must_be_false=has_loops,
            frames=self._frames,
            added=(term.sign if term and into < 0 else 1.0, into, self._prescribed if into >= 0 else ()),
        )

    def _role(self, label: str, checked: Checked, has_loops: bool) -> tuple[str, tuple[int, ...]]:
        """Return the role of an argument and the shape of its array, as the module takes them."""
        function = self._raw.functions[checked.name]
        if label in function.reads:
            return "read" if label in checked.labels else "zeros", self._raw.shapes[label]
        if label in ("frame", "out", "cut"):
            return label, ()
        term, functions = function.wrench, self._raw.functions
        if label != "wrench" or term is None or term.function not in functions or (function.loaded and has_loops):
            return "nothing", ()
        if term.into and self._raw.libraries.meta.get("inputs"):  # where forces stand elsewhere
            return "nothing", ()
        return label, self._raw.shapes[label]


def _arm(
    raw: RawKernel, libraries: dict[Library, int], new: itertools.count[int], function: Any, kind: str, many: bool
) -> None:
    """Tell a ``Function`` where its "main" code is, or that of wrenches, "added": for one state, or for many."""
    code = raw.functions[function.name]
    if kind != "main":
        assert code.wrench is not None
        code = raw.functions[code.wrench.function]
    address, library, work = code.address(batch=many), code.where(batch=many), code.operations
    number = libraries[library] if library in libraries else libraries.setdefault(library, next(new))
    setup = library.address(library.setup)
    function.arm(kind, many, library, number, address, setup, library.hoisted, float(work), states_at_once(work))
