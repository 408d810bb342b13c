"""The command compare: several robots for one task."""

from __future__ import annotations

import argparse

from .shared.command import Command
from .shared.numbers import real
from .shared.options import add_json, add_old_name
from .shared.output import show_result
from .shared.progress import progress_bar
from .shared.reading import add_robot, read_robot


def _add_compare(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument("others", metavar="ROBOT", nargs="+", help="the robots to compare it with")
    parser.add_argument("--duration", type=real, default=2.0, metavar="S", help="duration in seconds (2)")
    task = parser.add_mutually_exclusive_group()
    task.add_argument("--goal", type=real, nargs="+", metavar="Q", help="goal of the principal coordinates, rad or m")
    task.add_argument(
        "--line", type=real, nargs=6, metavar="X", help="straight line of the TCP: from, to, three numbers each, m"
    )
    frame = parser.add_argument("--frame", help="frame or link to look at (tcp, or the end of each robot)")
    add_old_name(parser, "--tool", frame)
    add_json(parser)


def _compare(options: argparse.Namespace) -> None:
    from ..analysis.structures import compare

    names = [options.robot, *options.others]
    robots = [read_robot(argparse.Namespace(**{**vars(options), "robot": name})) for name in names]
    line = (options.line[:3], options.line[3:]) if options.line else None
    with progress_bar("comparing") as report:
        comparison = compare(
            robots, duration=options.duration, goal=options.goal, line=line, tool=options.frame, progress=report
        )
    show_result(options, comparison)


COMMANDS = (
    Command(
        _add_compare,
        _compare,
        "design alternatives for one task",
        {"compare arm.toml other.toml": "actuator forces, reactions, TCP errors for one task"},
    ),
)
