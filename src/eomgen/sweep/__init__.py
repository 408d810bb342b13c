"""Many simulations of a robot whose numbers vary: plans, samples, workers, stores, results.

Uses runtime, robot, forms, description, state, integration, scenario, pipeline and simulation.
"""

from .driver import run
from .plan import Plan, load_plan, plan_from_toml
from .result import Sensitivity, SweepResult

__all__ = ["Plan", "Sensitivity", "SweepResult", "load_plan", "plan_from_toml", "run"]
