"""From arrays to the C of a kernel and back: what is checked and converted, what threads share, what an error says.

A generated package carries a copy of this file, which imports NumPy and its neighbours and nothing else.
"""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ArrayError, SingularError, UnknownNameError
from .parameters import Parameters, nearest

Array = NDArray[Any]

SHARE = 256  # states that are worth a thread of their own
WRENCHES = ("wrench", "dwrench")  # arguments with rows of links


class Calls:
    """How the functions of a compiled module are called; ``Kernel`` gives them their names and their meaning."""

    parameters: Parameters

    def __init__(self, ffi: Any, lib: Any, meta: Mapping[str, Any]) -> None:
        self.name: str = meta["name"]
        self.coordinates: tuple[str, ...] = tuple(meta["coordinates"])
        self.links: tuple[str, ...] = tuple(meta["links"])
        self.frames: tuple[str, ...] = tuple(meta["frames"])
        self.dtype: np.dtype[Any] = np.dtype(meta["dtype"])
        self._ffi, self._lib = ffi, lib
        self._pointer = {"float64": "double[]", "float32": "float[]"}[meta["dtype"]]
        self._shapes = {key: tuple(shape) for key, shape in meta["shapes"].items()}
        n = len(self.coordinates)
        self._shapes.update(pose=(4, 4), jacobian=(6, n))
        self._functions = {
            name: (tuple(entry["reads"]), entry["writes"])
            for name, entry in meta["kernels"].items()
            if name not in ("kinematics", "rollout")
        }
        if "kinematics" in meta["kernels"]:
            self._functions.update(frame_pose=(("q",), "pose"), frame_jacobian=(("q",), "jacobian"))
        self._code = {name: getattr(lib, f"{self.name}_{name}") for name in self._functions}
        self._batch_code = {name: getattr(lib, f"{self.name}_{name}_batch") for name in self._functions}
        self._threads, self._checks = 1, True

    def _shared(self, run: Callable[[int, int], int], count: int | None, least: int) -> int:
        """run(first, last) over all states in as many threads as there shall be; -1, or the first failure."""
        parts = min(self._threads, (count or 0) // least)
        if parts < 2:
            return run(0, 1 if count is None else count)
        edges = [(count or 0) * part // parts for part in range(parts + 1)]
        failures = [found for found in _pool(parts).map(run, edges[:-1], edges[1:]) if found >= 0]
        return min(failures, default=-1)

    def _frame(self, name: str) -> tuple[int]:
        if name not in self.frames:
            raise UnknownNameError(f"frame: {name!r} is unknown{nearest(str(name), self.frames)}")
        return (self.frames.index(name),)

    def _run_with(
        self,
        name: str,
        out: Array | None,
        values: Sequence[ArrayLike],
        wrench: ArrayLike | None,
        sign: float,
        part: str = "external_force",
    ) -> Array:
        """A kernel's result plus what the wrenches add to it (the kernel ``part``), times a sign."""
        if wrench is None:
            return self._run(name, out, values)
        external = self._run(part, None, (values[0], wrench))
        single = self._shapes["vector" if part == "external_force" else "reactions"]
        result = self._run(name, out, values, count=len(external) if external.ndim > len(single) else None)
        result += self.dtype.type(sign) * external
        return result

    def _run(
        self,
        name: str,
        out: Array | None,
        values: Sequence[ArrayLike],
        extra: tuple[int, ...] = (),
        count: int | None = None,
    ) -> Array:
        """Check the arrays, call the C, and say what went wrong."""
        found = self._functions.get(name)
        if found is None:
            raise UnknownNameError(
                f"{self.name} was built without the kernel {name}; built: {', '.join(self._functions)}"
            )
        reads, writes = found
        arrays: list[Array] = []
        steps: list[int] = []
        for label, value in zip(reads, values, strict=True):
            shape = self._shapes[label]
            array, states = self._array(label, value, shape)
            if states is not None:
                if count not in (None, states):
                    raise ArrayError(f"{label}: {states} states, but {count} in other arrays")
                count = states
            arrays.append(array)
            steps.append(math.prod(shape) if states is not None else 0)
        shape = self._shapes[writes] if count is None else (count, *self._shapes[writes])
        result = np.empty(shape, self.dtype) if out is None else self._checked_out(out, shape, arrays)
        failed = self._call(name, arrays, steps, extra, count, result)
        if failed >= 0:
            for label, array in zip(reads, arrays, strict=True):  # NaN has no pivot, either
                self.refuse_not_finite(label, array, self._shapes[label])
            state, coordinate = divmod(failed, len(self.coordinates))
            self._raise_singular(name, coordinate, "" if count is None else f" in state {state}")
        return result

    def _call(
        self,
        name: str,
        arrays: Sequence[Array],
        steps: Sequence[int],
        extra: tuple[int, ...],
        count: int | None,
        result: Array,
    ) -> int:
        """Call the C for a state, or for a batch in as many threads as there shall be; -1, or the first failure."""
        setup, view, pointer = self.parameters._setup, self._ffi.from_buffer, self._pointer
        if count is None:
            pointers = [view(pointer, array) for array in arrays]
            return int(self._code[name](setup.pointer, *pointers, *extra, view(pointer, result))) - 1
        batch = self._batch_code[name]

        def run(first: int, last: int) -> int:
            arguments: list[Any] = []
            for array, step in zip(arrays, steps, strict=True):
                arguments += [view(pointer, array[first:last] if step else array), step]
            failed = batch(last - first, setup.pointer, *arguments, *extra, view(pointer, result[first:last]))
            return int(failed) + first * len(self.coordinates) if failed >= 0 else -1

        return self._shared(run, count, SHARE)

    def _array(self, label: str, value: ArrayLike, shape: tuple[int, ...]) -> tuple[Array, int | None]:
        """The value as a C-contiguous array of this kernel's dtype, and the number of states if it is a batch."""
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
        if self._checks:
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

    def _raise_singular(self, name: str, coordinate: int, place: str) -> None:
        raise SingularError(
            f"{name}: the mass matrix cannot be inverted at {self.coordinates[coordinate]}{place}; either"
            " the links that it moves have no inertia along it, or an angle beta is at +-pi/2, where Euler angles are"
            " singular"
        )


@functools.cache
def _pool_of(process: int, threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "eomgen")


def _pool(threads: int) -> ThreadPoolExecutor:
    """Threads that wait for batches; a forked process gets its own."""
    return _pool_of(os.getpid(), threads)
