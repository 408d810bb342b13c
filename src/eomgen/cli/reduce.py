"""The command reduce: a link that bends, from finite elements."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..errors import InputError
from ..names import show
from .shared.command import Command
from .shared.numbers import once_each, real, whole
from .shared.options import add_json
from .shared.output import show_files
from .shared.progress import stage_bar

_ABOUT = """\
Reduce the finite elements of a link to modes, and write the constants of its equations of motion.

FILES: a .npz of nodes, M, K, root and interfaces alone; or matrices and nodes as programs write them: .sti, .mas, .dof
and .inp (CalculiX), .mtx and .inp (Abaqus), .mmf or .matrix, .mapping and .csv (Ansys), .pch and .bdf (Nastran), or
.op4 with a .dof that names its rows, a line NODE.DIRECTION for each; .csv has node,x,y,z.  K=FILE, M=FILE, nodes=FILE
and map=FILE say what a file is where its name does not.  Matrices of Nastran are KAAX, KXX, KAA, KGG or K, and the same
with M, or what --matrix-name gives; coordinate systems of nodes (CP, CD) are CORD1 and CORD2 entries of the same file.

A SET: numbers of nodes (1-12,40), a plane (x=0.5), or a set of *NSET; behind an @ the interface's place (x=1@1,0,0).
"""


def _add_reduce(parser: argparse.ArgumentParser) -> None:
    from ..bending.units import SI, UNITS, WORDS

    parser.add_argument("files", metavar="FILES", nargs="+", help="a .npz of finite elements, or matrices and nodes")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="the .npz of constants to write")
    parser.add_argument("--root", metavar="SET", help="nodes on the link's joint, clamped; without, the link is free")
    for option, about in (
        ("--node", "an interface of one node with rotations"),
        ("--rigid", "an interface of a set that moves as a rigid body (RBE2)"),
        ("--mean", "an interface of a set's mean displacements (RBE3)"),
    ):
        parser.add_argument(option, action="append", default=[], metavar="NAME=SET", help=f"{about}; more than once")
    parser.add_argument("--modes", type=whole, metavar="N", help="modes beside those of interfaces (6)")
    parser.add_argument("--units", choices=tuple(UNITS), default=SI, help=f"of the files: {WORDS} (m)")
    about = "name of the matrix in files of Nastran that is K, M or a load case's (KAAX, KXX, ...); more than once"
    parser.add_argument("--matrix-name", action="append", default=[], metavar="K=NAME", help=about)
    about = "pose of the files' axes in the link's frame: m, and rad as rpy of descriptions"
    words = ("X", "Y", "Z", "ROLL", "PITCH", "YAW")
    parser.add_argument("--placement", nargs=6, type=real, metavar=words, help=about)
    about = "geometric stiffness of a load case, for stiffening by rotation: all cases or none; more than once"
    parser.add_argument("--stress", action="append", default=[], metavar="CASE=FILE", help=about)
    about = "keep displacements of interfaces and fixed-interface modes as they are, without frequencies of their own"
    parser.add_argument("--craig-bampton", action="store_true", help=about)
    add_json(parser)


def _reduce(options: argparse.Namespace) -> None:
    from ..bending.files import ENDING
    from ..bending.reducing import LinkSets, reduce_files
    from ..files import check_ending
    from ..robot.value import Placement

    if options.output is not None:
        check_ending(options.output, ENDING)
    named = {
        name: _by_name(name, getattr(options, name)) for name in ("node", "rigid", "mean", "stress", "matrix_name")
    }
    stress, matrices = named.pop("stress"), named.pop("matrix_name")
    sets = LinkSets(options.root, **named) if options.root is not None or any(named.values()) else None
    pose = options.placement
    with stage_bar("reducing") as report:
        link = reduce_files(
            options.files,
            sets,
            modes=options.modes,
            units=options.units,
            stress=stress,
            matrices=matrices,
            craig_bampton=options.craig_bampton,
            placement=None if pose is None else Placement.from_rpy((pose[0], pose[1], pose[2]), tuple(pose[3:])),
            report=report,
        )
    written = [] if options.output is None else [link.save(options.output)]
    show_files(options, link.lines(), link.as_dict(), written)


def _by_name(option: str, texts: list[str]) -> dict[str, str]:
    """Return texts by name, from NAME=TEXT; InputError of what is none, and of a name twice."""
    rows = []
    for text in texts:
        name, sign, value = text.partition("=")
        if not (name and sign and value):
            what = {"stress": "CASE=FILE", "matrix_name": "K=NAME or M=NAME"}
            raise InputError(f"{option.replace('_', '-')}: {show(text)}; allowed: {what.get(option, 'NAME=SET')}")
        rows.append((name, value))
    return once_each(option, rows)


COMMANDS = (
    Command(
        _add_reduce,
        _reduce,
        "modes of a link that bends, from finite elements",
        {
            "reduce bar.npz -o bar_modes.npz": "from nodes, M and K in one file",
            "reduce se.op4 se.dof se.bdf --node tip=2 --matrix-name K=KXX": "from a superelement of Nastran, free",
            "reduce arm.sti arm.mas arm.dof arm.inp --root CLAMP --rigid tip=FLANGE": "from CalculiX, by sets of nodes",
        },
        _ABOUT,
    ),
)
