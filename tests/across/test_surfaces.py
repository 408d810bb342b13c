"""Files of all formats with random changes: no traceback, no crash, limits of processor time and memory for each."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from eomgen.authoring.studies import plan_file_text, tolerances_file_text
from eomgen.cli import entry as cli
from eomgen.codegen.c.sources import render
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.errors import EomgenWarning, InputError
from eomgen.identification.tolerances.solve import tolerance_quantities
from eomgen.identification.tolerances.table import read_table
from eomgen.pictures.measured.kinds import PAGES, page_of
from eomgen.results.kinds import KINDS
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from eomgen.sweep.plan import load_plan
from tests.support.extreme_numbers import COUNTS
from tests.support.fuzzing import ROOT, accepted, check_message, fuzzed
from tests.support.kept_files import KEPT, MEASURED
from tests.support.optional import needs
from tests.support.soak import WHOLE
from tests.support.surfaces import SURFACES, Surface

QUICK = {  # surfaces of one process each
    "descriptions": ("toml", "urdf"),
    "models of MuJoCo": ("mjcf",),
    "inputs": ("scenario", "plan", "tolerances", "csv", "dh", "mtx", "npz", "modes", "finite elements"),
    "results": ("result", "sweep", *MEASURED),
    "analyses": tuple(f"numbers of {kind}" for kind, (few, _) in COUNTS.items() if few),
}
FOLDERS = ("sweep", "finite elements")
ELSEWHERE = ("mjcf",)  # read by a process of its own
SINGLE = [name for names in QUICK.values() for name in names if name not in (*FOLDERS, *ELSEWHERE)]
SINGLE = [name for name in SINGLE if not name.startswith("numbers")]
BLOCK = 50_000


def test_all_surfaces_are_tried() -> None:
    """Files that results are saved in have surfaces, kept files, and pages where they are measured."""
    assert {name for names in QUICK.values() for name in names} == {x.name for x in SURFACES.values() if x.few}
    sources = "".join(path.read_text() for path in (ROOT / "src/eomgen").rglob("*.py"))
    assert set(re.findall(r'\bdeclare\(\s*Kind\(\s*"(\w+)"', sources)) == set(MEASURED)
    for kind in MEASURED:
        SURFACES[kind].read(KEPT / f"{kind}{MEASURED[kind]}")
    assert {kind.result for kind in KINDS.values() if "identification" in kind.result.__module__} <= set(PAGES)


@pytest.mark.parametrize("group", QUICK)
def test_changed_files_are_refused_or_read(group: str) -> None:
    if group == "models of MuJoCo":
        needs("mujoco")
    fuzzed(*QUICK[group], first=10_000_000, count=0)


def blocks(surface: Surface) -> list[tuple[str, int, int]]:
    """First seed and number of files of each run."""
    count = surface.whole if WHOLE else surface.many
    return [(surface.name, first, min(BLOCK, count - first)) for first in range(0, count, BLOCK)]


@pytest.mark.soak(most=1000)  # each file format
@pytest.mark.parametrize(("name", "first", "count"), [run for surface in SURFACES.values() for run in blocks(surface)])
def test_many_files_are_refused_or_read(name: str, first: int, count: int) -> None:
    report = fuzzed(name, first=first, count=count)[name]
    each = report["seconds"] / count * 1e6
    print(f"\n{count} {name}: {report['accepted']} accepted, {each:.0f} us each, slowest {report['slowest']:.3f} s")
    print(f"of processor time, {report['peak']} MB")


@pytest.mark.soak
def test_a_limit_that_is_passed_is_reported(tmp_path: Path) -> None:
    """The harness can fail: a reader that is slow, one that takes memory, and one that raises something else."""
    setup = """
from dataclasses import replace
from pathlib import Path
from tests.support import fuzzing, surfaces
def run(read, **limits):
    surface = replace(surfaces.SURFACES["toml"], read=read, **limits)
    fuzzing.run(surface, Path({folder!r}), 0, 1)
"""
    for code, word in (
        ("run(lambda _: [None for _ in iter(int, 1)], seconds=0.05)", "TooSlowError"),
        ("fuzzing.limit_memory(512); run(lambda _: bytes(600 * 2**20))", "MemoryError"),
        ("run(lambda _: {}['a'])", "KeyError"),
    ):
        command = [sys.executable, "-c", setup.format(folder=str(tmp_path)) + code]
        found = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
        assert found.returncode == 1
        assert word in found.stderr
        assert "AssertionError: toml 0: b" in found.stderr


GUIDED = """
import os, shutil, signal, sys
from pathlib import Path
import atheris
with atheris.instrument_imports(include=["eomgen", "tomllib"]):
    from tests.support.fuzzing import accepted, limit_memory, strict
    from tests.support.surfaces import SURFACES
flags, names = sys.argv[1:5], sys.argv[5:]
for name in names:
    surface, folder = SURFACES[name], Path(name)
    (folder / "corpus").mkdir(parents=True)
    for seed in range(40):
        path = surface.write(folder, 50_000_000 + seed)
        shutil.copy(path, folder / "corpus" / str(seed))
    def one(content):
        path.write_bytes(content)
        signal.setitimer(signal.ITIMER_PROF, surface.seconds)
        accepted(surface, path)
        signal.setitimer(signal.ITIMER_PROF, 0)
    process = os.fork()
    if process:
        _, status = os.waitpid(process, 0)
        print(name, "ended with", status, flush=True)
        continue
    one(path.read_bytes())
    strict()
    limit_memory(surface.megabytes)
    atheris.Setup([sys.argv[0], *flags, f"-artifact_prefix={folder}/", str(folder / "corpus")], one)
    atheris.Fuzz()
"""


@pytest.mark.soak
def test_guided_inputs(tmp_path: Path) -> None:
    """Coverage-guided fuzzing, from changed files on; limits are those of the surfaces, and a number of files."""
    needs("atheris")
    runs = 100_000 if WHOLE else 2_000
    flags = ("-timeout=100000", "-rss_limit_mb=0", "-max_len=8192", f"-runs={runs}")  # no limit of wall time or its own
    found = subprocess.run(
        [sys.executable, "-c", GUIDED, *flags, *SINGLE],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])},
        cwd=tmp_path,
    )
    said = found.stdout.decode(errors="replace")
    assert re.findall(r"^(\S+) ended with 0$", said, re.MULTILINE) == list(SINGLE), said[-6000:]
    assert [int(count) >= runs for count in re.findall(r"Done (\d+) runs", said)] == [True] * len(SINGLE)


# What is read can be used


def robots(kind: str, first: int, count: int, folder: Path) -> list[Robot]:
    """Different small robots that files of that kind describe."""
    found: dict[str, Robot] = {}
    surface, seed = SURFACES[kind], first
    while len(found) < count:
        made = accepted(surface, surface.write(folder, seed))
        seed += 1
        if made is not None and sum(len(joint.all_coordinates) for joint in made.joints) <= 8:
            parts = (made.links, made.joints, made.frames, made.loops, made.couplings, made.springs)
            found.setdefault(repr(parts), made)
    return list(found.values())


@pytest.mark.filterwarnings("error", "ignore::eomgen.EomgenWarning")
@pytest.mark.parametrize("kind", ["toml", "urdf"])
@pytest.mark.parametrize("count", [2, pytest.param(60, marks=pytest.mark.soak)])
def test_what_was_read_can_be_rendered(kind: str, count: int, tmp_path: Path) -> None:
    """C of all that was let in is ASCII without numbers that are not finite."""
    length = 0
    for robot in robots(kind, 20_000_000 + count, count, tmp_path):
        source = render(derive_equations(build_model(robot), ("residual", "mass_matrix")))
        written = source.code + source.batch_code
        assert written.isascii()
        code = re.sub(r"/\*.*?\*/", "", written, flags=re.DOTALL)  # comments have names
        assert not [word for word in ("nan", "inf", "NAN", "INFINITY") if f" {word}" in code]
        length += len(written)
    assert length > 1000 * count


@pytest.mark.parametrize("kind", ["toml", "urdf"])
@pytest.mark.parametrize("count", [8, pytest.param(100, marks=pytest.mark.soak)])
def test_first_files_for_studies_can_be_read(kind: str, count: int, tmp_path: Path) -> None:
    """Plans of all robots that were read, and tables of tolerances of those that have one."""
    path, tables = tmp_path / "table.toml", 0
    for robot in robots(kind, 60_000_000 + count, count, tmp_path):
        path.write_text(plan_file_text(robot), encoding="ascii")
        load_plan(path)
        try:
            text = tolerances_file_text(robot)
        except InputError as error:  # its loops are open, or elastic, or its drives do not say where all is
            check_message(error)
            continue
        path.write_text(text, encoding="ascii")
        assert read_table(path, tuple(tolerance_quantities(robot))).entries
        tables += 1
    assert tables > count // 10


@pytest.mark.parametrize("kind", ["toml", "urdf"])
def test_the_command_line_refuses_with_one_line(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Status 1 and a line that names the file; never a traceback."""
    surface, refused = SURFACES[kind], 0
    for seed in range(40_000_000, 40_000_060):
        path = surface.write(tmp_path, seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EomgenWarning)
            if accepted(surface, path) is not None:
                continue
        status = cli.main(["info", str(path), *(["--inertia", "project"] if kind == "urdf" else [])])
        printed = capsys.readouterr()
        (line,) = [line for line in printed.err.splitlines() if not line.startswith("note: ")]
        assert (status, printed.out) == (1, "")
        assert line.startswith(f"eomgen: {path}:")
        refused += 1
    assert refused > 30


@pytest.mark.soak
@pytest.mark.parametrize("kind", MEASURED)
def test_pages_of_changed_measurements(kind: str, tmp_path: Path) -> None:
    """What is read can be drawn as a page."""
    surface, pages = SURFACES[kind], 0
    for seed in range(1_000_000, 1_000_400 if WHOLE else 1_000_160):
        found = accepted(surface, surface.write(tmp_path, seed))
        if found is not None and type(found) in PAGES:
            assert page_of(found).html()
            pages += 1
    assert pages > 8 or KINDS[kind].result not in PAGES
