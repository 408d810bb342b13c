"""Many simulations of a robot whose numbers vary: plans, samples, workers, stores, results.

Uses runtime, robot, forms, description, state, integration, motion, scenario, pipeline and simulation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .driver import run as run
    from .plan import Plan as Plan
    from .plan import load_plan as load_plan
    from .plan import plan_from_toml as plan_from_toml
    from .result import Sensitivity as Sensitivity
    from .result import SweepResult as SweepResult
else:  # or type checkers would take every name to be there
    __getattr__, __dir__, __all__ = attributes(
        __name__, "driver: run", "plan: Plan load_plan plan_from_toml", "result: Sensitivity SweepResult"
    )
