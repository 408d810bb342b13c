"""Kernels: how they are made, copied and pickled, parameters, threads and checks; that of a generated package."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..names import DriveInput, html_table, joint_of, show
from .arrays import Arrays, inputs_of, names_in
from .bound import WrenchLike
from .calls import Calls
from .direct import BoundFunctions, ExtensionBinding
from .parameters import Parameters
from .raw import ROLLOUT, Array, Libraries, RawKernel, name_of

if TYPE_CHECKING:
    from .rollouts import Rollout


class CompiledKernel:
    """Compiled functions with separate parameters, and how they are called; attributes as of ``eomgen.Kernel``."""

    forward_dynamics: Any  # methods of classes derived from this one
    functions: Any
    _kind_of_bound: type[BoundFunctions] = BoundFunctions
    _bound: BoundFunctions

    def __init__(
        self,
        libraries: Libraries,
        again: tuple[Callable[..., Any], tuple[Any, ...]] | None = None,
        binding: ExtensionBinding | None = None,
        opener: Callable[..., Any] | None = None,
    ) -> None:
        """Make a kernel of compiled functions.

        Args:
            libraries: where the functions are.
            again: a function of a module and its arguments that make the same kernel in another process.
            binding: gives the extension module that plain calls go through; without one all go through cffi.
            opener: gives the methods of a kernel on a device; without one there are none.
        """
        meta = libraries.meta
        self.raw = RawKernel(libraries)
        self.name: str = self.raw.name
        self.dtype: np.dtype[Any] = self.raw.dtype
        self.coordinates: tuple[str, ...] = tuple(meta["coordinates"])
        self.internal_states: tuple[str, ...] = tuple(meta.get("internal_states", ()))
        self.internal_state_units: tuple[str, ...] = tuple(meta.get("internal_state_units", ()))
        self.inputs: dict[str, DriveInput] = inputs_of(meta)
        self.links: tuple[str, ...] = tuple(meta["links"])
        self.frames: tuple[str, ...] = tuple(meta["frames"])
        self.joints: tuple[str, ...] = tuple(meta["joints"])
        self.loops: dict[str, str] = dict(meta.get("loops", {}))
        self.constraints: tuple[str, ...] = tuple(meta.get("constraints", ()))
        self._followers: dict[str, Mapping[str, Any]] = dict(meta.get("followers", {}))
        self.couplings: tuple[str, ...] = tuple(
            name for name in meta.get("couplings", ()) if name in {x["coupling"] for x in self._followers.values()}
        )
        self.follower_names: tuple[str, ...] = tuple(self._followers)
        self.springs: tuple[str, ...] = tuple(meta.get("springs", ()))
        self.element_rows: tuple[str, ...] = tuple(meta.get("element_rows", ()))
        self.cut_laws: tuple[str, ...] = tuple(meta.get("cut_laws", ()))
        self.modal_couplings: tuple[tuple[str, str, float, float], ...] = tuple(
            (one, other, float(k), float(d)) for one, other, k, d in meta.get("modal_couplings", ())
        )
        self.elements: Mapping[str, Mapping[str, Mapping[str, int]]] = meta.get("elements", {})
        self.prescribed: tuple[str, ...] = tuple(meta["prescribed"])
        self.actuated_coordinates: tuple[str, ...] = tuple(self.coordinates[i] for i in meta["driven"])
        self.motors: dict[str, str] = {name: drives for name, (drives, _) in meta.get("motors", {}).items()}
        self.operations: Mapping[str, Mapping[str, int]] = libraries.operations
        self._again, self._opener = again, opener
        self.efforts: dict[str, float] = dict(meta.get("efforts", {}))
        self._ratios: dict[str, float] = {name: ratio for name, (_, ratio) in meta.get("motors", {}).items()}
        self.knots: dict[str, tuple[float, ...]] = {k: tuple(x) for k, x in meta["knots"].items()}
        self.parameters = Parameters(self.raw, again)
        arrays = Arrays(self.raw, self.coordinates, self.links)
        self.calls = Calls(self.raw, self.parameters, arrays, self.prescribed)
        self._binding = binding or ExtensionBinding()
        self._take_calls(self.calls)

    def __repr__(self) -> str:
        return f"<Kernel {self.name}: {len(self.coordinates)} coordinates, {self.dtype}>"

    def _repr_html_(self) -> str:
        """Return a small table, for notebooks."""
        rows = {
            "coordinates": len(self.coordinates),
            "links": len(self.links),
            "loops": len(self.loops),
            "springs between points": len(self.springs),
            "other force elements": len(dict.fromkeys(map(joint_of, self.element_rows))),
            "parameters": len(self.parameters),
            "functions": len(self.raw.libraries.meta["functions"]),
            "dtype": self.dtype,
            "threads": self.threads,
            "checks": self.checks,
        }
        return html_table(f"Kernel {self.name}", rows)

    def __copy__(self) -> Self:
        return self.replaced()

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self.replaced()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle what makes the same kernel again, and what may be set of it: no code, no pointers."""
        if self._again is None:
            raise InputError(
                f"{self.name}: a kernel that was put together by hand cannot be pickled; allowed: kernels of"
                " eomgen.build and of generated packages"
            )
        state = {"parameters": dict(self.parameters), "threads": self.threads, "checks": self.checks}
        return *self._again, state

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        changed = {name: value for name, value in state["parameters"].items() if self.parameters[name] != value}
        if changed:
            self.parameters.update(changed)
        self.threads, self.checks = state["threads"], state["checks"]

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return self.calls.n

    def replaced(
        self,
        *,
        parameters: Mapping[str, float] | None = None,
        threads: int | None = None,
        checks: bool | None = None,
        together: Iterable[str] = (),
    ) -> Self:
        """Return the same kernel with separate parameters, threads and checks: those of this one but for what is given.

        It costs microseconds; the code is shared, so that many threads may each work with other parameters.

        Args:
            parameters: values by name.
            threads, checks: as the attributes of these names.
            together: kernels, as in ``operations``, that one library of C has to hold, for programs that take its
                addresses; where all functions are in one library already, nothing is compiled.

        Raises:
            UnknownNameError, InputError: as for an assignment to ``parameters``, ``threads`` or ``checks``.
            BuildError: kernels do not compile.
        """
        names = names_in("together", together)
        libraries = self.raw.libraries.together(tuple(names)) if names else self.raw.libraries
        if libraries is self.raw.libraries:
            other = self._with_calls(self.calls.with_parameters(self.parameters.copy()))
        else:
            other = type(self)(libraries, self._again, self._binding, self._opener)
            other.__setstate__({"parameters": dict(self.parameters), "threads": self.threads, "checks": self.checks})
        if parameters is not None:
            other.parameters.update(parameters)
        if threads is not None:
            other.threads = threads
        if checks is not None:
            other.checks = checks
        return other

    def _with_calls(self, calls: Calls) -> Self:
        """Return the same code with other calls, and their parameters."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        other._take_calls(calls)
        return other

    def _take_calls(self, calls: Calls) -> None:
        """Let methods go through these calls, and through the extension module as soon as there is one."""
        self.calls, self.parameters = calls, calls.parameters
        self._bound = self._kind_of_bound(calls, self._bound.direct if "_bound" in self.__dict__ else None)
        self.functions = self._bound
        self._binding.take(self._bound)

    def internal_state_derivatives(self, q: ArrayLike, v: ArrayLike, z: ArrayLike, u: ArrayLike | None = None) -> Array:
        """Return the time derivatives of internal states, (m,), in their units per s.

        Args:
            q, v: coordinates and their rates, (n,).
            z: internal states, (m,).
            u: drives, (n,); zeros by default.
        """
        drives = np.zeros(self.n, self.dtype) if u is None else u
        whole = self.calls.run(self.forward_dynamics, None, (q, v, drives), z=z, whole=True)
        return np.ascontiguousarray(whole[..., self.n :])

    def constraint_forces(
        self,
        q: ArrayLike,
        v: ArrayLike,
        u: ArrayLike,
        *,
        wrench: WrenchLike | None = None,
        out: Array | None = None,
        z: ArrayLike | None = None,
    ) -> Array:
        """Return multipliers lambda of the constraint, (constraints,), N or N m: M a + h = u + J^T lambda.

        Behind them stand the forces of ``couplings``, which hold what is no coordinate (see ``coupling_forces``).
        They are the forces that the loops' cut joints exert on their second links.  Where constraints are redundant,
        those of them that rigid bodies do not determine have the least norm, weighted by the diagonal of J M^-1 J^T.

        Args:
            q, v, u: (n,), as in ``forward_dynamics``.
            wrench: as in ``generalized_force``.
            out: array to write to.
            z: internal states, (m,).

        Raises:
            SingularError, LoopError: as of ``forward_dynamics``.
            UnknownNameError: the robot has no loops or rigid couplings.
        """
        if not self.couplings:
            return self._bound[name_of(self.constraint_forces)](q, v, u, wrench=wrench, z=z, out=out)
        a = self.forward_dynamics(q, v, u, z, wrench=wrench)
        forces = self.functions.coupling_forces(q, v, a, wrench=wrench, z=z)
        if self.constraints:
            forces = np.concatenate(
                [self._bound[name_of(self.constraint_forces)](q, v, u, wrench=wrench, z=z), forces], axis=-1
            )
        return self.calls.arrays.written(forces, out)

    @property
    def threads(self) -> int:
        """Threads that share a batch, 1 at first; results do not depend on it.

        ``replaced`` copies the choice.

        Raises:
            InputError: on assignment of anything but a whole number from 1 on.
        """
        return self.calls.threads

    @threads.setter
    def threads(self, number: int) -> None:
        if isinstance(number, bool) or not isinstance(number, (int, np.integer)) or number < 1:
            raise InputError(f"threads: {show(number)} is not a number of threads; a whole number from 1 on is allowed")
        self.parameters.state.threads = min(int(number), sys.maxsize)

    @property
    def checks(self) -> bool:
        """True, as at first, if arrays and results with NaN or infinity are refused by the name of the coordinate.

        With False such numbers go through the C, and what depends on them is not finite, or of no use where a law
        compares them; a call costs less (``eomgen bench``).  Shapes and dtypes are checked all the same, integrators
        look for such numbers in any case, and one by which a mass matrix cannot be inverted is named.  ``replaced``
        copies the choice.

        Raises:
            InputError: on assignment of anything but True or False.
        """
        return self.calls.checks

    @checks.setter
    def checks(self, wanted: bool) -> None:
        if not isinstance(wanted, (bool, np.bool_)):
            raise InputError(f"checks: {show(wanted)} is neither True nor False")
        self.parameters.state.checks = bool(wanted)


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
