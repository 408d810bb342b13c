"""Input signals over time that a kernel's C follows: actuator forces, reference trajectories, wrenches, motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import ArrayError
from ...names import show
from ...runtime.arrays import numbers_in
from ...runtime.calls import Calls

Array = NDArray[np.float64]
Index = NDArray[np.intp]

JUMP = 1e-9  # of the largest value, beside which pieces of a signal meet
WORKS = ("drives", "prescribed", "wrenches", "dissipated")  # that C integrates, in its order


@dataclass(frozen=True, eq=False)
class Signal:
    """Columns over time: polynomials of t - knots[k] between knots[k] and knots[k + 1], constant outside.

    Attributes:
        knots: (pieces + 1,), s, increasing.
        coefficients: (pieces, degree + 1, columns), of rising powers.
        profile: a signal of one column that stands in the place of time, or None.
    """

    knots: Array
    coefficients: Array
    profile: Signal | None = None

    @classmethod
    def through(cls, times: ArrayLike, samples: ArrayLike) -> Signal:
        """Make a signal of straight lines between samples, (T, columns), at times, s, (T,), increasing.

        Raises:
            ArrayError: they are none, or do not go together.
        """
        rising = "two or more finite numbers (T,) that increase, s"
        knots = numbers_in("times", times, rising)
        if knots.ndim != 1 or knots.size < 2 or not (np.diff(knots) > 0.0).all():
            raise ArrayError(f"times: {show(times)}; allowed: {rising}")
        allowed = f"finite numbers ({knots.size}, columns)"
        x = numbers_in("samples", samples, allowed)
        if x.ndim != 2 or len(x) != knots.size:
            raise ArrayError(f"samples: got shape {x.shape}; allowed: {allowed}")
        rates = np.diff(x, axis=0) / np.diff(knots)[:, None]
        return cls(knots, np.stack([x[:-1], rates], axis=1))

    def by_samples(self, by_coefficients: ArrayLike) -> Array:
        """Convert derivatives by its coefficients to those by the samples that it goes ``through``, (T, columns)."""
        by = np.asarray(by_coefficients, dtype=np.float64)
        rates = by[:, 1] / np.diff(np.asarray(self.knots))[:, None]
        slopes = np.zeros((len(by) + 1, self.columns))
        slopes[:-1] += by[:, 0] - rates
        slopes[1:] += rates
        return slopes

    @classmethod
    def constant(cls, values: ArrayLike) -> Signal:
        """Make a signal of constant columns, (columns,); ArrayError where they are no numbers."""
        columns = numbers_in("values", values, "numbers (columns,)", finite=False)
        return cls(np.array([0.0, 1.0]), columns.reshape(1, 1, -1))

    @property
    def columns(self) -> int:
        """Number of columns."""
        return int(self.coefficients.shape[2])


@dataclass(frozen=True, eq=False)
class Track:
    """A signal whose columns are those of the coordinates at ``place``, (columns,)."""

    signal: Signal
    place: Index


@dataclass(frozen=True, eq=False)
class Gains:
    """kp and kd of a program's columns, (m,) each, of joints: kp (program - q / ratio) + kd (its rate - v / ratio)."""

    kp: Array
    kd: Array


@dataclass(frozen=True, eq=False)
class ChartData:
    """Chart of a closed mechanism: the coordinates that depend on the driven ones.

    Attributes:
        calls: of its kernel, with "following" and "residual", some of whose joints are turned.
        turned: which of ``MechanismData.joints`` these are, (k,).
        chart: which coordinates are dependent, as "following" reads it.
    """

    calls: Calls
    turned: Sequence[bool]
    chart: Array


@dataclass(frozen=True, eq=False)
class MechanismData:
    """Charts along which drives move a rigid robot with loops.

    Attributes:
        charts: one at least; where the angles of the first are singular, that whose are farthest from it counts.
        joints: places of alpha and of x, -1 without any, of those that may be turned, k of them.
        driven: which coordinates have a drive, (size,).
    """

    charts: Sequence[ChartData]
    joints: Sequence[tuple[int, int]]
    driven: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class ModelDrive:
    """Actuator forces by the inverse dynamics of a rigid robot, of float64.

    Attributes:
        calls: of its kernel.
        place: its coordinates among those of the robot, or of the motors in front of them, (size,).
        ratio: of the gears in between, (size,).
        column: of the program that drives each of them, or -1.
        given: which of the prescribed motions each follows, or -1.
        bandwidth: with which errors die out, rad/s; None where it holds against gravity and no more.
        mechanism: what takes the place of inverse dynamics where it has loops.
    """

    calls: Calls
    place: Index
    ratio: Array
    column: Index
    given: Index
    bandwidth: float | None
    mechanism: MechanismData | None = None


@dataclass(frozen=True, eq=False)
class Waves:
    """Prescribed motions, of coordinates in the order of ``Kernel.prescribed``, m of them.

    Attributes:
        wave: amplitude, angular frequency (rad/s), phase (rad) and offset, (m, 4): offset + amplitude sin(w t + phase).
        tracks: signals that stand in their places; ``place`` is among the m.
    """

    wave: Array
    tracks: Sequence[Track] = ()


@dataclass(frozen=True, eq=False)
class LinkWrench:
    """Force (N) and moment (N m) on a link's centre of mass over time: a signal of six columns.

    Attributes:
        link: its place in ``Kernel.links``.
        signal: in the base's axes, or in the link's where it ``turns``.
        arm: from the centre of mass to where the force acts, (3,), m, in the link's axes.
        t0, t1: s, from when on and until when.
    """

    link: int
    signal: Signal
    arm: Array = field(default_factory=lambda: np.zeros(3))
    t0: float = -np.inf
    t1: float = np.inf
    turns: bool = False


@dataclass(frozen=True, eq=False)
class DriveData:
    """Actuator forces as data: over time, or of gains, a model, or both that track a reference trajectory.

    Attributes:
        torque: forces, N or N m, by coordinate.
        program: of driven coordinates, m or rad at the joint, or None.
        ratio: of the gears between these and the coordinates at ``program.place``, (m,).
        gains, model: what follows the program.
        effort: greatest force of all that drives do at a coordinate, (n,), infinite where there is none; None for none.
    """

    torque: Track | None = None
    program: Track | None = None
    ratio: Array | None = None
    gains: Gains | None = None
    model: ModelDrive | None = None
    effort: Array | None = None


@dataclass(frozen=True, eq=False)
class InputSignals:
    """Time-signal inputs: everything that acts on a robot over time.

    Attributes:
        drive: of its drives.
        wrenches: on its links.
        prescribed: motions of its prescribed coordinates, or None.
        first, last: times, s, between which drives and wrenches are asked: what jumps at either is not seen.
    """

    drive: DriveData = field(default_factory=DriveData)
    wrenches: Sequence[LinkWrench] = ()
    prescribed: Waves | None = None
    first: float = -np.inf
    last: float = np.inf


def work_kernels(calls: Calls) -> tuple[str, ...]:
    """Return names of the kernels that work integrals need."""
    meta = calls.raw.libraries.meta
    needed = "residual" if meta.get("constraints") else "inverse_dynamics"
    drives = ("drive_forces",) if meta.get("inputs") else ()
    return ("generalized_force", *drives, *((needed,) if calls.prescribed else ()))


@dataclass(frozen=True)
class Slopes:
    """Names of the derivatives that differentiated steps call, by fields of the C.

    Attributes:
        model: of a model's inverse dynamics.
        forces: of the forces that wrenches make.
        poses: of the poses of the links that wrenches turn with.
    """

    model: tuple[str, str]
    forces: Mapping[str, str]
    poses: Mapping[str, str]


BACK = Slopes(
    ("back", "inverse_dynamics_adjoint"),
    {"force_back": "external_force_parameter_adjoint"},
    {"pose_back": "frame_pose_parameter_adjoint"},
)
ALONG = Slopes(
    ("along", "inverse_dynamics_tangent"),
    {"force_along": "external_force_tangent", "force_by": "external_force_parameter_tangent"},
    {"pose_along": "frame_pose_tangent", "pose_by": "frame_pose_parameter_tangent"},
)


def jump_times(loads: InputSignals, *, every: bool = False) -> Array:
    """Return times at which input signals or their rates jump, s, increasing: steps with error control end there.

    Args:
        every: whether all knots of signals count, as they do for derivatives by their coefficients: one changes its
            piece alone.
    """
    drive = loads.drive
    tracks = [x for x in (drive.torque, drive.program) if x is not None]
    tracks += [] if loads.prescribed is None else loads.prescribed.tracks
    signals = [track.signal for track in tracks] + [wrench.signal for wrench in loads.wrenches]
    each = {id(signal): signal for signal in signals}.values()
    jumps = [_jumps(signal, every=every) for signal in each]
    ends = [loads.first, loads.last, *(t for wrench in loads.wrenches for t in (wrench.t0, wrench.t1))]
    times: Array = np.unique(np.concatenate([*jumps, np.array(ends, dtype=np.float64)]))
    return times[np.isfinite(times)]


def _jumps(signal: Signal, *, every: bool) -> Array:
    """Return times at which a signal, its rate or its acceleration jumps, or of all its knots, s."""
    knots, c = (np.asarray(x, dtype=np.float64) for x in (signal.knots, signal.coefficients))
    places = knots
    if c.shape[:2] == (1, 1):
        places = knots[:0]  # it rests
    elif not every:
        places = knots[_jump(knots, c)]
    if signal.profile is None:
        return places
    return np.concatenate([_jumps(signal.profile, every=every), _crossings(signal.profile, places)])


def _jump(knots: Array, c: Array) -> Array:
    """Return the mask of knots at which pieces of these coefficients do not meet, (knots,); outside all is constant."""
    is_jump, widths = np.zeros(knots.size, dtype=bool), np.diff(knots)[:, None]
    for order in range(3):
        begins = c[:, 0] if c.shape[1] else np.zeros((len(c), c.shape[2]))
        ends, sizes = np.zeros_like(begins), np.zeros_like(begins)
        for power in range(c.shape[1] - 1, -1, -1):
            ends, sizes = ends * widths + c[:, power], sizes * widths + np.abs(c[:, power])
        rest = np.zeros((1, c.shape[2]))
        before = np.concatenate([begins[:1] if order == 0 else rest, ends])
        behind = np.concatenate([begins, ends[-1:] if order == 0 else rest])
        least = JUMP * sizes.max(axis=0, initial=0.0)
        is_jump |= (np.abs(behind - before) > least).any(axis=1)
        c = c[:, 1:] * np.arange(1, c.shape[1])[:, None]  # of the next derivative
    return is_jump


def _crossings(profile: Signal, places: Array) -> Array:
    """Return times at which a profile comes to these places, s."""
    crossings = [np.zeros(0)]
    knots, c = (np.asarray(x, dtype=np.float64) for x in (profile.knots, profile.coefficients))
    for begin, width, polynomial in zip(knots[:-1], np.diff(knots), c[:, :, 0], strict=True):
        slope = np.polynomial.polynomial.polyder(polynomial) if polynomial.size > 1 else np.zeros(1)
        turns = np.polynomial.polynomial.polyroots(slope) if np.any(slope[1:]) else np.zeros(0)
        inside = np.sort(turns[(np.abs(turns.imag) < 1e-9 * width) & (turns.real > 0.0) & (turns.real < width)].real)
        ends = np.array([0.0, *inside, width])
        at = np.polynomial.polynomial.polyval(ends, polynomial)
        crossings.append(begin + ends[np.isin(at, places)])
        for a, b, low, high in zip(ends[:-1], ends[1:], at[:-1], at[1:], strict=True):
            wanted = places[(places > min(low, high)) & (places < max(low, high))]
            if wanted.size:
                crossings.append(begin + _bisected(polynomial, (a, b), wanted, rises=bool(high > low)))
    return np.concatenate(crossings)


def _bisected(coefficients: Array, ends: tuple[float, float], wanted: Array, *, rises: bool) -> Array:
    """Find where a polynomial that is monotone between the ends has these values."""
    low, high = (np.full(wanted.size, x) for x in ends)
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = (np.polynomial.polynomial.polyval(middle, coefficients) > wanted) == rises
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.asarray(0.5 * (low + high))
