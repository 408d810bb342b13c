"""Readers of TOML, URDF and MJCF: each fills a Draft, which becomes a Robot.

Uses bending, robot and forms.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from .builtin import builtin_robots as builtin_robots
    from .load import RobotLike as RobotLike
    from .load import as_robot as as_robot
    from .load import load_robot as load_robot
    from .load import robot_from_toml as robot_from_toml
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
