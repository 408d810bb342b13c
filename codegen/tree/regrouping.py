"""Move to the parent what a joint's motion leaves unchanged (theory: mass on a joint's axis).

For a revolute joint the block {z, 1} x {z, 1} of the pseudo-inertia (J_zz, mc_z, m) may be carried by either link; in
general the block of those axes that every rotation of the joint leaves alone, without the row of 1 if the joint also
translates.  Residual and mass matrix do not change, reactions do: kernels that report reactions use the original.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from eomgen.robot.geometry import JointStep
from eomgen.robot.model import FIXED_BODY, Model

from ..joint.facts import facts_of
from .bound import Bound
from .spatial import PseudoInertia, add, congruence, mat3, vec3


def regroup(model: Model, bound: Bound) -> Bound:
    """Move every movable block of a pseudo-inertia towards the base."""
    inertias = [body.inertia for body in bound.bodies]
    at_rest, nodes = bound.at_rest, model.robot.nodes
    for k in range(len(inertias) - 1, -1, -1):
        body = model.bodies[k]
        if body.parent != FIXED_BODY and model.bodies[body.parent].joint in nodes:
            continue  # of a link that bends: what stands there has no inertia that could take it in
        moved, inertias[k] = split(inertias[k], facts_of(model, body.active).steps)
        moved = congruence(bound.bodies[k].placement, moved)
        if body.parent != FIXED_BODY:
            inertias[body.parent] = inertias[body.parent] + moved
        else:
            at_rest = add(at_rest, moved.first)
    bodies = tuple(replace(b, inertia=h) for b, h in zip(bound.bodies, inertias, strict=True))
    return replace(bound, bodies=bodies, at_rest=at_rest)


def split(H: PseudoInertia, steps: Sequence[JointStep]) -> tuple[PseudoInertia, PseudoInertia]:
    """Split H into what may move to the parent and what stays, for a joint of these elementary transforms."""
    axes = {0, 1, 2}.intersection(*({step.axis} for step in steps if step.is_rotation))
    with_mass = all(step.is_rotation for step in steps)

    def parts(inside: bool) -> PseudoInertia:
        second = mat3([H.second[i][j] if ({i, j} <= axes) == inside else 0.0 for j in range(3)] for i in range(3))
        first = vec3(H.first[i] if (i in axes and with_mass) == inside else 0.0 for i in range(3))
        return PseudoInertia(second, first, H.mass if with_mass == inside else 0.0)

    return parts(True), parts(False)
