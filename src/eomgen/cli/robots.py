"""Commands about robots as they are described: robots, info."""

from __future__ import annotations

import argparse
from dataclasses import replace

from .shared.command import Command
from .shared.options import add_json
from .shared.output import show_json, show_result
from .shared.progress import stage_bar
from .shared.reading import add_robot, read_robot


def _robots(options: argparse.Namespace) -> None:
    from ..description.builtin import builtin_robots
    from ..description.load import load_robot
    from ..robot.model import build_model

    rows = []
    for name in builtin_robots():
        model = build_model(load_robot(name))
        rows.append({"name": name, "coordinates": len(model.coordinates), "links": len(model.links)})
    if options.json:
        show_json(rows)
        return
    for row in rows:
        print(f"{row['name']:<18} {row['coordinates']:>3} coordinates, {row['links']:>2} moving links")


def _add_info(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument("--zeros", action="store_true", help="every zero of M, C and constraints with its reason")
    add_json(parser)


def _info(options: argparse.Namespace) -> None:
    robot = read_robot(options)
    if options.zeros:
        from ..codegen.joint.zero_listing import zero_report
        from ..codegen.kernels.constraint_rows import vanishing_rows
        from ..pipeline.derivations import derived_model

        model = derived_model(robot)
        show_result(options, zero_report(model, vanishing_rows(model)))
        return
    from ..pipeline.costs import robot_info
    from ..pipeline.mechanisms import mobility_of

    with stage_bar("deriving") as report:
        info = replace(robot_info(robot, progress=report), mobility=mobility_of(robot, progress=report))
    show_result(options, info)


COMMANDS = (
    Command(add_json, _robots, "list the built-in robots", {"robots": "the built-in robots"}, description=""),
    Command(
        _add_info,
        _info,
        "what a robot is made of, and what its equations cost",
        {"info puma560_elastic": "coordinates, parameters, zero blocks, operation counts"},
    ),
)
