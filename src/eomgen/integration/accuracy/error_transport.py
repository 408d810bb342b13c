"""Global error of an integrated motion, estimated from what its samples leave of the equations of motion.

From every sample x_k the motion is followed to the time of the next one, far more closely than integrators do.  By what
the next sample differs, d_k = x_(k+1) - flow(x_k), is its local error, whoever integrated.  With R_k, the linearised
motion between both, the global error is to first order

    e_(k+1) = R_k e_k + d_k,

so that the error of a quantity is the sum of all d_k, each weighted by the quantity's adjoint.  (R. D. Skeel, Thirteen
ways to estimate global error, Numerische Mathematik 48, 1986, of which this is one of those with local errors.)
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...arrays import Array, Index, Mask
from ...errors import InputError, SingularError, check_kind
from ...names import listed
from ...robot.coordinates import unit_of
from ...runtime.by_name import WrenchLike
from ...runtime.kernel import Kernel
from ...shown import Shown, prefixed
from ...state.vectors import DriveFunction, MotionFunction, WrenchFunction
from ..drives import drive_beside_states, drive_of, wrench_beside_states
from ..solve import system_of
from ..trajectory import Trajectory
from .collocation import METHOD, ROUND_OFF, LinearSpans, collocate
from .many_states import ManyLoads, Stretch, turned_joints

NUMBERS = 2_000_000  # of the states that are looked at together
FINEST, COARSE = 64, 8  # parts of a span: the most, and up to which all have the derivatives at its middle
RESOLVED = 0.1  # of a local error: what halving the parts of a span may still change
RELIABLE = 0.3  # of the estimate: what references may leave open
SMALL = 1e-6  # size of the change by which errors are taken from some coordinates to others


@dataclass(frozen=True, kw_only=True)
class GlobalError(Shown):
    """Estimated global error of a motion: what was computed less the exact motion, to first order.

    Attributes:
        coordinates: names, (n,).
        q_error, v_error: of coordinates and velocities, (T, n).
        z_error: of states of laws, (T, states); None without any.
        tool_error: of the tool's position, (T, 3), m, base frame; None where no tool is known.
        tool_rotation_error: angle by which the tool is turned wrongly, (T,), rad; None without a tool.
        unresolved: how much of the estimate is open, from 0 to 1, because the motion was not followed closely enough
            between samples.
    """

    coordinates: tuple[str, ...]
    q_error: Array
    v_error: Array
    z_error: Array | None = None
    tool_error: Array | None = None
    tool_rotation_error: Array | None = None
    unresolved: float = 0.0

    @property
    def is_resolved(self) -> bool:
        """Whether the estimate can be relied on: at most 30 % of it are open."""
        return self.unresolved <= RELIABLE

    @property
    def tool_max(self) -> float | None:
        """Largest error of the tool's position, m; None without a tool."""
        return None if self.tool_error is None else float(np.linalg.norm(self.tool_error, axis=1).max())

    def largest(self, unit: str) -> tuple[str, float] | None:
        """Return the coordinate of this unit, "m" or "rad", with the largest error, and that; None without any."""
        columns = [i for i, name in enumerate(self.coordinates) if unit_of(name) == unit]
        if not columns:
            return None
        sizes = np.abs(self.q_error[:, columns]).max(axis=0)
        return self.coordinates[columns[int(sizes.argmax())]], float(sizes.max())

    def columns(self, tool: str) -> dict[str, tuple[str, Array]]:
        """Return unit and values over time by name: NAME.error of coordinates, and of the tool's position."""
        errors = zip(self.coordinates, self.q_error.T, strict=True)
        columns = {f"{name}.error": (unit_of(name), error) for name, error in errors}
        return columns if self.tool_error is None else {**columns, f"{tool}.error": ("m", self.tool_error)}

    def summary(self) -> dict[str, object]:
        """Return the largest errors, as plain numbers that JSON can hold; m, rad."""
        largest = {unit: self.largest(unit) for unit in ("m", "rad")}
        rotation = self.tool_rotation_error
        return {
            "tool": self.tool_max,
            "tool_rotation": None if rotation is None else float(rotation.max()),
            **{unit: None if entry is None else list(entry) for unit, entry in largest.items()},
            "unresolved": self.unresolved,
        }

    def line(self) -> str:
        """Return the largest errors in a line of text."""
        what = []
        if self.tool_error is not None and self.tool_rotation_error is not None:
            turned = prefixed(float(self.tool_rotation_error.max()), "rad")
            what.append(f"tool off by {prefixed(self.tool_max or 0.0, 'm')} and {turned}")
        for unit in ("m", "rad"):
            entry = self.largest(unit)
            what += [] if entry is None else [f"{entry[0]} by {prefixed(entry[1], unit)}"]
        text = f"error of integration (estimated, at most): {', '.join(what)}"
        if self.is_resolved:
            return text
        return f"{text}; not reliable: {100.0 * self.unresolved:.0f} % of it are open, a smaller output_step may help"


class ErrorTransport:
    """Global errors along a motion, piece by piece.

    Attributes:
        errors: of the samples of the last piece, (T, 2n), q then v.
    """

    def __init__(self) -> None:
        self._at: tuple[Stretch, Array, Array] | None = None  # where it got to, errors there, and what is open of these
        self._size = self._open = 0.0

    @property
    def unresolved(self) -> float:
        """Part of the largest error that references left open, from 0 to 1."""
        if self._open == 0.0:
            return 0.0
        return min(1.0, self._open / self._size) if self._size > 0.0 else 1.0

    def extend(self, loads: ManyLoads, times: Array, states: Array) -> Array:
        """Return errors of the samples of the next piece, (T, 2n), which begins with the last sample of the one before.

        Args:
            loads: drives, wrenches and prescribed motions of the piece.
            times: of the samples, s, (T,).
            states: described (q, v) there, (T, 2n).
        """
        turned = turned_joints(loads.kernel, states[:, : loads.kernel.n])
        errors, first = np.zeros_like(states), 0
        while first < times.size - 1:
            last = first + 1
            while last < times.size - 1 and turned[last] == turned[first]:
                last += 1
            stretch = Stretch(loads, turned[first], times[first : last + 1], states[first : last + 1])
            along, opened = self._along(stretch, *self._begin(stretch))
            f, rows = stretch.y.shape[1], slice(first, first + stretch.times.size)
            exact = stretch.described(stretch.times, stretch.y - along[:, :f], stretch.rate - along[:, f:])
            errors[rows] = stretch.described(stretch.times, stretch.y, stretch.rate) - exact
            self._size = max(self._size, float(np.abs(along[:, :f]).max(initial=0.0)))
            self._open = max(self._open, float(np.abs(opened[:, :f]).max(initial=0.0)))
            self._at = stretch, along[-1], opened[-1]
            first += stretch.times.size - 1
        return errors

    def _begin(self, stretch: Stretch) -> tuple[Array, Array]:
        """Return errors at the begin of a stretch, (2f,), and what is open of them, in its coordinates."""
        size = 2 * stretch.y.shape[1]
        if self._at is None:
            return np.zeros(size), np.zeros(size)
        before, error, opened = self._at
        return _taken(before, stretch, error), _taken(before, stretch, opened)

    def _along(self, stretch: Stretch, error: Array, opened: Array) -> tuple[Array, Array]:
        """Return errors at the nodes of a stretch, (K + 1, 2f), from that at the first; and what is open of them."""
        both, spans = [(error, opened)], stretch.times.size - 1
        each = max(8, NUMBERS // ((error.size + 1) * stretch.kernel.n * METHOD.c.size))
        for begin in range(0, spans, each):
            local = local_errors(stretch, np.arange(begin, min(begin + each, spans)))
            for propagator, by, left in zip(local.propagators, local.errors, local.left, strict=True):
                error, opened = propagator @ error + by, propagator @ opened + left
                both.append((error, opened))
        errors, opens = zip(*both, strict=True)
        return np.array(errors), np.array(opens)


def _taken(before: Stretch, stretch: Stretch, error: Array) -> Array:
    """Return an error at the end of a stretch, (2f,), in the coordinates of the next, by a small change."""
    size = float(np.abs(error).max(initial=0.0))
    if size == 0.0:
        return np.zeros(2 * stretch.y.shape[1])
    change, f = SMALL / size * error, before.y.shape[1]
    y, rate = before.y[-1] + np.outer([0.0, -1.0], change[:f]), before.rate[-1] + np.outer([0.0, -1.0], change[f:])
    here, there = np.hstack(stretch.reduced(before.described(before.times[[-1, -1]], y, rate)))
    return np.asarray((here - there) * (size / SMALL))


@dataclass(frozen=True, eq=False)
class LocalErrors:
    """Local errors of K spans.

    Attributes:
        errors: of y and its rates, (K, 2f).
        left: what halving the parts of the span changed last, (K, 2f).
        propagators: linearised motions over the spans, (K, 2f, 2f).
    """

    errors: Array
    left: Array
    propagators: Array


def local_errors(stretch: Stretch, rows: Index) -> LocalErrors:
    """Return local errors of the spans between nodes that begin at ``rows``, (K,), following on each other.

    Spans are followed in one part and in two, and in more where that changes their error.
    """
    reference = _Reference(stretch, rows)
    every = np.arange(rows.size)
    coarse, _ = reference.followed(every, 1, None)
    errors, propagators = reference.followed(every, 2, coarse)
    left, parts = errors - coarse, 2
    improves = np.ones(rows.size, dtype=bool)
    while parts < FINEST:
        parts *= 2
        again = np.flatnonzero(_unresolved(stretch, rows, errors, left) & improves)
        if not again.size:
            break
        finer, maps = reference.followed(again, parts, errors[again])
        change = finer - errors[again]
        if parts > COARSE:
            improves[again] = ~(np.linalg.norm(change, axis=1) > 0.5 * np.linalg.norm(left[again], axis=1))
        errors[again], left[again], propagators[again] = finer, change, maps
    lost = ~(np.isfinite(errors).all(axis=1) & np.isfinite(propagators).all(axis=(1, 2)))
    if lost.any():  # not followed at all: the whole step of the motion is open
        errors[lost], propagators[lost] = 0.0, np.eye(errors.shape[1])
        left[lost] = np.hstack([np.diff(x, axis=0)[rows[lost]] for x in (stretch.y, stretch.rate)])
    left[~np.isfinite(left)] = errors[~np.isfinite(left)]
    return LocalErrors(errors, left, propagators)


def _sizes(errors: Array) -> tuple[Array, Array]:
    """Return the sizes of errors of y and of rates, (K,) each."""
    f = errors.shape[1] // 2
    return np.linalg.norm(errors[:, :f], axis=1), np.linalg.norm(errors[:, f:], axis=1)


def _unresolved(stretch: Stretch, rows: Index, errors: Array, left: Array) -> Mask:
    """Return which spans have local errors that halving their parts still changes, (K,)."""
    bad = ~np.isfinite(left).all(axis=1)
    for sizes, open_, nodes in zip(_sizes(errors), _sizes(left), (stretch.y, stretch.rate), strict=True):
        usual = float(np.mean(sizes[~bad])) if not bad.all() else 0.0
        floor = 16.0 * ROUND_OFF * np.linalg.norm(nodes[rows], axis=1)
        bad = bad | ~(open_ <= RESOLVED * np.maximum(sizes, usual) + floor)
    return np.asarray(bad)


class _Reference:
    """The exact motion over spans of a stretch, from the samples at which they begin."""

    def __init__(self, stretch: Stretch, rows: Index) -> None:
        self._stretch, self._rows = stretch, rows
        self._t, self._h = stretch.times[rows], stretch.times[rows + 1] - stretch.times[rows]
        nodes = np.append(rows, rows[-1] + 1)
        ends = stretch.accelerations(stretch.times[nodes], stretch.y[nodes], stretch.rate[nodes])
        self._ends = ends[:-1], ends[1:]
        self._slopes = self._slopes_at(np.arange(rows.size), 0.5)
        self._stages: Array | None = None

    def _slopes_at(self, spans: Index, share: float) -> tuple[Array, Array]:
        times = self._t[spans] + share * self._h[spans]
        by_y, by_rate = self._stretch.slopes(times, *self._stretch.between(times))
        return np.nan_to_num(by_y), np.nan_to_num(by_rate)

    def followed(self, spans: Index, parts: int, errors: Array | None) -> tuple[Array, Array]:
        """Return local errors of spans followed in so many parts, (K, 2f), NaN where that fails; and propagators.

        Args:
            spans: numbers of the spans, (K,); all of them in one part first.
            errors: local errors as they are known, (K, 2f).
        """
        stretch, rows = self._stretch, self._rows[spans]
        y, rate, target = stretch.y[rows], stretch.rate[rows], (stretch.y[rows + 1], stretch.rate[rows + 1])
        h, whole, is_good = self._h[spans] / parts, np.eye(2 * y.shape[1]), np.ones(spans.size, dtype=bool)
        sizes = _sizes(np.full((spans.size, 2), np.inf) if errors is None else np.nan_to_num(errors, nan=np.inf))
        linear = LinearSpans.of(h, *(x[spans] for x in self._slopes))
        for part in range(parts):
            if parts > COARSE:
                linear = LinearSpans.of(h, *self._slopes_at(spans, (part + 0.5) / parts))
            begin = self._t[spans] + part * h, y, rate
            guess = self._guess(spans, (part + METHOD.c) / parts)
            solved = collocate(stretch.accelerations, begin, linear, guess, sizes, target if parts == 1 else None)
            y, rate, is_good = solved.y, solved.rate, is_good & solved.is_good
            if parts > 1:
                whole = linear.propagators() @ whole
            else:
                self._stages = np.where(is_good[:, np.newaxis, np.newaxis], solved.stages, np.nan)
        found = np.hstack([target[0] - y, target[1] - rate])
        found[~is_good] = np.nan
        return found, whole

    def _guess(self, spans: Index, shares: Array) -> Array:
        """Return guesses of accelerations at shares of the spans, (K, s, f): of spans in one part, or between ends."""
        share = shares[:, np.newaxis]
        linear = self._ends[0][spans, np.newaxis] * (1.0 - share) + self._ends[1][spans, np.newaxis] * share
        if self._stages is None:
            return np.nan_to_num(linear)
        powers = np.arange(METHOD.c.size)
        through = share**powers @ np.linalg.inv(METHOD.c[:, np.newaxis] ** powers)
        guess = through @ self._stages[spans]
        return np.nan_to_num(np.where(np.isfinite(guess), guess, linear))


def global_error(
    kernel: Kernel,
    trajectory: Trajectory,
    *,
    drive: DriveFunction | ArrayLike | None = None,
    wrench: WrenchFunction | WrenchLike | None = None,
    prescribed: MotionFunction | None = None,
) -> GlobalError:
    """Estimate the global error of a motion of a kernel, whoever integrated it, from its samples alone.

    It is an estimate of first order: of errors that are small beside the motion.  What it takes for exact are the first
    sample, the times, and the laws as they are described.

    Args:
        kernel: as of ``integrate``.
        trajectory: of that kernel with two samples at least.
        drive, wrench, prescribed: under which it moved, as of ``integrate``.

    Raises:
        InputError: the trajectory is not of the kernel, or an argument is wrong.
        ArrayError: a load at the first sample has another shape, or is not finite.
        LoopError: a sample violates the constraints.
    """
    check_kind("kernel", kernel, hasattr(kernel, "calls"), "a Kernel (of eomgen.build, or of a generated package)")
    check_kind(
        "trajectory", trajectory, isinstance(trajectory, Trajectory), "a Trajectory, of eomgen.integration.integrate"
    )
    if trajectory.coordinates != kernel.coordinates or (trajectory.memory or ()) != kernel.memory:
        got, allowed = listed(trajectory.coordinates), listed(kernel.coordinates)
        raise InputError(f"trajectory: is of {got}; allowed: a motion of {kernel.name}, of {allowed}")
    system = system_of(
        kernel, drive_beside_states(drive_of(kernel, drive), kernel), wrench_beside_states(wrench, kernel), prescribed
    )
    transport, loads, (q, v, _) = ErrorTransport(), ManyLoads(system), trajectory.joined()
    with suppress(SingularError):  # of angles, which other coordinates have not; wrong loads are refused here
        u, wrenches = loads.at(trajectory.t[:1], q[:1], v[:1])
        kernel.forward_dynamics(q[:1], v[:1], u, wrench=wrenches)
    errors = transport.extend(loads, trajectory.t, np.hstack([q, v]))
    return error_of(kernel, errors, transport.unresolved)


def error_of(kernel: Kernel, errors: Array, unresolved: float) -> GlobalError:
    """Return errors of a kernel's states, (T, 2n), with those of states of laws apart."""
    n = len(kernel.coordinates)
    q, v, z = (
        np.ascontiguousarray(x) for x in (errors[:, :n], errors[:, kernel.n : kernel.n + n], errors[:, kernel.n + n :])
    )
    return GlobalError(
        coordinates=kernel.coordinates,
        q_error=q,
        v_error=v,
        z_error=z if kernel.memory else None,
        unresolved=unresolved,
    )
