"""Finite elements as texts of other programs, written for tests by what their manuals say of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from eomgen.bending.finite_elements import FiniteElements

Write = Callable[[Path, FiniteElements], list[str]]


def _paths(folder: Path, *names: str) -> list[str]:
    return [str(folder / name) for name in names]


def _triangle(matrix: Any) -> list[tuple[int, int, float]]:
    """Return row, column and entry of the upper triangle, rows from 0 on."""
    found = matrix.tocoo()
    return [
        (i, j, x) for i, j, x in zip(found.row.tolist(), found.col.tolist(), found.data.tolist(), strict=True) if i <= j
    ]


def _name(elements: FiniteElements, row: int) -> tuple[int, int]:
    """Return label and direction, 1 to 6, of a row."""
    node, way = elements.dofs[row].tolist()
    return int(elements.labels[node]), way + 1


def _nodes(elements: FiniteElements) -> list[tuple[int, float, float, float]]:
    return [(int(label), *place) for label, place in zip(elements.labels, elements.nodes.tolist(), strict=True)]


def _input_file(elements: FiniteElements, with_sets: bool) -> str:
    lines = ["** a link", "*NODE, NSET=ALL"] + [f"{a}, {x!r}, {y!r}, {z!r}" for a, x, y, z in _nodes(elements)]
    if with_sets:
        end = [str(elements.labels[node]) for node in elements.interfaces[0].nodes]
        root = [str(elements.labels[node]) for node in elements.root]
        lines += [
            "*NSET, NSET=CLAMP",
            ", ".join(root),
            "*NSET, NSET=FLANGE",
            ", ".join(end),
            "*ELEMENT, TYPE=C3D8",
            "1, 2",
        ]
    return "\n".join(lines) + "\n"


def calculix(folder: Path, elements: FiniteElements) -> list[str]:
    """Write .sti, .mas, .dof and .inp."""
    for name, matrix in (("sti", elements.K), ("mas", elements.M)):
        text = "".join(f"{i + 1} {j + 1} {x:20.13e}\n" for i, j, x in _triangle(matrix))
        (folder / f"arm.{name}").write_text(text)
    rows = [_name(elements, row) for row in range(len(elements.dofs))]
    (folder / "arm.dof").write_text("".join(f"{label}.{way}\n" for label, way in rows))
    (folder / "arm.inp").write_text(_input_file(elements, with_sets=True))
    return _paths(folder, "arm.sti", "arm.mas", "arm.dof", "arm.inp")


def abaqus(folder: Path, elements: FiniteElements) -> list[str]:
    """Write matrices in matrix input text, and .inp."""
    for name, matrix in (("arm_STIF2", elements.K), ("arm_MASS2", elements.M)):
        lines = []
        for i, j, x in _triangle(matrix):
            (a, b), (c, d) = _name(elements, i), _name(elements, j)
            lines.append(f"{a},{b}, {c},{d}, {x:.15e}\n")
        (folder / f"{name}.mtx").write_text("".join(lines))
    (folder / "arm.inp").write_text(_input_file(elements, with_sets=True))
    return _paths(folder, "arm_STIF2.mtx", "arm_MASS2.mtx", "arm.inp")


def substructure(folder: Path, elements: FiniteElements) -> list[str]:
    """Write a *USER ELEMENT with both matrices, and .inp; rows have to be in the order of nodes."""
    ways = sorted({_name(elements, row)[1] for row in range(len(elements.dofs))})
    lines = ["** ABAQUS", f"*USER ELEMENT, NODES={len(elements.labels)}, LINEAR", "** ELEMENT NODES"]
    labels = elements.labels.tolist()
    lines += ["** " + ", ".join(map(str, labels[k : k + 8])) + "," for k in range(0, len(labels), 8)]
    lines += [", ".join(map(str, ways))]
    for kind, matrix in (("STIFFNESS", elements.K.toarray()), ("MASS", elements.M.toarray())):
        lines.append(f"*MATRIX,TYPE={kind}")
        for column in range(len(matrix)):
            numbers = [f"{x:.15e}" for x in matrix[: column + 1, column].tolist()]
            lines += [" , ".join(numbers[k : k + 4]) for k in range(0, len(numbers), 4)]
    (folder / "arm.mtx").write_text("\n".join(lines) + "\n")
    (folder / "arm.inp").write_text(_input_file(elements, with_sets=True))
    return _paths(folder, "arm.mtx", "arm.inp")


def _ansys_rows(folder: Path, elements: FiniteElements) -> None:
    names = ("UX", "UY", "UZ", "ROTX", "ROTY", "ROTZ")
    rows = [_name(elements, row) for row in range(len(elements.dofs))]
    text = "".join(f"{k:12d}{label:12d}   {names[way - 1]}\n" for k, (label, way) in enumerate(rows, 1))
    (folder / "arm.mapping").write_text(f"  Matrix Eqn        Node   DOF\n{text}")
    lines = [f"{a},{x!r},{y!r},{z!r}\n" for a, x, y, z in _nodes(elements)]
    (folder / "arm.csv").write_text("node,x,y,z\n" + "".join(lines))


def market(folder: Path, elements: FiniteElements) -> list[str]:
    """Write Matrix Market files, .mapping and .csv."""
    _ansys_rows(folder, elements)
    for name, matrix in (("k", elements.K), ("m", elements.M)):
        entries = _triangle(matrix)
        n = len(elements.dofs)
        head = f"%%MatrixMarket matrix coordinate real symmetric\n% a link\n{n} {n} {len(entries)}\n"
        (folder / f"{name}.mmf").write_text(head + "".join(f"{j + 1} {i + 1} {x:.15e}\n" for i, j, x in entries))
    return [f"K={folder / 'k.mmf'}", f"M={folder / 'm.mmf'}", *_paths(folder, "arm.mapping", "arm.csv")]


def harwell_boeing(folder: Path, elements: FiniteElements) -> list[str]:
    """Write Harwell-Boeing files of lower triangles by columns, with numbers that touch, .mapping and .csv."""
    _ansys_rows(folder, elements)
    n = len(elements.dofs)
    for name, matrix in (("STIFF", elements.K), ("MASS", elements.M)):
        by_column = sorted((i, j, x) for i, j, x in _triangle(matrix))
        counts = np.bincount([i for i, _, _ in by_column], minlength=n)
        pointers = (1 + np.concatenate([[0], np.cumsum(counts)])).tolist()
        cards = [
            _cards([f"{p:8d}" for p in pointers], 10),
            _cards([f"{j + 1:8d}" for _, j, _ in by_column], 10),
            _cards([f"{x:24.15E}".replace("E", "D") for _, _, x in by_column], 3),
        ]
        lines = [
            f"{'a link':<72}{'arm':<8}",
            "".join(f"{k:14d}" for k in (sum(map(len, cards)), *map(len, cards), 0)),
            f"RSA{'':11}{n:14d}{n:14d}{len(by_column):14d}{0:14d}",
            f"{'(10I8)':<16}{'(10I8)':<16}{'(1P,3D24.15)':<20}{'':<20}",
        ]
        (folder / f"{name}.matrix").write_text("\n".join(lines + [line for part in cards for line in part]) + "\n")
    return _paths(folder, "STIFF.matrix", "MASS.matrix", "arm.mapping", "arm.csv")


def _cards(words: list[str], count: int) -> list[str]:
    return ["".join(words[k : k + count]) for k in range(0, len(words), count)]


def nastran(folder: Path, elements: FiniteElements) -> list[str]:
    """Write DMIG entries in large fields and in small ones, and GRID entries in free and in large fields."""
    lines = ["$ a link"]
    for name, matrix in (("KAAX", elements.K), ("MAAX", elements.M)):
        lines.append(f"DMIG    {name:<8}{0:8d}{6:8d}{2:8d}")
        columns: dict[int, list[tuple[int, float]]] = {}
        for i, j, x in _triangle(matrix):
            columns.setdefault(j, []).append((i, x))
        for j, entries in columns.items():
            label, way = _name(elements, j)
            lines.append(f"DMIG*   {name:<16}{label:16d}{way:16d}")
            for i, x in entries:
                label, way = _name(elements, i)
                lines.append(f"*       {label:16d}{way:16d}{f'{x:.9E}'.replace('E', 'D'):>16}")
    (folder / "arm.pch").write_text("\n".join(lines) + "\n")
    grids = []
    for k, (label, x, y, z) in enumerate(_nodes(elements)):
        if k % 2:
            grids.append(f"GRID,{label},,{x!r},{y!r},{z!r}")
        else:
            grids += [f"GRID*   {label:16d}{'':16}{x:16.9E}{y:16.9E}*", f"*       {z:16.9E}"]
    (folder / "arm.bdf").write_text("BEGIN BULK\n" + "\n".join(grids) + "\nENDDATA\n")
    return _paths(folder, "arm.pch", "arm.bdf")


def _rotation(angles: tuple[float, float, float]) -> np.ndarray:
    turns = []
    for k, angle in enumerate(angles):
        turn, (i, j) = np.eye(3), [(1, 2), (2, 0), (0, 1)][k]
        turn[[i, j], [i, j]], turn[j, i], turn[i, j] = np.cos(angle), np.sin(angle), -np.sin(angle)
        turns.append(turn)
    return np.linalg.multi_dot(turns)


def _in_system(kind: str, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return coordinates by those of rectangular axes, and their directions, rows, as differences have them."""
    x, y, z = local
    away, angle = float(np.hypot(x, y)), float(np.degrees(np.arctan2(y, x)))
    if kind == "R":
        return local, np.eye(3)
    outward, around, up = np.array([x, y, 0.0]) / away, np.array([-y, x, 0.0]) / away, np.array([0.0, 0.0, 1.0])
    if kind == "C":
        return np.array([away, angle, z]), np.array([outward, around, up])
    size = float(np.linalg.norm(local))
    along = local / size
    return np.array([size, np.degrees(np.arccos(z / size)), angle]), np.array([along, np.cross(around, along), around])


def nastran_systems(folder: Path, elements: FiniteElements) -> list[str]:
    """Write what ``nastran`` does, with places and directions in systems of CORD2R, CORD2C and CORD1S entries."""
    first, second = _rotation((0.3, -0.5, 1.1)), _rotation((0.3, -0.5, 1.1)) @ _rotation((-0.9, 0.4, 0.2))
    corners = np.array([[0.37, 2.0, 0.0], [0.37, 2.0, 1.0], [0.45, 2.5, 0.3]])
    up, normal = corners[1] - corners[0], np.cross(corners[1] - corners[0], corners[2] - corners[0])
    third = np.array([np.cross(normal, up), normal, up]).T
    origins = np.zeros(3), np.array([0.1, 0.2, -0.3]), np.array([0.5, 3.0, 0.4]), corners[0]
    axes = np.eye(3), first, second, third / np.linalg.norm(third, axis=0)
    within = [(first.T @ (x - origins[1])).tolist() for x in origins[2] + np.array([0 * up, second.T[2], second.T[0]])]
    points = [origins[1] + x for x in (0 * up, first.T[2], first.T[0] + 0.5 * first.T[2])]
    lines = [f"GRID,{900 + k},0,{x!r},{y!r},{z!r}" for k, (x, y, z) in enumerate(corners.tolist())]
    lines += ["GRDSET,,5", "CORD1S,8,901,900,902,7,900,901,902"]
    for name, system, (a, b, c) in (("CORD2R,5", 0, np.array(points).tolist()), ("CORD2C,6", 5, within)):
        lines += [",".join([name, str(system), *map(repr, (*a, *b))]), ",".join(["", *map(repr, c)])]
    turn = np.eye(len(elements.dofs))
    for node, (label, *place) in enumerate(_nodes(elements)):
        local = [axes[k].T @ (place - origins[k]) for k in range(4)]
        of_place, of_ways = node % 3 + 1, (node + 1) % 4
        coordinates = _in_system("RRCS"[of_place], local[of_place])[0].tolist()
        ways = axes[of_ways] @ _in_system("RRCS"[of_ways], local[of_ways])[1].T
        said = "" if of_place == 1 else str(4 + of_place)
        lines.append(f"GRID,{label},{said},{','.join(map(repr, coordinates))},{(0, 5, 6, 7)[of_ways]}")
        rows = np.flatnonzero(elements.dofs[:, 0] == node)
        for three in (rows[:3], rows[3:]):
            turn[np.ix_(three, three)] = ways if len(three) else 0.0
    again = {name: csr_array(turn.T @ getattr(elements, name).toarray() @ turn) for name in ("K", "M")}
    nastran(folder, replace(elements, **again))
    (folder / "arm.bdf").write_text("\n".join(lines) + "\n")
    return _paths(folder, "arm.pch", "arm.bdf")


def _runs(column: np.ndarray, is_sparse: bool) -> list[tuple[int, np.ndarray]]:
    """Return the strings of a column: first row, from 1 on, and entries; of a dense one all up to the last."""
    places = np.flatnonzero(column)
    if not is_sparse:
        return [(int(places[0]) + 1, column[places[0] : places[-1] + 1])]
    parts = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1)
    return [(int(part[0]) + 1, column[part]) for part in parts]


def op4(
    folder: Path,
    elements: FiniteElements,
    *,
    order: str = "",
    is_sparse: bool = False,
    is_big: bool = False,
    kind: int = 2,
) -> list[str]:
    """Write what OUTPUT4 does, in ASCII, or in binary of an order of bytes, as the DMAP Programmer's Guide says it.

    Beside K and M the file has a matrix that is neither square nor real.
    """
    n = len(elements.dofs)
    written = b""
    for name, matrix in (("KAAX", elements.K), ("GOAT", np.eye(2, 3)), ("MAAX", elements.M)):
        dense = matrix if isinstance(matrix, np.ndarray) else matrix.toarray()
        rows, columns = dense.shape
        about = (columns, -rows if is_big else rows, 6 if rows == columns else 2, kind if rows == columns else 4)
        each = {1: 1, 2: 2, 4: 4}[about[3]]
        records: list[tuple[tuple[int, int, int], list[tuple[list[int], np.ndarray]]]] = []
        for j, column in enumerate(dense.T, 1):
            if not column.any():
                continue
            runs = [(row, entries if each < 4 else np.repeat(entries, 2)) for row, entries in _runs(column, is_sparse)]
            words = [each * len(entries) // (2 if each == 4 else 1) for _, entries in runs]
            if not is_sparse:
                records.append(((j, runs[0][0], words[0]), [([], runs[0][1])]))
                continue
            heads = [[w + 1, r] if is_big else [r + 65536 * (w + 1)] for (r, _), w in zip(runs, words, strict=True)]
            count = sum(words) + sum(map(len, heads))
            records.append(((j, 0, count), [(head, run[1]) for head, run in zip(heads, runs, strict=True)]))
        records.append(((columns + 1, 1, 1), [([], np.ones(1))]))
        written += _op4_binary(about, name, records, order) if order else _op4_ascii(about, name, records)
    (folder / "arm.op4").write_bytes(written)
    named = (_name(elements, row) for row in range(n))
    (folder / "arm.dof").write_text("".join(f"{label}.{way}\n" for label, way in named))
    nodes = "".join(f"{label},{x!r},{y!r},{z!r}\n" for label, x, y, z in _nodes(elements))
    (folder / "arm.csv").write_text("node,x,y,z\n" + nodes)
    return _paths(folder, "arm.op4", "arm.dof", "arm.csv")


def _op4_ascii(about: tuple[int, ...], name: str, records: Any) -> bytes:
    lines = ["".join(f"{x:8d}" for x in about) + f"{name:<8}1P,3E23.16"]
    for says, strings in records:
        lines.append("".join(f"{x:8d}" for x in says))
        for head, entries in strings:
            lines += ["".join(f"{x:12d}" for x in head)] if head else []
            lines += ["".join(f"{x:23.16E}" for x in entries[k : k + 3]) for k in range(0, len(entries), 3)]
    return ("\n".join(lines) + "\n").encode("ascii")


def _op4_binary(about: tuple[int, ...], name: str, records: Any, order: str) -> bytes:
    integer, number = np.dtype(f"{order}i4"), np.dtype(f"{order}f{4 if about[3] == 1 else 8}")

    def record(data: bytes) -> bytes:
        ends = np.array([len(data)], dtype=integer).tobytes()
        return ends + data + ends

    result = record(np.array(about, dtype=integer).tobytes() + f"{name:<8}".encode("ascii"))
    for says, strings in records:
        data = np.array(says, dtype=integer).tobytes()
        for head, entries in strings:
            data += np.array(head, dtype=integer).tobytes() + entries.astype(number).tobytes()
        result += record(data)
    return result


OP4: dict[str, dict[str, Any]] = {  # as OUTPUT4 writes them
    "text": {},
    "strings": {"is_sparse": True},
    "big strings": {"is_sparse": True, "is_big": True},
    "binary": {"order": "<"},
    "binary strings": {"order": ">", "is_sparse": True},
    "big binary strings": {"order": "<", "is_sparse": True, "is_big": True},
    "single": {"order": "<", "kind": 1},
}
PROGRAMS: dict[str, Write] = {
    "calculix": calculix,
    "abaqus": abaqus,
    "market": market,
    "harwell_boeing": harwell_boeing,
    "nastran": nastran,
    "nastran_systems": nastran_systems,
}
