"""Kernels as differentiable functions of arrays: which there are, and their exact first derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, UnknownNameError
from ..robot.laws import number_of
from ..runtime.kernel import Kernel

Array = NDArray[Any]
FRAMES = ("frame_pose", "frame_jacobian")


@dataclass(frozen=True)
class Entry:
    """Arrays that a function reads, the name of its result, and the kernels that it and its derivatives take."""

    reads: tuple[str, ...]
    result: str
    kernels: tuple[str, ...]


FUNCTIONS: Mapping[str, Entry] = MappingProxyType(
    {
        "residual": Entry(("q", "v", "a", "u"), "r", ("residual", "residual_jacobian")),
        "inverse_dynamics": Entry(("q", "v", "a"), "u", ("inverse_dynamics", "residual_jacobian")),
        "forward_dynamics": Entry(("q", "v", "u"), "a", ("forward_dynamics", "forward_dynamics_jacobian")),
        "mass_matrix": Entry(("q",), "M", ("mass_matrix", "christoffel")),
        "bias_force": Entry(("q", "v"), "b", ("bias_force", "generalized_force", "residual_jacobian")),
        "generalized_force": Entry(("q", "v"), "Q", ("generalized_force", "residual_jacobian")),
        "external_force": Entry(("q", "wrench"), "Q", ("external_force", "external_force_tangent")),
        "energy": Entry(("q", "v"), "E", ("energy", "energy_tangent")),
        "frame_pose": Entry(("q",), "A", ("kinematics",)),
        "frame_jacobian": Entry(("q",), "J", ("kinematics",)),
        "constraint": Entry(("q",), "g", ("constraint", "constraint_jacobian")),
    }
)


def kernels_for(*names: str) -> tuple[str, ...]:
    """Names of the kernels that these functions and their derivatives need, for ``eomgen.build(robot, kernels=...)``.

    Raises:
        UnknownNameError: not one of FUNCTIONS.
    """
    return tuple(dict.fromkeys(kernel for name in names for kernel in _entry(name).kernels))


def _entry(name: str) -> Entry:
    if name not in FUNCTIONS:
        raise UnknownNameError(f"function: {name!r} is unknown; allowed: {', '.join(FUNCTIONS)}")
    return FUNCTIONS[name]


class DifferentiableFunction:
    """A kernel's function with its derivatives, on NumPy arrays; the parameters are those that the kernel has now.

    Attributes:
        kernel: with parameters of its own.
        name: one of FUNCTIONS.
        frame: of frame_pose and frame_jacobian.
        reads, result: names of what it takes and of what it gives.
        inputs: shapes of what it takes; output: that of its result.
        free: of bias_force and generalized_force the kernel without any force; else None.

    Raises:
        UnknownNameError: no function or frame of that name, or a kernel that it takes was not built.
        InputError: a frame is missing or not wanted; the robot has loops that are not to be open.
    """

    def __init__(self, kernel: Kernel, name: str, frame: str | None = None, *, cut: bool = False) -> None:
        entry = _entry(name)
        missing = [needed for needed in entry.kernels if needed not in kernel.operations]
        if missing:
            raise UnknownNameError(
                f"{name}: {kernel.name} was built without {', '.join(missing)}; allowed: kernels={entry.kernels!r}"
            )
        if (name in FRAMES) != (frame is not None):
            wanted = f"one of {', '.join(kernel.frames)}" if name in FRAMES else "none"
            raise InputError(f"frame: {name} got {frame!r}; allowed: {wanted}")
        if name == "forward_dynamics":
            kernel.refuse_loops(name, cut=cut)
        if frame is not None:
            kernel._frame(frame)
        self.kernel, self.name, self.frame = kernel.with_parameters(), name, frame
        self.reads, self.result = entry.reads, entry.result
        n = kernel.n
        self.inputs: tuple[tuple[int, ...], ...] = tuple(
            (len(kernel.links), 6) if label == "wrench" else (n,) for label in entry.reads
        )
        self.output: tuple[int, ...] = {
            "mass_matrix": (n, n),
            "energy": (2,),
            "frame_pose": (4, 4),
            "frame_jacobian": (6, n),
            "constraint": (len(kernel.constraints),),
        }.get(name, (n,))
        self.free = _without_forces(self.kernel) if name in ("bias_force", "generalized_force") else None

    def value(self, *arrays: Array) -> Array:
        """The kernel's result, for one state or a batch."""
        call = getattr(self.kernel, self.name)
        if self.name == "forward_dynamics":
            return np.asarray(call(*arrays, cut=True))
        return np.asarray(call(*arrays) if self.frame is None else call(*arrays, self.frame))

    def derivatives(self, *arrays: Array) -> tuple[Array, ...]:
        """Exact derivatives by every argument: (output shape, input shape), behind the batch's axis."""
        kernel = self.kernel
        if self.name in ("residual", "inverse_dynamics"):
            blocks = kernel.residual_jacobian(arrays[0], arrays[1], arrays[2])
            minus = np.broadcast_to(-np.eye(kernel.n, dtype=kernel.dtype), blocks[0].shape)
            return (*blocks, minus) if self.name == "residual" else blocks
        if self.name == "forward_dynamics":
            return kernel.forward_dynamics_jacobian(arrays[0], arrays[1], arrays[2], cut=True)
        if self.name == "mass_matrix":  # M_dot = C + C^T
            symbols = kernel.christoffel(*arrays)
            return (symbols + np.swapaxes(symbols, -3, -2),)
        if self.free is not None:
            zero = np.zeros_like(arrays[0])
            moving = self.free.residual_jacobian(arrays[0], arrays[1], zero)[:2]
            if self.name == "bias_force":
                return moving
            whole = kernel.residual_jacobian(arrays[0], arrays[1], zero)[:2]
            return tuple(m - w for m, w in zip(moving, whole, strict=True))
        if self.name in ("external_force", "energy"):
            return self._by_tangents(*arrays)
        if self.name == "constraint":
            return (kernel.constraint_jacobian(*arrays),)
        assert self.frame is not None
        J = kernel.frame_jacobian(arrays[0], self.frame)
        if self.name == "frame_jacobian":
            return (jacobian_derivative(J),)
        return (pose_derivative(kernel.frame_pose(arrays[0], self.frame), J),)

    def _by_tangents(self, *arrays: Array) -> tuple[Array, ...]:
        """A directional derivative per number of the arguments, all in one call."""
        sizes = [int(np.prod(shape)) for shape in self.inputs]
        lead = np.broadcast_shapes(*(x.shape[: x.ndim - len(s)] for x, s in zip(arrays, self.inputs, strict=True)))
        total, count = sum(sizes), int(np.prod(lead))
        states, directions = [], []
        unit = np.split(np.eye(total, dtype=self.kernel.dtype), np.cumsum(sizes)[:-1], axis=1)
        for array, shape, part in zip(arrays, self.inputs, unit, strict=True):
            whole = np.broadcast_to(array, (*lead, *shape)).reshape(count, 1, *shape)
            states.append(np.repeat(whole, total, axis=1).reshape(-1, *shape))
            directions.append(np.tile(part, (count, 1)).reshape(-1, *shape))
        found = self.kernel.tangent(self.name, *states, *directions).reshape(*lead, total, *self.output)
        blocks = np.split(np.moveaxis(found, len(lead), -1), np.cumsum(sizes)[:-1], axis=-1)
        return tuple(b.reshape(*b.shape[:-1], *shape) for b, shape in zip(blocks, self.inputs, strict=True))

    def patterns(self) -> tuple[Array, tuple[Array, ...]]:
        """Sparsity of the result and its derivatives: True where they may differ from zero, shapes as of one state."""
        whole = np.ones(self.output, np.bool_)
        blocks = [np.ones((*self.output, *shape), np.bool_) for shape in self.inputs]
        if self.name == "residual":
            blocks[3] = np.eye(self.kernel.n, dtype=np.bool_)
        elif self.name == "mass_matrix":
            found = self.kernel.blocks(np.zeros(self.kernel.n, self.kernel.dtype))
            symbols = found.christoffel.mask
            whole, blocks = found.mass.mask, [symbols | np.swapaxes(symbols, 0, 1)]
        elif self.name == "frame_pose":
            blocks[0][3] = False
        elif self.name == "energy":
            blocks[1][1] = False
        return whole, tuple(blocks)


def pose_derivative(A: Any, J: Any, xp: Any = np) -> Any:
    """dA/dq of a frame, (..., 4, 4, n), from its pose (..., 4, 4) and Jacobian (..., 6, n); xp: NumPy or its like."""
    turns = xp.swapaxes(J[..., 3:, :], -1, -2)  # (..., n, 3)
    columns = xp.swapaxes(A[..., :3, :3], -1, -2)  # (..., 3 columns, 3)
    by_turn = xp.cross(turns[..., None, :, :], columns[..., :, None, :])  # (..., column, n, 3)
    moved = xp.concatenate([by_turn, xp.swapaxes(J[..., :3, :], -1, -2)[..., None, :, :]], axis=-3)
    rows = xp.moveaxis(moved, -1, -3)  # (..., 3, 4, n)
    return xp.concatenate([rows, xp.zeros_like(rows[..., :1, :, :])], axis=-3)


def jacobian_derivative(J: Any, xp: Any = np) -> Any:
    """dJ/dq of a frame, (..., 6, n, n), the last axis by q, from J (..., 6, n) alone.

    A coordinate turns and moves the axes of those behind it, and coordinates are in the order of the chain.
    """
    n = J.shape[-1]
    column, by = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    near, far = np.minimum(column, by), np.maximum(column, by)
    moves, turns = (xp.swapaxes(J[..., rows, :], -1, -2) for rows in (slice(0, 3), slice(3, 6)))
    linear = xp.cross(turns[..., near, :], moves[..., far, :])
    angular = xp.cross(turns[..., by, :], turns[..., column, :]) * (by < column)[..., None]
    return xp.moveaxis(xp.concatenate([linear, angular], axis=-1), -1, -3)


def _without_forces(kernel: Kernel) -> Kernel:
    """The kernel without gravity and with all laws idle, so that its residual is M a + bias."""
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
