"""From a robot's description to compiled equations of motion.

import eomgen
kernel = eomgen.build("puma560_elastic")
kernel.mass_matrix(q)
eomgen.analysis.modes("puma560_elastic")

Names and packages are imported when they are first used.
"""

from typing import TYPE_CHECKING

from .lazily import lazy_names

if TYPE_CHECKING:
    from . import analysis as analysis
    from . import control as control
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
    from ._version import __version__ as __version__
    from .description import builtin_robots as builtin_robots
    from .description import load_robot as load_robot
    from .errors import ArrayError as ArrayError
    from .errors import BuildError as BuildError
    from .errors import DescriptionError as DescriptionError
    from .errors import EomgenError as EomgenError
    from .errors import EomgenWarning as EomgenWarning
    from .errors import InputError as InputError
    from .errors import IntegrationError as IntegrationError
    from .errors import IntegrationStopped as IntegrationStopped
    from .errors import InternalError as InternalError
    from .errors import LoopError as LoopError
    from .errors import ReachError as ReachError
    from .errors import SingularError as SingularError
    from .errors import UnknownNameError as UnknownNameError
    from .export import export_arrays as export_arrays
    from .export import export_fmu as export_fmu
    from .export import export_live as export_live
    from .export import export_mjcf as export_mjcf
    from .export import export_simt as export_simt
    from .export import export_wasm as export_wasm
    from .export import export_wheel as export_wheel
    from .kernel import Kernel as Kernel
    from .loading import load_result as load_result
    from .pipeline import build as build
    from .pipeline import generate as generate
    from .precision import float32_advice as float32_advice
    from .precision import rounding_bound as rounding_bound
    from .robot import Coordinate as Coordinate
    from .robot import Frame as Frame
    from .robot import Joint as Joint
    from .robot import Link as Link
    from .robot import Loop as Loop
    from .robot import Motor as Motor
    from .robot import Placement as Placement
    from .robot import Robot as Robot
    from .robot import Spring as Spring
    from .scenario import Scenario as Scenario
    from .scenario import load_scenario as load_scenario
    from .simulation import SimulationResult as SimulationResult
    from .simulation import load_stream as load_stream
    from .simulation import run_scenario as run_scenario
    from .simulation import simulate as simulate
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
