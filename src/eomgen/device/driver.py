"""The driver's library of CUDA, by ctypes."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

from ..errors import InputError
from ..names import show

LIBRARIES = ("libcuda.so.1", "libcuda.so", "nvcuda.dll")  # as loaders find them
NAMES: Mapping[str, str] = {
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
}
OUT_OF_MEMORY = 2
CAPABILITY = (75, 76)  # attributes of a device: its compute capability, major and minor
ORDINAL = 9  # attribute of a pointer: the number of its device
NO_TIMES = 2  # flag of events that only order streams
NAME_LENGTH = 256


class Driver:
    """Calls of the driver's library by short names, see NAMES; an answer that is not 0 is an error."""

    def __init__(self) -> None:
        """Load and initialize the library.

        Raises:
            InputError: there is none, or it finds no device.
        """
        library = _loaded()
        try:
            self._functions = {word: getattr(library, name) for word, name in NAMES.items()}
        except AttributeError as error:
            raise InputError(f"device: the driver of CUDA is too old: {error}") from None
        for function in self._functions.values():
            function.restype = ctypes.c_int
        self("init", ctypes.c_uint(0))

    def __call__(self, word: str, *arguments: Any) -> None:
        """Call a function of the library.

        Raises:
            MemoryError: the device has too little memory.
            InputError: any other failure, with the library's message.
        """
        code = self._functions[word](*arguments)
        if code:
            text = f"{NAMES[word]}: {self._message(code)} ({code})"
            raise MemoryError(f"device: {text}") if code == OUT_OF_MEMORY else InputError(f"device: {text}")

    def address(self, word: str) -> int:
        """Return the address of a function of the library."""
        return ctypes.cast(self._functions[word], ctypes.c_void_p).value or 0

    def _message(self, code: int) -> str:
        """Return the library's message for an error."""
        found = ctypes.c_char_p()
        self._functions["message"](ctypes.c_int(code), ctypes.byref(found))
        return found.value.decode("ascii", "replace") if found.value else "an error without a text"

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
    """A device of CUDA, whose context is current inside ``with chosen.current()``.

    The context is the primary one, that of CuPy, PyTorch and JAX.

    Attributes:
        driver: its driver.
        ordinal: its number.
        name: its name.
        context: address of the context.
    """

    def __init__(self, driver: Driver, ordinal: int) -> None:
        """Choose a device by its number.

        Raises:
            InputError: there is none of this number.
        """
        self.driver, self.ordinal = driver, ordinal
        count = driver.number("count")
        if not 0 <= ordinal < count:
            allowed = f'"cuda:0" to "cuda:{count - 1}"' if count else "none, as there is no device"
            raise InputError(f"device: {show(f'cuda:{ordinal}')}; allowed: {allowed}")
        self._device = driver.number("device", ctypes.c_int(ordinal))
        text = ctypes.create_string_buffer(NAME_LENGTH)
        driver("name", text, ctypes.c_int(NAME_LENGTH), ctypes.c_int(self._device))
        self.name = text.value.decode("ascii", "replace")
        self.context = driver.handle("retain", ctypes.c_int(self._device))

    @property
    def capability(self) -> int:
        """Compute capability, 90 for 9.0."""
        major, minor = (
            self.driver.number("attribute", ctypes.c_int(which), ctypes.c_int(self._device)) for which in CAPABILITY
        )
        return 10 * major + minor

    @contextmanager
    def current(self) -> Iterator[None]:
        """Let calls of this thread go to the device, and afterwards to what they went to before."""
        self.driver("push", ctypes.c_void_p(self.context))
        try:
            yield
        finally:
            self.driver.handle("pop")

    def release(self, word: str, address: int) -> None:
        """Give back what lies at an address by "free", "unload" or "drop", from a destructor.

        At the end of a process the driver has given back everything before and refuses the call, which is an
        InputError without a caller who could take it.
        """
        with suppress(InputError), self.current():
            self.driver(word, ctypes.c_void_p(address))


def _loaded() -> ctypes.CDLL:
    """Load the driver's library.

    Raises:
        InputError: there is none.
    """
    try:
        return first_library(LIBRARIES)
    except OSError as error:
        allowed = "a machine with one, or the methods of the kernel itself"
        raise InputError(f"device: no driver of CUDA here ({error}); allowed: {allowed}") from None


def first_library(names: Iterable[str]) -> ctypes.CDLL:
    """Load the first of some libraries that is here.

    Raises:
        OSError: none is; what the system says of the first.
    """
    said: OSError | None = None
    for name in names:
        try:
            return ctypes.CDLL(name)
        except OSError as error:
            said = said or error
    raise said or OSError("no library is named")
