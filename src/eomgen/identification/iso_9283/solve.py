"""From results and measured files to figures of ISO 9283."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...description import RobotLike
from ...errors import InputError
from ...motion.measured_numbers import answers_in_numbers
from ...names import listed, show
from ...npz import read_npz
from ...progress import Progress, no_progress, tells_at_prompt
from ...results.beside import SWEEP, TRAJECTORY
from ...simulation.result import SimulationResult, load_result
from ...sweep.plan import Plan
from .attained import Measured
from .measured import from_files
from .paths import MATCHES, path_figures
from .poses import distance_figures, pose_figures, stop_figures, variation_figures
from .result import STANDARD, AccuracyResult, PathFigures, PoseFigures
from .simulated import from_plan, from_simulations

POSES, CYCLES, PATH_CYCLES = 5, 30, 10  # that the standard asks for
_FAR = 0.1  # m, rad: of a pose from its command, from which on a mistake is more likely than a robot


@answers_in_numbers("results")
@tells_at_prompt("evaluating")
def accuracy(  # noqa: PLR0913
    *results: SimulationResult | Path | str,
    robot: RobotLike | None = None,
    scenario: str | Path | Mapping[str, Any] | None = None,
    plan: Plan | None = None,
    command: Path | str | None = None,
    frame: str | None = None,
    rotation: str = "rotvector",
    match: str = "plane",
    band: float | None = None,
    distances: Sequence[tuple[str, str]] | None = None,
    load: str = "",
    rate: str = "",
    progress: Progress | None = None,
) -> AccuracyResult:
    """Return accuracy and repeatability by the definitions of ISO 9283:1998.

    Args:
        results: simulations (results, their files or folders), cycles of one reference trajectory; or measured
            files, .csv or .npz (see ``measured.from_files``); or none, with robot, scenario and plan.
        robot, scenario, plan: of a sweep whose samples are simulated and taken as cycles.
        command: file with the commanded poses or paths of measured files that do not have them.
        frame: the one to look at; needed where a measured file has several.
        rotation: of measured orientations: "rotvector", "rpy" or "quaternion".
        match: points of a path that belong together: where attained paths go through the "plane" normal to the
            commanded one, as the standard has it, or the same "sample".
        band: limit band of stabilization and overshoot, m; by default the pose's repeatability.
        distances: pairs of poses; by default each and the next one.
        load, rate: of the test, in words; by default what simulations know.
        progress: called with a fraction from 0 to 1 and a line of text while samples are simulated.

    Raises:
        InputError: arguments that do not belong together, or hold too little; with their names.
    """
    if match not in MATCHES:
        raise InputError(f"match: {show(match)}; allowed: {', '.join(MATCHES)}")
    if band is not None and not (0.0 < band < np.inf):
        raise InputError(f"band: {show(band)}; allowed: a length greater than 0, m")
    sampled = (robot, scenario, plan)
    if results and any(item is not None for item in sampled):
        raise InputError("results, and a robot, scenario or plan; allowed: results, or all three of those")
    if results:
        measured = _from_results(results, None if command is None else Path(command), frame, rotation)
    elif robot is not None and scenario is not None and plan is not None:
        measured = from_plan(robot, scenario, plan, frame, progress or no_progress)
    else:
        raise InputError("no results; allowed: results, or a robot, a scenario and a plan")
    return figures_of(measured, match=match, band=band, distances=distances, load=load, rate=rate)


def _from_results(
    results: Sequence[SimulationResult | Path | str], command: Path | None, frame: str | None, rotation: str
) -> Measured:
    paths = [Path(item).resolve() for item in results if not isinstance(item, SimulationResult)]
    twice = [path for path in paths if paths.count(path) > 1]
    if twice:
        raise InputError(f"{twice[0]}: stands twice; allowed: once, or its cycles would count twice")
    kinds = [_kind(item) for item in results]
    if len(set(kinds)) > 1:
        i = next(i for i, kind in enumerate(kinds) if kind != kinds[0])
        raise InputError(
            f"{_label(results[i], i)} is {kinds[i]}, and {_label(results[0], 0)} {kinds[0]}; allowed: all of one kind"
        )
    if kinds[0] == "measured":
        return from_files([Path(str(item)) for item in results], command=command, frame=frame, rotation=rotation)
    if command is not None:
        raise InputError("command: simulations know their commands; allowed: with measured files")
    loaded = [item if isinstance(item, SimulationResult) else load_result(_file(Path(item))) for item in results]
    return from_simulations(loaded, [_label(item, i) for i, item in enumerate(results)], frame)


def _label(item: SimulationResult | Path | str, i: int) -> str:
    return f"results[{i}]" if isinstance(item, SimulationResult) else str(item)


def _kind(item: SimulationResult | Path | str) -> str:
    """Say what a result is: "simulated" or "measured".

    Raises:
        InputError: it is the folder of a sweep, or of something else.
    """
    if isinstance(item, SimulationResult):
        return "simulated"
    path = Path(item)
    if os.path.isdir(path):
        if os.path.isfile(path / SWEEP):
            raise InputError(
                f"{path}: is the folder of a sweep, whose table has no poses of the tool; allowed: robot, scenario"
                " and plan in its place, whose samples are simulated again"
            )
        return "simulated"
    return "simulated" if path.suffix == ".npz" and "meta" in read_npz(path) else "measured"


def _file(path: Path) -> Path:
    if not os.path.isdir(path):
        return path
    if not os.path.isfile(path / TRAJECTORY):
        raise InputError(f"{path}: has no {TRAJECTORY}; allowed: a folder that eomgen simulate wrote, or a file")
    return path / TRAJECTORY


# Figures


def figures_of(
    measured: Measured,
    *,
    match: str = "plane",
    band: float | None = None,
    distances: Sequence[tuple[str, str]] | None = None,
    load: str = "",
    rate: str = "",
) -> AccuracyResult:
    """Return all figures of attained poses and paths; arguments and errors as of ``accuracy``."""
    _check_cycles(measured)
    poses = tuple(pose_figures(pose) for pose in measured.poses)
    paths = tuple(path_figures(path, match) for path in measured.paths)
    variations, directions = variation_figures(measured.poses, poses)
    stops, unsettled = stop_figures(measured.poses, poses, band)
    exactly = ["the simulation repeats itself exactly: RP and RT are 0 and say nothing of the robot"] * measured.exact
    notes = [*_standard(measured), *exactly, *measured.notes, *_convention(measured, match), *_far(poses, paths)]
    return AccuracyResult(
        source=measured.source,
        robot=measured.robot,
        frame=measured.frame,
        load=load or measured.load or "not stated",
        rate=rate or measured.rate or "not stated",
        exact=measured.exact,
        poses=poses,
        paths=paths,
        distances=distance_figures(measured.poses, distances),
        stops=stops,
        variations=variations,
        notes=(*notes, *directions, *unsettled),
    )


def _check_cycles(measured: Measured) -> None:
    """Raise InputError where something was done once, though nothing says that it repeats itself."""
    for kind, items in (("pose", measured.poses), ("path", measured.paths)):
        for item in items:
            if len(item.cycles) < 2 and not measured.exact:
                raise InputError(
                    f"{kind} {item.name}: has one cycle, which says nothing of repeatability; allowed: 2 or more"
                )


# Notes


def _standard(measured: Measured) -> list[str]:
    """Say what the standard asks for and is not there: figures then follow its formulas and are not its figures."""
    lacks = []
    cycles = min((len(pose.cycles) for pose in measured.poses), default=CYCLES)
    if measured.poses and (cycles < CYCLES or len(measured.poses) < POSES):
        lacks.append(f"{CYCLES} cycles at {POSES} poses (here {cycles} at {len(measured.poses)})")
    cycles = min((len(path.cycles) for path in measured.paths), default=PATH_CYCLES)
    if cycles < PATH_CYCLES:
        lacks.append(f"{PATH_CYCLES} cycles of a path (here {cycles})")
    if not lacks:
        return []
    return [f"{STANDARD} asks for {' and '.join(lacks)}: the figures follow its formulas and are not those of it"]


def _convention(measured: Measured, match: str) -> list[str]:
    notes = []
    if any(pose.rotation is not None and pose.attained_rotation is not None for pose in measured.poses):
        notes.append(
            "a, b and c: components of the rotation vector from the commanded to the attained axes, base frame"
        )
    if measured.paths:
        by = "in planes normal to the commanded path" if match == "plane" else "sample by sample"
        notes.append(f"paths are compared {by}")
    return notes


def _far(poses: Sequence[PoseFigures], paths: Sequence[PathFigures]) -> list[str]:
    """Say what is more likely a mistake than a robot's error, and which points of paths are left out."""
    notes = []
    far = [pose for pose in poses if pose.accuracy > _FAR]
    if far:
        most = max(pose.accuracy for pose in far)
        names = listed(pose.name for pose in far)
        notes.append(f"poses {names}: up to {most:.3g} m from their commands: are units and base the same?")
    turned = [pose.name for pose in poses if pose.turned is not None and max(map(abs, pose.turned)) > _FAR]
    if turned:
        notes.append(f"poses {listed(turned)}: turned by more than {_FAR:g} rad: is the rotation of that kind?")
    for path in paths:
        if path.left_out:
            notes.append(
                f"path {path.name}: {path.left_out} of {path.left_out + path.points} points are not passed by"
                " all cycles and are left out"
            )
    return notes
