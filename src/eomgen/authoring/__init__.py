"""Files that people write: checks of one, a new one to begin with, their JSON Schemas.

Uses runtime, robot and forms, the keys and readers of description, scenario and sweep, and codegen (tree) on floats.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .check import check_file as check_file
    from .new import write_new_file as write_new_file
    from .schema_files import schema_path as schema_path
    from .schemas import schema_text as schema_text
else:  # or type checkers would take every name to be there; a new file waits for no reader and no schema
    __getattr__, __dir__, __all__ = attributes(
        __name__, "check: check_file", "new: write_new_file", "schema_files: schema_path", "schemas: schema_text"
    )
