"""Generalized Maxwell element: branches beside a coordinate's spring, each a spring k in series with a damper c.

    z' = v - (k / c) z,    F = k z,

of every branch, z what its spring is stretched by.  It stores k z^2 / 2.
"""

from __future__ import annotations

from eomgen.robot.internal_states.branches import BRANCHES

from ...tree.composite import Rows
from ...tree.spatial import Scalar
from ..element import StateSlopes
from .formula import LawArguments, StateEffect


def maxwell(x: LawArguments) -> StateEffect:
    """Return the force of all branches of a coordinate's numbers."""
    force: Scalar = 0.0
    rates, springs, g_z = list[Scalar](), list[Scalar](), Rows()
    for i, z in enumerate(x.z):
        k = x.numbers[f"{BRANCHES}.{i}.stiffness"]
        slope = -1.0 * (k * (1.0 / x.numbers[f"{BRANCHES}.{i}.damping"]))
        g_z[i, i] = slope
        force = force + k * z
        springs.append(k)
        rates.append(x.v + slope * z)
    none = [0.0] * len(x.z)
    return StateEffect(force, rates, StateSlopes(0.0, springs, [1.0] * len(x.z), none, g_z, x.inertias))
