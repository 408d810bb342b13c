"""Coordinates of a robot whose tool is in a pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import ArrayError, InputError, UnknownNameError
from ..names import nearest, show
from ..robot.mechanism import leading_home
from ..robot.model import program_coordinates, tool_of
from ..robot.value import Robot
from ..runtime.kernel import Kernel
from ..state.motors import turn_motors
from ..state.vectors import as_floats, prescribed_mask
from .ends import default_ends, limits_beside
from .reaching import Target, search, within_limits
from .tool_path import unreached
from .turns import rotation_matrices


def inverse_kinematics(
    kernel: Kernel,
    pose: ArrayLike,
    *,
    robot: Robot | None = None,
    frame: str | None = None,
    guess: ArrayLike | None = None,
    limits: bool | ArrayLike = True,
) -> Array:
    """Return coordinates that bring a frame into a pose, (n,): those to which the least change from the guess leads.

    Where the guess leads nowhere, or out of the limits, 40 other starts are tried, always the same, and steps that end
    at limits.  Redundant robots take the least steps, by the sum of squares of all coordinates' changes, rad and m
    alike.  Loops are closed.  Each of several poses is solved for by itself.

    Args:
        kernel: float64, with kinematics; of a mechanism with loops with all that ``close`` takes, and mass_matrix.
        pose: (4, 4) as ``frame_pose`` has it, base frame, m; or (3,), the frame's origin, whatever its axes; or
            several, (..., 4, 4) or (..., 3).
        robot: whose kernel it is: its driven coordinates move, and of a mechanism those that follow; deviations stay
            where the guess has them, and motors turn with their joints.  Without it all coordinates move that are not
            prescribed.
        frame: or link; default as in ``simulate``, without a robot "tcp" or the first.
        guess: coordinates, (n,), or as many as there are poses, (..., n); default the description's home, where it
            has none the middle of a default motion; 0 without a robot.
        limits: True for those of the robot (none without it), False for none, or lower and upper ones, (n, 2): a
            coordinate whose limits are equal stays at its guess, which has to be there.

    Returns:
        Coordinates, (n,) or (..., n).

    Raises:
        ReachError: the pose is not reached; says by how much, and which limits keep the tool away.
        ArrayError: an array of a wrong shape, with NaN or infinity, or a pose that is none.
        UnknownNameError: there is no such frame.
        InputError: the robot has other coordinates than the kernel, or the kernel is of float32.
    """
    if kernel.dtype != np.float64:
        raise InputError(f"{kernel.name}: a kernel of {kernel.dtype}; allowed: one of float64")
    known = set() if robot is None else set(program_coordinates(robot))
    if robot is not None and not known <= set(kernel.coordinates):
        raise InputError(f"robot: {robot.name} has other coordinates than {kernel.name}; allowed: the kernel's robot")
    tool = _frame(kernel, robot, frame)
    targets, lead = _targets(tool, pose)
    starts = _starts(kernel, robot, guess, lead)
    solutions = np.empty((len(targets), kernel.n))
    for k, (target, start) in enumerate(zip(targets, starts, strict=True)):
        between = _between(kernel, robot, known, start, limits)
        reached = search(kernel, target, start, between)
        if not (reached.is_there and within_limits(reached.q, between)):
            place = f" (pose {[int(i) for i in np.unravel_index(k, lead)]})" if lead else ""
            label = f"{tool} does not reach {target.text()}{place}"
            raise unreached(kernel, target, reached, between, label)
        solutions[k] = reached.q
        if robot is not None:
            turn_motors(kernel, solutions[k], ())
    return solutions.reshape(*lead, kernel.n)


def _frame(kernel: Kernel, robot: Robot | None, frame: str | None) -> str:
    if frame is None:
        if robot is not None:
            return tool_of(robot, None)
        return "tcp" if "tcp" in kernel.frames else kernel.frames[0]
    if frame not in kernel.frames:
        known = ", ".join(kernel.frames)
        raise UnknownNameError(f"frame: {show(frame)}{nearest(frame, kernel.frames)} is unknown; known: {known}")
    return frame


def _targets(tool: str, pose: ArrayLike) -> tuple[list[Target], tuple[int, ...]]:
    """Return every pose or point that is asked for, and their leading axes."""
    poses = as_floats(pose)
    if poses.ndim and poses.shape[-1] == 3 and np.isfinite(poses).all():
        return [Target(tool, point) for point in poses.reshape(-1, 3)], poses.shape[:-1]
    whole = poses.ndim > 1 and poses.shape[-2:] == (4, 4) and np.isfinite(poses).all()
    if not whole or np.abs(poses[..., 3, :] - [0.0, 0.0, 0.0, 1.0]).max(initial=0.0) > 0.0:
        raise ArrayError(
            f"pose: got shape {poses.shape}; allowed: finite numbers (..., 4, 4) with [0, 0, 0, 1] in the last row, or"
            " points (..., 3)"
        )
    lead = poses.shape[:-2]
    axes = rotation_matrices("pose", poses[..., :3, :3], lead).reshape(-1, 3, 3)
    points = poses[..., :3, 3].reshape(-1, 3)
    return [Target(tool, point, R) for point, R in zip(points, axes, strict=True)], lead


def _starts(kernel: Kernel, robot: Robot | None, guess: ArrayLike | None, lead: Sequence[int]) -> Array:
    """Return a guess for each pose, (N, n)."""
    guesses = np.zeros(kernel.n) if guess is None else as_floats(guess)
    if guess is None and robot is not None:
        names = program_coordinates(robot)
        start, goal = default_ends(robot, names)
        begun = dict(zip(names, start if robot.is_closed else (start + goal) / 2, strict=True))
        begun |= leading_home(robot)
        guesses = np.array([begun.get(name, 0.0) for name in kernel.coordinates])
    whole = (*lead, kernel.n)
    if guesses.shape not in ((kernel.n,), whole) or not np.isfinite(guesses).all():
        raise ArrayError(f"guess: got shape {guesses.shape}; allowed: finite numbers ({kernel.n},) or {whole}")
    return np.broadcast_to(guesses, whole).reshape(-1, kernel.n)


def _between(kernel: Kernel, robot: Robot | None, driven: set[str], start: Array, limits: bool | ArrayLike) -> Array:
    """Lower and upper limits, (n, 2); both are the guess where a coordinate stays."""
    stays = prescribed_mask(kernel)
    bounds = np.tile([-np.inf, np.inf], (kernel.n, 1))
    if robot is not None:
        bounds = limits_beside(robot, kernel.coordinates, driven, start)
        stays = stays | (bounds[:, 0] == bounds[:, 1])
    if not isinstance(limits, bool):
        bounds = as_floats(limits)
        if bounds.shape != (kernel.n, 2) or not (bounds[:, 0] <= bounds[:, 1]).all():
            raise ArrayError(f"limits: got shape {bounds.shape}; allowed: ({kernel.n}, 2), lower and upper ones")
    elif not limits:
        bounds = np.tile([-np.inf, np.inf], (kernel.n, 1))
    bounds[stays] = start[stays, np.newaxis]
    return bounds
