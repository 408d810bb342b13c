"""Commands of a robot over time: simulate, and feedforward of a motion."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from ..errors import InputError, IntegrationStopped
from ..files import check_ending
from ..results.beside import BESIDE_SIMULATION, TRAJECTORY
from .shared.command import Command
from .shared.numbers import once_each, real, reals
from .shared.options import add_choice, add_json, add_names
from .shared.output import can_be_left_out, say, show_files, show_result, show_written
from .shared.progress import progress_bar, stage_bar
from .shared.reading import add_robot, read_robot
from .shared.writing import remove_older


def _add_simulate(parser: argparse.ArgumentParser) -> None:
    from ..kernel.stepping.methods import METHODS

    add_robot(parser)
    parser.add_argument("-o", "--output", type=Path, default=Path("out"), help="folder for results and plots (out)")
    parser.add_argument("--scenario", metavar="FILE", help="a scenario: path of a .toml file, or a built-in name")
    parser.add_argument("--stream", metavar="FOLDER", help="write states there while they are integrated (Zarr)")
    parser.add_argument("--duration", type=real, metavar="S", help="duration in seconds (2)")
    parser.add_argument("--method", choices=METHODS, help="method of integration (auto)")
    goal = "goal of the principal coordinates, rad or m, joint by joint"
    add_names(parser, "--goal", "Q", goal, type=real, default=None)
    parser.add_argument("--global-error", action="store_true", help="estimate the error of the integration")
    within = "integrate with ever narrower tolerances until tool, tool.rotation or a coordinate is within (m, rad)"
    parser.add_argument("--within", nargs=2, action="append", metavar=("NAME", "E"), help=within)
    parser.add_argument("--no-plots", action="store_true", help="write no plots")
    add_json(parser)


def _simulate(options: argparse.Namespace) -> None:
    from ..scenario.load import load_scenario
    from ..simulation.run import run_scenario, simulate

    motion = {key: getattr(options, key) for key in ("duration", "method", "goal") if getattr(options, key) is not None}
    if options.scenario and motion:
        raise InputError(f"--{next(iter(motion))}: given together with --scenario, which says it; allowed: one of both")
    if options.stream and not options.scenario:
        raise InputError("--stream: given without --scenario; allowed: with a scenario")
    within = None
    if options.within:
        within = once_each("--within", ((name, reals("--within", [error])[0]) for name, error in options.within))
    robot, target = read_robot(options), options.output / TRAJECTORY
    scenario = load_scenario(options.scenario) if options.scenario else None
    replaced = os.path.exists(target)
    try:
        with progress_bar("simulating") as report:
            if scenario is not None:
                result = run_scenario(
                    robot,
                    scenario,
                    progress=report,
                    stream=options.stream,
                    global_error=options.global_error,
                    within=within,
                )
            else:
                result = simulate(robot, progress=report, global_error=options.global_error, within=within, **motion)
    except IntegrationStopped as error:
        if error.result is not None:  # what there is of it, marked as stopped; the status says so, too
            try:
                say(f"wrote {error.result.save(target)}: the motion until it stopped", sys.stderr)
                remove_older(target, BESIDE_SIMULATION, replaced=replaced)
            except InputError as refusal:  # why the motion stopped is said all the same
                say(f"eomgen: {refusal}", sys.stderr)
        raise
    written = [result.save(target)]
    if not options.no_plots:
        from ..pictures.simulation import plot_result

        with can_be_left_out("plots are"):
            written += plot_result(result, options.output)
    show_files(options, result.summary_lines(), result.summary(), written)
    remove_older(target, BESIDE_SIMULATION, written, replaced=replaced)


def _add_feedforward(parser: argparse.ArgumentParser) -> None:
    from ..codegen.kernels.signatures import DTYPES

    add_robot(parser)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--scenario", metavar="FILE", help="whose motion it is: path of a .toml file, or a built-in name")
    what.add_argument(
        "--c", type=Path, metavar="FOLDER", help="write it as C there: a function of a motion's derivatives"
    )
    parser.add_argument("-o", "--output", type=Path, help="samples: .csv or .npz")
    about = "over which Coulomb friction of links reverses, m/s or rad/s"
    parser.add_argument("--friction-smoothing", type=real, metavar="V", help=about)
    parser.add_argument("--step", type=real, metavar="S", help="length of a step, s (0.001); with --c")
    add_choice(parser, "--dtype", DTYPES, "type of all numbers")
    add_names(
        parser, "--outputs", "NAME", "what follows where deviations have no drive: tcp.x, joint4.gamma", default=None
    )
    parser.add_argument(
        "--tolerance", type=real, metavar="E", help="of coordinates of a stable inversion, m or rad (1e-8)"
    )
    add_json(parser)


def _feedforward(options: argparse.Namespace) -> None:
    from ..control.elastic_feedforward import feedforward
    from ..scenario.load import load_scenario

    if options.c is not None:
        _feedforward_in_c(options)
        return
    if options.step is not None or options.dtype != "float64":
        flag = "dtype" if options.step is None else "step"
        raise InputError(f"--{flag}: given with --scenario, whose samples say it; allowed: with --c FOLDER")
    if options.output is not None:
        check_ending(options.output, ".csv", ".npz")
    robot = read_robot(options)
    with stage_bar("feed-forward") as report:
        result = feedforward(
            robot,
            load_scenario(options.scenario),
            friction_smoothing=options.friction_smoothing,
            outputs=options.outputs,
            tolerance=options.tolerance,
            progress=report,
        )
    show_result(options, result)
    if options.output is not None:
        written = [result.save(options.output)]
        if not options.json:
            show_written(written)


def _feedforward_in_c(options: argparse.Namespace) -> None:
    from ..control.feedforward_source import write_feedforward

    for flag in ("output", "json", "outputs", "tolerance"):
        if getattr(options, flag) not in (None, False):
            raise InputError(f"--{flag}: given with --c, which writes no samples; allowed: with --scenario")
    robot = read_robot(options)
    step = 1e-3 if options.step is None else options.step
    with stage_bar("writing the feed-forward") as report:
        written = write_feedforward(
            robot,
            options.c,
            dt=step,
            dtype=options.dtype,
            friction_smoothing=options.friction_smoothing,
            progress=report,
        )
    show_written(path for path in written if path.parent == options.c)


COMMANDS = (
    Command(
        _add_simulate,
        _simulate,
        "simulate a reference trajectory, or a scenario, with all coordinates",
        {
            "simulate puma560_elastic -o out": "reference trajectory; trajectory.npz and plots",
            "simulate arm.toml --scenario s.toml": "trajectories, controllers, wrenches, payloads of a scenario file",
        },
    ),
    Command(
        _add_feedforward,
        _feedforward,
        "motors' angles, velocities and torques by which links follow a motion",
        {
            "feedforward arm.toml --scenario s.toml -o f.csv": "samples of drives behind elastic gears",
            "feedforward arm.toml --c out --dtype float32": "the same as C for the controller",
            "feedforward arm.toml --scenario s.toml --outputs tcp.x tcp.y": "where deviations have no drive",
        },
    ),
)
