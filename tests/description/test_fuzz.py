"""Fuzzed descriptions, scenarios, plans, motions, tables of some kinds: no traceback, no crash, 2 s and 512 MB each."""

from __future__ import annotations

import json
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import pytest

from eomgen.authoring.studies import plan_file_text, tolerances_file_text
from eomgen.cli import entry as cli
from eomgen.codegen.c.sources import render
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.errors import EomgenWarning, InputError
from eomgen.identification.tolerances.solve import tolerance_quantities
from eomgen.identification.tolerances.table import read_table
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from eomgen.sweep.plan import plan_from_toml
from tests.support import fuzzing
from tests.support.fuzzing import accepted
from tests.support.mutations import mutant
from tests.support.soak import WHOLE, share

ROOT = Path(__file__).parents[2]
BLOCK = 50_000 if WHOLE else 5_000
BLOCKS = {
    "toml": 10,
    "urdf": 10,
    "mjcf": 1,
    "scenario": 2,
    "plan": 1,
    "tolerances": 1,
    "csv": 1,
    "dh": 1,
    "npz": 1,
    "modes": 1,
    "mtx": 1,
}  # toml and urdf: a million together


def fuzzed(first: int, count: int, *kinds: str) -> dict[str, dict[str, Any]]:
    """What a process of its own says of these mutants, within the limits, by kind."""
    command = [sys.executable, "-m", "tests.support.fuzzing", *kinds, str(first), str(count)]
    found = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert found.returncode == 0, found.stderr[-6000:]
    reports: dict[str, dict[str, Any]] = json.loads(found.stdout)
    assert reports.keys() == set(kinds)
    for kind, report in reports.items():
        assert report["slowest"] < fuzzing.SECONDS, kind
        assert count / 50 < report["accepted"] < count / 2, kind  # neither noise nor always the same
    return reports


def test_mutants_are_refused_or_read() -> None:
    fuzzed(10_000_000, 150, *BLOCKS)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("kind", "block"), [(kind, block) for kind, count in BLOCKS.items() for block in share(range(count), 1)]
)
def test_a_million_mutants(kind: str, block: int) -> None:
    report = fuzzed(block * BLOCK, BLOCK, kind)[kind]
    print(
        f"\n{BLOCK} {kind} from {block * BLOCK}: {report['accepted']} accepted, {report['seconds']:.0f} s,"
        f" {report['seconds'] / BLOCK * 1e6:.0f} us each, slowest {report['slowest']:.3f} s, {report['peak']} MB"
    )


@pytest.mark.soak
def test_a_limit_that_is_passed_is_reported() -> None:
    """The fuzzer can fail: a reader that is slow, one that takes memory, and one that raises something else."""
    code = "from tests.support import fuzzing; {setup}; fuzzing.run('toml', 0, 1)"
    for setup, word in (
        ("fuzzing.SECONDS = 0.05; fuzzing.KINDS['toml'] = lambda *_: [None for _ in iter(int, 1)]", "TooSlowError"),
        ("fuzzing.limit_memory(); fuzzing.KINDS['toml'] = lambda *_: bytes(600 * 2**20)", "MemoryError"),
        ("fuzzing.KINDS['toml'] = lambda *_: {}['a']", "KeyError"),
    ):
        command = [sys.executable, "-c", code.format(setup=setup)]
        found = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
        assert found.returncode == 1
        assert word in found.stderr
        assert "AssertionError: toml 0: b'" in found.stderr


def robots(kind: str, first: int, count: int, folder: Path) -> list[Robot]:
    """Different small robots that mutants of that kind describe."""
    found: dict[str, Robot] = {}
    seed = first
    while len(found) < count:
        made = accepted(kind, mutant(kind, seed), folder)
        seed += 1
        if isinstance(made, Robot) and sum(len(joint.all_coordinates) for joint in made.joints) <= 8:
            parts = (made.links, made.joints, made.frames, made.loops, made.couplings, made.springs)
            found.setdefault(repr(parts), made)
    return list(found.values())


def rendered(kind: str, first: int, count: int, folder: Path) -> int:
    """Length of the C of robots that mutants describe: whatever was let in can be derived and rendered."""
    length = 0
    for robot in robots(kind, first, count, folder):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", EomgenWarning)
            source = render(derive_equations(build_model(robot), ("residual", "mass_matrix")), "float64")
        assert source.code.isascii()
        assert not [word for word in ("nan", "inf", "NAN", "INFINITY") if f" {word}" in source.code]
        length += len(source.code)
    return length


@pytest.mark.parametrize("kind", ["toml", "urdf"])
def test_what_was_read_can_be_rendered(kind: str, tmp_path: Path) -> None:
    assert rendered(kind, 20_000_000, 2, tmp_path) > 2_000


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["toml", "urdf"])
def test_more_of_what_was_read_can_be_rendered(kind: str, tmp_path: Path) -> None:
    print(f"\n60 robots of {kind} mutants: {rendered(kind, 30_000_000, 60, tmp_path)} characters of C")


def studied(kind: str, first: int, count: int, folder: Path) -> int:
    """How many robots that mutants describe get a table of tolerances; first files of all of them can be read."""
    path, tables = folder / "table.toml", 0
    for robot in robots(kind, first, count, folder):
        plan_from_toml(plan_file_text(robot))
        try:
            text = tolerances_file_text(robot)
        except InputError as error:  # its loops are open, or elastic, or its drives do not say where all is
            fuzzing.check_message(error)
            continue
        path.write_text(text, encoding="ascii")
        assert read_table(path, tuple(tolerance_quantities(robot))).entries
        tables += 1
    return tables


@pytest.mark.parametrize("kind", ["toml", "urdf"])
def test_first_files_for_studies_can_be_read(kind: str, tmp_path: Path) -> None:
    assert studied(kind, 60_000_000, 8, tmp_path)


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["toml", "urdf"])
def test_more_first_files_for_studies_can_be_read(kind: str, tmp_path: Path) -> None:
    assert studied(kind, 61_000_000, 100, tmp_path) > 10


def test_the_command_line_refuses_with_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Status 1 and a line that names the file; never a traceback."""
    refused = 0
    for seed in range(60):
        for kind in ("toml", "urdf"):
            content = mutant(kind, 40_000_000 + seed)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", EomgenWarning)
                if accepted(kind, content, tmp_path) is not None:
                    continue
            path = tmp_path / f"bad.{kind}"
            path.write_bytes(content)
            status = cli.main(["info", str(path), *(["--inertia", "project"] if kind == "urdf" else [])])
            printed = capsys.readouterr()
            (line,) = [line for line in printed.err.splitlines() if not line.startswith("note: ")]
            assert (status, printed.out) == (1, "")
            assert line.startswith(f"eomgen: {path}:")
            refused += 1
    assert refused > 70
