"""Commands about the accuracy of a TCP: accuracy, by ISO 9283; tolerance; compensate, which corrects paths."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...files import FIGURE_ENDINGS, check_ending
from ..choices import MODES
from ..shared.command import Command
from ..shared.numbers import by_name, coordinate_values, real, whole
from ..shared.options import (
    FORCE_LIMITS,
    VELOCITY_LIMITS,
    add_amounts,
    add_choice,
    add_confidence,
    add_json,
    add_names,
    add_old_name,
    add_page,
    add_pose,
    add_rotation,
    add_rows,
    add_sample_time,
    add_seed,
    keywords,
)
from ..shared.output import say_lines, show_json, show_written
from ..shared.progress import progress_bar, stage_bar
from ..shared.reading import add_robot, add_robot_of_result, read_robot
from ..shared.writing import (
    check_output,
    name_older_pages,
    pages_written,
    saved_or_drawn,
    show_measured,
    show_with_page,
)


def _add_accuracy(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "results",
        metavar="RESULT",
        type=Path,
        nargs="*",
        help="folders or files of eomgen simulate: cycles of one trajectory; or measured poses and paths, .csv or .npz",
    )
    add_robot_of_result(parser, "with --scenario and --plan in the place of results: the samples of a sweep")
    parser.add_argument("--scenario", metavar="FILE", help="a scenario: of these samples")
    parser.add_argument("--plan", metavar="FILE", help="plan of a sweep: of these samples (.toml)")
    parser.add_argument("--commands", metavar="FILE", type=Path, help="commanded poses or paths of measured files")
    parser.add_argument("--frame", help="frame or link to look at (the one in measured files)")
    add_rotation(parser)
    planes = "compare paths in planes normal to the commanded one, or sample by sample"
    add_choice(parser, "--match", ("plane", "sample"), planes)
    parser.add_argument("--band", type=real, metavar="M", help="limit band of stabilization, m (the repeatability)")
    between = "poses whose distance is looked at; more than once (each and the next one)"
    add_rows(parser, "--distance", "POSE POSE", between)
    for name, old, about in (("--test-load", "load", "load"), ("--test-velocity", "rate", "velocity")):
        about = f"{about} of the test, in words (what simulations say)"
        option = parser.add_argument(name, dest=old, default="", metavar="TEXT", help=about)
        add_old_name(parser, f"--{old}", option)
    parser.add_argument("-o", "--output", type=Path, help="write all figures, .json")
    parser.add_argument("--plot", type=Path, help="draw them, .svg, .pdf or .png")
    add_page(parser)
    add_json(parser)


def _accuracy(options: argparse.Namespace) -> None:
    from ...identification.iso_9283.solve import accuracy
    from ...sweep.plan import load_plan

    if options.output is not None:
        check_ending(options.output, ".json")
    if options.plot is not None:
        check_ending(options.plot, *FIGURE_ENDINGS, label="plot")
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
        written.append(figures.plot(path=options.plot))
    show_with_page(options, figures, written)


def _add_tolerance(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument(
        "table",
        metavar="TABLE",
        type=Path,
        help=".toml: standard deviations or bounds of parameters, by the names of calibrate, and correlations",
    )
    parser.add_argument("--frame", metavar="NAME", help="frame or link to look at (tcp, or the end of the robot)")
    where = parser.add_mutually_exclusive_group()
    add_pose(where)
    where.add_argument("--random", type=whole, default=0, metavar="N", help="poses within the joints' limits")
    where.add_argument("--along", type=Path, metavar="MOTION", help="along a motion: .csv or .npz")
    add_seed(parser)
    parser.add_argument("--wrench", nargs=6, type=real, metavar="F", help="force and moment on the frame, N and N m")
    add_confidence(parser)
    parser.add_argument("--accuracy", type=real, metavar="M", help="coverage radius to reach: what to tighten")
    parser.add_argument("-o", "--output", type=Path, help="the result, .json, or a map of the poses .svg, .pdf or .png")
    add_page(parser)
    add_json(parser)


def _tolerance(options: argparse.Namespace) -> None:
    from ...identification.tolerances.solve import tolerance

    check_output(options, ".json")
    robot = read_robot(options)
    with stage_bar("looking at tolerances") as report:
        settings = keywords(tolerance, options, poses=coordinate_values("pose", options.pose), progress=report)
        regions = tolerance(robot, options.table, options.frame, **settings)
        allocation = None if options.accuracy is None else regions.allocate(options.accuracy)
    written = pages_written(options, regions) + saved_or_drawn(options, regions)
    name_older_pages(written)
    if options.json:
        show_json({**regions.as_dict(), "allocation": None if allocation is None else allocation.as_dict()})
        return
    say_lines([*regions.lines(), *([] if allocation is None else ["", *allocation.lines()])])
    show_written(written)


def _add_compensate(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument(
        "--scenario",
        metavar="FILE",
        help="a scenario: path of a .toml file, or a built-in name (the reference trajectory of eomgen simulate)",
    )
    parser.add_argument("--frame", help="frame or link to look at (that of the scenario)")
    add_choice(parser, "--mode", MODES, "by repeated simulation, or by static equilibria along the path")
    add_sample_time(parser, None, "the scenario's output step")
    axes = "along the tool's axes, x, y, z (1), and about them, rx, ry, rz (0.1 m/rad)"
    add_names(parser, "--weights", "AXIS=W", f"of errors {axes}; 0: not corrected", default=None)
    inertia = parser.add_argument(
        "--inertia-forces", dest="accelerations", action="store_true", help="static: deflections by inertia forces, too"
    )
    add_old_name(parser, "--accelerations", inertia)
    parser.add_argument("--iterations", type=whole, default=30, metavar="N", help="dynamic: simulations at most (30)")
    add_amounts(parser, "--velocity-limits", "--rates", f"{VELOCITY_LIMITS}: NAME=VALUE", "rates")
    add_amounts(parser, "--force-limits", "--drive-limits", f"{FORCE_LIMITS}: NAME=VALUE", "drive_limits")
    parser.add_argument(
        "--robustness", type=real, metavar="SHARE", help="try robots whose stiffness is wrong by it, such as 0.2"
    )
    parser.add_argument("--draws", type=whole, default=3, metavar="N", help="of them with random signs (3)")
    add_seed(parser)
    about = "write a scenario that follows the compensated path"
    file = parser.add_argument("--write-scenario", dest="toml", type=Path, metavar="FILE", help=about)
    add_old_name(parser, "--toml", file)
    parser.add_argument("-o", "--output", type=Path, help="the result, .npz, or a figure .svg, .pdf or .png")
    add_page(parser)
    add_json(parser)


def _compensate(options: argparse.Namespace) -> None:
    from ...identification.compensating.solve import compensate

    check_output(options, ".npz")
    if options.toml is not None:
        check_ending(options.toml, ".toml", label="write-scenario")
    robot = read_robot(options)
    with progress_bar("compensating") as report:
        settings = keywords(
            compensate,
            options,
            weights=_numbers("weights", options.weights),
            rates=_numbers("velocity-limits", options.rates),
            drives=_numbers("force-limits", options.drive_limits),
            progress=report,
        )
        path = compensate(robot, options.scenario, **settings)
    written = [] if options.toml is None else path.to_scenario(options.toml)
    show_measured(options, path, written + saved_or_drawn(options, path))


def _numbers(label: str, texts: list[str] | None) -> dict[str, float] | None:
    """Return numbers by name; InputError where one has none, or a name is given twice."""
    return None if texts is None else by_name(label, texts)


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
        "TCP accuracy by the tolerances of joints, links and stiffness",
        {"tolerance arm.toml tolerances.toml --random 200": "coverage radius at the TCP, and what contributes to it"},
    ),
    Command(
        _add_compensate,
        _compensate,
        "the compensated path, on which the TCP of the elastic robot goes where it should",
        {"compensate arm.toml --scenario s.toml --write-scenario new.toml": "a scenario of the compensated path"},
    ),
)
