"""Kernels as functions of PyTorch with exact first and second derivatives; needs the extra "torch".

Operators of ``torch.library`` on tensors of the processor (``function(kernel, ...)``) or of an accelerator, which
nothing leaves (``function(kernel.device("cuda"), ...)``).  Under ``autograd``, ``torch.func`` in reverse mode, ``vmap``
and ``torch.compile``, in whose graphs they stand as they are.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..device.face import Device
from ..errors import ArrayError, InputError
from ..kernel.complete import Kernel
from ..optional import optional_import
from .mappings import FUNCTIONS, kernels_for
from .sources import OnDevice, OnProcessor, broadcast_axes, refuse_shape

_NUMBERS = itertools.count()  # of functions, whose operators have names of their own


def function(kernel: Kernel | Device, name: str, frame: str | None = None, *, cut: bool = False) -> Callable[..., Any]:
    """Return a differentiable function of PyTorch's tensors, of one state or of many along leading axes.

    Of a kernel, parameters are those that it has now; of a device they are its kernel's, also when they change, and
    work goes to PyTorch's current stream.  What they refuse is raised here, too; ``device.checks = False`` lets calls
    return at once.  Operators live as long as the process.

    Args:
        kernel: with ``kernels_for(name)``, for tensors on the processor; or ``kernel.device("cuda")``, for those there.
        name: of a kernel one of FUNCTIONS, "forward_dynamics", "residual", "mass_matrix", ...; of a device one of
            ``device.functions`` with one result.
        frame: of frame_pose and frame_jacobian of a kernel; a device's frame_poses and frame_jacobians have all.
        cut: of a kernel of a robot with loops, that its loops are meant to be open.

    Returns:
        A function of the arrays that the kernel's or the device's function reads, (n,) or (..., n) each (wrench:
        (..., links, 6)), leading axes as of broadcasting, with the kernel's dtype.  It raises ArrayError for other
        shapes, dtypes and places, and UnknownNameError or InputError where a derivative is asked for that there is
        not; third ones are refused by PyTorch.

    Raises:
        UnknownNameError: no function or frame of that name, or a kernel that it takes was not built.
        InputError: PyTorch is not installed, or another argument cannot be used.
    """
    with optional_import("torch", "functions of PyTorch need"):
        import torch
    there: OnProcessor | OnDevice
    there = (OnDevice if isinstance(kernel, Device) else OnProcessor)(kernel, name, frame, cut)  # type: ignore[arg-type]
    operators = Operators(torch, there)
    dtype = getattr(torch, there.dtype.name)

    def checked(*tensors: Any) -> Any:
        if len(tensors) != len(there.reads):
            raise InputError(f"{name}: got {len(tensors)} tensors; allowed: {', '.join(there.reads)}")
        lead: tuple[int, ...] = ()
        for label, shape, x in zip(there.reads, there.inputs, tensors, strict=True):
            _refuse(torch, label, shape, dtype, x)
            lead = broadcast_axes(label, lead, tuple(x.shape[: x.dim() - len(shape)]))
        count = math.prod(lead)
        rows = (x.expand(*lead, *shape).reshape(count, *shape) for x, shape in zip(tensors, there.inputs, strict=True))
        compute = operators.compiled if torch.compiler.is_compiling() else operators.value
        return compute(*rows).reshape(*lead, *there.output)

    checked.__name__ = name
    checked.__doc__ = f"{name}({', '.join(there.reads)}) of {there.robot}; see eomgen.adapters.torch.function."
    return checked


class Operators:
    """Operators of a function: ``value`` has the gradient ``adjoint``, and that one ``hessian`` and ``tangent``.

    Each takes tensors of N states, (N, shape).  ``compiled`` is ``value`` for graphs of ``torch.compile``, which asks
    for an operator, as ``torch.func`` asks for a Function of autograd.
    """

    def __init__(self, torch: Any, there: OnProcessor | OnDevice) -> None:
        """Make them known to PyTorch."""
        self._torch, self._there = torch, there
        self._sizes = [math.prod(shape) for shape in there.inputs]
        self._title = re.sub(r"\W", "_", f"{there.robot}_{there.name}_{next(_NUMBERS)}")
        reads, total = there.reads, sum(self._sizes)
        self.compiled = self._operator("value", reads, there.output)
        adjoint = self._operator("adjoint", (*reads, "weights"), (total,))
        self.tangent = self._operator("tangent", (*reads, *(f"d{x}" for x in reads)), there.output)
        self.hessian = self._operator("hessian", (*reads, "weights"), (total, total))

        def gradients(by: Callable[..., Any]) -> Callable[..., Any]:
            return lambda kept, weights: tuple(self._split(by(*kept.saved_tensors, weights)))

        self.compiled.register_autograd(gradients(adjoint), setup_context=_keep)
        self.adjoint = self._with_gradient(adjoint, self._second_gradients)
        self.value = self._with_gradient(self.compiled, gradients(self.adjoint))

    def _operator(self, kind: str, labels: Sequence[str], shape: tuple[int, ...]) -> Any:
        """Return an operator, with its shape for compilers and its rule under vmap."""

        def call(*tensors: Any) -> Any:
            return self._run(kind, [x.detach().contiguous() for x in tensors])

        def empty(*tensors: Any) -> Any:
            return tensors[0].new_empty((tensors[0].shape[0], *shape))

        def many(about: Any, axes: Sequence[int | None], *tensors: Any) -> Any:
            return _folded(made, about.batch_size, axes, tensors)

        words = ", ".join(f"Tensor {label}" for label in labels)
        library = self._torch.library
        made = library.custom_op(f"eomgen::{self._title}_{kind}", call, mutates_args=(), schema=f"({words}) -> Tensor")
        made.register_fake(empty)
        made.register_vmap(many)
        return made

    def _with_gradient(self, operator: Any, back: Callable[..., Any]) -> Callable[..., Any]:
        """Return an operator as a Function of autograd."""

        def many(about: Any, axes: Sequence[int | None], *tensors: Any) -> Any:
            return _folded(of.apply, about.batch_size, axes, tensors)

        body = {"forward": operator.__call__, "setup_context": _keep, "backward": back, "vmap": many}
        parts = {name: staticmethod(part) for name, part in body.items()}
        of: Any = type("Function", (self._torch.autograd.Function,), parts)
        return of.apply  # type: ignore[no-any-return,unused-ignore]

    def _run(self, kind: str, tensors: Sequence[Any]) -> Any:
        there = self._there
        if isinstance(there, OnDevice):
            return there.run(kind, tensors[0].new_empty, tensors)
        for label, x in zip(there.reads, tensors, strict=False):
            if x.device.type != "cpu":
                raise ArrayError(
                    f"{label}: a tensor on {x.device}; allowed: on the processor, or a function of a kernel's device"
                )
        return self._torch.from_numpy(np.ascontiguousarray(getattr(there, kind)(*(x.numpy() for x in tensors))))

    def _split(self, flat: Any) -> list[Any]:
        parts = flat.split(self._sizes, 1)
        return [x.reshape(len(flat), *shape) for x, shape in zip(parts, self._there.inputs, strict=True)]

    def _second_gradients(self, kept: Any, along: Any) -> Any:
        *states, weights = kept.saved_tensors
        by_states = (along.unsqueeze(1) @ self.hessian(*states, weights)).squeeze(1)
        return (*self._split(by_states), self.tangent(*states, *self._split(along)))


def _folded(call: Callable[..., Any], count: int, axes: Sequence[int | None], tensors: Sequence[Any]) -> Any:
    """Call an operator under vmap: states of all in one axis; return its result and that axis."""
    moved = [
        x.unsqueeze(0).expand(count, *x.shape) if axis is None else x.movedim(axis, 0)
        for x, axis in zip(tensors, axes, strict=True)
    ]
    return call(*(x.flatten(0, 1) for x in moved)).unflatten(0, moved[0].shape[:2]), 0


def _keep(ctx: Any, inputs: Sequence[Any], output: Any) -> None:
    ctx.save_for_backward(*inputs)


def _refuse(torch: Any, label: str, shape: tuple[int, ...], dtype: Any, x: Any) -> None:
    """Raise ArrayError for what is no tensor, or one of another shape or dtype."""
    if not isinstance(x, torch.Tensor):
        kind = type(x)
        raise ArrayError(f"{label}: got {kind.__module__}.{kind.__qualname__}; allowed: a tensor of PyTorch")
    if x.dtype != dtype:
        raise ArrayError(f"{label}: dtype {x.dtype}; allowed: {dtype}")
    refuse_shape(label, shape, tuple(x.shape))


__all__ = ["FUNCTIONS", "function", "kernels_for"]
