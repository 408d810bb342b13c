"""The command live: a robot, or a result, as a page in which it is simulated."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..errors import InputError
from .shared.command import Command
from .shared.options import page_path
from .shared.output import show_written
from .shared.progress import progress_bar
from .shared.reading import add_robot_or_result, is_result, read_robot, result_path


def _add_live(parser: argparse.ArgumentParser) -> None:
    add_robot_or_result(parser)
    parser.add_argument("-o", "--output", type=page_path, metavar="FILE", help="page to write (out/NAME.live.html)")
    parser.add_argument("--scenario", metavar="FILE", help="a scenario: path of a .toml file, or a built-in name")
    parser.add_argument("--open", action="store_true", help="show the page in the browser")


def _live(options: argparse.Namespace) -> None:
    from ..export.live.page import export_live

    if is_result(options.subject):
        from ..simulation.result import load_result

        if options.scenario is not None:
            raise InputError("--scenario: given together with a result, which has its own; allowed: one of both")
        result = load_result(result_path(Path(options.subject)))
        described = read_robot(options) if options.robot is not None else None
        with progress_bar("making the page") as report:
            written = export_live(result, _page(options, result.robot), described=described, progress=report)
    else:
        if options.robot is not None:
            raise InputError("--robot: given together with a robot; allowed: with a result")
        options.robot = options.subject
        robot = read_robot(options)
        with progress_bar("making the page") as report:
            written = export_live(robot, _page(options, robot.name), scenario=options.scenario, progress=report)
    show_written([written])
    if options.open:
        import webbrowser

        webbrowser.open(written.resolve().as_uri())


def _page(options: argparse.Namespace, name: str) -> Path:
    return options.output or Path("out") / f"{name}.live.html"


COMMANDS = (
    Command(
        _add_live,
        _live,
        "a robot in the browser, simulated there",
        {
            "live puma560_elastic": "a page in which it moves, by its equations",
            "live puma560 --scenario puma560_circle": "as a scenario says",
            "live out": "a simulated motion, and what comes after it",
        },
    ),
)
