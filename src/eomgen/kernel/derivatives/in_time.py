"""Time derivatives of what a kernel computes, along motions that are given by their own: exact."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...errors import InputError, UnknownNameError
from ...names import listed, nearest_or_all, show
from ...runtime.arrays import OF_ORDERS, names_in, place_of
from ...runtime.bound import frame_number
from ...runtime.raw import Array, Method, name_of
from ..loop_assembly import LoopClosure, closed_rates, free_coordinates
from .by_arguments import FRAMED

MOTION = ("q", "v", "a", "jerk", "snap", "crackle", "pop")  # time derivatives of coordinates, by their order
ORDERS = (1, 2, 3, 4)
JET = re.compile(r"_jet\d$")


class _Request(NamedTuple):
    """Function of C that a call of ``jet`` needs, and what it reads.

    Attributes:
        function: its name.
        order: the highest of the time derivatives.
        motion: names of the time derivatives of coordinates.
        others: by the name of each further array those of it and of its time derivatives.
        writes: what the function writes, without orders.
    """

    function: str
    order: int
    motion: tuple[str, ...]
    others: tuple[tuple[str, ...], ...]
    writes: str


class TimeDerivatives(LoopClosure):
    """Time derivatives along motions, of any order up to four."""

    def jet(self, name: Method, series: Sequence[Any], order: int = 1) -> tuple[Array, ...]:
        """Return a method's result and its time derivatives along a motion: f, f', f'', ...; exact.

        They are coefficients of a truncated Taylor series through the equations; run-time parameters and joints'
        placements are constant.  With loops closed the motion has to close them, with all its time derivatives:
        ``close_series`` completes one.

        Args:
            name: the method or its name, such as "inverse_dynamics", "forward_dynamics", "frame_pose", "mass_matrix";
                without ``wrench``.
            series: time derivatives of the coordinates, q, v, a, jerk, snap, ..., each (n,) or (..., n), as many as
                function and order need: q'''' for the inverse dynamics to order 2.  More are not read.  Behind them
                for each further array that the method reads, u, wrench or z, a tuple of the array and its time
                derivatives, ``order`` + 1 in all, then a frame's name where the method takes one.
            order: the highest time derivative, 1 to 4.

        Returns:
            ``order`` + 1 arrays of the result's shape; the matrices of ``forward_dynamics_jacobian`` and
            ``residual_jacobian`` in one array, (3, n, n).

        Raises:
            UnknownNameError: no such method or frame, or the kernel was built without its time derivatives.
            InputError: a series that is too short for the order, or another order; Christoffel symbols or derivatives
                of accelerations of so many coordinates that a program of their time derivatives would be too long.
            ArrayError: an array of wrong shape or dtype, or with NaN or infinity.
            SingularError, LoopError: as of the method.
        """
        name = name_of(name)
        wanted = self._requested(name, order)
        motion, others, frame = _split(name, wanted, series)
        index = frame_number(self.frames, frame) if wanted.writes in FRAMED else None
        given = dict(zip(wanted.motion, motion, strict=True))
        for names, one in zip(wanted.others, others, strict=True):
            given |= dict(zip(names, one, strict=True))
        function = self.raw.functions[wanted.function]
        if function.closes:
            values = [*motion[: len(wanted.motion) - order], *(one[0] for one in others)]
            z = values.pop() if "z" in given else None
            self.calls.run(name, None, values, z=z)
        none = {x: np.zeros(self.raw.shapes[x], self.dtype) for x in function.reads if x not in given}
        evaluated: Callable[..., Any] = self._bound[wanted.function]
        orders: tuple[Array, ...] = evaluated(*({**none, **given}[x] for x in function.reads), None)
        if index is None:
            return orders
        return tuple(_of_frame(x, index, wanted.writes, k) for k, x in enumerate(orders))

    def close_series(self, series: Sequence[ArrayLike], fixed: Iterable[str] = ()) -> tuple[Array, ...]:
        """Return time derivatives of coordinates that keep loops closed, those next to a guess: q, v, a, jerk, ...

        Coordinates that depend on others follow by implicit differentiation of the constraint, order by order; each
        change is that of least kinetic energy, as in ``project_velocity``.

        Args:
            series: the guess, each (n,) or (..., n): zeros where nothing is known of a dependent coordinate.
            fixed: names of coordinates that stay as they are given; those of prescribed ones do.

        Returns:
            As many arrays, with the leading axes of all of them.

        Raises:
            LoopError: loops cannot be closed, or not by motions that have what is fixed.
            UnknownNameError, InputError: an unknown name, no loops, or other than 2 to 7 arrays.
            SingularError: as of ``project_velocity``.
        """
        if not isinstance(series, (tuple, list)) or not 2 <= len(series) <= len(MOTION):
            got = len(series) if isinstance(series, (tuple, list)) else type(series).__name__
            raise InputError(f"series: got {got}; allowed: 2 to {len(MOTION)} arrays, {', '.join(MOTION)}")
        names = [fixed] if isinstance(fixed, str) else names_in("fixed", fixed)
        free = free_coordinates(self.calls, names)
        whole = [self.calls.array(label, x, (self.n,)) for label, x in zip(MOTION, series, strict=False)]
        arrays = np.broadcast_arrays(*(array for array, _ in whole))
        q = self.assemble(arrays[0], names)
        motion = [q, self.project_velocity(q, arrays[1], names)]
        for guess in arrays[2:]:
            flat = [x.reshape(-1, x.shape[-1]) for x in (*motion, guess)]
            rest = self._constraint_rest(flat[:-1])
            closed = closed_rates(self.calls, flat[0], flat[-1], free, lambda i: place_of([i]), rest)
            motion.append(closed.reshape(guess.shape))
        return tuple(motion)

    def _constraint_rest(self, motion: Sequence[Array]) -> Array:
        """Return what the constraint's next time derivative has beside J times that of the coordinates, (N, m)."""
        order = len(motion) - 2
        if order == 0:
            return self.calls.run(self.functions.constraint_bias, None, motion)
        rest = self.jet(self.functions.constraint_bias, motion, order)[order]
        for i, J in enumerate(self.jet(self.functions.constraint_jacobian, motion[:-1], order)[1:], 1):
            rest = rest + math.comb(order, i) * np.einsum("kmn,kn->km", J, motion[order + 2 - i])
        return rest

    def _requested(self, name: str, order: int) -> _Request:
        """Find the function of C of a method's time derivatives up to an order."""
        if isinstance(order, bool) or not isinstance(order, (int, np.integer)) or order not in ORDERS:
            raise InputError(f"order: {show(order)}; allowed: {ORDERS[0]} to {ORDERS[-1]}")
        known, function = self.raw.functions, f"{name}_jet{order}"
        if function not in known:
            available = sorted({JET.sub("", x) for x in known if JET.search(x)})
            raise UnknownNameError(
                f"{self.raw.name} was built without time derivatives of {show(name)} to order {order}"
                f"{nearest_or_all(str(name), available)}"
            )
        reads = known[function].reads
        motion = tuple(x for x in reads if x in MOTION)
        rest = reads[len(motion) :]
        series = [rest[i : i + order + 1] for i in range(0, len(rest), order + 1)]
        others = tuple(sorted((x for x in series if x[0] != "forces"), key=lambda x: x[0] == "z"))  # z behind others
        return _Request(function, int(order), motion, others, OF_ORDERS.sub("", known[function].writes))


def _split(name: str, wanted: _Request, series: Sequence[Any]) -> tuple[list[Any], list[Sequence[Any]], Any]:
    """Take a series apart: time derivatives of coordinates, those of other arrays, and a frame's name."""
    framed = wanted.writes in FRAMED
    behind = [f"({', '.join(names)})" for names in wanted.others] + (["frame"] if framed else [])
    allowed = ", ".join([*wanted.motion, *behind])
    if not isinstance(series, (tuple, list)):
        raise InputError(f"series: got {type(series).__name__}; allowed: ({allowed})")
    end = len(series) - len(behind)
    motion, rest = list(series[: max(end, 0)]), series[max(end, 0) :]
    if len(motion) < len(wanted.motion):
        missing = wanted.motion[len(motion) :]
        lacks = f"lacks {listed(missing)}" if end >= 0 else "is too short"
        raise InputError(
            f"series: {lacks}, which {name} to order {wanted.order} needs, got {len(series)}; allowed: ({allowed})"
        )
    others = list(rest[: len(wanted.others)])
    for names, one in zip(wanted.others, others, strict=True):
        if not isinstance(one, (tuple, list)) or len(one) != len(names):
            got = len(one) if isinstance(one, (tuple, list)) else type(one).__name__
            raise InputError(f"series of {names[0]}: got {got}; allowed: ({', '.join(names)})")
    return motion[: len(wanted.motion)], others, rest[-1] if framed else None


def _of_frame(result: Array, frame: int, writes: str, order: int) -> Array:
    """Select a frame's result of one for all frames; of a pose with its last row."""
    rows: Array = result[..., frame, :, :]
    if writes != "poses":
        return rows
    last = np.broadcast_to(np.array([0.0, 0.0, 0.0, float(order == 0)], rows.dtype), (*rows.shape[:-2], 1, 4))
    return np.concatenate([rows, last], axis=-2)
