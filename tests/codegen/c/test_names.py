"""Names in generated C: NAME.c alone says what a status means and which row is whose; the header has both as enums."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import cffi
import numpy as np
import pytest

import eomgen
from eomgen.codegen.c.library import included_files
from eomgen.codegen.c.names import entry_names
from eomgen.pipeline.generating import package_options
from eomgen.pipeline.stages import make_source
from eomgen.robot.model import build_model
from tests.support.c_project import WARNINGS, need, run, write_source
from tests.support.soak import soaked

ROBOTS = soaked(("one_link", "four_bar", "ur5", "puma560_elastic"), ("one_link", "four_bar"))
STATUSES = ("status_text", "status_reason", "status_index")


def compiled(robot: str, folder: Path) -> Any:
    """The functions of statuses, as a program sees them."""
    need("gcc")
    source = make_source(robot, package_options(robot))
    write_source(source, folder)
    text = "".join(
        f"{kind}test_{name}(int status);\n{kind}test_{name}(int status) {{ return {robot}_{name}(status); }}\n"
        for name, kind in zip(STATUSES, ("const char *", "int ", "int "), strict=True)
    )
    (folder / "test.c").write_text(f'#include "{robot}.h"\n{text}', encoding="ascii")
    library = folder / "test.so"
    run("gcc", *WARNINGS, "-O0", "-shared", "-fPIC", folder / "test.c", folder / f"{robot}.c", "-lm", "-o", library)
    ffi = cffi.FFI()
    ffi.cdef("const char *test_status_text(int); int test_status_reason(int); int test_status_index(int);")
    return ffi, ffi.dlopen(str(library))


def enum_of(header: str, prefix: str) -> dict[str, int]:
    return {name: int(value) for name, value in re.findall(rf"^    {prefix}_(\w+) = (\d+)", header, re.MULTILINE)}


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_status_has_a_text_a_reason_and_an_index(robot: str, tmp_path: Path) -> None:
    ffi, library = compiled(robot, tmp_path)
    model, header = build_model(eomgen.load_robot(robot)), (tmp_path / f"{robot}.h").read_text(encoding="ascii")
    code, n, m = (tmp_path / f"{robot}.c").read_text(encoding="ascii"), len(model.coordinates), len(model.constraints)
    known = enum_of(header, robot.upper())
    firsts = {"SINGULAR": 1} | ({"OPEN": n + 1, "OPENING": n + m + 1, "PARTING": n + 2 * m + 1} if m else {})
    firsts |= {"UNDRIVEN": n + 3 * m + 1} if m else {}
    assert firsts.items() <= known.items()
    assert known["OK"] == 0
    owners = [*model.coordinates, *([*model.constraints] * 3 if m else []), *(model.coordinates if m else [])]
    assert f"#define {robot.upper()}_STATUSES {len(owners)} " in header
    said = []
    for status, owner in enumerate(owners, 1):
        text, reason = ffi.string(library.test_status_text(status)).decode(), library.test_status_reason(status)
        said.append(text)
        assert text.startswith(f"{owner}: ")
        assert f'"{text}", /* {status} */' in code
        assert reason == max(first for first in firsts.values() if first <= status)
        assert library.test_status_index(status) == status - reason
    assert len(set(said)) == len(owners)
    assert ffi.string(library.test_status_text(0)) == b"ok"
    assert library.test_status_reason(0) == library.test_status_index(0) == 0
    for status in (-1, len(owners) + 1):
        assert ffi.string(library.test_status_text(status)) == b"unknown status"


def test_the_status_of_a_singular_state_names_its_coordinate() -> None:
    """The number that the code returns is the one that the text is about."""
    source = make_source("one_link", package_options("one_link"))
    kernel = eomgen.build("one_link", kernels=("forward_dynamics",), flags=("-O0",))
    out = np.zeros(2)
    arrays = [kernel.raw.view(x) for x in (np.full(2, np.nan), np.zeros(2), np.zeros(2), out)]
    h = kernel.raw.libraries.library("forward_dynamics").compute(np.array(list(kernel.parameters.values())))
    status = kernel.raw.functions["forward_dynamics"].code(kernel.raw.view(h), *arrays)
    assert f'"{kernel.coordinates[status - 1]}: the mass matrix cannot be inverted", /* {status} */' in source.code


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_output_index_has_a_name(robot: str) -> None:
    """The row and the column that a statement fills, which the header's enums number."""
    source = make_source(robot, package_options(robot))
    model = build_model(eomgen.load_robot(robot))
    code = re.sub(r"\n(?: {12,}| \* )", " ", source.code)  # continued lines
    stored = re.findall(r"^    out\[(\d+)\] = [^;]*;( /\* .* \*/)?$", code, re.MULTILINE)
    assert len(stored) > 10
    assert [index for index, note in stored if not note] == []
    places = enum_of(source.header, f"{robot.upper()}_COORDINATE")
    assert list(places.values()) == list(range(len(model.coordinates)))
    assert [name.replace("_", ".") for name in places] == [name.replace("_", ".") for name in model.coordinates]
    body = code.split(f"int {robot}_mass_matrix(")[1].split("\n}\n")[0]
    body += "".join(re.findall(rf"void {robot}_mass_matrix_part.*?\n}}\n", code, re.DOTALL))
    entries = re.findall(r"out\[(\d+)\] = .*; /\* (\S+), (\S+) \*/", body)
    assert len(entries) >= len(model.coordinates)
    for index, row, column in entries:
        assert divmod(int(index), len(places)) == tuple(model.coordinates.index(x) for x in (row, column))


@pytest.mark.parametrize("robot", ROBOTS)
def test_macros_and_static_functions_have_a_prefix(robot: str) -> None:
    """That of the library, or the robot's name, so that other C of a project has the same names."""
    source = make_source(robot, package_options(robot))
    assert {f"{robot}.c", f"{robot}_batch.c", "clib/lanes.h"} <= set(source.files)
    for place, text in source.files.items():
        macros = re.findall(r"^ *# *define (\w+)", text, re.MULTILINE)
        functions = re.findall(r"^(?:static|EOM_[A-Z]+) [^;{}=]*?\b(\w+)\([^;{}]*\)\s*\{", text, re.MULTILINE)
        own = ("EOM_", "EOMGEN_", f"{robot.upper()}_")
        assert {name for name in (*macros, *functions) if not name.upper().startswith(own)} <= {"EOM"}, place


def test_names_follow_axes() -> None:
    meta = {"coordinates": ("j.x", "j.y"), "internal_states": ("j.x.z",), "joints": ("j",), "links": ("l",)}
    assert entry_names("matrix", (2, 2), meta) == ["j.x, j.x", "j.x, j.y", "j.y, j.x", "j.y, j.y"]
    assert entry_names("rate_vector", (3,), meta) == ["j.x", "j.y", "j.x.z"]
    assert entry_names("reactions", (1, 6), meta)[4] == "j, moment y"
    assert entry_names("jacobian", (6, 2), meta)[7] == "angular x, j.y"
    assert entry_names("pose", (4, 4), meta)[6] == "1, 2"
    assert entry_names("unknown", (2,), meta) == ["0", "1"]


def test_lines_of_a_package_have_at_most_120_columns() -> None:
    """Those of C that a package has by default, with what it includes of the library."""
    source = make_source("one_link", package_options("one_link"))
    texts = {f"{source.name}.h": source.header, **source.codes, **included_files(*source.codes.values())}
    assert "clib/integrate.c" in texts
    assert [(place, line) for place, text in texts.items() for line in text.split("\n") if len(line) > 120] == []
