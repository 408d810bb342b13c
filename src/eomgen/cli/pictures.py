"""Commands that show results: figures, a page, and a scene."""

from __future__ import annotations

import argparse
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..files import FIGURE_ENDINGS
from ..robot.value import Robot

Load = Callable[[argparse.Namespace], Robot]
Progress = Callable[[str], Any]

TRAJECTORY = "trajectory.npz"


def result_path(path: Path) -> Path:
    """The file of a result: the path itself, or ``trajectory.npz`` in a folder.

    Raises:
        InputError: there is none.
    """
    if path.is_dir():
        if not (path / TRAJECTORY).is_file():
            raise InputError(f"{path}: has no {TRAJECTORY}; allowed: a folder that eomgen simulate wrote, or a .npz")
        return path / TRAJECTORY
    return path


def add_plot(commands: Any) -> None:
    """``eomgen plot``."""

    def run(options: argparse.Namespace) -> None:
        from ..pictures.simulation import plot_result
        from ..simulation.result import load_result

        path = result_path(options.result)
        for written in plot_result(load_result(path), options.output or path.parent, f".{options.format}"):
            print(f"wrote {written}")

    command = _result_command(commands, "plot", run, "figures of a result for print")
    command.add_argument("-o", "--output", type=Path, metavar="FOLDER", help="folder to write to (the result's)")
    command.add_argument(
        "--format", choices=[ending[1:] for ending in FIGURE_ENDINGS], default="pdf", help="of files (pdf)"
    )


def add_report(commands: Any, load: Load, progress: Progress) -> None:
    """``eomgen report``; ``load`` reads a robot."""

    def run(options: argparse.Namespace) -> None:
        from ..pictures.page import report_of
        from ..simulation.result import load_result

        path = result_path(options.result)
        result = load_result(path)
        robot = load(options) if options.robot is not None else None
        with progress("reporting") as report:
            page = report_of(result, robot, modes=not options.no_modes, progress=report)
        for line in page.missing:
            print(f"missing: {line}")
        print(f"wrote {page.save(options.output or path.with_name('report.html'))}")

    command = _result_command(commands, "report", run, "one page about a result, with figures and tables")
    command.add_argument("-o", "--output", type=Path, metavar="FILE", help="page to write (report.html at the result)")
    command.add_argument("--no-modes", action="store_true", help="without frequencies along the program")
    _add_robot(command)


def add_view(commands: Any, load: Load, progress: Progress) -> None:
    """``eomgen view``; ``load`` reads a robot."""

    def run(options: argparse.Namespace) -> None:
        from ..pictures.browser import View
        from ..simulation.result import load_result

        result = load_result(result_path(options.result))
        robot = load(options) if options.robot is not None else None
        with progress("computing reactions"):
            view = View(result, robot, port=options.port)
        for note in view.notes:
            print(f"note: {note}")
        print(f"{view.address} shows {result.robot}; Ctrl-C ends it", flush=True)
        if not options.no_browser:
            webbrowser.open(view.address)
        try:
            view.wait()
        except KeyboardInterrupt:
            view.close()

    command = _result_command(commands, "view", run, "a result in space, in the browser")
    command.add_argument("--port", type=int, default=8080, help="to listen at on this machine (8080, or the next free)")
    command.add_argument("--no-browser", action="store_true", help="print the address only")
    _add_robot(command)


def _result_command(commands: Any, name: str, function: Any, text: str) -> argparse.ArgumentParser:
    command: argparse.ArgumentParser = commands.add_parser(
        name, help=text, description=text[0].upper() + text[1:] + "."
    )
    command.add_argument("result", metavar="OUT", type=Path, help="folder of eomgen simulate, or its trajectory.npz")
    command.set_defaults(command=function)
    return command


def _add_robot(command: argparse.ArgumentParser) -> None:
    command.add_argument("--robot", help="the robot that was simulated (the one that the result keeps)")
    command.add_argument("--inertia", choices=("error", "warn", "project"), help="as in the other commands (error)")
    command.add_argument("--urdf-damping", action="store_true", help="as in the other commands")
