"""A link's modes as constants of its equations of motion: what a reduction gives, and its file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..robot.value import Node
from .bending_body import BendingBody
from .constants import Constants, as_tuples
from .files import write_constants

_SHOWN = 12  # frequencies in lines


@dataclass(frozen=True)
class ReducedLink:
    """Constants of a link that bends by m modes: SI units, link frame.

    H00: integral of rho0 rho0^T dm, (4, 4), rho0 = (x, y, z, 1).  H0: of rho0 phi_k^T dm, (m, 4, 3).  P: of phi_k
    phi_l^T dm, (m, m, 3, 3), whose traces are the modal masses.  Q: of rho0 psi_kl^T dm, (m, m, 4, 3), and
    interface_Psi, (I, 3, m, m): stiffening by rotation; None: without.  K, D: stiffness and damping, (m, m).
    interface_Phi: displacements of interfaces by the modes, (I, 6, m).  frequencies: of the modes together, with the
    root clamped, Hz.  masses_are: how the velocity terms were found, as ``mass_integrals`` says.  is_free: whether
    nothing is clamped, and modes are free of momenta of rigid-body motions.
    """

    H00: Array
    H0: Array
    P: Array
    K: Array
    D: Array
    Q: Array | None
    interface_names: tuple[str, ...]
    interface_places: Array
    interface_Phi: Array
    interface_Psi: Array | None
    frequencies: Array
    masses_are: str
    is_free: bool

    @property
    def mass(self) -> float:
        """Mass, kg."""
        return float(self.H00[3, 3])

    @property
    def com(self) -> Array:
        """Centre of mass, m, link frame, (3,)."""
        return np.asarray(self.H00[:3, 3] / self.H00[3, 3])

    @property
    def inertia(self) -> Array:
        """Inertia about the centre of mass, kg m^2, link axes, (3, 3)."""
        J = self.H00[:3, :3] - self.mass * np.outer(self.com, self.com)
        return np.asarray(np.trace(J) * np.eye(3) - J)

    def body(self) -> BendingBody:
        """Return the link as a description takes it."""
        constants = Constants(self.H00, self.H0, self.P, self.Q)
        second = [None] * len(self.interface_names) if self.interface_Psi is None else list(self.interface_Psi)
        faces = zip(self.interface_names, self.interface_places, self.interface_Phi, second, strict=True)
        nodes = [
            Node(name, as_tuples(place), as_tuples(Phi), None if Psi is None or not Psi.any() else as_tuples(Psi))
            for name, place, Phi, Psi in faces
        ]
        return BendingBody(self.H00, constants.link_modes(self.K, self.D, nodes), self.is_free, self.masses_are)

    def placed(self, rotation: ArrayLike, origin: ArrayLike) -> ReducedLink:
        """Return the link in a frame in which its own has axes, columns of a rotation, and an origin, (3,), m."""
        body = self.body().placed(rotation, origin)
        constants, nodes = body.constants, body.modes.nodes
        shapes = [np.array(node.Phi) for node in nodes]
        Psi = None if self.interface_Psi is None else np.einsum("ij,njkl->nikl", np.array(rotation), self.interface_Psi)
        return replace(
            self,
            H00=constants.H00,
            H0=constants.H0,
            P=constants.P,
            Q=constants.Q,
            interface_places=np.array([node.place for node in nodes]).reshape(-1, 3),
            interface_Phi=np.array(shapes).reshape(-1, 6, len(self.K)),
            interface_Psi=Psi,
        )

    def notes(self) -> list[str]:
        """Say what is left out or approximate, a line each."""
        return self.body().notes()

    def lines(self) -> list[str]:
        """Return what was found, a line each."""
        com = ", ".join(f"{x:.6g}" for x in self.com.tolist())
        J = self.inertia
        entries = [("xx", 0, 0), ("yy", 1, 1), ("zz", 2, 2), ("xy", 0, 1), ("xz", 0, 2), ("yz", 1, 2)]
        shown = [f"{x:.6g}" for x in self.frequencies[:_SHOWN].tolist()]
        more = f", ... {self.frequencies[-1]:.6g}" if len(self.frequencies) > _SHOWN else ""
        state = "free" if self.is_free else "root clamped"
        lines = [
            f"mass      {self.mass:.6g} kg, centre of mass [{com}] m",
            "inertia   " + ", ".join(f"{name} {J[i, j]:.6g}" for name, i, j in entries) + " kg m^2, about it",
            f"modes     {len(self.K)}, {state}: {', '.join(shown)}{more} Hz",
        ]
        for name, place in zip(self.interface_names, self.interface_places.tolist(), strict=True):
            lines.append(f"interface {name} at [{', '.join(f'{x:.6g}' for x in place)}] m")
        return lines + [f"note: {note}" for note in self.notes()]

    def as_dict(self) -> dict[str, Any]:
        """Return what was found as plain values."""
        return {
            "mass": self.mass,
            "com": self.com.tolist(),
            "inertia": self.inertia.tolist(),
            "modes": len(self.K),
            "frequencies_hz": self.frequencies.tolist(),
            "interfaces": dict(zip(self.interface_names, self.interface_places.tolist(), strict=True)),
            "is_free": self.is_free,
            "has_stiffening": self.Q is not None,
            "velocity_terms": self.masses_are,
            "notes": self.notes(),
        }

    def save(self, path: Path | str) -> Path:
        """Write the constants to a .npz and return its path."""
        return write_constants(path, self.body())
