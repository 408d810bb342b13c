"""Commands about the accuracy of a tool: accuracy, by a standard; tolerance; compensate, which corrects programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...errors import InputError
from ...files import check_ending
from ..shared import (
    Command,
    add_choice,
    add_json,
    add_names,
    add_page,
    add_robot,
    add_robot_of_result,
    add_rows,
    as_seed,
    check_output,
    coordinate_values,
    keywords,
    pages_written,
    progress_bar,
    read_robot,
    real,
    saved_or_drawn,
    say_lines,
    show_json,
    show_measured,
    show_with_page,
    show_written,
    stage_bar,
    whole,
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
    add_choice(parser, "--rotation", ("rotvector", "rpy", "quaternion"), "of measured orientations")
    planes = "compare paths in planes normal to the commanded one, or sample by sample"
    add_choice(parser, "--match", ("plane", "sample"), planes)
    parser.add_argument("--band", type=real, metavar="M", help="limit band of stabilization, m (the repeatability)")
    between = "poses whose distance is looked at; more than once (each and the next one)"
    add_rows(parser, "--distance", "POSE POSE", between)
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
        settings = keywords(
            accuracy,
            options,
            robot=None if options.robot is None else read_robot(options),
            plan=None if options.plan is None else load_plan(options.plan),
            command=options.commands,
            distances=[(a, b) for a, b in options.distance] or None,
            progress=report,
        )
        figures = accuracy(*options.results, **settings)
    written = [] if options.output is None else [figures.save(options.output)]
    if options.plot is not None:
        from ...pictures.measured.accuracy import plot_accuracy

        written.append(plot_accuracy(figures, options.plot))
    show_with_page(options, figures, written)


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
        settings = keywords(tolerance, options, poses=coordinate_values("pose", options.pose), progress=report)
        regions = tolerance(robot, options.table, options.frame, **settings)
        allocation = None if options.accuracy is None else regions.allocate(options.accuracy)
    written = pages_written(options, regions) + saved_or_drawn(options, regions, plot_tolerance)
    if options.json:
        show_json({**regions.as_dict(), "allocation": None if allocation is None else allocation.as_dict()})
        return
    say_lines([*regions.lines(), *([] if allocation is None else ["", *allocation.lines()])])
    show_written(written)


def _add_compensate(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument(
        "--scenario", metavar="FILE", help="path of a .toml file, or a built-in name (the motion of eomgen simulate)"
    )
    parser.add_argument("--frame", help="frame or link that is to follow (that of the scenario)")
    parser.add_argument(
        "--mode", default="dynamic", metavar="MODE", help="dynamic: by repeated simulation; static: states of rest"
    )
    parser.add_argument("--step", type=real, metavar="S", help="between samples (the scenario's output step)")
    axes = "along the tool's axes, x, y, z (1), and about them, rx, ry, rz (0.1 m/rad)"
    add_names(parser, "--weights", "AXIS=W", f"of errors {axes}; 0: not corrected", default=None)
    parser.add_argument(
        "--accelerations", action="store_true", help="static: what accelerates the masses bends the robot, too"
    )
    parser.add_argument("--iterations", type=whole, default=30, metavar="N", help="dynamic: simulations at most (30)")
    parser.add_argument("--rates", nargs="+", metavar="NAME=V", help="greatest rates of joints, rad/s or m/s")
    parser.add_argument("--drive-limits", nargs="+", metavar="NAME=U", help="greatest forces of drives, N m or N")
    parser.add_argument(
        "--robustness", type=real, metavar="SHARE", help="try robots whose stiffness is wrong by it, such as 0.2"
    )
    parser.add_argument("--draws", type=whole, default=3, metavar="N", help="of them with signs by chance (3)")
    parser.add_argument("--seed", type=as_seed, default=0, help="of these signs (0)")
    parser.add_argument("--toml", type=Path, metavar="FILE", help="write a scenario that follows the corrected program")
    parser.add_argument("-o", "--output", type=Path, help="the result, .npz, or a figure .svg, .pdf or .png")
    add_page(parser)
    add_json(parser)


def _compensate(options: argparse.Namespace) -> None:
    from ...identification.compensating.solve import compensate
    from ...pictures.measured.compensation import plot_compensation

    check_output(options, ".npz")
    if options.toml is not None:
        check_ending(options.toml, ".toml", label="toml")
    robot = read_robot(options)
    with progress_bar("compensating") as report:
        settings = keywords(
            compensate,
            options,
            weights=_numbers("weights", options.weights),
            rates=_numbers("rates", options.rates),
            drives=_numbers("drive-limits", options.drive_limits),
            progress=report,
        )
        path = compensate(robot, options.scenario, **settings)
    written = [] if options.toml is None else path.to_scenario(options.toml)
    show_measured(options, path, written + saved_or_drawn(options, path, plot_compensation))


def _numbers(label: str, texts: list[str] | None) -> dict[str, float] | None:
    """Numbers by name; InputError where one has none."""
    values = coordinate_values(label, texts)
    if values is not None and not isinstance(values, dict):
        raise InputError(f"{label}: {texts[0] if texts else ''!r}; allowed: NAME=VALUE")
    return values


COMMANDS = (
    Command(
        _add_accuracy,
        _accuracy,
        "accuracy and repeatability by ISO 9283, of simulations and of measured files",
        {
            "accuracy out/cycle1 out/cycle2": "ISO 9283: accuracy and repeatability of poses and paths",
            "accuracy measured.csv --commands poses.csv": "the same of measured files",
        },
    ),
    Command(
        _add_tolerance,
        _tolerance,
        "accuracy of a tool by the tolerances of joints, links and stiffness",
        {"tolerance arm.toml tolerances.toml --random 200": "how accurate the tool is, and what makes it so"},
    ),
    Command(
        _add_compensate,
        _compensate,
        "a corrected program with which the elastic robot's tool goes where it should",
        {"compensate arm.toml --scenario s.toml --toml new.toml": "a program that brings the tool where it should be"},
    ),
)
