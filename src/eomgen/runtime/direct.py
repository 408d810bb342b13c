"""Functions of kernels through the extension module ``_direct``: plain calls go from methods to the C at once.

``direct.c`` beside this file is its source, with its headers, and says which calls are plain; all others go to the
functions in Python.  A generated package carries a copy of this file, of its source, and of the module where it could
be compiled.
"""

from __future__ import annotations

import importlib
import itertools
from collections.abc import Callable
from functools import partial
from types import ModuleType
from typing import Any

from .arrays import axes_with_states
from .bound import CalledInPython, CheckedFunction, function_of
from .calls import TREE, Calls
from .chunking import states_at_once
from .parameters import State
from .raw import Array, Library, RawKernel

NAME = "_direct"


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

    def bound(self, checked: CheckedFunction, called: Callable[..., Any], state: State) -> Callable[..., Any]:
        """Return a function of a kernel with that state: plain calls go to the C, all others to ``called``."""
        function = self._made.get(checked.name)
        if function is None:
            if len(self._raw.functions[checked.name].reads) > self.module.ARRAYS:
                return called
            function = self._made.setdefault(checked.name, self._function(checked))
        bound: Callable[..., Any] = self.module.bind(function, called, state)
        return bound

    def _function(self, checked: CheckedFunction) -> Any:
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

    def _role(self, label: str, checked: CheckedFunction, has_loops: bool) -> tuple[str, tuple[int, ...]]:
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
        called = self.called_in_python(name)
        bound: Callable[..., Array] = called
        if self.direct is not None and self.is_direct and name in self.calls.raw.functions:
            bound = self.direct.bound(called.checked, called, self.calls.parameters.state)
        setattr(self, name, bound)
        return bound

    def called_in_python(self, name: str) -> CalledInPython:
        """Return the function of that name, which checks its arguments; errors as of ``CheckedFunction.of``."""
        return CalledInPython(CheckedFunction.of(self.calls.raw, name), self.calls)

    def __getitem__(self, name: str) -> Callable[..., Array]:
        bound: Callable[..., Array] = getattr(self, name)
        return bound

    def has(self, name: str) -> bool:
        """Whether there is a function of that name, which may be there for the open tree alone."""
        return function_of(self.calls.raw, name) is not None

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
        for name in vars(self).keys() & self.calls.raw.functions.keys():
            delattr(self, name)


class ExtensionBinding:
    """The extension module that kernels' calls go through; ``module`` is None where none can be had."""

    def __init__(self, module: ModuleType | None = None) -> None:
        self.module = module

    def take(self, functions: BoundFunctions) -> None:
        """Bind the functions of a kernel to the module."""
        if self.module is not None:
            functions.bind(self.module)


def packaged() -> ExtensionBinding:
    """Return the binding of the generated package that carries this file: to the module beside it, if that loads."""
    try:
        return ExtensionBinding(importlib.import_module(f".{NAME}", __package__))
    except (ImportError, RuntimeError):  # not compiled, or for another Python, NumPy or system
        return ExtensionBinding()
