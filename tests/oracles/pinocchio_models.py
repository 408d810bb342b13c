"""An independent oracle: Pinocchio, with every joint as a chain of joints of one coordinate.

Pinocchio's own composite joints are avoided: their Coriolis matrix is wrong.  The chain has no bodies in between, and
its coordinates are in the order of the robot's.  Springs and dampers are added by hand.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.pinocchio_peer import coordinate_joints
from eomgen.robot.value import COORDINATES, LINEAR, Joint, Placement, Robot
from tests.support.optional import OptionalModule

pin = OptionalModule("pinocchio")

Array = NDArray[np.float64]


class PinocchioOracle:
    """The robot in Pinocchio: arrays (n,) of one state, in the robot's coordinates, SI units.

    ``links`` are the links that move; ``last`` is Pinocchio's last joint of each joint that moves; ``coms``
    has Pinocchio's joint and the centre of mass in it of each of these links.
    """

    def __init__(self, robot: Robot) -> None:
        self.model, kinds = pin.Model(), coordinate_joints()
        self.model.gravity.linear = np.array(robot.gravity)
        self.last: list[int] = []
        self.links: list[str] = []
        self.coms: dict[str, tuple[int, Array]] = {}
        where = {robot.base: (0, pin.SE3.Identity())}  # link -> (Pinocchio's joint, the link's pose in it)
        for joint in robot.joints:
            at, pose = where[joint.parent]
            turn = pin.SE3(np.array(joint.axis_turn), np.zeros(3))
            pose = pose * _pose(joint.placement)
            pose = pose * turn
            for name, offset in zip(COORDINATES, joint.offset, strict=True):
                if name in joint.coordinates and f"{joint.name}.{name}" not in robot.followers:
                    at = self.model.addJoint(at, _joint_model(joint, name, kinds), pose, f"{joint.name}.{name}")
                    pose = pin.SE3.Identity()
                pose = pose * _elementary(name, offset or 0.0)
            pose = pose * turn.inverse()
            if joint.coordinates:
                self.last.append(at)
            where[joint.child] = (at, pose)
            self._add_link(robot, joint.child, at, pose)
        for name, (at, pose) in where.items():
            self.model.addFrame(pin.Frame(name, at, 0, pose, pin.FrameType.BODY))
        for frame in robot.frames:
            at, pose = where[frame.link]
            pose = pose * _pose(frame.placement)
            self.model.addFrame(pin.Frame(f"frame {frame.name}", at, 0, pose, pin.FrameType.OP_FRAME))
        given = [coordinate for name, coordinate in robot.coordinates.items() if name not in robot.followers]
        self.stiffness, self.damping, self.armature = (
            np.array([getattr(coordinate, key) or 0.0 for coordinate in given])
            for key in ("stiffness", "damping", "armature")
        )
        self.data = self.model.createData()

    def _add_link(self, robot: Robot, name: str, at: int, pose: pin.SE3) -> None:
        if at == 0:
            return
        link = robot.link(name)
        xx, yy, zz, xy, xz, yz = link.inertia
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        self.model.appendBodyToJoint(at, pin.Inertia(link.mass, np.array(link.com), tensor), pose)
        self.coms[name] = (at, pose * np.array(link.com))
        self.links.append(name)

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        tau = pin.rnea(self.model, self.data, q, v, a)
        return np.asarray(tau + self.armature * a + self.stiffness * q + self.damping * v)

    def mass_matrix(self, q: Array) -> Array:
        upper = np.triu(pin.crba(self.model, self.data, q))
        return np.asarray(upper + np.triu(upper, 1).T + np.diag(self.armature))

    def bias_force(self, q: Array, v: Array) -> Array:
        still = np.zeros(len(q))
        return np.asarray(
            pin.nonLinearEffects(self.model, self.data, q, v) - pin.rnea(self.model, self.data, q, still, still)
        )

    def weights(self, q: Array) -> Array:
        """Drives that hold the robot against gravity alone, without its springs."""
        return np.array(pin.computeGeneralizedGravity(self.model, self.data, q))

    def generalized_force(self, q: Array, v: Array) -> Array:
        return np.asarray(-self.weights(q) - self.stiffness * q - self.damping * v)

    def forward_dynamics(self, q: Array, v: Array, u: Array) -> Array:
        """By the articulated body algorithm."""
        self.model.armature = self.armature
        try:
            return np.array(pin.aba(self.model, self.data, q, v, u - self.stiffness * q - self.damping * v))
        finally:
            self.model.armature = np.zeros(len(q))

    def nonlinear_effects(self, q: Array, v: Array) -> Array:
        return np.array(pin.nonLinearEffects(self.model, self.data, q, v))

    def center_of_mass(self, q: Array) -> Array:
        return np.array(pin.centerOfMass(self.model, self.data, q))

    def centroidal_momentum(self, q: Array, v: Array) -> Array:
        return np.array(pin.computeCentroidalMomentum(self.model, self.data, q, v).vector)

    def coriolis_matrix(self, q: Array, v: Array) -> Array:
        return np.array(pin.computeCoriolisMatrix(self.model, self.data, q, v))

    def energy(self, q: Array, v: Array) -> Array:
        kinetic = pin.computeKineticEnergy(self.model, self.data, q, v) + self.armature @ (v * v) / 2
        potential = pin.computePotentialEnergy(self.model, self.data, q) + self.stiffness @ (q * q) / 2
        return np.array([kinetic, potential])

    def frame_pose(self, q: Array, name: str) -> Array:
        pin.framesForwardKinematics(self.model, self.data, q)
        return np.array(self.data.oMf[self.frame_number(name)].homogeneous)

    def frame_jacobian(self, q: Array, name: str) -> Array:
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        return np.array(pin.getFrameJacobian(self.model, self.data, self.frame_number(name), pin.LOCAL_WORLD_ALIGNED))

    def frame_velocity(self, q: Array, v: Array, name: str, reference: str) -> Array:
        pin.forwardKinematics(self.model, self.data, q, v)
        axes = getattr(pin, reference)
        return np.array(pin.getFrameVelocity(self.model, self.data, self.frame_number(name), axes).vector)

    def frame_acceleration(self, q: Array, v: Array, a: Array, name: str, reference: str) -> Array:
        """The classical one, or in WORLD the spatial one."""
        pin.forwardKinematics(self.model, self.data, q, v, a)
        find = pin.getFrameAcceleration if reference == "WORLD" else pin.getFrameClassicalAcceleration
        return np.array(find(self.model, self.data, self.frame_number(name), getattr(pin, reference)).vector)

    def frame_number(self, name: str) -> int:
        """A frame of the description, or a link."""
        known = [frame.name for frame in self.model.frames]
        return known.index(f"frame {name}" if f"frame {name}" in known else name)

    def reactions(self, q: Array, v: Array, a: Array) -> Array:
        """(joints, 6): what every joint exerts on its child, force then moment, in axes and at the origin behind it."""
        pin.rnea(self.model, self.data, q, v, a)
        return np.array([self.data.f[at].vector for at in self.last])

    def reactions_with(self, q: Array, v: Array, a: Array, wrench: Array) -> Array:
        """``reactions`` under external wrenches (links, 6) at the centres of mass, base axes."""
        forces = [pin.Force.Zero() for _ in self.model.joints]
        pin.forwardKinematics(self.model, self.data, q)
        for name, given in zip(self.links, wrench, strict=True):
            at, com = self.coms[name]
            R = self.data.oMi[at].rotation.T
            forces[at] += pin.SE3(np.eye(3), com).act(pin.Force(R @ given[:3], R @ given[3:]))
        pin.rnea(self.model, self.data, q, v, a, forces)
        return np.array([self.data.f[at].vector for at in self.last])

    def external_force(self, q: Array, wrench: Array) -> Array:
        """J^T w at the centres of mass; wrench (links, 6), base axes."""
        result = np.zeros(len(q))
        pin.computeJointJacobians(self.model, self.data, q)
        for name, given in zip(self.links, wrench, strict=True):
            at, com = self.coms[name]
            placed = pin.SE3(np.eye(3), com)
            J = pin.getFrameJacobian(self.model, self.data, at, placed, pin.LOCAL_WORLD_ALIGNED)
            result += J.T @ given
        return result


def _joint_model(joint: Joint, name: str, kinds: Mapping[str, Any]) -> Any:
    """A joint of one coordinate; of a screw the helical one, m per radian."""
    if joint.pitch is None or name != joint.principal:
        return kinds[name]()
    return pin.JointModelHelicalUnaligned(0.0, 0.0, 1.0, joint.pitch / (2 * np.pi))


def _elementary(name: str, value: float) -> pin.SE3:
    """A translation along, or a rotation about, a coordinate's axis."""
    axis = np.eye(3)[COORDINATES.index(name) % 3]
    if name in LINEAR:
        return pin.SE3(np.eye(3), value * axis)
    return pin.SE3(pin.AngleAxis(value, axis).toRotationMatrix(), np.zeros(3))


class UrdfOracle:
    """Pinocchio's own reading of a URDF whose joints have one coordinate each; arrays in eomgen's coordinates."""

    def __init__(self, path: Path) -> None:
        self.model = pin.buildModelFromUrdf(str(path))
        self.data = self.model.createData()
        self.joints = [re.sub("[^A-Za-z0-9_]", "_", name) for name in list(self.model.names)[1:]]
        assert all(joint.nv == 1 for joint in list(self.model.joints)[1:])

    def configuration(self, q: Array) -> Array:
        """Pinocchio's configuration: (cos, sin) for a joint without limits."""
        result = pin.neutral(self.model)
        for value, joint in zip(q, list(self.model.joints)[1:], strict=True):
            result[joint.idx_q : joint.idx_q + joint.nq] = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        return np.asarray(result)

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        return np.array(pin.rnea(self.model, self.data, self.configuration(q), v, a))

    def mass_matrix(self, q: Array) -> Array:
        upper = np.triu(pin.crba(self.model, self.data, self.configuration(q)))
        return np.asarray(upper + np.triu(upper, 1).T)

    def forward_dynamics(self, q: Array, v: Array, u: Array) -> Array:
        return np.array(pin.aba(self.model, self.data, self.configuration(q), v, u))

    def reactions(self, q: Array, v: Array, a: Array) -> Array:
        """(joints, 6), in link axes at the joint's origin."""
        pin.rnea(self.model, self.data, self.configuration(q), v, a)
        return np.array([force.vector for force in list(self.data.f)[1:]])


def _pose(placement: Placement) -> pin.SE3:
    return pin.SE3(np.array(placement.rotation), np.array(placement.xyz))


def numerical_tangents(oracle: PinocchioOracle, q: Array, wrench: Array, frame: str) -> tuple[Array, Array, Array]:
    """K (with the dead wrench's geometric part) and D by central differences of Pinocchio's forces, and its M."""
    zero, h = np.zeros(len(q)), 1e-5

    def force(at: Array, v: Array) -> Array:
        return oracle.inverse_dynamics(at, v, zero) - oracle.frame_jacobian(at, frame).T @ wrench

    K = np.array([(force(q + h * e, zero) - force(q - h * e, zero)) / (2 * h) for e in np.eye(len(q))]).T
    D = np.array([(force(q, h * e) - force(q, -h * e)) / (2 * h) for e in np.eye(len(q))]).T
    return K, D, oracle.mass_matrix(q)
