"""Files that are none, never end, or become larger than they look: refused before they are waited for or unpacked."""

from __future__ import annotations

import io
import os
import socket
import struct
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from eomgen.errors import InputError
from eomgen.files import read_regular
from eomgen.npz import read_npz

MOST = 1000


def _no_file(folder: Path, kind: str) -> Path:
    path = folder / f"{kind}.npz"
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
    path = _no_file(tmp_path, kind)
    with pytest.raises(OSError):
        read_regular(path, MOST)
    with pytest.raises(InputError, match=r"cannot be read|folder|FIFO|device"):
        read_npz(path)


def test_a_file_is_read_up_to_its_limit(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"x" * MOST)
    assert read_regular(path, MOST) == b"x" * MOST
    path.write_bytes(b"x" * (MOST + 1))
    with pytest.raises(OSError, match="1001 bytes; allowed: up to 1000"):
        read_regular(path, MOST)


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="no file that says it is empty and is not")
def test_a_file_that_hides_its_size_is_not_read_to_its_end() -> None:
    with pytest.raises(OSError, match="more bytes than that"):
        read_regular(Path("/proc/self/maps"), 10)


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


def _npy(header: str, data: bytes = b"", version: tuple[int, int] = (1, 0)) -> bytes:
    text = header.encode("latin1") + b"\n"
    return b"\x93NUMPY" + bytes(version) + struct.pack("<H", len(text)) + text + data


def _header(shape: object = (1,), dtype: object = "'<f8'") -> str:
    return f"{{'descr': {dtype}, 'fortran_order': False, 'shape': {shape}, }}"


_ENTRIES = {
    "a petabyte": _npy(_header(f"({10**15},)")),
    "more than there is": _npy(_header(f"({10**30},)")),
    "a truth value as a length": _npy(_header("(True,)"), b"\0" * 8),
    "a negative length": _npy(_header("(-1,)"), b"\0" * 8),
    "a length that is text": _npy(_header("('1',)"), b"\0" * 8),
    "texts without characters": _npy(_header(f"({10**15},)", "'<U0'")),
    "no rows of many columns": _npy(_header(f"(0, {10**19})")),
    "objects": _npy(_header(dtype="'|O'"), b"\0" * 8),
    "a record with objects": _npy(_header(dtype="[('a', '|O')]"), b"\0" * 8),
    "dates": _npy(_header(dtype="'<M8[s]'"), b"\0" * 8),
    "complex numbers": _npy(_header(dtype="'<c16'"), b"\0" * 16),
    "fewer bytes": _npy(_header("(2,)"), b"\0" * 8),
    "further bytes": _npy(_header(), b"\0" * 16),
    "another version": _npy(_header(), b"\0" * 8, (2, 0)),
    "no header": b"\x93NUMPY\1\0\xff\xff",
    "a header that is code": _npy("__import__('os').abort()"),
    "a deep header": _npy("(" * 5000 + ")" * 5000),
    "a long header": _npy(" " * 60000 + _header()),
    "no array": b"text",
    "nothing": b"",
    "many dimensions": _npy(_header((1,) * 100), b"\0" * 8),
}


def _zip(path: Path, *entries: tuple[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, data in entries:
            archive.writestr(name, data)
    return path


@pytest.mark.parametrize("entry", _ENTRIES.values(), ids=_ENTRIES)
def test_an_array_that_is_none_is_refused(entry: bytes, tmp_path: Path) -> None:
    path = _zip(tmp_path / "a.npz", ("t.npy", entry))
    with pytest.raises(InputError) as refusal:
        read_npz(path)
    assert str(path) in str(refusal.value)
    assert str(refusal.value).isprintable()


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_an_array_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    entry = _npy(_header(), b"\0" * 8)
    for names in (("t.npy", "t.npy"), ("t.npy", "t")):
        with pytest.raises(InputError, match="'t' is there twice"):
            read_npz(_zip(tmp_path / "a.npz", *((name, entry) for name in names)))


def test_a_small_file_of_many_zeros_is_not_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("t.npy", "w") as entry:
        entry.write(_npy(_header(f"({300 << 17},)")))
        for _ in range(300):
            entry.write(bytes(1 << 20))
    assert path.stat().st_size < 1 << 20
    with pytest.raises(InputError, match=r"arrays have 3145.* bytes; allowed: up to 268435456.*EOMGEN_NPZ_MB"):
        read_npz(path)


def test_the_limit_can_be_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.savez_compressed(tmp_path / "a.npz", t=np.zeros(1 << 18))
    monkeypatch.setenv("EOMGEN_NPZ_MB", "1")
    with pytest.raises(InputError, match="allowed: up to 1048576"):
        read_npz(tmp_path / "a.npz")
    monkeypatch.setenv("EOMGEN_NPZ_MB", "3")
    assert read_npz(tmp_path / "a.npz")["t"].size == 1 << 18
    monkeypatch.setenv("EOMGEN_NPZ_MB", "much")
    with pytest.raises(InputError, match="EOMGEN_NPZ_MB is 'much'; allowed: a number of megabytes"):
        read_npz(tmp_path / "a.npz")


def test_a_directory_of_very_many_arrays_is_refused(tmp_path: Path) -> None:
    path = _zip(tmp_path / "a.npz", *((f"{i}{'x' * 200}.npy", b"") for i in range(5000)))
    with pytest.raises(InputError, match=r"its directory has [0-9]+ bytes"):
        read_npz(path)


def test_any_byte_of_a_file_may_be_wrong(tmp_path: Path) -> None:
    stream = io.BytesIO()
    np.savez_compressed(stream, t=np.arange(3.0), names=np.array(["a", "b"]))
    data, path = stream.getvalue(), tmp_path / "a.npz"
    for at in range(len(data)):
        for change in (1, 0x80):
            path.write_bytes(data[:at] + bytes([data[at] ^ change]) + data[at + 1 :])
            with suppress(InputError):  # anything else that is raised ends the test
                read_npz(path)
    for end in range(0, len(data), 7):
        path.write_bytes(data[:end])
        with pytest.raises(InputError):
            read_npz(path)
