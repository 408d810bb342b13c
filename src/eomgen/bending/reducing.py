"""Files of finite elements -> a reduced link: which file is what, units, sets of nodes, interfaces."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array, Index
from ..errors import InputError
from ..files import as_path
from ..identifiers import check_kind, plain_path
from ..names import listed, nearest_or_all, show
from ..progress import StageReport, no_report
from ..robot.value import Placement
from .element_files import COUNT, read_elements
from .finite_elements import FiniteElements, Interface, checked, stress_cases
from .readers import abaqus, ansys, calculix, nastran, op4
from .readers import nodes as node_files
from .readers.contents import Entries, Labels, Nodes, assembled, is_point, merged
from .readers.selection import Selection
from .readers.text import lines_of
from .reduced_link import ReducedLink
from .reduction import reduce
from .units import SI, UNITS, in_si

ROLES = ("K", "M", "nodes", "map")
NASTRAN = (".pch", ".bdf", ".dat", ".nas")
MATRICES = (".mtx", ".mmf", ".matrix", ".hb", ".rb", ".txt")
KINDS = {
    ".npz": "finite elements of eomgen",
    ".sti, .mas, .dof": "CalculiX",
    ".mtx, .inp": "Abaqus",
    ".mmf, .hb, .matrix, .mapping": "Ansys",
    ".pch, .bdf, .op4": "Nastran",
    ".csv": "node,x,y,z",
}
_PLANE = re.compile(r"([xyz])=([+-]?(?:[0-9]{1,20}\.?[0-9]{0,20}|\.[0-9]{1,20})(?:[eE][+-]?[0-9]{1,2})?)")
_RANGES = re.compile(r"[0-9]{1,15}(-[0-9]{1,15})?(,[0-9]{1,15}(-[0-9]{1,15})?)*")
_SHOWN = 12  # sets of a file
_ON_PLANE = 1e-6  # of the link's size
_ALLOWED = 'numbers of nodes ("1-12,40"), a plane ("x=0.5"), or the name of a set of *NSET'


@dataclass(frozen=True)
class LinkSets:
    """Sets of nodes by which a link stands and is taken hold of.

    Each set is a text: numbers of nodes ("1-12,40"), a plane ("x=0.5", in the files' units), or the name of a set that
    an input file of Abaqus or CalculiX has.  root: clamped; None: the link is free.  node, rigid, mean: interfaces by
    their names, of one node, of rigid sets (RBE2) and of mean displacements (RBE3); behind an @ the place, "x=1@1,0,0",
    in the files' units; without, the mean of the set's nodes.
    """

    root: str | None = None
    node: Mapping[str, str] = field(default_factory=dict)
    rigid: Mapping[str, str] = field(default_factory=dict)
    mean: Mapping[str, str] = field(default_factory=dict)


def reduce_files(  # noqa: PLR0913
    files: Sequence[Path | str],
    sets: LinkSets | None = None,
    *,
    modes: int | None = None,
    units: str = SI,
    stress: Mapping[str, Path | str] | None = None,
    matrices: Mapping[str, str] | None = None,
    craig_bampton: bool = False,
    placement: Placement | None = None,
    report: StageReport = no_report,
) -> ReducedLink:
    """Reduce the finite elements of a link, of one .npz or of files of a program, to modes.

    Args:
        files: a .npz as ``element_files`` has it, alone; or files with matrices and nodes.  Their endings and names say
            what they are; "K=FILE", "M=FILE", "nodes=FILE" and "map=FILE" say it where these do not.
        sets: root and interfaces; of a .npz None, as it has its own.
        modes: beside those of interfaces (6, or what a .npz says).
        units: of the files: "m" (m, kg, s, N), "mm" (mm, t, s, N), "mm-kg-s" (mm, kg, s, mN) or "inch-lbf-s" (inch,
            lbf s^2 / inch, s, lbf).
        matrices: names of matrices in files of Nastran, by "K", "M" or load case; those that it does not name are KAAX
            or MAAX, KXX or MXX, ..., or the only square one that begins with K or M, K4 left out.
        stress: files of geometric stiffness matrices by load case, all that ``stress_cases`` names or none.
        craig_bampton: whether modes stay displacements of interfaces and fixed-interface modes.
        placement: pose of the files' axes in the link's frame, m; None: they are the same.
        report: called with what is done next.

    Raises:
        InputError: a file cannot be read, is missing, or does not hold a link; the message has the place.
    """
    named = [_named(file) for file in files]
    check_kind("placement", placement, placement is None or isinstance(placement, Placement), "a Placement")
    if units not in UNITS:
        raise InputError(f"units: got {show(units)}; allowed: {', '.join(UNITS)}")
    if any(path.suffix == ".npz" for _, path in named):
        elements = in_si(
            _of_npz([path for _, path in named], report, sets=sets, stress=stress, matrices=matrices), units
        )
    else:
        contents = _Contents(_names(matrices or {}, stress or {}))
        elements = _of_program(named, LinkSets() if sets is None else sets, contents, stress or {}, report)
        elements = checked(in_si(elements, units))
    if modes is not None:
        elements = replace(elements, count=modes)
    link = reduce(elements, craig_bampton=craig_bampton, report=report)
    return link if placement is None else link.placed(placement.rotation, placement.xyz)


def _named(file: Path | str) -> tuple[str, Path]:
    """Return what a file is said to be, or "", and its path."""
    role, sign, path = str(file).partition("=")
    return (role, as_path(path, "files")) if sign and role in ROLES else ("", as_path(file, "files"))


def _names(matrices: Mapping[str, str], stress: Mapping[str, Any]) -> dict[str, str]:
    """Return names of matrices in upper case, by what they are."""
    known = ("K", "M", *stress)
    for role, name in matrices.items():
        if role not in known or not isinstance(name, str):
            raise InputError(f"matrices: got {show(role)} of {show(name)}; allowed: names by {', '.join(known)}")
    return {role: name.upper() for role, name in matrices.items()}


def _of_npz(paths: list[Path], report: StageReport, **more: Any) -> FiniteElements:
    if len(paths) > 1:
        raise InputError(f"files: got {len(paths)} with a .npz among them; allowed: a .npz alone, which has all")
    given = [name for name, value in more.items() if value]
    if given:
        raise InputError(f"files: got {', '.join(given)} beside a .npz; allowed: none, as the file has its own")
    report(f"reading {plain_path(paths[0])}")
    return read_elements(paths[0])


@dataclass
class _Contents:
    """Contents of files, as far as they are read; ``names`` of matrices are asked for by what they are."""

    names: Mapping[str, str] = field(default_factory=dict)
    selections: list[Selection] = field(default_factory=list)  # of files of Nastran
    matrices: dict[str, Entries] = field(default_factory=dict)
    nodes: list[Nodes] = field(default_factory=list)
    keys: Labels | None = None
    reduced: bool = False
    waiting: list[tuple[str, Path]] = field(default_factory=list)  # matrices whose rows a mapping names

    def take(self, name: str, entries: Entries) -> None:
        """Keep a matrix; InputError where there is one of its kind."""
        if name in self.matrices:
            other = plain_path(self.matrices[name].path)
            raise InputError(f"{plain_path(entries.path)}: is {name}, as is {other}; allowed: one of each")
        self.matrices[name] = entries

    def selection(self, path: Path, role: str) -> Selection:
        """Return which matrices of a file are read, by what it is said to be."""
        self.selections.append(Selection(path, (role,) if role else ("K", "M"), self.names, bool(role)))
        return self.selections[-1]

    def check(self) -> None:
        """Refuse names that no file has, and files without K or M."""
        seen = list(dict.fromkeys(name for selection in self.selections for name in selection.seen))
        for name in self.names.values():
            if name not in seen:
                allowed = listed(seen) if seen else "names of matrices in .op4, .pch and .bdf files"
                raise InputError(f"matrices: no file has {show(name)}; allowed: {allowed}")
        missing = [name for name in ("K", "M") if name not in self.matrices]
        if missing:
            kinds = "; ".join(f"{endings} ({program})" for endings, program in KINDS.items())
            more = f", or --matrix-name {missing[0]}=NAME, one of {listed(seen)}" if seen else ""
            allowed = f"both, in {kinds}, or as K=FILE and M=FILE{more}"
            raise InputError(f"files: have no {' and no '.join(missing)}; allowed: {allowed}")

    def take_all(self, found: Mapping[str, Entries]) -> None:
        """Keep the matrices of a file, and whether they are of a reduced model."""
        for role, entries in found.items():
            self.take(role, entries)
            self.reduced = self.reduced or bool(is_point(entries.rows).any())


def _of_program(
    named: list[tuple[str, Path]],
    sets: LinkSets,
    contents: _Contents,
    stress: Mapping[str, Path | str],
    report: StageReport,
) -> FiniteElements:
    """Read matrices and nodes of a program's files, and make finite elements of them, in their units."""
    for role, path in named:
        report(f"reading {plain_path(path)}")
        _read(role, path, contents)
    for name, file in stress.items():
        report(f"reading {plain_path(file)}")
        _read_matrix(f"stress {name}", as_path(file, "stress"), contents)
    _take_waiting(contents)
    contents.check()
    nodes = merged(contents.nodes)
    dofs, matrices = assembled(nodes, contents.matrices, contents.reduced)
    elements = FiniteElements(
        nodes.places,
        dofs,
        matrices["M"],
        matrices["K"],
        _set("root", sets.root, nodes) if sets.root is not None else np.array([], dtype=np.intp),
        _interfaces(sets, nodes),
        COUNT,
        nodes.labels.astype(np.intp),
        contents.reduced,
        {name: matrices[f"stress {name}"] for name in stress},
    )
    _check_cases(elements, stress)
    return _with_used_nodes(elements)


def _take_waiting(contents: _Contents) -> None:
    """Read the matrices whose rows another file names."""
    for name, path in contents.waiting:
        if contents.keys is None:
            raise InputError(
                f"{plain_path(path)}: has no names of its rows; allowed: with a .mapping or a .dof file beside it"
            )
        if path.suffix.lower() == ".op4":
            contents.take_all(op4.read_matrices(path, contents.keys, contents.selection(path, name)))
        else:
            contents.take(name, _by_mapping(path, contents.keys))


def _check_cases(elements: FiniteElements, stress: Mapping[str, Any]) -> None:
    cases = stress_cases(elements.interfaces)
    for name in stress:
        if name not in cases:
            raise InputError(f"stress: got {show(name)}; allowed: {nearest_or_all(name, cases)}")


def _read(role: str, path: Path, contents: _Contents) -> None:
    """Read a file into the contents, by its ending and what it is said to be."""
    ending = path.suffix.lower()
    if role == "map" or ending in (".dof", ".mapping"):
        contents.keys = ansys.read_mapping(path) if ending == ".mapping" else calculix.read_directions(path)
    elif ending == ".csv":
        contents.nodes.append(node_files.read_nodes(path))
    elif role == "nodes" or ending == ".inp":
        is_bulk = ending in NASTRAN
        contents.nodes.append(nastran.read(path, Selection(path, ()))[0] if is_bulk else abaqus.read_nodes(path))
    elif ending in NASTRAN:
        nodes, matrices = nastran.read(path, contents.selection(path, role))
        if len(nodes.labels):
            contents.nodes.append(nodes)
        contents.take_all(matrices)
    elif ending in (".sti", ".mas"):
        _read_matrix(role or {".sti": "K", ".mas": "M"}[ending], path, contents)
    elif ending == ".op4":
        contents.waiting.append((role, path))
    elif ending in MATRICES or role:
        if ending == ".mtx" and not role and abaqus.is_substructure(path):
            for name, entries in abaqus.read_substructure(path).items():
                contents.take(name, entries)
            contents.reduced = True
            return
        _read_matrix(role or _by_name(path), path, contents)
    else:
        kinds = "; ".join(f"{endings} ({program})" for endings, program in KINDS.items())
        raise InputError(f"files: {plain_path(path)}; allowed: {kinds}, or K=FILE, M=FILE, nodes=FILE, map=FILE")


def _by_name(path: Path) -> str:
    """Return K or M, as the name of a file says."""
    stem = path.stem.upper()
    kinds = [kind for kind, word in (("K", "STIF"), ("M", "MASS")) if word in stem]
    if len(kinds) != 1:
        raise InputError(
            f"files: {plain_path(path)} may be K or M; allowed: K=FILE or M=FILE, or STIF or MASS in its name"
        )
    return kinds[0]


def _read_matrix(name: str, path: Path, contents: _Contents) -> None:
    """Read a matrix that names its rows by itself, or let it wait for the file that does."""
    if path.suffix.lower() in NASTRAN:
        contents.take_all(nastran.read(path, contents.selection(path, name))[1])
    elif path.suffix.lower() in (".sti", ".mas", ".op4") or not _names_rows(path):
        contents.waiting.append((name, path))
    else:
        contents.take(name, abaqus.read_matrix(path))


def _names_rows(path: Path) -> bool:
    """Whether a matrix has nodes and directions in its lines, five numbers with commas between them."""
    for _, text in lines_of(path):
        if text.strip() and not text.startswith("*"):
            return text.count(",") >= 4
    return True


def _by_mapping(path: Path, keys: Labels) -> Entries:
    is_calculix = path.suffix.lower() in (".sti", ".mas")
    return calculix.read_matrix(path, keys) if is_calculix else ansys.read_matrix(path, keys)


def _set(name: str, text: str, nodes: Nodes) -> Index:
    """Return the rows of the nodes of a set."""
    plane = _PLANE.fullmatch(text.replace(" ", ""))
    if plane is not None:
        axis, at = "xyz".index(plane[1]), float(plane[2])
        size = float(np.ptp(nodes.places, axis=0).max(initial=0.0))
        rows = np.flatnonzero(np.abs(nodes.places[:, axis] - at) <= _ON_PLANE * size)
        if len(rows) == 0:
            lowest, highest = nodes.places[:, axis].min(), nodes.places[:, axis].max()
            got = f"{show(text)} of nodes from {plane[1]} = {lowest:g} to {highest:g}"
            raise InputError(f"{name}: got {got}; allowed: a plane with nodes on it")
        return rows
    if text.upper() in nodes.sets:
        labels = nodes.sets[text.upper()]
    elif _RANGES.fullmatch(text.replace(" ", "")):
        labels = _labels(name, text.replace(" ", ""), nodes)
    else:
        known = f"; sets: {', '.join(sorted(nodes.sets)[:_SHOWN])}" if nodes.sets else ""
        raise InputError(f"{name}: got {show(text)}; allowed: {_ALLOWED}{known}")
    at_row = np.minimum(np.searchsorted(nodes.labels, labels), len(nodes.labels) - 1)
    missing = np.flatnonzero(nodes.labels[at_row] != labels)
    if len(missing):
        raise _no_node(name, int(labels[missing[0]]))
    return at_row


def _labels(name: str, text: str, nodes: Nodes) -> Labels:
    """Return the numbers of a text "1-12,40", all of which nodes have."""
    has = np.zeros(len(nodes.labels), dtype=bool)
    for part in text.split(","):
        first, sign, last = part.partition("-")
        begin, end = int(first), int(last if sign else first)
        if end < begin or end > int(nodes.labels[-1]):
            raise InputError(f"{name}: got {show(part)}; allowed: first-last, up to node {nodes.labels[-1]}")
        row, behind = np.searchsorted(nodes.labels, [begin, end + 1]).tolist()
        if behind - row != end + 1 - begin:
            gaps = np.flatnonzero(nodes.labels[row:behind] != begin + np.arange(behind - row))
            raise _no_node(name, begin + int(gaps[0] if len(gaps) else behind - row))
        has[row:behind] = True
    return nodes.labels[has]


def _no_node(name: str, label: int) -> InputError:
    return InputError(f"{name}: there is no node {label}; allowed: nodes of the files")


def _interfaces(sets: LinkSets, nodes: Nodes) -> tuple[Interface, ...]:
    """Return the interfaces of sets, in the order node, rigid, mean."""
    faces = []
    for kind, named in (("node", sets.node), ("rbe2", sets.rigid), ("rbe3", sets.mean)):
        for name, text in named.items():
            words, sign, at = text.partition("@")
            rows = _set(name, words, nodes)
            place = _place(name, at) if sign else nodes.places[rows].mean(axis=0)
            faces.append(Interface(name, kind, rows, place))
    return tuple(faces)


def _place(name: str, text: str) -> Array:
    try:
        place = np.array([float(word) for word in text.split(",")])
    except ValueError:
        place = np.array([])
    if place.shape != (3,) or not np.all(np.isfinite(place)):
        raise InputError(f"{name}: got the place {show(text)}; allowed: three numbers, x,y,z")
    return place


def _with_used_nodes(elements: FiniteElements) -> FiniteElements:
    """Return finite elements without nodes that neither matrices nor sets have."""
    used = np.unique(
        np.concatenate(
            [elements.dofs[elements.dofs[:, 0] >= 0, 0], elements.root] + [i.nodes for i in elements.interfaces]
        )
    )
    row = np.full(len(elements.nodes) + 1, -1, dtype=np.intp)  # the last one of amplitudes
    row[used] = np.arange(len(used))
    dofs = np.column_stack([row[elements.dofs[:, 0]], elements.dofs[:, 1]])
    faces = tuple(replace(face, nodes=row[face.nodes]) for face in elements.interfaces)
    return replace(
        elements,
        nodes=elements.nodes[used],
        labels=elements.labels[used],
        dofs=dofs,
        root=row[elements.root],
        interfaces=faces,
    )
