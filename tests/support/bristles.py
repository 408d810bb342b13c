"""Robots whose laws have states: LuGre friction, hysteresis and Maxwell branches in joints, motors and closed loops."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import eomgen
from eomgen.description import robot_from_toml
from eomgen.robot.value import Robot
from tests.support.joint_table import frame_table, joint_table, link_table

BRISTLES = ", bristle_stiffness = 300.0, bristle_damping = 0.5, fade = 0.5"
FRICTION = f'friction = {{ model = "lugre", coulomb = 0.3, static = 0.4, stribeck = 0.1{BRISTLES} }}'
SIZE = 1e-3  # m or rad, by which its bristles bend before they slide
ARM = f"""
name = "bristle_arm"
gravity = [0.0, -9.81, 0.0]
{link_table("l1", 2.0, (0.2, 0.01, 0.0), (0.1, 0.12, 0.13))}
{link_table("l2", 1.0, (0.2, 0.0, 0.05), (0.02, 0.03, 0.04))}
{joint_table("j1", "base", "l1", "revolute")}
gamma = {{ {FRICTION} }}
{joint_table("j2", "l1", "l2", "revolute")}
placement = {{ xyz = [0.4, 0.0, 0.0], rpy = [0.5, 0.0, 0.0] }}
x = {{ stiffness = 1e4, damping = 10.0 }}
gamma = {{ damping = 0.1 }}
[joints.motor]
inertia = 1e-3
ratio = 5.0
stiffness = 100.0
damping = 0.5
{FRICTION}
{frame_table("tcp", "l2", (0.3, 0.0, 0.0))}
"""


def gear_text(friction: str) -> str:
    """Describe two links of which the second one follows the first, with this friction on both sides of the gear."""
    return f"""
name = "bristle_gear"
gravity = [0.0, -9.81, 0.0]
{link_table("a", 1.0, (0.2, 0.0, 0.0), (0.01, 0.02, 0.02))}
{link_table("b", 0.5, (0.1, 0.0, 0.0), (0.01, 0.01, 0.01))}
{joint_table("j1", "base", "a", "revolute")}
gamma = {{ {friction} }}
{joint_table("j2", "a", "b", "revolute")}
placement = {{ xyz = [0.4, 0.0, 0.0] }}
gamma = {{ {friction} }}
[[couplings]]
name = "gear"
of = "j2.gamma"
to = {{ "j1.gamma" = -2.0 }}
"""


GEARED = gear_text(FRICTION)


HYSTERESIS = "hysteresis = {{ stiffness = {}, beta = 30.0, gamma = 10.0, n = 1.5, share = 0.3 }}"
MAXWELL = "maxwell = [{ stiffness = 2e3, damping = 5.0 }, { stiffness = 1e3, damping = 50.0 }]"
LAWS = (  # in the place of others of ARM
    ("x = { stiffness = 1e4, damping = 10.0 }", f"x = {{ stiffness = 1e4, {MAXWELL} }}"),
    ("gamma = { damping = 0.1 }", f"gamma = {{ damping = 0.1, {HYSTERESIS.format(30.0)} }}"),
    ("stiffness = 100.0\ndamping = 0.5\n", f"stiffness = 100.0\ndamping = 0.5\n{HYSTERESIS.format(50.0)}\n"),
    ('name = "bristle_arm"', 'name = "stateful_arm"'),
)


def all_laws_text() -> str:
    """Describe the arm with hysteresis in a joint and a transmission, and Maxwell branches, beside its bristles."""
    text = ARM
    for old, new in LAWS:
        text = text.replace(old, new)
    return text


def stateful_arm() -> Robot:
    """Return the arm with all kinds of laws that have states."""
    return robot_from_toml(all_laws_text())


DRIVE = (
    "drive = { winding = { resistance = 0.8, inductance = 8e-4, torque_constant = 0.5 }, controller = {"
    " position = { kp = 5.0 }, velocity = { kp = 2.0, ki = 20.0 }, current = { kp = 0.8, ki = 80.0 } } }"
)
WOUND = "drive = { winding = { resistance = 2.0, inductance = 1e-3, torque_constant = 0.05 } }"


def servo_text() -> str:
    """Describe the arm with a servo drive in its first joint and a winding of its motor, beside their bristles."""
    text = ARM.replace('name = "bristle_arm"', 'name = "servo_arm"').replace(
        "gamma = { friction", f"gamma = {{ {DRIVE}, friction", 1
    )
    return text.replace("ratio = 5.0\n", f"ratio = 5.0\n{WOUND}\n")


def servo_axes() -> Robot:
    """Return the arm with a servo drive in its first joint, and its second one's motor behind one, too."""
    text = servo_text().replace(WOUND, DRIVE.replace("kp = 5.0", "kp = 2.0"))
    return robot_from_toml(text.replace('name = "servo_arm"', 'name = "servo_axes"'))


def servo_arm() -> Robot:
    """Return the arm whose drives have states and inputs of their own."""
    return robot_from_toml(servo_text())


def loop_text() -> str:
    """Describe the four-bar linkage with bristles in its loop joint, and hysteresis in an elastic coupling."""
    text = linkage_text().replace('name = "joint4"\n', f'name = "joint4"\ngamma = {{ {FRICTION} }}\n')
    coupling = '[[couplings]]\nname = "belt"\nof = "joint2.gamma"\nto = { "joint1.gamma" = 0.5 }\n'
    return f"{text}\n{coupling}{HYSTERESIS.format(20.0)}\n"


def stateful_linkage() -> Robot:
    """Return the linkage whose loop joint and elastic coupling have states, too."""
    return robot_from_toml(loop_text())


def bristle_gear() -> Robot:
    """Return two links of which the second one follows the first, with bristles on both sides of the gear."""
    return robot_from_toml(GEARED)


def bristle_arm() -> Robot:
    """Return an arm of 4 coordinates with bristles in a joint and in a motor."""
    return robot_from_toml(ARM)


def linkage_text() -> str:
    """Describe the built-in four-bar linkage with bristles in two joints."""
    text = (Path(str(eomgen.__file__)).parent / "robots" / "four_bar.toml").read_text()
    for name in ("joint1", "joint2"):
        text = text.replace(f'name = "{name}"\n', f'name = "{name}"\ngamma = {{ {FRICTION} }}\n')
    return text


def bristle_linkage() -> Robot:
    """Return the built-in four-bar linkage with bristles in two joints."""
    return robot_from_toml(linkage_text())


def bent(kernel: eomgen.Kernel, seed: int = 3) -> tuple[Any, Any, Any, Any]:
    """Return q, v, u of coordinates near home, motors behind their gears, and z."""
    rng, n = np.random.default_rng(seed), len(kernel.coordinates)
    q, v, u = (rng.normal(size=n) * size for size in (0.1, 0.1, 1.0))
    q += kernel.home[:n]
    places = {name: i for i, name in enumerate(kernel.coordinates)}
    for motor, joint in kernel.motors.items():
        q[places[motor]] = kernel.ratio(motor) * q[places[joint]] + 0.01
    return q, v, u, SIZE * rng.uniform(-0.8, 0.8, len(kernel.internal_states))


def law_changes(kernel: eomgen.Kernel, count: int = 200) -> list[tuple[dict[str, float], bool]]:
    """Return random changes of numbers of laws, and whether the kernel takes each."""
    rng, changes = np.random.default_rng(8), list[tuple[dict[str, float], bool]]()
    names = [name for name in kernel.parameters if ".friction." in name or ".hysteresis." in name]
    for _ in range(count):
        chosen = rng.choice(names, 3, replace=False)
        values = {str(name): float(kernel.parameters[name] * 10.0 ** rng.uniform(-1.0, 1.0)) for name in chosen}
        values |= {name: -value for name, value in values.items() if name.endswith("gamma") and rng.random() < 0.5}
        try:
            kernel.replaced().parameters.update(values)
            changes.append((values, True))
        except eomgen.InputError:
            changes.append((values, False))
    assert {taken for _, taken in changes} == {True, False}
    return changes


STIFFNESS, DAMPING, VISCOUS, COULOMB, STATIC, STRIBECK = 1e5, float(np.sqrt(1e5)), 0.4, 1.0, 1.5, 1e-3  # published
PULL = 2.0  # N/m of the spring that pulls a mass of 1 kg
PUBLISHED = (
    f'model = "lugre", coulomb = {COULOMB}, static = {STATIC}, stribeck = {STRIBECK}, bristle_stiffness = {STIFFNESS},'
    f" bristle_damping = {DAMPING}, viscous = {VISCOUS}"
)


def block(friction: str = PUBLISHED, pull: float = PULL) -> Robot:
    """Return a mass of 1 kg on a rail, pulled by a spring, with the published friction or another one."""
    return robot_from_toml(f"""
name = "block"
gravity = [0.0, -9.81, 0.0]
{link_table("body", 1.0, inertia=(0.1, 0.1, 0.1))}
{joint_table("slide", "base", "body", "prismatic")}
z = {{ stiffness = {pull}, friction = {{ {friction} }} }}
""")


def rates(v: Any, z: Any) -> tuple[Any, Any]:
    """Return z' and the friction of the published numbers, as the paper writes them."""
    level = COULOMB + (STATIC - COULOMB) * np.exp(-((v / STRIBECK) ** 2))
    rate = v - STIFFNESS * np.abs(v) * z / level
    return rate, STIFFNESS * z + DAMPING * rate + VISCOUS * v
