"""A robot about a state or along a path: statics, vibration, frequency responses, linear systems, error budgets.

Uses runtime, robot, results, bending, description, state, loops, motion, pipeline, integration and simulation.
"""

from ..bending.beams.resultants import StressResultants
from ..lazily import public_names
from .compliance import ComplianceMap, compliance_map
from .discrete import DiscreteStateSpace
from .frequency import Response, h1, response
from .matrices import StateSpace, linearize
from .modal import modes, modes_along
from .modal_result import Modes, TrackedModes
from .options import StateOptions
from .sensitivity import offset_sensitivity
from .statics import Deflection, JointStiffnessMatrix, deflection, joint_stiffness_matrix
from .structures import Comparison, compare
from .tool_budget import Budget, budget

__all__ = [
    "Budget",
    "Comparison",
    "ComplianceMap",
    "Deflection",
    "DiscreteStateSpace",
    "JointStiffnessMatrix",
    "Modes",
    "Response",
    "StateOptions",
    "StateSpace",
    "StressResultants",
    "TrackedModes",
    "budget",
    "compare",
    "compliance_map",
    "deflection",
    "h1",
    "joint_stiffness_matrix",
    "linearize",
    "modes",
    "modes_along",
    "offset_sensitivity",
    "response",
]


def __dir__() -> list[str]:
    return public_names(globals(), __all__)
