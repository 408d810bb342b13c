"""Files of a million nodes are refused by size, in bounded memory."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest

NODES = 1_000_000
MOST = 1 << 30  # bytes of addresses that a process may have; 0.4 GB of them are those of NumPy and SciPy
READ = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[1]), int(sys.argv[1])))
from eomgen.bending import LinkSets, reduce_files
from eomgen.errors import InputError
try:
    reduce_files(sys.argv[2:], None if sys.argv[2].endswith(".npz") else LinkSets("x=0", rigid={"tip": "x=1"}))
except InputError as error:
    print(error)
"""


def _text(path: Path, head: str, lines: Iterable[str]) -> None:
    with path.open("w", encoding="ascii") as stream:
        stream.write(head)
        stream.writelines(lines)


def _arrays(path: Path) -> None:
    n = 3 * NODES
    every = np.arange(n, dtype=np.int32)
    dofs = np.column_stack([every // 3, every % 3]).astype(np.int32)
    entries = {f"{name}_{part}": every for name in "KM" for part in ("row", "col")}
    data = {f"{name}_data": np.ones(n) for name in "KM"}
    np.savez(path, nodes=np.zeros((NODES, 3)), dofs=dofs, **entries, **data)  # type: ignore[arg-type]


MANY = range(1, NODES + 1)
FILES: dict[str, tuple[Callable[[Path], None], str]] = {
    "nodes.csv": (
        lambda path: _text(path, "node,x,y,z\n", (f"{k},{1e-6 * k:.6f},0,0\n" for k in MANY)),
        "more than 50000 lines of node, x, y, z; allowed: up to that",
    ),
    "nodes.inp": (
        lambda path: _text(path, "*NODE\n", (f"{k}, {1e-6 * k:.6f}, 0, 0\n" for k in MANY)),
        "line 50002: got 'more than 50000 nodes'; allowed: up to that",
    ),
    "nodes.bdf": (
        lambda path: _text(path, "", (f"GRID,{k},,{1e-6 * k:.6f},0.,0.\n" for k in MANY)),
        "more than 50000 nodes'; allowed: up to that",
    ),
    "rows.dof": (
        lambda path: _text(path, "", (f"{k}.1\n{k}.2\n{k}.3\n" for k in MANY)),
        "line 300001: got 'more than 300000 rows'; allowed: up to that",
    ),
    "k.mapping": (
        lambda path: _text(path, "", (f"{k} {k} UX\n" for k in MANY)),
        "line 300001: got 'more than 300000 rows'; allowed: up to that",
    ),
    "k.pch": (
        lambda path: _text(path, "DMIG,K,0,6,2\n", (f"DMIG,K,{k},{d},,{k},{d},1.0\n" for k in MANY for d in (1, 2, 3))),
        "files: have no M",
    ),
    "STIF.mtx": (
        lambda path: _text(path, "", (f"{k},{d},{k},{d},1.0\n" for k in MANY for d in (1, 2, 3))),
        "files: have no M",
    ),
    "link.npz": (_arrays, "nodes: got 1000000 nodes; allowed: 1 to 50000, reduce larger models where they are made"),
}


@pytest.mark.soak
@pytest.mark.skipif(sys.platform == "win32", reason="limits of a process's memory")
@pytest.mark.parametrize("name", FILES)
def test_a_million_nodes_are_refused_in_bounded_memory(name: str, tmp_path: Path) -> None:
    """All but matrices alone by their sizes; these are read, and miss what belongs to them."""
    write, message = FILES[name]
    write(tmp_path / name)
    words = [sys.executable, "-c", READ, str(MOST), str(tmp_path / name)]
    once = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    answer = subprocess.run(words, capture_output=True, text=True, check=False, timeout=600, env=once)
    assert message in answer.stdout, answer.stderr[-1000:]
