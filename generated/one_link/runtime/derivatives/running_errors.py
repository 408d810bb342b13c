"""Results of a kernel with bounds of their rounding errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, Self, overload

import numpy as np
from numpy.typing import ArrayLike

from ...errors import ArrayError, InputError, UnknownNameError
from ...names import nearest_or_all, show
from ..arrays import flag, is_narrow, numbers_in, place_of, widened
from ..loop_assembly import LoopClosure, free_coordinates
from ..raw import Array
from .assemblies import assembled_errors
from .by_arguments import FRAMED
from .checked import CheckedKernel, Most
from .extended import IN_EXTENDED, as_bound, distance, run_extended
from .implicit_steps import STEP_RESIDUAL, bounded_step
from .solved_errors import SOLVED, Bounds

ASSEMBLED, STEP = "assemble", "implicit_step"
WITH_ERRORS = "_with_errors"  # ends the name of a function that bounds its errors, too
ERRORS, EXTENDED = "errors_", "extended_"  # begin names of what such functions write


class WithErrors(tuple[Array, Array]):
    """A result and the bounds of its rounding errors, both of the result's shape.

    Attributes:
        proved: whether the bounds are proved, for one state () or many (...,); where they are not, they are estimates.
    """

    proved: Array

    def __new__(cls, value: Array, bound: Array, proved: ArrayLike = True) -> WithErrors:
        """Pair a result with its bounds."""
        made = super().__new__(cls, (value, bound))
        made.proved = np.asarray(proved)
        return made

    @property
    def value(self) -> Array:
        """The result."""
        return self[0]

    @property
    def bound(self) -> Array:
        """Bounds of its errors."""
        return self[1]


class RunningErrors(LoopClosure):
    """Results with proved bounds of their rounding errors."""

    @overload
    def with_checks(self, wanted: bool) -> Self: ...

    @overload
    def with_checks(self, wanted: Literal["errors"], *, most: Most) -> CheckedKernel: ...

    def with_checks(self, wanted: bool | Literal["errors"], *, most: Most | None = None) -> Self | CheckedKernel:
        """Return the same code with other checks of its results.

        Args:
            wanted: True or False, whether NaN and infinity are refused (see ``checks``), with separate parameters; or
                "errors": methods that refuse a result which rounding may have moved by more than ``most``, or whose
                bound is not proved, of this kernel and its parameters.
            most: with "errors", the largest bound that is of use, as a share of the largest number of a state's result;
                or by the names of methods numbers or arrays that go with their results, in the results' units.

        Raises:
            InputError: another argument, or one that does not belong to the checks.
        """
        if isinstance(wanted, str) and wanted == "errors" and most is not None:
            return CheckedKernel(self, most)
        if most is not None or isinstance(wanted, str):
            raise InputError(
                f'checks: {show(wanted)} with most={show(most)}; allowed: True or False without most, "errors" with it'
            )
        return super().with_checks(wanted)

    def bounded_methods(self) -> tuple[str, ...]:
        """Return the names of the methods whose results ``with_errors`` bounds."""
        known = self.raw.functions
        plain = {x.removesuffix(WITH_ERRORS) for x in known if x.endswith(WITH_ERRORS)}
        closed = f"constrained_residual{IN_EXTENDED}" if self.constraints else f"residual{IN_EXTENDED}"
        solved = {
            x for x in SOLVED if x in known and (f"residual{IN_EXTENDED}" if x.startswith("tree_") else closed) in known
        }
        assembled = {ASSEMBLED} if self.constraints and f"constraint{IN_EXTENDED}" in known else set()
        stepped = (
            {STEP} if "rollout" in self.raw.rollouts and STEP_RESIDUAL in known and not self.raw.turning else set()
        )
        return tuple(sorted(plain | solved | assembled | stepped))

    def with_errors(
        self, name: str, args: Sequence[Any], *, most: ArrayLike | None = None, tight: bool = False
    ) -> WithErrors:
        """Return a method's result, and how far rounding has moved it at most: proved bounds, number by number.

        The bound is of the distance from what the equations give without rounding for the same arguments, parameters
        and constants, as the dtype holds them; it says nothing of errors that these have.  The result has the bits that
        the method gives, where compilers do not fuse products with sums (``native``), but for the last bits of
        "frame_jacobian", whose columns the method puts together in another order.

        - Without equations to solve, one call of C computes both, forwards, in one and a half to two times the time.
          With ``tight``, and of float32, a second call computes the result in double-double arithmetic: the bound is
          the error itself.
        - Solutions are bounded by what they leave of the equations in double-double arithmetic, if it can be proved
          that these have one solution: "forward_dynamics", of trees and with loops, "constraint_forces", and with loops
          "inverse_dynamics", "reactions" and "loop_reactions".
        - A state of "assemble", (q,) or (q, held), is bounded by its distance from one that is assembled exactly.
        - "implicit_step", (q, v, u, dt), is the state after a step of ``rollout`` by its method "implicit", q and v as
          (..., 2, n); of trees, and not of joints with 3-DOF rotation.

        Args:
            name: a method, such as "inverse_dynamics", "mass_matrix", "frame_pose", "energy", "forward_dynamics".
            args: its arguments in their order, such as (q, v, a) or (q, "tool"); without ``wrench``.
            most: the largest proved bounds that are of use, a number or an array that goes with the result.
            tight: whether bounds shall be the errors themselves, at the price of some fifty times the time.

        Returns:
            The result and its bounds, of the result's shape and dtype; ``proved`` of the pair is False for states in
            which they are estimates: where equations are, or rounding may make them, singular, as those of redundant
            constraints are.  Where a case changes within the errors (signs of velocities in friction), bounds have the
            difference of the cases.

        Raises:
            UnknownNameError: no such method or frame, or the kernel was built without bounds of its errors.
            InputError: another number of arguments.
            ArrayError: arrays of wrong shape or dtype, or with NaN or infinity; or a bound is larger than ``most``, or
                not proved.
            SingularError, LoopError: as of the method.
        """
        known, plain = self.raw.functions, isinstance(name, str)
        is_exact = flag("tight", tight) or self.dtype == np.float32
        if plain and is_exact and f"{name}{IN_EXTENDED}" in known:
            found = self._beside_extended(name, f"{name}{IN_EXTENDED}", args)
        elif plain and f"{name}{WITH_ERRORS}" in known:
            found = self._bounded_in_c(name, f"{name}{WITH_ERRORS}", args)
        elif plain and name in SOLVED and name in self.bounded_methods():
            found = self._of_solution(name, args)
        elif plain and name == ASSEMBLED and name in self.bounded_methods():
            found = self._assembled(args)
        elif plain and name == STEP and name in self.bounded_methods():
            found = self._stepped(args)
        else:
            raise UnknownNameError(
                f"{self.name} has no bounds of rounding errors of {show(name)}"
                f"{nearest_or_all(str(name), self.bounded_methods())}"
            )
        if most is not None:
            _refuse_above(name, found, most)
        return found

    def _bounded_in_c(self, name: str, function: str, args: Sequence[Any]) -> WithErrors:
        """Run a function that bounds its errors as it goes."""
        writes = self.raw.functions[function].writes
        arrays, frame = self._arrays(name, function, ERRORS, args)
        both = self.calls.run(function, None, arrays)
        value, bound = np.moveaxis(both, -len(self.raw.shapes[writes]), 0)
        if frame is None:
            return WithErrors(value, bound)
        return WithErrors(*_of_frame(writes.removeprefix(ERRORS), frame, value, bound))

    def _beside_extended(self, name: str, function: str, args: Sequence[Any]) -> WithErrors:
        """Compare a method's result with what the function gives in double-double arithmetic."""
        writes = self.raw.functions[function].writes
        arrays, frame = self._arrays(name, function, EXTENDED, args)
        exact = run_extended(self.calls, function, arrays)
        if frame is None:
            value = self.calls.run(name, None, arrays)
            return WithErrors(value, as_bound(distance(value, exact), self.dtype))
        kind = writes.removeprefix(EXTENDED)
        value = self.calls.run(name, None, arrays, (frame,))
        rows = exact.at(..., frame, slice(None), slice(None))
        bound = distance(value[..., : rows.high.shape[-2], :], rows)
        return WithErrors(value, as_bound(_with_last_row(bound, 0.0) if kind == FRAMED[0] else bound, self.dtype))

    def _arrays(self, name: str, function: str, begin: str, args: Sequence[Any]) -> tuple[list[Any], int | None]:
        """Return the arrays among arguments, and the number of the frame."""
        entry = self.raw.functions[function]
        is_framed = entry.writes.removeprefix(begin) in FRAMED
        _check_number(name, args, (*entry.reads, "frame") if is_framed else entry.reads)
        return list(args[: len(entry.reads)]), self.frame_index(args[-1]) if is_framed else None

    def _of_solution(self, name: str, args: Sequence[Any]) -> WithErrors:
        """Bound a method's result by what it leaves of the equations that it solves."""
        reads = self.raw.functions[name].reads
        _check_number(name, args, reads)
        if name == "constraint_forces" and self.couplings:
            raise InputError(
                f"with_errors: {name} of {self.name}, whose couplings ({', '.join(self.couplings)}) have forces behind"
                " those of loops, have no bounds; allowed: forward_dynamics, or robots without rigid couplings in trees"
            )
        value = self.calls.run(name, None, list(args))
        own = self.raw.shapes[self.raw.functions[name].writes]
        lead = value.shape[: value.ndim - len(own)]
        arrays: Mapping[str, Array] = {
            label: np.ascontiguousarray(
                np.broadcast_to(self.calls.array(label, x, self.raw.shapes[label])[0], (*lead, *self.raw.shapes[label]))
            ).reshape(-1, *self.raw.shapes[label])
            for label, x in zip(reads, args, strict=True)
        }
        bound: Callable[..., Bounds] = SOLVED[name]
        found = bound(self.calls, name, arrays, value.reshape(-1, *own))
        return WithErrors(value, as_bound(found.bound, self.dtype).reshape(value.shape), found.proved.reshape(lead))

    def _assembled(self, args: Sequence[Any]) -> WithErrors:
        """Bound how far an assembled state is from an exact one."""
        if not isinstance(args, (tuple, list)) or len(args) != 2:
            _check_number(ASSEMBLED, args, ("q",))
        held = args[1] if len(args) == 2 else ()
        value = self.assemble(args[0], held)
        lead = value.shape[:-1]
        states, narrow = value.reshape(-1, value.shape[-1]), is_narrow(self.calls, value)
        whole = widened(self.calls, "q", states) if narrow else states
        found = assembled_errors(self.calls, whole, free_coordinates(self.calls, held))
        bound = as_bound(found.bound, self.dtype)[:, : value.shape[-1]]
        return WithErrors(value, bound.reshape(value.shape), found.proved.reshape(lead))

    def _stepped(self, args: Sequence[Any]) -> WithErrors:
        """Bound how far the state after an implicit step is from the one that its equations have."""
        _check_number(STEP, args, ("q", "v", "u", "dt"))
        value, found = bounded_step(self.calls, *args)
        bound = as_bound(found.bound, self.dtype).reshape(value.shape)
        return WithErrors(value, bound, found.proved.reshape(value.shape[:-2]))


def _with_last_row(rows: Array, last: float) -> Array:
    """Return rows of poses, (..., 3, 4), with the last row, whose last number is given."""
    row = np.broadcast_to(np.array([0.0, 0.0, 0.0, last], rows.dtype), (*rows.shape[:-2], 1, 4))
    return np.concatenate([rows, row], axis=-2)


def _of_frame(writes: str, frame: int, value: Array, bound: Array) -> tuple[Array, Array]:
    """Select a frame's result of one for all frames, and its bounds."""
    value, bound = value[..., frame, :, :], bound[..., frame, :, :]
    return (_with_last_row(value, 1.0), _with_last_row(bound, 0.0)) if writes == FRAMED[0] else (value, bound)


def _check_number(name: str, args: Sequence[Any], wanted: Sequence[str]) -> None:
    """Refuse another number of arguments.

    Raises:
        InputError: there are more or fewer.
    """
    if not isinstance(args, (tuple, list)) or len(args) != len(wanted):
        got = len(args) if isinstance(args, (tuple, list)) else type(args).__name__
        raise InputError(f"{name}: got {got} arguments; allowed: ({', '.join(wanted)})")


def _refuse_above(name: str, found: WithErrors, most: ArrayLike) -> None:
    """Refuse bounds that are larger than what is asked for, or not proved.

    Raises:
        ArrayError: one of them is, or ``most`` has negative numbers or another shape.
    """
    bound, allowed = found.bound, numbers_in("most", most, "numbers from 0 on")
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
    if not found.proved.all():
        where = tuple(int(i) for i in np.argwhere(~found.proved)[0])
        raise ArrayError(
            f"{name}: what rounding moves the result by{place_of(list(where))} is an estimate, as its equations are"
            " singular there, or may be; allowed: bounds that are proved"
        )
