"""Results of a run of ``benchmarks.precision``, as plain values: docs/precision.json."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from .precision_cases import OTHERS, OURS


@dataclass(frozen=True)
class Point:
    """One run.

    Attributes:
        setting: relative tolerance, or length of a step, s.
        error: of coordinates, the greatest at all samples, m or rad.
        end: of coordinates at the end, likewise.
        seconds: the least time.
        steps: taken and refused.
    """

    contender: str
    setting: float
    error: float
    end: float
    seconds: float
    steps: int


@dataclass(frozen=True)
class Measured:
    """One problem: how far the two references are apart, the points, and why there are none of a contender."""

    problem: str
    difference: float
    points: tuple[Point, ...]
    missing: Mapping[str, str]

    def cheapest(self, contenders: Sequence[str], error: float) -> Point | None:
        """Return the fastest run of these contenders that is as exact, or None."""
        fit = [p for p in self.points if p.contender in contenders and p.error <= error]
        return min(fit, key=lambda p: p.seconds, default=None)

    def ratio(self, error: float, contenders: Sequence[str] = OTHERS) -> float | None:
        """Return the best time of the others, or of these, by the best of ours.

        None where one of both is not as exact.
        """
        ours, others = self.cheapest(OURS, error), self.cheapest(contenders, error)
        return others.seconds / ours.seconds if ours and others else None

    def at(self, contender: str, setting: float) -> Point | None:
        """Return the run of a contender with this tolerance or step."""
        return next((p for p in self.points if (p.contender, p.setting) == (contender, setting)), None)


@dataclass(frozen=True)
class Report:
    """A run: where, how often, and results by problem."""

    machine: Mapping[str, str]
    rounds: int
    found: tuple[Measured, ...]

    def of(self, problem: str) -> Measured | None:
        """Return the results of a problem."""
        return next((each for each in self.found if each.problem == problem), None)

    def write(self, path: Path) -> None:
        """Write it as JSON, four digits of every measured number."""
        values = asdict(self)
        for entry in values["found"]:
            entry["difference"] = _short(entry["difference"])
            for point in entry["points"]:
                point |= {name: _short(point[name]) for name in ("error", "end", "seconds")}
        text = json.dumps(values, indent=1)
        path.write_text(text + "\n", encoding="ascii")


def read(path: Path) -> Report:
    """Return the report of a JSON file."""
    values = json.loads(path.read_text(encoding="ascii"))
    measured = tuple(
        Measured(**{**each, "points": tuple(Point(**point) for point in each["points"])}) for each in values["found"]
    )
    return Report(values["machine"], values["rounds"], measured)


def _short(value: float) -> float:
    return float(f"{value:.4g}")
