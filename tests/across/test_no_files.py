"""FIFOs, devices and folders where a file is expected: refused at once; and names that would steer a terminal."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from eomgen.authoring.check import check_file
from eomgen.authoring.dh import dh_file_text
from eomgen.cli import entry as cli
from eomgen.description.load import load_robot
from eomgen.errors import InputError
from eomgen.identification.tolerances.table import read_table
from eomgen.names import printable
from eomgen.pictures.shapes import urdf_shapes
from eomgen.scenario.load import load_scenario
from eomgen.sweep.plan import load_plan
from tests.support.description_samples import ARM, URDF


@pytest.mark.parametrize("kind", ["fifo", "device", "folder"])
@pytest.mark.parametrize(
    ("read", "suffix"),
    [
        (load_robot, ".toml"),
        (load_robot, ".urdf"),
        (load_robot, ".xml"),
        (load_scenario, ".toml"),
        (load_plan, ".toml"),
        (partial(read_table, known=["base.x"]), ".toml"),
        (partial(dh_file_text, "arm", convention="classic"), ".csv"),
    ],
)
def test_no_reader_waits(read: Callable[[Path], object], suffix: str, kind: str, tmp_path: Path) -> None:
    path = _none(tmp_path / f"a{suffix}", kind)
    with pytest.raises(InputError, match=f"it is a {kind}".replace("fifo", "FIFO")) as caught:
        read(path)
    assert str(path) in str(caught.value)
    assert check_file(path).errors


def _none(path: Path, kind: str) -> Path:
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to("/dev/zero")
    return path


@pytest.mark.parametrize("kind", ["fifo", "device"])
def test_files_that_files_name_are_not_waited_for(kind: str, tmp_path: Path) -> None:
    _none(tmp_path / "m.csv", kind)
    _none(tmp_path / "a.urdf", kind)
    _none(tmp_path / "K.mtx", kind)
    cases = {
        "matrix.toml": ARM.replace("limits = [-1, 2]", 'stiffness = { matrix = "K.mtx" }'),
        "curve.toml": ARM.replace("stiffness = 1e6", 'curve = "m.csv"'),
        "refined.toml": 'name = "a"\nurdf = "a.urdf"\n',
    }
    for name, text in cases.items():
        (tmp_path / name).write_text(text)
        with pytest.raises(InputError, match=f"it is a {kind}".replace("fifo", "FIFO")):
            load_robot(tmp_path / name)
    scenario = 'duration = 1\n[motion]\ntype = "sampled"\nfile = "m.csv"\n'
    (tmp_path / "s.toml").write_text(scenario)
    with pytest.raises(InputError, match="does not exist"):
        load_scenario(tmp_path / "s.toml")


def test_meshes_are_files_of_bounded_size(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    path = tmp_path / "arm.urdf"
    visuals = "".join(
        f'<visual><geometry><mesh filename="{n}"/></geometry></visual>' for n in ("fifo.stl", "large.stl")
    )
    path.write_text(URDF.replace('<link name="upper">', f'<link name="upper">{visuals}'))
    os.mkfifo(tmp_path / "fifo.stl")
    with (tmp_path / "large.stl").open("wb") as stream:
        stream.truncate((1 << 25) + 1)
    shapes, notes = urdf_shapes(load_robot(path))
    assert not shapes
    assert "there is no mesh 'fifo.stl'" in notes[0]
    assert "33554433 bytes; allowed: up to 33554432" in notes[1]
    robot = load_robot(path)
    path.unlink()
    os.mkfifo(path)
    assert "cannot be read any more" in urdf_shapes(robot)[1][0]


def test_what_steers_a_terminal_is_printed_as_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert printable("a\tb\nc") == "a\tb\nc"
    assert printable("\x1b[31m\x07\u202e\udc80\N{SNOWMAN}") == "\\x1b[31m\\x07\\u202e\\udc80\N{SNOWMAN}"
    assert cli.main(["report", str(tmp_path / "\x1b]0;title\x07.npz")]) == 1
    said = capsys.readouterr().err
    assert "\x1b" not in said
    assert "\\x1b]0;title\\x07.npz" in said
