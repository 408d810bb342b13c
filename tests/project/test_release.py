"""What ``make release`` checks: versions and dates that agree, the recipe for conda, environments of each Python."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import release.__main__ as checks
from tests.support.refusals import refused

ROOT = Path(__file__).parents[2]
NAMES = ("CHANGELOG.md", "CITATION.cff", "release/conda/recipe.yaml", "src/eomgen/_version.py")


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the files that name the version."""
    for name in NAMES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    monkeypatch.setattr(checks, "ROOT", tmp_path)
    return tmp_path


def test_all_files_name_one_version() -> None:
    assert checks.consistent_version() == re.findall(r'"(.+)"', (ROOT / NAMES[3]).read_text(encoding="utf-8"))[-1]


@pytest.mark.parametrize("name", NAMES[:3])
def test_another_version_is_refused(name: str, tree: Path) -> None:
    version = checks.consistent_version()
    text = (tree / name).read_text(encoding="utf-8")
    (tree / name).write_text(text.replace(version, "9.9.9", 1), encoding="utf-8")
    refused(checks.Refused, f"{re.escape(name)}: names 9.9.9; expected {re.escape(version)}", checks.consistent_version)


def test_a_changelog_without_a_date_and_other_dates_are_refused(tree: Path) -> None:
    changelog = (tree / "CHANGELOG.md").read_text(encoding="utf-8")
    for date, message in (("unreleased", "CHANGELOG.md: names no version"), ("2001-01-01", "expected one date")):
        changed = re.sub(r"\(\d{4}-\d\d-\d\d\)", f"({date})", changelog, count=1)
        (tree / "CHANGELOG.md").write_text(changed, encoding="utf-8")
        refused(checks.Refused, message, checks.consistent_version)


def test_a_tree_with_changes_is_refused(tree: Path) -> None:
    subprocess.run(["git", "init", "-q", str(tree)], check=True)
    refused(checks.Refused, r"not clean:\n\?\? CHANGELOG.md", checks.clean_tree)


def test_pythons_that_are_asked_for_must_be_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks, "unpack_debian", lambda version: None)
    refused(checks.Refused, r"Python 2\.0 is not installed", checks.interpreters, ["2.0"], required=True)


def test_versions_that_were_not_tested_are_named(
    tree: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tested = list[str]()
    archives = (tree / "CHANGELOG.md", tree / "CITATION.cff")
    monkeypatch.setattr(checks, "clean_tree", lambda: None)
    monkeypatch.setattr(checks, "build", lambda *_: archives)
    monkeypatch.setattr(checks, "interpreter", {"3.11": "a", "3.13": "b"}.get)
    monkeypatch.setattr(checks, "unpack_debian", {"3.14": "c"}.get)
    monkeypatch.setattr(checks, "check_python", lambda version, *_: tested.append(version))
    monkeypatch.setattr(sys, "argv", ["release"])
    assert checks.main() == 0
    assert tested == ["3.11", "3.13", "3.14"]
    assert "tested with Python 3.11, 3.13, 3.14; not tested: 3.12." in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", ["release", "--pythons", "3.11", "3.12"])
    assert checks.main() == 1
    assert "Python 3.12 is not installed" in capsys.readouterr().err


def test_the_recipe_for_conda_needs_what_the_package_needs() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    recipe = (ROOT / "release/conda/recipe.yaml").read_text(encoding="utf-8")
    run = recipe.partition("  run:\n")[2].partition("\ntests:")[0]
    found = {line.split("#")[0].strip(" -").replace(" ", "") for line in run.splitlines() if line.strip()}
    needed = {entry.partition(";")[0].strip() for entry in project["dependencies"]}
    assert found == needed | {f"python{project['requires-python']}", "c-compiler"}
    assert "eomgen = eomgen.cli:main" in recipe
