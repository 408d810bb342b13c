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
        function = self.kernel.raw.function(NAMES.get(kernel, kernel))
        code, setup = self.kernel.raw.address(function.name, batch=batch), self.kernel.parameters.setup
        address = setup.address(function.where(batch=batch))
        return Contender(BATCH if batch else NAME, code, address, batch=batch, kept=(self, setup))

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
        rollout, setup = kernel.raw.address("rollout"), kernel.parameters.setup
        h = setup.address(kernel.raw.function("rollout").library)
        given = FFI.new("OurStep *", (FFI.cast("void *", rollout), FFI.cast("double *", h), dt, kernel.n))
        code = address(FFI, FFI.addressof(library, "ours_step"))
        return Contender(NAME, code, address(FFI, given), kept=(self, setup, library, given))


class Textbook:
    """Recursive Newton-Euler, composite bodies, articulated bodies: loops over a table of links."""

    def __init__(self, robot: Robot) -> None:
        self.yardstick: Yardstick = compile_yardstick(build_model(robot), USED)

    def contender(self, kernel: str) -> Contender:
        """The textbook's algorithm for a kernel."""
        return Contender(TEXTBOOK, self.yardstick.address(kernel), 0, kept=self)
