"""Mass matrix and Coriolis matrix from composite pseudo-inertias, eqs. (11) and (12) contracted as they arise.

M_sv = tr(D_s Hc D_v^T) and C_sv = tr(D_s (Hc N_v^T + Gc V_v^T)), with Hc = sum H_k and Gc = sum H_k W_k^T over the
bodies that the deeper of the two coordinates moves, N_v = dV_v/dt the rate of the tangent V_v.  Both sums are carried
from the tips to the base by the congruence X H X^T.  C is the Christoffel one: M_dot = C + C^T, C v = bias.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from eomgen.robot.geometry import IDENTITY
from eomgen.robot.model import FIXED_BODY

from .frozen_joints import JointGeometry, PosedTree, Rotation, unit
from .modal import Bent
from .recursion import Velocity, Wrench, rotational_inertia, through_joint_back, velocities
from .spatial import (
    ZERO,
    Mat,
    Pose,
    PseudoInertia,
    Scalar,
    Vec,
    add,
    congruence,
    cross,
    dot,
    mat3,
    matmul,
    matvec,
    scale,
    sum_mat,
    trace,
    transpose,
)

Rows = dict[tuple[int, int], Scalar]


def mass_matrix(tree: PosedTree) -> Rows:
    """Compute M: entries (i, j) with i <= j; an absent pair is identically zero."""
    rows: Rows = {}
    composite = [body.inertia for body in tree.bound.bodies]
    whole = _whole_rotations(tree)
    for k in range(len(tree.model.bodies) - 1, -1, -1):
        tree.note(f"{tree.model.bodies[k].joint}: columns of M from the composite pseudo-inertia, eq. (11)")
        bent = tree.bound.bodies[k].bent
        if bent is not None:
            _read_modes(tree, whole, k, bent, rows)
        columns, at_joint = _columns(composite[k], tree.joints[k])
        for index, wrench in columns:
            _read_column(tree, whole, k, index, wrench, rows)
        if len(tree.joints[k].translations) > 1:
            _read_translations(tree, k, at_joint, rows)
        parent = tree.model.bodies[k].parent
        if parent != FIXED_BODY:
            composite[parent] = composite[parent] + to_parent(at_joint, tree.joints[k])
    for index, c in enumerate(tree.bound.armature):
        rows[index, index] = rows.get((index, index), 0.0) + c
    return rows


def _read_modes(tree: PosedTree, whole: Mapping[int, Mat], k: int, bent: Bent, rows: Rows) -> None:
    """Read columns of a body's modes: what their unit accelerations need of its joint and of those in front of it."""
    for i, j, mass in bent.masses():
        rows[i, j] = mass
    for index, G in zip(bent.indices, bent.G, strict=True):
        read: list[Scalar] = [None] * tree.model.size
        wrench, body = Wrench(G.row, G.about()), k
        while body != FIXED_BODY:
            wrench = through_joint_back(wrench, tree.joints[body], read, whole.get(body) if body != k else None)
            body = tree.model.bodies[body].parent
        rows.update({(row, index): value for row, value in enumerate(read) if value is not None})


def _columns(H: PseudoInertia, joint: JointGeometry) -> tuple[list[tuple[int, Wrench]], PseudoInertia]:
    """Return the wrench of a coordinate's unit acceleration, in the axes in front of it; H in the joint's axes.

    A rotation leaves its axis alone, so its column is read from H in front of it: one rotation less per column.
    The moment of inertia about that axis is taken behind it, where the base joint needs nothing else.  Several
    translations are left to ``_read_translations``.
    """
    columns = []
    for turn in reversed(joint.rotations):
        about_axis = rotational_inertia(H, unit(turn.axis))[turn.axis]
        H = rotated(turn, H)
        axis = unit(turn.axis)
        moment = list(rotational_inertia(H, axis))
        moment[turn.axis] = about_axis
        columns.append((turn.index, Wrench(cross(axis, H.first), (moment[0], moment[1], moment[2]))))
    if len(joint.translations) == 1:
        ((index, number),) = joint.translations
        columns.append((index, Wrench(scale(H.mass, unit(number)), cross(H.first, unit(number)))))
    return columns, H


def _read_column(tree: PosedTree, whole: Mapping[int, Mat], k: int, index: int, wrench: Wrench, rows: Rows) -> None:
    """Read the entries of one column: in its joint from where it stands, then towards the base."""
    read: list[Scalar] = [None] * tree.model.size
    wrench = through_joint_back(wrench, front(tree.joints[k], index), read)
    parent = tree.model.bodies[k].parent
    while parent != FIXED_BODY:
        wrench = through_joint_back(wrench, tree.joints[parent], read, whole.get(parent))
        parent = tree.model.bodies[parent].parent
    for row, value in enumerate(read):
        if value is not None and (row <= index):
            rows[row, index] = value


def _read_translations(tree: PosedTree, k: int, H: PseudoInertia, rows: Rows) -> None:
    """Read columns of a joint's translations: force m e, moment mc x e; e and mc alone move through the joints.

    H is that in the joint's axes.
    """
    axes = [(index, unit(axis)) for index, axis in tree.joints[k].translations]
    first, body = H.first, k
    for index, e in axes:
        rows.update({(row, index): H.mass * e[axis] for row, axis in tree.joints[k].translations if row <= index})
    while axes and tree.model.bodies[body].parent != FIXED_BODY:
        turn, offset, body = tree.joints[body].turn, tree.joints[body].offset, tree.model.bodies[body].parent
        axes = [(index, matvec(turn, e)) for index, e in axes]
        first = add(matvec(turn, first), scale(H.mass, offset))
        for step in reversed(tree.joints[body].rotations):
            rows.update({(step.index, index): cross(first, e)[step.axis] for index, e in axes})
            axes = [(index, matvec(step.matrix, e)) for index, e in axes]
            first = matvec(step.matrix, first)
        for index, e in axes:
            rows.update({(row, index): H.mass * e[axis] for row, axis in tree.joints[body].translations})


def _whole_rotations(tree: PosedTree) -> dict[int, Mat]:
    """Multiply a joint's three rotations, where enough columns pass to make it worth its 14 products."""
    behind = [0] * len(tree.joints)
    for k in range(len(tree.joints) - 1, -1, -1):
        parent = tree.model.bodies[k].parent
        if parent != FIXED_BODY:
            behind[parent] += behind[k] + len(tree.joints[k].rotations)
    product: dict[int, Mat] = {}
    for k, joint in enumerate(tree.joints):
        if len(joint.rotations) == 3 and behind[k] > 5:
            one, two, three = (turn.matrix for turn in joint.rotations)
            product[k] = matmul(matmul(one, two), three)
    return product


def front(joint: JointGeometry, index: int) -> JointGeometry:
    """Return the joint's steps up to and with the coordinate, without the coordinate's rotation."""
    rotations = tuple(
        Rotation(turn.index, turn.axis, 0.0, 1.0, IDENTITY) if turn.index == index else turn
        for turn in joint.rotations
        if turn.index <= index
    )
    return JointGeometry(joint.turn, joint.offset, joint.translations, rotations)


def rotated(turn: Rotation, H: PseudoInertia) -> PseudoInertia:
    """Return X H X^T for one rotation about an axis."""
    return PseudoInertia(rotated_block(turn, H.second), matvec(turn.matrix, H.first), H.mass)


def rotated_block(turn: Rotation, S: Mat) -> Mat:
    """Return R S R^T for one rotation about an axis: 8 products for a symmetric S, 12 for any, instead of 54."""
    a, b, axis = (turn.axis + 1) % 3, (turn.axis + 2) % 3, turn.axis
    s, c = turn.sin, turn.cos
    # the difference of the diagonal and the sum beside it turn by twice the angle, all else is left alone
    t = s * (S[a][a] - S[b][b]) + c * (S[a][b] + S[b][a])
    entries: dict[tuple[int, int], Scalar] = {
        (a, a): S[a][a] - s * t,
        (b, b): S[b][b] + s * t,
        (a, b): c * t - S[b][a],
        (b, a): c * t - S[a][b],
        (axis, axis): S[axis][axis],
        (a, axis): c * S[a][axis] - s * S[b][axis],
        (b, axis): s * S[a][axis] + c * S[b][axis],
        (axis, a): c * S[axis][a] - s * S[axis][b],
        (axis, b): s * S[axis][a] + c * S[axis][b],
    }
    return mat3([entries[i, j] for j in range(3)] for i in range(3))


def _about_one_axis(R: Mat) -> Rotation | None:
    """Return a constant rotation as one about an axis, where it is one; else None."""
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        if all(R[axis][j] == (j == axis) and R[j][axis] == (j == axis) for j in range(3)):
            return Rotation(-1, axis, R[b][a], R[a][a], R)
    return None


def to_parent(H: PseudoInertia, joint: JointGeometry) -> PseudoInertia:
    """Return X H X^T from the joint's axes (translations included) to the parent body."""
    return shifted(turned(joint.turn, H), joint.offset)


def turned(R: Mat, H: PseudoInertia) -> PseudoInertia:
    """Return X H X^T for a constant rotation, elementary where it is about one axis."""
    turn = _about_one_axis(R)
    return congruence(Pose(R, ZERO), H) if turn is None else rotated(turn, H)


def shifted(H: PseudoInertia, p: Vec) -> PseudoInertia:
    """Return X H X^T for a translation by p: J + p h^T + h' p^T with h' = h + m p."""
    h, J = H.first, H.second
    moved = add(h, scale(H.mass, p))
    entries = {}
    for i in range(3):
        entries[i, i] = J[i][i] + p[i] * (h[i] + moved[i])
        for j in range(i + 1, 3):
            entries[i, j] = entries[j, i] = J[i][j] + p[i] * h[j] + moved[i] * p[j]
    return PseudoInertia(mat3([entries[i, j] for j in range(3)] for i in range(3)), moved, H.mass)


@dataclass(frozen=True)
class Momentum:
    """G = sum H W^T = [[block, 0], [linear^T, 0]]: the entries of H W^T that do not vanish."""

    block: Mat
    linear: Vec

    def __add__(self, other: Momentum) -> Momentum:
        return Momentum(sum_mat(self.block, other.block), add(self.linear, other.linear))


def momentum(H: PseudoInertia, W: Velocity) -> Momentum:
    """Return H W^T of one body: rows J_i x-skewed by w plus mc_i v, and the linear momentum."""
    block = mat3(add(cross(W.rate, H.second[i]), scale(H.first[i], W.origin)) for i in range(3))
    return Momentum(block, add(cross(W.rate, H.first), scale(H.mass, W.origin)))


def rotated_momentum(turn: Rotation, G: Momentum) -> Momentum:
    """Return G in the axes in front of a rotation."""
    return Momentum(rotated_block(turn, G.block), matvec(turn.matrix, G.linear))


def momentum_to_parent(G: Momentum, joint: JointGeometry) -> Momentum:
    """Move G from the joint's axes (translations included) to the parent body."""
    R, p, turn = joint.turn, joint.offset, _about_one_axis(joint.turn)
    block = matmul(matmul(R, G.block), transpose(R)) if turn is None else rotated_block(turn, G.block)
    linear = matvec(R, G.linear)
    return Momentum(mat3(add(block[i], scale(p[i], linear)) for i in range(3)), linear)


@dataclass(frozen=True)
class _Coordinate:
    """Contribution of coordinate v to C, in the axes in front of it.

    ``column`` is the wrench of Hc N_v^T + Gc D_v^T (read by rows above), ``row`` the wrench of D_v Hc and ``couple``
    the moment of D_v Gc (read against tangents above).
    """

    column: Wrench
    row: Wrench
    couple: Vec


def coriolis_matrix(tree: PosedTree, v: Sequence[Scalar]) -> Rows:
    """Compute C: entries (i, j); an absent pair is identically zero."""
    entries: Rows = {}
    speed = velocities(tree, v)
    composite = [body.inertia for body in tree.bound.bodies]
    momenta = [momentum(H, W) for H, (_, W) in zip(composite, speed, strict=True)]
    for k in range(len(tree.model.bodies) - 1, -1, -1):
        tree.note(f"{tree.model.bodies[k].joint}: columns and rows of C, eq. (12) contracted with the velocity")
        contributions, H, G = _contributions(composite[k], momenta[k], tree.joints[k], speed[k][0])
        for index, contribution in contributions:
            _read_coordinate(tree, speed, k, index, contribution, entries)
        parent = tree.model.bodies[k].parent
        if parent != FIXED_BODY:
            composite[parent] = composite[parent] + to_parent(H, tree.joints[k])
            momenta[parent] = momenta[parent] + momentum_to_parent(G, tree.joints[k])
    return entries


def _contributions(
    H: PseudoInertia, G: Momentum, joint: JointGeometry, before: Sequence[Velocity]
) -> tuple[list[tuple[int, _Coordinate]], PseudoInertia, Momentum]:
    contributions = []
    for turn, W in reversed(list(zip(joint.rotations, before, strict=False))):
        H, G = rotated(turn, H), rotated_momentum(turn, G)
        e, spin = unit(turn.axis), trace(G.block)
        rate, shift = cross(W.rate, e), cross(W.origin, e)  # N_v = [W, D_v]
        moment = add(rotational_inertia(H, rate), cross(H.first, shift))
        moment = add(moment, add(scale(spin, e), scale(-1.0, matvec(transpose(G.block), e))))
        force = add(add(cross(rate, H.first), scale(H.mass, shift)), cross(e, G.linear))
        row = Wrench(cross(e, H.first), rotational_inertia(H, e))
        couple = add(scale(spin, e), scale(-1.0, matvec(G.block, e)))
        contributions.append((turn.index, _Coordinate(Wrench(force, moment), row, couple)))
    for index, axis in joint.translations:
        e = unit(axis)
        shift = cross(before[0].rate, e)
        column = Wrench(scale(H.mass, shift), cross(H.first, shift))
        row = Wrench(scale(H.mass, e), cross(H.first, e))
        contributions.append((index, _Coordinate(column, row, cross(G.linear, e))))
    return contributions, H, G


def _read_coordinate(
    tree: PosedTree,
    speed: Sequence[tuple[tuple[Velocity, ...], Velocity]],
    k: int,
    index: int,
    contribution: _Coordinate,
    entries: Rows,
) -> None:
    """Read column ``index`` of C at and above coordinate ``index``, and row ``index`` above it."""
    read, ignored = ([None] * tree.model.size for _ in range(2))
    column, row, couple = contribution.column, contribution.row, contribution.couple
    joint, body = front(tree.joints[k], index), k
    while True:
        couple, values = _read_against_rates(row, couple, joint, speed[body][0])
        for other, value in values.items():
            if other < index:
                entries[index, other] = value
        column = through_joint_back(column, joint, read)
        row = through_joint_back(row, joint, ignored)
        body = tree.model.bodies[body].parent
        if body == FIXED_BODY:
            break
        joint = tree.joints[body]
    for other, value in enumerate(read):
        if value is not None and other <= index:
            entries[other, index] = value


def _read_against_rates(
    row: Wrench, couple: Vec, joint: JointGeometry, before: Sequence[Velocity]
) -> tuple[Vec, dict[int, Scalar]]:
    """Read tr(D_s (Hc N_v^T + Gc V_v^T)) for every v of a joint above s; return the couple in the parent's axes."""
    values: dict[int, Scalar] = {}
    force, moment = row.force, row.moment
    for turn, W in reversed(list(zip(joint.rotations, before, strict=False))):
        force, moment, couple = (matvec(turn.matrix, x) for x in (force, moment, couple))
        e = unit(turn.axis)
        values[turn.index] = dot(moment, cross(W.rate, e)) + dot(force, cross(W.origin, e)) + dot(couple, e)
    for index, axis in joint.translations:
        values[index] = dot(force, cross(before[0].rate, unit(axis)))
    return matvec(joint.turn, couple), values
