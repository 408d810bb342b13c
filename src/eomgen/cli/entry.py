"""The entry of the command line: the table of all commands, their parser, and the exit status.

Exit status: 0; 1 input that cannot be used; 2 usage; 70 a bug of eomgen; 130 interrupted.
"""

from __future__ import annotations

import argparse
import os
import sys
import traceback
import warnings
from collections.abc import Callable, Collection, Sequence

from .._version import __version__
from ..errors import BuildError, EomgenError, EomgenWarning, InputError
from . import (
    bench,
    cache,
    equations,
    export,
    files,
    live,
    measured,
    pictures,
    robots,
    simulate,
    states,
    structures,
    sweep,
)
from .completion import SHELLS, Completion
from .shared import Command, say_lines

OK, INPUT_ERROR, BUG = 0, 1, 70
INTERRUPTED = 130

_GROUPS = (  # in the order of eomgen --help
    *(robots, files, equations, simulate, measured, structures, states),
    *(sweep, export, pictures, live, bench, cache),
)
COMMANDS: tuple[Command, ...] = tuple(command for group in _GROUPS for command in group.COMMANDS)
NAMES = tuple(command.name for command in COMMANDS)
EXAMPLE_WIDTH = 46  # of the words of an example; longer ones move what is said of them to the right


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the value is the exit status."""
    words = sys.argv[1:] if arguments is None else arguments
    try:
        options = make_parser(words).parse_args(words)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EomgenWarning)  # the robot's notes say the same, and are printed
            run: Callable[[argparse.Namespace], None] = options.run
            run(options)
        sys.stdout.flush()
        return OK
    except EomgenError as error:
        text = f"eomgen: {error}"
        say_lines(text.split("\n") if isinstance(error, BuildError) else [text], sys.stderr)
        return INPUT_ERROR if isinstance(error, InputError) else BUG
    except BrokenPipeError:  # the reader has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except KeyboardInterrupt:
        print("eomgen: interrupted", file=sys.stderr)
        return INTERRUPTED
    except Exception:  # the last resort: whatever it is, it is our bug
        print("eomgen: this is a bug of eomgen; please report it with the lines below", file=sys.stderr)
        traceback.print_exc()
        return BUG


def make_parser(names: Collection[str] = NAMES) -> argparse.ArgumentParser:
    """The parser of all commands; those that are not among ``names`` have no arguments yet.

    To add arguments imports what their choices are taken from: ``main`` asks for the commands that it was called with.
    """
    parser = argparse.ArgumentParser(
        prog="eomgen",
        description="From a robot's description to compiled equations of motion.",
        epilog=_examples(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"eomgen {__version__}")
    parser.add_argument(
        "--completion",
        action=Completion,
        choices=SHELLS,
        parser=make_parser,
        help="print what a shell completes commands, options and built-in robots with",
    )
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for command in COMMANDS:
        sentence = f"{command.help[0].upper()}{command.help[1:]}."
        description = sentence if command.description is None else command.description
        added = commands.add_parser(command.name, help=command.help, description=description)
        added.set_defaults(run=command.run)
        if command.name in names:
            command.add_arguments(added)
    return parser


def _examples() -> str:
    """Text below the list of commands: each command's examples, and what a ROBOT is."""
    lines = [
        f"{f'  eomgen {words}':<{EXAMPLE_WIDTH}}   {what}"
        for command in COMMANDS
        for words, what in command.examples.items()
    ]
    robot = "ROBOT is the name of a built-in robot, or the path of a .toml, .urdf, .xacro or .xml (MJCF) file."
    return "\n".join(["examples:", *lines, "", robot, ""])
