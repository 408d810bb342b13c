"""Functions on a device, and calls of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from .cuda import DeviceArray, Functions
from .foreign import View
from .texts import FunctionText


@dataclass
class Loaded:
    """A function on a device.

    text: its source and metadata.  functions: the compiled source.  h: the numbers of the parameters, and setup: the
    kernel's parameters that they are of; None before the first call.
    """

    text: FunctionText
    functions: Functions
    setup: Any = None
    h: DeviceArray | None = None

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
    reads: Mapping[str, View]
    results: Mapping[str, tuple[Any, View]]
    like: Any

    @property
    def writes(self) -> Mapping[str, View]:
        """Places of results."""
        return {label: place for label, (_, place) in self.results.items()}

    def scratch_sizes(self, tile: int, item: int) -> list[int]:
        """Return bytes that a call needs in addition to its arrays: statuses, what a search finds, and tiles.

        Args:
            tile: states of a tile.
            item: bytes of a number.
        """
        whole, sizes = -(-self.count // tile) * tile, self.loaded.sizes
        tiles = [] if self.is_tiled else [whole * size * item for size in sizes.values()]
        return [4 * self.count, 4 * (1 + len(sizes)), *tiles]
