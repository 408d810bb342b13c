"""Results of a kernel with bounds of their rounding errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...errors import ArrayError, InputError, SingularError, UnknownNameError
from ...names import nearest_or_all, show
from ..arrays import numbers_in, place_of
from ..compiled_code import CompiledCode
from ..raw import Array
from .by_arguments import FRAMED

WITH_ERRORS = "_with_errors"  # ends the name of a function that bounds its errors, too
ERRORS = "errors_"  # begins the name of what it writes
SOLVED = "forward_dynamics"  # whose error is bounded by what its result leaves of the equations
MARGIN = 1.0 + 1e-9  # for roundings of these bounds themselves, in double precision


class RunningErrors(CompiledCode):
    """Results with proved bounds of their rounding errors."""

    def with_errors(self, name: str, args: Sequence[Any], *, most: ArrayLike | None = None) -> tuple[Array, Array]:
        """Return a method's result, and how far rounding has moved it at most: proved bounds, number by number.

        One call of C computes both, forwards, in two to three times the time; the result has the bits that the method
        gives, where compilers do not fuse products with sums (``native``).  The bound is of the distance from what the
        equations give without rounding for the same arguments, parameters and constants, as the dtype holds
        them; it says nothing of errors that these have.  Accelerations of "forward_dynamics" are bounded by what they
        leave of the equations, if M can be proved to be invertible.

        Args:
            name: a method that solves no equations, such as "inverse_dynamics", "mass_matrix", "frame_pose", "energy";
                or "forward_dynamics" of a robot without loops, prescribed coordinates and states of laws.
            args: its arguments in their order, such as (q, v, a) or (q, "tool"); without ``wrench``.
            most: the largest bounds that are of use, a number or an array that goes with the result.

        Returns:
            The result and its bounds, of the result's shape and dtype.  Where a case changes within the errors (signs
            of velocities in friction), bounds have the difference of the cases.

        Raises:
            UnknownNameError: no such method or frame, or the kernel was built without bounds of its errors.
            InputError: another number of arguments.
            ArrayError: arrays of wrong shape or dtype, or with NaN or infinity; or a bound is larger than ``most``.
            SingularError: rounding may make the mass matrix singular.
        """
        function = f"{name}{WITH_ERRORS}" if isinstance(name, str) else ""
        if function in self.raw.functions:
            value, bound = self._bounded_in_c(name, function, args)
        elif isinstance(name, str) and name == SOLVED and SOLVED in self.raw.functions:
            value, bound = self._bounded_by_residual(args)
        else:
            known = [x.removesuffix(WITH_ERRORS) for x in self.raw.functions if x.endswith(WITH_ERRORS)]
            raise UnknownNameError(
                f"{self.name} has no bounds of rounding errors of {show(name)}{nearest_or_all(str(name), known)}"
            )
        if most is not None:
            _refuse_above(name, bound, most)
        return value, bound

    def _bounded_in_c(self, name: str, function: str, args: Sequence[Any]) -> tuple[Array, Array]:
        entry = self.raw.functions[function]
        writes = entry.writes.removeprefix(ERRORS)
        is_framed = writes in FRAMED
        _check_number(name, args, (*entry.reads, "frame") if is_framed else entry.reads)
        frame = self.frame_index(args[-1]) if is_framed else None
        both = self.calls.run(function, None, list(args[: len(entry.reads)]))
        value, bound = np.moveaxis(both, -len(self.raw.shapes[entry.writes]), 0)
        if frame is None:
            return value, bound
        value, bound = value[..., frame, :, :], bound[..., frame, :, :]
        if writes != FRAMED[0]:
            return value, bound
        last = np.broadcast_to(np.array([0.0, 0.0, 0.0, 1.0], self.dtype), (*value.shape[:-2], 1, 4))
        return np.concatenate([value, last], axis=-2), np.concatenate([bound, np.zeros_like(last)], axis=-2)

    def _bounded_by_residual(self, args: Sequence[Any]) -> tuple[Array, Array]:
        """Bound accelerations a by the residual r = M a + h - u with its own errors: |da| <= |M^-1| |r|.

        M^-1 is enclosed by an approximate inverse R of M: with |1 - R M| <= G and a norm g < 1 of G it is R within
        g / (1 - g); the errors of M are in G.  All is scaled so that M has ones on its diagonal.
        """
        meta = self.raw.libraries.meta
        for what, names in (
            ("loops", meta.get("constraints")),
            ("prescribed coordinates", self.prescribed),
            ("states of laws", self.memory),
        ):
            if names:
                raise InputError(
                    f"with_errors: {SOLVED} of {self.name}, which has {what} ({names[0]}), has no bounds of rounding"
                    " errors; allowed: of robots without loops, prescribed coordinates and states of laws"
                )
        _check_number(SOLVED, args, self.raw.functions[SOLVED].reads)
        q, v, u = args
        a = self.calls.run(SOLVED, None, (q, v, u))
        q, v, u = (
            np.broadcast_to(self.calls.array(x, y, self.raw.shapes[x])[0], a.shape)
            for x, y in zip("qvu", args, strict=True)
        )
        M, of_M = (
            np.asarray(x, np.float64) for x in self._bounded_in_c("mass_matrix", "mass_matrix_with_errors", (q,))
        )
        moved, of_moved = self._bounded_in_c("inverse_dynamics", "inverse_dynamics_with_errors", (q, v, a))
        unit = np.finfo(np.float64).eps
        left = np.asarray(moved, np.float64) - np.asarray(u, np.float64)
        left = np.abs(left) * (1.0 + unit) + of_moved
        scale = 1.0 / np.sqrt(np.einsum("...ii->...i", M))
        both = scale[..., :, None] * scale[..., None, :]
        try:
            R = np.linalg.inv(M * both) * both
        except np.linalg.LinAlgError:
            raise self._not_sure(q) from None
        size, n = np.abs(R), a.shape[-1]
        off = np.abs(np.eye(n) - R @ M) + size @ of_M + (n + 2) * unit * (size @ np.abs(M) + np.eye(n))
        off = off / scale[..., :, None] * scale[..., None, :] * MARGIN
        norm = off.sum(axis=-1).max(axis=-1)
        if not np.all(norm < 1.0):
            raise self._not_sure(q)
        near = np.einsum("...ij,...j->...i", size, left) / scale * MARGIN
        rest = off.sum(axis=-1) / (1.0 - norm)[..., None] * near.max(axis=-1)[..., None]
        bound = (near + rest) * scale * MARGIN
        tiny = np.finfo(self.dtype).smallest_subnormal
        return a, np.nextafter(bound.astype(self.dtype), np.inf).astype(self.dtype) + tiny

    def _not_sure(self, q: Array) -> SingularError:
        first = show([float(x) for x in np.reshape(q, (-1, q.shape[-1]))[0]])
        return SingularError(
            f"with_errors: {SOLVED}: {self.name}: rounding errors may make the mass matrix singular in a state such as"
            f" {first}; allowed: states in which it is regular in {self.dtype}"
        )


def _check_number(name: str, args: Sequence[Any], wanted: Sequence[str]) -> None:
    """Refuse another number of arguments.

    Raises:
        InputError: there are more or fewer.
    """
    if not isinstance(args, (tuple, list)) or len(args) != len(wanted):
        got = len(args) if isinstance(args, (tuple, list)) else type(args).__name__
        raise InputError(f"{name}: got {got} arguments; allowed: ({', '.join(wanted)})")


def _refuse_above(name: str, bound: Array, most: ArrayLike) -> None:
    """Refuse bounds that are larger than what is asked for.

    Raises:
        ArrayError: one of them is, or ``most`` has negative numbers or another shape.
    """
    allowed = numbers_in("most", most, "numbers from 0 on")
    try:
        above = ~(bound <= np.broadcast_to(allowed, bound.shape))
    except ValueError:
        raise ArrayError(
            f"most: got shape {allowed.shape}; allowed: one that goes with the result, {bound.shape}"
        ) from None
    if not (allowed >= 0.0).all():
        raise ArrayError(f"most: got {show(float(np.min(allowed)))}; allowed: 0 and more")
    if above.any():
        where = tuple(int(i) for i in np.argwhere(above)[0])
        asked = float(np.broadcast_to(allowed, bound.shape)[where])
        raise ArrayError(
            f"{name}: rounding moves the result{place_of(list(where))} by up to {float(bound[where]):.3g}; allowed:"
            f" most, {asked:.3g}"
        )
