"""Every option of every command has a kind here, and wrong values of each are refused in one line that prints.

An option that is forgotten fails ``test_every_option_has_one_kind``.  Numbers that the parser itself reads, of which
test_any_number.py finds all, choices and flags need none.
"""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Collection, Mapping
from importlib.util import find_spec
from itertools import count, cycle
from pathlib import Path

import pytest

from eomgen.cli.entry import main
from eomgen.names import show
from tests.cli.test_any_number import HOSTILE, OTHER, options
from tests.support.soak import soaked

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
    **dict.fromkeys(("name", "held", "frame", "matrix", "input", "output_of", "kernels", "fixed", "stiffness"), "X"),
    "export parameters": "X",
    **dict.fromkeys(("measure", "estimate"), "X"),
    "attach": "ball=X",
}
LATER = {  # once a file was read: tests of analysis, identification and pages try them
    *("budget stops", "report stops", "budget robot", "report robot", "view robot", "live robot", "tolerance"),
    *("fit parameters", "coordinates", "matrices", "known", "distance", "calibrate attach", "calibrate fixed"),
    *("reduce root", "reduce node", "reduce rigid", "reduce mean", "reduce stress"),
    *(
        "calibrate stiffness",
        "feedforward outputs",
        "budget frame",
        "accuracy frame",
        "compensate frame",
        "tolerance frame",
        "plot output",
    ),
}
ANY = {  # any text will do: folders, addresses, words for a report
    *("derive output", "generate output", "export output", "simulate output", "simulate stream", "sweep output"),
    *("packages", "dask", "observer output", "feedforward c", "accuracy load", "accuracy rate"),
}
KINDS: Mapping[str, Collection[str]] = {
    "later": LATER,
    "any": ANY,
    "number": NUMBERS,
    "file": READ,
    "output": WRITTEN,
    "name": NAMES,
}
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
    if find_spec("ziglang") is None:  # pages ask for the compiler before they read files
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
        return [*made, action.option_strings[0], *behind]
    return made if action.dest != "results" else [*made, *behind]


@pytest.fixture
def refusal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Refusal:
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        Path(name).write_text(text, encoding="ascii")
    return Refusal(capsys)


class Refusal:
    """Calls of commands in the folder of a test, all of which have to be refused."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self.capsys = capsys

    def __call__(self, command: str, action: argparse.Action, behind: list[str]) -> str:
        """What a command refuses an option with: one last line, which a terminal prints as it is."""
        line = words(command, action, behind)
        try:
            status = main(line)
        except SystemExit as stop:  # the parser's own
            status = int(stop.code or 0)
        said = self.capsys.readouterr().err
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


def test_numbers_behind_names_are_refused(refusal: Refusal) -> None:
    """Each of the hostile texts in its turn."""
    texts = cycle(HOSTILE)
    for command, action in of_kind("number"):
        pattern = NUMBERS.get(f"{command} {action.dest}") or NUMBERS[action.dest]
        for text in (next(texts), next(texts)):
            behind = [word.removesuffix("N") + text if word.endswith("N") else word for word in pattern.split()]
            last = refusal(command, action, behind)
            assert show(text) in last or re.search(r"expected (at least one|one|\d) argument", last), last


@pytest.mark.parametrize("kind", soaked(["missing", "folder", "fifo", "bytes"], ["fifo"]))
def test_files_that_are_none_are_refused_by_name(kind: str, refusal: Refusal) -> None:
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
        assert path.name in last or action.dest == "files", last  # check says it in lines before


def test_names_that_are_none_are_refused_as_code(refusal: Refusal) -> None:
    for command, action in of_kind("name"):
        pattern = NAMES.get(f"{command} {action.dest}") or NAMES[action.dest]
        last = refusal(command, action, [pattern.replace("X", "\x1b[2J")])
        assert r"\x1b[2J" in last, last


def test_outputs_of_other_endings_are_refused(refusal: Refusal) -> None:
    for command, action in of_kind("output"):
        last = refusal(command, action, ["out\x1b[2J.txt"])
        assert r"out\x1b[2J.txt" in last, last
        assert re.search("allowed: (a path that ends|paths that end) in", last), last
