"""Functions with derivatives for tools of learning: of a kernel on the processor, or of a kernel's device."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..codegen.kernels.derived import FRAMED
from ..device.face import Device
from ..errors import ArrayError, InputError
from ..kernel.complete import Kernel
from ..kernel.derivatives.by_arguments import ADJOINT, HESSIAN, TANGENT
from ..names import show
from .mappings import DifferentiableFunction

Array = NDArray[Any]
OF_FRAMES = {f"{name}s": name for name in FRAMED}  # names of derivatives, by methods


class OnProcessor:
    """A function of a kernel with its derivatives, on arrays of NumPy of N states, (N, shape).

    Attributes:
        robot, name: of the robot, and of the function.
        reads, inputs: labels and shapes of one state's arrays.
        output: shape of its result.
        dtype: of all arrays.
    """

    def __init__(self, kernel: Kernel, name: str, frame: str | None, cut: bool) -> None:
        """Take a function by its name.

        Raises:
            UnknownNameError: no function or frame of that name, or a kernel that it takes was not built.
            InputError: a frame is missing or not wanted.
        """
        self._there = DifferentiableFunction(kernel, name, frame, cut=cut)
        self.robot, self.name, self.dtype = kernel.name, name, kernel.dtype
        self.reads, self.inputs, self.output = self._there.reads, self._there.inputs, self._there.output

    def value(self, *arrays: Array) -> Array:
        """Return results."""
        return self._there.value(*arrays)

    def adjoint(self, *arrays: Array) -> Array:
        """Return gradients, (N, total), of results weighted by the last array."""
        *states, weights = arrays
        parts = self._there.gradient(states, weights)
        return np.concatenate([x.reshape(len(weights), -1) for x in parts], axis=1)

    def tangent(self, *arrays: Array) -> Array:
        """Return what results change by along rates of the arguments, which stand behind these."""
        states, rates = arrays[: len(self.reads)], arrays[len(self.reads) :]
        count, size = len(states[0]), math.prod(self.output)
        along = np.concatenate([x.reshape(count, -1) for x in rates], axis=1)
        jacobians = self._there.jacobian(*states).reshape(count, size, along.shape[1])
        moved: Array = (jacobians @ along[..., None]).reshape(count, *self.output)
        return moved

    def hessian(self, *arrays: Array) -> Array:
        """Return second derivatives, (N, total, total), of results weighted by the last array."""
        *states, weights = arrays
        self._there.require_second()
        return self._there.hessian(states, weights)


class OnDevice:
    """A method of a kernel's device, on arrays that lie there; results are written to arrays that callers make.

    Attributes: those of ``OnProcessor``, and
        methods: names of the device's methods, by those of ``OnProcessor``.
    """

    def __init__(self, device: Device, name: str, frame: str | None, cut: bool) -> None:
        """Take a method by its name.

        Raises:
            UnknownNameError, InputError: the device has no such method, or one with several results; or a frame or
                open loops are asked for.
        """
        if frame is not None or cut:
            said = f"frame: {show(frame)}" if frame is not None else "cut: true"
            raise InputError(f"{said}; allowed on devices: none, frame_poses and frame_jacobians have all frames")
        reads, writes = device.shapes(name)
        if len(writes) != 1:
            raise InputError(f"{name}: a rollout, which has no derivatives on devices; allowed: functions of a state")
        self.device, self.robot, self.name = device, device.robot, name
        self.dtype = device.dtype
        self.reads, self.inputs, (self.output,) = tuple(reads), tuple(reads.values()), writes.values()
        base = OF_FRAMES.get(name, name)
        self.methods = {
            "value": name,
            **{
                kind: f"{base}_{end}"
                for kind, end in (("adjoint", ADJOINT), ("tangent", TANGENT), ("hessian", HESSIAN))
            },
        }

    def run(self, kind: str, new: Callable[[tuple[int, ...]], Any], arrays: Sequence[Any]) -> Any:
        """Call one of the methods.

        Args:
            kind: one of ``methods``.
            new: gives an array of a shape for the result, on the device.
            arrays: (N, shape).

        Raises:
            UnknownNameError, InputError: the device has no such method.
        """
        method = self.methods[kind]
        (shape,) = self.device.shapes(method)[1].values()
        out = new((arrays[0].shape[0], *shape))
        getattr(self.device, method)(*arrays, out=out)
        return out


def refuse_shape(label: str, shape: tuple[int, ...], given: tuple[int, ...]) -> None:
    """Raise ArrayError where an array's last axes are not those of one state."""
    if len(given) < len(shape) or given[len(given) - len(shape) :] != shape:
        inner = ", ".join(map(str, shape))
        raise ArrayError(f"{label}: shape {given}; allowed: ({inner}{',' * (len(shape) == 1)}) or (..., {inner})")


def broadcast_axes(label: str, lead: tuple[int, ...], other: tuple[int, ...]) -> tuple[int, ...]:
    """Return leading axes of both; raise ArrayError where they do not go together."""
    length = max(len(lead), len(other))
    one, two = ((1,) * (length - len(x)) + x for x in (lead, other))
    for a, b in zip(one, two, strict=True):
        if a != b and 1 not in (a, b):
            raise ArrayError(f"{label}: leading axes {other} beside {lead}; allowed: those of broadcasting")
    return tuple(b if a == 1 else a for a, b in zip(one, two, strict=True))
