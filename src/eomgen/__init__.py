"""From a robot's description to compiled equations of motion.

import eomgen
kernel = eomgen.build("puma560_elastic")
kernel.mass_matrix(q)
eomgen.analysis.modes("puma560_elastic")

Names and rooms are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ._version import __version__
from .errors import (
    ArrayError,
    BuildError,
    DerivationError,
    DescriptionError,
    EomgenError,
    EomgenWarning,
    InputError,
    IntegrationError,
    IntegrationStopped,
    InternalError,
    LoopError,
    ReachError,
    SingularError,
    UnknownNameError,
)
from .lazily import attributes

if TYPE_CHECKING:
    from . import analysis as analysis
    from . import description as description
    from . import identification as identification
    from . import integration as integration
    from . import loops as loops
    from . import motion as motion
    from . import pictures as pictures
    from . import robot as robot
    from . import scenario as scenario
    from . import simulation as simulation
    from . import sweep as sweep
    from .description import builtin_robots, load_robot
    from .export import export_arrays, export_fmu, export_live, export_mjcf, export_wasm, export_wheel
    from .loading import load_result
    from .pipeline import build, generate
    from .robot import Coordinate, Frame, Joint, Link, Loop, Motor, Placement, Robot, Spring
    from .runtime import Kernel
    from .scenario import Scenario, load_scenario
    from .simulation import SimulationResult, load_stream, run_scenario, simulate

_ROOMS = (  # for what a user does with kernels and results; functions of theirs are called eomgen.analysis.modes, say
    "analysis",
    "description",
    "identification",
    "integration",
    "loops",
    "motion",
    "pictures",
    "robot",
    "scenario",
    "simulation",
    "sweep",
)
_ROOM_OF = {
    **dict.fromkeys(("builtin_robots", "load_robot"), "description"),
    **dict.fromkeys(
        ("export_arrays", "export_fmu", "export_live", "export_mjcf", "export_wasm", "export_wheel"), "export"
    ),
    **dict.fromkeys(("build", "generate"), "pipeline"),
    **dict.fromkeys(("Coordinate", "Frame", "Joint", "Link", "Loop", "Motor", "Placement", "Robot", "Spring"), "robot"),
    "Kernel": "runtime",
    **dict.fromkeys(("Scenario", "load_scenario"), "scenario"),
    **dict.fromkeys(("SimulationResult", "load_stream", "run_scenario", "simulate"), "simulation"),
    "load_result": "loading",
}

__all__ = [
    "ArrayError",
    "BuildError",
    "Coordinate",
    "DerivationError",
    "DescriptionError",
    "EomgenError",
    "EomgenWarning",
    "Frame",
    "InputError",
    "IntegrationError",
    "IntegrationStopped",
    "InternalError",
    "Joint",
    "Kernel",
    "Link",
    "Loop",
    "LoopError",
    "Motor",
    "Placement",
    "ReachError",
    "Robot",
    "Scenario",
    "SimulationResult",
    "SingularError",
    "Spring",
    "UnknownNameError",
    "__version__",
    "build",
    "builtin_robots",
    "export_arrays",
    "export_fmu",
    "export_live",
    "export_mjcf",
    "export_wasm",
    "export_wheel",
    "generate",
    "load_result",
    "load_robot",
    "load_scenario",
    "load_stream",
    "run_scenario",
    "simulate",
]


if not TYPE_CHECKING:  # or type checkers would take every name to be there
    __getattr__ = attributes(__name__, {**dict(zip(_ROOMS, _ROOMS, strict=True)), **_ROOM_OF})


def __dir__() -> list[str]:
    hidden = {"TYPE_CHECKING", "annotations", "attributes"}
    return sorted({*globals(), *__all__, *_ROOMS} - hidden)
