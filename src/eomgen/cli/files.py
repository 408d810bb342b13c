"""Commands about files that people write: new, check, schema."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import EomgenWarning, InputError
from .choices import FORMATS
from .shared.command import Command
from .shared.options import add_input_ranges, add_json, ranges_of
from .shared.output import say, say_lines, show_json
from .shared.progress import stage_bar
from .shared.reading import add_reading, xacro_of

if TYPE_CHECKING:
    from ..authoring.check import Checked
    from ..precision import Float32Advice


def _add_new(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "name",
        metavar="NAME",
        help="of the robot: lower-case letters, digits and _; or, for files about one, its path",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="a file that does not exist yet (NAME.toml)")
    kinds = parser.add_mutually_exclusive_group()
    kinds.add_argument(
        "--scenario", action="store_true", help="a scenario instead: for the robot NAME, NAME_scenario.toml"
    )
    kinds.add_argument(
        "--poses", action="store_true", help="a file for measured poses instead, NAME_poses.csv, of that robot"
    )
    kinds.add_argument("--plan", action="store_true", help="a plan of a sweep instead, NAME_plan.toml, of that robot")
    about = "a table of what may be off instead, NAME_tolerances.toml, of that robot"
    kinds.add_argument("--tolerances", action="store_true", help=about)
    kinds.add_argument(
        "--dh", type=Path, metavar="TABLE", help="from a .csv table of Denavit-Hartenberg parameters, by --convention"
    )
    about = "of --dh: classic, Rz(theta) Tz(d) Tx(a) Rx(alpha), or modified, Rx(alpha) Tx(a) Rz(theta) Tz(d)"
    parser.add_argument("--convention", choices=("classic", "modified"), help=about)


def _new(options: argparse.Namespace) -> None:
    from ..authoring.new import write_dh_file, write_new_file, write_plan_file, write_poses_file, write_tolerances_file

    if (options.dh is None) != (options.convention is None):
        given, missing = ("--dh", "--convention") if options.convention is None else ("--convention", "--dh")
        raise InputError(f"new: {given} is given without {missing}; allowed: --dh TABLE --convention classic|modified")
    if options.dh is not None:
        say(f"wrote {write_dh_file(options.name, options.dh, options.convention, options.output)}")
        return
    of_robots = {"poses": write_poses_file, "plan": write_plan_file, "tolerances": write_tolerances_file}
    for kind, write in of_robots.items():
        if getattr(options, kind):
            say(f"wrote {write(options.name, options.output)}")
            return
    say(f"wrote {write_new_file(options.name, options.output, 'scenario' if options.scenario else 'robot')}")


def _add_check(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "files", metavar="FILE", nargs="+", help="path of a .toml, .urdf or .xml (MJCF) file, or a built-in robot"
    )
    parser.add_argument("--float32", action="store_true", help="and what single precision costs each robot")
    parser.add_argument(
        "--kernels", nargs="+", default=[], metavar="NAME", help="only these kernels (those that control and simulate)"
    )
    add_input_ranges(parser)
    add_reading(parser, "inertia", "floating_base", "xacro", "xacro_args")
    add_json(parser)


def _check(options: argparse.Namespace) -> None:
    from ..authoring.check import check_files

    ranges = ranges_of(options)
    given = {"--range": ranges, "--kernels": options.kernels}
    if any(given.values()) and not options.float32:
        option = next(name for name, is_given in given.items() if is_given)
        raise InputError(f"{option}: given without --float32; allowed: with it")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EomgenWarning)  # the notes say the same
        how = {"inertia": options.inertia, "floating_base": options.floating_base, **xacro_of(options)}
        checked = check_files(options.files, **how)
        costs = {file.file: _float32(file.file, how, options, ranges) for file in checked if _is_asked(options, file)}
    if options.json:
        about = [{"float32": costs[file.file].as_dict()} if file.file in costs else {} for file in checked]
        show_json([{**file.as_dict(), **more} for file, more in zip(checked, about, strict=True)])
    else:
        for file in checked:
            say_lines([*file.lines, *(costs[file.file].lines() if file.file in costs else ())])
    bad = sum(bool(file.errors) for file in checked)
    if bad:
        raise InputError(f"check: {bad} of {len(checked)} files cannot be used; allowed: what is said of each")


def _is_asked(options: argparse.Namespace, file: Checked) -> bool:
    """Whether a checked file is a robot that can be used, and --float32 was given."""
    return bool(options.float32) and file.kind == "robot" and not file.errors


def _float32(
    file: str, how: dict[str, Any], options: argparse.Namespace, ranges: Mapping[str, Sequence[float]]
) -> Float32Advice:
    """Return what single precision costs the robot of a file."""
    from ..description.load import load_robot
    from ..precision import float32_advice

    robot = load_robot(file, **how)
    with stage_bar("comparing") as report:
        return float32_advice(robot, options.kernels, ranges, progress=report)


def _add_schema(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("format", nargs="?", choices=FORMATS, default=FORMATS[0], help="of files (robot)")


def _schema(options: argparse.Namespace) -> None:
    from ..authoring.schemas import schema_text

    print(schema_text(options.format), end="")


COMMANDS = (
    Command(
        _add_new,
        _new,
        "write a commented description to begin with",
        {
            "new arm": "write arm.toml, a commented description to begin with",
            "new arm --dh table.csv --convention classic": "write arm.toml from Denavit-Hartenberg parameters",
        },
    ),
    Command(
        _add_check,
        _check,
        "check descriptions, scenarios and plans without generating anything",
        {
            "check arm.toml": "is it right? every error with file:line:column",
            "check ur5 --float32": "errors of single precision, and the operations that dominate them",
        },
    ),
    Command(
        _add_schema,
        _schema,
        "print the JSON Schema of a file format, for editors",
        {"schema robot": "JSON Schema, with which editors complete and check"},
    ),
)
