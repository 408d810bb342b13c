"""A rotor of bricks with a disc and an unbalance, its free-free modes, and this project's link of them."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eigh

from eomgen.arrays import Array
from eomgen.bending.constants import body_of, constants_of_masses
from eomgen.robot.elements import Bushing
from eomgen.robot.value import Coordinate, Frame, Joint, Link, Node, Placement, Robot, made_of

LENGTH, SHAFT, DISC = 0.5, 0.025, 0.2  # m: of the shaft, and radii of both
STATIONS = (0.0, 0.05, 0.1, 0.14, 0.16, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5)  # m: layers of nodes
THICK = (3, 4)  # layers of the disc
E, NU, DENSITY = 2.1e9, 0.3, 7850.0  # a hundredth of steel's stiffness, so that it bends
UNBALANCE = 0.1  # kg at the disc's rim
MODES = 8
STIFFNESS, DAMPING = 2e8, 2e6  # of bearings, N/m and N s/m
BEARINGS = {"left": (0.0, STIFFNESS), "right": (LENGTH, 0.0)}  # places on the shaft, m, and stiffness along it
SPEED = 100.0 * np.pi  # rad/s about the shaft

CORNERS = np.array(list(itertools.product((-1, 1), repeat=3)))
GAUSS = CORNERS / np.sqrt(3.0)


@dataclass(frozen=True, eq=False)
class Rotor:
    """Finite elements of the rotor: nodes (N, 3), lumped masses (N,), K (3 N, 3 N), and its free-free modes (3 N, m).

    ends: nodes of both ends of the shaft; middle: the node on its axis half way.
    """

    nodes: Array
    masses: Array
    K: Array
    modes: Array
    ends: tuple[Array, Array]
    middle: int

    @property
    def shapes(self) -> Array:
        """Displacements of nodes by modes, (N, 3, m)."""
        return self.modes.reshape(len(self.nodes), 3, -1)


def rotor() -> Rotor:
    """Return the rotor with its modes: those above the six rigid-body motions, masses 1."""
    nodes, bricks = _mesh()
    K, masses = np.zeros((3 * len(nodes),) * 2), np.zeros(len(nodes))
    for corners in bricks:
        places = (3 * corners[:, None] + np.arange(3)).ravel()
        stiffness, volumes = _brick(nodes[corners])
        K[np.ix_(places, places)] += stiffness
        masses[corners] += DENSITY * volumes
    masses[np.argmax(nodes[:, 1] - nodes[:, 2])] += UNBALANCE  # at the rim, where y is greatest
    M = np.repeat(masses, 3)
    modes = eigh(K, np.diag(M), subset_by_index=(6, 5 + MODES))[1]
    on_axis = np.hypot(nodes[:, 0], nodes[:, 1]) < 1e-9
    ends = tuple(np.flatnonzero(nodes[:, 2] == z) for z in (0.0, LENGTH))
    middle = int(np.flatnonzero(on_axis & (np.abs(nodes[:, 2] - 0.5 * LENGTH) < 1e-9))[0])
    return Rotor(nodes, masses, K, modes, (ends[0], ends[1]), middle)


def _mesh() -> tuple[Array, list[Any]]:
    """Return nodes and bricks: a square of four on the shaft's section, and a ring of eight on the disc's."""
    square = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=2)))
    size = np.abs(square).max(axis=1, keepdims=True)
    round_ = square * size / np.maximum(np.linalg.norm(square, axis=1, keepdims=True), 1e-12)
    rim = [i for i in range(9) if i != 4]
    turning = sorted(rim, key=lambda i: np.arctan2(square[i, 1], square[i, 0]))
    nodes: list[Any] = []
    inner = np.zeros((len(STATIONS), 9), dtype=int)
    outer: dict[int, dict[int, int]] = {}
    for layer, z in enumerate(STATIONS):
        for i in range(9):
            inner[layer, i] = len(nodes)
            nodes.append([*(SHAFT * round_[i]), z])
        if layer in THICK:
            outer[layer] = {}
            for i in rim:
                outer[layer][i] = len(nodes)
                nodes.append([*(DISC * round_[i]), z])
    bricks = []
    for layer in range(len(STATIONS) - 1):
        for i, j in itertools.product(range(2), repeat=2):
            corner = [inner[layer + c, 3 * (i + a) + j + b] for a, b, c in (CORNERS + 1) // 2]
            bricks.append(np.array(corner))
    low, high = THICK
    for one, other in zip(turning, [*turning[1:], turning[0]], strict=True):
        sides = {0: inner, 1: outer}
        corner = []
        for a, b, c in (CORNERS + 1) // 2:
            layer, i = (high if c else low), (other if b else one)
            corner.append(sides[a][layer][i])
        bricks.append(np.array(corner))
    return np.array(nodes), bricks


def _brick(places: Array) -> tuple[Array, Array]:
    """Return the stiffness matrix of a brick with these corners, (24, 24), and the volume at each."""
    lam, mu = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
    C = np.diag([2 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lam
    K, volumes = np.zeros((24, 24)), np.zeros(8)
    for point in GAUSS:
        factors = (1 + CORNERS * point) / 2
        slopes = np.array([CORNERS[:, d] / 2 * np.delete(factors, d, 1).prod(1) for d in range(3)])
        jacobian = slopes @ places
        dN, volume = np.linalg.solve(jacobian, slopes), np.linalg.det(jacobian)
        B = np.zeros((6, 24))
        for d in range(3):
            B[d, d::3] = dN[d]
        for row, (a, b) in enumerate(((0, 1), (1, 2), (0, 2)), 3):
            B[row, a::3], B[row, b::3] = dN[b], dN[a]
        K += volume * B.T @ C @ B
        volumes += volume * factors.prod(1)
    return K, volumes


def robot(made: Rotor) -> Robot:
    """Return the rotor behind a free joint, its ends in bearings, its middle a frame."""
    shapes, still = made.shapes, np.zeros((len(made.nodes), 3, MODES))
    constants = constants_of_masses(made.masses, made.nodes, np.zeros((len(made.nodes), 3, 3)), shapes, still)
    nodes = []
    for name, members in (("left", made.ends[0]), ("right", made.ends[1]), ("middle", [made.middle])):
        Phi = np.vstack([shapes[members].mean(axis=0), np.zeros((3, MODES))])
        nodes.append(Node(name, tuple(made.nodes[members].mean(axis=0).tolist()), _nested(Phi)))
    K = made.modes.T @ made.K @ made.modes
    modes = constants.link_modes(np.diag(np.diag(K)), np.zeros((MODES, MODES)), nodes)
    mass, com, inertia = body_of(constants.H00)
    link = Link("rotor", mass, com, inertia, modes)
    free = {name: Coordinate() for name in ("x", "y", "z", "alpha", "beta", "gamma")}
    joints = [Joint("pose", "base", "rotor", "free", coordinates=free)]
    links, couplings = [link], []
    for node_link, joint, coupled in made_of(link):
        links.append(node_link)
        joints.append(joint)
        couplings += coupled
    bearings = []
    for side, (z, along) in BEARINGS.items():
        k, d = (STIFFNESS, STIFFNESS, along, 0.0, 0.0, 0.0), (DAMPING,) * 3 + (0.0,) * 3
        placements = (Placement((0.0, 0.0, z)), Placement())
        bearings.append(
            Bushing(f"{side}_bearing", ("base", f"rotor_{side}"), placements=placements, stiffness=k, damping=d)
        )
    return Robot(
        "rotor",
        (0.0, 0.0, 0.0),
        tuple(links),
        tuple(joints),
        elements=tuple(bearings),
        frames=(Frame("middle", "rotor_middle"),),
        couplings=tuple(couplings),
    )


def _nested(x: Array) -> Any:
    """Return an array as nested tuples of floats."""
    return tuple(map(_nested, x)) if x.ndim else float(x)
