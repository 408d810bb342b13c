"""Text -> Robot: TOML, URDF and MJCF, each read into a Draft that is checked once.

Uses robot and forms.
"""

from .load import RobotLike, as_robot, builtin_robots, load_robot, robot_from_toml

__all__ = ["RobotLike", "as_robot", "builtin_robots", "load_robot", "robot_from_toml"]
