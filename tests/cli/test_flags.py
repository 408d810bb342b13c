"""The table of commands with groups and examples; flags with one meaning for each name; words for shells; imports."""

from __future__ import annotations

import argparse
import importlib
import pkgutil
import re
import shlex
import shutil
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest

import eomgen
import eomgen.cli
from eomgen.analysis.ports import KINDS
from eomgen.authoring.schemas import FORMATS as SCHEMAS
from eomgen.cli import choices, entry
from eomgen.cli.entry import COMMANDS, make_parser
from eomgen.cli.export import FORMATS
from eomgen.cli.shared.options import OldName, add_old_name, page_path
from eomgen.errors import InputError
from eomgen.identification.calibration.variants import VARIANTS
from eomgen.identification.choosing.information import CRITERIA as POSE_CRITERIA
from eomgen.identification.choosing.proposals import MEASURES
from eomgen.identification.choosing.sampling import AXES
from eomgen.identification.compensating.solve import MODES
from eomgen.identification.dynamics.further import FURTHER, SHAPES
from eomgen.identification.exciting.weighted_columns import CRITERIA as EXCITATION_CRITERIA
from eomgen.identification.geometry.poses import ROTATIONS
from eomgen.identification.geometry.solve import LOSSES
from eomgen.identification.identifiable import LINEAR, TERMS
from eomgen.kernel.stepping.methods import METHODS
from eomgen.pictures import Report
from tests.support.commands import command, facts, run
from tests.support.quick_builds import answer, python

PAGES = ("report", "view", "live")  # commands whose output is a page

DIFFER = {  # flags whose help or form is another one by command, and why
    "--output": "each command says what it writes",
    "--scenario": "new writes a scenario, the others read one",
    "--plan": "new writes a plan, the others read one",
    "--report": "generate writes the derivation, the others a page about their result",
    "--box": "excite looks at any frame and names it, poses at those to measure",
    "--drives": "a free joint has no static deflection",
    "--criterion": "poses and trajectories have other criteria beside D",
    "--frame": "poses takes several",
    "--goal": "compare takes a line in its place",
    "--kernels": "generate takes them behind commas, too",
    "--range": "coordinates have limits; bounds are over all inputs and parameters",
    "--method": "FMUs have other methods than simulations",
    "--points": "a map has two numbers",
    "--along": "some need a result of a simulation, not a measured motion",
    "--step": "an observer's samples have a length, steps of acados a default",
    "--parameters": "a fit finds them, a model of acados takes them as p",
    "--measure": "observers have sensors, poses one thing for all frames",
    "--noise": "of readings by name, or of positions and rotations",
    "--terms": "identify has terms that no excitation is for",
    "--tolerance": "view draws what tolerances allow, a feed-forward has one of its steps",
}


def commands() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Each command and its parser."""
    (listed,) = (x for x in make_parser()._actions if isinstance(x, argparse._SubParsersAction))
    for known in COMMANDS:
        yield known.name, listed.choices[known.name]


def meaning(action: argparse.Action) -> tuple[object, ...]:
    """What a flag takes, and the beginning of its help: what stands behind it is about a command, or a default."""
    words = re.split(r" ?[(:;]", action.help or "")[0]
    kind = getattr(action.type, "__name__", None)
    words_allowed = None if action.choices is None else tuple(action.choices)
    return words, action.metavar, action.nargs, kind, words_allowed, type(action).__name__


def flags() -> dict[str, dict[tuple[object, ...], list[str]]]:
    """The commands of each meaning of each flag."""
    listed: dict[str, dict[tuple[object, ...], list[str]]] = defaultdict(lambda: defaultdict(list))
    for name, parser in commands():
        for action in parser._actions:
            if action.option_strings and action.help != argparse.SUPPRESS:
                listed[action.option_strings[-1]][meaning(action)].append(name)
    return listed


def test_each_flag_has_one_meaning() -> None:
    several = {flag: dict(meanings) for flag, meanings in flags().items() if len(meanings) > 1}
    assert {flag: meanings for flag, meanings in several.items() if flag not in DIFFER} == {}
    assert set(DIFFER) == set(several), "a reason for what does not differ"


def test_each_flag_is_explained() -> None:
    for name, parser in commands():
        for action in parser._actions:
            assert action.help, (name, action.dest)


def test_no_old_name_is_a_flag_of_another_command_with_the_same_words() -> None:
    """Where an old name lives on elsewhere, it is with the meaning that kept it."""
    shown = flags()
    for name, parser in commands():
        for action in parser._actions:
            if isinstance(action, OldName):
                assert action.help == argparse.SUPPRESS
                assert action.new in parser._option_string_actions, (name, action.new)
                for meanings in (shown[old] for old in action.option_strings if old in shown):
                    assert all(name not in called for called in meanings.values())


FIRST = {"compare": ["a", "b"], "calibrate": ["a", "p.csv"], "accuracy": ["m.csv"]}  # other commands take "a"
OLD = [  # a command, its option under the old name with values, what the command calls it, and reads
    ("compare", ["--tool", "tcp"], "frame", "tcp"),
    *((name, ["--held", "j.x", "k.x"], "fixed", ["j.x", "k.x"]) for name in ("deflection", "modes", "response")),
    ("linearize", ["--held"], "fixed", []),
    ("modes", ["--goal", "1", "2"], "goal", ["1", "2"]),
    ("excite", ["--rates", "2"], "rates", ["2"]),
    ("excite", ["--accelerations", "3"], "accelerations", ["3"]),
    ("excite", ["--drives", "j=30"], "drives", ["j=30"]),
    ("excite", ["--noise", "0.2"], "noise", ["0.2"]),
    ("excite", ["--step", "0.01"], "step", 0.01),
    ("calibrate", ["--drives"], "drives", True),
    ("accuracy", ["--load", "5 kg"], "load", "5 kg"),
    ("accuracy", ["--rate", "100 %"], "rate", "100 %"),
    ("compensate", ["--step", "0.02"], "step", 0.02),
    ("compensate", ["--accelerations"], "accelerations", True),
    ("compensate", ["--rates", "j=2"], "rates", ["j=2"]),
    ("compensate", ["--drive-limits", "j=9"], "drive_limits", ["j=9"]),
    ("compensate", ["--toml", "new.toml"], "toml", Path("new.toml")),
]


@pytest.mark.parametrize(("command", "words", "name", "value"), OLD)
def test_old_names(
    command: str, words: list[str], name: str, value: object, capsys: pytest.CaptureFixture[str]
) -> None:
    parser, first = make_parser([command]), [command, *FIRST.get(command, ["a"])]
    assert vars(parser.parse_args([*first, *words]))[name] == value
    (new,) = re.findall(rf"^note: {words[0]} is now called (--[\w-]+)\n$", capsys.readouterr().err)
    assert vars(parser.parse_args([*first, new, *words[1:]]))[name] == value
    assert capsys.readouterr().err == ""


def test_old_names_are_all_tried() -> None:
    actions = ((name, x) for name, parser in commands() for x in parser._actions if isinstance(x, OldName))
    there = {(name, old) for name, action in actions for old in action.option_strings}
    assert there == {(command, words[0]) for command, words, _, _ in OLD}


def test_reading_of_descriptions_is_a_group_of_its_own() -> None:
    for words in (["info"], ["measure", "fit"], ["budget"]):
        before, after = command(*words, "--help").split("reading of descriptions:")
        assert "  --json" in before
        for flag in ("--inertia", "--urdf-damping", "--stops", "--xacro"):
            assert f"\n  {flag}" in after


CHOICES = [
    (choices.FORMATS, SCHEMAS),
    (choices.LOSSES, LOSSES),
    (choices.VARIANTS, VARIANTS),
    (choices.MEASURES, MEASURES),
    (choices.POSE_CRITERIA, POSE_CRITERIA),
    (choices.EXCITATION_CRITERIA, EXCITATION_CRITERIA),
    (choices.ROTATIONS, ROTATIONS),
    (choices.AXES, AXES),
    (choices.TERMS, TERMS),
    (choices.FURTHER_TERMS, (*FURTHER, *LINEAR[len(TERMS) :])),
    (choices.SHAPES, SHAPES),
    (choices.MODES, MODES),
    (choices.KINDS, KINDS),
]


@pytest.mark.parametrize(("offered", "allowed"), CHOICES)
def test_shells_offer_what_functions_take(offered: tuple[str, ...], allowed: Any) -> None:
    assert sorted(offered) == sorted(allowed)


def test_no_words_are_left_out() -> None:
    tuples = {name for name, value in vars(choices).items() if isinstance(value, tuple)}
    assert len(tuples) == len(CHOICES)
    assert get_args(eomgen.kernel.stepping.methods.Method) == METHODS


@pytest.mark.parametrize(
    "words",
    [
        ("modes", "one_link", "-o", "shapes.svg"),
        ("linearize", "one_link", "--drives", "locked", "-o", "system.npz"),
        ("response", "one_link", "--points", 3, "-o", "r.csv"),
    ],
)
def test_analyses_say_what_they_write(
    words: tuple[object, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert command(*words).splitlines()[-1] == f"wrote {words[-1]}"
    assert (tmp_path / words[-1]).is_file()
    assert facts(*words)


def test_pages_are_written_to_html_alone(tmp_path: Path) -> None:
    """Not over the result that they are about, nor into a file that its ending calls a figure."""
    seen = 0
    for name, parser in commands():
        for action in parser._actions:
            if (action.dest == "report" and name != "generate") or (action.dest == "output" and name in PAGES):
                seen += 1
                assert action.type is page_path, name
    assert seen == 9 + len(PAGES)
    kept = tmp_path / "trajectory.npz"
    kept.write_bytes(b"a result")
    robot = eomgen.load_robot("one_link")
    for write in (Report("page", (), (), (), ()).save, robot.show, lambda path: eomgen.export_live(robot, path)):
        with pytest.raises(InputError, match=r"^path: '.*trajectory\.npz'; allowed: a path that ends in \.html$"):
            write(kept)
    assert kept.read_bytes() == b"a result"


def test_every_option_of_export_has_its_format() -> None:
    parser = dict(commands())["export"]
    (reading,) = (group for group in parser._action_groups if group.title == "reading of descriptions")
    general = {"help", "robot", "output", *FORMATS, *(action.dest for action in reading._group_actions)}
    taken = {option for target in FORMATS.values() for option in target.takes}
    assert {action.dest for action in parser._actions} - general == taken


# The table of commands


GROUPS = {
    "describe": ("robots", "info", "new", "check", "schema", "reduce"),
    "build": ("derive", "generate", "export", "observer", "bench", "bound", "cache"),
    "simulate": ("simulate", "feedforward", "sweep"),
    "analyse": ("deflection", "modes", "response", "linearize", "budget", "compare"),
    "measure": ("forces", "fit", "identify", "excite", "calibrate", "poses", "accuracy", "tolerance", "compensate"),
    "show": ("plot", "report", "view", "live"),
}
ORDER = tuple(name for names in GROUPS.values() for name in names)
MODULES = sorted(
    {module.name for module in pkgutil.iter_modules(eomgen.cli.__path__)} - {"choices", "completion", "entry", "shared"}
)


def test_every_command_is_in_one_module_and_in_one_group() -> None:
    found = [command for name in MODULES for command in importlib.import_module(f"eomgen.cli.{name}").COMMANDS]
    assert len(found) == len({command.name for command in found})
    assert sorted(command.name for command in found) == sorted(command.name for command in entry.COMMANDS)


def test_help_lists_the_commands_in_order() -> None:
    text = command("--help")
    sections = dict(re.findall(r"^(\w+) \([^)\n]+\):\n((?:  .*\n)+)", text, re.MULTILINE))
    assert {name: tuple(re.findall(r"^ {2}(\w+)", found, re.MULTILINE)) for name, found in sections.items()} == GROUPS
    assert list(sections) == list(GROUPS)
    for word in ("ROBOT", ".toml", ".urdf", ".xml", "eomgen GROUP --help"):
        assert word in text


@pytest.mark.parametrize("group", [name for name in GROUPS if name not in GROUPS[name]])
def test_help_of_a_group_lists_its_commands_with_examples(group: str) -> None:
    listed, examples = command(group, "--help").split("examples:")
    assert tuple(re.findall(r"^ {4}(\w+)", listed, re.MULTILINE)) == GROUPS[group]
    assert tuple(dict.fromkeys(re.findall(rf"^  eomgen {group} (\w+)", examples, re.MULTILINE))) == GROUPS[group]


@pytest.mark.parametrize(("group", "name"), [(group, name) for group, names in GROUPS.items() for name in names])
def test_a_command_is_called_with_its_group_or_without(group: str, name: str) -> None:
    said = []
    for words in ([name], [group, name]):
        status, out, err = run(*words, "--help")
        assert (status, err) == (0, "")
        said.append(re.sub(r"\s+", " ", out.replace(f"eomgen {group} {name}", f"eomgen {name}", 1)))
    assert said[0] == said[1]
    assert f"eomgen {name}" in said[0].split("examples:")[1]


def test_a_group_with_the_name_of_a_command_gives_way_to_it() -> None:
    assert entry.without_group(["simulate", "one_link"]) == ["simulate", "one_link"]
    assert entry.without_group(["simulate", "sweep", "one_link"]) == ["sweep", "one_link"]
    assert entry.without_group(["simulate", "simulate"]) == ["simulate"]
    assert entry.without_group(["measure", "fit"]) == ["measure", "fit"]
    assert entry.without_group([]) == []
    assert not {name for names in GROUPS.values() for name in names} & set(eomgen.builtin_robots())


@pytest.mark.parametrize("name", ORDER)
def test_examples_are_understood(name: str) -> None:
    (command,) = (command for command in entry.COMMANDS if command.name == name)
    assert command.examples
    for words, what in command.examples.items():
        options = entry.make_parser().parse_args(shlex.split(words))
        assert options.run is command.run
        assert what


def test_an_option_under_its_old_name_is_taken_with_a_note(capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser()
    add_old_name(parser, "--old", parser.add_argument("--new", type=float, default=1.0))
    assert parser.parse_args([]).new == 1.0
    assert parser.parse_args(["--new", "2"]).new == 2.0
    assert capsys.readouterr().err == ""
    assert parser.parse_args(["--old", "3"]).new == 3.0
    assert capsys.readouterr().err == "note: --old is now called --new\n"
    assert "--old" not in parser.format_help()


# Imports: a start is as long as they are


ROBOTS = Path(eomgen.__path__[0], "robots")
NUMERIC = ("numpy", "scipy", "sympy", "matplotlib")
UNNEEDED = (
    *NUMERIC,
    "concurrent.futures",
    "jinja2",
    "cffi",
    "pycparser",
    "setuptools",
    "rich",
    "platformdirs",
    "filelock",
    "pydantic",
)
RUN = """
import contextlib, io, json, sys
from eomgen.cli import main

with contextlib.redirect_stdout(io.StringIO()) as said:
    try:
        status = main({arguments!r})
    except SystemExit as error:
        status = error.code
print(json.dumps([status, len(said.getvalue()), [name for name in {names!r} if name in sys.modules]]))
"""
BUILD = """
import json, sys
import eomgen

kernel = eomgen.build("one_link", kernels=("mass_matrix", "forward_dynamics"), flags=("-O0",))
heavy = ("sympy", "scipy", "matplotlib", "rich", "pydantic", "jinja2.meta")
print(json.dumps([kernel.mass_matrix([0.2, 0.5]).shape, [name for name in heavy if name in sys.modules]]))
"""


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["--help"], UNNEEDED),
        (["cache"], NUMERIC),
        (["check", "{robots}/one_link.toml"], ("scipy", "matplotlib", "jinja2", "cffi")),
        (["info", "one_link"], ("scipy", "matplotlib")),
        pytest.param(["--version"], UNNEEDED, marks=pytest.mark.soak),
        pytest.param(["simulate", "--help"], UNNEEDED, marks=pytest.mark.soak),
        (["sweep", "--help"], UNNEEDED),
        (["new", "--help"], UNNEEDED),
        pytest.param(["new", "arm", "-o", "{folder}/arm.toml"], UNNEEDED, marks=pytest.mark.soak),
        pytest.param(["robots"], NUMERIC[1:], marks=pytest.mark.soak),
        pytest.param(["schema", "plan"], NUMERIC[1:], marks=pytest.mark.soak),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_commands_import_what_they_need(arguments: list[str], names: tuple[str, ...], tmp_path: Path) -> None:
    words = [word.format(folder=tmp_path, robots=ROBOTS) for word in arguments]
    code = RUN.format(arguments=words, names=names)
    status, printed, found = answer(python(code, EOMGEN_CACHE_DIR=str(tmp_path / "cache")))
    assert (status, found) == (0, [])
    assert printed > 0


def test_sympy_is_imported_once_for_a_kind_of_joint(tmp_path: Path) -> None:
    """The cache holds what it derives: neither a second build imports it, nor one whose source is derived again."""
    cache = tmp_path / "cache"
    assert answer(python(BUILD, EOMGEN_CACHE_DIR=str(cache))) == [[2, 2], ["sympy"]]
    assert answer(python(BUILD, EOMGEN_CACHE_DIR=str(cache))) == [[2, 2], []]
    for kind in ("sources", "packages"):
        shutil.rmtree(cache / kind)
    assert answer(python(BUILD, EOMGEN_CACHE_DIR=str(cache))) == [[2, 2], []]
    code = RUN.format(arguments=["info", "one_link"], names=NUMERIC[1:])
    assert answer(python(code, EOMGEN_CACHE_DIR=str(cache)))[::2] == [0, []]
