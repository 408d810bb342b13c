"""Stations of a link that bends: points of its axis with what the modes make of them, by which it is drawn.

Those of a beam are exact.  Of other links modes are known at the nodes alone: between two of them, or the root, stand
C. Hermite's cubics, which have the displacements and slopes of both ends, as a beam without loads in between.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ...arrays import Array
from ...robot.value import AXES, Link, LinkBeam, Node
from ..beam import beam_shapes

COUNT = 21  # of stations along an axis
SECTORS = 16  # of a round section
_BESIDE = 0.05  # of the distance from the root: what lies nearer to the line to a node is passed on the way
_ROUNDS = ("tube", "rod")  # kinds of sections
_ROUND = 1e-6  # by which a torsion constant may be off the polar moment of a round section, as a part


@dataclass(frozen=True, eq=False)
class Stations:
    """S points of an axis of a link with m modes, in the link's frame.

    places: while nothing bends, (S, 3), m.  Phi, Psi: as of nodes, (S, 6, m) and (S, 3, m, m).  axes: columns along
    the axis and along y and z of its sections, (3, 3).  outline: of a section, along its y and z, anticlockwise,
    corners twice, (K, 2), m; None where its form is not known.
    """

    places: Array
    Phi: Array
    Psi: Array
    axes: Array
    outline: Array | None = None

    def coordinates(self, e: ArrayLike) -> Array:
        """Return x, y, z, alpha, beta, gamma of the sections by modal coordinates (..., m), (..., S, 6), m and rad."""
        modal = np.asarray(e, dtype=np.float64)
        found: Array = np.einsum("skm,...m->...sk", self.Phi, modal)
        found[..., :3] += 0.5 * np.einsum("sklm,...l,...m->...sk", self.Psi, modal, modal)
        return found


@lru_cache(maxsize=64)
def stations_of(link: Link) -> tuple[Stations, ...]:
    """Return the axes of a link that bends: that of a beam, else one to each node; none of a link without nodes."""
    modes, beam = link.modes, link.beam
    if modes is None:
        return ()
    if beam is not None and sum(beam.modes.counts.values()) == modes.count:
        along, axes = np.linspace(0.0, beam.length, COUNT), np.array(AXES[beam.axis])
        Phi, Psi = beam_shapes(beam, along)
        return (Stations(np.outer(along, axes[:, 0]), Phi, Psi, axes, _outline(beam)),)
    root = Node("", (0.0, 0.0, 0.0), ((0.0,) * modes.count,) * 6)
    nodes = sorted(modes.nodes, key=lambda node: math.hypot(*node.place))
    found = [_between(_on_the_way(node, nodes[:k], root), node) for k, node in enumerate(nodes)]
    return tuple(x for x in found if x is not None)


def _on_the_way(node: Node, nearer: Sequence[Node], root: Node) -> Node:
    """Return the last node on the straight line from the root to another one; the root where there is none."""
    place = np.array(node.place)
    square = float(place @ place)
    for other in reversed(nearer):
        at = np.array(other.place)
        off = at - (at @ place) / square * place if square > 0.0 else at
        if at @ place > 0.0 and off @ off < _BESIDE**2 * square:
            return other
    return root


def _between(first: Node, last: Node) -> Stations | None:
    """Return the axis from a node to another one; None where both are at one place."""
    begin, end = np.array(first.place), np.array(last.place)
    length = float(np.linalg.norm(end - begin))
    if length == 0.0:
        return None
    d = (end - begin) / length
    s = np.linspace(0.0, 1.0, COUNT)[:, None, None]
    (u0, t0), (u1, t1) = (np.array(node.Phi).reshape(2, 3, -1) for node in (first, last))
    turn = np.cross(np.eye(3), d)  # turn @ t = d x t
    along, across = np.outer(d, d), np.eye(3) - np.outer(d, d)
    slope0, slope1 = -turn @ t0, -turn @ t1
    even_u, even_t = (1.0 - s) * u0 + s * u1, (1.0 - s) * t0 + s * t1
    bent = (1.0 - 3.0 * s**2 + 2.0 * s**3) * u0 + (3.0 * s**2 - 2.0 * s**3) * u1
    bent = across @ bent + length * ((s - 2.0 * s**2 + s**3) * slope0 + (s**3 - s**2) * slope1)
    slope = across @ (u1 - u0) * (6.0 * s - 6.0 * s**2) / length
    slope = slope + (1.0 - 4.0 * s + 3.0 * s**2) * slope0 + (3.0 * s**2 - 2.0 * s) * slope1
    Phi = np.concatenate([along @ even_u + bent, along @ even_t + turn @ slope], axis=1)
    zero = np.zeros((3, Phi.shape[2], Phi.shape[2]))
    P0, P1 = (zero if node.Psi is None else np.array(node.Psi) for node in (first, last))
    Psi = (1.0 - s[..., None]) * P0 + s[..., None] * P1
    side = np.cross(d, np.eye(3)[int(np.abs(d).argmin())])
    side /= np.linalg.norm(side)
    axes = np.stack([d, side, np.cross(d, side)], axis=1)
    return Stations(begin + s[:, :, 0] * (end - begin), Phi, Psi, axes)


def circle(radius: float) -> Array:
    """Return the outline of a round section, (K, 2), m."""
    angle = 2.0 * np.pi * np.arange(SECTORS) / SECTORS
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _outline(beam: LinkBeam) -> Array:
    """Return the outer outline of a beam's section, (K, 2), m: round, or the rectangle around it.

    Where its form is not said, it is one that has the area and second moments: a tube or a rod where the torsion
    constant is the polar moment, else a rectangle with a hole of its form.
    """
    if beam.section is not None:
        kind, (first, *others) = beam.section
        return circle(0.5 * first) if kind in _ROUNDS else _rectangle(first, others[0])
    if abs(beam.J / (beam.Iy + beam.Iz) - 1.0) < _ROUND:
        solid = 4.0 * beam.A / math.pi  # its diameter squared
        return circle(0.5 * math.sqrt(max(4.0 * (beam.Iy + beam.Iz) / beam.A + 0.5 * solid, solid)))
    # of a rectangle h x w with a hole r h x r w: full = (1 - r^2) / (1 + r^2)
    full = min(beam.A**2 / (12.0 * math.sqrt(beam.Iy * beam.Iz)), 1.0)
    height, width = (math.sqrt(6.0 * (1.0 + full) * x / beam.A) for x in (beam.Iy, beam.Iz))
    return _rectangle(height, width)


def _rectangle(height: float, width: float) -> Array:
    """Return the outline of a rectangle, its height along z, (K, 2), m."""
    corners = 0.5 * np.array([(width, -height), (width, height), (-width, height), (-width, -height)])
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).reshape(-1, 2)
