"""The functions of a compiled module as they are: pointers go in, a status comes out, nothing is checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, NamedTuple

import _cffi_backend
import numpy as np
from numpy.typing import NDArray

from ..errors import BuildError, InputError, UnknownNameError
from ..names import show

Array = NDArray[Any]
Method = str | Callable[..., Any]  # a method of a kernel, or its name

__all__ = [
    *("Libraries", "Library", "Method", "RawFunction", "RawKernel", "Setup", "name_of"),
]

FFI = _cffi_backend.FFI()  # knows C's own types; pointers of all libraries are of these
POINTERS = {"float64": "double[]", "float32": "float[]"}
JOINED = "_joined"  # ends the names of functions that integrations call
BY_OPTION = ("z", "forces")  # arrays that options of methods give
DERIVED = ("tangent", "adjoint", "hessian", "jet", "gradient")  # kinds of functions that are of others
SETUP = "parameters"  # among operations: of what depends on parameters alone
FRAMES, ROLLOUT, ADAPTIVE, GRADIENT = "frames", "rollout", "adaptive", "gradient"  # kinds with special calls
WEIGHTS = {"mul": 1, "add": 1, "div": 5, "sincos": 25}  # times of operations beside each other
BATCH = "_batch"  # behind the name of what works on several states
ENDINGS = ("h", "c", "json")  # of the files that a kernel's package has beside its libraries
STAGES = 5  # of a step of a rollout: four of rk4, in numbers of linearly implicit ones, and what is around them


def name_of(method: Method) -> str:
    """Return the name of a method of a kernel; anything else as it is."""
    return str(getattr(method, "__name__", "")) if callable(method) else method


class WrenchTerm(NamedTuple):
    """Contribution of external wrenches to what a function computes.

    Attributes:
        function: of q and the wrenches, whose result is added.
        sign: 1 or -1.
        into: the argument that it is added to, with sign 1, where it is not the result.
    """

    function: str
    sign: float
    into: str = ""


@dataclass(frozen=True)
class RawFunction:
    """A function of C that users call.

    Its code for one state and that for batches may be in two libraries, each compiled when it is first looked up.

    Attributes:
        name: its name, without the robot's in front.
        kernel: the kernel that it belongs to, as in ``Kernel.operations``; frame_pose belongs to "kinematics".
        kind: "program" (straight-line code), "tangent", "adjoint", "hessian" or "jet" (the same, derivatives of
            another kernel), "composed" (calls programs), "frames" (takes the number of a frame) or "rollout" (many
            steps in one call).
        reads: names of the arrays that it reads, in the order of the arguments; ``RawKernel.shapes`` has their shapes.
        writes: name of the array that it writes.
        takes: optional arguments of its method behind the arrays, in their order: "wrench", "z", "cut".
        wrench: how external wrenches enter, if they do.
        loaded: the function that computes the same for closed loops where generalized forces act in addition, and
            that which gives these forces of wrenches; or ().
        closes: whether it, or what it is a derivative of, refuses states in which loops are open.
        diagnosis: what error messages take from it about a state: "mass", "gap", ...; or "".
    """

    name: str
    kernel: str
    kind: str
    reads: tuple[str, ...]
    writes: str
    _libraries: Libraries = field(repr=False, compare=False)
    takes: tuple[str, ...] = ()
    wrench: WrenchTerm | None = None
    loaded: tuple[str, ...] = ()
    closes: bool = False
    diagnosis: str = ""
    _codes: dict[bool, tuple[Any, Library]] = field(default_factory=dict, repr=False, compare=False)

    @property
    def arguments(self) -> tuple[str, ...]:
        """Names of the arrays that its method takes before options: without z and forces beside drives."""
        return self.reads if self.kind in DERIVED else tuple(x for x in self.reads if x not in BY_OPTION)

    @property
    def is_framed(self) -> bool:
        """True if the number of a frame comes before the result."""
        return self.kind == FRAMES

    @property
    def code(self) -> Any:
        """The C for one state: ``int code(h, array, ..., out)``, with ``int frame`` before ``out`` for "frames".

        The value is 0, or 1 + i where the mass matrix cannot be inverted at coordinate i; 1 + n + r where the
        constraint r of closed loops is open, and as many more as there are constraints where it is opening.
        """
        return self._code_of(batch=False)[0]

    @property
    def batch(self) -> Any:
        """The C for several: ``long long batch(count, h, array, step, ..., out)``, states ``step`` numbers apart.

        A step of 0 stands for one that is the same for all.  The value is -1, or state * ``statuses`` + i of the first
        failure.
        """
        return self._code_of(batch=True)[0]

    @property
    def library(self) -> Library:
        """Return the library with its code for one state; ``Setup`` has what that reads of the parameters."""
        return self.where()

    @cached_property
    def operations(self) -> int:
        """Operations of a call, or of a step of a rollout, at most: multiplications and additions, or what takes as
        long.
        """
        library = self.where(batch=False not in self._codes and True in self._codes)  # either says it
        work: int = sum(WEIGHTS[key] * count for key, count in library.meta["operations"][self.kernel].items())
        return work * (STAGES if self.kind == ROLLOUT else 1)

    def address(self, *, batch: bool = False) -> int:
        """Return the address of the code for one state, or for several."""
        return self.where(batch=batch).address(f"{self.name}{BATCH}" if batch else self.name)

    def joined_address(self) -> int:
        """Return the address of the code as integrations call it: z stands behind v, forces beside drives behind u."""
        joined = "" if self.arguments == self.reads else JOINED
        return self.where().address(f"{self.name}{joined}")

    def where(self, *, batch: bool = False) -> Library:
        """Return the library with the code for one state, or for several, which takes its ``Setup.pointer``."""
        return self._code_of(batch=batch)[1]

    def _code_of(self, *, batch: bool) -> tuple[Any, Library]:
        """Return its code, and where it is; libraries see to it that one thread makes them."""
        code = self._codes.get(batch)
        if code is None:
            name = f"{self.name}{BATCH}" if batch else self.name
            library = self._libraries.library(self.kernel, name)
            code = self._codes.setdefault(batch, (library.function(name), library))
        return code


class Library:
    """A compiled module of C: functions of a robot, and what they read of its parameters.

    Attributes:
        meta: its metadata.
        name: the robot's name, with which the names of C begin.
        dtype: the dtype of all arrays.
        hoisted: how many numbers are computed from the parameters.
        setup: name of the function that does it, "setup", or "turned_setup" where joints have 3-DOF rotation.
        ffi, lib: cffi's objects of the module.
    """

    def __init__(self, ffi: Any, lib: Any, meta: Mapping[str, Any]) -> None:
        self.ffi, self.lib, self.meta = ffi, lib, meta
        self.name: str = meta["name"]
        self.dtype: np.dtype[Any] = np.dtype(meta["dtype"])
        self.hoisted: int = meta["hoisted"]
        self._view = partial(FFI.from_buffer, POINTERS[meta["dtype"]])
        self.setup = "turned_setup" if meta.get("turning") else "setup"
        self._setup = getattr(lib, f"{self.name}_{self.setup}")

    def function(self, name: str) -> Any:
        """Return one of its functions by the name behind the robot's, such as "residual_batch"."""
        return getattr(self.lib, f"{self.name}_{name}")

    def address(self, name: str) -> int:
        """Return the address of one of its functions by the name behind the robot's, such as "setup"."""
        return int(FFI.cast("intptr_t", self.ffi.addressof(self.lib, f"{self.name}_{name}")))

    def compute(self, values: Array) -> Array:
        """Compute from the values of the parameters what the functions read: (hoisted,), or one number for none."""
        computed = np.zeros(max(self.hoisted, 1), self.dtype)
        self._setup(self._view(values if values.size else np.zeros(1, self.dtype)), self._view(computed))
        return computed

    def drive(self, **fields: Any) -> Any:
        """Return a new ``NAME_drive``, the argument of a rollout; pointers among the fields must be kept alive."""
        return self.new("drive", **fields)

    def new(self, kind: str, **fields: Any) -> Any:
        """Return a new ``NAME_kind``; pointers among the fields must be kept alive."""
        return self.ffi.new(f"{self.name}_{kind} *", fields)

    def new_array(self, kind: str, length: int) -> Any:
        """Return so many ``NAME_kind`` side by side, all of them zero."""
        return self.ffi.new(f"{self.name}_{kind}[]", length)


class Libraries:
    """Libraries with the functions of a kernel: one; several, made when they are asked for, in derived classes.

    Attributes:
        meta: names, shapes, parameters and functions, the same for all libraries.
    """

    def __init__(self, ffi: Any, lib: Any, meta: Mapping[str, Any], read: Callable[[str], str] | None = None) -> None:
        """Take a package's library by cffi's objects and its metadata; ``read`` gives the text of a file of it."""
        self.meta, self._only, self._text_of = meta, Library(ffi, lib, meta), read

    @property
    def operations(self) -> Mapping[str, Mapping[str, int]]:
        """Operations of the C of kernels, and of "parameters", by kind of operation."""
        counts: Mapping[str, Mapping[str, int]] = self.meta["operations"]
        return counts

    def library(self, kernel: str, function: str = "") -> Library:
        """Return the library with a C function of a kernel, such as "energy_batch", one of those that ``meta`` names.

        Without a name it is the one with the functions for one state.
        """
        return self._only

    def about(self, kernel: str) -> Mapping[str, Any]:
        """Return the metadata of what a kernel is compiled from, which may be derived for that, but is not compiled."""
        return self.meta

    def source(self, file: str) -> str:
        """Return the text of a file with all functions, such as "arm.c"; OSError or KeyError if it is gone."""
        if self._text_of is None:
            raise FileNotFoundError(file)
        return self._text_of(file)

    def together(self, kernels: tuple[str, ...]) -> Libraries:
        """Return libraries with these kernels in one of them."""
        return self


class RawKernel:
    """Compiled C: functions, the shapes of their arrays, and addresses for other programs.

    Nothing is checked here, neither shapes nor dtypes nor the life of a pointer; ``Kernel`` does that.  The header of
    the kernel (``kernel.raw.source("h")``) says what every array holds.

    Attributes:
        libraries: where the functions are.
        name: the robot's name, with which the names of C begin.
        dtype: the dtype of all arrays.
        shapes: shape of every array by its name, for one state.
        functions: functions of one state or a batch, by name.
        diagnoses: names of functions that error messages take numbers from, by what they give; of those that there are.
        statuses: reasons why a function may fail in one state: a pivot of each coordinate; where there are loops a
            gap of each constraint, then its rate, then its acceleration, then a force on each coordinate that no drive
            takes.
        turning: by the name of a joint with 3-DOF rotation the places of alpha and of x among the coordinates; -1 where
            x does not move.  Integrations choose other axes for it where its angles are singular.
        turning_room: numbers of a state by which a rollout goes on where another one ended; 0 without 3-DOF rotations.
        rollout: the function of many steps, or None where the kernel was built without one; its arguments are in the
            header.
        adaptive: the function of integrations with error control, or None, likewise.
        rollouts: ``rollout`` and all functions like ``adaptive``, by name.
        gradients: functions that go back through steps, by name, likewise.
        ffi: cffi's object for pointers and their types.
        view: ``view(array)`` is a pointer to a C-contiguous array of this dtype, for a function of C; it keeps the
            array alive.
    """

    def __init__(self, libraries: Libraries) -> None:
        meta = libraries.meta
        self.libraries = libraries
        self.name: str = meta["name"]
        self.dtype: np.dtype[Any] = np.dtype(meta["dtype"])
        self.shapes: dict[str, tuple[int, ...]] = {key: tuple(shape) for key, shape in meta["shapes"].items()}
        n, m = len(meta["coordinates"]), len(meta.get("constraints", ()))
        self.statuses: int = n + (3 * m + n if m else 0)
        turning = meta.get("turning", {"joints": {}, "room": 0})
        self.turning: dict[str, tuple[int, int]] = {
            name: (places["angles"], places["origin"]) for name, places in turning["joints"].items()
        }
        self.turning_room: int = turning["room"]
        self.ffi = FFI
        self.view = partial(FFI.from_buffer, POINTERS[meta["dtype"]])
        known = [
            RawFunction(
                *(name, entry["kernel"], entry["kind"], tuple(entry["reads"]), entry["writes"], libraries),
                tuple(entry.get("takes", ())),
                WrenchTerm(*entry["wrench"]) if "wrench" in entry else None,
                tuple(entry.get("loaded", ())),
                closes=entry.get("closes", False),
                diagnosis=entry.get("diagnosis", ""),
            )
            for name, entry in meta["functions"].items()
        ]
        self.rollout: RawFunction | None = next((x for x in known if x.kind == ROLLOUT), None)
        self.adaptive: RawFunction | None = next((x for x in known if x.kind == ADAPTIVE), None)
        self.rollouts: Mapping[str, RawFunction] = {x.name: x for x in known if x.kind in (ROLLOUT, ADAPTIVE)}
        self.gradients: Mapping[str, RawFunction] = {x.name: x for x in known if x.kind == GRADIENT}
        apart = (ROLLOUT, ADAPTIVE, GRADIENT)
        self.functions: Mapping[str, RawFunction] = {x.name: x for x in known if x.kind not in apart}
        self.diagnoses: Mapping[str, str] = {x.diagnosis: x.name for x in known if x.diagnosis}

    def __copy__(self) -> RawKernel:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> RawKernel:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        raise InputError(f"raw: compiled code of {self.name} cannot be pickled; allowed: its kernel, or its parameters")

    def missing(self, name: str) -> UnknownNameError:
        """Return the error that says that the kernel has no such function, and which ones it has."""
        return UnknownNameError(f"{self.name} was built without the kernel {name}; built: {', '.join(self.functions)}")

    def has(self, *methods: Method) -> bool:
        """Return whether the kernel was built with the functions of all these methods."""
        return all(name_of(method) in self.functions for method in methods)

    def function(self, name: Method) -> RawFunction:
        """Return the function of a method, or of its own name, that of ``rollout`` as well.

        Raises:
            UnknownNameError: the kernel was built without it.
        """
        name = name_of(name)
        if name in self.functions:
            return self.functions[name]
        if name in self.rollouts:
            return self.rollouts[name]
        raise self.missing(name)

    def writing(self, array: str) -> RawFunction:
        """Return the function that writes an array, of those that only one function writes, but for its derivatives.

        Raises:
            UnknownNameError: the kernel was built without it.
        """
        found = [x for x in self.functions.values() if x.writes == array and x.kind not in DERIVED]
        if len(found) != 1:
            raise self.missing(f"that writes {array}")
        return found[0]

    def address(self, name: str, *, batch: bool = False) -> int:
        """Return the address of the code of a function, for programs that call it without Python.

        Args:
            name: one of ``functions``, or the name of ``rollout``.
            batch: of its code for many states.

        Raises:
            UnknownNameError: the kernel was built without it.
        """
        return self.function(name).address(batch=batch)

    def source(self, ending: str) -> str:
        """Return the text of a file of the package.

        Args:
            ending: "h", the header of all functions; "c", the C of those of one state (those of many states are in
                NAME_batch.c); "json", what Python reads of both.

        Raises:
            InputError: another ending.
            BuildError: its package is not there any more.
        """
        if not isinstance(ending, str) or ending not in ENDINGS:
            raise InputError(f"ending: {show(ending)}; allowed: {', '.join(ENDINGS)}")
        file = f"{self.name}.{ending}"
        try:
            return self.libraries.source(file)
        except (OSError, KeyError):
            raise BuildError(f"{file} is not in the kernel's package any more; build the kernel again") from None


class Setup:
    """Values of the parameters and what is computed from them; never changed, so that a running call keeps them.

    What a library reads of them is computed when it is first asked for.

    Attributes:
        values: in the order of the parameters; behind them a number for each joint with 3-DOF rotation.
    """

    def __init__(self, values: Array) -> None:
        self.values = values
        self._computed: dict[Library, tuple[Array, Any]] = {}

    def computed(self, library: Library) -> Array:
        """Return the numbers that functions of a library read, (hoisted,), or one where there are none."""
        return self._of(library)[0]

    def pointer(self, library: Library) -> Any:
        """Return the pointer to ``computed``, the first argument of every function of the library."""
        return self._of(library)[1]

    def address(self, library: Library) -> int:
        """Return the address of ``computed``, which is valid as long as this object is kept."""
        return int(self.computed(library).ctypes.data)

    def _of(self, library: Library) -> tuple[Array, Any]:
        try:
            return self._computed[library]
        except KeyError:
            array = library.compute(self.values)
            pointer = FFI.from_buffer(POINTERS[str(array.dtype)], array)
            return self._computed.setdefault(library, (array, pointer))  # of two threads the first one's
