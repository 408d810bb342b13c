"""Text -> Scenario: a simulation as a value that names no kernel.

Uses robot, forms, description, motion, and the names of integration's methods.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .load import load_scenario, scenario_from_toml
    from .value import Scenario

__all__ = ["Scenario", "load_scenario", "scenario_from_toml"]

_MODULES = {
    "Scenario": "value",
    "load_scenario": "load",
    "scenario_from_toml": "load",
}


if not TYPE_CHECKING:  # or type checkers would take every name to be there
    __getattr__ = attributes(__name__, _MODULES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
