"""Robot and Scenario -> SimulationResult: programs, drives, loads, segments, energy balance, files of results.

Uses runtime, robot, results, forms, description, state, loops, motion, integration, scenario and pipeline.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
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

_MODULES = {
    "EnergyBalance": "balance",
    "Series": "result",
    "SimulationResult": "result",
    "StreamedMotion": "stream",
    "load_result": "result",
    "load_stream": "stream",
    "run_scenario": "run",
    "simulate": "run",
}


if not TYPE_CHECKING:  # or type checkers would take every name to be there
    __getattr__ = attributes(__name__, _MODULES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
