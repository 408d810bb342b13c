"""Reference of the command line, from its parser."""

from __future__ import annotations

import argparse
import html
from collections.abc import Iterator

from eomgen.cli.entry import GROUPS, NAMES, make_parser


def page() -> str:
    """Write all commands with their arguments, group by group."""
    parser = make_parser()
    lines = [
        "# Command line",
        "",
        "Written from the parser. ROBOT is the name of a built-in robot, or the path of a `.toml` or `.urdf` file. "
        "The name of a command's group may stand before it: `eomgen measure fit` is `eomgen fit`. "
        "Exit status: 0; 1 for input that cannot be used; 2 for usage; 70 for a bug of eomgen.",
        "",
        "`eomgen --completion bash` (or zsh, fish) prints what the shell completes commands, options, built-in robots "
        "and files with, where shtab is installed (`pip install shtab`); for bash it goes into "
        "`~/.local/share/bash-completion/completions/eomgen`.",
        "",
    ]
    headings = {group.names[0]: f"## {group.name.capitalize()}: {group.about}" for group in GROUPS}
    for name, text, command in commands(parser):
        lines += [headings[name], ""] if name in headings else []
        usage = " ".join(command.format_usage().removeprefix("usage: ").split())
        described = command.description or text
        lines += [f"### eomgen {name}", "", _text(described), "", f"<pre><code>{html.escape(usage)}</code></pre>", ""]
        lines += ["| argument | |", "|---|---|"]
        lines += [f"| {_name(action)} | {_help(command, action)} |" for action in arguments(command)]
        lines.append("")
        if command.epilog:
            lines += [f"<pre><code>{html.escape(command.epilog.strip())}</code></pre>", ""]
    return "\n".join(lines)


def commands(parser: argparse.ArgumentParser) -> Iterator[tuple[str, str, argparse.ArgumentParser]]:
    """Name, help and parser of each command, without those of groups."""
    (group,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    helps = {choice.dest: choice.help or "" for choice in group._choices_actions}
    for name, command in group.choices.items():
        if name in NAMES:
            yield name, helps[name], command


def arguments(command: argparse.ArgumentParser) -> list[argparse.Action]:
    """What the command takes, but --help."""
    return [a for a in command._actions if not isinstance(a, argparse._HelpAction) and a.help != argparse.SUPPRESS]


def _name(action: argparse.Action) -> str:
    value = action.metavar or ("|".join(map(str, action.choices)) if action.choices else action.dest.upper())
    shown = " ".join(value) if isinstance(value, tuple) else value
    if action.nargs in ("+", "*"):
        shown = f"{shown} ..."
    elif isinstance(action.nargs, int) and action.nargs > 1 and not isinstance(value, tuple):
        shown = " ".join([shown] * action.nargs)
    if not action.option_strings:
        return f"`{shown}`".replace("|", r"\|")
    if action.nargs == 0:
        shown = ""
    return "<br>".join(f"`{option} {shown}`".replace(" `", "`").replace("|", r"\|") for option in action.option_strings)


def _help(command: argparse.ArgumentParser, action: argparse.Action) -> str:
    formatter = command._get_formatter()
    return _text(formatter._expand_help(action) if action.help else "")


def _text(text: str) -> str:
    escaped = html.escape(text, quote=False).replace("|", r"\|").replace("*", r"\*")
    return escaped.replace("[[", r"\[[")
