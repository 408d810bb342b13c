"""Rules by which a function's Jacobian follows from kernels, in Python and in C.

A rule works on a ``Subject``; its template in ``templates/casadi`` does the same in C.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..kernel.complete import Kernel

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

    def copied(self, f: Subject) -> dict[str, int]:
        """Return where derivatives by each argument begin in what a kernel writes, which has more than these."""
        return {}

    def spare(self, f: Subject) -> int:
        """Return numbers that the C keeps beside the derivatives."""
        return 0


class ByKernel(Rule):
    """A kernel writes the derivatives, one matrix after the other."""

    template = "by_kernel"

    def __init__(self, kernel: str) -> None:
        self.kernel = kernel

    def derivatives(self, f: Subject, *arrays: Array) -> tuple[Array, ...]:
        given, shapes = dict(zip(f.reads, arrays, strict=True)), f.kernel.raw.shapes
        read = [given[x] if x in given else np.zeros(shapes[x], f.kernel.dtype) for x in self.reads(f)]
        jacobians = f.kernel.calls.run(self.kernel, None, read, whole=True)
        if len(arrays) == 1:
            return (jacobians,)
        ends = {x: begin + math.prod(shapes[x]) for x, (_, begin) in self.blocks(f).items()}
        return tuple(jacobians[..., i, : f.output[0], begin : ends[x]] for x, (i, begin) in self.blocks(f).items())

    def reads(self, f: Subject) -> tuple[str, ...]:
        return f.kernel.raw.functions[self.kernel].reads

    def blocks(self, f: Subject) -> dict[str, tuple[int, int]]:
        """Return, by argument, which of the kernel's matrices has the derivatives, and the first of their columns."""
        places = {"q": (0, 0), "v": (1, 0), "z": (1, f.kernel.n)}
        return {x: places.get(x, (2, 0)) for x in f.reads if x in self.reads(f)}

    def copied(self, f: Subject) -> dict[str, int]:
        if not self.spare(f):
            return {}
        _, rows, columns = f.kernel.raw.shapes["derivatives"]
        return {x: i * rows * columns + begin for x, (i, begin) in self.blocks(f).items()}

    def spare(self, f: Subject) -> int:
        return math.prod(f.kernel.raw.shapes["derivatives"]) if "z" in f.reads else 0


class ResidualRule(ByKernel):
    """A kernel writes the derivatives by q, v and a; by the drives, which come last, the residual's is -1."""

    template = "with_drives"

    def derivatives(self, f: Subject, *arrays: Array) -> tuple[Array, ...]:
        blocks = super().derivatives(f, *arrays)
        return (*blocks, np.broadcast_to(-np.eye(f.kernel.n, dtype=f.kernel.dtype), blocks[0].shape))

    def patterns(self, f: Subject) -> tuple[Array, list[Array]]:
        whole, blocks = super().patterns(f)
        return whole, [*blocks[:-1], np.eye(f.kernel.n, dtype=np.bool_)]


class MatrixRule(Rule):
    """M_dot = C + C^T, from the Christoffel symbols."""

    template = "by_christoffel"

    def __init__(self, kernel: str) -> None:
        self.kernel = kernel

    def derivatives(self, f: Subject, *arrays: Array) -> tuple[Array, ...]:
        symbols = f.kernel.calls.run(self.kernel, None, arrays)
        return (symbols + np.swapaxes(symbols, -3, -2),)

    def patterns(self, f: Subject) -> tuple[Array, list[Array]]:
        blocks = f.kernel.blocks(np.zeros(f.kernel.n, f.kernel.dtype))
        symbols = blocks.christoffel.mask
        return blocks.mass.mask, [symbols | np.swapaxes(symbols, 0, 1)]

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
    """Directional derivatives; kinetic energy has none by internal states, potential energy none by velocities."""

    def patterns(self, f: Subject) -> tuple[Array, list[Array]]:
        whole, blocks = super().patterns(f)
        for label, block in zip(f.reads, blocks, strict=True):
            block[{"v": 1, "z": 0}.get(label, slice(0)), :] = False
        return whole, blocks


def beside(f: Subject, arrays: Sequence[Array]) -> list[Array]:
    """Return arguments with one more axis in front of a state's, for many directions."""
    return [x.reshape(*x.shape[: x.ndim - len(s)], 1, *s) for x, s in zip(arrays, f.inputs, strict=True)]


def split(f: Subject, along: Array) -> tuple[Array, ...]:
    """Split the last axis of an array, which has the numbers of all arguments, into one array per argument."""
    ends = np.cumsum([math.prod(shape) for shape in f.inputs])[:-1]
    parts = np.split(along, ends, axis=-1)
    return tuple(block.reshape(*along.shape[:-1], *shape) for block, shape in zip(parts, f.inputs, strict=True))
