"""Read robots and results that commands begin with: their arguments, options of reading, the robot itself."""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import InputError
from ...names import show
from ...results.beside import NPZ, TRAJECTORY
from .numbers import by_name, once_each
from .output import say

if TYPE_CHECKING:
    from ...robot.value import Robot


def add_robot(parser: argparse.ArgumentParser) -> None:
    """Add a ROBOT and the options of reading it."""
    parser.add_argument("robot", metavar="ROBOT", help="built-in name, or path of a .toml, .urdf or .xml (MJCF) file")
    add_reading(parser)


def add_result(parser: argparse.ArgumentParser) -> None:
    """Add a RESULT of a simulation."""
    parser.add_argument("result", metavar="RESULT", type=Path, help="folder of eomgen simulate, or its trajectory.npz")


def add_robot_or_result(parser: argparse.ArgumentParser) -> None:
    """Add a ROBOT|RESULT, of which ``is_result`` says which it is, and the options of reading either."""
    parser.add_argument(
        "subject",
        metavar="ROBOT|RESULT",
        help="built-in name, or path of a .toml, .urdf or .xml (MJCF) file; folder of eomgen simulate, or its .npz",
    )
    add_robot_of_result(parser, "the one that the result keeps")


def is_result(subject: str) -> bool:
    """Return whether a ROBOT|RESULT is a .npz or a folder; a built-in name is one where its folder holds a result."""
    from ...description.builtin import builtin_robots

    path = Path(subject)
    return path.suffix == NPZ or (
        os.path.isdir(path) and (subject not in builtin_robots() or os.path.isfile(path / TRAJECTORY))
    )


def add_robot_of_result(parser: argparse.ArgumentParser, default: str) -> None:
    """Add the option --robot of a command about a result; ``default`` says which it is without the option."""
    parser.add_argument("--robot", help=f"the robot that was simulated ({default})")
    add_reading(parser)


def add_reading(parser: argparse.ArgumentParser, *names: str) -> None:
    """Add options of reading a robot from the fields of ``ReadOptions``, in a group of their own.

    Args:
        parser: of the command.
        names: of the fields; all if there are none.
    """
    from ...description.options import ReadOptions

    group = parser.add_argument_group("reading of descriptions")
    for item in fields(ReadOptions):
        if names and item.name not in names:
            continue
        about_it: dict[str, Any] = {"dest": item.name, **item.metadata}
        option = about_it.pop("option", f"--{item.name.replace('_', '-')}")
        if isinstance(item.default, bool):
            about_it["action"] = "store_false" if item.default else "store_true"
        group.add_argument(option, **about_it)
        if item.name == "xacro":
            package: dict[str, Any] = {"action": "append", "default": [], "metavar": "NAME=DIR"}
            package["help"] = "with --xacro: folder of a package, which $(find NAME) asks for; more than once"
            group.add_argument("--package", dest="packages", **package)


def read_robot(options: argparse.Namespace) -> Robot:
    """Read the robot of ``options.robot`` and print its notes on standard error.

    Raises:
        InputError: see ``eomgen.load_robot``.
    """
    from ...description.load import load_robot
    from ...description.options import ReadOptions

    how = {item.name: getattr(options, item.name) for item in fields(ReadOptions)} | xacro_of(options)
    if how["stops"] is not None:
        how["stops"] = by_name("stops", how["stops"].split(","))
    robot = load_robot(options.robot, **how)
    for note in robot.notes:
        say(f"note: {note}", sys.stderr)
    return robot


def xacro_of(options: argparse.Namespace) -> dict[str, Any]:
    """Return what --xacro, --package and --xacro-arg ask for, by arguments of ``load_robot``.

    Raises:
        InputError: packages or arguments without --xacro, and a name twice.
    """
    rows = []
    for text in options.packages:
        name, sign, folder = text.partition("=")
        if not (name and sign and folder):
            raise InputError(f"package: {show(text)}; allowed: NAME=DIR")
        rows.append((name, folder))
    packages = once_each("package", rows)
    arguments = once_each("xacro-arg", [_argument(text) for text in options.xacro_args or ()])
    for option, given in (("--package", packages), ("--xacro-arg", arguments)):
        if given and not options.xacro:
            raise InputError(f"{option}: given without --xacro; allowed: with it, for files of people whom you trust")
    return {"xacro": packages or bool(options.xacro), "xacro_args": arguments or None}


def _argument(text: str) -> tuple[str, str]:
    """Return name and value of an argument of xacro; a value may be empty."""
    name, sign, value = text.partition(":=")
    if not (name and sign):
        raise InputError(f"xacro-arg: {show(text)}; allowed: NAME:=VALUE")
    return name, value


def result_path(path: Path) -> Path:
    """Return the file of a result: the path itself, or ``trajectory.npz`` in a folder.

    Raises:
        InputError: there is none.
    """
    if os.path.isdir(path):
        if not os.path.isfile(path / TRAJECTORY):
            raise InputError(f"{path}: has no {TRAJECTORY}; allowed: a folder that eomgen simulate wrote, or a .npz")
        return path / TRAJECTORY
    return path
