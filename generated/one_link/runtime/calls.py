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
    DERIVATIVE,
    OF_ORDERS,
    Arrays,
    Lead,
    coordinate_axes,
    is_finite,
    joint_lead,
    place_of,
    rows_of,
)
from .chunking import shared, states_at_once
from .loop_errors import loop_error, singular_loop
from .parameters import Parameters
from .raw import Array, Method, RawFunction, RawKernel, name_of
from .singular import (
    NEARLY,
    VANISHED,
    bending_links,
    bent_too_far,
    null_coordinates,
    scaled_eigenvalues,
    singular_place,
)

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
        n: length of arrays by coordinate; of robots with internal states that of augmented arrays (``SplitCalls``).
        coordinates: names of these numbers.
        internal_states: names of the internal states of force laws.
    """

    def __init__(
        self, raw: RawKernel, parameters: Parameters, arrays: Arrays, prescribed: tuple[str, ...] = ()
    ) -> None:
        self.raw, self.parameters, self.arrays, self.prescribed = raw, parameters, arrays, prescribed
        self.dtype, self.coordinates, self.n = raw.dtype, arrays.coordinates, len(arrays.coordinates)
        self.internal_states: tuple[str, ...] = tuple(raw.libraries.meta.get("internal_states", ()))

    @property
    def augmented(self) -> Calls:
        """Calls with augmented arrays, as the C reads and writes them."""
        return self

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
        self.refuse_z(z)
        term = self.raw.functions[name].wrench
        assert term is not None
        added, sign, _ = term
        external = self.run(added, None, (values[0], wrench))
        single = self.raw.shapes[self.raw.functions[added].writes]
        result = self.run(name, out, values, lead=external.shape[: external.ndim - len(single)])
        with np.errstate(over="ignore", invalid="ignore"):
            result += self.dtype.type(sign) * external
        if self.checks and not is_finite(result):
            labels = (*self.raw.functions[name].reads, "wrench")
            arrays = [
                self.array(x, value, self.raw.shapes[x])[0] for x, value in zip(labels, (*values, wrench), strict=True)
            ]
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
    ) -> Array:
        """Check the arrays, call the C, and say what went wrong.

        Args:
            name: of the function, or the kernel's method.
            values: what it reads, for one state or many; their leading axes go together as NumPy broadcasts.
            extra: the number of a frame, for a function that takes one.
            lead: leading axes that the result has at least.
            inner: how many of the last leading axes are not of states: errors name none of them.
            z: internal states, (..., m), see ``SplitCalls``.

        Raises:
            UnknownNameError: the kernel was built without this function.
            ArrayError: an array of wrong shape or dtype, or with NaN or infinity, or a result that would be one.
            SingularError: the mass matrix cannot be inverted in a state.
        """
        name = name_of(name)
        self.refuse_z(z)
        raw, take, checks = self.raw, self.arrays.taken, self.checks
        if name not in raw.functions:
            raise raw.missing(name)
        function = raw.functions[name]
        arrays: list[Array] = []
        for label, value in zip(function.reads, values, strict=True):
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
            q, place = arrays[function.reads.index("q")], ""
            if lead:
                q, indices = rows_of(q, (self.n,), lead), np.unravel_index(state, lead)
                place = place_of([int(i) for i in indices[: len(indices) - inner]])
            if reason >= self.n:
                rows = self._rows(function.reads, arrays, lead)[0] if lead else arrays
                alone = [x[state] if x.ndim == 2 else x for x in rows]
                arguments = dict(zip(function.reads, alone, strict=True))
                raise loop_error(raw, name, reason - self.n, place, arguments, partial(self._asked, arguments))
            raise self.singular(name, reason, place, q[state] if q.ndim == 2 else q)
        if checks and not is_finite(result):
            raise self._overflow(name, result, function.reads, arrays)
        return result

    def refuse_z(self, z: ArrayLike | None) -> None:
        """Raise InputError if there is z where no force law has internal states."""
        if z is not None:
            raise InputError(f"z: no force law of {self.raw.name} has internal states; allowed: a call without z")

    def takes_z(self, name: str) -> bool:
        """Whether a function takes z: its result depends on internal states, which are an array of their own."""
        return False

    def join_arguments(self, name: str, values: Sequence[ArrayLike], z: ArrayLike | None) -> list[ArrayLike]:
        """Return augmented arrays of a function's arguments, in their order; InputError if z means nothing."""
        self.refuse_z(z)
        return list(values)

    def join(self, label: str, value: ArrayLike, z: ArrayLike | None = None) -> ArrayLike:
        """Return an argument as an augmented array, where it is by coordinate; InputError if z means nothing."""
        self.refuse_z(z)
        return value

    def split(self, result: Array, writes: str) -> Array:
        """Return the entries of coordinates of an augmented result of that kind."""
        return result

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
        if bending := bending_links(self.coordinates):
            reason += f", or links that bend ({', '.join(bending)}) bend too far for their modes"
        if q is not None:
            if (loop := self._singular_loop(q)) is not None:
                return f"{self.raw.name}: {loop}{place}"
            M, names = self.moving_mass(q), [x for x in self.coordinates if x not in self.prescribed]
            limit = VANISHED if self.dtype == np.float64 else NEARLY
            if (bent := self.bent_too_far(q)) is not None:
                return f"the mass matrix cannot be inverted{place}: {bent}"
            if M is not None and np.isfinite(M).all():
                where, reason = singular_place(null_coordinates(M, names, limit), q, self.coordinates)
            elif singular_place((where,), q, self.coordinates)[0] != where:
                where, reason = singular_place((where,), q, self.coordinates)
        return f"the mass matrix cannot be inverted at {where}{place}; {reason}"

    def bent_too_far(self, q: Array) -> str | None:
        """Say which links bend so far at q, (n,), that the mass matrix is not positive definite; None if none does."""
        limit = VANISHED if self.dtype == np.float64 else NEARLY
        return bent_too_far(self.moving_mass, q, self.coordinates, limit)

    def _singular_loop(self, q: Array) -> str | None:
        """Say which loop has constraints that follow from others at q, (n,), where M can be inverted; else None."""
        M = self.moving_mass(q) if self.raw.libraries.meta.get("constraints") else None
        rows = self.raw.diagnoses.get("gap_rows")
        if M is None or rows is None or not np.isfinite(M).all():
            return None
        if scaled_eigenvalues(M)[0][0] <= (VANISHED if self.dtype == np.float64 else NEARLY):
            return None
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
            M = self.run(drives, None, (q, zero, np.eye(self.n, dtype=self.dtype)))
            M = M - self.run(drives, None, (q, zero, zero))
        else:
            return None
        return np.asarray(M[np.ix_(moving, moving)])


class SplitCalls(Calls):
    """Checked calls where force laws have m internal states: z, (..., m), is an array of its own.

    In augmented arrays, those of the C, a state stands behind the n coordinates as a velocity: q has a number there
    that acts on nothing, v the state, a its rate, u zero.  This class is the one place that converts.
    """

    def __init__(self, augmented: Calls) -> None:
        """Split the arrays of calls with augmented ones."""
        n, arrays = augmented.n - len(augmented.internal_states), augmented.arrays
        split = Arrays(augmented.raw, augmented.coordinates[:n], arrays.links)
        super().__init__(augmented.raw, augmented.parameters, split, augmented.prescribed)
        self._augmented = augmented

    @property
    def augmented(self) -> Calls:
        """Calls with augmented arrays, as the C reads and writes them."""
        return self._augmented

    def takes_z(self, name: str) -> bool:
        """Whether a function takes z: its result depends on internal states."""
        return DERIVATIVE.sub("", name) in self.raw.libraries.meta["stateful"]

    def with_parameters(self, parameters: Parameters) -> Calls:
        """Return the calls by other parameters of the same code, whose state has threads and checks."""
        return SplitCalls(self._augmented.with_parameters(parameters))

    def run(
        self,
        name: Method,
        out: Array | None,
        values: Sequence[ArrayLike],
        extra: tuple[int, ...] = (),
        lead: Lead = (),
        inner: int = 0,
        z: ArrayLike | None = None,
    ) -> Array:
        """Call a function as ``Calls.run`` does, with z where its result depends on internal states."""
        name = name_of(name)
        joined = self.join_arguments(name, values, z)
        result = self._augmented.run(name, None, joined, extra, lead, inner)
        return self.arrays.written(self.split(result, self.raw.functions[name].writes), out)

    def run_with_wrench(
        self,
        name: str,
        out: Array | None,
        values: Sequence[ArrayLike],
        wrench: ArrayLike | None,
        z: ArrayLike | None = None,
    ) -> Array:
        """Run a function, and add the contribution of wrenches to its result, as its ``wrench`` says."""
        result = self._augmented.run_with_wrench(name, None, self.join_arguments(name, values, z), wrench)
        return self.arrays.written(self.split(result, self.raw.functions[name].writes), out)

    def join_arguments(self, name: str, values: Sequence[ArrayLike], z: ArrayLike | None) -> list[ArrayLike]:
        """Return augmented arrays of a function's arguments, in their order.

        Raises:
            UnknownNameError: the kernel was built without this function.
            ArrayError: an array of another shape, or no z where the result depends on it.
        """
        if name not in self.raw.functions:
            raise self.raw.missing(name)
        if z is None and self.takes_z(name):
            what = f"allowed: z, (..., {len(self.internal_states)}), of {listed(self.internal_states)}"
            raise ArrayError(f"{name}: its result depends on internal states, and z is missing; {what}")
        pairs = zip(self.raw.functions[name].reads, values, strict=True)
        return [self.join(x, value, z if x == "v" else None) for x, value in pairs]

    def join(self, label: str, value: ArrayLike, z: ArrayLike | None = None) -> ArrayLike:
        """Return an argument by coordinate with internal states behind, zeros by default; others as they are."""
        if not self.arrays.is_by_coordinate(label):
            return value
        array, lead = self.array(label, value, (self.n,))
        states = np.zeros(len(self.internal_states), self.dtype) if z is None else self.states(z)
        both = joint_lead(label, lead, states.shape[:-1])
        return np.concatenate([np.broadcast_to(x, (*both, x.shape[-1])) for x in (array, states)], axis=-1)

    def split(self, result: Array, writes: str) -> Array:
        """Return the entries of coordinates of an augmented result of that kind."""
        if OF_ORDERS.sub("", writes) == "regressor":  # its columns are parameters
            return np.ascontiguousarray(result[..., : self.n, :])
        place: tuple[Any, ...] = (..., *(slice(self.n),) * coordinate_axes(writes))
        return np.ascontiguousarray(result[place])

    def states(self, z: ArrayLike) -> Array:
        """Return internal states as an array, (..., m).

        Raises:
            ArrayError: another shape, or numbers that are not finite.
        """
        states, _ = self.arrays.taken("z", z, (len(self.internal_states),), False)
        if self.checks and not np.isfinite(states).all():
            where = np.argwhere(~np.isfinite(states))[0]
            raise ArrayError(f"z: {self.internal_states[where[-1]]} is {states[tuple(where)]}; numbers must be finite")
        return states

    def moving_mass(self, q: Array) -> Array | None:
        """Return the mass matrix of what is not prescribed at q, (n,); None where no function gives one."""
        M = self._augmented.moving_mass(np.asarray(self.join("q", q)))
        moving = self.n - len(self.prescribed)
        return None if M is None else M[:moving, :moving]
