"""Parameters of force elements as a kernel has them now, and stiffness and damping of joints as wholes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..arrays import Array
from ..kernel.complete import Kernel
from ..names import component_name, joint_of, kind_of, parameter_name
from ..robot.elements import KINDS, MATRICES
from ..robot.elements.joint_damping import MOVED, lag_of
from ..robot.elements.matrices import PAIRS, entry_name
from ..robot.parameter_names import CUT_MOTIONS, CUT_STIFFNESSES, MOTIONS, STIFFNESSES

Numbers = dict[str, dict[str, float]]  # by owner, then by their names in its table


def element_numbers(kernel: Kernel, family: str) -> Numbers:
    """Give the numbers of one family of forces, such as "bearings", by owner and by their names in its table.

    Args:
        family: one of ``robot.parameter_names.FAMILIES``.
    """
    values, owners = kernel.parameters.state.values, kernel.elements.get(family, {})
    return {owner: {key: float(values[place]) for key, place in places.items()} for owner, places in owners.items()}


def element_slopes(kernel: Kernel) -> tuple[Array, Array]:
    """Give the largest stiffness and damping along each of ``Kernel.element_rows``, (rows,) each; N/m, N m/rad."""
    slopes: dict[str, tuple[float, float]] = {}
    for table, kind in KINDS.items():
        for owner, numbers in element_numbers(kernel, table).items():
            slopes |= {component_name(owner, row): pair for row, pair in kind.slopes(numbers).items()}
    pairs = np.array([slopes[name] for name in kernel.element_rows]).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def element_couplings(kernel: Kernel) -> tuple[Array, Array]:
    """Give stiffness and damping between ``Kernel.element_rows`` beside the diagonal, (rows, rows) each."""
    stiffness, damping = np.zeros((2, len(kernel.element_rows), len(kernel.element_rows)))
    for table in KINDS:
        for owner, numbers in element_numbers(kernel, table).items():
            below = [{key.partition(".")[2]: x for key, x in numbers.items() if key.startswith(y)} for y in MATRICES]
            pairs = {(component_name(owner, x), component_name(owner, y)): entry_name(x, y) for x, y in PAIRS if x != y}
            for (one, other), entry in pairs.items():
                k, c = (x.get(entry, 0.0) for x in below)
                if k or c:
                    i, j = kernel.element_rows.index(one), kernel.element_rows.index(other)
                    stiffness[i, j] = stiffness[j, i] = k
                    damping[i, j] = damping[j, i] = c + lag_of(below[1]) * k
    return stiffness, damping


def joint_stiffness(kernel: Kernel) -> Array:
    """Return the stiffness matrices of joints, and what couples modes, (n, n), N/m, N/rad, N m/rad."""
    return _matrices(kernel, STIFFNESSES, kernel.calls.coordinates) + _between_modes(kernel)[0]


def cut_matrices(kernel: Kernel) -> tuple[Array, Array]:
    """Return the stiffness and damping matrices of loop joints, (cut_laws, cut_laws) each."""
    families = (CUT_STIFFNESSES, CUT_MOTIONS)
    return _matrices(kernel, CUT_STIFFNESSES, kernel.cut_laws), _damping_matrices(kernel, *families, kernel.cut_laws)


def stiffness_forces(kernel: Kernel, q: Array) -> Array:
    """Return the forces of ``joint_stiffness`` and of joints' preloads in states q, (T, n); (T, n), N or N m."""
    preload = np.zeros(kernel.n)
    for joint, numbers in element_numbers(kernel, STIFFNESSES).items():
        for i, name in enumerate(kernel.coordinates):
            if joint_of(name) == joint:
                preload[i] = numbers.get(f"preload.{kind_of(name)}", 0.0)
    return np.asarray(q @ joint_stiffness(kernel) + preload)


def joint_damping(kernel: Kernel) -> Array:
    """Return the largest damping by joints as wholes and between modes, (n, n), N s/m, N s/rad, N m s/rad.

    Isotropic damping counts on the diagonal alone.
    """
    return _coupling_damping(kernel) + np.diag(damping_diagonal(kernel))


def damping_diagonal(kernel: Kernel) -> Array:
    """Return the isotropic damping of every coordinate by joint dampers, (n,), N s/m or N m s/rad."""
    diagonal = np.zeros(kernel.n)
    for _, damping, index in _dampers(kernel):
        diagonal[list(index.values())] += damping
    return diagonal


def damping_forces(kernel: Kernel, q: Array, v: Array) -> Array:
    """Return the generalized forces of joint dampers, and between modes, against the motion in states, (T, n) each."""
    forces = np.asarray(v @ _coupling_damping(kernel))
    for joint, damping, index in _dampers(kernel):
        places = list(index.values())
        forces[:, places] += damping * v[:, places]
        if {"alpha", "gamma"} <= index.keys():
            beta = kernel.parameters.get(parameter_name("joints", joint, "offset", "beta"), 0.0)
            sine = np.sin(beta + (q[:, index["beta"]] if "beta" in index else 0.0))
            alpha, gamma = index["alpha"], index["gamma"]
            forces[:, alpha] += damping * sine * v[:, gamma]
            forces[:, gamma] += damping * sine * v[:, alpha]
    return forces


def _coupling_damping(kernel: Kernel) -> Array:
    """Return the damping matrices of joints, and what couples modes, (n, n)."""
    return _damping_matrices(kernel, STIFFNESSES, MOTIONS, kernel.calls.coordinates) + _between_modes(kernel)[1]


def _between_modes(kernel: Kernel) -> tuple[Array, Array]:
    """Return stiffness and damping of modes that work on each other beside the diagonals, (n, n) each."""
    stiffness, damping = np.zeros((2, kernel.n, kernel.n))
    for one, other, k, d in kernel.modal_couplings:
        i, j = kernel.calls.coordinates.index(one), kernel.calls.coordinates.index(other)
        stiffness[i, j] = stiffness[j, i] = k
        damping[i, j] = damping[j, i] = d
    return stiffness, damping


def _damping_matrices(kernel: Kernel, stiff: str, family: str, coordinates: Sequence[str]) -> Array:
    """Return damping matrices of one family, and what is proportional to stiffness matrices; as of ``_matrices``."""
    damping, stiffness = (_matrices(kernel, x, coordinates) for x in (family, stiff))
    for owner, numbers in element_numbers(kernel, family).items():
        own = [i for i, name in enumerate(coordinates) if joint_of(name) == owner]
        damping[np.ix_(own, own)] += lag_of(numbers) * stiffness[np.ix_(own, own)]
    return damping


def _matrices(kernel: Kernel, family: str, coordinates: Sequence[str]) -> Array:
    """Return the matrices of one family over coordinates, by their names, (size, size)."""
    matrix, place = np.zeros((len(coordinates),) * 2), {name: i for i, name in enumerate(coordinates)}
    for owner, numbers in element_numbers(kernel, family).items():
        for one, other in PAIRS:
            entry = numbers.get(entry_name(one, other))
            if entry is not None:
                i, j = place[component_name(owner, one)], place[component_name(owner, other)]
                matrix[i, j] = matrix[j, i] = entry
    return matrix


def _dampers(kernel: Kernel) -> Iterator[tuple[str, float, dict[str, int]]]:
    """Yield joints with isotropic damping, its number, and the indices of what it slows down, by short names."""
    for joint, numbers in element_numbers(kernel, MOTIONS).items():
        for key, damping in numbers.items():
            if key not in MOVED:
                continue
            names = {name: component_name(joint, name) for name in MOVED[key]}
            places = {name: kernel.coordinates.index(x) for name, x in names.items() if x in kernel.coordinates}
            yield joint, damping, places
