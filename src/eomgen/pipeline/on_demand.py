"""Kernels that are compiled when they are first asked for, each in a separate library."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..codegen.kernels.signatures import BATCHES, SINGLES
from ..errors import UnknownNameError
from ..progress import StageReport, no_report, told_at_prompt
from ..runtime.raw import BATCH, DERIVED, SETUP, Libraries, Library
from . import cache as store
from .direct_calls import settle
from .load import loaded, one_library
from .stages import Described, Tools, make_package, rendered

Names = tuple[str, ...]


class Operations(Mapping[str, Mapping[str, int]]):
    """Operations of the C of kernels, and of "parameters", by kind of operation."""

    def __init__(self, libraries: Libraries) -> None:
        self._libraries = libraries

    def __getitem__(self, kernel: str) -> Mapping[str, int]:
        if kernel not in self:
            raise KeyError(kernel)
        counts: Mapping[str, int] = self._libraries.about(kernel)["operations"][kernel]
        return dict(counts)

    def __contains__(self, kernel: object) -> bool:
        return kernel == SETUP or kernel in self._libraries.meta["kernels"]

    def __iter__(self) -> Iterator[str]:
        """Iterate over all but derivatives, of which there are many, and which would have to be derived."""
        functions = self._libraries.meta["functions"]
        derived = {name for name, entry in functions.items() if entry["kind"] in DERIVED}
        return iter((*(name for name in self._libraries.meta["kernels"] if name not in derived), SETUP))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __repr__(self) -> str:
        return f"<operations of {', '.join(self)}>"


@dataclass
class OnDemand(Libraries):
    """Libraries of a robot's kernels: each is made, or taken from the cache, when it is first asked for.

    A kernel has two: one with its functions for one state, and one with those for batches.  Two threads that ask for
    the same wait for one build, those that ask for two build side by side.

    Attributes:
        meta: what users see of the kernels.
        described: the robot.
        tools: that its kernels are compiled with.
        progress: called with a line of text when a stage begins; without one a terminal sees which kernel is built.
        groups: by the name of a half, kernels whose halves are in one library.
    """

    meta: Mapping[str, Any]
    described: Described
    tools: Tools
    progress: StageReport = no_report
    groups: Mapping[str, Names] = field(default_factory=dict)
    _found: dict[tuple[Names, str], Library] = field(default_factory=dict)
    _locks: dict[tuple[Names, str], threading.Lock] = field(default_factory=dict)

    @property
    def operations(self) -> Mapping[str, Mapping[str, int]]:
        """Operations of the C of kernels, which are counted when they are looked up."""
        return Operations(self)

    def library(self, kernel: str, function: str = "") -> Library:
        """Return the library with a function of C of a kernel; without a name with those for one state.

        Raises:
            BuildError: it does not compile, or computes something else than the equations.
        """
        what = f"{kernel} for batches" if function.endswith(BATCH) else kernel
        with told_at_prompt(f"building {what} of {self._name}", self._report(what)) as report:
            return self._library(kernel, function, report)

    def _library(self, kernel: str, function: str, report: StageReport) -> Library:
        half = self._half(kernel, function, report)
        place = self._names(kernel, half), half
        with self._locks.setdefault(place, threading.Lock()):
            if place not in self._found:
                package = self._package(*place, report)
                self._found[place] = Library(*loaded(package, self._name))
                settle(self.progress)
            return self._found[place]

    def _package(self, kernels: Names, half: str, report: StageReport) -> store.Entry:
        return make_package(self.described.of(kernels), self.tools, half, report)

    def _half(self, kernel: str, function: str, report: StageReport) -> str:
        """Return the half of a kernel's code that has a function; batches that are loops are in that of one state."""
        if not function.endswith(BATCH):
            return SINGLES
        halves: Mapping[str, Names] = self._meta(kernel, report)["halves"]
        return next(half for half, names in halves.items() if function in names)

    def _names(self, kernel: str, half: str) -> Names:
        """Return kernels that are in one library with a half of this one."""
        group = self.groups.get(half, ())
        return group if kernel in group else (kernel,)

    def about(self, kernel: str) -> Mapping[str, Any]:
        """Return the metadata of the C of a kernel; it is derived for that, but not compiled."""
        return self._meta(kernel, no_report)

    def _meta(self, kernel: str, report: StageReport) -> Mapping[str, Any]:
        if kernel == SETUP:
            return self._read((), report)
        places = [(self._names(kernel, half), half) for half in (SINGLES, BATCHES)]
        metas = [self._found[place].meta for place in places if place in self._found]
        return metas[0] if metas else self._read(places[1][0], report)

    def _read(self, kernels: Names, report: StageReport) -> Mapping[str, Any]:
        meta: dict[str, Any] = json.loads(rendered(self.described.of(kernels), report).source.meta)
        return meta

    def source(self, file: str) -> str:
        """Return the text of NAME.h, NAME.c, NAME_batch.c or NAME.json with all kernels but derivatives."""
        source = rendered(self.described.of(()), self.progress).source
        return {**source.files, f"{self._name}.json": source.meta}[file]

    def together(self, kernels: Names) -> Libraries:
        """Return these kernels in one library.

        Raises:
            UnknownNameError: the robot has no such kernel.
            BuildError: see ``library``.
        """
        for name in kernels:
            if name not in self.meta["kernels"]:
                known = ", ".join(self.meta["kernels"])
                raise UnknownNameError(f"{name!r} is no kernel of {self._name}; known: {known}")
        return one_library(self._package(kernels, "", self.progress), self._name)

    @property
    def _name(self) -> str:
        return str(self.meta["name"])

    def _report(self, what: str) -> StageReport:
        """Give a function that tells of a build: the caller's, or one that writes a line to a terminal."""
        if self.progress is not no_report or not sys.stderr.isatty():
            return self.progress
        told: list[str] = []

        def tell(_: str) -> None:
            if not told:
                told.append(what)
                print(f"eomgen: building {what} of {self._name}", file=sys.stderr, flush=True)

        return tell
