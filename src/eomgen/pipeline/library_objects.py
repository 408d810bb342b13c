"""The C library's objects: compiled once for all robots, beside the first derivation, and kept in the cache."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from . import cache as store

if TYPE_CHECKING:
    from ..codegen.package.compile import Linked
    from ..codegen.package.running import Compiler

KIND = "libraries"


@dataclass
class LibraryObjects:
    """Objects that the halves of a robot's code are linked with, made in a thread beside other work.

    Attributes:
        compiler, flags: those of the kernels that are linked with them.
        dtype: "float64" or "float32".
        parts: names of objects by half, see ``signatures.library_objects``.
    """

    compiler: Compiler
    flags: tuple[str, ...]
    dtype: str
    parts: Mapping[str, Sequence[str]]
    _begun: Future[list[bytes]] | None = field(default=None, init=False)

    def begin(self) -> Future[list[bytes]]:
        """Begin to make the objects that the cache lacks, once; the result raises BuildError where that fails."""
        from ..threads import begin_in_thread

        if self._begun is None:
            self._begun = begin_in_thread(self._made)
        return self._begun

    def linked(self) -> Linked:
        """Return what the code is linked with, and begin to make it."""
        from ..codegen.package.compile import Linked

        return Linked([half for half, names in self.parts.items() if names], self.begin().result)

    def _made(self) -> list[bytes]:
        return [self._object(name) for name in sorted({name for names in self.parts.values() for name in names})]

    def _object(self, name: str) -> bytes:
        """Return the content of an object, from the cache or made."""
        from ..codegen.package.library import OBJECT, library_key

        key = library_key(self.compiler, self.flags, self.dtype, name)
        return store.entry(KIND, key, lambda folder: self._make(name, folder)).files[OBJECT]

    def _make(self, name: str, folder: Path) -> None:
        from ..codegen.c.library import FOLDER
        from ..codegen.package.library import write_library

        write_library(self.compiler, self.flags, self.dtype, name, folder)
        shutil.rmtree(folder / FOLDER)
