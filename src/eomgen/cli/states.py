"""Commands about a robot at rest: deflection, modes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .shared import (
    Command,
    add_robot,
    add_state,
    coordinate_values,
    progress_bar,
    read_robot,
    real,
    result_path,
    show_result,
    stage_bar,
    state_options,
    whole,
    write_result,
)

if TYPE_CHECKING:
    from ..robot.value import Robot


def _add_deflection(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    add_state(parser, choices=("locked", "pd"))
    parser.add_argument(
        "--map",
        nargs=9,
        type=real,
        metavar="X",
        help="compliance over a plane: a corner and the two edges from it, three numbers each, m",
    )
    parser.add_argument("--points", nargs=2, type=whole, default=(21, 21), metavar="N", help="of the map (21 21)")
    parser.add_argument("-o", "--output", type=Path, help="the map: .npz, or a figure .svg, .pdf or .png")


def _deflection(options: argparse.Namespace) -> None:
    robot = read_robot(options)
    with progress_bar("deflecting") as report:
        about = state_options(options, lambda text: report(0.0, text))
        pose = coordinate_values("pose", options.pose)
        if options.map is None:
            if options.output is not None:
                raise InputError("output: a file is of a map; allowed: with --map")
            from ..analysis.statics import deflection

            show_result(options, deflection(robot, pose, **about))
            return
        from ..analysis.compliance import compliance_map

        corner, first, second = options.map[:3], options.map[3:6], options.map[6:]
        about["progress"] = report
        found = compliance_map(robot, corner, first, second, tuple(options.points), pose=pose, **about)
    show_result(options, found)
    write_result(options, "plot_compliance", found, endings=(".npz",))


def _add_modes(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    add_state(parser)
    path = parser.add_mutually_exclusive_group()
    path.add_argument("--goal", nargs="+", metavar="Q", help="end of a path of the principal coordinates, as --pose")
    path.add_argument("--along", type=Path, metavar="RESULT", help="of a simulation: modes along its program")
    parser.add_argument("--points", type=whole, default=21, metavar="N", help="poses along the path (21)")
    parser.add_argument("-o", "--output", type=Path, help="figure of shapes, or of a path's modes: .svg, .pdf or .png")


def _modes(options: argparse.Namespace) -> None:
    from ..analysis.modal import modes, modes_along

    robot = read_robot(options)
    with stage_bar("linearising") as report:
        about = state_options(options, report)
        if options.along is None and options.goal is None:
            at_pose = modes(robot, coordinate_values("pose", options.pose), **about)
            show_result(options, at_pose)
            write_result(options, "plot_mode_shapes", at_pose, robot)
            return
        found = modes_along(robot, _poses_along(robot, options), **about)
    show_result(options, found)
    write_result(options, "plot_tracks", found)


def _poses_along(robot: Robot, options: argparse.Namespace) -> Any:
    """Poses from --pose to --goal, or of the program of a result, (points, n)."""
    import numpy as np

    from ..analysis.holding import pose_of
    from ..analysis.options import kernel_of
    from ..robot.coordinates import index_of
    from ..simulation.result import load_result

    if options.points < 1:
        raise InputError(f"points: {options.points}; allowed: 1 or more")
    kernel = kernel_of(robot)
    if options.along is None:
        begin, end = (pose_of(robot, kernel, coordinate_values(k, getattr(options, k))) for k in ("pose", "goal"))
        return begin + np.linspace(0.0, 1.0, options.points)[:, np.newaxis] * (end - begin)
    result = load_result(result_path(options.along))
    if result.trajectory.coordinates != kernel.coordinates:
        raise InputError(f"{options.along}: has not the coordinates of {robot.name}; allowed: a result of this robot")
    rows = np.unique(np.linspace(0, len(result.program_q) - 1, options.points).round().astype(int))
    poses = np.zeros((len(rows), kernel.n))
    passive = index_of(kernel.coordinates, result.passive)
    poses[:, passive] = result.trajectory.q[rows][:, passive]
    poses[:, index_of(kernel.coordinates, result.program_coordinates)] = result.program_q[rows]
    return poses


COMMANDS = (
    Command(
        "deflection",
        "static deflection and stiffness of a frame under load",
        _add_deflection,
        _deflection,
        (("deflection arm.toml --load tcp 0 0 -50 0 0 0", "static deflection and stiffness of a frame"),),
    ),
    Command(
        "modes",
        "eigenfrequencies, damping and mode shapes at a pose or on a path",
        _add_modes,
        _modes,
        (("modes arm.toml --drives locked", "eigenfrequencies, damping, mode shapes at a pose"),),
    ),
)
