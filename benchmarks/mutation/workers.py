"""Copies of a checkout with an environment of their own, in which tests run on mutated files."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
FOLDERS = {"eomgen": "src/eomgen", "eomgen.codegen": "codegen", "eomgen.templates": "templates"}
CACHE = Path(".pytest_cache", "eomgen")
UNFINISHED = ("making-", "damaged-")
MEMORY = 8 << 30  # bytes that a process may write to


@dataclass(frozen=True)
class Run:
    """What tests said: ``result`` is "passed", "failed", "endless" or "stopped"; the test that failed and its words."""

    result: str
    test: str = ""
    what: str = ""
    ran: tuple[str, ...] = ()
    failed: tuple[str, ...] = ()


class Worker:
    """A copy of a checkout's files in a folder, whose Python imports eomgen from this copy."""

    def __init__(self, tree: Path, folder: Path) -> None:
        self.folder, self.tree, self.log = folder, folder / "tree", folder / "changes"
        self.marks = itertools.count(1)
        listed = subprocess.run(
            ["git", "ls-files", "-zco", "--exclude-standard"], cwd=tree, capture_output=True, text=True, check=True
        )
        for name in filter(None, listed.stdout.split("\0")):
            if (tree / name).is_file() or (tree / name).is_symlink():
                (self.tree / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(tree / name, self.tree / name, follow_symlinks=False)
        subprocess.run("git init -q && git add -A", cwd=self.tree, shell=True, check=True)  # tests ask for its files
        self.warm = tree / CACHE
        self.python = self._environment()
        where = self._call("-c", "import eomgen.codegen; print(eomgen.codegen.__file__)").stdout.strip()
        if not Path(where).resolve().is_relative_to(self.tree.resolve()):
            raise RuntimeError(f"eomgen comes from {where}, not from {self.tree}")

    def _environment(self) -> Path:
        """Make an environment that has the packages of this one, and eomgen from the copy; return its Python."""
        old, new = Path(sys.prefix), self.tree / ".venv"
        site = Path("lib", f"python{sys.version_info[0]}.{sys.version_info[1]}", "site-packages")
        (new / site).mkdir(parents=True)
        (new / "bin").mkdir()
        shutil.copy2(old / "pyvenv.cfg", new)
        for path in (old / site).iterdir():
            if path.name.startswith("__editable__") and path.suffix == ".py":
                mapping = {name: str(self.tree / inside) for name, inside in FOLDERS.items()}
                text = re.sub(r"^MAPPING.*$", f"MAPPING = {mapping}", path.read_text(encoding="utf-8"), flags=re.M)
                (new / site / path.name).write_text(text, encoding="utf-8")
            elif path.name != "__pycache__":
                (new / site / path.name).symlink_to(path)
        (new / site / "mutation_plugin.py").write_text((HERE / "plugin.py").read_text(encoding="ascii"))
        for path in (old / "bin").iterdir():
            if path.is_symlink() or not path.is_file() or not path.read_bytes().startswith(b"#!"):
                (new / "bin" / path.name).symlink_to(path.resolve() if path.is_symlink() else path)
            else:
                text = path.read_bytes().replace(str(old / "bin" / "python").encode(), str(new / "bin/python").encode())
                (new / "bin" / path.name).write_bytes(text)
                (new / "bin" / path.name).chmod(0o755)
        for path in old.iterdir():
            if not (new / path.name).exists():
                (new / path.name).symlink_to(path)
        return new / "bin" / "python"

    def environment(self, **more: str) -> dict[str, str]:
        """Return variables for processes of this worker: no folder of the user's, no coverage of another run."""
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "COV", "PYTEST"))}
        for name in ("home", "tmp"):
            (self.folder / name).mkdir(exist_ok=True)
        return {**kept, "HOME": str(self.folder / "home"), "TMPDIR": str(self.folder / "tmp"), **more}

    def _call(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [self.python, *arguments], cwd=self.tree, env=self.environment(), capture_output=True, text=True, check=True
        )

    def write(self, texts: Mapping[str, str]) -> dict[str, tuple[str, int]]:
        """Change files, each with a time that no bytecode has; return what undoes it."""
        before = {}
        for name, text in texts.items():
            path = self.tree / name
            before[name] = path.read_text(encoding="utf-8"), path.stat().st_mtime_ns
            path.write_text(text, encoding="utf-8")
            os.utime(path, (time.time(), 1_000_000_000 + next(self.marks)))
        return before

    def restore(self, before: Mapping[str, tuple[str, int]]) -> None:
        """Undo a change of files."""
        for name, (text, modified) in before.items():
            (self.tree / name).write_text(text, encoding="utf-8")
            os.utime(self.tree / name, ns=(modified, modified))

    def run(self, tests: Sequence[str], budget: float, limit: float, stop: bool = True) -> Run:
        """Run tests in this order with a private copy of the compiled kernels.

        Args:
            tests: identifiers; those of one module follow each other.
            budget: processor time in s after which no other test begins, 0 if there is none.
            limit: processor time in s of one process, after which a test is endless.
            stop: whether the first failure ends the run.
        """
        given, log = self.folder / "run.json", self.folder / "outcomes"
        given.write_text(json.dumps({"tests": [*tests], "budget": budget, "log": str(log)}), encoding="utf-8")
        log.write_text("", encoding="utf-8")
        if self.warm.exists():
            renew(self.warm, self.tree / CACHE)
        else:
            shutil.rmtree(self.tree / CACHE, ignore_errors=True)
        files = [file for file in dict.fromkeys(t.partition("::")[0] for t in tests) if (self.tree / file).exists()]
        if not files:
            return Run("passed")
        command = [str(self.python), "-m", "pytest", "-q", "-p", "mutation_plugin", "-p", "no:cacheprovider", "-n0"]
        process = subprocess.Popen(
            [*command, "--tb=line", *(["-x"] if stop else []), *files],
            cwd=self.tree,
            env=self.environment(MUTATION_RUN=str(given)),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            preexec_fn=lambda: _limit(limit),
        )
        try:
            output = process.communicate(timeout=10 * limit)[0].decode(errors="replace")
        except subprocess.TimeoutExpired:
            output = "waits for ever"
        finally:
            _end(process)
            shutil.rmtree(self.folder / "tmp", ignore_errors=True)
        entries = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
        ran = tuple(dict.fromkeys(e["test"] for e in entries if e["outcome"] in ("passed", "failed")))
        failed = {e["test"]: e["what"] for e in entries if e["outcome"] == "failed"}
        begun = [e["test"] for e in entries if e["outcome"] == "started"]
        if failed:
            test = next(iter(failed))
            return Run("failed", test, failed[test], ran, tuple(failed))
        if process.returncode in (0, 5):
            return Run("passed", ran=ran)
        if process.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
            return Run("endless", begun[-1] if begun else "", output[-300:], ran, tuple(begun[-1:]))
        if process.returncode == 2 and budget:  # shouldstop
            return Run("passed", ran=ran)
        return Run("stopped", begun[-1] if begun else "", output[-600:], ran, tuple(begun[-1:]))


def renew(source: Path, target: Path) -> None:
    """Make a folder equal to another again: its files are links to those of the other, and changed ones are replaced.

    A tenth of the time of a new copy: what is a link to the same file as before stays.
    """
    target.mkdir(parents=True, exist_ok=True)
    wanted = {x.name: x for x in os.scandir(source) if not x.name.startswith(UNFINISHED)}
    kept = set[str]()
    for entry in [*os.scandir(target)]:
        original = wanted.get(entry.name)
        is_folder = entry.is_dir(follow_symlinks=False)
        if original is not None and (
            original.is_dir(follow_symlinks=False) if is_folder else original.inode() == entry.inode()
        ):
            kept.add(entry.name)
        elif is_folder:
            shutil.rmtree(entry.path)
        else:
            os.unlink(entry.path)
    for name, original in wanted.items():
        if original.is_dir(follow_symlinks=False):
            renew(source / name, target / name)
        elif name not in kept:
            os.link(original.path, target / name, follow_symlinks=False)


def _limit(seconds: float) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 5))
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))


def _end(process: subprocess.Popen[bytes]) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)  # what tests left running too
    process.wait()
