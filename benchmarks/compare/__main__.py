"""Compare the working tree with a commit: exact operation counts, and times as ratios with 95 % intervals.

    python -m benchmarks.compare COMMIT [ROW ...] [--rounds N]

Each version has a process with its own package and its own compile cache; in every round both are asked for a sample
of CPU time, in alternating order, on one core. No row is timed before the results of both agree.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..peers.contender import MissingPeer
from ..size import ROOT, contents, table
from .rows import Row, chosen

CHILD = Path(__file__).with_name("child.py")
CACHES = ROOT / "out" / "compare"  # of commits, which do not change


class Version:
    """The process of one version."""

    def __init__(self, folder: Path, commit: str | None, cache: Path) -> None:
        for name, data in contents(ROOT, commit, untracked=True):
            if name.startswith(("src/", "codegen/", "templates/")):
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (folder / name).write_bytes(data)
        for name in ("codegen", "templates"):
            (folder / "src" / "eomgen" / name).symlink_to(folder / name)
        own = {"PYTHONPATH": str(folder / "src"), "EOMGEN_CACHE_DIR": str(cache), "OPENBLAS_NUM_THREADS": "1"}
        command, pipe = [sys.executable, "-P", str(CHILD), str(folder)], subprocess.PIPE
        self.process = subprocess.Popen(command, env={**os.environ, **own}, stdin=pipe, stdout=pipe, text=True)

    def send(self, request: Mapping[str, Any]) -> None:
        """Send a request, which ``answer`` answers."""
        assert self.process.stdin is not None
        print(json.dumps(request), file=self.process.stdin, flush=True)

    def answer(self) -> dict[str, Any]:
        """Wait for the answer.

        Raises:
            ChildProcessError: the process ended.
        """
        assert self.process.stdout is not None
        if not (line := self.process.stdout.readline()):
            raise ChildProcessError(f"a version's process ended with status {self.process.wait()}")
        answer: dict[str, Any] = json.loads(line)
        return answer


@dataclass
class Comparison:
    """A row in the commit and here: operation counts, difference between results, ratios of time."""

    row: Row
    counts: Sequence[Mapping[str, int]] = ({}, {})
    difference: float = math.nan
    missing: str = ""
    ratios: Sequence[float] = ()

    @property
    def differs(self) -> bool:
        """Whether the results differ by more than the row's tolerance."""
        return not self.missing and not self.difference <= self.row.tolerance

    @property
    def work(self) -> float:
        """Operations here divided by those of the commit, those of all steps; NaN where nothing is counted."""
        old, new = (work(count) for count in self.counts)
        return new / old if old else math.nan

    @property
    def time(self) -> tuple[float, float, float]:
        """Time here divided by that of the commit, with its interval."""
        return interval(self.ratios)


def work(count: Mapping[str, int]) -> int:
    """Return the operations of all steps, or the steps where operations are not counted."""
    operations = sum(number for key, number in count.items() if key != "steps")
    return operations * count.get("steps", 1) or count.get("steps", 0)


def interval(ratios: Sequence[float]) -> tuple[float, float, float]:
    """Return the geometric mean of ratios, and its 95 % interval by Student's t for their logarithms."""
    from scipy.stats import t

    if len(ratios) < 2:
        return (*ratios, math.nan, math.nan, math.nan)[:3]
    logs = np.log(ratios)
    middle, half = logs.mean(), t.ppf(0.975, len(logs) - 1) * logs.std(ddof=1) / math.sqrt(len(logs))
    return math.exp(middle), math.exp(middle - half), math.exp(middle + half)


def prepare(row: Row, versions: Sequence[Version], folder: Path) -> Comparison:
    """Build a row in both versions side by side, and compare their results."""
    paths = [folder / f"results{number}.npy" for number in range(2)]
    try:
        request = row.request(folder)
    except MissingPeer as error:
        return Comparison(row, missing=str(error))
    for version, path in zip(versions, paths, strict=True):
        version.send({**request, "results": str(path)})
    answers = dict(zip(("commit", "here"), [version.answer() for version in versions], strict=True))
    missing = "; ".join(f"{which}: {answer['missing']}" for which, answer in answers.items() if "missing" in answer)
    if missing:
        return Comparison(row, missing=missing)
    return Comparison(row, [answer["counts"] for answer in answers.values()], difference(*map(np.load, paths)))


def difference(first: np.ndarray, second: np.ndarray) -> float:
    """Return the greatest difference, relative to the greatest number of the first."""
    if first.shape != second.shape:
        return math.inf
    return float(np.abs(first - second).max() / max(np.abs(first).max(), 1e-300))


def time(row: Row, versions: Sequence[Version], rounds: int) -> list[float]:
    """Return ratios of time here to that of the commit, of rounds in which both are asked in alternating order."""
    ratios = []
    for number in range(rounds):
        ns = {}
        for which in (0, 1) if number % 2 == 0 else (1, 0):
            versions[which].send({"name": row.name})
            ns[which] = versions[which].answer()["ns"]
        ratios.append(ns[1] / ns[0])
    return ratios


def lines(comparisons: Sequence[Comparison], commit: str) -> list[str]:
    """Return the table, and which rows need more or fewer operations, and more or less time."""
    rows = []
    said: dict[str, list[str]] = {x: [] for x in ("More operations", "Fewer operations", "Slower", "Faster")}
    for each in comparisons:
        counts = [" ".join(f"{number} {key}" for key, number in count.items()) for count in each.counts]
        ratios = ["" if math.isnan(x) else f"{x:.3f}" for x in (each.work, *each.time)]
        last = each.missing or f"{each.difference:.1e}{', not timed' if each.differs else ''}"
        rows.append([each.row.name, *counts, *ratios, last])
        _, low, high = each.time
        for names, is_so in zip(said.values(), (each.work > 1, each.work < 1, low > 1, high < 1), strict=True):
            names += [each.row.name] * is_so
    heads = ["row", f"operations, {commit}", "here", "ratio", "time, ratio", "from", "to", "results differ by"]
    return [*table(heads, rows), "", *(f"{word}: {', '.join(names) or 'none'}." for word, names in said.items())]


def main(words: Sequence[str] | None = None) -> int:
    """Compare rows and print the table; status 1 where results differ."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.compare", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("commit", nargs="?", metavar="COMMIT", help="a commit, branch or tag")
    parser.add_argument("rows", nargs="*", metavar="ROW", help="name, beginning of a name, or pattern; default: all")
    parser.add_argument(
        "--rounds", type=int, default=20, metavar="N", help="rounds of each row (default 20; 0: counts)"
    )
    parser.add_argument("--list", action="store_true", help="print the names of all rows")
    arguments = parser.parse_args(words)
    if arguments.list:
        print("\n".join(row.name for row in chosen([])))
        return 0
    if arguments.commit is None or arguments.rounds < 0:
        parser.error("COMMIT is missing" if arguments.commit is None else "--rounds: at least 0")
    try:
        rows = chosen(arguments.rows)
    except ValueError as error:
        parser.error(str(error))
    parse = ["git", "-C", str(ROOT), "rev-parse", "--verify", "--quiet", f"{arguments.commit}^{{commit}}"]
    commit = subprocess.run(parse, capture_output=True, text=True, check=False).stdout.strip()
    if not commit:
        parser.error(f"COMMIT: {arguments.commit!r} is no commit of this repository")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        versions = [
            Version(folder / "commit", commit, CACHES / commit),
            Version(folder / "here", None, folder / "cache"),
        ]
        try:
            comparisons = [prepare(row, versions, folder) for row in rows]
            for version in versions if hasattr(os, "sched_setaffinity") else ():
                os.sched_setaffinity(version.process.pid, {max(os.sched_getaffinity(0))})
            for each in comparisons:
                if not each.missing and not each.differs:
                    each.ratios = time(each.row, versions, arguments.rounds)
        finally:
            for version in versions:
                version.process.communicate()
    print("\n".join(lines(comparisons, commit[:8])))
    return int(any(each.differs for each in comparisons))


if __name__ == "__main__":
    sys.exit(main())
