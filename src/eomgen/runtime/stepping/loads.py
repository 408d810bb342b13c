"""Loads over time as data that a kernel's C follows: signals, drives by a program, wrenches, prescribed motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls import Calls
from ..raw import FFI, Library

Array = NDArray[np.float64]
Index = NDArray[np.intp]

JUMP = 1e-9  # of the largest value, beside which pieces of a signal meet
WORKS = ("drives", "prescribed", "wrenches", "dissipated")  # that C integrates, in its order


@dataclass(frozen=True, eq=False)
class Signal:
    """Columns over time: polynomials of t - knots[k] between knots[k] and knots[k + 1]; they rest outside.

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
        """Straight lines between samples, (T, columns), at times, s, (T,), increasing."""
        knots, x = np.array(times, dtype=np.float64), np.array(samples, dtype=np.float64)
        rates = np.diff(x, axis=0) / np.diff(knots)[:, None]
        return cls(knots, np.stack([x[:-1], rates], axis=1))

    def by_samples(self, by_coefficients: ArrayLike) -> Array:
        """Derivatives by the samples that it goes ``through``, (T, columns), of those by its coefficients."""
        by = np.asarray(by_coefficients, dtype=np.float64)
        rates = by[:, 1] / np.diff(np.asarray(self.knots))[:, None]
        found = np.zeros((len(by) + 1, self.columns))
        found[:-1] += by[:, 0] - rates
        found[1:] += rates
        return found

    @classmethod
    def constant(cls, values: ArrayLike) -> Signal:
        """Columns that stay what they are, (columns,)."""
        return cls(np.array([0.0, 1.0]), np.array(values, dtype=np.float64).reshape(1, 1, -1))

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
    """A way in which coordinates of a closed mechanism follow those that are driven.

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
    """Drives by the inverse dynamics of a rigid robot, of float64.

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
    """Drives as data: forces over time, or a program that gains, a model, or both follow.

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
class LoadData:
    """Everything that acts on a robot over time.

    Attributes:
        drive: of its drives.
        wrenches: on its links.
        given: motions of its prescribed coordinates, or None.
        first, last: times, s, between which drives and wrenches are asked: what jumps at either is not seen.
    """

    drive: DriveData = field(default_factory=DriveData)
    wrenches: Sequence[LinkWrench] = ()
    given: Waves | None = None
    first: float = -np.inf
    last: float = np.inf


def work_kernels(calls: Calls) -> tuple[str, ...]:
    """Names of the kernels whose functions say what works there are."""
    needed = "residual" if calls.raw.libraries.meta.get("constraints") else "inverse_dynamics"
    return ("generalized_force", *((needed,) if calls.prescribed else ()))


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


def jump_times(loads: LoadData, *, every: bool = False) -> Array:
    """Times at which loads or their rates jump, s, increasing: steps with error control end there.

    Args:
        every: whether all knots of signals count, as they do for derivatives by their coefficients: one changes its
            piece alone.
    """
    drive = loads.drive
    tracks = [x for x in (drive.torque, drive.program) if x is not None]
    tracks += [] if loads.given is None else loads.given.tracks
    signals = [track.signal for track in tracks] + [wrench.signal for wrench in loads.wrenches]
    each = {id(signal): signal for signal in signals}.values()
    found = [_jumps(signal, every=every) for signal in each]
    ends = [loads.first, loads.last, *(t for wrench in loads.wrenches for t in (wrench.t0, wrench.t1))]
    times: Array = np.unique(np.concatenate([*found, np.array(ends, dtype=np.float64)]))
    return times[np.isfinite(times)]


def _jumps(signal: Signal, *, every: bool) -> Array:
    """Times at which a signal, its rate or its acceleration jumps, or of all its knots, s."""
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
    """At which knots pieces of these coefficients do not meet, (knots,); what rests outside has no rates."""
    found, widths = np.zeros(knots.size, dtype=bool), np.diff(knots)[:, None]
    for order in range(3):
        begins = c[:, 0] if c.shape[1] else np.zeros((len(c), c.shape[2]))
        ends, sizes = np.zeros_like(begins), np.zeros_like(begins)
        for power in range(c.shape[1] - 1, -1, -1):
            ends, sizes = ends * widths + c[:, power], sizes * widths + np.abs(c[:, power])
        rest = np.zeros((1, c.shape[2]))
        before = np.concatenate([begins[:1] if order == 0 else rest, ends])
        behind = np.concatenate([begins, ends[-1:] if order == 0 else rest])
        least = JUMP * sizes.max(axis=0, initial=0.0)
        found |= (np.abs(behind - before) > least).any(axis=1)
        c = c[:, 1:] * np.arange(1, c.shape[1])[:, None]  # of the next derivative
    return found


def _crossings(profile: Signal, places: Array) -> Array:
    """Times at which a profile comes to these places, s."""
    found = [np.zeros(0)]
    knots, c = (np.asarray(x, dtype=np.float64) for x in (profile.knots, profile.coefficients))
    for begin, width, own in zip(knots[:-1], np.diff(knots), c[:, :, 0], strict=True):
        slope = np.polynomial.polynomial.polyder(own) if own.size > 1 else np.zeros(1)
        turns = np.polynomial.polynomial.polyroots(slope) if np.any(slope[1:]) else np.zeros(0)
        inside = np.sort(turns[(np.abs(turns.imag) < 1e-9 * width) & (turns.real > 0.0) & (turns.real < width)].real)
        ends = np.array([0.0, *inside, width])
        at = np.polynomial.polynomial.polyval(ends, own)
        found.append(begin + ends[np.isin(at, places)])
        for a, b, low, high in zip(ends[:-1], ends[1:], at[:-1], at[1:], strict=True):
            wanted = places[(places > min(low, high)) & (places < max(low, high))]
            if wanted.size:
                found.append(begin + _bisected(own, (a, b), wanted, rises=bool(high > low)))
    return np.concatenate(found)


def _bisected(coefficients: Array, ends: tuple[float, float], wanted: Array, *, rises: bool) -> Array:
    """Where a polynomial that is monotone between the ends has these values."""
    low, high = (np.full(wanted.size, x) for x in ends)
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = (np.polynomial.polynomial.polyval(middle, coefficients) > wanted) == rises
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.asarray(0.5 * (low + high))


class Packed:
    """Loads as C takes them; whatever it points to lives as long as this object.

    Args:
        calls: of the robot's kernel, with "frame_pose" and "external_force" where there are wrenches.
        many: whether many states are moved at a time, so that a model of the robot is asked for many, too.
        works: whether works are integrated, see ``WORKS``; the kernel must have what ``work_kernels`` names.
        slopes: which derivatives of the kernel's functions and the model's go with them, of ``BACK`` or ``ALONG``.
        stops: times at which steps end, s, increasing; those of ``jump_times`` if not given.

    Attributes:
        pointer: to ``NAME_loads``.
    """

    def __init__(
        self,
        library: Library,
        calls: Calls,
        loads: LoadData,
        *,
        many: bool = False,
        works: bool = False,
        slopes: Slopes | None = None,
        stops: Array | None = None,
    ) -> None:
        self._library, self._calls, self._kept, self._many = library, calls, list[Any](), many
        self._slopes = slopes
        drive, fields = loads.drive, dict[str, Any](first=loads.first, last=loads.last)
        if works:
            fields["work"] = self._work()
        if drive.effort is not None:
            fields["effort"] = self._numbers(drive.effort)
        if drive.torque is not None:
            fields["torque"] = self._new("track", **self._track(drive.torque))
        if drive.program is not None:
            fields["control"] = self._control(drive)
        if drive.model is not None:
            fields["model"] = self._model(drive.model)
        if loads.given is not None:
            fields["given"] = self._given(loads.given)
        if loads.wrenches:
            fields |= self._wrenches(loads.wrenches)
        stops = jump_times(loads) if stops is None else stops
        if stops.size:
            fields |= {"stop": self._numbers(stops), "stops": stops.size}
        self.pointer = self._new("loads", **fields)

    def _work(self) -> Any:
        fields: dict[str, Any] = {}
        passive, *needed = work_kernels(self._calls)
        fields["generalized_force"], fields["passive_h"] = self._function(self._calls, passive)
        for name in needed:
            fields["residual" if name == "residual" else "needed"], fields["needed_h"] = self._function(
                self._calls, name
            )
        return self._new("work", **fields)

    def drives(self, times: Array, q: Array, v: Array) -> Array:
        """u at times in states, (T, n); prescribed coordinates have their accelerations there, and are put in place."""
        function, view, u = self._library.function("loaded"), self._calls.raw.view, np.zeros_like(q)
        function(len(times), self.pointer, FFI.from_buffer("double[]", times), view(q), view(v), view(u))
        return u

    def _new(self, kind: str, **fields: Any) -> Any:
        found = self._library.new(kind, **fields)
        self._kept.append(found)
        return found

    def _numbers(self, values: ArrayLike, kind: type[np.generic] = np.float64) -> Any:
        """Pointer to numbers of double precision, or to whole ones."""
        name = "double[]" if kind is np.float64 else "int[]"
        found = FFI.from_buffer(name, np.array(values, dtype=kind).ravel())
        self._kept.append(found)
        return found

    def _places(self, values: ArrayLike) -> Any:
        return self._numbers(values, np.intc)

    def _signal(self, signal: Signal) -> Any:
        pieces, powers, columns = signal.coefficients.shape
        return self._new(
            "signal",
            knot=self._numbers(signal.knots),
            coefficient=self._numbers(signal.coefficients),
            profile=self._library.ffi.NULL if signal.profile is None else self._signal(signal.profile),
            pieces=pieces,
            degree=powers - 1,
            columns=columns,
        )

    def _track(self, track: Track) -> dict[str, Any]:
        return {"signal": self._signal(track.signal), "place": self._places(track.place)}

    def _control(self, drive: DriveData) -> Any:
        assert drive.program is not None
        ratio = np.ones(drive.program.signal.columns) if drive.ratio is None else drive.ratio
        fields = {"program": self._track(drive.program), "ratio": self._numbers(ratio)}
        if drive.gains is not None:
            fields |= {"kp": self._numbers(drive.gains.kp), "kd": self._numbers(drive.gains.kd)}
        return self._new("control", **fields)

    def _model(self, model: ModelDrive) -> Any:
        fields: dict[str, Any] = {}
        if self._slopes is not None:
            field, name = self._slopes.model
            fields[field], fields[f"{field}_h"] = self._function(model.calls, name)
        if model.mechanism is None:
            fields["inverse_dynamics"], fields["h"] = self._function(model.calls, "inverse_dynamics")
            fields |= zip(("inverse_dynamics_batch", "batch_h"), self._batch(model.calls), strict=False)
        else:
            fields["mechanism"] = self._mechanism(model.mechanism)
        return self._new(
            "model",
            **fields,
            place=self._places(model.place),
            ratio=self._numbers(model.ratio),
            column=self._places(model.column),
            given=self._places(model.given),
            bandwidth=model.bandwidth or 0.0,
            size=len(model.place),
            holds=model.bandwidth is None,
        )

    def _mechanism(self, mechanism: MechanismData) -> Any:
        charts = self._library.new_array("chart", len(mechanism.charts))
        self._kept.append(charts)
        fields: dict[str, Any] = {}
        for own, chart in zip(charts, mechanism.charts, strict=True):
            fields["following"], own.following_h = self._function(chart.calls, "following")
            fields["residual"], own.residual_h = self._function(chart.calls, "residual")
            own.chart, own.turned = self._numbers(chart.chart), self._places(chart.turned or [0])
        angles, origin = zip(*(mechanism.joints or [(0, 0)]), strict=True)
        return self._new(
            "mechanism",
            **fields,
            charts=charts,
            driven=self._places(mechanism.driven),
            angles=self._places(angles),
            origin=self._places(origin),
            count=len(mechanism.charts),
            joints=len(mechanism.joints),
            gaps=len(mechanism.charts[0].calls.raw.libraries.meta["constraints"]),
        )

    def _given(self, given: Waves) -> Any:
        own = self._library.new_array("track", max(len(given.tracks), 1))
        self._kept.append(own)
        for k, track in enumerate(given.tracks):
            fields = self._track(track)
            own[k].signal, own[k].place = fields["signal"], fields["place"]
        places = [self._calls.coordinates.index(name) for name in self._calls.prescribed]
        wave, count = self._numbers(given.wave), len(given.tracks)
        return self._new("given", place=self._places(places), wave=wave, tracks=own, size=len(places), count=count)

    def _wrenches(self, wrenches: Sequence[LinkWrench]) -> dict[str, Any]:
        meta = self._calls.raw.libraries.meta
        own = self._library.new_array("wrench", len(wrenches))
        self._kept.append(own)
        for k, wrench in enumerate(wrenches):
            framed = wrench.turns or bool(np.any(wrench.arm))
            frame = list(meta["frames"]).index(meta["links"][wrench.link]) if framed else -1
            own[k].signal, own[k].t0, own[k].t1 = self._signal(wrench.signal), wrench.t0, wrench.t1
            own[k].arm = list(wrench.arm)
            own[k].link, own[k].frame, own[k].turns = wrench.link, frame, wrench.turns
        fields: dict[str, Any] = {"wrench": own, "wrenches": len(wrenches)}
        fields["external_force"], fields["force_h"] = self._function(self._calls, "external_force")
        if self._calls.raw.turning:
            fields["force_turned"] = self._function(self._calls, "external_force", turned=True)[1]
        framed = any(own[k].frame >= 0 for k in range(len(wrenches)))
        if framed:
            fields["frame_pose"], fields["frame_h"] = self._function(self._calls, "frame_pose")
        if self._slopes is not None:
            for field, name in {**self._slopes.forces, **(self._slopes.poses if framed else {})}.items():
                fields[field], fields[f"{field}_h"] = self._function(self._calls, name)
        return fields

    def _batch(self, calls: Calls) -> tuple[Any, ...]:
        """The same of inverse dynamics for many states at a time; nothing where one is moved alone."""
        if not self._many:
            return ()
        function, setup = calls.raw.function("inverse_dynamics"), calls.parameters.setup
        arguments = "size_t, const double *" + 3 * ", const double *, size_t" + ", double *"
        code = self._library.ffi.cast(f"long long (*)({arguments})", function.address(batch=True))
        where = setup.address(function.where(batch=True))
        return code, self._library.ffi.cast("const double *", where)

    def _function(self, calls: Calls, name: str, *, turned: bool = False) -> tuple[Any, Any]:
        """Code of a kernel's function as C of this library takes it, and what that reads of parameters.

        Of these with all joints ``turned`` that turn freely, or as the kernel has them.
        """
        parameters = calls.parameters
        if turned:
            parameters = parameters.copy()
            parameters.turn(calls.raw.turning)
        function, setup = calls.raw.function(name), parameters.setup
        self._kept.append(setup)
        ffi, own = self._library.ffi, function.library
        number = {"float64": "double", "float32": "float"}[str(calls.dtype)]
        arguments = "int, " if function.is_framed else f"const {number} *, " * (len(function.reads) - 1)
        kind = f"int (*)(const {number} *, const {number} *, {arguments}{number} *)"
        return ffi.cast(kind, function.address()), ffi.cast(f"const {number} *", setup.address(own))


class Side:
    """Loads of many states as C takes them side by side; whatever they point to lives as long as this object.

    Args:
        calls: of the robot's kernel, or, if states differ in parameters, of that of each.
        loads: the data for each state; one, or one object, that all share is packed once.

    Attributes:
        pointer: to ``NAME_loads``.
        distance: from one state's to the next one's, 0 where all share theirs.
    """

    def __init__(self, library: Library, calls: Sequence[Calls], loads: Sequence[LoadData], *, works: bool) -> None:
        shares = all(each is loads[0] for each in loads)
        each = zip(calls[:1], loads[:1], strict=True) if shares else zip(calls, loads, strict=True)
        self._packed = [Packed(library, *own, many=True, works=works) for own in each]
        self.pointer, self.distance = self._packed[0].pointer, 0
        if not shares:
            self.pointer, self.distance = library.new_array("loads", len(loads)), 1
            for i, packed in enumerate(self._packed):
                self.pointer[i] = packed.pointer[0]
