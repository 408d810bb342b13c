"""An exciting motion: series, samples, its information beside that of others, and how near it comes to its limits."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...files import check_ending, write_atomically
from ...identifiers import show_path
from ...motion.files import MeasuredMotion, write_motion
from ...results.contents import Contents
from ...results.kinds import Kind, Saved, declare
from ...results.stored import ALLOWED, Stored
from ...scenario.load import load_scenario
from ...shown import Plotting, Shown
from ..estimating import SOLVED
from ..identifiable import BaseParameters
from .fourier import FourierSeries
from .weighted_columns import CRITERIA

CONTROL = 20.0  # rad/s: bandwidth of computed torque in scenarios that are written


@dataclass(frozen=True)
class Compared:
    """A figure of the motion, of the one that the search began with, and the median of random ones within limits."""

    found: float
    start: float
    random: float


@dataclass(frozen=True, eq=False)  # arrays have no one truth
class ExciteResult(Plotting, Shown, Saved, plot="plot_excitation"):
    """Exciting motion of a robot.

    Attributes:
        robot: its name.
        series: the motion, of the m coordinates that move.
        t: times of the samples, (T,), s; the period's end is the last one.
        q, v, a: coordinates, velocities, accelerations, (T, m), m or rad and s.
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
        extremes: least and greatest of the motion, between samples too, (l, 2); of drives with Coulomb friction.
        randoms, starts, seed: of random motions, of searches, of the random numbers.
        notes: what was assumed.
        status: of the search, "converged", or what has not.
    """

    robot: str
    series: FourierSeries
    t: Annotated[Array, Stored(("T",), "s")]
    q: Annotated[Array, Stored(("T", "m"), "m, rad")]
    v: Annotated[Array, Stored(("T", "m"), "m/s, rad/s")]
    a: Annotated[Array, Stored(("T", "m"), "m/s^2, rad/s^2")]
    u: Annotated[Array, Stored(("T", "m"), "N, N m")]
    base: BaseParameters
    noise: Annotated[Array, Stored(("m",), "N, N m")]
    sizes: Annotated[Array, Stored(("b",), "SI")]
    deviations: Annotated[Array, Stored(("b",), "SI")]
    criterion: str
    condition: Annotated[Compared, Stored(largest=np.inf)]
    deviation: Annotated[Compared, Stored(largest=np.inf)]
    limited: tuple[str, ...]
    units: tuple[str, ...]
    limits: Annotated[Array, Stored(("l", 2), "SI", largest=np.inf)]
    extremes: Annotated[Array, Stored(("l", 2), "SI")]
    randoms: int
    starts: int
    seed: int
    notes: tuple[str, ...] = ()
    status: Annotated[str, Stored(otherwise=SOLVED)] = SOLVED

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates that move."""
        return self.series.names

    @property
    def used(self) -> Array:
        """How much of the way to its limit each number goes, (l,): 1 at the limit.

        From the middle between two limits; where there is one alone, that limit over what is nearest to it.  Beyond a
        limit it is more than 1.
        """
        (low, high), (least, greatest) = self.limits.T, self.extremes.T
        both = np.isfinite(low) & np.isfinite(high)
        middle, half = np.where(both, (low + high) / 2.0, 0.0), np.where(both, (high - low) / 2.0, 1.0)
        of_two = np.maximum(greatest - middle, middle - least) / half
        gap = np.where(np.isfinite(low), least - low, high - greatest)
        return np.asarray(np.where(both, of_two, 1.0 / (1.0 + np.maximum(gap, 0.0)) + np.maximum(-gap, 0.0)))

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
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
            "status": self.status,
            "notes": list(self.notes),
        }

    def lines(self) -> list[str]:
        """Return tables for people: the criterion beside others, and how near the motion comes to its limits."""
        series, terms = self.series, ", ".join(self.base.terms)
        lines = [
            f"{self.robot}: {series.duration:g} s, {series.harmonics} harmonics of {1.0 / series.duration:.4g} Hz,"
            f" {len(self.t)} samples",
            f"criterion {self.criterion} ({CRITERIA[self.criterion]}), {len(self.base)} base parameters ({terms}),"
            f" {self.status}",
            "",
            f"{'':<34}{'this motion':>14}{'its start':>14}{'random':>14}",
        ]
        for label, compared in (("condition number", self.condition), ("mean deviation over size", self.deviation)):
            lines.append(f"{label:<34}{compared.found:>14.4g}{compared.start:>14.4g}{compared.random:>14.4g}")
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
        names = self.coordinates
        motion = MeasuredMotion(
            coordinates=names, t=self.t, q=self.q, v=self.v, a=self.a, u=self.u, measured=names, driven=names
        )
        comments = (
            f"Motion of {self.robot} that excites its base parameters: s, m and rad, N and N m.",
            "Drives are computed from the description; measured ones take their place.",
        )
        return write_motion(path, motion, comments)

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
        text = "\n".join(lines).encode("utf-8")
        return write_atomically(target, lambda stream: stream.write(text), read=load_scenario)


def _finite(x: float) -> float | None:
    return x if np.isfinite(x) else None


def _record(result: ExciteResult) -> dict[str, Any]:
    series, base = result.series, result.base
    return {
        "base": {**base.texts(), "chosen": base.chosen, "matrix": base.matrix},
        "coordinates": series.names,
        "duration": series.duration,
        **{name: getattr(series, name) for name in _SERIES},
    }


def _rebuild(file: Contents) -> dict[str, Any]:
    names, duration = file.value(tuple[str, ...], "coordinates"), file.value(float, "duration")
    if not duration > 0.0:
        raise InputError(f"{file.path}: duration: got {duration:g}; allowed: a time in s greater than 0")
    numbers, sizes = {name: file.array(name, stored) for name, stored in _SERIES.items()}, {"m": len(names)}
    for name, stored in _SERIES.items():
        stored.check(numbers[name], sizes, f"{file.path}: array {name}")
    if not sizes["h"]:
        raise InputError(f"{file.path}: array sines has no harmonics; {ALLOWED}")
    table = file.table("base")
    rows = table.value(tuple[tuple[float, ...], ...], "matrix")
    chosen = np.array(table.value(tuple[int, ...], "chosen"), dtype=np.intp)
    parameters = table.value(tuple[str, ...], "parameters")
    matrix = np.array(rows, dtype=np.float64).reshape(len(rows), len(rows[0]) if rows else len(parameters))
    return {
        "series": FourierSeries(names, duration, **numbers),
        "base": BaseParameters.from_texts(table, chosen, matrix),
    }


def _sizes(result: ExciteResult) -> dict[str, int]:
    return {"T": len(result.t), "m": len(result.coordinates), "b": len(result.base), "l": len(result.limited)}


def _check(result: ExciteResult, path: str) -> None:
    if len(result.units) != len(result.limited):
        raise InputError(f"{path}: units: got {len(result.units)}; allowed: {len(result.limited)}, one for each limit")


_SERIES = {
    "offset": Stored(("m",), "m, rad"),
    "sines": Stored(("m", "h"), "m, rad"),
    "cosines": Stored(("m", "h"), "m, rad"),
}
load_excitation = declare(
    Kind(
        "excitation",
        ExciteResult,
        what="motion of excite",
        rebuilt=("series", "base"),
        record=_record,
        rebuild=_rebuild,
        sizes=_sizes,
        check=_check,
        is_finite=False,
    )
)
"""Read the result that ``ExciteResult.save`` wrote; InputError says what in the file is wrong."""
