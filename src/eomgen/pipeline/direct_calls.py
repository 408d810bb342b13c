"""The extension module that calls from Python go through: made once for all robots, while the first one is derived.

Nothing of a build depends on it: where it cannot be had, kernels are called through cffi alone.
"""

from __future__ import annotations

import threading
import weakref
from concurrent.futures import Future
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING

from ..errors import BuildError
from ..progress import StageReport, no_report
from ..runtime.direct import NAME, BoundFunctions, ExtensionBinding
from . import cache as store
from .load import load_module

if TYPE_CHECKING:
    from ..codegen.package.running import Compiler

KIND = "extensions"


class LateBinding(ExtensionBinding):
    """The extension module that calls go through, for kernels that are made before it and after it."""

    def __init__(self) -> None:
        super().__init__()
        self._is_expected, self._lock = True, threading.Lock()
        self._waiting: weakref.WeakSet[BoundFunctions] = weakref.WeakSet()

    def take(self, functions: BoundFunctions) -> None:
        """Bind the functions of a kernel to the module, now or when it comes."""
        with self._lock:
            if self._is_expected:
                self._waiting.add(functions)
                return
        super().take(functions)

    def settle(self, module: ModuleType | None) -> None:
        """Bind all functions that wait; without a module they stay as they are."""
        with self._lock:
            self.module, self._is_expected = module, False
            waiting, self._waiting = list(self._waiting), weakref.WeakSet()
        for functions in waiting:
            super().take(functions)


class Extension:
    """The module of this process: nobody waits for it before a first kernel has been built.

    Attributes:
        binding: binds kernels to the module.
    """

    def __init__(self) -> None:
        self.binding, self._guard = LateBinding(), threading.Lock()
        self._compiler: Compiler | None = None
        self._begun: Future[store.Entry | None] | None = None
        self._is_settled = False

    def begin(self, compiler: Compiler) -> ExtensionBinding:
        """Load the module where the cache has it; where not, begin to compile it beside what comes next."""
        from ..threads import begin_in_thread

        with self._guard:
            if self._compiler is not None:
                return self.binding
            self._compiler = compiler
            key = _key(compiler)
            if key is not None and store.find(KIND, key) is None:
                self._begun = begin_in_thread(partial(made_by, compiler))
                return self.binding
        self.settle()
        return self.binding

    def settle(self, progress: StageReport = no_report) -> None:
        """Wait for the module and bind the kernels that were made before it, or say why there is none."""
        with self._guard:
            if self._is_settled or self._compiler is None:
                return
            module: ModuleType | None = None
            try:
                made = made_by(self._compiler) if self._begun is None else self._begun.result()
                module = None if made is None else load_module(made, NAME.removeprefix("_"))
            except BuildError as error:
                progress(f"kernels are called through cffi alone: {error}")
            self._is_settled = True
        self.binding.settle(module)


EXTENSION = Extension()


def begin(compiler: Compiler | None = None) -> ExtensionBinding:
    """Return the binding of the kernels of this process; see ``Extension``.

    Args:
        compiler: that of the environment if None.
    """
    from ..codegen.package.compile import find_compiler

    try:
        return EXTENSION.begin(compiler or find_compiler())
    except BuildError:  # without a compiler, or a cache
        return ExtensionBinding()


def settle(progress: StageReport = no_report) -> None:
    """Bind the kernels of this process to the module, as soon as it is made."""
    EXTENSION.settle(progress)


def made_by(compiler: Compiler) -> store.Entry | None:
    """Return the compiled module, made or from the cache; None where there are no headers.

    Raises:
        BuildError: the compiler fails, or the cache cannot be written.
    """
    from ..codegen.package.extension import write_extension

    key = _key(compiler)
    return None if key is None else store.entry(KIND, key, lambda folder: write_extension(compiler, folder))


def binary_of(compiler: Compiler) -> store.Files:
    """Return the compiled module as a file of a package's ``runtime``, by its name; nothing where it cannot be had."""
    try:
        made = made_by(compiler)
    except BuildError:
        made = None
    return {} if made is None else {name: data for name, data in made.files.items() if name.startswith(NAME)}


def _key(compiler: Compiler) -> str | None:
    from ..codegen.package.extension import extension_key

    return extension_key(compiler)
