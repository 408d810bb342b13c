"""The rendered source of a kernel, and where the templates are; neither needs SymPy."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import jinja2


@dataclass(frozen=True)
class Source:
    """Texts to compile: ``header``, ``code``, ``cdef`` (the header's declarations, for cffi), ``meta`` for Python.

    ``statements`` is the length of the code in values.
    """

    name: str
    header: str
    code: str
    cdef: str
    meta: str
    statements: int


@cache
def environment() -> jinja2.Environment:
    """Jinja's environment with the templates; a name that a template is not given is an error."""
    return jinja2.Environment(
        loader=jinja2.PackageLoader("eomgen.templates", ""),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # C and Python, not HTML; every name in them is a checked identifier
    )
