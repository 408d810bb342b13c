"""Random results and folders of sweeps within limits of time and memory, as ``fuzzing`` does it for descriptions.

    python -m tests.support.kept_fuzzing KIND FIRST COUNT

prints a line of JSON: how many were accepted, the slowest one in s of processor time, and the memory used, MB.
"""

from __future__ import annotations

import json
import random
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import eomgen
from eomgen.errors import InputError
from eomgen.simulation.result import SimulationResult
from eomgen.sweep.result import SweepResult
from eomgen.sweep.store import MANIFEST, ROWS
from tests.support.fuzzing import check_message, limit_memory, measured
from tests.support.kept_files import (
    random_result,
    random_sweep,
    raw_result,
    raw_sweep,
    sample_result,
    write_raw,
    write_sweep,
)
from tests.support.measured_results import RESULTS, loaded_measured, random_measured, raw_measured, write_measured
from tests.support.mutations import raw

SingleMotion = SimulationResult | SweepResult


def loaded(read: Callable[[Path], SingleMotion], path: Path) -> SingleMotion | None:
    """What a file is, with what is printed of it; None where it is refused, with a message that is one."""
    try:
        found = read(path)
    except InputError as error:
        check_message(error)
        return None
    lines = (
        found.summary_lines() if isinstance(found, SimulationResult) else [*found.lines(), json.dumps(found.as_dict())]
    )
    if isinstance(found, SimulationResult):
        json.dumps(found.summary())
        for name in found.names:
            assert found.series(name).values.shape[0] == found.trajectory.t.size
    assert all(line.isprintable() for line in lines), lines
    return found


def _with_raw_bytes(path: Path, seed: int) -> None:
    """Truncation, flipped bits and the like in one of five files."""
    chance = random.Random(f"raw {seed}")
    if chance.random() < 0.2:
        path.write_bytes(raw(path.read_bytes(), chance))


def results(folder: Path) -> Callable[[int], SingleMotion | None]:
    names = ("one_link", "geared_arm", "balanced_arm")
    samples = [raw_result(sample_result(name, states=name != names[1]), folder) for name in names]

    def tried(seed: int) -> SingleMotion | None:
        path = write_raw(folder / "r.npz", *random_result(samples[seed % len(samples)], seed))
        _with_raw_bytes(path, seed)
        return loaded(eomgen.load_result, path)

    return tried


def sweeps(folder: Path) -> Callable[[int], SingleMotion | None]:
    sweep = raw_sweep()

    def tried(seed: int) -> SingleMotion | None:
        path = write_sweep(folder / "sweep", *random_sweep(sweep, seed))
        _with_raw_bytes(path / (MANIFEST if seed % 2 else ROWS), seed)
        return loaded(SweepResult.load, path)

    return tried


def _measured(kind: str) -> Callable[[Path], Callable[[int], Any]]:
    """A result of measurements of that kind."""

    def begin(folder: Path) -> Callable[[int], Any]:
        sample = raw_measured(kind, folder)

        def tried(seed: int) -> Any:
            path = write_measured(folder, *random_measured(sample, seed))
            _with_raw_bytes(path, seed)
            return loaded_measured(kind, path)

        return tried

    return begin


MEASURED = tuple(RESULTS)
KINDS = {"result": results, "sweep": sweeps, **{kind: _measured(kind) for kind in MEASURED}}


def run(kind: str, first: int, count: int) -> dict[str, Any]:
    """What readers make of mutants of these seeds, as ``fuzzing.measured``."""
    with tempfile.TemporaryDirectory() as folder:
        tried = KINDS[kind](Path(folder))
        tried(first)  # what is imported on first use is no part of a file's memory
        limit_memory()
        return measured(kind, tried, first, count)


if __name__ == "__main__":
    name, *numbers = sys.argv[1:]
    print(json.dumps(run(name, *map(int, numbers))))
