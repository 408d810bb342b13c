"""What eomgen reads of others: a table of files, with random changes, readers, and what holds of one that is read."""

from __future__ import annotations

import json
import math
import random
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

import eomgen
from eomgen.authoring.dh import CONVENTIONS, dh_file_text
from eomgen.bending.files import BendingBody
from eomgen.bending.finite_elements import FiniteElements
from eomgen.bending.link_files import read_link
from eomgen.bending.reduced_link import ReducedLink
from eomgen.bending.reducing import LinkSets, reduce_files
from eomgen.description.load import load_robot, robot_from_mjcf
from eomgen.description.matrix_files import read_matrix
from eomgen.errors import DescriptionError, InputError
from eomgen.identification.tolerances.correlations import read_correlations, root_of
from eomgen.identification.tolerances.table import Table, read_table
from eomgen.motion.files import MeasuredMotion, read_motion
from eomgen.results.kinds import KINDS, read
from eomgen.robot.coordinates import coordinate_names
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES as COORDINATES_OF_JOINTS
from eomgen.robot.value import Link, Robot, deflection_range
from eomgen.scenario.load import load_scenario
from eomgen.simulation.result import SimulationResult
from eomgen.sweep.plan import load_plan
from eomgen.sweep.result import SweepResult
from tests.support import element_texts, extreme_numbers, large_files
from tests.support.bad_files import BAD, READERS, SLOW
from tests.support.finite_elements import bar
from tests.support.good_files import COORDINATES, MOTIONS, TABLES, bending_links
from tests.support.kept_files import MEASURED, changed_file, changed_sweep, raw_kept, raw_result, sample_result
from tests.support.mutations import Chance, change_arrays, change_bytes, change_cells, document, npz

KNOWN = (  # parameters that tables of tolerances name
    *(f"joints.{joint}.offset.{key}" for joint in ("j1", "j2", "o" * 60) for key in COORDINATES_OF_JOINTS),
    *("joints.j2.stiffness", "base.x", "base.y", "base.z", "frames.tcp.x", "frames.tcp.y"),
)
Content = bytes | Mapping[str, bytes]  # of a file, or of files of a folder


@dataclass(frozen=True)
class Surface:
    """Files of one kind.

    Attributes:
        name: of the surface.
        write: writes the file of a seed into a folder, and returns its path.
        read: reads a file, checks what was read, and returns it; raises InputError.
        few, many, whole: number of files in quick tests, in the soak, and in the whole soak.
        most: share of files that may be accepted, of which at least one in fifty must be; 0: any.
        has_line: whether each refusal has the number of a line.
        seconds, megabytes: of processor time and memory that one file may take.
    """

    name: str
    write: Callable[[Path, int], Path]
    read: Callable[[Path], Any]
    few: int = 150
    many: int = 5_000
    whole: int = 50_000
    most: float = 0.5
    has_line: bool = False
    seconds: float = 2.0
    megabytes: int = 512


def mutants(
    name: str, file: str, change: Callable[[Chance], Content], damaged: float = 0.2
) -> Callable[[Path, int], Path]:
    """Return a function that writes mutants, some of them damaged in single bytes."""

    def write(folder: Path, seed: int) -> Path:
        chance = random.Random(f"{name} {seed}")
        made, path = change(chance), folder / file
        contents = {path: made} if isinstance(made, bytes) else {path / key: each for key, each in made.items()}
        target = chance.choice(list(contents)) if chance.random() < damaged else None
        for place, content in contents.items():
            place.parent.mkdir(exist_ok=True)
            place.write_bytes(change_bytes(content, chance) if place == target else content)
        return path

    return write


def _table(kind: str, chance: Chance) -> bytes:
    rows = [list(row) for row in TABLES[kind]]
    for _ in range(chance.choice((0, 1, 1, 2, 4))):
        change_cells(rows, chance)
    end, between = chance.choice(("\n", "\n", "\r\n", "\r")), " " if kind == "mtx" else ","
    if kind == "csv" and chance.random() < 0.4:
        between, marks = chance.choice(";\t"), chance.choice(((".", ","), (".", "."), (",", ".")))
        rows[1:] = [[cell.replace(*marks) for cell in row] for row in rows[1:]]
    return "".join(between.join(row) + end for row in rows).encode("utf-8", "surrogatepass")


def _arrays(files: Callable[[], list[dict[str, Any]]], chance: Chance) -> bytes:
    arrays = dict(chance.choice(files()))
    for _ in range(chance.choice((0, 1, 1, 2))):
        change_arrays(arrays, chance)
    return npz(arrays, chance)


@cache
def _results() -> list[Any]:
    names = {"one_link": True, "geared_arm": False, "balanced_arm": True}
    return [raw_result(sample_result(name, states=states)) for name, states in names.items()]


def _kept(kind: str, chance: Chance) -> Content:
    if kind == "sweep":
        return changed_sweep(chance)
    return changed_file(chance.choice(_results()) if kind == "result" else raw_kept(kind), chance)


def read_robot(path: Path, **options: Any) -> Robot:
    """Read a description as a file, or, of MJCF, as a text that nothing but this reader sees."""
    text = None
    if path.suffix == ".mjcf":
        try:
            text = path.read_bytes().decode("utf-8-sig")
        except UnicodeDecodeError:
            load_robot(path)
            raise AssertionError("no UTF-8, and yet it was read") from None
    robot = load_robot(path, **options) if text is None else robot_from_mjcf(text, source=path.name, **options)
    check_robot(robot)
    build_model(robot)
    return robot


def check_robot(robot: Robot) -> None:
    """Check that names are identifiers, numbers are finite, and notes are lines of ASCII."""
    items = (*robot.links, *robot.joints, *robot.frames, *robot.loops, *robot.couplings, *robot.springs)
    for name in (robot.name, robot.base, *(item.name for item in items)):
        assert re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", name)
    assert {name for beam in robot.beams for name in beam.link_names} <= {link.name for link in robot.links}
    for link in robot.links:
        assert all(map(math.isfinite, (link.mass, *link.com, *link.inertia)))
    for joint in robot.joints:
        rows = (*joint.placement.rotation, *joint.axis_turn, joint.placement.xyz)
        assert all(math.isfinite(value) for row in rows for value in row)
    known = coordinate_names(robot)
    for names in (robot.driven or (), robot.home, *((x.of, *x.to) for x in robot.couplings)):
        assert set(names) <= set(known)
    given = [*robot.home.values(), *(x for coupling in robot.couplings for x in coupling.numbers().values())]
    assert all(value is None or math.isfinite(value) for value in given)
    assert all(note.isascii() and note.isprintable() for note in robot.notes)


def read_tolerances(path: Path) -> Table:
    """Read a table whose names are known, each once, with one size; coefficients are of a matrix that has a root."""
    table = read_table(path, KNOWN)
    names = [entry.name for entry in table.entries]
    assert names == [name for name in KNOWN if name in names]
    for entry in table.entries:
        (size,) = (each for each in (entry.deviation, entry.bound) if each is not None)
        assert 0.0 <= size < math.inf
        assert 0.0 < entry.cost < math.inf
    correlation = read_correlations(table)
    root = root_of(correlation)
    assert correlation.shape == (len(names), len(names))
    np.testing.assert_allclose(root @ root.T, correlation, atol=1e-9)
    np.testing.assert_array_equal(np.diag(correlation), 1.0)
    return table


def read_measured_motion(path: Path) -> MeasuredMotion:
    """Read a motion whose arrays are of one length and finite, and whose times increase."""
    motion = read_motion(path, COORDINATES, principal={"joint1": "joint1.gamma", "joint2": "joint2.z"})
    shape = (len(motion.t), len(COORDINATES))
    arrays = [array for array in (motion.q, motion.v, motion.a, motion.u) if array is not None]
    assert all(array.shape == shape and np.isfinite(array).all() for array in arrays)
    assert len(motion.t)
    assert (np.diff(motion.t) > 0.0).all()
    return motion


def read_dh(path: Path) -> Robot | None:
    """Read a table, which is a robot by both conventions, but for inertias that no body can have."""
    robot = None
    for convention in CONVENTIONS:
        text = dh_file_text("arm", path, convention)
        assert text.isascii()
        try:
            robot = eomgen.description.robot_from_toml(text)
        except DescriptionError as error:
            if "inertia" not in error.where:
                raise AssertionError(f"{convention}: {text}") from error
            raise
        check_robot(robot)
    return robot


def read_square(path: Path) -> Any:
    """Read a matrix that is square and finite, of one to six rows."""
    found = read_matrix(path)
    assert 1 <= len(found.rows) <= len(COORDINATES_OF_JOINTS)
    assert all(len(row) == len(found.rows) and all(map(math.isfinite, row)) for row in found.rows)
    return found


def read_bending(path: Path) -> BendingBody:
    """Read a link that is a body with a mass, and whose modes a link can have; how far they reach is known."""
    body = read_link(path)
    modes = body.modes
    assert np.isfinite(body.H00).all()
    assert body.H00[3, 3] > 0.0
    assert modes.conflict() is None
    assert all(x > 0.0 for x in (modes.masses[k][k] for k in range(modes.count)))
    assert all(node.name.isidentifier() for node in modes.nodes)
    com = body.H00[:3, 3] / body.H00[3, 3]
    J = body.H00[:3, :3] - body.H00[3, 3] * np.outer(com, com)
    tensor = np.trace(J) * np.eye(3) - J
    inertia = [float(tensor[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    link = Link("arm", float(body.H00[3, 3]), tuple(map(float, com)), tuple(inertia), modes)  # type: ignore[arg-type]
    assert all(x >= 0.0 for x in deflection_range(link))
    return body


ELEMENTS: dict[str, Callable[[Path, FiniteElements], list[str]]] = {
    **element_texts.PROGRAMS,
    "substructure": element_texts.substructure,
    **{f"op4 {kind}": partial(element_texts.op4, **about) for kind, about in element_texts.OP4.items()},
}


def write_elements(folder: Path, seed: int) -> Path:
    """Write a brick as a program does into a folder, changed in words or bytes of its files; return the folder."""
    chance = random.Random(f"finite elements {seed}")
    path = folder / chance.choice(list(ELEMENTS))
    path.mkdir(exist_ok=True)
    ELEMENTS[path.name](path, bar(counts=(1, 1, 1), count=0))
    for file in chance.sample(sorted(path.iterdir()), k=chance.choice((0, 0, 1, 1, 2))):
        content = file.read_bytes()
        if path.name.startswith("op4 ") or chance.random() < 0.3:
            content = change_bytes(content, chance)
        else:
            rows = [line.split(",") for line in content.decode().split("\n")]
            change_cells(rows, chance)
            content = "\n".join(",".join(row) for row in rows).encode("utf-8", "surrogatepass")
        file.write_bytes(content)
    return path


def read_elements(path: Path) -> ReducedLink:
    """Read the files of a folder, by their names, as a link with a mass and frequencies."""
    roles = {"k.mmf": "K=", "m.mmf": "M="}
    files = [f"{roles.get(file.name, '')}{file}" for file in sorted(path.iterdir())]
    names = {"M": "MAAX"} if path.name.startswith(("op4 ", "nastran")) else None
    sets = LinkSets("x=0", rigid={"tip": "x=1"})
    link = reduce_files(files, sets, modes=0, units="inch-lbf-s", matrices=names)
    assert link.mass > 0.0
    assert np.isfinite(link.frequencies).all()
    return link


def read_result(path: Path) -> SimulationResult:
    """Read a result whose summary is printable and whose series have its times."""
    found = eomgen.load_result(path)
    assert all(line.isprintable() for line in found.summary_lines())
    json.dumps(found.summary())
    for name in found.names:
        assert found.series(name).values.shape[0] == found.trajectory.t.size
    return found


def read_sweep(path: Path) -> SweepResult:
    """Read a sweep whose summary is printable."""
    found = SweepResult.load(path)
    assert all(line.isprintable() for line in [*found.lines(), json.dumps(found.as_dict())])
    return found


def read_kept(kind: str, path: Path) -> Any:
    """Read a result of that kind, which prints finite numbers; a refusal names the file."""
    raw_kept(kind)  # imports what declares it
    try:
        found = read(KINDS[kind], path)
    except InputError as error:
        if str(path) not in str(error):
            raise AssertionError(f"{path} is not named: {error}") from None
        raise
    odd = [line for line in found.lines() if extreme_numbers.ODD.search(line)]
    infinite = not KINDS[kind].is_finite  # limits that there are not, and stiffness of what is rigid
    own = path.suffix == ".json" and extreme_numbers.ODD.search(path.read_text(errors="replace"))  # written by a change
    assert infinite or own or not odd, odd
    json.dumps(found.as_dict())
    return found


def read_bad(path: Path) -> None:
    """Refuse a hand-made bad file; test_bad_files looks at the messages."""
    with suppress(InputError):
        READERS[path.name](path)
        raise AssertionError("it is read")


ALL_BAD = [*BAD, *SLOW]


def _surfaces() -> Iterator[Surface]:
    projected: dict[str, Any] = {"inertia": "project"}
    read_urdf = partial(read_robot, **projected, urdf_damping=True, urdf_friction=True)
    for kind, file, reader, more in (
        ("toml", "r.toml", read_robot, {"whole": 500_000}),
        ("urdf", "r.urdf", read_urdf, {"whole": 500_000, "has_line": True}),
        (
            "mjcf",
            "r.mjcf",
            partial(read_robot, **projected),
            {"has_line": True, "few": 20, "many": 300, "whole": 5_000},
        ),
        ("scenario", "s.toml", load_scenario, {"whole": 100_000}),
        ("plan", "p.toml", load_plan, {}),
        ("tolerances", "t.toml", read_tolerances, {}),
    ):
        yield Surface(kind, mutants(kind, file, partial(document, kind)), reader, **more)
    for kind, table in (("csv", read_measured_motion), ("dh", read_dh), ("mtx", read_square)):
        ending = "csv" if kind == "dh" else kind
        yield Surface(kind, mutants(kind, f"m.{ending}", partial(_table, kind), 0.3), table)
    yield Surface("finite elements", write_elements, read_elements, few=100, many=5_000, whole=20_000, most=0.7)
    for kind, files, array in (("npz", lambda: MOTIONS, read_measured_motion), ("modes", bending_links, read_bending)):
        yield Surface(kind, mutants(kind, "m.npz", partial(_arrays, files), 0.3), array)
    for kind, file, reader, *counts in (
        ("result", "r.npz", read_result, 80, 1_600, 20_000),
        ("sweep", "sweep", read_sweep, 80, 4_000, 50_000),
        *((kind, f"r{ending}", partial(read_kept, kind), 15, 400, 5_000) for kind, ending in MEASURED.items()),
    ):
        yield Surface(kind, mutants(kind, file, partial(_kept, kind)), reader, *counts, 0.7)
    for kind, (few, many) in extreme_numbers.COUNTS.items():
        file, name = f"m{extreme_numbers.ending_of(kind)}", f"numbers of {kind}"
        write = mutants(name, file, partial(extreme_numbers.changed, kind), 0.0)
        yield Surface(name, write, partial(extreme_numbers.read, kind), few, many, many, 0.7, seconds=20.0)
    large = large_files
    for name, count, write, reader, seconds, megabytes in (
        ("bad files", len(ALL_BAD), lambda folder, seed: ALL_BAD[seed].write(folder), read_bad, 2.0, 512),
        ("large motions", len(large.MOTIONS), large.write_motion, large.read_large_motion, 2.0, 512),
        ("large links", len(large.LINKS), large.write_link, large.read_large_link, 120.0, 600),
    ):
        yield Surface(name, write, reader, 0, count, count, 0.0, seconds=seconds, megabytes=megabytes)


SURFACES = {surface.name: surface for surface in _surfaces()}
