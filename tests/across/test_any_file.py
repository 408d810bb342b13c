"""Files that are none, never end, or become larger than they look: refused before they are waited for or unpacked."""

from __future__ import annotations

import os
import socket
import zipfile
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from eomgen.authoring.check import check_file
from eomgen.authoring.dh import dh_file_text
from eomgen.cli import entry as cli
from eomgen.description.load import load_robot
from eomgen.errors import InputError
from eomgen.files import read_regular
from eomgen.identification.tolerances.table import read_table
from eomgen.identifiers import printable
from eomgen.motion.files import read_motion
from eomgen.npz import read_npz
from eomgen.pictures.shapes import urdf_shapes
from eomgen.results.contents import write_npz
from eomgen.scenario.load import load_scenario
from eomgen.sweep.plan import load_plan
from tests.support.bad_files import archive, header, npy
from tests.support.description_samples import ARM, URDF
from tests.support.mutations import npz
from tests.support.optional import needs
from tests.support.refusals import refused

MOST = 1000


def no_file(path: Path, kind: str) -> Path:
    """Put what is no file at a path, or nothing."""
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as end:
            end.bind(str(path))
    elif kind == "loop":
        path.symlink_to(path)
    return path


@pytest.mark.parametrize("kind", ["fifo", "folder", "device", "socket", "loop", "nothing"])
def test_what_is_no_file_is_refused_at_once(kind: str, tmp_path: Path) -> None:
    path = no_file(tmp_path / f"{kind}.npz", kind)
    refused(OSError, "", read_regular, path, MOST)
    refused(InputError, r"cannot be read|folder|FIFO|device", read_npz, path)


@pytest.mark.parametrize("kind", ["fifo", "device", "folder"])
@pytest.mark.parametrize(
    ("read", "suffix"),
    [
        *((load_robot, suffix) for suffix in (".toml", ".urdf", ".xml")),
        (load_scenario, ".toml"),
        (load_plan, ".toml"),
        (partial(read_table, known=["base.x"]), ".toml"),
        (partial(dh_file_text, "arm", convention="classic"), ".csv"),
    ],
)
def test_no_reader_waits(read: Callable[[Path], object], suffix: str, kind: str, tmp_path: Path) -> None:
    path = no_file(tmp_path / f"a{suffix}", kind)
    caught = refused(InputError, f"it is a {kind}".replace("fifo", "FIFO"), read, path)
    assert str(path) in str(caught)
    assert check_file(path).errors


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_a_fifo_is_no_motion(suffix: str, tmp_path: Path) -> None:
    for path in (no_file(tmp_path / f"m{suffix}", "fifo"), tmp_path / f"a\0{suffix}"):
        refused(InputError, r"cannot be read|null byte", read_motion, path, ("joint1.x",))


@pytest.mark.parametrize("kind", ["fifo", "device"])
def test_files_that_files_name_are_not_waited_for(kind: str, tmp_path: Path) -> None:
    for name in ("m.csv", "a.urdf", "K.mtx"):
        no_file(tmp_path / name, kind)
    said = f"it is a {kind}".replace("fifo", "FIFO")
    for text, read, words in (
        (ARM.replace("limits = [-1, 2]", 'stiffness = { matrix = "K.mtx" }'), load_robot, said),
        (ARM.replace("stiffness = 1e6", 'curve = "m.csv"'), load_robot, said),
        ('name = "a"\nurdf = "a.urdf"\n', load_robot, said),
        ('duration = 1\n[motion]\ntype = "sampled"\nfile = "m.csv"\n', load_scenario, "does not exist"),
    ):
        (tmp_path / "a.toml").write_text(text)
        refused(InputError, words, read, tmp_path / "a.toml")


def test_meshes_are_files_of_bounded_size(tmp_path: Path) -> None:
    needs("trimesh")
    path = tmp_path / "arm.urdf"
    visual = '<visual><geometry><mesh filename="{}.stl"/></geometry></visual>'
    visuals = visual.format("fifo") + visual.format("large")
    path.write_text(URDF.replace('<link name="upper">', f'<link name="upper">{visuals}'))
    no_file(tmp_path / "fifo.stl", "fifo")
    with (tmp_path / "large.stl").open("wb") as stream:
        stream.truncate((1 << 25) + 1)
    robot = load_robot(path)
    shapes, notes = urdf_shapes(robot)
    assert not shapes
    assert "there is no mesh 'fifo.stl'" in notes[0]
    assert "33554433 bytes; allowed: up to 33554432" in notes[1]
    path.unlink()
    no_file(path, "fifo")
    assert "cannot be read any more" in urdf_shapes(robot)[1][0]


def test_what_steers_a_terminal_is_printed_as_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert printable("a\tb\nc") == "a\tb\nc"
    assert printable("\x1b[31m\x07\u202e\udc80\N{SNOWMAN}") == "\\x1b[31m\\x07\\u202e\\udc80\N{SNOWMAN}"
    assert cli.main(["report", str(tmp_path / "\x1b]0;title\x07.npz")]) == 1
    said = capsys.readouterr().err
    assert "\x1b" not in said
    assert "\\x1b]0;title\\x07.npz" in said


def test_a_file_is_read_up_to_its_limit(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"x" * MOST)
    assert read_regular(path, MOST) == b"x" * MOST
    path.write_bytes(b"x" * (MOST + 1))
    refused(OSError, "1001 bytes; allowed: up to 1000", read_regular, path, MOST)


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="no file that says it is empty and is not")
def test_a_file_that_hides_its_size_is_not_read_to_its_end() -> None:
    refused(OSError, "more bytes than that", read_regular, Path("/proc/self/maps"), 10)


# Arrays; bad_files.py has entries that are none


def test_arrays_come_back_as_numpy_reads_them(tmp_path: Path) -> None:
    given = {
        "a": np.arange(6.0).reshape(2, 3),
        "columns": np.asfortranarray(np.arange(12, dtype=np.int32).reshape(3, 4)),
        "empty": np.zeros((0, 3)),
        "number": np.array(2.5),
        "texts": np.array(["joint1.x", "joint2"]),
        "text": np.array("a text"),
        "big_endian": np.arange(3, dtype=">f8"),
    }
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "a.npz", **given)
        found = read_npz(tmp_path / "a.npz")
        assert set(found) == set(given)
        for name, value in given.items():
            np.testing.assert_array_equal(found[name], value)
            assert found[name].dtype == value.dtype
            assert found[name].flags.f_contiguous == value.flags.f_contiguous


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("names", [("t.npy", "t.npy"), ("t.npy", "t")])
def test_an_array_that_is_there_twice_is_refused(names: tuple[str, str], tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(archive(*((name, npy(header(), bytes(8))) for name in names)))
    refused(InputError, "'t' is there twice", read_npz, tmp_path / "a.npz")


def test_a_small_file_of_many_zeros_is_not_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed, packed.open("t.npy", "w") as entry:
        entry.write(npy(header(f"({300 << 17},)")))
        for _ in range(300):
            entry.write(bytes(1 << 20))
    assert path.stat().st_size < 1 << 20
    refused(InputError, r"arrays have 3145.* bytes; allowed: up to 268435456.*EOMGEN_NPZ_MB", read_npz, path)


def test_short_numbers_and_texts_count_as_what_they_become(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, t=np.zeros(1_000_001, dtype="U1"))
    refused(InputError, r"a.npz: array 't': has 1000001 texts; allowed: up to 1000000", read_npz, path)
    np.savez_compressed(path, a=np.zeros(1000), t=np.zeros(1 << 18, dtype=bool))
    assert read_npz(path)["t"].size == 1 << 18
    monkeypatch.setenv("EOMGEN_NPZ_MB", "1")
    message = r"array 't': with it the arrays have 2105152 bytes as numbers of 8 bytes each; allowed: up to 1048576"
    refused(InputError, message, read_npz, path)


def test_the_limit_can_be_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, t=np.zeros(1 << 18))
    monkeypatch.setenv("EOMGEN_NPZ_MB", "3")
    assert read_npz(path)["t"].size == 1 << 18
    for most, said in (("1", "allowed: up to 1048576"), ("much", "EOMGEN_NPZ_MB is 'much'; allowed: a number of mega")):
        monkeypatch.setenv("EOMGEN_NPZ_MB", most)
        refused(InputError, said, read_npz, path)


def test_a_result_is_written_whatever_its_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EOMGEN_NPZ_MB", "1")
    sizes: list[int] = []
    for size in (1 << 12, 1 << 18):
        path = write_npz(tmp_path / "a.npz", {}, {"t": np.zeros(size)}, lambda x: sizes.append(read_npz(x)["t"].size))
    assert sizes == [1 << 12]
    with pytest.raises(InputError, match="allowed: up to 1048576"):
        read_npz(path)


def test_a_directory_of_very_many_arrays_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(archive(*((f"{i}{'x' * 200}.npy", b"") for i in range(5000))))
    refused(InputError, r"its directory has [0-9]+ bytes", read_npz, tmp_path / "a.npz")


def test_any_byte_of_a_file_may_be_wrong(tmp_path: Path) -> None:
    data, path = npz({"t": np.arange(3.0), "names": np.array(["a", "b"])}), tmp_path / "a.npz"
    for at in range(len(data)):
        for change in (1, 0x80):
            path.write_bytes(data[:at] + bytes([data[at] ^ change]) + data[at + 1 :])
            with suppress(InputError):  # anything else that is raised ends the test
                read_npz(path)
    for end in range(0, len(data), 7):
        path.write_bytes(data[:end])
        refused(InputError, "", read_npz, path)
