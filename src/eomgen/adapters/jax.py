"""Kernels and rollouts as functions of JAX, with exact derivatives; needs the extra "jax".

Under ``jit``, ``vmap``, ``jvp``, ``grad``, ``hessian`` and ``scan``; ``vmap`` calls the kernel for the whole batch at
once.  The kernel runs on the host's processor (``jax.pure_callback``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..codegen.kernels.derived import FRAMED
from ..description import RobotLike, as_robot
from ..device.face import Device
from ..errors import ArrayError, InputError
from ..kernel.complete import Kernel
from ..kernel.stepping.options import StepOptions
from ..names import show
from ..optional import optional_import
from ..pipeline.derivations import derived_model
from ..runtime.bound import frame_number
from .frames import jacobian_derivative, pose_derivative
from .jax_devices import SWITCH, device_function
from .mappings import FUNCTIONS, DifferentiableFunction, kernels_for

Array = NDArray[Any]
GIVEN = ("q", "v", "z", "u")  # arguments of rollouts by their names in gradients, z with internal states alone
CONTROLLER = ("kp", "kd", "target")


def function(kernel: Kernel | Device, name: str, frame: str | None = None, *, cut: bool = False) -> Callable[..., Any]:
    """Return a differentiable function of JAX arrays; one state, ``vmap`` makes it one of many.

    Parameters are those that the kernel has now.  What a kernel refuses (a mass matrix that cannot be inverted; NaN and
    infinity, unless ``kernel.checks`` is False) JAX raises as an error of its runtime with the kernel's message.

    Of ``kernel.device("cuda")`` it is launched on XLA's stream and nothing leaves the device; arrays may be (..., n),
    and derivatives are of reverse mode, of first and second order.  With ``device.checks`` it waits for each result.

    Args:
        kernel: with ``kernels_for(name)``, or its device; of float64 it needs ``jax_enable_x64``, of float32 it works
            without.
        name: one of FUNCTIONS: "forward_dynamics", "residual", "mass_matrix", ...; of a device one of
            ``device.functions`` with one result.
        frame: of frame_pose and frame_jacobian of a kernel; a device's frame_poses and frame_jacobians have all.
        cut: of a kernel of a robot with loops, that its loops are meant to be open.

    Returns:
        A function of the arrays FUNCTIONS[name].reads, (n,) each (wrench: (links, 6)), with z, (m,), behind v where the
        result depends on internal states, with the kernel's dtype.  It raises ArrayError for other shapes and dtypes,
        InputError where float64 is switched off, and where a third derivative is asked for (those of frames are of any
        order, where no coordinate follows others and no link bends), UnknownNameError where a second one is that the
        kernel was built without.

    Raises:
        UnknownNameError: no function or frame of that name, or a kernel that it takes was not built.
        InputError: JAX is not installed, or another argument cannot be used.
    """
    with optional_import("JAX", "functions of JAX need"):
        import jax
        import jax.numpy as jnp
    if isinstance(kernel, Device):
        return device_function(jax, kernel, name, frame, cut)
    there = DifferentiableFunction(kernel, name, frame, cut=cut)
    compute = (_with_jacobian if there.frame is None else _frame_functions)(jax, jnp, there)

    def checked(*arrays: Any) -> Any:
        if len(arrays) != len(there.reads):
            raise InputError(f"{name}: got {len(arrays)} arrays; allowed: {', '.join(there.reads)}")
        _refuse_single(jax, name, there.kernel)
        return compute(
            *(
                _array(jnp, label, [shape], there.kernel.dtype, array)
                for label, shape, array in zip(there.reads, there.inputs, arrays, strict=True)
            )
        )

    checked.__name__ = name
    checked.__doc__ = f"{name}({', '.join(there.reads)}) of {there.kernel.name}; see eomgen.adapters.jax.function."
    return checked


def native(robot: RobotLike, kernels: Sequence[str] = ()) -> Any:
    """Return functions that JAX itself compiles: for jit, vmap and grad, and accelerators, without callbacks.

    They have derivatives by parameters too, of any order, and no checks; compiling takes seconds for an arm, and grows
    with the length of the equations (``function`` compiles at once, and is faster on the host's processor).

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        kernels: as of ``eomgen.export_arrays``.

    Returns:
        An object with a function for each kernel, ``frame_poses`` and ``rollout``; what ``make`` of the module gives
        that ``eomgen.export_arrays`` writes.

    Raises:
        InputError: JAX is not installed, or a kernel is unknown or no program.
    """
    with optional_import("JAX", "functions of JAX need"):
        import jax
        import jax.numpy as jnp
    from ..codegen.arrays.sources import render_arrays

    described = as_robot(robot)
    module: dict[str, Any] = {"__name__": f"{described.name}_arrays"}
    exec(compile(render_arrays(derived_model(described), kernels), f"<{described.name}_arrays>", "exec"), module)
    return module["make"](jnp, jax.lax.scan)


def _refuse_single(jax: Any, name: str, kernel: Kernel) -> None:
    if jax.dtypes.canonicalize_dtype(np.float64) != np.float64 and kernel.dtype == np.float64:
        raise InputError(
            f"{name}: {kernel.name} is a kernel of float64, which JAX has switched off; allowed: {SWITCH}"
            ' at the program\'s beginning, or a kernel built with dtype="float32"'
        )


def _array(jnp: Any, label: str, shapes: Sequence[tuple[int, ...]], dtype: Any, value: Any) -> Any:
    try:
        array = jnp.asarray(value)
    except (TypeError, ValueError, OverflowError) as error:
        allowed = " or ".join(map(str, shapes))
        raise ArrayError(f"{label}: {show(value)}; allowed: numbers of shape {allowed}") from error
    weak = isinstance(value, (list, tuple)) or getattr(array, "weak_type", False)
    if array.shape not in shapes:
        allowed = " or ".join(map(str, shapes))
        raise ArrayError(f"{label}: expected shape {allowed}, got {array.shape}; vmap takes many states")
    if array.dtype.kind not in "fiub" or not (weak or np.can_cast(array.dtype, dtype, "safe")):
        raise ArrayError(f"{label}: expected {dtype}, got {array.dtype}, which {dtype} cannot hold exactly")
    return array.astype(dtype)


def _callback(jax: Any, call: Callable[..., Any], shapes: Sequence[tuple[int, ...]], result: Any) -> Callable[..., Any]:
    """Return ``call`` on the host; under vmap once, with a leading axis."""

    def host(*arrays: Any) -> Any:
        return _apply(call, shapes, [np.asarray(array) for array in arrays])

    def on_device(*arrays: Any) -> Any:
        return jax.pure_callback(host, result, *arrays, vmap_method="expand_dims")

    return on_device


def _apply(call: Callable[..., Any], shapes: Sequence[tuple[int, ...]], arrays: Sequence[Array]) -> Any:
    """Call a function for all leading axes of the arrays as one batch; length 1: an array is the same for all."""
    leads = [array.shape[: array.ndim - len(shape)] for array, shape in zip(arrays, shapes, strict=True)]
    lead = np.broadcast_shapes(*leads)
    flat = []
    for array, leading, shape in zip(arrays, leads, shapes, strict=True):
        if math.prod(leading) == 1:
            flat.append(array.reshape(shape))
        else:
            flat.append(np.broadcast_to(array, (*lead, *shape)).reshape(-1, *shape))
    outputs = call(*flat)
    batch = math.prod(lead) != 1

    def spread(result: Array) -> Array:
        inner = result.shape[1:] if batch else result.shape
        return np.ascontiguousarray(result).reshape(*lead, *inner)

    return tuple(map(spread, outputs)) if isinstance(outputs, tuple) else spread(outputs)


def _with_jacobian(jax: Any, jnp: Any, there: DifferentiableFunction) -> Callable[..., Any]:
    """Return the value with its Jacobian as tangent map: linear, so that JAX transposes it; and so again."""
    dtype, total = there.kernel.dtype, sum(math.prod(shape) for shape in there.inputs)

    def of(call: Callable[..., Any], *axes: int) -> Any:
        result = jax.ShapeDtypeStruct((*there.output, *axes), dtype)
        return jax.custom_jvp(_callback(jax, call, there.inputs, result))

    value, jacobian = of(there.value), of(there.jacobian, total)
    second = of(there.second_derivatives, total, total)

    def along(derivative: Any, tangents: Any) -> Any:
        return derivative @ jnp.concatenate([move.ravel() for move in tangents])

    @value.defjvp  # type: ignore[untyped-decorator,unused-ignore]
    def tangent(primals: Any, tangents: Any) -> Any:
        return value(*primals), along(jacobian(*primals), tangents)

    @jacobian.defjvp  # type: ignore[untyped-decorator,unused-ignore]
    def curvature(primals: Any, tangents: Any) -> Any:
        there.require_second()
        return jacobian(*primals), along(second(*primals), tangents)

    @second.defjvp  # type: ignore[untyped-decorator,unused-ignore]
    def third(primals: Any, tangents: Any) -> Any:
        raise InputError(f"{there.name}: third derivatives are asked for; allowed: first and second ones")

    return value  # type: ignore[no-any-return,unused-ignore]


def _frame_functions(jax: Any, jnp: Any, there: DifferentiableFunction) -> Callable[..., Any]:
    """Return the pose or Jacobian of a frame: derivatives of any order follow from the Jacobian.

    Where coordinates follow others those of the Jacobian are of first order, by the kernel's tangents.
    """
    kernel, frame = there.kernel, there.frame
    assert frame is not None
    index = frame_number(kernel.frames, frame)

    def raw(name: str) -> Any:
        def call(q: Array) -> Array:
            return kernel.calls.run(name, None, (q,), (index,))

        result = jax.ShapeDtypeStruct(kernel.raw.shapes[kernel.raw.functions[name].writes], kernel.dtype)
        return jax.custom_jvp(_callback(jax, call, there.inputs, result))

    both = {name: raw(name) for name in FRAMED}
    pose, jacobian = both.values()

    @pose.defjvp  # type: ignore[untyped-decorator,unused-ignore]
    def pose_tangent(primals: Any, tangents: Any) -> Any:
        A = pose(*primals)
        return A, pose_derivative(A, jacobian(*primals), jnp) @ tangents[0]

    def turned(q: Array) -> Array:
        along = (np.broadcast_to(rates, q.shape) for rates in np.eye(q.shape[-1]))
        return np.stack([kernel.jvp(kernel.frame_jacobian, (q, frame), (rates,)) for rates in along], axis=-1)

    shape = kernel.raw.shapes["jacobian"]
    moved = jax.ShapeDtypeStruct((*shape, shape[-1]), kernel.dtype)
    slopes = jax.custom_jvp(_callback(jax, turned, there.inputs, moved))

    @jacobian.defjvp  # type: ignore[untyped-decorator,unused-ignore]
    def jacobian_tangent(primals: Any, tangents: Any) -> Any:
        J = jacobian(*primals)
        if kernel.follower_names:  # whose columns are sums, of which J does not know the parts
            return J, slopes(*primals) @ tangents[0]
        return J, jacobian_derivative(J, jnp) @ tangents[0]

    @slopes.defjvp  # type: ignore[untyped-decorator,unused-ignore]
    def curvature(primals: Any, tangents: Any) -> Any:
        raise InputError(
            f"{there.name}: second derivatives of Jacobians are asked for, and coordinates of {kernel.name} follow"
            " others; allowed: first ones, and second ones of poses"
        )

    return both[there.name]  # type: ignore[no-any-return,unused-ignore]


def rollout(
    kernel: Kernel,
    dt: float | None = None,
    steps: int | None = None,
    *,
    method: str = "rk4",
    every: int = 1,
    duration: float | None = None,
    samples: int | None = None,
    rtol: float = 1e-6,
) -> Callable[..., Any]:
    """Return rollouts as a function of JAX arrays, whose gradient comes from the same steps in C, backwards.

    Under ``jit``, ``grad``, ``vjp`` and ``vmap``; first derivatives in reverse mode.  ``vmap`` makes it one call for
    the whole batch; with gains it is one for each state.

    Args:
        kernel: with ``rollout`` or ``adaptive_rollout`` and the method's gradient ("explicit_gradient", ...); a kernel
            built with all kernels has them.  Parameters are those that it has now.
        dt, steps, method, every, duration, samples, rtol: as of ``Kernel.rollout``.

    Returns:
        A function of q0, v0, u and, with a controller, kp, kd and target: (n,) each, u and target (steps, n) or
        (samples, n), too; of robots with internal states z0, (m,), stands behind v0.  It gives q and v at the samples,
        (samples, n) each, and then z, (samples, m).  It raises ArrayError for other shapes and dtypes, InputError where
        float64 is switched off.

    Raises:
        InputError: JAX is not installed; the method is unknown, or an option does not belong to it.
    """
    with optional_import("JAX", "functions of JAX need"):
        import jax
        import jax.numpy as jnp
    private, m = kernel.replaced(), len(kernel.internal_states)
    how = vars(StepOptions(method, dt, steps, every, duration, samples, rtol))
    rows = (samples or 1) if steps is None else steps
    labels = [x for x in GIVEN if x != "z" or m]
    sizes = [private.n, private.n, *([m] if m else [])]
    told = tuple(jax.ShapeDtypeStruct((rows // every + 1, size), private.dtype) for size in sizes)

    def there(*arrays: Array) -> tuple[Array, ...]:
        motion = private.rollout(**_arguments(labels, arrays), **how)
        return (*motion, motion.z) if m else tuple(motion)

    def back(*arrays: Array) -> tuple[Array, ...]:
        given, by = arrays[: -len(told)], arrays[-len(told) :]
        known = {**_arguments(labels, given), **how, "loss": lambda t, *x: (0.0, *by)}
        _, gradients = private.rollout_gradient(**known)
        return tuple(gradients[name] for name in (*labels, *CONTROLLER)[: len(given)])

    @jax.custom_vjp  # type: ignore[untyped-decorator,unused-ignore]
    def states(*arrays: Any) -> Any:
        return _batched(jax, there, [x.shape for x in arrays], told, single=len(arrays) > len(labels))(*arrays)

    def keep(*arrays: Any) -> Any:
        return states(*arrays), arrays

    def pull(arrays: Any, by: Any) -> Any:
        shapes = [x.shape for x in arrays]
        results = tuple(jax.ShapeDtypeStruct(shape, private.dtype) for shape in shapes)
        every_shape = [*shapes, *(x.shape for x in told)]
        return _batched(jax, back, every_shape, results, single=len(arrays) > len(labels))(*arrays, *by)

    states.defvjp(keep, pull)

    def checked(*arrays: Any) -> Any:
        wanted = [f"{x}0" if x != "u" else x for x in labels]
        if len(arrays) not in (len(wanted), len(wanted) + len(CONTROLLER)):
            few, more = ", ".join(wanted), ", ".join((*wanted, *CONTROLLER))
            raise InputError(f"rollout: got {len(arrays)} arrays; allowed: {few}, or {more}")
        _refuse_single(jax, "rollout", private)
        over_time: list[tuple[int, ...]] = [(private.n,), (rows, private.n)]
        shapes: dict[str, list[tuple[int, ...]]] = {"z0": [(m,)], "u": over_time, "target": over_time}
        return states(
            *(
                _array(jnp, label, shapes.get(label, [(private.n,)]), private.dtype, value)
                for label, value in zip((*wanted, *CONTROLLER), arrays, strict=False)
            )
        )

    return checked


def _arguments(labels: Sequence[str], arrays: Sequence[Array]) -> dict[str, Any]:
    """Return arguments of a kernel's rollout by their names."""
    renamed = {"q": "q0", "v": "v0"}
    return {renamed.get(x, x): array for x, array in zip((*labels, *CONTROLLER), arrays, strict=False)}


def _batched(
    jax: Any, call: Callable[..., Any], shapes: Sequence[tuple[int, ...]], result: Any, *, single: bool
) -> Callable[..., Any]:
    """Call a rollout on the host, of all states at once where no controller is, whose gains are for all.

    Args:
        single: call it for one state after the other.
    """

    def host(*arrays: Any) -> Any:
        inputs = [np.asarray(array) for array in arrays]
        leads = [x.shape[: x.ndim - len(shape)] for x, shape in zip(inputs, shapes, strict=True)]
        lead = np.broadcast_shapes(*leads)
        if lead == ():
            return call(*inputs)
        rows = [np.broadcast_to(x, (*lead, *s)).reshape(-1, *s) for x, s in zip(inputs, shapes, strict=True)]
        if math.prod(lead) == 0:
            return tuple(np.zeros((*lead, *one.shape), one.dtype) for one in result)
        outputs = _one_by_one(call, rows) if single else call(*rows)
        return tuple(np.ascontiguousarray(x).reshape(*lead, *x.shape[1:]) for x in outputs)

    def on_device(*arrays: Any) -> Any:
        return jax.pure_callback(host, result, *arrays, vmap_method="expand_dims")

    return on_device


def _one_by_one(call: Callable[..., Any], rows: Sequence[Array]) -> tuple[Array, ...]:
    return tuple(np.stack(column) for column in zip(*(call(*state) for state in zip(*rows, strict=True)), strict=True))


__all__ = ["FUNCTIONS", "function", "kernels_for", "native", "rollout"]
