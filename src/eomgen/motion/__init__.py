"""Motions of coordinates and tools over time: from point to point, splines, tables, tool paths, poses, measured files.

Uses runtime, robot, forms, state and loops.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .ends import default_motion as default_motion
    from .ends import principal_limits as principal_limits
    from .files import MeasuredMotion as MeasuredMotion
    from .files import motion_from_columns as motion_from_columns
    from .files import read_motion as read_motion
    from .point_to_point import Harmonic as Harmonic
    from .point_to_point import PointToPoint as PointToPoint
    from .point_to_point import Program as Program
    from .poses import inverse_kinematics as inverse_kinematics
    from .splines import Spline as Spline
    from .splines import Standstill as Standstill
    from .timetable import TimeTable as TimeTable
    from .tool_path import ToolCircle as ToolCircle
    from .tool_path import ToolLine as ToolLine
    from .tool_path import ToolPath as ToolPath
    from .tool_path import ToolSpline as ToolSpline
else:  # or type checkers would take every name to be there
    __getattr__, __dir__, __all__ = attributes(
        __name__,
        "ends: default_motion principal_limits",
        "files: MeasuredMotion motion_from_columns read_motion",
        "point_to_point: Harmonic PointToPoint Program",
        "poses: inverse_kinematics",
        "splines: Spline Standstill",
        "timetable: TimeTable",
        "tool_path: ToolCircle ToolLine ToolPath ToolSpline",
    )
