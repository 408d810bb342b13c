"""The C library's objects: compiled once for all robots, beside the first derivation, and kept in the cache."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from . import cache as store

if TYPE_CHECKING:
    from ..codegen.c.source import Source
    from ..codegen.package.compile import Compiler, Linked

KIND = "libraries"


@dataclass(frozen=True)
class Libraries:
    """Parts of the library as a compiler and its flags make them.

    Attributes:
        compiler, flags: those of the kernels that are linked with them.
        dtype: "float64" or "float32".
    """

    compiler: Compiler
    flags: tuple[str, ...]
    dtype: str

    def begin(self, parts: Sequence[str]) -> Callable[[], list[bytes]]:
        """Begin to compile what the cache does not have, each component in a thread.

        Returns:
            A function that waits for the objects and returns their content; it raises BuildError where the compiler
            fails.
        """
        from ..codegen.package.running import begin_in_thread

        begun = {part: begin_in_thread(partial(self._made, part)) for part in self._missing(parts)}
        return lambda: [begun[part].result() if part in begun else self._made(part) for part in parts]

    def begin_for(self, source: Source) -> Linked:
        """Begin with the components that a source is linked with."""
        from ..codegen.c.library import parts_of
        from ..codegen.package.compile import Linked

        kernels = json.loads(source.meta)["kernels"]
        parts = {half: parts_of(kernels, half) for half in ([source.half] if source.half else source.cdefs)}
        halves = [half for half, members in parts.items() if members]
        return Linked(halves, self.begin(sorted({component for members in parts.values() for component in members})))

    def _missing(self, parts: Sequence[str]) -> list[str]:
        return [component for component in parts if store.find(KIND, self._key(component)) is None]

    def _key(self, component: str) -> str:
        from ..codegen.package.library import library_key

        return library_key(self.compiler, self.flags, self.dtype, component)

    def _made(self, component: str) -> bytes:
        """Return the object of a component, made or from the cache."""
        from ..codegen.package.library import OBJECT

        key = self._key(component)
        return store.entry(KIND, key, lambda folder: self._make(component, folder)).files[OBJECT]

    def _make(self, component: str, folder: Path) -> None:
        from ..codegen.c.library import FOLDER
        from ..codegen.package.library import write_library

        write_library(self.compiler, self.flags, self.dtype, component, folder)
        shutil.rmtree(folder / FOLDER)
