"""Methods of a kernel's device as functions of JAX, on XLA's stream; ``eomgen.adapters.jax.function`` gives them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from ..device.face import Device
from ..device.xla import HANDLERS, handlers, plan_number, scratch_size
from ..errors import ArrayError, InputError
from ..names import show
from .sources import OnDevice, broadcast_axes, refuse_shape

SWITCH = 'jax.config.update("jax_enable_x64", True)'
TARGET = "eomgen_device"  # of XLA's foreign functions


def device_function(jax: Any, device: Device, name: str, frame: str | None, cut: bool) -> Callable[..., Any]:
    """Return a method of a device as a function of JAX's arrays; see ``eomgen.adapters.jax.function``.

    Raises:
        UnknownNameError: the device has no such method.
        InputError: it has several results, JAX is too old, or the device is none of CUDA.
    """
    if not hasattr(jax, "ffi"):
        raise InputError(f"device: JAX {jax.__version__} has no jax.ffi; allowed: 0.5 or newer")
    there = OnDevice(device, name, frame, cut)
    value = _differentiable(jax, there)

    def checked(*arrays: Any) -> Any:
        if len(arrays) != len(there.reads):
            raise InputError(f"{name}: got {len(arrays)} arrays; allowed: {', '.join(there.reads)}")
        _refuse_single(jax, there)
        lead: tuple[int, ...] = ()
        taken = []
        for label, shape, given in zip(there.reads, there.inputs, arrays, strict=True):
            taken.append(_array(jax, label, shape, there.dtype, given))
            lead = broadcast_axes(label, lead, taken[-1].shape[: taken[-1].ndim - len(shape)])
        count = math.prod(lead)
        rows = [
            jax.numpy.broadcast_to(x, (*lead, *shape)).reshape(count, *shape)
            for x, shape in zip(taken, there.inputs, strict=True)
        ]
        return value(*rows).reshape(*lead, *there.output)

    return checked


def _differentiable(jax: Any, there: OnDevice) -> Callable[..., Any]:
    """Return a method with its gradient from the device's adjoint, and that one's from hessian and tangent."""
    sizes = [math.prod(shape) for shape in there.inputs]
    ends = np.cumsum(sizes)[:-1].tolist()
    launch = {kind: _launcher(jax, there, kind) for kind in there.methods}

    def split(flat: Any) -> tuple[Any, ...]:
        parts = jax.numpy.split(flat, ends, axis=1)
        return tuple(x.reshape(flat.shape[0], *s) for x, s in zip(parts, there.inputs, strict=True))

    adjoint = jax.custom_vjp(lambda *arrays: launch["adjoint"](*arrays))
    value = jax.custom_vjp(lambda *arrays: launch["value"](*arrays))

    def pull(arrays: Sequence[Any], weights: Any) -> tuple[Any, ...]:
        return split(adjoint(*arrays, weights))

    def pull_again(arrays: Sequence[Any], along: Any) -> tuple[Any, ...]:
        *states, weights = arrays
        by_states = (along[:, None] @ launch["hessian"](*states, weights))[:, 0]
        return (*split(by_states), launch["tangent"](*states, *split(along)))

    value.defvjp(lambda *arrays: (value(*arrays), arrays), pull)
    adjoint.defvjp(lambda *arrays: (adjoint(*arrays), arrays), pull_again)
    return value  # type: ignore[no-any-return,unused-ignore]


def _launcher(jax: Any, there: OnDevice, kind: str) -> Callable[..., Any]:
    """Return a method on arrays of N states without derivatives; ``vmap`` makes it one call of all."""

    def rows(*arrays: Any) -> Any:
        count, device, name = arrays[0].shape[0], there.device, there.methods[kind]
        number, text = plan_number(_registered(jax, TARGET), device, name)
        (shape,) = text.shapes("writes").values()
        if count == 0:
            return jax.numpy.zeros((0, *shape), there.dtype)
        size = scratch_size(text, count, there.dtype.itemsize)
        results = tuple(
            jax.ShapeDtypeStruct(one, dtype) for one, dtype in (((count, *shape), there.dtype), ((size,), np.uint8))
        )
        return jax.ffi.ffi_call(TARGET, results)(*arrays, plan=np.int64(number))[0]

    call = jax.custom_batching.custom_vmap(rows)

    @call.def_vmap  # type: ignore[untyped-decorator,unused-ignore]
    def many(count: int, batched: Sequence[bool], *arrays: Any) -> Any:
        whole = [
            x if is_batched else jax.numpy.broadcast_to(x, (count, *x.shape))
            for x, is_batched in zip(arrays, batched, strict=True)
        ]
        lead = whole[0].shape[:2]
        made = call(*(x.reshape(math.prod(lead), *x.shape[2:]) for x in whole))
        return made.reshape(*lead, *made.shape[1:]), True

    return call  # type: ignore[no-any-return,unused-ignore]


@cache
def _registered(jax: Any, target: str) -> Any:
    """Return the library of handlers, which XLA knows by a name."""
    library = handlers(jax.ffi.include_dir())
    for platform, name in HANDLERS.items():
        jax.ffi.register_ffi_target(target, jax.ffi.pycapsule(getattr(library, name)), platform=platform)
    return library


def _refuse_single(jax: Any, there: OnDevice) -> None:
    if there.dtype == np.float64 and not jax.config.jax_enable_x64:
        raise InputError(
            f"{there.name}: {there.robot} is a kernel of float64, which JAX has switched off; allowed: {SWITCH}"
            ' at the program\'s beginning, or a kernel built with dtype="float32"'
        )


def _array(jax: Any, label: str, shape: tuple[int, ...], dtype: np.dtype[Any], given: Any) -> Any:
    """Return an argument as an array of JAX; numbers without a type of their own take that of the kernel."""
    try:
        array = jax.numpy.asarray(given)
    except (TypeError, ValueError, OverflowError):
        raise ArrayError(f"{label}: {show(given)}; allowed: an array of numbers") from None
    if array.dtype != dtype:
        if not getattr(array, "weak_type", False) or array.dtype.kind not in "fiub":
            raise ArrayError(f"{label}: dtype {array.dtype}; allowed: {dtype}")
        array = array.astype(dtype)
    refuse_shape(label, shape, tuple(array.shape))
    return array
