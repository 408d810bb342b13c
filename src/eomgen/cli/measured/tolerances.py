"""The command about what tolerances make of a tool's pose: tolerance."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...errors import InputError
from ...files import FIGURE_ENDINGS
from ...names import show
from ..shared import (
    Command,
    add_json,
    add_page,
    add_robot,
    coordinate_values,
    pages_written,
    read_robot,
    say,
    show_json,
    show_written,
    stage_bar,
)


def _add_tolerance(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument(
        "table", metavar="TABLE", type=Path, help=".toml: deviations or bounds of quantities, by the names of calibrate"
    )
    parser.add_argument("--frame", metavar="NAME", help="frame or link to look at (the tool)")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--pose", nargs="+", metavar="VALUE", help="coordinates, m and rad, or NAME=VALUE (home)")
    where.add_argument("--random", type=int, default=0, metavar="N", help="poses within the joints' limits")
    where.add_argument("--along", type=Path, metavar="MOTION", help=".csv or .npz, such as a simulation's result")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the random poses (0)")
    parser.add_argument("--wrench", nargs=6, type=float, metavar="F", help="force and moment on the frame, N and N m")
    parser.add_argument("--confidence", type=float, default=0.95, metavar="P", help="of the regions (0.95)")
    parser.add_argument("--accuracy", type=float, metavar="M", help="radius to reach: which tolerances to tighten")
    parser.add_argument("-o", "--output", type=Path, help="the result, .json, or a map of the poses .svg, .pdf or .png")
    add_page(parser)
    add_json(parser)


def _tolerance(options: argparse.Namespace) -> None:
    from ...identification.tolerances.budgeting import tolerance

    endings = (".json", *FIGURE_ENDINGS)
    if options.output is not None and options.output.suffix not in endings:
        raise InputError(f"output: {show(str(options.output))}; allowed: a path that ends in {', '.join(endings)}")
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
    written = pages_written(options, found)
    if options.output is not None and options.output.suffix == ".json":
        written.append(found.save(options.output))
    elif options.output is not None:
        from ...pictures.measured.tolerances import plot_tolerance

        written.append(plot_tolerance(found, options.output))
    if options.json:
        show_json({**found.as_dict(), "allocation": None if allocation is None else allocation.as_dict()})
        return
    say("\n".join([*found.lines(), *([] if allocation is None else ["", *allocation.lines()])]))
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
