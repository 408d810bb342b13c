"""Commands that write equations of motion, to be read or to be compiled: derive, generate."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from .shared.command import Command
from .shared.numbers import whole
from .shared.output import say, show_written
from .shared.progress import progress_bar, stage_bar
from .shared.reading import add_robot, read_robot

if TYPE_CHECKING:
    from ..robot.value import Robot


def _add_derive(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    style = parser.add_mutually_exclusive_group()
    style.add_argument("--text", action="store_true", help="plain text (the default)")
    style.add_argument("--latex", action="store_true", help="a LaTeX fragment for amsmath")
    parser.add_argument("--numbers", action="store_true", help="keep the description's numbers, no symbols for them")
    parser.add_argument("-o", "--output", type=Path, help="file to write to (standard output)")


def _derive(options: argparse.Namespace) -> None:
    from ..codegen.closed_form.readable import readable_closed_form
    from ..files import write_atomically
    from ..robot.model import build_model

    form = readable_closed_form(build_model(read_robot(options)), numbers=options.numbers)
    text = (form.latex() if options.latex else "\n".join(form.lines())) + "\n"
    if options.output is None:
        print(text, end="")
        return
    show_written([write_atomically(options.output, lambda stream: stream.write(text.encode()), read=None)])


def _add_generate(parser: argparse.ArgumentParser) -> None:
    from ..codegen.kernels.groups import ON_REQUEST, PACKAGE
    from ..codegen.kernels.signatures import DTYPES
    from ..runtime.levels import LEVELS

    add_robot(parser)
    parser.add_argument("-o", "--output", type=Path, default=Path("generated"), help="folder to write to (generated)")
    parser.add_argument("--dtype", choices=DTYPES, default="float64", help="type of all numbers (float64)")
    processors = parser.add_mutually_exclusive_group()
    processors.add_argument(
        "--levels",
        action="extend",
        type=_names,
        default=[],
        metavar="LEVEL[,LEVEL...]",
        help=f"x86-64 levels to compile for, {', '.join(LEVELS)} or all (v1 and the best here; of wheels all)",
    )
    processors.add_argument("--native", action="store_true", help="compile for this processor alone")
    parser.add_argument(
        "--scalar", action="store_true", help="write one file of C without SIMD; batches are computed state by state"
    )
    parser.add_argument(
        "--libm", action="store_true", help="call the C library for sines and cosines: other last bits than polynomials"
    )
    parser.add_argument("--cmake", action="store_true", help="with a C++17 header, a CMake package, a pkg-config file")
    parser.add_argument("--ros2", action="store_true", help="that, and a package of ROS 2 that simulates the robot")
    parser.add_argument("--wheel", action="store_true", help="write a wheel, which pip installs without eomgen")
    parser.add_argument(
        "--simt", action="store_true", help="write one text for CUDA, HIP, OpenCL C and C++: one thread per state"
    )
    parser.add_argument("--tile", type=whole, metavar="N", help="of that: states whose numbers stand side by side (32)")
    parser.add_argument(
        "--contract", action="store_true", help="of that: products and sums may be one operation: other last bits"
    )
    parser.add_argument(
        "--samples", type=whole, default=0, metavar="N", help="with NAME_samples.c, which tests the C in N states"
    )
    parser.add_argument("--report", type=Path, metavar="FILE", help="write the derivation, .html or .tex")
    parser.add_argument(
        "--kernels",
        action="extend",
        type=_names,
        default=[],
        metavar="NAME[,NAME...]",
        help=f"these kernels instead of {', '.join(PACKAGE)}; all: these, and {', '.join(ON_REQUEST)};"
        " derivatives by name, such as energy_adjoint: _tangent, _adjoint, _hessian, _parameter_tangent,"
        " _parameter_adjoint, _jet1 to _jet4",
    )


def _names(text: str) -> list[str]:
    """Names with commas in between."""
    return [name.strip() for name in text.split(",")]


def _generate(options: argparse.Namespace) -> None:
    from ..errors import InputError
    from ..export.wheel import export_wheel
    from ..pipeline.generating import check_module_name, generate, left_out
    from ..pipeline.options import Options

    robot = read_robot(options)
    if options.simt:
        _generate_simt(robot, options)
        return
    for flag, is_given in (("--tile", options.tile is not None), ("--contract", options.contract)):
        if is_given:
            raise InputError(f"{flag}: given without --simt; allowed: with --simt")
    chosen = Options(
        tuple(options.kernels),
        options.dtype,
        options.native,
        levels=tuple(options.levels),
        scalar=options.scalar,
        libm=options.libm,
    )
    if options.wheel and (options.cmake or options.ros2 or options.native or options.report or options.samples):
        raise InputError(
            "--wheel stands without --cmake, --ros2, --native, --report and --samples; allowed: with --dtype, --levels,"
            " --kernels, --scalar, --libm"
        )
    if note := check_module_name(robot.name):
        say(f"note: {note}", sys.stderr)
    with progress_bar("generating") as report:
        if options.wheel:
            show_written([export_wheel(robot, options.output, chosen, progress=report)])
        else:
            wanted = {name: getattr(options, name) for name in ("cmake", "ros2", "report", "samples")}
            say(str(generate(robot, options.output, chosen, **wanted, progress=report)))
    if not chosen.kernels:
        left = ", ".join(left_out(robot))
        say(f"note: without {left} and derivatives; --kernels takes their names, or all (but derivatives)", sys.stderr)
    if options.report is not None:
        show_written([options.report])


def _generate_simt(robot: Robot, options: argparse.Namespace) -> None:
    from ..errors import InputError
    from ..export.simt import export_simt

    names = ("cmake", "ros2", "wheel", "native", "levels", "scalar", "libm", "samples", "report")
    if any(getattr(options, name) for name in names):
        without = ", ".join(f"--{name}" for name in names[:-1])
        raise InputError(
            f"--simt stands without {without} and --report; allowed: with --dtype, --kernels, --tile, --contract"
        )
    tile = {} if options.tile is None else {"tile": options.tile}
    with stage_bar("generating") as report:
        show_written(
            export_simt(
                robot,
                options.output,
                kernels=options.kernels,
                dtype=options.dtype,
                contract=options.contract,
                progress=report,
                **tile,
            )
        )


COMMANDS = (
    Command(
        _add_derive,
        _derive,
        "closed-form equations of a small robot, for a reader",
        {"derive one_link --latex": "equations in closed form, for small robots"},
    ),
    Command(
        _add_generate,
        _generate,
        "write and compile an importable package",
        {
            "generate arm.toml -o generated": "write and compile generated/arm, then: import arm",
            "generate arm.toml --cmake": "the same, with a CMake package and a header for C++17",
            "generate arm.toml --report derivation.html": "the same, and which terms survive, joint by joint",
            "generate arm.toml --simt": "a text for accelerators, CUDA, HIP or OpenCL C, one thread per state",
            "generate arm.toml --wheel": "a wheel of it, which pip installs where eomgen is not",
        },
    ),
)
