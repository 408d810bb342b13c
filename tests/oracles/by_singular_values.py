"""Mechanisms with closed loops, in NumPy: a kernel's tree together with the constraint of its cut joints.

    M a + h = u + J^T lambda,    J a + J_dot v = 0,    g(q) = 0,

with h = inverse_dynamics(q, v, 0).  Constraints may be redundant (J without full rank): everything is solved through
the singular values of J L^-T, M = L L^T, so that accelerations are unique and multipliers those of least norm.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eomgen.errors import InputError, LoopError, SingularError, UnknownNameError
from eomgen.kernel.complete import Kernel
from eomgen.loops.redundant import Factors, Redundancy
from eomgen.robot.coordinates import unit_of
from eomgen.robot.joint_types import CUTS, JOINT_TYPES
from eomgen.runtime.singular import null_coordinates, singular_place
from eomgen.shown import Shown
from eomgen.state.equilibrium import known_coordinates
from eomgen.state.vectors import prescribed_mask, state_vector
from tests.oracles.closed_loops import cut_wrenches, least_drives

Array = NDArray[np.float64]

CLOSED = 1e-12  # m, or sine of an angle: a constraint that is met
OPEN = 1e-9  # m or rad, and per second: more is not round-off
STEP = 0.5  # m or rad, the longest step towards closure


@dataclass(frozen=True)
class LoopDynamics(Shown):
    """Accelerations of a mechanism with loops, and the forces in its cuts.

    Attributes:
        a: accelerations, (n,), m/s^2 or rad/s^2.
        multipliers: lambda, (constraints,), N or N m, of least norm in the sense of ``redundancy``.
        redundancy: the rank, and what is not unique.
    """

    a: Array
    multipliers: Array
    redundancy: Redundancy


@dataclass(frozen=True)
class LoopForces(Shown):
    """Drives of a motion of a mechanism with loops, and the forces in its cuts.

    Attributes:
        u: drives, (n,), N or N m; 0 where there is none.
        multipliers: lambda, (constraints,), N or N m, of least norm.
        redundancy: the rank, and what is not unique.
    """

    u: Array
    multipliers: Array
    redundancy: Redundancy


class ClosedLoops:
    """The mechanism that a kernel's tree is once its loops are closed; one state at a time.

    Args:
        kernel: float64, of a robot with loops, with the kernels constraint, constraint_jacobian, constraint_bias,
            cut_poses, mass_matrix and inverse_dynamics (``integrate``: also energy).

    Raises (all methods):
        ArrayError, UnknownNameError: an array or a name is wrong.
        SingularError: M is not positive definite.
    """

    def __init__(self, kernel: Kernel) -> None:
        if not kernel.loops:
            raise InputError(f"{kernel.name} has no loops; allowed: a kernel of a robot with [[loops]]")
        if kernel.dtype != np.float64:
            raise InputError(f"loops need a float64 kernel; {kernel.name} is {kernel.dtype}")
        self.kernel = kernel
        self._owner = [loop for loop, kind in kernel.loops.items() for _ in CUTS[kind]]
        self._moving = ~prescribed_mask(kernel)

    def consistent_positions(self, q_guess: ArrayLike, *, held: Iterable[str] = ()) -> Array:
        """Coordinates near a guess that close all loops, (n,); Levenberg-Marquardt method.

        Args:
            q_guess: (n,).
            held: names of coordinates that stay at their guess; prescribed ones do.

        Raises:
            LoopError: they do not close near the guess; names the loop and its remaining gap.
        """
        q = state_vector("q_guess", q_guess, self.kernel.coordinates)
        free = self._free(held)
        g: Array = self.kernel.functions.constraint(q)
        damping = 1e-3
        for _ in range(300):
            gap = float(np.linalg.norm(g))
            if np.abs(g).max() <= CLOSED or damping > 1e12 or not free.any():
                break
            trial = q.copy()
            trial[free] += self._closing_step(q, g, free, damping * gap)
            found = self.kernel.functions.constraint(trial)
            if np.linalg.norm(found) < gap:
                q, g, damping = trial, found, max(0.2 * damping, 1e-12)
            else:
                damping *= 5.0
        if np.abs(g).max() > CLOSED:
            raise self._open(g, "does not close near the guess", "a guess nearer to closure, or fewer held coordinates")
        self._refuse_turned_over(q)
        return q

    def _closing_step(self, q: Array, g: Array, free: NDArray[np.bool_], damping: float) -> Array:
        J = self.kernel.functions.constraint_jacobian(q)[:, free]
        size = J.shape[1]
        damped = np.vstack([J, np.sqrt(damping) * np.eye(size)])
        step: Array = np.linalg.lstsq(damped, np.concatenate([-g, np.zeros(size)]), rcond=None)[0]
        return np.asarray(step * min(1.0, STEP / max(np.abs(step).max(initial=0.0), 1e-300)))

    def _refuse_turned_over(self, q: Array) -> None:
        """Products of axes vanish for opposite axes, too."""
        for (name, kind), pose in zip(self.kernel.loops.items(), self.kernel.functions.cut_poses(q), strict=True):
            terms = JOINT_TYPES[kind].upright
            if terms and sum(factor * pose[i, j] for factor, i, j in terms) <= 0.0:
                raise LoopError(
                    f"{self.kernel.name}: loop {name} closes near the guess only turned over by half a turn; allowed: a"
                    " guess in which the axes of the cut joint's frames point to the same side",
                    loop=name,
                    gap=np.pi,
                )

    def consistent_velocities(self, q: ArrayLike, v_guess: ArrayLike, *, held: Iterable[str] = ()) -> Array:
        """Rates that keep the loops closed, (n,), those with the least kinetic energy of the difference to the guess.

        That is what a sudden closing of the loops makes of ``v_guess``, too.

        Args:
            q: coordinates that close the loops, (n,).
            v_guess: (n,).
            held: names of coordinates whose rates stay; those of prescribed ones do.

        Raises:
            LoopError: the loops are open at q, or the rates that are held open one; names it and what remains.
        """
        q, v = (state_vector(label, x, self.kernel.coordinates) for label, x in (("q", q), ("v_guess", v_guess)))
        self.refuse_open(q, np.zeros_like(v))
        free = self._free(held)
        J = self.kernel.functions.constraint_jacobian(q)
        moving: Array = v.copy()
        for _ in range(2 if free.any() else 0):  # the second time for round-off
            moving[free] -= RankedFactors(J[:, free], *self._root(q, free)).smallest(J @ moving)
        rates = J @ moving
        if np.abs(rates).max() > OPEN * max(1.0, np.abs(J).max() * np.abs(moving).max()):
            raise self._open(rates, "opens at the rates that are held", "fewer held rates, or others", "/s")
        return moving

    def forward_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        u: ArrayLike,
        *,
        wrench: ArrayLike | None = None,
        baumgarte: float = 0.0,
        rank: int | None = None,
    ) -> LoopDynamics:
        """Accelerations under the drives u with the loops closed, and the multipliers of the constraint.

        Args:
            q, v, u: (n,); q and v that close the loops, unless ``baumgarte`` is to close them.  In u a prescribed
                coordinate has its acceleration.
            wrench: external wrenches, (links, 6).
            baumgarte: w, 1/s: g_ddot = -2 w g_dot - w^2 g instead of 0.
            rank: of a closed state nearby, where the loops are open by more than round-off and some constraints are
                redundant.

        Raises:
            LoopError: the loops are open or opening, by more than 1e-9, and no ``baumgarte`` closes them; or the
                prescribed accelerations open them.
        """
        q, v, u = (state_vector(label, x, self.kernel.coordinates) for label, x in zip("qvu", (q, v, u), strict=True))
        if not baumgarte:
            self.refuse_open(q, v)
        a, multipliers, factors = self.solve(q, v, u, wrench, baumgarte, rank)
        if not baumgarte and not self._moving.all():
            J, bias = self.kernel.functions.constraint_jacobian(q), self.kernel.functions.constraint_bias(q, v)
            self._refuse_opening(a, J, bias, "opens at the prescribed accelerations", "others")
        return LoopDynamics(a, multipliers, self._redundancy(factors))

    def solve(
        self, q: Array, v: Array, u: Array, wrench: ArrayLike | None, baumgarte: float, rank: int | None
    ) -> tuple[Array, Array, RankedFactors]:
        """Accelerations, multipliers and factors like ``forward_dynamics``, without the cost of its report."""
        kernel = self.kernel
        J = kernel.functions.constraint_jacobian(q)
        wanted = -kernel.functions.constraint_bias(q, v)
        if baumgarte:
            wanted -= baumgarte * (2.0 * (J @ v) + baumgarte * kernel.functions.constraint(q))
        free = self._moving
        a = np.where(free, 0.0, u)
        factors = self._factors(q, J, rank)
        force = (u - kernel.inverse_dynamics(q, v, a, wrench=wrench, cut=True))[free]
        open_a = factors.back(np.linalg.solve(factors.L, force))
        missing = wanted - J @ a - factors.J @ open_a
        a[free] = open_a + factors.smallest(missing)
        return a, factors.multipliers(missing), factors

    def inverse_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        *,
        driven: Iterable[str],
        wrench: ArrayLike | None = None,
    ) -> LoopForces:
        """Drives that a motion takes with the loops closed: M a + h = u + J^T lambda, u at some coordinates alone.

        Args:
            q, v, a: (n,), a motion that keeps the loops closed.
            driven: names of the coordinates with a drive; prescribed ones always have one.  Of more drives than the
                mechanism has degrees of freedom the least ones are found, by the sum of their squares.
            wrench: external wrenches, (links, 6).

        Raises:
            LoopError: the motion opens a loop, or these drives cannot make it.
        """
        kernel = self.kernel
        q, v, a = (state_vector(label, x, kernel.coordinates) for label, x in zip("qva", (q, v, a), strict=True))
        self.refuse_open(q, v)
        J = kernel.functions.constraint_jacobian(q)
        self._refuse_opening(
            a, J, kernel.functions.constraint_bias(q, v), "opens at the accelerations", "those of its motion"
        )
        names = self._driven(driven)
        needed = kernel.inverse_dynamics(q, v, a, wrench=wrench, cut=True)
        u, multipliers, left = least_drives(J, needed, [kernel.coordinates.index(name) for name in names])
        if left > OPEN * max(1.0, np.abs(needed).max()):
            raise LoopError(
                f"{kernel.name}: drives at {', '.join(names) or 'none'} cannot make this motion: {left:.3g} N or N m"
                f" are left; allowed: drives that hold all {self.redundancy(q).mobility} degrees of freedom",
                loop=self._owner[0],
                gap=left,
            )
        return LoopForces(u, multipliers, self.redundancy(q))

    def _driven(self, names: Iterable[str]) -> list[str]:
        """Names of the coordinates with a drive, in order."""
        found = {*names, *self.kernel.prescribed}
        for name in found:
            if name not in self.kernel.coordinates:
                raise UnknownNameError(f"driven: {name!r} is unknown; known: {', '.join(self.kernel.coordinates)}")
        return [name for name in self.kernel.coordinates if name in found]

    def reactions(self, q: ArrayLike, multipliers: ArrayLike) -> Array:
        """Reactions of the cut joints on their second links, (loops, 6): force (N), moment (N m).

        At the origin and in the axes of the cut frame on that link; the first link feels the opposite.  Components
        that the joint leaves free are zero; those of ``Redundancy.undetermined`` are one possibility of many.

        Args:
            q: (n,).
            multipliers: (constraints,), of ``forward_dynamics``.
        """
        q = state_vector("q", q, self.kernel.coordinates)
        return cut_wrenches(self.kernel, q, state_vector("multipliers", multipliers, self.kernel.constraints))

    def redundancy(self, q: ArrayLike) -> Redundancy:
        """Rank of the constraint at q, (n,), where prescribed coordinates do not move, and what is redundant."""
        q = state_vector("q", q, self.kernel.coordinates)
        return self._redundancy(self._factors(q, self.kernel.functions.constraint_jacobian(q)))

    def settled(self, q: Array, v: Array, rank: int) -> tuple[Array, Array, int]:
        """The nearest state, in the kinetic metric of q, that is closed and stays so; and its rank.

        Args:
            q, v: nearly closed, (n,) each.
            rank: of a closed state nearby.

        Raises:
            LoopError: a gap stays.
        """
        free, root = self._moving, self._root(q)
        q, v = q.copy(), v.copy()
        for _ in range(10):
            g, J = self.kernel.functions.constraint(q), self.kernel.functions.constraint_jacobian(q)
            factors = RankedFactors(J[:, free], *root, rank)
            if np.abs(g).max() <= CLOSED:
                v[free] -= factors.smallest(J @ v)
                return q, v, factors.found_rank
            q[free] -= factors.smallest(g)
        raise self._open(g, "comes open", "a shorter step")

    def refuse_open(self, q: Array, v: Array) -> None:
        """LoopError unless the state, (n,) each, is closed and stays so, up to 1e-9."""
        g, rates = self.kernel.functions.constraint(q), self.kernel.functions.constraint_jacobian(q) @ v
        if np.abs(g).max() > OPEN:
            raise self._open(g, "is open", "q of consistent_positions")
        if np.abs(rates).max() > OPEN * max(1.0, np.abs(v).max()):
            raise self._open(rates, "is opening", "v of consistent_velocities", "/s")

    def _refuse_opening(self, a: Array, J: Array, bias: Array, what: str, allowed: str) -> None:
        rates = J @ a + bias
        if np.abs(rates).max() > OPEN * max(1.0, np.abs(J).max() * np.abs(a).max(), np.abs(bias).max()):
            raise self._open(rates, what, allowed, "/s^2")

    def _free(self, held: Iterable[str]) -> NDArray[np.bool_]:
        kept = known_coordinates(held, self.kernel) | set(self.kernel.prescribed)
        return np.array([name not in kept for name in self.kernel.coordinates])

    def _factors(self, q: Array, J: Array, rank: int | None = None) -> RankedFactors:
        """Factors of the constraint in the coordinates that are not prescribed."""
        return RankedFactors(J[:, self._moving], *self._root(q), rank)

    def _root(self, q: Array, free: NDArray[np.bool_] | None = None) -> tuple[Array, Array]:
        """M of the coordinates that are free (not prescribed, by default), and L of M = L L^T."""
        free = self._moving if free is None else free
        M = self.kernel.mass_matrix(q)[np.ix_(free, free)]
        try:
            return M, np.linalg.cholesky(M)
        except np.linalg.LinAlgError:
            names = np.array(self.kernel.coordinates)[free].tolist()
            found, reason = singular_place(null_coordinates(M, names), q, self.kernel.coordinates)
            raise SingularError(
                f"{self.kernel.name}: the mass matrix of the open tree cannot be inverted at {found}; {reason}"
            ) from None

    def _redundancy(self, factors: Factors) -> Redundancy:
        return factors.redundancy(self.kernel.constraints)

    def _open(self, gaps: Array, what: str, allowed: str, per: str = "") -> LoopError:
        """The error that names the loop with the greatest gap."""
        worst = int(np.abs(gaps).argmax())
        name, loop = self.kernel.constraints[worst], self._owner[worst]
        unit = unit_of(name) + per
        gap = float(abs(gaps[worst]))
        return LoopError(
            f"{self.kernel.name}: loop {loop} {what}: {name} is left with {gap:.3g} {unit}; allowed: {allowed}",
            loop=loop,
            gap=gap,
        )


class RankedFactors(Factors):
    """Factors of a given rank, and what they solve.

    Where loops are closed up to a gap only, redundant constraints have singular values of the size of the gap; so the
    rank may be given, as that of a closed state nearby.  ``found_rank`` is the one that is seen here.
    """

    def __init__(self, J: Array, M: Array, L: Array | None = None, rank: int | None = None) -> None:
        super().__init__(J, M)
        self.L = np.linalg.cholesky(M) if L is None else L
        self.found_rank = self.rank
        self.rank = self.rank if rank is None else rank
        U, S, Vt = np.linalg.svd(self.scaled, full_matrices=False)
        self.U, self.S, self.Vt = U[:, : self.rank], S[: self.rank], Vt[: self.rank]

    def back(self, y: Array) -> Array:
        """L^-T y."""
        return np.linalg.solve(self.L.T, y)

    def smallest(self, b: Array) -> Array:
        """The x with J x = b (in the least-squares sense) and the least x^T M x."""
        return self.back(self.Vt.T @ ((self.U.T @ b) / self.S))

    def multipliers(self, b: Array) -> Array:
        """The lambda of least norm with J M^-1 J^T lambda = b."""
        return np.asarray(self.U @ ((self.U.T @ b) / self.S**2))
