"""Runs of the suite: workers are limited by the memory that is available, and the soak leaves a record."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.support.figures import Figures
from tests.support.soak_page import write_soak_page
from tests.support.workers import GROUPS, OF_A_WORKER, available_memory, workers_by_memory


def _report(nodeid: str, duration: float, figures: Figures | None = None) -> SimpleNamespace:
    properties = [("figures", figures.recorded)] if figures else []
    return SimpleNamespace(nodeid=nodeid, duration=duration, when="call", user_properties=properties)


def test_the_page_names_what_failed_and_gathers_the_figures_of_a_test(tmp_path: Path) -> None:
    first, second = Figures({}), Figures({})
    first.at_most("error of a step", 1e-9, 1e-6)
    second.at_most("error of a step", 3e-8, 1e-6)
    second.count("steps", 12)
    stats = {
        "passed": [_report("tests/a.py::test_one[1]", 60.0, first), _report("tests/a.py::test_one[2]", 30.0, second)],
        "failed": [_report("tests/b.py::test_two", 240.0)],
        "skipped": [_report("tests/c.py::test_three", 0.0)],
    }
    page = tmp_path / "soak.md"
    write_soak_page(page, stats, 3000.0, 2)
    text = page.read_text(encoding="utf-8")
    assert "| tests | 2 passed, 1 skipped, 1 failed |" in text
    assert "| time | 50 minutes in 2 processes" in text
    assert "## Failed\n\n- `tests/b.py::test_two`\n" in text
    assert text.index("| `tests/b.py` | 4.0 |") < text.index("| `tests/a.py` | 1.5 |")
    assert "| `test_one` | error of a step | 3.00e-08 | 1e-06 |" in text
    assert "| `test_one` | steps | 12.0 |  |" in text


def test_a_run_without_failures_lists_none(tmp_path: Path) -> None:
    write_soak_page(tmp_path / "soak.md", {"passed": [_report("tests/a.py::test_one", 1.0)]}, 60.0, 1)
    text = (tmp_path / "soak.md").read_text(encoding="utf-8")
    assert "1 passed, 0 failed" in text
    assert "## Failed" not in text
    assert "Counts" not in text


def test_make_soak_gathers_where_the_page_exists() -> None:
    """A path in a word of its own pytest takes for one of tests, and then no process gathers what the workers say."""
    root = Path(__file__).parents[2]
    assert (root / "docs" / "soak.md").is_file()
    makefile = (root / "Makefile").read_text(encoding="utf-8")
    (words,) = (line.split()[1:] for line in makefile.splitlines() if "--soak-page" in line)
    command = [sys.executable, *(word for word in words if word not in ("-n", "auto", "--dist", "worksteal"))]
    asked = subprocess.run(
        [*command, "--trace-config", "--markers"], cwd=root, capture_output=True, text=True, check=False
    )
    assert asked.returncode == 0, asked.stderr
    assert str(root / "tests" / "conftest.py") in asked.stdout


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
