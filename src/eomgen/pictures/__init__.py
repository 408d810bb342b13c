"""Figures, pages and views of robots and results.

Uses runtime, robot, forms, description, state, codegen (joint), templates, pipeline, simulation, analysis,
sweep and identification.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .analysis import plot_budget, plot_compliance, plot_mode_shapes, plot_response, plot_tracks
    from .browser import View
    from .energy import plot_energy, plot_tracking
    from .journals import plot_journals
    from .measured.accuracy import plot_accuracy
    from .measured.calibration import plot_calibration
    from .measured.compensation import plot_compensation
    from .measured.excitation import plot_excitation
    from .measured.motions import plot_identification
    from .measured.tolerances import plot_tolerance
    from .page import report_of
    from .report import Report
    from .robot import plot_robot
    from .simulation import plot_deviations, plot_result, plot_tool
    from .sweep import plot_sweep
    from .zeros import plot_zeros

_MODULES = {  # one of them is imported when a name of it is first used: a figure of one thing waits for no other
    "plot_accuracy": "measured.accuracy",
    "plot_budget": "analysis",
    "plot_compliance": "analysis",
    "plot_mode_shapes": "analysis",
    "plot_response": "analysis",
    "plot_tracks": "analysis",
    "View": "browser",
    "plot_calibration": "measured.calibration",
    "plot_compensation": "measured.compensation",
    "plot_excitation": "measured.excitation",
    "plot_identification": "measured.motions",
    "plot_tolerance": "measured.tolerances",
    "plot_energy": "energy",
    "plot_tracking": "energy",
    "plot_journals": "journals",
    "Report": "report",
    "report_of": "page",
    "plot_robot": "robot",
    "plot_deviations": "simulation",
    "plot_result": "simulation",
    "plot_tool": "simulation",
    "plot_sweep": "sweep",
    "plot_zeros": "zeros",
}

__all__ = [
    "Report",
    "View",
    "plot_accuracy",
    "plot_budget",
    "plot_calibration",
    "plot_compensation",
    "plot_compliance",
    "plot_deviations",
    "plot_energy",
    "plot_excitation",
    "plot_identification",
    "plot_journals",
    "plot_mode_shapes",
    "plot_response",
    "plot_result",
    "plot_robot",
    "plot_sweep",
    "plot_tolerance",
    "plot_tool",
    "plot_tracking",
    "plot_tracks",
    "plot_zeros",
    "report_of",
]


if not TYPE_CHECKING:  # or type checkers would take every name to be there
    __getattr__ = attributes(__name__, _MODULES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
