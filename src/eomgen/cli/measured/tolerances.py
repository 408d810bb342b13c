"""The command about what tolerances make of a tool's pose: tolerance."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..shared import (
    Command,
    add_json,
    add_page,
    add_robot,
    as_seed,
    check_output,
    coordinate_values,
    pages_written,
    read_robot,
    real,
    saved_or_drawn,
    say_lines,
    show_json,
    show_written,
    stage_bar,
    whole,
)


def _add_tolerance(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument(
        "table",
        metavar="TABLE",
        type=Path,
        help=".toml: deviations or bounds of quantities, by the names of calibrate, and correlations",
    )
    parser.add_argument("--frame", metavar="NAME", help="frame or link to look at (the tool)")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--pose", nargs="+", metavar="VALUE", help="coordinates, m and rad, or NAME=VALUE (home)")
    where.add_argument("--random", type=whole, default=0, metavar="N", help="poses within the joints' limits")
    where.add_argument("--along", type=Path, metavar="MOTION", help=".csv or .npz, such as a simulation's result")
    parser.add_argument("--seed", type=as_seed, default=0, metavar="N", help="of the random poses (0)")
    parser.add_argument("--wrench", nargs=6, type=real, metavar="F", help="force and moment on the frame, N and N m")
    parser.add_argument("--confidence", type=real, default=0.95, metavar="P", help="of the regions (0.95)")
    parser.add_argument("--accuracy", type=real, metavar="M", help="radius to reach: which tolerances to tighten")
    parser.add_argument("-o", "--output", type=Path, help="the result, .json, or a map of the poses .svg, .pdf or .png")
    add_page(parser)
    add_json(parser)


def _tolerance(options: argparse.Namespace) -> None:
    from ...identification.tolerances.solve import tolerance
    from ...pictures.measured.tolerances import plot_tolerance

    check_output(options, ".json")
    robot = read_robot(options)
    with stage_bar("looking at tolerances") as report:
        found = tolerance(
            robot,
            options.table,
            options.frame,
            poses=coordinate_values("pose", options.pose),
            random=options.random,
            along=options.along,
            seed=options.seed,
            wrench=options.wrench,
            confidence=options.confidence,
            progress=report,
        )
        allocation = None if options.accuracy is None else found.allocate(options.accuracy)
    written = pages_written(options, found) + saved_or_drawn(options, found, plot_tolerance)
    if options.json:
        show_json({**found.as_dict(), "allocation": None if allocation is None else allocation.as_dict()})
        return
    say_lines([*found.lines(), *([] if allocation is None else ["", *allocation.lines()])])
    show_written(written)


COMMANDS = (
    Command(
        "tolerance",
        "accuracy of a tool by the tolerances of joints, links and stiffness",
        _add_tolerance,
        _tolerance,
        (("tolerance arm.toml tolerances.toml --random 200", "how accurate the tool is, and what makes it so"),),
    ),
)
