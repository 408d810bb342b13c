"""Text -> Robot: TOML, URDF and MJCF, each read into a Draft that is checked once.

Uses robot and forms.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .builtin import builtin_robots
    from .load import RobotLike, as_robot, load_robot, robot_from_toml

__all__ = ["RobotLike", "as_robot", "builtin_robots", "load_robot", "robot_from_toml"]

_MODULES = {
    "RobotLike": "load",
    "as_robot": "load",
    "builtin_robots": "builtin",
    "load_robot": "load",
    "robot_from_toml": "load",
}


if not TYPE_CHECKING:  # or type checkers would take every name to be there
    __getattr__ = attributes(__name__, _MODULES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
