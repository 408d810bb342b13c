"""This project's kernels, one state and many, and the textbook's algorithms, compiled with the same flags."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

import eomgen
from eomgen.bench.textbook import Yardstick, compile_yardstick
from eomgen.codegen.package.compile import FLAGS, NATIVE
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot

from .contender import FFI, Contender, MissingPeer, address, build_library

NAME, BATCH, TEXTBOOK = "eomgen", "eomgen, batch", "textbook"
USED = (*FLAGS, *NATIVE)
NAMES = {  # of kernels that are called otherwise here
    "derivatives": "residual_jacobian",
    "forward_derivatives": "forward_dynamics_jacobian",
    "second_derivatives": "inverse_dynamics_hessian",
    "step": "rollout",
}
STEP = Path(__file__).with_name("ours_step.c")
LARGEST = 64  # coordinates that its arrays hold
FFI.cdef(
    "typedef struct { void *rollout; const double *h; double dt; size_t n; void *batch; double *q_out, *v_out; }"
    " OurStep;"
    "void ours_step(void); void ours_step_batch(void);"
)


class Ours:
    """A robot's kernels, compiled for this machine."""

    def __init__(self, robot: Robot, kernels: Sequence[str], progress: Callable[[str], None]) -> None:
        names = [NAMES.get(kernel, kernel) for kernel in kernels]
        self.kernel = eomgen.build(robot, kernels=names, native=True, progress=progress)

    def contender(self, kernel: str, *, batch: bool = False) -> Contender:
        """Return a kernel for one state, or for all states in one call."""
        function = self.kernel.raw.function(NAMES.get(kernel, kernel))
        code, setup = self.kernel.raw.address(function.name, batch=batch), self.kernel.parameters.setup
        address = setup.address(function.where(batch=batch))
        return Contender(BATCH if batch else NAME, code, address, batch=batch, kept=(self, setup))

    def step(self, dt: float, states: int = 0) -> Contender:
        """Return ten linearly implicit steps of dt, s, q and v after them.

        With ``states`` those of so many in one call.

        Raises:
            MissingPeer: the robot is too large.
        """
        kernel = self.kernel
        if kernel.n > LARGEST:
            raise MissingPeer(f"{kernel.n} coordinates; at most {LARGEST} are timed")
        text = STEP.read_text(encoding="ascii")
        path = build_library("ours_step", "cc", [("-std=c99", "-O2", STEP.name)], (), {STEP.name: text})
        library = FFI.dlopen(str(path))
        batch = states > 0
        code, setup = kernel.raw.address("rollout", batch=batch), kernel.parameters.setup
        h = setup.address(kernel.raw.function("rollout").where(batch=batch))
        room = np.zeros((2, max(states, 1), 2, kernel.n))
        parts = [FFI.cast("double *", array.ctypes.data) for array in room]
        both = (FFI.NULL, FFI.cast("void *", code))[:: -1 if not batch else 1]
        arguments = FFI.new("OurStep *", (both[0], FFI.cast("double *", h), dt, kernel.n, both[1], *parts))
        called = address(FFI, FFI.addressof(library, "ours_step_batch" if batch else "ours_step"))
        kept = (self, setup, library, arguments, room)
        label = BATCH if batch else NAME
        return Contender(label, called, address(FFI, arguments), batch=batch, keeps_result=True, kept=kept)


class Textbook:
    """Recursive Newton-Euler, composite bodies, articulated bodies: loops over a table of links."""

    def __init__(self, robot: Robot) -> None:
        self.yardstick: Yardstick = compile_yardstick(build_model(robot), USED)

    def contender(self, kernel: str) -> Contender:
        """Return the textbook's algorithm for a kernel."""
        return Contender(TEXTBOOK, self.yardstick.address(kernel), 0, kept=self)
