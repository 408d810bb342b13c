"""A device of CUDA: memory, streams, functions and launches."""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ArrayError
from .dlpack import CUDA, make_capsule
from .driver import NO_TIMES, ORDINAL, Chosen, Driver
from .foreign import (
    DEFAULT,
    View,
    current_stream,
    handed_over,
    handle_of,
    library_of,
    new_array,
    refuse_elsewhere,
    view_of,
)
from .nvrtc import Nvrtc

BLOCK = 128  # threads of a block
LINE = 256  # bytes at whose multiples memory begins
SHAPE = tuple(ctypes.c_uint(x) for x in (1, 1, BLOCK, 1, 1, 0))  # of grids, blocks and shared memory, behind the first
NOTHING = ctypes.c_void_p(0)
WORDS: Mapping[type, Any] = {  # 64 bits that begin with those of an argument; addresses are plain numbers
    int: int,
    np.uint64: int,
    np.int32: lambda x: int(x) & 0xFFFFFFFF,
    np.float32: lambda x: int(x.view(np.uint32)),
    np.float64: lambda x: int(x.view(np.uint64)),
}
WORD = 8  # bytes
Array = NDArray[Any]
Launch = tuple[str, int, Sequence[Any]]  # a function's name, threads, arguments


class Memory:
    """Memory of a device, given back when nobody holds on to it."""

    def __init__(self, chosen: Chosen, size: int) -> None:
        """Take so many bytes of the device that is current.

        Raises:
            MemoryError: it has too few.
        """
        self.address, self.size, self._chosen = 0, size, chosen
        self.address = chosen.driver.handle("allocate", ctypes.c_size_t(max(size, 1)))

    def __del__(self) -> None:
        if self.address:
            self._chosen.release("free", self.address)


class DeviceArray:
    """Numbers on a device, in C's order; CuPy, PyTorch, Numba and JAX take it without copying.

    Attributes:
        shape, dtype: as of NumPy.
    """

    def __init__(self, chosen: Chosen, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        self.shape, self.dtype, self._chosen = shape, dtype, chosen
        self._memory = Memory(chosen, prod(shape) * dtype.itemsize)
        self.stream = DEFAULT

    def __repr__(self) -> str:
        return f"<array {self.shape} of {self.dtype} on cuda:{self._chosen.ordinal}>"

    @property
    def address(self) -> int:
        """Address of its first number."""
        return self._memory.address

    @property
    def lies_on(self) -> int:
        """Number of its device."""
        return self._chosen.ordinal

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        """Say where it lies, version 3."""
        return {
            "shape": self.shape,
            "typestr": self.dtype.str,
            "data": (self.address if prod(self.shape) else 0, False),
            "strides": None,
            "stream": self.stream,
            "version": 3,
        }

    def __dlpack__(self, *, stream: Any = None, **_: Any) -> Any:
        """Return a capsule of DLPack; what was put on the array's stream is done by then."""
        with self._chosen.current():
            self._chosen.driver("wait", ctypes.c_void_p(self.stream))
        return make_capsule(self, self.address, self.shape, self.dtype, self.__dlpack_device__())

    def __dlpack_device__(self) -> tuple[int, int]:
        """Return the type and the number of its device."""
        return CUDA, self._chosen.ordinal


class Functions:
    """Functions of an image on a device, by their names."""

    def __init__(self, chosen: Chosen, image: bytes) -> None:
        self._chosen, self._found = chosen, dict[str, int]()
        self._module = 0
        self._module = chosen.driver.handle("load", ctypes.c_char_p(image))

    def __del__(self) -> None:
        if self._module:
            self._chosen.release("unload", self._module)

    def find(self, name: str) -> int:
        """Return a function's address."""
        if name not in self._found:
            module = ctypes.c_void_p(self._module)
            self._found[name] = self._chosen.driver.handle("function", module, name.encode("ascii"))
        return self._found[name]


class Cuda:
    """A device of CUDA; all calls of it go inside ``with session(...)``.

    Attributes:
        chosen: the device.
        title: its number and name.
        contract: whether a product and a sum may be one operation.
    """

    def __init__(self, ordinal: int, contract: bool) -> None:
        """Open a device by its number.

        Raises:
            InputError: no driver, or no device of this number.
            NotInstalledError: no NVRTC.
        """
        self.chosen, self.contract = Chosen(Driver(), ordinal), contract
        self.title = f"cuda:{ordinal}, {self.chosen.name}"
        self._compiler = Nvrtc()
        self._scratch: Memory | None = None  # for what lives for one call
        self._used: tuple[int, int] | None = None  # the last stream that it was used on, and what says when it is done

    def __del__(self) -> None:
        used = getattr(self, "_used", None)  # not there where the device was not opened
        if used is not None:
            self.chosen.release("drop", used[1])

    @contextmanager
    def session(self, stream: Any, arrays: Sequence[Any]) -> Iterator[int]:
        """Let a call's work go to a stream: the given one, or the one that the first array's library works on."""
        library = library_of(arrays[0]) if arrays else ""
        with self.chosen.current():
            own = current_stream(library, self.chosen.ordinal)
            chosen = own if stream is None else handle_of(stream)
            self._follow(chosen, own)
            yield chosen
            self._follow(own, chosen)

    def _follow(self, stream: int, other: int | None) -> None:
        """Let what is put on a stream from now on wait for what was put on another one."""
        if other is None or (stream or DEFAULT) == (other or DEFAULT):
            return
        event = self._record(other)
        try:
            self.chosen.driver("wait_for", ctypes.c_void_p(stream), ctypes.c_void_p(event), ctypes.c_uint(0))
        finally:
            self.chosen.driver("drop", ctypes.c_void_p(event))

    def _record(self, stream: int) -> int:
        event = self.chosen.driver.handle("event", ctypes.c_uint(NO_TIMES))
        try:
            self.chosen.driver("record", ctypes.c_void_p(event), ctypes.c_void_p(stream))
        except BaseException:
            self.chosen.driver("drop", ctypes.c_void_p(event))
            raise
        return event

    def functions(self, code: str) -> Functions:
        """Return the functions of source code."""
        with self.chosen.current():
            return Functions(self.chosen, self._compiler.image(code, self.chosen, self.contract))

    def view(self, label: str, x: Any, dtype: np.dtype[Any], stream: int, is_written: bool = False) -> View:
        """Return where an array lies, behind whatever its library has still to do."""
        if isinstance(x, DeviceArray) and x.dtype == dtype and x.lies_on == self.chosen.ordinal:  # it need not be asked
            view = View(x.address, x.shape, x, x.stream)
        else:
            view = view_of(label, x, dtype, self.chosen.ordinal, stream, is_written)
            if prod(view.shape):
                self._refuse_elsewhere(label, view.place)
        self._follow(stream, view.stream)
        return view

    def _refuse_elsewhere(self, label: str, address: int) -> None:
        found, driver = ctypes.c_int(-1), self.chosen.driver
        try:
            driver("pointer", ctypes.byref(found), ctypes.c_int(ORDINAL), ctypes.c_void_p(address))
        except ValueError as error:
            raise ArrayError(f"{label}: the array lies on no device of CUDA ({error})") from None
        refuse_elsewhere(label, found.value, self.chosen.ordinal)

    def made(self, like: Any, shape: tuple[int, ...], dtype: np.dtype[Any], stream: int) -> tuple[Any, View]:
        """Return a new array for a result, of the library of another array where that can be, and where it lies."""
        array = new_array(library_of(like), shape, dtype, self.chosen.ordinal)
        if array is not None:
            return array, self.view("out", array, dtype, stream, True)
        own = DeviceArray(self.chosen, shape, dtype)
        own.stream = stream or DEFAULT
        return own, View(own.address, shape, own)

    def finished(self, like: Any, array: Any) -> Any:
        """Return a result as an array of the library of another one."""
        return handed_over(library_of(like), array) if isinstance(array, DeviceArray) else array

    def launch(self, functions: Functions, name: str, threads: int, arguments: Sequence[Any], stream: int) -> None:
        """Put a function on a stream, one thread for each of so many; addresses are plain numbers."""
        given, _words = _arguments(functions, name, threads, arguments, stream)
        self.chosen.driver("launch", *given)

    def ready(self, functions: Functions, launches: Sequence[Launch], stream: int) -> Callable[[], None]:
        """Return what puts functions on a stream, again and again."""
        chosen, prepared = self.chosen, [_arguments(functions, *launch, stream) for launch in launches]

        def again() -> None:
            with chosen.current():
                for given, _words in prepared:
                    chosen.driver("launch", *given)

        return again

    def own_rooms(self, sizes: Sequence[int]) -> tuple[Memory, list[int]]:
        """Return memory of so many bytes each, and what holds on to it."""
        begins, total = _packed(sizes)
        memory = Memory(self.chosen, total)
        return memory, [memory.address + begin for begin in begins]

    def rooms(self, sizes: Sequence[int], stream: int) -> list[int]:
        """Return memory of so many bytes each, for this call on this stream."""
        begins, total = _packed(sizes)
        if self._used is not None and self._used[0] != stream:
            self.chosen.driver("wait_for", ctypes.c_void_p(stream), ctypes.c_void_p(self._used[1]), ctypes.c_uint(0))
        if self._scratch is None or self._scratch.size < total:
            if self._used is not None:
                self.chosen.driver("drop", ctypes.c_void_p(self._used[1]))
            self._used = self._scratch = None
            self._scratch = Memory(self.chosen, total)
        return [self._scratch.address + begin for begin in begins]

    def used(self, stream: int) -> None:
        """Say that all of a call is on its stream, so that others wait before they take the memory of ``rooms``."""
        driver = self.chosen.driver
        if self._used is None:
            self._used = stream, self._record(stream)
        else:
            self._used = stream, self._used[1]
            driver("record", ctypes.c_void_p(self._used[1]), ctypes.c_void_p(stream))

    def fill(self, place: int, words: int, stream: int) -> None:
        """Set so many words of 32 bits to their largest number."""
        count, largest = ctypes.c_size_t(words), ctypes.c_uint(0xFFFFFFFF)
        self.chosen.driver("fill", ctypes.c_void_p(place), largest, count, ctypes.c_void_p(stream))

    def read(self, place: int, offset: int, target: Array, stream: int) -> Array:
        """Copy bytes from so far behind a place into an array of NumPy, wait for that, and return it."""
        driver, size = self.chosen.driver, ctypes.c_size_t(target.nbytes)
        if target.nbytes:
            source = ctypes.c_void_p(place + offset)
            driver("to_host", ctypes.c_void_p(target.ctypes.data), source, size, ctypes.c_void_p(stream))
        driver("wait", ctypes.c_void_p(stream))
        return target

    def put(self, array: Array, stream: int) -> DeviceArray:
        """Return a copy of an array of NumPy on the device; the copy is complete."""
        own = DeviceArray(self.chosen, array.shape, array.dtype)
        if array.nbytes:
            driver, size = self.chosen.driver, ctypes.c_size_t(array.nbytes)
            source, target = ctypes.c_void_p(array.ctypes.data), ctypes.c_void_p(own.address)
            driver("to_device", target, source, size, ctypes.c_void_p(stream))
            driver("wait", ctypes.c_void_p(stream))
        return own


def _packed(sizes: Sequence[int]) -> tuple[list[int], int]:
    """Return where parts of so many bytes begin, one behind the other in whole lines, and the size of all."""
    *begins, total = itertools.accumulate((-(-size // LINE) * LINE for size in sizes), initial=0)
    return begins, total


def _arguments(
    functions: Functions, name: str, threads: int, arguments: Sequence[Any], stream: int
) -> tuple[tuple[Any, ...], Any]:
    """Return what the driver's launch takes, and the words that it points to."""
    count = len(arguments)
    words = (ctypes.c_uint64 * count)(*[WORDS[type(x)](x) for x in arguments])
    begin = ctypes.addressof(words)
    pointers = (ctypes.c_void_p * count)(*range(begin, begin + WORD * count, WORD))
    function, grid = ctypes.c_void_p(functions.find(name)), ctypes.c_uint(-(-threads // BLOCK))
    return (function, grid, *SHAPE, ctypes.c_void_p(stream), pointers, NOTHING), words
