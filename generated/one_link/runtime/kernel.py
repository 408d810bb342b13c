"""The NumPy face of a compiled module.

A generated package carries a copy of this file, which imports NumPy and its neighbours and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, UnknownNameError
from ..names import html_table, nearest_or_all, show
from .arrays import Arrays, flag, joint_lead, names_in
from .by_name import Blocks, make_blocks
from .calls import Calls
from .closing import closed_positions, closed_rates
from .closing import roots as found_roots
from .derivatives import Differentiated, hessian, jvp, parameter_jacobian, vjp
from .direct import Face, functions
from .opened import LOADED
from .parameters import Parameters
from .raw import Libraries, Operations, RawKernel
from .stepping.adaptive import adaptive_rollout, takes_samples
from .stepping.given_loads import Loads
from .stepping.gradients import Loss, rollout_gradient
from .stepping.many_steps import rollout
from .stepping.rollouts import Rollout
from .stepping.saturation import Saturate, efforts_of
from .stepping.sensitivities import rollout_sensitivity

Array = NDArray[Any]


class Kernel:
    """Compiled equations of motion of one robot.

    Arrays are (n,) for one state, (N, n) for N states, or (..., n); the result gains the same leading axes.  Leading
    axes of several arrays go together as NumPy broadcasts, so that one state beside many stands for all of them.  SI
    units, radians; frames are the description's.  Coordinates are in the order of ``coordinates``.  Calls are
    re-entrant, release the GIL where they take long, and end soon after Ctrl-C.  Where the package has an extension
    module (see ``is_direct``), methods with plain arrays go to the C without Python in between.

    Kernels can be copied and pickled, with parameters of their own.  In another process the same package is loaded, or
    built where the cache there lacks it; a kernel of a generated package asks for that package by its name.

    Attributes:
        name: the robot's name.
        coordinates: n names such as "joint1.x".
        joints: names of the joints that move, in the order of ``reactions``.
        links: names of the links that move, in the order of ``wrench``.
        frames: names that ``frame_pose`` knows: frames, then links.
        loops: mapping from the names of the loops to the types of their cut joints.  Where there are loops, they are
            closed in ``forward_dynamics``, ``constraint_forces``, ``inverse_dynamics``, ``reactions``,
            ``loop_reactions``, ``forward_dynamics_jacobian`` and ``rollout``, of which some know the tree that is left
            when the loops are cut by ``cut=True``; all other methods are those of that tree.
        constraints: names of the constraint's components, such as "loop1.x".
        couplings: names of the rigid couplings whose followers are no coordinates, in the order of ``coupling_forces``;
            see ``followers``.
        follower_names: names of what these couplings move, each behind those that it follows itself.
        springs: names of the springs between two points, in the order of ``spring_forces``.
        cut_laws: names of the coordinates of cut joints that have a force ("pin4.x"), then of elastic couplings, in the
            order of ``cut_forces``.
        prescribed: names of the coordinates whose motion is given, in their order.
        efforts: mapping from coordinates to limits of their drives' forces, N or N m, as the description has them.
        motors: mapping from the names of motors' coordinates to those of the principal coordinates that they drive.
        parameters: mapping from name to value; an assignment takes effect without recompiling.
        elements: places among the parameters of the numbers of forces, by family ("coordinates", "springs", ...), by
            what has them ("joint1.x"), and by their names in its table ("stiffness").
        knots: deviations (m, rad) of measured curves by coordinate, elongations (m) by spring; the forces there are
            parameters.
        operations: per kernel the multiplications, additions, divisions and sine-cosine pairs of its C; of one that was
            not asked for yet they are counted when they are looked up.
        dtype: the dtype of all arrays.
        raw: the functions of C as they are, for programs that call them without checks.
        calls: checked calls of those functions by their names.

    Raises (all methods):
        ArrayError: an array of wrong shape, with numbers that the dtype cannot hold exactly, or with NaN or infinity
            (see ``checks``); or a result that is not finite.
    """

    def __init__(
        self,
        libraries: Libraries,
        again: tuple[Callable[..., Any], tuple[Any, ...]] | None = None,
        face: Face | None = None,
    ) -> None:
        """A kernel of compiled functions.

        Args:
            libraries: where the functions are.
            again: a function of a module and its arguments that make the same kernel in another process.
            face: gives the extension module that plain calls go through; without one all go through cffi.
        """
        meta = libraries.meta
        self.raw = RawKernel(libraries)
        self.name: str = self.raw.name
        self.dtype: np.dtype[Any] = self.raw.dtype
        self.coordinates: tuple[str, ...] = tuple(meta["coordinates"])
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
        self.cut_laws: tuple[str, ...] = tuple(meta.get("cut_laws", ()))
        self.elements: Mapping[str, Mapping[str, Mapping[str, int]]] = meta.get("elements", {})
        self.prescribed: tuple[str, ...] = tuple(meta["prescribed"])
        self.motors: dict[str, str] = {name: drives for name, (drives, _) in meta.get("motors", {}).items()}
        self.operations: Mapping[str, Mapping[str, int]] = Operations(libraries)
        self._again = again
        self._driven = tuple(meta["driven"])
        self.efforts: dict[str, float] = dict(meta.get("efforts", {}))
        self._given = [self.coordinates.index(name) for name in self.prescribed]
        self._ratios: dict[str, float] = {name: ratio for name, (_, ratio) in meta.get("motors", {}).items()}
        self.knots: dict[str, tuple[float, ...]] = {k: tuple(x) for k, x in meta["knots"].items()}
        self.parameters = Parameters.of(self.raw, meta["parameters"], meta["least"])
        self.calls = Calls(self.raw, self.parameters, Arrays(self.raw, self.coordinates, self.links), self.prescribed)
        self._face = face or Face()
        self._functions: tuple[ModuleType, tuple[Any, ...]] | None = None
        self._face.take(self)

    def __repr__(self) -> str:
        return f"<Kernel {self.name}: {len(self.coordinates)} coordinates, {self.dtype}>"

    def _repr_html_(self) -> str:
        """A small table, for notebooks."""
        rows = {
            "coordinates": len(self.coordinates),
            "links": len(self.links),
            "loops": len(self.loops),
            "springs between points": len(self.springs),
            "parameters": len(self.parameters),
            "functions": len(self.raw.libraries.meta["functions"]),
            "dtype": self.dtype,
            "threads": self.threads,
            "checks": self.checks,
        }
        return html_table(f"Kernel {self.name}", rows)

    def __copy__(self) -> Kernel:
        return self.with_parameters()

    def __deepcopy__(self, memo: dict[int, Any]) -> Kernel:
        return self.with_parameters()

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
        return len(self.coordinates)

    def source(self, ending: str) -> str:
        """The C that it was compiled from: "h", the header, or "c".

        Raises:
            BuildError: its package is not there any more.
        """
        return self.raw.source(ending)

    def ratio(self, motor: str) -> float:
        """Ratio of the gear behind a motor's coordinate ("joint1.motor") as the kernel has it now, 1 or rad/m.

        Raises:
            UnknownNameError: no motor of that name.
        """
        if not isinstance(motor, str) or motor not in self._ratios:
            raise UnknownNameError(f"motor: {show(motor)} is unknown; known: {', '.join(self._ratios)}")
        return float(self.parameters.get(f"joints.{motor}.ratio", self._ratios[motor]))

    def followers(self, q: ArrayLike, v: ArrayLike | None = None) -> dict[str, tuple[Array, Array]]:
        """Positions and velocities of what follows coordinates in rigid couplings, by name; m or rad, and per second.

        Args:
            q: (n,).
            v: (n,); zero if it is not given.

        Returns:
            Per follower a pair of numbers, or of arrays with the leading axes of q and v.
        """
        here, lead = self.calls.array("q", q, self.raw.shapes["q"])
        rates = np.zeros_like(here) if v is None else self.calls.array("v", v, self.raw.shapes["v"])[0]
        joint_lead("v", rates.shape[:-1], lead)
        matrix, offsets = self.follower_matrix()
        pairs = zip(self._followers, matrix.astype(self.dtype), offsets.astype(self.dtype), strict=True)
        return {name: (here @ row + offset, rates @ row + 0 * here[..., 0]) for name, row, offset in pairs}

    def follower_matrix(self) -> tuple[Array, Array]:
        """Matrix (followers, n) and offsets (followers,) that make positions of followers of q, with today's ratios.

        The rows are in the order of ``follower_names``, in the follower's unit per the coordinate's.
        """
        rows, offsets = dict[str, Array](), dict[str, float]()
        for name, coupling in self._followers.items():
            prefix, row = f"couplings.{coupling['coupling']}", np.zeros(self.n)
            offset = self.parameters.get(f"{prefix}.offset", coupling["offset"])
            for other, described in coupling["to"].items():
                ratio = self.parameters.get(f"{prefix}.ratio.{other}", described)
                if other in rows:
                    row, offset = row + ratio * rows[other], offset + ratio * offsets[other]
                else:
                    row[self.coordinates.index(other)] += ratio
            rows[name], offsets[name] = row, offset
        return np.array([*rows.values()]).reshape(-1, self.n), np.array([*offsets.values()])

    def with_parameters(self, values: Mapping[str, float] | None = None) -> Kernel:
        """The same compiled code with parameters of its own: those of this kernel now, and ``values`` by name.

        It costs microseconds; the code is shared, so that many threads may each work with other parameters.

        Raises:
            UnknownNameError, InputError: as for an assignment to ``parameters``.
        """
        other = self._with_methods_in_python()
        other.parameters = self.parameters.copy()
        other.calls = self.calls.with_parameters(other.parameters)
        self._face.take(other)
        if values is not None:
            other.parameters.update(values)
        return other

    def with_turned(self, joints: Collection[str]) -> Kernel:
        """The same compiled code with parameters of its own, and other coordinates of joints that turn freely.

        The axes y, z and x of the joint's frame stand in the place of x, y and z, so that its angles are not singular
        where those of the description are.  That is so for forward_dynamics, forward_dynamics_jacobian,
        inverse_dynamics, mass_matrix, residual_jacobian and external_force; with loops not for inverse_dynamics, but
        for residual, the constraint, its Jacobian and bias, constrained_dynamics, settling and following.  All else
        stays as it is described.  It is for integrations, which choose by ``raw.turning``; ``rollout`` does it by
        itself.

        Args:
            joints: names of those that are turned; the others are as described.

        Raises:
            UnknownNameError: a joint that does not turn freely.
        """
        joints = names_in("joints", joints)
        for name in joints:
            if name not in self.raw.turning:
                raise UnknownNameError(f"joints: {name!r} does not turn freely; known: {', '.join(self.raw.turning)}")
        other = self.with_parameters()
        other.parameters.turn(joints)
        return other

    def _with_methods_in_python(self) -> Kernel:
        """This kernel once more, not bound to an extension module."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__.get("_plain", self).__dict__)  # a third of the time of copy.copy
        return other

    def bind(self, module: ModuleType) -> None:
        """Let plain calls of methods go through an extension module.

        Attributes of the kernel then stand before the methods of its class, which they call where a call is not plain;
        they do so for a second kernel that has none of them, so that no kernel is part of a circle of references.
        """
        if self._functions is None or self._functions[0] is not module:
            methods = {
                name: method
                for name, method in vars(Kernel).items()
                if isinstance(method, FunctionType) and getattr(type(self), name) is method  # not one of a subclass
            }
            found = functions(module, self.raw, methods, self.frames, bool(self.constraints), self._given)
            self._functions = (module, found)
        plain = self._with_methods_in_python()
        state = self.parameters.state
        if not isinstance(state, module.State):
            state = self.parameters.state = state.moved_to(module.State)
        module.bind(self._functions[1], plain, state, self.__dict__)
        self.__dict__["_plain"] = plain

    @property
    def is_direct(self) -> bool:
        """True if an extension module takes plain calls: arrays of the kernel's dtype and of exactly its shapes.

        They go to the C without Python in between.  All others, and all errors, are those of the methods in Python, so
        that nothing but their time depends on it.  It is False where Python's or NumPy's headers were missing.
        """
        return "_plain" in self.__dict__

    def together(self, *kernels: str) -> Kernel:
        """The same with these kernels in one library of C, and with parameters of its own.

        For programs that take the C and its addresses; where all functions are in one library already, nothing is
        compiled.

        Args:
            kernels: names as in ``operations``.

        Raises:
            BuildError: they do not compile.
        """
        libraries = self.raw.libraries.together(kernels)
        if libraries is self.raw.libraries:
            return self.with_parameters()
        other = type(self)(libraries, self._again, self._face)
        other.__setstate__({"parameters": dict(self.parameters), "threads": self.threads, "checks": self.checks})
        return other

    def with_threads(self, number: int) -> Kernel:
        """The same compiled code with parameters of its own, whose batches so many threads share (see ``threads``).

        Raises:
            InputError: not a whole number from 1 on.
        """
        other = self.with_parameters()
        other.threads = number
        return other

    def with_checks(self, wanted: bool) -> Kernel:
        """The same compiled code with parameters of its own, which refuses NaN and infinity or not (see ``checks``).

        Raises:
            InputError: neither True nor False.
        """
        other = self.with_parameters()
        other.checks = wanted
        return other

    @property
    def threads(self) -> int:
        """Threads that share a batch, 1 at first; results do not depend on it.

        ``with_parameters``, ``with_threads`` and ``with_checks`` copy the choice.

        Raises:
            InputError: on assignment of anything but a whole number from 1 on.
        """
        return self.calls.threads

    @threads.setter
    def threads(self, number: int) -> None:
        if isinstance(number, bool) or not isinstance(number, (int, np.integer)) or number < 1:
            raise InputError(f"threads: {show(number)} is not a number of threads; a whole number from 1 on is allowed")
        self.calls.threads = int(number)

    @property
    def checks(self) -> bool:
        """True if arrays with NaN or infinity are refused by the name of the coordinate, which is so at first.

        That holds for results, too, where finite numbers lead beyond what the dtype holds.  With False such numbers
        go through the C, and what depends on them is not finite, or of no use where a law compares them; a call costs
        less (``eomgen bench`` says how much).  Shapes and dtypes are checked all the same,
        integrators look for such numbers in any case, and where a mass matrix cannot be inverted because of one, it is
        still named.  ``with_parameters``, ``with_threads`` and ``with_checks`` copy the choice.

        Raises:
            InputError: on assignment of anything but True or False.
        """
        return self.calls.checks

    @checks.setter
    def checks(self, wanted: bool) -> None:
        if not isinstance(wanted, (bool, np.bool_)):
            raise InputError(f"checks: {show(wanted)} is neither True nor False")
        self.calls.checks = bool(wanted)

    def mass_matrix(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """M(q), (n, n), symmetric; eq. (11).  Entry units: kg, kg m or kg m^2 by the kinds of its coordinates."""
        return self.calls.run("mass_matrix", out, (q,))

    def bias_force(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Coriolis and centrifugal terms, (n,), N or N m: sum_vw C^svw v w of eq. (12)."""
        return self.calls.run("bias_force", out, (q, v))

    def generalized_force(
        self, q: ArrayLike, v: ArrayLike, *, wrench: ArrayLike | None = None, out: Array | None = None
    ) -> Array:
        """Q_P + Q_G, eqs. (13) and (14), (n,), N or N m; with Q_F where wrenches are given.

        Args:
            q, v: coordinates and their rates, (n,).
            wrench: (links, 6), per link force (N) then moment (N m) about its centre of mass, base axes.
            out: array to write to.
        """
        return self.calls.run_with_wrench("generalized_force", out, (q, v), wrench)

    def residual(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        u: ArrayLike,
        *,
        wrench: ArrayLike | None = None,
        out: Array | None = None,
    ) -> Array:
        """M a + bias - generalized_force - u, (n,), N or N m; zero on a motion."""
        return self.calls.run_with_wrench("residual", out, (q, v, a, u), wrench)

    def inverse_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        *,
        wrench: ArrayLike | None = None,
        out: Array | None = None,
        cut: bool = False,
    ) -> Array:
        """The drives u, (n,), N or N m, that make a motion: the residual is zero, or what the loops' forces make of it.

        Of a robot with loops: M a + h = u + J^T lambda with u at the coordinates that have a drive alone, prescribed
        ones among them, and 0 elsewhere; of several possible drives the least by the sum of their squares.

        Args:
            q, v, a: (n,), a motion that keeps the loops closed.
            wrench: (links, 6) as in ``generalized_force``.
            out: array to write to.
            cut: of a robot with loops, that its loops are open: of the tree alone, at every coordinate.

        Raises:
            LoopError: a loop is open, opening, or opens at the accelerations, by more than 1e-9 (float32: 1e-5) m or
                rad (per second and the largest rate; per second squared and the largest acceleration); or these drives
                cannot make the motion.
        """
        return self._driving("inverse_dynamics", out, (q, v, a), wrench, cut=cut)

    def forward_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        u: ArrayLike,
        *,
        wrench: ArrayLike | None = None,
        out: Array | None = None,
        cut: bool = False,
    ) -> Array:
        """Accelerations, (n,), m/s^2 or rad/s^2, under the drives u.

        In ``u`` a prescribed coordinate has its acceleration, m/s^2 or rad/s^2, which the result repeats; the force
        that this takes is ``inverse_dynamics`` at the result.  Loops are closed.

        Args:
            q, v, u: (n,).
            wrench: (links, 6) as in ``generalized_force``.
            out: array to write to.
            cut: of a robot with loops, that its loops are open: of the tree alone.

        Raises:
            SingularError: M cannot be inverted in this state.
            LoopError: a loop is open, or opening, by more than 1e-9 (float32: 1e-5) m or rad (per second and the
                largest rate).
        """
        if wrench is not None:
            u = self._with_wrench(q, u, wrench)
        name = "forward_dynamics"
        return self.calls.run(self.calls.of_tree(name) if flag("cut", cut) else name, out, (q, v, u))

    def constraint_forces(
        self, q: ArrayLike, v: ArrayLike, u: ArrayLike, *, wrench: ArrayLike | None = None, out: Array | None = None
    ) -> Array:
        """Multipliers lambda of the constraint, (constraints,), N or N m: M a + h = u + J^T lambda.

        Behind them stand the forces of ``couplings``, which hold what is no coordinate (see ``coupling_forces``).
        They are the forces that the loops' cut joints exert on their second links.  Where constraints are redundant,
        those of them that rigid bodies do not determine have the least norm, weighted by the diagonal of J M^-1 J^T.

        Args:
            q, v, u: (n,), as in ``forward_dynamics``.
            wrench: (links, 6) as in ``generalized_force``.
            out: array to write to.

        Raises:
            SingularError, LoopError: as of ``forward_dynamics``.
            UnknownNameError: the robot has no loops or rigid couplings.
        """
        under = u if wrench is None else self._with_wrench(q, u, wrench)
        if not self.couplings:
            return self.calls.run("constraint_forces", out, (q, v, under))
        a = self.forward_dynamics(q, v, under)
        found = self.coupling_forces(q, v, a, wrench=wrench)
        if self.constraints:
            found = np.concatenate([self.calls.run("constraint_forces", None, (q, v, under)), found], axis=-1)
        if out is not None:
            out = self.calls.arrays.checked_out(out, found.shape, ())
            out[...] = found
        return found if out is None else out

    def coupling_forces(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, wrench: ArrayLike | None = None, out: Array | None = None
    ) -> Array:
        """Forces on the followers of ``couplings`` that a motion takes, (couplings,), N or N m.

        A coupling exerts it on its follower, and -ratio times as much on what that follows.

        Args:
            q, v, a: (n,).
            wrench: (links, 6) as in ``generalized_force``.
            out: array to write to.

        Raises:
            UnknownNameError: no rigid coupling makes followers of coordinates.
        """
        return self.calls.run_with_wrench("coupling_forces", out, (q, v, a), wrench)

    def _with_wrench(self, q: ArrayLike, u: ArrayLike, wrench: ArrayLike) -> Array:
        """Drives with the generalized forces of wrenches; of a prescribed coordinate its acceleration."""
        drives, lead = self.calls.array("u", u, self.raw.shapes["u"])
        external = self.external_force(q, wrench)
        joint_lead("u", lead, external.shape[:-1])
        external[..., self._given] = 0  # where u is an acceleration
        found: Array = drives + external
        return found

    def residual_jacobian(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, u: ArrayLike | None = None, *, out: Array | None = None
    ) -> tuple[Array, Array, Array]:
        """Exact derivatives of the residual, three (n, n): dr/dq, dr/dv and dr/da (the mass matrix).

        Row i belongs to the residual's coordinate i, column j to the coordinate that changes.  Without external
        wrenches.  The residual is linear in the drives with -1, so that ``u`` changes nothing; it may be left out.

        Args:
            q, v, a, u: (n,).
            out: array (3, n, n) to write to; the result are views of it.
        """
        lead = () if u is None else self.calls.array("u", u, self.raw.shapes["u"])[1]
        return _three(self.calls.run("residual_jacobian", out, (q, v, a), lead=lead))

    def forward_dynamics_jacobian(
        self, q: ArrayLike, v: ArrayLike, u: ArrayLike, *, out: Array | None = None, cut: bool = False
    ) -> tuple[Array, Array, Array]:
        """Exact derivatives of the accelerations, three (n, n): da/dq, da/dv and da/du (the inverse mass matrix).

        The acceleration of a prescribed coordinate stands in ``u`` and depends on nothing else.
        Without external wrenches; where some are constant generalized forces, add them to ``u``.
        With loops closed, da/du is what of the inverse mass matrix keeps them closed, and da/dq and da/dv are of the
        smooth extension M a + h = u + J^T lambda, J a + J_dot v = 0, beyond the closed states too.  Where constraints
        are redundant, they are sure along directions that keep the loops closed alone.

        Args:
            q, v, u: (n,).
            out: array (3, n, n) to write to; the result are views of it.
            cut: of a robot with loops, that its loops are open: of the tree alone.

        Raises:
            SingularError, LoopError: as of ``forward_dynamics``.
        """
        name = "forward_dynamics_jacobian"
        return _three(self.calls.run(self.calls.of_tree(name) if flag("cut", cut) else name, out, (q, v, u)))

    def euler_cosines(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Cosine of beta of each joint with three angles, (joints,); 1 for other joints.

        At 0 the Euler angles are singular (beta = +-pi/2) and forward dynamics has no solution; near it,
        accelerations of alpha and gamma lose as many digits as the cosine has zeros.
        """
        return self.calls.run("euler_cosines", out, (q,))

    def external_force(self, q: ArrayLike, wrench: ArrayLike, *, out: Array | None = None) -> Array:
        """Q_F of eq. (14), its moment term corrected, (n,), N or N m, of wrenches (links, 6) in base axes."""
        return self.calls.run("external_force", out, (q, wrench))

    def coriolis_matrix(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """C(q, v), (n, n), the Christoffel one: C v = bias, M_dot = C + C^T."""
        return self.calls.run("coriolis_matrix", out, (q, v))

    def christoffel(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Christoffel symbols of the first kind, (n, n, n): C^svw of eq. (12), symmetric in the last two indices."""
        return self.calls.run("christoffel", out, (q,))

    def blocks(self, q: ArrayLike) -> Blocks:
        """M and C of eqs. (10)-(12) by names, for one state or a batch; needs mass_matrix and christoffel.

        ``blocks.mass["joint1", "joint2"]`` is a joint's block, ``blocks.christoffel["joint1.x", "joint2.gamma",
        "joint2.gamma"]`` an entry; blocks that vanish identically are absent.  ``blocks.row`` and ``blocks.matrix``
        are the paper's M_i^sv and C_i^svw over all joints.
        """
        mass, christoffel = self.mass_matrix(q), self.christoffel(q)
        survivors = self.raw.libraries.about("christoffel")["survivors"]
        return make_blocks(mass, christoffel, survivors, self.coordinates)

    def frame_pose(self, q: ArrayLike, frame: str, *, out: Array | None = None) -> Array:
        """A_0k of a frame or link in the base, (4, 4), m; eqs. (1) and (2).

        Raises:
            UnknownNameError: no frame or link of that name.
        """
        return self.calls.run("frame_pose", out, (q,), (self.frame_index(frame),))

    def frame_jacobian(self, q: ArrayLike, frame: str, *, out: Array | None = None) -> Array:
        """Velocity of a frame's origin and angular velocity per coordinate rate, (6, n): linear, angular, base axes.

        Raises:
            UnknownNameError: no frame or link of that name.
        """
        return self.calls.run("frame_jacobian", out, (q,), (self.frame_index(frame),))

    def energy(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """(kinetic, potential) energy, (2,), J: eq. (4); gravity (zero at the base's origin) and springs."""
        return self.calls.run("energy", out, (q, v))

    def reactions(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        *,
        wrench: ArrayLike | None = None,
        out: Array | None = None,
        cut: bool = False,
    ) -> Array:
        """Wrench that each joint exerts on its child link, (joints, 6): force (N), moment (N m) at the joint.

        In the axes of the joint's frame after its motion (z is the principal axis), at that frame's origin.  The
        joint's own springs, dampers and drives are part of it.  Springs between points act on the links, so that what
        they carry passes the joints by.  The cut joints of loops act on them, too, by the forces of
        ``loop_reactions``.

        Args:
            q, v, a: (n,).
            wrench: external wrenches, (links, 6), as in ``generalized_force``.
            out: array to write to.
            cut: of a robot with loops, that its loops are open: no force passes through them.

        Raises:
            LoopError: as of ``inverse_dynamics``.
        """
        return self._driving("reactions", out, (q, v, a), wrench, cut=cut)

    def regressor(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, out: Array | None = None) -> Array:
        """Y(q, v, a), (n, parameters): inverse dynamics without springs and dampers is Y theta, N or N m.

        The columns have the names ``regressor_names``: ten of each link that moves against its parent, with all that is
        fixed to it, then one of every armature.  Of a link they are m (kg), m c by x, y and z (kg m) and the inertia
        xx, xy, xz, yy, yz, zz (kg m^2) about the origin and along the axes of its own frame, not about its centre of
        mass: "link1.m", "link1.mx", "link1.ixx"; products of inertia as in the description, minus the integral of x y.
        Columns of links that do not hang on a coordinate are zero in its row.  Of a robot with loops: of its open tree.

        Args:
            q, v, a: (n,).
            out: array to write to.
        """
        return self.calls.run("regressor", out, (q, v, a))

    @property
    def regressor_names(self) -> tuple[str, ...]:
        """Names of the inertial parameters theta, the columns of ``regressor``.

        "link1.m" ... "link1.izz" of each link, "joint1.gamma.armature" and "joint1.motor.inertia" of coordinates.

        Raises:
            UnknownNameError: the kernel was built without the regressor.
        """
        if "regressor" not in self.raw.functions:
            raise self.raw.missing("regressor")
        return tuple(self.raw.libraries.meta["regressor"])

    @property
    def regressor_values(self) -> Array:
        """Inertial parameters theta of the description, (parameters,), kg, kg m, kg m^2; armatures as they are now.

        ``regressor(q, v, a) @ regressor_values`` is inverse dynamics without springs and dampers, loops cut.

        Raises:
            UnknownNameError: the kernel was built without the regressor.
            InputError: a run-time parameter of links was changed since.
        """
        names, meta = self.regressor_names, self.raw.libraries.meta
        found = self.raw.libraries.about("regressor")["inertial"]
        for name in found["come_from"]:
            if self.parameters[name] != meta["parameters"][name]:
                raise InputError(
                    f"regressor_values: {name} is {self.parameters[name]!r} now; allowed: the description's"
                    f" {meta['parameters'][name]!r}"
                )
        own = zip(names, found["values"], strict=True)
        return np.array([self.parameters.get(f"joints.{name}", value) for name, value in own], self.dtype)

    def loop_reactions(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, wrench: ArrayLike | None = None, out: Array | None = None
    ) -> Array:
        """Wrench that each loop's cut joint exerts on its second link, (loops, 6): force (N), moment (N m).

        At the origin and in the axes of the cut frame on that link; the first link feels the opposite.  Components
        that the joint leaves free are zero, elastic ones what their laws say.  Where constraints are redundant, those
        of them that rigid bodies do not determine have about the least norm.

        Args:
            q, v, a: (n,), a motion that keeps the loops closed, made by drives at the coordinates that have one.
            wrench: (links, 6) as in ``generalized_force``.
            out: array to write to.

        Raises:
            LoopError: as of ``inverse_dynamics``.
            UnknownNameError: the robot has no loops.
        """
        if wrench is None or not self.constraints:
            return self.calls.run("loop_reactions", out, (q, v, a))
        return self.calls.run("loop_reactions_under_load", out, (q, v, a, self.external_force(q, wrench)))

    def _driving(
        self,
        name: str,
        out: Array | None,
        values: tuple[ArrayLike, ...],
        wrench: ArrayLike | None,
        *,
        cut: bool,
    ) -> Array:
        """Compute what a motion takes, with its loops closed or cut; see ``Calls.run_with_wrench``."""
        if flag("cut", cut) or not self.constraints:
            return self.calls.run_with_wrench(self.calls.of_tree(name), out, values, wrench)
        if wrench is None:
            return self.calls.run(name, out, values)
        under = (*values, self.external_force(values[0], wrench))
        if name != "reactions":
            return self.calls.run(f"{name}{LOADED}", out, under)
        return self.calls.run_with_wrench(f"{name}{LOADED}", out, under, wrench)

    def jvp(
        self,
        name: str,
        args: Sequence[Any],
        tangents: Sequence[ArrayLike],
        *,
        parameters: Mapping[str, float] | None = None,
    ) -> Array:
        """Give what a method's result changes by along rates of its arguments: its Jacobian times them, exact.

        Args:
            name: the method, such as "inverse_dynamics", "reactions", "energy", "frame_pose".
            args: its arguments in their order, such as (q, v, a) or (q, "tool"); without ``wrench``.
            tangents: a rate for each array among them, of its shape.
            parameters: rates of run-time parameters by their names.

        Returns:
            Of the result's shape.

        Raises:
            UnknownNameError: no such method, parameter or frame, or the kernel was built without its derivatives.
            InputError: another number of arguments or rates.
            SingularError: of "forward_dynamics" and what is like it, where there are no accelerations.
        """
        return jvp(self._differentiated(name), args, tangents, parameters)

    def vjp(
        self, name: str, args: Sequence[Any], cotangent: ArrayLike, parameters: Sequence[str] = ()
    ) -> tuple[Array, ...]:
        """The gradient of the sum of a method's weighted results: weights times its Jacobian, exact.

        It comes from one reverse sweep, which takes about as long as two or three calls of the method whatever the
        number of coordinates is.

        Args:
            name, args: as of ``jvp``.
            cotangent: the weights, of the result's shape.
            parameters: names of run-time parameters that the gradient is taken by as well.

        Returns:
            An array of each array among the arguments, of its shape; where there are names of parameters, one more,
            (parameters,).

        Raises:
            UnknownNameError, InputError, SingularError: as of ``jvp``.
        """
        return vjp(self._differentiated(name), args, cotangent, parameters)

    def hessian(self, name: str, args: Sequence[Any], cotangent: ArrayLike) -> Array:
        """Second derivatives of the sum of a method's weighted results by its arguments, exact and symmetric.

        Args:
            name, args: as of ``jvp``.
            cotangent: the weights, of the result's shape.

        Returns:
            A matrix whose rows and columns are the numbers of all arguments one behind the other: (3 n, 3 n) of
            "inverse_dynamics" and "forward_dynamics".

        Raises:
            UnknownNameError, InputError, SingularError: as of ``jvp``.
        """
        return hessian(self._differentiated(name), args, cotangent)

    def parameter_jacobian(self, name: str, args: Sequence[Any], parameters: Sequence[str] | None = None) -> Array:
        """Derivatives of a method's results by run-time parameters, exact.

        Args:
            name, args: as of ``jvp``.
            parameters: names of the parameters; all if None.

        Returns:
            Of the result's shape with one more axis, (..., parameters).

        Raises:
            UnknownNameError, InputError, SingularError: as of ``jvp``.
        """
        return parameter_jacobian(self._differentiated(name), args, parameters)

    def _differentiated(self, name: str) -> Differentiated:
        return Differentiated.of(self.calls, name, self.frame_index)

    def constraint(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """g(q), (constraints,): zero where the loops are closed.

        Of frame b on a loop's second link, seen from frame a on its first: x, y, z (m) of its origin, and sines of its
        turns alpha, beta, gamma about x, y, z, as far as the cut joint blocks them (``eomgen.robot.cuts``).
        """
        return self.calls.run("constraint", out, (q,))

    def constraint_jacobian(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """J = dg/dq, (constraints, n), exact; J v is the rate of g."""
        return self.calls.run("constraint_jacobian", out, (q,))

    def constraint_bias(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """J_dot v, (constraints,): the second derivative of g is J a + J_dot v."""
        return self.calls.run("constraint_bias", out, (q, v))

    def cut_poses(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Pose of frame b seen from frame a of each loop, (loops, 4, 4), m: the motion of the cut joint."""
        return self.calls.run("cut_poses", out, (q,))

    def cut_coordinates(self, q: ArrayLike) -> Array:
        """Coordinates of the loops' cut joints, (loops, 6): x, y, z (m), alpha, beta, gamma (rad) as of other joints.

        They are those of frame b on a loop's second link, seen from frame a on its first, where the angles turn about
        x, then y, then z; zero in what the joint blocks, where the loops are closed.
        """
        poses = self.cut_poses(q)
        R = poses[..., :3, :3]
        angles = (
            np.arctan2(-R[..., 1, 2], R[..., 2, 2]),
            np.arctan2(R[..., 0, 2], np.hypot(R[..., 0, 0], R[..., 0, 1])),
            np.arctan2(-R[..., 0, 1], R[..., 0, 0]),
        )
        return np.concatenate([poses[..., :3, 3], np.stack(angles, axis=-1)], axis=-1)

    def close(self, q: ArrayLike, held: Iterable[str] = (), *, roots: int | None = None) -> Array:
        """Coordinates near a guess that close all loops, (n,); Levenberg and Marquardt's method.

        Args:
            q: the guess, (n,), or many of them.
            held: names of coordinates that stay at their guess; prescribed ones do.
            roots: find so many ways to close the loops, or as many as there are, from random guesses about this one
                (always the same): (roots, n), the nearest first, angles within half a turn of the guess.  Where fewer
                coordinates are held than the mechanism has freedoms, they are any of infinitely many.

        Raises:
            LoopError: they do not close near the guess, or only turned over; names the loop and its remaining gap.
            UnknownNameError: a held coordinate is none.
            InputError: the robot has no loops, or roots of many states are asked for.
        """
        if roots is not None:
            return found_roots(self.calls, q, held, roots)
        return closed_positions(self.calls, q, held)

    def close_rates(self, q: ArrayLike, v: ArrayLike, held: Iterable[str] = ()) -> Array:
        """Rates that keep the loops closed, (n,), those with the least kinetic energy of the difference to a guess.

        That is what a sudden closing of the loops makes of the guess, too.

        Args:
            q: coordinates that close the loops, (n,).
            v: the guess, (n,).
            held: names of coordinates whose rates stay; those of prescribed ones do.

        Raises:
            LoopError: the loops are open at q, or the rates that are held open one; names it and what remains.
            SingularError: M is not positive definite, or angles at +-pi/2 have no such rates.
            UnknownNameError, InputError: as of ``close``.
        """
        return closed_rates(self.calls, q, v, held)

    def spring_forces(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Length (m) and tension (N) of every spring between two points, (springs, 2), in the order of ``springs``.

        Tension is positive where the spring pulls its points together; dampers are part of it.
        """
        return self.calls.run("spring_forces", out, (q, v))

    def spring_jacobian(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Derivatives of the springs' lengths by q, (springs, n), m or m/rad: the tensions' moment arms.

        The springs' generalized force is minus its transpose times the tensions.
        """
        return self.calls.run("spring_jacobian", out, (q,))

    def cut_forces(self, q: ArrayLike, v: ArrayLike, *, out: Array | None = None) -> Array:
        """Deviation (m, rad) and resisting force (N, N m) of everything in ``cut_laws``, (cut_laws, 2).

        The deviation is that of the cut joint's coordinate (of the frame on its second link as seen from the first)
        from its offset, or of a coupled coordinate from what it is coupled to; dampers and friction are in the force.
        """
        return self.calls.run("cut_forces", out, (q, v))

    def cut_jacobian(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Derivatives of the deviations in ``cut_forces`` by q, (cut_laws, n), in their units per m or rad.

        The generalized force is minus its transpose times the resisting forces.
        """
        return self.calls.run("cut_jacobian", out, (q,))

    def spring_stiffness(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Upper bound of the springs' stiffness in the coordinates, (n, n), N/m, N or N m/rad; at least semidefinite.

        The sum of k D^T D, D the derivative by q of the vector between a spring's points, seen from the last link that
        moves both, k its stiffness in all directions: of a curve that of its steepest piece, of a cable as if taut.
        """
        return self.calls.run("spring_stiffness", out, (q,))

    def rollout(
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
        duration: float | None = None,
        samples: int | None = None,
        rtol: float = 1e-6,
        atol: ArrayLike | None = None,
        loads: Loads | Sequence[Loads] | None = None,
        works: bool = False,
        saturate: Saturate = None,
    ) -> Rollout:
        """Integrate in C, one state or many at a time; external wrenches are some of the ``loads``.

        Loops are closed after every step, to the nearest state in the metric of the kinetic energy that is closed to
        1e-10 m or rad; where they are open at the beginning, the first step closes them.

        Two methods take ``steps`` of length ``dt``.  "rk4" is the classical Runge-Kutta method: fourth order, stable
        while dt is below about 2.8 over the fastest eigenfrequency.  "implicit" takes springs, dampers and the
        controller at the end of a step: first order, and stable whatever their stiffness; theory section "Stiff joints
        without small steps".  Springs between points are taken so along their lines, and across them as they are at a
        step's beginning.

        Two methods choose their steps so that the error of each stays within tolerances, and give ``samples`` at equal
        times of a ``duration``; each of many states has steps of its own, and the same bits as alone.  "tsit5" is
        explicit, of fifth order.  "rosenbrock" is linearly implicit, of fourth order, and stable whatever springs and
        dampers there are; steps end at samples.  Theory section "Steps that the error chooses".

        Joints that turn freely (``raw.turning``) pass beta = +-pi/2 in other angles; what comes back is as described,
        each angle next to its value before.  A joint with gains on its coordinates stays in its own angles.

        Args:
            q0, v0: states, (n,) or (N, n).
            u: drives, N or N m (of prescribed coordinates accelerations, as in ``forward_dynamics``), held over a
                step, or from a sample to the next: (n,); for one state (steps, n); for many (N, n), (N, steps, n) or
                (1, steps, n).  None if not given.
            dt: length of a step, s.
            steps: their number.
            method: "rk4", "implicit", "rosenbrock" or "tsit5".
            every: one of so many steps is stored.
            kp, kd: gains of a joint controller that adds kp (target - q) - kd v: a number for all principal
                coordinates (for the motor where one has a motor), or (n,) with 0 at deviations, at principal
                coordinates behind a motor, and at what is prescribed.
            target: coordinates that the controller aims at, shapes as for ``u``.
            duration: of a motion with error control, s.
            samples: of it, beside the beginning; 1 if not given.
            rtol, atol: tolerances: the error of a step is at most atol + rtol times the size of each number.  atol is a
                number or (2n,), first of q, then of v; by default rtol times the size of each coordinate: 1, or what
                10 m/s^2 make of its springs where that is less.
            loads: with error control, what else acts, over time, for all states or a list with that of each: LoadData
                of ``eomgen.runtime.stepping.loads``, or a mapping from "drive", "wrench" and "prescribed" to what
                ``integrate`` takes by these names, where that is data, or has some (``load_data``).  Prescribed
                coordinates begin where their motions do.  No joint may turn freely.
            works: whether works are integrated, too: attribute ``works``.  Needs generalized_force, and, of prescribed
                coordinates, inverse_dynamics (with loops residual); not where joints turn freely.
            saturate: True: all that drives do at a coordinate (u, controller, drives of loads) is clipped at +- the
                effort of its description (``efforts``); or efforts by coordinate, or (n,), infinite where there is
                none.  What is clipped does not answer to the state in the matrix of an implicit step.

        Returns:
            q and v, (steps // every + 1, n) or (N, steps // every + 1, n), the states at the beginning first; with
            error control (samples + 1, n) or (N, samples + 1, n).  Attributes of the tuple say what the steps were:
            ``steps``, ``rejected``, ``largest`` and ``smallest`` (s), of many states (N,).  ``works``, J, (samples + 1,
            4) or (N, samples + 1, 4), are those of drives, of what moves prescribed coordinates, of wrenches, and what
            dampers and friction take.

        Raises:
            SingularError: M cannot be inverted in a state that is reached.
            IntegrationStopped: a state is not finite any more, or its accelerations, whatever ``checks`` says, or no
                step is short enough for the tolerances; it names the coordinate and the step or time, and keeps what
                was stored.
            InputError: another argument is wrong, or does not belong to the method.
        """
        controlled: dict[str, Any] = {"kp": kp, "kd": kd, "target": target, "effort": efforts_of(self.calls, saturate)}
        own: dict[str, Any] = {"loads": loads, "works": flag("rollout: works", works)}
        sampled: dict[str, Any] = {"duration": duration, "samples": samples, "atol": atol}
        if takes_samples(method, dt=dt, steps=steps, every=every, **sampled, **own):
            how: dict[str, Any] = {"method": method, "rtol": rtol, "atol": atol, **own}
            return adaptive_rollout(self.calls, self._driven, q0, v0, u, duration, samples, **how, **controlled)
        u = np.zeros(self.n, self.dtype) if u is None else u
        return rollout(self.calls, self._driven, q0, v0, u, dt, steps, method=method, every=every, **controlled)

    def rollout_gradient(
        self,
        q0: ArrayLike,
        v0: ArrayLike,
        u: ArrayLike | None = None,
        dt: float | None = None,
        steps: int | None = None,
        *,
        loss: Loss,
        parameters: Sequence[str] = (),
        method: str = "rk4",
        every: int = 1,
        kp: ArrayLike | None = None,
        kd: ArrayLike | None = None,
        target: ArrayLike | None = None,
        duration: float | None = None,
        samples: int | None = None,
        rtol: float = 1e-6,
        atol: ArrayLike | None = None,
        loads: Loads | Sequence[Loads] | None = None,
        saturate: Saturate = None,
        out: Mapping[str, Array] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """The gradient of a function of a rollout's states, exact for its steps: they are taken once more, backwards.

        Steps that the error chooses count as given: how their lengths change is left out.  Contacts, friction and stops
        are as smooth as their laws are.  Loops are closed after every step, and differentiated with that.  What is kept
        on the way grows with the square root of the number of steps where they are many.

        Args:
            q0, v0, u, dt, steps, method, every, kp, kd, target, duration, samples, rtol, atol: as of ``rollout``.
            loss: ``loss(t, q, v)`` returns a value and its derivatives by q and v, of their shapes; t are times, s,
                (samples,), q and v states as of ``rollout``.
            parameters: names of run-time parameters that the gradient is taken by as well.
            loads: as of ``rollout``, but with all methods; an implicit step takes them at its end.  Wrenches need the
                kernel external_force_parameter_adjoint, in points and axes of links frame_pose_parameter_adjoint; a
                model that drives know needs inverse_dynamics_adjoint, and has no loops.
            saturate: as of ``rollout``; drives that are clipped have the slope 0, those at their effort 1.
            out: arrays to write derivatives to, by the names that they are returned by; others are new.

        Returns:
            The value, and derivatives by name: "q" and "v" by the states at the beginning, "u", and with a controller
            "target", "kp" and "kd", in the shapes of what was given (gains: (n,)); a number for each parameter.  With
            ``loads`` "loads": a dictionary, or one for each of a list, with "drive.torque", "drive.program",
            "prescribed.tracks[k]" and "wrench[k]", derivatives by the coefficients of signals (``Signal.by_samples``
            gives those by samples), "drive.gains.kp", "drive.gains.kd" and "drive.model.bandwidth".

        Raises:
            UnknownNameError: no such parameter, or the kernel was built without the method's gradient.
            InputError: as of ``rollout``; a loss that returns something else; joints that turn freely; a robot so stiff
                that derivatives of tsit5's steps are not those of the motion.
            SingularError, IntegrationStopped: as of ``rollout``; a mechanism begins in a singular pose.
        """
        u = np.zeros(self.n, self.dtype) if u is None else u
        return rollout_gradient(
            self.calls,
            self._driven,
            q0,
            v0,
            u,
            dt,
            steps,
            loss=loss,
            parameters=parameters,
            method=method,
            every=every,
            duration=duration,
            samples=samples,
            rtol=rtol,
            atol=atol,
            kp=kp,
            kd=kd,
            target=target,
            loads=loads,
            out=out,
            effort=efforts_of(self.calls, saturate),
        )

    def rollout_sensitivity(
        self,
        q0: ArrayLike,
        v0: ArrayLike,
        u: ArrayLike | None = None,
        dt: float | None = None,
        steps: int | None = None,
        *,
        parameters: Sequence[str] = (),
        along: Mapping[str, ArrayLike] | None = None,
        method: str = "rk4",
        every: int = 1,
        kp: ArrayLike | None = None,
        kd: ArrayLike | None = None,
        target: ArrayLike | None = None,
        duration: float | None = None,
        samples: int | None = None,
        rtol: float = 1e-6,
        atol: ArrayLike | None = None,
        loads: Loads | Sequence[Loads] | None = None,
        saturate: Saturate = None,
        out: Sequence[Array] | None = None,
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Derivatives of a rollout's states along few directions, exact for its steps: they carry them forwards.

        Steps that the error chooses count as given, as of ``rollout_gradient``.  Every direction costs some rollouts,
        whatever the number of samples is.

        Args:
            q0, v0, u, dt, steps, method, every, kp, kd, target, duration, samples, rtol, atol: as of ``rollout``.
            parameters: names of run-time parameters, a direction each.
            along: directions in front of those: rates by names "q", "v" and "u", (directions, n) each, those of drives
                (directions, rows, n) where they change with the rows of u; rates that are not given are zero.
            loads: as of ``rollout_gradient``; wrenches need external_force_tangent and
                external_force_parameter_tangent, in points and axes of links those of frame_pose, and a model that
                drives know inverse_dynamics_tangent.
            saturate: as of ``rollout_gradient``.
            out: q, v, dq and dv to write to.

        Returns:
            q and v as of ``rollout``, then dq and dv, (samples, directions, n); of many states (N, samples, directions,
            n), all along the same directions.

        Raises:
            UnknownNameError: no such parameter, or the kernel was built without the method's sensitivity.
            InputError: as of ``rollout``; no direction; joints that turn freely; a robot that is too stiff, as there.
            SingularError, IntegrationStopped: as of ``rollout``.
        """
        u = np.zeros(self.n, self.dtype) if u is None else u
        given = {"q0": q0, "v0": v0, "u": u, "kp": kp, "kd": kd, "target": target}
        given["effort"] = efforts_of(self.calls, saturate)
        how: dict[str, Any] = {"method": method, "dt": dt, "steps": steps, "every": every, "duration": duration}
        how |= {"samples": samples, "rtol": rtol, "atol": atol}
        return rollout_sensitivity(
            self.calls, self._driven, given, parameters=parameters, along=along, loads=loads, out=out, **how
        )

    def frame_index(self, name: str) -> int:
        """The number of a frame or link in ``frames``, by which functions of C take it.

        Raises:
            UnknownNameError: no frame or link of that name.
        """
        if not isinstance(name, str) or name not in self.frames:
            raise UnknownNameError(f"frame: {show(name)} is unknown{nearest_or_all(str(name), self.frames)}")
        return self.frames.index(name)

    def refuse_not_finite(self, label: str, array: Array, shape: tuple[int, ...], place: str = "") -> None:
        """Refuse NaN and infinity in an argument of a kernel, or in a batch of them, whatever ``checks`` says.

        Args:
            label: the argument's name; "wrench" has rows of links, everything else numbers of coordinates.
            array: of that shape, or (N, *shape).
            shape: (n,); (steps, n); or (links, 6).
            place: what follows the number, such as " at t = 1 s".

        Raises:
            ArrayError: there is such a number; coordinate, state and step of the first one are named.
        """
        self.calls.refuse_not_finite(label, array, shape, place)


def _three(blocks: Array) -> tuple[Array, Array, Array]:
    return blocks[..., 0, :, :], blocks[..., 1, :, :], blocks[..., 2, :, :]
