"""A robot's equations as Python on arrays, for NumPy and JAX."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from eomgen.description import RobotLike, as_robot
from eomgen.files import check_ending, write_atomically
from eomgen.pipeline.derivations import derived_model
from eomgen.progress import StageReport, no_report, tells_at_prompt


@tells_at_prompt("exporting")
def export_arrays(
    robot: RobotLike, path: Path | str, *, kernels: Sequence[str] = (), progress: StageReport = no_report
) -> Path:
    """Write a module of Python whose functions take NumPy's arrays or JAX's, and return its path.

    It needs nothing but the namespace that ``make`` takes, and runs where that runs: under ``jit``, ``vmap`` and
    ``grad``, on accelerators too.  With loops dynamics are those of the closed mechanism, violated or not.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        path: file to write, ending in .py.
        kernels: names of KERNEL_NAMES that are programs; by default dynamics, energy and poses of frames.
        progress: called with a line of text when a stage begins.

    Raises:
        InputError: another ending, a kernel is unknown or no program, or the file cannot be written.
    """
    from eomgen.codegen.arrays.sources import render_arrays

    target = check_ending(path, ".py")
    robot = as_robot(robot)
    progress("deriving the equations")
    text = render_arrays(derived_model(robot), kernels)
    return write_atomically(target, lambda stream: stream.write(text.encode("ascii")), read=None)
