"""Functions of a kernel as its methods call them: checked, with wrenches, with loops closed or cut."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ArrayError, UnknownNameError
from ..names import listed, nearest_or_all, parameter_name, show
from .arrays import flag, joint_lead, numbers_in
from .calls import TREE, Calls
from .parameters import kernel_of
from .raw import Array, RawFunction, RawKernel

FRAME, WRENCH, Z, CUT, OUT = "frame", "wrench", "z", "cut", "out"  # names of arguments
PARTS = ("jet", "derivatives")  # kinds of functions, or of results, whose result is a tuple of arrays
WrenchLike = ArrayLike | Mapping[str, ArrayLike]  # rows of links, (links, 6), or wrenches by frame or link
ALLOWED = "six finite numbers, (6,) or (..., 6): force (N), then moment (N m)"


@dataclass(frozen=True)
class CheckedFunction:
    """A function that is called in Python, which checks all arguments.

    Attributes:
        name: the function's.
        labels: names of its arguments, arrays and options, in their order.
        positional: how many of them may be given without their names.
        axes: axes of each array of a result that is a tuple of arrays, beginning with theirs; 0 of one array.
    """

    name: str
    labels: tuple[str, ...]
    positional: int
    axes: int

    @classmethod
    def of(cls, raw: RawKernel, name: str) -> CheckedFunction:
        """Return the function of that name, which may be there for the open tree alone.

        Raises:
            UnknownNameError: the kernel was built without it.
        """
        function = function_of(raw, name)
        if function is None:
            raise raw.missing(name)
        options = (*((FRAME,) if function.is_framed else ()), *sorted(function.takes, key=lambda x: x != Z))
        labels = (*function.arguments, *options, *((CUT,) if name not in raw.functions else ()), OUT)
        return cls(name, labels, len(labels), axes_of_parts(raw, function))

    def __call__(self, calls: Calls, /, *args: Any, **options: Any) -> Any:
        """Call it with a kernel's ``Calls``, arrays and options."""
        function = function_of(calls.raw, self.name)
        if function is None:
            raise calls.raw.missing(self.name)
        given = dict(zip(self.labels, args, strict=False)) | options
        result = evaluate(calls, self.name, [given.pop(x) for x in function.arguments], **given)
        return tuple(np.moveaxis(result, -self.axes, 0)) if self.axes else result


def axes_of_parts(raw: RawKernel, function: RawFunction | None) -> int:
    """Return the axes of each array of a function's result, see ``CheckedFunction``; 0 without a function."""
    in_parts = function is not None and not {function.kind, function.writes}.isdisjoint(PARTS)
    return len(raw.shapes[function.writes]) if function is not None and in_parts else 0


def function_of(raw: RawKernel, name: str) -> RawFunction | None:
    """Return the function of that name, which may be there for the open tree alone; None where there is none."""
    return raw.functions.get(name) or raw.functions.get(f"{TREE}{name}")


class CalledInPython(partial[Any]):
    """A ``CheckedFunction`` for a kernel's calls."""

    def __init__(self, checked: CheckedFunction, calls: Calls) -> None:
        self.checked = checked
        self.__name__ = checked.name

    def __repr__(self) -> str:
        return f"<{self.checked.name} of {self.args[0].raw.name}>"

    def __get__(self, instance: Any, owner: type | None = None) -> CalledInPython:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        calls: Calls = self.args[0]
        _, made = calls.parameters.__reduce__()
        return _method_again, (self.checked.name, calls.threads, calls.checks, made)


def _method_again(name: str, threads: int, checks: bool, made: tuple[Any, ...]) -> Any:
    """Return a method of a kernel that is made again, of one that was pickled."""
    kernel = kernel_of(*made)
    kernel.threads, kernel.checks = threads, checks
    return getattr(kernel if hasattr(type(kernel), name) else kernel.functions, name)


def evaluate(
    calls: Calls,
    name: str,
    values: Sequence[Any],
    *,
    frame: str | None = None,
    wrench: WrenchLike | None = None,
    z: ArrayLike | None = None,
    cut: bool = False,
    out: Array | None = None,
) -> Array:
    """Compute a function as the method of its name does; see ``Kernel`` for arguments and errors."""
    meta, function = calls.raw.libraries.meta, calls.raw.functions.get(name)
    is_closed = bool(meta.get("constraints"))
    if flag(CUT, cut) and is_closed:
        return evaluate(calls, calls.of_tree(name), values, wrench=wrench, z=z, out=out)
    if function is None:
        raise calls.raw.missing(name)
    if function.is_framed:
        return calls.run(name, out, values, (frame_number(meta["frames"], frame),))
    if WRENCH in function.reads:
        values = [wrench_rows(calls, values[0], x) if i else x for i, x in enumerate(values)]
    if wrench is not None and function.loaded and is_closed:
        loaded, external = function.loaded
        values = (*values, evaluate(calls, external, (values[0], wrench)))
        return evaluate(calls, loaded, values, wrench=wrench, z=z, out=out)
    if wrench is None or function.wrench is None:
        return calls.run(name, out, values, z=z)
    if not function.wrench.into:
        return calls.run_with_wrench(name, out, values, wrench_rows(calls, values[0], wrench), z)
    values, forces = with_wrench(calls, name, values, wrench)
    return calls.run(name, out, calls.arguments(name, values, z, forces))


def with_wrench(calls: Calls, name: str, values: Sequence[Any], wrench: WrenchLike) -> tuple[list[Any], Array | None]:
    """Return arguments with the generalized forces of wrenches, and forces beside drives with states.

    Of a prescribed coordinate its acceleration stays.
    """
    function = calls.raw.functions[name]
    assert function.wrench is not None
    place = function.arguments.index(function.wrench.into)
    external = evaluate(calls, function.wrench.function, (values[0], wrench))
    drives, lead = calls.array(function.wrench.into, values[place], external.shape[-1:])
    joint_lead(function.wrench.into, lead, external.shape[:-1])
    external[..., [calls.coordinates.index(x) for x in calls.prescribed]] = 0
    total, forces = calls.arrays.beside_drives(drives, external)
    return [*values[:place], total, *values[place + 1 :]], forces


def frame_number(frames: Sequence[str], name: str | None) -> int:
    """Return the number of a frame or link.

    Raises:
        UnknownNameError: no frame or link of that name.
    """
    if not isinstance(name, str) or name not in frames:
        raise UnknownNameError(f"frame: {show(name)} is unknown{nearest_or_all(str(name), frames)}")
    return frames.index(name)


class Place(NamedTuple):
    """Place of a wrench: the link's row, its number among the frames, and the arm from its centre of mass, (3,), m.

    The arm is in the link's axes; None is at the centre of mass.
    """

    link: int
    frame: int
    arm: Array | None


def wrench_rows(calls: Calls, q: ArrayLike, wrench: WrenchLike | None) -> ArrayLike | None:
    """Return rows of links, (..., links, 6), about centres of mass in the base frame; what is no mapping as it came.

    Args:
        calls: of a kernel with kinematics, where wrenches are at frames.
        q: (n,) or (..., n).
        wrench: by name, (6,) or (..., 6), base frame: at a frame's origin, or about a link's centre of mass.

    Raises:
        UnknownNameError: a name is none of a frame or link that moves.
        ArrayError: a wrench is not six finite numbers, or does not go together with q.
    """
    if not isinstance(wrench, Mapping):
        return wrench
    values = {name: (place_of_wrench(calls, name), wrench_numbers(calls, name, x)) for name, x in wrench.items()}
    states, lead = calls.array("q", q, (calls.n,))
    for name, (_, numbers) in values.items():
        lead = joint_lead(f"wrench: {name}", numbers.shape[:-1], lead)
    rows = np.zeros((*lead, len(calls.raw.libraries.meta["links"]), 6), calls.dtype)
    for place, numbers in values.values():
        rows[..., place.link, :] += numbers
        if place.arm is not None:
            R_0k = calls.run(calls.raw.writing("pose").name, None, (states,), (place.frame,))[..., :3, :3]
            rows[..., place.link, 3:] += np.cross(R_0k @ place.arm, numbers[..., :3])
    return rows


def place_of_wrench(calls: Calls, name: str) -> Place:
    """Return the place of a wrench by name; UnknownNameError where there is nothing that moves."""
    meta = calls.raw.libraries.meta
    links, frames = list(meta["links"]), list(meta["frames"])
    carriers: Mapping[str, str] = meta.get("frame_links", {})
    known = [*(frame for frame, link in carriers.items() if link in links), *links]
    if name not in known:
        if name in frames:
            raise UnknownNameError(f"wrench: {show(name)} does not move; allowed: {listed(known)}")
        raise UnknownNameError(f"wrench: {show(name)} is unknown{nearest_or_all(str(name), known)}")
    if name not in carriers:
        return Place(links.index(name), frames.index(name), None)
    link = carriers[name]
    if link in carriers or name in links:
        both = link if link in carriers else name
        raise UnknownNameError(
            f"wrench: {show(name)}: {show(both)} names a frame and a link; allowed: another name for the frame, or an"
            f" array of shape ({len(links)}, 6)"
        )
    zero = np.zeros(calls.n, calls.dtype)
    T_0f, T_0k = (calls.run(calls.raw.writing("pose").name, None, (zero,), (frames.index(x),)) for x in (name, link))
    arm = T_0k[:3, :3].T @ (T_0f[:3, 3] - T_0k[:3, 3]) - _centre_of_mass(calls, link)
    return Place(links.index(link), frames.index(link), np.asarray(arm, calls.dtype))


def _centre_of_mass(calls: Calls, link: str) -> Array:
    """Return a link's centre of mass in its axes, (3,), m, with the parameters of now."""
    described = calls.raw.libraries.meta["coms"][link]
    names = [parameter_name("links", link, "com", axis) for axis in "xyz"]
    return np.array([calls.parameters.get(name, x) for name, x in zip(names, described, strict=True)], calls.dtype)


def wrench_numbers(calls: Calls, name: str, value: Any) -> Array:
    """Return a wrench as an array of the kernel's dtype, (6,) or (..., 6)."""
    numbers = numbers_in(f"wrench: {name}", value, ALLOWED, finite=calls.checks)
    if not numbers.ndim or numbers.shape[-1] != 6:
        raise ArrayError(f"wrench: {name}: got {show(value)}; allowed: {ALLOWED}")
    with np.errstate(over="ignore"):
        return np.asarray(numbers, calls.dtype)
