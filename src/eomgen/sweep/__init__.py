"""Parameter sweeps: plans, samples, workers, stores, results.

Uses kernel, robot, forms, description, state, integration, motion, scenario, codegen (kernels),
pipeline and simulation.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from .driver import run as run
    from .plan import Plan as Plan
    from .plan import load_plan as load_plan
    from .plan import plan_from_toml as plan_from_toml
    from .result import Sensitivity as Sensitivity
    from .result import SweepResult as SweepResult
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
