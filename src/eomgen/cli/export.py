"""The command export: a robot in the formats of other tools."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..export.fmu.pack import METHODS, VERSIONS, export_fmu
from ..export.mujoco import export_mjcf, left_out
from ..robot.value import Robot
from .states import Command, Load, Progress

Export = Callable[[Robot, argparse.Namespace, Callable[[str], None]], list[Path]]


def _export_fmu(robot: Robot, options: argparse.Namespace, report: Callable[[str], None]) -> list[Path]:
    return [
        export_fmu(
            robot,
            options.output / f"{robot.name}.fmi{version}.fmu",
            version,
            method=options.method,
            step=options.step,
            progress=report,
        )
        for version in ([options.fmi] if options.fmi else VERSIONS)
    ]


def _export_mjcf(robot: Robot, options: argparse.Namespace, report: Callable[[str], None]) -> list[Path]:
    output: Path = options.output
    path = output if output.suffix == ".xml" else output / f"{robot.name}.xml"
    report("finding the step of the integrator")
    written = export_mjcf(robot, path, step=options.step, approximate=options.approximate)
    for what in left_out(robot):
        print(f"note: {what}", file=sys.stderr)
    return [written]


FORMATS: Mapping[str, tuple[str, Export]] = {  # what an option is called, what it says, and what it does
    "fmu": ("functional mock-up units for model exchange and co-simulation", _export_fmu),
    "mjcf": ("a model of MuJoCo", _export_mjcf),
}


def add_export(commands: Any, robot_command: Command, load: Load, progress: Progress) -> None:
    """``eomgen export``; ``robot_command`` makes a command that takes a robot, ``load`` reads it."""

    def run_command(options: argparse.Namespace) -> None:
        wanted = [name for name in FORMATS if getattr(options, name)]
        if not wanted:
            raise InputError(f"export: no format is given; allowed: {', '.join(f'--{name}' for name in FORMATS)}")
        robot = load(options)
        with progress("exporting") as report:
            written = [
                path for name in wanted for path in FORMATS[name][1](robot, options, lambda text: report(0.0, text))
            ]
        for path in written:
            print(f"wrote {path}")

    command = robot_command(commands, "export", run_command, "write the robot for other tools")
    for name, (text, _) in FORMATS.items():
        command.add_argument(f"--{name}", action="store_true", help=text)
    command.add_argument(
        "-o", "--output", type=Path, default=Path("out"), help="folder to write to (out); of MJCF, or a .xml file"
    )
    command.add_argument("--step", type=float, metavar="S", help="(greatest) step of integration, s (what rk4 needs)")
    units = command.add_argument_group("functional mock-up units")
    units.add_argument("--fmi", type=int, choices=VERSIONS, help="version of the interface (both)")
    units.add_argument("--method", choices=METHODS, default="rk4", help="of co-simulation (rk4)")
    models = command.add_argument_group("models of MuJoCo")
    models.add_argument("--approximate", action="store_true", help="leave out what MuJoCo has no equal for, with notes")
