"""Arrays that lie on a device of the stub, which is the processor's memory, and the stub itself."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from eomgen.device.dlpack import CUDA, make_capsule
from eomgen.kernel.complete import Kernel

HERE = Path(__file__).parent / "stub"
FLAGS = ("-D_GNU_SOURCE", "-O1", "-fPIC", "-shared")
COUNT, TILE = 37, 32  # states: a whole tile and a part of one


def states(kernel: Kernel, number: int = 3, count: int = COUNT, scale: float = 0.3) -> list[np.ndarray]:
    """Return random arrays of states."""
    rng = np.random.default_rng(0)
    return [rng.uniform(-scale, scale, (count, kernel.n)).astype(kernel.dtype) for _ in range(number)]


def in_tiles(x: np.ndarray) -> np.ndarray:
    """Return whole tiles of states."""
    return np.ascontiguousarray(np.moveaxis(x.reshape(-1, TILE, *x.shape[1:]), 1, -1))


def compiled(folder: Path) -> tuple[Path, Path]:
    """Compile the stubs of the driver and of NVRTC, and return their paths."""
    made = []
    for name in ("driver", "nvrtc"):
        made.append(folder / f"{name}.so")
        subprocess.run(["gcc", *FLAGS, str(HERE / f"{name}.c"), "-o", str(made[-1]), "-ldl"], check=True)
    return made[0], made[1]


class Stub:
    """What the stub of the driver counts, and what it is told."""

    def __init__(self, driver: Path, compiler: Path) -> None:
        self.library, self.compiler = ctypes.CDLL(str(driver)), ctypes.CDLL(str(compiler))
        self.library.stub_count.restype = ctypes.c_long

    def count(self, what: str) -> int:
        """Return how many of something are alive, or happened: "memory", "events", "modules", "waits", "launches"."""
        return int(self.library.stub_count(what.encode()))

    def put_elsewhere(self, array: np.ndarray) -> None:
        """Let an array's address be one of device 1."""
        self.library.stub_elsewhere(ctypes.c_void_p(array.ctypes.data))


class Lying:
    """An array of a library with the CUDA array interface."""

    def __init__(self, x: np.ndarray, *, readonly: bool = False, stream: Any = None) -> None:
        self.x, self.readonly, self.stream = x, readonly, stream

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        """Say where it lies."""
        x = self.x
        strides = None if x.flags.c_contiguous else x.strides
        said = {"shape": x.shape, "typestr": x.dtype.str, "data": (x.ctypes.data, self.readonly), "strides": strides}
        return {**said, "version": 3, "stream": self.stream}


class Lent:
    """An array of a library with DLPack alone."""

    def __init__(self, x: np.ndarray, device: tuple[int, int] = (CUDA, 0)) -> None:
        self.x, self.device, self.streams = x, device, list[Any]()

    def __dlpack__(self, stream: Any = None) -> Any:
        """Return a capsule."""
        self.streams.append(stream)
        return make_capsule(self, self.x.ctypes.data, self.x.shape, self.x.dtype, self.device)

    def __dlpack_device__(self) -> tuple[int, int]:
        """Return where it lies."""
        return self.device
