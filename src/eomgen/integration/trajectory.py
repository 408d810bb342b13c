"""Sampled motions, made of the samples of an integration."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import ArrayError, InputError, IntegrationStopped
from ..kernel.complete import Kernel
from ..names import component_name
from ..robot.coordinates import force_unit_of, rotating_joints, unit_of
from ..robot.value import ANGULAR
from ..runtime.internal_states import cut_apart
from ..shown import Shown
from ..state.turning import joint_quaternions, quaternion_columns, quaternions
from ..tabular import Rows, TableColumn, Tabular
from .contacts import Contact
from .resting import Rest
from .steps import Samples
from .system import System


@dataclass(frozen=True)
class Trajectory(Shown, Tabular):
    """A motion, sampled at equal distances in time (where it was stopped, the last sample may be nearer).

    Attributes:
        t: times, (T,), s.
        q, v: coordinates and velocities, (T, n); angles are unwrapped from sample to sample (see ``quaternions``).
        u: drives, (T, n), N or N m.
        energy: kinetic and potential energy, (T, 2), J.
        coordinates: names, (n,).
        method: the method that was used; with stiffness switching the one that advanced for most of the time.
        info: numbers of steps (0: not known), evaluations (of forward or inverse dynamics) and jacobians; wall_s, s.
            Of C also rejected, the steps that were tried again, and, with stiffness switching, implicit_s, the time
            that rosenbrock and radau advanced, s, and, with radau among them, radau_s of it.  Where there is
            friction, friction_smoothing is the largest smoothing velocity w (m/s or rad/s): a coordinate that friction
            holds with the fraction x of its limit creeps at w x / sqrt(1 - x^2).
        contacts: contact events: clearances that closed and opened, by time.
        rests: intervals in which friction held a coordinate (stiction), by time; see ``resting.rests``.
        works: work integrals, (T, 4), J, from the first sample on, integrated with the motion; None where that was not
            asked for.  Of the drives, of the forces of prescribed motions, of external wrenches, and what dampers and
            friction dissipated (``eomgen.kernel.stepping.input_signals.WORKS``).
        z: internal states, (T, states), by the names in ``internal_states``, in ``internal_state_units``; or None.
        input_units: of u where drives take something else than forces, (n,), see ``Kernel.inputs``; None without such.
    """

    t: Array
    q: Array
    v: Array
    u: Array
    energy: Array
    coordinates: tuple[str, ...]
    method: str
    info: Mapping[str, float] = field(default_factory=dict)
    contacts: tuple[Contact, ...] = ()
    rests: tuple[Rest, ...] = ()
    works: Array | None = None
    z: Array | None = None
    internal_states: tuple[str, ...] | None = None
    internal_state_units: tuple[str, ...] | None = None
    input_units: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "info", MappingProxyType(dict(self.info)))

    def apart(self, kernel: Kernel) -> Trajectory:
        """Return the motion with internal states of a kernel, which stood behind velocities, as ``z``."""
        if not kernel.internal_states:
            return self
        v, z = cut_apart(self.v, kernel.n)
        names: dict[str, Any] = {
            "internal_states": kernel.internal_states,
            "internal_state_units": kernel.internal_state_units,
        }
        inputs = {name: x for name, x in kernel.inputs.items() if name not in kernel.prescribed}  # there u has forces
        if any(not x.is_force for x in inputs.values()):
            units = (inputs[name].unit if name in inputs else force_unit_of(name) for name in kernel.coordinates)
            names["input_units"] = tuple(units)
        return replace(self, v=v, z=z, **names)

    @property
    def rates(self) -> Array:
        """Velocities, (T, n), with internal states behind them, if any."""
        return self.v if self.z is None else np.hstack([self.v, self.z])

    def of(self, coordinate: str) -> Array:
        """Return a coordinate or an internal state over time, (T,); InputError if there is none of that name."""
        internal_states = self.internal_states or ()
        if self.z is not None and coordinate in internal_states:
            return self.z[:, internal_states.index(coordinate)]
        if coordinate not in self.coordinates:
            known = ", ".join((*self.coordinates, *internal_states))
            raise InputError(f"coordinate: {coordinate!r} is unknown; known: {known}")
        return self.q[:, self.coordinates.index(coordinate)]

    def quaternion(self, joint: str) -> Array:
        """Return a joint's rotation over time as unit quaternions (w, x, y, z), (T, 4).

        From the joint frame after the motion (child side) to that of its described placement, without offsets.  They
        have no singularity, and follow one another without a jump of sign, from w >= 0 on.

        Raises:
            InputError: there are no such three coordinates.
        """
        return quaternions(np.stack([self.of(component_name(joint, name)) for name in ANGULAR], axis=-1))

    @property
    def rotating(self) -> tuple[str, ...]:
        """Names of the joints that have alpha, beta and gamma, and so a quaternion, k of them."""
        return rotating_joints(self.coordinates)

    @property
    def quaternions(self) -> Array | None:
        """Unit quaternions of the joints of ``rotating``, as ``quaternion`` has them, (T, k, 4); None without any."""
        by_joint = joint_quaternions(self.coordinates, self.q)
        return np.stack(list(by_joint.values()), axis=1) if by_joint else None

    def as_rows(self) -> Rows:
        """Return a row per time: every coordinate, .rate and .drive, internal states, kinetic and potential energy.

        Joints with alpha, beta and gamma have .qw, .qx, .qy and .qz besides, the unit quaternions of ``quaternion``.
        """
        columns = motion_columns(self)
        columns["energy.kinetic"], columns["energy.potential"] = (("J", column) for column in self.energy.T)
        table = [TableColumn(name, *column) for name, column in columns.items()]
        return Rows("t", "s", self.t, table, {"method": self.method})


def motion_columns(motion: Trajectory) -> dict[str, tuple[str, Array]]:
    """Return unit and values over time, (T,), by name: coordinates with .rate and .drive, states, quaternions."""
    columns: dict[str, tuple[str, Array]] = {}
    for i, name in enumerate(motion.coordinates):
        unit = unit_of(name)
        columns[name], columns[f"{name}.rate"] = (unit, motion.q[:, i]), (f"{unit}/s", motion.v[:, i])
        force = force_unit_of(name) if motion.input_units is None else motion.input_units[i]
        columns[f"{name}.drive"] = (force, motion.u[:, i])
    units = motion.internal_state_units or ()
    columns |= {name: (unit, motion.of(name)) for name, unit in zip(motion.internal_states or (), units, strict=True)}
    return columns | {name: ("", x) for name, x in quaternion_columns(motion.coordinates, motion.q).items()}


def trajectory_of(
    system: System,
    samples: Samples,
    run: Callable[[], None],
    described: Callable[[Array, Array, Array], Mapping[str, Any]],
) -> Trajectory:
    """Return the trajectory of the samples that ``run`` fills.

    Args:
        described: ``described(t, q, v)`` gives the fields that say how the motion came about, by their names.

    Raises:
        IntegrationStopped: from ``run``, or because forces at a sample are not finite; with the trajectory until then.
    """
    stop: IntegrationStopped | None = None
    try:
        run()
        times, states = samples.times, samples.states
    except IntegrationStopped as error:
        stop = error
        times, states = samples.until(error)
    rows, trouble = _with_forces(system, times, states)
    last = rows["t"].size - 1
    if trouble is not None and stop is None:
        if last < 0:
            raise trouble
        system.trouble = trouble
        reason = "the forces cannot be evaluated at the next sample"
        stop = system.ended(reason, float(times[last]), states[last], states[last])
    trajectory = None
    if last >= 0:
        about = described(rows["t"], rows["q"], rows["v"])
        trajectory = Trajectory(**rows, coordinates=system.kernel.calls.coordinates, **about)
    if stop is not None:
        stop.trajectory = trajectory
        raise stop from (stop.__cause__ or trouble)
    assert trajectory is not None  # nothing stopped, so that there are all samples
    return trajectory


def _with_forces(system: System, times: Array, states: Array) -> tuple[dict[str, Any], ArrayError | None]:
    """Return the motion's fields with drives, energies and works as far as these are finite, and why no further."""
    n = system.n
    q, v = np.ascontiguousarray(states[:, :n]), np.ascontiguousarray(states[:, n:])
    u, trouble = system.forces_over(times, q, v)
    end = len(u)
    velocities, z = system.apart(v[:end])
    energy = np.asarray(system.kernel.replaced(checks=False).energy(q[:end], velocities, z=z))
    bad = ~np.isfinite(energy).all(axis=1)
    if bad.any():
        end = int(bad.argmax())
        trouble = ArrayError(f"energy: {energy[end].tolist()} J at t = {times[end]:.6g} s; numbers must be finite")
    rows: dict[str, Any] = {"t": times, "q": q, "v": v, "u": u, "energy": energy, "works": system.works_until(len(q))}
    return {name: None if x is None else x[:end] for name, x in rows.items()}, trouble
