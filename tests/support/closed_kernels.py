"""How this project's kernels say that a mechanism with loops moves."""

from __future__ import annotations

import numpy as np

import eomgen
from tests.oracles.by_singular_values import ClosedLoops
from tests.oracles.closed_mechanisms import NO_WRENCH, Closed, Wrench
from tests.support.linkages import KERNELS
from tests.support.random_robots import Array

CHECKED = ("forward_dynamics", "constraint_forces")
USED = (*(name for name in KERNELS if name not in ("energy", "kinematics")), "external_force", *CHECKED)


def closed_dynamics(kernel: eomgen.Kernel, q: Array, v: Array, u: Array, wrench: Wrench = NO_WRENCH) -> Closed:
    """Accelerations, multipliers and wrenches in the cuts of one state, with the loops closed.

    The one place that says which of this project's functions tests of random mechanisms check.
    """
    outside = np.array([wrench.get(name, np.zeros(6)) for name in kernel.links]) if wrench else None
    a = kernel.forward_dynamics(q, v, u, wrench=outside)
    multipliers = kernel.constraint_forces(q, v, u, wrench=outside)
    loops = ClosedLoops(kernel)
    undetermined = loops.redundancy(q).undetermined
    unique = np.array([name not in undetermined for name in kernel.constraints])
    return Closed(a, multipliers, unique, loops.reactions(q, multipliers))
