"""Rules by which first derivatives of a kernel's function follow from other kernels, in Python and in C.

A rule works on a ``Subject``; its template in ``templates/casadi`` does the same in C.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..robot.laws import number_of
from ..runtime.kernel import Kernel
from .frames import jacobian_derivative, pose_derivative

Array = NDArray[Any]


class Subject(Protocol):
    """A function whose derivatives are asked for; ``DifferentiableFunction`` says what its attributes are."""

    kernel: Kernel
    name: str
    calls: str
    frame: str | None
    reads: tuple[str, ...]
    inputs: tuple[tuple[int, ...], ...]
    output: tuple[int, ...]
    idle: tuple[str, ...]
    free: Kernel | None


class Rule:
    """A way in which derivatives follow from kernels.

    Attributes:
        template: file of ``templates/casadi`` with the body of C that computes them.
        kernel: the kernel that writes them all, or nothing.
        framed: whether the function is one of a frame.
        needs_free: whether the kernel without any force is needed.
        writes: shape of the result, by its name in a kernel's ``shapes``, where it is a part of what a kernel writes.
    """

    writes = ""
    template = ""
    kernel = ""
    framed = False
    needs_free = False

    def derivatives(self, f: Subject, *arrays: Array) -> tuple[Array, ...]:
        """Derivatives by every argument, (output shape, input shape), behind the batch's axis."""
        raise NotImplementedError

    def patterns(self, f: Subject) -> tuple[Array, list[Array]]:
        """Sparsity of the result and its derivatives: True where they may differ from zero, shapes as of one state."""
        return np.ones(f.output, np.bool_), [np.ones((*f.output, *shape), np.bool_) for shape in f.inputs]

    def first(self, f: Subject) -> int:
        """Place of the result in what the kernel writes."""
        return 0

    def part(self, f: Subject, written: Array) -> Array:
        """The result, of what the kernel writes."""
        return written

    def reads(self, f: Subject) -> tuple[str, ...]:
        """Arguments that the C reads."""
        return f.reads

    def spare(self, f: Subject) -> int:
        """Numbers that the C keeps beside the derivatives."""
        return 0


class ByKernel(Rule):
    """A kernel writes the derivatives, one matrix after the other."""

    template = "by_kernel"

    def __init__(self, kernel: str) -> None:
        self.kernel = kernel

    def derivatives(self, f: Subject, *arrays: Array) -> tuple[Array, ...]:
        found = f.kernel.calls.run(self.kernel, None, arrays)
        count = len(arrays)
        return (found,) if count == 1 else tuple(found[..., i, :, :] for i in range(count))


class ResidualRule(ByKernel):
    """A kernel writes the derivatives by q, v and a; by the drives, which come last, the residual's is -1."""

    template = "residual"

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

    template = "mass_matrix"

    def derivatives(self, f: Subject, *arrays: Array) -> tuple[Array, ...]:
        symbols = f.kernel.christoffel(*arrays)
        return (symbols + np.swapaxes(symbols, -3, -2),)

    def patterns(self, f: Subject) -> tuple[Array, list[Array]]:
        found = f.kernel.blocks(np.zeros(f.kernel.n, f.kernel.dtype))
        symbols = found.christoffel.mask
        return found.mass.mask, [symbols | np.swapaxes(symbols, 0, 1)]

    def spare(self, f: Subject) -> int:
        return f.kernel.n**3


class BiasRule(Rule):
    """The residual's derivatives at rest, of the kernel without any force."""

    template = "bias_force"
    needs_free = True

    def derivatives(self, f: Subject, *arrays: Array) -> tuple[Array, ...]:
        assert f.free is not None
        return f.free.residual_jacobian(arrays[0], arrays[1], np.zeros_like(arrays[0]))[:2]

    def spare(self, f: Subject) -> int:
        return f.kernel.n


class ForceRule(BiasRule):
    """Derivatives of the residual without forces less those with them."""

    template = "generalized_force"

    def derivatives(self, f: Subject, *arrays: Array) -> tuple[Array, ...]:
        whole = f.kernel.residual_jacobian(arrays[0], arrays[1], np.zeros_like(arrays[0]))[:2]
        return tuple(
            free - with_forces for free, with_forces in zip(super().derivatives(f, *arrays), whole, strict=True)
        )

    def spare(self, f: Subject) -> int:
        return 3 * f.kernel.n**2


class TangentRule(Rule):
    """A directional derivative per number of the arguments, in Python all in one call."""

    template = "by_tangents"

    def derivatives(self, f: Subject, *arrays: Array) -> tuple[Array, ...]:
        sizes = [math.prod(shape) for shape in f.inputs]
        lead = np.broadcast_shapes(*(x.shape[: x.ndim - len(s)] for x, s in zip(arrays, f.inputs, strict=True)))
        total, count = sum(sizes), math.prod(lead)
        states, directions = [], []
        unit = np.split(np.eye(total, dtype=f.kernel.dtype), np.cumsum(sizes)[:-1], axis=1)
        for array, shape, part in zip(arrays, f.inputs, unit, strict=True):
            whole = np.broadcast_to(array, (*lead, *shape)).reshape(count, 1, *shape)
            states.append(np.repeat(whole, total, axis=1).reshape(-1, *shape))
            directions.append(np.tile(part, (count, 1)).reshape(-1, *shape))
        written = self.part(f, f.kernel.tangent(f.calls, *states, *nothing(f), *directions, *nothing(f)))
        found = written.reshape(*lead, total, *f.output)
        blocks = np.split(np.moveaxis(found, len(lead), -1), np.cumsum(sizes)[:-1], axis=-1)
        return tuple(b.reshape(*b.shape[:-1], *shape) for b, shape in zip(blocks, f.inputs, strict=True))

    def spare(self, f: Subject) -> int:
        return sum(math.prod(shape) for shape in f.inputs) + math.prod(
            f.kernel.raw.shapes[f.kernel.raw.functions[f.calls].writes]
        )


class ConstrainedRule(TangentRule):
    """A part of what constrained_dynamics or constrained_drives writes, whatever the gaps are.

    That is accelerations or drives, or multipliers.

    Args:
        writes: "vector" for the former, "constraints" for multipliers.
        place: 0 for the former, 1 for the latter.
    """

    def __init__(self, writes: str, place: int) -> None:
        self.writes, self.place = writes, place

    def first(self, f: Subject) -> int:
        return f.kernel.n * self.place

    def part(self, f: Subject, written: Array) -> Array:
        return np.ascontiguousarray(written[..., self.first(f) : self.first(f) + f.output[0]])


class EnergyRule(TangentRule):
    """Directional derivatives; potential energy does not change with the rates."""

    def patterns(self, f: Subject) -> tuple[Array, list[Array]]:
        whole, blocks = super().patterns(f)
        blocks[1][1] = False
        return whole, blocks


class PoseRule(Rule):
    """A frame's pose turns about its Jacobian's angular rows and moves along the linear ones."""

    template = "frame_pose"
    framed = True

    def derivatives(self, f: Subject, *arrays: Array) -> tuple[Array, ...]:
        assert f.frame is not None
        pose, jacobian = f.kernel.frame_pose(arrays[0], f.frame), f.kernel.frame_jacobian(arrays[0], f.frame)
        return (pose_derivative(pose, jacobian),)

    def patterns(self, f: Subject) -> tuple[Array, list[Array]]:
        whole, blocks = super().patterns(f)
        blocks[0][3] = False  # the last row is constant
        return whole, blocks

    def spare(self, f: Subject) -> int:
        return 6 * f.kernel.n + 16


class FrameJacobianRule(Rule):
    """A coordinate turns and moves the axes of those behind it."""

    template = "frame_jacobian"
    framed = True

    def derivatives(self, f: Subject, *arrays: Array) -> tuple[Array, ...]:
        assert f.frame is not None
        return (jacobian_derivative(f.kernel.frame_jacobian(arrays[0], f.frame)),)

    def spare(self, f: Subject) -> int:
        return 6 * f.kernel.n


def nothing(f: Subject) -> list[Array]:
    """Arrays of 0 that a function's kernel reads behind its arguments."""
    return [np.zeros(f.kernel.raw.shapes[label], f.kernel.dtype) for label in f.idle]


def without_forces(kernel: Kernel) -> Kernel:
    """The kernel without gravity and with all laws idle, so that its residual is M a + bias.

    Raises:
        InputError: a force is no run-time parameter.
    """
    numbers = {name: number_of(name) for name in kernel.parameters}
    idle = {name: number.idle for name, number in numbers.items() if number is not None}
    idle |= dict.fromkeys((name for name in kernel.parameters if name.startswith("gravity.")), 0.0)
    free = kernel.with_parameters({name: value for name, value in idle.items() if value is not None})
    rng = np.random.default_rng(0)
    states = rng.uniform(-1.0, 1.0, (2, 8, kernel.n)).astype(kernel.dtype)
    forces = free.generalized_force(*states)
    if np.any(forces != 0.0):
        place = kernel.coordinates[int(np.argwhere(forces != 0.0)[0][1])]
        raise InputError(
            f"{kernel.name}: a force at {place} is no run-time parameter, so that bias_force and generalized_force have"
            " no exact derivatives here; allowed: residual, inverse_dynamics, forward_dynamics"
        )
    return free
