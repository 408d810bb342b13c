"""A link that bends as files and reductions give it: its mass and its modes, and what these leave out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..robot.value import LinkModes
from .constants import Constants, first_frequency, placed_node
from .mass_integrals import EXACT, MEAN, REDUCED

SLOW = 0.1  # of the first frequency: rates up to which a link without stiffening by rotation is right


@dataclass(frozen=True, eq=False)
class BendingBody:
    """A link that bends: SI units, link frame.

    H00: integral of rho0 rho0^T over the mass, (4, 4).  is_free: whether its modes are those of a free link in mean
    axes, for which the joint that carries it has to be free.  velocity_terms: how these were found, EXACT, MEAN or
    REDUCED.
    """

    H00: Array
    modes: LinkModes
    is_free: bool
    velocity_terms: str = EXACT

    @property
    def constants(self) -> Constants:
        """Integrals of its mass over the modes."""
        modes = self.modes
        return Constants(self.H00, *(None if x is None else np.array(x) for x in (modes.H0, modes.P, modes.Q)))  # type: ignore[arg-type]

    def placed(self, rotation: ArrayLike, origin: ArrayLike) -> BendingBody:
        """Return the body in another frame, in which its own has axes, columns of a rotation, and an origin, (3,), m.

        Rotations of nodes are turned as small ones.
        """
        R, p = np.array(rotation, dtype=float), np.array(origin, dtype=float)
        moved = self.constants.turned(R, p)
        nodes = [placed_node(node, R, p) for node in self.modes.nodes]
        return replace(self, H00=moved.H00, modes=moved.link_modes(self.modes.K, self.modes.D, nodes))

    def notes(self) -> list[str]:
        """Say what is left out or approximate, a line each."""
        slow, notes = SLOW * first_frequency(self.modes.masses, self.modes.K), []
        if self.modes.Q is None and not self.is_free:
            notes.append(
                "stiffening by rotation is left out, as there is no Q (no load cases): at a rate W the first frequency "
                f"w1 is off by about 0.6 (W / w1)^2 of it; keep rates below {slow:.3g} rad/s (w1 / 10)"
            )
        if self.velocity_terms == MEAN:
            notes.append(
                "velocity terms of the modes come from mean translational masses, with an error of the mesh's size"
            )
        if self.velocity_terms == REDUCED:
            notes.append(
                "M and K are those of a reduced model, which does not say velocity terms of the modes (the symmetric "
                "part of N_k, and P_kl): they are left out, or the same in all directions; keep rates below "
                f"{slow:.3g} rad/s"
            )
        return notes
