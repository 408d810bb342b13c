"""Damping of joints' own motions as a kernel has it now."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..arrays import Array
from ..names import component_name, parameter_name
from ..robot.joint_damping import MOVED
from ..robot.parameter_names import MOTIONS
from ..runtime.kernel import Kernel
from .elements import element_numbers


def damping_diagonal(kernel: Kernel) -> Array:
    """Share of joints' own damping in that of every coordinate, (n,), N s/m or N m s/rad."""
    found = np.zeros(kernel.n)
    for _, damping, index in _dampers(kernel):
        found[list(index.values())] += damping
    return found


def damping_forces(kernel: Kernel, q: Array, v: Array) -> Array:
    """The forces, (T, n), that damping of joints' own motions takes from the drives in states, (T, n) each."""
    found = np.zeros_like(v)
    for joint, damping, index in _dampers(kernel):
        places = list(index.values())
        found[:, places] += damping * v[:, places]
        if {"alpha", "gamma"} <= index.keys():
            beta = kernel.parameters.get(parameter_name("joints", joint, "offset", "beta"), 0.0)
            sine = np.sin(beta + (q[:, index["beta"]] if "beta" in index else 0.0))
            alpha, gamma = index["alpha"], index["gamma"]
            found[:, alpha] += damping * sine * v[:, gamma]
            found[:, gamma] += damping * sine * v[:, alpha]
    return found


def _dampers(kernel: Kernel) -> Iterator[tuple[str, float, dict[str, int]]]:
    """Joints with such a damping, its number, and the indices of what it slows down, by their short names."""
    for joint, numbers in element_numbers(kernel, MOTIONS).items():
        for key, damping in numbers.items():
            names = {name: component_name(joint, name) for name in MOVED[key]}
            places = {name: kernel.coordinates.index(x) for name, x in names.items() if x in kernel.coordinates}
            yield joint, damping, places
