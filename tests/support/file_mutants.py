"""Files of measured motions and DH tables that are nearly right: changed cells, arrays and headers, and raw bytes."""

from __future__ import annotations

import io
import random
import zipfile
from typing import Any

import numpy as np

from tests.support import mode_file_mutants
from tests.support.mutations import ATTRIBUTES, PIECES, mutant, raw

COORDINATES = ("joint1.x", "joint1.gamma", "joint2.z")
ROWS = [
    ["t", *COORDINATES[:2], "joint1.x.rate", "joint1.gamma.rate", "joint2.z.drive"],
    *([f"{k / 8}", f"{k}", f"{-k}.5", f"1e-{k}", f" {k}", f'"{k}"'] for k in range(6)),
]
T = np.arange(5.0)
COLUMNS: dict[str, Any] = {"t": T, "joint1.x": T**2, "joint1.x.rate": 2 * T, "joint1.gamma.drive": -T}
SAVED: dict[str, Any] = {"t": T, "q": np.ones((5, 3)), "v": np.ones((5, 3)), "coordinates": np.array(COORDINATES)}
DH_ROWS = [
    ["joint", "type", "a_mm", "alpha_deg", "d", "theta", "lower", "upper", "mass", "com_z", "ixx", "iyy", "izz"],
    *([f"axis{k}", "revolute", f"{k}", "90", "-.1", "pi/2", "-1", f"{k}", "2", f" {k}", "1", "1", "1"] for k in (1, 2)),
    ["", "prismatic", "", "0", "0.5", "-3 pi/4", *[""] * 7],
    ["", "fixed", "1e1", "-90", "0.1", "0", *[""] * 7],
]
MATRIX_ROWS = [
    ["%%MatrixMarket", "matrix", "coordinate", "real", "symmetric"],
    ["2", "2", "3"],
    *(["1", "1", "2e3"], ["2", "1", "-4.5"], ["2", "2", ".5"]),
]
TABLES = {"csv": ROWS, "dh": DH_ROWS, "mtx": MATRIX_ROWS}
FILES = (*TABLES, "npz", "modes")
NAMES = [
    *COORDINATES,
    "t",
    "q",
    "v",
    "a",
    "u",
    "coordinates",
    "meta",
    "joint1.x.acceleration",
    "a/b",
    "..",
    "\x1b[31m",
    "",
]
CELLS = [
    *ATTRIBUTES,
    *NAMES,
    "1_0",
    "\N{ARABIC-INDIC DIGIT ONE}",
    '"',
    '""',
    '"1',
    "1,2",
    "#",
    " # 1",
    "\0",
    "infinity",
    "1\r2",
]
ARRAYS = [
    *(np.nan * T, np.float64(1), T[:0], T[:, None], np.ones((5, 3)), np.ones((5, 0)), T[::-1], T.astype("S3")),
    *(
        T.astype(np.float16),
        T.astype(np.longdouble),
        np.full(5, np.finfo(np.longdouble).max),
        T.astype(bool),
        T.astype(int),
    ),
    *(T.astype(complex), np.array(["joint1.x"] * 3), np.array("joint1.x"), T.astype("M8[s]"), np.zeros(5, "i1,f8")),
    *(T.astype(">f8"), np.array(["a" * 300]), np.ones((1,) * 20), np.full(5, 2**63, dtype=np.uint64)),
]
HEADERS = [
    "(5,)",
    "(5, 1)",
    "(True,)",
    "(10**15,)",
    f"({10**15},)",
    "(-1,)",
    "()",
    "(5",
    "'<f8'",
    "'|O'",
    "[('a', '<f8')]",
    "{",
]


def good(kind: str) -> list[bytes]:
    """Files of that kind that can be read."""
    if kind in TABLES:
        return [_csv(TABLES[kind], kind)]
    return [_npz(arrays, "") for arrays in (mode_file_mutants.files() if kind == "modes" else (COLUMNS, SAVED))]


def any_mutant(kind: str, seed: int) -> bytes:
    """The file of that kind and seed, of descriptions and data alike."""
    if kind not in FILES:
        return mutant(kind, seed)
    chance = random.Random(f"{kind} {seed}")
    if kind == "modes":
        content = _npz(mode_file_mutants.changed(chance), "", chance)
    else:
        content = _changed_csv(TABLES[kind], kind, chance) if kind in TABLES else _changed_npz(chance)
    return raw(content, chance) if chance.random() < 0.3 else content


def _csv(rows: list[list[str]], kind: str, end: str = "\n") -> bytes:
    between = " " if kind == "mtx" else ","
    return "".join(between.join(row) + end for row in rows).encode("utf-8", "surrogatepass")


def _changed_csv(table: list[list[str]], kind: str, chance: random.Random) -> bytes:
    rows = [list(row) for row in table]
    for _ in range(chance.choice((0, 1, 1, 2, 4))):
        row = chance.choice(rows[chance.choice((0, 1)) :])
        at, change = chance.randrange(len(row) + 1), chance.random()
        if change < 0.6:
            row[at : at + 1] = [chance.choice(CELLS)]
        elif change < 0.7:
            row.insert(at, chance.choice(CELLS))
        elif change < 0.8:
            rows.insert(chance.randrange(len(rows) + 1), [chance.choice(["", "# a", " ", *CELLS, *PIECES])])
        elif change < 0.9:
            rows.append(list(row))
        else:
            del row[at:]
    return _csv(rows, kind, chance.choice(("\n", "\n", "\r\n", "\r")))


def _changed_npz(chance: random.Random) -> bytes:
    arrays = dict(chance.choice((COLUMNS, SAVED)))
    for _ in range(chance.choice((0, 1, 1, 2))):
        kind, name = chance.random(), chance.choice(list(arrays))
        if kind < 0.5:
            arrays[name] = chance.choice([*ARRAYS, *arrays.values()])
        elif kind < 0.7:
            arrays[chance.choice(NAMES)] = arrays[name]
        else:
            arrays.pop(name)
            arrays = arrays or {"t": T}
    return _npz(arrays, chance.choice(("", "", *HEADERS)), chance)


def _npz(arrays: dict[str, Any], header: str, chance: random.Random | None = None) -> bytes:
    """The file; a part of the header of each array is replaced by that of another, if one is given."""
    stream = io.BytesIO()
    method = zipfile.ZIP_STORED if chance is not None and chance.random() < 0.5 else zipfile.ZIP_DEFLATED
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, array in arrays.items():
            inner = io.BytesIO()
            np.save(inner, array)
            data = inner.getvalue()
            if header and chance is not None and chance.random() < 0.5:
                old = chance.choice((b"'<f8'", b"(5,)", b"(5, 3)"))
                data = data.replace(old, header.encode()[: len(old)].ljust(len(old)), 1)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), data, method)
    return stream.getvalue()
