"""Figures, pages and views of robots and results.

Uses runtime, robot, forms, description, codegen (joint), templates, pipeline, simulation, analysis and sweep.
"""

from .analysis import plot_budget, plot_compliance, plot_response, plot_tracks
from .browser import View
from .energy import plot_energy, plot_tracking
from .page import Report, report_of
from .robot import plot_robot
from .simulation import plot_deviations, plot_result, plot_tool
from .sweep import plot_sweep
from .zeros import plot_zeros

__all__ = [
    "Report",
    "View",
    "plot_budget",
    "plot_compliance",
    "plot_deviations",
    "plot_energy",
    "plot_response",
    "plot_result",
    "plot_robot",
    "plot_sweep",
    "plot_tool",
    "plot_tracking",
    "plot_tracks",
    "plot_zeros",
    "report_of",
]
