"""A link's modes as constants of its equations of motion: what a reduction gives, and its file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..files import check_ending, write_atomically
from .mass_integrals import EXACT, MEAN, REDUCED

ENDING = ".npz"
SLOW = 0.1  # of the first frequency: rotations up to which a link without stiffening by rotation is right
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

    def notes(self) -> list[str]:
        """Say what is left out or approximate, a line each."""
        notes = []
        first = 2.0 * math.pi * float(self.frequencies[0])
        if self.Q is None and not self.is_free:
            notes.append(
                "stiffening by rotation is left out, as there are no load cases: at a rate W the first frequency w1 is "
                f"off by about 0.6 (W / w1)^2 of it; keep rates below {SLOW * first:.3g} rad/s (w1 / 10)"
            )
        if self.masses_are == MEAN:
            notes.append(
                "velocity terms of the modes come from mean translational masses, with an error of the mesh's size"
            )
        if self.masses_are == REDUCED:
            notes.append(
                "M and K are those of a reduced model, which does not say velocity terms of the modes (the symmetric "
                "part of N_k, and P_kl): they are left out, or the same in all directions; keep rates below "
                f"{SLOW * first:.3g} rad/s"
            )
        return notes

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
            "velocity_terms": "exact" if self.masses_are == EXACT else self.masses_are,
            "notes": self.notes(),
        }

    def arrays(self) -> dict[str, Any]:
        """Return the arrays of a file of constants by their names."""
        arrays: dict[str, Any] = {name: getattr(self, name) for name in ("H00", "H0", "P", "K", "D")}
        arrays["interface_names"] = np.array(self.interface_names, dtype=str)
        arrays["interface_places"], arrays["interface_Phi"] = self.interface_places, self.interface_Phi
        if self.Q is not None and self.interface_Psi is not None:
            arrays["Q"], arrays["interface_Psi"] = self.Q, self.interface_Psi
        return arrays

    def save(self, path: Path | str) -> Path:
        """Write the constants to a .npz and return its path."""
        arrays = self.arrays()
        return write_atomically(check_ending(path, ENDING), lambda stream: np.savez(stream, **arrays))
