"""Functions with derivatives for tools of learning: of a kernel on the processor, or of a kernel's device."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..device.face import Device
from ..errors import InputError
from ..names import show
from ..runtime.derivatives.by_arguments import ADJOINT, HESSIAN, TANGENT
from ..runtime.kernel import Kernel
from .mappings import DifferentiableFunction

Array = NDArray[Any]
OF_FRAMES = {"frame_poses": "frame_pose", "frame_jacobians": "frame_jacobian"}  # names of derivatives, by methods


class Described(Protocol):
    """What is known of a function: labels and shapes of one state's arrays, its result's shape, and its dtype.

    robot: name of the robot.  place: where its arrays lie, in messages.
    """

    robot: str
    name: str
    place: str
    reads: tuple[str, ...]
    inputs: tuple[tuple[int, ...], ...]
    output: tuple[int, ...]
    dtype: np.dtype[Any]


class Source(Described, Protocol):
    """A function of N states and its derivatives, on arrays (N, shape) in C's order of one library.

    Gradients are flat, (N, total): numbers of all arguments one behind the other.
    """

    def value(self, *arrays: Any) -> Any:
        """Return results."""

    def adjoint(self, *arrays: Any) -> Any:
        """Return gradients, (N, total), of results weighted by the last array."""

    def tangent(self, *arrays: Any) -> Any:
        """Return what results change by along rates of the arguments, which stand behind these."""

    def hessian(self, *arrays: Any) -> Any:
        """Return second derivatives, (N, total, total), of results weighted by the last array."""


def total_of(there: Described) -> int:
    """Return how many numbers the arguments of one state have."""
    return sum(math.prod(shape) for shape in there.inputs)


class OnProcessor:
    """A function of a kernel, on arrays of NumPy.

    Attributes: as of ``Source``.
    """

    place = "the processor"

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
        return (jacobians @ along[..., None]).reshape(count, *self.output)

    def hessian(self, *arrays: Array) -> Array:
        """Return second derivatives, (N, total, total), of results weighted by the last array."""
        *states, weights = arrays
        self._there.require_second()
        return self._there.hessian(states, weights)


class OnDevice:
    """A method of a kernel's device, on arrays that lie there; results are written to arrays that callers make.

    Attributes: as of ``Source``.
        methods: names of the device's methods, by those of ``Source``.
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
        self.device, self.robot, self.name, self.place = device, device.robot, name, device.name
        self.dtype = device.dtype
        self.reads, self.inputs, (self.output,) = tuple(reads), tuple(reads.values()), writes.values()
        base = OF_FRAMES.get(name, name)
        self.methods = {
            "value": name,
            **{kind: f"{base}_{end}" for kind, end in (("adjoint", ADJOINT), ("tangent", TANGENT), ("hessian", HESSIAN))},
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
