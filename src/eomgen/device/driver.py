"""The driver's library of CUDA, or of HIP, by ctypes: the same calls under two tables of names."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from ..errors import InputError
from ..names import show

LIBRARIES: Mapping[str, Sequence[str]] = {  # as loaders find them
    "cuda": ("libcuda.so.1", "libcuda.so", "nvcuda.dll"),
    "hip": ("libamdhip64.so.7", "libamdhip64.so.6", "libamdhip64.so", "amdhip64_7.dll", "amdhip64_6.dll"),
}
TITLES = {"cuda": "CUDA", "hip": "HIP"}
NAMES: Mapping[str, Mapping[str, str]] = {
    "cuda": {
        "init": "cuInit",
        "version": "cuDriverGetVersion",
        "count": "cuDeviceGetCount",
        "device": "cuDeviceGet",
        "name": "cuDeviceGetName",
        "attribute": "cuDeviceGetAttribute",
        "retain": "cuDevicePrimaryCtxRetain",
        "push": "cuCtxPushCurrent_v2",
        "pop": "cuCtxPopCurrent_v2",
        "load": "cuModuleLoadData",
        "unload": "cuModuleUnload",
        "function": "cuModuleGetFunction",
        "launch": "cuLaunchKernel",
        "allocate": "cuMemAlloc_v2",
        "free": "cuMemFree_v2",
        "to_host": "cuMemcpyDtoHAsync_v2",
        "to_device": "cuMemcpyHtoDAsync_v2",
        "fill": "cuMemsetD32Async",
        "pointer": "cuPointerGetAttribute",
        "wait": "cuStreamSynchronize",
        "event": "cuEventCreate",
        "record": "cuEventRecord",
        "wait_for": "cuStreamWaitEvent",
        "drop": "cuEventDestroy_v2",
        "message": "cuGetErrorString",
    },
    "hip": {
        "init": "hipInit",
        "version": "hipDriverGetVersion",
        "count": "hipGetDeviceCount",
        "device": "hipDeviceGet",
        "name": "hipDeviceGetName",
        "current": "hipGetDevice",
        "choose": "hipSetDevice",
        "load": "hipModuleLoadData",
        "unload": "hipModuleUnload",
        "function": "hipModuleGetFunction",
        "launch": "hipModuleLaunchKernel",
        "allocate": "hipMalloc",
        "free": "hipFree",
        "to_host": "hipMemcpyDtoHAsync",
        "to_device": "hipMemcpyHtoDAsync",
        "fill": "hipMemsetD32Async",
        "pointer": "hipPointerGetAttribute",
        "wait": "hipStreamSynchronize",
        "event": "hipEventCreateWithFlags",
        "record": "hipEventRecord",
        "wait_for": "hipStreamWaitEvent",
        "drop": "hipEventDestroy",
        "message": "hipGetErrorString",
    },
}
OUT_OF_MEMORY = 2  # of both
CAPABILITY = (75, 76)  # attributes of a device of CUDA: its compute capability, major and minor
ORDINAL = 9  # attribute of a pointer: the number of its device
NO_TIMES = 2  # flag of events that only order streams
NAME_LENGTH = 256


class Driver:
    """Calls of a driver's library by short names, see NAMES; an answer that is not 0 is an error.

    kind: "cuda" or "hip".
    """

    def __init__(self, kind: str) -> None:
        """Load the library, and let it begin.

        Raises:
            InputError: there is none, or it finds no device.
        """
        self.kind, self.title = kind, TITLES[kind]
        library = _loaded(kind)
        try:
            self._functions = {word: getattr(library, name) for word, name in NAMES[kind].items()}
        except AttributeError as error:
            raise InputError(f"device: the driver of {self.title} is too old: {error}") from None
        for function in self._functions.values():
            function.restype = ctypes.c_int
        if kind == "hip":
            self._functions["message"].restype = ctypes.c_char_p
        self("init", ctypes.c_uint(0))

    def __call__(self, word: str, *arguments: Any) -> None:
        """Call a function of the library.

        Raises:
            MemoryError: the device has too little memory.
            InputError: any other failure, with the library's text.
        """
        code = self._functions[word](*arguments)
        if code:
            text = f"{NAMES[self.kind][word]}: {self._message(code)} ({code})"
            raise MemoryError(f"device: {text}") if code == OUT_OF_MEMORY else InputError(f"device: {text}")

    def address(self, word: str) -> int:
        """Return the address of a function of the library."""
        return ctypes.cast(self._functions[word], ctypes.c_void_p).value or 0

    def _message(self, code: int) -> str:
        """Return the library's text of an error."""
        if self.kind == "hip":
            said = self._functions["message"](ctypes.c_int(code))
        else:
            found = ctypes.c_char_p()
            self._functions["message"](ctypes.c_int(code), ctypes.byref(found))
            said = found.value
        return said.decode("ascii", "replace") if said else "an error without a text"

    def number(self, word: str, *arguments: Any) -> int:
        """Return a whole number that a function of the library writes through its first argument."""
        found = ctypes.c_int()
        self(word, ctypes.byref(found), *arguments)
        return found.value

    def handle(self, word: str, *arguments: Any) -> int:
        """Return an address that a function of the library writes through its first argument; 0 is none."""
        found = ctypes.c_void_p()
        self(word, ctypes.byref(found), *arguments)
        return found.value or 0


class Chosen:
    """A device of a driver, whose context is current inside ``with chosen.current()``.

    The context of CUDA is the primary one, that of CuPy, PyTorch and JAX.
    """

    def __init__(self, driver: Driver, ordinal: int) -> None:
        """Choose a device by its number.

        Raises:
            InputError: there is none of this number.
        """
        self.driver, self.ordinal = driver, ordinal
        count = driver.number("count")
        if not 0 <= ordinal < count:
            allowed = f'"{driver.kind}:0" to "{driver.kind}:{count - 1}"' if count else "none, as there is no device"
            raise InputError(f"device: {show(f'{driver.kind}:{ordinal}')}; allowed: {allowed}")
        self._device = driver.number("device", ctypes.c_int(ordinal))
        text = ctypes.create_string_buffer(NAME_LENGTH)
        driver("name", text, ctypes.c_int(NAME_LENGTH), ctypes.c_int(self._device))
        self.name = text.value.decode("ascii", "replace")
        self.context = 0 if driver.kind == "hip" else driver.handle("retain", ctypes.c_int(self._device))

    @property
    def capability(self) -> int:
        """Compute capability of a device of CUDA, 90 for 9.0."""
        major, minor = (
            self.driver.number("attribute", ctypes.c_int(which), ctypes.c_int(self._device)) for which in CAPABILITY
        )
        return 10 * major + minor

    @contextmanager
    def current(self) -> Iterator[None]:
        """Let calls of this thread go to the device, and afterwards to what they went to before."""
        if self.driver.kind == "hip":
            before = self.driver.number("current")
            self.driver("choose", ctypes.c_int(self.ordinal))
            try:
                yield
            finally:
                self.driver("choose", ctypes.c_int(before))
            return
        self.driver("push", ctypes.c_void_p(self.context))
        try:
            yield
        finally:
            self.driver.handle("pop")


def _loaded(kind: str) -> ctypes.CDLL:
    """Load the driver's library.

    Raises:
        InputError: there is none.
    """
    said = ""
    for name in LIBRARIES[kind]:
        try:
            return ctypes.CDLL(name)
        except OSError as error:
            said = said or str(error)
    raise InputError(
        f"device: no driver of {TITLES[kind]} here ({said}); allowed: a machine with one,"
        ' "opencl" where a device has that, or the methods of the kernel itself'
    )
