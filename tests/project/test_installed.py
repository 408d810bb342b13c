"""What an index would give out: installed into an empty environment of each Python, it passes the tests from there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from eomgen.cli import entry as cli
from release.pythons import PYTHONS, interpreter
from tests.support.soak import WHOLE

NEEDED = ("pytest>=7.4", "pytest-xdist>=3.3", "hypothesis>=6.90", "pin>=3.0", "mujoco>=3.0", "example-robot-data>=4.1")
CORE = (
    *(
        "cli",
        "description/test_description.py",
        "codegen/kernels/test_kernels.py",
        "codegen/kernels/test_against_pinocchio.py",
    ),
    *("pipeline/test_cache.py", "runtime/test_arrays.py", "runtime/test_parameters.py"),
)
BROAD = (
    *(*CORE, "codegen/joint/test_errata.py", "codegen/tree/test_reactions.py", "loops/test_loops.py"),
    *("runtime/test_batches.py", "runtime/test_rollout.py", "simulation/test_result.py", "simulation/test_simulate.py"),
)
TESTS = Path(__file__).parents[1]
EXTRA_MODULES = ("scipy", "matplotlib")
SIMULATE = ("simulate", "one_link", "--method", "rk4")
WHERE = "import eomgen, eomgen.codegen as c, eomgen.templates as t; print(eomgen.__file__, c.__file__, t.__file__)"


def command(words: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run in a folder, without what would lead to the tree of these tests."""
    clean = {key: value for key, value in os.environ.items() if not key.startswith(("PYTEST", "PYTHON", "EOMGEN"))}
    return subprocess.run(words, cwd=folder, env=clean, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", BROAD)
def test_the_tests_to_be_passed_are_there(name: str) -> None:
    assert (TESTS / name).exists()


@pytest.mark.soak
@pytest.mark.parametrize("wanted", PYTHONS if WHOLE else PYTHONS[1:2])
def test_the_installed_package_passes_the_tests(wanted: str, archives: tuple[Path, Path], tmp_path: Path) -> None:
    python = interpreter(wanted)
    if python is None:
        pytest.skip(f"there is no Python {wanted} here")
    began = time.perf_counter()
    subprocess.run([python, "-m", "venv", tmp_path / "venv"], check=True, capture_output=True)
    other = str(tmp_path / "venv" / "bin" / "python")
    install = [other, "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    oracles = command([*install, "--only-binary", ":all:", *NEEDED], tmp_path)
    if oracles.returncode != 0:
        pytest.skip(f"packages cannot be installed for Python {wanted}: {oracles.stderr.strip().splitlines()[-1]}")
    done = command([*install, f"{archives[1]}[sim]"], tmp_path)
    assert done.returncode == 0, done.stderr[-3000:]
    with tarfile.open(archives[0]) as archive:
        archive.extractall(tmp_path / "source", filter="data")
    (tree,) = (tmp_path / "source").iterdir()
    where = command([other, "-c", WHERE], tree).stdout.split()
    assert len(where) == 3
    assert all(place.startswith(str(tmp_path / "venv")) for place in where), where
    here = sys.version_info[:2] == tuple(map(int, wanted.split(".")))
    files = [f"tests/{name}" for name in (BROAD if here else CORE)]
    found = command([other, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", *files], tree)
    assert found.returncode == 0, found.stdout[-6000:] + found.stderr[-2000:]
    print(f"Python {wanted}: {found.stdout.strip().splitlines()[-1]}, {time.perf_counter() - began:.0f} s in all")


def test_without_extras_a_simulation_is_whole_but_for_its_plots(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in EXTRA_MODULES:
        monkeypatch.setitem(sys.modules, name, None)
    assert cli.main([*SIMULATE, "-o", str(tmp_path)]) == 0
    shown = capsys.readouterr()
    check_simulation(shown.out, shown.err, tmp_path)
    assert cli.main(["simulate", "one_link", "-o", str(tmp_path)]) == 0  # in C
    assert cli.main(["simulate", "one_link", "-o", str(tmp_path), "--method", "Radau"]) == 1
    assert 'needs SciPy, which is not installed: pip install scipy, or pip install "eomgen[sim]"; "rk4" works' in (
        capsys.readouterr().err
    )


@pytest.mark.soak
def test_the_base_install_simulates(archives: tuple[Path, Path], tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "venv"], check=True, capture_output=True)
    python, eomgen = (str(tmp_path / "venv" / "bin" / name) for name in ("python", "eomgen"))
    done = command([python, "-m", "pip", "install", "-q", "--disable-pip-version-check", str(archives[1])], tmp_path)
    assert done.returncode == 0, done.stderr[-3000:]
    for name in EXTRA_MODULES:
        assert command([python, "-c", f"import {name}"], tmp_path).returncode == 1
    done = command([eomgen, *SIMULATE, "-o", "out"], tmp_path)
    assert done.returncode == 0, done.stderr
    check_simulation(done.stdout, done.stderr, tmp_path / "out")


def check_simulation(out: str, err: str, folder: Path) -> None:
    """The summary, the result, and one line on standard error about what is left out, beside those of long builds."""
    assert out.startswith("one_link: 2 coordinates")
    assert out.endswith(f"wrote {folder if folder.name != 'out' else Path('out')}/trajectory.npz\n")
    assert [path.name for path in folder.iterdir()] == ["trajectory.npz"]
    (line,) = (line for line in err.splitlines() if not re.fullmatch(r".*\(\d+ s\)", line))
    assert line.startswith("note: plots are left out: plots need Matplotlib, which is not installed: pip install matp")
