"""Packages that only some functions need."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path

import pytest

from eomgen.errors import InputError
from eomgen.optional import PACKAGES, NotInstalledError, optional_import

ROOT = Path(__file__).parents[2]


def test_a_missing_package_is_named_with_what_installs_it() -> None:
    with (
        pytest.raises(InputError) as caught,
        optional_import("SciPy", "figures of sand need", "water works"),
    ):
        raise ModuleNotFoundError("no sand")
    advice = 'pip install scipy, or pip install "eomgen[sim]"'
    assert str(caught.value) == f"figures of sand need SciPy, which is not installed: {advice}; water works"


def test_a_package_that_is_there_but_broken_is_not_called_missing() -> None:
    with (
        pytest.raises(NotInstalledError, match=r"SciPy, which cannot be imported \(libsand\.so: not found\): pip"),
        optional_import("SciPy", "figures of sand need"),
    ):
        raise ImportError("libsand.so: not found")


def test_other_errors_are_not_hidden() -> None:
    with pytest.raises(ZeroDivisionError), optional_import("SciPy", "sums need"):
        1 / 0  # noqa: B018


@pytest.mark.parametrize("package", PACKAGES)
def test_the_extra_installs_the_package(package: str) -> None:
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    name, extra = PACKAGES[package]
    assert name in [re.split("[<>=; ]", requirement)[0] for requirement in groups[extra]]
    assert name.partition("[")[0] == package.partition(" ")[0].lower()


def test_every_package_that_functions_ask_for_is_known() -> None:
    asked = set()
    for path in (ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "optional_import":
                assert isinstance(node.args[0], ast.Constant)
                asked.add(node.args[0].value)
    assert asked == set(PACKAGES)
