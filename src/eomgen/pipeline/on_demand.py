"""Kernels that are compiled when they are first asked for, each in a library of its own."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ..errors import UnknownNameError
from ..progress import StageReport, no_report
from ..runtime.raw import SETUP, Library, OneLibrary
from . import cache as store
from .direct_calls import settle
from .load import load_module

if TYPE_CHECKING:
    from ..codegen.c.source import Source

Names = tuple[str, ...]


def one_library(package: store.Entry, name: str) -> OneLibrary:
    """The library of a package of the cache, whose texts are read as long as they are there; ``name`` is the robot's.

    Raises:
        BuildError: it does not load.
    """

    def read(file: str) -> str:
        found = store.find(package.kind, package.key)
        if found is None:
            raise FileNotFoundError(file)
        return found.files[file].decode("ascii")

    return OneLibrary(*_loaded(package, name), read)


def _loaded(package: store.Entry, name: str) -> tuple[Any, Any, dict[str, Any]]:
    """cffi's objects of a package's module, and its metadata."""
    module = load_module(package, name)
    return module.ffi, module.lib, json.loads(package.files[f"{name}.json"])


@dataclass
class OnDemand:
    """Libraries of a robot's kernels: each is made, or taken from the cache, when it is first asked for.

    Two threads that ask for one kernel wait for the same build, those that ask for two kernels build side by side.

    Attributes:
        meta: what users see of the kernels.
        package_of: gives the compiled package of kernels by their names, all if there are none, and tells its stages.
        source_of: the same for their C.
        progress: called with a line of text when a stage begins; without one a terminal sees which kernel is built.
    """

    meta: Mapping[str, Any]
    package_of: Callable[[Names, StageReport], store.Entry]
    source_of: Callable[[Names, StageReport], Source]
    progress: StageReport = no_report
    _found: dict[str, Library] = field(default_factory=dict)
    _locks: dict[str, threading.Lock] = field(default_factory=dict)

    def library(self, kernel: str) -> Library:
        """The library of one kernel.

        Raises:
            BuildError: it does not compile, or computes something else than the equations.
        """
        with self._locks.setdefault(kernel, threading.Lock()):
            if kernel not in self._found:
                package = self.package_of((kernel,), self._report(kernel))
                self._found[kernel] = Library(*_loaded(package, self._name))
                settle(self.progress)
            return self._found[kernel]

    def operations(self, kernel: str) -> Mapping[str, int]:
        """Operations of the C of a kernel; it is derived for that, but not compiled."""
        if kernel == SETUP:
            return self._counts((), SETUP)
        found = self._found.get(kernel)
        return dict(found.meta["operations"][kernel]) if found else self._counts((kernel,), kernel)

    def source(self, file: str) -> str:
        """Text of NAME.h, NAME.c or NAME.json with all kernels but tangents."""
        source = self.source_of((), self.progress)
        texts = {"h": source.header, "c": source.code, "json": source.meta}
        return texts[file.removeprefix(f"{self._name}.")]

    def together(self, kernels: Names) -> OneLibrary:
        """These kernels in one library.

        Raises:
            UnknownNameError: the robot has no such kernel.
            BuildError: see ``library``.
        """
        for name in kernels:
            if name not in self.meta["kernels"]:
                known = ", ".join(self.meta["kernels"])
                raise UnknownNameError(f"{name!r} is no kernel of {self._name}; known: {known}")
        return one_library(self.package_of(kernels, self.progress), self._name)

    @property
    def _name(self) -> str:
        return str(self.meta["name"])

    def _counts(self, kernels: Names, name: str) -> dict[str, int]:
        found: dict[str, int] = json.loads(self.source_of(kernels, no_report).meta)["operations"][name]
        return found

    def _report(self, kernel: str) -> StageReport:
        """Give a function that tells of a build: the caller's, or one that writes a line to a terminal."""
        if self.progress is not no_report or not sys.stderr.isatty():
            return self.progress
        told: list[str] = []

        def tell(_: str) -> None:
            if not told:
                told.append(kernel)
                print(f"eomgen: building {kernel} of {self._name}", file=sys.stderr, flush=True)

        return tell
