"""The commands about files that people write: new, check, schema."""

from __future__ import annotations

import argparse
import json
import warnings
from pathlib import Path
from typing import Any

from ..errors import EomgenWarning, InputError


def add_files(commands: Any) -> None:
    """``eomgen new``, ``eomgen check`` and ``eomgen schema``."""
    new = _command(commands, "new", _new, "write a commented description to begin with")
    new.add_argument("name", metavar="NAME", help="of the robot: lower-case letters, digits and _")
    new.add_argument("-o", "--output", type=Path, metavar="FILE", help="a file that does not exist yet (NAME.toml)")
    new.add_argument("--scenario", action="store_true", help="a scenario for such a robot instead")
    check = _command(commands, "check", _check, "check descriptions, scenarios and plans without generating anything")
    check.add_argument("files", metavar="FILE", nargs="+", help="path of a .toml, .urdf or .xml (MJCF) file")
    check.add_argument("--json", action="store_true", help="print JSON")
    schema = _command(commands, "schema", _schema, "print the JSON Schema of a file format, for editors")
    schema.add_argument("format", nargs="?", default="robot", help="robot, scenario or plan (robot)")


def _command(commands: Any, name: str, function: Any, text: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
    parser.set_defaults(command=function)
    return parser


def _new(options: argparse.Namespace) -> None:
    from ..authoring.new import write_starter

    print(f"wrote {write_starter(options.name, options.output, 'scenario' if options.scenario else 'robot')}")


def _check(options: argparse.Namespace) -> None:
    from ..authoring.check import check_file

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EomgenWarning)  # the notes say the same
        checked = [check_file(name) for name in options.files]
    if options.json:
        print(json.dumps([file.as_dict() for file in checked], indent=1))
    else:
        print("\n".join(line for file in checked for line in file.lines))
    bad = sum(bool(file.errors) for file in checked)
    if bad:
        raise InputError(f"check: {bad} of {len(checked)} files cannot be used; allowed: what is said of each")


def _schema(options: argparse.Namespace) -> None:
    from ..authoring.schemas import schema_text

    print(schema_text(options.format), end="")
