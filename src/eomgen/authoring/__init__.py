"""Files that people write: checks of one, a new one to begin with, their JSON Schemas.

Uses runtime, robot and forms, the keys and readers of description, scenario and sweep, and codegen (tree) on floats.
"""

from .check import check_file
from .new import write_new_file
from .schemas import schema_path, schema_text

__all__ = ["check_file", "schema_path", "schema_text", "write_new_file"]
