"""Commands that show results: plot, report, view."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..errors import InputError
from ..files import PAGE_ENDING
from ..results.beside import PAGE
from .shared.command import Command
from .shared.options import page_path
from .shared.output import say, show_written
from .shared.progress import progress_bar, stage_bar
from .shared.reading import add_result, add_robot_of_result, add_robot_or_result, is_result, read_robot, result_path

PORT = 8080  # of a view, where none is asked for


def _add_plot(parser: argparse.ArgumentParser) -> None:
    from ..files import FIGURE_ENDINGS

    add_result(parser)
    parser.add_argument("-o", "--output", type=Path, metavar="FOLDER", help="folder to write to (the result's)")
    parser.add_argument(
        "--format", choices=[ending[1:] for ending in FIGURE_ENDINGS], default="pdf", help="of files (pdf)"
    )


def _plot(options: argparse.Namespace) -> None:
    from ..pictures.simulation import plot_result
    from ..simulation.result import load_result

    path = result_path(options.result)
    show_written(plot_result(load_result(path), options.output or path.parent, f".{options.format}"))


def _add_report(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "result",
        metavar="RESULT",
        type=Path,
        help="folder of eomgen simulate, or its trajectory.npz; what calibrate, accuracy and the like saved",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=page_path,
        metavar="FILE",
        help="page to write (report.html at a simulation; the file with .html of a calibration and the like)",
    )
    parser.add_argument(
        "--no-modes", action="store_true", help="without natural frequencies along the reference trajectory"
    )
    add_robot_of_result(parser, "the one that the result keeps")


def _report(options: argparse.Namespace) -> None:
    from ..loading import load_result
    from ..pictures.page import report_of
    from ..simulation.result import SimulationResult

    path = result_path(options.result)
    with progress_bar("reporting") as report:
        result = load_result(path)
        is_simulation = isinstance(result, SimulationResult)
        if not is_simulation and options.robot is not None:
            raise InputError(f"{path}: is no simulation; allowed: --robot with simulations")
        robot = read_robot(options) if options.robot is not None else None
        page = report_of(result, robot, modes=not options.no_modes, progress=report)
        usual = path.with_name(PAGE) if is_simulation else path.with_suffix(PAGE_ENDING)
    for line in page.missing:
        say(f"missing: {line}")
    say(f"wrote {page.save(options.output or usual)}")


def _add_view(parser: argparse.ArgumentParser) -> None:
    add_robot_or_result(parser)
    parser.add_argument("-o", "--output", type=page_path, metavar="FILE", help="page of a robot (out/NAME.view.html)")
    parser.add_argument("--port", type=int, help=f"to listen at on this machine ({PORT}, or the next free)")
    parser.add_argument(
        "--tolerance",
        type=Path,
        metavar="TABLE",
        help="a table of tolerances: draws where the TCP may be",
    )
    parser.add_argument("--no-browser", action="store_true", help="print the address only")


def _view(options: argparse.Namespace) -> None:
    if is_result(options.subject):
        _view_result(options, result_path(Path(options.subject)))
    else:
        _view_robot(options)


def _view_robot(options: argparse.Namespace) -> None:
    """Write a page with a slider for each joint, and open it."""
    import webbrowser

    from ..export.live.view import robot_page

    for option in ("robot", "tolerance", "port"):
        if getattr(options, option) is not None:
            raise InputError(f"--{option}: comes together with a robot; allowed: with a result")
    options.robot = options.subject
    robot = read_robot(options)
    page = robot_page(robot)
    for note in page.notes:
        say(f"note: {note}")
    written = page.save(options.output or Path("out") / f"{robot.name}.view.html")
    show_written([written])
    if not options.no_browser:
        webbrowser.open(written.resolve().as_uri())


def _view_result(options: argparse.Namespace, path: Path) -> None:
    """Serve a result until the browser or Ctrl-C ends it."""
    import webbrowser

    from ..pictures.browser import View
    from ..simulation.result import load_result, simulated_robot

    if options.output is not None:
        raise InputError("--output: comes together with a result, which is served; allowed: with a robot")
    result = load_result(path)
    robot = read_robot(options) if options.robot is not None else None
    regions = None
    if options.tolerance is not None:
        from ..identification.tolerances.solve import tolerance

        with stage_bar("looking at tolerances") as report:
            simulated = simulated_robot(result, robot)
            regions = tolerance(simulated, options.tolerance, result.tool, along=path, progress=report)
    with progress_bar("computing reactions"):
        port = PORT if options.port is None else options.port
        view = View(result, robot, tolerance=regions, port=port)
    for note in view.notes:
        say(f"note: {note}")
    print(f"{view.address} shows {result.robot}; Ctrl-C ends it", flush=True)
    if not options.no_browser:
        webbrowser.open(view.address)
    try:
        view.wait()
    except KeyboardInterrupt:
        view.close()


COMMANDS = (
    Command(
        _add_plot, _plot, "figures of a result for print", {"plot out --format pdf": "figures of a result for print"}
    ),
    Command(
        _add_report,
        _report,
        "one page about a result: figures, tables",
        {"report out": "one page about a result: out/report.html"},
    ),
    Command(
        _add_view,
        _view,
        "a robot, or a result, in 3-D in the browser",
        {
            "view ur5": "the robot with a slider for each joint, nothing is simulated",
            "view out": "the result in 3-D, deviations exaggerated",
        },
    ),
)
