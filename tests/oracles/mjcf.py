"""MuJoCo as an oracle of models that were read from MJCF: quaternions there, three angles here."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eomgen.robot.value import Robot
from tests.support.optional import OptionalModule

mujoco = OptionalModule("mujoco")

Array = np.ndarray
FREE, BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)


def about(axis: int, angle: complex) -> Array:
    """Rotation about x, y or z; of complex angles, too."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3, dtype=np.result_type(c))
    rotation[i, i], rotation[i, j], rotation[j, i], rotation[j, j] = c, -s, s, c
    return rotation


def angle_rates(angles: Array) -> Array:
    """The matrix from rates of alpha, beta, gamma to the angular velocity in axes behind them, (3, 3)."""
    back = about(2, angles[2]).T
    return np.column_stack([back @ about(1, angles[1]).T[:, 0], back[:, 1], np.eye(3)[:, 2]])


class MjcfOracle:
    """The model of a text or file in MuJoCo, in the coordinates of the robot that was read from it.

    Nothing constrains it.
    """

    def __init__(self, given: str | Path, robot: Robot) -> None:
        read = mujoco.MjModel.from_xml_path if isinstance(given, Path) else mujoco.MjModel.from_xml_string
        self.model = read(str(given))
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        self.data = mujoco.MjData(self.model)
        self.n = sum(len(joint.coordinates) for joint in robot.joints)
        assert self.n == self.model.nv

    def _joints(self) -> list[tuple[int, int, int, int]]:
        """Kind, first of qpos, first of qvel, body."""
        m = self.model
        return [
            (int(m.jnt_type[i]), int(m.jnt_qposadr[i]), int(m.jnt_dofadr[i]), int(m.jnt_bodyid[i]))
            for i in range(m.njnt)
        ]

    def _turn(self, body: int) -> Array:
        found = np.empty(9)
        mujoco.mju_quat2Mat(found, self.model.body_quat[body])
        return found.reshape(3, 3)

    def qpos(self, q: Array) -> Array:
        """MuJoCo's positions: a free joint's coordinates begin at the body's place."""
        found = np.array(self.model.qpos0)
        for kind, at, first, body in self._joints():
            if kind not in (FREE, BALL):
                found[at] = q[first]
                continue
            start, quat = first + 3 * (kind == FREE), np.empty(4)
            rotation = about(0, q[start]) @ about(1, q[start + 1]) @ about(2, q[start + 2])
            if kind == FREE:
                found[at : at + 3] = self.model.body_pos[body] + self._turn(body) @ q[first : first + 3]
                rotation, at = self._turn(body) @ rotation, at + 3
            mujoco.mju_mat2Quat(quat, np.ascontiguousarray(rotation).ravel())
            found[at : at + 4] = quat
        return found

    def map(self, q: Array) -> Array:
        """S of qvel = S(q) v, (n, n)."""
        found = np.eye(self.n, dtype=q.dtype)
        for kind, _, first, body in self._joints():
            if kind == FREE:
                found[first : first + 3, first : first + 3] = self._turn(body)
                first += 3
            if kind in (FREE, BALL):
                found[first : first + 3, first : first + 3] = angle_rates(q[first : first + 3])
        return found

    def set(self, q: Array, v: Array) -> None:
        self.data.qpos[:], self.data.qvel[:] = self.qpos(q), self.map(q) @ v
        mujoco.mj_forward(self.model, self.data)

    def mass_matrix(self, q: Array) -> Array:
        self.set(q, np.zeros_like(q))
        S, columns = self.map(q), np.empty((self.n, self.n))
        for i in range(self.n):
            mujoco.mj_mulM(self.model, self.data, columns[i], np.ascontiguousarray(S[:, i]))
        return columns @ S

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        self.set(q, v)
        step = 1e-30  # a complex step: S_dot = dS/dq v
        S_dot = self.map(q + 1j * step * v).imag / step
        self.data.qacc[:] = self.map(q) @ a + S_dot @ v
        mujoco.mj_inverse(self.model, self.data)
        return self.map(q).T @ self.data.qfrc_inverse

    def energy(self, q: Array, v: Array) -> Array:
        """(kinetic, potential), J."""
        self.set(q, v)
        mujoco.mj_energyPos(self.model, self.data)
        mujoco.mj_energyVel(self.model, self.data)
        return np.array([self.data.energy[1], self.data.energy[0]])

    def poses(self, q: Array) -> dict[str, Array]:
        """(4, 4) of every body and site that has a name."""
        self.set(q, np.zeros_like(q))
        found = {}
        for count, name_of, places, turns in (
            (self.model.nbody, self.model.body, self.data.xpos, self.data.xmat),
            (self.model.nsite, self.model.site, self.data.site_xpos, self.data.site_xmat),
        ):
            for i in range(count):
                if name_of(i).name not in ("", "world"):
                    pose = np.eye(4)
                    pose[:3, :3], pose[:3, 3] = turns[i].reshape(3, 3), places[i]
                    found.setdefault(name_of(i).name, pose)  # a body before a site of the same name
        return found
