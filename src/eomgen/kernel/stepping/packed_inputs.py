"""Input signals as plain values, and as structures of C: one table says which value goes into which field.

Rollouts pack plain values through cffi, the JavaScript of a kernel packs them by the same table, and pages read them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...runtime.calls import Calls
from ...runtime.raw import FFI, Library
from .input_signals import (
    DriveData,
    InputSignals,
    LinkWrench,
    MechanismData,
    ModelDrive,
    Signal,
    Slopes,
    Track,
    Waves,
    jump_times,
    work_kernels,
)

Array = NDArray[np.float64]
Plain = dict[str, Any]  # numbers, names, arrays, and plain values of parts


@dataclass(frozen=True)
class Field:
    """How a field of a structure of ``clib/eom.h`` is filled with plain values.

    Attributes:
        kind: "reals" or "wholes" (pointers to numbers), "vector" (three numbers), "real" or "whole" (a number),
            "count" (of the values of a list, with ``more`` added), "absent" (1 where there is no value), "link" or
            "frame" (the number of a name), "part" or "parts" (a pointer to another structure, or to several), "inline"
            (a structure inside, of the same values).
        key: of the value among the plain ones.
        more: the structure of parts, what is added to a count, or the number where there is no value.
    """

    kind: str
    key: str = ""
    more: str | float = 0


STRUCTS: Mapping[str, Mapping[str, Field]] = {  # of eom.h, by their names behind eom_
    "spline": {
        "knot": Field("reals", "knots"),
        "coefficient": Field("reals", "coefficients"),
        "profile": Field("part", "profile", "spline"),
        "pieces": Field("count", "knots", -1),
        "degree": Field("whole", "degree"),
        "columns": Field("whole", "columns"),
    },
    "track": {"signal": Field("part", "signal", "spline"), "place": Field("wholes", "place")},
    "tracking": {
        "program": Field("inline", more="track"),
        "ratio": Field("reals", "ratio"),
        "kp": Field("reals", "kp"),
        "kd": Field("reals", "kd"),
    },
    "computed_torque": {
        "place": Field("wholes", "place"),
        "ratio": Field("reals", "ratio"),
        "column": Field("wholes", "column"),
        "given": Field("wholes", "given"),
        "bandwidth": Field("real", "bandwidth"),
        "size": Field("count", "place"),
        "holds": Field("absent", "bandwidth"),
    },
    "prescribed": {
        "place": Field("wholes", "place"),
        "wave": Field("reals", "waves"),
        "tracks": Field("parts", "tracks", "track"),
        "size": Field("count", "place"),
        "count": Field("count", "tracks"),
    },
    "wrench": {
        "signal": Field("part", "signal", "spline"),
        "t0": Field("real", "t0", -np.inf),
        "t1": Field("real", "t1", np.inf),
        "arm": Field("vector", "arm"),
        "link": Field("link", "link"),
        "frame": Field("frame", "frame", -1),
        "turns": Field("whole", "turns"),
    },
    "inputs": {
        "first": Field("real", "first", -np.inf),
        "last": Field("real", "last", np.inf),
        "torque": Field("part", "torque", "track"),
        "control": Field("part", "program", "tracking"),
        "model": Field("part", "model", "computed_torque"),
        "given": Field("part", "given", "prescribed"),
        "wrench": Field("parts", "wrenches", "wrench"),
        "wrenches": Field("count", "wrenches"),
        "stop": Field("reals", "stops"),
        "stops": Field("count", "stops"),
        "effort": Field("reals", "effort"),
    },
}


def plain_signal(signal: Signal) -> Plain:
    """Return a signal as plain values: coefficients are one row of numbers."""
    _, powers, columns = signal.coefficients.shape
    plain: Plain = {"knots": signal.knots, "coefficients": signal.coefficients}
    plain |= {"degree": powers - 1, "columns": columns}
    return plain if signal.profile is None else {**plain, "profile": plain_signal(signal.profile)}


def plain_track(track: Track) -> Plain:
    """Return a track as plain values."""
    return {"signal": plain_signal(track.signal), "place": track.place}


def plain_program(drive: DriveData, program: Track) -> Plain:
    """Return a program with its gears and gains as plain values."""
    ratio = np.ones(program.signal.columns) if drive.ratio is None else drive.ratio
    gains = {} if drive.gains is None else {"kp": drive.gains.kp, "kd": drive.gains.kd}
    return {**plain_track(program), "ratio": ratio, **gains}


def plain_model(model: ModelDrive) -> Plain:
    """Return the places of the coordinates of a drives' model, and what it makes of the program."""
    plain: Plain = {"place": model.place, "ratio": model.ratio, "column": model.column, "given": model.given}
    return plain if model.bandwidth is None else {**plain, "bandwidth": model.bandwidth}


def plain_prescribed(waves: Waves, place: Sequence[int]) -> Plain:
    """Return the prescribed motions of the coordinates at ``place``."""
    return {"place": place, "waves": waves.wave, "tracks": [plain_track(track) for track in waves.tracks]}


def plain_wrench(wrench: LinkWrench, links: Sequence[str]) -> Plain:
    """Return a wrench as plain values; it has a frame where it turns or has an arm."""
    link = links[wrench.link]
    plain: Plain = {"link": link, "signal": plain_signal(wrench.signal), "arm": wrench.arm, "turns": wrench.turns}
    plain |= {key: t for key, t in (("t0", wrench.t0), ("t1", wrench.t1)) if isfinite(t)}
    return {**plain, "frame": link} if wrench.turns or np.any(wrench.arm) else plain


def plain_inputs(calls: Calls, loads: InputSignals, stops: Array | None = None) -> Plain:
    """Return input signals as plain values.

    Args:
        calls: of the robot's kernel.
        stops: times at which steps end, s, increasing; those of ``jump_times`` by default.
    """
    drive, plain = loads.drive, Plain()
    plain |= {key: t for key, t in (("first", loads.first), ("last", loads.last)) if isfinite(t)}
    if drive.effort is not None:
        plain["effort"] = np.append(drive.effort, np.full(calls.inputs - calls.n, np.inf))
    if drive.torque is not None:
        plain["torque"] = plain_track(drive.torque)
    if drive.program is not None:
        plain["program"] = plain_program(drive, drive.program)
    if drive.model is not None:
        plain["model"] = plain_model(drive.model)
    if loads.prescribed is not None:
        plain["given"] = plain_prescribed(
            loads.prescribed, [calls.coordinates.index(name) for name in calls.prescribed]
        )
    if loads.wrenches:
        links = calls.raw.libraries.meta["links"]
        plain["wrenches"] = [plain_wrench(wrench, links) for wrench in loads.wrenches]
    stops = jump_times(loads) if stops is None else stops
    return {**plain, "stops": stops} if stops.size else plain


class PackedInputs:
    """Input signals as structures of C; what these point to lives as long as this object.

    Args:
        calls: of the robot's kernel, with "frame_pose" and "external_force" where there are wrenches.
        many: whether many states are moved at a time, so that a model of the robot is asked for many, too.
        works: whether works are integrated, see ``WORKS``; the kernel must have what ``work_kernels`` names.
        slopes: which derivatives of the kernel's functions and the model's go with them, of ``BACK`` or ``ALONG``.
        stops: times at which steps end, s, increasing; those of ``jump_times`` by default.

    Attributes:
        pointer: to ``NAME_loads``.
    """

    def __init__(
        self,
        library: Library,
        calls: Calls,
        loads: InputSignals,
        *,
        many: bool = False,
        works: bool = False,
        slopes: Slopes | None = None,
        stops: Array | None = None,
    ) -> None:
        self._library, self._calls, self._kept, self._many = library, calls, list[Any](), many
        self._slopes = slopes
        plain, functions = plain_inputs(calls, loads, stops), dict[str, Any]()
        if works:
            functions["work"] = self._work()
        if loads.wrenches:
            functions |= self._of_wrenches(framed=any("frame" in wrench for wrench in plain["wrenches"]))
        if loads.drive.model is not None:
            torque_fields = self._fields("computed_torque", plain.pop("model")) | self._of_model(loads.drive.model)
            functions["model"] = self._kept_new("eom_computed_torque *", torque_fields)
        self.pointer = library.new("loads", **self._fields("inputs", plain), **functions)
        self._kept.append(self.pointer)

    def drives(self, times: Array, q: Array, v: Array) -> Array:
        """Return u at times in states, (T, n), accelerations of prescribed coordinates, which are put in place.

        Behind it are forces beside drives with states; internal states stand behind v.
        """
        function, view = self._library.function("loaded"), self._calls.raw.view
        u = np.zeros((len(q), self._calls.inputs), q.dtype)
        function(len(times), self.pointer, FFI.from_buffer("double[]", times), view(q), view(v), view(u))
        return u

    def _fields(self, struct: str, plain: Plain) -> dict[str, Any]:
        """Return fields of a structure, as cffi initialises it; those that are left out stay zero."""
        fields: dict[str, Any] = {}
        for name, field in STRUCTS[struct].items():
            kind, more = field.kind, field.more
            value = plain.get(field.key)
            if kind == "inline":
                fields[name] = self._fields(str(more), plain)
            elif kind == "absent":
                fields[name] = value is None
            elif value is None:
                if more and not isinstance(more, str):  # a number where there is no value
                    fields[name] = more
            elif kind == "count":
                fields[name] = len(value) + int(more)
            elif kind == "reals":
                fields[name] = self._numbers(value)
            elif kind == "wholes":
                fields[name] = self._numbers(value, np.intc)
            elif kind == "part":
                fields[name] = self._kept_new(f"eom_{more} *", self._fields(str(more), value))
            elif kind == "parts":
                fields[name] = self._kept_new(f"eom_{more}[]", [self._fields(str(more), element) for element in value])
            elif kind in ("link", "frame"):
                fields[name] = self._calls.raw.libraries.meta[f"{kind}s"].index(value)
            else:
                fields[name] = list(value) if kind == "vector" else value
        return fields

    def _kept_new(self, kind: str, content: Any) -> Any:
        """Return a new value of a type of C, which lives as long as this object."""
        self._kept.append(self._library.ffi.new(kind, content))
        return self._kept[-1]

    def _new(self, kind: str, **fields: Any) -> Any:
        self._kept.append(self._library.new(kind, **fields))
        return self._kept[-1]

    def _numbers(self, values: ArrayLike, kind: type[np.generic] = np.float64) -> Any:
        """Return the pointer to numbers of double precision, or to whole ones."""
        name = "double[]" if kind is np.float64 else "int[]"
        self._kept.append(FFI.from_buffer(name, np.array(values, dtype=kind).ravel()))
        return self._kept[-1]

    def _work(self) -> Any:
        fields: dict[str, Any] = {}
        passive, *needed = work_kernels(self._calls)
        fields["generalized_force"], fields["passive_h"] = self._function(self._calls, passive)
        for name in needed:
            field = {"inverse_dynamics": "needed"}.get(name, name)
            setup = "drive_h" if name == "drive_forces" else "needed_h"
            fields[field], fields[setup] = self._function(self._calls, name)
        return self._new("work", **fields)

    def _of_model(self, model: ModelDrive) -> dict[str, Any]:
        """Return functions of the model that drives know."""
        fields: dict[str, Any] = {}
        if self._slopes is not None:
            field, name = self._slopes.model
            fields[field], fields[f"{field}_h"] = self._function(model.calls, name)
        if model.mechanism is None:
            fields["inverse_dynamics"], fields["h"] = self._function(model.calls, "inverse_dynamics")
            fields |= zip(("inverse_dynamics_batch", "batch_h"), self._batch(model.calls), strict=False)
        else:
            fields["mechanism"] = self._mechanism(model.mechanism)
        return fields

    def _mechanism(self, mechanism: MechanismData) -> Any:
        charts = self._library.new_array("chart", len(mechanism.charts))
        self._kept.append(charts)
        fields: dict[str, Any] = {}
        for struct, chart in zip(charts, mechanism.charts, strict=True):
            fields["following"], struct.following_h = self._function(chart.calls, "following")
            fields["residual"], struct.residual_h = self._function(chart.calls, "residual")
            struct.chart, struct.turned = self._numbers(chart.chart), self._numbers(chart.turned or [0], np.intc)
        angles, origin = zip(*(mechanism.joints or [(0, 0)]), strict=True)
        return self._new(
            "mechanism",
            **fields,
            charts=charts,
            driven=self._numbers(mechanism.driven, np.intc),
            angles=self._numbers(angles, np.intc),
            origin=self._numbers(origin, np.intc),
            count=len(mechanism.charts),
            joints=len(mechanism.joints),
            gaps=len(mechanism.charts[0].calls.raw.libraries.meta["constraints"]),
        )

    def _of_wrenches(self, *, framed: bool) -> dict[str, Any]:
        """Return functions by which wrenches act; ``framed``: some have a frame."""
        fields: dict[str, Any] = {}
        fields["external_force"], fields["force_h"] = self._function(self._calls, "external_force")
        if self._calls.raw.turning:
            fields["force_turned"] = self._function(self._calls, "external_force", turned=True)[1]
        if framed:
            fields["frame_pose"], fields["frame_h"] = self._function(self._calls, "frame_pose")
        if self._slopes is not None:
            for field, name in {**self._slopes.forces, **(self._slopes.poses if framed else {})}.items():
                fields[field], fields[f"{field}_h"] = self._function(self._calls, name)
        return fields

    def _batch(self, calls: Calls) -> tuple[Any, ...]:
        """Return inverse dynamics for many states at a time; nothing where one is moved alone."""
        if not self._many:
            return ()
        function, setup = calls.raw.function("inverse_dynamics"), calls.parameters.setup
        arguments = "size_t, const double *" + 3 * ", const double *, size_t" + ", double *"
        code = self._library.ffi.cast(f"long long (*)({arguments})", function.address(batch=True))
        where = setup.address(function.where(batch=True))
        return code, self._library.ffi.cast("const double *", where)

    def _function(self, calls: Calls, name: str, *, turned: bool = False) -> tuple[Any, Any]:
        """Return the code of a kernel's function as C of this library takes it, and what that reads of parameters.

        Of these with all joints with 3-DOF rotation ``turned``, or as the kernel has them.
        """
        parameters = calls.parameters
        if turned:
            parameters = parameters.copy()
            parameters.turn(calls.raw.turning)
        function, setup = calls.raw.function(name), parameters.setup
        self._kept.append(setup)
        ffi, code_library = self._library.ffi, function.library
        number = {"float64": "double", "float32": "float"}[str(calls.dtype)]
        arguments = "int, " if function.is_framed else f"const {number} *, " * (len(function.arguments) - 1)
        kind = f"int (*)(const {number} *, const {number} *, {arguments}{number} *)"
        return ffi.cast(kind, function.joined_address()), ffi.cast(f"const {number} *", setup.address(code_library))


class PackedBatch:
    """Input signals of many states as structures of C side by side, which live as long as this object.

    Args:
        calls: of the robot's kernel, or, if states differ in parameters, of that of each.
        loads: the data for each state; one, or one object, that all share is packed once.

    Attributes:
        pointer: to ``NAME_loads``.
        distance: from one state's to the next one's, 0 where all share theirs.
    """

    def __init__(self, library: Library, calls: Sequence[Calls], loads: Sequence[InputSignals], *, works: bool) -> None:
        shares = all(each is loads[0] for each in loads)
        each = zip(calls[:1], loads[:1], strict=True) if shares else zip(calls, loads, strict=True)
        self._packed = [PackedInputs(library, *arguments, many=True, works=works) for arguments in each]
        self.pointer, self.distance = self._packed[0].pointer, 0
        if not shares:
            self.pointer, self.distance = library.new_array("loads", len(loads)), 1
            for i, packed in enumerate(self._packed):
                self.pointer[i] = packed.pointer[0]
