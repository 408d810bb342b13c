"""A kernel's functions beside those that C has for their derivatives.

A generated package carries a copy of this file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, UnknownNameError
from ..names import nearest_or_all, show
from .arrays import names_in
from .calls import Calls
from .parameters import Parameters

Array = NDArray[Any]

ADJOINT, TANGENT, HESSIAN = "adjoint", "tangent", "hessian"
BY_PARAMETERS = "parameter_"
KINDS = (ADJOINT, TANGENT, HESSIAN, f"{BY_PARAMETERS}{ADJOINT}", f"{BY_PARAMETERS}{TANGENT}")  # ends of names
COTANGENT = "cotangent"
FRAMED = ("poses", "jacobians")  # results of all frames at once
CLOSED = (  # functions that refuse states in which loops are open
    "inverse_dynamics",
    "inverse_dynamics_under_load",
    "forward_dynamics",
    "constraint_forces",
    "reactions",
    "reactions_under_load",
    "loop_reactions",
    "loop_reactions_under_load",
)


@dataclass(frozen=True)
class Differentiated:
    """A function of a kernel with its derivatives.

    Attributes:
        calls: of the kernel.
        name: the function's.
        reads: names of the arrays that it reads.
        writes: name of what its derivatives take it to write; for a function of a frame that is of all frames.
        frame_index: gives a frame's number by its name.
    """

    calls: Calls
    name: str
    reads: tuple[str, ...]
    writes: str
    frame_index: Callable[[str], int]

    @classmethod
    def of(cls, calls: Calls, name: str, frame_index: Callable[[str], int]) -> Differentiated:
        """The function of that name.

        Raises:
            UnknownNameError: the kernel was built without its derivatives.
        """
        known = calls.raw.functions
        kinds = [kind for kind in KINDS if f"{name}_{kind}" in known]
        if not kinds:
            ends = [(x, kind) for x in known for kind in reversed(KINDS) if x.endswith(f"_{kind}")]
            given = sorted({x.removesuffix(f"_{kind}").removesuffix("_parameter") for x, kind in ends})
            raise UnknownNameError(
                f"{calls.raw.name} was built without derivatives of {show(name)}{nearest_or_all(str(name), given)}"
            )
        found = known[f"{name}_{kinds[0]}"]
        if not kinds[0].endswith(TANGENT):
            *reads, weights = found.reads
            return cls(calls, name, tuple(reads), weights.removeprefix(f"{COTANGENT}_"), frame_index)
        arrays = len(found.reads) // 2 if kinds[0] == TANGENT else len(found.reads) - 1
        return cls(calls, name, found.reads[:arrays], found.writes, frame_index)

    @property
    def is_framed(self) -> bool:
        """True if it takes a frame's name behind its arrays."""
        return self.writes in FRAMED

    def shape(self, label: str) -> tuple[int, ...]:
        """Shape of an array for one state."""
        return self.calls.raw.shapes[label]

    def state(self, args: Sequence[Any]) -> tuple[list[ArrayLike], int | None]:
        """The arrays of its arguments, and the number of the frame.

        Raises:
            InputError: another number of arguments.
            UnknownNameError: no frame of that name.
            LoopError: the function refuses such a state, as its loops are open.
        """
        wanted = (*self.reads, "frame") if self.is_framed else self.reads
        if not isinstance(args, (tuple, list)) or len(args) != len(wanted):
            raise InputError(f"{self.name}: got {number_of(args)} arguments; allowed: ({', '.join(wanted)})")
        arrays, frame = list(args[: len(self.reads)]), None
        if self.is_framed:
            frame = self.frame_index(args[-1])
        if self.name in CLOSED and self.calls.raw.libraries.meta.get("constraints"):
            self.calls.run(self.name, None, arrays)
        return arrays, frame

    def run(self, kind: str, arrays: Sequence[ArrayLike], inner: int = 0) -> Array:
        """Call one of its derivatives; the last ``inner`` leading axes are no states' own.

        Raises:
            UnknownNameError: the kernel was built without it.
        """
        if f"{self.name}_{kind}" not in self.calls.raw.functions:
            raise self.calls.raw.missing(f"{self.name}_{kind}")
        return self.calls.run(f"{self.name}_{kind}", None, arrays, inner=inner)

    def weights(self, cotangent: ArrayLike, frame: int | None) -> Array:
        """Weights of the results as derivatives read them.

        Raises:
            ArrayError: another shape or dtype than the function's result.
        """
        if frame is None:
            return self.calls.array(COTANGENT, cotangent, self.shape(self.writes))[0]
        frames, *inner = self.shape(self.writes)
        outer = (4, 4) if self.writes == "poses" else tuple(inner)
        given, lead = self.calls.array(COTANGENT, cotangent, outer)
        whole = np.zeros((*lead, frames, *inner), self.calls.dtype)
        whole[..., frame, :, :] = given[..., : inner[0], :]
        return whole

    def part(self, result: Array, frame: int | None) -> Array:
        """The function's own result, of one for all frames; derivatives of a pose's last row are zero."""
        if frame is None:
            return result
        own: Array = result[..., frame, :, :]
        if self.writes != "poses":
            return own
        return np.concatenate([own, np.zeros_like(own[..., :1, :])], axis=-2)

    def rows(self, gradient: Array) -> tuple[Array, ...]:
        """A gradient's parts by the arguments, in their shapes."""
        found, begin = list[Array](), 0
        for label in self.reads:
            shape = self.shape(label)
            end = begin + math.prod(shape)
            found.append(gradient[..., begin:end].reshape(*gradient.shape[:-1], *shape))
            begin = end
        return tuple(found)


def parameter_slots(parameters: Parameters, names: Sequence[str]) -> list[int]:
    """Places of parameters by their names.

    Raises:
        InputError: a text instead of a sequence of names, or a name given twice.
        UnknownNameError: not a run-time parameter.
    """
    names = names_in("parameters", names)
    known = {name: slot for slot, name in enumerate(parameters)}
    for name in names:
        if name not in known:
            raise UnknownNameError(f"parameters: {name!r} is unknown{nearest_or_all(str(name), known)}")
    if len(set(names)) < len(names):
        raise InputError(f"parameters: {', '.join(names)}; allowed: every name once")
    return [known[name] for name in names]


def number_of(values: Any) -> str:
    """Say how many values there are, or what they are instead of several."""
    return str(len(values)) if isinstance(values, (tuple, list)) else type(values).__name__
