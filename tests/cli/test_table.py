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

import eomgen
import eomgen.cli
from eomgen.cli import entry
from eomgen.cli.shared.options import add_old_name

GROUPS = {
    "describe": ("robots", "info", "new", "check", "schema", "reduce"),
    "build": ("derive", "generate", "export", "observer", "bench", "bound", "cache"),
    "simulate": ("simulate", "feedforward", "sweep"),
    "analyse": ("deflection", "modes", "response", "linearize", "budget", "compare"),
    "measure": (
        *("forces", "fit", "identify", "excite", "calibrate", "poses"),
        *("accuracy", "tolerance", "compensate"),
    ),
    "show": ("plot", "report", "view", "live"),
}
ORDER = tuple(name for names in GROUPS.values() for name in names)
MODULES = sorted(
    {module.name for module in pkgutil.iter_modules(eomgen.cli.__path__)} - {"choices", "completion", "entry", "shared"}
)
HEAVY = ("numpy", "sympy", "scipy", "matplotlib", "cffi", "jinja2", "rich", "concurrent.futures")


def test_every_command_is_in_one_module_and_in_one_group() -> None:
    found = [command for name in MODULES for command in importlib.import_module(f"eomgen.cli.{name}").COMMANDS]
    assert len(found) == len({command.name for command in found})
    assert sorted(command.name for command in found) == sorted(command.name for command in entry.COMMANDS)


def test_help_lists_the_commands_in_order(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        entry.main(["--help"])
    assert left.value.code == 0
    text = capsys.readouterr().out
    sections = dict(re.findall(r"^(\w+) \([^)\n]+\):\n((?:  .*\n)+)", text, re.MULTILINE))
    assert {name: tuple(re.findall(r"^ {2}(\w+)", found, re.MULTILINE)) for name, found in sections.items()} == GROUPS
    assert list(sections) == list(GROUPS)
    for word in ("ROBOT", ".toml", ".urdf", ".xml", "eomgen GROUP --help"):
        assert word in text


@pytest.mark.parametrize("group", [name for name in GROUPS if name not in GROUPS[name]])
def test_help_of_a_group_lists_its_commands_with_examples(group: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        entry.main([group, "--help"])
    assert left.value.code == 0
    listed, examples = capsys.readouterr().out.split("examples:")
    assert tuple(re.findall(r"^ {4}(\w+)", listed, re.MULTILINE)) == GROUPS[group]
    assert tuple(dict.fromkeys(re.findall(rf"^  eomgen {group} (\w+)", examples, re.MULTILINE))) == GROUPS[group]


@pytest.mark.parametrize(("group", "name"), [(group, name) for group, names in GROUPS.items() for name in names])
def test_a_command_is_called_with_its_group_or_without(
    group: str, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    said = []
    for words in ([name], [group, name]):
        with pytest.raises(SystemExit) as left:
            entry.main([*words, "--help"])
        assert left.value.code == 0
        printed = capsys.readouterr()
        assert printed.err == ""
        said.append(re.sub(r"\s+", " ", printed.out.replace(f"eomgen {group} {name}", f"eomgen {name}", 1)))
    assert said[0] == said[1]
    assert f"eomgen {name}" in said[0].split("examples:")[1]


def test_a_group_with_the_name_of_a_command_gives_way_to_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert entry.without_group(["simulate", "one_link"]) == ["simulate", "one_link"]
    assert entry.without_group(["simulate", "sweep", "one_link"]) == ["sweep", "one_link"]
    assert entry.without_group(["simulate", "simulate"]) == ["simulate"]
    assert entry.without_group(["measure", "fit"]) == ["measure", "fit"]
    assert entry.without_group([]) == []
    assert not {name for names in GROUPS.values() for name in names} & set(eomgen.builtin_robots())
    with pytest.raises(SystemExit) as left:
        entry.main(["measure", "simulate", "one_link"])
    assert left.value.code == 2
    assert "invalid choice: 'simulate'" in capsys.readouterr().err


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
    add_old_name(parser, "--old", parser.add_argument("--new", type=float, default=1.0))
    assert parser.parse_args([]).new == 1.0
    assert parser.parse_args(["--new", "2"]).new == 2.0
    assert capsys.readouterr().err == ""
    assert parser.parse_args(["--old", "3"]).new == 3.0
    assert capsys.readouterr().err == "note: --old is now called --new\n"
    assert "--old" not in parser.format_help()
