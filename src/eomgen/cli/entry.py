"""The entry of the command line: the groups of commands, their parser, and the exit status.

A command is called by its name, or by that of its group and its own: ``eomgen fit``, ``eomgen measure fit``.

Exit status: 0; 1 input that cannot be used; 2 usage; 70 a bug of eomgen; 130 interrupted.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import traceback
import warnings
from collections.abc import Callable, Collection, Iterable, Sequence

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
    reduce,
    robots,
    simulate,
    states,
    structures,
    sweep,
)
from .completion import SHELLS, Completion
from .shared.command import Command, Group
from .shared.output import say_lines
from .shared.parser import CommandParser

OK, INPUT_ERROR, BUG = 0, 1, 70
INTERRUPTED = 130
_ARGUMENT = re.compile(r"[A-Za-z_][A-Za-z0-9_]*:=")

GROUPS = (  # in the order of eomgen --help
    Group("describe", "robots, and files about them", (*robots.COMMANDS, *files.COMMANDS, *reduce.COMMANDS)),
    Group(
        "build",
        "equations, code, models for other tools",
        (*equations.COMMANDS, *export.COMMANDS, *bench.COMMANDS, *cache.COMMANDS),
    ),
    Group("simulate", "motions over time", (*simulate.COMMANDS, *sweep.COMMANDS)),
    Group("analyse", "statics, vibration, linear systems, TCP errors", (*states.COMMANDS, *structures.COMMANDS)),
    Group("measure", "identification, calibration, accuracy", measured.COMMANDS),
    Group("show", "figures, reports, views of results", (*pictures.COMMANDS, *live.COMMANDS)),
)
COMMANDS: tuple[Command, ...] = tuple(command for group in GROUPS for command in group.commands)
NAMES = tuple(command.name for command in COMMANDS)
EXAMPLE_WIDTH = 46  # of the words of an example; longer ones move what is said of them to the right
ROBOT = "ROBOT is the name of a built-in robot, or the path of a .toml, .urdf, .xacro or .xml (MJCF) file."
EPILOG = f"""\
eomgen COMMAND --help     arguments of a command, with examples
eomgen GROUP --help       commands of a group, with examples; eomgen GROUP COMMAND is the same as eomgen COMMAND

{ROBOT}
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the value is the exit status."""
    words = sys.argv[1:] if arguments is None else arguments
    try:
        options = make_parser(words).parse_args(with_arguments(without_group(words)))
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


def without_group(words: Sequence[str]) -> Sequence[str]:
    """Drop the name of a group before that of one of its commands, where a command has the name of its group."""
    for group in GROUPS:
        if group.name in NAMES and len(words) > 1 and words[0] == group.name and words[1] in group.names:
            return words[1:]
    return words


def with_arguments(words: Sequence[str]) -> list[str]:
    """Return the words with the option --xacro-arg at those that are NAME:=VALUE, which argparse has no place for."""
    end = words.index("--") if "--" in words else len(words)
    bare = {i for i in range(end) if _ARGUMENT.match(words[i]) and words[i - 1] != "--xacro-arg"}
    return [f"--xacro-arg={word}" if i in bare else word for i, word in enumerate(words)]


def make_parser(names: Collection[str] = NAMES) -> argparse.ArgumentParser:
    """Make the parser of all commands; those that are not among ``names`` have no arguments yet.

    To add arguments imports what their choices are taken from: ``main`` asks for the commands that it was called with.
    """
    parser = _Parser(
        prog="eomgen",
        description="From a robot's description to compiled equations of motion.",
        epilog=EPILOG,
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
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=CommandParser)
    for command in COMMANDS:
        _add_command(commands, command, command.name in names)
    for group in GROUPS:
        if group.name in NAMES:
            continue
        added = commands.add_parser(
            group.name,
            help=f"commands of this group: {', '.join(group.names)}",
            description=f"{group.about[0].upper()}{group.about[1:]}.",
            epilog=_examples(group.commands, f"eomgen {group.name}"),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        inner = added.add_subparsers(title="commands", required=True, metavar="COMMAND")
        for command in group.commands:
            _add_command(inner, command, command.name in names)
    return parser


class _Parser(CommandParser):
    """The parser of ``eomgen``: its help lists commands by groups."""

    def format_help(self) -> str:
        """Return usage, commands group by group, options, and what else can be asked."""
        formatter = self._get_formatter()
        formatter.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
        formatter.add_text(self.description)
        for group in GROUPS:
            formatter.start_section(f"{group.name} ({group.about})")
            formatter.add_arguments(argparse.Action((), command.name, help=command.help) for command in group.commands)
            formatter.end_section()
        formatter.start_section("options")
        formatter.add_arguments(self._get_optional_actions())
        formatter.end_section()
        formatter.add_text(self.epilog)
        return formatter.format_help()


def _add_command(commands: argparse._SubParsersAction[CommandParser], command: Command, whole: bool) -> None:
    """Add the parser of a command, with its arguments if it is to be ``whole``."""
    sentence = f"{command.help[0].upper()}{command.help[1:]}."
    added = commands.add_parser(
        command.name,
        help=command.help,
        description=sentence if command.description is None else command.description,
        epilog=_examples([command]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    added.set_defaults(run=command.run)
    if whole:
        command.add_arguments(added)


def _examples(commands: Iterable[Command], program: str = "eomgen") -> str:
    """Write the examples of commands in lines, for the end of a help."""
    lines = [
        f"{f'  {program} {words}':<{EXAMPLE_WIDTH}}   {what}"
        for command in commands
        for words, what in command.examples.items()
    ]
    return "\n".join(["examples:", *lines, ""])
