"""Mutation testing in short: a dozen nasty changes of the derivation that the fast oracle must notice; and the page."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path

import pytest
from mutant import FOLDER, dependents, mutated, source_of
from mutation_cases import cases, small_cases
from mutation_oracle import (
    KERNELS,
    PART_OF,
    check_closed_form_of,
    check_counts,
    check_joint,
    check_kernels,
    check_zeros,
    codegen,
)

from eomgen.errors import InternalError

PAGE = Path(__file__).parents[1] / "docs" / "mutation.md"

# Module, what it says, what it says instead, and the check that sees it: a robot, or one of the others by name.
NASTY = [
    ("joint", "A[i, j], A[j, i] = -sp.sin(s), sp.sin(s)", "A[i, j], A[j, i] = sp.sin(s), -sp.sin(s)", "joint"),
    ("joint", "if i < j and _trace(", "if _trace(", "joint"),
    ("zeros", "(s == w) & self.before[v, w]", "(s == v) & self.before[v, w]", "zeros"),
    ("zeros", "self.same & self._look_up(found) & is_first", "self.same & self._look_up(found)", "zeros"),
    ("trace", "_trace(DH, D2)", "_trace(D, D2)", "small tree"),
    ("recursion", "cross(scale(2.0, w), unit(axis, v[index]))", "cross(w, unit(axis, v[index]))", "chain"),
    ("recursion", "column = matvec(back, matvec(", "column = matvec(turn.matrix, matvec(", "puma560"),
    ("recursion", "J[1][2] * (s[2] - s[1])", "J[1][2] * (s[1] - s[2])", "chain"),
    ("composite", "moment[turn.axis] = about_axis", "moment[turn.axis] = moment[turn.axis]", "counts"),
    ("composite", "(b, a): c * t - S[a][b],", "(b, a): c * t - S[b][a],", "chain"),
    ("articulated", "columns = [cross(p, column)", "columns = [cross(column, p)", "tree"),
    ("elimination", "share = armature * inverse", "share = inverse", "tree"),
    ("free_bodies", "(x + beta.sin * carried[2]) * t", "(x - beta.sin * carried[2]) * t", "free"),
    ("free_bodies", "factor = psi.armature / (1.0 +", "factor = psi.armature / (2.0 +", "rotors of free bodies"),
    ("forces", "rows[between.principal] - force", "rows[between.principal] + force", "motors"),
    ("accelerations", "taken = share * _along(pull, other)", "taken = share", "springs"),
    ("bodies", "(xx + zz - yy) * 0.5", "(xx + zz + yy) * 0.5", "rigid"),
    ("frames", "offsets[body.indices[-1]] += angle\n                if not", "if not", "rigid"),
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


@pytest.mark.parametrize(("module", "old", "new", "seen_by"), NASTY, ids=lambda text: None)
def test_nasty_changes_are_noticed(module: str, old: str, new: str, seen_by: str) -> None:
    source = source_of(module)
    assert source.count(old) == 1, "the code has changed: change this list too"
    with (
        pytest.raises((AssertionError, InternalError, pytest.fail.Exception)),
        mutated(module, source.replace(old, new)),
    ):
        check(seen_by, PART_OF.get(module, KERNELS))


@pytest.mark.parametrize(
    "name", ["joint", "zeros", "counts", *sorted({x[3] for x in NASTY} - {"joint", "zeros", "counts"})]
)
def test_the_code_as_it_is_passes(name: str) -> None:
    check(name)


def test_all_is_as_it_was_after_a_change() -> None:
    before = codegen("recursion"), codegen("equations"), codegen("joint")
    with mutated("recursion", source_of("recursion") + "\nCHANGED = True\n"):
        assert codegen("recursion").CHANGED
        assert codegen("equations") is not before[1]
        assert codegen("derivation").inertial_rows is codegen("recursion").inertial_rows
        assert codegen("joint") is before[2]  # it does not import the changed module
    assert (codegen("recursion"), codegen("equations"), codegen("joint")) == before
    import eomgen.codegen as package

    assert package.recursion is before[0]


def test_what_imports_a_module_is_found() -> None:
    assert {"zeros", "freeze", "trace", "equations", "recursion"} <= dependents("joint")
    assert "joint" not in dependents("recursion")
    assert dependents("render") == {"render"}


def test_the_page_says_that_enough_is_killed() -> None:
    """At least 85 %, and every survivor is argued about."""
    text = PAGE.read_text(encoding="ascii")
    found = re.search(r"^Killed: (\d+) of (\d+) mutants", text, re.MULTILINE)
    assert found is not None
    killed, total = map(int, found.groups())
    rows = re.findall(r"^\| (\w+)\.py \| (\d+) \| (\d+) \| (\d+) \| (\d+) \| (\d+) \| (\d+) \|", text, re.MULTILINE)
    assert {row[0] for row in rows} <= {path.stem for path in FOLDER.glob("*.py")}
    assert sum(int(row[2]) for row in rows) == total
    assert all(int(run) == sum(map(int, parts)) for _, _, run, *parts in rows)
    survived = sum(int(row[-1]) for row in rows)
    assert killed == total - survived
    assert killed >= 0.85 * total
    listed = [line for line in text.splitlines() if re.match(r"\| \w+\.py:\d+ ", line)]
    assert len(listed) == survived
    assert not any("not argued" in line for line in listed)
