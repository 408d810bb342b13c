"""Text -> Scenario: a simulation as a value that names no kernel.

Uses robot, forms, description, motion, and the names of integration's methods.
"""

from ..lazily import imports_when_used

with imports_when_used(globals()):
    from .load import load_scenario as load_scenario
    from .load import scenario_from_toml as scenario_from_toml
    from .value import Scenario as Scenario
