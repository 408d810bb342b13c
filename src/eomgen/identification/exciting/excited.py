"""A motion that excites: its series and samples, what it tells beside others, and how near it comes to its limits."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...files import check_ending, write_atomically
from ...motion.files import SUFFIXES
from ...names import show_path
from ...shown import Shown
from ..identifiable import BaseParameters
from ..saved import write_arrays
from .fourier import FourierSeries
from .telling import CRITERIA

Array = NDArray[np.float64]

KIND = "excitation"
ARRAYS = (*("t", "q", "v", "a", "u", "noise", "sizes", "deviations"), *("limits", "extremes"))
PLAIN = ("robot", "criterion", "condition", "deviation", "limited", "units", "randoms", "starts", "seed", "notes")
CONTROL = 20.0  # rad/s: bandwidth of computed torque in scenarios that are written


@dataclass(frozen=True)
class Compared:
    """A figure of the motion, of the one that the search began with, and the median of random ones within limits."""

    found: float
    start: float
    random: float


@dataclass(frozen=True, eq=False)  # arrays have no one truth
class ExciteResult(Shown):
    """A motion that excites.

    Attributes:
        robot: its name.
        series: the motion, of the m coordinates that move.
        t: times of the samples, (T,), s; the period's end is the last one.
        q, v, a: coordinates, rates, accelerations, (T, m), m or rad and s.
        u: drives that the description's numbers take, (T, m), N or N m.
        base: the combinations of parameters that forces can show.
        noise: standard deviations of the drives' noise that count as weights, (m,), N or N m.
        sizes: that are expected of the combinations, (b,), SI units.
        deviations: standard deviations of the combinations to expect from all samples, (b,), SI units.
        criterion: "D" or "condition".
        condition: condition numbers of the base regressor, in units of sizes and noise.
        deviation: geometric means of the standard deviations along the axes of their ellipsoid, over the sizes.
        limited: names of what limits hold, such as "joint1.gamma rate" (l of them).
        units: of these.
        limits: least and greatest that is allowed, (l, 2); infinite where there is no limit.
        extremes: least and greatest of the motion, between samples too, (l, 2); of drives with dry friction either way.
        randoms, starts, seed: of random motions, of searches, of the random numbers.
        notes: what was assumed.
    """

    robot: str
    series: FourierSeries
    t: Array
    q: Array
    v: Array
    a: Array
    u: Array
    base: BaseParameters
    noise: Array
    sizes: Array
    deviations: Array
    criterion: str
    condition: Compared
    deviation: Compared
    limited: tuple[str, ...]
    units: tuple[str, ...]
    limits: Array
    extremes: Array
    randoms: int
    starts: int
    seed: int
    notes: tuple[str, ...] = ()

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates that move."""
        return self.series.names

    @property
    def used(self) -> Array:
        """How much of the way to its limit each number goes, (l,): 1 at the limit.

        From the middle between two limits; where there is one alone, that limit over what is nearest to it.
        """
        (low, high), (least, greatest) = self.limits.T, self.extremes.T
        both = np.isfinite(low) & np.isfinite(high)
        middle, half = np.where(both, (low + high) / 2.0, 0.0), np.where(both, (high - low) / 2.0, 1.0)
        of_two = np.maximum(greatest - middle, middle - least) / half
        gap = np.where(np.isfinite(low), least - low, high - greatest)
        return np.asarray(np.where(both, of_two, 1.0 / (1.0 + np.maximum(gap, 0.0))))

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        limited = zip(self.limited, self.units, self.limits.tolist(), self.extremes.tolist(), strict=True)
        return {
            "robot": self.robot,
            "coordinates": list(self.coordinates),
            "duration": self.series.duration,
            "harmonics": self.series.harmonics,
            "offset": self.series.offset.tolist(),
            "sines": self.series.sines.tolist(),
            "cosines": self.series.cosines.tolist(),
            "samples": len(self.t),
            "criterion": self.criterion,
            "condition": vars(self.condition),
            "deviation": vars(self.deviation),
            "base_parameters": list(self.base.names),
            "deviations": dict(zip(self.base.names, self.deviations.tolist(), strict=True)),
            "noise": dict(zip(self.coordinates, self.noise.tolist(), strict=True)),
            "limits": {
                name: {"unit": unit, "allowed": [_finite(x) for x in allowed], "reached": reached}
                for name, unit, allowed, reached in limited
            },
            "seed": self.seed,
            "notes": list(self.notes),
        }

    def lines(self) -> list[str]:
        """Tables for people: the criterion beside others, and how near the motion comes to its limits."""
        series, terms = self.series, ", ".join(self.base.terms)
        lines = [
            f"{self.robot}: {series.duration:g} s, {series.harmonics} harmonics of {1.0 / series.duration:.4g} Hz,"
            f" {len(self.t)} samples",
            f"criterion {self.criterion} ({CRITERIA[self.criterion]}), {len(self.base)} base parameters ({terms})",
            "",
            f"{'':<34}{'this motion':>14}{'its start':>14}{'random':>14}",
        ]
        for label, found in (("condition number", self.condition), ("mean deviation over size", self.deviation)):
            lines.append(f"{label:<34}{found.found:>14.4g}{found.start:>14.4g}{found.random:>14.4g}")
        width = max(34, *(len(f"{x} [{unit}]") + 2 for x, unit in zip(self.limited, self.units, strict=True)))
        lines += ["", f"{'limits':<{width}}{'least':>12}{'greatest':>12}   allowed"]
        for name, unit, (low, high), (least, greatest) in zip(
            self.limited, self.units, self.limits.tolist(), self.extremes.tolist(), strict=True
        ):
            ends = [f"from {low:.4g}"] * bool(np.isfinite(low)) + [f"to {high:.4g}"] * bool(np.isfinite(high))
            lines.append(f"{f'{name} [{unit}]':<{width}}{least:>12.4g}{greatest:>12.4g}   {' '.join(ends)}")
        noise = ", ".join(f"{x:.3g}" for x in self.noise)
        lines += ["", f"random: median of {self.randoms} random motions that fill the same limits; seed {self.seed}"]
        lines += [f"noise of drives, N or N m: {noise}", *(f"note: {note}" for note in self.notes)]
        return lines

    def to_csv(self, path: Path | str) -> Path:
        """Write the samples as a sampled motion and return the path: ``simulate`` and ``identify`` read it.

        Drives are those that the description's numbers take: they stand for the measured ones.

        Raises:
            InputError: another ending, or the file cannot be written.
        """
        target = check_ending(path, ".csv")
        text = StringIO()
        text.write(f"# Motion of {self.robot} that excites its base parameters: s, m and rad, N and N m.\n")
        text.write("# Drives are computed from the description; measured ones take their place.\n")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["t", *(name + suffix for suffix in SUFFIXES for name in self.coordinates)])
        writer.writerows(np.column_stack([self.t, self.q, self.v, self.a, self.u]).tolist())
        return write_atomically(target, lambda stream: stream.write(text.getvalue().encode("ascii")))

    def to_scenario(self, path: Path | str, motion: Path | str) -> Path:
        """Write a scenario of the motion under computed torque, and return its path.

        Args:
            path: of the scenario, .toml.
            motion: the file that ``to_csv`` wrote, in the same folder.

        Raises:
            InputError: another ending or folder, or the file cannot be written.
        """
        target, samples = check_ending(path, ".toml"), Path(motion)
        if samples.parent.resolve() != target.parent.resolve():
            raise InputError(
                f"output: {show_path(str(samples))} is not beside {show_path(str(target))}; allowed: one folder"
            )
        step = float(self.t[-1]) / (len(self.t) - 1)
        lines = [
            f"# The motion of {samples.name} under computed torque.",
            f"duration = {self.series.duration!r}",
            f"output_step = {step!r}",
            "",
            "[motion]",
            'type = "sampled"',
            f"file = {json.dumps(samples.name)}",
            "",
            "[control]",
            'type = "computed_torque"',
            f"bandwidth = {CONTROL}",
            "",
        ]
        return write_atomically(target, lambda stream: stream.write("\n".join(lines).encode("utf-8")))

    def save(self, path: Path | str) -> Path:
        """Write the result as .npz for ``load_excitation``, and return the path.

        Raises:
            InputError: another ending, or the file cannot be written.
        """
        meta: dict[str, Any] = {name: getattr(self, name) for name in PLAIN}
        meta |= {"condition": vars(self.condition), "deviation": vars(self.deviation)}
        about = {**vars(self.base), "chosen": self.base.chosen.tolist(), "matrix": self.base.matrix.tolist()}
        meta |= {"base": about, "coordinates": self.coordinates, "duration": self.series.duration}
        arrays: dict[str, Any] = {name: getattr(self, name) for name in ARRAYS}
        arrays |= {name: getattr(self.series, name) for name in ("offset", "sines", "cosines")}
        return write_arrays(arrays, meta, KIND, path)


def _finite(x: float) -> float | None:
    return x if np.isfinite(x) else None
