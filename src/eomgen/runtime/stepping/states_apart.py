"""Rollouts and their derivatives with states of laws apart from coordinates: what goes in, and what comes out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...errors import ArrayError, InputError
from ...names import listed, show
from ..arrays import shape_or_type
from ..calls import Memory
from ..raw import Array

LossApart = Callable[[Array, Array, Array, Array], tuple[Any, ArrayLike, ArrayLike, ArrayLike]]
LABELS = ("dq", "dv", "dz")


def joined_loss(memory: Memory, loss: LossApart) -> Callable[[Array, Array, Array], tuple[Any, Array, Array]]:
    """Return a loss of arrays that have states of laws behind coordinates, of one that takes them apart.

    Args:
        memory: of the kernel.
        loss: (t, q, v, z) -> its value, and derivatives by q, v and z, in their shapes.
    """
    n = memory.coordinates

    def joined(t: Array, q: Array, v: Array) -> tuple[Any, Array, Array]:
        apart = [np.ascontiguousarray(x) for x in (q[..., :n], v[..., :n], v[..., n:])]
        answer = loss(t, *apart)
        if not isinstance(answer, tuple) or len(answer) != 1 + len(LABELS):
            raise InputError(f"loss: it returned {show(answer)}; allowed: (value, {', '.join(LABELS)})")
        value, *by = answer
        arrays = []
        for label, array, of in zip(LABELS, by, apart, strict=True):
            if np.shape(array) != of.shape:
                raise ArrayError(f"loss: {label} has {shape_or_type(array)}; expected shape {of.shape}")
            arrays.append(np.asarray(array))
        by_q, by_v, by_z = arrays
        return value, np.concatenate([by_q, np.zeros_like(by_z)], axis=-1), np.concatenate([by_v, by_z], axis=-1)

    return joined


def gradients_apart(memory: Memory, gradients: Mapping[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
    """Return gradients of coordinates alone, and that by states of laws at the beginning, as ``z``.

    Args:
        names: of the gradients that are by coordinates.
    """
    n = memory.coordinates
    apart = {name: np.ascontiguousarray(x[..., :n]) if name in names else x for name, x in gradients.items()}
    return apart | {"z": np.ascontiguousarray(gradients["v"][..., n:])}


def joined_directions(memory: Memory, along: Mapping[str, ArrayLike]) -> dict[str, ArrayLike]:
    """Return directions of a sensitivity as rates of arrays that have states of laws behind coordinates.

    Args:
        along: rates by names "q", "v" and "u", (directions, n) each, and "z", (directions, memory).

    Raises:
        ArrayError: another shape of those of states.
    """
    if not isinstance(along, Mapping):
        raise InputError(f"along: {show(along)}; allowed: arrays by {listed(('q', 'v', 'u', 'z'))}")
    joined = {name: memory.padded(x) for name, x in along.items() if name != "z"}
    if "z" in along:
        states, _ = memory.calls.array("z", along["z"], (len(memory.names),))
        if states.ndim != 2:
            raise ArrayError(f"along: z has shape {states.shape}; expected (directions, {len(memory.names)})")
        rates = np.zeros((len(states), memory.coordinates), states.dtype) if "v" not in along else along["v"]
        rates = np.asarray(rates)
        expected = (len(states), memory.coordinates)
        if rates.shape != expected:
            raise ArrayError(f"along: v has shape {rates.shape}; expected {expected}, as many directions as z")
        joined["v"] = np.concatenate([rates, states], axis=1)
    return joined


def cut_apart(memory: Memory, q: Array, v: Array) -> tuple[Array, Array, Array]:
    """Return q and v of coordinates alone, and states of laws."""
    n = memory.coordinates
    parts = (q[..., :n], v[..., :n], v[..., n:])
    return tuple(np.ascontiguousarray(x) for x in parts)  # type: ignore[return-value]
