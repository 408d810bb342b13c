"""From arrays to the C of a kernel and back: what is called how, and what an error says."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ArrayError, InputError, SingularError
from ..names import listed, split_component
from .arrays import (
    Arrays,
    Lead,
    is_finite,
    joint_lead,
    place_of,
    rows_of,
)
from .chunking import shared, states_at_once
from .parameters import Parameters
from .raw import Array, Method, RawFunction, RawKernel, name_of
from .singular import NEARLY, VANISHED, null_coordinates, scaled_eigenvalues, singular_place

SHARE = 256  # states that are worth a separate thread
POLE = 1e-7  # cosine of beta, below which alpha and gamma turn about one axis
TREE = "tree_"  # begins the names of functions of the open tree
ELIMINATED = (
    "either the links that it moves have no inertia along it, or an angle beta is at +-pi/2, where Euler angles are"
    " singular"
)


class Calls:
    """Checked calls of a raw kernel's functions, by their names.

    Attributes:
        n: number of coordinates.
        coordinates: their names.
        internal_states: names of the internal states of force laws.
        rates: number of what has a rate in motions: of coordinates, then of internal states.
        vanished: scaled eigenvalues of mass matrices below it are zero.
        inputs: number of inputs of motions: of coordinates, then of forces beside drives with states.
        rate_names: names of what has a rate.
    """

    def __init__(
        self, raw: RawKernel, parameters: Parameters, arrays: Arrays, prescribed: tuple[str, ...] = ()
    ) -> None:
        self.raw, self.parameters, self.arrays, self.prescribed = raw, parameters, arrays, prescribed
        self.dtype, self.coordinates, self.n = raw.dtype, arrays.coordinates, len(arrays.coordinates)
        self.vanished = VANISHED if raw.dtype == np.float64 else NEARLY
        self.internal_states: tuple[str, ...] = tuple(raw.libraries.meta.get("internal_states", ()))
        self.rate_names = (*self.coordinates, *self.internal_states)
        self.rates, self.inputs = len(self.rate_names), self.n + len(raw.libraries.meta.get("inputs", ()))

    @property
    def threads(self) -> int:
        """How many threads share a batch."""
        return self.parameters.state.threads

    @property
    def checks(self) -> bool:
        """Whether NaN and infinity are refused."""
        return self.parameters.state.checks

    def with_parameters(self, parameters: Parameters) -> Calls:
        """Return the calls by other parameters of the same code, whose state has threads and checks."""
        return Calls(self.raw, parameters, self.arrays, self.prescribed)

    def of_tree(self, name: str) -> str:
        """Return the function of the open tree that corresponds to one of the closed mechanism."""
        return f"{TREE}{name}" if self.raw.libraries.meta.get("constraints") else name

    def run_with_wrench(
        self,
        name: str,
        out: Array | None,
        values: Sequence[ArrayLike],
        wrench: ArrayLike | None,
        z: ArrayLike | None = None,
    ) -> Array:
        """Run a function, and add the contribution of wrenches to its result, as its ``wrench`` says."""
        if wrench is None:
            return self.run(name, out, values, z=z)
        term = self.raw.functions[name].wrench
        assert term is not None
        added, sign, _ = term
        external = self.run(added, None, (values[0], wrench))
        single = self.raw.shapes[self.raw.functions[added].writes]
        result = self.run(name, out, values, lead=external.shape[: external.ndim - len(single)], z=z)
        with np.errstate(over="ignore", invalid="ignore"):
            result += self.dtype.type(sign) * external
        if self.checks and not is_finite(result):
            labels = (*self.raw.functions[name].reads, "wrench")
            given = (*self.arguments(name, values, z), wrench)
            arrays = [self.array(x, value, self.raw.shapes[x])[0] for x, value in zip(labels, given, strict=True)]
            raise self._overflow(name, result, labels, arrays)
        return result

    def run(
        self,
        name: Method,
        out: Array | None,
        values: Sequence[ArrayLike],
        extra: tuple[int, ...] = (),
        lead: Lead = (),
        inner: int = 0,
        z: ArrayLike | None = None,
        whole: bool = False,
    ) -> Array:
        """Check the arrays, call the C, and say what went wrong.

        Args:
            name: of the function, or the kernel's method.
            values: what it reads, for one state or many, with z and forces beside drives or without both; their leading
                axes go together as NumPy broadcasts.
            extra: the number of a frame, for a function that takes one.
            lead: leading axes that the result has at least.
            inner: how many of the last leading axes are not of states: errors name none of them.
            z: internal states, (..., m), where the result depends on them and they are not among the values.
            whole: whether entries of internal states are left behind those of coordinates in the result.

        Raises:
            UnknownNameError: the kernel was built without this function.
            ArrayError: an array of wrong shape or dtype, or with NaN or infinity, or a result that would be one; or z
                is missing.
            InputError: z, and no force law has internal states.
            SingularError: the mass matrix cannot be inverted in a state.
        """
        name = name_of(name)
        raw, take, checks = self.raw, self.arrays.taken, self.checks
        if name not in raw.functions:
            raise raw.missing(name)
        function = raw.functions[name]
        if axes := 0 if whole else self.arrays.axes_with_states(function.writes):
            result = self.run(name, None, values, extra, lead, inner, z, whole=True)
            place: tuple[Any, ...] = (..., *(slice(self.n),) * axes)
            return self.arrays.written(result[place].copy(), out)
        arrays: list[Array] = []
        for label, value in zip(function.reads, self.arguments(name, values, z), strict=True):
            array, leading = take(label, value, raw.shapes[label], checks)
            if leading != lead:
                lead = joint_lead(label, leading, lead) if leading and lead else leading or lead
            arrays.append(array)
        shape = (*lead, *raw.shapes[function.writes])
        result = np.empty(shape, self.dtype) if out is None else self.arrays.checked_out(out, shape, arrays)
        if lead:
            rows, steps = self._rows(function.reads, arrays, lead)
            count = math.prod(lead)
            failed = self.call(function, rows, steps, extra, count, result.reshape(count, *shape[len(lead) :]))
        else:
            failed = self.call(function, arrays, (), extra, None, result)
        if failed >= 0:
            for label, array in zip(function.reads, arrays, strict=True):  # NaN has no pivot, either
                self.arrays.refuse_not_finite(label, array, raw.shapes[label])
            state, reason = divmod(failed, raw.statuses)
            q, where = arrays[function.reads.index("q")], ""
            if lead:
                q, indices = rows_of(q, (self.n,), lead), np.unravel_index(state, lead)
                where = place_of([int(i) for i in indices[: len(indices) - inner]])
            if reason >= self.n:
                from .loop_errors import loop_error

                rows = self._rows(function.reads, arrays, lead)[0] if lead else arrays
                alone = [x[state] if x.ndim == 2 else x for x in rows]
                arguments = dict(zip(function.reads, alone, strict=True))
                raise loop_error(raw, name, reason - self.n, where, arguments, partial(self._asked, arguments))
            raise self.singular(name, reason, where, q[state] if q.ndim == 2 else q)
        if checks and not is_finite(result):
            raise self._overflow(name, result, function.reads, arrays)
        return result

    def arguments(
        self, name: str, values: Sequence[ArrayLike], z: ArrayLike | None = None, forces: ArrayLike | None = None
    ) -> Sequence[ArrayLike]:
        """Return a function's arguments in the order of its C.

        Args:
            forces: generalized forces beside drives with states, (..., drives); zeros by default.

        Raises:
            ArrayError, InputError: as of ``run``.
        """
        reads = self.raw.functions[name].reads
        self.refuse_z(z)
        if not self.internal_states or len(values) == len(reads):
            return values
        if "z" in reads and z is None:
            what = f"allowed: z, (..., {len(self.internal_states)}), of {listed(self.internal_states)}"
            raise ArrayError(f"{name}: its result depends on internal states, and z is missing; {what}")
        none = np.zeros(self.raw.shapes["forces"], self.dtype) if "forces" in reads and forces is None else forces
        rest, more = iter(values), {"z": z, "forces": none}
        return [value if (value := more.get(x)) is not None else next(rest) for x in reads]

    def refuse_z(self, z: ArrayLike | None) -> None:
        """Raise InputError if there are entries of z where no force law has internal states."""
        if z is None or self.internal_states:
            return
        try:
            given = np.size(z)
        except ValueError:  # rows of several lengths
            given = 1
        if given:
            raise InputError(f"z: no force law of {self.raw.name} has internal states; allowed: a call without z")

    def _rows(self, labels: Sequence[str], arrays: Sequence[Array], lead: Lead) -> tuple[list[Array], list[int]]:
        """Return arguments as rows of states, and strides between states, in numbers: 0 where one stands for all."""
        rows, steps = [], []
        for label, array in zip(labels, arrays, strict=True):
            shape = self.raw.shapes[label]
            flat = rows_of(array, shape, lead)
            rows.append(flat)
            steps.append(math.prod(shape) if flat.ndim > len(shape) else 0)
        return rows, steps

    def _overflow(
        self, name: str, result: Array, labels: Sequence[str], arrays: Sequence[Array]
    ) -> ArrayError | SingularError:
        """Return the error that says that a function's result is not finite, though its arguments are."""
        function = self.raw.functions[name]
        shape = self.raw.shapes[function.writes]
        lead = result.shape[: result.ndim - len(shape)]
        rows = self._rows(labels, arrays, lead)[0] if lead else arrays
        if "q" in labels:
            where = np.argwhere(~np.isfinite(result))[0][: len(lead)]
            state = int(np.ravel_multi_index(tuple(where), lead)) if lead else 0
            q = np.reshape(rows[list(labels).index("q")], (-1, self.n))
            if (loop := self._pole(q[min(state, len(q) - 1)])) is not None:
                return SingularError(
                    f"{name}: {self.raw.name}: {loop}{place_of(where.tolist())}; allowed: poses beside it"
                )
        return self.arrays.overflow(function, result, shape, list(zip(labels, rows, strict=True)))

    def _pole(self, q: Array) -> str | None:
        """Say which frames with forces along their angles have them at their pole at q, (n,); None if none has."""
        meta = self.raw.libraries.meta
        laws = [split_component(name) for name in meta.get("cut_laws", ())]
        turned = {owner for owner, kind in laws if kind in ("alpha", "beta", "gamma")}
        at_pole = "is at beta = +-90 degrees, where its alpha and gamma turn about one axis"
        diagnoses = self.raw.diagnoses
        if turned and "loop_poses" in diagnoses:
            for loop, pose in zip(meta["loops"], self.run(diagnoses["loop_poses"], None, (q,)), strict=True):
                if loop in turned and np.hypot(pose[1, 2], pose[2, 2]) < POLE:
                    return f"loop {loop} {at_pole}"
        if meta.get("element_rows") and "element_rows" in diagnoses:
            with np.errstate(all="ignore"):
                function = self.raw.functions[diagnoses["element_rows"]]
                rows = np.empty(self.raw.shapes[function.writes], self.arrays.dtype)
                self.call(function, [np.ascontiguousarray(q, self.arrays.dtype)], [0], (), None, rows)
            for name, row in zip(meta["element_rows"], rows, strict=True):
                if not np.isfinite(row).all():
                    return f"the force element {split_component(name)[0]} {at_pole}"
        return None

    def call(
        self,
        function: RawFunction,
        arrays: Sequence[Array],
        steps: Sequence[int],
        extra: tuple[int, ...],
        count: int | None,
        result: Array,
    ) -> int:
        """Call the C for a state, or for a batch in as many threads as there shall be.

        Args:
            arrays: what it reads, C-contiguous and of the kernel's dtype.
            steps: how many numbers apart the states of each array lie, 0 where one is the same for all.
            count: the number of states, None for a single one.

        Returns:
            -1, or state * ``raw.statuses`` + i of the first failure.
        """
        setup, view = self.parameters.setup, self.raw.view  # which may be replaced by another one meanwhile
        code = function.code if count is None else function.batch
        pointer = setup.pointer(function.where(batch=count is not None))
        if count is None:
            return int(code(pointer, *map(view, arrays), *extra, view(result))) - 1
        size = states_at_once(function.operations)

        def work(first: int, end: int) -> Iterator[int]:
            for begin in range(first, end, size):
                last = min(begin + size, end)
                arguments: list[Any] = []
                for array, step in zip(arrays, steps, strict=True):
                    arguments += [view(array[begin:last] if step else array), step]
                failed = code(last - begin, pointer, *arguments, *extra, view(result[begin:last]))
                yield int(failed) + begin * self.raw.statuses if failed >= 0 else -1

        return shared(work, count, min(self.threads, count // SHARE))

    def _asked(self, arguments: Mapping[str, Array], diagnosis: str) -> Array | None:
        """Ask another function about a state, with zeros for missing arguments; None where there is none."""
        name = self.raw.diagnoses.get(diagnosis)
        if name is None:
            return None
        reads = self.raw.functions[name].reads
        return self.run(name, None, [arguments.get(x, np.zeros(self.raw.shapes[x], self.dtype)) for x in reads])

    def array(self, label: str, value: ArrayLike, shape: tuple[int, ...]) -> tuple[Array, Lead]:
        """Convert a value to a C-contiguous array of the kernel's dtype; return it and the axes in front of a state's.

        Raises:
            ArrayError: another shape, a number that the dtype cannot hold exactly, or NaN or infinity (see ``checks``).
        """
        return self.arrays.taken(label, value, shape, self.checks)

    def singular(self, name: str, coordinate: int, place: str, q: Array | None = None) -> SingularError:
        """Return the error that says that a function cannot invert the mass matrix.

        It names the coordinates that move without inertia, the links that bend too far for their modes, or the loop
        whose constraints do not say what it bears; where the kernel cannot compute a mass matrix, the coordinate at
        which elimination fails.

        Args:
            place: what follows the coordinates' names, such as " in state 3".
            q: coordinates in that state, (n,), where they are known.
        """
        return SingularError(f"{name}: {self.why_singular(coordinate, place, q)}")

    def why_singular(self, coordinate: int, place: str, q: Array | None = None) -> str:
        """Return what ``singular`` says, without the function's name."""
        where, reason = self.coordinates[coordinate], ELIMINATED
        if bending := self.raw.libraries.meta.get("flexible_links"):
            reason += f", or links that bend ({', '.join(bending)}) bend too far for their modes"
        if q is not None:
            if (loop := self._singular_loop(q)) is not None:
                return f"{self.raw.name}: {loop}{place}"
            M, names = self.moving_mass(q), [x for x in self.coordinates if x not in self.prescribed]
            if (bent := self.bent_too_far(q)) is not None:
                return f"the mass matrix cannot be inverted{place}: {bent}"
            if M is not None and np.isfinite(M).all():
                where, reason = singular_place(null_coordinates(M, names, self.vanished), q, self.coordinates)
            elif singular_place((where,), q, self.coordinates)[0] != where:
                where, reason = singular_place((where,), q, self.coordinates)
        return f"the mass matrix cannot be inverted at {where}{place}; {reason}"

    def bent_too_far(self, q: Array) -> str | None:
        """Say which links bend so far at q, (n,), that the mass matrix is not positive definite; None if none does."""
        if not self.raw.libraries.meta.get("flexible_links"):
            return None
        from .flexible_links import bent_too_far

        return bent_too_far(self.moving_mass, q, self.coordinates, self.vanished)

    def _singular_loop(self, q: Array) -> str | None:
        """Say which loop has constraints that follow from others at q, (n,), where M can be inverted; else None."""
        M = self.moving_mass(q) if self.raw.libraries.meta.get("constraints") else None
        rows = self.raw.diagnoses.get("gap_rows")
        if M is None or rows is None or not np.isfinite(M).all() or scaled_eigenvalues(M)[0][0] <= self.vanished:
            return None
        from .loop_errors import singular_loop

        here = np.asarray(q, dtype=np.float64)
        states = np.stack([here, here + np.linspace(0.3, 0.7, self.n)]).astype(self.dtype)
        return singular_loop(self.raw, *self.run(rows, None, (states,)))

    def moving_mass(self, q: Array) -> Array | None:
        """Return the mass matrix of what is not prescribed at q, (n,); None where no function gives one."""
        moving = [i for i, name in enumerate(self.coordinates) if name not in self.prescribed]
        diagnoses = self.raw.diagnoses
        if "mass" in diagnoses:
            M = self.run(diagnoses["mass"], None, (q,))
        elif (drives := diagnoses.get("forces")) is not None:
            zero = np.zeros(self.n, self.dtype)
            z = np.zeros(len(self.internal_states), self.dtype) if self.internal_states else None
            M = self.run(drives, None, (q, zero, np.eye(self.n, dtype=self.dtype)), z=z)
            M = M - self.run(drives, None, (q, zero, zero), z=z)
        else:
            return None
        return np.asarray(M[np.ix_(moving, moving)])
