"""Views by name of kernels: coefficients of eqs. (10)-(12), inertial parameters, gears, followers.

What vanishes identically stands in a package's metadata.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, UnknownNameError
from ..names import joint_of, nearest_or_all, show
from ..runtime.arrays import joint_lead
from ..runtime.raw import Array, name_of
from .functions import KernelWithMethods

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
        """Return the block, or the default where it vanishes identically; UnknownNameError for a name that is none."""
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
        """Return places of a key's names in ``whole``: an index for a coordinate, a slice for a joint.

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
        """Return M_i^sv of eq. (11), (joints,): coordinate s ("joint1.x") against v ("gamma") of every joint; 0 where a
        joint has no such coordinate.  UnknownNameError for a name that is none."""
        (i,) = self.mass.index((s, s))[:1]
        return self._spread(self.mass.whole[..., i, :], (s, v))

    def matrix(self, s: str, v: str, w: str) -> Array:
        """Return C_i^svw of eqs. (10) and (12), (joints, joints): rows are v, columns w of every joint."""
        (i,) = self.christoffel.index((s, s, s))[:1]
        return self._spread(self.christoffel.whole[..., i, :, :], (s, v, w))

    def _spread(self, block: Array, names: tuple[str, ...]) -> Array:
        """Return entries of the named kinds in an array over all joints."""
        s, *kinds = names
        if s in self._joints:
            raise UnknownNameError(f"s: {s!r} is a joint; allowed: one of its coordinates, such as {s + '.x'!r}")
        result = np.zeros((*block.shape[: block.ndim - len(kinds)], *(len(self._joints),) * len(kinds)), block.dtype)
        into: list[list[int]] = []
        take: list[list[Any]] = []
        for kind in kinds:
            if kind not in KINDS:
                raise UnknownNameError(f"{kind!r} is no kind of coordinate; allowed: {', '.join(KINDS)}")
            columns = {k: self.mass.places.get(f"{joint}.{kind}") for k, joint in enumerate(self._joints)}
            into.append([k for k, place in columns.items() if place is not None])
            take.append([place for place in columns.values() if place is not None])
        target: tuple[Any, ...] = (..., *np.ix_(*into))
        source: tuple[Any, ...] = (..., *np.ix_(*take))
        result[target] = block[source]
        return result


def make_blocks(
    mass: Array,
    christoffel: Array,
    meta: Mapping[str, Sequence[str]],
    names: Sequence[str],
) -> Blocks:
    """Return blocks of the whole arrays.

    Args:
        mass, christoffel: of coordinates.
        meta: the metadata's entry "survivors".
        names: of the coordinates.
    """
    n = len(names)
    rows = np.stack([_bits(text, n) for text in meta["matrix"]])
    upper = np.stack([_bits(text, n * (n + 1) // 2) for text in meta["tensor"]])
    mask = np.zeros((n, n, n), dtype=np.bool_)
    v, w = np.triu_indices(n)
    mask[:, v, w] = upper
    mask |= np.swapaxes(mask, 1, 2)
    joints = list(dict.fromkeys(map(joint_of, names)))
    blocks = BlockMap("M", mass, rows, names), BlockMap("C", christoffel, mask, names)
    return Blocks(*blocks, joints)


def _bits(text: str, count: int) -> Mask:
    """Return bits written as hexadecimal digits, the first in the highest bit."""
    return np.unpackbits(np.frombuffer(bytes.fromhex(text), np.uint8), count=count).astype(np.bool_)


class NamedViews(KernelWithMethods):
    """Views by name of a kernel's results and parameters."""

    def blocks(self, q: ArrayLike) -> Blocks:
        """Return M and C of eqs. (10)-(12) by names, for one state or a batch; needs mass_matrix and christoffel.

        ``blocks.mass["joint1", "joint2"]`` is a joint's block, ``blocks.christoffel["joint1.x", "joint2.gamma",
        "joint2.gamma"]`` an entry; blocks that vanish identically are absent.  ``blocks.row`` and ``blocks.matrix``
        are the paper's M_i^sv and C_i^svw over all joints.
        """
        mass, christoffel = self.mass_matrix(q), self.christoffel(q)
        survivors = self.raw.libraries.about(name_of(self.christoffel))["survivors"]
        return make_blocks(mass, christoffel, survivors, self.coordinates)

    @property
    def regressor_names(self) -> tuple[str, ...]:
        """Names of the inertial parameters theta, the columns of ``regressor``.

        "link1.m" ... "link1.izz" of each link, "joint1.gamma.armature" and "joint1.motor.inertia" of coordinates.

        Raises:
            UnknownNameError: the kernel was built without the regressor.
        """
        self.raw.function(self.functions.regressor)  # or the error that it is not there
        return tuple(self.raw.libraries.meta["regressor"])

    @property
    def regressor_values(self) -> Array:
        """Inertial parameters theta of the description, (parameters,), kg, kg m, kg m^2; armatures as they are now.

        ``regressor(q, v, a) @ regressor_values`` is inverse dynamics without springs and dampers, loops cut; of links
        that bend without what their modes need.

        Raises:
            UnknownNameError: the kernel was built without the regressor.
            InputError: a run-time parameter of links was changed since.
        """
        names, meta = self.regressor_names, self.raw.libraries.meta
        inertial = self.raw.libraries.about(name_of(self.functions.regressor))["inertial"]
        for name in inertial["come_from"]:
            if self.parameters[name] != meta["parameters"][name]:
                raise InputError(
                    f"regressor_values: {name} is {self.parameters[name]!r} now; allowed: the description's"
                    f" {meta['parameters'][name]!r}"
                )
        defaults = zip(names, inertial["values"], strict=True)
        return np.array([self.parameters.get(f"joints.{name}", value) for name, value in defaults], self.dtype)

    def ratio(self, motor: str) -> float:
        """Return the gear ratio of a motor's coordinate ("joint1.motor") with the kernel's parameters, 1 or rad/m.

        Raises:
            UnknownNameError: no motor of that name.
        """
        if not isinstance(motor, str) or motor not in self._ratios:
            raise UnknownNameError(f"motor: {show(motor)} is unknown; known: {', '.join(self._ratios)}")
        return float(self.parameters.get(f"joints.{motor}.ratio", self._ratios[motor]))

    def followers(self, q: ArrayLike, v: ArrayLike | None = None) -> dict[str, tuple[Array, Array]]:
        """Return positions and velocities of followers in rigid couplings, by name; m or rad, and per second.

        Args:
            q: (n,).
            v: (n,); None: zero.

        Returns:
            Per follower a pair of numbers, or of arrays with the leading axes of q and v.
        """
        here, lead = self.calls.array("q", q, (self.n,))
        rates = np.zeros_like(here) if v is None else self.calls.array("v", v, (self.n,))[0]
        lead = joint_lead("v", rates.shape[:-1], lead)
        here, rates = (np.broadcast_to(x, (*lead, self.n)) for x in (here, rates))
        matrix, offsets = follower_matrix(self)
        pairs = zip(self._followers, matrix.astype(self.dtype), offsets.astype(self.dtype), strict=True)
        moved = {name: (here @ row + offset, rates @ row) for name, row, offset in pairs}
        for name, coupling in self._followers.items():
            for one, other, bend in coupling.get("bends", ()):
                i, j = self.coordinates.index(one), self.coordinates.index(other)
                half, (place, rate) = self.dtype.type(0.5 * bend), moved[name]
                if i != j:
                    half = half + half
                place = place + half * here[..., i] * here[..., j]
                grown = here[..., i] * rates[..., j] + rates[..., i] * here[..., j]
                moved[name] = place, rate + (half * grown)
            if "sliding" in coupling:
                place, rate = moved[name]
                shift, shift_rate = self._on_beam(coupling["sliding"], moved, here, rates)
                moved[name] = place + shift.astype(self.dtype), rate + shift_rate.astype(self.dtype)
        return moved

    def _on_beam(
        self, shapes: Mapping[str, Any], moved: Mapping[str, tuple[Array, Array]], q: Array, v: Array
    ) -> tuple[Array, Array]:
        """Return how a beam's modes move a place on it, and its rate."""

        def of(name: str) -> tuple[Array, Array]:
            at = moved.get(name)
            return at if at is not None else (q[..., i := self.coordinates.index(name)], v[..., i])

        s, s_rate = of(shapes["by"])
        slope = 2.0 / shapes["length"]
        x, x_rate = slope * s - 1.0, slope * s_rate
        place = rate = np.zeros(x.shape)
        for *names, series in (*shapes["first"], *shapes["second"]):
            one, one_rate = of(names[0])
            if len(names) > 1:
                other, other_rate = of(names[1])
                half = 0.5 if names[0] == names[1] else 1.0
                one, one_rate = half * one * other, half * (one_rate * other + one * other_rate)
            value, grown = (np.asarray(chebyshev.chebval(x, c)) for c in (series, chebyshev.chebder(series)))
            place, rate = place + value * one, rate + (value * one_rate + grown * x_rate * one)
        return place, rate


def follower_matrix(kernel: KernelWithMethods) -> tuple[Array, Array]:
    """Return the matrix (followers, n) and offsets (followers,) that map q to positions of followers.

    What nodes of links that bend are drawn in by products of modes is not among them.
    The rows are in the order of ``follower_names``, in the follower's unit per the coordinate's.
    """
    rows, offsets = dict[str, Array](), dict[str, float]()
    for name, coupling in kernel.raw.libraries.meta.get("followers", {}).items():
        prefix, row = f"couplings.{coupling['coupling']}", np.zeros(kernel.n)
        offset = kernel.parameters.get(f"{prefix}.offset", coupling["offset"])
        for other, described in coupling["to"].items():
            ratio = kernel.parameters.get(f"{prefix}.ratio.{other}", described)
            if coupling.get("pitch") in kernel.parameters:
                ratio = 0.5 / np.pi * kernel.parameters[coupling["pitch"]]
            if other in rows:
                row, offset = row + ratio * rows[other], offset + ratio * offsets[other]
            else:
                row[kernel.coordinates.index(other)] += ratio
        rows[name], offsets[name] = row, offset
    return np.array([*rows.values()]).reshape(-1, kernel.n), np.array([*offsets.values()])
