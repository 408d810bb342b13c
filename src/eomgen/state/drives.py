"""Drives with states: derivatives of what they do, beside those of inverse dynamics, and what they do at rest."""

from __future__ import annotations

import math
from collections.abc import Callable, Container

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import IntegrationError
from ..identifiers import check_kind
from ..kernel.complete import Kernel
from ..kernel.kernel_methods import KernelFunctions
from ..robot.coordinates import force_unit_of
from ..robot.internal_states.drives import DRIVE, STATES
from ..robot.internal_states.standstill import standstill_of
from ..robot.parameter_names import JOINTS
from ..runtime.internal_states import cut_apart, split_state
from ..runtime.raw import name_of
from .elements import element_numbers
from .vectors import state_vector

NEAR, TINY = 1e-6, 1e-12  # of inputs under which drives exert the same force: relative, and in their units


def has_drives(kernel: Kernel) -> bool:
    """Tell whether a kernel has drives with states, so that u is what ``Kernel.inputs`` says."""
    return kernel.calls.arrays.has_drives


def is_of_drive(state: str) -> bool:
    """Tell of an internal state, by its name, whether it is one of a drive: "joint1.gamma.drive.current"."""
    return split_state(state)[1] == DRIVE


def stores_energy(state: str) -> bool:
    """Tell of an internal state, by its name, whether it stores energy: not those of loops, filters and lags."""
    return not is_of_drive(state) or STATES[state.rpartition(".")[2]].inertia is not None


def inputs_at(kernel: Kernel, q: Array, v: Array) -> Array:
    """Return u, (..., n), by which drives have no control error: references are what they measure, other inputs 0."""
    u = np.zeros(q.shape)
    for i, one in enumerate(kernel.inputs.values()):
        if one.meaning in (f"reference of {name}" for name in ("position", "velocity")):
            u[..., i] = (q if one.meaning.endswith("position") else v)[..., i]
    return u


def drive_jacobian(kernel: Kernel, q: Array, v: Array, u: Array) -> tuple[Array, Array, Array]:
    """Return derivatives of what drives and u do on coordinates and, times inertias, on states, by q, v and u.

    They are (n + m, n + m) each: columns of states stand behind those of coordinates, of u forces beside drives in
    the columns of ``places_of_forces``.

    Args:
        q, v, u: a state, (n,), internal states behind v, u as ``Kernel.forward_dynamics`` takes it.
    """
    velocities, z = cut_apart(v, kernel.n)
    by_q, by_v, by_u = kernel.calls.run(KernelFunctions.drive_jacobian, None, (q, velocities, u), z=z, whole=True)
    inputs = np.diag(np.arange(kernel.calls.rates) < kernel.n).astype(float)
    for i, place in enumerate(places_of_forces(kernel)):
        if place != i:
            inputs[i, place] = 1.0  # a force beside the drive
            inputs[:, i] = by_u[:, i]
    return by_q, by_v, inputs


def places_of_forces(kernel: Kernel) -> list[int]:
    """Return the columns of derivatives by u that belong to a force on each coordinate: that of a drive's first state.

    Of coordinates without a drive with states they are the coordinates' own.
    """
    names, drives = kernel.calls.rate_names, kernel.calls.arrays.drives
    first = {name: next(k for k, x in enumerate(names) if x.startswith(f"{name}.{DRIVE}.")) for name in drives}
    return [first.get(name, i) for i, name in enumerate(kernel.coordinates)]


def inputs_with(kernel: Kernel, u: Array, forces: Array) -> Array:
    """Return inputs of motions, (..., kernel.calls.inputs): u with forces, (..., n) each, in addition to drives."""
    total, beside = kernel.calls.arrays.beside_drives(u, forces)
    return total if beside is None else np.concatenate([total, beside], axis=-1)


def acceleration_slopes(
    kernel: Kernel, q: Array, v: Array, u: Array, forces: Array | None = None
) -> tuple[Array, Array, Array]:
    """Return derivatives of accelerations and of rates of internal states by q, by v and z, and by u.

    They are (n + m, n + m) each, columns as of ``drive_jacobian``.

    Args:
        q, v, u: a state, (n,), internal states behind v.
        forces: beside drives with states, (drives,); zeros by default.
    """
    name = name_of(kernel.forward_dynamics_jacobian)
    velocities, z = cut_apart(v, kernel.n) if kernel.internal_states else (v, None)
    values = kernel.calls.arguments(name, (q, velocities, u), z, forces)
    by_q, by_v, by_u = kernel.calls.run(name, None, values, whole=True)
    return by_q, by_v, by_u


def drive_slopes(kernel: Kernel, q: Array, v: Array, u: Array | None) -> tuple[Array, Array, Array]:
    """Return ``drive_jacobian`` under inputs u; without them, within all limits, where drives are linear."""
    if u is None:
        v = np.zeros_like(v)
        u = inputs_at(kernel, q, v)
    return drive_jacobian(kernel, q, v, u)


class DrivesAtRest:
    """Drives with states of a kernel in a static equilibrium, by the numbers that the kernel has now.

    Attributes:
        kernel: whose they are.
        drives: what each does at rest, by the index of its coordinate.
    """

    def __init__(self, kernel: Kernel) -> None:
        laws, own = element_numbers(kernel, JOINTS), kernel.calls.raw.libraries.meta.get("inputs", {})
        self.kernel = kernel
        self.drives = {kernel.coordinates.index(name): standstill_of(laws[name]) for name in own}
        self._beside = {kernel.coordinates.index(name): kernel.n + place for name, (_, _, place) in own.items()}

    def places(self, q: Array, inputs: Callable[[Array], Array], kept: Container[str]) -> dict[int, float]:
        """Return where drives without an error hold their coordinates, m or rad, by index; others stay as they are.

        Args:
            q: coordinates, (n,).
            inputs: of all drives as a function of q, (n,) or more.
            kept: names of coordinates that stay whatever their drives do.

        Raises:
            IntegrationError: a velocity's integral has a reference that is not 0; the drive is named.
        """
        if not self.drives:
            return {}
        held, u = dict[int, float](), inputs(q)
        for i, one in self.drives.items():
            name = self.kernel.coordinates[i]
            if name in kept or one.compliance:
                continue
            if one.heeds and not one.follows and u[i]:
                meant = self.kernel.inputs[name]
                raise IntegrationError(
                    f"{self.kernel.name}: no static equilibrium: {name} has a {meant.meaning} of {u[i]:g} {meant.unit},"
                    " and its drive leaves no error; allowed: 0"
                )
            held[i] = float(u[i] if one.follows else q[i])
        return held

    def forces(self, q: Array, u: Array, *, limited: bool = True) -> Array:
        """Return forces on coordinates of drives with an error, and of all else that u is, (..., n), N or N m.

        Args:
            q: coordinates, (..., n).
            u: inputs, (..., kernel.calls.inputs), with forces beside drives behind.
            limited: whether limits of the drives count.
        """
        if not self.drives:
            return u
        total: Array = u[..., : self.kernel.n].copy()
        for i, one in self.drives.items():
            free = one if limited else one._replace(greatest=math.inf)
            pairs = zip(np.ravel(u[..., i]).tolist(), np.ravel(q[..., i]).tolist(), strict=True)
            exerted = [free.force(*pair) if one.compliance else 0.0 for pair in pairs]
            total[..., i] = np.reshape(exerted, u.shape[:-1]) + u[..., self._beside[i]]
        return total

    def alone(self, forces: Array, u: Array) -> Array:
        """Return forces, (n,), less those beside drives in u: what drives exert by themselves."""
        result: Array = forces.copy()
        for i, beside in self._beside.items():
            result[i] -= u[beside]
        return result

    def beside(self, q: Array, forces: Array) -> Array:
        """Return u, (..., kernel.calls.inputs), with which forces act at rest beside drives that exert nothing."""
        if not self.drives:
            return forces
        return inputs_with(self.kernel, inputs_at(self.kernel, q, np.zeros_like(q)), forces)

    def overload(self, forces: Array, kept: Container[str] = ()) -> str:
        """Say which drives cannot exert forces, (n,) or more, within their limits; "" where all can."""
        said = []
        for i, one in self.drives.items():
            name = self.kernel.coordinates[i]
            if name not in kept and not one.can_exert(forces[i]):
                unit = force_unit_of(name)
                leaves = f"{one.limit} leaves {one.greatest:.4g} {unit}"
                why = leaves if math.isfinite(one.compliance) else "its controller exerts none at rest"
                said.append(f"{name} would have to exert {forces[i]:.4g} {unit}, {why}")
        return "; ".join(said)

    def refuse_overload(self, forces: Array, kept: Container[str] = ()) -> None:
        """Raise IntegrationError where drives cannot exert forces, (n,) or more; they are named, and their limits."""
        said = self.overload(forces, kept)
        if said:
            what = "no static equilibrium within the limits of its drives"
            allowed = "allowed: another pose or load, or higher limits"
            raise IntegrationError(f"{self.kernel.name}: {what}: {said}; {allowed}")


def drives_at_rest(
    kernel: Kernel, q: ArrayLike, forces: ArrayLike, z: ArrayLike | None = None, *, fixed: Container[str] = ()
) -> tuple[Array, Array]:
    """Return inputs u, (n,), and internal states, (m,), with which drives exert forces on a robot at rest.

    Currents and filters stand at the values that these forces take, integrals where the control errors that they watch
    are 0; without an integral a reference differs from what is measured by the steady error.

    Args:
        kernel: of the robot.
        q: coordinates, (n,).
        forces: on coordinates, (n,), N or N m, as ``static_equilibrium`` returns them.
        z: states of other laws, (m,); 0 by default.
        fixed: names of coordinates that are held by something else: u is the force there, and states stay as in z.

    Raises:
        ArrayError: an array is wrong.
        IntegrationError: limits of a drive do not leave its force; it is named, and the limit.
    """
    check_kind("kernel", kernel, hasattr(kernel, "calls"), "a Kernel (of eomgen.build, or of a generated package)")
    n, drives = len(kernel.coordinates), DrivesAtRest(kernel)
    q, u = (state_vector(label, x, kernel.coordinates) for label, x in (("q", q), ("forces", forces)))
    states = np.zeros(len(kernel.internal_states)) if z is None else state_vector("z", z, kernel.internal_states)
    drives.refuse_overload(u, fixed)
    for i, one in drives.drives.items():
        if kernel.coordinates[i] in fixed:
            continue
        own = f"{kernel.coordinates[i]}.{DRIVE}."
        for k, name in enumerate(kernel.internal_states):
            if name.startswith(own):
                states[k] = one.states.get(name.removeprefix(own), 0.0) * u[i]
        u[i] = one.input(u[i], q[i])
    return u[:n], states


def settled(kernel: Kernel, q: Array, v: Array, u: Array, forces: Array) -> tuple[Array, tuple[str, ...]]:
    """Return v with states of drives that hold a robot at rest, and the coordinates of drives whose input does not.

    Args:
        q, v: a state at rest, (n,), with internal states behind velocities; those of drives that do not hold it stay
            as they are.
        u: inputs of the drives, (n,).
        forces: on coordinates that hold it, (n,), N or N m.

    Raises:
        IntegrationError: limits of a drive do not leave its force; it is named, and the limit.
    """
    n = len(kernel.coordinates)
    wanted, states = drives_at_rest(kernel, q, forces, v[n:])
    drives, lost, result = DrivesAtRest(kernel).drives, list[str](), np.append(v[:n], states)
    for i, one in drives.items():
        error = abs(u[i] - wanted[i]) if one.heeds else 0.0
        if error > NEAR * max(abs(u[i]), abs(wanted[i]), abs(wanted[i] - q[i] * one.follows), TINY):
            own = f"{kernel.coordinates[i]}.{DRIVE}."
            index = [k for k, name in enumerate(kernel.calls.rate_names) if name.startswith(own)]
            result[index] = v[index]
            lost.append(kernel.coordinates[i])
    return result, tuple(lost)
