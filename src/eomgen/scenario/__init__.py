"""TOML -> Scenario: a simulation as a value that names no kernel.

Uses robot, forms, description, motion, and the names of kernel's integration methods.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from .load import load_scenario as load_scenario
    from .load import scenario_from_toml as scenario_from_toml
    from .value import Scenario as Scenario
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
