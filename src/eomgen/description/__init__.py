"""Text -> Robot: TOML, URDF and MJCF, each read into a Draft that is checked once.

Uses bending, robot and forms.
"""

from ..lazily import imports_when_used

with imports_when_used(globals()):
    from .builtin import builtin_robots as builtin_robots
    from .load import RobotLike as RobotLike
    from .load import as_robot as as_robot
    from .load import load_robot as load_robot
    from .load import robot_from_toml as robot_from_toml
