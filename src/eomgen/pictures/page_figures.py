"""The figures of a report, as elements of its page."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..errors import EomgenError, EomgenWarning, InputError
from ..names import component_name
from ..progress import Progress
from ..robot.coordinates import index_of
from ..robot.model import build_model
from ..robot.value import Robot
from ..simulation.result import SimulationResult
from .analysis import plot_tracks
from .report import Figure, figure_of
from .simulation import plot_result
from .zeros import plot_zeros

POSES = 21  # along the reference trajectory, of frequencies
CAPTIONS = {
    "tool": "Path of the TCP with its error magnified, and position and orientation errors over time.",
    "deviations": "Deviations in the joints, the coordinates without a reference trajectory.",
    "journals": "Paths of journals' centres in their bearings; inside the circle they are free.",
    "tracking": "Driven coordinates, their reference trajectory and tracking error.",
    "energy": "Changes of energy, work integrals, and the residue of their balance.",
    "states": "Internal states: deflections of bristles, for example.",
    "modes": "Natural frequencies and damping ratios of small motions along the reference trajectory, brakes on.",
    "zeros": "What vanishes identically in the mass matrix and in the tensor C of eqs. (11) and (12).",
}


def figures_of(
    result: SimulationResult, robot: Robot | None, missing: list[str], *, modes: bool, progress: Progress
) -> list[Figure]:
    """Figures of a result, as far as they can be made; ``missing`` says what cannot.

    Raises:
        InputError: Matplotlib is not installed.
    """
    with tempfile.TemporaryDirectory(prefix="eomgen-") as folder:
        progress(0.0, "figures")
        paths = plot_result(result, folder, ".svg")
        if not result.programmed:
            missing.append("tracking errors: there is no reference trajectory")
        if robot is not None:
            if modes:
                paths += _attempt(
                    "frequencies along the reference trajectory", missing, lambda: _modes(result, robot, folder)
                )
            paths += _attempt("zeros", missing, lambda: [plot_zeros(build_model(robot), Path(folder) / "zeros.svg")])
        return [figure_of(path, CAPTIONS[path.stem]) for path in paths]


def _attempt(what: str, missing: list[str], draw: Callable[[], list[Path]]) -> list[Path]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EomgenWarning)
            return draw()
    except EomgenError as error:
        missing.append(f"{what}: {error}")
        return []


def _modes(result: SimulationResult, robot: Robot, folder: str) -> list[Path]:
    from ..analysis.modal import modes_along

    springs = {
        component_name(joint.name, name)
        for joint in robot.joints
        for name, coordinate in joint.coordinates.items()
        if coordinate.stiffness or coordinate.curve
    }
    if not (springs | set(robot.modal_coordinates)) & set(result.deviation_coordinates):
        raise InputError("no deviation has a stiffness")
    samples = np.unique(np.linspace(0, result.trajectory.t.size - 1, POSES).astype(int))
    moved = (*result.program_coordinates, *result.prescribed)
    q = result.trajectory.q[:, index_of(result.trajectory.coordinates, result.prescribed)]
    values = np.concatenate([result.program_q, q], axis=1)[samples]
    tracked = modes_along(robot, [dict(zip(moved, row.tolist(), strict=True)) for row in values], drives="locked")
    return [plot_tracks(tracked, Path(folder) / "modes.svg", times=result.trajectory.t[samples])]
