"""What commands and builds import: a start is as long as its imports."""

from __future__ import annotations

from pathlib import Path

import pytest

import eomgen
from tests.support.quick_builds import answer, python

ROBOTS = Path(eomgen.__path__[0], "robots")
NUMERIC = ("numpy", "scipy", "sympy", "matplotlib")
HEAVY = (*NUMERIC, "jinja2", "cffi", "pycparser", "setuptools", "rich", "platformdirs", "filelock", "pydantic")
RUN = """
import contextlib, io, json, sys
from eomgen.cli import main

with contextlib.redirect_stdout(io.StringIO()) as said:
    try:
        status = main({arguments!r})
    except SystemExit as error:
        status = error.code
print(json.dumps([status, len(said.getvalue()), [name for name in {names!r} if name in sys.modules]]))
"""
BUILD = """
import json, sys
import eomgen

kernel = eomgen.build("one_link", kernels=("mass_matrix", "forward_dynamics"), flags=("-O0",))
heavy = ("sympy", "scipy", "matplotlib", "rich", "pydantic", "jinja2.meta")
print(json.dumps([kernel.mass_matrix([0.2, 0.5]).shape, [name for name in heavy if name in sys.modules]]))
"""


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["--help"], HEAVY),
        (["cache"], NUMERIC),
        (["check", "{robots}/one_link.toml"], (*NUMERIC[1:], "jinja2", "cffi")),
        (["info", "one_link"], NUMERIC[1:]),
        pytest.param(["--version"], HEAVY, marks=pytest.mark.soak),
        pytest.param(["simulate", "--help"], HEAVY, marks=pytest.mark.soak),
        pytest.param(["sweep", "--help"], HEAVY, marks=pytest.mark.soak),
        pytest.param(["new", "arm", "-o", "{folder}/arm.toml"], HEAVY, marks=pytest.mark.soak),
        pytest.param(["robots"], NUMERIC[1:], marks=pytest.mark.soak),
        pytest.param(["schema", "plan"], NUMERIC[1:], marks=pytest.mark.soak),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_commands_import_what_they_need(arguments: list[str], names: tuple[str, ...], tmp_path: Path) -> None:
    words = [word.format(folder=tmp_path, robots=ROBOTS) for word in arguments]
    code = RUN.format(arguments=words, names=names)
    status, printed, found = answer(python(code, EOMGEN_CACHE_DIR=str(tmp_path / "cache")))
    assert (status, found) == (0, [])
    assert printed > 0


def test_a_first_build_does_without_sympy(tmp_path: Path) -> None:
    """What is needed of a joint is kept as plain values."""
    assert answer(python(BUILD, EOMGEN_CACHE_DIR=str(tmp_path / "cache"))) == [[2, 2], []]
