"""Random descriptions, scenarios, plans and tolerances that are nearly right: trees changed where it hurts, raw bytes.

A document is a tree (TOML values, or XML elements as [tag, attributes, children]); a mutant is a function of the kind
and the seed alone.
"""

from __future__ import annotations

import json
import random
import re
import tomllib
from collections.abc import Iterator
from copy import deepcopy
from typing import Any
from xml.sax.saxutils import quoteattr

from defusedxml import ElementTree

from tests.support.description_samples import ARM, MJCF, URDF

SMALL = """
name = "rod"
tunable = ["links.*.mass", "gravity"]
[[links]]
name = "l1"
mass = 1.0
inertia = { xx = 0.1, yy = 0.1, zz = 0.1 }
[[joints]]
name = "j1"
parent = "base"
child = "l1"
type = "revolute"
x = { stiffness = 1e4 }
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
motor = { inertia = 1e-4, ratio = 100, stiffness = 1e4, damping = 1, limits = { upper = 300, effort = 0.5 }, \
hysteresis = { model = "bouc_wen", stiffness = 1e3, A = 1, beta = 100, gamma = 50, n = 1.5, share = 0.5 }, \
friction = { model = "lugre", coulomb = 0.1, bristle_stiffness = 10, bristle_damping = 0.1, fade = 0.5 } }
offset = { x = 1e-3, alpha = 1e-3 }
[[joints]]
name = "j2"
parent = "a"
child = "b"
type = "prismatic"
z = { drive = { winding = { resistance = 1, inductance = 1e-3, torque_constant = 2 }, current_limit = 5, \
voltage_limit = 24, controller = { position = { kp = 9, kd = 0.1, filter = 0.01, limit = 2 }, \
velocity = { kp = 4, ki = 40 }, \
current = { kp = 1, ki = 100, tracking_time = 0.01 } } } }
x = { curve = [[-1, -2], [0, 0], [1, 3]], limits = { lower = -2, velocity = 3 }, \
maxwell = [{ stiffness = 10, damping = 1 }, { stiffness = 5, damping = 9 }] }
y = { role = "prescribed", friction = { model = "lugre", coulomb = 2, static = 3, stribeck = 0.1, \
viscous = 1, bristle_stiffness = 1e4 } }
prescribed = ["y"]
stiffness = { matrix = [[200, 1, 0], [1, 10, 0], [0, 0, 5]], preload = [1, 0, 2] }
damping = { ratio = 0.1, at_hz = 5 }
limits = [-1, 1]
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
[[links]]
name = "a"
mass = 2
[[links]]
name = "b"
mass = 1
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
[[links]]
name = "arm"
modal_damping = 0.01
[links.beam]
axis = "y"
length = 0.7
E = 7e10
G = 2.6e10
density = 2700
section = { rod = 0.02 }
modes = { y = 1, torsion = 1 }
nodes = { middle = 0.35 }
[[joints]]
name = "hinge"
parent = "b"
child = "arm"
type = "revolute"
[[links]]
name = "trolley"
mass = 0.5
[[joints]]
name = "slides"
parent = "arm"
along = "beam"
child = "trolley"
type = "prismatic"
[[frames]]
name = "eye"
link = "arm"
node = "tip"
[[springs]]
name = "stay"
links = ["base", "arm"]
nodes = ["root", "tip"]
stiffness = 10.0
"""
SCENARIO = """
duration = 1.0
output_step = 0.01
frame = "tcp"
initial = { q = { joint1.x = 0.1, joint2 = 1 }, v = {}, z = { joint1.x.friction.z = 1e-6 }, equilibrium = false }
motion = { type = "via", points = [[0, 0], { joint1 = 1 }, [1, 1]], times = [0, 1, 2] }
control = { type = "pd", kp = { joint1 = 10 }, kd = 1, gravity = true, saturate = true }
integrator = { method = "auto", rtol = 1e-6, atol = 1e-8 }
[[prescribed]]
type = "harmonic"
coordinate = "mount.x"
amplitude = 1e-3
frequency = 2
phase_deg = 30
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
[motion]
type = "spline"
points = [{ xyz = [1, 0, 0], rpy_deg = [0, 0, 90] }, { xyz = [1, 1, 0], rpy = [0, 0, 1] }]
times = [0, 1]
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
correlations = [
    { names = ["base.x", "base.y", "joints.j1.offset.x"], matrix = [[1, 0.5, 0], [0.5, 1, 0.1], [0, 0.1, 1]] },
    { names = ["joints.*.offset.z", "joints.j2.offset.y"], coefficient = 0.6 },
]
[base]
x = { deviation = 1e-3 }
y = { deviation = 1e-3, cost = 0.5 }
"""

PIECES = [
    *('"', "'", '"""', "'''", "\\", "\n", "\r", "\0", "#", "=", ".", ",", "[", "]", "[[", "]]", "{", "}", "<"),
    *(">", "/>"),
    *("&amp;", "&#0;", "&#x202e;", "&x;", "<!--", "-->", "<![CDATA[", "]]>", "<?x?>", "<!DOCTYPE a>", "\ufeff"),
    *("nan", "inf", "-inf", "1e999", "-0", "0x", "1_0", "1979-05-27", "true", "\N{SNOWMAN}", "\u202e", "\U0001f600"),
    *("[[links]]", "[joints]", "name = ", '<link name="a"/>', "</robot>", '<joint name="j" type="fixed">', "a.b.c = 1"),
]
NAMES = [
    *("base", "world", "link1", "link2", "joint1", "joint2", "j1", "j2", "a", "b", "l1", "upper", "lower"),
    *("ground", "tcp"),
    *("elbow", "shoulder", "revolute", "prismatic", "continuous", "floating", "planar", "fixed", "free", "locked", "x"),
    *("gamma", "prescribed", "project", "warn", "error", "links.*.mass", "*", "*.*.*", "joints", "a.urdf", "m.csv", ""),
    *("base.x", "joints.*.offset.z", "*.*", "**", "joints.*o*o*o*o*o*o*o*o*o*o*o*o*o*o*p.*.x", "frames.tcp.x"),
    *("..", "../../etc/passwd.csv", "\0.csv", "\n", "\x1b[31m", "\u202e", "int", "*/", "%s%n", "a" * 200),
    *("\U0001f600" * 90,),
]
NUMBERS = [0, -1, 1, 1e-320, 1e30, -1e30, 1e31, 1e308, 2**63, 2**70, -(2**2000), 0.1, 1e-12, 1e-9, 0.5, 3.14159265]
EMPTY = [[], {}, [[]], [{}], {"": 0}, [0, 0, 0], [[0, 1], [1, 2]]]
VALUES = [*NUMBERS, *NAMES, *EMPTY, True, False, float("nan"), float("inf")]
ATTRIBUTES = ["0", "1", "-1", "nan", "inf", "1e400", "0 0 1", "1 2", "0x1", "", " ", "9" * 400, "1e-300 0 0", *NAMES]
KEYS = sorted(
    set(
        re.findall(
            r"[A-Za-z_]+(?= =)",
            ARM + WORN + BENT + SCENARIO + TORQUES + FEEDFORWARD + LINE + SPLINE + PLAN + TOLERANCES,
        )
    )
    | {"stifness", "", "a b", "\n", "__class__"}
)
TAGS = [
    *("link", "joint", "inertial", "origin", "mass", "inertia", "axis", "limit", "dynamics", "mimic", "parent"),
    *("child", "robot"),
]
MJCF_TAGS = [
    *("body", "joint", "freejoint", "geom", "site", "frame", "inertial", "default", "compiler", "option", "flag"),
    *("worldbody", "tendon", "spatial", "fixed", "equality", "connect", "weld", "include", "replicate", "actuator"),
]
MJCF_NAMES = (
    *("name", "class", "childclass", "type", "pos", "quat", "euler", "zaxis", "axis", "fromto", "size", "mass", "ref"),
    *("joint1", "joint2", "polycoef", "body1", "body2", "anchor", "relpose", "site1", "site2"),
    *("stiffness", "range", "angle", "eulerseq", "inertiafromgeom", "balanceinertia", "boundmass", "springlength"),
)
MJCF_VALUES = (
    *("true", "false", "auto", "radian", "degree", "zyx", "slide", "hinge", "ball", "free", "box", "sphere", "mesh"),
    *("ellipsoid", "cylinder", "0 0 0", "1 0 0 0", "0 0 0 0 0 1", "1 2 3", "leg", "main", "world", "torso", "hook"),
)
XML = ("urdf", "mjcf")


MIMICS = URDF.replace("</joint>", '<mimic joint="elbow" multiplier="2" offset="0.1"/></joint>', 1)
HELD = MJCF.replace(
    "<actuator>",
    '<equality><joint joint1="knee" joint2="hip" polycoef="0.1 2 0 0 0"/><connect body1="torso" anchor="0 0 1"/>'
    '<weld site1="head" site2="hook"/></equality><actuator>',
)


def element_tree(element: Any) -> list[Any]:
    return [element.tag, dict(element.attrib), [element_tree(child) for child in element]]


DOCUMENTS: dict[str, list[Any]] = {
    "toml": [tomllib.loads(text) for text in (ARM, SMALL, SMALL, SMALL, WORN, BENT)],
    "scenario": [tomllib.loads(text) for text in (SCENARIO, SCENARIO, TORQUES, FEEDFORWARD, LINE, SPLINE)],
    "plan": [tomllib.loads(PLAN)],
    "tolerances": [tomllib.loads(TOLERANCES)],
    "urdf": [element_tree(ElementTree.fromstring(text)) for text in (URDF, MIMICS)],
    "mjcf": [element_tree(ElementTree.fromstring(text)) for text in (MJCF, HELD)],
}


def mutant(kind: str, seed: int) -> bytes:
    """The file of that kind and seed."""
    chance = random.Random(f"{kind} {seed}")
    tree = deepcopy(chance.choice(DOCUMENTS[kind]))
    if chance.random() < 0.9:
        for _ in range(chance.choice((1, 1, 1, 2, 2, 3, 6))):
            (change_element if kind in XML else change_value)(tree, chance)
    text = as_xml(tree) if kind in XML else as_document(tree)
    content = text.encode("utf-8", "surrogatepass")
    return raw(content, chance) if chance.random() < 0.2 else content


def raw(content: bytes, chance: random.Random) -> bytes:
    """Truncation, flipped bits, splices and insertions."""
    for _ in range(chance.choice((1, 1, 2, 4))):
        at, other = (chance.randrange(len(content) + 1) for _ in range(2))
        kind = chance.random()
        if kind < 0.2:
            content = content[:at]
        elif kind < 0.4 and at < len(content):
            content = content[:at] + bytes([content[at] ^ 1 << chance.randrange(8)]) + content[at + 1 :]
        elif kind < 0.6:
            content = content[:at] + content[other : other + chance.randrange(60)] + content[at:]
        elif kind < 0.7:
            content = content[:at] + content[at + chance.randrange(20) :]
        else:
            content = content[:at] + chance.choice(PIECES).encode() + content[at:]
    return content


def places(node: Any) -> Iterator[tuple[Any, Any]]:
    """Every container of a tree with every key in it."""
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        yield node, key
        if isinstance(value, (dict, list)):
            yield from places(value)


def change_value(tree: dict[str, Any], chance: random.Random) -> None:
    """One change of a TOML tree."""
    found = list(places(tree))
    if not found:
        tree[chance.choice(KEYS)] = chance.choice(VALUES)
        return
    node, key = chance.choice(found)
    kind = chance.random()
    if kind < 0.35:
        node[key] = deepcopy(chance.choice(VALUES))
    elif kind < 0.5 and isinstance(node[key], (int, float)) and abs(node[key]) < 1e300:
        node[key] = chance.choice((-1, 2, 1e12, 1e-12)) * node[key]
    elif kind < 0.6:
        del node[key]
    elif kind < 0.7:
        other, place = chance.choice(found)
        node[key] = deepcopy(other[place])
    elif kind < 0.8 and isinstance(node, list):
        node.insert(key, deepcopy(node[key]))
    elif kind < 0.9 and isinstance(node, dict):
        node[chance.choice(KEYS)] = deepcopy(chance.choice([*VALUES, node[key]]))
    elif kind < 0.93 and isinstance(node, dict):
        node[chance.choice(KEYS)] = node.pop(key)
    else:
        node[key] = chance.choice((lambda x: [x], lambda x: {"x": x}, lambda x: [x] * 70, str))(node[key])


def elements(tree: list[Any]) -> Iterator[list[Any]]:
    yield tree
    for child in tree[2]:
        yield from elements(child)


def change_element(tree: list[Any], chance: random.Random) -> None:
    """One change of a tree of elements."""
    found, mjcf = list(elements(tree)), tree[0] == "mujoco"
    values, tags = ((*ATTRIBUTES, *MJCF_VALUES), MJCF_TAGS) if mjcf else (ATTRIBUTES, TAGS)
    names = MJCF_NAMES if mjcf else ("name", "type", "link", "xyz", "rpy", "value", "lower", "xmlns", "x:y")
    tag, attributes, children = node = chance.choice(found)
    kind = chance.random()
    if kind < 0.5 and attributes:
        name = chance.choice(list(attributes))
        attributes[name] = chance.choice((*values, attributes[name] + " 1", "-" + attributes[name]))
    elif kind < 0.6 and attributes:
        del attributes[chance.choice(list(attributes))]
    elif kind < 0.7 and children:
        children.pop(chance.randrange(len(children)))
    elif kind < 0.8:
        children.insert(0, deepcopy(chance.choice(found)))
    elif kind < 0.85:
        node[0] = chance.choice([*tags, "visual", "x:macro", "{", tag])
    elif kind < 0.9:
        attributes[chance.choice(names)] = chance.choice(MJCF_VALUES) if mjcf else "1 0 0"
    elif kind < 0.95:
        chance.shuffle(children)
    else:
        other = chance.choice(found)
        node[1], other[1] = other[1], node[1]


def as_xml(tree: list[Any]) -> str:
    tag, attributes, children = tree
    start = "".join([f"<{tag}", *(f" {key}={quoteattr(value)}" for key, value in attributes.items())])
    return f"{start}>{''.join(map(as_xml, children))}</{tag}>\n" if children else f"{start}/>\n"


def as_document(tree: dict[str, Any]) -> str:
    return "".join(f"{_key(key)} = {as_toml(value)}\n" for key, value in tree.items())


def toml_string(text: str) -> str:
    """A string of TOML in ASCII; JSON's notation has pairs of surrogates in it, which TOML does not take."""
    plain = (c if " " <= c <= "~" and c not in '"\\' else f"\\U{ord(c):08x}" for c in text)
    return '"' + "".join(plain) + '"'


def _key(key: str) -> str:
    return key if re.fullmatch("[A-Za-z0-9_-]+", key) else toml_string(key)


def as_toml(value: object) -> str:
    """A value in TOML's inline notation."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(key)} = {as_toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, str):
        return toml_string(value)
    return json.dumps(value) if isinstance(value, (bool, int)) else str(value)
