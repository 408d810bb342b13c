"""Files of motions in many blocks, and arrays that are none; test_surfaces has large files, within their limits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eomgen.errors import InputError
from eomgen.motion.csv_columns import read_csv
from eomgen.motion.files import read_motion
from tests.support.refusals import refused

NAMES = ("joint1.x", "joint1.gamma")


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
    refused(InputError, r"line 100004: column 'joint1.gamma': 'inf'; allowed: a finite number", read_csv, path)
    path.write_bytes("\n".join(lines).encode() + b"\n\xc3")
    refused(InputError, f"byte {path.stat().st_size - 1} is no UTF-8", read_csv, path)


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
        refused(InputError, words, read_motion, path, NAMES)


def test_a_motion_of_very_many_coordinates(tmp_path: Path) -> None:
    np.savez(tmp_path / "m.npz", t=np.arange(20_000.0), **{"joint1.x": np.zeros(20_000)})
    names = [*NAMES, *(f"joint{k}.x" for k in range(2, 501))]
    with pytest.raises(InputError, match="20000 times of 501 coordinates; allowed: up to 10000000 numbers"):
        read_motion(tmp_path / "m.npz", names)
