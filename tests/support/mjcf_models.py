"""Random MJCF models of all that the reader takes: orientations, default classes, frames, geoms, joints, tendons."""

from __future__ import annotations

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from tests.support.random_robots import random_rotation

SHAPES = {"sphere": 1, "capsule": 2, "ellipsoid": 3, "cylinder": 2, "box": 3}
SEQUENCES = ("xyz", "XYZ", "zyx", "zxz", "xYz", "ZyX")


class RandomModel:
    """The model of a seed.  ``text`` is its XML."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.degrees = self.chance(0.5)
        self.sites: list[str] = []
        self.bodies = self.joints = 0
        root = Element("mujoco", model=f"random{seed}")
        compiler = SubElement(root, "compiler", angle="degree" if self.degrees else "radian")
        compiler.set("eulerseq", str(self.rng.choice(SEQUENCES)))
        if self.chance(0.3):
            compiler.set("boundmass", "2.5")
            compiler.set("boundinertia", "0.05")
        self.always_geoms = self.chance(0.2)
        if self.always_geoms:
            compiler.set("inertiafromgeom", "true")
        option = SubElement(root, "option", gravity=self.text(self.rng.uniform(-10, 10, 3)))
        if self.chance(0.2):
            SubElement(option, "flag", damper="disable")
        self.defaults(root)
        world = SubElement(root, "worldbody")
        SubElement(world, "geom", type="plane", size="1 1 1")
        self.site(world)
        trees = [world]
        for i in range(int(self.rng.integers(2, 4))):
            parent = trees[int(self.rng.integers(len(trees)))]
            trees.append(self.body(parent, free=parent is world and self.chance(0.3), moves=i > 0 or self.chance(0.9)))
        self.tendons(root)
        self.text_of = ElementTree.tostring(root, encoding="unicode")

    def chance(self, p: float) -> bool:
        return bool(self.rng.random() < p)

    def text(self, values: object) -> str:
        return " ".join(repr(float(value)) for value in np.atleast_1d(values))

    def angle(self, radians: object) -> str:
        return self.text(np.atleast_1d(radians) * (180 / np.pi if self.degrees else 1.0))

    def orientation(self, element: Element) -> None:
        kind = self.rng.integers(7)
        if kind == 0:
            element.set("quat", self.text(self.rng.standard_normal(4)))
        elif kind == 1:
            axis = np.append(self.rng.standard_normal(3), 0.0)
            element.set("axisangle", self.text(axis[:3]) + " " + self.angle(self.rng.uniform(-3, 3)))
        elif kind == 2:
            element.set("xyaxes", self.text(self.rng.standard_normal(6)))
        elif kind == 3:
            choices = [[0, 0, -2], [0, 1, 0], *self.rng.standard_normal((3, 3))]
            element.set("zaxis", self.text(choices[int(self.rng.integers(5))]))
        elif kind == 4:
            element.set("euler", self.angle(self.rng.uniform(-3, 3, 3)))
        elif kind == 5:
            element.set("euler", self.angle(self.rng.choice([0, np.pi / 2, np.pi], 3)))

    def place(self, element: Element) -> Element:
        if self.chance(0.8):
            element.set("pos", self.text(self.rng.uniform(-0.4, 0.4, 3)))
        self.orientation(element)
        return element

    def defaults(self, root: Element) -> None:
        top = SubElement(root, "default", {"class": "main"} if self.chance(0.5) else {})
        SubElement(top, "joint", damping="0.3")
        SubElement(top, "geom", density="900")
        for name in ("soft", "hard"):
            outer = SubElement(top, "default", {"class": name})
            SubElement(outer, "joint", stiffness=self.text(self.rng.uniform(1, 20)), armature="0.1")
            SubElement(outer, "geom", type="box", size="0.1 0.2 0.15")
            SubElement(outer, "site", euler=self.angle([0.1, 0.2, 0.3]), pos="0.1 0 0")
            inner = SubElement(outer, "default", {"class": f"{name}_slide"})
            SubElement(inner, "joint", type="slide", axis="1 2 0", damping="1.5")
            SubElement(inner, "geom", mass="1.25")
            SubElement(inner, "site", zaxis="1 0 1")

    def classed(self, element: Element) -> Element:
        if self.chance(0.3):
            element.set("class", str(self.rng.choice(["main", "soft", "hard_slide", "soft_slide"])))
        return element

    def inside(self, body: Element) -> Element:
        """The body, or a frame in it."""
        if self.chance(0.6):
            return body
        frame = self.place(SubElement(body, "frame"))
        if self.chance(0.3):
            frame.set("childclass", "soft")
        return self.inside(frame)

    def body(self, parent: Element, free: bool, moves: bool) -> Element:
        self.bodies += 1
        body = self.place(SubElement(self.inside(parent), "body", name=f"body{self.bodies}"))
        if self.chance(0.4):
            body.set("childclass", str(self.rng.choice(["soft", "hard"])))
        if free:
            SubElement(body, "freejoint")
        elif moves:
            self.some_joints(body)
        if not self.always_geoms and self.chance(0.4):
            self.inertial(body)
        else:
            for _ in range(int(self.rng.integers(1, 4))):
                self.geom(self.inside(body))
        for _ in range(int(self.rng.integers(0, 2))):
            self.site(self.inside(body))
        return body

    def some_joints(self, body: Element) -> None:
        if self.chance(0.15):
            damping = self.text(self.rng.uniform(0.0, 2.0))
            self.joint(body, type="ball", stiffness="0", damping=damping, armature="0", pos="0.1 0 0.2")
            return
        count = int(self.rng.integers(1, 4))
        triad, anchor = random_rotation(self.rng), self.text(self.rng.uniform(-0.2, 0.2, 3))
        together = self.chance(0.6)  # as eomgen's joints have them, or in any order
        kinds = sorted(self.rng.choice(["slide", "hinge"], count), reverse=True) if together else None
        for i in range(count):
            kind = str(kinds[i]) if kinds else str(self.rng.choice(["slide", "hinge"]))
            axis = triad[:, i] if together else self.rng.standard_normal(3)
            given = {"type": kind, "axis": self.text(axis), "pos": anchor if together else self.text(0.1 * axis)}
            where = body if together else self.inside(body)
            self.classed(self.joint(where, **given))

    def joint(self, parent: Element, **given: str) -> Element:
        self.joints += 1
        joint = SubElement(parent, "joint", name=f"joint{self.joints}", **given)
        if given["type"] != "ball":
            turn = self.angle if given["type"] == "hinge" else self.text
            for key in ("ref", "springref"):
                if self.chance(0.4):
                    joint.set(key, turn(self.rng.uniform(-0.5, 0.5)))
            if self.chance(0.4):
                joint.set("stiffness", self.text(self.rng.uniform(1, 50)))
            if self.chance(0.4):
                joint.set("range", turn([-0.5, 0.75]))
        return joint

    def inertial(self, body: Element) -> None:
        a, b, c = self.rng.uniform(0.05, 0.2, 3)
        moments, mass = np.array([b + c, a + c, a + b]), self.text(self.rng.uniform(1, 5))
        item = SubElement(body, "inertial", mass=mass, pos=self.text(self.rng.uniform(-0.3, 0.3, 3)))
        if self.chance(0.5):
            turn = random_rotation(self.rng)
            full = turn @ np.diag(moments) @ turn.T
            item.set("fullinertia", self.text(full[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]))
        else:
            item.set("diaginertia", self.text(moments))
            self.orientation(item)

    def geom(self, parent: Element) -> None:
        geom = SubElement(parent, "geom")
        kind = str(self.rng.choice(list(SHAPES)))
        sizes = self.rng.uniform(0.05, 0.3, SHAPES[kind])
        if not self.chance(0.2):
            geom.set("type", kind)
            geom.set("size", self.text(sizes))
            if kind != "sphere" and self.chance(0.4):
                geom.set("fromto", self.text(self.rng.uniform(-0.3, 0.3, 6)))
                geom.set("size", self.text(sizes[:1]))
        else:
            geom.set("class", "hard_slide")
        if "fromto" not in geom.attrib:
            self.place(geom)
        if self.chance(0.3):
            geom.set("mass", self.text(self.rng.uniform(0.5, 3)))
        elif self.chance(0.3):
            geom.set("density", self.text(self.rng.uniform(100, 3000)))
        if self.chance(0.15):
            geom.set("group", "3")

    def site(self, parent: Element) -> None:
        name = f"site{len(self.sites)}"
        self.sites.append(name)
        if self.chance(0.2):
            ends = self.text(self.rng.uniform(-0.3, 0.3, 6))
            SubElement(
                parent, "site", {"name": name, "type": "capsule", "size": "0.1", "fromto": ends, "class": "main"}
            )
            return
        site = self.classed(SubElement(parent, "site", name=name))
        self.place(site)
        if "quat" in site.attrib:  # by a default class it would be another
            site.set("zaxis", "0 1 1")
            del site.attrib["quat"]

    def tendons(self, root: Element) -> None:
        tendons = SubElement(root, "tendon")
        for i in range(len(self.sites) - 1):
            tendon = SubElement(tendons, "spatial", name=f"tendon{i}", stiffness=self.text(self.rng.uniform(5, 50)))
            if self.chance(0.5):
                tendon.set("damping", "0.7")
            if self.chance(0.5):
                tendon.set("springlength", self.text(self.rng.uniform(0, 1)))
            for k in (i, i + 1):
                SubElement(tendon, "site", site=self.sites[k])


def random_model(seed: int) -> str:
    """Its XML."""
    return RandomModel(seed).text_of


def humanoids(count: int) -> str:
    """So many bodies of 22 coordinates, with motors, tendons and sensors, and with pictures whose files are missing."""
    worldbody, actuator, tendon, sensor = [], [], [], []
    for k in range(count):
        limbs = [f"{side}{limb}{k}" for side in "lr" for limb in ("arm", "leg")]
        inside = "".join(
            f'<body name="upper_{n}" pos="0 0.1 0"><joint name="a_{n}" axis="1 0 0" armature="0.01"/>'
            f'<joint name="b_{n}" axis="0 1 0" range="-30 40"/><joint name="c_{n}" stiffness="3" damping="1"/><geom/>'
            f'<geom type="mesh" mesh="limb" class="shown"/><body name="lower_{n}" pos="0 0 -0.3"><joint name="d_{n}"'
            ' axis="0 1 0"/><geom/><geom type="mesh" mesh="limb" class="shown"/></body></body>'
            for n in limbs
        )
        torso = '<freejoint/><geom type="sphere" size="0.1"/><geom type="mesh" mesh="torso" class="shown"/>'
        worldbody.append(f'<body name="torso{k}" pos="{0.1 * k} 0 1">{torso}{inside}</body>')
        actuator += [f'<motor name="{j}_{n}" joint="{j}_{n}" ctrlrange="-1 1"/>' for n in limbs for j in "abcd"]
        tendon += [
            f'<fixed name="{n}"><joint joint="a_{n}" coef="2"/><joint joint="d_{n}" coef="1"/></fixed>' for n in limbs
        ]
        sensor += [f'<jointpos joint="{j}_{n}"/>' for n in limbs for j in "abcd"]
    assets = '<mesh name="limb" file="limb.stl"/><mesh name="torso" file="torso.stl"/>'
    picture = '<texture name="skin" type="2d" file="skin.png"/><material name="skin" texture="skin"/>'
    shown = '<default class="shown"><geom contype="0" conaffinity="0" density="0" material="skin"/></default>'
    default = f'<default><geom type="capsule" size="0.05 0.1"/>{shown}</default>'
    sections = {"worldbody": worldbody, "actuator": actuator, "tendon": tendon, "sensor": sensor}
    body = "".join(f"<{tag}>{''.join(items)}</{tag}>" for tag, items in sections.items())
    return f"<mujoco>{default}<asset>{assets}{picture}</asset>{body}</mujoco>"
