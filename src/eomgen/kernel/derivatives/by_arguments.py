"""Exact derivatives of a kernel's functions: along directions, of weighted results, and by run-time parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...errors import InputError, UnknownNameError
from ...names import nearest_or_all, show
from ...runtime.bound import frame_number
from ...runtime.calls import Calls
from ...runtime.direct import BoundFunctions
from ...runtime.raw import Array, Method, name_of
from ..declared_methods import kernel_method
from ..functions import KernelWithMethods
from ..slots import parameter_slots

ADJOINT, TANGENT, HESSIAN = "adjoint", "tangent", "hessian"
BY_PARAMETERS = "parameter_"
KINDS = (ADJOINT, TANGENT, HESSIAN, f"{BY_PARAMETERS}{ADJOINT}", f"{BY_PARAMETERS}{TANGENT}")  # ends of names
COTANGENT = "cotangent"
FRAMED = ("poses", "jacobians")  # results of all frames at once


@dataclass(frozen=True)
class Differentiated:
    """A function of a kernel with its derivatives.

    Attributes:
        bound: functions of the kernel.
        name: the function's.
        reads: names of the arrays that its C reads; ``arguments`` are those of the method.
        writes: name of what its derivatives take it to write; for a function of a frame that is of all frames.
        closes: whether it refuses states in which loops are open.
    """

    bound: BoundFunctions
    name: str
    reads: tuple[str, ...]
    writes: str
    closes: bool

    @classmethod
    def of(cls, bound: BoundFunctions, name: str) -> Differentiated:
        """Return the function of that name.

        Raises:
            UnknownNameError: the kernel was built without its derivatives.
        """
        raw = bound.calls.raw
        known = raw.functions
        kinds = [kind for kind in KINDS if f"{name}_{kind}" in known]
        if not kinds:
            ends = [(x, kind) for x in known for kind in reversed(KINDS) if x.endswith(f"_{kind}")]
            available = sorted({x.removesuffix(f"_{kind}").removesuffix("_parameter") for x, kind in ends})
            raise UnknownNameError(
                f"{raw.name} was built without derivatives of {show(name)}{nearest_or_all(str(name), available)}"
            )
        function = known[f"{name}_{kinds[0]}"]
        if not kinds[0].endswith(TANGENT):
            *reads, weights = function.reads
            return cls(bound, name, tuple(reads), weights.removeprefix(f"{COTANGENT}_"), function.closes)
        arrays = len(function.reads) // 2 if kinds[0] == TANGENT else len(function.reads) - 1
        return cls(bound, name, function.reads[:arrays], function.writes, function.closes)

    @property
    def calls(self) -> Calls:
        """Calls of the kernel."""
        return self.bound.calls

    @property
    def is_framed(self) -> bool:
        """True if it takes a frame's name behind its arrays."""
        return self.writes in FRAMED

    @property
    def arguments(self) -> tuple[str, ...]:
        """Names of the method's arrays: z behind the others where its result depends on internal states."""
        given = tuple(x for x in self.reads if x not in ("z", "forces"))
        return (*given, "z") if "z" in self.reads else given

    @property
    def result_shape(self) -> tuple[int, ...]:
        """Shape of its result for one state, of all frames where it takes one."""
        shape, axes = self.shape(self.writes), self.calls.arrays.axes_with_states(self.writes)
        return (*shape[: len(shape) - axes], *(self.calls.n,) * axes)

    def shape(self, label: str) -> tuple[int, ...]:
        """Return the shape of one of the C's arrays for one state."""
        return self.calls.raw.shapes[label]

    def state(self, args: Sequence[Any]) -> tuple[list[ArrayLike], int | None]:
        """Return the arrays of its arguments, and the number of the frame.

        Raises:
            InputError: another number of arguments.
            UnknownNameError: no frame of that name.
            LoopError: the function refuses such a state, as its loops are open.
        """
        wanted = (*self.arguments, "frame") if self.is_framed else self.arguments
        if not isinstance(args, (tuple, list)) or len(args) != len(wanted):
            raise InputError(f"{self.name}: got {_number(args)} arguments; allowed: ({', '.join(wanted)})")
        arrays, frame = list(args[: len(self.arguments)]), None
        if self.is_framed:
            frame = frame_number(self.calls.raw.libraries.meta["frames"], args[-1])
        if self.closes:
            *given, z = arrays if "z" in self.reads else (*arrays, None)
            self.calls.run(self.name, None, given, z=z)
        return arrays, frame

    def ordered(self, arrays: Sequence[ArrayLike]) -> list[ArrayLike]:
        """Return arguments, or rates of them, in the order of the C, without forces beside drives."""
        given = dict(zip(self.arguments, arrays, strict=True))
        return [given[x] if x in given else np.zeros(self.shape(x), self.calls.dtype) for x in self.reads]

    def run(self, kind: str, arrays: Sequence[ArrayLike], inner: int = 0) -> Array:
        """Call one of its derivatives on the C's arrays; the last ``inner`` leading axes are not of states.

        Raises:
            UnknownNameError: the kernel was built without it.
        """
        if f"{self.name}_{kind}" not in self.calls.raw.functions:
            raise self.calls.raw.missing(f"{self.name}_{kind}")
        if inner:
            return self.calls.run(f"{self.name}_{kind}", None, arrays, inner=inner)
        return self.bound[f"{self.name}_{kind}"](*arrays)

    def weights(self, cotangent: ArrayLike, frame: int | None) -> Array:
        """Return weights of the results in the layout that derivatives read.

        Args:
            cotangent: of the result's shape.
            frame: its number, of a function of a frame.

        Raises:
            ArrayError: another shape or dtype than the function's result.
        """
        if frame is None:
            return self._weights(cotangent, self.shape(self.writes))[0]
        frames, *inner = self.shape(self.writes)
        outer = (4, 4) if self.writes == "poses" else tuple(inner)
        weights, lead = self._weights(cotangent, outer)
        whole = np.zeros((*lead, frames, *inner), self.calls.dtype)
        whole[..., frame, :, :] = weights[..., : inner[0], :]
        return whole

    def _weights(self, cotangent: ArrayLike, shape: tuple[int, ...]) -> tuple[Array, tuple[int, ...]]:
        """Return weights of that shape of the C's, with zeros for internal states, and leading axes."""
        axes = self.calls.arrays.axes_with_states(self.writes)
        inner = (*shape[: len(shape) - axes], *(self.calls.n,) * axes)
        weights, lead = self.calls.array(COTANGENT, cotangent, inner)
        if inner == shape:
            return weights, lead
        whole = np.zeros((*lead, *shape), self.calls.dtype)
        place: tuple[Any, ...] = (..., *map(slice, inner))
        whole[place] = weights
        return whole, lead

    def places(self) -> list[range]:
        """Return places of the numbers of each of the method's arrays among those of all of the C's in a row."""
        ends = np.cumsum([math.prod(self.shape(x)) for x in self.reads]).tolist()
        places = dict(zip(self.reads, map(range, [0, *ends], ends), strict=False))
        return [places[x] for x in self.arguments]

    def of_frame(self, result: Array, frame: int | None) -> Array:
        """Select a frame's result of one for all frames; derivatives of a pose's last row are zero."""
        if frame is None:
            return result
        rows: Array = result[..., frame, :, :]
        if self.writes != "poses":
            return rows
        return np.concatenate([rows, np.zeros_like(rows[..., :1, :])], axis=-2)

    def rows(self, gradient: Array) -> tuple[Array, ...]:
        """Split a gradient into one array per argument, in its shape."""
        gradients = list[Array]()
        for label, place in zip(self.arguments, self.places(), strict=True):
            row = np.ascontiguousarray(gradient[..., place.start : place.stop])
            gradients.append(row.reshape(*row.shape[:-1], *self.shape(label)))
        return tuple(gradients)


def _number(values: Any) -> str:
    return str(len(values)) if isinstance(values, (tuple, list)) else type(values).__name__


class Differentiation(KernelWithMethods):
    """Jacobians, products with them, and second derivatives; exact."""

    @kernel_method()
    def residual_jacobian(  # type: ignore[empty-body]
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, z: ArrayLike | None = None, *, out: Array | None = None
    ) -> tuple[Array, Array, Array]:
        """Return exact derivatives of the residual, three (n, n): dr/dq, dr/dv and dr/da (the mass matrix).

        Row i belongs to the residual's coordinate i, column j to the coordinate that changes.  Without external
        wrenches.  By drives the derivative is -1.

        Args:
            q, v, a: (n,).
            z: internal states, (m,).
            out: array (3, n, n) to write to; the result are views of it.
        """

    @kernel_method()
    def forward_dynamics_jacobian(  # type: ignore[empty-body]
        self,
        q: ArrayLike,
        v: ArrayLike,
        u: ArrayLike,
        z: ArrayLike | None = None,
        *,
        out: Array | None = None,
        cut: bool = False,
    ) -> tuple[Array, Array, Array]:
        """Return exact derivatives of accelerations, three (n, n): da/dq, da/dv and da/du (the inverse mass matrix).

        The acceleration of a prescribed coordinate stands in ``u`` and depends on nothing else.
        Without external wrenches; where some are constant generalized forces, add them to ``u``.
        With loops closed, da/du is what of the inverse mass matrix keeps them closed, and da/dq and da/dv are of the
        smooth extension M a + h = u + J^T lambda, J a + J_dot v = 0, beyond the closed states too.  Where constraints
        are redundant, they are sure along directions that keep the loops closed alone.

        Args:
            q, v, u: (n,).
            z: internal states, (m,).
            out: array (3, n, n) to write to; the result are views of it.
            cut: of a robot with loops, that its loops are open: of the tree alone.

        Raises:
            SingularError, LoopError: as of ``forward_dynamics``.
        """

    def jvp(
        self,
        name: Method,
        args: Sequence[Any],
        tangents: Sequence[ArrayLike],
        *,
        parameters: Mapping[str, float] | None = None,
    ) -> Array:
        """Give what a method's result changes by along rates of its arguments: its Jacobian times them, exact.

        Args:
            name: the method or its name, such as "inverse_dynamics", "reactions", "energy", "frame_pose".
            args: its arguments in their order, such as (q, v, a) or (q, "tool"); without ``wrench``; z behind the other
                arrays where the result depends on internal states.
            tangents: a rate for each array among them, of its shape.
            parameters: rates of run-time parameters by their names.

        Returns:
            Of the result's shape.

        Raises:
            UnknownNameError: no such method, parameter or frame, or the kernel was built without its derivatives.
            InputError: another number of arguments or rates.
            SingularError: of "forward_dynamics" and what is like it, where there are no accelerations.
        """
        f = self._differentiated(name)
        arrays, frame = f.state(args)
        if not isinstance(tangents, (tuple, list)) or len(tangents) != len(f.arguments):
            raise InputError(f"tangents: got {_number(tangents)}; allowed: one for each of {', '.join(f.arguments)}")
        given = f.ordered(arrays)
        derivative = f.of_frame(f.run(TANGENT, [*given, *f.ordered(tangents)]), frame)
        if parameters:
            along = np.zeros(len(self.parameters), self.dtype)
            along[parameter_slots(self.parameters, tuple(parameters))] = list(parameters.values())
            derivative = derivative + f.of_frame(f.run(f"{BY_PARAMETERS}{TANGENT}", [*given, along]), frame)
        return derivative

    def vjp(
        self, name: Method, args: Sequence[Any], cotangent: ArrayLike, parameters: Sequence[str] = ()
    ) -> tuple[Array, ...]:
        """Return the gradient of the sum of a method's weighted results: weights times its Jacobian, exact.

        It comes from one reverse sweep, which takes about as long as two or three calls of the method whatever the
        number of coordinates is.

        Args:
            name, args: as of ``jvp``.
            cotangent: the weights, of the result's shape.
            parameters: names of run-time parameters that the gradient is taken by as well.

        Returns:
            An array of each array among the arguments, of its shape; where there are names of parameters, one more,
            (parameters,).

        Raises:
            UnknownNameError, InputError, SingularError: as of ``jvp``.
        """
        f = self._differentiated(name)
        arrays, frame = f.state(args)
        slots = parameter_slots(self.parameters, parameters)
        arguments = [*f.ordered(arrays), f.weights(cotangent, frame)]
        if not slots:
            return f.rows(f.run(ADJOINT, arguments))
        gradient = f.run(f"{BY_PARAMETERS}{ADJOINT}", arguments)
        split = gradient.shape[-1] - len(self.parameters)
        return (*f.rows(gradient[..., :split]), gradient[..., split:][..., slots])

    def hessian(self, name: Method, args: Sequence[Any], cotangent: ArrayLike) -> Array:
        """Return exact second derivatives, symmetric, of the sum of a method's weighted results by its arguments.

        Args:
            name, args: as of ``jvp``.
            cotangent: the weights, of the result's shape.

        Returns:
            A matrix whose rows and columns are the numbers of all arguments one behind the other: (3 n, 3 n) of
            "inverse_dynamics" and "forward_dynamics" without internal states.

        Raises:
            UnknownNameError, InputError, SingularError: as of ``jvp``.
        """
        f = self._differentiated(name)
        arrays, frame = f.state(args)
        second = f.run(HESSIAN, [*f.ordered(arrays), f.weights(cotangent, frame)])
        if f.arguments == f.reads:
            return second
        places = np.concatenate(f.places()).astype(np.intp)
        return np.ascontiguousarray(second[..., places[:, np.newaxis], places])

    def parameter_jacobian(self, name: Method, args: Sequence[Any], parameters: Sequence[str] | None = None) -> Array:
        """Return derivatives of a method's results by run-time parameters, exact.

        Args:
            name, args: as of ``jvp``.
            parameters: names of the parameters; all if None.

        Returns:
            Of the result's shape with one more axis, (..., parameters).

        Raises:
            UnknownNameError, InputError, SingularError: as of ``jvp``.
        """
        f = self._differentiated(name)
        slots = parameter_slots(self.parameters, tuple(self.parameters) if parameters is None else parameters)
        arrays, frame = f.state(args)
        pairs = zip(f.reads, f.ordered(arrays), strict=True)
        shaped = [self.calls.array(label, value, f.shape(label)) for label, value in pairs]
        lead = np.broadcast_shapes(*(leading for _, leading in shaped))
        if not slots:
            inner = f.of_frame(np.zeros(f.result_shape, self.dtype), frame).shape
            return np.zeros((*lead, *inner, 0), self.dtype)
        units = np.zeros((len(slots), len(self.parameters)), self.dtype)
        units[range(len(slots)), slots] = 1.0
        beside = [x.reshape(*leading, 1, *f.shape(label)) for label, (x, leading) in zip(f.reads, shaped, strict=True)]
        columns = f.of_frame(f.run(f"{BY_PARAMETERS}{TANGENT}", [*beside, units], inner=1), frame)
        return np.moveaxis(columns, len(lead), -1)

    def _differentiated(self, name: Method) -> Differentiated:
        return Differentiated.of(self._bound, name_of(name))
