"""Where an exported model starts: at the description's home, with loops and rigid couplings closed."""

from __future__ import annotations

import numpy as np

from ..errors import LoopError
from ..pipeline.stages import build
from ..progress import StageReport, no_report
from ..robot.model import build_model
from ..robot.value import Robot

CLOSED = 1e-12  # m or rad, a gap that is round-off
LONGEST = 0.5  # m or rad, of a coordinate in one step
_STEPS = 100


def closed_home(robot: Robot, progress: StageReport = no_report) -> tuple[float, ...]:
    """The description's home, (n,), m or rad, closed by steps of Newton's method in the metric of the kinetic energy.

    Raises:
        LoopError: a loop or a coupling stays open.
        SingularError: the mass matrix cannot be inverted on the way.
    """
    model = build_model(robot)
    q = np.array(model.home)
    if not model.constraints:
        return model.home
    kernel = build(robot, kernels=("settling",), flags=("-O0",), progress=progress)
    n, still = kernel.n, np.zeros(kernel.n)
    for _ in range(_STEPS):
        found = kernel.calls.run("settling", None, (q, still))
        change, gaps = found[:n], np.abs(found[2 * n :])
        if gaps.max() <= CLOSED:
            return tuple(q.tolist())
        q = q + change * min(1.0, LONGEST / max(float(np.abs(change).max()), LONGEST))
    name = model.constraints[int(np.argmax(gaps))]
    raise LoopError(
        f"{robot.name}: {name} does not close near home, where {gaps.max():.3g} is left; allowed: a home nearer to"
        " closure",
        loop=name.partition(".")[0],
        gap=float(gaps.max()),
    )
