"""Results of compensations: the compensated path, the tool's error without and with it, and what is left, and why."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...results.kinds import Kind, Saved, declare
from ...results.stored import Stored
from ...scenario.recorded import scenario_from_record
from ...scenario.value import Scenario
from ...shown import Plotting, Shown, prefixed, scale_of
from ...tabular import Rows, TableColumn, Tabular
from .as_scenario import write_program

AXES = ("x", "y", "z", "rx", "ry", "rz")  # of the tool: displacements along them and rotations about them
UNITS = ("m",) * 3 + ("rad",) * 3
_PART = 0.01  # of a motion along an axis that cannot be corrected, from which on it is said


def sizes(error: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return rms of position and of orientation of errors, (T, 6), and the greatest of both; m, rad."""
    lengths = np.linalg.norm(error.reshape(-1, 2, 3), axis=2)
    (p, o), (p_peak, o_peak) = np.sqrt((lengths**2).mean(axis=0)).tolist(), lengths.max(axis=0).tolist()
    return (p, o), (p_peak, o_peak)


@dataclass(frozen=True)
class Variant:
    """A robot that differs from the description: rms of the tool's error without and with the correction, m and rad."""

    label: str
    position_before: float
    orientation_before: float
    position_after: float
    orientation_after: float

    @property
    def gain(self) -> float:
        """How many times smaller the position's error is with the correction."""
        return self.position_before / max(self.position_after, 1e-300)


@dataclass(frozen=True)
class HeldBack:
    """A coordinate whose limits take something from its correction.

    seconds: for how long.  position, orientation: the tool's greatest error meanwhile, m and rad.
    """

    coordinate: str
    seconds: float
    position: float
    orientation: float


@dataclass(frozen=True, kw_only=True)
class CompensationResult(Plotting, Shown, Tabular, Saved, plot="plot_compensation"):
    """A compensated path, T samples of m driven coordinates; errors at and between them, in the wanted tool's axes.

    Attributes:
        robot, frame: names.
        mode: "static" or "dynamic".
        coordinates: names of the driven coordinates, m.
        t: times of the samples, (T,), s.
        program, corrected: coordinates as they were programmed and as they are to be, (T, m), m or rad.
        times: of the errors, (2 T - 1,), s.
        before, after: the simulated tool's errors without and with the correction, (2 T - 1, 6), m and rad.
        beyond: what of the latter no change of the reference undoes, (2 T - 1, 6).
        weights: of the tool's axes, (6,), 1 and m/rad.
        history: weighted rms of the error that can be undone, m: of each simulation of "dynamic", the first without
            correction; empty of "static".
        rank: least and greatest number of directions that can be corrected.
        shares: fraction of a small motion along each axis that cannot be undone, (6,), mean of the path.
        limits: coordinates that limits held back.
        robustness: other robots.
        scenario: the simulation, without its motion.
        notes: lines about what was assumed and what remains.
    """

    robot: str
    frame: str
    mode: str
    coordinates: tuple[str, ...]
    t: Annotated[Array, Stored(("T",), "s")]
    program: Annotated[Array, Stored(("T", "m"), "m, rad")]
    corrected: Annotated[Array, Stored(("T", "m"), "m, rad")]
    times: Annotated[Array, Stored(("2 T - 1",), "s")]
    before: Annotated[Array, Stored(("2 T - 1", 6), "m, rad")]
    after: Annotated[Array, Stored(("2 T - 1", 6), "m, rad")]
    beyond: Annotated[Array, Stored(("2 T - 1", 6), "m, rad")]
    weights: Annotated[Array, Stored((6,), "1, m/rad")]
    history: tuple[float, ...]
    rank: tuple[int, int]
    shares: tuple[float, ...]
    limits: tuple[HeldBack, ...]
    robustness: tuple[Variant, ...]
    scenario: Scenario
    notes: tuple[str, ...]

    @property
    def gain(self) -> float:
        """How many times smaller the rms of the position's error is."""
        return sizes(self.before)[0][0] / max(sizes(self.after)[0][0], 1e-300)

    def figures(self) -> dict[str, dict[str, float]]:
        """Return rms and greatest of all errors by axis, and of the lengths of position and orientation; m, rad."""
        errors: dict[str, dict[str, float]] = {}
        parts = {"before": self.before, "after": self.after, "beyond": self.beyond}
        for i, axis in enumerate(AXES):
            errors[axis] = {}
            for name, error in parts.items():
                errors[axis][f"{name}_rms"] = float(np.sqrt((error[:, i] ** 2).mean()))
                errors[axis][f"{name}_peak"] = float(np.abs(error[:, i]).max())
        for i, kind in enumerate(("position", "orientation")):
            errors[kind] = {}
            for name, error in parts.items():
                rms, peak = sizes(error)
                errors[kind] |= {f"{name}_rms": rms[i], f"{name}_peak": peak[i]}
        return errors

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {
            "robot": self.robot,
            "frame": self.frame,
            "mode": self.mode,
            "coordinates": list(self.coordinates),
            "samples": len(self.t),
            "duration": float(self.t[-1]),
            "errors": self.figures(),
            "gain": self.gain,
            "weights": dict(zip(AXES, self.weights.tolist(), strict=True)),
            "history": list(self.history),
            "rank": list(self.rank),
            "not_correctable": dict(zip(AXES, self.shares, strict=True)),
            "largest_correction": dict(
                zip(self.coordinates, np.abs(self.corrected - self.program).max(axis=0).tolist(), strict=True)
            ),
            "limits": [vars(item) for item in self.limits],
            "robustness": [{**vars(item), "gain": item.gain} for item in self.robustness],
            "notes": list(self.notes),
        }

    def as_rows(self) -> Rows:
        """Return a row per time: the errors before and after by axis."""
        columns = [
            TableColumn(f"{name}.{axis}", unit, error[:, i])
            for name, error in (("before", self.before), ("after", self.after))
            for i, (axis, unit) in enumerate(zip(AXES, UNITS, strict=True))
        ]
        return Rows("t", "s", self.times, columns, {"robot": self.robot, "frame": self.frame})

    def lines(self) -> list[str]:
        """Return tables for people."""
        how = f"{len(self.history)} simulations" if self.mode == "dynamic" else "static equilibria"
        lines = [f"{self.robot}: tracking error of {self.frame}, in its axes; {self.mode} compensation, {how}", ""]
        lines.append(f"{'':<18}{'before':^20}{'after':^20}{'of it out of reach':^20}")
        lines.append(f"{'':<18}" + f"{'rms':>10}{'peak':>10}" * 3)
        for name, row in self.figures().items():
            numbers = [row[f"{stage}_{kind}"] for stage in ("before", "after", "beyond") for kind in ("rms", "peak")]
            scale, unit = scale_of(numbers, "m" if name in (*AXES[:3], "position") else "rad")
            lines.append(f"{name + ' [' + unit + ']':<18}" + "".join(f"{scale * x:>10.4g}" for x in numbers))
        lines += ["", *self._reach_lines(), *self._limit_lines()]
        if self.robustness:
            lines += ["", "with other stiffness, rms of position", *self._robust_lines()]
        return lines + [f"note: {note}" for note in self.notes]

    def _reach_lines(self) -> Iterator[str]:
        least, most = self.rank
        followed = int((self.weights > 0.0).sum())
        numbers = f"{most}" if least == most else f"{least} to {most}"
        yield f"directions that can be corrected: {numbers} of {followed}"
        for axis, share, weight in zip(AXES, self.shares, self.weights.tolist(), strict=True):
            if weight == 0.0:
                yield f"  {axis}: weight 0, not corrected"
            elif share >= _PART:
                yield f"  {axis}: {100.0 * share:.0f} % of it cannot be corrected, on average"

    def _limit_lines(self) -> Iterator[str]:
        for item in self.limits:
            yield (
                f"limits hold {item.coordinate} back for {item.seconds:.3g} s: up to {prefixed(item.position, 'm', 4)}"
                f" and {prefixed(item.orientation, 'rad', 4)} remain there"
            )

    def _robust_lines(self) -> Iterator[str]:
        for item in self.robustness:
            numbers = f"{prefixed(item.position_before, 'm', 4)} -> {prefixed(item.position_after, 'm', 4)}"
            yield f"  {item.label:<24}{numbers}, {item.gain:.3g} times less"

    def to_scenario(self, path: Path | str) -> list[Path]:
        """Write a scenario .toml that follows the compensated path, which stands beside it; returns all paths.

        NAME.csv is the compensated path, and NAME_wanted.csv the one as it was, with which results are compared.
        Columns are t (s), the driven coordinates, their velocities and accelerations, as the scenario's spline has.

        Raises:
            InputError: the path does not end in .toml, or a file cannot be written.
        """
        return write_program(self, Path(path))


def _sizes(result: CompensationResult) -> dict[str, int]:
    return {"T": result.t.size, "m": len(result.coordinates), "2 T - 1": 2 * result.t.size - 1}


def _check(result: CompensationResult, path: str) -> None:
    if (np.diff(result.t) <= 0.0).any():
        raise InputError(f"{path}: array t does not increase; allowed: increasing times")


load_compensation = declare(
    Kind(
        "compensation",
        CompensationResult,
        rebuilt=("scenario",),
        record=lambda result: {"scenario": result.scenario.as_dict()},
        rebuild=lambda file: {
            "scenario": scenario_from_record(file.plain.get("scenario", {}), f"{file.path}: scenario")
        },
        sizes=_sizes,
        check=_check,
    )
)
"""Read the result that ``CompensationResult.save`` wrote; InputError says what in the file is wrong."""
