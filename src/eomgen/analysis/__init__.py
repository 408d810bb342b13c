"""Statics, vibration, frequency response, linearization and error budgets about a state or along a path.

Uses runtime, kernel, robot, results, bending, description, state, loops, motion, codegen (kernels), pipeline,
integration and simulation.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from ..bending.beams.resultants import StressResultants as StressResultants
    from .compliance import ComplianceMap as ComplianceMap
    from .compliance import compliance_map as compliance_map
    from .discrete import DiscreteStateSpace as DiscreteStateSpace
    from .frequency import Response as Response
    from .frequency import h1 as h1
    from .frequency import response as response
    from .matrices import StateSpace as StateSpace
    from .matrices import linearize as linearize
    from .modal import modes as modes
    from .modal import modes_along as modes_along
    from .modal_result import Modes as Modes
    from .modal_result import TrackedModes as TrackedModes
    from .options import StateOptions as StateOptions
    from .sensitivity import offset_sensitivity as offset_sensitivity
    from .statics import Deflection as Deflection
    from .statics import JointStiffnessMatrix as JointStiffnessMatrix
    from .statics import deflection as deflection
    from .statics import joint_stiffness_matrix as joint_stiffness_matrix
    from .structures import Comparison as Comparison
    from .structures import compare as compare
    from .tool_budget import Budget as Budget
    from .tool_budget import budget as budget
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
