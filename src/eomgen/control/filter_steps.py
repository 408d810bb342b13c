"""Steps of a filter's state with their exact derivatives: linearly implicit ones, as rollouts take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..robot.model import Model
from ..runtime.kernel import Kernel

Numbers = NDArray[Any]
LINEAR_LAWS = ("stiffness", "damping")  # whose forces are linear in coordinates and velocities
LINEAR_KERNELS = ("rollout", "residual_jacobian", "inverse_dynamics")
GENERAL_KERNELS = ("implicit_sensitivity",)
WRENCH_KERNELS = ("external_force", "external_force_tangent")
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
        K, B, _ = kernel.with_parameters(weightless).residual_jacobian(still, still, still)
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
    """Steps of a robot, and their derivatives by q, v, wrenches on links and parameters.

    Attributes:
        kernel: with separate parameters, which estimates are written to.
        dt: length of a step, s.
        links: indices of the links whose wrenches are states.
        parameters: names of those that are states.
        slopes: of a robot whose steps are linear in accelerations; None: derivatives along all directions.
    """

    kernel: Kernel
    dt: float
    links: tuple[int, ...]
    parameters: tuple[str, ...]
    slopes: Slopes | None

    @property
    def size(self) -> int:
        """The number of directions."""
        return 2 * self.kernel.n + 6 * len(self.links) + len(self.parameters)

    def advance(self, q: Numbers, v: Numbers, acting: Acting) -> tuple[Numbers, Numbers, Numbers]:
        """Return q and v at the end, (n,) each, and the derivatives of that v, (n, size); that q is q + dt v."""
        kernel, n, dtype = self.kernel, self.kernel.n, self.kernel.dtype
        forces, along = self.forces(q, acting)
        if self.slopes is None:
            starts = np.eye(self.size, dtype=dtype)[: self.size - len(self.parameters)]
            directions = {"q": starts[:, :n], "v": starts[:, n : 2 * n], "u": along}
            (q_end, v_end), (_, dv) = kernel.rollout_sensitivity(
                q, v, forces, self.dt, 1, method="implicit", along=directions, parameters=self.parameters
            )
            return q_end[1], v_end[1], dv[1].T
        q_end, v_end = kernel.rollout(q, v, forces, self.dt, 1, method="implicit")
        dt, (K, B) = dtype.type(self.dt), (self.slopes.K, self.slopes.B)
        by_q, by_v, M = kernel.residual_jacobian(q, v, (v_end[1] - v) / dt)
        solved = np.linalg.solve(M + dt * (B + dt * K), np.hstack([by_q, by_v + dt * K]))
        start = np.hstack([np.zeros((n, n), dtype), np.eye(n, dtype=dtype)])
        return q_end[1], v_end[1], start - dt * solved

    def forces(self, q: Numbers, acting: Acting) -> tuple[Numbers, Numbers]:
        """Return drives with what wrenches add, (n,), and their derivatives along directions but parameters."""
        kernel, n, dtype = self.kernel, self.kernel.n, self.kernel.dtype
        count = self.size - len(self.parameters)
        along = np.zeros((count, n), dtype)
        if not self.links:
            return acting.u, along
        still = np.zeros_like(acting.wrench)
        for d in range(n):
            rate = np.eye(n, dtype=dtype)[d]
            along[d] = kernel.jvp("external_force", (q, acting.wrench), (rate, still))
        for d in range(6 * len(self.links)):
            unit = still.copy()
            unit[self.links[d // 6], d % 6] = 1.0
            along[2 * n + d] = kernel.external_force(q, unit)
        return acting.u + kernel.external_force(q, acting.wrench), along

    def accelerations(self, q: Numbers, v: Numbers, acting: Acting) -> tuple[Numbers, Numbers]:
        """Return accelerations in a state, (n,), and their derivatives, (n, size)."""
        kernel, n, dtype = self.kernel, self.kernel.n, self.kernel.dtype
        forces, along = self.forces(q, acting)
        starts, state = np.eye(self.size, dtype=dtype)[: len(along)], (q, v, forces)
        pairs = zip(starts, along, strict=True)
        rows = [kernel.jvp("forward_dynamics", state, (x[:n], x[n : 2 * n], f)) for x, f in pairs]
        still = np.zeros(n, dtype)
        for name in self.parameters:
            rates = (still, still, still)
            rows.append(kernel.jvp("forward_dynamics", state, rates, parameters={name: 1.0}))
        return kernel.forward_dynamics(q, v, forces), np.array(rows, dtype).T


def kernels_of_steps(*, is_linear: bool, has_wrenches: bool) -> Sequence[str]:
    """Name the kernels that steps call."""
    return (*(LINEAR_KERNELS if is_linear else GENERAL_KERNELS), *(WRENCH_KERNELS if has_wrenches else ()))
