"""Methods of a kernel on arrays that lie on a device."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ArrayError, InputError, LoopError, SingularError, UnknownNameError
from ..kernel.complete import Kernel
from ..names import nearest_or_all, show
from ..robot.value import Robot
from .arguments import named_arrays, named_outs, number_of, shown_shape
from .calls import Loaded, Taken
from .cuda import Cuda, DeviceArray, Functions, Launch
from .foreign import IMMUTABLE, View, library_of
from .texts import FunctionText, text_of

ALLOWED = '"cuda", with a number such as "cuda:1"'
WELL = 0xFFFFFFFF  # where no state is named
MOST = WELL - 1  # states of a call: they are named by 32 bits
Array = NDArray[Any]


class Device:
    """Methods of the same names as a kernel's, on arrays of many states that lie on a device.

    Arrays are (N, n), or tiles (T, n, 32) for 32 T states: number i of state k at [k // 32, i, k % 32], which takes no
    transposes.  They have the kernel's dtype, lie in C's order, and are of any library with the CUDA array interface or
    DLPack (CuPy, PyTorch, JAX).  Results are arrays of the library that the first one is of, or ``out``.  Methods are
    the functions of ``eomgen.export_simt``: those of ``dir``.  They take arrays by position or by name, and

        out: array to write to; a tuple of q and v for rollouts, and z of robots with internal states.
        stream: a stream's address or object; that on which the library of the first array works, or the default one,
            without.  Other streams that arrays say they are made on are waited for.
        step, steps: of rollouts, the length of a step in s and how many there are.
        kp, kd, target: of rk4_pd_rollout and implicit_pd_rollout, arrays (N, driven coordinates).

    Numbers are those of the kernel, to the bit, but for exponential functions, logarithms and angles of points in laws,
    and where ``contract`` was asked for.  Parameters are the kernel's.  A function is compiled when it is first called.
    Calls of one object go one after the other, also those of several threads.

    Attributes:
        name: which device it is.
        checks: True if every call waits for its result and refuses what a kernel does by the numbers of states: NaN and
            infinity in arrays, results that are not finite, mass matrices that cannot be inverted, open loops, and
            angles that are too far.  With False calls return at once, and nothing is looked at.
        tile: states of a tile.
        cuda: the device itself.
    """

    def __init__(self, robot: Robot, kernel: Kernel, cuda: Cuda) -> None:
        """Make the methods of a kernel on a device that is open."""
        self.name, self.checks, self.tile = cuda.title, kernel.checks, 32
        self.cuda = cuda
        self._robot, self._kernel = robot, kernel
        self._loaded, self._lock = dict[str, Loaded](), threading.RLock()

    def __repr__(self) -> str:
        return f"<{self._kernel.name} on {self.name}, {self._kernel.dtype}>"

    def __dir__(self) -> list[str]:
        return sorted({*object.__dir__(self), *self.functions})

    @property
    def functions(self) -> tuple[str, ...]:
        """Names of the methods: functions of the robot that are straight-line programs."""
        from ..codegen.kernels.signatures import KERNELS
        from ..codegen.simt.kernels import FRAMES, ROLLOUTS, refusal
        from ..robot.model import build_model

        model = build_model(self._robot)
        return tuple(name for name in (*KERNELS.compiled, *FRAMES, *ROLLOUTS) if refusal(model, name) is None)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            self._load(name)
        except UnknownNameError:
            said = nearest_or_all(name, self.functions)
            raise AttributeError(f"device: {show(name)} is no method on devices{said}") from None

        def call(*arrays: Any, out: Any = None, stream: Any = None, **others: Any) -> Any:
            return self._call(name, arrays, others, out, stream)

        call.__name__ = name
        return call

    @property
    def robot(self) -> str:
        """Name of the robot."""
        return self._kernel.name

    @property
    def dtype(self) -> np.dtype[Any]:
        """Dtype of all arrays."""
        return self._kernel.dtype

    def shapes(self, name: str) -> tuple[dict[str, tuple[int, ...]], dict[str, tuple[int, ...]]]:
        """Return shapes of one state's arrays that a method reads, and of those that it writes, by their names.

        Raises:
            UnknownNameError, InputError: there is no such method.
        """
        text = self._load(name).text
        return text.shapes("reads"), text.shapes("writes")

    def prepared(self, name: str) -> tuple[FunctionText, Functions, DeviceArray]:
        """Return a method's function with the numbers h of the parameters that the kernel has now.

        For whoever launches it himself: its source and metadata, the compiled source, and h on the device.

        Raises:
            UnknownNameError, InputError: there is no such method.
        """
        loaded = self._load(name)
        with self._lock, self.cuda.session(None, ()) as stream:
            return loaded.text, loaded.functions, self._h(loaded, stream)

    def put(self, x: ArrayLike) -> Any:
        """Return a copy on the device of an array, in the kernel's dtype.

        Raises:
            InputError: it is no array of numbers.
        """
        try:
            array = np.ascontiguousarray(x, self._kernel.dtype).reshape(np.shape(x))
        except (TypeError, ValueError):
            raise InputError(f"x: {show(x)}; allowed: an array of numbers") from None
        with self._lock, self.cuda.session(None, ()) as stream:
            return self.cuda.put(array, stream)

    def get(self, x: Any) -> Array:
        """Return a copy in NumPy of an array on the device.

        Raises:
            ArrayError: it is none, of another dtype, or not in C's order.
        """
        with self._lock, self.cuda.session(None, (x,)) as stream:
            view = self.cuda.view("x", x, self._kernel.dtype, stream)
            return self.cuda.read(view.place, 0, np.empty(view.shape, self._kernel.dtype), stream)

    def _load(self, name: str) -> Loaded:
        """Return a function on the device, compiled when it is first asked for."""
        with self._lock:
            if name not in self._loaded:
                text = text_of(self._robot, name, str(self._kernel.dtype))
                self._loaded[name] = Loaded(text, self.cuda.functions(text.code))
            return self._loaded[name]

    def _call(self, name: str, arrays: tuple[Any, ...], others: dict[str, Any], out: Any, stream: Any) -> Any:
        loaded = self._load(name)
        given = named_arrays(name, arrays, others, loaded.reads)
        numbers, outs = self._numbers(loaded.text, others), named_outs(name, out, loaded.writes)
        with self._lock, self.cuda.session(stream, list(given.values())) as on:
            taken = self._taken(loaded, given, numbers, outs, on)
            if taken.count:
                self._run(taken, on)
            return self._results(taken)

    def bind(self, name: str, *arrays: Any, out: Any = None, stream: Any = None, **others: Any) -> Callable[[], Any]:
        """Return a call of a method with its arrays, which is begun again and again at the cost of its launches alone.

        Each time it computes from what the arrays hold by then, writes to the same results, and returns these at once.
        Nothing is looked at, whatever ``checks`` say, and no stream is waited for but the one that it was bound on.
        Parameters are those that the kernel has when it is bound.

        Args:
            name: of the method.
            arrays, out, stream, others: as of the method; arrays of JAX are refused, as their numbers never change.

        Returns:
            A function without arguments, which returns what the method does.

        Raises:
            UnknownNameError, InputError: see the method.
            ArrayError: an array of JAX, or see the method.
        """
        loaded = self._load(name)
        given = named_arrays(name, arrays, others, loaded.reads)
        for label, x in given.items():
            if library_of(x) in IMMUTABLE:
                raise ArrayError(f"{label}: an array of JAX, whose numbers never change; allowed: others")
        numbers, outs = self._numbers(loaded.text, others), named_outs(name, out, loaded.writes)
        with self._lock, self.cuda.session(stream, list(given.values())) as on:
            taken = self._taken(loaded, given, numbers, outs, on)
            memory, rooms = self.cuda.own_rooms(taken.scratch_sizes(self.tile, self._kernel.dtype.itemsize))
            launches, _ = self._launches(taken, rooms, self._h(loaded, on)) if taken.count else ([], None)
            again, results = self.cuda.ready(loaded.functions, launches, on), self._results(taken)
            kept = (taken, memory, loaded.h, self.cuda)

        def call() -> Any:
            again()
            return results

        call.__name__, call.kept = name, kept  # type: ignore[attr-defined]
        return call

    def _taken(
        self,
        loaded: Loaded,
        given: Mapping[str, Any],
        numbers: Sequence[Any],
        outs: Mapping[str, Any],
        on: Any,
    ) -> Taken:
        """Look at arrays, and make those of results that are not given."""
        views = {x: self.cuda.view(x, value, self._kernel.dtype, on) for x, value in given.items()}
        count, is_tiled = self._layout(loaded.text.name, views, loaded.reads)
        like, results = next(iter(given.values())), dict[str, tuple[Any, View]]()
        for array, shape in loaded.writes.items():
            whole = (count // self.tile, *shape, self.tile) if is_tiled else (count, *shape)
            results[array] = self._result(array, outs.get(array), whole, like, on)
        taken = Taken(loaded, count, is_tiled, numbers, views, results, like)
        if count and outs:
            self._refuse_shared(views, taken.writes)
        return taken

    def _results(self, taken: Taken) -> Any:
        made = [self.cuda.finished(taken.like, array) for array, _ in taken.results.values()]
        return made[0] if len(made) == 1 else tuple(made)

    def _numbers(self, text: FunctionText, given: Mapping[str, Any]) -> list[Any]:
        """Return numbers for all states with their types."""
        wanted: Mapping[str, str] = text.about["scalars"]
        if set(given) != set(wanted):
            said = ", ".join(given) or "no numbers"
            raise InputError(f"{text.name}: {said} beside arrays; allowed: {', '.join(wanted) or 'out and stream'}")
        return [number_of(text.name, key, kind, given[key], self._kernel.dtype) for key, kind in wanted.items()]

    def _layout(self, name: str, views: Mapping[str, View], shapes: Mapping[str, tuple[int, ...]]) -> tuple[int, bool]:
        """Return the number of states, and whether arrays are tiles; what is neither is refused by name."""
        found = dict[str, tuple[int, bool]]()
        for label, shape in shapes.items():
            actual = views[label].shape
            if actual[1:] == shape:
                found[label] = actual[0], False
            elif len(actual) == len(shape) + 2 and actual[1:] == (*shape, self.tile):
                found[label] = actual[0] * self.tile, True
            else:
                rows, inner = ("N", *shape), ("T", *shape, self.tile)
                raise ArrayError(
                    f"{label}: shape {actual}; allowed: {shown_shape(rows)}, or in tiles {shown_shape(inner)}"
                )
        label, layout = next(iter(found.items()))
        for other, one in found.items():
            if one != layout:
                said = ["in tiles" if is_tiled else "in rows" for _, is_tiled in (one, layout)]
                raise ArrayError(f"{other}: {one[0]} states {said[0]}, but {layout[0]} {said[1]} in {label}")
        if layout[0] > MOST:
            raise ArrayError(f"{name}: {layout[0]} states; allowed: at most {MOST} in a call")
        return layout

    def _result(self, label: str, out: Any, shape: tuple[int, ...], like: Any, stream: Any) -> tuple[Any, View]:
        if out is None:
            return self.cuda.made(like, shape, self._kernel.dtype, stream)
        view = self.cuda.view(label, out, self._kernel.dtype, stream, True)
        if view.shape != shape:
            raise ArrayError(f"{label}: shape {view.shape}; allowed: {shape}")
        return out, view

    def _refuse_shared(self, views: Mapping[str, View], outs: Mapping[str, View]) -> None:
        """Refuse outputs that begin or end inside what is read, or inside each other."""
        size = self._kernel.dtype.itemsize
        for label, one in outs.items():
            for other, view in (*views.items(), *((x, y) for x, y in outs.items() if x != label)):
                ends = [x.place + math.prod(x.shape) * size for x in (one, view)]
                if one.place < ends[1] and view.place < ends[0]:
                    raise ArrayError(f"{label}: shares memory with {other}; allowed: memory of its own")

    def _run(self, taken: Taken, stream: int) -> None:
        """Put all of a call on its stream: its launches, and what is looked for."""
        loaded, checks = taken.loaded, self.checks
        rooms = self.cuda.rooms(taken.scratch_sizes(self.tile, self._kernel.dtype.itemsize), stream)
        launches, places = self._launches(taken, rooms, self._h(loaded, stream))
        if checks:  # for a status that is not 0 and for numbers that are not finite
            self.cuda.fill(rooms[1], 1 + len(places), stream)
            arguments = [np.uint64(taken.count), *places.values(), *rooms[:2]]
            launches.append((loaded.text.beside("find"), taken.count, arguments))
        for launch in launches:
            self.cuda.launch(loaded.functions, *launch, stream)
        self.cuda.used(stream)
        if checks:
            self._check(taken, places, rooms, stream)

    def _launches(self, taken: Taken, rooms: Sequence[int], h: DeviceArray) -> tuple[list[Launch], dict[str, int]]:
        """Return launches of a call, with transposes around them where arrays are rows, and places of tiles."""
        loaded, count = taken.loaded, np.uint64(taken.count)
        status, _, *tiles = rooms
        rows = [x.place for x in (*taken.reads.values(), *taken.writes.values())]
        within = dict(zip((*taken.reads, *taken.results), rows if taken.is_tiled else tiles, strict=True))
        arguments = [count, h.address, *taken.numbers, *within.values(), status]
        launches: list[Launch] = [(name, taken.count, arguments) for name in loaded.text.about["functions"]]
        if not taken.is_tiled:
            first = len(taken.reads)
            begin, end = [count, *rows[:first], *tiles[:first]], [count, *tiles[first:], *rows[first:]]
            widest = [max(loaded.sizes[x] for x in which) for which in (taken.reads, taken.results)]
            launches.insert(0, (loaded.text.beside("begin"), taken.count * widest[0], begin))
            launches.append((loaded.text.beside("end"), taken.count * widest[1], end))
        return launches, within

    def _h(self, loaded: Loaded, stream: int) -> DeviceArray:
        """Return the numbers h that belong to the kernel's parameters now."""
        from ..codegen.simt.setup import setup_values

        setup = self._kernel.parameters.setup
        if loaded.h is None or loaded.setup is not setup:
            values = list(self._kernel.parameters.state.values)
            h = setup_values(loaded.text.meta["setup"], values, self._kernel.dtype)
            loaded.h = self.cuda.put(h, stream)
            loaded.setup = setup
        return loaded.h

    def _check(self, taken: Taken, places: Mapping[str, int], rooms: Sequence[int], stream: int) -> None:
        """Wait for a call, and raise what its searches found: in what it reads, in statuses, in what it writes."""
        text = taken.loaded.text
        failed, *bad = self.cuda.read(rooms[1], 0, np.empty(1 + len(places), np.uint32), stream).tolist()
        wrong = {label: state for label, state in zip(places, bad, strict=True) if state != WELL}
        for label in taken.reads:
            if label in wrong:
                said, name = self._entry(taken.loaded, label, places[label], wrong[label], stream)
                raise ArrayError(f"{label}: {said}; numbers must be finite", name)
        if failed != WELL:
            (status,) = self.cuda.read(rooms[0], 4 * failed, np.empty(1, np.int32), stream).tolist()
            raise self._failure(text, failed, status)
        for label in wrong:
            said, name = self._entry(taken.loaded, label, places[label], wrong[label], stream)
            raise ArrayError(f"{text.name}: {said}, out of numbers that are finite", name)

    def _entry(self, loaded: Loaded, label: str, place: int, state: int, stream: int) -> tuple[str, str]:
        """Return which number of a state is not finite, and the name of its coordinate, "" where it has none."""
        size = loaded.sizes[label]
        offset = state // self.tile * size * self.tile * self._kernel.dtype.itemsize
        tile = self.cuda.read(place, offset, np.empty((size, self.tile), self._kernel.dtype), stream)
        numbers = tile[:, state % self.tile]
        entry = int(np.flatnonzero(~np.isfinite(numbers))[0])
        shape = {**loaded.reads, **loaded.writes}[label]
        index = tuple(int(i) for i in np.unravel_index(entry, shape))
        calls = self._kernel.calls
        known = calls.arrays.names(label.removesuffix("_out")), (*calls.coordinates, *calls.internal_states)
        name = next((names[entry] for names in known if shape == (len(names),)), "")
        return f"{name or list(index)} in state {state} is {numbers[entry]}", name

    def _failure(self, text: FunctionText, state: int, status: int) -> Exception:
        """Return the error that a status stands for."""
        said = text.reasons(status)
        if said:
            message = f"{text.name}: {said} in state {state}"
            is_loop = status >> text.meta["status"]["violation"] & 3
            loops = ", ".join(self._kernel.loops)
            return LoopError(f"{message} ({loops})", loop=loops, gap=math.nan) if is_loop else ArrayError(message)
        names = " or ".join(text.vanished(status))
        return SingularError(f"{text.name}: the mass matrix cannot be inverted at {names} in state {state}")


def open_device(robot: Robot, kernel: Kernel, where: Any, *, contract: bool = False) -> Device:
    """Return methods of a robot's kernel on a device.

    Args:
        robot: of the kernel.
        kernel: whose parameters, dtype and checks they have.
        where: "cuda", with the number of a device behind a colon.
        contract: let products and sums be one operation: faster, with other last bits than on processors.

    Raises:
        InputError: there is no such device, no driver, or no compiler for it.
    """
    if not isinstance(contract, bool):
        raise InputError(f"contract: {show(contract)}; allowed: True or False")
    if not isinstance(where, str):
        raise InputError(f"device: got {type(where).__name__}; allowed: {ALLOWED}")
    kind, colon, number = where.partition(":")
    if kind != "cuda" or (colon and not (number.isascii() and number.isdigit() and len(number) < 9)):
        more = "; eomgen.export_simt writes source code for HIP and OpenCL" if kind in ("hip", "opencl") else ""
        raise InputError(f"device: {show(where)}; allowed: {ALLOWED}{more}")
    return Device(robot, kernel, Cuda(int(number or 0), contract))
