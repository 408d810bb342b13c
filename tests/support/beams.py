"""Cantilevers as descriptions and as linear systems, from the robot's values alone: no generator, no kernel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, expm
from scipy.optimize import brentq

from eomgen.description.load import robot_from_toml
from eomgen.robot.value import COORDINATES, Robot
from tests.support.description_samples import link_poses

Array = NDArray[np.float64]

STEEL = {"E": 2.1e11, "G": 8.0e10, "density": 7800.0}
SIZES = {"A": 2.0e-3, "Iy": 4.0e-7, "Iz": 3.0e-7, "J": 5.0e-7, "shear": [0.8, 0.6]}
HEAD = """
name = "crane"
[[links]]
name = "head"
mass = {mass}
"""


def toml(keys: Mapping[str, object], mass: float = 0.0, more: str = "") -> str:
    """A description with one beam from the base to a head; keys of the beam with their values, None for none."""
    given = {"name": "boom", "parent": "base", "child": "head", "length": 1.3, "segments": 2, **STEEL, **SIZES, **keys}
    return HEAD.format(mass=mass) + "[[beams]]\n" + "\n".join(lines_of(given)) + "\n" + more


def lines_of(keys: Mapping[str, object]) -> list[str]:
    return [f"{key} = {value_of(value)}" for key, value in keys.items() if value is not None]


def value_of(value: object) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(lines_of(value)) + " }"
    return f'"{value}"' if isinstance(value, str) else str(value)


def cantilever(mass: float = 0.0, more: str = "", **keys: Any) -> Robot:
    return robot_from_toml(toml(keys, mass, more))


@dataclass(frozen=True)
class Straight:
    """A cantilever's small motions about its straight pose: stiffness and mass matrix, (n, n), motions of each link
    and of the child by the coordinates, (6, n), displacement then rotation, base axes."""

    K: Array
    M: Array
    moved: dict[str, Array]
    masses: dict[str, float]
    child: str

    def deflection(self, forces: Array) -> Array:
        """Displacement and rotation of the child under generalized forces, (n,) or (n, k)."""
        moved: Array = self.moved[self.child] @ np.linalg.solve(self.K, forces)
        return moved

    def by_tip(self, wrench: Array) -> Array:
        """Displacement and rotation of the child under a force and a moment there."""
        return self.deflection(self.moved[self.child].T @ wrench)

    def by_weight(self, gravity: Array) -> Array:
        """The same under its own weight."""
        return self.deflection(sum(m * self.moved[name][:3].T @ gravity for name, m in self.masses.items()))

    def frequencies(self) -> Array:
        """Angular frequencies, rad/s, ascending."""
        found: Array = np.sqrt(1.0 / eigh(self.M, self.K, eigvals_only=True)[::-1])
        return found


def straight(robot: Robot) -> Straight:
    names = [(joint, name) for joint in robot.joints for name in joint.coordinates]
    poses = link_poses(robot, np.zeros(len(names)))
    above = {joint.child: joint for joint in robot.joints}
    moved: dict[str, Array] = {}
    masses: dict[str, float] = {}
    M = np.zeros((len(names), len(names)))
    for link in robot.links:
        R, origin = poses[link.name][:3, :3], poses[link.name][:3, 3]
        centre = origin + R @ link.com
        path, at = set(), link.name
        while at in above:
            path.add(above[at].name)
            at = above[at].parent
        columns = np.zeros((6, len(names)))
        for i, (joint, name) in enumerate(names):
            if joint.name in path:
                turned, place = poses[joint.child][:3, :3], poses[joint.child][:3, 3]
                axis = turned[:, COORDINATES.index(name) % 3]
                turns = COORDINATES.index(name) > 2
                columns[:, i] = [*(np.cross(axis, centre - place) if turns else axis), *(axis if turns else 0 * axis)]
        xx, yy, zz, xy, xz, yz = link.inertia
        inertia = R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T
        M += link.mass * columns[:3].T @ columns[:3] + columns[3:].T @ inertia @ columns[3:]
        moved[link.name], masses[link.name] = columns, link.mass
    K = np.diag([joint.coordinates[name].stiffness or 0.0 for joint, name in names])
    return Straight(K, M, moved, masses, robot.beams[0].child)


def timoshenko(bending: float, shear: float, line_mass: float, line_inertia: float, length: float) -> Array:
    """First three angular frequencies, rad/s, of Timoshenko's cantilever, clamped and free.

    The state (w, theta, M, V) along the beam: w' = theta + V / (k G A), theta' = M / (E I), M' = -V - rho I W^2 theta,
    V' = -rho A W^2 w; at a frequency W what is free at the tip is possible where the determinant vanishes.

    Args:
        bending: E I, N m^2.
        shear: k G A, N.
        line_mass: rho A, kg/m.
        line_inertia: rho I, kg m.
        length: m.
    """

    def free(x: float) -> float:
        square = x**4 * bending / (line_mass * length**4)
        A = np.zeros((4, 4))
        A[0, 1], A[0, 3], A[1, 2] = 1.0, 1.0 / shear, 1.0 / bending
        A[2, 3], A[2, 1], A[3, 0] = -1.0, -line_inertia * square, -line_mass * square
        scale = np.array([length, 1.0, bending / length, bending / length**2])
        return float(np.linalg.det(expm(A * length * scale / scale[:, None])[2:, 2:]))

    grid = np.linspace(0.3, 9.0, 400)
    values = [free(x) for x in grid]
    changes = [i for i in range(grid.size - 1) if values[i] * values[i + 1] < 0.0]
    roots = [brentq(free, grid[i], grid[i + 1], xtol=1e-13) for i in changes]
    found: Array = np.array(roots[:3]) ** 2 * np.sqrt(bending / line_mass) / length**2
    return found
