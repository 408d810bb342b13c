"""The commands export and observer: a robot in the formats of other tools, and a filter of its state as C."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError, UnknownNameError
from ..names import nearest_or_all, show
from ..progress import StageReport
from .shared.command import Command
from .shared.numbers import by_name, real, whole
from .shared.options import add_choice, add_names
from .shared.output import say, say_lines, show_written
from .shared.progress import stage_bar
from .shared.reading import add_robot, read_robot

if TYPE_CHECKING:
    from ..robot.value import Robot

Export = Callable[["Robot", argparse.Namespace, StageReport], list[Path]]


def _export_fmu(robot: Robot, options: argparse.Namespace, report: StageReport) -> list[Path]:
    from ..export.fmu.choices import VERSIONS
    from ..export.fmu.pack import export_fmu

    return [
        export_fmu(
            robot,
            options.output / f"{robot.name}.fmi{version}.fmu",
            version,
            method=options.method,
            rtol=options.rtol,
            step=options.step,
            progress=report,
        )
        for version in ([options.fmi] if options.fmi else VERSIONS)
    ]


def _export_mjcf(robot: Robot, options: argparse.Namespace, report: StageReport) -> list[Path]:
    from ..export.mujoco import export_mjcf, left_out

    output: Path = options.output
    path = output if output.suffix == ".xml" else output / f"{robot.name}.xml"
    report("finding the step of the integrator")
    if options.segments is not None:
        robot = robot.with_segments(options.segments)
    written = export_mjcf(robot, path, step=options.step, approximate=options.approximate)
    for what in left_out(robot):
        say(f"note: {what}", sys.stderr)
    return [written]


def _export_wasm(robot: Robot, options: argparse.Namespace, report: StageReport) -> list[Path]:
    from ..export.wasm.pack import export_wasm

    return export_wasm(
        robot,
        options.output,
        kernels=options.kernels,
        dtype=options.dtype,
        model=options.model,
        progress=report,
    )


def _export_arrays(robot: Robot, options: argparse.Namespace, report: StageReport) -> list[Path]:
    from ..export.arrays import export_arrays

    output: Path = options.output
    path = output if output.suffix == ".py" else output / f"{robot.name}_arrays.py"
    return [export_arrays(robot, path, kernels=options.kernels, progress=report)]


def _export_acados(robot: Robot, options: argparse.Namespace, report: StageReport) -> list[Path]:
    from ..export.acados import STEP, export_acados

    return export_acados(
        robot,
        options.output,
        method=options.method,
        step=STEP if options.step is None else options.step,
        substeps=options.substeps,
        parameters=options.parameters,
        progress=report,
    )


@dataclass(frozen=True)
class Format:
    """A format to write.

    Attributes:
        about: what its option says.
        write: writes it, and returns paths.
        takes: names of further options that it takes.
    """

    about: str
    write: Export
    takes: tuple[str, ...]


FORMATS: Mapping[str, Format] = {  # by the names of their options
    "fmu": Format(
        "FMUs (functional mock-up units) for co-simulation and model exchange",
        _export_fmu,
        ("fmi", "method", "rtol", "step"),
    ),
    "mjcf": Format("a model of MuJoCo", _export_mjcf, ("approximate", "segments", "step")),
    "arrays": Format("a module of Python on arrays of NumPy or JAX", _export_arrays, ("kernels",)),
    "wasm": Format(
        "WebAssembly, with an ES module that calls it and TypeScript's declarations",
        _export_wasm,
        ("kernels", "model", "dtype"),
    ),
    "acados": Format(
        "a model of acados: discrete dynamics with exact derivatives in one file of C",
        _export_acados,
        ("method", "parameters", "step", "substeps"),
    ),
}


def _add_export(parser: argparse.ArgumentParser) -> None:
    from ..codegen.kernels.signatures import DTYPES
    from ..export.fmu.choices import AUTO, METHODS, VERSIONS

    add_robot(parser)
    for name, target in FORMATS.items():
        parser.add_argument(f"--{name}", action="store_true", help=target.about)
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("out"),
        help="folder to write to (out); of MJCF or a .xml file, of arrays or a .py file",
    )
    parser.add_argument(
        "--step",
        type=real,
        metavar="S",
        help="(greatest) step of integration, s (what rk4 needs); of FMUs with the methods rk4 and implicit;"
        " of acados the step of the model (0.01)",
    )
    units = parser.add_argument_group("FMUs")
    units.add_argument("--fmi", type=int, choices=VERSIONS, help="version of the interface (both)")
    units.add_argument(
        "--method", choices=METHODS, default=AUTO, help=f"method of integration: of co-simulation, of acados ({AUTO})"
    )
    units.add_argument("--rtol", type=real, metavar="R", help="relative tolerance of co-simulation at first (1e-6)")
    models = parser.add_argument_group("models of MuJoCo")
    models.add_argument("--approximate", action="store_true", help="leave out what MuJoCo has no equal for, with notes")
    models.add_argument(
        "--segments", type=whole, metavar="N", help="links that bend as chains of N rigid segments; else refused"
    )
    modules = parser.add_argument_group("WebAssembly and arrays")
    modules.add_argument(
        "--kernels", nargs="+", default=[], metavar="NAME", help="only these kernels (dynamics, kinematics, energy ...)"
    )
    modules.add_argument(
        "--model", action="store_true", help="with inverse dynamics of the rigid robot, for actuator forces"
    )
    modules.add_argument(
        "--dtype", choices=DTYPES, default="float64", help="type of all numbers: of WebAssembly (float64)"
    )
    predictions = parser.add_argument_group("models of acados")
    predictions.add_argument(
        "--substeps", type=whole, default=1, metavar="N", help="equal steps of integration in a step of the model (1)"
    )
    predictions.add_argument(
        "--parameters", nargs="+", default=[], metavar="NAME", help="run-time parameters that are p of the model (none)"
    )
    taken = {option for target in FORMATS.values() for option in target.takes}
    parser.set_defaults(unset={option: parser.get_default(option) for option in sorted(taken)})


def _export(options: argparse.Namespace) -> None:
    wanted = [name for name in FORMATS if getattr(options, name)]
    if not wanted:
        raise InputError(f"export: no format is given; allowed: {', '.join(f'--{name}' for name in FORMATS)}")
    for option, default in options.unset.items():
        takers = [name for name, target in FORMATS.items() if option in target.takes]
        if getattr(options, option) != default and not set(takers) & set(wanted):
            raise InputError(f"--{option}: given without its format; allowed: with --{' or --'.join(takers)}")
    robot = read_robot(options)
    with stage_bar("exporting") as report:
        written = [path for name in wanted for path in FORMATS[name].write(robot, options, report)]
    show_written(written)


def _add_observer(parser: argparse.ArgumentParser) -> None:
    from ..codegen.kernels.signatures import DTYPES
    from ..control.kalman_filter import FORMS

    add_robot(parser)
    about = "sensors, KIND:NAME, such as encoder:joint1.gamma, torque:joint1.motor, imu:tcp, pose:tcp"
    add_names(parser, "--measure", "SENSOR", about, required=True)
    about = "standard deviations of readings, NAME=VALUE: of sensors, or of kinds of them"
    add_names(parser, "--noise", "NAME=VALUE", about)
    about = "how fast their biases, which are states then, drift per root of a second, NAME=VALUE; others have none"
    add_names(parser, "--drift", "NAME=VALUE", about)
    about = "further states: run-time parameters, and wrench:LINK for force and moment on a link"
    add_names(parser, "--estimate", "NAME", about)
    about = "of the beginning and of noise that moves states, NAME=VALUE: position, velocity, acceleration, wrench ..."
    add_names(parser, "--uncertainty", "NAME=VALUE", about)
    parser.add_argument("--step", type=real, default=1e-3, metavar="S", help="length of a step, s (0.001)")
    about = "time of measurements after which standard deviations of the states are reported, s (1)"
    parser.add_argument("--horizon", type=real, default=1.0, metavar="S", help=about)
    add_choice(parser, "--form", FORMS, "what is kept of the covariance", default="square_root")
    add_choice(parser, "--dtype", DTYPES, "type of all numbers")
    parser.add_argument("-o", "--output", type=Path, default=Path("out"), help="folder to write to (out)")


def _observer(options: argparse.Namespace) -> None:
    from ..control.kalman_filter import Uncertainty, observer
    from ..control.observer_source import write_observer
    from ..control.sensing import Measurement

    noise, drift, known = (by_name(label, getattr(options, label)) for label in ("noise", "drift", "uncertainty"))
    names = [item.name for item in fields(Uncertainty)]
    for name in known:
        if name not in names:
            raise UnknownNameError(f"uncertainty: {show(name)} is unknown{nearest_or_all(name, names)}")
    robot = read_robot(options)
    measurement = Measurement.of(robot, options.measure, noise=noise, drift=drift)
    with stage_bar("writing the observer") as report:
        report("looking at what measurements tell")
        made = observer(
            robot,
            measurement,
            dt=options.step,
            states=options.estimate,
            uncertainty=Uncertainty(**known),
            form=options.form,
            dtype=options.dtype,
        )
        told = made.observability(horizon=options.horizon)
        written = write_observer(made, options.output, progress=report)
    say(f"{robot.name}: {len(made.states)} states by {len(made.measured)} measurements, every {options.step:g} s")
    say_lines(told.lines())
    show_written(path for path in written if path.parent == options.output)


COMMANDS = (
    Command(
        _add_export,
        _export,
        "write the robot for other tools",
        {
            "export arm.toml --fmu -o out": "FMUs (functional mock-up units) of FMI 2.0 and 3.0",
            "export arm.toml --mjcf -o arm.xml": "the same robot for MuJoCo",
            "export crane.toml --mjcf --segments 8": "the same of one whose links bend, as chains of segments",
            "export arm.toml --wasm -o out": "its kernel for browsers",
            "export arm.toml --acados --method rk4 --step 0.02": "its discrete dynamics for predictive control",
            "export arm.toml --arrays -o arm.py": "its equations on arrays of NumPy or JAX",
        },
    ),
    Command(
        _add_observer,
        _observer,
        "an extended Kalman filter as C, without heap",
        {
            "observer arm.toml --measure encoder:joint1.gamma,encoder:joint2.gamma": "states of two joints' encoders",
            "observer arm.toml --measure encoder:joint1.gamma,imu:tcp --drift imu=1e-3": "with an IMU that drifts",
            "observer arm.toml --measure encoder:joint1.gamma --dtype float32": "in single precision, for controllers",
        },
    ),
)
