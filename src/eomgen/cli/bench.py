"""The commands bench and bound: what generated equations cost, and how far rounding may put them off."""

from __future__ import annotations

import argparse

from .shared.command import Command
from .shared.options import add_input_ranges, add_json, ranges_of
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


def _add_bound(parser: argparse.ArgumentParser) -> None:
    from ..codegen.kernels.signatures import DTYPES

    add_robot(parser)
    parser.add_argument("--kernels", nargs="+", default=[], metavar="NAME", help="only these kernels (all)")
    add_input_ranges(parser)
    parser.add_argument("--dtype", choices=DTYPES, default="float64", help="type of all numbers (float64)")
    add_json(parser)


def _bound(options: argparse.Namespace) -> None:
    from ..precision import rounding_bounds

    robot, ranges = read_robot(options), ranges_of(options)
    with stage_bar("bounding") as report:
        result = rounding_bounds(robot, options.kernels, ranges, dtype=options.dtype, progress=report)
    show_result(options, result)


COMMANDS = (
    Command(
        _add_bench,
        _bench,
        "operation counts and times beside a Newton-Euler algorithm in C",
        {"bench ur5": "operation counts and times beside Newton-Euler"},
    ),
    Command(
        _add_bound,
        _bound,
        "proved bounds of rounding errors over ranges of inputs",
        {
            "bound ur5 --kernels inverse_dynamics": "how far rounding may put torques off",
            "bound ur5 --range joint2.gamma -1.5 1.5 --dtype float32": "over a range, in single precision",
        },
    ),
)
