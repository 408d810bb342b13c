"""Mutation testing in short: a dozen nasty changes of the derivation that the fast oracle must notice; and the page."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Collection
from pathlib import Path

import pytest

from eomgen.errors import InternalError
from tests.oracles.mutation import (
    KERNELS,
    PART_OF,
    check_closed_form,
    check_closed_form_of,
    check_counts,
    check_joint,
    check_kernels,
    check_parameters,
    check_zeros,
    checks,
    codegen,
)
from tests.support.mutant import Mutant, dependents, imports_of, modules, mutated, source_of
from tests.support.mutation_cases import cases, small_cases

ROOT = Path(__file__).parents[2]
PAGE, ARGUMENTS = ROOT / "docs" / "mutation.md", ROOT / "benchmarks" / "mutation" / "survivors.toml"

# Module, what it says, what it says instead, and the check that sees it: a robot, or one of the others by name.
NASTY = [
    ("joint.lemmas", "A[i, j], A[j, i] = -sp.sin(s), sp.sin(s)", "A[i, j], A[j, i] = sp.sin(s), -sp.sin(s)", "joint"),
    ("joint.lemmas", "H * step(j).generator.T) == 0)", "H * step(j).generator.T) != 0)", "joint"),
    ("joint.deriving", "by_sin, by_cos = kinds", "by_cos, by_sin = kinds", "joint"),
    ("joint.deriving", "source.is_rotation, source.axis", "source.is_rotation, 0", "joint"),
    ("joint.zeros", "(s == w) & self.before[v, w]", "(s == v) & self.before[v, w]", "zeros"),
    ("joint.zeros", "for pair in facts.coaxial if pair[1] == turn]", "for pair in facts.coaxial]", "zeros"),
    ("closed_form.trace", "_dot(DH, D2)", "_dot(D, D2)", "small tree"),
    ("tree.recursion", "cross(scale(2.0, w), unit(axis, v[index]))", "cross(w, unit(axis, v[index]))", "chain"),
    ("tree.recursion", "column = matvec(back, matvec(", "column = matvec(turn.matrix, matvec(", "puma560"),
    ("tree.recursion", "J[1][2] * (s[2] - s[1])", "J[1][2] * (s[1] - s[2])", "chain"),
    ("tree.composite", "moment[turn.axis] = about_axis", "moment[turn.axis] = moment[turn.axis]", "counts"),
    ("tree.composite", "(b, a): c * t - S[a][b],", "(b, a): c * t - S[b][a],", "chain"),
    ("tree.regressor", "add(x, cross(e, joint.offset))", "add(x, cross(joint.offset, e))", "chain"),
    ("tree.regressor", "(U[1][1] - U[2][2], -U[0][1], U[0][2])", "(U[1][1] - U[2][2], U[0][1], U[0][2])", "chain"),
    ("tree.regressor", "cross(self.a, e)", "cross(e, self.a)", "puma560"),
    ("solve.articulated", "mat3(cross(p, column)", "mat3(cross(column, p)", "tree"),
    ("solve.elimination", "share = armature * inverse", "share = inverse", "tree"),
    ("solve.free_bodies", "(x + beta.sin * carried[2]) * t", "(x - beta.sin * carried[2]) * t", "free"),
    ("solve.free_bodies", "factor = psi.armature / (1.0 +", "factor = psi.armature / (2.0 +", "rotors of free bodies"),
    ("forces.transmissions", "yield between.principal, -force", "yield between.principal, force", "motors"),
    ("solve.rows", "slope / (1.0 + slope * entry)", "1.0 / (1.0 + slope * entry)", "springs"),
    ("solve.responses", "left = push[index] - (", "left = push[index] + (", "springs"),
    ("tree.bound", "(xx + zz - yy) * 0.5", "(xx + zz + yy) * 0.5", "rigid"),
    ("tree.frames", "offsets[body.indices[-1]] += angle\n                if not", "if not", "rigid"),
]  # fmt: skip


def check(name: str, kernels: Collection[str] = KERNELS) -> None:
    others = {"joint": check_joint, "zeros": check_zeros, "counts": lambda: check_counts(("mass_matrix",))}
    if name in others:
        others[name]()
    elif name.startswith("small"):
        (case,) = (case for case in small_cases() if case.name == name)
        check_closed_form_of(case)
    else:
        (case,) = (case for case in cases() if case.name == name)
        check_kernels(case, kernels)


@pytest.mark.parametrize(
    ("module", "old", "new", "seen_by"),
    [pytest.param(*change, marks=pytest.mark.soak) if i % 3 else change for i, change in enumerate(NASTY)],
    ids=lambda text: None,
)
def test_nasty_changes_are_noticed(module: str, old: str, new: str, seen_by: str) -> None:
    text = Mutant.replacing(module, source_of(module), old, new).applied(source_of(module))
    with pytest.raises((AssertionError, InternalError, pytest.fail.Exception)), mutated(module, text):
        check(seen_by, PART_OF.get(module, KERNELS))


@pytest.mark.soak
@pytest.mark.parametrize(
    "name", ["joint", "zeros", "counts", *sorted({x[3] for x in NASTY} - {"joint", "zeros", "counts"})]
)
def test_the_code_as_it_is_passes(name: str) -> None:
    check(name)


def test_all_is_as_it_was_after_a_change() -> None:
    before = codegen("tree.recursion"), codegen("kernels.equations"), codegen("joint.lemmas")
    with mutated("tree.recursion", source_of("tree.recursion") + "\nCHANGED = True\n"):
        assert codegen("tree.recursion").CHANGED
        assert codegen("kernels.equations") is not before[1]
        assert codegen("kernels.derivation").inertial_rows is codegen("tree.recursion").inertial_rows
        assert codegen("joint.lemmas") is before[2]  # it does not import the changed module
    assert (codegen("tree.recursion"), codegen("kernels.equations"), codegen("joint.lemmas")) == before
    from eomgen.codegen import tree

    assert tree.recursion is before[0]


def test_all_that_imports_a_changed_module_is_imported_anew() -> None:
    before = {name: codegen(name) for name in modules()}
    with mutated("tree.spatial", source_of("tree.spatial")):
        anew = {name for name in modules() if codegen(name) is not before[name]}
    assert anew == dependents("tree.spatial") < {*modules()}
    assert all(codegen(name) is loaded for name, loaded in before.items())


def test_what_imports_a_module_is_found() -> None:
    found = dependents("joint.lemmas")
    assert {"joint.deriving", "joint.zeros", "closed_form.trace", "tree.frozen_joints", "c.sources"} <= found
    assert {"program.ir", "tree.spatial"}.isdisjoint(found)
    assert "joint.lemmas" not in dependents("tree.recursion")
    assert dependents("c.sources") == {"c.sources"}


def test_imports_are_found_however_they_are_written(tmp_path: Path) -> None:
    texts = {
        "__init__.py": "",
        "low/__init__.py": "",
        "low/a.py": "import sys\nfrom os import path\n",
        "low/b.py": "from . import a as other\n",
        "high/__init__.py": "from .d import x\n",
        "high/c.py": "from ..low.a import (\n    x,\n)\n",
        "high/d.py": "def late():\n    from ..low import b, missing\n",
        "high/e.py": "import p.q.low.b as other\n",
        "high/deep/f.py": "from p.q.low import a\nfrom ...high.d import a\n",
        "high/deep/g.py": "from ... import low, high\n",
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="ascii")
    found = {
        name.removeprefix("p.q"): {used.removeprefix("p.q") for used in names - {"p.q"}}
        for name, names in imports_of(tmp_path, "p.q").items()
    }
    assert found == {
        "": set(),
        ".low": set(),
        ".low.a": {".low"},
        ".low.b": {".low", ".low.a"},
        ".high": {".high.d"},
        ".high.c": {".high", ".low", ".low.a"},
        ".high.d": {".high", ".low", ".low.b"},
        ".high.e": {".high", ".low", ".low.b"},
        ".high.deep.f": {".high", ".high.d", ".low", ".low.a"},
        ".high.deep.g": {".high", ".low"},
    }


@pytest.mark.parametrize(
    "name", ["joint", "recursion", "tree.bodies", "tree", "tree.__init__", "", "eomgen.codegen.tree.bound"]
)
def test_what_is_no_module_is_refused(name: str) -> None:
    def change() -> None:
        with mutated(name, ""):
            pass

    for ask in (lambda: source_of(name), lambda: dependents(name), lambda: codegen(name), lambda: checks(name), change):
        with pytest.raises(ValueError, match="no module of the generator"):
            ask()


def test_tables_name_modules() -> None:
    """Those of the checks, and every remark on survivors of the derivation that is about one module."""
    assert {*PART_OF} <= {*modules()}
    patterns = [rule["match"] for rule in tomllib.loads(ARGUMENTS.read_text(encoding="ascii"))["survivor"]]
    assert len(patterns) > 30
    for pattern in (pattern for pattern in patterns if "::" not in pattern):  # the others name functions
        named = re.findall(r"(?:^\^\(?|(?<=\|))(\w+)\\\.(\w+)\\\.", pattern)
        assert named or pattern.startswith(r"^\w+"), pattern
        assert {".".join(words) for words in named} <= {*modules()}, pattern


def test_modules_have_checks_of_their_own() -> None:
    assert checks("joint.lemmas")[0] is check_joint
    assert checks("joint.zeros") == [check_zeros]
    assert checks("closed_form.trace") == [check_closed_form]
    assert all(checks(name)[-1] is check_closed_form for name in ("forces.coordinates", "tree.bound", "tree.spatial"))
    assert all(checks(name)[-1] is check_parameters for name in ("kernels.equations", "kernels.derivation"))


def test_the_page_says_that_enough_is_killed() -> None:
    """Of small changes of the derivation at least 93 %, of wrong values 90 %, and every survivor is argued about."""
    derivation = PAGE.read_text(encoding="ascii").partition("## Small changes of the derivation")[2].split("\n## ")[0]
    found = re.search(r"^Killed: (\d+) of (\d+) mutants", derivation, re.MULTILINE)
    killed, total = map(int, found.groups())
    rows = re.findall(
        r"^\| ([\w/]+)\.py \| (\d+) \| (\d+) \| (\d+) \| (\d+) \| (\d+) \| (\d+) \|", derivation, re.MULTILINE
    )
    assert {row[0].replace("/", ".") for row in rows} <= {*modules()}
    assert sum(int(row[2]) for row in rows) == total
    assert all(int(run) == sum(map(int, parts)) for _, _, run, *parts in rows)
    survived = sum(int(row[-1]) for row in rows)
    assert killed == total - survived
    assert killed >= 0.93 * total
    listed = [line for line in derivation.splitlines() if re.match(r"\| [\w/]+\.py:\d+ ", line)]
    assert len(listed) == survived
    assert not any("not argued" in line for line in listed)
    packages = PAGE.read_text(encoding="ascii").partition("## Wrong values in every package")[2].split("\n## ")[0]
    found = re.search(r"^Killed: (\d+) of 400 wrong values", packages, re.MULTILINE)
    assert int(found[1]) >= 360
    assert "not argued" not in packages
