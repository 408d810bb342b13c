"""Values of declared types out of what JSON holds, and the line and column of a key of TOML."""

from __future__ import annotations

import json
import pathlib
import random
import tomllib
import types
from dataclasses import make_dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.authoring.check import check_file
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError
from eomgen.forms import toml_place
from eomgen.forms.dotted_paths import get_path
from eomgen.forms.keys import FileName
from eomgen.forms.plain import value_of
from eomgen.forms.toml_place import lines_of
from tests.support.refusals import refused


class Alias:
    """What NumPy 2.5 calls NDArray where Python has type statements: a name with the type behind it."""

    __name__ = "NDArray"
    __value__ = np.ndarray[Any, np.dtype[np.float64]]

    def __getitem__(self, items: Any) -> types.GenericAlias:
        return types.GenericAlias(self, items)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("until", 2.0),
        ("control.kp.hinge", 50.0),
        ("control.kd", None),
        ("forces.0.wrench.1", -3.0),
        ("forces.push.wrench.0", 1.5),
    ],
)
def test_dotted_paths_lead_to_values(path: str, value: float | None) -> None:
    """Through tables by keys, through lists by numbers and names."""
    forces = [{"name": "push", "wrench": [1.5, -3.0]}]
    assert get_path({"until": 2.0, "control": {"kp": {"hinge": 50.0}}, "forces": forces}, path) == value


def test_allowed_endings_of_files_are_named() -> None:
    allowed = "the path of a .csv or .npz file, relative to this file"
    assert FileName("", suffixes=(".csv", ".npz")).rule == allowed
    assert FileName("", suffixes=(".urdf",)).rule == "the path of an .urdf file, relative to this file"


@pytest.mark.quick
@pytest.mark.parametrize("array", [NDArray[np.float64], Alias()[(np.float64,)]], ids=["class", "name"])
def test_arrays_are_read_as_numpy_names_them(array: Any) -> None:
    kind = make_dataclass("Rows", [("x", array)])
    assert value_of(kind, {"x": [0.0, 1.5]}, "file").x == (0.0, 1.5)
    assert value_of(kind, {"x": [[0.0, 1.5], [2.0, 3.0]]}, "file").x == ((0.0, 1.5), (2.0, 3.0))
    refused(InputError, r"file: x: got rows of different lengths", value_of, kind, {"x": [[0.0], [1.0, 2.0]]}, "file")
    with pytest.raises(InputError, match=r"file: x\[1\]: got 'a'; allowed: a value of type float"):
        value_of(kind, {"x": [0.0, "a"]}, "file")


Path = tuple[str, ...]
NAMES = ["a", "b1", "links", "-", "7", "a.b", "", "x y", 'q"q', "#", "[x]", "\N{SNOWMAN}"]
TEXTS = ['"plain # no comment"', "'[a]\\'", '"""one " two "" \\""" \n[x]\na = 1 """""', "'''\nb = '' 2 '''", '"\\\\"']
SCALARS = [*TEXTS, "1", "-2.5e3", "nan", "true", "1979-05-27 07:32:00", "0x1f"]


class Writer:
    """Writes a random document, and where every key and element of an array is."""

    def __init__(self, seed: int) -> None:
        self.random, self.text = random.Random(seed), ""
        self.places: dict[Path, int] = {}

    def put(self, text: str, path: Path | None = None) -> None:
        if path is not None:
            self.places.setdefault(path, len(self.text))
        self.text += text

    def gap(self, newline: bool = False) -> None:
        self.put(self.random.choice(["", "", " ", "\t ", *(["\n", " # a = 1 [b]\n", "\r\n"] if newline else [])]))

    def key(self, path: Path) -> None:
        name = path[-1]
        bare = bool(name) and all(c.isascii() and (c.isalnum() or c in "_-") for c in name)
        literal = f"'{name}'" if "\n" not in name else json.dumps(name)
        self.put(self.random.choice([json.dumps(name), literal, *([name, name, name] if bare else [])]), path)

    def dotted(self, path: Path, known: Path) -> None:
        for end in range(len(known) + 1, len(path) + 1):
            if end > len(known) + 1:
                self.gap()
                self.put(".")
                self.gap()
            self.key(path[:end])

    def value(self, path: Path, depth: int) -> None:
        kind = self.random.random()
        if depth == 0 or kind < 0.6:
            self.put(self.random.choice(SCALARS))
        elif kind < 0.8:
            self.array(path, depth)
        else:
            self.put("{")
            for place, name in enumerate(self.random.sample(NAMES, self.random.randint(0, 3))):
                self.put("," if place else "")
                self.gap()
                self.pair((*path, name), path, depth - 1)
                self.gap()
            self.put("}")

    def array(self, path: Path, depth: int) -> None:
        self.put("[")
        for index in range(self.random.randint(0, 3)):
            self.gap(True)
            self.places[(*path, str(index))] = len(self.text)
            self.value((*path, str(index)), depth - 1)
            self.gap(True)
            self.put(",")
        self.gap(True)
        self.put("]")

    def pair(self, path: Path, known: Path, depth: int) -> None:
        self.dotted(path, known)
        self.gap()
        self.put("=")
        self.gap()
        self.value(path, depth)

    def body(self, path: Path) -> None:
        for name in self.random.sample(NAMES[:6], self.random.randint(0, 3)):
            self.gap(True)
            deeper = (*path, name, "in", "side") if self.random.random() < 0.2 else (*path, name)
            self.pair(deeper, path, 3)
            self.put(self.random.choice(["\n", " # x = 2\n", "\r\n"]))

    def document(self) -> str:
        self.body(())
        for number in range(self.random.randint(0, 4)):
            name = f"{self.random.choice(NAMES)}{number} t"
            count = self.random.choice([0, 0, 2, 3])
            for index in range(max(count, 1)):
                self.put("[[" if count else "[")
                self.gap()
                self.dotted((name,), ())
                self.gap()
                path: Path = (name, str(index)) if count else (name,)
                if count:
                    self.places[path] = self.places[(name,)] if index == 0 else self.text.rindex("[[") + 2
                self.put("]] # [c]\n" if count else "]\n")
                self.body(path)
        return self.text


def line_of(text: str, path: tuple[str, ...], value: bool = False) -> tuple[int, int] | None:
    return lines_of(text, [(path, value)])[0]


def expected(text: str, offset: int) -> tuple[int, int]:
    line = text[:offset].splitlines(keepends=True)
    last = line[-1] if line and not line[-1].endswith("\n") else ""
    return text.count("\n", 0, offset) + 1, len(last) + 1


def check(seed: int) -> int:
    writer = Writer(seed)
    text = writer.document()
    tomllib.loads(text)
    for path, offset in writer.places.items():
        found = line_of(text, path)
        assert found is not None, (seed, path)
        if path[-1].isdigit() and text[offset] not in "[{\"'-0123456789nt":  # an entry: its header's key, after blanks
            offset += len(text[offset:]) - len(text[offset:].lstrip(" \t"))
        assert found[0] == expected(text, offset)[0], (seed, path, found)
        if not path[-1].isdigit():
            assert found == expected(text, offset), (seed, path, found)
        deeper = line_of(text, (*path, "no such key"))
        assert deeper == found
    assert line_of(text, ("no such key",)) is None
    return len(writer.places)


def test_random_documents() -> None:
    assert sum(check(seed) for seed in range(150)) > 2000


@pytest.mark.soak
def test_many_random_documents() -> None:
    print(f"\n{sum(check(seed) for seed in range(150, 6000))} keys found where they were written")


def test_a_text_that_is_too_deep_has_no_line() -> None:
    text = "a = " + "[" * 20_000 + "]" * 20_000
    assert line_of(text, ("a", *["0"] * 20_000)) is None
    assert line_of("a = [", ("b",)) is None


def test_the_second_of_two_names_is_meant() -> None:
    text = 'name = "r"\n' + '[[links]]\nname = "a"\nmass = 1\n' * 2
    caught = refused(DescriptionError, "", robot_from_toml, text, source="r.toml")
    assert str(caught).startswith("r.toml:5:3: links.a: the name 'a' is taken")
    assert (caught.line, caught.column) == (5, 3)


@pytest.mark.parametrize(
    ("text", "column"),
    [
        ('name = "r"\n  mas = 1', 3),  # an unknown key: the key
        ('name = "r"\ngravity   = 3', 13),  # a value: where it begins
        ('name = "r"\ngravity = [0, 0, "\\u0041"]', 18),
        ('name = "r"\nlinks = [{ name = "a" }]', 10),  # a missing key: the table
        ('name = "r"\nlinks = [{ name = "a", mass = -1 }]', 31),
        ('name = "r"\nlinks = [{ name = "a", mass = 1, "com" = [1] }]', 42),
        ('name = "r"\ntunable = ["gravity"', 21),  # no TOML: where the text ends
        ('name = "r"\ngravity = = 1', 11),
    ],
)
def test_columns(text: str, column: int) -> None:
    caught = refused(DescriptionError, "", robot_from_toml, text, source="r.toml")
    assert str(caught).startswith(f"r.toml:2:{column}: ")


def test_without_a_source() -> None:
    refused(DescriptionError, r"^line 2, column 11: gravity: got 3", robot_from_toml, 'name = "r"\ngravity = 3')


def test_many_paths_are_found_in_one_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    """The places of all of them are those of each alone, and the text is read once for all."""
    rows = ", ".join(f"{{ k = {i}, inner = {{ a = {{ b = {i} }} }} }}" for i in range(200))
    text = f"first = 1\nrows = [{rows}]\n[last.one]\nx = 2\n"
    paths = [("rows", str(i), *rest) for i in (0, 7, 199, 300) for rest in ((), ("inner", "a", "b"), ("inner", "c"))]
    wanted = [(path, value) for path in [*paths, ("first",), ("last", "one", "x"), ()] for value in (False, True)]
    alone = [line_of(text, path, value) for path, value in wanted]
    scans, run = [], toml_place._Scan.statements
    monkeypatch.setattr(toml_place._Scan, "statements", lambda scan: (scans.append(scan), run(scan)))
    assert lines_of(text, wanted) == alone
    assert len(scans) == 1
    assert None in alone
    assert (4, 5) in alone


def test_a_check_reads_its_text_once_for_all_errors(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scans, run = [], toml_place._Scan.statements
    monkeypatch.setattr(toml_place._Scan, "statements", lambda scan: (scans.append(scan), run(scan)))
    path = tmp_path / "s.toml"
    path.write_text(
        "duration = 1.0\nmotion = {" + ", ".join(f"k{i} = {{ a = {{ b = 1 }} }}" for i in range(300)) + "}\n"
    )
    assert len(check_file(path).errors) == 50
    assert len(scans) == 1
