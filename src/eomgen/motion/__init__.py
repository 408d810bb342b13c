"""Motions of coordinates and tools over time: from point to point, splines, tables, tool paths, measured files.

Uses runtime, robot and forms.
"""

from .ends import default_motion, principal_limits
from .files import MeasuredMotion, motion_from_columns, read_motion
from .point_to_point import Harmonic, PointToPoint, Program
from .splines import Spline, Standstill
from .timetable import TimeTable
from .tool_path import ToolCircle, ToolLine, ToolPath

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
    "default_motion",
    "motion_from_columns",
    "principal_limits",
    "read_motion",
]
