"""Small files of each format that are right, with all of its keys: what random changes begin with."""

from __future__ import annotations

import tomllib
import xml.etree.ElementTree as ElementTree
from functools import cache
from typing import Any

import numpy as np

from eomgen.bending.beam import beam_inertia, beam_modes
from eomgen.robot.value import BeamModes, LinkBeam
from tests.support.description_samples import ARM, MJCF, URDF

SMALL = """
name = "rod"
tunable = ["links.*.mass", "gravity"]
links = [{ name = "l1", mass = 1.0, inertia = { xx = 0.1, yy = 0.1, zz = 0.1 } }]
joints = [{ name = "j1", parent = "base", child = "l1", type = "revolute", x = { stiffness = 1e4 } }]
"""
WORN = """
name = "worn"
gravity = [0, 0, -9.81]
inertia = "project"
driven = ["j1.gamma", "j2.z"]
home = { j1.gamma = 0.1, j2 = { z = 0.2 } }
links = [{ name = "a", mass = 2, com = [0, 0, 1] }, { name = "b", mass = 1, inertia = { xx = 1, yy = 1, zz = 1 } }]
frames = [{ name = "tcp", link = "b", placement = { xyz = [0, 0, 1], rpy = [1, 0, 0] } }]
[[loops]]
name = "cut"
links = ["b", "base"]
type = "revolute"
placements = [{ xyz = [1, 0, 0] }, { rpy_deg = [0, 0, 90] }]
x = { stiffness = 1e6, clearance = 1e-3 }
alpha = {}
stiffness = { matrix = [[1e4, 3], [3, 10]] }
offset = { y = 1e-3 }
[[couplings]]
name = "gear"
of = "j2.z"
to = { j1.gamma = 0.1, "j1.beta" = 1 }
offset = 1
[[couplings]]
name = "belt"
of = "j1.motor"
to = { j2.z = 2 }
stiffness = 1e3
friction = { coulomb = 1 }
maxwell = [{ stiffness = 1, damping = 2 }]
[[joints]]
name = "j1"
parent = "base"
child = "a"
type = "revolute"
dh = { a = 0.1, alpha_deg = -90, d = 0.2, theta_deg = 30 }
gamma = { friction = { coulomb = 1, static = 2, stribeck = 0.1, shape = "gaussian", viscous = 0.1 }, cubic = 2 }
alpha = { stiffness = 1e4, maxwell = { loss_factor = 0.1, band_hz = [1, 10], branches = 2 } }
beta = { stiffness = 1e3, clearance = 1e-3, smoothing = 1e-5, restitution_damping = 1 }
offset = { x = 1e-3, alpha = 1e-3 }
[joints.motor]
limits = { upper = 300, effort = 0.5 }
inertia = 1e-4
ratio = 100
stiffness = 1e4
damping = 1
hysteresis = { model = "bouc_wen", stiffness = 1e3, A = 1, beta = 100, gamma = 50, n = 1.5, share = 0.5 }
friction = { model = "lugre", coulomb = 0.1, bristle_stiffness = 10, bristle_damping = 0.1, fade = 0.5 }
[[joints]]
name = "j2"
parent = "a"
child = "b"
type = "prismatic"
x = { curve = [[-1, -2], [0, 0], [1, 3]], limits = { lower = -2, velocity = 3 }, \
maxwell = [{ stiffness = 10, damping = 1 }, { stiffness = 5, damping = 9 }] }
prescribed = ["y"]
stiffness = { matrix = [[200, 1, 0], [1, 10, 0], [0, 0, 5]], preload = [1, 0, 2] }
damping = { ratio = 0.1, at_hz = 5 }
limits = [-1, 1]
[joints.y]
role = "prescribed"
friction = { model = "lugre", coulomb = 2, static = 3, stribeck = 0.1, viscous = 1, bristle_stiffness = 1e4 }
[joints.z.drive]
winding = { resistance = 1, inductance = 1e-3, torque_constant = 2 }
current_limit = 5
voltage_limit = 24
controller.position = { kp = 9, kd = 0.1, filter = 0.01, limit = 2 }
controller.velocity = { kp = 4, ki = 40 }
controller.current = { kp = 1, ki = 100, tracking_time = 0.01 }
[[springs]]
name = "rope"
links = ["b", "base"]
points = [[0, 0, 1], [1, 0, 0]]
free_length = 0.5
stiffness = 100.0
tension_only = true
"""
BENT = """
name = "crane"
frames = [{ name = "eye", link = "arm", node = "tip" }]
springs = [{ name = "stay", links = ["base", "arm"], nodes = ["root", "tip"], stiffness = 10.0 }]
joints = [
    { name = "hinge", parent = "b", child = "arm", type = "revolute" },
    { name = "slides", parent = "arm", along = "beam", child = "trolley", type = "prismatic" },
    { name = "spindle", parent = "trolley", child = "nut", type = "screw", pitch = -0.01, z = { damping = 1.0 } },
]
links = [{ name = "a", mass = 2 }, { name = "b", mass = 1 }, { name = "arm", modal_damping = 0.01, beam = { \
axis = "y", length = 0.7, E = 7e10, G = 2.6e10, density = 2700, section = { rod = 0.02 }, modes = { y = 1, \
torsion = 1 }, nodes = { middle = 0.35 } } }, { name = "trolley", mass = 0.5 }, \
{ name = "nut", mass = 0.1 }]
[[beams]]
name = "boom"
parent = "base"
child = "a"
placement = { xyz = [0, 0, 1], rpy_deg = [0, 0, 30] }
axis = "-z"
length = 1.5
segments = 1
E = 7e10
G = 2.6e10
density = 2700
section = { tube = [0.1, 0.09] }
damping = { ratio = 0.01, at_hz = 40 }
[[beams]]
name = "jib"
parent = "a"
child = "b"
length = 0.5
segments = 1
E = 7e10
G = 2.6e10
density = 2700
A = 1e-3
Iy = 1e-7
Iz = 2e-7
J = 2e-7
shear = [0.8, 0.5]
damping = [1e-4, 0, 0, 1e-3, 1e-3, 1e-3]
rigid = ["x", "y", "z", "alpha"]
"""
SCENARIO = """
duration = 1.0
output_step = 0.01
frame = "tcp"
initial = { q = { joint1.x = 0.1, joint2 = 1 }, v = {}, z = { joint1.x.friction.z = 1e-6 }, equilibrium = false }
motion = { type = "via", points = [[0, 0], { joint1 = 1 }, [1, 1]], times = [0, 1, 2] }
control = { type = "pd", kp = { joint1 = 10 }, kd = 1, gravity = true, saturate = true }
integrator = { method = "auto", rtol = 1e-6, atol = 1e-8 }
prescribed = [{ type = "harmonic", coordinate = "mount.x", amplitude = 1e-3, frequency = 2, phase_deg = 30 }]
[[wrenches]]
link = "link2"
rows = [[0, 0, 0, 1, 0, 0, 0], [1, 0, 0, 2, 0, 0, 0]]
interpolation = "hold"
axes = "link"
[[payloads]]
link = "link2"
mass = 1
point = [0, 0, 0]
inertia = { xx = 1, yy = 1, zz = 1 }
t0 = 0.1
t1 = 0.5
"""
TORQUES = """
duration = 1
motion = { type = "circle", center = [0, 0, 0], normal = [0, 0, 1], from = [1, 0, 0], angle_deg = 90 }
control = { type = "torque", coordinates = ["joint1.gamma", "joint2.z"], rows = [[0, 1, 2], [1, 2, 3]] }
prescribed = [{ type = "sampled", file = "m.csv" }]
"""
FEEDFORWARD = """
duration = 1
motion = { type = "point_to_point", start = [0, 0], goal = [1, 1], begin = 0.1, duration = 0.5, smooth = 4 }
control = { type = "feedforward", kp = { joint1 = 10 }, kd = 1, outputs = ["tcp.x", "joint2"], tolerance = 1e-8 }
"""
LINE = """
duration = 1
motion = { type = "line", from = [1, 0, 0], to = [1, 1, 0], orientation = { from_deg = [0, 0, 90], to = [0, 0, 1] } }
"""
SPLINE = """
duration = 1
motion = { type = "spline", times = [0, 1], \
points = [{ xyz = [1, 0, 0], rpy_deg = [0, 0, 90] }, { xyz = [1, 1, 0], rpy = [0, 0, 1] }] }
"""
ROLLOUTS = """
samples = 3
record = ["tool_deviation_max"]
[engine]
type = "rollout"
[[vary]]
parameter = "joints.joint1.x.stiffness"
uniform = { low = 1e4, high = 2e4 }
"""
PLAN = """
samples = 4
seed = 1
design = "latin_hypercube"
record = ["drive_max", "coordinate_end"]
engine = { type = "rollout" }
[[vary]]
parameter = "joints.*.x.stiffness"
normal = { mean = 1, deviation = 0.1, low = 0.5, high = 2 }
relative = true
[[vary]]
scenario = "control.kd"
grid = { low = 1, high = 2, count = 3 }
"""
TOLERANCES = """
"joints.*.offset.*" = { deviation = 1e-4 }
"frames.tcp.*" = { bound = 1e-4, cost = 2 }
"*.x" = { deviation = 0.01, relative = true }
joints.j1.offset.gamma = { deviation = 1e-5, fixed = true }
joints.j2 = { stiffness = { deviation = 0.1, relative = true } }
base = { x = { deviation = 1e-3 }, y = { deviation = 1e-3, cost = 0.5 } }
correlations = [
    { names = ["base.x", "base.y", "joints.j1.offset.x"], matrix = [[1, 0.5, 0], [0.5, 1, 0.1], [0, 0.1, 1]] },
    { names = ["joints.*.offset.z", "joints.j2.offset.y"], coefficient = 0.6 },
]
"""
MIMICS = URDF.replace("</joint>", '<mimic joint="elbow" multiplier="2" offset="0.1"/></joint>', 1)
HELD = MJCF.replace(
    "<actuator>",
    '<equality><joint joint1="knee" joint2="hip" polycoef="0.1 2 0 0 0"/><connect body1="torso" anchor="0 0 1"/>'
    '<weld site1="head" site2="hook"/></equality><actuator>',
)


def element_tree(element: Any) -> list[Any]:
    """Return an element of XML as [tag, attributes, children]."""
    return [element.tag, dict(element.attrib), [element_tree(child) for child in element]]


def _elements(*texts: str) -> list[Any]:
    return [element_tree(ElementTree.fromstring(text)) for text in texts]


DOCUMENTS: dict[str, list[Any]] = {  # by kind of file; those that stand here more often are changed more often
    "toml": [tomllib.loads(text) for text in (ARM, SMALL, SMALL, SMALL, WORN, BENT)],
    "scenario": [tomllib.loads(text) for text in (SCENARIO, SCENARIO, TORQUES, FEEDFORWARD, LINE, SPLINE)],
    "plan": [tomllib.loads(PLAN)],
    "tolerances": [tomllib.loads(TOLERANCES)],
    "urdf": _elements(URDF, MIMICS),
    "mjcf": _elements(MJCF, HELD),
}
COORDINATES = ("joint1.x", "joint1.gamma", "joint2.z")
TABLES = {  # rows of cells
    "csv": [
        ["t", *COORDINATES[:2], "joint1.x.rate", "joint1.gamma.rate", "joint2.z.drive"],
        *([f"{k / 8}", f"{k}", f"{-k}.5", f"1e-{k}", f" {k}", f'"{k}"'] for k in range(6)),
    ],
    "dh": [
        ["joint", "type", "a_mm", "alpha_deg", "d", "theta", "lower", "upper", "mass", "com_z", "ixx", "iyy", "izz"],
        *([f"axis{k}", "revolute", f"{k}", "90", "-.1", "pi/2", "-1", f"{k}", "2", f" {k}", *"111"] for k in (1, 2)),
        ["", "prismatic", "", "0", "0.5", "-3 pi/4", *[""] * 7],
        ["", "fixed", "1e1", "-90", "0.1", "0", *[""] * 7],
    ],
    "mtx": [
        line.split()
        for line in ("%%MatrixMarket matrix coordinate real symmetric", "2 2 3", "1 1 2e3", "2 1 -4.5", "2 2 .5")
    ],
}
T = np.arange(5.0)
MOTIONS: list[dict[str, Any]] = [  # arrays of files
    {"t": T, "joint1.x": T**2, "joint1.x.rate": 2 * T, "joint1.gamma.drive": -T},
    {"t": T, "q": np.ones((5, 3)), "v": np.ones((5, 3)), "coordinates": np.array(COORDINATES)},
]
BEAM = LinkBeam(0.5, 7e10, 2.6e10, 1e-4, 2e-9, 5e-9, 7e-9, (1.0, 1.0), 2700.0, BeamModes(1, 1, 0, 0))


@cache
def bending_links() -> list[dict[str, Any]]:
    """Return the arrays of a file of a link's constants, and of one of the modes of its nodes."""
    modes, count = beam_modes(BEAM, 0.01), 4
    (tip,) = modes.nodes
    constants = {
        "H00": beam_inertia(BEAM),
        **{key: np.array(getattr(modes, key)) for key in ("H0", "P", "Q", "K", "D")},
        "interface_names": np.array(["tip"]),
        **{f"interface_{key}": np.array([getattr(tip, key[:5])]) for key in ("places", "Phi", "Psi")},
    }
    x = np.linspace(0.0, 0.5, count)
    Phi = np.zeros((count, 6, 2))
    Phi[:, 1, 0], Phi[:, 5, 0] = x**2, 2.0 * x
    Phi[:, 2, 1], Phi[:, 4, 1] = x**2, -2.0 * x
    nodal = {
        "nodes": np.stack([x, 0.0 * x, 0.0 * x], axis=1),
        "mass": np.array([0.1, 0.2, 0.2, 0.1]),
        "inertia": np.array([1e-4 * np.eye(3)] * count),
        "Phi": Phi,
        "K": np.diag([20.0, 50.0]),
        "interface_names": np.array(["tip", "middle"]),
        "interface_nodes": np.array([3, 1]),
    }
    return [constants, nodal]
