"""Functions of scalars that arithmetic lacks, for the kinds of scalars that forces are written in."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from ..program.operations import CALLS
from ..tree.spatial import Scalar


class Functions:
    """Functions of one kind of scalar, by the names of their operations: ``f.sqrt(x)``, ``f.max(x, y)``, ``f.step(x)``.

    call: (name, *arguments) -> value, such as ``Graph.call``.
    """

    def __init__(self, call: Callable[..., Scalar]) -> None:
        self._call = call

    def __getattr__(self, name: str) -> Callable[..., Scalar]:
        if name not in CALLS:
            raise AttributeError(f"{name!r} is no operation; known: {', '.join(CALLS)}")
        return partial(self._call, name)

    def min(self, x: Scalar, y: Scalar) -> Scalar:
        """Return the smaller of x and y; where both are equal, y with its rate."""
        return -self.max(-x, -y)
