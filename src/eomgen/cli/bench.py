"""The command bench: what the generated equations cost, beside textbook algorithms."""

from __future__ import annotations

import argparse

from .shared.command import Command
from .shared.options import add_json
from .shared.output import show_result
from .shared.progress import stage_bar
from .shared.reading import add_robot, read_robot


def _add_bench(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    add_json(parser)


def _bench(options: argparse.Namespace) -> None:
    from ..bench.beside import bench

    robot = read_robot(options)
    with stage_bar("measuring") as report:
        result = bench(robot, progress=report)
    show_result(options, result)


COMMANDS = (
    Command(
        _add_bench,
        _bench,
        "operation counts and times beside a Newton-Euler algorithm in C",
        {"bench ur5": "operation counts and times beside Newton-Euler"},
    ),
)
