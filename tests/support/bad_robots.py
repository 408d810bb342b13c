"""Descriptions in TOML that the reader refuses: what is changed in ARM, and what the message must say."""

from __future__ import annotations

import re

from tests.support.description_samples import ARM


def changed(sample: str, old: str, new: str) -> str:
    assert sample.count(old) >= 1, old
    return sample.replace(old, new, 1)


def loop(extra: str, links: str = 'links = ["link2", "base"]', kind: str = 'type = "fixed"') -> tuple[str, str]:
    """What is replaced, and a loop in its place: keys that ``extra`` gives are not given twice."""
    lines = [line for line in (links, kind) if line.split(" ")[0] != extra.split(" ")[0]]
    return "[[frames]]", "\n".join(["[[loops]]", 'name = "loop"', *lines, extra, "[[frames]]"])


def spring(*extra: str, links: str = 'links = ["link2", "base"]') -> tuple[str, str]:
    """What is replaced, and a spring of these lines in its place."""
    return "[[frames]]", "\n".join(["[[springs]]", 'name = "rope"', links, *extra, "[[frames]]"])


def beam(**changes: str) -> tuple[str, str]:
    """What is replaced, and a beam from link2 to a further link in its place, with other texts of keys; "" for none."""
    keys = {"name": '"boom"', "parent": '"link2"', "child": '"tip"', "length": "0.5", "segments": "2"}
    keys |= {"E": "7e10", "G": "2.6e10", "density": "2700", "section": "{ rod = 0.02 }"} | changes
    lines = [f"{key} = {text}" for key, text in keys.items() if text]
    return "[[frames]]", "\n".join(["[[links]]", 'name = "tip"\nmass = 1', "[[beams]]", *lines, "[[frames]]"])


def bent(more: str = "", entries: str = "", **changes: str) -> tuple[str, str]:
    """What is replaced, and a link that is a beam behind link2 in its place: more keys, more entries, other texts."""
    keys = {"length": "0.5", "E": "7e10", "G": "2.6e10", "density": "2700", "section": "{ rod = 0.02 }"}
    keys |= {"modes": "{ y = 2 }"} | changes
    table = ", ".join(f"{key} = {text}" for key, text in keys.items() if text)
    link = f'[[links]]\nname = "boom"\nbeam = {{ {table} }}\n{more}'
    joint = '[[joints]]\nname = "hinge"\nparent = "link2"\nchild = "boom"\ntype = "revolute"'
    return "[[frames]]", "\n".join([link, joint, entries, "[[frames]]"])


def along(word: str = "beam", **changes: str) -> str:
    """Entries of a link on a joint that slides along that beam; other texts."""
    keys = {"name": "slides", "parent": "boom", "child": "trolley", "type": "prismatic", "along": word} | changes
    link = '[[links]]\nname = "trolley"\nmass = 1.0\ninertia = { xx = 1, yy = 1, zz = 1 }\n'
    return link + "[[joints]]\n" + "".join(f'{key} = "{text}"\n' for key, text in keys.items())


def limits(given: str) -> tuple[str, str]:
    """What is replaced, and a joint whose principal coordinate has these limits in its place."""
    return '"prismatic"', f'"prismatic"\nz = {{ limits = {{ {given} }} }}'


# what is replaced, by what, and what the message must say: the place, the value, what is allowed
TOML_CASES = {
    "syntax": ("mass = 3.0", "mass = = 3.0", ["my.toml:8:8: "]),
    "unknown key": (
        "stiffness = 1e6",
        "stiffnes = 1e6",
        ["joints.joint1.x", "'stiffnes'", "mean 'stiffness'", "damping"],
    ),
    "unknown top key": ("gravity =", "gravitiy =", ["'gravitiy'", "mean 'gravity'", "allowed: name"]),
    "unknown coordinate": ("x = { stiff", "delta = { stiff", ["joints.joint1", "'delta'", "allowed", "gamma"]),
    "key with control characters": ("gravity =", '"\\u001b[31m\\n" =', [r"'\x1b[31m\n'", "allowed"]),
    "duplicate key": ("mass = 3.0", "mass = 3.0\nmass = 4.0", ["my.toml:9:"]),
    "string for number": ("mass = 3.0", 'mass = "3.0"', ["links.link1.mass", "'3.0'", "at least 0"]),
    "boolean for number": ("mass = 3.0", "mass = true", ["links.link1.mass", "true", "at least 0"]),
    "number for table": (
        "x = { stiffness = 1e6, damping = 10 }",
        "x = 1e6",
        ["joints.joint1.x", "1000000.0", "a table"],
    ),
    "number for name": ('name = "link1"', "name = 1", ["links[0].name", "1", "a string"]),
    "date for number": ("mass = 3.0", "mass = 1979-05-27", ["links.link1.mass", "1979", "allowed"]),
    "table for array": ("gravity = [0.0, 0.0, -9.81]", "gravity = { z = -9.81 }", ["gravity", "a table", "3 numbers"]),
    "short vector": ("[0.1, 0.0, 0.0]", "[0.1, 0.0]", ["links.link1.com", "[0.1, 0.0]", "an array of 3 numbers"]),
    "text in vector": ("[0.1, 0.0, 0.0]", '[0.1, "a", 0.0]', ["links.link1.com.1", "'a'", "a finite number"]),
    "nested vector": ("[0.1, 0.0, 0.0]", "[[0.1], 0.0, 0.0]", ["links.link1.com.0", "[0.1]", "a finite number"]),
    "table for array of tables": ("[[frames]]", "[frames]", ["frames", "a table", "[[frames]]"]),
    "nan": ("mass = 3.0", "mass = nan", ["links.link1.mass", "nan", "at least 0"]),
    "inf": ("-9.81", "-inf", ["gravity.2", "-inf", "a finite number"]),
    "huge number": ("mass = 3.0", "mass = 1e200", ["links.link1.mass", "1e+200", "1e+30"]),
    "huge integer": ("mass = 3.0", "mass = 0x" + "f" * 9000, ["links.link1.mass", "36000 bits", "1e+30"]),
    "integer of 5000 digits": ("mass = 3.0", "mass = " + "9" * 5000, ["not valid TOML"]),
    "negative mass": ("mass = 3.0", "mass = -3.0", ["links.link1.mass", "-3.0", "at least 0"]),
    "negative stiffness": ("1e6", "-1e6", ["joints.joint1.x.stiffness", "-1000000.0", "at least 0"]),
    "negative damping": ("damping = 10", "damping = -10", ["joints.joint1.x.damping", "-10", "at least 0"]),
    "negative armature": ("0.02", "-0.02", ["joints.joint1.gamma.armature", "-0.02", "at least 0"]),
    "indefinite stiffness": (
        "x = { stiffness = 1e6, damping = 10 }",
        "x = {}\nstiffness = { matrix = [[1e6, 1e3], [1e3, 0.5]] }",
        ["joints.joint1.stiffness.matrix", "x.gamma", "1000.0", "up to 707.107", "units?"],
    ),
    "matrix of other coordinates": (
        "x = { stiffness = 1e6, damping = 10 }",
        "x = {}\ndamping = { matrix = [[1.0]] }",
        ["joints.joint1.damping.matrix", "1 row", "2, for x, gamma, or six"],
    ),
    "damping in proportion to nothing": (
        "x = { stiffness = 1e6, damping = 10 }",
        "x = {}\ndamping = { ratio = 0.02, at_hz = 40 }",
        ["joints.joint1.damping", "no table stiffness", "matrix"],
    ),
    "impossible inertia": ("zz = 0.2", "zz = 0.5", ["links.link1.inertia", "-0.1", '"warn"', '"project"', "--inertia"]),
    "indefinite inertia": ("xx = 0.1", "xx = -0.1", ["links.link1.inertia", "(-0.1, 0.2, 0.2", "allowed"]),
    "product of inertia": ("zz = 0.2", "zz = 0.2, xy = 0.3", ["links.link1.inertia", "eigenvalue -", "allowed"]),
    "inertia without zz": (", zz = 0.2", "", ["links.link1.inertia", "'zz'", "missing", "kg m^2"]),
    "mass missing": ("mass = 3.0\n", "", ["links.link1", "'mass'", "missing"]),
    "name missing": ('name = "link1"\n', "", ["links[0]", "'name'", "missing"]),
    "robot name missing": ('name = "arm"\n', "", ["'name'", "missing", "lower-case"]),
    "parent missing": ('parent = "base"\n', "", ["joints.joint1", "'parent'", "missing", "'base'"]),
    "type missing": ('type = "revolute"\n', "", ["joints.joint1", "'type'", "missing", "prismatic"]),
    "unknown type": ('"revolute"', '"revolut"', ["joints.joint1.type", "'revolut'", "mean 'revolute'", "free"]),
    "type of URDF": ('"revolute"', '"continuous"', ["joints.joint1.type", "'continuous'", "mean 'revolute'"]),
    "unsupported type": (
        '"revolute"',
        '"planar"',
        ["joints.joint1.type", "'planar'", "revolute, prismatic, fixed, free"],
    ),
    "unknown parent": (
        'parent = "link1"',
        'parent = "lnk1"',
        ["joints.joint2.parent", "'lnk1'", "mean 'link1'", "base"],
    ),
    "unknown child": ('child = "link2"', 'child = "lnk2"', ["joints.joint2.child", "'lnk2'", "mean 'link2'"]),
    "unknown link of frame": ('link = "link2"', 'link = "hand"', ["frames.tcp.link", "'hand'", "'link1', 'link2'"]),
    "two parents": ('child = "link2"', 'child = "link1"', ["joints.joint2.child", "'link1'", "'joint1'", "one parent"]),
    "cycle": ('parent = "base"', 'parent = "link2"', ["joints.joint", "'joint1', 'joint2'", "cycle", "a tree"]),
    "own parent": ('parent = "link1"', 'parent = "link2"', ["joints.joint2", "'joint2'", "cycle"]),
    "base as child": ('child = "link2"', 'child = "base"', ["joints.joint2.child", "'base'", "a link"]),
    "link without joint": ("[[frames]]", '[[links]]\nname = "far"\nmass = 1\n[[frames]]', ["links.far", "one joint"]),
    "link named base": ('name = "link1"', 'name = "base"', ["links.base.name", "another name"]),
    "duplicate link": ('name = "link2"', 'name = "link1"', ["links.link1", "unique"]),
    "duplicate joint": ('name = "joint2"', 'name = "joint1"', ["joints.joint1", "unique"]),
    "no identifier": ('name = "link1"', 'name = "link 1"', ["links[0].name", "'link 1'", "letter", "'link_1'"]),
    "trailing newline": ('name = "link1"', 'name = "link1\\n"', ["links[0].name", r"'link1\n'", "letter"]),
    "code in a name": ('name = "link1"', 'name = "*/ int x; /*"', ["links[0].name", "'*/ int x; /*'", "letter"]),
    "foreign letters": (
        'name = "joint1"',
        'name = "\N{GREEK SMALL LETTER PHI}"',
        ["joints[0].name", r"'\u03c6'", "letter"],
    ),
    "empty name": ('name = "link1"', 'name = ""', ["links[0].name", "''", "letter"]),
    "long name": ('name = "link1"', f'name = "{"l" * 5000}"', ["links[0].name", "lll...'", "128"]),
    "robot name in capitals": ('name = "arm"', 'name = "Arm"', ["name", "'Arm'", "lower-case", "'arm'"]),
    "robot name with newline": ('name = "arm"', 'name = "arm\\n"', ["name", r"'arm\n'", "lower-case"]),
    "long robot name": ('name = "arm"', f'name = "{"a" * 49}"', ["name", "'aaaa", "48"]),
    "dh and placement": ("dh =", "placement = {}\ndh =", ["joints.joint1", "both dh and placement", "one of them"]),
    "limits reversed": ("limits = [-1, 2]", "limits = [2, -1]", ["joints.joint1.limits", "[2, -1]", "lower <= upper"]),
    "limits of a fixed joint": ('type = "revolute"', 'type = "fixed"', ["joints.joint1.limits", "fixed", "revolute"]),
    "limits twice": (
        "gamma = { damping = 0.1",
        "gamma = { limits = { velocity = 1 }, damping = 0.1",
        ["joints.joint1.limits", "gamma has limits", "one of them"],
    ),
    "speed of a limit": (*limits("velocity = 0"), ["joints.joint2.z.limits.velocity", "greater than 0"]),
    "effort of a limit": (*limits("effort = -1"), ["joints.joint2.z.limits.effort", "greater than 0"]),
    "limits in their order": (
        *limits("lower = 1, upper = -1"),
        ["joints.joint2.z.limits", "lower is 1.0", "lower <= upper"],
    ),
    "no limits": (*limits(""), ["joints.joint2.z.limits", "lower, upper, velocity"]),
    "limits of a cut joint": (*loop("x = { limits = { velocity = 1 } }"), ["loops.loop.x", "unknown key 'limits'"]),
    "clearance without stiffness": (
        "stiffness = 1e6",
        "clearance = 1e-4",
        ["joints.joint1.x.clearance", "no stiffness", "stiffness > 0"],
    ),
    "key of a loop": (*loop("a = 1"), ["loops.loop", "unknown key 'a'", "placements"]),
    "key of a spring": (*spring("stifness = 1"), ["springs.rope", "'stifness'", "mean 'stiffness'", "tension_only"]),
    "spring without links": (*spring("stiffness = 1", links=""), ["springs.rope", "'links' is missing", "two names"]),
    "spring of three links": (
        *spring("stiffness = 1", links='links = ["base", "link1", "link2"]'),
        ["springs.rope.links", "two names, each 'base' or a link"],
    ),
    "spring of no link": (
        *spring("stiffness = 1", links='links = ["link2", "lnk1"]'),
        ["springs.rope.links.1", "'lnk1'", "mean 'link1'"],
    ),
    "spring of one link": (
        *spring("stiffness = 1", links='links = ["link2", "link2"]'),
        ["springs.rope.links", "both ends are on one link", "two different links"],
    ),
    "spring without force": (*spring("free_length = 1"), ["springs.rope", "no force", "stiffness, damping or curve"]),
    "negative spring": (*spring("stiffness = -1"), ["springs.rope.stiffness", "-1", "at least 0"]),
    "negative length": (
        *spring("stiffness = 1", "free_length = -0.1"),
        ["springs.rope.free_length", "-0.1", "at least 0"],
    ),
    "negative damper": (*spring("damping = -2.0"), ["springs.rope.damping", "-2.0", "at least 0"]),
    "infinite spring": (*spring("stiffness = inf"), ["springs.rope.stiffness", "inf", "at least 0"]),
    "one point": (*spring("stiffness = 1", "points = [[0, 0, 0]]"), ["springs.rope.points", "1 values", "two points"]),
    "flat point": (*spring("stiffness = 1", "points = [[0, 0], [0, 0, 0]]"), ["springs.rope.points.0", "3 numbers"]),
    "point that is none": (
        *spring("stiffness = 1", "points = [[0, 0, nan], [0, 0, 0]]"),
        ["springs.rope.points.0.2", "nan", "finite"],
    ),
    "cable of a word": (
        *spring("stiffness = 1", 'tension_only = "yes"'),
        ["springs.rope.tension_only", "true or false"],
    ),
    "cable of no length": (
        *spring("stiffness = 1", "tension_only = true"),
        ["springs.rope.tension_only", "no free_length and no smoothing"],
    ),
    "smoothing of no cable": (
        *spring("stiffness = 1", "smoothing = 0.1"),
        ["springs.rope.smoothing", "with tension_only = true"],
    ),
    "sharp cable": (
        *spring("stiffness = 1", "tension_only = true", "smoothing = 0"),
        ["springs.rope.smoothing", "at least 1e-12"],
    ),
    "curve and stiffness of a spring": (
        *spring("stiffness = 1", "curve = [[0, 0], [1, 1]]"),
        ["springs.rope.curve", "stiffness is set, too"],
    ),
    "curve of a cable": (
        *spring("tension_only = true", "smoothing = 0.1", "curve = [[0, 0], [1, 1]]"),
        ["springs.rope.curve", "tension_only is set, too"],
    ),
    "curve of a spring that falls back": (
        *spring("curve = [[0, 0], [1, 1], [0.5, 2]]"),
        ["springs.rope.curve", "point 2", "elongation 0.5", "elongations that rise"],
    ),
    "spring twice": (
        *spring("stiffness = 1", "[[springs]]", 'name = "rope"', 'links = ["link1", "base"]', "damping = 1"),
        ["springs.rope", "'rope' is taken"],
    ),
    "name of a spring": (*spring("stiffness = 1", "[[springs]]", 'name = "a b; x"'), ["springs[1].name", "'a b; x'"]),
    "tunable of a spring": (
        "tunable = [",
        'tunable = ["springs.rope.stiffness", ',
        ["tunable", "'springs.rope.stiffness'", "springs.SPRING.points"],
    ),
    "beam without length": (*beam(length=""), ["beams.boom", "'length' is missing", "greater than 0"]),
    "key of a beam": (*beam(lenght="1"), ["beams.boom", "'lenght'", "mean 'length'", "segments"]),
    "beam of length zero": (*beam(length="0"), ["beams.boom.length", "got 0", "greater than 0"]),
    "beam of no segments": (*beam(segments="0"), ["beams.boom.segments", "got 0", "from 1 to 100"]),
    "beam of many segments": (*beam(segments="101"), ["beams.boom.segments", "got 101", "from 1 to 100"]),
    "beam of half segments": (*beam(segments="2.5"), ["beams.boom.segments", "2.5", "whole number"]),
    "beam of no modulus": (*beam(E="nan"), ["beams.boom.E", "nan", "greater than 0"]),
    "beam along no axis": (*beam(axis='"w"'), ["beams.boom.axis", "'w'", "x, y, z, -x"]),
    "beam of no link": (*beam(parent='"lnk2"'), ["beams.boom.parent", "'lnk2'", "mean 'link2'", "the base or a link"]),
    "beam to no link": (*beam(child='"tpi"'), ["beams.boom.child", "'tpi'", "mean 'tip'"]),
    "beam to its root": (*beam(child='"link2"'), ["beams.boom.child", "the parent", "two different links"]),
    "beam to the base": (*beam(child='"base"'), ["beams.boom.child", "'base'", "nothing carries", "a link"]),
    "beam to a link of a joint": (
        *beam(child='"link1"'),
        ["beams.boom.child", "'link1'", "the child of joint 'joint1'", "one parent"],
    ),
    "beam in a circle": (*beam(parent='"tip"', child='"boom1"'), ["beams.boom.child", "child of joint 'boom1'"]),
    "link of a beam's name": (*beam(name='"link"'), ["beams.link.name", "link", "'link1', 'link2'", "another name"]),
    "joint of a beam's name": (*beam(name='"joint"'), ["beams.joint.name", "joint", "'joint1', 'joint2'", "another"]),
    "beam of a long name": (*beam(name=f'"{"b" * 126}"'), [".name", "called after it", "124 characters"]),
    "beam without section": (*beam(section=""), ["beams.boom", "'A' is missing", "A, Iy, Iz, J, shear, or a section"]),
    "beam without shear": (
        *beam(section="", A="1e-4", Iy="1e-9", Iz="1e-9", J="2e-9"),
        ["beams.boom", "'shear' is missing", "or a section"],
    ),
    "beam of two sections": (
        *beam(section="{ rod = 0.02, bar = [0.01, 0.02] }"),
        ["beams.boom.section", "2 keys", "one of tube, rod, bar, box, I"],
    ),
    "beam of no section": (*beam(section="{}"), ["beams.boom.section", "0 keys", "one of tube, rod"]),
    "beam of an unknown section": (*beam(section="{ L = [1, 2] }"), ["beams.boom.section", "'L'", "tube, rod"]),
    "tube that is none": (
        *beam(section="{ tube = [0.02, 0.02] }"),
        ["section.tube", "[0.02, 0.02]", "below the outer"],
    ),
    "box of thick walls": (
        *beam(section="{ box = [0.02, 0.01, 0.005] }"),
        ["section.box", "[height, width, thickness]", "below half"],
    ),
    "I-beam of thick flanges": (
        *beam(section="{ I = [0.02, 0.01, 0.01, 0.001] }"),
        ["section.I", "[height, width, flange, web]", "thinner than half"],
    ),
    "I-beam of three numbers": (*beam(section="{ I = [0.02, 0.01, 0.001] }"), ["section.I", "4 numbers"]),
    "negative section": (*beam(section="{ rod = -0.02 }"), ["section.rod", "-0.02", "greater than 0"]),
    "Poisson's ratio of no body": (
        *beam(G="1e10"),
        ["beams.boom.G", "ratio E / (2 G) - 1 is 2.5", "up to 0.5", "shear = [ky, kz]"],
    ),
    "three shear coefficients": (*beam(shear="[0.8, 0.8, 0.8]"), ["beams.boom.shear", "2 numbers"]),
    "damping of a beam twice": (
        *beam(damping="{ ratio = 0.1, loss_factor = 0.1, at_hz = 1 }"),
        ["beams.boom.damping", "both are given", "one of ratio, loss_factor"],
    ),
    "damping of a beam of none": (*beam(damping="{ at_hz = 1 }"), ["beams.boom.damping", "none is given"]),
    "damping of a beam at no frequency": (
        *beam(damping="{ ratio = 0.1 }"),
        ["beams.boom.damping", "'at_hz' is missing", "Hz"],
    ),
    "damping of a beam of five": (*beam(damping="[1, 1, 1, 1, 1]"), ["beams.boom.damping", "6 numbers"]),
    "damping of a beam as a word": (*beam(damping='"much"'), ["beams.boom.damping", "'much'", "a number in s, or six"]),
    "beam that is rigid": (
        *beam(rigid='["x", "y", "z", "alpha", "beta", "gamma"]'),
        ["beams.boom.rigid", "each once, not all"],
    ),
    "beam rigid in what is none": (*beam(rigid='["w"]'), ["beams.boom.rigid", "'w'", "x, y, z, alpha"]),
    "beam too stiff for numbers": (
        *beam(E="1e30", G="5e29", length="1e-6"),
        ["beams.boom", "stiffness x", "from 1e-30 to 1e+30"],
    ),
    "beam too short for numbers": (*beam(length="1e-200"), ["beams.boom", "its segments have", "allowed"]),
    "bending link without length": (*bent(length=""), ["links.boom.beam", "'length' is missing", "greater than 0"]),
    "bending link of no modulus": (*bent(E="-1"), ["links.boom.beam.E", "-1", "greater than 0"]),
    "bending link without modes": (*bent(modes=""), ["links.boom.beam", "'modes' is missing", "whole numbers"]),
    "bending link of no modes": (*bent(modes="{}"), ["links.boom.beam.modes", "there are none", "y, z, torsion"]),
    "bending link of half a mode": (*bent(modes="{ y = 0.5 }"), ["links.boom.beam.modes.y", "0.5", "from 0 to 12"]),
    "bending link of many modes": (*bent(modes="{ z = 13 }"), ["links.boom.beam.modes.z", "13", "from 0 to 12"]),
    "modes of a bending link in x": (*bent(modes="{ x = 1 }"), ["links.boom.beam.modes", "'x'", "torsion, axial"]),
    "bending link along no axis": (*bent(axis='"w"'), ["links.boom.beam.axis", "'w'", "x, y, z, -x"]),
    "bending link without section": (*bent(section=""), ["links.boom.beam", "'A' is missing", "or a section"]),
    "bending link of no body's ratio": (*bent(G="1e10"), ["links.boom.beam.G", "2.5", "up to 0.5"]),
    "bending link too short for numbers": (*bent(length="1e-200"), ["links.boom.beam", "allowed"]),
    "bending link of another mass": (*bent("mass = 1"), ["links.boom.mass", "got 1", "0.4241", "no mass"]),
    "bending link of another center": (*bent("com = [0, 0.1, 0]"), ["links.boom.com[0]", "0.25", "no com"]),
    "bending link of another inertia": (
        *bent("inertia = { xx = 1, yy = 1, zz = 1 }"),
        ["links.boom.inertia.xx", "got 1", "no inertia"],
    ),
    "bending link of two kinds": (*bent('modes = "a.npz"'), ["links.boom.modes", "both beam and modes", "one of them"]),
    "negative modal damping": (*bent("modal_damping = -0.1"), ["links.boom.modal_damping", "-0.1", "at least 0"]),
    "modal damping of a rigid link": (
        "mass = 3.0",
        "mass = 3.0\nmodal_damping = 0.1",
        ["links.link1.modal_damping", "no modes", "beam or modes"],
    ),
    "modes from a text": (
        "mass = 3.0",
        'mass = 3.0\nmodes = "arm.txt"',
        ["links.link1.modes", "'arm.txt'", "a .npz file"],
    ),
    "modes of no file": (
        "mass = 3.0",
        "modes = { count = 2 }",
        ["links.link1.modes", "'file' is missing", ".npz file"],
    ),
    "modes in other units": (
        "mass = 3.0",
        'modes = { file = "arm.npz", units = "inch" }',
        ["links.link1.modes.units", "'inch'", "mm"],
    ),
    "modes from nowhere": ("mass = 3.0", 'modes = "arm.npz"', ["links.link1.modes", "'arm.npz'", "relative to this"]),
    "node of a rigid link": (
        "child = ",
        'node = "tip"\nchild = ',
        ["joints.joint1.node", "'tip'", "does not bend", "root"],
    ),
    "node that is not there": (
        *bent(entries='[[frames]]\nname = "eye"\nlink = "boom"\nnode = "tpi"'),
        ["frames.eye.node", "'tpi'", "mean 'tip'", "root, tip"],
    ),
    "node of the base": (
        *bent(entries='[[springs]]\nname = "s"\nlinks = ["base", "boom"]\nnodes = ["tip", "tip"]\nstiffness = 1'),
        ["springs.s.nodes[0]", "'tip'", "'base'", "does not bend"],
    ),
    "one node of two": (
        *bent(entries='[[springs]]\nname = "s"\nlinks = ["base", "boom"]\nnodes = ["tip"]\nstiffness = 1'),
        ["springs.s.nodes", "two names of nodes"],
    ),
    "link of a node's name": (
        *bent(
            entries='[[links]]\nname = "boom_tip"\nmass = 1\n'
            '[[joints]]\nname = "j"\nparent = "boom"\nchild = "boom_tip"\ntype = "revolute"'
        ),
        ["links.boom", "'boom_tip'", "taken", "another name"],
    ),
    "bending link that nothing moves": (
        "[[frames]]",
        bent()[1].replace('"revolute"', '"fixed"'),
        ["links.boom", "'hinge' is rigid", "a joint that moves"],
    ),
    "node at the root of a beam": (
        *bent(nodes="{ start = 0.0 }"),
        ["links.boom.beam.nodes.start", "got 0.0", "greater than 0"],
    ),
    "node beyond a beam": (*bent(nodes="{ far = 0.6 }"), ["links.boom.beam.nodes.far", "0.6", "up to the length"]),
    "node of the tip's name": (*bent(nodes="{ tip = 0.2 }"), ["links.boom.beam.nodes", "'tip'", "identifiers but"]),
    "nodes as a list": (*bent(nodes="[0.2]"), ["links.boom.beam.nodes", "nodes"]),
    "joint along nothing": (*bent(entries=along("x")), ["joints.slides.along", "'x'", "beam"]),
    "joint along a rigid link": (
        *bent(entries=along(parent="link2")),
        ["joints.slides.along", "'link2'", "no beam", "links with beam"],
    ),
    "joint that turns along a beam": (
        *bent(entries=along(type="revolute")),
        ["joints.slides.along", "revolute", "prismatic"],
    ),
    "joint along a beam that is placed": (
        *bent(entries=along() + "placement = { xyz = [0, 0, 1] }"),
        ["joints.slides.placement", "slides along the beam's axis", "z alone"],
    ),
    "joint along a beam that gives way": (*bent(entries=along() + "x = {}"), ["joints.slides.x", "z alone"]),
    "joint beyond a beam": (
        *bent(entries=along() + "limits = [0.1, 0.7]"),
        ["joints.slides.limits", "0.1 to 0.7", "0 to 0.5 m"],
    ),
    "link of a sliding joint's name": (
        *bent(
            entries=along() + '[[links]]\nname = "boom_slides"\nmass = 1\n'
            '[[joints]]\nname = "j"\nparent = "boom"\nchild = "boom_slides"\ntype = "revolute"'
        ),
        ["joints.slides", "'boom_slides'", "taken", "another name"],
    ),
    "loop of three links": (*loop('links = ["base", "link1", "link2"]'), ["loops.loop.links", "two names"]),
    "loop of a string": (*loop('links = "link1"'), ["loops.loop.links", "strings"]),
    "loop of no link": (*loop('links = ["link2", "lnk1"]'), ["loops.loop.links.1", "'lnk1'", "mean 'link1'"]),
    "loop of one link": (*loop('links = ["link2", "link2"]'), ["loops.loop.links", "to itself", "different"]),
    "loop without links": (*loop('type = "fixed"', links=""), ["loops.loop", "'links' is missing", "two names"]),
    "loop without type": (*loop("", kind=""), ["loops.loop", "'type' is missing", "revolute", "planar"]),
    "type of a loop": (*loop("", kind='type = "hinge"'), ["loops.loop.type", "'hinge'", "mean 'revolute'"]),
    "placements of a loop": (*loop("placements = [{}]"), ["loops.loop.placements", "two tables"]),
    "placement of a loop": (*loop("placements = [{}, {xy = 1}]"), ["loops.loop.placements.1", "'xy'", "xyz, rpy"]),
    "angles of a loop twice": (
        *loop("placements = [{}, {rpy = [1, 0, 0], rpy_deg = [9, 0, 0]}]"),
        ["loops.loop.placements.1.rpy_deg", "rpy (rad) is given, too", "one of them"],
    ),
    "angle of dh twice": (
        "alpha = ",
        "alpha_deg = 9, alpha = ",
        ["joints.joint1.dh.alpha_deg", "alpha (rad) is given, too", "one of them"],
    ),
    "origin of a loop": (*loop("placements = [{}, {xyz = [1]}]"), ["loops.loop.placements.1.xyz", "3 numbers"]),
    "armature of a loop": (*loop("x = { armature = 1 }"), ["loops.loop.x", "'armature'", "stiffness, damping"]),
    "force of a loop": (*loop("x = { cubic = -1 }"), ["loops.loop.x.cubic", "-1", "at least 0"]),
    "drive that is not there": (
        "gravity =",
        'driven = ["joint1.zeta"]\ngravity =',
        ["driven", "'joint1.zeta'", "mean 'joint2.z'", "allowed"],
    ),
    "home that is not there": ("gravity =", "home = { joint9.x = 1 }\ngravity =", ["home", "'joint9.x'", "allowed"]),
    "negative clearance": (
        "stiffness = 1e6",
        "stiffness = 1e6, clearance = -1e-4",
        ["joints.joint1.x.clearance", "-0.0001", "at least 0"],
    ),
    "clearance of stiffness zero": (
        "stiffness = 1e6",
        "stiffness = 0, clearance = 1e-4",
        ["joints.joint1.x.clearance", "stiffness > 0"],
    ),
    "sharp clearance": (
        "stiffness = 1e6",
        "stiffness = 1, clearance = 0",
        ["joints.joint1.x.clearance", "no smoothing", "1e-12"],
    ),
    "smoothing zero": (
        "stiffness = 1e6",
        "stiffness = 1, clearance = 1, smoothing = 0",
        ["joints.joint1.x.smoothing", "0", "1e-12"],
    ),
    "smoothing of nothing": (
        "stiffness = 1e6",
        "stiffness = 1, smoothing = 1e-5",
        ["joints.joint1.x.smoothing", "no clearance"],
    ),
    "restitution of nothing": (
        "stiffness = 1e6",
        "restitution_damping = 1.0",
        ["joints.joint1.x.restitution_damping", "no clearance"],
    ),
    "negative restitution damping": (
        "stiffness = 1e6",
        "stiffness = 1, clearance = 1, restitution_damping = -1",
        ["joints.joint1.x.restitution_damping", "-1", "at least 0"],
    ),
    "one side only": (
        "stiffness = 1e6",
        "stiffness_negative = 1e6",
        ["joints.joint1.x.stiffness_negative", "with stiffness"],
    ),
    "falling cubic": ("stiffness = 1e6", "cubic = -1.0", ["joints.joint1.x.cubic", "-1", "at least 0"]),
    "endless preload": ("stiffness = 1e6", "preload = inf", ["joints.joint1.x.preload", "inf", "finite"]),
    "friction as a number": (
        "stiffness = 1e6",
        "friction = 1.0",
        ["joints.joint1.x.friction", "1.0", "a table", "coulomb"],
    ),
    "friction without coulomb": (
        "stiffness = 1e6",
        "friction = { viscous = 1.0 }",
        ["joints.joint1.x.friction", "'coulomb' is missing"],
    ),
    "static without stribeck": (
        "stiffness = 1e6",
        "friction = { coulomb = 1.0, static = 2.0 }",
        ["joints.joint1.x.friction", "static and stribeck"],
    ),
    "stribeck without static": (
        "stiffness = 1e6",
        "friction = { coulomb = 1.0, stribeck = 0.1 }",
        ["joints.joint1.x.friction", "static and stribeck"],
    ),
    "static below coulomb": (
        "stiffness = 1e6",
        "friction = { coulomb = 2.0, static = 1.0, stribeck = 0.1 }",
        ["joints.joint1.x.friction.static", "1.0", "at least coulomb, 2.0"],
    ),
    "stribeck zero": (
        "stiffness = 1e6",
        "friction = { coulomb = 1.0, static = 2.0, stribeck = 0.0 }",
        ["joints.joint1.x.friction.stribeck", "0.0", "1e-12"],
    ),
    "unknown friction": (
        "stiffness = 1e6",
        "friction = { coulomb = 1.0, statik = 2.0 }",
        ["joints.joint1.x.friction", "'statik'", "mean 'static'"],
    ),
    "drive with nothing in it": (
        "stiffness = 1e6",
        "drive = {}",
        ["joints.joint1.x.drive", "there is nothing in it", "lag, winding, controller"],
    ),
    "drive of what nothing drives": (
        "stiffness = 1e6",
        "stiffness = 1e6, drive = { lag = 0.1 }",
        ["joints.joint1.x.drive", "nothing drives 'joint1.x'", "joint1.gamma"],
    ),
    "winding without its constant": (
        "stiffness = 1e6",
        "drive = { winding = { resistance = 1.0, inductance = 1e-3 } }",
        ["joints.joint1.x.drive.winding.torque_constant", "it is missing"],
    ),
    "voltage limit of no winding": (
        "stiffness = 1e6",
        "drive = { lag = 0.1, voltage_limit = 24.0 }",
        ["joints.joint1.x.drive.voltage_limit", "there is no winding"],
    ),
    "loop without a gain": (
        "stiffness = 1e6",
        "drive = { controller = { velocity = { limit = 1.0 } } }",
        ["joints.joint1.x.drive.controller.velocity", "there is no gain", "kp, ki, kd"],
    ),
    "loop of no such quantity": (
        "stiffness = 1e6",
        "drive = { controller = { torque = { kp = 1.0 } } }",
        ["joints.joint1.x.drive.controller", "'torque'", "position, velocity, current"],
    ),
    "lag that is no time": (
        "stiffness = 1e6",
        "drive = { lag = -0.1 }",
        ["joints.joint1.x.drive.lag", "-0.1", "at least 1e-12"],
    ),
    "bristles without a stiffness": (
        "stiffness = 1e6",
        'friction = { model = "lugre", coulomb = 1.0 }',
        ["joints.joint1.x.friction", "'bristle_stiffness' is missing"],
    ),
    "bristles of no model": (
        "stiffness = 1e6",
        "friction = { coulomb = 1.0, bristle_stiffness = 1e4 }",
        ["joints.joint1.x.friction.bristle_stiffness", "the model is not lugre", 'with model = "lugre"'],
    ),
    "friction of another model": (
        "stiffness = 1e6",
        'friction = { model = "dahl", coulomb = 1.0, bristle_stiffness = 1e4 }',
        ["joints.joint1.x.friction.model", "'dahl'", "lugre"],
    ),
    "bristles that nothing bends": (
        "stiffness = 1e6",
        'friction = { model = "lugre", coulomb = 0.0, bristle_stiffness = 1e4 }',
        ["joints.joint1.x.friction.coulomb", "0.0", "at least 1e-12"],
    ),
    "bristles and smoothing": (
        "stiffness = 1e6",
        'friction = { model = "lugre", coulomb = 1.0, bristle_stiffness = 1e4, smoothing = 1e-3 }',
        ["joints.joint1.x.friction.smoothing", "the model is lugre"],
    ),
    "bristles on a lorentzian curve": (
        "stiffness = 1e6",
        'friction = { model = "lugre", coulomb = 1, static = 2, stribeck = 0.1, shape = "lorentzian", '
        "bristle_stiffness = 1e4 }",
        ["joints.joint1.x.friction.shape", "'lorentzian'", "the model is lugre", "gaussian"],
    ),
    "bristles that fade too late": (
        "stiffness = 1e6",
        'friction = { model = "lugre", coulomb = 1.0, bristle_stiffness = 1e4, bristle_damping = 50.0, fade = 1.0 }',
        ["joints.joint1.x.friction.fade", "1.0", "a lower velocity"],
    ),
    "damping of no bristles": (
        "stiffness = 1e6",
        "friction = { coulomb = 1.0, bristle_damping = 5.0 }",
        ["joints.joint1.x.friction.bristle_damping", "there is no bristle_stiffness"],
    ),
    "hysteresis that gives energy back": (
        "stiffness = 1e6",
        "hysteresis = { stiffness = 1e5, beta = 10, gamma = -20 }",
        ["joints.joint1.x.hysteresis.gamma", "-20.0", "from -10.0 to 10.0"],
    ),
    "hysteresis of nothing that yields": (
        "stiffness = 1e6",
        "hysteresis = { stiffness = 1e5, beta = 10, gamma = 5, share = 1 }",
        ["joints.joint1.x.hysteresis.share", "1.0", "less than 1"],
    ),
    "hysteresis without a number": (
        "stiffness = 1e6",
        "hysteresis = { stiffness = 1e5, beta = 10 }",
        ["joints.joint1.x.hysteresis", "'gamma' is missing"],
    ),
    "hysteresis of another model": (
        "stiffness = 1e6",
        'hysteresis = { model = "preisach", stiffness = 1e5, beta = 10, gamma = 5 }',
        ["joints.joint1.x.hysteresis.model", "'preisach'", "bouc_wen"],
    ),
    "branches that are no table": (
        "stiffness = 1e6",
        "maxwell = 3",
        ["joints.joint1.x.maxwell", "got 3", "an array of branches"],
    ),
    "no branch": ("stiffness = 1e6", "maxwell = []", ["joints.joint1.x.maxwell", "1 to 8 tables"]),
    "branch without a damper": (
        "stiffness = 1e6",
        "maxwell = [{ stiffness = 1, damping = 1 }, { stiffness = 1 }]",
        ["joints.joint1.x.maxwell.1", "'damping' is missing"],
    ),
    "loss factor of no stiffness": (
        "stiffness = 1e6",
        "maxwell = { loss_factor = 0.1, band_hz = [1, 10] }",
        ["joints.joint1.x.maxwell", "no stiffness"],
    ),
    "loss factor over a band that falls": (
        "stiffness = 1e6",
        "stiffness = 1e6, maxwell = { loss_factor = 0.1, band_hz = [10, 1] }",
        ["joints.joint1.x.maxwell.band_hz", "that rise"],
    ),
    **{
        name: ("stiffness = 1e6", law, [f"joints.joint1.x.{place}", said])
        for name, law, place, said in (
            ("loop of no stiffness", "hysteresis = { beta = 1, gamma = 0.5 }", "hysteresis", "no hysteresis.stiffness"),
            (
                "blunt loop",
                "hysteresis = { stiffness = 1.0, beta = 1.0, gamma = 0.5, n = 0.5 }",
                "hysteresis.n",
                "at least 1",
            ),
            ("branch of no damping", "maxwell = [{ stiffness = 1, damping = 0.0 }]", "maxwell.0.damping", "0.0"),
            ("no loss", "stiffness = 1.0, maxwell = { band_hz = [1.0, 2.0] }", "maxwell", "loss_factor"),
        )
    },
    "curve of one point": ("stiffness = 1e6", "curve = [[0, 0]]", ["joints.joint1.x.curve", "1 points", "2 to 64"]),
    "curve of many points": (
        "stiffness = 1e6",
        f"curve = {[[i, 0] for i in range(65)]}",
        ["joints.joint1.x.curve", "65 points", "2 to 64"],
    ),
    "curve that turns back": (
        "stiffness = 1e6",
        "curve = [[0, 0], [1, 2], [1, 3]]",
        ["joints.joint1.x.curve", "point 2", "1.0 after 1.0", "rise"],
    ),
    "curve of triples": (
        "stiffness = 1e6",
        "curve = [[0, 0, 1], [1, 2, 3]]",
        ["joints.joint1.x.curve.0", "[0, 0, 1]", "2 numbers"],
    ),
    "curve of words": ("stiffness = 1e6", 'curve = [[0, 0], [1, "a"]]', ["joints.joint1.x.curve.1.1", "'a'", "finite"]),
    "curve as a number": ("stiffness = 1e6", "curve = 3", ["joints.joint1.x.curve", "3", "array of arrays"]),
    "curve from nowhere": ("stiffness = 1e6", 'curve = "a.csv"', ["joints.joint1.x.curve", "'a.csv'", "relative"]),
    "matrix from nowhere": (
        "limits = [-1, 2]",
        'stiffness = { matrix = "K.mtx" }',
        ["joints.joint1.stiffness.matrix", "'K.mtx'", "relative"],
    ),
    "matrix of another file": (
        "limits = [-1, 2]",
        'stiffness = { matrix = "K.txt" }',
        ["joints.joint1.stiffness.matrix", "'K.txt'", ".mtx or .npz or .csv"],
    ),
    "curve and stiffness": (
        "stiffness = 1e6",
        "stiffness = 1, curve = [[0, 0], [1, 2]]",
        ["joints.joint1.x.curve", "stiffness is set, too", "instead of"],
    ),
    "curve and friction that is none": (
        "stiffness = 1e6",
        "curve = [[0, 0], [1, 2]], friction = { coulomb = 1, static = 2 }",
        ["joints.joint1.x.friction", "static and stribeck"],
    ),
    "prescribed": ("limits =", 'prescribed = ["w"]\nlimits =', ["joints.joint1.prescribed", "'w'", "x, y, z, alpha"]),
    "role": ("stiffness = 1e6", 'role = "drive"', ["joints.joint1.x.role", "'drive'", "free, locked, prescribed"]),
    "inertia policy": ("tunable =", 'inertia = "ignore"\ntunable =', ["inertia", "'ignore'", "error, warn, project"]),
    "urdf without folder": ("tunable =", 'urdf = "a.urdf"\ntunable =', ["urdf", "'a.urdf'", "relative"]),
    "tunable of no link": ("links.link2.mass", "links.lnk2.mass", ["tunable", "lnk2.mass", "links.link2.mass"]),
    "tunable of no joint": (
        "links.link2.mass",
        "joints.joint3.x.damping",
        ["tunable", "joint3.x", "joints.joint1.x.damping"],
    ),
    "tunable of inactive": ("links.link2.mass", "joints.joint2.x.damping", ["tunable", "joint2.x", "allowed: gravity"]),
    "tunable rpy of dh": ("links.link2.mass", "joints.joint1.placement.rpy", ["tunable", "joint1", "dh has none"]),
    "tunable half wildcard": (
        "links.link2.mass",
        "links.link*.mass",
        ["tunable", "'links.link*.mass'", "any one component"],
    ),
    "tunable number": ('["links.link2.mass"]', "[3]", ["tunable", "[3]", "an array of strings"]),
    "nothing moves": ('"revolute"', '"fixed"', ["joints", "allowed"]),
}


NOTHING_MOVES = re.sub("^(x|gamma|limits) = .*\n", "", ARM, flags=re.MULTILINE).replace('"prismatic"', '"fixed"')
