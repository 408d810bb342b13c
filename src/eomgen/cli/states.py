"""Commands about a state of rest of a robot: deflection and modes; the options that all such commands have."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..robot.value import Robot

Load = Callable[[argparse.Namespace], Robot]
Command = Callable[..., argparse.ArgumentParser]
Progress = Callable[[str], Any]


def add_modes(commands: Any, robot_command: Command, load: Load, progress: Progress) -> None:
    """``eomgen modes``; ``robot_command`` makes a command that takes a robot, ``load`` reads it."""

    def run(options: argparse.Namespace) -> None:
        from ..analysis import modal as module

        robot = load(options)
        with progress("linearising") as report:
            common = state_options(options, report)
            if options.along is None and options.goal is None:
                if options.output is not None:
                    raise InputError("output: a figure is of modes along a path; allowed: with --goal or --along")
                show_result(options, module.modes(robot, state_pose(options), **common))
                return
            found = module.modes_along(robot, poses_along(robot, options), **common)
        if options.output is not None:
            from ..pictures.analysis import plot_tracks

            plot_tracks(found, options.output)
        show_result(options, found)

    command = robot_command(commands, "modes", run, "eigenfrequencies, damping and mode shapes at a pose or on a path")
    add_state(command)
    path = command.add_mutually_exclusive_group()
    path.add_argument("--goal", nargs="+", metavar="Q", help="end of a path of the principal coordinates, as --pose")
    path.add_argument("--along", type=Path, metavar="RESULT", help="a trajectory.npz: modes along its program")
    command.add_argument("--points", type=int, default=21, metavar="N", help="poses along the path (21)")
    command.add_argument("-o", "--output", type=Path, help="figure of the path's modes: .svg, .pdf or .png")


def add_deflection(commands: Any, robot_command: Command, load: Load, progress: Progress) -> None:
    """``eomgen deflection``."""

    def run(options: argparse.Namespace) -> None:
        robot = load(options)
        with progress("deflecting") as report:
            common = state_options(options, report)
            if options.map is None:
                if options.output is not None:
                    raise InputError("output: a file is of a map; allowed: with --map")
                from ..analysis.statics import deflection

                show_result(options, deflection(robot, state_pose(options), **common))
                return
            from ..analysis.compliance import compliance_map

            corner, first, second = options.map[:3], options.map[3:6], options.map[6:]
            found = compliance_map(
                robot,
                corner,
                first,
                second,
                tuple(options.points),
                pose=state_pose(options),
                **{**common, "progress": report},
            )
        if options.output is not None and options.output.suffix == ".npz":
            found.save(options.output)
        elif options.output is not None:
            from ..pictures.analysis import plot_compliance

            plot_compliance(found, options.output)
        show_result(options, found)

    command = robot_command(commands, "deflection", run, "static deflection and stiffness of a frame under load")
    add_state(command, choices=("locked", "pd"))
    command.add_argument(
        "--map",
        nargs=9,
        type=float,
        metavar="X",
        help="compliance over a plane: a corner and the two edges from it, three numbers each, m",
    )
    command.add_argument("--points", nargs=2, type=int, default=(21, 21), metavar="N", help="of the map (21 21)")
    command.add_argument("-o", "--output", type=Path, help="the map: .npz, or a figure .svg, .pdf or .png")


def add_state(
    command: argparse.ArgumentParser, *, drives: str = "locked", choices: Sequence[str] = ("locked", "free", "pd")
) -> None:
    """Options that say about which state a robot is looked at."""
    command.add_argument(
        "--pose", nargs="+", metavar="Q", help="principal coordinates, rad or m: all in order, or NAME=VALUE"
    )
    command.add_argument("--drives", choices=choices, default=drives, help=f"what drives do about the state ({drives})")
    command.add_argument("--kp", nargs="+", metavar="K", help="gains of pd: one number, or NAME=VALUE")
    command.add_argument("--kd", nargs="+", metavar="K", help="gains of pd by rates, the same way (0)")
    command.add_argument("--held", nargs="*", metavar="NAME", help="coordinates that stay, instead of principal ones")
    command.add_argument(
        "--load",
        nargs=7,
        action="append",
        default=[],
        metavar=("FRAME", "FX", "FY", "FZ", "MX", "MY", "MZ"),
        help="dead force and moment at a frame or link, base axes, N and N m; more than once",
    )
    command.add_argument("--frame", help="frame or link to look at (tcp, or the end of the robot)")
    command.add_argument(
        "--set", nargs="+", default=[], metavar="NAME=VALUE", help="parameters, such as gravity.z=0", dest="parameters"
    )
    command.add_argument("--json", action="store_true", help="print JSON")


def state_options(options: argparse.Namespace, report: Callable[[float, str], None]) -> dict[str, Any]:
    """Keywords that all analyses about a state of rest take."""
    return {
        "drives": options.drives,
        "kp": _gains("kp", options.kp),
        "kd": _gains("kd", options.kd),
        "held": options.held,
        "loads": {row[0]: [number("load", value) for value in row[1:]] for row in options.load} or None,
        "frame": options.frame,
        "parameters": _named("set", options.parameters) or None,
        "progress": lambda text: report(0.0, text),
    }


def state_pose(options: argparse.Namespace) -> Any:
    return _values("pose", options.pose)


def poses_along(robot: Robot, options: argparse.Namespace) -> Any:
    """Poses from --pose to --goal, or of the program of a result."""
    import numpy as np

    from ..analysis.holding import pose_of
    from ..analysis.options import kernel_of
    from ..robot.coordinates import index_of
    from ..simulation.result import load_result

    if options.points < 1:
        raise InputError(f"points: {options.points}; allowed: 1 or more")
    kernel = kernel_of(robot)
    if options.along is None:
        begin, end = (pose_of(robot, kernel, _values(k, getattr(options, k))) for k in ("pose", "goal"))
        return begin + np.linspace(0.0, 1.0, options.points)[:, np.newaxis] * (end - begin)
    result = load_result(options.along)
    if result.trajectory.coordinates != kernel.coordinates:
        raise InputError(f"{options.along}: has not the coordinates of {robot.name}; allowed: a result of this robot")
    rows = np.unique(np.linspace(0, len(result.program_q) - 1, options.points).round().astype(int))
    poses = np.zeros((len(rows), kernel.n))
    poses[:, index_of(kernel.coordinates, result.program_coordinates)] = result.program_q[rows]
    return poses


def _values(label: str, texts: Sequence[str] | None) -> Any:
    """Numbers in order, or by name."""
    if texts is None:
        return None
    if any("=" in text for text in texts):
        return _named(label, texts)
    return [number(label, text) for text in texts]


def _gains(label: str, texts: Sequence[str] | None) -> Any:
    found = _values(label, texts)
    if isinstance(found, list):
        if len(found) != 1:
            raise InputError(f"{label}: {len(found)} numbers; allowed: one number, or NAME=VALUE for each")
        return found[0]
    return found


def _named(label: str, texts: Sequence[str]) -> dict[str, float]:
    found = {}
    for text in texts:
        name, sign, value = text.partition("=")
        if not sign:
            raise InputError(f"{label}: {text!r}; allowed: NAME=VALUE")
        found[name.strip()] = number(f"{label}: {name}", value)
    return found


def number(label: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{label}: {text!r} is not a number") from None


def show_result(options: argparse.Namespace, result: Any) -> None:
    print(json.dumps(result.as_dict(), indent=1) if options.json else "\n".join(result.lines()))
