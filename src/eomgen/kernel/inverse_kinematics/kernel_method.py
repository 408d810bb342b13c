"""Coordinates of a kernel that bring a frame into a pose."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ...errors import ArrayError, InputError, UnknownNameError
from ...names import joint_of, listed, nearest_or_all, show
from ...runtime.arrays import names_in, numbers_in
from ...runtime.bound import frame_number
from ..by_name import NamedViews
from ..kinematics import Kinematics
from .reaching import GUESSES, Target, search, unreached
from .rotations import Array, rotation_matrices

MOST_STARTS = 100_000
FARTHEST = 1e30  # m: as of all numbers that descriptions may have
POSES = (
    "finite numbers (..., 4, 4) with [0, 0, 0, 1] in the last row, or points (..., 3), with coordinates up to"
    f" {FARTHEST:g} m"
)


class InverseKinematics(Kinematics, NamedViews):
    """Poses of frames, and coordinates that reach them."""

    @property
    def home(self) -> Array:
        """Return the description's home, (n,), m or rad; 0 where it names none."""
        described = self.raw.libraries.meta.get("home", {})
        return np.array([described.get(name, 0.0) for name in self.coordinates], self.dtype)

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Return lower and upper limits, m or rad, of the coordinates that a rigid robot has and may move, by name.

        They are infinite where the description has none, and for those that follow the drives of closed loops.
        Deviations of joints with compliance and prescribed coordinates are not among them.
        """
        ranges: Mapping[str, Sequence[float | None]] = self.raw.libraries.meta.get("ranges", {})
        ends = (-np.inf, np.inf)
        return {
            name: (ends[0] if low is None else low, ends[1] if high is None else high)
            for name, (low, high) in ranges.items()
        }

    def inverse_kinematics(
        self,
        pose: ArrayLike,
        frame: str | None = None,
        *,
        q0: ArrayLike | None = None,
        limits: bool | ArrayLike | Mapping[str, ArrayLike] = True,
        moving: Iterable[str] | None = None,
        starts: int = GUESSES,
    ) -> Array:
        """Return coordinates that bring a frame into a pose, (n,), by the Levenberg-Marquardt method; loops are closed.

        Each step is the least one by the sum of squares of all coordinates' changes, rad and m alike, so that of
        redundant robots the result is near q0.  Where that leads nowhere, or out of the limits, other starts are tried,
        always the same, and steps that end at limits.  Each of several poses is found by itself, to 1e-11 (float32:
        1e-5) m, times the largest coordinate of the point or 1 m, and rad.  Motors turn with their joints.

        Args:
            pose: (4, 4) as ``frame_pose`` has it, base frame, m; or (3,), the frame's origin, whatever its axes; or
                many, (..., 4, 4) or (..., 3).
            frame: one of ``frames``; "tcp" if not given.
            q0: where the search begins, (n,), or one for each pose, (..., n); ``home`` if not given.  With room for
                internal states behind them the result has that, too.
            limits: True for ``limits``, False for none, a mapping from coordinates or joints to lower and upper ones,
                beside those of ``limits``, or both for all, (n, 2).
            moving: names of coordinates or joints that may move; those of ``limits`` if not given (of a robot without
                any: all).  All others stay where q0 has them.
            starts: how many other starting points are tried.

        Returns:
            Coordinates, (n,), or (..., n) of many poses.

        Raises:
            ReachError: a pose is not reached; its message and attributes say by how much, and which limits are in the
                way.
            UnknownNameError: no frame or coordinate of that name.
            ArrayError: an array of another shape, with NaN or infinity, or a pose that is none.
        """
        tool = tool_frame(self, frame)
        targets, lead = targets_of(tool, pose)
        begun = starting_states(self, "q0", self.home if q0 is None else q0, lead)
        between = self._limits(limits, moving)
        if isinstance(starts, bool) or not isinstance(starts, (int, np.integer)) or not 0 <= starts <= MOST_STARTS:
            raise InputError(f"starts: {show(starts)}; allowed: a whole number from 0 to {MOST_STARTS}")
        reached = reach_all(
            self, targets, lead, begun, np.broadcast_to(between, (len(targets), *between.shape)), starts
        )
        for motor, principal in self.motors.items():
            turned = self.ratio(motor) * reached[:, self.coordinates.index(principal)]
            reached[:, self.coordinates.index(motor)] = turned
        return reached.reshape(*lead, len(self.coordinates))

    def _limits(self, limits: bool | ArrayLike | Mapping[str, ArrayLike], moving: Iterable[str] | None) -> Array:
        """Return lower and upper limits, (n, 2), with NaN where a coordinate stays."""
        described = self.limits
        known = dict.fromkeys([*map(joint_of, described), *self.coordinates])
        between = np.tile([-np.inf, np.inf], (len(self.coordinates), 1))
        if isinstance(limits, Mapping) or limits is True:
            for name, ends in described.items():
                between[self.coordinates.index(name)] = ends
        if isinstance(limits, Mapping):
            allowed = "a lower and an upper number, m or rad"
            for name, wanted in limits.items():
                pair = numbers_in(f"limits: {name}", wanted, allowed, finite=False)
                if pair.shape != (2,) or not are_limits(pair):
                    raise ArrayError(f"limits: {name}: {show(wanted)}; allowed: {allowed}")
                for place in self._places("limits", name, known):
                    between[place] = pair
        elif not isinstance(limits, bool):
            between = limits_of_all(self, limits)
        names = (
            list(described or self.coordinates)
            if moving is None
            else names_in("moving", [moving] if isinstance(moving, str) else moving)
        )
        move = {place for name in names for place in self._places("moving", name, known)}
        prescribed = {self.coordinates.index(name) for name in self.prescribed}
        between[[i for i in range(len(between)) if i not in move - prescribed]] = np.nan
        return between

    def _places(self, label: str, name: object, known: Iterable[str]) -> list[int]:
        """Return the places of a coordinate, or of those of a joint that a rigid robot has, by its name."""
        if name in self.coordinates:
            return [self.coordinates.index(str(name))]
        places = [self.coordinates.index(x) for x in self.limits if joint_of(x) == name]
        if not places:
            raise UnknownNameError(f"{label}: {show(name)} is unknown{nearest_or_all(str(name), list(known))}")
        return places


def reach_all(
    kernel: Kinematics,
    targets: Sequence[Target],
    lead: Sequence[int],
    begun: Array,
    limits: Array,
    starts: int = GUESSES,
    remark: Callable[[Target], str] = lambda target: "",
) -> Array:
    """Return coordinates that reach each target, (N, n).

    Args:
        targets: N of them.
        lead: leading axes of what was asked for, for messages.
        begun: where each search begins, (N, n).
        limits: (N, n, 2); NaN where a coordinate stays where it begins.
        starts: how many other starting points are tried.
        remark: what messages about a target end with.

    Raises:
        ReachError: one is not reached.
    """
    solution = np.empty((len(targets), len(kernel.coordinates)), kernel.dtype)
    for k, (target, start, ends) in enumerate(zip(targets, begun, limits, strict=True)):
        between = np.where(np.isnan(ends), start[:, np.newaxis], _held_exactly(ends, kernel.dtype))
        reached, is_there = search(kernel, target, start, between, starts)
        if not is_there:
            place = f" (pose {[int(i) for i in np.unravel_index(k, lead)]})" if len(lead) else ""
            label = f"{target.tool} does not reach {target.text()}{place}"
            raise unreached(kernel, target, reached, between, label, remark=remark(target))
        solution[k] = reached.q
    return solution


def _held_exactly(limits: Array, dtype: np.dtype[np.floating]) -> Array:
    """Return limits that a dtype holds exactly, within them; where it has no number there, both are the nearest one."""
    with np.errstate(over="ignore"):  # what becomes infinite is brought within
        rounded = limits.astype(dtype)
    low, high = rounded[..., 0], rounded[..., 1]
    low = np.where(low < limits[..., 0], np.nextafter(low, dtype.type(np.inf)), low)
    high = np.where(high > limits[..., 1], np.nextafter(high, dtype.type(-np.inf)), high)
    nothing = low > high
    within = np.stack([np.where(nothing, rounded[..., 0], low), np.where(nothing, rounded[..., 0], high)], axis=-1)
    return within.astype(np.float64)


def limits_of_all(kernel: Kinematics, value: ArrayLike) -> Array:
    """Return lower and upper limits of all coordinates, (n, 2).

    Raises:
        ArrayError: they are none; the first pair that is none is named.
    """
    allowed = f"lower and upper numbers, ({len(kernel.coordinates)}, 2), m or rad"
    limits = numbers_in("limits", value, allowed, finite=False)
    if limits.shape != (len(kernel.coordinates), 2):
        raise ArrayError(f"limits: got shape {limits.shape}; allowed: {allowed}")
    for name, pair in zip(kernel.coordinates, limits, strict=True):
        if not are_limits(pair):
            raise ArrayError(f"limits: {name}: {show(pair.tolist())}; allowed: {allowed}")
    return limits


def are_limits(pair: Array) -> bool:
    """Return whether a finite number is between two."""
    low, high = pair
    return bool(low <= high and low < np.inf and high > -np.inf)


def tool_frame(kernel: Kinematics, frame: str | None) -> str:
    """Return the frame that is asked for, "tcp" if None; UnknownNameError where it is not there."""
    if frame is None and "tcp" not in kernel.frames:
        raise UnknownNameError(f"frame: none is called tcp; allowed: {listed(list(kernel.frames))}")
    if frame is not None:
        frame_number(kernel.frames, frame)
    return "tcp" if frame is None else frame


def targets_of(tool: str, pose: ArrayLike) -> tuple[list[Target], tuple[int, ...]]:
    """Return every pose or point that is asked for, and their leading axes.

    Raises:
        ArrayError: they are none.
    """
    numbers = numbers_in("pose", pose, POSES)
    if np.abs(numbers).max(initial=0.0) > FARTHEST:
        raise ArrayError(f"pose: {show(pose)}; allowed: {POSES}")
    if numbers.ndim and numbers.shape[-1] == 3:
        return [Target(tool, point) for point in numbers.reshape(-1, 3)], numbers.shape[:-1]
    if numbers.shape[-2:] != (4, 4):
        raise ArrayError(f"pose: got shape {numbers.shape}; allowed: {POSES}")
    last = numbers[..., 3, :].reshape(-1, 4)
    wrong = last[(last != [0.0, 0.0, 0.0, 1.0]).any(axis=-1)]
    if wrong.size:
        raise ArrayError(f"pose: its last row is {show(wrong[0].tolist())}; allowed: {POSES}")
    lead = numbers.shape[:-2]
    axes = rotation_matrices("pose", numbers[..., :3, :3], lead).reshape(-1, 3, 3)
    points = numbers[..., :3, 3].reshape(-1, 3)
    return [Target(tool, point, R) for point, R in zip(points, axes, strict=True)], lead


def starting_states(kernel: Kinematics, label: str, value: ArrayLike, lead: Sequence[int]) -> Array:
    """Return a state to begin from for each pose, (N, n), of one for all or one for each.

    Raises:
        ArrayError: they are none; the message begins with the label.
    """
    n = len(kernel.coordinates)
    whole = (*lead, n)
    allowed = f"finite numbers ({n},){f' or {whole}' if len(lead) else ''}"
    states = numbers_in(label, value, allowed)
    if states.shape not in ((n,), whole):
        raise ArrayError(f"{label}: got shape {states.shape}; allowed: {allowed}")
    largest = np.finfo(kernel.dtype).max
    if (np.abs(states) > largest).any():
        raise ArrayError(f"{label}: {show(value)}; allowed: {allowed}, up to {largest:.2g} ({kernel.dtype})")
    return np.broadcast_to(states, whole).reshape(-1, n)
