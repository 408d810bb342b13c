"""Kernels by what calls them: simulations, analyses, identification, control, exports; without SymPy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Robot

from .signatures import OWN_KERNELS, available

# packages
PACKAGE = (
    *("mass_matrix", "bias_force", "generalized_force", "external_force", "gravity", "residual", "inverse_dynamics"),
    *("forward_dynamics", "coriolis_matrix", "kinematics", "energy", "reactions", "rollout"),
    *("constraint_forces", "loop_reactions", "constraint", "constraint_jacobian", "cut_poses", "coupling_forces"),
)
ON_REQUEST = tuple(name for name in OWN_KERNELS if name not in PACKAGE)
# mechanisms
ASSEMBLY = ("constraint", "constraint_jacobian", "cut_poses")
MECHANISM = ("following", "constraint_bias", "mass_matrix", "residual")
INDEPENDENT_COORDINATES = ("constraint", "constraint_jacobian", "mass_matrix", "cut_poses")
# simulations
RIGID_MODEL = ("inverse_dynamics", "kinematics")
SIMULATION = (
    *("inverse_dynamics", "kinematics", "forward_dynamics", "mass_matrix"),
    *("external_force", "energy", "generalized_force"),
)
IMPLICIT_STEPS = ("residual_jacobian",)
CLOSED_SIMULATION = ("constrained_dynamics", "kinematics", "external_force", "energy", "generalized_force")
ELECTRIC_DRIVES = ("inverse_dynamics", "residual", "residual_jacobian")
SIMULATED_STATES = ("inverse_dynamics", "forward_dynamics", "mass_matrix")
SIMULATED_BATCHES = ("inverse_dynamics", "kinematics", "energy")
ENERGY_BALANCE = ("generalized_force",)
EXTERNAL_WRENCHES = ("external_force",)
JOINT_REACTIONS = ("reactions", "external_reactions")
# analyses
FRAME_POSES = ("kinematics",)
INERTIA = ("mass_matrix",)
INVERSE_DYNAMICS = ("inverse_dynamics",)
ANALYSIS = ("inverse_dynamics", "residual_jacobian", "kinematics")
ANALYSIS_OF_LAWS = ("cut_forces", "cut_jacobian", "drive_forces")
CUT_LAWS = ("cut_forces", "cut_jacobian")
STRUCTURES = ("inverse_dynamics", "forward_dynamics", "mass_matrix")
SLOPES_OF_CLOSURE = ("constraint_bias_tangent",)
CLOSURE_BY_PARAMETERS = ("constraint_tangent", "constraint_parameter_tangent")
ACCELERATION_SLOPES = ("forward_dynamics_jacobian",)
POLES_OF_MECHANISMS = ("constrained_dynamics", "constrained_dynamics_tangent")
ADVICE_ON_FLOAT32 = (
    *("inverse_dynamics", "tree_inverse_dynamics", "forward_dynamics", "tree_forward_dynamics"),
    *("constrained_dynamics", "mass_matrix", "bias_force", "generalized_force", "gravity", "residual", "energy"),
    "kinematics",
)
# identification
BASE_PARAMETERS = ("regressor",)
IDENTIFICATION = ("regressor", "inverse_dynamics")
EXCITATION = ("regressor", "regressor_adjoint", "inverse_dynamics", "inverse_dynamics_adjoint", "kinematics")
FORCES_OF_MOTIONS = ("inverse_dynamics", "reactions", "loop_reactions", "cut_forces", "cut_jacobian")
FIT_OF_MOTIONS = ("mass_matrix", "forward_dynamics", "adaptive_rollout", "rosenbrock_sensitivity")
# control
CONTROLLED_INVERSION = ("residual", "residual_jacobian", "mass_matrix", "kinematics")
GEARS = ("generalized_force", "generalized_force_jet2")
SPRINGS_OF_GEARS = ("generalized_force_jet2",)
ROTORS_OF_GEARS = ("generalized_force",)
SENSORS = ("measurement", "measurement_adjoint")
MOMENTUM_OBSERVER = ("generalized_momentum", "generalized_force")
MOMENTUM_ALONG_CONSTRAINTS = ("constraint_jacobian", "constraint_bias", "constraint_bias_adjoint")
FILTER_OF_LINEAR_LAWS = ("rollout", "residual_jacobian")
FILTER_BY_SENSITIVITIES = ("implicit_sensitivity",)
FILTERED_WRENCHES = ("external_force", "external_force_tangent")
FILTERED_ACCELERATIONS = ("forward_dynamics", "forward_dynamics_tangent")
FILTERED_ACCELERATIONS_IN_C = ("forward_dynamics", "forward_dynamics_jacobian")
FILTERED_ACCELERATIONS_BY_PARAMETERS = ("forward_dynamics_parameter_tangent",)
FILTERED_SENSORS = ("measurement_tangent", "measurement_parameter_tangent")
FILTERED_SENSORS_IN_C = ("measurement_parameter_tangent",)
# pages and exports
CARRIED_STEPS = ("rollout",)  # which generated packages take by modules of their own
PAGE_ABOUT_A_STATE = ("residual", "mass_matrix", "reactions", "external_reactions", "external_force")
LIVE_PAGE = ("adaptive_rollout", "inverse_dynamics", "energy", "kinematics", "external_force")
FMU = (
    *("forward_dynamics", "forward_dynamics_jacobian", "external_force", "kinematics", "energy", "reactions"),
    *("external_reactions", "external_force_tangent", "energy_tangent", "reactions_tangent"),
    "external_reactions_tangent",
)
CLOSED_FMU = (
    *("constrained_dynamics", "settling", "external_force", "kinematics", "energy"),
    *("constrained_dynamics_tangent", "settling_tangent", "external_force_tangent", "energy_tangent"),
)
WEBASSEMBLY = (
    *("forward_dynamics", "inverse_dynamics", "mass_matrix", "bias_force", "generalized_force", "external_force"),
    *("kinematics", "energy", "reactions", "constraint", "rollout", "adaptive_rollout"),
)
ARRAYS = (
    *("inverse_dynamics", "forward_dynamics", "mass_matrix", "bias_force", "generalized_force", "external_force"),
    *("energy", "kinematics", "residual", "constraint", "constraint_jacobian"),
)
DEVICE = (
    *("inverse_dynamics", "forward_dynamics", "mass_matrix", "residual"),
    *("residual_jacobian", "forward_dynamics_jacobian"),
)


@dataclass(frozen=True)
class Differentiable:
    """A kernel that JAX, PyTorch and CasADi take as a differentiable function.

    symbol: of its result.
    jacobian: the kernel that its derivatives follow from; that of its tangents where there is none.
    flat: pairs of arguments: derivatives by one do not change with the other.
    """

    symbol: str
    jacobian: str = ""
    flat: tuple[tuple[str, str], ...] = ()


DIFFERENTIABLE: Mapping[str, Differentiable] = {
    "residual": Differentiable("r", "residual_jacobian", tuple(("u", x) for x in ("q", "v", "z", "a", "u"))),
    "inverse_dynamics": Differentiable("u", "residual_jacobian"),
    "forward_dynamics": Differentiable("a", "forward_dynamics_jacobian"),
    "mass_matrix": Differentiable("M", "christoffel"),
    "bias_force": Differentiable("b"),
    "gravity": Differentiable("g"),
    "nonlinear_effects": Differentiable("n"),
    "generalized_force": Differentiable("Q"),
    "external_force": Differentiable("Q", flat=(("wrench", "wrench"),)),
    "energy": Differentiable("E"),
    "center_of_mass": Differentiable("c"),
    "centroidal_momentum": Differentiable("h"),
    "frame_velocities": Differentiable("V"),
    "frame_accelerations": Differentiable("A_dot"),
    "imu": Differentiable("y"),
    "generalized_momentum": Differentiable("p"),
    "frame_pose": Differentiable("A"),
    "frame_jacobian": Differentiable("J"),
    "constraint": Differentiable("g", "constraint_jacobian"),
    "constraint_jacobian": Differentiable("G"),
    "constraint_forces": Differentiable("f"),
    "tree_forward_dynamics": Differentiable("a", "tree_forward_dynamics_jacobian"),
    "tree_inverse_dynamics": Differentiable("u", "residual_jacobian"),
}


def kernel_group(of: Robot | Model, *groups: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the kernels of these groups that a robot has, each once."""
    known = available(build_model(of) if isinstance(of, Robot) else of)
    return tuple(dict.fromkeys(name for group in groups for name in group if name in known))
