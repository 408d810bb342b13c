"""Files as large as they come, each with what is said of it: of measured motions, and of links that bend."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from eomgen.bending import LinkSets, reduce_files
from eomgen.errors import InputError
from eomgen.motion.files import read_motion
from tests.support.soak import WHOLE

NAMES = ("joint1.x", "joint1.gamma")
HEADER = b"t,joint1.x,joint1.gamma,joint1.x.drive\n"
DIGITS = b"0.12345678901234567," * 3 + b"0.12345678901234567\n"
MANY = 84 if WHOLE else 30  # MB: runs share the machine with others
MOTIONS = {  # head, what is repeated until there are so many MB, and what is said of it
    "numbers": (HEADER, DIGITS, MANY, "increasing times"),
    "a wrong number": (HEADER, DIGITS, MANY, "'x'; allowed: a finite number"),
    "zeros": (HEADER, b"0,0,0,0\n", MANY, "too many numbers"),
    "zeros and semicolons": (HEADER.replace(b",", b";"), b"0;0;0;0\n", MANY, "too many numbers"),
    "decimal commas": (
        HEADER.replace(b",", b"\t"),
        DIGITS.replace(b",", b"\t").replace(b".", b","),
        9,
        "increasing times",
    ),
    "times": (b"t,joint1.x\n", b"1,\n", MANY, "too many numbers"),
    "empty lines": (HEADER, b"\n", MANY, "too many numbers"),
    "one line": (HEADER, b"0", MANY, "line 2: it has more than 1048576 bytes"),
    "a quoted line": (HEADER, b'"0 ', MANY, "line 2: it has more than"),
    "bytes that are none": (HEADER, b"\xff\n", MANY, "byte 39 is no UTF-8"),
    "comments": (HEADER, b"# nothing at all here, and not much more there\n", MANY, "has no values"),
    "200 MB": (HEADER, DIGITS, 200, "bytes; allowed: up to"),
    "a line of very many columns": (b"", b"a,", 0.9, "471860 columns; allowed: up to 20000"),
    "NULs": (HEADER, b"\0", 0.9, "line 2: "),
    "a header alone": (HEADER, b"", 0, "has no values"),
}


def write_motion(folder: Path, seed: int) -> Path:
    """Write the motion of that number; the name of the file is that of its entry."""
    name = list(MOTIONS)[seed]
    head, unit, megabytes, _ = MOTIONS[name]
    path = folder / f"{name}.csv"
    with path.open("wb") as stream:
        stream.write(head)
        block = unit * (2**20 // max(len(unit), 1))
        for _ in range(int(megabytes)):
            stream.write(block)
        stream.write(block[: int(megabytes % 1 * 2**20)])
        if "wrong" in name:
            stream.write(b"0,x,0,0\n")
    return path


def read_large_motion(path: Path) -> None:
    """Refuse a motion in the words of its entry."""
    _refuse(lambda: read_motion(path, NAMES), MOTIONS[path.stem][-1], path)


def _refuse(read: Callable[[], object], words: str, path: Path) -> None:
    try:
        read()
    except InputError as error:
        path.unlink()
        if words in str(error):
            raise
        raise AssertionError(f"not {words!r}") from error
    raise AssertionError("it is read")


NODES = 1_000_000
COUNT = range(1, NODES + 1)


def _arrays(path: Path) -> None:
    n = 3 * NODES
    every = np.arange(n, dtype=np.int32)
    dofs = np.column_stack([every // 3, every % 3]).astype(np.int32)
    entries = {f"{name}_{part}": every for name in "KM" for part in ("row", "col")}
    data: dict[str, Any] = {f"{name}_data": np.ones(n) for name in "KM"}
    np.savez(path, nodes=np.zeros((NODES, 3)), dofs=dofs, **entries, **data)


LINKS: dict[str, tuple[str, Callable[[], Iterable[str]], str]] = {  # head and lines, and what is said of them
    "nodes.csv": (
        "node,x,y,z\n",
        lambda: (f"{k},{1e-6 * k:.6f},0,0\n" for k in COUNT),
        "more than 50000 lines of node, x, y, z; allowed: up to that",
    ),
    "nodes.inp": (
        "*NODE\n",
        lambda: (f"{k}, {1e-6 * k:.6f}, 0, 0\n" for k in COUNT),
        "line 50002: got 'more than 50000 nodes'; allowed: up to that",
    ),
    "sets.inp": (
        "*NODE, NSET=A\n1, 0., 0., 0.\n",
        lambda: ("*NSET, NSET=A\n", "A, A, A, A\n" * 10**6, "*NSET, NSET=B, GENERATE\n1, 1000000000\n"),
        "got '2 sets of 1000000001 nodes'; allowed: up to 10000 sets",
    ),
    "nodes.bdf": (
        "",
        lambda: (f"GRID,{k},,{1e-6 * k:.6f},0.,0.\n" for k in COUNT),
        "more than 50000 nodes'; allowed: up to that",
    ),
    "rows.dof": (
        "",
        lambda: (f"{k}.1\n{k}.2\n{k}.3\n" for k in COUNT),
        "line 300001: got 'more than 300000 rows'; allowed: up to that",
    ),
    "k.mapping": (
        "",
        lambda: (f"{k} {k} UX\n" for k in COUNT),
        "line 300001: got 'more than 300000 rows'; allowed: up to that",
    ),
    "k.pch": (
        "DMIG,K,0,6,2\n",
        lambda: (f"DMIG,K,{k},{d},,{k},{d},1.0\n" for k in COUNT for d in (1, 2, 3)),
        "files: have no M",
    ),
    "k.op4": (
        f"{10**5:8d}{10**5:8d}       6       2KAAX    1P,3E23.16\n       1       1  200000\n",
        lambda: (f"{1.0:23.16E}\n" for _ in COUNT),
        "got '200000 words, and 100001 entries behind it'; allowed: 2 words of an entry",
    ),
    "STIF.mtx": ("", lambda: (f"{k},{d},{k},{d},1.0\n" for k in COUNT for d in (1, 2, 3)), "files: have no M"),
    "names.npz": ("", lambda: (), "has 64000000 texts; allowed: up to 1000000"),
    "link.npz": ("", lambda: (), "nodes: got 1000000 nodes; allowed: 1 to 50000, reduce larger models where they are"),
}


def write_link(folder: Path, seed: int) -> Path:
    """Write a file of a million nodes; the name says of which program it is."""
    name = list(LINKS)[seed]
    head, lines, _ = LINKS[name]
    if name == "names.npz":
        np.savez_compressed(folder / name, stress_names=np.zeros(64 * 10**6, dtype="U1"))
    elif name.endswith(".npz"):
        _arrays(folder / name)
    else:
        with (folder / name).open("w", encoding="ascii") as stream:
            stream.write(head)
            stream.writelines(lines())
        (folder / "rows.of.k.dof").write_text("1.1\n")  # of a .op4
    return folder / name


def read_large_link(path: Path) -> None:
    """Refuse a link by its size; matrices alone are read, and miss what belongs to them."""
    sets = None if path.suffix == ".npz" else LinkSets("x=0", rigid={"tip": "x=1"})
    files = [path, path.with_name("rows.of.k.dof")] if path.suffix == ".op4" else [path]
    _refuse(lambda: reduce_files(files, sets), LINKS[path.name][-1], path)
