"""The kernel of a generated package: functions of its C by their names, and rollouts of fixed steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from .compiled_kernel import CompiledKernel
from .raw import ROLLOUT

if TYPE_CHECKING:
    from .rollouts import Rollout


class PackageKernel(CompiledKernel):
    """Compiled equations of motion of one robot, as a generated package has them.

    Functions of the C are methods: ``mass_matrix(q)``, ``forward_dynamics(q, v, u)``, ``frame_pose(q, frame)``; the
    package's header says what they take and return.  Arrays are (n,) for one state or (..., n) for many; options are
    ``wrench``, ``z``, ``cut`` and ``out`` where a function has them.  ``eomgen.Kernel`` has the same, and derivatives,
    adaptive integration, inverse kinematics and loops beside them: ``eomgen.Kernel(kernel.raw.libraries)`` makes one.

    Raises (all methods):
        ArrayError: an array of wrong shape, with numbers that the dtype cannot hold exactly, or with NaN or infinity
            (see ``checks``); or a result that is not finite.
    """

    def __getattr__(self, name: str) -> Callable[..., Any]:
        """Return the function of that name."""
        bound = self.__dict__.get("_bound")
        if bound is None or not bound.has(name):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return bound[name]  # type: ignore[no-any-return]

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self._bound.names()})

    def rollout(  # noqa: PLR0913
        self,
        q0: ArrayLike,
        v0: ArrayLike,
        u: ArrayLike | None = None,
        dt: float | None = None,
        steps: int | None = None,
        *,
        method: str = "rk4",
        every: int = 1,
        kp: ArrayLike | None = None,
        kd: ArrayLike | None = None,
        target: ArrayLike | None = None,
        z: ArrayLike | None = None,
    ) -> Rollout:
        """Integrate in C over steps of one length, one state or many at a time; as ``eomgen.Kernel.rollout``.

        Args:
            q0, v0: states, (n,) or (N, n).
            u: drives, N or N m, held over a step: (n,); for one state (steps, n); for many (N, n), (N, steps, n) or
                (1, steps, n).
            dt: length of a step, s.
            steps: their number.
            method: "rk4", the classical Runge-Kutta method, or "implicit", linearly implicit Euler, stable whatever
                springs and dampers there are.
            every: one of so many steps is stored.
            kp, kd: gains of a joint controller that adds kp (target - q) - kd v: a number, or (n,).
            target: coordinates that the controller aims at, shapes as for ``u``.
            z: internal states at the beginning, (m,) or (N, m), 0 by default; the result has them as attribute ``z``.

        Returns:
            q and v, (steps // every + 1, n) or (N, steps // every + 1, n), the states at the beginning first.

        Raises:
            UnknownNameError: the package was written without rollouts.
            SingularError, IntegrationStopped, InputError: as of ``eomgen.Kernel.rollout``.
        """
        self.raw.function(ROLLOUT)  # or the error that it is not there
        from .many_steps import rollout
        from .rollouts import Control, FixedSteps, Inputs

        options, inputs = FixedSteps(method, dt, steps, every), Inputs(q0, v0, u, Control(kp, kd, target))
        if not self.internal_states:
            self.calls.refuse_z(z)
            return rollout(self.calls, inputs, options)
        from .internal_states import joined_inputs, taken_apart

        joined = joined_inputs(self.calls, z, inputs)
        return taken_apart(self.calls, lambda: rollout(self.calls, joined, options))
