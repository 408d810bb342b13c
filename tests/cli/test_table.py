"""The table of commands: each of them once, in the order of the help, with examples that are understood."""

from __future__ import annotations

import argparse
import importlib
import json
import pkgutil
import re
import shlex
import subprocess
import sys

import pytest

import eomgen.cli
from eomgen.cli import entry
from eomgen.cli.shared import OldName

ORDER = (
    *("robots", "info", "new", "check", "schema", "derive", "generate", "simulate", "forces", "fit", "identify"),
    *("excite", "calibrate", "poses", "accuracy", "tolerance", "compensate"),
    *("compare", "deflection", "modes", "response", "linearize", "budget", "sweep", "export", "plot"),
    *("report", "view", "live", "bench", "cache"),
)
GROUPS = sorted(
    {module.name for module in pkgutil.iter_modules(eomgen.cli.__path__)} - {"completion", "entry", "shared"}
)
HEAVY = ("numpy", "sympy", "scipy", "matplotlib", "cffi", "jinja2", "rich", "concurrent.futures")


def test_every_command_is_in_one_group_and_every_group_in_the_table() -> None:
    found = [command for name in GROUPS for command in importlib.import_module(f"eomgen.cli.{name}").COMMANDS]
    assert len(found) == len({command.name for command in found})
    assert sorted(command.name for command in found) == sorted(command.name for command in entry.COMMANDS)


def test_help_lists_the_commands_in_order(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        entry.main(["--help"])
    assert left.value.code == 0
    listed, examples = capsys.readouterr().out.split("examples:")
    assert tuple(re.findall(r"^ {4}(\w+)", listed, re.MULTILINE)) == ORDER
    assert tuple(dict.fromkeys(re.findall(r"^  eomgen (\w+)", examples, re.MULTILINE))) == ORDER
    for word in ("ROBOT", ".toml", ".urdf", ".xml"):
        assert word in examples


@pytest.mark.parametrize("name", ORDER)
def test_examples_are_understood(name: str) -> None:
    (command,) = (command for command in entry.COMMANDS if command.name == name)
    assert command.examples
    for words, what in command.examples.items():
        options = entry.make_parser().parse_args(shlex.split(words))
        assert options.run is command.run
        assert what


@pytest.mark.parametrize("words", [["--help"], ["new", "--help"], ["sweep", "--help"], ["check"]])
def test_parsing_imports_what_the_command_needs_only(words: list[str]) -> None:
    code = f"""
import json, sys
from eomgen.cli import main
try:
    main({words!r})
except SystemExit:
    print(json.dumps([name for name in {HEAVY!r} if name in sys.modules]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout.splitlines()[-1]) == []


def test_an_option_under_its_old_name_is_taken_with_a_note(capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--new", type=float, default=1.0)
    parser.add_argument("--old", type=float, action=OldName, new="--new", dest="new", help=argparse.SUPPRESS)
    assert parser.parse_args([]).new == 1.0
    assert parser.parse_args(["--new", "2"]).new == 2.0
    assert capsys.readouterr().err == ""
    assert parser.parse_args(["--old", "3"]).new == 3.0
    assert capsys.readouterr().err == "note: --old is now called --new\n"
    assert "--old" not in parser.format_help()


def test_old_names_of_options(capsys: pytest.CaptureFixture[str]) -> None:
    for words, name, value in ((["compare", "puma560", "ur5", "--tool", "tcp"], "frame", "tcp"),):
        assert vars(entry.make_parser().parse_args(words))[name] == value
        assert capsys.readouterr().err.startswith("note: ")
