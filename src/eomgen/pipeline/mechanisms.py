"""Kernels that assemble a mechanism, and the description's home with its loops assembled."""

from __future__ import annotations

from ..progress import StageReport, no_report
from ..robot.model import build_model
from ..robot.value import Robot
from .stages import build


def assembly_kernels(robot: Robot) -> tuple[str, ...]:
    """Return names of the kernels that ``Kernel.assemble`` calls; none without loops and couplings."""
    if not build_model(robot).constraints:
        return ()
    return ("constraint", "constraint_jacobian", *(("cut_poses",) if robot.loops else ()))


def mechanism_kernels(robot: Robot) -> tuple[str, ...]:
    """Add what moves the mechanism along its loops: charts, residual, mass matrix, the constraint's bias."""
    kernels = assembly_kernels(robot)
    return (*kernels, "following", "constraint_bias", "mass_matrix", "residual") if kernels else ()


def assembled_home(robot: Robot, progress: StageReport = no_report) -> tuple[float, ...]:
    """Return the description's home, (n,), m or rad, assembled; compiles ``assembly_kernels`` where there are some.

    Raises:
        LoopError: a loop or a coupling stays open, or closes turned over alone.
    """
    home, kernels = build_model(robot).home, assembly_kernels(robot)
    if not kernels:
        return home
    kernel = build(robot, kernels=kernels, flags=("-O0",), progress=progress)
    whole = [*home, *(0.0 for _ in kernel.memory)]
    return tuple(kernel.assemble(whole)[: len(home)].tolist())
