"""Robot and Scenario -> SimulationResult: reference motions, actuators, loads, energy.

Uses runtime, kernel, robot, results, forms, description, state, loops, motion, integration, scenario, codegen (kernels)
and pipeline; feedforward uses control.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from .balance import EnergyBalance as EnergyBalance
    from .result import Series as Series
    from .result import SimulationResult as SimulationResult
    from .result import load_result as load_result
    from .run import run_scenario as run_scenario
    from .run import simulate as simulate
    from .stream import StreamedMotion as StreamedMotion
    from .stream import load_stream as load_stream
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
