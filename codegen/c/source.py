"""The rendered source of a kernel, and where the templates are; neither needs SymPy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

from .library import library_files

if TYPE_CHECKING:
    import jinja2


@dataclass(frozen=True)
class Source:
    """Texts to compile: ``header``, ``code``, ``cdef`` (the header's declarations, for cffi), ``meta`` for Python.

    ``code`` is for one state at a time, ``batch_code`` for several; it is empty without functions for batches.
    ``statements`` is the length of the code in values, and ``longest`` that of its longest program.  ``cdefs`` are the
    declarations of each half of the code, and ``half`` is the one that is to be compiled, without a name both.
    """

    name: str
    header: str
    code: str
    batch_code: str
    cdef: str
    meta: str
    statements: int
    longest: int
    cdefs: Mapping[str, str]
    half: str = ""

    @property
    def files(self) -> dict[str, str]:
        """Header, code and the library that they include, by their places in one folder."""
        return {f"{self.name}.h": self.header, **self.codes, **library_files()}

    @property
    def codes(self) -> dict[str, str]:
        """The files to compile, by their names: the one for one state, and the one for several if there is one."""
        batch = {f"{self.name}_batch.c": self.batch_code} if self.batch_code else {}
        return {f"{self.name}.c": self.code, **batch}

    @property
    def halves(self) -> tuple[str, ...]:
        """Which halves of the code are to be compiled."""
        return (self.half,) if self.half else tuple(self.cdefs)

    def only(self, half: str) -> Source:
        """Return the source to compile one half alone: "singles" or "batches", or both without a name."""
        return replace(self, half=half, cdef=self.cdefs[half]) if half else self


@cache
def environment() -> jinja2.Environment:
    """Return Jinja's environment with the templates; a name that a context lacks is an error."""
    import jinja2  # a source from the cache needs none

    return jinja2.Environment(
        loader=jinja2.PackageLoader("eomgen.templates", ""),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # C and Python, not HTML; every name in them is a checked identifier
    )
