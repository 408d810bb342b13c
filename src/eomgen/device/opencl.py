"""Devices of OpenCL by pyopencl: buffers, queues, programs and launches."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..codegen.simt.sources import CONTRACTION
from ..errors import ArrayError, BuildError, InputError
from ..optional import optional_import
from .backends import Launch
from .foreign import View

LANGUAGE, ROUNDED = "-cl-std=CL1.2", "-cl-fp32-correctly-rounded-divide-sqrt"
GROUP = 32  # threads in whole groups of so many
TRIED = 1 << 16  # numbers by which rounding is tried
PROBE = """
__kernel void probe(__global const float *x, __global const float *y, __global float *z)
{
    const size_t k = get_global_id(0);
    z[k] = x[k] / y[k];
    z[get_global_size(0) + k] = sqrt(x[k]);
}
"""
Array = NDArray[Any]


class OpenCLBackend:
    """A device of OpenCL as calls of kernels need it.

    Attributes:
        queue: that of all calls; arrays are of its context.
    """

    def __init__(self, where: Any, contract: bool, dtype: str) -> None:
        """Open a device by its number among those of all platforms, or that of a queue.

        Raises:
            NotInstalledError: pyopencl is not installed.
            InputError: no device of this number, a queue that is out of order, or arithmetic that is not IEEE's.
        """
        with optional_import("pyopencl", "devices of OpenCL need"):
            import pyopencl
            import pyopencl.array
        self.cl = pyopencl
        context = self._new_context(where) if isinstance(where, int) else None
        self.queue = pyopencl.CommandQueue(context) if context is not None else where
        if not isinstance(self.queue, pyopencl.CommandQueue):
            raise InputError(f"device: got {type(where).__name__} of pyopencl; allowed: a CommandQueue of it")
        if self.queue.properties & pyopencl.command_queue_properties.OUT_OF_ORDER_EXEC_MODE_ENABLE:
            raise InputError("device: a queue that is out of order; allowed: one in order")
        self.context = self.queue.context if context is None else context  # Intel's runtime asks for it to be held
        self.title = f"opencl, {self.queue.device.name.strip()}"
        self._options = [LANGUAGE, CONTRACTION["opencl"][contract], *self._rounding(contract, dtype)]

    def _new_context(self, number: int) -> Any:
        try:
            platforms = self.cl.get_platforms()
        except self.cl.Error:  # which says so where there is none
            platforms = []
        devices = [device for platform in platforms for device in _devices(self.cl, platform)]
        if number >= len(devices):
            names = [f'"opencl:{place}" ({device.name.strip()})' for place, device in enumerate(devices)]
            allowed = ", ".join(names) or "none, as no runtime of OpenCL has a device here"
            raise InputError(f'device: "opencl:{number}"; allowed: {allowed}')
        return self.cl.Context([devices[number]])

    def _rounding(self, contract: bool, dtype: str) -> list[str]:
        """Return options that keep IEEE's arithmetic; refuse devices that have none."""
        device, flags = self.queue.device, self.cl.device_fp_config
        if dtype == "float64":
            if not device.double_fp_config:
                raise InputError(f"device: {self.title} has no float64 (cl_khr_fp64); allowed: kernels of float32")
            return []
        config = device.single_fp_config
        if config & flags.DENORM and config & flags.CORRECTLY_ROUNDED_DIVIDE_SQRT:
            return [ROUNDED]
        if contract or (config & flags.DENORM and self._rounds()):
            return []
        raise InputError(
            f"device: divisions, roots or denormal numbers of float32 are not IEEE's on {self.title}; allowed:"
            " contract=True, which takes other last bits"
        )

    def _rounds(self) -> bool:
        """Try whether quotients and roots are rounded correctly on a device that does not say so."""
        kernel = self.cl.Kernel(self.cl.Program(self.context, PROBE).build([LANGUAGE]), "probe")
        x, y = np.random.default_rng(0).uniform(1e-3, 1e3, (2, TRIED)).astype(np.float32)
        read, result = [self.put(z, self.queue)[1] for z in (x, y)], self._buffer(2 * x.nbytes)
        kernel.set_args(*read, result)
        self.cl.enqueue_nd_range_kernel(self.queue, kernel, x.shape, None)
        found = self.read(result, 0, np.empty((2, TRIED), np.float32), self.queue)
        return bool(np.array_equal(found, [x / y, np.sqrt(x)]))

    @contextmanager
    def session(self, stream: Any, arrays: Sequence[Any]) -> Iterator[Any]:
        """Let a call's work go to the queue; one that is given has to be of the same context."""
        if stream is not None and (not isinstance(stream, self.cl.CommandQueue) or stream.context != self.context):
            raise InputError(f"stream: got {type(stream).__name__}; allowed: a queue of pyopencl in the same context")
        queue = self.queue if stream is None else stream
        if queue != self.queue:
            self.queue.finish()
        yield queue
        if queue != self.queue:
            queue.finish()

    def functions(self, code: str, dtype: np.dtype[Any]) -> Any:
        """Return the functions of a text, by their names.

        Raises:
            BuildError: the device's compiler refuses it.
        """
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", self.cl.CompilerWarning)  # which is of a compiler that says anything
                program = self.cl.Program(self.context, code).build(self._options)
        except self.cl.Error as error:
            raise BuildError(f"device: {self.title}: {error}") from None
        return {kernel.function_name: kernel for kernel in program.all_kernels()}

    def view(self, label: str, x: Any, dtype: np.dtype[Any], stream: Any, is_written: bool = False) -> View:
        """Return the buffer of an array; a buffer has rows of states without saying so."""
        if isinstance(x, self.cl.Buffer):
            if x.get_info(self.cl.mem_info.CONTEXT) != self.context:
                raise ArrayError(f"{label}: a buffer of another context; allowed: one of the context of device.queue")
            if is_written and x.flags & self.cl.mem_flags.READ_ONLY:
                raise ArrayError(f"{label}: the buffer may not be written; allowed: a writable one")
            return View(x, (x.size // dtype.itemsize,), x, is_flat=True)
        if not isinstance(x, self.cl.array.Array):
            kind = type(x)
            said = f"{kind.__module__}.{kind.__qualname__}"
            raise ArrayError(f"{label}: got {said}; allowed: arrays and buffers of pyopencl, or device.put")
        if x.context != self.context:
            raise ArrayError(f"{label}: an array of another context; allowed: one of the context of device.queue")
        if x.dtype != dtype:
            raise ArrayError(f"{label}: dtype {x.dtype}; allowed: {dtype}")
        if not x.flags.c_contiguous or x.offset:
            said = f"strides {x.strides} of shape {x.shape}" if not x.flags.c_contiguous else f"offset {x.offset}"
            raise ArrayError(f"{label}: {said}; allowed: an array in C's order from the beginning of its buffer")
        for event in x.events:
            event.wait()
        if x.queue is not None and x.queue != stream:
            x.queue.finish()
        return View(x.base_data, tuple(x.shape), x)

    def made(self, like: Any, shape: tuple[int, ...], dtype: np.dtype[Any], stream: Any) -> tuple[Any, View]:
        """Return a new array, or a buffer where the other one is a buffer."""
        if isinstance(like, self.cl.Buffer):
            buffer = self._buffer(math.prod(shape) * dtype.itemsize)
            return buffer, View(buffer, shape, buffer)
        array = self.cl.array.empty(stream, shape, dtype)
        return array, View(array.base_data, shape, array)

    def finished(self, like: Any, array: Any) -> Any:
        """Return a result."""
        return array

    def _buffer(self, size: int) -> Any:
        return self.cl.Buffer(self.context, self.cl.mem_flags.READ_WRITE, max(size, 1))

    def launch(self, functions: Any, name: str, threads: int, arguments: Sequence[Any], stream: Any) -> None:
        """Put a function into the queue."""
        kernel = functions[name]
        kernel.set_args(*arguments)
        self.cl.enqueue_nd_range_kernel(stream, kernel, (-(-threads // GROUP) * GROUP,), None)

    def ready(self, functions: Any, launches: Sequence[Launch], stream: Any) -> Callable[[], None]:
        """Return what puts functions into the queue, again and again."""
        prepared = []
        for name, threads, arguments in launches:
            kernel = self.cl.Kernel(functions[name].program, name)  # whose arguments stay
            kernel.set_args(*arguments)
            prepared.append((kernel, (-(-threads // GROUP) * GROUP,)))

        def again() -> None:
            for kernel, threads in prepared:
                self.cl.enqueue_nd_range_kernel(stream, kernel, threads, None)
            stream.flush()

        return again

    def own_rooms(self, sizes: Sequence[int]) -> tuple[Any, list[Any]]:
        """Return buffers of so many bytes each, and what holds on to them."""
        buffers = [self._buffer(size) for size in sizes]
        return buffers, buffers

    def rooms(self, sizes: Sequence[int], stream: Any) -> list[Any]:
        """Return buffers of so many bytes each, which OpenCL keeps until what reads them is done."""
        return [self._buffer(size) for size in sizes]

    def used(self, stream: Any) -> None:
        """Let the queue begin."""
        stream.flush()

    def fill(self, place: Any, words: int, stream: Any) -> None:
        """Set so many words of 32 bits to their largest number."""
        self.cl.enqueue_fill_buffer(stream, place, np.uint32(0xFFFFFFFF), 0, 4 * words)

    def read(self, place: Any, offset: int, target: Array, stream: Any) -> Array:
        """Copy bytes from so far behind the beginning of a buffer into an array of NumPy, and return it."""
        if target.nbytes:
            self.cl.enqueue_copy(stream, target, place, src_offset=offset, is_blocking=True)
        return target

    def put(self, array: Array, stream: Any) -> tuple[Any, Any]:
        """Return a copy of an array of NumPy on the device, and its buffer."""
        own = self.cl.array.to_device(stream, array)
        return own, own.base_data


def _devices(cl: Any, platform: Any) -> list[Any]:
    """Return the devices of a platform; none of one whose driver fails."""
    try:
        return list(platform.get_devices())
    except cl.Error:
        return []
