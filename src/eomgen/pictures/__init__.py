"""Figures, pages and views of robots and results.

Uses kernel, robot, results, forms, bending, description, state, codegen (joint, kernels, package), templates,
pipeline, simulation, analysis, sweep and identification.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from .analysis import plot_budget as plot_budget
    from .analysis import plot_compliance as plot_compliance
    from .analysis import plot_mode_shapes as plot_mode_shapes
    from .analysis import plot_response as plot_response
    from .analysis import plot_stress_resultants as plot_stress_resultants
    from .analysis import plot_tracks as plot_tracks
    from .browser import View as View
    from .energy import plot_energy as plot_energy
    from .energy import plot_tracking as plot_tracking
    from .journals import plot_journals as plot_journals
    from .measured.accuracy import plot_accuracy as plot_accuracy
    from .measured.calibration import plot_calibration as plot_calibration
    from .measured.choosing import plot_poses as plot_poses
    from .measured.compensation import plot_compensation as plot_compensation
    from .measured.excitation import plot_excitation as plot_excitation
    from .measured.motions import plot_fit as plot_fit
    from .measured.motions import plot_identification as plot_identification
    from .measured.tolerances import plot_tolerance as plot_tolerance
    from .page import report_of as report_of
    from .report import Report as Report
    from .robot import plot_robot as plot_robot
    from .simulation import plot_deviations as plot_deviations
    from .simulation import plot_result as plot_result
    from .simulation import plot_series as plot_series
    from .simulation import plot_states as plot_states
    from .simulation import plot_tool as plot_tool
    from .sweep import plot_column as plot_column
    from .sweep import plot_sweep as plot_sweep
    from .zeros import plot_zeros as plot_zeros
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
