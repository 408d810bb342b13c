"""Options that several commands have, alike in each; options under their old names."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from inspect import signature
from pathlib import Path
from typing import Any

from ...files import PAGE_ENDING
from ...identifiers import show_path
from ..choices import ROTATIONS
from .numbers import as_seed, once_each, real, reals

VELOCITY_LIMITS = "greatest velocities of joints, rad/s or m/s"
FORCE_LIMITS = "greatest actuator forces, N m or N"


class OldName(argparse.Action):
    """Take an option under the name that it had before, as the new one, with a note on standard error."""

    def __init__(self, *arguments: Any, new: str, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.new = new

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        print(f"note: {option} is now called {self.new}", file=sys.stderr)
        setattr(namespace, self.dest, True if self.nargs == 0 else values)


def add_old_name(parser: argparse.ArgumentParser | argparse._ArgumentGroup, old: str, option: argparse.Action) -> None:
    """Let an option of a parser, or of a group of it, be called ``old``, too; neither help nor shells say so."""
    alike = {name: getattr(option, name) for name in ("dest", "nargs", "type", "choices", "default")}
    parser.add_argument(old, action=OldName, new=option.option_strings[0], help=argparse.SUPPRESS, **alike)


def add_names(parser: argparse.ArgumentParser, option: str, name: str, about: str, **options: Any) -> None:
    """Add an option with one value or more behind it, each of which ``name`` stands for; by default none."""
    parser.add_argument(option, **{"nargs": "+", "default": (), "metavar": name, "help": about, **options})


def add_rows(parser: argparse.ArgumentParser, option: str, columns: str, about: str, **options: Any) -> None:
    """Add an option that may be given more than once, with a value for each of the columns "NAME LOW HIGH"."""
    names = tuple(columns.split())
    parser.add_argument(option, nargs=len(names), action="append", default=[], metavar=names, help=about, **options)


def add_choice(
    parser: argparse.ArgumentParser, option: str, choices: Sequence[str], about: str, default: str = ""
) -> None:
    """Add an option that is one of some words, by default the first of them."""
    default = default or choices[0]
    parser.add_argument(option, choices=choices, default=default, help=f"{about} ({default})")


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add the option --json of all commands that print results."""
    parser.add_argument("--json", action="store_true", help="print JSON")


def page_path(text: str) -> Path:
    """Read the path of a page to write, as ``type`` of an argument."""
    if Path(text).suffix != PAGE_ENDING:
        raise argparse.ArgumentTypeError(f"{show_path(text)}; allowed: a path that ends in {PAGE_ENDING}")
    return Path(text)


def add_page(parser: argparse.ArgumentParser) -> None:
    """Add the option --report of commands about measurements, and about deflection."""
    parser.add_argument("--report", type=page_path, metavar="FILE", help="write a page about it: figures, tables")


def add_rotation(parser: argparse.ArgumentParser) -> None:
    """Add the option --rotation of commands about measured poses."""
    add_choice(parser, "--rotation", ROTATIONS, "how measured orientations are written")


def add_amounts(parser: argparse.ArgumentParser, option: str, old: str, about: str, dest: str) -> None:
    """Add an option of numbers by name, which ``gains`` reads, with the name that it had before."""
    add_old_name(parser, old, parser.add_argument(option, nargs="+", metavar="VALUE", help=about, dest=dest))


def add_ranges(parser: argparse.ArgumentParser) -> None:
    """Add the option --range, which ``ranges_of`` reads."""
    add_rows(parser, "--range", "NAME LOW HIGH", "of a coordinate, m or rad (its limits); more than once")


def add_input_ranges(parser: argparse.ArgumentParser) -> None:
    """Add the option --range of commands about rounding errors, which ``ranges_of`` reads."""
    add_rows(parser, "--range", "NAME LOW HIGH", "of an input, an array or a parameter (what is usual); more than once")


def ranges_of(options: argparse.Namespace) -> dict[str, list[float]]:
    """Return least and greatest values of coordinates by --range; InputError of no number, and of a name twice."""
    return once_each("range", ((name, reals(f"range: {name}", ends)) for name, *ends in options.range))


def add_pose(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """Add the option --pose, which ``coordinate_values`` reads."""
    parser.add_argument(
        "--pose", nargs="+", metavar="Q", help="principal coordinates, rad or m: all in order, or NAME=VALUE"
    )


def add_seed(parser: argparse.ArgumentParser) -> None:
    """Add the option --seed of commands that draw random numbers."""
    parser.add_argument("--seed", type=as_seed, default=0, metavar="N", help="of random numbers (0)")


def add_confidence(parser: argparse.ArgumentParser) -> None:
    """Add the option --confidence of commands that estimate uncertainty."""
    about = "probability of coverage by intervals and regions (0.95)"
    parser.add_argument("--confidence", type=real, default=0.95, metavar="P", help=about)


def add_sample_time(parser: argparse.ArgumentParser, default: float | None, about: str) -> None:
    """Add the option --sample-time, which was --step; ``about`` says what it is by default."""
    about = f"between samples, s ({about})"
    time = parser.add_argument("--sample-time", dest="step", type=real, default=default, metavar="S", help=about)
    add_old_name(parser, "--step", time)


def keywords(function: Callable[..., Any], options: argparse.Namespace, **converted: Any) -> dict[str, Any]:
    """Return values of the options that are keywords of a function, and ``converted`` in place of the others."""
    named = [item.name for item in signature(function).parameters.values() if item.kind is item.KEYWORD_ONLY]
    return {**{name: value for name, value in vars(options).items() if name in named}, **converted}
