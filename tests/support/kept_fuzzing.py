"""Random results and folders of sweeps within limits of time and memory, as ``fuzzing`` does it for descriptions.

    python -m tests.support.kept_fuzzing KIND FIRST COUNT

prints a line of JSON: how many were accepted, the slowest one in s of processor time, and the memory used, MB.
"""

from __future__ import annotations

import json
import random
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import eomgen
from eomgen.errors import EomgenWarning, InputError
from eomgen.simulation.result import SimulationResult
from eomgen.sweep.result import SweepResult
from eomgen.sweep.store import MANIFEST, ROWS
from tests.support.fuzzing import SECONDS, check_message, late, limit_memory
from tests.support.kept_files import (
    random_result,
    random_sweep,
    raw_result,
    raw_sweep,
    sample_result,
    write_raw,
    write_sweep,
)
from tests.support.mutations import raw

Loaded = SimulationResult | SweepResult


def loaded(read: Callable[[Path], Loaded], path: Path) -> Loaded | None:
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


def results(folder: Path) -> Callable[[int], Loaded | None]:
    samples = [raw_result(sample_result(name), folder) for name in ("one_link", "geared_arm", "balanced_arm")]

    def tried(seed: int) -> Loaded | None:
        path = write_raw(folder / "r.npz", *random_result(samples[seed % len(samples)], seed))
        _with_raw_bytes(path, seed)
        return loaded(eomgen.load_result, path)

    return tried


def sweeps(folder: Path) -> Callable[[int], Loaded | None]:
    sweep = raw_sweep()

    def tried(seed: int) -> Loaded | None:
        path = write_sweep(folder / "sweep", *random_sweep(sweep, seed))
        _with_raw_bytes(path / (MANIFEST if seed % 2 else ROWS), seed)
        return loaded(SweepResult.load, path)

    return tried


KINDS = {"result": results, "sweep": sweeps}


def run(kind: str, first: int, count: int) -> dict[str, Any]:
    """Mutants of these seeds; AssertionError with the seed for one that is not handled."""
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", EomgenWarning)
    signal.signal(signal.SIGPROF, late)
    found, slowest, began = 0, 0.0, time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        tried = KINDS[kind](Path(folder))
        tried(first)  # what is imported on first use is no part of a file's memory
        limit_memory()
        for seed in range(first, first + count):
            signal.setitimer(signal.ITIMER_PROF, SECONDS)
            start = time.process_time()
            try:
                found += tried(seed) is not None
            except BaseException as error:
                signal.setitimer(signal.ITIMER_PROF, 0)
                raise AssertionError(f"{kind} {seed}") from error
            slowest = max(slowest, time.process_time() - start)
        signal.setitimer(signal.ITIMER_PROF, 0)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    return {"accepted": found, "slowest": slowest, "peak": peak, "seconds": time.process_time() - began}


if __name__ == "__main__":
    name, *numbers = sys.argv[1:]
    print(json.dumps(run(name, *map(int, numbers))))
