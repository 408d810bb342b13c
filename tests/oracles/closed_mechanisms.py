"""An independent oracle for mechanisms with loops: rows of the constraint from Pinocchio's frames, a KKT solve.

    M a + h = u + J^T lambda,    J a + bias = 0,

with what the tree's oracle says of M and h (bodies by Pinocchio, laws, motors and springs between points by hand) and
J, bias from velocities and accelerations of the cut joints' frames.  Solved through singular values, so that redundant
rows do no harm: accelerations are unique, multipliers where ``unique`` says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from eomgen.robot.value import Placement, Robot
from tests.oracles.springs import SpringOracle
from tests.support.optional import OptionalModule
from tests.support.random_motors import MotorOracle, without_motors
from tests.support.random_robots import Array

pin = OptionalModule("pinocchio")

# What a cut joint keeps at zero: a coordinate of b's origin in a (0, 1, 2), or the sum of factor (axis i of a) (axis j
# of b) over (factor, i, j).
Row = int | tuple[tuple[float, int, int], ...]
_AXES: tuple[Row, ...] = (((-1.0, 1, 2),), ((1.0, 0, 2),))  # b's z stays a's
_TURN: tuple[Row, ...] = tuple(
    ((0.5, (k + 2) % 3, (k + 1) % 3), (-0.5, (k + 1) % 3, (k + 2) % 3))
    for k in range(3)
)  # fmt: skip
ROWS: Mapping[str, tuple[Row, ...]] = {
    "revolute": (0, 1, 2, *_AXES),
    "prismatic": (0, 1, *_TURN),
    "cylindrical": (0, 1, *_AXES),
    "universal": (0, 1, 2, ((-1.0, 0, 1),)),
    "spherical": (0, 1, 2),
    "planar": (2, *_AXES),
    "fixed": (0, 1, 2, *_TURN),
}
Wrench = Mapping[str, Array]  # link -> force and moment at its centre of mass in base axes, (6,)
NO_WRENCH: Wrench = {}
RANK = 1e-9  # of the greatest singular value: less is zero
SIZES = {"spherical": pin.ContactType.CONTACT_3D, "fixed": pin.ContactType.CONTACT_6D}


@dataclass(frozen=True)
class Closed:
    """Accelerations (n,), multipliers (m,), which of these are unique (m,), wrenches in the cuts (loops, 6).

    Wrenches act on the second links, at the origin and in the axes of the cut frames there: force, moment.
    """

    a: Array
    multipliers: Array
    unique: Array
    reactions: Array


@dataclass(frozen=True)
class _Side:
    """A cut joint's frame in the base: origin, axes (columns), Jacobians (3, n), rates and their drifts (3,)."""

    x: Array
    R: Array
    linear: Array
    angular: Array
    v: Array
    w: Array
    v_dot: Array
    w_dot: Array


class ClosedOracle:
    """A robot with loops; arrays (n,) of one state, SI units."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        bare = replace(robot, loops=(), springs=())
        self.tree = MotorOracle(bare)
        self.springs = SpringOracle(without_motors(replace(robot, loops=()))) if robot.springs else None
        self.bodies = self.tree.bodies.bodies
        self.model = self.bodies.model
        self.frames: list[tuple[int, int]] = []
        for loop in robot.loops:
            pair = [
                self._frame(f"{loop.name} {side}", link, placement)
                for side, link, placement in zip("ab", loop.links, loop.placements, strict=True)
            ]
            self.frames.append((pair[0], pair[1]))
        self.data = self.model.createData()
        self.bodies.data = self.data

    @property
    def free(self) -> Array:
        """Which coordinates are not prescribed."""
        return ~self.tree.given

    def _frame(self, name: str, link: str, placement: Placement) -> int:
        body = self.model.frames[self.bodies.frame_number(link)]
        placed = body.placement * pin.SE3(np.array(placement.rotation), np.array(placement.xyz))
        return int(self.model.addFrame(pin.Frame(name, body.parentJoint, 0, placed, pin.FrameType.OP_FRAME)))

    def _side(self, frame: int) -> _Side:
        world = pin.LOCAL_WORLD_ALIGNED
        J = np.array(pin.getFrameJacobian(self.model, self.data, frame, world)).reshape(6, self.model.nv)
        rate = pin.getFrameVelocity(self.model, self.data, frame, world)
        drift = pin.getFrameClassicalAcceleration(self.model, self.data, frame, world)
        pose, n, own = self.data.oMf[frame], self.tree.n, self.tree.own
        whole = np.zeros((6, n))
        whole[:, own] = J
        return _Side(
            np.array(pose.translation), np.array(pose.rotation), whole[:3], whole[3:],
            np.array(rate.linear), np.array(rate.angular), np.array(drift.linear), np.array(drift.angular),
        )  # fmt: skip

    def sides(self, q: Array, v: Array) -> list[tuple[_Side, _Side]]:
        """Both frames of every cut joint, with the drifts of v."""
        own = self.tree.own
        pin.forwardKinematics(self.model, self.data, q[own], v[own], np.zeros(len(own)))
        pin.computeJointJacobians(self.model, self.data, q[own])
        pin.updateFramePlacements(self.model, self.data)
        return [(self._side(a), self._side(b)) for a, b in self.frames]

    def turn(self, q: Array, v: Array, loop: str) -> tuple[float, float]:
        """Angle and rate of a cut revolute joint: of its second frame against the first, about z."""
        a, b = self.sides(q, v)[[one.name for one in self.robot.loops].index(loop)]
        R = a.R.T @ b.R
        return float(np.arctan2(R[1, 0], R[0, 0])), float(a.R[:, 2] @ (b.w - a.w))

    def constraint(self, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """g (m,), J (m, n) and the bias J_dot v (m,)."""
        g, J, bias = [], [], []
        for loop, (a, b) in zip(self.robot.loops, self.sides(q, v), strict=True):
            for row in ROWS[loop.type]:
                found = _point_row(a, b, row) if isinstance(row, int) else _angle_row(a, b, row)
                for values, value in zip((g, J, bias), found, strict=True):
                    values.append(value)
        return np.array(g), np.array(J), np.array(bias)

    def forces(self, q: Array, v: Array, a: Array, wrench: Wrench = NO_WRENCH) -> Array:
        """What the tree's motion takes: M a + h."""
        found = self.tree.inverse_dynamics(q, v, a)
        if wrench:
            found = found - self.tree.spread(self.bodies.external_force(q[self.tree.own], self._by_link(wrench)))
        if self.springs is not None:
            own = self.tree.own
            found = found - self.tree.spread(self.springs.external(q[own], v[own]))
        return np.asarray(found)

    def _by_link(self, wrench: Wrench) -> Array:
        return np.array([wrench.get(name, np.zeros(6)) for name in self.bodies.links])

    def solve(self, q: Array, v: Array, u: Array, wrench: Wrench = NO_WRENCH) -> Closed:
        """Motion under the drives u and wrenches on links; in u a prescribed coordinate has its acceleration."""
        _, J, bias = self.constraint(q, v)
        free, M = self.free, self.tree.mass_matrix(q)
        a = np.where(free, 0.0, u)
        right = np.concatenate([(u - self.forces(q, v, a, wrench))[free], -bias - J @ a])
        root = np.sqrt(np.diag(M)[free])  # rows and columns of like size
        M, Jf = M[np.ix_(free, free)] / np.outer(root, root), J[:, free] / root
        size, m = Jf.shape[1], len(Jf)
        right[:size] /= root
        whole = np.block([[M, -Jf.T], [Jf, np.zeros((m, m))]])
        U, S, Vt = np.linalg.svd(whole)
        kept = S / S[0] > RANK
        inverse = (Vt[kept].T / S[kept]) @ U[:, kept].T
        x = inverse @ right
        x += inverse @ (right - whole @ x)  # one refinement
        a[free] = x[:size] / root
        left = Vt[~kept][:, size:]
        unique = (left * left).sum(axis=0) < 1e-12
        return Closed(a, x[size:], unique, self._wrenches(q, v, x[size:]))

    def _wrenches(self, q: Array, v: Array, multipliers: Array) -> Array:
        """What the cuts exert on their second links."""
        result, values = np.zeros((len(self.frames), 6)), iter(multipliers)
        for wrench, loop, (a, b) in zip(result, self.robot.loops, self.sides(q, v), strict=True):
            for row in ROWS[loop.type]:
                value = next(values)
                if isinstance(row, int):
                    wrench[:3] += value * b.R.T @ a.R[:, row]
                else:
                    for factor, i, j in row:
                        wrench[3:] += value * factor * b.R.T @ np.cross(b.R[:, j], a.R[:, i])
        return result

    def reactions(self, q: Array, v: Array, found: Closed, wrench: Wrench = NO_WRENCH) -> Array:
        """(joints that move, 6): what each exerts on its child, force then moment, in axes and at the origin behind it.

        Unique where the multipliers of all loops around it are.
        """
        own, data = self.tree.own, self.data
        wrenches = [pin.Force.Zero() for _ in range(self.model.njoints)]
        for one, (_, b), (first, second) in zip(found.reactions, self.sides(q, v), self.frames, strict=True):
            force = b.R @ one[:3]
            in_base = pin.Force(force, b.R @ one[3:] + np.cross(b.x, force))
            for frame, sign in ((first, -1.0), (second, 1.0)):
                at = self.model.frames[frame].parentJoint
                wrenches[at] = wrenches[at] + data.oMi[at].actInv(sign * in_base)
        if self.springs is not None:
            wrenches = [x + y for x, y in zip(wrenches, self.springs.wrenches(q[own], v[own]), strict=True)]
        for name, (at, com) in self.bodies.coms.items():
            given, R = wrench.get(name, np.zeros(6)), data.oMi[at].rotation.T
            wrenches[at] = wrenches[at] + pin.SE3(np.eye(3), com).act(pin.Force(R @ given[:3], R @ given[3:]))
        pin.rnea(self.model, data, q[own], v[own], found.a[own], wrenches)
        joints = [joint for joint in self.robot.joints if joint.coordinates]
        rows = []
        for at, joint in zip(self.bodies.last, joints, strict=True):
            body = self.model.frames[self.bodies.frame_number(joint.child)]
            behind = body.placement * pin.SE3(np.array(joint.axis_turn), np.zeros(3))
            rows.append(behind.actInv(data.f[at]).vector)
        return np.array(rows)

    def by_pinocchio(self, q: Array, v: Array, u: Array) -> tuple[Array, Array]:
        """Accelerations and wrenches by Pinocchio's constraintDynamics: cuts spherical or fixed, nothing prescribed.

        Wrenches like those of ``Closed``; the frames of a spherical cut may be turned.  No motors, no springs between
        points.
        """
        cuts, kept = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for loop, pair in zip(self.robot.loops, self.frames, strict=True):
            sides = [x for i in pair for x in (self.model.frames[i].parentJoint, self.model.frames[i].placement)]
            cuts.append(pin.RigidConstraintModel(SIZES[loop.type], self.model, *sides, pin.ReferenceFrame.LOCAL))
            kept.append(cuts[len(cuts) - 1].createData())
        model = pin.Model(self.model)
        model.armature = self.bodies.armature
        data = model.createData()
        pin.initConstraintDynamics(model, data, cuts, kept)
        settings = pin.ProximalSettings(1e-14, 1e-14, 1e-10, 20)
        still = np.zeros(len(q))
        drives = u - (self.forces(q, v, still) - self.bodies.inverse_dynamics(q, v, still)) - self.bodies.damping * v
        a = np.array(pin.constraintDynamics(model, data, q, v, drives, cuts, kept, settings))
        wrenches = []
        for one, (first, second) in zip(kept, self.sides(q, v), strict=True):
            turn = second.R.T @ first.R
            found = -np.array(one.contact_force.vector)
            wrenches.append(np.concatenate([turn @ found[:3], turn @ found[3:]]))
        return a, np.array(wrenches)


def _point_row(a: _Side, b: _Side, axis: int) -> tuple[float, Array, float]:
    """Value, gradient and drift of a coordinate of b's origin, seen from the turning a."""
    d, e = b.x - a.x, a.R[:, axis]
    across = np.cross(d, e)  # e (w x d) = w (d x e)
    rate = b.v - a.v - np.cross(a.w, d)
    drift = b.v_dot - a.v_dot - np.cross(a.w_dot, d) - 2.0 * np.cross(a.w, rate) - np.cross(a.w, np.cross(a.w, d))
    return float(e @ d), e @ (b.linear - a.linear) - across @ a.angular, float(e @ drift)


def _angle_row(a: _Side, b: _Side, row: tuple[tuple[float, int, int], ...]) -> tuple[float, Array, float]:
    """Value, gradient and drift of a sum of products of axes."""
    g, J, bias = 0.0, np.zeros(a.angular.shape[1]), 0.0
    for factor, i, j in row:
        x, y = a.R[:, i], b.R[:, j]
        normal = np.cross(y, x)
        moving = np.cross(np.cross(b.w, y), x) + np.cross(y, np.cross(a.w, x))
        g += factor * float(x @ y)
        J += factor * normal @ (b.angular - a.angular)
        bias += factor * float(normal @ (b.w_dot - a.w_dot) + moving @ (b.w - a.w))
    return g, J, bias
