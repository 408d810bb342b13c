"""Flags of commands: one meaning for each name, words for shells, old names with a note."""

from __future__ import annotations

import argparse
import json
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest

import eomgen
from eomgen.analysis.ports import KINDS
from eomgen.authoring.schemas import FORMATS as SCHEMAS
from eomgen.cli import choices
from eomgen.cli.entry import COMMANDS, main, make_parser
from eomgen.cli.export import FORMATS
from eomgen.cli.shared.options import OldName, page_path
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
from eomgen.integration.methods import METHODS
from eomgen.pictures import Report

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
    for command in COMMANDS:
        yield command.name, listed.choices[command.name]


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
    *((name, ["--held", "j.x", "k.x"], "held", ["j.x", "k.x"]) for name in ("deflection", "modes", "response")),
    ("linearize", ["--held"], "held", []),
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
    there = {
        (name, old)
        for name, parser in commands()
        for action in parser._actions
        if isinstance(action, OldName)
        for old in action.option_strings
    }
    assert there == {(command, words[0]) for command, words, _, _ in OLD}


def test_reading_of_descriptions_is_a_group_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["info"], ["measure", "fit"], ["budget"]):
        with pytest.raises(SystemExit):
            main([*words, "--help"])
        before, after = capsys.readouterr().out.split("reading of descriptions:")
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
    assert get_args(eomgen.integration.methods.Method) == METHODS


@pytest.mark.parametrize("words", [
    ("schema", "robots"),
    ("calibrate", "ur5", "p.csv", "--loss", "tukay"),
    ("poses", "ur5", "--criterion", "E"),
    ("excite", "ur5", "--terms", "links", "wet"),
    ("simulate", "ur5", "--method", "euler"),
])  # fmt: skip
def test_other_words_are_usage(words: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(words)
    assert left.value.code == 2
    assert re.search(rf"invalid choice: '{words[-1]}' \(choose from ", capsys.readouterr().err)


@pytest.mark.parametrize("words", [
    *(("deflection", "one_link"), ("modes", "one_link"), ("response", "one_link"), ("linearize", "one_link")),
    *(("fit", "one_link", "gone.csv"), ("identify", "one_link", "gone.csv"), ("excite", "one_link")),
    *(("calibrate", "one_link", "gone.csv"), ("poses", "one_link"), ("tolerance", "one_link", "gone.toml")),
    *(("compensate", "one_link"), ("accuracy", "gone.csv"), ("budget", "gone.npz"), ("forces", "one_link", "gone.csv")),
])  # fmt: skip
def test_endings_are_looked_at_first(words: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    """Before files are read and before anything is computed; what is allowed is all that the command writes."""
    assert main([*words, "-o", "a.doc"]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert re.match(r"eomgen: output: '?a\.doc'?; allowed: (a path|paths) that ends? in \.", said.err)


@pytest.mark.parametrize(("words", "option", "ending"), [
    (("identify", "one_link", "gone.csv"), "toml", ".toml"),
    (("calibrate", "one_link", "gone.csv"), "toml", ".toml"),
    (("calibrate", "one_link", "gone.csv"), "urdf", ".urdf"),
])  # fmt: skip
def test_endings_of_descriptions_as_well(
    words: tuple[str, ...], option: str, ending: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words, f"--{option}", "a.doc"]) == 1
    assert f"{option}: 'a.doc'; allowed: a path that ends in {ending}" in capsys.readouterr().err


@pytest.mark.parametrize("words", [
    ("modes", "one_link", "-o", "shapes.svg"), ("linearize", "one_link", "--drives", "locked", "-o", "system.npz"),
    ("response", "one_link", "--points", "3", "-o", "r.csv"),
])  # fmt: skip
def test_analyses_say_what_they_write(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"wrote {words[-1]}"
    assert (tmp_path / words[-1]).is_file()
    assert main([*words, "--json"]) == 0
    json.loads(capsys.readouterr().out)


def test_pages_are_written_to_html_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Not over the result that they are about, nor into a file that its ending calls a figure; before any work."""
    seen = 0
    for name, parser in commands():
        for action in parser._actions:
            if (action.dest == "report" and name != "generate") or (action.dest == "output" and name in PAGES):
                seen += 1
                assert action.type is page_path, name
    assert seen == 9 + len(PAGES)
    kept = tmp_path / "trajectory.npz"
    kept.write_bytes(b"a result")
    for words in (("report", str(kept)), ("view", "one_link"), ("live", "one_link")):
        with pytest.raises(SystemExit) as caught:
            main([*words, "-o", str(kept)])
        assert caught.value.code == 2
        assert "trajectory.npz'; allowed: a path that ends in .html" in capsys.readouterr().err
    robot = eomgen.load_robot("one_link")
    for write in (
        Report("page", (), (), (), ()).save,
        robot.show,
        lambda path: eomgen.export_live(robot, path),
    ):
        with pytest.raises(InputError, match=r"^path: '.*trajectory\.npz'; allowed: a path that ends in \.html$"):
            write(kept)
    assert kept.read_bytes() == b"a result"


@pytest.mark.parametrize(("words", "refused"), [
    (("--mjcf", "--kernels", "mass_matrix"), "--kernels: given without its format; allowed: with --arrays or --wasm"),
    (("--arrays", "--dtype", "float32"), "--dtype: given without its format; allowed: with --wasm"),
    (("--wasm", "--fmi", "3"), "--fmi: given without its format; allowed: with --fmu"),
    (("--fmu", "--mjcf", "--model"), "--model: given without its format; allowed: with --wasm"),
    (("--arrays", "--step", "1e-3"), "--step: given without its format; allowed: with --fmu or --mjcf"),
    (("--fmu", "--approximate"), "--approximate: given without its format; allowed: with --mjcf"),
])  # fmt: skip
def test_options_of_a_format_that_is_not_written_are_refused(
    words: tuple[str, ...], refused: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", "one_link", *words, "-o", str(tmp_path)]) == 1
    assert refused in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())


def test_every_option_of_export_has_its_format() -> None:
    parser = dict(commands())["export"]
    (reading,) = (group for group in parser._action_groups if group.title == "reading of descriptions")
    general = {"help", "robot", "output", *FORMATS, *(action.dest for action in reading._group_actions)}
    taken = {option for target in FORMATS.values() for option in target.takes}
    assert {action.dest for action in parser._actions} - general == taken
