"""Commands about small motions of a robot: linearize, response, and the budget of a simulation."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..errors import InputError
from .states import Command, Load, Progress, add_state, show_result, state_options, state_pose


def add_response(commands: Any, robot_command: Command, load: Load, progress: Progress) -> None:
    """``eomgen response``; ``robot_command`` makes a command that takes a robot, ``load`` reads it."""

    def run(options: argparse.Namespace) -> None:
        import numpy as np

        from ..analysis.frequency import response
        from ..robot.model import tool_of

        robot = load(options)
        low, high, count = options.frequencies[0], options.frequencies[1], options.points
        if not (0.0 < low < high < np.inf and count >= 2):
            raise InputError(
                f"frequencies: {low:g} to {high:g} Hz at {count} points; allowed: 0 < from < to, 2 or more"
            )
        spaced = np.linspace if options.linear else np.geomspace
        with progress("responding") as report:
            common = state_options(options, report)
            tool = tool_of(robot, common.pop("frame"))
            inputs = options.input or [f"{tool}.f{axis}" for axis in "xyz"]
            outputs = options.output_of or [f"{tool}.{axis}" for axis in "xyz"]
            pose = state_pose(options)
            found = response(robot, inputs, outputs, spaced(low, high, count), pose, kind=options.kind, **common)
        if options.output is not None and options.output.suffix in (".csv", ".npz"):
            found.save(options.output)
        elif options.output is not None:
            from ..pictures.analysis import plot_response

            plot_response(found, options.output)
        show_result(options, found)

    command = robot_command(commands, "response", run, "frequency response from drives and wrenches to what moves")
    add_state(command)
    _add_ports(command)
    command.add_argument(
        "--frequencies", nargs=2, type=float, default=(1.0, 500.0), metavar="HZ", help="from, to (1 500)"
    )
    command.add_argument("--points", type=int, default=400, metavar="N", help="frequencies (400)")
    command.add_argument("--linear", action="store_true", help="equal distances instead of equal ratios")
    command.add_argument("-o", "--output", type=Path, help=".csv or .npz, or a figure .svg, .pdf or .png")


def add_linearize(commands: Any, robot_command: Command, load: Load, progress: Progress) -> None:
    """``eomgen linearize``."""

    def run(options: argparse.Namespace) -> None:
        from ..analysis.matrices import linearize

        robot = load(options)
        with progress("linearising") as report:
            common = state_options(options, report)
            motion: dict[str, Any] = {"pose": state_pose(options)}
            if options.along is not None:
                if options.pose is not None:
                    raise InputError("pose and along are both given; allowed: one of them")
                motion = _state_at(options.along, options.time)
            found = linearize(
                robot, **motion, inputs=options.input, outputs=options.output_of, kind=options.kind, **common
            )
        if options.output is not None:
            found.save(options.output)
        show_result(options, found)

    command = robot_command(commands, "linearize", run, "A, B, C, D about a state of rest or a motion")
    add_state(command, drives="free")
    _add_ports(command)
    command.add_argument("--along", type=Path, metavar="RESULT", help="a trajectory.npz: about its motion at --time")
    command.add_argument("--time", type=float, default=0.0, metavar="S", help="of the motion, the nearest sample (0)")
    command.add_argument("-o", "--output", type=Path, help="write all matrices and names, .npz")


def add_budget(commands: Any, load: Load) -> None:
    """``eomgen budget``, of a result instead of a robot."""

    def run(options: argparse.Namespace) -> None:
        from ..analysis.tool_budget import budget
        from ..description.load import builtin_robots
        from ..simulation.result import load_result

        result = load_result(options.result)
        if options.robot is None:
            if result.robot not in builtin_robots():
                raise InputError(f"robot: {options.result} is of {result.robot}, which is not built in; give --robot")
            options.robot = result.robot
        found = budget(result, load(options), frame=options.frame)
        if options.output is not None:
            from ..pictures.analysis import plot_budget

            plot_budget(found, options.output)
        show_result(options, found)

    text = "what each coordinate contributes to a simulated tool's deviation"
    command = commands.add_parser("budget", help=text, description=text[0].upper() + text[1:] + ".")
    command.add_argument("result", metavar="RESULT", type=Path, help="the trajectory.npz of eomgen simulate")
    command.add_argument("--robot", help="the robot that was simulated (the built-in one of the result's name)")
    command.add_argument("--inertia", choices=("error", "warn", "project"), help="as in the other commands (error)")
    command.add_argument("--urdf-damping", action="store_true", help="as in the other commands")
    command.add_argument("--frame", help="frame or link to look at (that of the result)")
    command.add_argument("--json", action="store_true", help="print JSON")
    command.add_argument("-o", "--output", type=Path, help="figure: .svg, .pdf or .png")
    command.set_defaults(command=run)


def _add_ports(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--input", nargs="+", metavar="NAME", help="drives (joint1.gamma) and components of wrenches (tcp.fx, tcp.mz)"
    )
    command.add_argument(
        "--to", nargs="+", metavar="NAME", dest="output_of", help="coordinates (joint1.x) and motions (tcp.x, tcp.rz)"
    )
    command.add_argument(
        "--kind",
        choices=("displacement", "velocity", "acceleration"),
        default="displacement",
        help="what of them (displacement)",
    )


def _state_at(path: Path, time: float) -> dict[str, Any]:
    """Coordinates, rates and drives of a result at the sample nearest to a time."""
    import numpy as np

    from ..simulation.result import load_result

    motion = load_result(path).trajectory
    if not motion.t[0] <= time <= motion.t[-1]:
        raise InputError(f"time: {time:g} s; allowed: {motion.t[0]:g} to {motion.t[-1]:g} s")
    k = int(np.abs(motion.t - time).argmin())
    return {
        "pose": dict(zip(motion.coordinates, motion.q[k].tolist(), strict=True)),
        "v": motion.v[k],
        "u": motion.u[k],
    }
