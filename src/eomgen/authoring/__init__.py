"""Files that people write: checks of one, a new one to begin with, their JSON Schemas.

Uses runtime, robot and forms, the keys and readers of description, scenario and sweep, and codegen (tree) on floats.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .check import check_file
    from .new import write_new_file
    from .schema_files import schema_path
    from .schemas import schema_text

__all__ = ["check_file", "schema_path", "schema_text", "write_new_file"]

_MODULES = {  # a new file waits neither for readers nor for the keys of schemas
    "check_file": "check",
    "schema_path": "schema_files",
    "schema_text": "schemas",
    "write_new_file": "new",
}


if not TYPE_CHECKING:  # or type checkers would take every name to be there
    __getattr__ = attributes(__name__, _MODULES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
