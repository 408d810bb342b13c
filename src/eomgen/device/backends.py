"""Devices as calls of kernels need them, and what is known of a function and a call there."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .texts import FunctionText

Array = NDArray[Any]


class Placed(Protocol):
    """An array on a device: its shape, and its address or buffer."""

    @property
    def place(self) -> Any:
        """Address or buffer."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape, as of NumPy."""

    @property
    def is_flat(self) -> bool:
        """Whether it is a buffer, which has no axes."""


class Backend(Protocol):
    """Interface of devices that calls need; see ``GpuBackend`` and ``OpenCLBackend``."""

    title: str

    def session(self, stream: Any, arrays: Sequence[Any]) -> AbstractContextManager[Any]:
        """Let a call's work go to a stream."""

    def functions(self, code: str, dtype: np.dtype[Any]) -> Any:
        """Return the functions of a text."""

    def view(self, label: str, x: Any, dtype: np.dtype[Any], stream: Any, is_written: bool = False) -> Placed:
        """Return where an array lies."""

    def made(self, like: Any, shape: tuple[int, ...], dtype: np.dtype[Any], stream: Any) -> tuple[Any, Placed]:
        """Return a new array, and where it lies."""

    def finished(self, like: Any, array: Any) -> Any:
        """Return a result for the caller."""

    def launch(self, functions: Any, name: str, threads: int, arguments: Sequence[Any], stream: Any) -> None:
        """Put a function on a stream."""

    def ready(self, functions: Any, launches: Sequence[Launch], stream: Any) -> Callable[[], None]:
        """Return what puts functions on a stream, again and again."""

    def own_rooms(self, sizes: Sequence[int]) -> tuple[Any, list[Any]]:
        """Return memory of so many bytes each, and what holds on to it."""

    def rooms(self, sizes: Sequence[int], stream: Any) -> list[Any]:
        """Return memory for one call."""

    def used(self, stream: Any) -> None:
        """Say that all of a call is on its stream."""

    def fill(self, place: Any, words: int, stream: Any) -> None:
        """Set words to their largest number."""

    def read(self, place: Any, offset: int, target: Array, stream: Any) -> Array:
        """Copy to an array of NumPy."""

    def put(self, array: Array, stream: Any) -> tuple[Any, Any]:
        """Copy an array of NumPy to the device."""


@dataclass
class Loaded:
    """A function on a device: its text, what was made of it, and the numbers h of parameters as they were."""

    text: FunctionText
    functions: Any
    setup: Any = None
    h: tuple[Any, Any] = (None, None)

    def __post_init__(self) -> None:
        """Keep shapes of one state's arrays, and how many numbers each has."""
        self.reads, self.writes = self.text.shapes("reads"), self.text.shapes("writes")
        self.sizes = {x: math.prod(shape) for x, shape in {**self.reads, **self.writes}.items()}


@dataclass(frozen=True)
class Taken:
    """Input of a call.

    numbers: the same for all states.  reads: where arrays lie.  results: arrays with their places.  like: an array of
    whose library results are.
    """

    loaded: Loaded
    count: int
    is_tiled: bool
    numbers: Sequence[Any]
    reads: Mapping[str, Placed]
    results: Mapping[str, tuple[Any, Placed]]
    like: Any

    @property
    def writes(self) -> Mapping[str, Placed]:
        """Places of results."""
        return {label: place for label, (_, place) in self.results.items()}

    def sizes(self, tile: int, item: int) -> list[int]:
        """Return bytes that a call needs beside its arrays: statuses, what a search finds, and tiles.

        Args:
            tile: states of a tile.
            item: bytes of a number.
        """
        whole, sizes = -(-self.count // tile) * tile, self.loaded.sizes
        tiles = [] if self.is_tiled else [whole * size * item for size in sizes.values()]
        return [4 * self.count, 4 * (1 + len(sizes)), *tiles]


Launch = tuple[str, int, Sequence[Any]]  # a function's name, threads, arguments


@dataclass(frozen=True)
class Prepared:
    """A function on a device as it is now: its text, what was made of it, and the numbers h of parameters."""

    text: FunctionText
    functions: Any
    h: Any


@dataclass(frozen=True)
class Call:
    """One call: places of arrays in tiles, with the labels of what is read and written.

    axes: axes of states that are in front of each array's own in messages.
    """

    loaded: Loaded
    count: int
    reads: Mapping[str, Any]
    writes: Mapping[str, Any]
    status: Any
    first: Any
    stream: Any

    @property
    def text(self) -> FunctionText:
        """The function's text."""
        return self.loaded.text
