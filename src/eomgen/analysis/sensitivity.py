"""How the pose of a tool answers to deviations of the geometry: exact first derivatives, no differences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..codegen.kernels.groups import FRAME_POSES
from ..description import RobotLike, as_robot
from ..errors import ArrayError
from ..names import joint_of, kind_of, parameter_name
from ..pipeline.building import build
from ..robot.model import build_model
from ..robot.value import COORDINATES, Coordinate
from ..runtime.arrays import numbers_in


def offset_sensitivity(
    robot: RobotLike, q: ArrayLike, frame: str, *, parameters: Mapping[str, float] | None = None
) -> tuple[tuple[str, ...], Array]:
    """Return the motion of a frame per unit of every joint's six constant offsets, active coordinates or not.

    An offset moves what hangs on it as its coordinate would, so these are the columns of the frame's Jacobian in the
    same robot with six coordinates in each joint, fixed ones included; the primary deviations of the paper's section 1.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        q: coordinates of ``robot``, (n,) or (N, n), m or rad.
        frame: name of a frame or link.
        parameters: values that differ from the description's, such as ``kernel.parameters`` (other names are ignored).

    Returns:
        Names ("joints.joint1.offset.x", ...), and (6, names) or (N, 6, names): displacement of the frame's origin and
        small rotation in the base frame, m or rad per m or rad.

    Raises:
        UnknownNameError: no frame or link of that name.
        ArrayError: q has a wrong shape or is not finite.
    """
    robot = as_robot(robot)
    every = {joint.name: {name: Coordinate() for name in COORDINATES} for joint in robot.joints}
    whole = robot.with_coordinates(every)
    joints = tuple(replace(joint, motor=None) for joint in whole.joints)  # motors move no frame
    whole = replace(whole, name=robot.name[:44] + "_six", joints=joints, tunable=())
    kernel = build(whole, kernels=FRAME_POSES)
    active = build_model(robot).coordinates
    kernel.parameters.update({name: value for name, value in (parameters or {}).items() if name in kernel.parameters})
    states = numbers_in("q", q, f"finite numbers of shape ({len(active)},) or (N, {len(active)})")
    if states.shape[-1:] != (len(active),) or states.ndim > 2:
        raise ArrayError(f"q: expected shape ({len(active)},) or (N, {len(active)}), got {states.shape}")
    full = np.zeros((*states.shape[:-1], kernel.n))
    moving = [i for i, name in enumerate(active) if name in kernel.coordinates]
    full[..., [kernel.coordinates.index(active[i]) for i in moving]] = states[..., moving]
    names = tuple(parameter_name("joints", joint_of(name), "offset", kind_of(name)) for name in kernel.coordinates)
    return names, np.asarray(kernel.frame_jacobian(full, frame))
