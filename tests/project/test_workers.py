"""Workers of the test suite are limited by the memory that is available, and the run says so."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.workers import GROUPS, OF_A_WORKER, available_memory, workers_by_memory

GB = 1e9


@pytest.mark.parametrize(
    ("cores", "available", "expected"),
    [(16, 100 * GB, 16), (16, 7.6 * GB, 5), (2, 0.3 * GB, 1), (4, 4 * OF_A_WORKER, 4), (8, None, 8)],
)
def test_workers_fit_into_the_memory(cores: int, available: float | None, expected: int) -> None:
    workers, reason = workers_by_memory(cores, available)
    assert workers == expected
    assert bool(reason) == (workers < cores)
    assert not reason or reason.startswith(f"workers: {workers} instead of {cores}, ")
    assert "\n" not in reason


def write(root: Path, **files: str) -> None:
    for name, text in files.items():
        path = root / name.replace("__", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


@pytest.mark.parametrize(("folder", "limit", "usage", "idle"), GROUPS)
def test_the_least_of_machine_and_container_counts(
    folder: str, limit: str, usage: str, idle: str, tmp_path: Path
) -> None:
    """Files that the system keeps in memory without need count as available, in a container as on the machine."""
    assert available_memory(tmp_path) is None
    meminfo = "MemTotal:       24000000 kB\nMemFree:          100000 kB\nMemAvailable:    9000000 kB\n"
    write(tmp_path, proc__meminfo=meminfo)
    assert available_memory(tmp_path) == 9_000_000 * 1024
    statistics = f"anon 5\nactive_file 900000000\n{idle} 500000000\n"
    group = {f"{folder}/{usage}": "3000000000\n", f"{folder}/memory.stat": statistics}
    write(tmp_path, **group, **{f"{folder}/{limit}": "4000000000\n"})
    assert available_memory(tmp_path) == 1.5 * GB
    write(tmp_path, **{f"{folder}/{limit}": "max\n"})
    assert available_memory(tmp_path) == 9_000_000 * 1024
