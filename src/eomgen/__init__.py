"""From a robot's description to compiled equations of motion.

import eomgen
robot = eomgen.load_robot("puma560_elastic")
kernel = eomgen.build(robot)
kernel.mass_matrix(q)

Names are imported from their rooms when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ._version import __version__
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

if TYPE_CHECKING:
    from .description import builtin_robots, load_robot
    from .export import export_fmu, export_mjcf
    from .pipeline import build, generate
    from .robot import Coordinate, Frame, Joint, Link, Loop, Motor, Placement, Robot, Spring
    from .runtime import Kernel
    from .scenario import Scenario, load_scenario
    from .simulation import SimulationResult, load_result, load_stream, run_scenario, simulate

_ROOM_OF = {
    **dict.fromkeys(("builtin_robots", "load_robot"), "description"),
    **dict.fromkeys(("export_fmu", "export_mjcf"), "export"),
    **dict.fromkeys(("build", "generate"), "pipeline"),
    **dict.fromkeys(("Coordinate", "Frame", "Joint", "Link", "Loop", "Motor", "Placement", "Robot", "Spring"), "robot"),
    "Kernel": "runtime",
    **dict.fromkeys(("Scenario", "load_scenario"), "scenario"),
    **dict.fromkeys(("SimulationResult", "load_result", "load_stream", "run_scenario", "simulate"), "simulation"),
}

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
    "Scenario",
    "SimulationResult",
    "SingularError",
    "Spring",
    "UnknownNameError",
    "__version__",
    "build",
    "builtin_robots",
    "export_fmu",
    "export_mjcf",
    "generate",
    "load_result",
    "load_robot",
    "load_scenario",
    "load_stream",
    "run_scenario",
    "simulate",
]


def __getattr__(name: str) -> Any:
    if name not in _ROOM_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_ROOM_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
