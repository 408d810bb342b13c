"""Motions of all coordinates with prescribed outputs: in balance sample by sample, then with all that moves inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Index, rank_by
from ...errors import InputError, IntegrationError
from ...kernel.complete import Kernel
from ...motion.point_to_point import Program
from ...names import listed
from .collocation import WIDTH, CollocationSpline, equilibrated, least_norm
from .outputs import Outputs, outputs_of
from .zeros import InternalZeros, internal_zeros, refuse_undamped

STATIC_STEPS, ITERATIONS = 30, 20
SETTLED = 1e-11  # m or rad, of a change of a coordinate
SMALL = 1e-7  # likewise, where changes get no smaller
SINGULAR = 1e-9  # of the greatest singular value, rows and columns alike: a pose at which outputs cannot be followed
SHOWN = 0.3  # of the largest share: outputs that a message names


@dataclass(frozen=True, eq=False)
class Problem:
    """A robot whose outputs follow a program.

    Attributes:
        kernel, program: of the robot, and of its principal coordinates.
        driven: places of the program's coordinates, (m,).
        index, ratio: where drives act, (m,), and the ratios of gears in front of those, (m,).
        undriven: the other coordinates, (n - m,).
        outputs: names of what follows, m.
    """

    kernel: Kernel
    program: Program
    driven: Index
    index: Index
    ratio: Array
    undriven: Index
    outputs: tuple[str, ...]

    def rigid(self, t: Array) -> tuple[Array, Array, Array]:
        """Return coordinates, velocities and accelerations without deviations, (T, n) each."""
        q, v, a = (self._whole(x) for x in self.program.at(t))
        return q, v, a

    def _whole(self, x: Array) -> Array:
        whole = np.zeros((len(x), self.kernel.n))
        whole[:, self.index] = x * self.ratio
        whole[:, self.driven] = x
        return whole

    def wanted(self, q: Array) -> Outputs:
        """Return the outputs, wanted where they are at coordinates without deviations, (T, n)."""
        return outputs_of(self.kernel, self.outputs, q)


@dataclass(frozen=True, eq=False)
class InverseMotion:
    """Motion of all coordinates, a spline, and where they are in static equilibrium at its first and last time, (2, n).

    history: greatest change of a coordinate in each iteration, m or rad.
    """

    spline: CollocationSpline
    still: Array
    history: tuple[float, ...]


def zeros_at(problem: Problem, t: float) -> InternalZeros:
    """Return finite zeros from drives to outputs at rest in the pose of a time.

    Raises:
        InputError: one is on the imaginary axis, or outputs cannot be followed there.
    """
    kernel, places = problem.kernel, problem.rigid(np.array([t]))[0]
    q = _in_balance(problem, np.array([t]), (places, 0.0 * places, 0.0 * places))[0]
    still = np.zeros(kernel.n)
    tangents = kernel.residual_jacobian(q, still, still)
    slopes = problem.wanted(places).slopes(kernel, q[np.newaxis])[0]
    zeros = internal_zeros(tangents, problem.undriven, slopes)
    refuse_undamped(zeros, tangents[2], kernel.coordinates, f"at the pose of {t:.4g} s")
    return zeros


def balanced(problem: Problem, t: Array) -> Array:
    """Return coordinates that balance the program's accelerations sample by sample, outputs as wanted, (T, n).

    Raises:
        InputError: outputs cannot be followed at a pose.
        IntegrationError: there is no balance.
    """
    return _in_balance(problem, t, problem.rigid(t))


def _in_balance(problem: Problem, t: Array, motion: tuple[Array, Array, Array]) -> Array:
    kernel, (places, v, a) = problem.kernel, motion
    wanted, zero, before = problem.wanted(places), np.zeros_like(places), np.inf
    q = places
    for step in range(STATIC_STEPS):
        off = _left(problem, wanted, (q, v, a), zero)
        stiffness = kernel.residual_jacobian(q, v, a)[0][:, problem.undriven]
        matrix = np.concatenate([stiffness, wanted.slopes(kernel, q)], axis=1)
        rows, columns = equilibrated(np.abs(matrix).max(axis=0))
        scaled = rows[:, np.newaxis] * matrix * columns
        if step == 0:
            _refuse_singular(problem, t, scaled)
        change = -columns * np.linalg.solve(scaled, (rows * off)[..., np.newaxis])[..., 0]
        q = q + change
        size = float(np.abs(change).max())
        if size <= SETTLED or (size <= SMALL and size >= 0.5 * before):
            return q
        before = size
    worst = int(np.abs(change).max(axis=1).argmax())
    name = kernel.coordinates[int(np.abs(change[worst]).argmax())]
    raise IntegrationError(
        f"{kernel.name}: {name} finds no balance at {t[worst]:.4g} s with its outputs where they are wanted"
    )


def _refuse_singular(problem: Problem, t: Array, matrices: Array) -> None:
    """Raise InputError where coordinates in balance do not move the outputs in some direction; names these."""
    U, S, _ = np.linalg.svd(matrices)
    worst = int((S[:, -1] / S[:, 0]).argmin())
    if S[worst, -1] > SINGULAR * S[worst, 0]:
        return
    share = np.abs(U[worst, problem.undriven.size :, -1])
    names = [name for name, x in zip(problem.outputs, share.tolist(), strict=True) if x >= SHOWN * share.max()]
    raise InputError(
        f"outputs: drives of {problem.kernel.name} do not move {listed(names)} independently at {t[worst]:.4g} s, a"
        " singular pose; allowed: another motion, or other outputs (positions of the tool and coordinates of its wrist"
        " say)"
    )


def _left(problem: Problem, wanted: Outputs, motion: tuple[Array, Array, Array], zero: Array) -> Array:
    """Return what is left of all equations, (T, n): forces of what has no drive, then the outputs' errors."""
    force = np.asarray(problem.kernel.residual(*motion, zero))[:, problem.undriven]
    return np.concatenate([force, wanted.errors(problem.kernel, motion[0])], axis=1)


def inverted(problem: Problem, t: Array, still: Array, ends: tuple[InternalZeros, InternalZeros]) -> InverseMotion:
    """Return the bounded motion with the outputs as wanted.

    Args:
        problem: the task.
        t: equally spaced times, (T,).
        still: coordinates in balance there, (T, n).
        ends: zeros at the first and the last of these, those that times resolve.

    Raises:
        IntegrationError: Newton's method does not converge.
    """
    kernel, (places, rates, _) = problem.kernel, problem.rigid(t)
    wanted, history, zero = problem.wanted(places), list[float](), np.zeros_like(still)
    spline = CollocationSpline.through(t, still, rates[[0, -1]])
    for _ in range(ITERATIONS):
        motion = spline.at(t)
        off = _left(problem, wanted, motion, zero)
        slopes = wanted.slopes(kernel, motion[0])
        blocks = _blocks(problem, spline, motion, slopes)
        rows, columns = equilibrated(np.abs(blocks).max(axis=1).sum(axis=0))
        first = _orthonormal(_conditions(spline, ends[0], slopes[0], at_end=False), columns)
        last = _orthonormal(_conditions(spline, ends[1], slopes[-1], at_end=True), columns)
        change = columns * least_norm(rows[:, np.newaxis] * blocks * columns, spline.starts, -rows * off, (first, last))
        spline = spline.moved(change)
        history.append(float(np.abs(change).max()))
        if history[-1] <= SETTLED or (history[-1] <= SMALL and history[-1] >= 0.5 * min(history[:-1], default=np.inf)):
            return InverseMotion(spline, still[[0, -1]], tuple(history))
        if not np.isfinite(history[-1]) or history[-1] > 1e3:
            break
    steps = ", ".join(f"{x:.2g}" for x in history[-3:])
    raise IntegrationError(
        f"{kernel.name}: Newton's method does not find the inverse motion (last changes {steps} m or rad); allowed: a"
        " slower motion, or another step"
    )


def _blocks(problem: Problem, spline: CollocationSpline, motion: tuple[Array, Array, Array], slopes: Array) -> Array:
    """Return derivatives of all equations by the coefficients that count at each time, (WIDTH, T, n, n)."""
    tangents = [x[:, problem.undriven] for x in problem.kernel.residual_jacobian(*motion)]
    blocks = np.zeros((WIDTH, len(slopes), problem.kernel.n, problem.kernel.n))
    d = problem.undriven.size
    for j in range(WIDTH):
        weights = spline.weights[:, :, j, np.newaxis, np.newaxis]
        blocks[j, :, :d] = sum(w * x for w, x in zip(weights, tangents, strict=True))
        blocks[j, :, d:] = weights[0] * slopes
    return blocks


def _conditions(spline: CollocationSpline, zeros: InternalZeros, slopes: Array, *, at_end: bool) -> Array:
    """Return conditions on the two outer coefficients, (r, 2 n), which are orthogonal to them.

    Then nothing decays forwards at the first time, or backwards at the last, and outputs keep their rates.
    """
    decaying = zeros.where(zeros.values.real > 0.0 if at_end else zeros.values.real < 0.0).amplitudes
    weights = spline.weights[:2, -1, -2:] if at_end else spline.weights[:2, 0, :2]
    outputs = np.stack([np.zeros_like(slopes), slopes], axis=1)
    every = np.concatenate([decaying.real, decaying.imag, outputs])
    return np.asarray(np.einsum("rin,ij->rjn", every, weights))


def _orthonormal(conditions: Array, columns: Array) -> Array:
    """Return conditions, (r, 2, n), on coefficients over their sizes, (n,), as orthonormal rows, (r, 2 n)."""
    rows = (conditions * columns).reshape(len(conditions), 2 * len(columns))
    rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
    _, S, Vt = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(Vt[: rank_by(S)])
