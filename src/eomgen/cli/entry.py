"""The command line: one command after the other.

Exit status: 0; 1 something given cannot be used; 2 usage; 70 a bug of eomgen.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .._version import __version__
from ..description.load import builtin_robots, load_robot
from ..errors import EomgenError, EomgenWarning, InputError, IntegrationStopped
from ..pipeline.stages import DTYPES, KERNEL_NAMES, Options, generate
from ..robot.value import Robot
from .cache import add_cache
from .export import add_export
from .files import add_files
from .measured import add_analysis, add_compare, add_derive
from .pictures import add_plot, add_report, add_view
from .small_motions import add_budget, add_linearize, add_response
from .states import add_deflection, add_modes
from .sweep import add_sweep

OK, INPUT_ERROR, BUG = 0, 1, 70
INTERRUPTED = 130

EXAMPLES = """\
examples:
  eomgen robots                                  the built-in robots
  eomgen new arm                                 write arm.toml, a commented description to begin with
  eomgen check arm.toml                          is it right? every error with file:line:column
  eomgen schema robot                            JSON Schema, with which editors complete and check
  eomgen info puma560_elastic                    coordinates, parameters, zero blocks, operation counts
  eomgen derive one_link --latex                 equations in closed form, for small robots
  eomgen generate arm.toml -o generated          write and compile generated/arm, then: import arm
  eomgen generate arm.toml --cmake               the same, with a CMake package and a header for C++17
  eomgen simulate puma560_elastic -o out         programmed motion; trajectory.npz and plots
  eomgen simulate arm.toml --scenario s.toml     motions, drives, wrenches, payloads of a scenario file
  eomgen forces arm.toml measured.csv            drives, springs, dampers, reactions of a measured motion
  eomgen fit arm.toml measured.csv               stiffness and damping from motion and known drives
  eomgen compare arm.toml other.toml             drives, reactions, tool deviations for one task
  eomgen deflection arm.toml --load tcp 0 0 -50 0 0 0   static deflection and stiffness of a frame
  eomgen modes arm.toml --drives locked           eigenfrequencies, damping, mode shapes at a pose
  eomgen response arm.toml --input tcp.fx --to tcp.x   frequency response
  eomgen linearize arm.toml -o arm.npz           A, B, C, D about a state of rest or a motion
  eomgen budget out/trajectory.npz               what each coordinate contributes to the tool's deviation
  eomgen sweep arm.toml --scenario s.toml --plan p.toml -o out   the scenario for many values of its numbers
  eomgen export arm.toml --fmu -o out            functional mock-up units of FMI 2.0 and 3.0
  eomgen export arm.toml --mjcf -o arm.xml       the same robot for MuJoCo
  eomgen plot out --format pdf                   figures of a result for print
  eomgen report out                              one page about a result: out/report.html
  eomgen view out                                the result in space, in the browser
  eomgen bench ur5                               operation counts and times beside Newton-Euler
  eomgen cache --clear                           remove compiled kernels

ROBOT is the name of a built-in robot, or the path of a .toml, .urdf or .xml (MJCF) file.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the value is the exit status."""
    options = make_parser().parse_args(arguments)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EomgenWarning)  # the robot's notes say the same, and are printed
            command: Callable[[argparse.Namespace], None] = options.command
            command(options)
        sys.stdout.flush()
        return OK
    except EomgenError as error:
        print(f"eomgen: {error}", file=sys.stderr)
        return INPUT_ERROR if isinstance(error, InputError) else BUG
    except BrokenPipeError:  # the reader has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except KeyboardInterrupt:
        print("eomgen: interrupted", file=sys.stderr)
        return INTERRUPTED
    except Exception:  # the last resort: whatever it is, it is our bug
        print("eomgen: this is a bug of eomgen; please report it with the lines below", file=sys.stderr)
        traceback.print_exc()
        return BUG


def make_parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    parser = argparse.ArgumentParser(
        prog="eomgen",
        description="From a robot's description to compiled equations of motion.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"eomgen {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    robots = commands.add_parser("robots", help="list the built-in robots")
    robots.add_argument("--json", action="store_true", help="print JSON")
    robots.set_defaults(command=_robots)
    info = _robot_command(commands, "info", _info, "what a robot is made of, and what its equations cost")
    info.add_argument("--zeros", action="store_true", help="every zero of M and C with its reason, by joints")
    info.add_argument("--json", action="store_true", help="print JSON")
    add_files(commands)
    add_derive(commands, _robot_command, _load)
    make = _robot_command(commands, "generate", _generate, "write and compile an importable package")
    make.add_argument("-o", "--output", type=Path, default=Path("generated"), help="folder to write to (generated)")
    make.add_argument("--dtype", choices=DTYPES, default="float64", help="type of all numbers (float64)")
    make.add_argument("--native", action="store_true", help="compile for this processor alone")
    make.add_argument("--cmake", action="store_true", help="with a C++17 header, a CMake package, a pkg-config file")
    make.add_argument(
        "--kernels",
        action="extend",
        type=_names,
        default=[],
        metavar="NAME[,NAME...]",
        help=f"only these (all but tangents): {', '.join(KERNEL_NAMES)}",
    )
    _add_simulate(commands)
    add_analysis(commands, _robot_command, _load, _progress)
    add_compare(commands, _robot_command, _load, _progress)
    add_deflection(commands, _robot_command, _load, _progress)
    add_modes(commands, _robot_command, _load, _progress)
    add_response(commands, _robot_command, _load, _progress)
    add_linearize(commands, _robot_command, _load, _progress)
    add_budget(commands, _load)
    add_sweep(commands, _robot_command, _load, _progress)
    add_export(commands, _robot_command, _load, _progress)
    add_plot(commands)
    add_report(commands, _load, _progress)
    add_view(commands, _load, _progress)
    bench = _robot_command(commands, "bench", _bench, "operation counts and times beside a Newton-Euler algorithm in C")
    bench.add_argument("--json", action="store_true", help="print JSON")
    add_cache(commands)
    return parser


def _names(text: str) -> list[str]:
    """Names with commas in between."""
    return [name.strip() for name in text.split(",")]


def _add_simulate(commands: Any) -> None:
    simulate = _robot_command(commands, "simulate", _simulate, "run a programmed motion of all coordinates")
    simulate.add_argument("-o", "--output", type=Path, default=Path("out"), help="folder for results and plots (out)")
    simulate.add_argument("--scenario", metavar="FILE", help="a scenario: path of a .toml file, or a built-in name")
    simulate.add_argument("--stream", metavar="FOLDER", help="write states there while they are integrated (Zarr)")
    simulate.add_argument("--duration", type=float, metavar="S", help="duration in seconds (2)")
    simulate.add_argument("--method", help="auto, Radau, BDF, LSODA, CVODE, IDA, DOP853, RK45 or rk4 (auto)")
    simulate.add_argument(
        "--goal", type=float, nargs="+", metavar="Q", help="goal of the principal coordinates, rad or m, joint by joint"
    )
    simulate.add_argument("--no-plots", action="store_true", help="write the trajectory only")
    simulate.add_argument("--json", action="store_true", help="print JSON")


def _robot_command(commands: Any, name: str, function: Any, text: str) -> argparse.ArgumentParser:
    """A command that takes a ROBOT and the options of reading it."""
    parser: argparse.ArgumentParser = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
    parser.add_argument("robot", metavar="ROBOT", help="built-in name, or path of a .toml, .urdf or .xml (MJCF) file")
    parser.add_argument(
        "--inertia",
        choices=("error", "warn", "project"),
        help="an inertia that no body can have: refuse it, take it as it is, or take the nearest one (error)",
    )
    parser.add_argument("--urdf-damping", action="store_true", help="read <dynamics damping=...> of an URDF")
    parser.set_defaults(command=function)
    return parser


def _load(options: argparse.Namespace) -> Robot:
    robot = load_robot(options.robot, inertia=options.inertia, urdf_damping=options.urdf_damping)
    for note in robot.notes:
        print(f"note: {note}", file=sys.stderr)
    return robot


@contextmanager
def _progress(title: str) -> Iterator[Callable[[float, str], None]]:
    """A progress bar on a terminal, nothing in a pipe."""
    if not sys.stderr.isatty():
        yield lambda fraction, text: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(title, total=None)

        def report(fraction: float, text: str) -> None:
            bars.update(task, description=text or title, total=1.0 if fraction > 0 else None, completed=fraction)

        yield report


def _show(options: argparse.Namespace, result: Any) -> None:
    """A result that has ``lines`` and ``as_dict``, as the options ask for it."""
    print(json.dumps(result.as_dict(), indent=1) if options.json else "\n".join(result.lines()))


def _robots(options: argparse.Namespace) -> None:
    from ..robot.model import build_model

    rows = []
    for name in builtin_robots():
        model = build_model(load_robot(name))
        rows.append({"name": name, "coordinates": model.size, "links": len(model.links)})
    if options.json:
        print(json.dumps(rows, indent=1))
        return
    for row in rows:
        print(f"{row['name']:<18} {row['coordinates']:>3} coordinates, {row['links']:>2} moving links")


def _info(options: argparse.Namespace) -> None:
    from ..pipeline.costs import robot_info

    robot = _load(options)
    if options.zeros:
        from ..codegen.joint.zero_listing import zero_report
        from ..robot.model import build_model

        _show(options, zero_report(build_model(robot)))
        return
    with _progress("deriving") as report:
        info = robot_info(robot, progress=lambda text: report(0.0, text))
    _show(options, info)


def _generate(options: argparse.Namespace) -> None:
    robot = _load(options)
    chosen = Options(tuple(options.kernels), options.dtype, options.native)
    with _progress("generating") as report:
        target = generate(robot, options.output, chosen, cmake=options.cmake, progress=lambda text: report(0.0, text))
    print(target)


def _simulate(options: argparse.Namespace) -> None:
    from ..scenario.load import load_scenario
    from ..simulation.run import run_scenario, simulate

    given = {key: getattr(options, key) for key in ("duration", "method", "goal") if getattr(options, key) is not None}
    if options.scenario and given:
        raise InputError(f"--{next(iter(given))}: given together with --scenario, which says it; allowed: one of both")
    if options.stream and not options.scenario:
        raise InputError("--stream: given without --scenario; allowed: with a scenario")
    robot = _load(options)
    scenario = load_scenario(options.scenario) if options.scenario else None
    try:
        with _progress("simulating") as report:
            if scenario is not None:
                result = run_scenario(robot, scenario, progress=report, stream=options.stream)
            else:
                result = simulate(robot, progress=report, **given)
    except IntegrationStopped as error:
        if error.result is not None:  # what there is of it, marked as stopped; the status says so, too
            path = error.result.save(options.output / "trajectory.npz")
            print(f"wrote {path}: the motion until it stopped", file=sys.stderr)
        raise
    written = [result.save(options.output / "trajectory.npz")]
    if not options.no_plots:
        from ..pictures.simulation import plot_result

        written += plot_result(result, options.output)
    if options.json:
        print(json.dumps({"files": [str(path) for path in written], **result.summary()}, indent=1))
        return
    print("\n".join(result.summary_lines()))
    for path in written:
        print(f"wrote {path}")


def _bench(options: argparse.Namespace) -> None:
    from ..bench.beside import bench

    robot = _load(options)
    with _progress("measuring") as report:
        result = bench(robot, progress=lambda text: report(0.0, text))
    _show(options, result)


if __name__ == "__main__":
    sys.exit(main())
