"""What every kernel reads and writes: the one table of kernels, without SymPy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from eomgen.robot.model import Model


@dataclass(frozen=True)
class Signature:
    """Arrays that a kernel reads and the one that it writes, by their names in ``shapes``, and what it computes.

    ``calls``: the programs that a kernel's C calls, where it is no program of its own.  ``tangent_of``: the kernel that
    this one differentiates; such a one is there only if it is asked for.
    ``solves``: whether it inverts the mass matrix, and so fails where that is singular; the others always return 0.
    """

    reads: tuple[str, ...]
    writes: str
    text: str
    calls: tuple[str, ...] = ()
    tangent_of: str = ""
    solves: bool = False


RATES = {"q": "dq", "v": "dv", "a": "da", "wrench": "dwrench"}  # of what tangents move


def _tangent(kernel: str, *reads: str, writes: str) -> dict[str, Signature]:
    rates = tuple(RATES[array] for array in reads)
    text = f"What {kernel} changes by along {', '.join(rates)}."
    return {f"{kernel}_tangent": Signature((*reads, *rates), writes, text, tangent_of=kernel)}


KERNELS: Mapping[str, Signature] = {
    "mass_matrix": Signature(("q",), "matrix", "Mass matrix M(q), eq. (11)."),
    "bias_force": Signature(("q", "v"), "vector", "Coriolis and centrifugal terms, eq. (12) contracted."),
    "generalized_force": Signature(("q", "v"), "vector", "Springs, dampers, gravity: Q_P + Q_G, eqs. (13), (14)."),
    "external_force": Signature(
        ("q", "wrench"),
        "vector",
        "Q_F of eq. (14), its moment term corrected; base axes.",
    ),
    "residual": Signature(("q", "v", "a", "u"), "vector", "M a + bias - Q - u, eq. (5) unexpanded; zero on a motion."),
    "inverse_dynamics": Signature(("q", "v", "a"), "vector", "The drives u that make the residual zero."),
    "forward_dynamics": Signature(("q", "v", "u"), "vector", "Accelerations under the drives u.", solves=True),
    "residual_jacobian": Signature(
        ("q", "v", "a"),
        "derivatives",
        "Derivatives of the residual by q, v and a: three matrices.",
    ),
    "forward_dynamics_jacobian": Signature(
        ("q", "v", "u"),
        "derivatives",
        "Derivatives of the accelerations by q, v and u: three matrices.",
        calls=("forward_dynamics", "residual_jacobian"),
        solves=True,
    ),
    "coriolis_matrix": Signature(("q", "v"), "matrix", "Coriolis matrix C(q, v) with C v = bias and M_dot = C + C^T."),
    "christoffel": Signature(("q",), "tensor", "Christoffel symbols of the first kind, the tensor C of eq. (12)."),
    "kinematics": Signature(
        ("q",),
        "kinematics",
        "Frames [R | X], bodies' origins, coordinates' axes; eqs. (1)-(3).",
    ),
    "energy": Signature(("q", "v"), "pair", "Kinetic energy, eq. (4), and potential energy of gravity and springs."),
    "reactions": Signature(
        ("q", "v", "a"),
        "reactions",
        "Force and moment on each joint's child link, moved joint's axes.",
    ),
    "external_reactions": Signature(
        ("q", "wrench"), "reactions", "What external wrenches add to the reactions, moved joint's axes."
    ),
    **_tangent("external_force", "q", "wrench", writes="vector"),
    **_tangent("energy", "q", "v", writes="pair"),
    **_tangent("reactions", "q", "v", "a", writes="reactions"),
    **_tangent("external_reactions", "q", "wrench", writes="reactions"),
    "euler_cosines": Signature(("q",), "joints", "Cosine of beta of every joint with three angles, 1 for the others."),
    "constraint": Signature(("q",), "constraints", "Constraint g(q) of the cut joints; zero where loops are closed."),
    "constraint_jacobian": Signature(("q",), "constraint_rows", "Jacobian J = dg/dq of the constraint."),
    "constraint_bias": Signature(("q", "v"), "constraints", "J_dot v: g_ddot = J a + J_dot v."),
    "cut_poses": Signature(
        ("q",), "cut_poses", "Per loop the cut frame on its second link seen from that on its first."
    ),
    "spring_forces": Signature(("q", "v"), "spring_pairs", "Per spring between two points its length and tension."),
    "spring_jacobian": Signature(("q",), "spring_rows", "Derivatives of the springs' lengths by q: moment arms."),
    "spring_stiffness": Signature(
        ("q",), "matrix", "What the springs between points stiffen at most: sum of k (dd/dq)^T dd/dq."
    ),
    "rollout": Signature(
        ("q", "v", "u"),
        "vector",
        "Many steps of one integration.",
        calls=("forward_dynamics", "implicit_step"),
        solves=True,
    ),
}

LOOP_KERNELS = ("constraint", "constraint_jacobian", "constraint_bias", "cut_poses")  # of robots with loops alone
SPRING_KERNELS = ("spring_forces", "spring_jacobian", "spring_stiffness")  # of robots with springs between points

PARTS: Mapping[str, Signature] = {  # programs that only other kernels call
    "implicit_step": Signature(
        ("q", "v", "u", "added", "dt"),
        "vector",
        "(M + dt B + dt^2 K + added) a = u - bias - K (q + dt v) - B v: accelerations of a linearly implicit step.",
    ),
}

SIGNATURES: Mapping[str, Signature] = {**KERNELS, **PARTS}


def available(model: Model) -> tuple[str, ...]:
    """Names of the kernels that there are for a model."""
    missing: tuple[str, ...] = () if model.robot.loops else LOOP_KERNELS
    missing += () if model.robot.springs else SPRING_KERNELS
    return tuple(name for name in KERNELS if name not in missing)


def shapes(model: Model) -> dict[str, tuple[int, ...]]:
    """Shape of every array that kernels read and write."""
    n = model.size
    vectors: dict[str, tuple[int, ...]] = dict.fromkeys(("q", "v", "a", "u", "added", "vector"), (n,))
    vectors |= dict.fromkeys(("dq", "dv", "da"), (n,))
    m, loops = len(model.constraints), len(model.robot.loops)
    closing: dict[str, tuple[int, ...]] = {"constraints": (m,), "constraint_rows": (m, n), "cut_poses": (loops, 4, 4)}
    springs = len(model.robot.springs)
    return {
        **vectors,
        **(closing if loops else {}),
        **({"spring_pairs": (springs, 2), "spring_rows": (springs, n)} if springs else {}),
        "wrench": (len(model.links), 6),
        "dwrench": (len(model.links), 6),
        "matrix": (n, n),
        "tensor": (n, n, n),
        "derivatives": (3, n, n),
        "pair": (2,),
        "dt": (2,),
        "joints": (len(model.bodies),),
        "reactions": (len(model.bodies), 6),
        "kinematics": (12 * len(model.frames) + 3 * len(model.bodies) + 3 * n,),
    }
