"""Coordinates of a robot whose tool is in a pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import InputError
from ..identifiers import check_kind
from ..kernel.complete import Kernel
from ..kernel.inverse_kinematics.kernel_method import limits_of_all, reach_all, starting_states, targets_of, tool_frame
from ..robot.mechanism import leading_home
from ..robot.model import program_coordinates, tool_of
from ..robot.value import Robot
from ..state.motors import turn_motors
from ..state.vectors import prescribed_mask
from .ends import default_ends, limits_beside
from .tool_path import far_point


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
        kernel: float64, with kinematics; of a mechanism with loops with all that ``assemble`` takes, and mass_matrix.
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
    check_kind("kernel", kernel, hasattr(kernel, "calls"), "a Kernel (of eomgen.build, or of a generated package)")
    if kernel.dtype != np.float64:
        raise InputError(f"{kernel.name}: a kernel of {kernel.dtype}; allowed: one of float64")
    known = set() if robot is None else set(program_coordinates(robot))
    if robot is not None and not known <= set(kernel.coordinates):
        raise InputError(f"robot: {robot.name} has other coordinates than {kernel.name}; allowed: the kernel's robot")
    targets, lead = targets_of(_frame(kernel, robot, frame), pose)
    begun = starting_states(kernel, "guess", _guess(kernel, robot) if guess is None else guess, lead)
    between = np.empty((len(targets), len(kernel.coordinates), 2))
    for k, start in enumerate(begun):
        between[k] = _between(kernel, robot, known, start, limits)
    q = reach_all(kernel, targets, lead, begun, between, remark=far_point)
    if robot is not None:
        for state in q:
            turn_motors(kernel, state, ())
    return q.reshape(*lead, len(kernel.coordinates))


def _frame(kernel: Kernel, robot: Robot | None, frame: str | None) -> str:
    if frame is None:
        if robot is not None:
            return tool_of(robot, None)
        return "tcp" if "tcp" in kernel.frames else kernel.frames[0]
    return tool_frame(kernel, frame)


def _guess(kernel: Kernel, robot: Robot | None) -> Array:
    """Return where a search begins, (n,): home, or the middle of a default motion; 0 without a robot."""
    if robot is None:
        return np.zeros(len(kernel.coordinates))
    names = program_coordinates(robot)
    start, goal = default_ends(robot, names)
    begun = dict(zip(names, start if robot.is_closed else (start + goal) / 2, strict=True))
    begun |= leading_home(robot)
    return np.array([begun.get(name, 0.0) for name in kernel.coordinates])


def _between(kernel: Kernel, robot: Robot | None, driven: set[str], start: Array, limits: bool | ArrayLike) -> Array:
    """Return lower and upper limits, (n, 2); both are the guess where a coordinate stays."""
    n = len(kernel.coordinates)
    stays, bounds = prescribed_mask(kernel)[:n], np.tile([-np.inf, np.inf], (n, 1))
    if robot is not None:
        bounds = limits_beside(robot, kernel.coordinates, driven, start)
        stays = stays | (bounds[:, 0] == bounds[:, 1])
    if not isinstance(limits, bool):
        bounds = limits_of_all(kernel, limits)
    elif not limits:
        bounds = np.tile([-np.inf, np.inf], (n, 1))
    bounds[stays] = start[stays, np.newaxis]
    return bounds
