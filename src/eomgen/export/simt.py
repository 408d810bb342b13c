"""A robot's equations as one text for accelerators: CUDA, HIP, OpenCL C, and C++."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..description import RobotLike, as_robot
from ..errors import InputError
from ..files import as_path, write_atomically
from ..names import show
from ..pipeline.derivations import derived_model
from ..progress import StageReport, no_report, tells_at_prompt


@tells_at_prompt("exporting")
def export_simt(
    robot: RobotLike,
    folder: Path | str,
    *,
    kernels: Sequence[str] = (),
    dtype: str = "float64",
    tile: int = 32,
    contract: bool = False,
    progress: StageReport = no_report,
) -> list[Path]:
    """Write NAME_simt.h and NAME_simt.json, and return their paths.

    The first has a kernel per function, in which one thread computes one state, for compilers of CUDA, HIP, OpenCL C,
    C99 and C++; the second lists the arguments of each, and the array h that all read.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        folder: to write to.
        kernels: names of KERNEL_NAMES that are straight-line programs, derivatives too, "frame_poses",
            "frame_jacobians", "rk4_rollout" and "implicit_rollout", with joint controllers "rk4_pd_rollout" and
            "implicit_pd_rollout"; dynamics with their derivatives, kinematics and rollouts without them if empty.
        dtype: "float64" or "float32".
        tile: states whose numbers stand side by side, 1 to 256, a power of two.
        contract: let products and sums be one operation, rounded once: faster, with other last bits than the C.
        progress: called with a line of text when a stage begins.

    Raises:
        InputError, UnknownNameError: a kernel, dtype, tile or contract is not one of these; a kernel has loops, or is
            of what the robot does not have; or a file cannot be written.
    """
    from ..codegen.simt.sources import render_simt

    robot, target = as_robot(robot), as_path(folder, "folder")
    if isinstance(kernels, str) or not all(isinstance(name, str) for name in kernels):
        raise InputError(f"kernels: {show(kernels)}; allowed: a sequence of names")
    progress("deriving the equations")
    source = render_simt(derived_model(robot), tuple(kernels), dtype, tile, contract=contract)
    return [_written(target / name, text) for name, text in source.files.items()]


def _written(path: Path, text: str) -> Path:
    """Write a file of ASCII text, and return its path."""
    return write_atomically(path, lambda stream: stream.write(text.encode("ascii")), read=None)
