"""Argument parser of commands: repeated options, negative numbers and printable messages."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from typing import Any, NoReturn

from ...identifiers import printable

_NEGATIVE = re.compile(r"-(\.?[0-9]|inf|nan)", re.IGNORECASE)  # no option begins so; its type says what is no number
_SEVERAL = (argparse.ZERO_OR_MORE, argparse.ONE_OR_MORE)


class CommandParser(argparse.ArgumentParser):
    """An argument parser that never drops the value of an option.

    - A repeated option with any number of values collects them.
    - Repeating another option is an error, unless its action is "append" or "extend".
    - A word that begins like a negative number is a value; argparse takes ``-1e-2`` for an option.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._negative_number_matcher = _NEGATIVE
        self._given: dict[str, Any] = {}

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse the arguments of one command line."""
        self._given = {}
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Print the usage and a one-line message with escaped control characters, and exit with status 2."""
        super().error(printable(message).replace("\n", "\\n"))

    def _get_values(self, action: argparse.Action, arg_strings: Sequence[str]) -> Any:
        values = super()._get_values(action, list(arg_strings))
        if not action.option_strings or isinstance(action, self._registry_get("action", "append")):
            return values  # of "extend" as well, which is a kind of it
        if action.dest in self._given:  # by this option, or under its old name
            if action.nargs not in _SEVERAL:
                raise argparse.ArgumentError(action, "given more than once; allowed: once")
            values = [*self._given[action.dest], *values]
        self._given[action.dest] = values
        return values
