"""Packages that only some functions need."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from eomgen.errors import InputError
from eomgen.optional import EXTRAS, optional_import

ROOT = Path(__file__).parents[2]


def test_a_missing_package_is_named_with_what_installs_it() -> None:
    with (
        pytest.raises(InputError, match=r'^figures of sand need SciPy: pip install "eomgen\[sim\]"; water works$'),
        optional_import("SciPy", "figures of sand need", "water works"),
    ):
        raise ImportError("no sand")


def test_other_errors_are_not_hidden() -> None:
    with pytest.raises(ZeroDivisionError), optional_import("SciPy", "sums need"):
        1 / 0  # noqa: B018


@pytest.mark.parametrize("package", EXTRAS)
def test_the_extra_installs_the_package(package: str) -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    (listed,) = re.findall(rf"^{EXTRAS[package]} = \[(.*?)\]$", text, re.MULTILINE)
    assert f'"{package.split(" ")[0].lower()}' in listed


def test_every_package_that_functions_ask_for_is_known() -> None:
    asked = set()
    for path in (ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "optional_import":
                assert isinstance(node.args[0], ast.Constant)
                asked.add(node.args[0].value)
    assert asked == set(EXTRAS)
