"""Results of modal analyses, at a pose and along a path."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Index
from ..errors import InputError
from ..names import joint_of, show
from ..robot.coordinates import MOTIONS, owner_of, unit_of
from ..shown import Plotting, Shown
from ..tabular import Rows, TableColumn, Tabular

Complex = NDArray[np.complex128]
ENERGIES = ("strain_energy", "kinetic_energy")


@dataclass(frozen=True, kw_only=True)
class Modes(Plotting, Shown, Tabular, plot="plot_mode_shapes"):
    """Modes of small motions about a static equilibrium, by rising natural frequency; m of them.

    A pair of conjugate eigenvalues s is one mode, a real eigenvalue is one, too (overdamped, or divergent).

    Attributes:
        robot: the robot's name.
        coordinates: names, n.
        q: the static equilibrium, (n,), m or rad.
        eigenvalues: s, (m,), 1/s, with imaginary parts at least 0.
        shapes: motion of all coordinates, (m, n), complex, m or rad: phi^H M phi = 1, the phase such that phi is as
            real as can be and its largest inertial component is positive.
        frame: name of the frame that is looked at.
        frame_shapes: its displacement and rotation, (m, 6), base frame, m and rad, in the scale of ``shapes``.
        undamped: natural frequencies without dampers, Hz, of the symmetric K; negative where it is unstable.
        resolution: Hz; slower oscillations cannot be told from rigid-body modes, whose frequency is 0.
        internal_states: names of internal states, p, those of locked coordinates left out.
        states: what they do in the scale of ``shapes``, (m, p), complex; a mode in which only they move has a shape of
            zeros.
        zeros: those of them that stick, as bristles do at rest: they are springs in the modes, and each has an
            eigenvalue of 0 that is not among the ``eigenvalues``.
        notes: lines about what was assumed.
        strain_energy: what each coordinate has of a mode's potential energy phi^H K phi / 2, with gravity and gains of
            drives in K, (m, n): parts of 1; 0 of rigid-body modes.  kinetic_energy: of phi^H M phi / 2, likewise.
    """

    robot: str
    coordinates: tuple[str, ...]
    q: Array
    eigenvalues: Complex
    shapes: Complex
    frame: str
    frame_shapes: Complex
    undamped: Array
    resolution: float
    notes: tuple[str, ...]
    internal_states: tuple[str, ...] = ()
    states: Complex = field(default_factory=lambda: np.zeros((0, 0), dtype=np.complex128))
    zeros: tuple[str, ...] = ()
    strain_energy: Array = field(default_factory=lambda: np.zeros((0, 0)))
    kinetic_energy: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def by_owner(self, energy: str = "strain_energy") -> dict[str, Array]:
        """Return parts of an energy, (m,), by joints, and by links that bend: "arm.modes".

        Args:
            energy: "strain_energy" or "kinetic_energy".

        Raises:
            InputError: another one.
        """
        if energy not in ENERGIES:
            raise InputError(f"energy: {show(energy)}; allowed: {', '.join(ENERGIES)}")
        parts: dict[str, Array] = {}
        for name, share in zip(self.coordinates, getattr(self, energy).T, strict=True):
            owner = owner_of(name)
            parts[owner] = parts[owner] + share if owner in parts else share
        return parts

    @property
    def frequencies(self) -> Array:
        """Natural frequencies abs(s) / 2 pi, (m,), Hz."""
        return np.asarray(np.abs(self.eigenvalues) / (2.0 * np.pi))

    @property
    def damped_frequencies(self) -> Array:
        """Frequencies of the oscillation, Im(s) / 2 pi, (m,), Hz."""
        return np.asarray(self.eigenvalues.imag / (2.0 * np.pi))

    @property
    def damping_ratios(self) -> Array:
        """-Re(s) / abs(s), (m,); NaN for rigid-body modes."""
        size = np.abs(self.eigenvalues)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(-self.eigenvalues.real / np.where(size > 0.0, size, np.nan))

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON; complex numbers as [real, imaginary]."""
        rows = []
        energies = {name: self.by_owner(name) for name in self._energies_known}
        for k, s in enumerate(self.eigenvalues):
            ratio = float(self.damping_ratios[k])
            rows.append(
                {
                    "frequency": float(self.frequencies[k]),
                    "damped_frequency": float(self.damped_frequencies[k]),
                    "damping_ratio": ratio if np.isfinite(ratio) else None,
                    "eigenvalue": [s.real, s.imag],
                    "shape": dict(zip(self.coordinates, _pairs(self.shapes[k]), strict=True)),
                    "frame_shape": dict(zip(MOTIONS, _pairs(self.frame_shapes[k]), strict=True)),
                    **{name: {owner: float(x[k]) for owner, x in parts.items()} for name, parts in energies.items()},
                }
            )
            if self.internal_states:
                rows[-1]["states"] = dict(zip(self.internal_states, _pairs(self.states[k]), strict=True))
        return {
            "robot": self.robot,
            "q": dict(zip(self.coordinates, self.q.tolist(), strict=True)),
            "frame": self.frame,
            "modes": rows,
            **({"zeros": list(self.zeros)} if self.internal_states else {}),
            "undamped": self.undamped.tolist(),
            "resolution": self.resolution,
            "notes": list(self.notes),
        }

    def as_rows(self) -> Rows:
        """Return a row per mode, from 1 on.

        Frequencies, damping ratio, eigenvalue, shape by coordinates and of the frame.
        """
        shape = TableColumn("shape", "m or rad", self.shapes, self.coordinates, "coordinate")
        moved = TableColumn(f"{self.frame}.shape", "m or rad", self.frame_shapes, MOTIONS, "motion")
        columns = [
            TableColumn("frequency", "Hz", self.frequencies),
            TableColumn("damped_frequency", "Hz", self.damped_frequencies),
            TableColumn("damping_ratio", "1", self.damping_ratios),
            TableColumn("eigenvalue", "1/s", self.eigenvalues),
            shape,
            moved,
        ]
        columns += [TableColumn(x, "1", getattr(self, x), self.coordinates, "coordinate") for x in self._energies_known]
        if self.internal_states:
            columns.append(TableColumn("states", "m or rad", self.states, self.internal_states, "state"))
        about = {"robot": self.robot, "frame": self.frame}
        return Rows("mode", "1", np.arange(1, len(self.eigenvalues) + 1), columns, about)

    def lines(self, largest: int = 3) -> list[str]:
        """Return a table for people: each mode with the coordinates that move most in it.

        Of robots with links that bend also what has most of its potential energy, of a rigid-body mode of its kinetic
        energy.
        """
        bends = any(owner_of(name) != joint_of(name) for name in self.coordinates) and bool(self._energies_known)
        energies = [self._energies(k) if bends else "" for k in range(len(self.frequencies))]
        width = max(map(len, energies), default=0) + 2
        lines = [f"{self.robot}: {len(self.eigenvalues)} modes; {self.frame} moves by this per unit of modal mass", ""]
        energy = f"{'energy':<{width}}" if bends else ""
        lines.append(f"{'mode':>4}{'f [Hz]':>12}{'damping':>10}  {f'{self.frame} [mm, mrad]':<26}{energy}coordinates")
        size = np.abs(self.shapes)
        for k, f in enumerate(self.frequencies):
            ratio = self.damping_ratios[k]
            moved = f"{1e3 * np.linalg.norm(self.frame_shapes[k][:3]):.3g}, "
            moved += f"{1e3 * np.linalg.norm(self.frame_shapes[k][3:]):.3g}"
            scaled = size[k] / max(float(size[k].max()), 1e-300)
            first = [i for i in np.argsort(-scaled, kind="stable")[:largest] if scaled[i] > 0.02]
            shape = ", ".join(_sized(self.coordinates[i], size[k, i]) for i in first)
            text = "rigid" if not np.isfinite(ratio) else f"{round(ratio, 12) + 0.0:.3g}"
            energy = f"{energies[k]:<{width}}" if bends else ""
            lines.append(f"{k + 1:>4}{f:>12.5g}{text:>10}  {moved:<26}{energy}{shape}")
        return lines + [f"note: {note}" for note in self.notes]

    @property
    def _energies_known(self) -> tuple[str, ...]:
        return tuple(name for name in ENERGIES if getattr(self, name).shape == self.shapes.shape)

    def _energies(self, k: int, most: int = 2) -> str:
        """Return the owners of most of a mode's energy, with their parts in percent."""
        energy = "strain_energy" if self.strain_energy[k].any() else "kinetic_energy"
        parts = {owner: float(x[k]) for owner, x in self.by_owner(energy).items()}
        first = sorted(parts, key=lambda owner: -abs(parts[owner]))[:most]
        return ", ".join(f"{owner} {100.0 * parts[owner]:.0f} %" for owner in first if abs(parts[owner]) >= 0.005)


@dataclass(frozen=True)
class TrackedModes(Plotting, Shown, Tabular, plot="plot_tracks"):
    """Modes along a path: track k is one mode that is followed from pose to pose.

    Attributes:
        modes: at each of the P poses.
        tracks: which mode of each pose it is, (P, tracks); -1 where it is none of them.
    """

    modes: tuple[Modes, ...]
    tracks: Index

    def values(self, name: str) -> Array:
        """Return ``frequencies``, ``damped_frequencies`` or ``damping_ratios`` of all tracks, (P, tracks).

        NaN where none.
        """
        table = np.full(self.tracks.shape, np.nan)
        for row, modes, index in zip(table, self.modes, self.tracks, strict=True):
            row[index >= 0] = getattr(modes, name)[index[index >= 0]]
        return table

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""

        def plain(name: str) -> list[list[float | None]]:
            return [[float(x) if np.isfinite(x) else None for x in row] for row in self.values(name)]

        first = self.modes[0]
        return {
            "robot": first.robot,
            "coordinates": list(first.coordinates),
            "q": [modes.q.tolist() for modes in self.modes],
            "frequencies": plain("frequencies"),
            "damping_ratios": plain("damping_ratios"),
            "notes": list(dict.fromkeys(note for modes in self.modes for note in modes.notes)),
        }

    def as_rows(self) -> Rows:
        """Return a row per pose, from 0 on.

        Frequencies and damping ratios of the tracks, from 1 on, NaN where none is.
        """
        tracks = tuple(str(k + 1) for k in range(self.tracks.shape[1]))
        units = {"frequencies": "Hz", "damped_frequencies": "Hz", "damping_ratios": "1"}
        columns = [TableColumn(name, unit, self.values(name), tracks, "track") for name, unit in units.items()]
        return Rows("pose", "1", np.arange(len(self.modes)), columns, {"robot": self.modes[0].robot})

    def lines(self) -> list[str]:
        """Return the range of every track for people."""
        first = self.modes[0]
        lines = [f"{first.robot}: modes over {len(self.modes)} poses", ""]
        lines.append(f"{'track':>5}{'first [Hz]':>12}{'least':>12}{'most':>12}{'last':>12}{'damping':>18}")
        for k, (f, ratio) in enumerate(zip(self.values("frequencies").T, self.values("damping_ratios").T, strict=True)):
            seen = ratio[np.isfinite(ratio)]
            text = f"{seen.min():.3g} to {seen.max():.3g}" if seen.size else "rigid"
            ends = f"{f[0]:>12.5g}{np.nanmin(f):>12.5g}{np.nanmax(f):>12.5g}{f[-1]:>12.5g}"
            lines.append(f"{k + 1:>5}{ends}{text:>18}")
        return lines + [f"note: {note}" for note in dict.fromkeys(n for modes in self.modes for n in modes.notes)]


def _sized(name: str, size: float) -> str:
    """Return a coordinate's name and its size with its unit; modes of links are numbers."""
    unit = unit_of(name)
    return f"{name} {size:.3g}" + ("" if unit == "1" else f" {unit}")


def _pairs(values: Complex) -> list[list[float]]:
    return [[float(z.real), float(z.imag)] for z in values]
