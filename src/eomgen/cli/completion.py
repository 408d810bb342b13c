"""Completions for shells: commands, options and their choices, names of built-in robots and scenarios, files."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from ..optional import optional_import

SHELLS = ("bash", "zsh", "fish")
FILES = ("FILE", "RESULT", "MOTION")  # what arguments are called that take one; others have the type Path


class Completion(argparse.Action):
    """The option --completion: prints the script of a shell and ends.

    Usage: ``add_argument("--completion", action=Completion, choices=SHELLS, parser=make_parser)``.
    """

    def __init__(self, *arguments: Any, parser: Callable[[], argparse.ArgumentParser], **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.parser = parser

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        print(completion_script(self.parser(), values))
        parser.exit()


def completion_script(parser: argparse.ArgumentParser, shell: str) -> str:
    """Write the script that a shell completes the words of a parser with; marks arguments with what they take.

    Raises:
        InputError: shtab is not installed.
    """
    from ..description.builtin import builtin_robots
    from ..scenario.builtin import builtin_scenarios

    with optional_import("shtab", "--completion needs"):
        import shtab
    kinds = {
        "robot": _names_or_files("robots", builtin_robots()),
        "scenario": _names_or_files("scenarios", builtin_scenarios()),
        "file": shtab.FILE,
        "folder": shtab.DIRECTORY,
    }
    for action in _arguments(parser):
        kind = _kind(action)
        if kind is not None and action.choices is None:
            action.complete = kinds[kind]  # type: ignore[attr-defined]  # where shtab looks for it
    return str(shtab.complete(parser, shell))


def _arguments(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """All arguments of a parser and of its commands."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _arguments(command)
        else:
            yield action


def _kind(action: argparse.Action) -> str | None:
    """The kind of thing that an argument takes, by what it is called; None for numbers, names and flags."""
    if action.metavar == "ROBOT" or action.dest == "robot":
        return "robot"
    if action.dest == "scenario":
        return "scenario"
    if action.metavar == "FOLDER":
        return "folder"
    return "file" if action.metavar in FILES or action.type is Path else None


def _names_or_files(kind: str, names: Sequence[str]) -> dict[str, Any]:
    """Functions of the shells that complete one of the names, or a path."""
    function, words = f"_eomgen_{kind}", " ".join(names)
    return {
        "bash": function,
        "zsh": function,
        "fish": f"({function})",
        "preamble": {
            "bash": f'{function}() {{ compgen -W "{words}" -- "$1"; compgen -f -- "$1"; }}',
            "zsh": f"{function}() {{ _alternative '{kind}:built-in {kind}:({words})' 'files:file:_files' }}",
            "fish": f"function {function}\n  printf '%s\\n' {words}\n  __fish_complete_path (commandline -ct)\nend",
        },
    }
