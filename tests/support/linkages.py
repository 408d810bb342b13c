"""Mechanisms with closed loops: known linkages, and the kernels that say how they move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.ladder import rod
from eomgen.robot.value import Coordinate, Joint, Link, Loop, Placement, Robot
from tests.support.random_robots import Array
from tests.support.recuts import inverse, placed, pose

KERNELS = (
    "constraint",
    "constraint_jacobian",
    "constraint_bias",
    "cut_poses",
    "constrained_dynamics",
    "residual",
    "mass_matrix",
    "tree_inverse_dynamics",
    "energy",
    "kinematics",
)

FREE = {  # coordinates of eq. (3) that a cut joint leaves free
    "revolute": ("gamma",),
    "prismatic": ("z",),
    "cylindrical": ("z", "gamma"),
    "universal": ("alpha", "beta"),
    "spherical": ("alpha", "beta", "gamma"),
    "planar": ("x", "y", "gamma"),
    "fixed": (),
}


def bricard(ground: Placement | None = None) -> Robot:
    """Bricard's mechanism, problem A04 of the IFToMM library of multibody benchmarks.

    Six revolute joints at right angles, five rods of 1 m and 1 kg, weight along -y.  The library starts it at rest
    along edges of a cube (``threefold`` of a right angle).

    Args:
        ground: where the first joint stands.
    """
    quarter, stand = (np.pi / 2, -np.pi / 2), ground or Placement()
    joints = tuple(
        hinge(
            f"joint{i}",
            "base" if i == 1 else f"rod{i - 1}",
            f"rod{i}",
            stand if i == 1 else Placement.from_dh(1.0, quarter[i % 2], 0.0, 0.0),
        )
        for i in range(1, 6)
    )
    behind = inverse(Placement.from_dh(1.0, quarter[1], 0.0, 0.0))
    ends = Placement.from_dh(1.0, quarter[0], 0.0, 0.0), placed(pose(stand) @ pose(behind))
    cut = Loop("joint6", ("rod5", "base"), "revolute", ends)
    return Robot("bricard", (0.0, -9.81, 0.0), tuple(rod(f"rod{i}") for i in range(1, 6)), joints, loops=(cut,))


def threefold(theta: float) -> Array:
    """Angles of the threefold-symmetric form, Chen, You and Tarnai (2005) at 90 degrees."""
    phi = np.arccos(-np.cos(theta) / (1 + np.cos(theta)))
    return np.array([theta, phi, theta, phi, theta])


def bennett(
    a: float, alpha: float, beta: float, theta: float, links: Sequence[Link], ground: Placement
) -> tuple[Robot, Array]:
    """Bennett's linkage (1903) with the twists alpha and beta (rad) of its sides a (m) and a sin(beta) / sin(alpha).

    Args:
        theta: angle of its first joint.
        links: link1, link2, link3.
        ground: where the first joint stands.

    Returns:
        The robot, and the coordinates that close it.
    """
    b = a * np.sin(beta) / np.sin(alpha)
    short, long = Placement.from_dh(a, alpha, 0.0, 0.0), Placement.from_dh(b, beta, 0.0, 0.0)
    joints = (
        hinge("joint1", "base", "link1", ground),
        hinge("joint2", "link1", "link2", short),
        hinge("joint3", "link2", "link3", long),
    )
    cut = Loop("joint4", ("link3", "base"), "revolute", (short, placed(pose(ground) @ pose(inverse(long)))))
    product = np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2)
    other = 2.0 * np.arctan(product / np.tan(theta / 2))
    robot = Robot("bennett", (0.0, -9.81, 0.0), tuple(links), joints, loops=(cut,))
    return robot, np.array([theta, other, -theta])


def hinge(name: str, parent: str, child: str, placement: Placement) -> Joint:
    """A revolute joint without forces."""
    return Joint(name, parent, child, "revolute", placement, coordinates={"gamma": Coordinate()})
