"""Many simulations of a robot whose numbers vary: plans, samples, workers, stores, results.

Uses runtime, robot, forms, description, state, integration, motion, scenario, pipeline and simulation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .driver import run
    from .plan import Plan, load_plan, plan_from_toml
    from .result import Sensitivity, SweepResult

__all__ = ["Plan", "Sensitivity", "SweepResult", "load_plan", "plan_from_toml", "run"]

_MODULES = {
    "Plan": "plan",
    "Sensitivity": "result",
    "SweepResult": "result",
    "load_plan": "plan",
    "plan_from_toml": "plan",
    "run": "driver",
}


if not TYPE_CHECKING:  # or type checkers would take every name to be there
    __getattr__ = attributes(__name__, _MODULES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
