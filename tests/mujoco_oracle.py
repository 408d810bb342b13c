"""MuJoCo as an independent oracle: the same robot as an MJCF model.

MuJoCo applies the joints of one body in their order, each about the axes that the ones before it have turned: three
slides along x, y, z and three hinges about x, y, z are eq. (3).
"""

from __future__ import annotations

from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import NDArray

from eomgen.robot import ANGULAR, COORDINATES, Joint, Link, Robot

Array = NDArray[np.float64]
AXES = ("1 0 0", "0 1 0", "0 0 1")


class MujocoRobot:
    """A robot in MuJoCo: no contacts, no limits, coordinates in the same order as the robot's.

    Links need masses and inertias above zero: MuJoCo takes no massless body and no thin rod.
    """

    def __init__(self, robot: Robot, step: float = 1e-3) -> None:
        self.model = mujoco.MjModel.from_xml_string(mjcf(robot, step))
        self.data = mujoco.MjData(self.model)
        expected = [f"{joint.name}.{name}" for joint in robot.joints for name in joint.coordinates]
        found = [self.model.joint(i).name for i in range(self.model.njnt)]
        assert found == expected, "MuJoCo orders the coordinates otherwise"

    def _set(self, q: Array, v: Array) -> None:
        self.data.qpos[:], self.data.qvel[:] = q, v
        mujoco.mj_forward(self.model, self.data)

    def mass_matrix(self, q: Array) -> Array:
        """M, (n, n), with armature: column by column, the force that a unit acceleration takes."""
        zero, n = np.zeros_like(q), q.size
        self._set(q, zero)
        columns = np.empty((n, n))
        for i in range(n):
            mujoco.mj_mulM(self.model, self.data, columns[i], np.eye(n)[i])
        return columns

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """M a + bias - passive forces, (n,)."""
        self._set(q, v)
        self.data.qacc[:] = a
        mujoco.mj_inverse(self.model, self.data)
        return np.array(self.data.qfrc_inverse)

    def bias_force(self, q: Array, v: Array) -> Array:
        """Coriolis and centrifugal terms, (n,): MuJoCo's bias less its value at rest, which is gravity's."""
        self._set(q, v)
        moving = np.array(self.data.qfrc_bias)
        self._set(q, np.zeros_like(v))
        return moving - np.array(self.data.qfrc_bias)

    def energy(self, q: Array, v: Array) -> Array:
        """(kinetic, potential), J."""
        self._set(q, v)
        mujoco.mj_energyPos(self.model, self.data)
        mujoco.mj_energyVel(self.model, self.data)
        return np.array([self.data.energy[1], self.data.energy[0]])

    def trajectory(self, q: Array, v: Array, u: Array, steps: int, every: int) -> Array:
        """States (q, v) after every so many RK4 steps under constant drives, (steps / every + 1, 2n)."""
        mujoco.mj_resetData(self.model, self.data)
        self._set(q, v)
        self.data.qfrc_applied[:] = u
        states = [np.concatenate([q, v])]
        for i in range(1, steps + 1):
            mujoco.mj_step(self.model, self.data)
            if i % every == 0:
                states.append(np.concatenate([self.data.qpos, self.data.qvel]))
        return np.array(states)


def mjcf(robot: Robot, step: float) -> str:
    """The robot as MJCF text."""
    root = ElementTree.Element("mujoco")
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="false")
    option = {"timestep": repr(step), "gravity": _text(robot.gravity), "integrator": "RK4"}
    ElementTree.SubElement(root, "option", option)
    bodies = {robot.base: (ElementTree.SubElement(root, "worldbody"), np.eye(3))}
    for joint in robot.joints:
        parent, back = bodies[joint.parent]
        bodies[joint.child] = _add_body(parent, back, joint, robot.link(joint.child))
    return ElementTree.tostring(root, encoding="unicode")


def _add_body(parent: ElementTree.Element, back: Array, joint: Joint, link: Link) -> tuple[ElementTree.Element, Array]:
    """The link as a body whose axes are the joint's; returns it, and the rotation from link axes to its axes."""
    turn = np.array(joint.axis_turn)
    rotation = back @ np.array(joint.placement.rotation) @ turn
    place = {"name": joint.child, "pos": _text(back @ np.array(joint.placement.xyz)), "xyaxes": _axes(rotation)}
    body = ElementTree.SubElement(parent, "body", place)
    xx, yy, zz, xy, xz, yz = link.inertia
    inertia = turn.T @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn
    full = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    values = {"mass": repr(link.mass), "pos": _text(turn.T @ np.array(link.com)), "fullinertia": _text(full)}
    ElementTree.SubElement(body, "inertial", values)
    for name, given in joint.coordinates.items():
        values = {key: repr(getattr(given, key) or 0.0) for key in ("stiffness", "damping", "armature")}
        kind = "hinge" if name in ANGULAR else "slide"
        axis = AXES[COORDINATES.index(name) % 3]
        ElementTree.SubElement(body, "joint", name=f"{joint.name}.{name}", type=kind, axis=axis, **values)
    return body, turn.T


def _axes(rotation: Array) -> str:
    return _text(np.concatenate([rotation[:, 0], rotation[:, 1]]))


def _text(values: Array | tuple[float, ...]) -> str:
    return " ".join(repr(float(value)) for value in values)
