"""The command that evaluates by a standard: accuracy."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..shared import (
    Command,
    add_json,
    add_page,
    add_robot_of_result,
    progress_bar,
    read_robot,
    real,
    show_with_page,
)


def _add_accuracy(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "results",
        metavar="RESULT",
        type=Path,
        nargs="*",
        help="folders or files of eomgen simulate, cycles of one program; or measured poses and paths, .csv or .npz",
    )
    add_robot_of_result(parser, "with --scenario and --plan in the place of results: the samples of a sweep")
    parser.add_argument("--scenario", metavar="FILE", help="of these samples: path of a .toml file, or a built-in name")
    parser.add_argument("--plan", metavar="FILE", help="of these samples: what changes from one to the next (.toml)")
    parser.add_argument("--commands", metavar="FILE", type=Path, help="commanded poses or paths of measured files")
    parser.add_argument("--frame", help="the frame to look at, where measured files have several")
    parser.add_argument(
        "--rotation",
        choices=("rotvector", "rpy", "quaternion"),
        default="rotvector",
        help="of measured orientations (rotvector)",
    )
    parser.add_argument(
        "--match",
        choices=("plane", "sample"),
        default="plane",
        help="compare paths in planes normal to the commanded one, or sample by sample (plane)",
    )
    parser.add_argument("--band", type=real, metavar="M", help="limit band of stabilization, m (the repeatability)")
    parser.add_argument(
        "--distance",
        nargs=2,
        action="append",
        metavar=("POSE", "POSE"),
        help="poses whose distance is looked at; more than once (each and the next one)",
    )
    parser.add_argument("--load", default="", help="load of the test, in words (what simulations say)")
    parser.add_argument("--rate", default="", help="speed of the test, in words (what simulations say)")
    parser.add_argument("-o", "--output", type=Path, help="write all figures, .json")
    parser.add_argument("--plot", type=Path, help="draw them, .svg, .pdf or .png")
    add_page(parser)
    add_json(parser)


def _accuracy(options: argparse.Namespace) -> None:
    from ...identification.iso_9283.solve import accuracy
    from ...sweep.plan import load_plan

    with progress_bar("evaluating") as report:
        found = accuracy(
            *options.results,
            robot=None if options.robot is None else read_robot(options),
            scenario=options.scenario,
            plan=None if options.plan is None else load_plan(options.plan),
            command=options.commands,
            frame=options.frame,
            rotation=options.rotation,
            match=options.match,
            band=options.band,
            distances=None if options.distance is None else [(a, b) for a, b in options.distance],
            load=options.load,
            rate=options.rate,
            progress=report,
        )
    written = [] if options.output is None else [found.save(options.output)]
    if options.plot is not None:
        from ...pictures.measured.accuracy import plot_accuracy

        written.append(plot_accuracy(found, options.plot))
    show_with_page(options, found, written)


COMMANDS = (
    Command(
        "accuracy",
        "accuracy and repeatability by ISO 9283, of simulations and of measured files",
        _add_accuracy,
        _accuracy,
        (
            ("accuracy out/cycle1 out/cycle2", "ISO 9283: accuracy and repeatability of poses and paths"),
            ("accuracy measured.csv --commands poses.csv", "the same of measured files"),
        ),
    ),
)
