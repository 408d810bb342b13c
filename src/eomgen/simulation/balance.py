"""Energy balance of a simulated motion: works of drives, wrenches and payloads, and dissipation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..kernel.complete import Kernel
from ..kernel.stepping.input_signals import WORKS
from ..runtime.internal_states import cut_apart
from ..shown import Shown
from ..state.drives import has_drives
from ..state.vectors import prescribed_mask

CLOSED = 1e-3  # relative residue from which a balance is said not to close
STATIC = 1e-7  # of the energies: works that are less are those of a robot that does not move
MOVING_ON = 1e-2  # of the kinetic energy, which an integration keeps to some 1e-5 of itself where nothing changes it
TERMS = ("drives", "prescribed", "wrenches", "payloads", "dissipated")
# Lobatto's rule on [0, 1]: exact for polynomials of degree 7, and its ends are samples
NODES = np.array([0.0, (1.0 - np.sqrt(3.0 / 7.0)) / 2.0, 0.5, (1.0 + np.sqrt(3.0 / 7.0)) / 2.0, 1.0])
WEIGHTS = np.array([9.0, 49.0, 64.0, 49.0, 9.0]) / 180.0
SUBINTERVALS = NODES.size - 1  # of an interval between two edges


@dataclass(frozen=True)
class EnergyBalance(Shown):
    """Work and energy over time; kinetic + potential = what they were + works - dissipated + residue.

    Attributes:
        work: work integrals, (T, 5), J, from the beginning on: TERMS.  Of the drives, of the forces of prescribed
            motions, of external wrenches, the energy that payloads bring when they are picked up (less what they take
            away), and what dampers and friction dissipated.
        energy: kinetic and potential, (T, 2), J.
    """

    work: Array
    energy: Array

    def of(self, term: str) -> Array:
        """Return one of TERMS over time, (T,), J."""
        return self.work[:, TERMS.index(term)]

    @property
    def residue(self) -> Array:
        """Energy that does not balance, (T,), J: the error of integration, in Python of quadrature, too."""
        total = self.energy.sum(axis=1)
        residue: Array = total - total[0] - self.work[:, :4].sum(axis=1) + self.work[:, 4]
        return residue

    @property
    def size(self) -> float:
        """Size that the residue is compared with, J: the largest of the works and of the ranges of both energies.

        Of a robot that does not move, where these are round-off, a small fraction of the energies themselves, and so of
        the kinetic energy where that is constant, as of a body that tumbles freely.
        """
        moved = max(np.abs(self.work).max(), np.ptp(self.energy, axis=0).max())
        kept = max(STATIC * np.abs(self.energy).max(), MOVING_ON * self.energy[:, 0].max())
        return float(max(moved, kept))

    @property
    def relative_residue(self) -> float:
        """The largest residue over ``size``; 0 where nothing moves."""
        size = self.size
        return float(np.abs(self.residue).max()) / size if size > 0.0 else 0.0

    def summary(self) -> dict[str, float]:
        """Return work integrals and changes of energy at the end, J, and the relative residue."""
        change = self.energy[-1] - self.energy[0]
        works = {term: float(self.of(term)[-1]) for term in TERMS}
        return {
            **works,
            "kinetic": float(change[0]),
            "potential": float(change[1]),
            "relative_residue": self.relative_residue,
        }

    def line(self) -> str:
        """Return the summary in a line of text."""
        facts = self.summary()
        terms = ", ".join(f"{name} {facts[name]:.4g} J" for name in TERMS if facts[name])
        return (
            f"energy: {terms or 'no work'}; kinetic {facts['kinetic']:+.4g} J, potential {facts['potential']:+.4g} J;"
            f" residue {facts['relative_residue']:.1g} of it"
        )

    def note(self) -> str | None:
        """Return a warning where the balance does not close; else None."""
        if self.relative_residue <= CLOSED:
            return None
        return (
            f"warning: the energy balance does not close: {self.relative_residue:.2g} of {self.size:.3g} J is"
            " left over; a smaller rtol or output_step may help"
        )


def integrated(works: Array) -> Array:
    """Arrange work integrals of a trajectory, (T, 4), J, by TERMS, (T, 5)."""
    work = np.zeros((len(works), len(TERMS)))
    work[:, [TERMS.index(name) for name in WORKS]] = works
    return work


def with_nodes(edges: Array) -> Array:
    """Return times of quadrature on all intervals between the edges, (4 (E - 1) + 1,), the edges among them."""
    inner = edges[:-1, np.newaxis] + np.diff(edges)[:, np.newaxis] * NODES[:-1]  # at NODES[0] = 0 the edge to the bit
    return np.append(inner.ravel(), edges[-1])


def works(kernel: Kernel, t: Array, q: Array, v: Array, u: Array, wrench: ArrayLike | None) -> Array:
    """Integrate work between the edges of ``with_nodes``, (E - 1, 5), J: TERMS; arguments at all of its times.

    Internal states stand behind velocities.
    """
    prescribed, n, run = prescribed_mask(kernel), kernel.n, kernel.calls.run
    power = np.zeros((t.size, len(TERMS)))
    velocities, z = cut_apart(v, n)
    by_drive = u * velocities
    if has_drives(kernel):
        by_drive = run(kernel.functions.drive_forces, None, (q, velocities, u), z=z, whole=True) * v
        prescribed = np.append(prescribed, np.zeros(v.shape[1] - n, np.bool_))
    power[:, 0], power[:, 1] = by_drive[:, ~prescribed].sum(axis=1), by_drive[:, prescribed].sum(axis=1)
    if wrench is not None:
        power[:, 2] = (kernel.functions.external_force(q, wrench) * velocities).sum(axis=1)
    still = np.zeros_like(q), np.zeros_like(z)
    passive = run(kernel.generalized_force, None, (q, still[0]), z=still[1], whole=True)
    passive = passive - run(kernel.generalized_force, None, (q, velocities), z=z, whole=True)
    power[:, 4] = (passive * v).sum(axis=1)
    spans = t[4::4] - t[:-1:4]
    rows = np.arange(spans.size)[:, np.newaxis] * 4 + np.arange(5)
    work: Array = np.einsum("ikw,k,i->iw", power[rows], WEIGHTS, spans)
    return work
