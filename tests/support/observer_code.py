"""Filters that eomgen wrote as C, compiled with all warnings as errors and called from Python."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cffi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from eomgen.control import MomentumObserver, Observer
from eomgen.control.observer_source import observer_files
from eomgen.pipeline import Options, make_source
from tests.support.controllers import compiled

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror")


class CompiledObserver:
    """A filter in C: the functions of its header on a struct of its own."""

    def __init__(self, observer: Observer, folder: Path, compiler: Sequence[str] = ("cc",), *flags: str) -> None:
        """Write, compile and load it; ``folder`` has to be new, as libraries are known by their paths."""
        self.model, self.name = observer.filter, observer.filter.model.name
        for file, text in observer_files(observer).items():
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / file).write_text(text, encoding="ascii")
        stems = [self.name, *(f"{self.name}_{x}" for x in ("innovation", "observer"))]
        stems = [stem for stem in stems if (folder / f"{stem}.c").exists()]
        for stem in stems:
            words = [*compiler, *WARNINGS, "-O0", *flags, "-fPIC", "-c", f"{stem}.c"]
            made = subprocess.run([*words, "-o", f"{stem}.o"], cwd=folder, capture_output=True, text=True, check=False)
            assert made.returncode == 0, made.stderr
        objects = [f"{stem}.o" for stem in stems]
        subprocess.run([*compiler, *flags, "-shared", *objects, "-o", "observer.so", "-lm"], cwd=folder, check=True)
        self.ffi, header = cffi.FFI(), (folder / f"{self.name}_observer.h").read_text(encoding="ascii")
        self.ffi.cdef(self._declared(header, (folder / f"{self.name}.h").read_text(encoding="ascii")))
        self._library: Any = self.ffi.dlopen(str(folder / "observer.so"))
        self.struct: Any = self.ffi.new(f"{self.name}_observer *")

    def _declared(self, header: str, robot: str) -> str:
        """Return the header's declarations without preprocessor and comments."""
        hoisted = re.search(r"_HOISTED (\d+)", robot)
        text = re.sub(r"/\*.*?\*/", "", header, flags=re.S).replace(f"{self.name.upper()}_HOISTED", hoisted[1])
        begin, end = text.index("typedef struct"), text.rindex(");") + 2
        return re.sub(r"\[([^\]]*)\]", lambda found: f"[{found[1]}]", text[begin:end])

    def _numbers(self, values: ArrayLike) -> Any:
        real = "float[]" if self.model.dtype == "float32" else "double[]"
        return self.ffi.new(real, [float(x) for x in np.ravel(values)])

    def setup(self, q: ArrayLike, v: ArrayLike) -> None:
        """Begin at q and v."""
        getattr(self._library, f"{self.name}_observer_setup")(self.struct, self._numbers(q), self._numbers(v))

    def predict(self, u: ArrayLike) -> int:
        """Go on by a step: its status."""
        return int(getattr(self._library, f"{self.name}_observer_predict")(self.struct, self._numbers(u)))

    def update(self, y: ArrayLike) -> float:
        """Take measurements: the sum of squares of normalized innovations."""
        return float(getattr(self._library, f"{self.name}_observer_update")(self.struct, self._numbers(y)))

    @property
    def covariance(self) -> NDArray[np.float64]:
        """The covariance, (N, N), which is symmetric to the bit, or whose root is a triangle."""
        N, is_root = len(self.model.states), self.model.form == "square_root"
        kept = np.array(list(self.struct.root if is_root else self.struct.covariance)).reshape(N, N)
        assert not np.tril(kept, -1).any() if is_root else np.array_equal(kept, kept.T)
        return kept.T @ kept if is_root else kept

    @property
    def state(self) -> NDArray[np.float64]:
        """The state in the order of the model's."""
        rest: list[float] = []
        for link in self.model.links:
            at = 6 * self.model.model.links.index(link)
            rest += list(self.struct.wrench)[at : at + 6]
        names = list(self.model.model.parameters)
        rest += [self.struct.parameters[names.index(name)] for name in self.model.parameters]
        rest += list(self.struct.bias) if self.model.biases else []
        return np.array([*self.struct.q, *self.struct.v, *rest])


class CompiledMomentumObserver:
    """A momentum observer in C, at the described parameters, with a struct of its own."""

    def __init__(self, observer: MomentumObserver, folder: Path) -> None:
        """Write, compile and load it; ``folder`` has to be new."""
        self.name, self.dtype = observer.robot.name, observer.dtype
        options = Options(observer.kernels_in_c, str(self.dtype), batches=False)
        sources = observer.sources()
        library = compiled({**make_source(observer.robot, options).files, **sources}, folder)
        own, real = f"{self.name}_momentum_observer", "float" if self.dtype == np.float32 else "double"
        text = re.sub(r"/\*.*?\*/", "", sources[f"{own}.h"], flags=re.S)
        self.ffi, self._own = cffi.FFI(), own
        self.ffi.cdef(f"void {self.name}_setup(const {real} *p, {real} *h);")
        self.ffi.cdef(text[text.index("typedef struct") : text.rindex(");") + 2])
        self._library: Any = self.ffi.dlopen(str(library))
        self.struct: Any = self.ffi.new(f"{own} *")
        self._real, self._hoisted = f"{real}[]", np.zeros(4096, self.dtype)
        parameters = np.array([*observer.kernel.parameters.values()], self.dtype)
        getattr(self._library, f"{self.name}_setup")(self._at(parameters), self._at(self._hoisted))

    def _at(self, values: ArrayLike) -> Any:
        return self.ffi.from_buffer(self._real, np.ascontiguousarray(values, self.dtype))

    def start(self, q: ArrayLike, v: ArrayLike) -> int:
        """Begin at q and v: 0, or why not."""
        arrays = [self._at(x) for x in (self._hoisted, q, v)]
        return int(getattr(self._library, f"{self._own}_start")(*arrays, self.struct))

    def step(self, q: ArrayLike, v: ArrayLike, u: ArrayLike) -> int:
        """Take a sample: 0, or which coordinate is beyond its threshold."""
        arrays = [self._at(x) for x in (self._hoisted, q, v, u)]
        return int(getattr(self._library, f"{self._own}_step")(*arrays, self.struct))

    @property
    def external(self) -> NDArray[Any]:
        """The forces found."""
        return np.frombuffer(self.ffi.buffer(self.struct.external), self.dtype)
