"""Closed mechanisms whose free and ball joints turn as far as they like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eomgen.robot.value import ANGULAR, COORDINATES, Coordinate, Joint, Link, Loop, Placement, Robot
from tests.support.random_robots import Array
from tests.support.recuts import placed, pose

INTEGRATED = (
    *("constrained_dynamics", "constraint", "constraint_jacobian", "mass_matrix", "residual", "energy", "kinematics"),
    *("forward_dynamics_jacobian", "external_force", "rollout", "adaptive_rollout", "cut_poses"),
)
OFFSET, STAND = (0.3, -0.2, 0.25), (0.1, 0.2, 0.3)  # of the pendulum's point on its link, and in the base, m
BODY = Link("body", 2.0, (0.1, 0.0, 0.05), (0.1, 0.12, 0.09, 0.01, 0.0, 0.0))
ACROSS = (-np.pi / 2, 0.0, 0.0)  # roll, pitch and yaw of a frame whose z is y of the one before


def free(name: str, parent: str, child: str, placement: Placement | None = None) -> Joint:
    coordinates = dict.fromkeys(COORDINATES, Coordinate())
    return Joint(name, parent, child, "free", placement or Placement(), coordinates=coordinates)


def ball(name: str, parent: str, child: str, placement: Placement | None = None) -> Joint:
    coordinates = dict.fromkeys(ANGULAR, Coordinate())
    return Joint(name, parent, child, "fixed", placement or Placement(), coordinates=coordinates)


def held_pendulum() -> Robot:
    """A free body of which a cut joint holds one point."""
    cut = Loop("pivot", ("base", "body"), "spherical", (Placement(xyz=STAND), Placement(xyz=OFFSET)))
    return Robot("held_pendulum", (0.0, 0.0, -9.81), (BODY,), (free("free", "base", "body"),), loops=(cut,))


def hung_pendulum() -> Robot:
    """The same without a loop: the point is the link's origin, and a ball joint is there."""
    x, y, z = np.subtract(BODY.com, OFFSET).tolist()
    joint = ball("ball", "base", "body", Placement(xyz=STAND))
    return Robot("hung_pendulum", (0.0, 0.0, -9.81), (replace(BODY, com=(x, y, z)),), (joint,))


def hinged_body(hinges: int) -> Robot:
    """A free body without weight that cut hinges on one line let turn about y alone; of two the second is redundant."""
    frames = [Placement.from_rpy((0.0, 0.2 * i, 0.0), ACROSS) for i in range(hinges)]
    cuts = tuple(Loop(f"hinge{i}", ("base", "body"), "revolute", (frame, frame)) for i, frame in enumerate(frames))
    return Robot(f"hinged_body_{hinges}", (0.0, 0.0, 0.0), (BODY,), (free("free", "base", "body"),), loops=cuts)


def triangle(turned: bool = False) -> Robot:
    """Two links on ball joints, whose end a third ball joint holds, which is cut.

    turned: whether the ball joints' own axes stand otherwise.  Their frames' origins, and where links are, stay.
    """
    links = Link("first", 1.0, (0.2, 0.05, 0.0), BODY.inertia), Link("second", 1.0, (0.1, -0.05, 0.1), BODY.inertia)
    places = Placement(xyz=(0.0, 0.0, 0.0)), Placement(xyz=(0.5, 0.1, 0.0))
    if turned:
        places = Placement.from_rpy(places[0].xyz, (0.4, -0.9, 2.0)), Placement.from_rpy(places[1].xyz, (2.1, 0.7, 0.5))
    joints = ball("shoulder", "base", "first", places[0]), ball("elbow", "first", "second", places[1])
    ends = Placement(xyz=(0.3, -0.2, 0.1)), Placement(xyz=(0.4, 0.1, 0.2))
    cut = Loop("wrist", ("base", "second"), "spherical", ends)
    name = "turned_triangle" if turned else "triangle"
    return Robot(name, (0.0, 0.0, -9.81), links, joints, loops=(cut,))


def random_ring(seed: int, turned: bool = False) -> Robot:
    """Two or three links in a row on free, ball and hinge joints, the last one held by a cut joint; closed at home.

    turned: as of the triangle; home is where the cut joint is closed that has other axes.
    """
    rng = np.random.default_rng(seed)
    links, joints, home, last, parent = [], [], dict[str, float](), np.eye(4), "base"
    for i in range(int(rng.integers(2, 4))):
        x, y, z = rng.uniform(-0.2, 0.2, 3).tolist()
        name, child, kind = f"joint{i}", f"link{i}", ("free", "ball", "hinge", "ball")[int(rng.integers(0, 4))]
        links.append(Link(child, float(rng.uniform(0.5, 2.0)), (x, y, z), BODY.inertia))
        place = rng.uniform(-0.4, 0.4, 3).tolist()
        axes, others, q = rng.uniform(-3.0, 3.0, 3).tolist(), rng.uniform(-3.0, 3.0, 3).tolist(), rng.normal(size=6)
        at, moved = Placement.from_rpy(place, axes), np.eye(4)
        if kind == "hinge":
            joint = Joint(name, parent, child, "revolute", at, coordinates={"gamma": Coordinate()})
            q[:5] = 0.0
        else:
            joint = (free if kind == "free" else ball)(name, parent, child, at)
            q[:3] *= kind == "free"
        moved[:3, 3], moved[:3, :3] = q[:3], rotation(q[3:])
        last = last @ pose(at) @ moved
        home |= {f"{name}.{x}": float(q[COORDINATES.index(x)]) for x in joint.coordinates}
        if turned and kind != "hinge":
            joint = replace(joint, placement=Placement.from_rpy(place, others))
        joints.append(joint)
        parent = child
    end = Placement.from_rpy(*rng.uniform(-0.3, 0.3, (2, 3)).tolist())
    cut = Loop(
        "ring", ("base", parent), str(rng.choice(["spherical", "universal", "planar"])), (placed(last @ pose(end)), end)
    )
    name = f"ring_{seed}{'_turned' if turned else ''}"
    return Robot(name, (0.0, 0.0, -9.81), tuple(links), tuple(joints), loops=(cut,), home=home)


def cranked_plate(angle: float = 0.0) -> Robot:
    """A free plate that is welded to a driven crank, by a cut, and so turns about y; home is at an angle of both."""
    crank = Link("crank", 1.0, (0.1, 0.0, 0.0), (0.01, 0.02, 0.03, 0.0, 0.0, 0.0))
    stand, weld = (
        Placement.from_rpy((0.0, 0.0, 0.0), ACROSS),
        Placement.from_rpy((0.2, 0.0, 0.0), (np.pi / 2, 0.0, 0.0)),
    )
    hinge = Joint("hinge", "base", "crank", "revolute", stand, coordinates={"gamma": Coordinate()})
    cut = Loop("weld", ("crank", "body"), "fixed", (weld, Placement(xyz=(0.1, 0.0, 0.0))))
    return Robot(
        "cranked_plate",
        (0.0, 0.0, -9.81),
        (crank, BODY),
        (hinge, free("pose", "base", "body")),
        loops=(cut,),
        home={"hinge.gamma": angle, "pose.beta": angle},
    )


def rotation(angles: Array) -> Array:
    """Rx(alpha) Ry(beta) Rz(gamma), (3, 3)."""
    (sa, sb, sg), (ca, cb, cg) = np.sin(angles), np.cos(angles)
    rows = (
        (cb * cg, -cb * sg, sb),
        (ca * sg + sa * sb * cg, ca * cg - sa * sb * sg, -sa * cb),
        (sa * sg - ca * sb * cg, sa * cg + ca * sb * sg, ca * cb),
    )
    return np.array(rows)


def held_at(angles: Array, rates: Array) -> tuple[Array, Array]:
    """q and v of the held pendulum where the hung one has these angles and rates; these by a complex step."""
    change = np.imag(rotation(angles + 1e-30j * rates)) / 1e-30
    q = np.concatenate([STAND - rotation(angles) @ OFFSET, angles])
    return q, np.concatenate([-change @ np.array(OFFSET), rates])
