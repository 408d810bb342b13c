"""Observer of external forces by the generalized momentum, in Python and as C.

With p = M v a motion has p' = u + C^T v + Q + tau, where u are the drives, Q = ``generalized_force`` springs, friction
and gravity, and tau what acts from outside.  The observer is r' = K (p' - u - C^T v - Q - r): no acceleration is
needed, M is not inverted, and r follows tau by the time constants 1 / K.  Over a sample dt, in which drives are held,
it is

    r+ = exp(-K dt) r + (1 - exp(-K dt)) ((p+ - p) / dt - u - mean of C^T v + Q),

exact where tau is constant, but for the mean, that of both ends.  Of a closed mechanism all of this is taken along its
independent coordinates, where forces of constraints do no work (``independent.py``): r is Z^T tau.

Source: A. De Luca, R. Mattone, "Actuator Failure Detection and Isolation Using Generalized Momenta", ICRA 2003; S.
Haddadin, A. De Luca, A. Albu-Schaeffer, "Robot Collisions: A Survey on Detection, Isolation, and Identification", IEEE
Transactions on Robotics 33(6), 2017.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._version import __version__
from ..codegen.c.scalar_types import SCALARS
from ..codegen.kernels.groups import (
    INDEPENDENT_COORDINATES,
    MOMENTUM_ALONG_CONSTRAINTS,
    MOMENTUM_OBSERVER,
    kernel_group,
)
from ..description import RobotLike, as_robot
from ..errors import InputError, UnknownNameError
from ..identifiers import check_kind, word_in
from ..kernel.complete import Kernel
from ..limits import is_usable
from ..names import listed, nearest_or_all, show
from ..pipeline import Options, build, generate
from ..robot.mechanism import coordinate_of
from ..robot.model import build_model
from ..robot.value import Coordinate, Robot
from ..runtime.arrays import flag, joint_lead, numbers_in
from .independent import Independent

KERNELS = MOMENTUM_OBSERVER
SOLVED = "clib/dependent_coordinates.h"  # of the C library, of closed mechanisms
PerCoordinate = float | Sequence[float] | Mapping[str, float]  # a number for all, one each, or by names


class Sample(NamedTuple):
    """Numbers that an observer keeps of a sample: p, C^T v + Q, and slopes of dependent coordinates, (..., b, f)."""

    momentum: NDArray[Any]
    force: NDArray[Any]
    slopes: NDArray[Any] | None


class MomentumObserver:
    """External forces on a robot's coordinates, from samples of its state and drives.

    Of robots with elastic gears q and v have the encoders of both sides, and u is the motors': on the link's side acts
    the torque of the spring.  With ``torque_sensors`` u are torques that are measured on the gears' outputs, and
    motors, gears and friction of joints are left out of the robot: q and v are those of the links alone.

    Of closed mechanisms forces are found on independent coordinates, driven ones as far as they can be, each with what
    acts on the coordinates that follow it; q, v and u have all coordinates.

    Attributes:
        robot: that is observed.
        kernels: names of the kernels that its kernel has.
        coordinates: names of the coordinates that forces are found on, f: all, of closed mechanisms independent ones.
        external: the forces found, r, (..., f), N or N m; zero at the beginning.
    """

    def __init__(
        self,
        robot: RobotLike,
        gain: PerCoordinate,
        dt: float,
        *,
        threshold: PerCoordinate = math.inf,
        torque_sensors: bool = False,
        dtype: str = "float64",
        kernel: Kernel | None = None,
    ) -> None:
        """Build the observer's kernel.

        Args:
            robot: a Robot, the name of a built-in one, or the path of a description.
            gain: K, 1/s: of all ``coordinates``, of each, or by their names (of all).
            dt: between samples, s.
            threshold: sizes of forces, N or N m, beyond which they are a collision; by names those of some coordinates.
            torque_sensors: whether u are torques measured on the gears' outputs.
            dtype: of the kernel and of the C.
            kernel: one of the robot with ``kernels`` that is there already; built without one.

        Raises:
            InputError: arguments of other types, numbers out of their range, or a robot whose external forces cannot be
                told: with prescribed coordinates, or laws with internal states.
            LoopError: loops do not close near the described home.
            UnknownNameError: a name that is no coordinate.
        """
        whole = as_robot(robot)
        self.robot = links_alone(whole) if flag("torque_sensors", torque_sensors) else whole
        _check_observable(self.robot)
        check_kind("kernel", kernel, kernel is None or isinstance(kernel, Kernel), "a Kernel (from build), or None")
        model, self._given = build_model(self.robot), kernel
        self.dtype = np.dtype(word_in("dtype", dtype, SCALARS))
        self._size = model.size
        self.kernels: tuple[str, ...] = KERNELS
        self._independent: Independent | None = None
        if model.constraints:
            self.kernels = kernel_group(model, MOMENTUM_OBSERVER, MOMENTUM_ALONG_CONSTRAINTS, INDEPENDENT_COORDINATES)
            assembled = self.kernel.assemble(np.asarray(model.home, self.dtype))
            self._independent = Independent.of(self.kernel, assembled, model.driven)
        kept = range(model.size) if self._independent is None else self._independent.free
        self.coordinates = tuple(model.coordinates[i] for i in kept)
        if not (is_usable(dt) and dt > 0.0):
            raise InputError(f"dt: got {show(dt)}; allowed: a number above 0, s")
        self.dt = float(dt)
        self.gain = self._numbers("gain", gain, None)
        self.threshold = self._numbers("threshold", threshold, math.inf)
        self._share = -np.expm1(-self.gain * self.dt).astype(self.dtype)
        self._keep = np.exp(-self.gain * self.dt).astype(self.dtype)
        self._per_second = self.dtype.type(1.0 / self.dt)
        self._half = self.dtype.type(0.5)
        self._before: Sample | None = None
        self.external: NDArray[Any] = np.zeros(len(self.coordinates), self.dtype)

    @cached_property
    def kernel(self) -> Kernel:
        """The kernel of the robot that is observed, with ``kernels``."""
        return self._given or build(self.robot, kernels=self.kernels, dtype=str(self.dtype))

    def start(self, q: ArrayLike, v: ArrayLike) -> None:
        """Begin at a state, q and v, (..., n), with no external force; a first ``step`` does so, too."""
        self._before = self._look(q, v)
        self.external = np.zeros_like(self._before.momentum)

    def step(self, q: ArrayLike, v: ArrayLike, u: ArrayLike) -> NDArray[Any]:
        """Take the next sample and return the external forces, (..., f), N or N m.

        Args:
            q, v: the state now, (..., n).
            u: drives that were held since the sample before, (..., n).

        Raises:
            InputError: q, v or u of another shape than before, or a sample whose forces are not finite; the observer
                stays as it was.
            SingularError: the independent coordinates of a closed mechanism do not hold the others in this state.
        """
        if self._before is None:
            self.start(q, v)
            return self.external
        now, before = self._look(q, v), self._before
        held = numbers_in("u", u, f"(..., {self._size}), finite numbers").astype(self.dtype)
        if held.shape[-1:] != (self._size,):
            raise InputError(f"u: got the shape {held.shape}; allowed: (..., {self._size})")
        lead = joint_lead("q", self.external.shape[:-1], now.momentum.shape[:-1])
        joint_lead("u", lead, held.shape[:-1])
        if self._independent is not None and before.slopes is not None and now.slopes is not None:
            held = self._independent.along(self._half * (before.slopes + now.slopes), held)
        with np.errstate(all="ignore"):
            known = self._half * (before.force + now.force) + held
            rate = (now.momentum - before.momentum) * self._per_second
            external = self._keep * self.external + self._share * (rate - known)
        if not np.isfinite(external).all():
            raise InputError(
                f"u: {show(held.tolist())} is not allowed, as forces would not be finite; allowed: finite numbers"
            )
        self.external, self._before = external, now
        return self.external

    @property
    def collisions(self) -> tuple[str, ...]:
        """Names of the coordinates on which the force is beyond its threshold, in any of the states."""
        beyond = ~(np.abs(self.external) <= self.threshold)
        return tuple(name for i, name in enumerate(self.coordinates) if np.any(beyond[..., i]))

    @property
    def kernels_in_c(self) -> tuple[str, ...]:
        """Names of the kernels that the observer's C calls."""
        return kernel_group(self.robot, MOMENTUM_OBSERVER, MOMENTUM_ALONG_CONSTRAINTS)

    def sources(self) -> dict[str, str]:
        """Return names and texts of the observer's C, which stands beside the robot's with ``kernels_in_c``.

        Of closed mechanisms the file of the C library that it includes is among them.
        It takes no heap, keeps its state in the caller's struct, and needs the same time for each sample.  Its numbers
        are those of ``step`` to the bit, where products are not fused with sums; of closed mechanisms to round-off.
        """
        from ..codegen.c.library import library_files
        from ..codegen.c.source import environment

        scalar = SCALARS[str(self.dtype)]

        def literals(values: NDArray[Any]) -> list[str]:
            return [scalar.literal(float(x)) for x in values]

        largest = float(np.finfo(self.dtype).max)
        context = {
            "name": self.robot.name,
            "version": __version__,
            "n": self._size,
            "found": self.coordinates,
            "independent": self._independent,
            "constraints": len(build_model(self.robot).constraints),
            "dt": repr(self.dt),
            "real": scalar.name,
            "keep": literals(self._keep),
            "share": literals(self._share),
            "threshold": literals(np.minimum(self.threshold, largest)) if np.isfinite(self.threshold).any() else [],
            "half": scalar.literal(0.5),
            "zero": scalar.literal(0.0),
            "one": scalar.literal(1.0),
            "per_second": scalar.literal(float(self._per_second)),
        }
        made = {
            f"{self.robot.name}_momentum_observer.{ending}": environment()
            .get_template(f"control/momentum_observer.{ending}.jinja")
            .render(context)
            for ending in ("h", "c")
        }
        library = {} if self._independent is None else {SOLVED: library_files()[SOLVED]}
        return {**library, **made}

    def write(self, folder: Path | str) -> Path:
        """Write the robot's package with ``kernels_in_c`` into a folder, and the observer's C into it; return its path.

        Raises:
            InputError, BuildError: as of ``eomgen.generate``.
        """
        package = generate(self.robot, folder, Options(self.kernels_in_c, str(self.dtype)))
        for name, text in self.sources().items():
            (package / name).write_text(text, encoding="ascii")
        return package

    def _look(self, q: ArrayLike, v: ArrayLike) -> Sample:
        """Return p, and C^T v + Q; of a closed mechanism along its independent coordinates, which turn."""
        both, of = self.kernel.functions.generalized_momentum(q, v), self._independent
        momentum, force = both[..., 0, :], both[..., 1, :] + self.kernel.generalized_force(q, v)
        if of is None:
            return Sample(momentum, force, None)
        slopes, inverse = of.follow(self.kernel, q)
        force = force - of.turning(self.kernel, q, v, momentum, inverse)
        return Sample(of.along(slopes, momentum), of.along(slopes, force), slopes)

    def _numbers(self, label: str, given: PerCoordinate, left: float | None) -> NDArray[np.float64]:
        """Return a positive number for each coordinate; ``left``: of those that are not named.

        Raises:
            InputError: another count, or a number that is not above 0.
            UnknownNameError: a name that is no coordinate.
        """
        names, values = self.coordinates, list[Any]()
        if isinstance(given, Mapping):
            for name in given:
                if name not in names:
                    raise UnknownNameError(f"{label}: {show(name)} is no coordinate{nearest_or_all(name, names)}")
            missing = [name for name in names if name not in given]
            if missing and left is None:
                raise InputError(f"{label}: {listed(missing)} has none; allowed: a number for each coordinate")
            values = [given.get(name, left) for name in names]
        elif isinstance(given, Sequence) or (isinstance(given, np.ndarray) and given.ndim > 0):
            values = list(given)
        else:
            values = [given] * len(names)
        if len(values) != len(names):
            raise InputError(
                f"{label}: got {len(values)} numbers; allowed: one, or {len(names)}, one for each coordinate"
            )
        for name, value in zip(names, values, strict=True):
            endless = left is not None and isinstance(value, float) and value == math.inf
            if not endless and not (is_usable(value) and value > 0.0):
                raise InputError(f"{label}: {name} has {show(value)}; allowed: a number above 0")
        return np.array(values, float)


def links_alone(robot: Robot) -> Robot:
    """Return the robot whose joints are driven by torques measured on their gears' outputs.

    Motors, and laws of principal coordinates (friction, armature, springs, stops), stand before the sensor; deviations
    stay.
    """
    joints = []
    for joint in robot.joints:
        plain = {k: Coordinate() if k == joint.principal else c for k, c in joint.coordinates.items()}
        joints.append(replace(joint, motor=None, coordinates=plain))
    names = {f"{joint.name}.{kind}" for joint in joints for kind in joint.coordinates}
    driven = None if robot.driven is None else tuple(dict.fromkeys(x for x in robot.driven if x in names))
    made = replace(
        robot, joints=tuple(joints), driven=driven, home={k: x for k, x in robot.home.items() if k in names}, sensors=()
    )
    known = {name for name, _ in made.numbers()}
    return replace(made, tunable=tuple(name for name in made.tunable if name in known))


def _check_observable(robot: Robot) -> None:
    """Refuse robots whose external forces do not follow from momentum and drives."""
    model = build_model(robot)
    prescribed = [name for name in model.coordinates if coordinate_of(robot, name).prescribed]
    if prescribed:
        raise InputError(
            f"robot: {listed(prescribed)} is prescribed, by forces that are not known; allowed: driven ones"
        )
    if model.internal_states:
        raise InputError(
            f"robot: laws have states ({listed(model.internal_states)}), which are not measured; allowed:"
            " robot.without_states()"
        )
