"""What must hold for every file, whatever is in it; as a program, for many mutants within limits of time and memory.

    python -m tests.support.fuzzing KIND FIRST COUNT

prints a line of JSON: how many were accepted, the slowest one in s of processor time, and the memory used, MB.
"""

from __future__ import annotations

import json
import math
import re
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from eomgen.authoring.dh import CONVENTIONS, dh_file_text
from eomgen.bending.link_files import read_link
from eomgen.description.load import load_robot, robot_from_mjcf, robot_from_toml, robot_from_urdf
from eomgen.description.matrix_files import FileMatrix, read_matrix
from eomgen.errors import DescriptionError, EomgenWarning, InputError
from eomgen.identification.tolerances.correlations import read_correlations, root_of
from eomgen.identification.tolerances.table import Table, read_table
from eomgen.motion.files import MeasuredMotion, read_motion
from eomgen.robot.coordinates import coordinate_names
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES as COORDINATES_OF_JOINTS
from eomgen.robot.value import Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.sweep.plan import plan_from_toml
from tests.support.file_mutants import COORDINATES, FILES, any_mutant
from tests.support.mode_file_mutants import check_bending

KNOWN = (  # parameters that tables of tolerances name
    *(f"joints.{joint}.offset.{key}" for joint in ("j1", "j2", "o" * 60) for key in COORDINATES_OF_JOINTS),
    *("joints.j2.stiffness", "base.x", "base.y", "base.z", "frames.tcp.x", "frames.tcp.y"),
)
SECONDS, MEGABYTES = 2.0, 512  # of one description
LENGTH = 900
KINDS: dict[str, Any] = {
    "toml": lambda text, folder: robot_from_toml(text, source="r.toml", folder=folder),
    "urdf": lambda text, folder: robot_from_urdf(
        text, source="r.urdf", inertia="project", urdf_damping=True, urdf_friction=True
    ),
    "mjcf": lambda text, folder: robot_from_mjcf(text, source="r.mjcf", inertia="project"),
    "scenario": lambda text, folder: scenario_from_toml(text, source="s.toml", folder=folder),
    "plan": lambda text, folder: plan_from_toml(text, source="p.toml"),
    "tolerances": lambda text, folder: check_tolerances(text, folder / "t.toml"),
    **dict.fromkeys(FILES),
}


class TooSlowError(Exception):
    """A description took more than SECONDS of processor time."""


def accepted(kind: str, content: bytes, folder: Path) -> Any:
    """What the file is, or None where it is refused; any other exception, or a message that is none, is an error."""
    try:
        if kind in FILES:
            path = folder / f"mutant.{'npz' if kind == 'modes' else kind}"
            path.write_bytes(content)
            if kind == "modes":
                return check_bending(read_link(path))
            if kind == "mtx":
                return check_matrix(read_matrix(path))
            return check_dh(path) if kind == "dh" else check_motion(read_motion(path, COORDINATES))
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:  # the way of a file
            if kind not in ("toml", "urdf", "mjcf"):
                return None
            path = folder / f"mutant.{kind}"
            path.write_bytes(content)
            load_robot(path)
            raise AssertionError("no UTF-8, and yet it was read") from None
        made = KINDS[kind](text, folder)
        if isinstance(made, Robot):
            check_robot(made)
            build_model(made)
        return made
    except InputError as error:
        check_message(error)
        check_place(kind, error)
    return None


def check_message(error: InputError, most: int = LENGTH) -> None:
    message = str(error)
    assert message.isascii(), message
    assert message.isprintable(), repr(message)
    assert len(message) < most, message
    assert isinstance(error, DescriptionError) or "allowed" in message, message
    assert error.__cause__ is None


def check_place(kind: str, error: InputError) -> None:
    """Refusals inside of a file have a line."""
    if kind in ("urdf", "mjcf"):
        assert isinstance(error, DescriptionError)
        assert error.line is not None, error


def check_motion(motion: MeasuredMotion) -> MeasuredMotion:
    """Arrays are of one length and finite, and times increase."""
    shape = (len(motion.t), len(COORDINATES))
    arrays = [array for array in (motion.q, motion.v, motion.a, motion.u) if array is not None]
    assert all(array.shape == shape and np.isfinite(array).all() for array in arrays)
    assert len(motion.t)
    assert (np.diff(motion.t) > 0.0).all()
    return motion


def check_matrix(found: FileMatrix) -> FileMatrix:
    """It is square and finite, of one to six rows."""
    assert 1 <= len(found.rows) <= len(COORDINATES_OF_JOINTS)
    assert all(len(row) == len(found.rows) and all(map(math.isfinite, row)) for row in found.rows)
    return found


def check_tolerances(text: str, path: Path) -> Table:
    """Names are known ones, each once, with one size; coefficients are those of a matrix that has a root."""
    path.write_text(text, encoding="utf-8", newline="")
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


def check_dh(path: Path) -> Robot | None:
    """What a table describes can be read, by both conventions, but for inertias that no body can have."""
    robot = None
    for convention in CONVENTIONS:
        text = dh_file_text("arm", path, convention)
        assert text.isascii()
        try:
            robot = robot_from_toml(text)
        except DescriptionError as error:
            if "inertia" not in error.where:
                raise AssertionError(f"{convention}: {text}") from error
            raise
        check_robot(robot)
    return robot


def check_robot(robot: Robot) -> None:
    """Names are identifiers, numbers are finite, notes are lines of ASCII."""
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


def late(*_: object) -> None:
    raise TooSlowError


def memory() -> int:
    """Bytes of address space in use."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def limit_memory() -> None:
    """MEGABYTES more than now, at most."""
    most = memory() + MEGABYTES * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def run(kind: str, first: int, count: int) -> dict[str, Any]:
    """What readers make of ``any_mutant`` of these seeds, as ``measured``."""
    with tempfile.TemporaryDirectory() as folder:
        return measured(
            kind,
            lambda seed: accepted(kind, any_mutant(kind, seed), Path(folder)),
            first,
            count,
            lambda seed: repr(any_mutant(kind, seed)[:3000]),
        )


def measured(
    kind: str, tried: Callable[[int], object], first: int, count: int, said: Callable[[int], str] = lambda _: ""
) -> dict[str, Any]:
    """Counts and times of mutants that are read or refused, SECONDS of the processor each.

    Args:
        kind: named in messages.
        tried: reads the mutant of a seed; None where it is refused.
        first, count: of the seeds.
        said: text of the mutant of a seed, for messages.

    Raises:
        AssertionError: a mutant is not handled; names its seed.
    """
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", EomgenWarning)
    signal.signal(signal.SIGPROF, late)
    found, slowest, began = 0, 0.0, time.process_time()
    for seed in range(first, first + count):
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        start = time.process_time()
        try:
            found += tried(seed) is not None
        except BaseException as error:
            signal.setitimer(signal.ITIMER_PROF, 0)
            raise AssertionError(f"{kind} {seed}: {said(seed)}") from error
        slowest = max(slowest, time.process_time() - start)
    signal.setitimer(signal.ITIMER_PROF, 0)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    return {"accepted": found, "slowest": slowest, "peak": peak, "seconds": time.process_time() - began}


if __name__ == "__main__":
    *names, first_seed, seeds = sys.argv[1:]
    for name in names:  # what is imported on first use is no part of a description's memory
        accepted(name, any_mutant(name, 0), Path(tempfile.gettempdir()))
    limit_memory()
    print(json.dumps({name: run(name, int(first_seed), int(seeds)) for name in names}))
