"""Every option of every command has a kind here, and wrong values of each are refused in one line that prints."""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Callable, Iterator
from itertools import count, cycle
from pathlib import Path

import numpy as np
import pytest

from eomgen.cli.entry import NAMES as COMMANDS
from eomgen.cli.entry import make_parser
from eomgen.cli.shared.numbers import real
from eomgen.description.load import load_robot
from eomgen.errors import InputError
from eomgen.identification import calibrate, fit
from eomgen.identification.exciting.solve import excite
from eomgen.identification.tolerances.solve import tolerance
from eomgen.motion.ends import default_motion
from eomgen.motion.point_to_point import PointToPoint
from eomgen.names import show
from eomgen.simulation.run import simulate
from tests.support.commands import run
from tests.support.optional import installed
from tests.support.refusals import refused
from tests.support.soak import soaked

pytestmark = pytest.mark.quick

HOSTILE = ("1e300", "-1e300", "1e-300", "nan", "inf", "-inf", "1" + "0" * 400, "9" * 5000, "\x1b[2J", "", "1_0e300")
OTHER = {"port", "fmi", "kernels", "levels"}  # a port is the system's to refuse, a version one of a few; names


def options() -> Iterator[tuple[str, argparse.Action]]:
    """All options of all commands."""
    (commands,) = (x for x in make_parser(COMMANDS)._actions if isinstance(x, argparse._SubParsersAction))
    for name, parser in commands.choices.items():
        if name in COMMANDS:  # what is left are groups of the same commands
            yield from ((name, action) for action in parser._actions)


def test_all_numbers_of_options_are_bounded() -> None:
    seen = 0
    for command, action in options():
        if action.type is None or action.dest in OTHER or not action.type.__module__.startswith("eomgen"):
            assert action.type not in (int, float) or action.dest in OTHER, (command, action.dest)
            continue
        seen += 1
        for text in HOSTILE:
            caught = refused(argparse.ArgumentTypeError, "allowed", action.type, text)
            assert str(caught).isprintable()
    assert seen > 40


@pytest.mark.parametrize(
    "value",
    soaked([1e300, 1e-300, 10**400, float("nan"), "1", True, [1.0], None], [1e300, 10**400, None]),
    ids=range(8),
)
def test_functions_refuse_them_as_well(value: object) -> None:
    robot = load_robot("ur5")
    given: dict[str, object]
    for given in ({"duration": value}, {"bandwidth": value}):
        refused(InputError, "allowed", simulate, robot, **given)
    refused(InputError, "a motion takes a time above 0", default_motion, robot, value, ["joint1.gamma"])
    refused(InputError, "a motion takes a time above 0", PointToPoint, [0.0], [1.0], value)
    for given in ({"duration": value}, {"step": value}):
        refused(InputError, "allowed", excite, robot, **given)
    for given in ({"bandwidth": value}, {"confidence": value}):
        refused(InputError, rf"{next(iter(given))}: .*; allowed: a number", fit, robot, "gone.csv", **given)
    with pytest.raises(InputError, match=r"confidence: .*; allowed: a number between 0 and 1"):
        calibrate(robot, "gone.csv", confidence=value)
    if value is not None:
        refused(InputError, "allowed", excite, robot, noise=value)


WRONG = (
    *(np.ones(3), np.array([True, False]), "x", 10**400, np.nan, 1e300, object(), [], {}, -1, {"a": 1}, 2**70),
    *(np.array(["a"]), [[1], [1, 2]], 1j, b"x", {1: 2}),
)
TABLE = {"frames.*.x": {"bound": 1e-4}}


@pytest.mark.parametrize(
    ("function", "key"),
    [
        *((tolerance, key) for key in ("along", "poses", "random", "seed", "wrench", "confidence")),
        *((simulate, key) for key in ("duration", "rtol", "output_step", "goal")),
        *(pytest.param(simulate, key, marks=pytest.mark.soak) for key in ("bandwidth", "step", "start", "tool")),
        (simulate, "method"),
    ],
)
def test_anything_given_is_taken_or_refused(function: Callable[..., object], key: str) -> None:
    """Arrays, texts and huge numbers in the place of what belongs there: an error of eomgen, and no other."""
    given: dict[str, object] = {"table": TABLE} if function is tolerance else {"duration": 0.01}
    given |= {"seed": {"random": 1}, "step": {"method": "rk4"}}.get(key, {})
    said = []
    for value in WRONG:
        try:
            function("one_link", **{**given, key: value})
        except InputError as error:
            said.append(str(error))
    assert said
    assert [text for text in said if not text.isprintable()] == []


STATES = ("deflection", "modes", "response", "linearize")
ARGUMENTS = {"robot": "one_link", "others": "four_bar", "subject": "one_link", "name": "arm"}  # others are files
BASE = {  # words of commands that need more than a robot
    "new": "new {name}",
    "check": "check {files}",
    "reduce": "reduce {files}",
    "export": "export {robot} --mjcf",
    "observer": "observer {robot} --measure encoder:joint1.gamma",
    "compare": "compare {robot} {others}",
    "sweep": "sweep {robot} --scenario gone.toml --plan plan.toml -o out",
    **{command: f"{command} {{robot}} {{motion}}" for command in ("forces", "fit", "identify")},
    "calibrate": "calibrate {robot} {poses}",
    "poses": "poses {robot} --range joint1.gamma 0 1",
    "accuracy": "accuracy --robot one_link --scenario gone.toml --plan plan.toml",
    "tolerance": "tolerance {robot} {table}",
    **{command: f"{command} {{robot}} --scenario gone.toml" for command in ("compensate", "feedforward")},
    **{command: f"{command} {{result}}" for command in ("budget", "plot", "report")},
    **{command: f"{command} {{subject}}" for command in ("view", "live")},
    "new dh": "new arm --convention classic",  # and for single options
    "check kernels": "check {robot} --float32",
    "export kernels": "export {robot} --arrays",
    "export parameters": "export {robot} --acados",
    **{f"feedforward {place}": "feedforward {robot} --c out" for place in ("step", "friction_smoothing")},
    "feedforward c": "feedforward {robot}",
    "accuracy results": "accuracy",
    "accuracy commands": "accuracy poses.csv",
}
FILES = {
    "plan.toml": 'samples = 2\n[[vary]]\nparameter = "gravity.z"\nuniform = { low = -10.0, high = -9.0 }\n',
    "poses.csv": "pose,tool.x,tool.y,tool.z\n1,0,0,0\n1,0,0,1e-3\n",
}

# Options by their place among the values of a command, "command place" where commands mean different things by it.
NUMBERS = {  # words behind the option, N in the place of a number
    "stops": "stiffness=N",
    **dict.fromkeys(("pose", "goal"), "joint1.gamma=N"),
    **dict.fromkeys(("kp", "kd", "excite rates", "excite drives", "noise"), "N"),
    **dict.fromkeys(("accelerations", "compensate rates", "drive_limits"), "joint1.gamma=N"),
    **dict.fromkeys((f"{command} load" for command in STATES), "tcp 0 0 N 0 0 0"),
    **dict.fromkeys((f"{command} parameters" for command in STATES), "gravity.z=N"),
    "states": "joint1.gamma.friction.z=N",
    "range": "joint1.gamma 0 N",
    "box": "tcp 0 0 0 1 1 N",
    "half_space": "tcp 0 0 1 N",
    "clear_of": "tcp 0 0 0 N",
    "weights": "x=N",
    "folds": "N",
    "observer uncertainty": "position=N",
    "observer drift": "encoder=N",
    "simulate within": "tool N",
}
READ = {  # files, with the endings without which they are not looked at
    **dict.fromkeys(("robot", "others", "subject", "files", "scenario", "plan", "table"), ".toml"),
    **dict.fromkeys(("dh", "motion", "poses", "results", "commands", "after"), ".csv"),
    **dict.fromkeys(("along", "result", "covariance"), ".npz"),
    "fit": ".json",
}
WRITTEN = {"output", "report", "toml", "urdf", "plot"}
NAMES = {  # words behind the option, X in the place of a name
    **dict.fromkeys(("name", "frame", "matrix", "input", "output_of", "kernels", "fixed", "stiffness"), "X"),
    "export parameters": "X",
    **dict.fromkeys(("measure", "estimate"), "X"),
    "attach": "ball=X",
}
LATER = {  # once a file was read: tests of analysis, identification and pages try them
    *("budget stops", "report stops", "budget robot", "report robot", "view robot", "live robot", "tolerance"),
    *("fit parameters", "coordinates", "matrices", "known", "distance", "calibrate attach", "calibrate fixed"),
    *("reduce root", "reduce node", "reduce rigid", "reduce mean", "reduce stress", "reduce matrix_name", "xacro_args"),
    *("calibrate stiffness", "feedforward outputs", "budget frame", "accuracy frame", "compensate frame"),
    *("tolerance frame", "plot output"),
}
ANY = {  # any text will do: folders, addresses, words for a report
    *("derive output", "generate output", "export output", "simulate output", "simulate stream", "sweep output"),
    *("packages", "dask", "observer output", "feedforward c", "accuracy load", "accuracy rate"),
}
KINDS = {"later": LATER, "any": ANY, "number": NUMBERS, "file": READ, "output": WRITTEN, "name": NAMES}
OPTIONS = [
    (command, action)
    for command, action in options()
    if action.nargs != 0 and not action.choices and action.dest not in OTHER - {"kernels"}
    if action.type in (None, Path)
]


def kinds_of(command: str, place: str) -> list[str]:
    """The kinds that an option has, by its command and place or else by its place alone."""
    of_command = [kind for kind, places in KINDS.items() if f"{command} {place}" in places]
    return of_command or [kind for kind, places in KINDS.items() if place in places]


def of_kind(kind: str) -> list[tuple[str, argparse.Action]]:
    found = [(command, action) for command, action in OPTIONS if kinds_of(command, action.dest) == [kind]]
    assert found
    if not installed("ziglang"):  # pages ask for the compiler before they read files
        found = [(command, action) for command, action in found if command != "live"]
    return found


def words(command: str, action: argparse.Action, behind: list[str]) -> list[str]:
    """The words of a command with an option, or with an argument in its place."""
    made: list[str] = []
    for word in BASE.get(f"{command} {action.dest}", BASE.get(command, f"{command} {{robot}}")).split():
        place = word.strip("{}")
        if place == word:
            made.append(word)
        elif place == action.dest and not action.option_strings:
            made += behind
        else:
            made.append(ARGUMENTS.get(place) or f"gone{READ[place]}")
    if action.option_strings:
        first = action.option_strings[0]
        if first in made and not isinstance(action, argparse._AppendAction):  # once is all that is allowed
            del made[made.index(first) : made.index(first) + 2]
        return [*made, first, *behind]
    return made if action.dest != "results" else [*made, *behind]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        Path(name).write_text(text, encoding="ascii")


def refusal(command: str, action: argparse.Action, behind: list[str]) -> str:
    """What a command refuses an option with: one last line, which a terminal prints as it is."""
    line = words(command, action, behind)
    status, _, said = run(*line)
    assert status in (1, 2), f"{line}: {said}"
    last = said.strip().splitlines()[-1]
    assert last.isprintable(), line
    assert last.startswith("eomgen"), f"{line}: {said}"
    return last


def test_every_option_has_one_kind() -> None:
    for command, action in OPTIONS:
        found = kinds_of(command, action.dest)
        assert len(found) == 1, f"{command} {action.dest} ({'/'.join(action.option_strings)}): {found or 'no kind'}"
    places = {f"{command} {action.dest}" for command, action in OPTIONS} | {action.dest for _, action in OPTIONS}
    assert {place for kind in KINDS.values() for place in kind} <= places, "a table names what is no option"


def test_numbers_behind_names_are_refused(folder: None) -> None:
    """Each of the hostile texts in its turn."""
    for (command, action), text in zip(of_kind("number"), cycle(HOSTILE)):
        pattern = NUMBERS.get(f"{command} {action.dest}") or NUMBERS[action.dest]
        behind = [word.removesuffix("N") + text if word.endswith("N") else word for word in pattern.split()]
        last = refusal(command, action, behind)
        assert show(text) in last or re.search(r"expected (at least one|one|\d) argument", last), last


@pytest.mark.parametrize("kind", soaked(["missing", "folder", "fifo", "bytes", "x" * 300], ["fifo", "x" * 300]))
def test_files_that_are_none_are_refused_by_name(kind: str, folder: None) -> None:
    numbers = count()
    for command, action in of_kind("file"):
        path = Path(f"{kind}{next(numbers)}{READ[action.dest]}")
        if kind == "folder":
            path.mkdir()
        elif kind == "fifo":
            os.mkfifo(path)
        elif kind == "bytes":
            path.write_bytes(b"\x89\x00\xff\x1b[2J" * 9)
        last = refusal(command, action, [str(path)])
        assert path.name[-20:] in last or action.dest == "files", last  # check says it in lines before


def test_names_that_are_none_are_refused_as_code(folder: None) -> None:
    for command, action in of_kind("name"):
        pattern = NAMES.get(f"{command} {action.dest}") or NAMES[action.dest]
        last = refusal(command, action, [pattern.replace("X", "\x1b[2J")])
        assert r"\x1b[2J" in last, last


def test_outputs_of_other_endings_are_refused(folder: None) -> None:
    for command, action in of_kind("output"):
        last = refusal(command, action, ["out\x1b[2J.txt"])
        assert r"out\x1b[2J.txt" in last, last
        assert re.search("allowed: (a path that ends|paths that end) in", last), last


def alone() -> Iterator[tuple[argparse.ArgumentParser, argparse.Action]]:
    """Each option of each command, with a parser that needs nothing else."""
    (commands,) = (x for x in make_parser(COMMANDS)._actions if isinstance(x, argparse._SubParsersAction))
    for parser in (commands.choices[name] for name in COMMANDS):
        for part in (*parser._actions, *parser._mutually_exclusive_groups):
            part.required = False
        yield from ((parser, action) for action in parser._actions if action.option_strings and action.dest != "help")


def given(action: argparse.Action, text: str) -> list[str]:
    """The words of an option with a text in the place of each value."""
    counted = action.nargs if isinstance(action.nargs, int) else 1
    return [*action.option_strings[-1:], *([next(iter(map(str, action.choices or [text])))] * counted)]


def test_options_that_are_given_twice_are_collected_or_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for parser, action in alone():
        words = given(action, "a.html" if action.dest in ("report", "output") else "1")
        if action.nargs in ("+", "*") or isinstance(action, argparse._AppendAction):
            once, twice = (vars(parser.parse_args(words * n))[action.dest] for n in (1, 2))
            assert twice == [*once, *once], words
            continue
        with pytest.raises(SystemExit):
            parser.parse_args([*words, *words])
        assert capsys.readouterr().err.endswith(": given more than once; allowed: once\n"), words


def test_negative_numbers_with_exponents_are_values() -> None:
    tried = [0, 0]
    for parser, action in alone():
        if action.nargs != 0 and not action.choices and action.type in (None, real):
            found = np.ravel(vars(parser.parse_args(given(action, "-1e-2")))[action.dest]).tolist()
            assert set(found) == ({"-1e-2"} if action.type is None else {-0.01}), action.option_strings
            tried[action.type is None] += 1
    assert min(tried) > 30


def test_files_of_an_option_that_is_given_twice_are_written(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("motion.csv", "result.npz", "scenario.toml")]
    words = [word for path in paths for word in ("-o", path)]
    assert run("excite", "one_link", "--duration", 2, "--harmonics", 2, "--starts", 1, *words)[0] == 0
    assert all(path.is_file() for path in paths)
