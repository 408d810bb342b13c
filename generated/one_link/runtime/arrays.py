"""Arrays on their way to the C of a kernel and back: shapes, dtypes, leading axes, and numbers that are not finite."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ArrayError, InputError
from ..names import DriveInput, plain_input, show
from .raw import Array, RawFunction, RawKernel

Lead = tuple[int, ...]  # axes in front of a state's: () for one state, (N,) for N of them

WRENCHES = ("wrench", "dwrench")  # arguments with rows of links
WEIGHTS, NUMBERED = "cotangent", ("dp", "multipliers")  # arguments whose elements have numbers, no names
WRENCH_PARTS = ("force.x", "force.y", "force.z", "moment.x", "moment.y", "moment.z")
BY_COORDINATE = {  # how many of the last axes of a result are coordinates
    "vector": 1,
    "rate_vector": 1,
    "momenta": 1,
    "matrix": 2,
    "tensor": 3,
    "derivatives": 2,
    "jacobian": 1,
    "jacobians": 1,
    "constraint_rows": 1,
    "spring_rows": 1,
    "element_rows": 1,
}
WITH_STATES = {"rate_vector": 1, "derivatives": 2}  # of these axes those behind which internal states stand
OF_STATES = re.compile(r"^d?z\d?$")  # arguments that are internal states, their rates or time derivatives
BESIDE_DRIVES = re.compile(r"^d?forces\d?$")  # arguments that are forces beside drives with states

OF_ORDERS = re.compile(r"^jet\d_")  # begins names of results with time derivatives


def inputs_of(meta: Mapping[str, Any]) -> dict[str, DriveInput]:
    """Return what u means at each coordinate of a kernel, in their order; of prescribed ones it is an acceleration."""
    servos, prescribed = meta.get("inputs", {}), meta["prescribed"]
    return {
        name: DriveInput(*servos[name][:2]) if name in servos else plain_input(name, is_prescribed=name in prescribed)
        for name in meta["coordinates"]
    }


class Arrays:
    """Checks of a kernel's arguments and results, and the errors that name what is wrong with them."""

    def __init__(self, raw: RawKernel, coordinates: tuple[str, ...], links: tuple[str, ...]) -> None:
        self.dtype, self.coordinates, self.links, self._shapes = raw.dtype, coordinates, links, raw.shapes
        self._states: tuple[str, ...] = tuple(raw.libraries.meta.get("internal_states", ()))
        self.drives: tuple[str, ...] = tuple(raw.libraries.meta.get("inputs", ()))
        self.has_drives = bool(self.drives)
        self._followers = tuple(raw.libraries.meta.get("followers", ()))
        self._bits = np.finfo(raw.dtype).nmant + 1  # of the whole numbers that are all held exactly

    def beside_drives(self, u: Array, forces: Array) -> tuple[Array, Array | None]:
        """Return u, (..., n), with generalized forces, (..., n), that act in addition to drives.

        Where a drive has states, u is its input, and the force beside it stands in a second array, (..., drives), None
        without such drives.
        """
        if not self.drives:
            return u + forces, None
        places = [self.coordinates.index(name) for name in self.drives]
        beside, rest = forces[..., places], forces.copy()
        rest[..., places] = 0.0
        return u + rest, np.ascontiguousarray(beside)

    def taken(self, label: str, value: ArrayLike, shape: tuple[int, ...], checks: bool) -> tuple[Array, Lead]:
        """Convert a value to a C-contiguous array of the kernel's dtype; return it and the axes in front of a state's.

        Raises:
            ArrayError: another shape, a number that the dtype cannot hold exactly, or NaN or infinity.
        """
        if type(value) is np.ndarray and value.dtype == self.dtype and value.flags.c_contiguous and value.flags.aligned:
            array = value
        else:
            array = self._converted(label, value, shape)
        actual = array.shape
        if actual == shape:
            lead: Lead = ()
        elif actual[-len(shape) :] == shape:
            lead = actual[: -len(shape)]
        else:
            raise ArrayError(
                f"{label}: expected {self._expected(shape)}, got shape {actual}{self._said(actual, shape)}"
            )
        if checks and not is_finite(array):
            self.refuse_not_finite(label, array, shape)
        return array, lead

    def _said(self, actual: Lead, shape: tuple[int, ...]) -> str:
        """Name what follows other coordinates where it may be what an array has too many numbers for."""
        more = (*shape[:-1], shape[-1] + len(self._followers))
        if not self._followers or actual[-len(shape) :] != more:
            return ""
        said = "follow others and are no coordinates" if len(self._followers) > 1 else "follows others and is none"
        return f" ({', '.join(self._followers)} {said}; see kernel.coordinates and kernel.followers)"

    def refuse_not_finite(self, label: str, array: Array, shape: tuple[int, ...], place: str = "") -> None:
        """Refuse NaN and infinity in an argument of a kernel, or in many of them.

        Args:
            label: its name; one of WRENCHES has rows of links, everything else numbers of coordinates.

        Raises:
            ArrayError: there is such a number; coordinate, state and step of the first one are named.
        """
        if is_finite(array):
            return
        where = tuple(np.argwhere(~np.isfinite(array))[0].tolist())
        name = self.names(label)[where[-1]] if self.is_by_name(label) else ""
        element = self._element(label, where, shape)
        raise ArrayError(f"{label}: {element} is {array[where]}{place}; numbers must be finite", name)

    def overflow(
        self, function: RawFunction, result: Array, shape: tuple[int, ...], arguments: Sequence[tuple[str, Array]]
    ) -> ArrayError:
        """Return the error that a result of finite numbers is not finite: which entry, and the largest argument.

        Args:
            arguments: label and array of each; of a batch the rows of states, or the state that stands for all.
        """
        where = tuple(np.argwhere(~np.isfinite(result))[0].tolist())
        lead, inner = where[: len(where) - len(shape)], where[len(where) - len(shape) :]
        state = int(np.ravel_multi_index(lead, result.shape[: len(lead)])) if lead else 0
        named = len(inner) - coordinate_axes(function.writes)
        names = [(*self.coordinates, *self._states)[i] for i in inner[named:]]
        entry = [f"[{', '.join(map(str, inner[:named]))}]"] if named else []
        overflowed = f"{' '.join([*entry, *names])}{place_of(lead)} is {result[where]}"
        largest, most = "", -1.0
        for label, array in arguments:
            block = array[state] if array.ndim > len(self._shapes[label]) else array
            at = np.unravel_index(np.abs(block).argmax(), block.shape)
            if abs(block[at]) > most:
                most = abs(block[at])
                largest = f"{self._element(label, tuple(map(int, at)), block.shape)} = {block[at]:g} in {label}"
        return ArrayError(
            f"{function.name}: {overflowed}, out of numbers that are finite; the largest is {largest}, and {self.dtype}"
            f" ends at {np.finfo(self.dtype).max:.2g}",
            names[0] if names else "",
        )

    def checked_out(self, out: Array, shape: tuple[int, ...], arrays: Sequence[Array]) -> Array:
        """Check the array to write to, and return it.

        Args:
            arrays: what is read meanwhile.

        Raises:
            ArrayError: it is no such array, or overlaps what is read.
        """
        if not isinstance(out, np.ndarray):
            raise ArrayError(f"out: expected a NumPy array, got {type(out).__name__}")
        if out.shape != shape or out.dtype != self.dtype:
            raise ArrayError(f"out: expected {self.dtype} of shape {shape}, got {out.dtype} of shape {out.shape}")
        if not out.flags.c_contiguous or not out.flags.writeable:
            raise ArrayError("out: expected a C-contiguous array that can be written, got one that is not")
        if not out.flags.aligned:  # C may only write numbers where numbers of their size begin
            raise ArrayError(f"out: expected an array that is aligned for {self.dtype}, got one that is not")
        if any(np.may_share_memory(out, array) for array in arrays):
            raise ArrayError("out: overlaps an argument; give it separate memory")
        return out

    def written(self, result: Array, out: Array | None) -> Array:
        """Return a result, in ``out`` if there is one; errors as of ``checked_out``."""
        if out is None:
            return result
        out = self.checked_out(out, result.shape, ())
        out[...] = result
        return out

    def _converted(self, label: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
        try:
            array = np.asarray(value)
        except (ValueError, TypeError, OverflowError) as error:
            raise ArrayError(
                f"{label}: expected {self._expected(shape)}, got {type(value).__name__} ({error})"
            ) from None
        if is_masked(value):
            raise ArrayError(f"{label}: expected {self._expected(shape)}, got a masked array; fill what is masked")
        plain = not isinstance(value, np.ndarray) and array.dtype in (np.float64, np.int64)  # Python's own numbers
        if array.dtype.kind not in "fiub" or not (plain or np.can_cast(array.dtype, self.dtype, "safe")):
            raise ArrayError(
                f"{label}: expected {self._expected(shape)}, got dtype {array.dtype},"
                f" which {self.dtype} cannot hold exactly"
            )
        rounded = _first_rounded(_whole_numbers(value, array, self._bits), self._bits)
        if rounded is not None:
            raise ArrayError(f"{label}: {show(rounded)} is a whole number that {self.dtype} cannot hold exactly")
        with np.errstate(over="ignore"):  # what becomes infinite is refused by its name
            return np.require(array, self.dtype, ("C", "A"))

    def _expected(self, shape: tuple[int, ...]) -> str:
        inner = ", ".join(map(str, shape))
        comma = "," if len(shape) == 1 else ""
        return f"{self.dtype} of shape ({inner}{comma}) or (..., {inner})"

    @staticmethod
    def is_by_name(label: str) -> bool:
        """Whether an argument has a number for each of some names; not weights of results, and rates of parameters."""
        return label not in (*WRENCHES, *NUMBERED) and not label.startswith(WEIGHTS)

    def names(self, label: str) -> tuple[str, ...]:
        """Name the numbers of such an argument: coordinates, internal states, or coordinates of drives with states."""
        if OF_STATES.match(label):
            return self._states
        return self.drives if BESIDE_DRIVES.match(label) else (*self.coordinates, *self._states)

    def axes_with_states(self, writes: str) -> int:
        """Return how many of the last axes of a result have internal states behind the coordinates."""
        return axes_with_states(writes) if self._states else 0

    def _element(self, label: str, where: tuple[int, ...], shape: tuple[int, ...]) -> str:
        inner = where[-len(shape) :]
        if label in WRENCHES:
            text = f"{WRENCH_PARTS[inner[1]]} of link {self.links[inner[0]]}"
        elif not self.is_by_name(label):
            text = f"[{', '.join(map(str, inner))}]"
        else:
            text = self.names(label)[inner[-1]] + (f" in step {inner[0]}" if len(inner) > 1 else "")
        return text + place_of(where[: -len(shape)])


def flag(label: str, value: Any) -> bool:
    """Return a truth value; InputError, which begins with the label, of anything else."""
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    raise InputError(f"{label}: {show(value)} is neither True nor False")


def names_in(label: str, value: Any) -> list[str]:
    """Return names as a list; InputError, which begins with the label, of anything but texts in a row."""
    try:
        names = None if isinstance(value, (str, bytes)) else list(value)
    except TypeError:  # arrays without axes are iterables, too
        names = None
    if names is None:
        raise InputError(f"{label}: {show(value)}; allowed: a sequence of names")
    for name in names:
        if not isinstance(name, str):
            raise InputError(f"{label}: {show(name)} is no name; allowed: a sequence of names")
    return names


def numbers_in(label: str, value: Any, allowed: str, *, finite: bool = True) -> Array:
    """Return a value as a new array of float64, of whatever shape.

    Args:
        label, allowed: begin and end the message.
        finite: whether NaN and infinity are refused.

    Raises:
        ArrayError: it is no array of real numbers, some are masked, or one is not finite.
    """
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, OverflowError):
        array = np.zeros(0, object)
    if array.dtype.kind not in "fiub" or is_masked(value):
        raise ArrayError(f"{label}: {show(value)}; allowed: {allowed}")
    with np.errstate(over="ignore"):  # of wider numbers; what becomes infinite is refused
        numbers = np.array(array, np.float64)
    if finite and not np.isfinite(numbers).all():
        raise ArrayError(f"{label}: {show(value)} has numbers that are not finite; allowed: {allowed}")
    return numbers


def is_masked(value: Any) -> bool:
    """Return True of NumPy's masked arrays, without an import of them; pandas has methods of that name."""
    return isinstance(value, np.ndarray) and getattr(value, "mask", None) is not None


def is_finite(array: Array) -> bool:
    """Return True if no number is NaN or infinite."""
    return 0 not in np.isfinite(array).tobytes()  # a quarter of the time of all() for few numbers


def joint_lead(label: str, leading: Lead, lead: Lead) -> Lead:
    """Return the leading axes of a result whose arguments have ``leading`` and ``lead``, by NumPy's rules.

    Raises:
        ArrayError: they do not go together.
    """
    try:
        return np.broadcast_shapes(leading, lead)
    except ValueError:
        pass
    if len(leading) == len(lead) == 1:
        raise ArrayError(f"{label}: {leading[0]} states, but {lead[0]} in other arrays")
    raise ArrayError(f"{label}: leading axes {leading} do not go together with {lead} of other arrays")


def rows_of(array: Array, shape: tuple[int, ...], lead: Lead) -> Array:
    """Return an argument of many states as rows of them, or as one state that stands for all.

    Args:
        array: (..., *shape), its leading axes go together with ``lead``.
        lead: the leading axes of the result, at least one.
    """
    leading = array.shape[: array.ndim - len(shape)]
    if leading == lead:
        return array if len(lead) == 1 else array.reshape(math.prod(lead), *shape)
    if math.prod(leading) == 1:
        return array.reshape(shape)
    whole = np.ascontiguousarray(np.broadcast_to(array, (*lead, *shape)))
    return whole.reshape(math.prod(lead), *shape)


def axes_with_states(writes: str) -> int:
    """Return how many of the last axes of a result of that kind have internal states behind the coordinates."""
    return WITH_STATES.get(OF_ORDERS.sub("", writes), 0)


def coordinate_axes(writes: str) -> int:
    """Return how many of the last axes of a result of that kind are coordinates."""
    return BY_COORDINATE.get(OF_ORDERS.sub("", writes), 0)


def place_of(state: Sequence[int]) -> str:
    """Say which of many states one is, by its indices: " in state 3", " in state (1, 2)"; nothing of one alone."""
    if not len(state):
        return ""
    return f" in state {state[0]}" if len(state) == 1 else f" in state ({', '.join(map(str, state))})"


def _whole_numbers(value: ArrayLike, array: Array, bits: int) -> Array:
    """Return whole numbers that a value has, as far as they may have been rounded on their way into its array.

    An array has them itself; a sequence of Python's numbers becomes one of floats where one of them is a float.
    """
    if array.dtype.kind in "iu":
        return array if array.dtype.itemsize * 8 > bits else array[:0]
    if isinstance(value, np.ndarray) or array.dtype.kind != "f" or not (np.abs(array) >= 2.0**bits).any():
        return np.zeros(0, np.int64)
    return np.array([x for x in np.asarray(value, object).ravel() if isinstance(x, (int, np.integer))], object)


def _first_rounded(numbers: Array, bits: int) -> int | None:
    """Return the first of many whole numbers that has more bits between its ends than a float, or None."""
    large = numbers[(numbers > 2**bits) | (numbers < -(2**bits))]
    odd = large // (large & -large)  # without the zeros at the end
    rounded = large[np.abs(odd) >= 2**bits]
    return int(rounded[0]) if rounded.size else None
