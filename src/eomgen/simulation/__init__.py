"""Robot and Scenario -> SimulationResult: programs, drives, loads, segments, energy balance, files of results.

Uses runtime, robot, forms, description, state, motion, integration, scenario and pipeline.
"""

from .balance import EnergyBalance
from .result import Series, SimulationResult, load_result
from .run import run_scenario, simulate
from .stream import StreamedMotion, load_stream

__all__ = [
    "EnergyBalance",
    "Series",
    "SimulationResult",
    "StreamedMotion",
    "load_result",
    "load_stream",
    "run_scenario",
    "simulate",
]
