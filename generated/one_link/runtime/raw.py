"""The functions of a compiled module as they are: pointers go in, a status comes out, nothing is checked.

A generated package carries a copy of this file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import UnknownNameError

Array = NDArray[Any]

__all__ = ["RawFunction", "RawKernel", "Setup"]

POINTERS = {"float64": "double[]", "float32": "float[]"}
FRAMES, ROLLOUT = "frames", "rollout"  # kinds of functions that are called otherwise than all others
WEIGHTS = {"mul": 1, "add": 1, "div": 5, "sincos": 25}  # times of operations beside each other
STAGES = 5  # of a step of a rollout: four of rk4, in numbers of linearly implicit ones, and what is around them


@dataclass(frozen=True)
class RawFunction:
    """A function of C that users call.

    Attributes:
        name: its name, without the robot's in front.
        kernel: the kernel that it belongs to, as in ``Kernel.operations``; frame_pose belongs to "kinematics".
        kind: "program" (straight-line code), "tangent" (the same, the derivative of another kernel), "composed" (calls
            programs), "frames" (takes the number of a frame) or "rollout" (many steps in one call).
        reads: names of the arrays that it reads, in the order of the arguments; ``RawKernel.shapes`` has their shapes.
        writes: name of the array that it writes.
        code: ``int code(h, array, ..., out)``, with ``int frame`` before ``out`` where the kind is "frames".  The value
            is 0, or 1 + i where the mass matrix cannot be inverted at coordinate i.
        batch: ``long long batch(count, h, array, step, ..., out)`` for states that lie ``step`` numbers apart (0: the
            same for all).  The value is -1, or state * n + i of the first failure.
        tangent_of: the function whose directional derivative it is, or nothing.
        operations: of one call, or of a step of a rollout, at most: multiplications and additions, or what takes as
            long.
    """

    name: str
    kernel: str
    kind: str
    reads: tuple[str, ...]
    writes: str
    code: Any
    batch: Any
    tangent_of: str = ""
    operations: int = 0

    @property
    def is_framed(self) -> bool:
        """True if the number of a frame comes before the result."""
        return self.kind == FRAMES


class RawKernel:
    """A compiled module of C: its functions, the shapes of their arrays, and addresses for other programs.

    Nothing is checked here, neither shapes nor dtypes nor the life of a pointer; ``Kernel`` does that.  The header of
    the kernel (``kernel.source("h")``) says what every array holds.

    Attributes:
        name: the robot's name, with which the names of C begin.
        dtype: the dtype of all arrays.
        shapes: shape of every array by its name, for one state.
        functions: functions of one state or a batch, by name.
        rollout: the function of many steps, or None where the kernel was built without one; its arguments are in the
            header.
        hoisted: how many numbers are computed from the parameters.
        ffi, lib: cffi's objects of the module.
        view: ``view(array)`` is a pointer to a C-contiguous array of this dtype, for a function of C; it keeps the
            array alive.
    """

    def __init__(self, ffi: Any, lib: Any, meta: Mapping[str, Any]) -> None:
        self.ffi, self.lib = ffi, lib
        self.name: str = meta["name"]
        self.dtype: np.dtype[Any] = np.dtype(meta["dtype"])
        self.hoisted: int = meta["hoisted"]
        self.shapes: dict[str, tuple[int, ...]] = {key: tuple(shape) for key, shape in meta["shapes"].items()}
        self.view = partial(ffi.from_buffer, POINTERS[meta["dtype"]])
        found = [self._function(name, entry, meta["operations"]) for name, entry in meta["functions"].items()]
        self.functions: dict[str, RawFunction] = {x.name: x for x in found if x.kind != ROLLOUT}
        self.rollout: RawFunction | None = next((x for x in found if x.kind == ROLLOUT), None)
        self._setup = getattr(lib, f"{self.name}_setup")

    def _function(self, name: str, entry: Mapping[str, Any], operations: Mapping[str, Any]) -> RawFunction:
        code, batch = (getattr(self.lib, f"{self.name}_{name}{end}") for end in ("", "_batch"))
        reads, of = tuple(entry["reads"]), entry.get("tangent_of", "")
        kernel, kind = entry["kernel"], entry["kind"]
        work = sum(WEIGHTS[key] * count for key, count in operations[kernel].items())
        work *= STAGES if kind == ROLLOUT else 1
        return RawFunction(name, kernel, kind, reads, entry["writes"], code, batch, of, work)

    def missing(self, name: str) -> UnknownNameError:
        """The error that says that the kernel has no such function, and which ones it has."""
        return UnknownNameError(f"{self.name} was built without the kernel {name}; built: {', '.join(self.functions)}")

    def address(self, name: str, *, batch: bool = False) -> int:
        """Address of the code of a function, for programs that call it without Python.

        Args:
            name: one of ``functions``, or the name of ``rollout``.
            batch: of its code for many states.

        Raises:
            UnknownNameError: the kernel was built without it.
        """
        if name not in self.functions and (self.rollout is None or name != self.rollout.name):
            raise self.missing(name)
        code = self.ffi.addressof(self.lib, f"{self.name}_{name}{'_batch' if batch else ''}")
        return int(self.ffi.cast("intptr_t", code))

    def compute(self, values: Array, computed: Array) -> None:
        """Compute from the values of the parameters what all functions read.

        Args:
            values: in the order of the parameters, at least one number.
            computed: (hoisted,), at least one number; written.
        """
        self._setup(self.view(values), self.view(computed))

    def drive(self, **fields: Any) -> Any:
        """A new ``NAME_drive``, the argument of a rollout; pointers among the fields must be kept alive."""
        return self.ffi.new(f"{self.name}_drive *", fields)


class Setup:
    """Values of the parameters and what is computed from them; never changed, so that a running call keeps its own.

    Attributes:
        values: in the order of the parameters.
        computed: the numbers that functions read, (hoisted,), or one where there are none.
        pointer: to ``computed``, the first argument of every function.
    """

    def __init__(self, raw: RawKernel, values: Array) -> None:
        self.values = values
        self.computed = np.zeros(max(raw.hoisted, 1), raw.dtype)
        self.pointer = raw.view(self.computed)
        raw.compute(values if values.size else np.zeros(1, raw.dtype), self.computed)

    @property
    def address(self) -> int:
        """Address of ``computed``, which is valid as long as this object is kept."""
        return int(self.computed.ctypes.data)
