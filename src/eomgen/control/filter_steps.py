"""Steps of a filter's state with their exact derivatives: linearly implicit ones, as rollouts take them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..kernel.complete import Kernel
from ..robot.model import Model
from .filter_coordinates import FilterCoordinates

Numbers = NDArray[Any]
LINEAR_LAWS = ("stiffness", "damping")  # whose forces are linear in coordinates and velocities
ROUND_OFFS = 1e5  # of what a linear step may miss its equations by


def names_linear_laws(model: Model) -> bool:
    """Whether springs and dampers of a robot are linear as far as the names of its parameters tell."""
    laws = [name for name in model.parameters if not name.startswith("gravity.")]
    return all(name.startswith("joints.") and name.rpartition(".")[2] in LINEAR_LAWS for name in laws)


@dataclass(frozen=True)
class Slopes:
    """Constant stiffness K and damping B of a robot, (n, n) each."""

    K: Numbers
    B: Numbers

    @classmethod
    def of(cls, kernel: Kernel) -> Slopes:
        """Return what the residual's derivatives are at rest and without weight."""
        still, weightless = (
            np.zeros(kernel.n, kernel.dtype),
            dict.fromkeys((x for x in kernel.parameters if _is_gravity(x)), 0.0),
        )
        K, B, _ = kernel.replaced(parameters=weightless).residual_jacobian(still, still, still)
        return cls(K, B)

    def describe(self, kernel: Kernel, dt: float) -> bool:
        """Whether steps of this length are (M + dt B + dt^2 K) a = u - b - K (q + dt v) - B v, in random states."""
        rng, eps = np.random.default_rng(4), float(np.finfo(kernel.dtype).eps)
        for _ in range(3):
            q, v, u = (rng.normal(size=kernel.n).astype(kernel.dtype) for _ in range(3))
            a = (kernel.rollout(q, v, u, dt, 1, method="implicit")[1][1] - v) / kernel.dtype.type(dt)
            terms = (kernel.inverse_dynamics(q, v, a), dt * (self.K @ (v + dt * a)), dt * (self.B @ a), -u)
            scale = max(float(np.abs(x).max()) for x in (*terms, self.K @ q, self.B @ v))
            if float(np.abs(sum(terms)).max()) > ROUND_OFFS * eps * scale:
                return False
        return True


def _is_gravity(name: str) -> bool:
    return name.startswith("gravity.")


@dataclass(frozen=True)
class Acting:
    """Drives u, (n,), and wrenches on links, (links, 6), held over a step."""

    u: Numbers
    wrench: Numbers


@dataclass(frozen=True)
class FilterSteps:
    """Steps of a robot, and their derivatives by estimated q and v, wrenches on links and parameters.

    Attributes:
        kernel: with separate parameters, which estimates are written to.
        coordinates: those that are estimated, f of n.
        dt: length of a step, s.
        links: indices of the links whose wrenches are states.
        parameters: names of those that are states.
        slopes: of a robot whose steps are linear in accelerations; None: derivatives along all directions.
    """

    kernel: Kernel
    coordinates: FilterCoordinates
    dt: float
    links: tuple[int, ...]
    parameters: tuple[str, ...]
    slopes: Slopes | None

    @property
    def size(self) -> int:
        """The number of directions."""
        return 2 * len(self.coordinates.free) + 6 * len(self.links) + len(self.parameters)

    def advance(self, q: Numbers, v: Numbers, acting: Acting) -> tuple[Numbers, Numbers]:
        """Return estimated q and v at the end, (2 f,), and their derivatives, (2 f, size)."""
        kernel, n, dtype, free = self.kernel, self.kernel.n, self.kernel.dtype, self.coordinates.free
        along_q, along_v = self.directions(q, v)
        forces, along = self.forces(q, acting, along_q)
        if self.slopes is None:
            directions = {"q": along_q, "v": along_v, "u": along}
            (q_end, v_end), (dq, dv) = kernel.rollout_sensitivity(
                q, v, forces, self.dt, 1, method="implicit", along=directions, parameters=self.parameters
            )
            by = np.vstack([dq[1].T[free], dv[1].T[free]])
            return np.concatenate([q_end[1][free], v_end[1][free]]), by
        q_end, v_end = kernel.rollout(q, v, forces, self.dt, 1, method="implicit")
        dt, (K, B) = dtype.type(self.dt), (self.slopes.K, self.slopes.B)
        by_q, by_v, M = kernel.residual_jacobian(q, v, (v_end[1] - v) / dt)
        solved = np.linalg.solve(M + dt * (B + dt * K), np.hstack([by_q, by_v + dt * K]))
        start = np.eye(2 * n, dtype=dtype)
        by = start[n:] - dt * solved
        return np.concatenate([q_end[1], v_end[1]]), np.vstack([start[:n] + dt * by, by])

    def directions(self, q: Numbers, v: Numbers) -> tuple[Numbers, Numbers]:
        """Return derivatives of q and v by what is estimated, parameters apart, (size - parameters, n) each."""
        wrenches = np.zeros((6 * len(self.links), self.kernel.n), self.kernel.dtype)
        along_q, along_v = self.coordinates.directions(q, v)
        return np.vstack([along_q, wrenches]), np.vstack([along_v, wrenches])

    def forces(self, q: Numbers, acting: Acting, along_q: Numbers) -> tuple[Numbers, Numbers]:
        """Return drives with what wrenches add, (n,), and their derivatives along directions of q, (size, n)."""
        kernel, f = self.kernel, len(self.coordinates.free)
        along = np.zeros_like(along_q)
        if not self.links:
            return acting.u, along
        still = np.zeros_like(acting.wrench)
        for d in range(f):
            along[d] = kernel.jvp(kernel.functions.external_force, (q, acting.wrench), (along_q[d], still))
        for d in range(6 * len(self.links)):
            unit = still.copy()
            unit[self.links[d // 6], d % 6] = 1.0
            along[2 * f + d] = kernel.functions.external_force(q, unit)
        return acting.u + kernel.functions.external_force(q, acting.wrench), along

    def accelerations(self, q: Numbers, v: Numbers, acting: Acting) -> tuple[Numbers, Numbers]:
        """Return accelerations in a state, (n,), and their derivatives, (n, size)."""
        kernel, n, dtype = self.kernel, self.kernel.n, self.kernel.dtype
        along_q, along_v = self.directions(q, v)
        forces, along = self.forces(q, acting, along_q)
        state = (q, v, forces)
        rows = [
            kernel.jvp(kernel.forward_dynamics, state, directions)
            for directions in zip(along_q, along_v, along, strict=True)
        ]
        still = np.zeros(n, dtype)
        for name in self.parameters:
            rates = (still, still, still)
            rows.append(kernel.jvp(kernel.forward_dynamics, state, rates, parameters={name: 1.0}))
        return kernel.forward_dynamics(q, v, forces), np.array(rows, dtype).T
