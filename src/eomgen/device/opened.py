"""Name of a device -> methods of a kernel on it."""

from __future__ import annotations

from typing import Any

from ..errors import InputError
from ..names import show
from ..robot.value import Robot
from ..runtime.kernel import Kernel
from .backends import Backend
from .face import Device

KINDS = ("cuda", "hip", "opencl")
ALLOWED = '"cuda", "hip" or "opencl", with a number such as "cuda:1", or a queue of pyopencl'


def open_device(robot: Robot, kernel: Kernel, where: Any, *, contract: bool = False) -> Device:
    """Return methods of a robot's kernel on a device.

    Args:
        robot: of the kernel.
        kernel: whose parameters, dtype and checks they have.
        where: "cuda", "hip" or "opencl", with the number of a device behind a colon; or a queue of pyopencl.
        contract: let products and sums be one operation: faster, with other last bits than on processors.

    Raises:
        InputError: there is no such device, no driver, or no compiler for it.
    """
    if not isinstance(contract, bool):
        raise InputError(f"contract: {show(contract)}; allowed: True or False")
    return Device(robot, kernel, _opened(where, contract, str(kernel.dtype)))


def _opened(where: Any, contract: bool, dtype: str) -> Backend:
    if not isinstance(where, str):
        if type(where).__module__.partition(".")[0] != "pyopencl":
            raise InputError(f"device: got {type(where).__name__}; allowed: {ALLOWED}")
        from .opencl import OpenCLBackend

        return OpenCLBackend(where, contract, dtype)
    kind, colon, number = where.partition(":")
    if kind not in KINDS or (colon and not (number.isascii() and number.isdigit() and len(number) < 9)):
        raise InputError(f"device: {show(where)}; allowed: {ALLOWED}")
    if kind == "opencl":
        from .opencl import OpenCLBackend

        return OpenCLBackend(int(number or 0), contract, dtype)
    from .gpu import GpuBackend

    return GpuBackend(kind, int(number or 0), contract)
