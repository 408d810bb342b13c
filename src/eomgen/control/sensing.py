"""Measurement models: sensors of a robot with their noise, predicted readings, innovations, and exact Jacobians."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._version import __version__
from ..arrays import Array
from ..codegen.kernels.groups import SENSORS
from ..description import RobotLike, as_robot
from ..errors import InputError, UnknownNameError
from ..identifiers import check_kind, word_in
from ..kernel.complete import Kernel
from ..limits import is_usable
from ..names import nearest, nearest_or_all, show
from ..robot.fields import Picklable
from ..robot.model import build_model
from ..robot.value import SENSOR_KINDS, Robot, Sensor, innovations, readings, sensor_conflict
from ..runtime.arrays import joint_lead, numbers_in

NOISE: Mapping[str, float] = MappingProxyType(  # standard deviations of readings, by their units
    {"rad": 1e-4, "m": 1e-4, "rad/s": 5e-3, "m/s": 1e-3, "N m": 0.1, "N": 1.0, "m/s^2": 0.05}
)
_LIKE = "KIND:NAME, such as encoder:joint1.gamma, torque:joint1.motor, imu:tcp, pose:tcp"
_BEGINS = {"encoder": 0, "tachometer": 1}  # sensors of numbers of (q, v): of which of both
_POSE = 12  # readings of a pose, rows of [R | X]


@dataclass(frozen=True)
class Measurement(Picklable):
    """Sensors of a robot: h(q, v, a) as the kernel ``measurement`` of ``robot``, and the noise on it.

    Readings are what sensors tell, innovations the differences that a filter compares.  They are as many but for poses:
    a pose has twelve readings, [R | X] row by row, and six innovations, its position's and three angles in the frame's
    own axes (the Gibbs vector of the rotation that is left, doubled).

    Attributes:
        robot: with these sensors; ``eomgen.build(m.robot, kernels=(*m.kernels, ...))`` makes a kernel for them.
        noise: standard deviation of each innovation, (innovations,).
        drift: of each innovation's bias, per root of a second, (innovations,); 0 where it has none.
    """

    robot: Robot
    noise: tuple[float, ...]
    drift: tuple[float, ...]
    kernels: tuple[str, ...] = field(default=SENSORS, init=False)

    def __post_init__(self) -> None:
        check_kind("robot", self.robot, isinstance(self.robot, Robot), "a Robot (from load_robot)")
        count = len(self.innovations)
        for label, numbers in (("noise", self.noise), ("drift", self.drift)):
            check_kind(label, numbers, isinstance(numbers, tuple), f"a tuple of {count} numbers")
            if len(numbers) != count or not all(is_usable(x) and x >= 0.0 for x in numbers):
                raise InputError(f"{label}: {show(list(numbers))}; allowed: {count} numbers from 0 on")

    @classmethod
    def of(
        cls,
        robot: RobotLike,
        sensors: str | Sequence[str | Sensor],
        *,
        noise: Mapping[str, float] | None = None,
        drift: Mapping[str, float] | None = None,
    ) -> Measurement:
        """Return the measurement model of sensors.

        Args:
            robot: a Robot, the name of a built-in one, or the path of a description.
            sensors: as of ``parse_sensors``, or in a row.
            noise: standard deviations by the names of innovations ("imu:tcp.fx"), of sensors ("imu:tcp") or of kinds
                ("encoder"), of which the first that is there counts; by default NOISE, by units.
            drift: of biases, per root of a second, by the same names; others have no bias, and poses may have none.

        Raises:
            InputError: sensors that are none, stand twice, or that this robot cannot carry; numbers out of their range.
            UnknownNameError: noise or drift of what is not measured.
        """
        chosen = as_robot(robot)
        found = _sensors(sensors)
        for sensor in found:
            conflict = sensor_conflict(chosen, sensor)
            if conflict is not None:
                raise InputError(f"sensors of {chosen.name}: {conflict}")
        rows = [(sensor, name, unit) for sensor in found for name, unit in innovations(chosen, sensor)]
        deviations, drifts = _by_name("noise", noise, rows), _by_name("drift", drift, rows)
        for (sensor, _, _), walk in zip(rows, drifts, strict=True):
            if sensor.kind == "pose" and walk:
                raise InputError(f"drift: {sensor.name} is a pose, which has no bias; allowed: other sensors")
        whole = tuple(NOISE[unit] if x is None else x for (_, _, unit), x in zip(rows, deviations, strict=True))
        if min(whole) <= 0.0:
            name = rows[whole.index(min(whole))][1]
            raise InputError(f"noise: {name} has {min(whole)}; allowed: above 0")
        return cls(replace(chosen, sensors=found), whole, tuple(x or 0.0 for x in drifts))

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The sensors, in the order of readings."""
        return self.robot.sensors

    @property
    def readings(self) -> tuple[tuple[str, str], ...]:
        """Names and units of readings: ("imu:tcp.fx", "m/s^2"), ..."""
        return tuple(row for sensor in self.sensors for row in readings(self.robot, sensor))

    @property
    def innovations(self) -> tuple[tuple[str, str], ...]:
        """Names and units of innovations."""
        return tuple(row for sensor in self.sensors for row in innovations(self.robot, sensor))

    @property
    def biased(self) -> tuple[int, ...]:
        """Indices of the innovations whose readings have a bias."""
        return tuple(i for i, walk in enumerate(self.drift) if walk)

    @property
    def depends_on_acceleration(self) -> bool:
        """Whether readings depend on accelerations, and so on what drives do."""
        return any(
            x.kind in ("accelerometer", "imu") or (x.kind == "torque" and not x.of.endswith(".motor"))
            for x in self.sensors
        )

    @property
    def places(self) -> tuple[int | None, ...]:
        """Places in (q, v) of the innovations that are numbers of them, as of encoders and tachometers; else None."""
        names, found = build_model(self.robot).coordinates, list[int | None]()
        for sensor in self.sensors:
            place = names.index(sensor.of) if sensor.kind in _BEGINS else None
            count = len(innovations(self.robot, sensor))
            found += [None if place is None else place + _BEGINS[sensor.kind] * len(names)] * count
        return tuple(found)

    @property
    def poses(self) -> tuple[tuple[int, int], ...]:
        """Indices at which each pose begins, among readings and among innovations."""
        places, reading, row = list[tuple[int, int]](), 0, 0
        for sensor in self.sensors:
            if sensor.kind == "pose":
                places.append((reading, row))
            reading += len(readings(self.robot, sensor))
            row += len(innovations(self.robot, sensor))
        return tuple(places)

    def innovation(self, measured: ArrayLike, predicted: ArrayLike) -> Array:
        """Return measured less predicted readings as a filter compares them, (..., innovations).

        Args:
            measured, predicted: (..., readings).

        Raises:
            InputError: numbers of another shape, or not finite.
        """
        y, h = self._taken("measured", measured), self._taken("predicted", predicted)
        lead = joint_lead("predicted", y.shape[:-1], h.shape[:-1])
        y, h = (np.broadcast_to(x, (*lead, x.shape[-1])) for x in (y, h))
        parts, at = list[Array](), 0
        for begin, _ in self.poses:
            parts += [y[..., at:begin] - h[..., at:begin]]
            A, B = (x[..., begin : begin + _POSE].reshape(*x.shape[:-1], 3, 4) for x in (y, h))
            parts += [A[..., 3] - B[..., 3], _left_rotation(A[..., :3], B[..., :3])]
            at = begin + _POSE
        return np.concatenate([*parts, y[..., at:] - h[..., at:]], axis=-1)

    def weights(self, predicted: ArrayLike) -> Array:
        """Return derivatives of the innovations' predicted part by the readings, (..., innovations, readings).

        H = weights times the derivative of ``measurement``: each row is the cotangent of one reverse sweep.

        Raises:
            InputError: numbers of another shape, or not finite.
        """
        h = self._taken("predicted", predicted)
        W = np.zeros((*h.shape[:-1], len(self.noise), h.shape[-1]))
        row = at = 0
        for begin, first in self.poses:
            W[..., range(row, first), range(at, begin)] = 1.0
            W[..., range(first, first + 3), range(begin + 3, begin + _POSE, 4)] = 1.0
            R = h[..., begin : begin + _POSE].reshape(*h.shape[:-1], 3, 4)[..., :3]
            for i, (j, k) in enumerate(((2, 1), (0, 2), (1, 0))):  # (R^T dR)_jk less (R^T dR)_kj, half
                W[..., first + 3 + i, range(begin + k, begin + _POSE, 4)] = 0.5 * R[..., j]
                W[..., first + 3 + i, range(begin + j, begin + _POSE, 4)] = -0.5 * R[..., k]
            row, at = first + 6, begin + _POSE
        W[..., range(row, W.shape[-2]), range(at, W.shape[-1])] = 1.0
        return W

    def jacobian(self, kernel: Kernel, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> tuple[Array, Array, Array]:
        """Return derivatives H of the predicted part of innovations by q, v and a, (..., innovations, n) each; exact.

        Args:
            kernel: of ``robot``, with ``kernels``.
            q, v, a: (..., n).

        Raises:
            InputError: no kernel, or numbers of another shape, or not finite.
        """
        check_kind("kernel", kernel, isinstance(kernel, Kernel), "a Kernel (from build)")
        W = self.weights(kernel.functions.measurement(q, v, a)).astype(kernel.dtype)
        states = (np.asarray(x, kernel.dtype)[..., None, :] for x in (q, v, a))
        rows = [np.ascontiguousarray(np.broadcast_to(x, (*W.shape[:-1], kernel.n))) for x in states]
        H_q, H_v, H_a = kernel.vjp(kernel.functions.measurement, rows, W)
        return H_q, H_v, H_a

    def noisy(self, exact: ArrayLike, rng: np.random.Generator) -> Array:
        """Return readings with white noise of these standard deviations, (..., readings): poses stay poses.

        Args:
            exact: (..., readings), of the kernel.
            rng: draws the noise.

        Raises:
            InputError: numbers of another shape, or not finite.
        """
        check_kind("rng", rng, isinstance(rng, np.random.Generator), "a numpy.random.Generator")
        y = self._taken("exact", exact)
        noise = rng.normal(size=(*y.shape[:-1], len(self.noise))) * np.array(self.noise)
        row = at = 0
        for begin, first in self.poses:
            y[..., at:begin] += noise[..., row:first]
            A = y[..., begin : begin + _POSE].reshape(*y.shape[:-1], 3, 4)
            A[..., 3] += noise[..., first : first + 3]
            A[..., :3] = A[..., :3] @ _rotation(noise[..., first + 3 : first + 6])
            y[..., begin : begin + _POSE] = A.reshape(*y.shape[:-1], _POSE)
            row, at = first + 6, begin + _POSE
        y[..., at:] += noise[..., row:]
        return y

    def sources(self, dtype: str = "float64") -> dict[str, str]:
        """Return names and texts of C that stands beside that of ``robot`` with ``kernels``: innovations, Jacobians.

        Args:
            dtype: of the robot's C.

        Raises:
            InputError: the dtype is unknown.
        """
        from ..codegen.c.scalar_types import SCALARS
        from ..codegen.c.source import environment

        real, name = SCALARS[word_in("dtype", dtype, SCALARS)], self.robot.name
        rows = self.weights(np.zeros(len(self.readings)))
        context = {
            "name": name,
            "version": __version__,
            "n": build_model(self.robot).size,
            "readings": self.readings,
            "innovations": [(*row, f"{x:g}") for row, x in zip(self.innovations, self.noise, strict=True)],
            "reading_of": [int(row.argmax()) if row.any() else -1 for row in rows],
            "state_of": [-1 if place is None else place for place in self.places],
            "poses": self.poses,
            "real": real.name,
            **{word: real.literal(x) for word, x in (("zero", 0.0), ("half", 0.5), ("one", 1.0), ("two", 2.0))},
        }
        texts = {ending: environment().get_template(f"control/measurement.{ending}.jinja") for ending in ("h", "c")}
        return {f"{name}_innovation.{ending}": text.render(context) for ending, text in texts.items()}

    def _taken(self, label: str, values: ArrayLike) -> Array:
        size = len(self.readings)
        array = numbers_in(label, values, f"(..., {size}), one number for each reading")
        if array.shape[-1:] != (size,):
            raise InputError(
                f"{label}: got the shape {array.shape}; allowed: (..., {size}), one number for each reading"
            )
        return array


def parse_sensors(text: str) -> tuple[Sensor, ...]:
    """Read sensors: "encoder:joint1.gamma,imu:tcp,torque:joint2.gamma,pose:tcp".

    Raises:
        InputError: with what is no sensor, and what is.
    """
    if not isinstance(text, str):
        raise InputError(f"sensors: got {show(text)}; allowed: {_LIKE}")
    found = list[Sensor]()
    for item in text.split(","):
        kind, colon, of = item.strip().partition(":")
        if not colon or not of:
            raise InputError(f"sensors: got {show(item)}; allowed: {_LIKE}")
        if kind not in SENSOR_KINDS:
            raise InputError(
                f"sensors: {show(kind)} is no sensor; allowed: {', '.join(SENSOR_KINDS)}{nearest(kind, SENSOR_KINDS)}"
            )
        found.append(Sensor(kind, of))
    return tuple(found)


def _sensors(given: str | Sequence[str | Sensor]) -> tuple[Sensor, ...]:
    """Return sensors of texts and values in a row.

    Raises:
        InputError: none at all, one that is none, or one that stands twice.
    """
    items: Sequence[Any] = given if isinstance(given, (tuple, list)) else (given,)
    found = list[Sensor]()
    for item in items:
        if not isinstance(item, (str, Sensor)):
            raise InputError(f"sensors: got {show(item)}; allowed: {_LIKE}")
        found += parse_sensors(item) if isinstance(item, str) else (item,)
    if not found:
        raise InputError(f"sensors: none is there; allowed: at least one, {_LIKE}")
    for sensor in found:
        if found.count(sensor) > 1:
            raise InputError(f"sensors: {sensor.name} stands twice; allowed: every sensor once")
    return tuple(found)


def _by_name(label: str, named: Any, rows: Sequence[tuple[Sensor, str, str]]) -> list[float | None]:
    """Return a number for each innovation from those by names of innovations, sensors or kinds.

    Raises:
        UnknownNameError: a name of nothing that is measured.
        InputError: no number, or one below 0.
    """
    check_kind(label, named, named is None or isinstance(named, Mapping), "numbers by name, or None")
    given = named or {}
    known = {x for sensor, name, _ in rows for x in (name, sensor.name, sensor.kind)}
    for name, value in given.items():
        if name not in known:
            raise UnknownNameError(f"{label}: {show(name)} is not measured{nearest_or_all(name, known)}")
        if not (is_usable(value) and value >= 0.0):
            raise InputError(f"{label}: {name} has {show(value)}; allowed: a number that is at least 0")
    return [
        next((float(given[x]) for x in (name, sensor.name, sensor.kind) if x in given), None)
        for sensor, name, _ in rows
    ]


def _left_rotation(measured: Array, predicted: Array) -> Array:
    """Return angles, (..., 3), by which a measured rotation is further than the predicted one, in its axes.

    They are 2 tan(angle / 2) about the axis: twice the Gibbs vector, which differs from the angle by its cube / 12.
    """
    E = np.swapaxes(predicted, -1, -2) @ measured
    twist = np.stack([E[..., 2, 1] - E[..., 1, 2], E[..., 0, 2] - E[..., 2, 0], E[..., 1, 0] - E[..., 0, 1]], axis=-1)
    return np.asarray(2.0 * twist / (1.0 + np.trace(E, axis1=-2, axis2=-1))[..., None])


def _rotation(angles: Array) -> Array:
    """Return the rotation, (..., 3, 3), whose doubled Gibbs vector these are: Cayley's form of them, halved."""
    x, y, z = np.moveaxis(0.5 * angles, -1, 0)
    S = np.stack([np.stack([0 * x, -z, y], -1), np.stack([z, 0 * x, -x], -1), np.stack([-y, x, 0 * x], -1)], -2)
    return np.asarray(np.linalg.solve(np.eye(3) - S, np.eye(3) + S))
