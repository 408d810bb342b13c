"""From arrays to the C of a kernel and back: what is checked and converted, what threads share, what an error says.

A generated package carries a copy of this file, which imports NumPy and its neighbours and nothing else.
"""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ArrayError, SingularError
from .parameters import Parameters
from .raw import RawFunction, RawKernel
from .singular import NEARLY, VANISHED, null_coordinates, singular_place

Array = NDArray[Any]

SHARE = 256  # states that are worth a thread of their own
ELIMINATED = (
    "either the links that it moves have no inertia along it, or an angle beta is at +-pi/2, where Euler angles are"
    " singular"
)
WRENCHES = ("wrench", "dwrench")  # arguments with rows of links


class Calls:
    """Checked calls of a raw kernel's functions, by their names.

    Attributes:
        raw: the functions.
        parameters: the run-time parameters that calls take.
        coordinates: names of the coordinates, for messages.
        links: names of the links that wrenches act on, for messages.
        threads: how many threads share a batch.
        checks: whether NaN and infinity are refused.
        prescribed: names of the coordinates whose motion is given.
    """

    def __init__(
        self,
        raw: RawKernel,
        parameters: Parameters,
        coordinates: tuple[str, ...],
        links: tuple[str, ...],
        prescribed: tuple[str, ...] = (),
    ) -> None:
        self.raw, self.parameters, self.coordinates, self.links = raw, parameters, coordinates, links
        self.prescribed = prescribed
        self.dtype, self.n = raw.dtype, len(coordinates)
        self.threads, self.checks = 1, True

    def with_parameters(self, parameters: Parameters) -> Calls:
        """The same calls, with the same threads and checks, by other parameters of the same code."""
        other = Calls(self.raw, parameters, self.coordinates, self.links, self.prescribed)
        other.threads, other.checks = self.threads, self.checks
        return other

    def shared(self, run: Callable[[int, int], int], count: int | None, least: int) -> int:
        """Run a batch in as many threads as there shall be.

        Args:
            run: ``run(first, last)`` does some of the states; its value is -1, or a failure's number.
            count: the number of states; None for a single one.
            least: states that are worth a thread.

        Returns:
            -1, or the first failure.
        """
        parts = min(self.threads, (count or 0) // least)
        if parts < 2:
            return run(0, 1 if count is None else count)
        edges = [(count or 0) * part // parts for part in range(parts + 1)]
        failures = [found for found in _pool(parts).map(run, edges[:-1], edges[1:]) if found >= 0]
        return min(failures, default=-1)

    def run_with_wrench(
        self,
        name: str,
        out: Array | None,
        values: Sequence[ArrayLike],
        wrench: ArrayLike | None,
        sign: float,
        part: str = "external_force",
    ) -> Array:
        """A function's result plus what wrenches add to it, times a sign.

        Args:
            name, out, values: as of ``run``.
            wrench: external wrenches, (links, 6), or None.
            sign: 1 or -1.
            part: the function of q and the wrenches that is added; it writes an array of the same shape.
        """
        if wrench is None:
            return self.run(name, out, values)
        external = self.run(part, None, (values[0], wrench))
        single = self.raw.shapes[self.raw.functions[part].writes]
        result = self.run(name, out, values, count=len(external) if external.ndim > len(single) else None)
        result += self.dtype.type(sign) * external
        return result

    def run(
        self,
        name: str,
        out: Array | None,
        values: Sequence[ArrayLike],
        extra: tuple[int, ...] = (),
        count: int | None = None,
    ) -> Array:
        """Check the arrays, call the C, and say what went wrong.

        Args:
            name: a function of ``raw``.
            out: array to write to, or None.
            values: what it reads, for one state or a batch; a single state beside a batch stands for all of it.
            extra: the number of a frame, for a function that takes one.
            count: the number of states, where it is known to be a batch.

        Raises:
            UnknownNameError: the kernel was built without this function.
            ArrayError: an array of wrong shape or dtype, or with NaN or infinity.
            SingularError: the mass matrix cannot be inverted in a state.
        """
        raw = self.raw
        function = raw.functions.get(name)
        if function is None:
            raise raw.missing(name)
        arrays: list[Array] = []
        steps: list[int] = []
        for label, value in zip(function.reads, values, strict=True):
            shape = raw.shapes[label]
            array, states = self.array(label, value, shape)
            if states is not None:
                if count not in (None, states):
                    raise ArrayError(f"{label}: {states} states, but {count} in other arrays")
                count = states
            arrays.append(array)
            steps.append(math.prod(shape) if states is not None else 0)
        shape = raw.shapes[function.writes] if count is None else (count, *raw.shapes[function.writes])
        result = np.empty(shape, self.dtype) if out is None else self._checked_out(out, shape, arrays)
        failed = self.call(function, arrays, steps, extra, count, result)
        if failed >= 0:
            for label, array in zip(function.reads, arrays, strict=True):  # NaN has no pivot, either
                self.refuse_not_finite(label, array, raw.shapes[label])
            state, coordinate = divmod(failed, self.n)
            q = arrays[function.reads.index("q")]
            place = "" if count is None else f" in state {state}"
            raise self.singular(name, coordinate, place, q[state] if q.ndim == 2 else q)
        return result

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
            function: of ``raw``.
            arrays: what it reads, C-contiguous and of the kernel's dtype.
            steps: how many numbers apart the states of each array lie, 0 where one is the same for all.
            extra: the number of a frame, for a function that takes one.
            count: the number of states, None for a single one.
            result: what it writes.

        Returns:
            -1, or state * n + i where the mass matrix cannot be inverted at coordinate i.
        """
        setup, view = self.parameters.setup, self.raw.view
        if count is None:
            return int(function.code(setup.pointer, *map(view, arrays), *extra, view(result))) - 1

        def run(first: int, last: int) -> int:
            arguments: list[Any] = []
            for array, step in zip(arrays, steps, strict=True):
                arguments += [view(array[first:last] if step else array), step]
            failed = function.batch(last - first, setup.pointer, *arguments, *extra, view(result[first:last]))
            return int(failed) + first * self.n if failed >= 0 else -1

        return self.shared(run, count, SHARE)

    def array(self, label: str, value: ArrayLike, shape: tuple[int, ...]) -> tuple[Array, int | None]:
        """A value as a C-contiguous array of the kernel's dtype, and the number of states if it is a batch.

        Args:
            label: the argument's name.
            value: what was given for it.
            shape: its shape for one state.

        Raises:
            ArrayError: another shape, a dtype that is not converted exactly, or NaN or infinity (see ``checks``).
        """
        if type(value) is np.ndarray and value.dtype == self.dtype and value.flags.c_contiguous and value.flags.aligned:
            array = value
        else:
            array = self._converted(label, value, shape)
        if array.shape == shape:
            states = None
        elif array.ndim == len(shape) + 1 and array.shape[1:] == shape:
            states = array.shape[0]
        else:
            raise ArrayError(f"{label}: expected {self._expected(shape)}, got shape {array.shape}")
        if self.checks:
            self.refuse_not_finite(label, array, shape)
        return array, states

    def refuse_not_finite(self, label: str, array: Array, shape: tuple[int, ...], place: str = "") -> None:
        """Refuse NaN and infinity in an argument of a kernel, or in a batch of them.

        Args:
            label: its name; one of WRENCHES has rows of links, everything else numbers of coordinates.
            array: of that shape, or (N, *shape).
            shape: (n,); (steps, n); or (links, 6).
            place: what follows the number, such as " at t = 1 s".

        Raises:
            ArrayError: there is such a number; coordinate, state and step of the first one are named.
        """
        if np.isfinite(array).all():
            return
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        name = "" if label in WRENCHES else self.coordinates[where[-1]]
        element = self._element(label, where, shape)
        raise ArrayError(f"{label}: {element} is {array[where]}{place}; numbers must be finite", name)

    def _converted(self, label: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
        try:
            array = np.asarray(value)
        except (ValueError, TypeError) as error:
            raise ArrayError(
                f"{label}: expected {self._expected(shape)}, got {type(value).__name__} ({error})"
            ) from None
        if getattr(value, "mask", None) is not None:
            raise ArrayError(f"{label}: expected {self._expected(shape)}, got a masked array; fill what is masked")
        plain = not isinstance(value, np.ndarray) and array.dtype in (np.float64, np.int64)  # Python's own numbers
        if array.dtype.kind not in "fiub" or not (plain or np.can_cast(array.dtype, self.dtype, "safe")):
            raise ArrayError(
                f"{label}: expected {self._expected(shape)}, got dtype {array.dtype},"
                f" which {self.dtype} cannot hold exactly"
            )
        with np.errstate(over="ignore"):  # what becomes infinite is refused by its name
            return np.require(array, self.dtype, ("C", "A"))

    def _expected(self, shape: tuple[int, ...]) -> str:
        inner = ", ".join(map(str, shape))
        comma = "," if len(shape) == 1 else ""
        return f"{self.dtype} of shape ({inner}{comma}) or (N, {inner})"

    def _element(self, label: str, where: tuple[int, ...], shape: tuple[int, ...]) -> str:
        inner = where[-len(shape) :]
        if label in WRENCHES:
            axis = ("force.x", "force.y", "force.z", "moment.x", "moment.y", "moment.z")[inner[1]]
            text = f"{axis} of link {self.links[inner[0]]}"
        else:
            text = self.coordinates[inner[-1]] + (f" in step {inner[0]}" if len(inner) > 1 else "")
        return text if len(where) == len(shape) else f"{text} in state {where[0]}"

    def _checked_out(self, out: Array, shape: tuple[int, ...], arrays: Sequence[Array]) -> Array:
        if not isinstance(out, np.ndarray):
            raise ArrayError(f"out: expected a NumPy array, got {type(out).__name__}")
        if out.shape != shape or out.dtype != self.dtype:
            raise ArrayError(f"out: expected {self.dtype} of shape {shape}, got {out.dtype} of shape {out.shape}")
        if not out.flags.c_contiguous or not out.flags.writeable:
            raise ArrayError("out: expected a C-contiguous array that can be written, got one that is not")
        if any(np.may_share_memory(out, array) for array in arrays):
            raise ArrayError("out: overlaps an argument; give it memory of its own")
        return out

    def singular(self, name: str, coordinate: int, place: str, q: Array | None = None) -> SingularError:
        """The error that says that a function cannot invert the mass matrix.

        It names the coordinates that move without inertia; where the kernel cannot compute a mass matrix, the one at
        which elimination fails.

        Args:
            name: the function.
            coordinate: index of the coordinate at which elimination fails.
            place: what follows the coordinates' names, such as " in state 3".
            q: coordinates in that state, (n,), where they are known.
        """
        found, reason = self.coordinates[coordinate], ELIMINATED
        if q is not None:
            M, names = self._moving_mass(q), [x for x in self.coordinates if x not in self.prescribed]
            limit = VANISHED if self.dtype == np.float64 else NEARLY
            if M is not None and np.isfinite(M).all():
                found, reason = singular_place(null_coordinates(M, names, limit), q, self.coordinates)
            elif singular_place((found,), q, self.coordinates)[0] != found:
                found, reason = singular_place((found,), q, self.coordinates)
        return SingularError(f"{name}: the mass matrix cannot be inverted at {found}{place}; {reason}")

    def _moving_mass(self, q: Array) -> Array | None:
        """The mass matrix of what is not prescribed at q, (n,); None where no function gives one."""
        moving = [i for i, name in enumerate(self.coordinates) if name not in self.prescribed]
        if "mass_matrix" in self.raw.functions:
            M = self.run("mass_matrix", None, (q,))
        elif "inverse_dynamics" in self.raw.functions:
            zero = np.zeros(self.n, self.dtype)
            M = self.run("inverse_dynamics", None, (q, zero, np.eye(self.n, dtype=self.dtype)))
            M = M - self.run("inverse_dynamics", None, (q, zero, zero))
        else:
            return None
        return np.asarray(M[np.ix_(moving, moving)])


@functools.cache
def _pool_of(process: int, threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "eomgen")


def _pool(threads: int) -> ThreadPoolExecutor:
    """Threads that wait for batches; a forked process gets its own."""
    return _pool_of(os.getpid(), threads)
