"""Stress resultants of links that are beams, in a static equilibrium: what acts between the parts of a beam.

They follow from the equilibrium of what lies beyond the section, where the link is bent: loads at its nodes and its
weight.  So they are as exact as these are, with few modes, too.  Curvatures of mode shapes have what loads at the tip
do, but not what a weight along the beam does: by two modes of bending its moment at the root is 5/6 of the true one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arrays import Array
from ...robot.sections import ROUND, reach_of
from ...robot.value import AXES, Link, LinkBeam
from ...shown import Shown, scale_of
from ...tabular import Rows, TableColumn, Tabular
from ..beam import beam_shapes

STATIONS = 11  # sections from the root to the tip
COMPONENTS = ("N", "Vy", "Vz", "T", "My", "Mz")
_POINTS = 32  # of sums along a beam, which are exact for polynomials of degree 63
_NOISE = 1e-12  # of the greatest force or moment: round-off, which is shown as 0
_AT_NODE = 1e-12  # of the length: a section at a node is on the node's near side


@dataclass(frozen=True, kw_only=True)
class StressResultants(Shown, Tabular):
    """Stress resultants of a beam at S sections, from its root to its tip.

    Attributes:
        link: name of the link that is the beam.
        x: distances of the sections from the root, (S,), m.
        resultants: what the part beyond a section exerts on the part before it, (S, 6): normal force N and shear forces
            Vy and Vz (N), torque T and bending moments My and Mz (N m), along the axes of the section, which turns with
            the link; x along the beam, towards its tip.  A section at a node is on its near side.
        stress: greatest normal stress in each section, by N, My and Mz, (S,), N/m^2; None where the form of the section
            is not known.
    """

    link: str
    x: Array
    resultants: Array
    stress: Array | None

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        columns = dict(zip(COMPONENTS, self.resultants.T.tolist(), strict=True))
        stress = None if self.stress is None else self.stress.tolist()
        return {"link": self.link, "x": self.x.tolist(), **columns, "stress": stress}

    def as_rows(self) -> Rows:
        """Return a row per section: forces, moments, and the stress where it is known."""
        columns = [
            TableColumn(name, "N" if k < 3 else "N m", self.resultants[:, k]) for k, name in enumerate(COMPONENTS)
        ]
        if self.stress is not None:
            columns.append(TableColumn("stress", "N/m^2", self.stress))
        return Rows("x", "m", self.x, columns, {"link": self.link})

    def lines(self) -> list[str]:
        """Return a table for people."""
        parts = self.resultants.reshape(-1, 2, 3)
        factors, units = zip(scale_of(parts[:, 0], "N"), scale_of(parts[:, 1], "N m"), strict=True)
        titles = [f"{name} [{units[k // 3]}]" for k, name in enumerate(COMPONENTS)]
        stress = () if self.stress is None else ("stress [MPa]",)
        lines = [f"beam {self.link}: stress resultants on the part before a section, in the section's axes", ""]
        lines.append(f"{'x [m]':>10}" + "".join(f"{title:>13}" for title in (*titles, *stress)))
        parts = np.where(np.abs(parts) > _NOISE * np.abs(parts).max(axis=(0, 2), keepdims=True), parts, 0.0)
        scaled = (parts * np.array(factors)[:, np.newaxis]).reshape(-1, 6)
        for k, x in enumerate(self.x):
            row = [*scaled[k], *(() if self.stress is None else (1e-6 * self.stress[k],))]
            lines.append(f"{x:>10.4g}" + "".join(f"{value + 0.0:>13.5g}" for value in row))
        return lines


def stress_resultants(
    link: Link, beam: LinkBeam, e: Array, gravity: Array, loads: Sequence[tuple[float, Array, Array]]
) -> StressResultants:
    """Return the stress resultants of a link that is a beam.

    Args:
        link, beam: the link, and its beam.
        e: modal coordinates, (m,).
        gravity: (3,), m/s^2, link frame.
        loads: at places of the beam: distance from the root while nothing bends, m; pose in the link's frame, (4, 4),
            m; force (N) and moment (N m) that act there on the link, in the axes of that pose, (6,).
    """
    axes = np.array(AXES[beam.axis])
    x = np.linspace(0.0, beam.length, STATIONS)
    places, turns = _bent(beam, e, x)
    force, moment = _by_weight(beam, e, x, places, beam.density * beam.A * gravity)
    for place, there, wrench in loads:
        load, about = (there[:3, :3] @ part for part in wrench.reshape(2, 3))
        beyond = (x <= place + _AT_NODE * beam.length)[:, np.newaxis]
        force += beyond * load
        moment += beyond * (about + np.cross(there[:3, 3] - places, load))
    of_section = np.swapaxes(turns @ axes, 1, 2)
    resultants = np.hstack([np.einsum("sij,sj->si", of_section, part) for part in (force, moment)]) + 0.0
    return StressResultants(link=link.name, x=x, resultants=resultants, stress=_stress(beam, resultants))


def _bent(beam: LinkBeam, e: Array, x: Array) -> tuple[Array, Array]:
    """Return where sections at x, (S,), are, (S, 3), m, and their axes, (S, 3, 3), link frame, by modal coordinates."""
    Phi, Psi = beam_shapes(beam, x)
    moved = Phi @ e
    places = np.outer(x, np.array(AXES[beam.axis])[:, 0]) + moved[:, :3] + 0.5 * (Psi @ e) @ e
    (ca, cb, cg), (sa, sb, sg) = np.cos(moved[:, 3:]).T, np.sin(moved[:, 3:]).T
    rows = (
        (cb * cg, -cb * sg, sb),
        (ca * sg + sa * sb * cg, ca * cg - sa * sb * sg, -sa * cb),
        (sa * sg - ca * sb * cg, sa * cg + ca * sb * sg, ca * cb),
    )
    return places, np.moveaxis(np.array(rows), -1, 0)


def _by_weight(beam: LinkBeam, e: Array, x: Array, places: Array, weight: Array) -> tuple[Array, Array]:
    """Return force and moment of the weight (N/m, (3,), link frame) beyond each section, about its place, (S, 3)."""
    points, weights = np.polynomial.legendre.leggauss(_POINTS)
    half = (beam.length - x)[:, np.newaxis] / 2.0
    along = x[:, np.newaxis] + half * (1.0 + points)
    beyond = _bent(beam, e, along.ravel())[0].reshape(*along.shape, 3) - places[:, np.newaxis]
    arms = half * np.einsum("g,sgi->si", weights, beyond)
    return 2.0 * half * weight, np.cross(arms, weight)


def _stress(beam: LinkBeam, resultants: Array) -> Array | None:
    """Return the greatest normal stress in each section, (S,), N/m^2; None where its form is not known."""
    if beam.section is None:
        return None
    N, _, _, _, My, Mz = np.abs(resultants).T
    along_y, along_z = reach_of(*beam.section)
    by_y, by_z = My * along_z / beam.Iy, Mz * along_y / beam.Iz
    bending = np.hypot(by_y, by_z) if beam.section[0] in ROUND else by_y + by_z
    return np.asarray(N / beam.A + bending)
