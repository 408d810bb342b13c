"""From a robot's description to compiled equations of motion.

import eomgen
robot = eomgen.load_robot("puma560_elastic")
kernel = eomgen.build(robot)
kernel.mass_matrix(q)
"""

from __future__ import annotations

from ._version import __version__
from .description import builtin_robots, load_robot
from .errors import (
    ArrayError,
    BuildError,
    DescriptionError,
    EomgenError,
    InputError,
    IntegrationError,
    InternalError,
    LoopError,
    SingularError,
    UnknownNameError,
)
from .fmu import export_fmu
from .kernel import Kernel
from .mjcf_export import export_mjcf
from .pipeline import build, generate
from .result_file import load_result
from .robot import Coordinate, Frame, Joint, Link, Loop, Motor, Placement, Robot
from .stream import load_stream

__all__ = [
    "ArrayError",
    "BuildError",
    "Coordinate",
    "DescriptionError",
    "EomgenError",
    "Frame",
    "InputError",
    "IntegrationError",
    "InternalError",
    "Joint",
    "Kernel",
    "Link",
    "Loop",
    "LoopError",
    "Motor",
    "Placement",
    "Robot",
    "SingularError",
    "UnknownNameError",
    "__version__",
    "build",
    "builtin_robots",
    "export_fmu",
    "export_mjcf",
    "generate",
    "load_result",
    "load_robot",
    "load_stream",
]
