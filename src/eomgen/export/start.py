"""Where an exported model starts: at the description's home, with loops and rigid couplings closed."""

from __future__ import annotations

from ..pipeline.stages import build
from ..progress import StageReport, no_report
from ..robot.model import build_model
from ..robot.value import Robot

CLOSING = ("constraint", "constraint_jacobian")  # and cut_poses where there are loops


def closed_home(robot: Robot, progress: StageReport = no_report) -> tuple[float, ...]:
    """The description's home, (n,), m or rad, closed.

    Raises:
        LoopError: a loop or a coupling stays open, or closes turned over alone.
    """
    model = build_model(robot)
    if not model.constraints:
        return model.home
    wanted = (*CLOSING, "cut_poses") if model.robot.loops else CLOSING
    kernel = build(robot, kernels=wanted, flags=("-O0",), progress=progress)
    return tuple(kernel.close(model.home).tolist())
