"""Text -> Scenario: a simulation as a value that names no kernel.

Uses robot, forms, description, motion, and the names of integration's methods.
"""

from .load import load_scenario, scenario_from_toml
from .value import Scenario

__all__ = ["Scenario", "load_scenario", "scenario_from_toml"]
