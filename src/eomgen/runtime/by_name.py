"""The matrix coefficients of eqs. (10)-(12) by the names of joints and coordinates.

A generated package carries a copy of this file.  What vanishes identically stands in its metadata.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import UnknownNameError
from ..names import joint_of, nearest_or_all

Array = NDArray[Any]
Mask = NDArray[np.bool_]
Index = int | slice

KINDS = ("x", "y", "z", "alpha", "beta", "gamma", "motor")


class BlockMap(Mapping[tuple[str, ...], Array]):
    """Blocks of one array by name; those that vanish identically are absent.

    A key has a name for each index: a joint ("joint1", all its coordinates) or a coordinate ("joint1.x").  Iteration
    goes over the joints' blocks.  The values are views of ``whole``; a batch keeps its leading axis.

    Attributes:
        whole: the array with all coordinates, (n, n) or (n, n, n).
        places: index or slice of every coordinate and joint by its name.
        mask: same shape, True where an entry does not vanish identically for joints of this kind in this order.
    """

    def __init__(self, symbol: str, whole: Array, mask: Mask, coordinates: Sequence[str]) -> None:
        self.whole, self.mask, self._symbol = whole, mask, symbol
        self.places: dict[str, Index] = {name: i for i, name in enumerate(coordinates)}
        self._joints: dict[str, slice] = {}
        for i, name in enumerate(coordinates):
            joint = joint_of(name)
            self._joints[joint] = slice(self._joints.get(joint, slice(i, i)).start, i + 1)
        self.places.update(self._joints)

    def __getitem__(self, key: tuple[str, ...]) -> Array:
        place = self.index(key)
        if not self.mask[place].any():
            raise UnknownNameError(
                f"{self._symbol} of {', '.join(key)} vanishes identically; .get({key!r}, 0.0) gives a zero for it"
            )
        entries: tuple[Any, ...] = (..., *place)
        block: Array = self.whole[entries]
        return block

    def get(self, key: tuple[str, ...], default: Any = None) -> Any:
        """The block, or the default where it vanishes identically; UnknownNameError for a name that is none."""
        return self[key] if self.mask[self.index(key)].any() else default

    def __contains__(self, key: object) -> bool:
        return isinstance(key, tuple) and bool(self.mask[self.index(key)].any())

    def __iter__(self) -> Iterator[tuple[str, ...]]:
        for key in product(self._joints, repeat=self.mask.ndim):
            if self.mask[tuple(self._joints[name] for name in key)].any():
                yield key

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __repr__(self) -> str:
        return f"<{len(self)} blocks of {self._symbol} by {self.mask.ndim} joints>"

    def index(self, key: Sequence[str]) -> tuple[Index, ...]:
        """Places of a key's names in ``whole``: an index for a coordinate, a slice for a joint.

        Raises:
            UnknownNameError: a name that is none, or another number of them.
        """
        rank = self.mask.ndim
        if not isinstance(key, tuple) or len(key) != rank:
            raise UnknownNameError(f"{self._symbol}: {key!r} is no block; allowed: a tuple of {rank} names")
        for name in key:
            if name not in self.places:
                raise UnknownNameError(f"{self._symbol}: {name!r} is unknown{nearest_or_all(str(name), self.places)}")
        return tuple(self.places[name] for name in key)


class Blocks:
    """M and C of one state, or of a batch, by names.

    Attributes:
        mass: tr(dA/ds H dA/dv^T), eq. (11); ``mass["joint1", "joint2"]``, ``mass["joint1.x", "joint2.gamma"]``;
            kg, kg m or kg m^2 by the kinds of the coordinates.
        christoffel: tr(dA/ds H d2A/dv dw^T), eq. (12), symmetric in the last two names.
    """

    def __init__(self, mass: BlockMap, christoffel: BlockMap, joints: Sequence[str]) -> None:
        self.mass, self.christoffel, self._joints = mass, christoffel, tuple(joints)

    def __repr__(self) -> str:
        return f"Blocks(mass={self.mass!r}, christoffel={self.christoffel!r})"

    def row(self, s: str, v: str) -> Array:
        """M_i^sv of eq. (11), (joints,): coordinate s ("joint1.x") against v ("gamma") of every joint; 0 where a
        joint has no such coordinate.  UnknownNameError for a name that is none."""
        (i,) = self.mass.index((s, s))[:1]
        return self._spread(self.mass.whole[..., i, :], (s, v))

    def matrix(self, s: str, v: str, w: str) -> Array:
        """C_i^svw of eqs. (10) and (12), (joints, joints): rows are v of every joint, columns w of every joint."""
        (i,) = self.christoffel.index((s, s, s))[:1]
        return self._spread(self.christoffel.whole[..., i, :, :], (s, v, w))

    def _spread(self, part: Array, names: tuple[str, ...]) -> Array:
        """Entries of the named kinds in an array over all joints."""
        s, *kinds = names
        if s in self._joints:
            raise UnknownNameError(f"s: {s!r} is a joint; allowed: one of its coordinates, such as {s + '.x'!r}")
        result = np.zeros((*part.shape[: part.ndim - len(kinds)], *(len(self._joints),) * len(kinds)), part.dtype)
        into: list[list[int]] = []
        take: list[list[Any]] = []
        for kind in kinds:
            if kind not in KINDS:
                raise UnknownNameError(f"{kind!r} is no kind of coordinate; allowed: {', '.join(KINDS)}")
            found = {k: self.mass.places.get(f"{joint}.{kind}") for k, joint in enumerate(self._joints)}
            into.append([k for k, place in found.items() if place is not None])
            take.append([place for place in found.values() if place is not None])
        target: tuple[Any, ...] = (..., *np.ix_(*into))
        source: tuple[Any, ...] = (..., *np.ix_(*take))
        result[target] = part[source]
        return result


def make_blocks(mass: Array, christoffel: Array, meta: Mapping[str, Sequence[str]], names: Sequence[str]) -> Blocks:
    """Blocks of the whole arrays; ``meta`` is the metadata's entry "survivors", ``names`` the coordinates."""
    n = len(names)
    rows = np.stack([_bits(text, n) for text in meta["mass_matrix"]])
    upper = np.stack([_bits(text, n * (n + 1) // 2) for text in meta["christoffel"]])
    mask = np.zeros((n, n, n), dtype=np.bool_)
    v, w = np.triu_indices(n)
    mask[:, v, w] = upper
    mask |= np.swapaxes(mask, 1, 2)
    joints = list(dict.fromkeys(map(joint_of, names)))
    return Blocks(BlockMap("M", mass, rows, names), BlockMap("C", christoffel, mask, names), joints)


def _bits(text: str, count: int) -> Mask:
    """Bits written as hexadecimal digits, the first in the highest bit."""
    return np.unpackbits(np.frombuffer(bytes.fromhex(text), np.uint8), count=count).astype(np.bool_)
