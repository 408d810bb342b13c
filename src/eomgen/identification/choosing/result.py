"""Chosen poses in the order to measure them, their information, what stays poorly observable; a file to fill in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...files import check_ending, write_csv
from ...names import component_name, show
from ...results.contents import plain_fields
from ...results.kinds import Kind, Saved, declare
from ...results.stored import Stored
from ...robot.coordinates import MOTIONS
from ...shown import Plotting, Shown
from ...tabular import Rows as TableRows
from ...tabular import TableColumn, Tabular
from ..calibration.identifiability import unidentifiable_rows
from ..estimating import SOLVED
from .information import DETERMINANT
from .proposals import DISTANCE, POSE

_ABOUT = {
    DETERMINANT: "D (determinant of the information)",
    "V": "V (expected error of the tool over the workspace)",
}


@dataclass(frozen=True, kw_only=True)
class PosesResult(Plotting, Shown, Tabular, Saved, plot="plot_poses"):
    """Poses to measure of a robot.

    Attributes:
        robot: the robot's name.
        coordinates: names of the columns of q.
        q: (N, n), m or rad; the most informative poses first (D-optimal by default).
        frames: names of the frames to measure.
        measure: what of them: "pose", "position" or "distance".
        series: number of the series that the poses belong to.
        criterion: "D" or "V".
        efficiency: share of what the best weights of all candidates reach, 0 to 1, at most off by ``gap`` below it.
        gap: of the bound to the optimal weights, as a share.
        value: log det of the information, or the negative mean square of the tool's error (m^2).
        bound: what no choice of so many candidates exceeds.
        size: combinations of parameters that the candidates can show.
        rank: those that the chosen poses, and those measured before, show; rank_above_noise: above their noise.
        names, deviations, units: of all parameters, their standard deviations with expected sizes known before, (P,).
        merged: why a parameter is not identifiable by these poses, by name.
        weak: poorly observable directions, which show less than their noise, with their standard deviations.
        error: expected distance of the tool from where it is thought to be, rms over the workspace, m.
        error_before: the same without the chosen poses.
        measured: rows that were measured before.
        candidates: poses that were to choose from.
        noise: standard deviations of lengths (m) and rotations (rad).
        seed: of the candidates.
        notes: remarks and warnings.
        status: "converged", or what of the choice and its bound has not.
    """

    robot: str
    coordinates: Annotated[tuple[str, ...], Stored(("n",))]
    q: Annotated[Array, Stored(("N", "n"), "m, rad")]
    frames: tuple[str, ...]
    measure: str
    series: int
    criterion: str
    efficiency: float
    gap: float
    value: float
    bound: float
    size: int
    rank: int
    rank_above_noise: int
    names: Annotated[tuple[str, ...], Stored(("P",))]
    deviations: Annotated[Array, Stored(("P",), "SI")]
    units: tuple[str, ...]
    merged: Mapping[str, str]
    weak: tuple[tuple[str, float], ...]
    error: float
    error_before: float
    measured: int
    candidates: int
    noise: tuple[float, float]
    seed: int
    notes: tuple[str, ...] = ()
    status: Annotated[str, Stored(otherwise=SOLVED)] = SOLVED

    def to_csv(self, path: Path | str) -> Path:
        """Write coordinates, and empty columns for what is to be measured, and return the path.

        ``calibrate`` reads the file when these are filled in.

        Raises:
            InputError: another ending, or the file cannot be written.
        """
        target = check_ending(path, ".csv")
        parts = {POSE: MOTIONS, DISTANCE: ("distance",)}.get(self.measure, MOTIONS[:3])
        empty = [component_name(frame, key) for frame in self.frames for key in parts]
        more = ["series"] if self.series else []
        comments = (
            f"Poses to measure of {self.robot}, the most informative ones first; fill in the empty columns.",
            "Coordinates in m and rad; what is measured in m, rotations as rotation vectors, rad.",
        )
        rows = [[*row, *("" for _ in empty), *(self.series for _ in more)] for row in self.q.tolist()]
        return write_csv(target, [[*self.coordinates, *empty, *more], *rows], comments, read=None)

    def as_rows(self) -> TableRows:
        """Return a row per pose: its coordinates, m or rad."""
        columns = [TableColumn(name, "SI", self.q[:, i]) for i, name in enumerate(self.coordinates)]
        return TableRows("pose", "", np.arange(len(self.q)), columns, {"robot": self.robot})

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {
            **plain_fields(self),
            "weak": [{"direction": text, "deviation": value} for text, value in self.weak],
        }

    def lines(self) -> list[str]:
        """Return tables for people: the criterion, the poses, what stays poorly observable."""
        lines = [*self.summary_lines(), "", "".join(f"{name:>16}" for name in self.coordinates)]
        lines += ["".join(f"{value:>16.6f}" for value in row) for row in self.q]
        if self.weak:
            lines += ["", "poorly observable: standard deviation of the first, along the direction"]
            lines += [f"{value:>10.2g}  {text}" for text, value in self.weak]
        if self.merged:
            rows = unidentifiable_rows(self.merged)
            width = max(len(name) for name, _ in rows) + 2
            lines += ["", "not identifiable:", *(f"{name:<{width}}{why}" for name, why in rows)]
        return lines + (["", *(f"note: {note}" for note in self.notes)] if self.notes else [])

    def summary_lines(self) -> list[str]:
        """Return lines about the choice: how many of what, how near to the bound, expected accuracy."""
        behind = f" behind {self.measured} measured ones" if self.measured else ""
        names = ", ".join(self.frames)
        without = f", without these poses {1e3 * self.error_before:.4g} mm" if self.measured else ""
        return [
            f"{self.robot}: {len(self.q)} of {self.candidates} poses{behind}, {self.measure} of {names}",
            f"criterion {_ABOUT[self.criterion]}: {100 * self.efficiency:.1f} % of what any weights of them reach,"
            f" {self.status}",
            f"rank {self.rank} of {self.size}, {self.rank_above_noise} above the noise"
            f" ({1e3 * self.noise[0]:.3g} mm, {1e3 * self.noise[1]:.3g} mrad)",
            f"expected error of the tool {1e3 * self.error:.4g} mm rms{without}",
        ]


def _check(result: PosesResult, path: str) -> None:
    if not len(result.q):
        raise InputError(f"{path}: q: got no poses; allowed: one or more")
    if len(result.units) != len(result.names):
        raise InputError(f"{path}: units: got {len(result.units)}; allowed: {len(result.names)}, one for each of names")
    if result.criterion not in _ABOUT:
        raise InputError(f"{path}: criterion: {show(result.criterion)}; allowed: {', '.join(_ABOUT)}")


load_poses = declare(Kind("poses", PosesResult, ending=".json", check=_check))
"""Read the result that ``PosesResult.save`` wrote; InputError says what in the file is wrong."""
