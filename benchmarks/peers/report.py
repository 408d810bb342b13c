"""What a run measured, as plain values: docs/peers.json, from which page and plot are written without timing."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from ..bars import Bar
from .required import required

Quartiles = tuple[float, float, float]  # first, median, third


@dataclass(frozen=True)
class Entry:
    """One kernel of one robot.

    ns: medians by label, nanoseconds per state.  ratios: the contender's time by this project's, rounds in turns.
    difference: greatest relative difference of results.  missing: label -> why there is no such contender.
    """

    case: str
    title: str
    coordinates: int
    kernel: str
    batch: bool = False
    ns: Mapping[str, float] = field(default_factory=dict)
    ratios: Mapping[str, Quartiles] = field(default_factory=dict)
    difference: float = 0.0
    missing: Mapping[str, str] = field(default_factory=dict)

    def against(self, peer: str) -> tuple[str, Quartiles] | None:
        """Return label and ratio of the peer, of its fastest variant where it has several; None without any."""
        candidates = [(label, ratio) for label, ratio in self.ratios.items() if label.split(" (")[0] == peer]
        return min(candidates, key=lambda item: item[1][1], default=None)

    def bar(self, peer: str) -> Bar | None:
        """Return what is required of the ratio to this peer, or None."""
        needed = required(peer, self.case, self.kernel, self.batch)
        ratio = self.against(peer)
        return None if needed is None else Bar(f"{self.title}, {peer}", ratio[1][1] if ratio else None, needed)


@dataclass(frozen=True)
class Call:
    """A kernel of a robot called in several ways; ns: least times by way, nanoseconds per state."""

    title: str
    processor: str
    kernel: str
    ns: Mapping[str, float]


@dataclass(frozen=True)
class Gradient:
    """The gradient of a rollout of so many steps; ns: least times by way, nanoseconds; errors: relative, by way."""

    title: str
    processor: str
    steps: int
    ns: Mapping[str, float]
    errors: Mapping[str, float]


@dataclass(frozen=True)
class Report:
    """A run: where, how, and its entries; ``growing`` are chains of more and more joints, for the plot.

    calls: what calls from Python cost.  gradients: of rollouts.
    """

    machine: Mapping[str, str]
    rounds: int
    states: int
    batch_states: int
    missing: Mapping[str, str]
    entries: tuple[Entry, ...]
    growing: tuple[Entry, ...] = ()
    calls: tuple[Call, ...] = ()
    gradients: tuple[Gradient, ...] = ()

    def entry(self, case: str, kernel: str, batch: bool = False) -> Entry | None:
        """Return the entry of a kernel of a robot, or None."""
        return next((e for e in self.entries if (e.case, e.kernel, e.batch) == (case, kernel, batch)), None)

    def write(self, path: Path) -> None:
        """Write it as JSON, four digits of every number."""
        path.write_text(json.dumps(_rounded(asdict(self)), indent=1) + "\n", encoding="ascii")


def read(path: Path) -> Report:
    """Return the report of a JSON file."""
    values = json.loads(path.read_text(encoding="ascii"))
    for key in ("entries", "growing"):
        values[key] = tuple(
            Entry(**{**entry, "ratios": {label: tuple(x) for label, x in entry["ratios"].items()}})
            for entry in values[key]
        )
    values["calls"] = tuple(Call(**call) for call in values.get("calls", ()))
    values["gradients"] = tuple(Gradient(**gradient) for gradient in values.get("gradients", ()))
    return Report(**values)


def _rounded(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(item) for item in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value
