"""Commands for who reads equations, or has measured a motion."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..robot.value import Robot

Load = Callable[[argparse.Namespace], Robot]
Command = Callable[..., argparse.ArgumentParser]
Progress = Callable[[str], Any]


def add_derive(commands: Any, robot_command: Command, load: Load) -> None:
    """``eomgen derive``; ``robot_command`` makes a command that takes a robot, ``load`` reads it."""

    def derive(options: argparse.Namespace) -> None:
        from ..codegen.closed_form.readable import readable_form
        from ..robot.model import build_model

        form = readable_form(build_model(load(options)), numbers=options.numbers)
        _write(options.output, form.latex() if options.latex else "\n".join(form.lines()))

    command = robot_command(commands, "derive", derive, "closed-form equations of a small robot, for a reader")
    style = command.add_mutually_exclusive_group()
    style.add_argument("--text", action="store_true", help="plain text (the default)")
    style.add_argument("--latex", action="store_true", help="a LaTeX fragment for amsmath")
    command.add_argument("--numbers", action="store_true", help="keep the description's numbers, no symbols for them")
    command.add_argument("-o", "--output", type=Path, help="file to write to (standard output)")


def add_analysis(commands: Any, robot_command: Command, load: Load, progress: Progress) -> None:
    """``eomgen forces`` and ``eomgen fit``."""

    def forces(options: argparse.Namespace) -> None:
        from ..identification import forces as evaluate

        robot = load(options)
        with progress("evaluating") as report:
            found = evaluate(robot, options.motion, window=options.window, progress=lambda text: report(0.0, text))
        if options.output is not None:
            found.save(options.output)
        _print(options, found)

    def fit(options: argparse.Namespace) -> None:
        from ..identification import fit as estimate

        robot = load(options)
        with progress("fitting") as report:
            found = estimate(
                robot,
                options.motion,
                coordinates=options.coordinates,
                confidence=options.confidence,
                progress=lambda text: report(0.0, text),
            )
        _print(options, found)

    command = robot_command(commands, "forces", forces, "forces and reactions that belong to a measured motion")
    _add_motion(command)
    command.add_argument("--window", type=int, default=11, metavar="N", help="samples that derivatives use (11)")
    command.add_argument("-o", "--output", type=Path, help="write all forces over time, .csv or .npz")
    command = robot_command(commands, "fit", fit, "stiffness and damping from a measured motion and known drives")
    _add_motion(command)
    command.add_argument("--coordinates", nargs="+", default=(), metavar="NAME", help="those to fit (all that can be)")
    command.add_argument("--confidence", type=float, default=0.95, metavar="P", help="of the intervals (0.95)")


def add_compare(commands: Any, robot_command: Command, load: Load, progress: Progress) -> None:
    """``eomgen compare``."""

    def compare(options: argparse.Namespace) -> None:
        from ..analysis.structures import compare as compare_robots

        names = [options.robot, *options.others]
        robots = [load(argparse.Namespace(**{**vars(options), "robot": name})) for name in names]
        line = (options.line[:3], options.line[3:]) if options.line else None
        with progress("comparing") as report:
            found = compare_robots(
                robots, duration=options.duration, goal=options.goal, line=line, tool=options.tool, progress=report
            )
        _print(options, found)

    command = robot_command(commands, "compare", compare, "alternative robots for one task")
    command.add_argument("others", metavar="ROBOT", nargs="+", help="the robots to compare it with")
    command.add_argument("--duration", type=float, default=2.0, metavar="S", help="duration in seconds (2)")
    task = command.add_mutually_exclusive_group()
    task.add_argument("--goal", type=float, nargs="+", metavar="Q", help="goal of the principal coordinates, rad or m")
    task.add_argument("--line", type=float, nargs=6, metavar="X", help="tool's line: three numbers from, three to, m")
    command.add_argument("--tool", help="frame or link of all robots (each robot's own)")
    command.add_argument("--json", action="store_true", help="print JSON")


def _add_motion(command: argparse.ArgumentParser) -> None:
    command.add_argument("motion", metavar="MOTION", type=Path, help=".csv or .npz: t, coordinates, rates, drives")
    command.add_argument("--json", action="store_true", help="print JSON")


def _print(options: argparse.Namespace, result: Any) -> None:
    print(json.dumps(result.as_dict(), indent=1) if options.json else "\n".join(result.lines()))


def _write(target: Path | None, text: str) -> None:
    """The text into a file, or on standard output."""
    if target is None:
        print(text)
        return
    from ..files import write_atomically

    print(f"wrote {write_atomically(target, lambda stream: stream.write((text + chr(10)).encode()))}")
