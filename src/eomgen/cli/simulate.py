"""Commands of a robot over time: simulate, and feedforward of a motion."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..errors import InputError, IntegrationStopped
from ..files import check_ending
from ..results.beside import BESIDE_SIMULATION, TRAJECTORY
from .shared.command import Command
from .shared.numbers import real
from .shared.options import add_json, add_names
from .shared.output import can_be_left_out, say, show_files, show_result, show_written
from .shared.progress import progress_bar, stage_bar
from .shared.reading import add_robot, read_robot
from .shared.writing import remove_older


def _add_simulate(parser: argparse.ArgumentParser) -> None:
    from ..integration.methods import METHODS

    add_robot(parser)
    parser.add_argument("-o", "--output", type=Path, default=Path("out"), help="folder for results and plots (out)")
    parser.add_argument("--scenario", metavar="FILE", help="a scenario: path of a .toml file, or a built-in name")
    parser.add_argument("--stream", metavar="FOLDER", help="write states there while they are integrated (Zarr)")
    parser.add_argument("--duration", type=real, metavar="S", help="duration in seconds (2)")
    parser.add_argument("--method", choices=METHODS, help="method of integration (auto)")
    goal = "goal of the principal coordinates, rad or m, joint by joint"
    add_names(parser, "--goal", "Q", goal, type=real, default=None)
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
    robot, target = read_robot(options), options.output / TRAJECTORY
    scenario = load_scenario(options.scenario) if options.scenario else None
    replaced = target.exists()
    try:
        with progress_bar("simulating") as report:
            if scenario is not None:
                result = run_scenario(robot, scenario, progress=report, stream=options.stream)
            else:
                result = simulate(robot, progress=report, **motion)
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
    add_robot(parser)
    parser.add_argument(
        "--scenario", metavar="FILE", required=True, help="whose motion it is: path of a .toml file, or a built-in name"
    )
    parser.add_argument("-o", "--output", type=Path, help="samples: .csv or .npz")
    add_json(parser)


def _feedforward(options: argparse.Namespace) -> None:
    from ..control.elastic_feedforward import feedforward
    from ..scenario.load import load_scenario

    if options.output is not None:
        check_ending(options.output, ".csv", ".npz")
    robot = read_robot(options)
    with stage_bar("feed-forward") as report:
        result = feedforward(robot, load_scenario(options.scenario), progress=report)
    show_result(options, result)
    if options.output is not None:
        written = [result.save(options.output)]
        if not options.json:
            show_written(written)


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
        {"feedforward arm.toml --scenario s.toml -o f.csv": "samples of drives behind elastic gears"},
    ),
)
