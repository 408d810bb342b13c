"""Rules by which a function's Jacobian follows from kernels, in Python and in C.

A rule works on a ``Subject``; its template in ``templates/casadi`` does the same in C.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..runtime.kernel import Kernel

Array = NDArray[Any]


class Subject(Protocol):
    """A function whose derivatives are asked for; ``DifferentiableFunction`` says what its attributes are."""

    kernel: Kernel
    reads: tuple[str, ...]
    inputs: tuple[tuple[int, ...], ...]
    output: tuple[int, ...]
    whole: tuple[int, ...]
    moving: int

    def tangent(self, arrays: Sequence[Array], rates: Sequence[Array]) -> Array:
        """Give what the result changes by along rates of the arguments."""
        ...


class Rule:
    """A way in which the Jacobian follows from kernels.

    Attributes:
        template: file of ``templates/casadi`` with the body of C that computes it.
        kernel: the kernel that writes it, or what it is made of; nothing of a function's tangents.
    """

    template = ""
    kernel = ""

    def derivatives(self, f: Subject, *arrays: Array) -> tuple[Array, ...]:
        """Return derivatives by every argument, (output shape, input shape), behind the batch's axis."""
        raise NotImplementedError

    def patterns(self, f: Subject) -> tuple[Array, list[Array]]:
        """Return the sparsity of the result and its derivatives, True where not always zero; shapes of one state."""
        blocks = [np.ones((*f.output, *shape), np.bool_) for shape in f.inputs]
        for block in blocks:
            block.reshape(math.prod(f.output), -1)[f.moving :] = False
        return np.ones(f.output, np.bool_), blocks

    def reads(self, f: Subject) -> tuple[str, ...]:
        """Return arguments that the C reads."""
        return f.reads

    def spare(self, f: Subject) -> int:
        """Return numbers that the C keeps beside the derivatives."""
        return 0


class ByKernel(Rule):
    """A kernel writes the derivatives, one matrix after the other."""

    template = "by_kernel"

    def __init__(self, kernel: str) -> None:
        self.kernel = kernel

    def derivatives(self, f: Subject, *arrays: Array) -> tuple[Array, ...]:
        jacobians = f.kernel.calls.run(self.kernel, None, arrays)
        count = len(arrays)
        return (jacobians,) if count == 1 else tuple(jacobians[..., i, :, :] for i in range(count))


class ResidualRule(ByKernel):
    """A kernel writes the derivatives by q, v and a; by the drives, which come last, the residual's is -1."""

    template = "with_drives"

    def derivatives(self, f: Subject, *arrays: Array) -> tuple[Array, ...]:
        blocks = super().derivatives(f, *arrays[:-1])
        return (*blocks, np.broadcast_to(-np.eye(f.kernel.n, dtype=f.kernel.dtype), blocks[0].shape))

    def patterns(self, f: Subject) -> tuple[Array, list[Array]]:
        whole, blocks = super().patterns(f)
        return whole, [*blocks[:-1], np.eye(f.kernel.n, dtype=np.bool_)]

    def reads(self, f: Subject) -> tuple[str, ...]:
        return f.reads[:-1]


class MatrixRule(Rule):
    """M_dot = C + C^T, from the Christoffel symbols."""

    template = "by_christoffel"

    def __init__(self, kernel: str) -> None:
        self.kernel = kernel

    def derivatives(self, f: Subject, *arrays: Array) -> tuple[Array, ...]:
        symbols = f.kernel.calls.run(self.kernel, None, arrays)
        return (symbols + np.swapaxes(symbols, -3, -2),)

    def patterns(self, f: Subject) -> tuple[Array, list[Array]]:
        n = f.kernel.n
        blocks, part = f.kernel.blocks(np.zeros(n, f.kernel.dtype)), slice(len(f.kernel.coordinates))
        mass, symbols = np.eye(n, dtype=np.bool_), np.zeros((n, n, n), np.bool_)  # internal states stand by themselves
        mass[part, part], symbols[part, part, part] = blocks.mass.mask, blocks.christoffel.mask
        return mass, [symbols | np.swapaxes(symbols, 0, 1)]

    def spare(self, f: Subject) -> int:
        return f.kernel.n**3


class TangentRule(Rule):
    """A directional derivative per number of the arguments, in Python all in one call."""

    template = "by_tangents"

    def derivatives(self, f: Subject, *arrays: Array) -> tuple[Array, ...]:
        sizes = [math.prod(shape) for shape in f.inputs]
        total = sum(sizes)
        units = np.split(np.eye(total, dtype=f.kernel.dtype), np.cumsum(sizes)[:-1], axis=1)
        rates = [unit.reshape(total, *shape) for unit, shape in zip(units, f.inputs, strict=True)]
        columns = f.tangent(beside(f, arrays), rates)
        lead = columns.ndim - 1 - len(f.output)
        return split(f, np.moveaxis(columns, lead, -1))

    def spare(self, f: Subject) -> int:
        return sum(math.prod(shape) for shape in f.inputs) + math.prod(f.whole)


class EnergyRule(TangentRule):
    """Directional derivatives; of the rates, potential energy has those of internal states alone, kinetic no such."""

    def patterns(self, f: Subject) -> tuple[Array, list[Array]]:
        whole, blocks = super().patterns(f)
        n = len(f.kernel.coordinates)
        blocks[1][0, n:] = blocks[1][1, :n] = False
        return whole, blocks


def beside(f: Subject, arrays: Sequence[Array]) -> list[Array]:
    """Return arguments with one more axis in front of a state's, for many directions."""
    return [x.reshape(*x.shape[: x.ndim - len(s)], 1, *s) for x, s in zip(arrays, f.inputs, strict=True)]


def split(f: Subject, along: Array) -> tuple[Array, ...]:
    """Split the last axis of an array, which has the numbers of all arguments, into one array per argument."""
    ends = np.cumsum([math.prod(shape) for shape in f.inputs])[:-1]
    parts = np.split(along, ends, axis=-1)
    return tuple(block.reshape(*along.shape[:-1], *shape) for block, shape in zip(parts, f.inputs, strict=True))
