"""Feed-forwards that eomgen wrote as C, compiled with all warnings as errors and called from Python."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cffi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from eomgen.control.feedforward_source import feedforward_files
from eomgen.robot.value import Robot
from tests.support.observer_code import WARNINGS


class CompiledFeedForward:
    """A feed-forward in C: the functions of its header on a struct of its own."""

    def __init__(self, robot: Robot, folder: Path, compiler: Sequence[str] = ("cc",), **given: Any) -> None:
        """Write, compile and load it; ``folder`` has to be new, as libraries are known by their paths."""
        files = feedforward_files(robot, **given)
        for place, text in files.items():
            (folder / place).parent.mkdir(parents=True, exist_ok=True)
            (folder / place).write_text(text, encoding="ascii")
        codes = [place for place in files if place.endswith(".c") and "/" not in place]
        words = [*compiler, *WARNINGS, "-O0", "-ffp-contract=off", "-shared", "-fPIC", *codes]
        made = subprocess.run(
            [*words, "-o", "feedforward.so", "-lm"], cwd=folder, capture_output=True, text=True, check=False
        )
        assert made.returncode == 0, made.stderr
        self.name, header = robot.name, files[f"{robot.name}_feedforward.h"]
        self.dtype = np.dtype(given.get("dtype", "float64"))
        self.n, self.rows, self.drives = (
            int(re.findall(rf"_FEEDFORWARD_{what} (\d+)", header)[0]) for what in ("COORDINATES", "SERIES", "DRIVES")
        )
        self.ffi = cffi.FFI()
        self.ffi.cdef(_declared(header, "\n".join(files.values())))
        self._library: Any = self.ffi.dlopen(str(folder / "feedforward.so"))
        self.struct: Any = self.ffi.new(f"{robot.name}_feedforward *")
        self.setup()

    def setup(self) -> None:
        """Take the parameters that were written; the next step begins a motion."""
        getattr(self._library, f"{self.name}_feedforward_setup")(self.struct)

    def step(self, series: ArrayLike) -> tuple[int, NDArray[Any]]:
        """Return the status, and positions, velocities and forces of drives, (3, m), at series, (rows, n)."""
        rows, out = np.ascontiguousarray(series, self.dtype), np.zeros((3, self.drives), self.dtype)
        assert rows.shape == (self.rows, self.n)
        real = "float *" if self.dtype == np.float32 else "double *"
        series_c, *out_c = (self.ffi.cast(real, x.ctypes.data) for x in (rows, *out))
        return int(getattr(self._library, f"{self.name}_feedforward_step")(self.struct, series_c, *out_c)), out

    def run(self, series: NDArray[np.float64]) -> NDArray[Any]:
        """Return positions, velocities, forces of drives, (3, T, m), from a beginning on, at series (>= rows, T, n)."""
        self.setup()
        found = [self.step(series[: self.rows, k]) for k in range(series.shape[1])]
        assert not any(status for status, _ in found)
        return np.stack([out for _, out in found], axis=1)


def _declared(header: str, texts: str) -> str:
    """Return a header's declarations without preprocessor and comments, with the sizes that others define."""
    text = re.sub(r"/\*.*?\*/", "", header, flags=re.S)
    for name, size in re.findall(r"#define (\w+_HOISTED) (\d+)", texts):
        text = text.replace(name, size)
    return text[text.index("typedef struct") : text.rindex(");") + 2]
