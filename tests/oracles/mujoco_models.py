"""MuJoCo as an independent oracle: the same robot as an MJCF model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eomgen.export.mujoco import mjcf
from eomgen.robot.value import Robot
from tests.support.optional import OptionalModule

mujoco = OptionalModule("mujoco")

Array = NDArray[np.float64]


class MujocoRobot:
    """A robot in MuJoCo: no contacts, no limits, coordinates in the same order as the robot's."""

    def __init__(self, robot: Robot, step: float = 1e-3, approximate: bool = False) -> None:
        self.model = mujoco.MjModel.from_xml_string(mjcf(robot, step, approximate=approximate))
        self.data = mujoco.MjData(self.model)
        expected = [f"{joint.name}.{name}" for joint in robot.joints for name in joint.all_coordinates]
        found = [self.model.joint(i).name for i in range(self.model.njnt)]
        assert found == expected, "MuJoCo orders the coordinates otherwise"
        moving = [joint for joint in robot.joints if joint.coordinates]
        self._moved = [(self.model.body(joint.child).id, np.array(joint.axis_turn)) for joint in moving]

    def set_state(self, q: Array, v: Array) -> None:
        self.data.qpos[:], self.data.qvel[:] = q, v
        mujoco.mj_forward(self.model, self.data)

    def mass_matrix(self, q: Array) -> Array:
        """M, (n, n), with armature: column by column, the force that a unit acceleration takes."""
        zero, n = np.zeros_like(q), q.size
        self.set_state(q, zero)
        columns = np.empty((n, n))
        for i in range(n):
            mujoco.mj_mulM(self.model, self.data, columns[i], np.eye(n)[i])
        return columns

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """M a + bias - passive forces, (n,)."""
        self.set_state(q, v)
        self.data.qacc[:] = a
        mujoco.mj_inverse(self.model, self.data)
        return np.array(self.data.qfrc_inverse)

    def reactions(self, q: Array, v: Array, a: Array) -> Array:
        """(joints, 6): what every joint exerts on its child, force then moment, in axes and at the origin behind it.

        MuJoCo has it as moment and force about the centre of mass of all that hangs on the same root, world axes.
        """
        self.set_state(q, v)
        self.data.qacc[:] = a
        mujoco.mj_rnePostConstraint(self.model, self.data)
        found = []
        for body, turn in self._moved:
            moment, force = np.split(self.data.cfrc_int[body], 2)
            arm = self.data.subtree_com[self.model.body_rootid[body]] - self.data.xpos[body]
            R = (self.data.xmat[body].reshape(3, 3) @ turn).T
            found.append(np.concatenate([R @ force, R @ (moment + np.cross(arm, force))]))
        return np.array(found)

    def bias_force(self, q: Array, v: Array) -> Array:
        """Coriolis and centrifugal terms, (n,): MuJoCo's bias less its value at rest, which is gravity's."""
        self.set_state(q, v)
        moving = np.array(self.data.qfrc_bias)
        self.set_state(q, np.zeros_like(v))
        return moving - np.array(self.data.qfrc_bias)

    def energy(self, q: Array, v: Array) -> Array:
        """(kinetic, potential), J."""
        self.set_state(q, v)
        mujoco.mj_energyPos(self.model, self.data)
        mujoco.mj_energyVel(self.model, self.data)
        return np.array([self.data.energy[1], self.data.energy[0]])

    def trajectory(self, q: Array, v: Array, u: Array, steps: int, every: int) -> Array:
        """States (q, v) after every so many RK4 steps under constant drives, (steps / every + 1, 2n)."""
        mujoco.mj_resetData(self.model, self.data)
        self.set_state(q, v)
        self.data.qfrc_applied[:] = u
        states = [np.concatenate([q, v])]
        for i in range(1, steps + 1):
            mujoco.mj_step(self.model, self.data)
            if i % every == 0:
                states.append(np.concatenate([self.data.qpos, self.data.qvel]))
        return np.array(states)
