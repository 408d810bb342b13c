"""Robot and Scenario -> SimulationResult: reference motions, drives, loads, segments, energy balance, files of results.

Uses runtime, robot, results, forms, description, state, loops, motion, integration, scenario and pipeline.
"""

from ..lazily import imports_when_used

with imports_when_used(globals()):
    from .balance import EnergyBalance as EnergyBalance
    from .result import Series as Series
    from .result import SimulationResult as SimulationResult
    from .result import load_result as load_result
    from .run import run_scenario as run_scenario
    from .run import simulate as simulate
    from .stream import StreamedMotion as StreamedMotion
    from .stream import load_stream as load_stream
