"""Robot and Scenario -> SimulationResult: programs, drives, loads, segments, energy balance, files of results.

Uses runtime, robot, description, state, motion, integration, scenario and pipeline.
"""

from .result import SimulationResult, load_result
from .run import run_scenario, simulate
from .stream import load_stream

__all__ = ["SimulationResult", "load_result", "load_stream", "run_scenario", "simulate"]
