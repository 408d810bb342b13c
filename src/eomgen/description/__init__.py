"""Text -> Robot: TOML, URDF and MJCF, each read into a Draft that is checked once.

Uses robot and forms.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .builtin import builtin_robots as builtin_robots
    from .load import RobotLike as RobotLike
    from .load import as_robot as as_robot
    from .load import load_robot as load_robot
    from .load import robot_from_toml as robot_from_toml
else:  # or type checkers would take every name to be there
    __getattr__, __dir__, __all__ = attributes(
        __name__, "builtin: builtin_robots", "load: RobotLike as_robot load_robot robot_from_toml"
    )
