"""Tables of makers' arms as they are published, and forward kinematics that knows nothing of descriptions.

Sources are in the heads of the built-in robots of the same names.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce

import numpy as np

PI = np.pi
# theta, d, a, alpha (m, rad), mass, centre of mass in the frame of the row
UR5E = (
    (0.0, 0.1625, 0.0, PI / 2, 3.761, (0, -0.02561, 0.00193)),
    (0.0, 0.0, -0.425, 0.0, 8.058, (0.2125, 0, 0.11336)),
    (0.0, 0.0, -0.3922, 0.0, 2.846, (0.15, 0.0, 0.0265)),
    (0.0, 0.1333, 0.0, PI / 2, 1.37, (0, -0.0018, 0.01634)),
    (0.0, 0.0997, 0.0, -PI / 2, 1.3, (0, 0.0018, 0.01634)),
    (0.0, 0.0996, 0.0, 0.0, 0.365, (0, 0, -0.001159)),
)
UR20 = (
    (0.0, 0.2363, 0.0, PI / 2, 16.343, (0, -0.0610, 0.0062)),
    (0.0, 0.0, -0.8620, 0.0, 29.632, (0.5226, 0, 0.2098)),
    (0.0, 0.0, -0.7287, 0.0, 7.879, (0.3234, 0, 0.0604)),
    (0.0, 0.2010, 0.0, PI / 2, 3.054, (0, -0.0026, 0.0393)),
    (0.0, 0.1593, 0.0, -PI / 2, 3.126, (0, 0.0024, 0.0379)),
    (0.0, 0.1543, 0.0, 0.0, 0.846, (0, -0.0003, -0.0318)),
)
# The same arm by two tables: deg and mm; modified with masses, and standard.
UFACTORY850 = (
    (0.0, 0.364, 0.0, 0.0, 4.811, (-0.049e-3, 13.92e-3, -20.31e-3)),
    (PI / 2, 0.0, 0.0, PI / 2, 3.166, (327.98e-3, 0.074e-3, 6.48e-3)),
    (PI / 2, 0.0, 0.390, PI, 2.247, (130.23e-3, 105.18e-3, 8.97e-3)),
    (0.0, 0.426, 0.150, -PI / 2, 2.12, (0.016e-3, -38.47e-3, -98.3e-3)),
    (0.0, 0.0, 0.0, -PI / 2, 1.346, (-0.42e-3, -17.6e-3, -1.42e-3)),
    (0.0, 0.090, 0.0, PI / 2, 0.225, (0.15e-3, 1.38e-3, -13.97e-3)),
)
UFACTORY850_CLASSIC = (
    *((0.0, 0.364, 0.0, PI / 2), (PI / 2, 0.0, 0.390, PI), (PI / 2, 0.0, 0.150, -PI / 2)),
    *((0.0, 0.426, 0.0, -PI / 2), (0.0, 0.0, 0.0, PI / 2), (0.0, 0.090, 0.0, 0.0)),
)
PANDA = (
    (0.0, 0.333, 0.0, 0.0, 4.970684, (0.003875, 0.002081, -0.04762)),
    (0.0, 0.0, 0.0, -PI / 2, 0.646926, (-0.003141, -0.02872, 0.003495)),
    (0.0, 0.316, 0.0, PI / 2, 3.228604, (0.027518, 0.039252, -0.066502)),
    (0.0, 0.0, 0.0825, PI / 2, 3.587895, (-0.05317, 0.104419, 0.027454)),
    (0.0, 0.384, -0.0825, -PI / 2, 1.225946, (-0.011953, 0.041065, -0.038437)),
    (0.0, 0.0, 0.0, PI / 2, 1.666555, (0.060149, -0.014117, -0.010517)),
    (0.0, 0.0, 0.088, PI / 2, 0.735522, (0.010517, -0.004252, 0.061597)),
)
PANDA_FLANGE = 0.107  # m along z behind frame 7
FramesOf = Callable[[Sequence[Sequence[float]], Sequence[float]], list[np.ndarray]]
# Origin of each joint in the frame before it, and its axis, of URDF frames that are parallel where all angles are 0;
# the tool's roll, pitch, yaw; mass and centre of mass where they are published.
Urdf = tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]
KR6_R900: Urdf = (
    *(((0, 0, 0.400), (0, 0, -1)), ((0.025, 0, 0), (0, 1, 0)), ((0.455, 0, 0), (0, 1, 0))),
    *(((0, 0, 0.035), (-1, 0, 0)), ((0.420, 0, 0), (0, 1, 0)), ((0.080, 0, 0), (-1, 0, 0))),
)
LRMATE200ID: Urdf = (
    *(((0, 0, 0.330), (0, 0, 1)), ((0.050, 0, 0), (0, 1, 0)), ((0, 0, 0.330), (0, -1, 0))),
    *(((0, 0, 0.035), (-1, 0, 0)), ((0.335, 0, 0), (0, -1, 0)), ((0.080, 0, 0), (-1, 0, 0))),
)
IRB120: Urdf = (
    *(((0, 0, 0), (0, 0, 1)), ((0, 0, 0.29), (0, 1, 0)), ((0, 0, 0.27), (0, 1, 0))),
    *(((0, 0, 0.07), (1, 0, 0)), ((0.302, 0, 0), (0, 1, 0)), ((0.072, 0, 0), (1, 0, 0))),
)
RX160: Urdf = (
    *(((0, 0, 0.55), (0, 0, 1)), ((0.15, 0, 0), (0, 1, 0)), ((0, 0, 0.825), (0, 1, 0))),
    *(((0, 0, 0), (0, 0, 1)), ((0, 0, 0.625), (0, 1, 0)), ((0, 0, 0.11), (0, 0, 1))),
)
URDFS = {
    "kr6_r900": (KR6_R900, (0.0, PI / 2, 0.0)),
    "lrmate200id": (LRMATE200ID, (PI, -PI / 2, 0.0)),
    "irb120": (IRB120, (0.0, PI / 2, 0.0)),
    "rx160": (RX160, (0.0, 0.0, 0.0)),
}
URDF_MASSES = {
    "irb120": (
        *((3.067, (9.77e-05, -0.00012, 0.23841)), (3.909, (0.00078, -0.00212, 0.10124))),
        *((2.944, (0.02281, 0.00106, 0.05791)), (1.328, (0.2247, 0.00015, 0.00041))),
        *((0.546, (-0.00109, 3.68e-05, 6.22e-05)), (0.137, (-0.00706, -0.00017, -1.32e-06))),
    ),
    "rx160": (
        *((45.357763, (0.085479, -0.002547, -0.040488)), (51.266495, (-0.000002, 0.264164, 0.347704))),
        *((19.754401, (-0.000255, 0.016478, -0.003819)), (15.287896, (-0.015515, 0.000164, 0.340348))),
        *((0.548088, (0.0, -0.000347, 0.023671)), (0.038484, (-0.000245, 0.0, -0.007626))),
    ),
}
MAKERS = (
    "ur5e",
    "ur20",
    "panda",
    "ufactory850",
    *URDFS,
)  # built-in robots: serial arms as ur5 is, which stands for them


def about_z(angle: float, along: float) -> np.ndarray:
    """Rz(angle) Tz(along)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, along], [0, 0, 0, 1]])


def about_x(angle: float, along: float) -> np.ndarray:
    """Rx(angle) Tx(along)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0, along], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


def about(axis: Sequence[float], angle: float) -> np.ndarray:
    """Rotation about a unit vector by Rodrigues' formula, as a pose."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    pose = np.eye(4)
    pose[:3, :3] += np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
    return pose


def classic_frames(table: Sequence[Sequence[float]], q: Sequence[float]) -> list[np.ndarray]:
    """Frames of a classic table, A_i = Rz(theta + q) Tz(d) Tx(a) Rx(alpha), in the base."""
    steps = [about_z(row[0] + x, row[1]) @ about_x(row[3], row[2]) for row, x in zip(table, q, strict=True)]
    return _products(steps)


def modified_frames(table: Sequence[Sequence[float]], q: Sequence[float]) -> list[np.ndarray]:
    """Frames of a modified table, A_i = Rx(alpha) Tx(a) Rz(theta + q) Tz(d), in the base."""
    steps = [about_x(row[3], row[2]) @ about_z(row[0] + x, row[1]) for row, x in zip(table, q, strict=True)]
    return _products(steps)


def urdf_frames(table: Urdf, q: Sequence[float]) -> list[np.ndarray]:
    """Frames of the links of a URDF whose origins have no rotations, in the base."""
    steps = []
    for (origin, axis), angle in zip(table, q, strict=True):
        step = about(axis, angle)
        step[:3, 3] = origin
        steps.append(step)
    return _products(steps)


def turned(rpy: Sequence[float]) -> np.ndarray:
    """Rz(yaw) Ry(pitch) Rx(roll) as a pose."""
    roll, pitch, yaw = rpy
    return about((0, 0, 1), yaw) @ about((0, 1, 0), pitch) @ about((1, 0, 0), roll)


def _products(steps: Sequence[np.ndarray]) -> list[np.ndarray]:
    return [reduce(np.matmul, steps[: i + 1]) for i in range(len(steps))]
