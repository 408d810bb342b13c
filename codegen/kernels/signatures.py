"""The one table of kernels: arrays that each reads and writes, where its C comes from; without SymPy."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eomgen.robot.model import Model

from eomgen.lazily import kept
from eomgen.names import component_name
from eomgen.robot.value import readings

from ..tree.regressor import regressor_names
from .blocks import row_blocks
from .bodies import kinematics_size
from .derived import BACKWARDS, GRADIENTS, derivative_shapes, differentiated
from .entries import ARRAYS, KINDS, KernelTable, Kind, Signature, WrenchTerm, kernel, table, with_internal_states

DTYPES = ("float64", "float32")  # types of kernels' numbers
SINGLES, BATCHES = "singles", "batches"  # the C of all kernels as two libraries: for one state, and on vectors


TOLD = ("constraint", "constraint_jacobian", "constraint_bias", "constrained_drives")  # what errors of loops tell

CORE, MORE = "KernelMethods", "KernelFunctions"  # classes of methods: those of kernels, and of ``kernel.functions``
EXTERNAL = WrenchTerm("external_force")
EXTERNAL_OF_ROWS = WrenchTerm("external_force", -1.0)  # where they stand on the other side of the equation
EXTERNAL_REACTIONS = WrenchTerm("external_reactions")

OWN_KERNELS: Mapping[str, Signature] = table(
    kernel(
        "mass_matrix(q) -> matrix",
        "Mass matrix M(q), eq. (11).",
        symmetric=True,
        diagnosis="mass",
        method=CORE,
    ),
    kernel(
        "bias_force(q, v) -> vector",
        "Coriolis and centrifugal terms, eq. (12) contracted.",
        method=CORE,
    ),
    kernel(
        "generalized_force(q, v) -> rate_vector",
        "Springs, dampers, gravity: Q_P + Q_G, eqs. (13), (14).",
        wrench=EXTERNAL,
        states=True,
        in_balances=True,
        method=CORE,
    ),
    kernel(
        "external_force(q, wrench) -> vector",
        "Q_F of eq. (14), its moment term corrected; base frame.",
        method=MORE,
    ),
    kernel(
        "residual(q, v, a, u) -> vector",
        "M a + bias - Q - u, eq. (5) unexpanded; zero on a motion.",
        wrench=EXTERNAL_OF_ROWS,
        states=True,
        in_balances=True,
        method=CORE,
    ),
    kernel(
        "inverse_dynamics(q, v, a) -> vector",
        "The drives u that make the residual zero.",
        closed=("constrained_drives",),
        beside=("tree_inverse_dynamics", "inverse_dynamics_under_load", *TOLD),
        wrench=EXTERNAL_OF_ROWS,
        tree="tree_inverse_dynamics",
        loaded="inverse_dynamics_under_load",
        diagnosis="forces",
        states=True,
        in_balances=True,
        method=CORE,
    ),
    kernel(
        "tree_inverse_dynamics(q, v, a) -> vector",
        "The drives u that make the residual zero, loops cut.",
        needs="constraints",
        wrench=EXTERNAL_OF_ROWS,
        diagnosis="forces",
        states=True,
    ),
    kernel(
        "constrained_drives(q, v, a, u) -> driving",
        "Drives of a motion beside forces u, multipliers, g, J v, J a, J_dot v, forces left and needed.",
        needs="constraints",
        diagnosis="drives",
        states=True,
    ),
    kernel(
        "inverse_dynamics_under_load(q, v, a, u) -> vector",
        "The drives that make a motion beside forces u.",
        "composed",
        calls=("constrained_drives",),
        needs="constraints",
        states=True,
    ),
    kernel(
        "forward_dynamics(q, v, u) -> rate_vector",
        "Accelerations under the drives u.",
        solves=True,
        closed=("constrained_dynamics",),
        beside=("tree_forward_dynamics", *TOLD),
        wrench=WrenchTerm("external_force", into="u"),
        tree="tree_forward_dynamics",
        states=True,
        method=CORE,
    ),
    kernel(
        "tree_forward_dynamics(q, v, u) -> rate_vector",
        "Accelerations under the drives u, loops cut.",
        solves=True,
        needs="constraints",
        wrench=WrenchTerm("external_force", into="u"),
        states=True,
    ),
    kernel(
        "constrained_dynamics(q, v, u) -> constrained",
        "Accelerations under the drives u, multipliers, g and J v; whatever g is.",
        solves=True,
        needs="constraints",
        beside=("following",),  # charts, along which it is integrated
        states=True,
    ),
    kernel(
        "constraint_forces(q, v, u) -> constraints",
        "Multipliers of the constraint under the drives u.",
        "composed",
        calls=("constrained_dynamics",),
        solves=True,
        needs="constraints",
        wrench=WrenchTerm("external_force", into="u"),
        states=True,
    ),
    kernel(
        "settling(q, v) -> settling",
        "Projection of q and v onto the constraint, by the kinetic energy: changes of both, and g.",
        solves=True,
        needs="constraints",
        states=True,
    ),
    kernel(
        "following(q, v, a, chart) -> following",
        "Solve for the dependent coordinates of a chart, their rates and accelerations: loops stay assembled.",
        "composed",
        calls=("constraint", "constraint_jacobian", "constraint_bias"),
        needs="constraints",
        vectors=False,
        derivatives=(),
    ),
    kernel(
        "residual_jacobian(q, v, a) -> derivatives",
        "Derivatives of the residual by q, v and a: three matrices.",
        states=True,
    ),
    kernel(
        "forward_dynamics_jacobian(q, v, u) -> derivatives",
        "Derivatives of the accelerations by q, v and u: three matrices.",
        "composed",
        calls=("forward_dynamics", "residual_jacobian"),
        closed=("constrained_dynamics", "residual_jacobian", "closing_derivatives"),
        solves=True,
        beside=("tree_forward_dynamics_jacobian", *TOLD),
        tree="tree_forward_dynamics_jacobian",
        derivatives=("jet",),
        states=True,
    ),
    kernel(
        "tree_forward_dynamics_jacobian(q, v, u) -> derivatives",
        "Derivatives of the accelerations by q, v and u, loops cut: three matrices.",
        "composed",
        calls=("tree_forward_dynamics", "residual_jacobian"),
        solves=True,
        needs="constraints",
        derivatives=("jet",),
        states=True,
    ),
    kernel(
        "coriolis_matrix(q, v) -> matrix",
        "Coriolis matrix C(q, v) with C v = bias and M_dot = C + C^T.",
        method=CORE,
    ),
    kernel(
        "christoffel(q) -> tensor",
        "Christoffel symbols of the first kind, the tensor C of eq. (12).",
        columns_of="coriolis_matrix",
        mapped=True,
        derivatives=("jet",),
        method=CORE,
    ),
    kernel(
        "kinematics(q) -> kinematics",
        "Frames [R | X], bodies' origins, coordinates' axes; eqs. (1)-(3).",
        "frames",
        functions=table(
            kernel(
                "frame_pose(q) -> pose",
                "Pose A_0k of a frame in the base; eqs. (1) and (2).",
                method=CORE,
            ),
            kernel(
                "frame_jacobian(q) -> jacobian",
                "Velocity of a frame's origin (3 rows) and angular velocity (3 rows) per coordinate rate, base frame.",
                method=CORE,
            ),
        ),
    ),
    kernel(
        "gravity(q) -> vector",
        "Forces that hold the links' weight, loops cut.",
        by_request=True,
        method=CORE,
    ),
    kernel(
        "nonlinear_effects(q, v) -> vector",
        "Coriolis, centrifugal and gravity terms, loops cut.",
        by_request=True,
        method=CORE,
    ),
    kernel(
        "center_of_mass(q) -> point",
        "Center of mass of the moving links, base frame.",
        by_request=True,
        method=CORE,
    ),
    kernel(
        "centroidal_momentum(q, v) -> momentum",
        "Linear momentum of the moving links, and angular momentum about their center of mass; base frame.",
        by_request=True,
        method=CORE,
    ),
    kernel(
        "frame_velocities(q, v) -> frame_rates",
        "Per frame the velocity of its origin and its angular velocity, base frame.",
        by_request=True,
        method=MORE,
    ),
    kernel(
        "frame_accelerations(q, v, a) -> frame_rates",
        "Per frame the acceleration of its origin and its angular acceleration, base frame.",
        by_request=True,
        method=MORE,
    ),
    kernel(
        "imu(q, v, a) -> frame_rates",
        "Per frame what an IMU reads in the frame's axes: specific force R^T (a - g), angular rate R^T w.",
        by_request=True,
        method=MORE,
    ),
    kernel(
        "measurement(q, v, a) -> readings",
        "Readings of the robot's sensors, one behind the other.",
        by_request=True,
        needs="sensors",
        method=MORE,
    ),
    kernel(
        "generalized_momentum(q, v) -> momenta",
        "Generalized momentum p = M v, and C^T v = dT/dq: p' = u + C^T v + Q on a motion.",
        by_request=True,
        method=MORE,
    ),
    kernel(
        "energy(q, v) -> pair",
        "Kinetic energy, eq. (4), and potential energy of gravity and springs.",
        states=True,
        method=CORE,
    ),
    kernel(
        "reactions(q, v, a) -> reactions",
        "Joint reaction wrenches: force and moment on child links, joint frames after the motion.",
        closed=("tree_reactions", "constrained_drives", "closing_reactions"),
        beside=("tree_reactions", "reactions_under_load", *TOLD),
        wrench=EXTERNAL_REACTIONS,
        tree="tree_reactions",
        loaded="reactions_under_load",
        states=True,
        method=CORE,
    ),
    kernel(
        "tree_reactions(q, v, a) -> reactions",
        "Joint reaction wrenches: force and moment on child links, joint frames after the motion, loops cut.",
        needs="constraints",
        wrench=EXTERNAL_REACTIONS,
        states=True,
    ),
    kernel(
        "reactions_under_load(q, v, a, u) -> reactions",
        "Joint reaction wrenches where forces u act beside the drives, without reactions to u.",
        "composed",
        calls=("tree_reactions", "constrained_drives", "closing_reactions"),
        needs="constraints",
        wrench=EXTERNAL_REACTIONS,
        states=True,
    ),
    kernel(
        "loop_reactions(q, v, a) -> loop_reactions",
        "Force and moment of each cut joint on its second link, cut frame there.",
        closed=("constrained_drives", "loop_wrenches"),
        needs="loops",
        beside=("loop_reactions_under_load", *TOLD),
        loaded="loop_reactions_under_load",
        states=True,
        method=CORE,
    ),
    kernel(
        "loop_reactions_under_load(q, v, a, u) -> loop_reactions",
        "The same where forces u act beside the drives.",
        "composed",
        calls=("constrained_drives", "loop_wrenches"),
        needs="cuts",
        states=True,
    ),
    kernel(
        "external_reactions(q, wrench) -> reactions",
        "Joint reaction wrenches to external wrenches alone, joint frames after the motion.",
    ),
    kernel(
        "regressor(q, v, a) -> regressor",
        "Y of inverse dynamics without springs and dampers, u = Y theta; loops cut.",
        method=MORE,
    ),
    kernel(
        "euler_cosines(q) -> joints",
        "Cosine of beta of every joint with three angles, 1 for the others.",
        method=MORE,
    ),
    kernel(
        "constraint(q) -> constraints",
        "Constraint g(q) of the cut joints; zero where loops are closed.",
        needs="constraints",
        diagnosis="gap",
        method=MORE,
    ),
    kernel(
        "constraint_jacobian(q) -> constraint_rows",
        "Jacobian J = dg/dq of the constraint.",
        needs="constraints",
        diagnosis="gap_rows",
        method=MORE,
    ),
    kernel(
        "constraint_bias(q, v) -> constraints",
        "J_dot v: g_ddot = J a + J_dot v.",
        needs="constraints",
        diagnosis="gap_bias",
        method=MORE,
    ),
    kernel(
        "coupling_forces(q, v, a) -> couplings",
        "Force on each follower of a rigid coupling that a motion takes.",
        needs="followers",
        wrench=WrenchTerm("external_coupling_forces"),
        states=True,
        method=MORE,
    ),
    kernel(
        "external_coupling_forces(q, wrench) -> couplings",
        "Forces of the couplings by external wrenches alone.",
        needs="followers",
    ),
    kernel(
        "cut_poses(q) -> cut_poses",
        "Per loop the cut frame on its second link seen from that on its first.",
        needs="loops",
        diagnosis="loop_poses",
        method=MORE,
    ),
    kernel(
        "spring_forces(q, v) -> spring_pairs",
        "Length and tension of each point-to-point spring.",
        needs="springs",
        method=MORE,
    ),
    kernel(
        "spring_jacobian(q) -> spring_rows",
        "Derivatives of the springs' lengths by q: moment arms.",
        needs="springs",
        method=MORE,
    ),
    kernel(
        "cut_forces(q, v) -> law_pairs",
        "Per coordinate of a cut joint with a force, and elastic coupling, its deviation and what resists it.",
        needs="laws",
        method=MORE,
    ),
    kernel(
        "cut_jacobian(q) -> law_rows",
        "Derivatives by q of the deviations of cut joints and elastic couplings.",
        needs="laws",
        method=MORE,
    ),
    kernel(
        "element_forces(q, v) -> element_pairs",
        "Per coordinate of a force element between two links its value and what resists it.",
        needs="elements",
        method=MORE,
    ),
    kernel(
        "element_jacobian(q) -> element_rows",
        "Derivatives by q of the coordinates of force elements.",
        needs="elements",
        diagnosis="element_rows",
        method=MORE,
    ),
    kernel(
        "drive_forces(q, v, u) -> rate_vector",
        "Forces of drives on coordinates, and voltages on currents less what the motion induces; their power by v is"
        " what drives take in.",
        needs="drives",
        states=True,
        in_balances=True,
        method=MORE,
        otherwise="u",
    ),
    kernel(
        "drive_jacobian(q, v, u) -> derivatives",
        "Derivatives by q, v and u of what drives with states do, of forces and of the states' rates times inertias.",
        needs="drives",
        states=True,
        method=MORE,
    ),
    kernel(
        "spring_stiffness(q) -> matrix",
        "Largest stiffness of the point-to-point springs: sum of k (dd/dq)^T dd/dq.",
        symmetric=True,
        needs="springs",
        method=MORE,
    ),
    kernel(
        "rollout(q, v, u) -> rate_vector",
        "Many steps of one integration.",
        "rollout",
        calls=("forward_dynamics", "implicit_step"),
        counts=("implicit_step",),  # those of one linearly implicit step
        closed=("constrained_dynamics", "implicit_step", "settling"),
        solves=True,
    ),
    kernel(
        "adaptive_rollout(q, v, u) -> rate_vector",
        "Integration with error control.",
        "adaptive",
        calls=("forward_dynamics", "stage_factors", "stage_solution"),  # a stage's, with the factors of a step
        closed=("constrained_dynamics", "stage_factors", "stage_solution", "settling"),
        solves=True,
    ),
    kernel(
        "radau_rollout(q, v, u) -> rate_vector",
        "The same, by Radau IIA, too.",
        "adaptive",
        calls=("forward_dynamics", "stage_factors", "stage_solution", "pair_factors", "pair_solution"),
        closed=("constrained_dynamics", "stage_factors", "stage_solution", "settling", "pair_factors", "pair_solution"),
        solves=True,
        by_request=True,
    ),
)

PARTS: Mapping[str, Signature] = table(  # programs that only other kernels call
    kernel(
        "closing_derivatives(q, v, a, multipliers) -> closing",
        "Per loop J, the derivatives of J a + J_dot v by q and v, and of J^T lambda by q, where they may not vanish.",
    ),
    kernel(
        "closing_reactions(q, multipliers) -> reactions",
        "Joint reaction wrenches to the forces in the cuts.",
        needs="constraints",
    ),
    kernel(
        "loop_wrenches(q, v, multipliers) -> loop_reactions",
        "Force and moment of each cut joint on its second link.",
        needs="cuts",
        states=True,
    ),
    kernel(
        "implicit_step(q, v, u, added, dt) -> rate_vector",
        "(M + dt B + dt^2 K + added) a = u - bias - K (q + dt v) - B v: accelerations of a linearly implicit step.",
        states=True,
    ),
    kernel(
        "stage_factors(q, v, kp, kd, times) -> kept",
        "Factors of M + c B + c^2 K, for the stages of a Rosenbrock method.",
        states=True,
    ),
    kernel(
        "stage_solution(kept, rates, shifts) -> rate_vector",
        "w of (M + c B + c^2 K) w = -((c B + c^2 K) rates + c K shifts).",
    ),
    kernel(
        "pair_factors(q, v, kp, kd, pair_times, spans) -> pair_kept",
        "Factors of M + c B + c^2 K with a complex c, for iterations of Radau IIA.",
        states=True,
    ),
    kernel(
        "pair_solution(pair_kept, pair_rates, pair_shifts) -> pair_vector",
        "w of (M + c B + c^2 K) w = -((c B + c^2 K) rates + c K shifts), imaginary parts behind real ones.",
    ),
)

DERIVATIVES = KernelTable(differentiated(OWN_KERNELS))  # there only if they are asked for
KERNELS = KernelTable({**OWN_KERNELS, **DERIVATIVES, **GRADIENTS})
FRAME_KERNEL = next(name for name, signature in OWN_KERNELS.items() if signature.kind == "frames")
CLOSED_PROGRAMS: Mapping[str, str] = {  # the one program with whose first numbers a kernel ends where there are loops
    name: signature.closed[0] for name, signature in OWN_KERNELS.items() if len(signature.closed) == 1
}


def closes_loops(name: str) -> bool:
    """Return whether a kernel, or what it is a derivative of, refuses states in which loops are open."""
    signature = KERNELS.get(KERNELS[name].derivative_of) or KERNELS[name]
    return not {*signature.closed, *signature.calls}.isdisjoint(CLOSED_PROGRAMS.values())


CLOSURE_KERNELS = ("constraint", "constraint_jacobian", "constraint_bias", "cut_poses")  # of the constraint itself

SIGNATURES = KernelTable({**OWN_KERNELS, **DERIVATIVES, **GRADIENTS, **PARTS, **BACKWARDS})


@cache
def signature_table(*, states: bool, drives: bool) -> KernelTable:
    """Return all signatures for robots with internal states, or without any; ``drives``: some of them of drives."""
    if not states:
        return SIGNATURES
    own, others = (
        {name: with_internal_states(row, states=states, drives=drives) for name, row in rows.items()}
        for rows in (OWN_KERNELS, {**PARTS, **BACKWARDS})
    )
    return KernelTable({**own, **differentiated(own), **GRADIENTS, **others})


def signatures_of(model: Model) -> KernelTable:
    """Return all signatures as a model has them."""
    return signature_table(states=bool(model.internal_states), drives=bool(model.drives))


TURNED = (  # programs that know how joints are turned, which integrations call
    *("forward_dynamics", "forward_dynamics_jacobian", "implicit_step", "stage_factors", "stage_solution"),
    *("pair_factors", "pair_solution"),
    *("inverse_dynamics", "mass_matrix", "residual_jacobian", "external_force"),
)
CLOSED_TURNED = (  # more of them where there are constraints
    *("constrained_dynamics", "settling", "residual"),
    *("constraint", "constraint_jacobian", "constraint_bias", "closing_derivatives"),
)


def knows_turns(program: str, model: Model) -> bool:
    """Whether a program reads how the joints of ``Model.turning`` are turned."""
    return program in TURNED or (bool(model.constraints) and program in CLOSED_TURNED)


def element_rows(model: Model) -> tuple[str, ...]:
    """Name the coordinates of force elements that ``element_forces`` tells of, in its order: "mount.x"."""
    rows = list[str]()
    for element in model.robot.elements:
        names = (f"{element.prefix}.{key}" for key, _ in element.numbers())
        below = len(element.prefix) + 1
        numbers = {name[below:]: model.parameters[name] for name in names if name in model.parameters}
        rows += (component_name(element.name, row) for row in element.slopes(numbers))
    return tuple(rows)


def reading_names(model: Model) -> tuple[str, ...]:
    """Name what the kernel "measurement" writes: "encoder:joint1.gamma", "imu:tcp.fx", ..."""
    return tuple(name for sensor in model.robot.sensors for name, _ in readings(model.robot, sensor))


def available(model: Model) -> tuple[str, ...]:
    """Name the functions of C of the kernels that there are for a model."""
    has = {
        "": True,
        "loops": bool(model.robot.loops),
        "springs": bool(model.robot.springs),
        "elements": bool(element_rows(model)),
        "constraints": bool(model.constraints),
        "cuts": bool(model.robot.loops and model.constraints),
        "laws": bool(model.cut_laws),
        "followers": bool(model.followers),
        "drives": bool(model.drives),
        "sensors": bool(model.robot.sensors),
    }
    return tuple(
        name
        for name, signature in KERNELS.compiled.items()
        if has[signature.needs] and (model.parameters or not signature.by_parameters)
    )


def with_beside(names: Sequence[str], model: Model) -> tuple[str, ...]:
    """Add to kernels those that come with them for a model that has constraints."""
    kernels, known = dict.fromkeys(names), available(model)
    for name in names if model.constraints else ():
        kernels |= dict.fromkeys(x for x in KERNELS[name].beside if x in known)
    return tuple(kernels)


def library_objects(kernels: Iterable[str], half: str) -> tuple[str, ...]:
    """Name the objects that the scalar or the batch library of kernels is linked with, of both without a name.

    None where that includes what it needs: the C of gradients does, which calls its equations by name.
    """
    kinds = {KERNELS[name].kind for name in kernels}
    if "adaptive" not in kinds:
        return ()
    singles = ("adaptive",) if half != BATCHES and "gradient" not in kinds else ()
    return (*singles, *(("adaptive_lanes",) if half != SINGLES else ()))


def by_kind(names: Iterable[str]) -> list[str]:
    """Order kernels as KINDS has them; those of one kind in the order of KERNELS."""
    place = list(SIGNATURES.compiled)
    return sorted(names, key=lambda name: (KINDS.index(SIGNATURES[name].kind), place.index(name)))


@dataclass(frozen=True)
class Function:
    """A function of C that users call: its name, the kernel that it belongs to, and its signature.

    ``kind`` is its kernel's.
    """

    name: str
    kernel: str
    kind: Kind
    signature: Signature

    @property
    def is_framed(self) -> bool:
        """True if the number of a frame comes before the result."""
        return self.kind == "frames"

    @property
    def is_rollout(self) -> bool:
        """True if one call does many steps."""
        return self.kind in ("rollout", "adaptive", "gradient")


def functions(names: Iterable[str], known: KernelTable = SIGNATURES) -> list[Function]:
    """Return functions that users of these kernels call, in the order in which headers and packages have them.

    That is the order of KERNELS, with functions of a frame's number behind the others, and rollouts last.
    """
    wanted = set(names)
    kernels = {name: known[name] for name in KERNELS.compiled if name in wanted}
    listed = [
        Function(name, kernel, owner.kind, called)
        for kernel, owner in kernels.items()
        for name, called in (owner.functions or {kernel: owner}).items()
    ]
    return sorted(listed, key=lambda function: (function.is_rollout, function.is_framed))


def _uses(array: str, kernels: Collection[str] | None) -> bool:
    """Return whether kernels, what they are derivatives of, or programs that their C calls write an array."""
    named = [KERNELS[name] for name in (KERNELS.compiled if kernels is None else kernels)]
    called = {name for x in named for name in (x.derivative_of, *x.calls, *x.closed)}
    return any(x.writes == array for x in (*named, *(SIGNATURES[name] for name in called if name in SIGNATURES)))


def _lengths(model: Model, kernels: frozenset[str] | None) -> dict[str, int]:
    """Return the lengths of axes that arrays of a model have; what it has nothing of is left out."""
    n, m, robot = len(model.coordinates), len(model.constraints), model.robot
    always = {
        "coordinates": n,
        "rates": model.size,
        "inputs": n + len(model.drives),
        "links": len(model.links),
        "frames": len(model.frames),
        "joints": len(model.bodies),
    }
    if _uses("regressor", kernels):
        always["inertial_parameters"] = len(regressor_names(model))
    if _uses("kinematics", kernels):
        always["kinematics"] = kinematics_size(model)
    if m:
        always |= {
            "constraints": m,
            "constrained": model.size + 3 * m,
            "settling": n + model.size + m,
            "chart": 2 * n + m + 1 + m * n,
            "following": 3 * n + m * n + m,
            "driving": 3 * n + 5 * m,
            "closing": sum(3 * block.size + len(block.columns) ** 2 for block in row_blocks(model)),
        }
    counted = {
        "internal_states": len(model.internal_states),
        "drives": len(model.drives),
        "loops": len(robot.loops),
        "cut_laws": len(model.cut_laws),
        "couplings": len(model.followers),
        "springs": len(robot.springs),
        "element_rows": len(element_rows(model)),
        "readings": len(reading_names(model)) if robot.sensors else 0,
    }
    return always | {name: length for name, length in counted.items() if length}


def _pairs(model: Model) -> dict[str, tuple[int, ...]]:
    """Return shapes of arrays of complex numbers."""
    shifts, rates = (2 * len(model.coordinates),), (2 * model.size,)
    return {"pair_rates": rates, "pair_shifts": shifts, "pair_vector": rates, "pair_times": (4,), "spans": (2,)}


def shapes(model: Model, kernels: Collection[str] | None = None) -> dict[str, tuple[int, ...]]:
    """Return the shapes of arrays that kernels read and write; with names, of derivatives' arrays of these alone."""
    return dict(_shapes(model, None if kernels is None else frozenset(kernels)))


@kept
def _shapes(model: Model, kernels: frozenset[str] | None) -> dict[str, tuple[int, ...]]:
    lengths = _lengths(model, kernels)
    table: dict[str, tuple[int, ...]] = {
        name: tuple(axis if isinstance(axis, int) else lengths[axis] for axis in array.axes)
        for name, array in ARRAYS.items()
        if all(isinstance(axis, int) or axis in lengths for axis in array.axes)
    }
    if kernels is None or "radau_rollout" in kernels:
        table |= _pairs(model)
    known = signatures_of(model)
    wanted = {name: known[name] for name in DERIVATIVES.compiled if kernels is None or name in kernels}
    return {**table, **derivative_shapes(wanted, table, len(model.parameters))}
