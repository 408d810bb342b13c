"""Text -> Scenario: a simulation as a value that names no kernel.

Uses robot, forms, description, motion, and the names of integration's methods.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .load import load_scenario as load_scenario
    from .load import scenario_from_toml as scenario_from_toml
    from .value import Scenario as Scenario
else:  # or type checkers would take every name to be there
    __getattr__, __dir__, __all__ = attributes(__name__, "load: load_scenario scenario_from_toml", "value: Scenario")
