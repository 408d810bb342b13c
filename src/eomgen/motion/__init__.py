"""Reference motions of coordinates and tools: splines, tables, tool paths, measured files.

Uses runtime, kernel, robot, forms, state and loops; ``feedforward`` is that of control.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from ..control.elastic_feedforward import feedforward as feedforward
    from .ends import default_motion as default_motion
    from .ends import principal_limits as principal_limits
    from .files import MeasuredMotion as MeasuredMotion
    from .files import motion_from_columns as motion_from_columns
    from .files import read_motion as read_motion
    from .files import write_motion as write_motion
    from .point_to_point import Harmonic as Harmonic
    from .point_to_point import PointToPoint as PointToPoint
    from .point_to_point import Program as Program
    from .poses import inverse_kinematics as inverse_kinematics
    from .splines import Spline as Spline
    from .splines import Standstill as Standstill
    from .time_derivatives import Jump as Jump
    from .time_derivatives import SmoothProgram as SmoothProgram
    from .time_derivatives import with_series as with_series
    from .timetable import TimeTable as TimeTable
    from .tool_path import ToolCircle as ToolCircle
    from .tool_path import ToolLine as ToolLine
    from .tool_path import ToolPath as ToolPath
    from .tool_path import ToolSpline as ToolSpline
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
