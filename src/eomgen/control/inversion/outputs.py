"""Outputs that an inversion prescribes: components of a frame's pose and coordinates, by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Index
from ...errors import InputError, UnknownNameError
from ...kernel.complete import Kernel
from ...names import component_name, nearest_or_all, show, split_component
from ...robot.coordinates import MOTIONS


@dataclass(frozen=True, eq=False)
class Outputs:
    """Outputs that follow a motion, m of them, and where they are wanted at T times.

    Attributes:
        names: "tcp.x", "tcp.rz" in the base frame, or coordinates.
        frames: names of the frames among them.
        rows: for each output the place of its frame, or -1 of a coordinate; and of its component or coordinate, (m, 2).
        poses: wanted ones, (T, 4, 4), of each frame.
        places: wanted coordinates, (T, n).
    """

    names: tuple[str, ...]
    frames: tuple[str, ...]
    rows: Index
    poses: tuple[Array, ...]
    places: Array

    def errors(self, kernel: Kernel, q: Array) -> Array:
        """Return by how much outputs are off at coordinates (T, n): (T, m), m or rad."""
        off = [
            _pose_error(kernel.frame_pose(q, name), want) for name, want in zip(self.frames, self.poses, strict=True)
        ]
        every = np.stack([*off, np.zeros((len(q), 6))])
        columns = [every[f, :, i] if f >= 0 else q[:, i] - self.places[:, i] for f, i in self.rows.tolist()]
        return np.stack(columns, axis=1)

    def slopes(self, kernel: Kernel, q: Array) -> Array:
        """Return derivatives of the outputs by coordinates, (T, m, n)."""
        J = [kernel.frame_jacobian(q, name) for name in self.frames]
        unit = np.broadcast_to(np.eye(q.shape[1]), (len(q), q.shape[1], q.shape[1]))
        return np.stack([J[f][:, i] if f >= 0 else unit[:, i] for f, i in self.rows.tolist()], axis=1)


def outputs_of(kernel: Kernel, names: Sequence[str], rigid: Array) -> Outputs:
    """Return outputs by their names, wanted where they are at coordinates without deviations, (T, n).

    Raises:
        UnknownNameError: a name is no coordinate, and no frame or link with a component.
        InputError: one stands twice.
    """
    frames: list[str] = []
    rows = []
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"outputs: {show(str(name))} stands twice; allowed: once")
        if name in kernel.coordinates:
            rows.append((-1, kernel.coordinates.index(name)))
            continue
        frame, component = split_component(str(name))
        if component not in MOTIONS or frame not in kernel.frames:
            known = [*kernel.coordinates, *(component_name(x, y) for x in kernel.frames for y in MOTIONS)]
            raise UnknownNameError(f"outputs: {show(str(name))} is unknown{nearest_or_all(str(name), known)}")
        if frame not in frames:
            frames.append(frame)
        rows.append((frames.index(frame), MOTIONS.index(component)))
    poses = tuple(np.asarray(kernel.frame_pose(rigid, frame)) for frame in frames)
    return Outputs(tuple(names), tuple(frames), np.array(rows, dtype=np.intp).reshape(-1, 2), poses, rigid)


def _pose_error(poses: Array, wanted: Array) -> Array:
    """Return displacements and rotation vectors from wanted poses, (T, 4, 4), to others: (T, 6), base frame."""
    R = poses[:, :3, :3] @ np.swapaxes(wanted[:, :3, :3], 1, 2)
    axis = 0.5 * np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, 0.5 * (np.trace(R, axis1=1, axis2=2) - 1.0))
    factor = np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 1.0)
    return np.hstack([poses[:, :3, 3] - wanted[:, :3, 3], factor[:, np.newaxis] * axis])
