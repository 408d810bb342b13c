"""Checks, templates and JSON Schemas of the files that users write.

Uses runtime, robot, motion and forms, the keys and readers of description, scenario and sweep, the names of tolerances
of identification, models of pipeline, and codegen (tree) on floats.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from .check import check_file as check_file
    from .dh import dh_file_text as dh_file_text
    from .dh import robot_from_dh as robot_from_dh
    from .new import write_dh_file as write_dh_file
    from .new import write_new_file as write_new_file
    from .new import write_plan_file as write_plan_file
    from .new import write_poses_file as write_poses_file
    from .new import write_tolerances_file as write_tolerances_file
    from .schema_files import schema_path as schema_path
    from .schemas import schema_text as schema_text
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
