"""Models of acados: a robot's discrete dynamics in one file of C, and a module of Python for it."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from .._version import __version__
from ..control.discrete_steps import DiscreteStep, checked_step, kernels_for_step
from ..description import RobotLike, as_robot
from ..files import as_path, write_atomically
from ..pipeline.building import build
from ..progress import StageReport, no_report, tells_at_prompt
from ..robot.model import build_model
from ..robot.value import Robot
from .fmu.choices import AUTO

STEP = 0.01  # s


@tells_at_prompt("exporting")
def export_acados(
    robot: RobotLike,
    folder: Path | str,
    *,
    method: str = AUTO,
    step: float = STEP,
    substeps: int = 1,
    parameters: Sequence[str] = (),
    progress: StageReport = no_report,
) -> list[Path]:
    """Write NAME_acados.c and NAME_acados.py, whose function ``model`` makes an AcadosModel, and return their paths.

    x is q, then v with internal states behind it; u acts on the coordinates that have drives.  Derivatives are exact
    for the steps taken; there are no second ones, so that acados takes Gauss-Newton Hessians.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        folder: to write to.
        method: as of ``eomgen.adapters.casadi.step``, or "auto": "rk4" where all coordinates have drives and no law
            has a state, else "rosenbrock", which takes stiff springs.
        step: its length, s.
        substeps: equal ones that it is made of.
        parameters: names of run-time parameters that are p of the model.
        progress: called with a line of text when a stage begins.

    Raises:
        InputError, UnknownNameError: no such method, length, number of substeps or parameter; joints with 3-DOF
            rotation; or a file cannot be written.
    """
    from ..codegen.c.library import library_files
    from ..codegen.c.source import environment

    robot, folder = as_robot(robot), as_path(folder, "folder")
    chosen = _method(robot) if method == AUTO else method
    checked_step(chosen, step, substeps, parameters, build_model(robot).parameters)
    kernel = build(robot, kernels=kernels_for_step(chosen, closed=robot.is_closed), flags=("-O0",), progress=progress)
    made = DiscreteStep(kernel, chosen, step, substeps, parameters=parameters)
    header, code = (made.together.raw.source(ending) for ending in ("h", "c"))
    texts = {f"{kernel.name}.h": header, f"{kernel.name}.c": code} | library_files()
    context = {
        **made.context(by_parameters=False, adjoint=False),
        "version": __version__,
        "code": in_one_file(texts, f"{kernel.name}.c"),
        "laws": bool(kernel.internal_states),
        "names": {
            "x": made.states,
            "u": made.drives,
            "p": {name: repr(float(kernel.parameters[name])) for name in made.parameters},
        },
    }
    files = {f"{kernel.name}_acados.c": "step.c", f"{kernel.name}_acados.py": "model.py"}
    return [
        _written(Path(folder, name), environment().get_template(f"acados/{template}.jinja").render(context))
        for name, template in files.items()
    ]


def _written(path: Path, text: str) -> Path:
    """Write a file of ASCII text, and return its path."""
    return write_atomically(path, lambda stream: stream.write(text.encode("ascii")), read=None)


def _method(robot: Robot) -> str:
    """Return the method that is stable whatever springs there are, or the explicit one where nothing is elastic."""
    model = build_model(robot)
    return "rk4" if len(model.driven) == len(model.coordinates) and not model.internal_states else "rosenbrock"


def in_one_file(texts: Mapping[str, str], place: str) -> str:
    """Return C with all files in it that it includes by quotes, each as often as it is asked for.

    Args:
        texts: of all files, by their places in one folder.
        place: of the file to begin with.
    """

    def included(found: re.Match[str]) -> str:
        return in_one_file(texts, posixpath.normpath(posixpath.join(posixpath.dirname(place), found[1])))

    return re.sub(r'^#include "(.+)"$', included, texts[place], flags=re.MULTILINE)
