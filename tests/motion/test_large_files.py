"""Files of motions as large as they come: read or refused within limits of time and memory, or found to be none."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from eomgen.errors import InputError
from eomgen.motion.csv_columns import read_csv
from eomgen.motion.files import read_motion
from tests.support.soak import WHOLE

ROOT = Path(__file__).parents[2]
NAMES = ("joint1.x", "joint1.gamma")
HEADER = b"t,joint1.x,joint1.gamma,joint1.x.drive\n"
DIGITS = b"0.12345678901234567," * 3 + b"0.12345678901234567\n"
LARGE = {  # head, what is repeated until there are so many MB, and what is said of it
    "84 MB of numbers": (HEADER, DIGITS, 84, "increasing times"),
    "84 MB and a wrong number": (HEADER, DIGITS, 84, "'x'; allowed: a finite number"),
    "84 MB of zeros": (HEADER, b"0,0,0,0\n", 84, "too many numbers"),
    "84 MB of times": (b"t,joint1.x\n", b"1,\n", 84, "too many numbers"),
    "84 MB of empty lines": (HEADER, b"\n", 84, "too many numbers"),
    "one line of 84 MB": (HEADER, b"0", 84, "line 2: it has more than 1048576 bytes"),
    "a quoted line of 84 MB": (HEADER, b'"0 ', 84, "line 2: it has more than"),
    "84 MB of bytes that are none": (HEADER, b"\xff\n", 84, "byte 39 is no UTF-8"),
    "84 MB of comments": (HEADER, b"# nothing at all here, and not much more there\n", 84, "has no values"),
    "200 MB": (HEADER, DIGITS, 200, "bytes; allowed: up to"),
    "a line of very many columns": (b"", b"a,", 0.9, "471860 columns; allowed: up to 20000"),
    "NULs": (HEADER, b"\0", 0.9, "line 2: "),
    "a header alone": (HEADER, b"", 0, "has no values"),
}


@pytest.mark.soak
@pytest.mark.parametrize("megabytes", [30, *([84] if WHOLE else [])])
def test_limits_of_time_and_memory(megabytes: int, tmp_path: Path) -> None:
    """In one process that is allowed 512 MB more than it begins with, 2 s of the processor each.

    Runs share the machine with other tests, so that they take shorter files for the same time.
    """
    code = f"""
import signal, sys
from pathlib import Path
sys.path.insert(0, {str(ROOT)!r})
from tests.motion.test_large_files import LARGE, NAMES, read_motion, written
from tests.support import fuzzing
fuzzing.limit_memory()
signal.signal(signal.SIGPROF, fuzzing.late)
for name, (*_, said) in LARGE.items():
    path = written(name, Path({str(tmp_path)!r}), {megabytes})
    signal.setitimer(signal.ITIMER_PROF, fuzzing.SECONDS)
    try:
        read_motion(path, NAMES)
    except fuzzing.InputError as error:
        assert said in str(error), (name, str(error))
    else:
        raise AssertionError(name)
    signal.setitimer(signal.ITIMER_PROF, 0)
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert found.returncode == 0, found.stderr[-3000:]


def written(name: str, folder: Path, instead_of_84: int) -> Path:
    head, unit, megabytes, _ = LARGE[name]
    megabytes = instead_of_84 if megabytes == 84 else megabytes
    path = folder / "large.csv"
    with path.open("wb") as stream:
        stream.write(head)
        block = unit * (2**20 // max(len(unit), 1))
        for _ in range(int(megabytes)):
            stream.write(block)
        stream.write(block[: int(megabytes % 1 * 2**20)])
        if "wrong" in name:
            stream.write(b"0,x,0,0\n")
    return path


def test_blocks_are_put_together(tmp_path: Path) -> None:
    """Lines and numbers of a file of many blocks, with comments, empty lines and other ends of lines."""
    values = np.random.default_rng(5).standard_normal((120_000, 3))
    values[:, 0] = np.arange(len(values))
    rows = [f'{int(t)},{float(x)!r},"{float(y)!r}" ' for t, x, y in values]
    lines = ["# first", "", "t, joint1.x ,joint1.gamma"]
    for k, row in enumerate(rows):
        lines += [row, "  # a comment", ""] if k % 1000 == 7 else [row]
    path = tmp_path / "m.csv"
    for end in ("\n", "\r\n", "\r"):
        path.write_bytes(b"\xef\xbb\xbf" + end.join(lines).encode())
        columns, places = read_csv(path)
        assert list(columns) == ["t", "joint1.x", "joint1.gamma"]
        assert np.array_equal(np.stack(list(columns.values()), axis=1), values)
        assert [lines[k - 1] for k in places[[0, 7, 8, -1]]] == [rows[0], rows[7], rows[8], rows[-1]]
    lines[100_003] = "1,2,inf"
    path.write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"line 100004: column 'joint1.gamma': 'inf'; allowed: a finite number"):
        read_csv(path)
    path.write_bytes("\n".join(lines).encode() + b"\n\xc3")
    with pytest.raises(InputError, match=f"byte {path.stat().st_size - 1} is no UTF-8"):
        read_csv(path)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("0,1_0", "'1_0'; allowed: a finite number"),
        ("0,\N{ARABIC-INDIC DIGIT ONE}", "allowed: a finite number"),
        ("0,0x10", "'0x10'"),
        ("0,", "''; allowed: a finite number"),
        ("0,1 # no comment", "'1 # no comment'"),
        ('0,"1', "a quote is not closed"),
        ('0,"1\n1,2"', "a quote is not closed"),
        ("0,1\0", "allowed: "),
        ("0,1e999", "'1e999'"),
        ("0,1,", "3 values; allowed: 2"),
        ("  ", "1 values; allowed: 2"),
        ("0," + "1" * 200_000, "field larger than field limit"),
    ],
)
def test_what_is_no_number_is_found(line: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_text(f"t,joint1.x\n{line}\n", encoding="utf-8")
    with pytest.raises(InputError) as refusal:
        read_csv(path)
    assert str(refusal.value).startswith(f"{path}: line 2: ")
    assert words in str(refusal.value)


def test_arrays_that_are_no_motion(tmp_path: Path) -> None:
    t, path = np.arange(3.0), tmp_path / "m.npz"
    for arrays, words in (
        ({"t": t, "q": np.zeros((3, 2)), "coordinates": np.array(["joint1.x"] * 2)}, "'joint1.x' is there twice"),
        ({"t": t[:0], "joint1.x": t[:0]}, "array t has no values"),
        ({"t": np.array(1.0), "joint1.x": np.array(1.0)}, r"shape \(\)"),
        ({"t": t, "joint1.x": np.full(3, np.finfo(np.longdouble).max)}, "sample 0: column 'joint1.x': inf"),
        ({"t": np.zeros(21_000_000, dtype=np.int8)}, "its arrays have 21000000 numbers; allowed: up to 20000000"),
    ):
        np.savez(path, **arrays)
        with pytest.raises(InputError, match=words):
            read_motion(path, NAMES)


def test_a_motion_of_very_many_coordinates(tmp_path: Path) -> None:
    np.savez(tmp_path / "m.npz", t=np.arange(20_000.0), **{"joint1.x": np.zeros(20_000)})
    names = [*NAMES, *(f"joint{k}.x" for k in range(2, 501))]
    with pytest.raises(InputError, match="20000 times of 501 coordinates; allowed: up to 10000000 numbers"):
        read_motion(tmp_path / "m.npz", names)


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_a_fifo_is_no_motion(suffix: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / f"m{suffix}")
    for path in (tmp_path / f"m{suffix}", tmp_path / f"a\0{suffix}"):
        with pytest.raises(InputError, match=r"cannot be read|null byte"):
            read_motion(path, NAMES)
