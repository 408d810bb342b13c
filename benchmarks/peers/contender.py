"""One way of computing a kernel's result, behind a kernel's arguments, and how to build the C or C++ of a peer."""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cffi
import numpy as np
from numpy.typing import NDArray

from eomgen.codegen.package.compile import processor
from eomgen.pipeline import cache

Array = NDArray[np.float64]

FFI = cffi.FFI()


class MissingPeer(Exception):
    """A peer cannot be had on this machine; the text says why."""


@dataclass(frozen=True)
class Contender:
    """A function with a kernel's arguments, by address: see ``eomgen.bench.clock.Timed``.

    label: who computes.  h: its first argument.  batch: one call takes all states.  keeps_result: it has a place of
    an array for the result, and is timed with a null ``out`` so that no copy is timed.  kept: what must stay alive.
    """

    label: str
    code: int
    h: int
    batch: bool = False
    keeps_result: bool = False
    kept: Any = field(default=None, repr=False)

    def results(self, arrays: Sequence[Array], size: int) -> Array:
        """Return its results in all states, (states, size)."""
        out = np.zeros((len(arrays[0]), size))
        if self.batch:
            kind = f"long long (*)(size_t, const double *{', const double *, size_t' * len(arrays)}, double *)"
            steps = [x for array in arrays for x in (_pointer(array), array.shape[1])]
            failed = FFI.cast(kind, self.code)(len(out), FFI.cast("double *", self.h), *steps, _pointer(out)) >= 0
            if failed:
                raise ArithmeticError(f"{self.label} fails in a state")
            return out
        function = FFI.cast(f"int (*)(const double *{', const double *' * len(arrays)}, double *)", self.code)
        for state, row in enumerate(out):
            if function(FFI.cast("double *", self.h), *(_pointer(array[state]) for array in arrays), _pointer(row)):
                raise ArithmeticError(f"{self.label} fails in state {state}")
        return out


def _pointer(array: Array) -> Any:
    return FFI.cast("double *", array.ctypes.data)


def address(ffi: Any, pointer: Any) -> int:
    """Return a cffi pointer as a number."""
    return int(ffi.cast("intptr_t", pointer))


def build_library(
    name: str,
    compiler: str,
    parts: Sequence[Sequence[str]],
    link: Sequence[str],
    sources: Mapping[str, str],
    depends: Sequence[str] = (),
    *,
    program: bool = False,
) -> Path:
    """Return a shared library, or a program, compiled once and then from the cache.

    Args:
        name: of the library.
        compiler: the command.
        parts: per object file its flags and its source's name; they are compiled side by side.
        link: flags of the linker.
        sources: file name -> text.
        depends: what else it depends on: versions of headers.
        program: make a program.

    Raises:
        MissingPeer: the compiler is missing or fails.
    """
    command = shlex.split(compiler)
    if shutil.which(command[0]) is None:
        raise MissingPeer(f"there is no compiler {command[0]}")
    version = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True).stdout
    digest = hashlib.sha256()
    for text in (name, version, processor(), repr(parts), repr(link), *sources.values(), *depends):
        digest.update(f"{len(text)}:{text}".encode())

    target = name if program else f"lib{name}.so"

    def make(folder: Path) -> None:
        for file, text in sources.items():
            (folder / file).write_text(text, encoding="ascii")
        objects = [folder / f"part{i}.o" for i in range(len(parts))]
        jobs = [
            [*command, "-fPIC", *flags[:-1], "-c", str(folder / flags[-1]), "-o", str(made)]
            for flags, made in zip(parts, objects, strict=True)
        ]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(_run, jobs))
        _run([*command, *(() if program else ("-shared",)), *map(str, objects), *link, "-o", str(folder / target)])
        for made in objects:
            made.unlink()

    return cache.entry("peers", digest.hexdigest(), make).folder / target


def _run(command: Sequence[str]) -> None:
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    if said.returncode != 0:
        first = next((line for line in said.stderr.splitlines() if "error" in line), said.stderr[:200])
        raise MissingPeer(f"{Path(command[0]).name} fails: {first.split('error: ')[-1]}")
