"""Mutation testing of all packages: wrong values, the choice of functions, their texts, and the tests that run."""

from __future__ import annotations

import copy
import enum
import functools
import sqlite3
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import sympy as sp

from benchmarks.mutation.executions import read_coverage, read_executions
from benchmarks.mutation.functions import (
    LIST,
    Function,
    choose,
    eligible,
    located,
    mutated_text,
    read_list,
    renewed,
    write_list,
)
from benchmarks.mutation.packages import FIRST, by_module, parts
from benchmarks.mutation.workers import renew
from benchmarks.mutation.wrong import CONTROL, KINDS, PROCEDURE, UNCHANGED, altered, wrong


class Colour(enum.Enum):
    RED, GREEN = 1, 2


class Pair(NamedTuple):
    name: str
    size: float


@dataclass(frozen=True, slots=True)
class Point:
    label: str
    x: float


@dataclass(frozen=True)
class Shape:
    points: tuple[Point, ...]
    scale: np.ndarray = field(default_factory=lambda: np.ones(2))

    @cached_property
    def first(self) -> str:
        return self.points[0].label


class Plain:
    def __init__(self) -> None:
        self.size = 3

    def __repr__(self) -> str:
        return f"Plain({vars(self)})"


VALUES: list[Any] = [
    True, np.True_, 3, 0, -2.5, 0.0, 1e300, 2j, float("nan"), np.float32(1.5), np.int64(7), "one", "a\nb\nc\n", b"raw",
    [1, 2], [1], [[]  , 4], (1.0, 2.0), (1.0, "x"), (np.eye(2), None), tuple(range(9)), {"a": 1},
    {1, 2}, frozenset({1}),
    np.arange(4.0), np.zeros((2, 2)), np.array([True, False]), np.array(["a", "b"]), np.array([1, 2], np.uint8),
    Colour.RED, Pair("p", 0.0), Point("a", 0.0), Shape((Point("a", 1.0),)), Plain(), Path("a/b"), sp.Symbol("x"),
    sp.eye(2), sp.Integer(0),
]  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("value", VALUES, ids=repr)
def test_a_wrong_value_is_another_of_the_same_type(value: Any, kind: str) -> None:
    before = copy.deepcopy(value)
    for pick in range(3):
        new = altered(value, kind, pick)
        assert isinstance(new, type(value)) or (isinstance(value, sp.Basic) and isinstance(new, sp.Basic))
        assert repr(new) != repr(value) == repr(before)


def test_kinds_of_wrong_numbers() -> None:
    assert [altered(2.0, kind) for kind in KINDS] == pytest.approx([-2.0, 2.2, 1.8, 0.0])
    assert [altered(5, kind) for kind in KINDS] == [-5, 6, 4, 0]
    changed = altered(np.arange(1.0, 5.0), "part", 2) != np.arange(1.0, 5.0)
    assert changed.tolist() == [False, False, True, False]
    np.testing.assert_array_equal(altered(np.arange(3), "sign"), [0, -1, -2])
    assert altered([1, 2, 3], "sign") == [3, 2, 1]
    assert altered([1, 2, 3], "part") == [1, 2]
    assert altered([1, 2, 3], "zero") == []
    assert altered("a\nb\nc\n", "part") == "a\nb\n"
    assert altered({"a": 1, "b": 2}, "part") == {"a": 1}
    assert all(altered(value, kind) is UNCHANGED for value in ([], {}, "", None, ()) for kind in KINDS)


def test_fields_of_copies_change_and_what_follows_from_them() -> None:
    shape = Shape((Point("a", 1.0),))
    assert shape.first == "a"
    new = altered(shape, "part", 0)
    assert (new.points == shape.points) == np.any(new.scale != shape.scale)
    assert "first" not in vars(new)
    assert "first" in vars(shape)


def test_functions_of_every_sort() -> None:
    done: list[int] = []

    def items(n: int) -> Iterator[int]:
        yield from range(n)

    assert list(wrong("sign")(items)(3)) == [0, 1]
    assert list(wrong("zero")(items)(3)) == []
    assert list(wrong("part")(lambda: iter("abc"))()) == ["a", "b"]
    assert wrong("sign")(lambda: lambda: 2)()() == -2
    assert wrong("sign")(functools.partial)(int, 7)() == -7
    wrong(PROCEDURE)(done.append)(1)
    assert not done
    assert wrong(CONTROL)(done.append)(1) is None
    assert done == [1]


SOURCE = '''"""A module."""

from __future__ import annotations

import functools


class A(Base if (Base := object) else object):
    @property
    def size(self) -> Later:
        """A size."""
        return 3

    @staticmethod
    @functools.cache
    def twice(x):
        def inner():
            return 2 * x
        return inner()

    def grow(self):
        self.grown = True


def items():
    yield 1
    yield 2
'''


def test_a_mutated_text_returns_wrong_values_and_says_so(tmp_path: Path) -> None:
    names, log = ("A.size", "A.twice", "A.grow", "items"), tmp_path / "log"
    kinds = ("zero", "sign", PROCEDURE, "part")

    def values(text: str) -> tuple[object, ...]:
        space: dict[str, Any] = {"__name__": "made"}
        exec(compile(text, "made.py", "exec"), space)
        a = space["A"]()
        a.grow()
        return a.size, a.twice(4), hasattr(a, "grown"), list(space["items"]())

    chosen = [Function("codegen/a.py", name, kind) for name, kind in zip(names, kinds, strict=True)]
    right = values(SOURCE)
    assert right == (3, 8, True, [1, 2])
    assert values(mutated_text(SOURCE, chosen, control=True)) == right
    assert not log.exists()
    assert values(mutated_text(SOURCE, chosen, str(log))) == (0, -8, False, [1])
    assert log.read_text(encoding="utf-8").split() == ["changed"] * 4


def checkout(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="ascii")
    return folder


def functions(*names: str) -> str:
    return "".join(f"def {name}():\n    return 1\n" for name in names)


def test_functions_without_a_value_to_change_are_not_chosen(tmp_path: Path) -> None:
    tree = checkout(
        tmp_path,
        {
            "codegen/joint/a.py": "from abc import abstractmethod\nclass A:\n    def __init__(self): self.x = 1\n"
            "    @abstractmethod\n    def f(self): ...\n    def g(self):\n        self.x = 2\n"
            "class P(Protocol):\n    def f(self): return 1\n",
            "src/eomgen/b.py": "import contextlib\ndef refuse():\n    '''Say no.'''\n    raise ValueError\n"
            "@contextlib.contextmanager\ndef inside():\n    yield 1\ndef outer():\n    def inner(): return 1\n",
        },
    )
    found = eligible(tree)
    assert found == [Function("src/eomgen/b.py", "outer", PROCEDURE), Function("codegen/joint/a.py", "A.g", PROCEDURE)]
    assert [f.package for f in found] == ["eomgen", "codegen/joint"]


def test_the_choice_has_all_packages_and_is_the_same_again() -> None:
    given = [Function(f"src/eomgen/{p}/m.py", f"f{i}") for p, n in (("a", 200), ("b", 30), ("c", 4)) for i in range(n)]
    chosen = choose(given, 60, 10)
    assert choose(given[::-1], 60, 10) == chosen != choose(given, 60, 10, seed=1)
    count = Counter(f.package for f in chosen)
    assert count["c"] == 4
    assert count["b"] == 10
    assert count.total() == 60
    assert {f.kind for f in chosen} == {*KINDS}


def test_functions_that_moved_are_found_and_those_gone_are_named_and_replaced(tmp_path: Path) -> None:
    tree = checkout(
        tmp_path, {"codegen/c/a.py": functions("kept", "fresh"), "src/eomgen/c/b.py": functions("A", "moved", "g")}
    )
    listed = [
        Function("codegen/c/a.py", "kept", "sign"),
        Function("codegen/c/a.py", "moved", "zero"),
        Function("codegen/c/a.py", "lost", "part"),
    ]
    found, gone = located(listed, eligible(tree))
    assert found == [listed[0], replace(listed[1], file="src/eomgen/c/b.py")]
    assert gone == [listed[2]]
    anew = renewed(listed, eligible(tree))
    assert {*anew} - {*found} == {f for f in anew if f.name == "fresh"}
    assert len(anew) == 3
    assert renewed(anew, eligible(tree)) == anew
    write_list(anew, tmp_path / "list.json")
    assert read_list(tmp_path / "list.json") == anew


def test_the_list_of_this_checkout() -> None:
    listed = read_list()
    assert len({f.key for f in listed}) == len(listed) == 386
    assert {f.kind for f in listed} == {*KINDS, PROCEDURE}
    assert len(LIST.read_text(encoding="ascii").splitlines()) == len(listed) + 2  # a line per function


def test_contexts_of_processes_say_which_tests_execute_a_function(tmp_path: Path) -> None:
    tree = checkout(tmp_path, {"codegen/c/a.py": functions("f", "g", "h")})
    lines = {
        "": [1, 3, 5],
        "tests/c/t.py::x[1]|run": [2],
        "tests/c/t.py::x[2]|setup": [2, 4],
        "tests/d/u.py::C::y (call)": [2],
    }
    with sqlite3.connect(tree / ".coverage") as database:
        database.execute("CREATE TABLE file (id integer, path text)")
        database.execute("CREATE TABLE context (id integer, context text)")
        database.execute("CREATE TABLE line_bits (file_id integer, context_id integer, numbits blob)")
        database.execute("INSERT INTO file VALUES (1, '/elsewhere/src/eomgen/codegen/c/a.py')")
        for i, (name, hit) in enumerate(lines.items()):
            database.execute("INSERT INTO context VALUES (?, ?)", (i, name))
            numbits = sum(1 << line for line in hit).to_bytes(2, "little")
            database.execute("INSERT INTO line_bits VALUES (1, ?, ?)", (i, numbits))
    (tree / "junit.xml").write_text(
        '<testsuites><testsuite><testcase classname="tests.c.t" name="x[1]" time="2.0"/>'
        '<testcase classname="tests.c.t" name="x[2]" time="1.0"/>'
        '<testcase classname="tests.d.u.C" name="y" time="0.1"/></testsuite></testsuites>',
        encoding="ascii",
    )
    read_coverage(tree / ".coverage", tree / "junit.xml", tree).write(tree / "kept.gz")
    found = read_executions(tree / "kept.gz")
    f, g, h = (Function("codegen/c/a.py", name) for name in "fgh")
    assert [x[0] for x in found.of(f)] == ["tests/c/t.py::x[1]", "tests/c/t.py::x[2]", "tests/d/u.py::C::y"]
    assert found.of(g) == [("tests/c/t.py::x[2]", 1.0)]
    assert found.of(h) == []  # tests/codegen/c has none
    checkout(tree, {"tests/d/u.py": "g()"})
    assert [x[0] for x in found.ranked(g, tree)] == ["tests/c/t.py::x[2]", "tests/d/u.py::C::y", "tests/c/t.py::x[1]"]
    assert [x[0] for x in found.ranked(f, tree)] == ["tests/d/u.py::C::y", "tests/c/t.py::x[2]", "tests/c/t.py::x[1]"]


def test_tests_of_a_mutant_are_shared_out_up_to_a_time() -> None:
    ranked = [("b.py::x", 1.0), ("a.py::x", 2.0), ("b.py::y", FIRST - 5.0), ("c.py::x", 10.0), ("d.py::x", 100.0)]
    assert list(parts(ranked, 40.0)) == [["b.py::x", "b.py::y", "a.py::x"], ["c.py::x"]]
    assert list(parts(ranked[-1:], 40.0)) == [["d.py::x"]]
    assert list(parts([], 40.0)) == []
    assert by_module(["b::1", "a::1", "b::2"]) == ["b::1", "b::2", "a::1"]


def test_a_folder_is_renewed_by_links(tmp_path: Path) -> None:
    source = checkout(tmp_path / "source", {"a/one": "1", "a/two": "2", "b": "3", "making-c/d": "4"})
    target = tmp_path / "target"
    for _ in range(2):
        renew(source, target)
        files = {str(x.relative_to(target)): x.read_text() for x in target.rglob("*") if x.is_file()}
        assert files == {"a/one": "1", "a/two": "2", "b": "3"}
        assert (target / "b").samefile(source / "b")
        (target / "a" / "one").unlink()
        (target / "b").unlink()
        checkout(target, {"b": "wrong", "a/more/x": "5", "c": "6"})
        (target / "a" / "two").unlink()
        (target / "a" / "two").mkdir()
