"""Kernels as differentiable functions of arrays: which there are, and their exact first and second derivatives."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..codegen.kernels.derived import FRAMED
from ..codegen.kernels.groups import DIFFERENTIABLE
from ..codegen.kernels.signatures import CLOSED_PROGRAMS, FRAME_KERNEL, KERNELS
from ..errors import InputError, UnknownNameError
from ..kernel.complete import Kernel
from ..kernel.derivatives.by_arguments import ADJOINT, HESSIAN, TANGENT
from ..names import show
from ..runtime.bound import frame_number
from . import rules

Array = NDArray[Any]


_TANGENTS = rules.TangentRule()


@dataclass(frozen=True)
class Entry:
    """A function of FUNCTIONS.

    calls: the kernel's function whose result, or a block of whose result, it is.
    reads: arrays that it reads.
    result: name of its result.
    rule: how its Jacobian follows from kernels.
    block: shape of the result, where it is a block, and 1 if that stands behind all rates, else 0.
    flat: pairs of arguments: derivatives by one do not change with the other.
    """

    calls: str
    reads: tuple[str, ...]
    result: str
    rule: rules.Rule = _TANGENTS
    block: tuple[str, int] | None = None
    flat: tuple[tuple[str, str], ...] = ()

    @property
    def kernels(self) -> tuple[str, ...]:
        """Kernels that it and its Jacobian take."""
        return FRAME_KERNEL if self.calls in FRAMED else self.calls, self.rule.kernel or f"{self.calls}_tangent"

    @property
    def second(self) -> tuple[str, ...]:
        """Kernels that gradients and second derivatives take."""
        return tuple(f"{self.calls}_{kind}" for kind in (ADJOINT, HESSIAN))


_SIGNATURES = {**KERNELS, **KERNELS[FRAME_KERNEL].functions}


def _own(name: str) -> Entry:
    """Return the function that has the name of the kernel's; of one that calls a program, the block of its result."""
    signature, known = _SIGNATURES[name], DIFFERENTIABLE[name]
    if signature.calls:
        [program] = signature.calls
        return Entry(program, signature.reads, known.symbol, block=(signature.writes, 1))
    return Entry(name, signature.reads, known.symbol, _rule(name), flat=known.flat)


def _rule(name: str) -> rules.Rule:
    """Return how a function's Jacobian follows from kernels."""
    signature, jacobian = _SIGNATURES[name], DIFFERENTIABLE[name].jacobian
    if not jacobian:
        return rules.EnergyRule() if signature.writes == "pair" else _TANGENTS
    if signature.symmetric:
        return rules.MatrixRule(jacobian)
    by_all = len(_SIGNATURES[jacobian].reads) == len(signature.reads)
    return (rules.ByKernel if by_all else rules.ResidualRule)(jacobian)


_TREES = {_SIGNATURES[name].tree: name for name in DIFFERENTIABLE if _SIGNATURES[name].tree}
FUNCTIONS: Mapping[str, Entry] = MappingProxyType(
    {name: _own(name) for name in DIFFERENTIABLE if name not in _TREES},
)
CLOSED: Mapping[str, Entry] = MappingProxyType(  # in their place where a robot has loops or rigid couplings
    {
        name: Entry(program, KERNELS[name].reads, DIFFERENTIABLE[name].symbol, block=(KERNELS[name].writes, 0))
        for name, program in CLOSED_PROGRAMS.items()
    }
)
CUT: Mapping[str, Entry] = MappingProxyType({name: _own(tree) for tree, name in _TREES.items()})  # where these are open
ORDERS = (1, 2)


def kernels_for(*names: str, closed: bool = False, cut: bool = False, order: int = 2) -> tuple[str, ...]:
    """Return names of the kernels that functions and their derivatives need, for ``eomgen.build(robot, kernels=...)``.

    Args:
        names: of FUNCTIONS.
        closed: of a robot with loops or rigid couplings.
        cut: of one whose loops are meant to be open.
        order: of the derivatives, 1 or 2.

    Raises:
        UnknownNameError: not one of FUNCTIONS.
        InputError: another order.
    """
    check_order(order)
    needed: dict[str, None] = {}
    for name in names:
        entry = _entry(name, closed or cut, cut)
        needed |= dict.fromkeys((*entry.kernels, *(entry.second if order == 2 else ())))
    return tuple(needed)


def check_order(order: int) -> None:
    """Refuse an order of derivatives that there is not.

    Raises:
        InputError: it is not one of ORDERS.
    """
    if order not in ORDERS:
        raise InputError(f"order: {show(order)} is no order of derivatives here; allowed: 1, 2")


def _entry(name: str, closed: bool, cut: bool) -> Entry:
    if name not in FUNCTIONS:
        raise UnknownNameError(f"function: {name!r} is unknown; allowed: {', '.join(FUNCTIONS)}")
    others: Mapping[str, Entry] = (CUT if cut else CLOSED) if closed else {}
    return others.get(name, FUNCTIONS[name])


class DifferentiableFunction:
    """A kernel's function with its derivatives, on NumPy arrays; the parameters are those that the kernel has now.

    Where the result depends on internal states, z is read behind v; forward dynamics give accelerations, then
    derivatives of z.  There are no forces beside drives with states.

    Attributes:
        kernel: with separate parameters.
        name: one of FUNCTIONS.
        frame: of frame_pose and frame_jacobian.
        kernels: what it and its Jacobian take; second: what gradients and second derivatives take.
        rule: how the Jacobian follows.
        calls: the kernel's function that has the result, or more than that.
        reads, result: names of what it takes and of what it gives.
        inputs: shapes of what it takes; output: that of its result.
        idle: what the kernel's function reads behind that, which is 0 here.
        whole: shape of what the kernel's derivatives are of, which is more than the result where that is a block of it,
            and the poses or Jacobians of all frames.
        begins: where the result begins in that; moving: how many numbers of the result change at all, the first ones.

    Raises:
        UnknownNameError: no function or frame of that name, or a kernel that it takes was not built.
        InputError: a frame is missing or not wanted.
    """

    def __init__(self, kernel: Kernel, name: str, frame: str | None = None, *, cut: bool = False) -> None:
        entry = _entry(name, bool(kernel.constraints), cut)
        if (
            isinstance(entry.rule, rules.ResidualRule) and kernel.calls.arrays.has_drives
        ):  # its derivatives by q and v depend on u
            entry = replace(entry, rule=_TANGENTS, flat=())
        if (name in FRAMED) != (frame is not None):
            wanted = f"one of {', '.join(kernel.frames)}" if name in FRAMED else "none"
            raise InputError(f"frame: {name} got {show(frame)}; allowed: {wanted}")
        self.kernel, self.name, self.frame, self.rule = kernel.replaced(), name, frame, entry.rule
        self.kernels, self.second, self._entry = entry.kernels, entry.second, entry
        self._require(self.kernels)
        self._extra = () if frame is None else (frame_number(kernel.frames, frame),)
        self.result, self.calls = entry.result, entry.calls
        shapes, called = kernel.raw.shapes, kernel.raw.functions[self.calls]
        self.reads: tuple[str, ...] = tuple(label for label in called.reads if label in (*entry.reads, "z"))
        self.inputs: tuple[tuple[int, ...], ...] = tuple(shapes[label] for label in self.reads)
        self.idle: tuple[str, ...] = called.reads[len(self.reads) :]
        block, is_behind = entry.block or (called.writes, 0)
        self.output: tuple[int, ...] = shapes[block]
        self.whole: tuple[int, ...] = shapes[FRAMED.get(name, called.writes)]
        self.moving = math.prod(self.output if frame is None else self.whole[1:])
        self.begins = is_behind * math.prod(shapes["rate_vector"]) + sum(self._extra) * self.moving

    def _require(self, kernels: Sequence[str]) -> None:
        missing = [needed for needed in kernels if needed not in self.kernel.operations]
        if missing:
            raise UnknownNameError(
                f"{self.name}: {self.kernel.name} was built without {', '.join(missing)}; allowed: kernels={kernels!r}"
            )

    def require_second(self) -> None:
        """Refuse second derivatives where there are none.

        Raises:
            UnknownNameError: the kernel was built without them.
        """
        self._require((*self.kernels, *self.second))

    def value(self, *arrays: Array) -> Array:
        """Return the kernel's result, for one state or a batch."""
        written = self._run(self.calls, *arrays, *self._nothing(), extra=self._extra)
        return written if self._entry.block is None else self._part(written)

    def derivatives(self, *arrays: Array) -> tuple[Array, ...]:
        """Return exact derivatives by every argument: (output shape, input shape), behind the batch's axis."""
        return self.rule.derivatives(self, *arrays)

    def jacobian(self, *arrays: Array) -> Array:
        """Return exact derivatives by the numbers of all arguments one behind the other, (output shape, numbers)."""
        blocks = self.derivatives(*arrays)
        flat = [x.reshape(*x.shape[: x.ndim - len(shape)], -1) for x, shape in zip(blocks, self.inputs, strict=True)]
        return np.concatenate(flat, axis=-1)

    def second_derivatives(self, *arrays: Array) -> Array:
        """Return exact second derivatives by the numbers of all arguments, (output shape, numbers, numbers)."""
        size = math.prod(self.output)
        units = np.eye(size, dtype=self.kernel.dtype).reshape(size, *self.output)
        hessian = self.hessian(rules.beside(self, arrays), units)
        return hessian.reshape(*hessian.shape[:-3], *self.output, *hessian.shape[-2:])

    def tangent(self, arrays: Sequence[Array], rates: Sequence[Array]) -> Array:
        """Give what the result changes by along rates of the arguments."""
        zeros = self._nothing()
        return self._part(self._run(f"{self.calls}_{TANGENT}", *arrays, *zeros, *rates, *zeros))

    def gradient(self, arrays: Sequence[Array], weights: Array) -> tuple[Array, ...]:
        """Return derivatives of the weighted result by every argument."""
        gradients = self._run(f"{self.calls}_{ADJOINT}", *arrays, *self._nothing(), self._weights(weights))
        return rules.split(self, gradients[..., : self._total])

    def hessian(self, arrays: Sequence[Array], weights: Array) -> Array:
        """Return the second derivatives of the weighted result by the numbers of all arguments one behind the other."""
        hessian = self._run(f"{self.calls}_{HESSIAN}", *arrays, *self._nothing(), self._weights(weights))
        return hessian[..., : self._total, : self._total]

    def patterns(self) -> tuple[Array, tuple[Array, ...]]:
        """Return the sparsity of the result and its derivatives, True where not always zero; shapes of one state."""
        whole, blocks = self.rule.patterns(self)
        return whole, tuple(blocks)

    def second_pattern(self, at: int, by: int) -> Array:
        """Return the sparsity of second derivatives of a weighted result by two arguments, (shape, other's shape)."""
        one, other = (self.reads[place] for place in (at, by))
        if (one, other) in self._entry.flat or (other, one) in self._entry.flat:
            return np.zeros((*self.inputs[at], *self.inputs[by]), np.bool_)
        axes = tuple(range(len(self.output)))
        moving = [self.patterns()[1][place].any(axis=axes) for place in (at, by)]
        return np.logical_and.outer(*moving)

    @property
    def _total(self) -> int:
        """How many numbers all arguments have."""
        return sum(math.prod(shape) for shape in self.inputs)

    def _run(self, name: str, *arrays: Array, extra: tuple[int, ...] = ()) -> Array:
        """Call a function of the kernel with the arrays of its C."""
        return self.kernel.calls.run(name, None, arrays, extra, whole=True)

    def _nothing(self) -> list[Array]:
        """Return arrays of 0 that the kernel's function reads behind its arguments."""
        return [np.zeros(self.kernel.raw.shapes[label], self.kernel.dtype) for label in self.idle]

    def _part(self, written: Array) -> Array:
        """Return the result, or how it moves, of what the kernel's derivatives are of; zeros where it never moves."""
        lead = written.shape[: written.ndim - len(self.whole)]
        part = written.reshape(*lead, -1)[..., self.begins : self.begins + self.moving]
        rest = np.zeros((*lead, math.prod(self.output) - self.moving), self.kernel.dtype)
        return np.concatenate([part, rest], axis=-1).reshape(*lead, *self.output)

    def _weights(self, weights: Array) -> Array:
        """Return weights of the kernel's whole output from those of the result."""
        lead = weights.shape[: weights.ndim - len(self.output)]
        whole = np.zeros((*lead, math.prod(self.whole)), self.kernel.dtype)
        whole[..., self.begins : self.begins + self.moving] = weights.reshape(*lead, -1)[..., : self.moving]
        return whole.reshape(*lead, *self.whole)
