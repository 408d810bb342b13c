"""Kernels as functions of JAX, with exact derivatives, forward and reverse; needs the extra "jax".

Under ``jit``, ``vmap``, ``jvp``, ``grad`` and ``scan``; ``vmap`` calls the kernel for the whole batch at once.  The
kernel runs on the host's processor (``jax.pure_callback``).  Second derivatives there are of frames alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ArrayError, InputError
from ..optional import optional_import
from ..runtime.kernel import Kernel
from .frames import jacobian_derivative, pose_derivative
from .mappings import FUNCTIONS, DifferentiableFunction, kernels_for

Array = NDArray[Any]
SWITCH = 'jax.config.update("jax_enable_x64", True)'


def function(kernel: Kernel, name: str, frame: str | None = None, *, cut: bool = False) -> Callable[..., Any]:
    """A differentiable function of JAX arrays; one state, ``vmap`` makes it one of many.

    Parameters are those that the kernel has now.  What a kernel refuses (a mass matrix that cannot be inverted; NaN and
    infinity, unless ``kernel.checks`` is False) JAX raises as an error of its runtime with the kernel's message.

    Args:
        kernel: with ``kernels_for(name)``; of float64 it needs ``jax_enable_x64``, of float32 it works without.
        name: one of FUNCTIONS: "forward_dynamics", "residual", "mass_matrix", ...
        frame: of frame_pose and frame_jacobian.
        cut: of a robot with loops, that its loops are meant to be open.

    Returns:
        A function of the arrays FUNCTIONS[name].reads, (n,) each (wrench: (links, 6)), with the kernel's dtype; it
        raises ArrayError for other shapes and dtypes, InputError where float64 is switched off, and where a second
        derivative is asked for.

    Raises:
        UnknownNameError: no function or frame of that name, or a kernel that it takes was not built.
        InputError: JAX is not installed, or another argument cannot be used.
    """
    with optional_import("JAX", "functions of JAX need"):
        import jax
        import jax.numpy as jnp
    there = DifferentiableFunction(kernel, name, frame, cut=cut)
    compute = (_with_jacobian if there.frame is None else _frame_functions)(jax, jnp, there)

    def checked(*arrays: Any) -> Any:
        if len(arrays) != len(there.reads):
            raise InputError(f"{name}: got {len(arrays)} arrays; allowed: {', '.join(there.reads)}")
        if jax.dtypes.canonicalize_dtype(np.float64) != np.float64 and there.kernel.dtype == np.float64:
            raise InputError(
                f"{name}: {there.kernel.name} is a kernel of float64, which JAX has switched off; allowed: {SWITCH}"
                ' at the program\'s beginning, or a kernel built with dtype="float32"'
            )
        return compute(*(_converted(jnp, there, i, array) for i, array in enumerate(arrays)))

    checked.__name__ = name
    checked.__doc__ = f"{name}({', '.join(there.reads)}) of {there.kernel.name}; see eomgen.adapters.jax.function."
    return checked


def _converted(jnp: Any, there: DifferentiableFunction, place: int, value: Any) -> Any:
    label, shape, dtype = there.reads[place], there.inputs[place], there.kernel.dtype
    array = jnp.asarray(value)
    weak = isinstance(value, (list, tuple)) or getattr(array, "weak_type", False)
    if array.shape != shape:
        raise ArrayError(f"{label}: expected shape {shape}, got {array.shape}; vmap takes many states")
    if array.dtype.kind not in "fiub" or not (weak or np.can_cast(array.dtype, dtype, "safe")):
        raise ArrayError(f"{label}: expected {dtype}, got {array.dtype}, which {dtype} cannot hold exactly")
    return array.astype(dtype)


def _callback(jax: Any, call: Callable[..., Any], shapes: Sequence[tuple[int, ...]], result: Any) -> Callable[..., Any]:
    """``call`` on the host; under vmap once, with a leading axis."""

    def host(*arrays: Any) -> Any:
        return _apply(call, shapes, [np.asarray(array) for array in arrays])

    def on_device(*arrays: Any) -> Any:
        return jax.pure_callback(host, result, *arrays, vmap_method="expand_dims")

    return on_device


def _apply(call: Callable[..., Any], shapes: Sequence[tuple[int, ...]], arrays: Sequence[Array]) -> Any:
    """A call for all leading axes of the arrays, of length 1 where an array is the same for all, as one batch."""
    leads = [array.shape[: array.ndim - len(shape)] for array, shape in zip(arrays, shapes, strict=True)]
    lead = np.broadcast_shapes(*leads)
    flat = []
    for array, own, shape in zip(arrays, leads, shapes, strict=True):
        if math.prod(own) == 1:
            flat.append(array.reshape(shape))
        else:
            flat.append(np.broadcast_to(array, (*lead, *shape)).reshape(-1, *shape))
    found = call(*flat)
    batch = math.prod(lead) != 1

    def spread(result: Array) -> Array:
        own = result.shape[1:] if batch else result.shape
        return np.ascontiguousarray(result).reshape(*lead, *own)

    return tuple(map(spread, found)) if isinstance(found, tuple) else spread(found)


def _with_jacobian(jax: Any, jnp: Any, there: DifferentiableFunction) -> Callable[..., Any]:
    """The value, whose tangent is its Jacobian times the tangents: linear, so that JAX transposes it."""
    dtype = there.kernel.dtype
    result = jax.ShapeDtypeStruct(there.output, dtype)
    blocks = tuple(jax.ShapeDtypeStruct((*there.output, *shape), dtype) for shape in there.inputs)
    value = jax.custom_jvp(_callback(jax, there.value, there.inputs, result))
    jacobian = jax.custom_jvp(_callback(jax, there.derivatives, there.inputs, blocks))

    @value.defjvp  # type: ignore[untyped-decorator,unused-ignore]
    def tangent(primals: Any, tangents: Any) -> Any:
        parts = [
            jnp.tensordot(block, move, axes=move.ndim) for block, move in zip(jacobian(*primals), tangents, strict=True)
        ]
        return value(*primals), sum(parts[1:], parts[0])

    @jacobian.defjvp  # type: ignore[untyped-decorator,unused-ignore]
    def second(primals: Any, tangents: Any) -> Any:
        raise InputError(f"{there.name}: second derivatives are asked for; allowed: first ones, which are exact")

    return value  # type: ignore[no-any-return,unused-ignore]


def _frame_functions(jax: Any, jnp: Any, there: DifferentiableFunction) -> Callable[..., Any]:
    """Pose or Jacobian of a frame: derivatives of any order follow from the Jacobian."""
    kernel, frame = there.kernel, there.frame
    assert frame is not None
    index = kernel.frame_index(frame)

    def raw(name: str) -> Any:
        def call(q: Array) -> Array:
            return kernel.calls.run(name, None, (q,), (index,))

        result = jax.ShapeDtypeStruct(kernel.raw.shapes[kernel.raw.functions[name].writes], kernel.dtype)
        return jax.custom_jvp(_callback(jax, call, there.inputs, result))

    both = {name: raw(name) for name in ("frame_pose", "frame_jacobian")}
    pose, jacobian = both.values()

    @pose.defjvp  # type: ignore[untyped-decorator,unused-ignore]
    def pose_tangent(primals: Any, tangents: Any) -> Any:
        A = pose(*primals)
        return A, pose_derivative(A, jacobian(*primals), jnp) @ tangents[0]

    @jacobian.defjvp  # type: ignore[untyped-decorator,unused-ignore]
    def jacobian_tangent(primals: Any, tangents: Any) -> Any:
        J = jacobian(*primals)
        return J, jacobian_derivative(J, jnp) @ tangents[0]

    return both[there.name]  # type: ignore[no-any-return,unused-ignore]


__all__ = ["FUNCTIONS", "function", "kernels_for"]
