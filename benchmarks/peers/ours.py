"""This project's kernels, one state and many, and the textbook's algorithms, compiled with the same flags."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import eomgen
from eomgen.codegen.compile import FLAGS, NATIVE
from eomgen.model import build_model
from eomgen.pipeline import KERNEL_NAMES
from eomgen.robot import Robot
from eomgen.yardstick import Yardstick, compile_yardstick

from .contender import Contender, MissingPeer, address
from .measure import READS

NAME, BATCH, TEXTBOOK = "eomgen", "eomgen, batch", "textbook"
USED = (*FLAGS, *NATIVE)
# Kernels that this file knows by a name of its own: the first that the generator knows is measured.
DERIVATIVES = ("inverse_dynamics_derivatives", "residual_jacobian")
STEP = ("implicit_step",)  # (h, q, v, u, out): one linearly implicit step of mujoco_peer.TIME_STEP
ALIASES = {"derivatives": DERIVATIVES, "step": STEP}


def kernel_name(kernel: str) -> str:
    """The generator's name of a kernel.

    Raises:
        MissingPeer: it has none.
    """
    names = ALIASES.get(kernel, (kernel,))
    for name in names:
        if name in KERNEL_NAMES:
            return name
    raise MissingPeer(f"not built: the generator has no kernel {names[0]}")


class Ours:
    """A robot's kernels, compiled for this machine."""

    def __init__(self, robot: Robot, kernels: Sequence[str], progress: Callable[[str], None]) -> None:
        names = [kernel_name(kernel) for kernel in kernels]
        self.kernel = eomgen.build(robot, kernels=names, native=True, progress=progress)

    def contender(self, kernel: str, *, batch: bool = False) -> Contender:
        """A kernel for one state, or for all states in one call."""
        ffi, lib, name = self.kernel._ffi, self.kernel._lib, kernel_name(kernel)
        reads = self.kernel._functions[name][1]
        if reads != READS[kernel]:  # a call would be undefined
            raise MissingPeer(f"not measured: {name} reads {', '.join(reads)}, not {', '.join(READS[kernel])}")
        code = ffi.addressof(lib, f"{self.kernel.name}_{name}{'_batch' if batch else ''}")
        h = address(ffi, self.kernel.parameters._setup.pointer)
        return Contender(BATCH if batch else NAME, address(ffi, code), h, batch=batch, kept=self)


class Textbook:
    """Recursive Newton-Euler, composite bodies, articulated bodies: loops over a table of links."""

    def __init__(self, robot: Robot) -> None:
        self.yardstick: Yardstick = compile_yardstick(build_model(robot), USED)

    def contender(self, kernel: str) -> Contender:
        """The textbook's algorithm for a kernel."""
        return Contender(TEXTBOOK, self.yardstick.address(kernel), 0, kept=self)
