"""Functions of scalars that arithmetic lacks, for the kinds of scalars that forces are written in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..program.ir import CALLS, Graph
from ..tree.spatial import Scalar


@dataclass(frozen=True)
class Functions:
    """Square root, the larger of two, and 1 where greater than 0 else 0, of one kind of scalar."""

    sqrt: Callable[[Scalar], Scalar]
    larger: Callable[[Scalar, Scalar], Scalar]
    step: Callable[[Scalar], Scalar]

    @classmethod
    def of(cls, graph: Graph) -> Functions:
        """Those of a program under construction."""
        return cls(graph.sqrt, graph.max, graph.step)


FLOATS = Functions(CALLS["sqrt"], CALLS["max"], CALLS["step"])
