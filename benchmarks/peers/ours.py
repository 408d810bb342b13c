"""This project's kernels, one state and many, and the textbook's algorithms, compiled with the same flags."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import eomgen
from eomgen.bench.textbook import Yardstick, compile_yardstick
from eomgen.codegen.package.compile import FLAGS, NATIVE
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot

from .contender import FFI, Contender, MissingPeer, address, build_library

NAME, BATCH, TEXTBOOK = "eomgen", "eomgen, batch", "textbook"
USED = (*FLAGS, *NATIVE)
NAMES = {"derivatives": "residual_jacobian", "step": "rollout"}  # of kernels that are called otherwise here
STEP = Path(__file__).with_name("ours_step.c")
LARGEST = 64  # coordinates that its arrays hold
FFI.cdef("typedef struct { void *rollout; const double *h; double dt; size_t n; } OurStep; void ours_step(void);")


class Ours:
    """A robot's kernels, compiled for this machine."""

    def __init__(self, robot: Robot, kernels: Sequence[str], progress: Callable[[str], None]) -> None:
        names = [NAMES.get(kernel, kernel) for kernel in kernels]
        self.kernel = eomgen.build(robot, kernels=names, native=True, progress=progress)

    def contender(self, kernel: str, *, batch: bool = False) -> Contender:
        """A kernel for one state, or for all states in one call."""
        ffi, lib, name = self.kernel._ffi, self.kernel._lib, NAMES.get(kernel, kernel)
        code = ffi.addressof(lib, f"{self.kernel.name}_{name}{'_batch' if batch else ''}")
        h = address(ffi, self.kernel.parameters._setup.pointer)
        return Contender(BATCH if batch else NAME, address(ffi, code), h, batch=batch, kept=self)

    def step(self, dt: float) -> Contender:
        """One linearly implicit step of so many seconds, q and v after it.

        Raises:
            MissingPeer: the robot is too large.
        """
        kernel = self.kernel
        if kernel.n > LARGEST:
            raise MissingPeer(f"{kernel.n} coordinates; at most {LARGEST} are timed")
        text = STEP.read_text(encoding="ascii")
        path = build_library("ours_step", "cc", [("-std=c99", "-O2", STEP.name)], (), {STEP.name: text})
        library = FFI.dlopen(str(path))
        rollout = address(kernel._ffi, kernel._ffi.addressof(kernel._lib, f"{kernel.name}_rollout"))
        h = address(kernel._ffi, kernel.parameters._setup.pointer)
        given = FFI.new("OurStep *", (FFI.cast("void *", rollout), FFI.cast("double *", h), dt, kernel.n))
        code = address(FFI, FFI.addressof(library, "ours_step"))
        return Contender(NAME, code, address(FFI, given), kept=(self, library, given))


class Textbook:
    """Recursive Newton-Euler, composite bodies, articulated bodies: loops over a table of links."""

    def __init__(self, robot: Robot) -> None:
        self.yardstick: Yardstick = compile_yardstick(build_model(robot), USED)

    def contender(self, kernel: str) -> Contender:
        """The textbook's algorithm for a kernel."""
        return Contender(TEXTBOOK, self.yardstick.address(kernel), 0, kept=self)
