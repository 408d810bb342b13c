"""The ladder of four-bar windows: problem A02 of the IFToMM library of multibody benchmarks, "N four-bar mechanism".

M. Gonzalez, D. Dopico, U. Lugris, J. Cuadrado, "A benchmarking system for MBS simulation software: Problem
standardization and performance measurement", Multibody System Dynamics 16 (2006): N windows of 2 N + 1 rods of 1 m and
1 kg, weight along -y; all uprights stand, and the tip of the first one starts with 1 m/s along x; 20 s, N = 40.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eomgen.robot.value import Coordinate, Joint, Link, Loop, Placement, Robot

GRAVITY = 9.81


def ladder(windows: int) -> Robot:
    """Return uprights crank0 ... on the ground, 1 m apart.

    Bar k hangs on upright k - 1, and its end on upright k is cut.
    """
    links, joints, loops = [rod("crank0")], [_hinge("foot0", "base", "crank0", 0.0)], []
    for k in range(1, windows + 1):
        bar, crank = f"bar{k}", f"crank{k}"
        links += [rod(bar), rod(crank)]
        joints += [_hinge(f"pin{k}", f"crank{k - 1}", bar, 1.0), _hinge(f"foot{k}", "base", crank, float(k))]
        loops.append(Loop(f"top{k}", (crank, bar), "revolute", (_at(1.0), _at(1.0))))
    return Robot(f"ladder{windows}", (0.0, -GRAVITY, 0.0), tuple(links), tuple(joints), loops=tuple(loops))


def rod(name: str) -> Link:
    """Return a thin rod of 1 m and 1 kg along x."""
    return Link(name, 1.0, (0.5, 0.0, 0.0), (0.0, 1 / 12, 1 / 12, 0.0, 0.0, 0.0))


def ladder_state(windows: int, angle: float, rate: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return q and v, (2 windows + 1,), of uprights at an angle (rad) from x that turn at a rate (rad/s)."""
    q, v = (np.full(2 * windows + 1, x) for x in (angle, rate))
    q[1::2], v[1::2] = -angle, -rate
    return q, v


def _hinge(name: str, parent: str, child: str, x: float) -> Joint:
    return Joint(name, parent, child, "revolute", _at(x), coordinates={"gamma": Coordinate()})


def _at(x: float) -> Placement:
    return Placement((x, 0.0, 0.0))
