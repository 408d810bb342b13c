"""Finite elements out of other programs' files: the same link out of each, and what is refused, by line or node."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import block_diag, coo_array, csr_array

from eomgen.bending.element_files import arrays_of, elements_of, has_elements, read_elements
from eomgen.bending.finite_elements import FiniteElements, Interface
from eomgen.bending.link_files import read_link
from eomgen.bending.readers import abaqus, calculix, op4
from eomgen.bending.readers.selection import Selection
from eomgen.bending.reducing import LinkSets, reduce_files
from eomgen.bending.reduction import reduce
from eomgen.errors import InputError
from tests.support import element_texts
from tests.support.finite_elements import bar, beam
from tests.support.refusals import refused

pytestmark = pytest.mark.quick
SMALL = {"counts": (3, 1, 1)}
BY_PLANES = LinkSets("x=0", rigid={"tip": "x=1@1,0,0"})


@pytest.mark.parametrize("program", element_texts.PROGRAMS)
def test_each_program_has_the_same_link(program: str, tmp_path: Path) -> None:
    elements = bar(**SMALL)
    files = element_texts.PROGRAMS[program](tmp_path, elements)
    found, expected = reduce_files(files, BY_PLANES), reduce(elements)
    digits = 1e-5 if program.startswith("nastran") else 1e-8  # its files have nine of them
    assert found.frequencies == pytest.approx(expected.frequencies, rel=digits)
    assert found.mass == pytest.approx(expected.mass, rel=1e-8)
    assert found.inertia == pytest.approx(expected.inertia, rel=digits, abs=1e-8)
    assert np.abs(found.interface_Phi) == pytest.approx(
        np.abs(expected.interface_Phi), rel=1e2 * digits, abs=1e2 * digits
    )


@pytest.mark.parametrize("case", element_texts.OP4)
def test_files_of_output4_have_the_same_link(case: str, tmp_path: Path) -> None:
    """Dense and sparse, in ASCII and binary, of both orders of bytes; rows are named by another file."""
    elements, about = bar(**SMALL), element_texts.OP4[case]
    files = element_texts.op4(tmp_path, elements, **about)
    keys = calculix.read_directions(tmp_path / "arm.dof")
    matrices = op4.read_matrices(tmp_path / "arm.op4", keys, Selection(tmp_path / "arm.op4"))
    assert matrices.keys() == {"K", "M"}
    for name, matrix in (("K", elements.K), ("M", elements.M)):
        found = matrices[name]
        rows, columns = (np.searchsorted(keys, x) for x in (found.rows, found.columns))
        again = coo_array((found.entries, (rows, columns)), shape=matrix.shape).toarray()
        exact = matrix.toarray()
        assert np.abs(again - exact).max() <= (1e-7 if "kind" in about else 1e-16) * np.abs(exact).max()
    if not about:
        found = reduce_files([*files[:1], *files[1:]], BY_PLANES)
        assert found.frequencies == pytest.approx(reduce(elements).frequencies, rel=1e-9)


OF_OUTPUT4 = (  # what is changed in a text, and what is said
    ("1P,3E23.16", "3E23.16", r"arm\.op4, line 1: got .*; allowed: columns, rows, form, type, name and format"),
    (
        "       6       2KAAX",
        "       6       3KAAX",
        r"line 1: KAAX has 48 rows, 48 columns, form 6, type 3; allowed: square",
    ),
    (
        "MAAX",
        "KXX ",
        r"arm\.op4: has the matrices 'KAAX', 'KXX', each of which may be K; allowed: .*: --matrix-name K=NAME",
    ),
    ("MAAX", "KBBX", r"files: have no M; allowed: both, .*, or --matrix-name M=NAME, one of 'KAAX', 'GOAT', 'KBBX'"),
    ("       1       1", "       1      47", r"line 2: got .* entries from row 47 on in column 1; allowed: within 48"),
    ("      49       1       1\n", "      48       1       2\n", r"arm\.op4.*line .*: got .*; allowed: .*"),
    (
        "       1       1",
        f"       1       1       1\n{1.0:23}{1.0:23}\n1.\n       2       1",
        r"line 2: got '1 words, and 2 entries behind",
    ),
    ("E+0", "E+400", r"allowed: finite numbers of 23 characters behind their row"),
)


@pytest.mark.parametrize(("old", "new", "message"), OF_OUTPUT4)
def test_wrong_files_of_output4_are_refused_with_their_line(old: str, new: str, message: str, tmp_path: Path) -> None:
    files = element_texts.op4(tmp_path, bar(**SMALL))
    path = tmp_path / "arm.op4"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    refused(InputError, message, reduce_files, files, BY_PLANES)


@pytest.mark.parametrize(
    ("names", "asked", "chosen"),
    [
        ("MES1- KXX K4XX MXX MUG1-", {}, {"K": "KXX", "M": "MXX"}),
        ("KSE K4SE MSE PSE-", {}, {"K": "KSE", "M": "MSE"}),
        ("KAAX KXX MAAX", {"K": "KXX"}, {"K": "KXX", "M": "MAAX"}),
        ("KSE KTE KUE KXX", {}, {"K": "KXX"}),
        ("KSE KTE", {"M": "KTE"}, {"K": None}),
    ],
)
def test_matrices_of_superelements_are_chosen_by_their_names(
    names: str, asked: dict[str, str], chosen: dict[str, str | None]
) -> None:
    """A minus stands behind names of such as are not square; of some names K may be either."""
    selection, words = Selection(Path("se.op4"), names=asked), names.split()
    wanted = [k for k, word in enumerate(words) if selection.wants(word.rstrip("-"), not word.endswith("-"))]
    if None in chosen.values():
        refused(InputError, "has the matrices 'KSE', 'KTE', each of which may be K", selection.chosen)
    else:
        assert {role: words[number] for role, number in selection.chosen().items()} == chosen
        assert set(selection.chosen().values()) <= set(wanted)


def test_files_of_superelements_have_more_than_two_matrices(tmp_path: Path) -> None:
    files = element_texts.op4(tmp_path, bar(**SMALL))
    path = tmp_path / "arm.op4"
    text = path.read_text().replace("GOAT", "MUG1").replace("KAAX", "KXX ").replace("MAAX", "MXX ")
    path.write_text(text + text[: text.index("       3       2")].replace("KXX ", "K4XX"))
    found = reduce_files(files, BY_PLANES)
    assert found.frequencies == pytest.approx(reduce(bar(**SMALL)).frequencies, rel=1e-9)
    stiff = reduce_files(files, BY_PLANES, matrices={"K": "k4xx", "M": "MXX"})
    assert stiff.frequencies == pytest.approx(found.frequencies, rel=1e-12)
    for matrices, message in (
        ({"K": "KYY"}, "matrices: no file has 'KYY'; allowed: 'KXX', 'MUG1', 'MXX', 'K4XX'"),
        ({"L": "KXX"}, "matrices: got 'L' of 'KXX'; allowed: names by K, M"),
    ):
        refused(InputError, message, reduce_files, files, BY_PLANES, matrices=matrices)
    sti = element_texts.calculix(tmp_path, bar(**SMALL))
    message = r"matrices: no file has 'KXX'; allowed: names of matrices in \.op4, \.pch and \.bdf files"
    refused(InputError, message, reduce_files, sti, BY_PLANES, matrices={"K": "KXX"})


def test_directions_of_a_node_are_turned_together(tmp_path: Path) -> None:
    files = element_texts.nastran_systems(tmp_path, beam())
    text = (tmp_path / "arm.pch").read_text().split("\n")
    rows = [line for line in text if f"{2:16d}{6:16d}" not in line]  # node 2 has no rotation about its z
    (tmp_path / "arm.pch").write_text("\n".join(rows))
    message = r"nodes: node 2 has a rotation in a coordinate system of its own \(CD\), and not all three; allowed: all"
    refused(InputError, message, reduce_files, files, LinkSets("1", node={"tip": "11"}))


@pytest.mark.parametrize("case", ["text", "binary", "big binary strings"])
def test_cut_files_of_output4_are_refused(case: str, tmp_path: Path) -> None:
    """Wherever a file ends, and whatever a byte of it becomes: a link, or an InputError."""
    files = element_texts.op4(tmp_path, bar(counts=(1, 1, 1), count=0), **element_texts.OP4[case])
    path, keys = tmp_path / "arm.op4", calculix.read_directions(tmp_path / "arm.dof")
    data, rng = path.read_bytes(), np.random.default_rng(3)
    for end in rng.integers(1, len(data) - 40, size=20):
        path.write_bytes(data[:end])
        refused(InputError, r"arm\.op4", op4.read_matrices, path, keys, Selection(path))
    for at in rng.integers(0, len(data), size=100):
        path.write_bytes(data[:at] + bytes([int(rng.integers(256))]) + data[at + 1 :])
        with suppress(InputError):
            assert op4.read_matrices(path, keys, Selection(path))
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"arm\.op4.*GOAT has 2 rows, 3 columns, form 2, type 4; allowed: square"):
        reduce_files(files, BY_PLANES, matrices={"K": "goat"})
    (tmp_path / "arm.dof").write_text("1.1\n1.2\n")
    with pytest.raises(InputError, match=r"KAAX has 24 rows, and 2 have names; allowed: a \.dof or \.mapping"):
        reduce_files(files, BY_PLANES)
    with pytest.raises(InputError, match=r"arm\.op4: has no names of its rows; allowed: with a \.mapping or a \.dof"):
        reduce_files([path, files[2]], BY_PLANES)


def test_files_of_output4_with_long_words_are_refused(tmp_path: Path) -> None:
    (tmp_path / "arm.op4").write_bytes(
        np.array([48], dtype="<i4").tobytes() + bytes(48) + np.array([48], "<i4").tobytes()
    )
    with pytest.raises(InputError, match=r"byte 0: has words of 64 bits; allowed: words of 32 bits"):
        op4.read_matrices(tmp_path / "arm.op4", np.arange(3), Selection(tmp_path / "arm.op4"))


OF_SETS = (  # program, elements, sets by name or number, and how exact the program's files are
    ("calculix", bar("rbe3", **SMALL, count=2), LinkSets("clamp", mean={"tip": "FLANGE"}), 1e-9),
    ("abaqus", bar("rbe3", **SMALL, count=2), LinkSets("clamp", mean={"tip": "FLANGE"}), 1e-9),
    ("nastran", beam(), LinkSets("1", node={"tip": "11"}), 1e-7),  # its files have nine digits
    ("nastran_systems", beam(), LinkSets("1", node={"tip": "11"}), 1e-5),  # bending beside tension in each entry
    ("substructure", beam(count=3, pieces=4), LinkSets("CLAMP", node={"tip": "FLANGE"}), 1e-9),
)


@pytest.mark.parametrize(("program", "elements", "sets", "digits"), OF_SETS, ids=[case[0] for case in OF_SETS])
def test_sets_are_known_by_name_or_number(
    program: str, elements: FiniteElements, sets: LinkSets, digits: float, tmp_path: Path
) -> None:
    """Of solids and of nodes with rotations; a substructure is a reduced model."""
    found = reduce_files(getattr(element_texts, program)(tmp_path, elements), sets, modes=elements.count)
    assert found.frequencies == pytest.approx(reduce(elements).frequencies, rel=digits)
    assert program != "substructure" or any("reduced model" in note for note in found.notes())


@pytest.mark.parametrize(
    ("units", "length", "mass"), [("mm", 1e-3, 1e3), ("mm-kg-s", 1e-3, 1.0), ("inch-lbf-s", 0.0254, 175.12683524647637)]
)
def test_other_units_become_si(units: str, length: float, mass: float, tmp_path: Path) -> None:
    """The same beam in other units: rotations keep their unit, entries by their directions do not."""
    elements = beam()
    scale = np.where(elements.dofs[:, 1] > 2, 1.0 / length, 1.0)
    by_row = np.outer(scale, scale) / mass
    in_mm = replace(
        elements,
        nodes=elements.nodes / length,
        K=elements.K.multiply(by_row).tocsr(),
        M=elements.M.multiply(by_row).tocsr(),
    )
    files = element_texts.calculix(tmp_path, in_mm)
    found, expected = reduce_files(files, LinkSets("1", node={"tip": "11"}), modes=4, units=units), reduce(elements)
    assert found.frequencies == pytest.approx(expected.frequencies, rel=1e-9)
    assert pytest.approx(expected.H00, rel=1e-9, abs=1e-12) == found.H00
    assert found.interface_places[0] == pytest.approx([0.8, 0.0, 0.0])


def test_points_of_nastran_are_amplitudes(tmp_path: Path) -> None:
    """A free beam reduced to its ends and two modes: SPOINTs carry the amplitudes."""
    elements = beam(pieces=6)
    ends, inner = np.r_[0:6, 36:42], np.arange(6, 36)
    K, M = elements.K.toarray(), elements.M.toarray()
    from scipy.linalg import eigh

    T = np.zeros((42, 14))
    T[ends, :12] = np.eye(12)
    T[inner, :12] = -np.linalg.solve(K[np.ix_(inner, inner)], K[np.ix_(inner, ends)])
    T[inner, 12:] = eigh(K[np.ix_(inner, inner)], M[np.ix_(inner, inner)])[1][:, :2]
    lines = []
    for name, matrix in (("K", T.T @ K @ T), ("M", T.T @ M @ T)):
        lines.append(f"DMIG,{name},0,6,2")
        rows = [(1, k + 1) for k in range(6)] + [(2, k + 1) for k in range(6)] + [(101, 0), (102, 0)]
        for j, column in enumerate(rows):
            lines.append(f"DMIG*,{name},{column[0]},{column[1]}")
            lines += [f"*,{a},{b},{float(matrix[i, j])!r}" for i, (a, b) in enumerate(rows[: j + 1]) if matrix[i, j]]
    (tmp_path / "arm.pch").write_text("\n".join([*lines, "GRID,1,,0.,0.,0.", "GRID,2,,.8,0.,0."]))
    found = reduce_files([tmp_path / "arm.pch"], LinkSets("1", node={"tip": "2"}), modes=2)
    kept = T[:, 6:]
    squares = eigh(kept.T @ K @ kept, kept.T @ M @ kept, eigvals_only=True)
    assert (2.0 * np.pi * found.frequencies) ** 2 == pytest.approx(squares, rel=1e-8)
    assert any("reduced model" in note for note in found.notes())


CHANGES = (  # program, file, line, what it becomes, and the message; a colon stands behind file and line
    ("calculix", "arm.sti", 3, "4 4", ": got '4 4'; allowed: 3 finite numbers, row, column, entry"),
    ("calculix", "arm.sti", 3, "1 900 2.0", "arm.sti: got column 900; allowed: 1 to 48"),
    ("calculix", "arm.mas", 2, "1 2 nan", ": got '1 2 nan'"),
    ("calculix", "arm.dof", 5, "7", ": got '7'; allowed: node.direction"),
    ("calculix", "arm.dof", 5, "2.9", "arm.dof: got direction 9 of node 2; allowed: 1 to 6"),
    ("calculix", "arm.inp", 4, "1, a, b", ": got '1, a, b'; allowed: a node, x, y and z"),
    ("calculix", "arm.inp", 2, "*NODE, SYSTEM=C", ": got '*NODE, SYSTEM=C'; allowed: nodes by *NODE alone"),
    ("calculix", "arm.inp", 20, "NOTHING", ": got"),
    ("abaqus", "arm_STIF2.mtx", 1, "1,1, 1, 5.0", "may be K or M|arm_STIF2.mtx"),
    ("abaqus", "arm_STIF2.mtx", 2, "1,1, 1,1, x", ": got '1,1, 1,1, x'; allowed: 5 finite numbers"),
    ("abaqus", "arm_STIF2.mtx", 2, "-5,1, 1,1, 2.0", "got node -5; allowed: numbers of nodes from 1 on"),
    ("abaqus", "arm_STIF2.mtx", 2, "99,1, 1,1, 2.0", "node 99, direction 1 has no place among the 16 nodes"),
    ("market", "k.mmf", 1, "%%MatrixMarket matrix array real general", ": got .*; allowed: a header"),
    ("market", "k.mmf", 3, "48 47 900", ": got '48 47 900'; allowed: a square matrix"),
    ("market", "k.mmf", 3, "48 48 3", "k.mmf: has .* entries; allowed: 3, as line 3 says"),
    ("market", "arm.mapping", 4, "4 1 UX", ": got '4 1 UX'; allowed: row 3 next"),
    ("market", "arm.mapping", 4, "temperature", ": got 'temperature'; allowed: row, node and one of UX"),
    ("market", "arm.csv", 1, "n,x,y,z", ": got 'n,x,y,z'; allowed: a header node,x,y,z"),
    ("harwell_boeing", "STIFF.matrix", 3, "CUA 1 1 1 0", ": got 'CUA 1 1 1 0'; allowed: a kind RSA or RUA"),
    ("harwell_boeing", "STIFF.matrix", 5, "       2" * 10, "STIFF.matrix: got pointers 2 to"),
    ("harwell_boeing", "STIFF.matrix", 4, "free", ": got 'free'; allowed: formats"),
    ("nastran", "arm.pch", 2, "DMIG    KAAX           0       9       2", ": got 'form 9, type 2'; allowed: form 6"),
    ("nastran", "arm.pch", 4, f"*       {1:16d}{1:16d}{'what':>16}", "line 3: got 'what'; allowed: a finite number"),
    ("nastran", "arm.bdf", 4, "GRID,2,7,0.,0.,0.", ": got 'CP = 7'; allowed: 0 or nothing, or a system of a CORD1R"),
    ("nastran", "arm.bdf", 4, "GRID,2,,0.,0.,0.,-1", ": got 'CD = -1'; allowed: 0 or nothing, or a system of a CORD1R"),
    ("nastran_systems", "arm.bdf", 5, "CORD1S,7,900,901,999", ": got 'node 999'; allowed: nodes of GRID entries"),
    ("nastran_systems", "arm.bdf", 5, "CORD1S,7,900,901,901", ": got 'system 7, its points in a line'; allowed: three"),
    ("nastran_systems", "arm.bdf", 5, "CORD2R,7,9", ": got 'system 9'; allowed: 0, or a system of a CORD1R"),
    ("nastran_systems", "arm.bdf", 5, "CORD2R,7,7,,,,,,1.,1.", ": got 'system 7, which refers to itself'; allowed"),
    ("nastran_systems", "arm.bdf", 5, "CORD2R,5", "arm.bdf, line 6: got 'system 5'; allowed: numbers from 1 on, once"),
    ("nastran", "arm.bdf", 4, "GRID,2,,a,0.,0.", ": got 'a, 0., 0.'; allowed: three finite numbers"),
)


@pytest.mark.parametrize(("program", "file", "line", "text", "message"), CHANGES)
def test_a_wrong_line_is_refused_with_its_number(
    program: str, file: str, line: int, text: str, message: str, tmp_path: Path
) -> None:
    files = element_texts.PROGRAMS[program](tmp_path, bar(**SMALL))
    lines = (tmp_path / file).read_text().split("\n")
    lines[line - 1] = text
    (tmp_path / file).write_text("\n".join(lines))
    whole = f"{file}, line {line}{message}" if message.startswith(":") else message
    refused(InputError, whole.replace("(", r"\(").replace("*NODE", r"\*NODE"), reduce_files, files, BY_PLANES)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(1, 8))])
@pytest.mark.parametrize("program", [*element_texts.PROGRAMS, "substructure"])
def test_random_changes_are_read_or_refused(program: str, seed: int, tmp_path: Path) -> None:
    """Whatever a text has, the answer is a link or an InputError."""
    write = getattr(element_texts, program)
    files = write(tmp_path, bar(counts=(1, 1, 1), count=0))
    rng = np.random.default_rng(seed)
    paths = [Path(file.rpartition("=")[2]) for file in files]
    texts = {path: path.read_text() for path in paths}
    words = [
        "",
        "nan",
        "1e400",
        "-1",
        "*",
        "**",
        ",",
        "0",
        "999999999999999999",
        "*MATRIX,TYPE=MASS",
        "\x00",
        "K",
        "1.5",
        "%",
    ]
    count = 0
    for _ in range(60):
        path = paths[int(rng.integers(len(paths)))]
        text = texts[path]
        at = int(rng.integers(len(text)))
        kind = int(rng.integers(3))
        word = words[int(rng.integers(len(words)))]
        changed = (text[:at], text[:at] + word + text[at + 3 :], text[:at] + text[at + int(rng.integers(200)) :])[kind]
        path.write_text(changed)
        try:
            reduce_files(files, BY_PLANES, modes=0)
        except InputError:
            count += 1
        path.write_text(text)
    assert count > 5


def test_files_that_do_not_belong_together_are_refused(tmp_path: Path) -> None:
    files = element_texts.calculix(tmp_path, bar(**SMALL))
    sti, mas, dof, inp = files
    for given, message in (
        ([sti, dof, inp], "files: have no M; allowed: both"),
        ([sti, mas, inp], "arm.sti: has no names of its rows; allowed: with a .mapping or a .dof"),
        ([sti, mas, dof], "nodes: no file has them"),
        ([*files, f"K={mas}"], "is K, as is"),
        ([*files, str(tmp_path / "arm.xyz")], "arm.xyz; allowed: .npz"),
        ([*files, str(tmp_path / "arm.op4")], "arm.op4: cannot be read"),
        ([*files, str(tmp_path / "arm.npz")], "got 5 with a .npz among them"),
        ([str(tmp_path / "none.sti"), mas, dof, inp], "none.sti: cannot be read"),
        ([str(tmp_path / "some.mtx"), mas, dof, inp], "cannot be read"),
    ):
        refused(InputError, message.replace("(", r"\("), reduce_files, given, BY_PLANES)
    for sets, message in (
        (
            LinkSets("x=0.1", rigid={"tip": "x=1"}),
            "root: got 'x=0.1' of nodes from x = 0 to 1; allowed: a plane with nodes",
        ),
        (LinkSets("x=1.2.3", rigid={"tip": "x=1"}), "root: got 'x=1.2.3'; allowed: numbers of nodes"),
        (LinkSets("x=0", rigid={"tip": "900-901"}), "tip: got '900-901'; allowed: first-last, up to node 16"),
        (LinkSets("x=0", rigid={"tip": "WRIST"}), "tip: got 'WRIST'; allowed: numbers .*; sets: ALL, CLAMP, FLANGE"),
        (LinkSets("x=0", rigid={"tip": "x=1@1,2"}), "tip: got the place '1,2'; allowed: three numbers"),
        (LinkSets("x=0", rigid={"2nd": "x=1"}), "interface_names: got '2nd'; allowed: an identifier"),
        (LinkSets("x=0", rigid={"tip": "x=1", "end": "16"}), "node 16 is in tip and in end; allowed: in one rigid set"),
    ):
        refused(InputError, message, reduce_files, files, sets)
    refused(InputError, "units: got 'inch'; allowed: m, mm", reduce_files, files, BY_PLANES, units="inch")
    refused(InputError, r"stress: got 'body.q.x'; allowed: ", reduce_files, files, BY_PLANES, stress={"body.q.x": sti})
    with pytest.raises(InputError, match=r"stress: lacks body.x.y.*; allowed: none, or all 15 load cases"):
        reduce_files(files, BY_PLANES, stress={"body.x.x": sti})


def test_texts_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = element_texts.calculix(tmp_path, bar(**SMALL))
    monkeypatch.setenv("EOMGEN_MATRIX_MB", "1")
    with (tmp_path / "arm.sti").open("a") as stream:
        stream.write("1 1 0.0\n" * 140_000)
    refused(InputError, r"arm.sti: cannot be read: .*EOMGEN_MATRIX_MB", reduce_files, files, BY_PLANES)
    monkeypatch.setenv("EOMGEN_MATRIX_MB", "64")
    monkeypatch.setattr("eomgen.bending.readers.text.MOST_ENTRIES", 1000)
    refused(InputError, r"arm.sti: got more than 1000 lines of row, column, entry", reduce_files, files, BY_PLANES)
    (tmp_path / "arm.sti").write_text("1" * 5000)
    refused(InputError, r"arm.sti, line 1: has more than 4096 bytes", reduce_files, files, BY_PLANES)
    element_texts.op4(tmp_path, bar(**SMALL))
    keys = calculix.read_directions(tmp_path / "arm.dof")
    path = tmp_path / "arm.op4"
    monkeypatch.setattr("eomgen.bending.readers.selection.MOST_MATRICES", 2)
    refused(InputError, r"arm.op4: has more than 2 matrices", op4.read_matrices, path, keys, Selection(path))
    element_texts.substructure(tmp_path, bar(**SMALL))
    monkeypatch.setattr("eomgen.bending.readers.abaqus._MOST_TRIANGLE", 50)
    refused(InputError, r"arm.mtx, line .*: got 'more than 50 entr", abaqus.read_substructure, tmp_path / "arm.mtx")
    monkeypatch.setattr("eomgen.bending.readers.abaqus.MOST_NODES", 5)
    refused(InputError, "more than 5 nodes", reduce_files, files[::-1], BY_PLANES)


GENERATED = "".join(f"*NSET, NSET=S{k}, GENERATE\n1, 100000\n" for k in range(21))
OF_EACH_OTHER = "*NSET, NSET=B\nA\n" + "*NSET, NSET=A\nB\n*NSET, NSET=B\nA\n" * 20


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("*NSET, NSET=A\n" + "A, A, A, A\n" * 100, ""),
        ("*NSET, NSET=B, GENERATE\n1, 1000000000\n", "line 4: got '2 sets of 1000000001 nodes'; allowed: up to 10000"),
        (GENERATED, "line 42: got '21 sets of 2000001 nodes'; allowed: up to 10000 sets, and 2000000 nodes of all"),
        (OF_EACH_OTHER, "line .*: got '2 sets of .* nodes'; allowed: up to 10000 sets"),
        ("".join(f"*NSET, NSET=S{k}\n1\n" for k in range(10_000)), "got '10001 sets of 10001 nodes'"),
    ],
)
def test_sets_are_counted_before_they_are_made(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "arm.inp").write_text(f"*NODE, NSET=A\n1, 0., 0., 0.\n{text}")
    if message:
        refused(InputError, rf"arm\.inp, .*{message}", abaqus.read_nodes, tmp_path / "arm.inp")
    else:
        assert abaqus.read_nodes(tmp_path / "arm.inp").sets["A"].tolist() == [1]


def test_numbers_of_nodes_are_not_listed_before_they_are_known(tmp_path: Path) -> None:
    files = element_texts.calculix(tmp_path, bar(**SMALL))
    with (tmp_path / "arm.inp").open("a") as stream:
        stream.write("*NODE\n900000000000000, 0., 0., 0.\n")
    message = "root: there is no node 17; allowed: nodes of the files"
    refused(InputError, message, reduce_files, files, LinkSets("3-900000000000000", rigid={"tip": "x=1"}))


FEW = {"counts": (3, 1, 1), "count": 2}


def _at(matrix: Any, row: int, column: int, add: float) -> Any:
    changed = matrix.tolil()
    changed[row, column] += add
    return changed.tocsr()


def _face(elements: FiniteElements, **about: Any) -> FiniteElements:
    return replace(elements, interfaces=(replace(elements.interfaces[0], **about),))


def _in_two(elements: FiniteElements) -> FiniteElements:
    """Return a bar and a second one that nothing holds."""
    n = len(elements.nodes)
    dofs = np.vstack([elements.dofs, elements.dofs + [n, 0]])
    both = {name: csr_array(block_diag([getattr(elements, name)] * 2)) for name in ("M", "K")}
    return replace(elements, nodes=np.vstack([elements.nodes] * 2), dofs=dofs, labels=np.arange(1, 2 * n + 1), **both)


def _clamped(elements: FiniteElements) -> FiniteElements:
    """Return matrices of a model that was written with its root held."""
    kept = np.flatnonzero(~np.isin(elements.dofs[:, 0], elements.root))
    small = {name: getattr(elements, name)[kept][:, kept] for name in ("M", "K")}
    return replace(elements, dofs=elements.dofs[kept], root=np.array([], dtype=np.intp), **small)


WRONG: dict[str, tuple[Callable[[FiniteElements], FiniteElements], str]] = {
    "unsymmetric": (
        lambda e: replace(e, K=_at(e.K, 7, 3, 1e5)),
        r"K: got .* between \(node 3, y\) and \(node 2, x\)|K: got .* between \(node 2, x\) and \(node 3, y\)",
    ),
    "springs to ground": (
        lambda e: replace(e, K=_at(e.K, 22, 22, 1e7)),
        r"K: got the translation along y by 1 m is resisted by 1e\+07 N at node 8, y, .* of the greatest sum of terms; "
        r"allowed: up to 1e-06",
    ),
    "nodes elsewhere": (
        lambda e: replace(e, nodes=e.nodes * [1.0, 2.0, 1.0]),
        "K: got the rotation about . by 1 rad is resisted by .* N at node",
    ),
    "held where it was written": (
        _clamped,
        r"K: got the translation along x by 1 m is resisted by .* at node",
    ),
    "negative mass": (
        lambda e: replace(e, M=_at(e.M, 4, 4, -1e3)),
        r"M: got -.* on the diagonal at node 2, y; allowed: 0 or",
    ),
    "masses by direction": (
        lambda e: replace(e, M=_at(e.M, 4, 4, 0.1)),
        "M: has masses of 12 kg along x, 12.1 kg along y, 12 kg along z; allowed: the same",
    ),
    "masses that couple root and tip": (
        lambda e: replace(e, M=_at(_at(e.M, 10, 47, 1e4), 47, 10, 1e4)),
        "M: has second moments of mass of -.* kg m.2 together; allowed: 0 or more",
    ),
    "no masses": (lambda e: replace(e, M=e.M * 0.0), "M: all entries are 0"),
    "in two pieces": (
        _in_two,
        r"K, clamped: its pivot at node [0-9]+, . is .* of its diagonal; allowed|K, clamped: is singular",
    ),
    "root in a line": (
        lambda e: replace(e, root=e.root[:2]),
        "root: its displacements have rank 5 and leave the rotation about . open; allowed: rank 6",
    ),
    "interface of one node of solids": (
        lambda e: _face(e, kind="node", nodes=e.interfaces[0].nodes[:1]),
        "interface tip: its displacements have rank 3 and leave the rotation about . open; allowed: rank 6",
    ),
    "mean of a line": (
        lambda e: _face(e, kind="rbe3", nodes=e.interfaces[0].nodes[:2]),
        "interface tip: its displacements have rank 5",
    ),
    "interface at the root": (
        lambda e: _face(e, kind="rbe3", nodes=e.root),
        "interface tip: its flexibility along x is 0; allowed: above 0",
    ),
    "twice the same interface": (
        lambda e: replace(
            e, interfaces=tuple(replace(e.interfaces[0], kind="rbe3", name=name) for name in ("tip", "end"))
        ),
        "interfaces tip, end: their flexibility, scaled, has the eigenvalue .*; allowed: above 1e-12",
    ),
    "too many modes": (
        lambda e: replace(e, count=100),
        "count: got 100 modes; allowed: up to 24, as there are so many",
    ),
    "more modes than any": (lambda e: replace(e, count=1000), "count: got 1000; allowed: 0 to 194 modes beside"),
    "nothing to do": (lambda e: replace(e, interfaces=(), count=0), "count: got 0 modes and no interface"),
    "unknown kind": (lambda e: _face(e, kind="glue"), "interface tip: got the kind 'glue'; allowed: node, rbe2, rbe3"),
    "several nodes as one": (
        lambda e: _face(e, kind="node"),
        "interface tip: got 4 nodes; allowed: one for the kind node",
    ),
    "name of the root": (
        lambda e: _face(e, name="root"),
        "interface_names: got 'root'; allowed: an identifier other than",
    ),
    "no finite place": (lambda e: _face(e, place=np.array([np.nan, 0, 0])), "interface tip: got the place"),
    "place in other units": (
        lambda e: _face(e, place=np.array([1000.0, 0.0, 0.0])),
        "interface tip: its place is 999 m from its nodes, the link has 1 m; allowed: 100 times that",
    ),
    "one weight that counts": (
        lambda e: _face(e, kind="rbe3", weights=np.array([1.0, 1e-20, 1e-20, 1e-20])),
        "interface tip: its displacements have rank 3",
    ),
    "no positive weight": (
        lambda e: _face(e, kind="rbe3", weights=np.zeros(4)),
        "interface tip: allowed: a positive weight",
    ),
    "no finite node": (
        lambda e: replace(e, nodes=np.where(e.nodes == 0.05, np.inf, e.nodes)),
        "nodes: got inf as y of node 3; allowed: numbers up to",
    ),
    "a translation is missing": (
        lambda e: replace(e, dofs=e.dofs[:-1], M=e.M[:-1][:, :-1], K=e.K[:-1][:, :-1]),
        "dofs: node 16 has no coordinate z; allowed: x, y and z of each node",
    ),
    "a coordinate twice": (
        lambda e: replace(e, dofs=np.vstack([e.dofs[:-1], e.dofs[:1]])),
        "dofs: node 1, x is there twice; allowed: once",
    ),
    "direction that is none": (
        lambda e: replace(e, dofs=np.where(e.dofs == 2, 7, e.dofs)),
        "dofs: got node|dofs: got direction 7 in row 2; allowed: 0 .x., 1 .y.",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_link_is_refused(name: str) -> None:
    change, message = WRONG[name]
    refused(InputError, message, reduce, change(bar(**FEW)))


def test_large_links_are_refused_without_copies_of_their_factors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("eomgen.bending.reduction.MOST_PIVOTS", 0)
    assert reduce(bar(**FEW)).mass == pytest.approx(12.0)
    loose = _in_two(bar(**FEW))
    n = loose.K.shape[0] // 2
    spring = 1e-9 * csr_array(np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(n)))  # between nodes at the same places
    with pytest.raises(InputError, match=r"K, clamped: a load moves node (1[7-9]|2[0-9]|3[0-2]), . as if it had"):
        reduce(replace(loose, K=loose.K + spring))


def test_what_is_asked_of_a_free_link_only_or_of_a_clamped_one() -> None:
    free = bar(clamped=False, **FEW)
    refused(InputError, "root: has no node, and Craig-Bampton modes are asked for", reduce, free, craig_bampton=True)
    massless = replace(beam(lumped=True, count=40, pieces=3))
    keep = massless.dofs[:, 1] < 3
    massless = replace(massless, M=massless.M.multiply(np.outer(keep, keep)).tocsr(), count=12)
    refused(InputError, "count: got 12 modes; allowed: up to 6, as so many have a mass", reduce, massless)


def test_what_leaves_no_node_free_or_has_no_rows_is_refused(tmp_path: Path) -> None:
    link = bar(**FEW)
    every = np.arange(len(link.nodes))
    free = replace(link, root=every[:0], interfaces=(Interface("tip", "rbe2", every, link.nodes.mean(axis=0)),))
    for whole in (replace(link, root=every, interfaces=()), free):
        refused(InputError, "^root: with rigid interfaces it has all nodes; allowed: ", reduce, whole)
    np.savez(tmp_path / "link.npz", **{**arrays_of(link), "dofs": np.array(3)})
    refused(InputError, r"array 'dofs': has shape \(\); allowed: ", read_link, tmp_path / "link.npz")


def test_files_of_finite_elements_hold_what_they_were_written_from(tmp_path: Path) -> None:
    elements = bar("rbe3", counts=(3, 1, 1))
    elements = replace(elements, interfaces=(replace(elements.interfaces[0], weights=np.array([1.0, 2.0, 1.0, 2.0])),))
    path = tmp_path / "bar.npz"
    np.savez(path, **arrays_of(elements))
    found = read_elements(path)
    assert has_elements(arrays_of(elements))
    for name in ("nodes", "dofs", "root", "count", "reduced"):
        assert np.array_equal(getattr(found, name), getattr(elements, name))
    assert (found.K != elements.K).nnz == 0
    assert np.array_equal(found.interfaces[0].weights, elements.interfaces[0].weights)
    weighted = reduce_files([path], modes=2)
    assert weighted.frequencies != pytest.approx(reduce(bar("rbe3", counts=(3, 1, 1), count=2)).frequencies, rel=1e-6)
    link = weighted.save(tmp_path / "modes.npz")
    arrays = np.load(link)
    assert arrays["H0"].shape == (8, 4, 3)
    assert arrays["interface_names"].tolist() == ["tip"]
    assert arrays["interface_Phi"].shape == (1, 6, 8)
    body = read_link(link)
    assert body.modes.conflict() is None
    assert not body.is_free
    assert np.array_equal(np.array(body.modes.K), weighted.K)
    assert np.array_equal(np.array(body.modes.nodes[0].Phi), weighted.interface_Phi[0])
    free = reduce(bar(clamped=False, counts=(3, 1, 1), count=2)).save(tmp_path / "free.npz")
    assert read_link(free).is_free
    refused(InputError, r"got sets beside a .npz; allowed: none", reduce_files, [path], LinkSets("x=0"), units="mm")


ARRAYS: dict[str, tuple[dict[str, Any], str]] = {
    "missing": ({"K_row": None}, "array 'K_row' is missing; allowed: a file of finite elements has it"),
    "no integers": ({"dofs": np.zeros((48, 2))}, "array 'dofs': has dtype float64; allowed: integers"),
    "shape": ({"nodes": np.zeros((16, 2))}, r"array 'nodes': has shape \(16, 2\); allowed: \(n, 3\)"),
    "outside": ({"M_row": np.full(9, 90), "M_col": np.zeros(9, int), "M_data": np.ones(9)}, "M: entry 1 has row 90"),
    "lengths": ({"M_row": np.zeros(3, int)}, "M: got 3 rows, .* columns"),
    "no number": (
        {"K_data": np.full(9, np.nan), "K_row": np.zeros(9, int), "K_col": np.zeros(9, int)},
        "K: got nan at row 0",
    ),
    "counts": ({"interface_counts": np.array([9])}, "interface_nodes: has 4 nodes; allowed: 9, the sum of"),
    "kinds": ({"interface_kinds": np.array(["rbe2", "rbe3"])}, "interface_kinds: has 2 entries; allowed: 1"),
    "members": ({"interface_nodes": np.array([0, 1, 2, 99])}, "interface_nodes: got 0 to 99; allowed: 0 to 15"),
    "root": ({"root": np.array([0, 99])}, "root: got a node 0 or 99; allowed: 0 to 15"),
    "many interfaces": ({"interface_names": np.full(10**5, "a")}, "'interface_names': has 100000 entries; .* up to 33"),
    "many cases": ({"stress_names": np.full(10**5, "a")}, "'stress_names': has 100000 entries; allowed: up to 15"),
    "many rows": ({"dofs": np.zeros((300_001, 2), dtype=bool)}, "'dofs': has 300001 entries; allowed: up to 300000"),
    "cases": (
        {"stress_names": np.array(["a"]), **{f"stress_{k}": np.array([4]) for k in ("case", "row", "col", "data")}},
        "stress_case: got 4 to 4; allowed: 0 to 0",
    ),
}


@pytest.mark.parametrize("name", ARRAYS)
def test_wrong_arrays_are_refused_by_name(name: str) -> None:
    changes, message = ARRAYS[name]
    arrays = {**arrays_of(bar(counts=(3, 1, 1))), **changes}
    refused(InputError, message, elements_of, {key: array for key, array in arrays.items() if array is not None})


def test_one_triangle_is_as_good_as_both() -> None:
    elements = bar(counts=(3, 1, 1))
    arrays = arrays_of(elements)
    for name in ("K", "M"):
        lower = arrays[f"{name}_row"] >= arrays[f"{name}_col"]
        arrays |= {f"{name}_{part}": arrays[f"{name}_{part}"][lower] for part in ("row", "col", "data")}
    assert abs(elements_of(arrays).K - elements.K).max() <= 1e-9 * abs(elements.K).max()


def test_models_beyond_memory_are_refused_by_size(monkeypatch: pytest.MonkeyPatch) -> None:
    elements = bar(counts=(3, 1, 1))
    many = {**arrays_of(elements), "nodes": np.zeros((1_000_000, 3))}
    refused(InputError, "nodes: got 1000000 nodes; allowed: 1 to 50000", elements_of, many)
    monkeypatch.setattr("eomgen.bending.finite_elements.MOST_ENTRIES", 100)
    refused(InputError, r"M: has .* entries; allowed: up to 100", elements_of, arrays_of(elements))


def test_interfaces_are_values() -> None:
    face = Interface("tip", "rbe2", np.array([1]), np.zeros(3))
    assert face.weights is None


def _changed(array: np.ndarray, rng: np.random.Generator) -> Any:
    """Return an array that is wrong in some way, or None for none at all."""
    values = [0, -1, 1, 2**40, np.nan, np.inf, -1e300, 1e300, 1e-300, 3.5]
    kind = int(rng.integers(6))
    if kind == 0 or array.size == 0:
        return None
    if kind == 1:
        return array.ravel()[: int(rng.integers(array.size))]
    if kind == 2:
        return np.array(["rbe3", "tip"])[: int(rng.integers(3))]
    if kind == 3 and array.dtype.kind in "iuf":
        return array * float(rng.choice([-1.0, 0.0, 1e-9, 1e12]))
    if array.dtype.kind == "U":
        return np.array([rng.choice(["node", "rbe2", "rbe3", "", "root", "a b", "\x1b"])] * array.size)
    changed = array.astype(float if kind == 4 else array.dtype).copy()
    with np.errstate(invalid="ignore", over="ignore"):
        changed.flat[int(rng.integers(array.size))] = np.array(values[int(rng.integers(len(values)))]).astype(
            changed.dtype
        )
    return changed


@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(4, 40))])
def test_random_changes_of_arrays_are_reduced_or_refused(seed: int) -> None:
    rng = np.random.default_rng(seed)
    elements = bar(("rbe2", "rbe3")[seed % 2], counts=(2, 1, 1), count=2, clamped=seed != 3)
    arrays, count = arrays_of(elements), 0
    for _ in range(60):
        changed = dict(arrays)
        for name in rng.choice(list(arrays), size=int(rng.integers(1, 3)), replace=False):
            changed[name] = _changed(arrays[name], rng)
        try:
            reduce(elements_of({name: array for name, array in changed.items() if array is not None}))
        except InputError as error:
            count += str(error).count("allowed") > 0
    assert count > 30
