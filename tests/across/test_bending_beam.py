"""A link that is a beam, from its description to motions: the spin-up of a flexible rod.

J. C. Simo and L. Vu-Quoc, "On the Dynamics of Flexible Beams Under Large Overall Motions - The Plane Case: Part II",
Journal of Applied Mechanics 53 (1986) 855-863.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import eomgen
from eomgen.description.load import robot_from_toml
from tests.support.joint_table import joint_table

pytestmark = pytest.mark.usefixtures("unoptimised")

ROD = f"""
name = "spin_up"
gravity = [0.0, 0.0, 0.0]
[[links]]
name = "rod"
[links.beam]
length = 10
E = 2.8e9
G = 1e9
density = 120
A = 0.01
Iy = 5e-6
Iz = 5e-6
J = 1e-5
shear = [1, 1]
modes = {{ y = 3, axial = 1 }}
{joint_table("hub", "base", "rod", "revolute")}
[[frames]]
name = "tip"
link = "rod"
node = "tip"
"""
SPUN, RATE = 15.0, 6.0  # s until the rate is reached, rad/s
# of a geometrically exact beam (20 elements): least deflection of the tip, m, and its stretch at the rate, m
LEAST, STRETCH = -0.5738, 5.14e-4


def hub(t: float) -> tuple[float, float, float]:
    """The prescribed angle, its rate and its acceleration."""
    if t >= SPUN:
        return RATE * (t - SPUN / 2), RATE, 0.0
    w = 2 * np.pi / SPUN
    angle = t * t / 2 + (np.cos(w * t) - 1) / w**2
    return RATE / SPUN * angle, RATE / SPUN * (t - np.sin(w * t) / w), RATE / SPUN * (1 - np.cos(w * t))


@pytest.mark.soak
def test_a_rod_that_spins_up_bends_as_an_exact_beam() -> None:
    """Three bending modes: least deflection within 0.3 %, stretch by centrifugal forces within 0.1 %."""
    kernel = eomgen.build(robot_from_toml(ROD))
    assert kernel.coordinates == ("hub.gamma", *(f"rod.mode{k}" for k in range(1, 5)))
    n = len(kernel.coordinates) - 1
    back = np.linalg.inv(kernel.mass_matrix(np.zeros(n + 1))[1:, 1:])  # which does not change

    def rates(t: float, y: NDArray[np.float64]) -> NDArray[np.float64]:
        angle, rate, acceleration = hub(t)
        q, v = np.append(angle, y[:n]), np.append(rate, y[n:])
        forces = kernel.inverse_dynamics(q, v, np.append(acceleration, np.zeros(n)))
        return np.concatenate([y[n:], -back @ forces[1:]])

    times = np.linspace(0.0, 20.0, 801)
    motion = solve_ivp(rates, (0.0, 20.0), np.zeros(2 * n), t_eval=times, method="LSODA", rtol=1e-6, atol=1e-9)
    tips = [kernel.frame_pose(np.append(0.0, y[:n]), "tip")[:2, 3] - [10.0, 0.0] for y in motion.y.T]
    along, across = np.array(tips).T
    assert across.min() == pytest.approx(LEAST, rel=3e-3)
    assert along[times >= SPUN + 0.5].mean() == pytest.approx(STRETCH, rel=1e-3)
