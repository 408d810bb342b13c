"""Run tests on functions that return wrong values, in copies of a checkout."""

from __future__ import annotations

import json
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

from .executions import Executions, read_coverage
from .functions import Function, mutated_text
from .runner import Clock
from .workers import CACHE, Run, Worker

FIRST = 10.0  # s of tests in the first process of a mutant
IMPORT = 0.7  # s to import a module of tests
SPARE = 60.0  # s of processor time beyond the budget, after which a process is endless


@dataclass(frozen=True)
class Verdict:
    """What became of a function with wrong values, the test that failed with its words, and the time it took.

    ``result`` is "killed", "survived", "unchanged" (no test made it return a value that can be changed) or
    "not executed".
    """

    mutant: Function
    result: str
    test: str = ""
    what: str = ""
    seconds: float = 0.0


class Packages:
    """Mutants of a checkout, the tests that execute them, and a file to which verdicts are appended."""

    def __init__(self, tree: Path, executions: Executions, raw: Path, budget: float, workers: int) -> None:
        self.tree, self.executions, self.raw, self.budget, self.workers = tree, executions, raw, budget, workers
        self.broken = set[str]()  # tests that fail without a wrong value
        self.lock = threading.Lock()

    def run(self, functions: Sequence[Function], listed: Sequence[Function]) -> None:
        """Judge functions; then judge those of the list anew that a test killed which fails with right values too."""
        with ExitStack() as stack:
            folders = [Path(stack.enter_context(tempfile.TemporaryDirectory())) for _ in range(self.workers)]
            workers = [Worker(self.tree, folder) for folder in folders]
            while True:
                clock, waiting = Clock(len(functions)), list(reversed(functions))
                threads = [threading.Thread(target=self._work, args=(w, waiting, clock)) for w in workers]
                for thread in threads:
                    thread.start()
                for thread in threads:
                    thread.join()
                functions = self._doubtful(workers[0], listed)
                if not functions:
                    return

    def _work(self, worker: Worker, waiting: list[Function], clock: Clock) -> None:
        while True:
            with self.lock:
                if not waiting:
                    return
                function = waiting.pop()
            verdict = self.judge(worker, function)
            with self.lock, self.raw.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(verdict)) + "\n")
                clock.tick(verdict.result)

    def judge(self, worker: Worker, function: Function) -> Verdict:
        """Run the tests of a function until one fails that the wrong values have reached."""
        began, source = time.monotonic(), (self.tree / function.file).read_text(encoding="utf-8")
        worker.log.write_text("", encoding="utf-8")
        before = worker.write({function.file: mutated_text(source, [function], str(worker.log))})
        try:
            run, notes = self._tested(worker, function)
        finally:
            worker.restore(before)
        killed = "killed" if run.result != "passed" else "survived"
        result = killed if "changed" in notes else "unchanged" if notes else "not executed"
        return Verdict(function, result, run.test, f"{run.result}: {run.what}", round(time.monotonic() - began, 1))

    def _tested(self, worker: Worker, function: Function) -> tuple[Run, set[str]]:
        run, notes = Run("passed"), set[str]()
        for _ in range(5):
            ranked = [test for test in self.executions.ranked(function, self.tree) if test[0] not in self.broken]
            for tests in parts(ranked, self.budget):
                run = worker.run(tests, self.budget, self.budget + SPARE)
                notes |= {*worker.log.read_text(encoding="utf-8").split()}
                if run.result != "passed":
                    break
            if run.result == "passed" or "changed" in notes:
                break
            self.broken.add(run.test)
        return run, notes

    def _doubtful(self, worker: Worker, listed: Sequence[Function]) -> list[Function]:
        """Return the functions that were killed by a test that fails with unchanged values too."""
        verdicts = [v for v in read_verdicts(self.raw) if v.mutant in listed and v.result == "killed"]
        texts = {}
        for name in {v.mutant.file for v in verdicts}:
            source = (self.tree / name).read_text(encoding="utf-8")
            texts[name] = mutated_text(source, [v.mutant for v in verdicts if v.mutant.file == name], control=True)
        before = worker.write(texts)
        try:
            waiting = sorted({v.test for v in verdicts if v.test} - self.broken)
            found = set[str]()
            while waiting:
                run = worker.run(waiting, 0.0, 3600.0, stop=False)
                found |= {*run.failed}
                died = run.result in ("endless", "stopped")
                if died and run.test not in waiting:
                    raise RuntimeError(f"pytest does not run with unchanged values: {run.what}")
                waiting = waiting[waiting.index(run.test) + 1 :] if died else []
        finally:
            worker.restore(before)
        self.broken |= found
        print(f"{len(verdicts)} killed; without a wrong value too fail: {', '.join(sorted(found)) or 'no tests'}")
        return [v.mutant for v in verdicts if v.test in found]


def parts(ranked: Sequence[tuple[str, float]], budget: float) -> Iterator[list[str]]:
    """Yield tests for one process after another, up to a time in all; those of one module follow each other."""
    spent, part, modules = 0.0, list[str](), set[str]()
    for test, seconds in ranked:
        module = test.partition("::")[0]
        cost = seconds + IMPORT * (module not in modules)
        if spent <= FIRST < spent + cost and part:
            yield by_module(part)
            part, modules = [], set()
        spent += cost
        if spent > budget and part:
            break
        part.append(test)
        modules.add(module)
    if part:
        yield by_module(part)


def by_module(tests: Sequence[str]) -> list[str]:
    """Return tests grouped by module, in the order of the first of each."""
    modules = {test.partition("::")[0]: i for i, test in reversed([*enumerate(tests)])}
    return sorted(tests, key=lambda test: modules[test.partition("::")[0]])


def read_verdicts(raw: Path) -> list[Verdict]:
    """Read verdicts, of each function the last one."""
    lines = raw.read_text(encoding="utf-8").splitlines() if raw.exists() else []
    found = [Verdict(Function(**x.pop("mutant")), **x) for x in map(json.loads, lines)]
    return sorted({v.mutant.key: v for v in found}.values(), key=lambda v: v.mutant)


def record(tree: Path, processes: int, tests: Sequence[str]) -> Executions:
    """Run the tests of a checkout without compiled kernels, and return which test executes what."""
    with tempfile.TemporaryDirectory() as folder:
        worker = Worker(tree, Path(folder))
        settings, given = worker.folder / "coveragerc", worker.folder / "run.json"
        settings.write_text(
            f"[run]\nsource_pkgs = eomgen\nparallel = true\nconcurrency = thread\ndata_file = {folder}/.coverage\n"
            "context = ${PYTEST_CURRENT_TEST-}\n",  # of processes that a test starts
            encoding="ascii",
        )
        start = next((worker.tree / ".venv" / "lib").glob("*/site-packages")) / "recorded.pth"
        start.write_text("import coverage; coverage.process_startup()\n", encoding="ascii")
        given.write_text(json.dumps({"tests": [], "budget": 0, "log": ""}), encoding="ascii")
        env = worker.environment(COVERAGE_PROCESS_START=str(settings), MUTATION_RUN=str(given))
        times = worker.folder / "junit.xml"
        command = [str(worker.python), "-m", "pytest", "-n", str(processes), "-p", "mutation_plugin"]
        subprocess.run([*command, f"--junitxml={times}", *tests], cwd=worker.tree, env=env)
        subprocess.run([str(worker.python), "-m", "coverage", "combine", "-q"], cwd=folder, check=True)
        if not (tree / CACHE).exists():
            (worker.tree / CACHE).rename(tree / CACHE)
        return read_coverage(worker.folder / ".coverage", times, worker.tree)
