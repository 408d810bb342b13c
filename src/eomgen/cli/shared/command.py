"""Commands of ``eomgen``, and groups of them, as values."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Command:
    """A command of ``eomgen``.

    add_arguments: adds its arguments to its parser; imports what their choices are taken from.
    run: does it; imports what it needs; named as the command, behind a _.
    help: one line about it, in the list of all commands.
    examples: lines of the epilog of its help and of its group's: the words behind ``eomgen``, and what they do.
    description: text of ``eomgen COMMAND --help``; by default ``help`` as a sentence.
    """

    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], None]
    help: str
    examples: Mapping[str, str]
    description: str | None = None

    @property
    def name(self) -> str:
        """Return the word that calls it."""
        return self.run.__name__.removeprefix("_")


@dataclass(frozen=True)
class Group:
    """Commands under a heading of ``eomgen --help``.

    name: stands before those of its commands, or is left out.
    about: what they are about, in some words.
    commands: in the order of the help.
    """

    name: str
    about: str
    commands: Sequence[Command]

    @property
    def names(self) -> tuple[str, ...]:
        """Return the words that call its commands."""
        return tuple(command.name for command in self.commands)
