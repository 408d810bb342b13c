"""Write docs/soak.md, the record of a whole run of the soak: which commit, when, how long, what failed, the figures."""

from __future__ import annotations

import datetime
import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.support.figures import Figure, gathered, shown
from tests.support.soak import MOST, WHOLE

COUNTED = ("passed", "skipped", "failed", "error")
SLOWEST = 12

INTRODUCTION = """# Soak

Written by `make soak`; do not edit. The soak is what takes too long for `make test-all`: random robots by the hundred,
fuzzers, other compilers and instruction sets, packages built and installed, notebooks and pages run as a reader would.
"""


class FailuresAtOnce:
    """Keeps failures in a file as they come: a run that is cut off after an hour has said them."""

    def __init__(self, path: Path) -> None:
        self.path = path
        path.unlink(missing_ok=True)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(f"{report.nodeid} [{report.when}]\n{report.longrepr}\n\n")


def write_soak_page(path: Path, stats: Mapping[str, Sequence[Any]], seconds: float, workers: int) -> None:
    """Write the page.

    Args:
        path: Where the page goes.
        stats: Reports by their outcome, as pytest's terminal reporter keeps them.
        seconds: How long the run took.
        workers: How many processes ran tests.
    """
    calls = [report for outcome in ("passed", "failed") for report in stats.get(outcome, ())]
    path.write_text(
        "\n".join([INTRODUCTION, *_run(stats, seconds, workers), *_slowest(calls), *_figures(calls)]) + "\n"
    )


def commit(root: Path) -> str:
    """Return the short name of the commit that is checked out, and whether files differ from it."""
    try:
        name = _git(root, "rev-parse", "--short=10", "HEAD")
        changed = _git(root, "status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.CalledProcessError):
        return "no commit"
    return f"{name} with changes that are not committed" if changed else name


def _git(root: Path, *arguments: str) -> str:
    run = subprocess.run(["git", *arguments], cwd=root, check=True, capture_output=True, text=True)
    return run.stdout.strip()


def _run(stats: Mapping[str, Sequence[Any]], seconds: float, workers: int) -> list[str]:
    """Rows of the table about the run, and the tests that failed."""
    counts = {outcome: len(stats.get(outcome, ())) for outcome in COUNTED}
    rows = {
        "commit": commit(Path(__file__).parents[2]),
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "tests": ", ".join(f"{count} {outcome}" for outcome, count in counts.items() if count or outcome == "failed"),
        "time": f"{seconds / 60:.0f} minutes in {workers} processes on {os.cpu_count()} cores",
        "cases": "all" if WHOLE else f"of each test {MOST}, if not more; all with `EOMGEN_SOAK=all make soak`",
        "Python": f"{platform.python_version()}, {platform.system()} {platform.machine()}",
    }
    table = ["|  |  |", "|---|---|", *(f"| {name} | {text} |" for name, text in rows.items())]
    failed = [f"- `{report.nodeid}`" for outcome in ("failed", "error") for report in stats.get(outcome, ())]
    return [*table, *(["", "## Failed", "", *failed] if failed else [])]


def _slowest(calls: Sequence[Any]) -> list[str]:
    by_file: dict[str, float] = {}
    for report in calls:
        name = report.nodeid.partition("::")[0]
        by_file[name] = by_file.get(name, 0.0) + report.duration
    rows = sorted(by_file.items(), key=lambda entry: -entry[1])[:SLOWEST]
    table = ["| tests | minutes of one process |", "|---|---:|"]
    return ["", "## Where the time goes", "", *table, *(f"| `{name}` | {time / 60:.1f} |" for name, time in rows)]


def _figures(calls: Sequence[Any]) -> list[str]:
    """Rows of counts and worst deviations, by test."""
    rows = [
        f"| `{test.rpartition('::')[2]}` | {name} | {value} | {limit} |"
        for test, figures in sorted(gathered(calls).items())
        for name, value, limit in _columns(figures)
    ]
    if not rows:
        return []
    return [
        "",
        "## Counts and worst deviations",
        "",
        "| test | what | measured | at most |",
        "|---|---|---:|---:|",
        *rows,
    ]


def _columns(figures: Mapping[str, Figure]) -> list[tuple[str, str, str]]:
    return [(name.replace("|", "\\|"), *shown(figure)) for name, figure in figures.items()]
