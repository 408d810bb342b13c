"""Builds that take a moment, in this process and in others."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import eomgen
from eomgen.pipeline.cache import Entry
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import describe, make_package, tools_for
from eomgen.runtime.levels import BASE

Q = [0.2, 0.5]
QUICK = Options(("mass_matrix",), flags=("-O0",))
ONE_LEVEL = replace(QUICK, levels=(BASE,))  # of packages with one binary
BUILD = """
    import eomgen
    kernel = eomgen.build(eomgen.load_robot("one_link"), kernels=("mass_matrix",), flags=("-O0",))
    print(kernel.mass_matrix([0.2, 0.5]).tolist())
"""


def python(code: str, **variables: str) -> subprocess.Popen[str]:
    """A fresh interpreter; its output is read by the caller."""
    environment = {**os.environ, **variables}
    command = [sys.executable, "-c", textwrap.dedent(code)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def answer(process: subprocess.Popen[str]) -> Any:
    out, said = process.communicate()
    assert process.returncode == 0, said
    return json.loads(out)


def one_link(progress: Any = None, options: Options = QUICK) -> eomgen.Kernel:
    robot = eomgen.load_robot("one_link")
    steps = [] if progress is None else progress
    return eomgen.build(
        robot,
        kernels=options.kernels,
        dtype=options.dtype,
        native=options.native,
        flags=options.flags,
        progress=steps.append,
    )


def package_of(robot: eomgen.Robot, options: Options) -> Entry:
    """The compiled package in the cache, of the level that is the best here."""
    return make_package(describe(robot, options), tools_for(options))


def script(path: Path, text: str) -> str:
    path.write_text(f"#!/bin/sh\n{text}\n", encoding="ascii")
    path.chmod(0o755)
    return str(path)


def logging_compiler(folder: Path) -> tuple[str, Path]:
    """A compiler that writes down every call but those for its version."""
    log = folder / "calls"
    log.touch()
    real = shutil.which("cc") or shutil.which("gcc") or "cc"
    text = f'case "$*" in *--version*) ;; *) echo "$*" >> {log} ;; esac\nexec {real} "$@"'
    return script(folder / "logging-cc", text), log


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    exchange(path, bytes(content))


def truncate(path: Path) -> None:
    exchange(path, path.read_bytes()[:-7])


def exchange(path: Path, content: bytes) -> None:
    """Another file under the same name: writing into a library that this process has mapped may kill it."""
    new = path.with_name("new")
    new.write_bytes(content)
    new.replace(path)


def without_headers(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine whose Python has no headers."""
    own = sysconfig.get_path
    monkeypatch.setattr(
        sysconfig, "get_path", lambda name, *rest: "/nowhere" if name == "include" else own(name, *rest)
    )


def as_new_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget the modules that are loaded, so that the next build reads the cache."""
    for name in [name for name in sys.modules if name.startswith("_eomgen_")]:
        monkeypatch.delitem(sys.modules, name)
