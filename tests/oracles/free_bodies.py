"""An independent oracle: one free body under its weight, integrated in a quaternion about its centre of mass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from eomgen.robot.value import Robot

Array = NDArray[np.float64]


def falling_body(robot: Robot, q: Array, v: Array, times: Array) -> tuple[Rotation, Array]:
    """Rotations and origins (T, 3) of the only body at times from 0 on; q and v are its six coordinates and rates."""
    (link,) = robot.links
    xx, yy, zz, xy, xz, yz = link.inertia
    tensor, com = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), np.array(link.com)
    R, (_, beta, gamma) = Rotation.from_euler("XYZ", q[3:]), q[3:]
    turned = Rotation.from_euler("YZ", [beta, gamma]).inv()
    spun = turned.apply([v[3], 0.0, 0.0]) + Rotation.from_euler("Z", gamma).inv().apply([0.0, v[4], 0.0])
    w = spun + [0.0, 0.0, v[5]]

    def slopes(_: float, y: Array) -> Array:
        p, w = y[:4], y[4:]
        product = np.array([*(p[3] * w + np.cross(p[:3], w)), -p[:3] @ w])
        return np.concatenate([0.5 * product, np.linalg.solve(tensor, -np.cross(w, tensor @ w))])

    y = solve_ivp(
        slopes,
        (0.0, times[-1]),
        np.concatenate([R.as_quat(), w]),
        method="DOP853",
        t_eval=times,
        rtol=1e-12,
        atol=1e-13,
    ).y
    found = Rotation.from_quat(y[:4].T)
    rate = v[:3] + R.apply(np.cross(w, com))
    centre = q[:3] + R.apply(com) + np.outer(times, rate) + np.outer(0.5 * times**2, robot.gravity)
    return found, np.asarray(centre - found.apply(com))
