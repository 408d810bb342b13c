"""The wheel in fresh environments: with each Python, with the oldest dependencies, without extras."""

from __future__ import annotations

import os
import random
import re
import subprocess
import sys
import tarfile
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from eomgen.cli import entry as cli
from release.pythons import PYTHONS, interpreter
from tests.support.archives import ROOT
from tests.support.soak import WHOLE

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
QUICK = ("-m", "pytest", "-q", "-m", "quick and not soak", "-n", "0", "-p", "no:cacheprovider")
EXTRA_MODULES = ("scipy", "matplotlib")
SIMULATE = ("simulate", "one_link", "--method", "rk4")
WHERE = "import eomgen, eomgen.codegen as c, eomgen.templates as t; print(eomgen.__file__, c.__file__, t.__file__)"


def command(words: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run in a folder, without what would lead to the tree of these tests."""
    clean = {key: value for key, value in os.environ.items() if not key.startswith(("PYTEST", "PYTHON", "EOMGEN"))}
    return subprocess.run(words, cwd=folder, env=clean, capture_output=True, text=True, check=False)


@pytest.mark.soak
@pytest.mark.parametrize("version", PYTHONS if WHOLE else PYTHONS[1:2])
def test_the_quick_tests_pass(version: str, archives: tuple[Path, Path], tmp_path: Path) -> None:
    """In random order."""
    order = ("-p", "randomly", f"--randomly-seed={random.SystemRandom().randrange(1_000_000)}")
    quick_tests(version, [f"{archives[1]}[test]", "pytest-randomly"], archives, tmp_path, order)


@pytest.mark.soak
def test_the_quick_tests_pass_with_the_oldest_dependencies(archives: tuple[Path, Path], tmp_path: Path) -> None:
    pins = list(oldest([*PROJECT["dependencies"], f"{PROJECT['name']}[test]"]))
    quick_tests(PYTHONS[0], [*pins, f"{archives[1]}"], archives, tmp_path)


def oldest(requirements: Iterable[str]) -> Iterator[str]:
    """The same requirements with their lower bounds as versions; an extra of the package itself is what it requires."""
    for requirement in map(Requirement, requirements):
        if requirement.name == PROJECT["name"]:
            for extra in requirement.extras:
                yield from oldest(PROJECT["optional-dependencies"][extra])
        elif requirement.marker is None or requirement.marker.evaluate():
            (bound,) = (found.version for found in requirement.specifier if found.operator == ">=")
            yield f"{requirement.name}=={bound}"


def quick_tests(
    version: str, packages: list[str], archives: tuple[Path, Path], folder: Path, order: Sequence[str] = ()
) -> None:
    """Install packages for a Python, and run the quick tests of the source distribution there."""
    python, here = interpreter(version), str(folder / "venv" / "bin" / "python")
    if python is None:
        pytest.skip(f"Python {version} is not installed")
    pip = (here, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--only-binary", ":all:")
    for words in ((python, "-m", "venv", "venv"), (*pip, *packages)):
        done = command(words, folder)
        assert done.returncode == 0, done.stderr[-3000:]
    with tarfile.open(archives[0]) as archive:
        archive.extractall(folder / "source", filter="data")
    (tree,) = (folder / "source").iterdir()
    where = command((here, "-c", WHERE), tree).stdout.split()
    assert len(where) == 3
    assert all(place.startswith(str(folder / "venv")) for place in where), where
    done = command((here, *QUICK, *order), tree)
    assert done.returncode == 0, (order, done.stdout[-30000:] + done.stderr[-2000:])
    print(f"Python {version}, {', '.join(packages)}: {done.stdout.strip().splitlines()[-1]}")


def test_without_extras_a_simulation_is_whole_but_for_its_plots(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in EXTRA_MODULES:
        monkeypatch.setitem(sys.modules, name, None)
    assert cli.main([*SIMULATE, "-o", str(tmp_path)]) == 0
    shown = capsys.readouterr()
    check_simulation(shown.out, shown.err, tmp_path)
    assert cli.main(["simulate", "one_link", "-o", str(tmp_path)]) == 0  # in C
    assert cli.main(["simulate", "one_link", "-o", str(tmp_path), "--method", "scipy:Radau"]) == 1
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
