"""Methods of a kernel on tiles: arrays of many states in which each number of several states stands side by side.

C computes a state in every lane of a vector.  Rows of states, (N, n), are transposed on their way into vectors and out;
tiles, (ceil(N / W), n, W), are loaded as they are.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping, Sequence
from inspect import signature
from types import FunctionType, MethodType
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ArrayError, InputError, IntegrationStopped
from ..names import show
from .arrays import is_finite, is_masked
from .calls import SHARE, Calls
from .chunking import shared, states_at_once
from .direct import DRIVING, WRENCHED, DirectFunctions, State, calls_its_function
from .raw import TILE_BYTES, TILES, Array, RawFunction


class Owner(Protocol):
    """A kernel whose methods are called with rows of states."""

    name: str
    dtype: np.dtype[Any]
    memory: tuple[str, ...]
    calls: Calls

    def frame_index(self, name: str) -> int:
        """Return the number of a frame."""


class Tiled:
    """Methods of the same names as the kernel's, on tiles of ``width`` states.

    Arrays are (T, n, width) for T tiles, with further axes (T, n, m, width); one state, (n,), stands for all.  Number i
    of state k is at [k // width, i, k % width].  Results are in tiles, with the bits that the same states have in rows.
    What a method takes beside arrays, and what it raises, is as of the kernel; errors name states by their numbers k.
    Parameters, threads and checks are the kernel's.

    C loads tiles as they are.  Calls with wrenches by name, with states of laws apart, or of open loops, and those of
    functions that C computes state by state, are converted on the way; so are rollouts, whose vectors keep states
    between steps.

    Attributes:
        width: states of a tile, a line of memory for each of their numbers: 8 in double precision, 16 in single.
    """

    def __init__(self, kernel: Owner, methods: Mapping[str, FunctionType]) -> None:
        """Make methods on tiles of a kernel whose own methods are those of Python.

        Args:
            kernel: which parameters and code are taken from.
            methods: of the kernel's class, by the names of functions.
        """
        self.width = TILE_BYTES // kernel.dtype.itemsize
        self._kernel, self._known = kernel, dict(methods)
        self._module: Any = None

    def bind(self, kernel: Owner, functions: DirectFunctions, state: State) -> None:
        """Let plain calls go through the extension module, others to a kernel whose methods are those of Python."""
        self._kernel = kernel
        plain = Tiled(kernel, self._known)
        self._module = plain._module = functions.module
        functions.module.bind(functions.in_tiles(self.width, _on_tiles), plain, state, self.__dict__)

    def __repr__(self) -> str:
        return f"<{self._kernel.name} on tiles of {self.width} states, {self._kernel.dtype}>"

    def __dir__(self) -> list[str]:
        return sorted({*object.__dir__(self), *self._known})

    def __getattr__(self, name: str) -> Any:
        known = self.__dict__.get("_known", {})
        if name in known:
            return MethodType(_on_tiles(name, known[name]), self)
        raise AttributeError(f"tiled: {show(name)} is no method on tiles; allowed: {', '.join(known)}")

    def __reduce__(self) -> tuple[Any, ...]:
        return getattr, (self._kernel, "tiled")

    def pack(self, x: ArrayLike) -> Array:
        """Return states as tiles; what fills the last tile repeats the last state.

        Args:
            x: (N, n), or (N, n, m) and so on, of the kernel's dtype or of what it holds exactly.

        Returns:
            (ceil(N / width), n, width), or (ceil(N / width), n, m, width); its memory begins at a line.

        Raises:
            ArrayError: another dtype, or no axis of states and numbers.
        """
        shape = _shape_of(x)
        if len(shape) < 2:
            raise ArrayError(f"x: expected {self._kernel.dtype} of shape (N, n) or (N, n, m), got {_said(x)}")
        states, _ = self._kernel.calls.arrays.taken("x", x, shape[1:], False)
        return self._packed(states)

    def unpack(self, x: ArrayLike, N: int | None = None) -> Array:
        """Return tiles as states.

        Args:
            x: (T, n, width), or (T, n, m, width) and so on.
            N: how many states there are; without it those that fill the last tile are among the result.

        Returns:
            (N, n), or (N, n, m), in memory of its own.

        Raises:
            ArrayError: no tiles of this width, or another dtype.
            InputError: N is no whole number of states in so many tiles.
        """
        shape = _shape_of(x)
        if len(shape) < 2 or shape[-1] != self.width:
            raise ArrayError(f"x: expected {self._kernel.dtype} of shape {self._tiles_of(('n',))}, got {_said(x)}")
        tiles, _ = self._kernel.calls.arrays.taken("x", x, shape[1:], False)
        most = len(tiles) * self.width
        if N is None:
            return self._rows(tiles)
        least = max(most - self.width + 1, 0)
        if isinstance(N, bool) or not isinstance(N, (int, np.integer)) or not least <= N <= most:
            raise InputError(
                f"N: {show(N)}; allowed: a whole number from {least} to {most}, as there are {len(tiles)} tiles"
            )
        return self._rows(tiles)[:N]

    def jvp(
        self, name: str, args: Sequence[Any], tangents: Sequence[Any], *, parameters: Mapping[str, float] | None = None
    ) -> Array:
        """Return what a method's result changes by along rates of its arguments, as the kernel's ``jvp``, in tiles.

        Args:
            name: the method.
            args, tangents: its arguments and a rate for each array among them, one state or tiles.
            parameters: rates of run-time parameters by their names.
        """
        is_plain = parameters is None or (isinstance(parameters, dict) and not parameters)
        result = self._derivative(name, "tangent", args, tangents) if is_plain else None
        if result is not None:
            return cast("Array", result)
        counts = dict[str, int]()
        rows = self._argument_rows(name, args, counts), self._argument_rows(name, tangents, counts, "d")
        _refuse_different(counts)
        result = self._kernel_method("jvp")(name, *rows, parameters=parameters)
        return self._packed(result) if counts else cast("Array", result)

    def vjp(
        self, name: str, args: Sequence[Any], cotangent: ArrayLike, parameters: Sequence[str] = ()
    ) -> tuple[Array, ...]:
        """Return the gradient of the sum of a method's weighted results, as the kernel's ``vjp``, in tiles.

        Args:
            name: the method.
            args: its arguments, one state or tiles.
            cotangent: the weights, of the result's shape.
            parameters: names of run-time parameters that the gradient is taken by as well.
        """
        gradient = self._derivative(name, "adjoint", args, (cotangent,)) if _is_empty(parameters) else None
        if gradient is not None:
            parts, begin = list[Array](), 0
            for label in self._kernel.calls.raw.functions[f"{name}_adjoint"].reads[:-1]:
                shape = self._kernel.calls.raw.shapes[label]
                end = begin + math.prod(shape)
                parts.append(gradient[:, begin:end].reshape(len(gradient), *shape, self.width))
                begin = end
            return tuple(parts)
        counts = dict[str, int]()
        rows = self._argument_rows(name, args, counts), self._weight_rows(name, args, cotangent, counts)
        _refuse_different(counts)
        result = self._kernel_method("vjp")(name, *rows, parameters)
        return tuple(self._packed(x) if counts else x for x in result)

    def hessian(self, name: str, args: Sequence[Any], cotangent: ArrayLike) -> Array:
        """Return second derivatives of the sum of a method's weighted results, as the kernel's ``hessian``, in tiles.

        Args:
            name: the method.
            args: its arguments, one state or tiles.
            cotangent: the weights, of the result's shape.
        """
        result = self._derivative(name, "hessian", args, (cotangent,))
        if result is not None:
            return cast("Array", result)
        counts = dict[str, int]()
        rows = self._argument_rows(name, args, counts), self._weight_rows(name, args, cotangent, counts)
        _refuse_different(counts)
        result = self._kernel_method("hessian")(name, *rows)
        return self._packed(result) if counts else cast("Array", result)

    def rollout(self, q0: ArrayLike, v0: ArrayLike, u: ArrayLike | None = None, *args: Any, **keywords: Any) -> Any:
        """Integrate as the kernel's ``rollout``, of fixed and of adaptive steps; states go in and come out in tiles.

        Args:
            q0, v0: states, (n,) or (T, n, width).
            u: drives, (n,), (T, n, width), or (T, steps, n, width) with a row for every step.
            args, keywords: as of the kernel's ``rollout``; ``target`` has shapes as ``u``, ``z`` (memory,) or
                (T, memory, width).  Those of ``loads`` that are a list have one for each state of all tiles.

        Returns:
            q and v, (T, samples + 1, n, width); attributes ``steps``, ``rejected``, ``largest`` and ``smallest`` are
            (T, width), ``works`` and ``z`` as q.  States that fill the last tile are integrated, too.
        """
        counts = dict[str, int]()
        rows = [self._rollout_rows(x, y, counts) for x, y in (("q0", q0), ("v0", v0), ("u", u))]
        for label in ("target", "z"):
            if label in keywords:
                keywords[label] = self._rollout_rows(label, keywords[label], counts)
        _refuse_different(counts)
        try:
            return self._rollout_in_tiles(self._kernel_method("rollout")(*rows, *args, **keywords), counts)
        except IntegrationStopped as error:
            if error.stored is not None and counts:
                error.stored = tuple(self._packed(x) for x in error.stored)
            raise

    def _rollout_rows(self, label: str, value: Any, counts: dict[str, int]) -> Any:
        """Return states or drives of a rollout in rows; one state as it is."""
        lengths = _shape_of(value)
        if value is None or len(lengths) < 2:
            return value
        over_time = label in ("u", "target")
        if len(lengths) not in ((3, 4) if over_time else (3,)) or lengths[-1] != self.width:
            more = f", or {self._tiles_of(('steps', 'n'))}" if over_time else ""
            raise ArrayError(f"{label}: got shape {lengths}; allowed: (n,), or in tiles {self._tiles_of(('n',))}{more}")
        counts[label] = lengths[0]
        return self._rows(np.asarray(value))

    def _rollout_in_tiles(self, result: Any, counts: Mapping[str, int]) -> Any:
        """Return a rollout of states in rows, with what its steps were, in tiles."""
        if not counts:
            return result
        figures = {
            label: x.reshape(-1, self.width) if x.ndim == 1 else self._packed(x) for label, x in vars(result).items()
        }
        return result.of(*map(self._packed, result), **figures)

    def _kernel_method(self, name: str) -> Any:
        return getattr(self._kernel, name)

    def _derivative(self, name: str, kind: str, args: Sequence[Any], more: Sequence[Any]) -> Any:
        """Call the C of a derivative with tiles; None where that does not do."""
        raw = self._kernel.calls.raw
        function = raw.functions.get(f"{name}_{kind}") if isinstance(name, str) else None
        sequences = isinstance(args, (tuple, list)) and isinstance(more, (tuple, list))
        if function is None or not sequences or raw.libraries.meta.get("constraints"):
            return None
        arrays = (*args, *more)
        if len(arrays) != len(function.reads):
            return None
        return self._straight(function.name, dict(zip(function.reads, arrays, strict=True)))

    def _argument_rows(self, name: str, args: Any, counts: dict[str, int], rate: str = "") -> Any:
        """Return arguments of a method, or their rates, in rows; names of frames and what is wrong as they are."""
        raw = self._kernel.calls.raw
        kinds = ("tangent", "adjoint", "hessian")
        known = [raw.functions[f"{name}_{x}"] for x in kinds if f"{name}_{x}" in raw.functions]
        if not known or not isinstance(args, (tuple, list)):
            return args
        labels = known[0].reads
        return tuple(
            x
            if isinstance(x, str) or i >= len(labels)
            else self._unpacked(f"{rate}{labels[i]}", x, raw.shapes[labels[i]], counts)
            for i, x in enumerate(args)
        )

    def _weight_rows(self, name: str, args: Any, cotangent: Any, counts: dict[str, int]) -> Any:
        """Return weights of a method's results in rows."""
        raw = self._kernel.calls.raw
        if not isinstance(name, str):
            return cotangent
        if name in raw.functions:
            return self._unpacked("cotangent", cotangent, raw.shapes[raw.functions[name].writes], counts)
        known = raw.functions.get(f"{name}_adjoint") or raw.functions.get(f"{name}_hessian")
        if known is None:
            return cotangent
        framed = isinstance(args, (tuple, list)) and any(isinstance(x, str) for x in args)
        return self._unpacked("cotangent", cotangent, raw.shapes[known.reads[-1]][framed:], counts)

    def _tiles_of(self, shape: tuple[Any, ...]) -> str:
        return f"(T, {', '.join(map(str, shape))}, {self.width})"

    def _packed(self, states: Array) -> Array:
        whole, left = divmod(len(states), self.width)
        inner = states.shape[1:]
        tiles = aligned((whole + (left > 0), *inner, self.width), states.dtype)
        if self._module is not None and states.size and states.dtype == self._kernel.dtype:
            size = math.prod(inner)
            rows = np.require(states, None, ("C", "A")).reshape(len(states), size)
            self._module.pack(rows, tiles.reshape(-1, size, self.width))
            return tiles
        by_state = np.moveaxis(tiles, -1, 1)
        by_state[:whole] = states[: whole * self.width].reshape(whole, self.width, *inner)
        if left:
            by_state[whole, :left] = states[-left:]
            by_state[whole, left:] = states[-1]
        return tiles

    def _rows(self, tiles: Array) -> Array:
        if self._module is not None and tiles.size and tiles.dtype == self._kernel.dtype:
            size = math.prod(tiles.shape[1:-1])
            states = np.empty((len(tiles) * self.width, *tiles.shape[1:-1]), tiles.dtype)
            whole = np.require(tiles, None, ("C", "A")).reshape(-1, size, self.width)
            self._module.unpack(whole, states.reshape(len(states), size))
            return states
        by_state = np.moveaxis(tiles, -1, 1)
        return np.ascontiguousarray(by_state).reshape(len(tiles) * self.width, *by_state.shape[2:])

    def _call(self, name: str, method: FunctionType, args: tuple[Any, ...], keywords: Mapping[str, Any]) -> Any:
        arguments = dict(signature(method).bind(self._kernel, *args, **keywords).arguments)
        arguments.pop("self", None)
        result = self._straight(name, arguments) if arguments.get("wrench") is None else self._loaded(name, arguments)
        return self._converted(name, arguments) if result is None else result

    def _loaded(self, name: str, arguments: Mapping[str, Any]) -> Any:
        """Call the C with wrenches of links, which add to a result or to drives; None where that does not do."""
        calls, added = self._kernel.calls, WRENCHED.get(name)
        rest = {label: x for label, x in arguments.items() if label != "wrench"}
        wrench, out = arguments["wrench"], arguments.get("out")
        closed = bool(calls.raw.libraries.meta.get("constraints"))
        if added is None or added.function not in calls.raw.functions or type(wrench) is not np.ndarray:
            return None
        if calls.arrays.has_drives or (closed and name in DRIVING):
            return None
        if out is not None and np.may_share_memory(out, wrench):
            return None
        external = self._straight(added.function, {"q": rest.get("q"), "wrench": wrench})
        if external is None:
            return None
        if added.into:
            drives = rest.get(added.into)
            if type(drives) is not np.ndarray or drives.dtype != calls.dtype:
                return None
            if drives.shape == (calls.n,):
                drives = drives[:, np.newaxis]
            elif drives.shape != external.shape:
                return None
            external[:, [calls.coordinates.index(x) for x in calls.prescribed]] = 0  # where u is an acceleration
            with np.errstate(over="ignore", invalid="ignore"):
                return self._straight(name, {**rest, added.into: drives + external})
        result = self._straight(name, rest)
        if result is None or isinstance(result, tuple) or len(result) != len(external):
            return None
        with np.errstate(over="ignore", invalid="ignore"):
            result += calls.dtype.type(added.sign) * external
        return None if calls.checks and not is_finite(result) else result

    def _straight(self, name: str, arguments: Mapping[str, Any]) -> Any:
        """Call the C with arguments that are tiles or one state, and nothing else; None where that does not do."""
        calls, out = self._kernel.calls, arguments.get("out")
        function = calls.raw.functions[name]
        others = [x for label, x in arguments.items() if label not in (*function.reads, "frame", "out")]
        if not calls_its_function(calls.raw, name) or any(x is not None and x is not False for x in others):
            return None
        arrays: list[Any] = [arguments.get(label) for label in function.reads]
        count = 0
        for array, label in zip(arrays, function.reads, strict=True):
            shape = calls.raw.shapes[label]
            if type(array) is not np.ndarray or array.dtype != calls.dtype:
                return None
            if not (array.flags.c_contiguous and array.flags.aligned and array.size) or 0 in shape:
                return None
            if array.shape != shape:
                if array.shape[1:] != (*shape, self.width) or count not in (0, len(array)):
                    return None
                count = len(array)
        if count == 0 or not function.takes_tiles or (calls.checks and not all(map(is_finite, arrays))):
            return None
        whole = (count, *calls.raw.shapes[function.writes], self.width)
        result = aligned(whole, calls.dtype) if out is None else calls.arrays.checked_out(out, whole, arrays)
        extra = (self._kernel.frame_index(arguments["frame"]),) if function.is_framed else ()
        if self._computed(function, arrays, extra, result) >= 0 or (calls.checks and not is_finite(result)):
            return None
        return tuple(np.moveaxis(result, 1, 0)) if function.writes == "derivatives" else result

    def _computed(self, function: RawFunction, arrays: list[Any], extra: tuple[int, ...], result: Array) -> int:
        """Call the C in pieces and threads; return -1, or a number from 0 on where a state fails."""
        calls, width = self._kernel.calls, self.width
        setup, view = calls.parameters.setup, calls.raw.view
        code, pointer = function.batch, setup.pointer(function.where(batch=True))
        steps = [
            0 if x.shape == calls.raw.shapes[label] else TILES for x, label in zip(arrays, function.reads, strict=True)
        ]
        size = max(states_at_once(function.operations) // width, 1)

        def work(first: int, end: int) -> Iterator[int]:
            for begin in range(first, end, size):
                last = min(begin + size, end)
                pairs = [(view(x[begin:last] if step else x), step) for x, step in zip(arrays, steps, strict=True)]
                yield int(code((last - begin) * width, pointer, *sum(pairs, ()), *extra, view(result[begin:last])))

        return shared(work, len(result), min(calls.threads, len(result) * width // SHARE))

    def _converted(self, name: str, arguments: Mapping[str, Any]) -> Any:
        """Call the kernel's method with states in rows; return its result in tiles."""
        calls, out = self._kernel.calls, arguments.get("out")
        function = calls.raw.functions[name]
        counts = dict[str, int]()
        rows = {label: self._rows_of(label, value, counts) for label, value in arguments.items() if label != "out"}
        _refuse_different(counts)
        result = getattr(self._kernel, name)(**rows)
        in_parts = isinstance(result, tuple)
        whole = np.stack(result, axis=-1 - len(calls.raw.shapes[function.writes][1:])) if in_parts else result
        if counts:
            whole = self._packed(whole)
        if out is not None:
            arrays = [x for x in arguments.values() if isinstance(x, np.ndarray) and x is not out]
            calls.arrays.checked_out(out, whole.shape, arrays)[...] = whole
            whole = out
        return tuple(np.moveaxis(whole, 1 if counts else 0, 0)) if in_parts else whole

    def _rows_of(self, label: str, value: Any, counts: dict[str, int]) -> Any:
        """Return an argument with states in rows, and count its tiles; what is no tile of states as it is."""
        shapes = self._kernel.calls.raw.shapes
        if label == "wrench" and isinstance(value, Mapping):
            return {name: self._unpacked(f"wrench: {show(name)}", x, (6,), counts) for name, x in value.items()}
        if label == "z":
            return self._unpacked(label, value, (len(self._kernel.memory),), counts)
        return self._unpacked(label, value, shapes[label], counts) if label in shapes else value

    def _unpacked(self, label: str, value: Any, shape: tuple[int, ...], counts: dict[str, int]) -> Any:
        lengths = _shape_of(value)
        if len(lengths) <= len(shape) or is_masked(value):
            return value
        if len(lengths) != len(shape) + 2 or lengths[-1] != self.width:
            one = f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
            raise ArrayError(f"{label}: got shape {lengths}; allowed: {one}, or in tiles {self._tiles_of(shape)}")
        counts[label] = lengths[0]
        return self._rows(np.asarray(value))


def aligned(shape: tuple[int, ...], dtype: np.dtype[Any]) -> Array:
    """Return an array whose memory begins at a line, so that no number of a tile lies in two of them."""
    size = math.prod(shape)
    room = np.empty(size + TILE_BYTES // dtype.itemsize, dtype)
    first = -room.ctypes.data % TILE_BYTES // dtype.itemsize
    return room[first : first + size].reshape(shape)


@functools.cache
def _on_tiles(name: str, method: FunctionType) -> Any:
    """Return the method on tiles that corresponds to one of a kernel."""

    @functools.wraps(method)
    def call(self: Tiled, *args: Any, **keywords: Any) -> Any:
        return self._call(name, method, args, keywords)

    return call


def _refuse_different(counts: Mapping[str, int]) -> None:
    """Refuse arrays, by their labels, that have other numbers of tiles than the first."""
    first = next(iter(counts), "")
    for label, count in counts.items():
        if count != counts[first]:
            raise ArrayError(f"{label}: {count} tiles, but {counts[first]} in {first}")


def _is_empty(names: Any) -> bool:
    return isinstance(names, (tuple, list)) and not names


def _shape_of(value: Any) -> tuple[int, ...]:
    """Return an array's shape; () of what is none."""
    try:
        return tuple(np.shape(value))
    except ValueError:
        return ()


def _said(value: Any) -> str:
    """Say what an argument is: its shape, or its type where it has none."""
    return f"shape {_shape_of(value)}" if isinstance(value, np.ndarray) else type(value).__name__
