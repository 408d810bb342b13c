"""Commands about a state: deflection, modes, response, linearize; and budget for the TCP error of a simulation."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..files import check_ending
from ..progress import StageReport
from .choices import KINDS
from .shared.command import Command
from .shared.numbers import by_name, coordinate_values, gains, once_each, real, reals, whole
from .shared.options import add_choice, add_json, add_names, add_old_name, add_page, add_pose, add_rows
from .shared.progress import progress_bar, stage_bar
from .shared.reading import add_result, add_robot, add_robot_of_result, read_robot, result_path
from .shared.writing import check_output, saved_or_drawn, show_and_write, show_with_page

if TYPE_CHECKING:
    from ..robot.value import Robot

_DRIVES = {
    "locked": "locked (brakes on)",
    "free": "free under constant forces",
    "pd": "held by gains (pd)",
}


def _add_deflection(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    _add_state(parser, choices=("locked", "pd"))
    parser.add_argument(
        "--map",
        nargs=9,
        type=real,
        metavar="X",
        help="compliance over a plane: a corner and the two edges from it, three numbers each, m",
    )
    parser.add_argument(
        "--points",
        nargs=2,
        type=whole,
        default=(21, 21),
        metavar="N",
        help="how many points: of the map (21 21)",
    )
    about = "stiffness matrix of a joint over its coordinates, in the place of the frame's"
    parser.add_argument("--matrix", metavar="JOINT", help=about)
    about = "the map: .npz, or a figure .svg, .pdf or .png; the matrix: .csv, .npz or .mtx; else of beams: .csv, figure"
    parser.add_argument("-o", "--output", type=Path, help=about)
    add_page(parser)


def _deflection(options: argparse.Namespace) -> None:
    from ..analysis.statics import NO_BEAM, deflection

    for name in ("map", "matrix"):
        if options.report is not None and getattr(options, name) is not None:
            raise InputError(f"report and {name} are both given; allowed: one of them")
    if options.matrix is not None:
        _deflection_of_joint(options)
        return
    check_output(options, ".npz", *(() if options.map is not None else (".csv",)))
    robot = read_robot(options)
    if options.map is None and options.output is not None:
        if all(link.beam is None for link in robot.links):
            raise InputError(f"output: {NO_BEAM.format(robot.name)}")
        check_output(options, ".csv")
    with progress_bar("deflecting") as report:
        about = _state_options(options, lambda text: report(0.0, text))
        pose = coordinate_values("pose", options.pose)
        result: Any
        if options.map is None:
            result = deflection(robot, pose, **about)
        else:
            from ..analysis.compliance import compliance_map

            corner, first, second = options.map[:3], options.map[3:6], options.map[6:]
            about["progress"] = report
            result = compliance_map(robot, corner, first, second, tuple(options.points), pose=pose, **about)
    show_with_page(options, result, saved_or_drawn(options, result))


def _deflection_of_joint(options: argparse.Namespace) -> None:
    from ..analysis.statics import MATRIX_ENDINGS, joint_stiffness_matrix

    for name in ("map", "frame"):
        if getattr(options, name) is not None:
            raise InputError(f"matrix and {name} are both given; allowed: one of them")
    if options.output is not None:
        check_ending(options.output, *MATRIX_ENDINGS)
    robot = read_robot(options)
    with stage_bar("deflecting") as report:
        about = _state_options(options, report)
        del about["frame"]
        matrix = joint_stiffness_matrix(robot, options.matrix, coordinate_values("pose", options.pose), **about)
    show_and_write(options, matrix)


def _add_modes(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    _add_state(parser)
    path = parser.add_mutually_exclusive_group()
    about = "end of a path that begins at --pose, written as that"
    add_old_name(path, "--goal", path.add_argument("--end-pose", dest="goal", nargs="+", metavar="Q", help=about))
    path.add_argument("--along", type=Path, metavar="RESULT", help="along a motion: of a simulation")
    parser.add_argument("--points", type=whole, default=21, metavar="N", help="how many points: of the path (21)")
    parser.add_argument("-o", "--output", type=Path, help="figure of shapes, or of a path's modes: .svg, .pdf or .png")


def _modes(options: argparse.Namespace) -> None:
    from ..analysis.modal import modes, modes_along

    check_output(options)
    robot = read_robot(options)
    with stage_bar("linearising") as report:
        about = _state_options(options, report)
        if options.along is None and options.goal is None:
            at_pose = modes(robot, coordinate_values("pose", options.pose), **about)
            show_and_write(options, at_pose, robot)
            return
        tracks = modes_along(robot, _poses_along(robot, options), **about)
    show_and_write(options, tracks)


def _poses_along(robot: Robot, options: argparse.Namespace) -> Any:
    """Return poses from --pose to --end-pose, or of the reference trajectory of a result, (points, n)."""
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
    poses = np.zeros((len(rows), len(kernel.coordinates)))
    passive = index_of(kernel.coordinates, result.passive)
    poses[:, passive] = result.trajectory.q[rows][:, passive]
    poses[:, index_of(kernel.coordinates, result.program_coordinates)] = result.program_q[rows]
    return poses


def _add_ports(parser: argparse.ArgumentParser) -> None:
    inputs = "actuator forces (joint1.gamma) and components of wrenches (tcp.fx, tcp.mz)"
    add_names(parser, "--input", "NAME", inputs, default=None)
    motions = "coordinates (joint1.x) and motions (tcp.x, tcp.rz)"
    add_names(parser, "--to", "NAME", motions, default=None, dest="output_of")
    add_choice(parser, "--kind", KINDS, "what of them")


def _add_response(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    _add_state(parser)
    _add_ports(parser)
    parser.add_argument(
        "--frequencies", nargs=2, type=real, default=(1.0, 500.0), metavar="HZ", help="from, to (1 500)"
    )
    parser.add_argument("--points", type=whole, default=400, metavar="N", help="how many points: frequencies (400)")
    parser.add_argument("--linear", action="store_true", help="equal distances instead of equal ratios")
    parser.add_argument("-o", "--output", type=Path, help=".csv or .npz, or a figure .svg, .pdf or .png")


def _response(options: argparse.Namespace) -> None:
    import numpy as np

    from ..analysis.frequency import response
    from ..robot.model import tool_of

    check_output(options, ".csv", ".npz")
    robot = read_robot(options)
    low, high, count = options.frequencies[0], options.frequencies[1], options.points
    if not (0.0 < low < high < np.inf and count >= 2):
        raise InputError(f"frequencies: {low:g} to {high:g} Hz at {count} points; allowed: 0 < from < to, 2 or more")
    spaced = np.linspace if options.linear else np.geomspace
    with stage_bar("responding") as report:
        about = _state_options(options, report)
        frame = tool_of(robot, about.pop("frame"))
        inputs = options.input or [f"{frame}.f{axis}" for axis in "xyz"]
        outputs = options.output_of or [f"{frame}.{axis}" for axis in "xyz"]
        pose = coordinate_values("pose", options.pose)
        amplitudes = response(robot, inputs, outputs, spaced(low, high, count), pose, kind=options.kind, **about)
    show_and_write(options, amplitudes)


def _add_linearize(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    _add_state(parser, drives="free")
    _add_ports(parser)
    parser.add_argument("--along", type=Path, metavar="RESULT", help="along a motion: of a simulation, at --time")
    parser.add_argument("--time", type=real, default=0.0, metavar="S", help="of the motion, s: the nearest sample (0)")
    parser.add_argument("-o", "--output", type=Path, help="write all matrices and names, .npz")


def _linearize(options: argparse.Namespace) -> None:
    from ..analysis.matrices import linearize

    if options.output is not None:
        check_ending(options.output, ".npz")
    robot = read_robot(options)
    with stage_bar("linearising") as report:
        about = _state_options(options, report)
        state: dict[str, Any] = {"pose": coordinate_values("pose", options.pose)}
        if options.along is not None:
            if options.pose is not None:
                raise InputError("pose and along are both given; allowed: one of them")
            if options.states:
                raise InputError("state and along are both given; allowed: one of them (a motion has its states)")
            del about["z"]
            state = _state_at(options.along, options.time)
        system = linearize(robot, **state, inputs=options.input, outputs=options.output_of, kind=options.kind, **about)
    show_and_write(options, system)


def _state_at(path: Path, time: float) -> dict[str, Any]:
    """Return coordinates, velocities and actuator forces of a result at the sample nearest to a time."""
    import numpy as np

    from ..simulation.result import load_result

    motion = load_result(result_path(path)).trajectory
    if not motion.t[0] <= time <= motion.t[-1]:
        raise InputError(f"time: {time:g} s; allowed: {motion.t[0]:g} to {motion.t[-1]:g} s")
    k = int(np.abs(motion.t - time).argmin())
    return {
        "pose": dict(zip(motion.coordinates, motion.q[k].tolist(), strict=True)),
        "v": motion.v[k],
        "u": motion.u[k],
        **({} if motion.z is None else {"z": motion.z[k]}),
    }


def _add_budget(parser: argparse.ArgumentParser) -> None:
    add_result(parser)
    add_robot_of_result(parser, "the built-in one of the result's name")
    parser.add_argument("--frame", help="frame or link to look at (that of the result)")
    add_json(parser)
    parser.add_argument("-o", "--output", type=Path, help="figure: .svg, .pdf or .png")


def _budget(options: argparse.Namespace) -> None:
    from ..analysis.tool_budget import budget
    from ..description.builtin import builtin_robots
    from ..simulation.result import load_result

    check_output(options)
    result = load_result(result_path(options.result))
    if options.robot is None:
        if result.robot not in builtin_robots():
            raise InputError(f"robot: {options.result} is of {result.robot}, which is not built in; give --robot")
        options.robot = result.robot
    contributions = budget(result, read_robot(options), frame=options.frame)
    show_and_write(options, contributions)


# Options about a state of a robot


def _add_state(
    parser: argparse.ArgumentParser, *, drives: str = "locked", choices: Sequence[str] = tuple(_DRIVES)
) -> None:
    """Add options that say about which state a robot is looked at, and --json."""
    add_pose(parser)
    about = f"actuated joints: {', '.join(_DRIVES[name] for name in choices)} ({drives})"
    parser.add_argument("--drives", choices=choices, default=drives, help=about)
    parser.add_argument("--kp", nargs="+", metavar="K", help="proportional gains of pd: one number, or NAME=VALUE")
    parser.add_argument("--kd", nargs="+", metavar="K", help="derivative gains of pd: one number, or NAME=VALUE (0)")
    about = "coordinates that are fixed, in the place of principal ones"
    fixed = parser.add_argument("--fixed-coordinates", dest="fixed", nargs="*", metavar="NAME", help=about)
    add_old_name(parser, "--held", fixed)
    about = "constant force and moment at a frame or link, base frame, N and N m; more than once"
    add_rows(parser, "--load", "FRAME FX FY FZ MX MY MZ", about)
    parser.add_argument("--frame", help="frame or link to look at (tcp, or the end of the robot)")
    add_names(parser, "--set", "NAME=VALUE", "parameters, such as gravity.z=0", dest="parameters")
    add_names(parser, "--state", "NAME=VALUE", "internal states, such as j1.gamma.friction.z=1e-5 (0)", dest="states")
    add_json(parser)


def _state_options(options: argparse.Namespace, report: StageReport) -> dict[str, Any]:
    """Return keywords that all analyses about a state take, but for the pose.

    Raises:
        InputError: a value is no number, or a name is given twice.
    """
    return {
        "drives": options.drives,
        "kp": gains("kp", options.kp),
        "kd": gains("kd", options.kd),
        "fixed": options.fixed,
        "loads": once_each("load", ((row[0], reals("load", row[1:])) for row in options.load)) or None,
        "frame": options.frame,
        "parameters": by_name("set", options.parameters) or None,
        "z": by_name("state", options.states) or None,
        "progress": report,
    }


COMMANDS = (
    Command(
        _add_deflection,
        _deflection,
        "static deflection and stiffness of a frame under load",
        {
            "deflection arm.toml --load tcp 0 0 -50 0 0 0": "static deflection and stiffness of a frame",
            "deflection boom.toml -o boom.svg": "beams of the robot: forces, moments and stress along them",
            "deflection boom.toml --report boom.html": "a page about it: tables, and figures of beams",
            "deflection arm.toml --matrix joint2 -o K.csv": "stiffness matrix of a joint, for other programs",
        },
    ),
    Command(
        _add_modes,
        _modes,
        "natural frequencies, damping ratios and mode shapes at a pose or along a path",
        {"modes arm.toml --drives locked": "with brakes on: natural frequencies, damping ratios, mode shapes"},
    ),
    Command(
        _add_response,
        _response,
        "frequency response from actuator forces and wrenches to motions",
        {"response arm.toml --input tcp.fx --to tcp.x": "frequency response"},
    ),
    Command(
        _add_linearize,
        _linearize,
        "A, B, C, D about a static equilibrium or a motion",
        {"linearize arm.toml -o arm.npz": "A, B, C, D about a static equilibrium or a motion"},
    ),
    Command(
        _add_budget,
        _budget,
        "contribution of each coordinate to the TCP error of a simulation",
        {"budget out/trajectory.npz": "contribution of each coordinate to the TCP error"},
    ),
)
