"""Motions of coordinates and tools over time: from point to point, splines, tables, tool paths, poses, measured files.

Uses runtime, robot, forms, state and loops.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .ends import default_motion, principal_limits
    from .files import MeasuredMotion, motion_from_columns, read_motion
    from .point_to_point import Harmonic, PointToPoint, Program
    from .poses import inverse_kinematics
    from .splines import Spline, Standstill
    from .timetable import TimeTable
    from .tool_path import ToolCircle, ToolLine, ToolPath, ToolSpline

__all__ = [
    "Harmonic",
    "MeasuredMotion",
    "PointToPoint",
    "Program",
    "Spline",
    "Standstill",
    "TimeTable",
    "ToolCircle",
    "ToolLine",
    "ToolPath",
    "ToolSpline",
    "default_motion",
    "inverse_kinematics",
    "motion_from_columns",
    "principal_limits",
    "read_motion",
]

_MODULES = {
    **dict.fromkeys(("default_motion", "principal_limits"), "ends"),
    **dict.fromkeys(("MeasuredMotion", "motion_from_columns", "read_motion"), "files"),
    **dict.fromkeys(("Harmonic", "PointToPoint", "Program"), "point_to_point"),
    "inverse_kinematics": "poses",
    **dict.fromkeys(("Spline", "Standstill"), "splines"),
    "TimeTable": "timetable",
    **dict.fromkeys(("ToolCircle", "ToolLine", "ToolPath", "ToolSpline"), "tool_path"),
}


if not TYPE_CHECKING:  # or type checkers would take every name to be there
    __getattr__ = attributes(__name__, _MODULES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
