"""Small descriptions that the tests of the reader change in one place, and a plain reading of a Robot."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np

import eomgen
from eomgen.errors import EomgenWarning
from eomgen.robot.value import Joint, Placement, Robot
from tests.support.joint_table import frame_table, joint_table, link_table

ARM = f"""
name = "arm"
gravity = [0.0, 0.0, -9.81]
tunable = ["links.link2.mass"]

{link_table("link1", 3.0, (0.1, 0.0, 0.0), (0.1, 0.2, 0.2))}

{link_table("link2", 1.0, inertia=(0.1, 0.1, 0.1))}

{joint_table("joint1", "base", "link1", "revolute")}
dh = {{ a = 0.0, alpha = 0.0, d = 0.3, theta = 0.0 }}
x = {{ stiffness = 1e6, damping = 10 }}
gamma = {{ damping = 0.1, armature = 0.02 }}
limits = [-1, 2]

{joint_table("joint2", "link1", "link2", "prismatic")}
placement = {{ xyz = [0.5, 0.0, 0.0], rpy = [0.0, 0.1, 0.0] }}

{frame_table("tcp", "link2", (0.0, 0.0, 0.1))}
"""

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="ground"/>
  <link name="upper">
    <inertial>
      <origin xyz="0.1 0 0.2" rpy="0.3 0 0"/>
      <mass value="2.0"/>
      <inertia ixx="0.1" iyy="0.2" izz="0.15" ixy="0.01" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <link name="lower">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="shoulder" type="revolute">
    <parent link="ground"/><child link="upper"/>
    <origin xyz="0 0 0.5" rpy="0 0 0.1"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1" upper="2" effort="10" velocity="1"/>
    <dynamics damping="0.7"/>
  </joint>
  <joint name="elbow" type="continuous">
    <parent link="upper"/><child link="lower"/>
    <axis xyz="1 2 3"/>
  </joint>
</robot>
"""

MJCF = """<?xml version="1.0"?>
<mujoco model="legs">
  <compiler angle="degree" eulerseq="xyz"/>
  <option gravity="0 0 -9.81" timestep="0.001"><flag contact="disable"/></option>
  <default>
    <joint damping="0.1"/>
    <geom type="capsule" size="0.05"/>
    <default class="leg"><joint stiffness="5" springref="10" range="-30 40"/></default>
  </default>
  <worldbody>
    <site name="hook" pos="0 0 2"/>
    <body name="torso" pos="0 0 1" axisangle="0 0 1 30">
      <joint name="rootx" type="slide" axis="1 0 0"/>
      <joint name="rootz" type="slide" axis="0 0 1" armature="0.2"/>
      <joint name="rooty" axis="0 1 0" frictionloss="0.3"/>
      <geom fromto="0 0 -0.1 0 0 0.3" mass="4"/>
      <site name="head" pos="0 0 0.3"/>
      <frame pos="0 0.1 0" zaxis="0 1 1">
        <body name="thigh" childclass="leg" pos="0 0 -0.2" euler="0 0 20">
          <joint name="hip" pos="0 0 0.1" axis="0 1 1" ref="5" actuatorfrcrange="-6 6"/>
          <joint name="twist" pos="0 0 0.1" axis="1 2 3"/>
          <geom type="box" size="0.1 0.05 0.2" density="500" pos="0 0 -0.1"/>
          <body name="shin" pos="0 0 -0.4" quat="1 0 0.2 0">
            <joint name="knee" limited="false"/>
            <inertial pos="0 0 -0.1" mass="1.5" diaginertia="0.02 0.03 0.02" xyaxes="1 0 0 0 0 1"/>
            <geom type="mesh" mesh="shin"/>
          </body>
        </body>
      </frame>
    </body>
    <body name="ball" pos="1 0 1"><freejoint name="loose"/><geom type="sphere" size="0.1"/></body>
  </worldbody>
  <tendon>
    <spatial name="rope" stiffness="20" damping="1" springlength="0.5"><site site="hook"/><site site="head"/></spatial>
  </tendon>
  <actuator><motor name="push" joint="hip"/></actuator>
</mujoco>
"""


def example_urdfs() -> list[Path]:
    """All URDFs of the wheel example-robot-data."""
    folders = [Path(entry) / "cmeel.prefix/share/example-robot-data/robots" for entry in sys.path]
    return sorted(path for folder in folders if folder.is_dir() for path in folder.rglob("*.urdf"))


def homogeneous(placement: Placement) -> np.ndarray:
    """The 4x4 matrix of a placement."""
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = placement.rotation, placement.xyz
    return result


def joint_transform(joint: Joint, values: dict[str, float]) -> np.ndarray:
    """Pose of the child link in the parent link: placement . turn . T . Rx . Ry . Rz . turn^T."""
    turn, motion = np.eye(4), np.eye(4)
    turn[:3, :3] = joint.axis_turn
    motion[:3, 3] = [values.get(key, 0.0) for key in "xyz"]
    for axis, key in enumerate(("alpha", "beta", "gamma")):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        c, s = np.cos(values.get(key, 0.0)), np.sin(values.get(key, 0.0))
        rotation = np.eye(4)
        rotation[i, i], rotation[i, j], rotation[j, i], rotation[j, j] = c, -s, s, c
        motion = motion @ rotation
    return homogeneous(joint.placement) @ turn @ motion @ turn.T


def link_poses(robot: Robot, q: np.ndarray) -> dict[str, np.ndarray]:
    """Pose of every link in the base; q in the order of the joints and their coordinates."""
    poses, values = {robot.base: np.eye(4)}, iter(q)
    for joint in robot.joints:
        poses[joint.child] = poses[joint.parent] @ joint_transform(joint, {k: next(values) for k in joint.coordinates})
    return poses


def load_without_mimics(path: Path) -> Robot:
    """Load a URDF whose <mimic> counts for nothing and whose inertia no body needs to have."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EomgenWarning)
        return eomgen.load_robot(path, inertia="warn", urdf_mimic=False)
