"""Robots with forces of one family each, and one with all of them; their numbers are drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eomgen.codegen.forces.bushings import Bushings
from eomgen.codegen.forces.coordinates import CoordinateLaws, ModalCouplings
from eomgen.codegen.forces.cut_journals import LoopBearingContacts
from eomgen.codegen.forces.cuts import ElasticLoopCoordinates
from eomgen.codegen.forces.element import ForceElement
from eomgen.codegen.forces.internal_states.coordinate_laws import InternalStateLaws
from eomgen.codegen.forces.internal_states.drives import Drives
from eomgen.codegen.forces.joint_damping import JointDampers
from eomgen.codegen.forces.joint_stiffness import JointStiffnesses
from eomgen.codegen.forces.journals import BearingContacts
from eomgen.codegen.forces.springs import PointSprings
from eomgen.codegen.forces.transmissions import Transmissions
from eomgen.description.load import robot_from_toml
from eomgen.robot.model import Model, build_model
from eomgen.robot.parameter_names import FAMILIES, element_places
from eomgen.robot.value import Link, LinkModes, Robot
from tests.oracles.bending_lagrange import Cloud
from tests.support.bending_links import nested
from tests.support.joint_table import joint_table, link_table, loop_table, spring_table

Array = NDArray[np.float64]

FREE = "x = {}\ny = {}\nalpha = {}\nbeta = {}\n"
LAWS = """
x = { stiffness = 20.0, damping = 4.0, clearance = 1e-2, smoothing = 5e-2, restitution_damping = 2.0 }
z = { stiffness = 20.0, stiffness_negative = 10.0, cubic = 9.0, damping = 4.0, preload = 3.0 }
beta = { damping = 0.5, curve = [[-0.4, -3.0], [-0.1, -2.0], [0.1, 2.0], [0.4, 4.0]] }
gamma = { damping = 0.3, exponential = { force = 1.0, scale = 0.3 }, friction = { coulomb = 0.2, static = 0.3, \
stribeck = 0.2, viscous = 0.1, smoothing = 0.2, coefficient = 0.1, radius = 0.3 }, \
stops = { stiffness = 10.0, damping = 3.0, lower = -0.1, upper = 0.1, smoothing = 0.1, restitution_damping = 0.2 } }
"""
MOTOR = """
motor = { inertia = 1e-2, ratio = 3.0, stiffness = 10.0, damping = 2.0, cubic = 5.0 }
"""
BEARING = "{ clearance = 1e-2, stiffness = 100.0, length = 0.5, smoothing = 0.1, restitution_damping = 0.5, \
friction = { coefficient = 0.1, radius = 0.2, smoothing = 0.1 } }\n"
STIFFNESS = f"""
{link_table("head", 0.5, (0.05, 0.02, 0.1), (1e-2, 2e-2, 1e-2))}
{joint_table("neck", "rocker", "head", "revolute")}
placement = {{ xyz = [0.3, 0.0, 0.1], rpy = [0.2, 0.1, 0.0] }}
x = {{}}
beta = {{ stiffness = 2.0 }}
stiffness = {{ matrix = [[40.0, 3.0, -2.0], [3.0, 5.0, 1.0], [-2.0, 1.0, 4.0]], preload = [1.0, -0.5, 0.2] }}
damping = {{ loss_factor = 0.9, at_hz = 1.5 }}
"""
DAMPING = f"""
{link_table("hand", 0.4, (0.05, 0.02, 0.1), (1e-2, 2e-2, 1e-2))}
{joint_table("wrist", "fore", "hand", "revolute")}
placement = {{ xyz = [0.3, 0.0, 0.1] }}
z = {{}}
alpha = {{}}
damping = {{ matrix = [[4.0, 0.2, 0.0], [0.2, 0.5, -0.1], [0.0, -0.1, 0.3]] }}
"""
SPRINGS = f"""
{spring_table("coil", "base", "fore", 30.0, 2.0)}
points = [[0.0, 0.5, 0.0], [0.1, 0.0, 0.0]]
free_length = 0.3
{spring_table("zero", "rocker", "fore", 30.0, 1.0)}
points = [[0.0, 0.5, 0.0], [0.1, 0.0, 0.0]]
{spring_table("rope", "base", "fore", 30.0, 2.0)}
points = [[0.0, -0.9, 0.0], [0.1, 0.0, 0.0]]
free_length = 0.1
tension_only = true
smoothing = 0.1
"""
CUT = f"""
{loop_table("pin", "fore", "rocker", "revolute")}
placements = [{{ xyz = [0.3, 0.0, 0.0] }}, {{ xyz = [0.3, 0.1, 0.0], rpy = [0.2, 0.0, 0.0] }}]
x = {{ stiffness = 10.0, damping = 2.0 }}
y = {{ stiffness = 10.0, damping = 2.0, clearance = 2e-2 }}
z = {{ stiffness = 10.0, damping = 2.0, friction = {{ model = "lugre", coulomb = 2.0, bristle_stiffness = 3.0 }} }}
alpha = {{ stiffness = 1.0, damping = 0.2, maxwell = [{{ stiffness = 2.0, damping = 1.0 }}] }}
beta = {{ stiffness = 1.0, damping = 0.2, hysteresis = {{ stiffness = 3.0, beta = 0.9, gamma = 0.4, n = 1.4 }} }}
gamma = {{ friction = {{ coefficient = 0.8, radius = 0.2, smoothing = 0.1 }} }}
{loop_table("clamp", "base", "rocker", "fixed")}
placements = [{{ xyz = [0.6, 0.2, 0.1] }}, {{ xyz = [0.0, 0.1, 0.1], rpy = [-0.1, 0.2, 0.0] }}]
x = {{}}
y = {{}}
z = {{ stiffness = 3.0 }}
alpha = {{}}
beta = {{}}
gamma = {{}}
stiffness = {{ matrix = [[9.0, 1.0, -2.0, 0.3, 0.1, 0.0], [1.0, 8.0, 0.5, 0.2, -0.3, 0.4], \
[-2.0, 0.5, 7.0, 0.1, 0.6, 0.2], [0.3, 0.2, 0.1, 1.0, 0.2, 0.1], [0.1, -0.3, 0.6, 0.2, 1.5, -0.2], \
[0.0, 0.4, 0.2, 0.1, -0.2, 1.2]], preload = [0.1, 0.0, 0.2, 0.0, -0.1, 0.0] }}
damping = {{ ratio = 0.8, at_hz = 1.5 }}
[[couplings]]
name = "belt"
of = "pivot.gamma"
to = {{ "knee.gamma" = -1.5 }}
stiffness = 10.0
damping = 2.0
maxwell = [{{ stiffness = 3.0, damping = 0.5 }}]
"""
CUT_BEARING = f"""
{loop_table("bush", "fore", "base", "revolute")}
placements = [{{ xyz = [0.1, 0.0, 0.1] }}, {{ xyz = [0.5, 0.1, 0.0] }}]
x = {{ damping = 2.0 }}
y = {{ damping = 2.0 }}
z = {{ damping = 2.0 }}
alpha = {{ damping = 0.2 }}
beta = {{ damping = 0.2 }}
gamma = {{ damping = 0.1 }}
radial = {BEARING}
"""
BUSHING = """
[[bushings]]
name = "mount"
links = ["base", "fore"]
placements = [{ xyz = [0.5, 0.1, 0.0] }, { xyz = [0.1, 0.0, 0.05], rpy = [0.1, 0.2, 0.3] }]
stiffness = [10.0, 0.0, 12.0, 1.0, 2.0, 0.5]
damping = [1.0, 2.0, 0.5, 0.1, 0.2, 0.0]
[[bushings]]
name = "pad"
links = ["fore", "rocker"]
stiffness = [20.0, 10.0, 15.0, 0.0, 0.0, 0.0]
[[bushings]]
name = "block"
links = ["fore", "base"]
placements = [{ xyz = [0.1, 0.0, 0.1] }, { xyz = [0.5, 0.0, 0.1], rpy = [0.1, -0.2, 0.2] }]
stiffness = { matrix = [[9.0, 1.0, -2.0, 0.3, 0.1, 0.0], [1.0, 8.0, 0.5, 0.2, -0.3, 0.4], \
[-2.0, 0.5, 7.0, 0.1, 0.6, 0.2], [0.3, 0.2, 0.1, 1.0, 0.2, 0.1], [0.1, -0.3, 0.6, 0.2, 1.5, -0.2], \
[0.0, 0.4, 0.2, 0.1, -0.2, 1.2]], preload = [0.1, 0.0, 0.2, 0.0, -0.1, 0.0] }
damping = { matrix = [[2.0, 0.1, 0.0, 0.1, 0.0, 0.0], [0.1, 1.0, 0.2, 0.0, 0.0, 0.1], \
[0.0, 0.2, 1.5, 0.0, 0.0, 0.0], [0.1, 0.0, 0.0, 0.2, 0.0, 0.1], [0.0, 0.0, 0.0, 0.0, 0.3, 0.0], \
[0.0, 0.1, 0.0, 0.1, 0.0, 0.4]] }
"""
WITH_STATES = f"""
{link_table("finger", 0.4, (0.05, 0.01, 0.0), (3e-3, 4e-3, 5e-3))}
{joint_table("knuckle", "fore", "finger", "revolute")}
placement = {{ xyz = [0.3, 0.0, 0.0], rpy = [0.2, 0.0, 0.1] }}
beta = {{ friction = {{ model = "lugre", coulomb = 3.0, bristle_stiffness = 2.0, bristle_damping = 1.0, fade = 0.7 }} }}
gamma = {{ friction = {{ model = "lugre", coulomb = 2.0, static = 3.0, stribeck = 0.5, bristle_stiffness = 1.5, \
bristle_damping = 0.8, viscous = 0.2 }}, \
hysteresis = {{ stiffness = 3.0, A = 1.2, beta = 0.9, gamma = -0.4, n = 1.6, share = 0.3 }}, \
maxwell = [{{ stiffness = 2.0, damping = 1.0 }}, {{ stiffness = 1.5, damping = 0.2 }}] }}
{link_table("thumb", 0.3, (0.04, 0.01, 0.01), (3e-3, 4e-3, 5e-3))}
{joint_table("saddle", "rocker", "thumb", "revolute")}
placement = {{ xyz = [0.2, 0.0, 0.1], rpy = [0.1, -0.2, 0.1] }}
[joints.motor]
inertia = 2e-2
ratio = -2.0
stiffness = 5.0
hysteresis = {{ stiffness = 4.0, beta = 1.1, gamma = 0.5, n = 1.3, share = 0.2 }}
maxwell = [{{ stiffness = 3.0, damping = 0.4 }}]
friction = {{ model = "lugre", coulomb = 1.0, bristle_stiffness = 0.8, viscous = 0.1 }}
"""

DRIVES = f"""
{link_table("tool", 0.5, (0.04, 0.02, 0.0), (6e-3, 5e-3, 7e-3))}
{link_table("slide", 0.3, (0.0, 0.02, 0.0), (2e-3, 3e-3, 4e-3))}
{joint_table("swivel", "rocker", "tool", "revolute")}
placement = {{ xyz = [0.2, 0.1, 0.0], rpy = [0.1, 0.3, 0.0] }}
[joints.gamma.drive]
winding = {{ resistance = 2.0, inductance = 0.3, torque_constant = 0.8 }}
current_limit = 0.3
voltage_limit = 0.8
[joints.gamma.drive.controller]
position = {{ kp = 2.0, ki = 1.0, kd = 0.5, filter = 0.4, limit = 0.5 }}
velocity = {{ kp = 0.7, ki = 1.5, kd = 0.2, filter = 0.3 }}
current = {{ kp = 1.5, ki = 2.0, kd = 0.1, filter = 0.5 }}
{joint_table("rail", "tool", "slide", "prismatic")}
placement = {{ xyz = [0.1, 0.0, 0.0], rpy = [0.4, 0.0, 0.2] }}
[joints.z.drive]
lag = 0.2
controller = {{ kp = 3.0, ki = 2.0, kd = 1.0, limit = 0.7 }}
"""

ROBOTS: Mapping[type[ForceElement], Mapping[str, str]] = {
    CoordinateLaws: {"knee": LAWS},
    InternalStateLaws: {"beside": WITH_STATES},
    Drives: {"beside": DRIVES},
    Transmissions: {"hip": MOTOR},
    PointSprings: {"beside": SPRINGS},
    BearingContacts: {"hip": FREE + "radial = " + BEARING},
    JointStiffnesses: {"beside": STIFFNESS},
    JointDampers: {"hip": FREE + "damping = { linear = 3.0, angular = 0.2 }\n", "beside": DAMPING},
    ElasticLoopCoordinates: {"beside": CUT},
    LoopBearingContacts: {"beside": CUT_BEARING},
    Bushings: {"beside": BUSHING},
    ModalCouplings: {},  # ``robot_of`` makes the rocker bend
}
PARTS = ("hip", "knee", "beside")


def robot_with(*families: type[ForceElement]) -> str:
    """Give a description of a robot with forces of these families; ``FREE`` joints move crosswise, too."""
    parts = {part: "".join(ROBOTS[family].get(part, "") for family in families) for part in PARTS}
    if parts["hip"].count(FREE) > 1:
        parts["hip"] = FREE + parts["hip"].replace(FREE, "")
    return tree(**parts)


def tree(hip: str = "", knee: str = "", beside: str = "") -> str:
    """Describe three links on three joints, of which two have further keys, with more tables behind them."""
    return f"""
name = "every"
gravity = [0.0, -9.81, 1.0]
{link_table("upper", 2.0, (0.2, 0.01, 0.02))}
inertia = {{ xx = 2e-2, yy = 3e-2, zz = 3e-2, xy = 1e-3 }}
{link_table("fore", 1.5, (0.1, 0.0, 0.03), (2e-2, 3e-2, 3e-2))}
{link_table("rocker", 0.7, (0.15, 0.02, 0.0), (1e-2, 1e-2, 1e-2))}
{joint_table("hip", "base", "upper", "revolute")}
{hip}
{joint_table("knee", "upper", "fore", "revolute")}
placement = {{ xyz = [0.4, 0.0, 0.0], rpy = [0.3, 0.1, 0.0] }}
{knee}
{joint_table("pivot", "base", "rocker", "revolute")}
placement = {{ xyz = [0.6, 0.2, 0.0], rpy = [0.1, -0.2, 0.0] }}
{beside}
"""


def robot_of(*families: type[ForceElement]) -> Robot:
    """Return the robot of that description; its rocker bends, by modes that work on each other, if these are wanted."""
    robot = robot_from_toml(robot_with(*families))
    if ModalCouplings not in families:
        return robot
    return replace(robot, links=tuple(_bending(x) if x.name == "rocker" else x for x in robot.links))


def _bending(link: Link) -> Link:
    """Return a link with two modes, of particles that have its mass and inertia."""
    cloud = Cloud.of(link.mass, link.com, link.inertia)
    phi = 0.3 * np.random.default_rng(40).normal(size=(len(cloud.mass), 3, 2))
    H0, P, _ = replace(cloud, phi=phi, psi=np.zeros((*phi.shape, 2))).constants()
    K, D = ((40.0, 12.0), (12.0, 60.0)), ((0.6, -0.15), (-0.15, 0.4))
    return replace(link, modes=LinkModes(nested(H0), nested(P), K, D, ()))


def drawn(robot: Robot, seed: int) -> tuple[Model, Array]:
    """Return a robot's model, and its parameters with those of forces drawn about the described ones."""
    rng, model = np.random.default_rng(seed), build_model(robot)
    values, places = np.array(list(model.parameters.values())), element_places(model.robot, model.parameters)
    own = [place for family in FAMILIES for numbers in places[family].values() for place in numbers.values()]
    values[own] *= rng.uniform(0.8, 1.25, len(own))
    return model, values
