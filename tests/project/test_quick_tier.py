"""The quick tests pass with the oldest supported versions of all dependencies, and in any order."""

from __future__ import annotations

import random
import sys
import tarfile
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from release.pythons import PYTHONS, interpreter
from tests.project.test_installed import command
from tests.support.archives import ROOT
from tests.support.optional import needs

pytestmark = pytest.mark.soak
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
QUICK = ("-m", "pytest", "-q", "-m", "quick", "-n", "0", "-p", "no:cacheprovider")


def oldest(requirements: list[str]) -> Iterator[str]:
    """The same requirements with the lower bounds as versions; those of extras of the package itself in their place."""
    for requirement in map(Requirement, requirements):
        if requirement.name == PROJECT["name"]:
            for extra in requirement.extras:
                yield from oldest(PROJECT["optional-dependencies"][extra])
        elif requirement.marker is None or requirement.marker.evaluate():
            (bound,) = (found.version for found in requirement.specifier if found.operator == ">=")
            yield f"{requirement.name}=={bound}"


def test_with_the_oldest_dependencies(archives: tuple[Path, Path], tmp_path: Path) -> None:
    python = interpreter(PYTHONS[0])
    if python is None:
        pytest.skip(f"Python {PYTHONS[0]} is not installed")
    here = str(tmp_path / "venv" / "bin" / "python")
    pip = (here, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--only-binary", ":all:")
    pins = list(oldest([*PROJECT["dependencies"], f"{PROJECT['name']}[test]"]))
    for words in ((python, "-m", "venv", "venv"), (*pip, *pins), (*pip, "--no-deps", str(archives[1]))):
        done = command(words, tmp_path)
        assert done.returncode == 0, done.stderr[-3000:]
    with tarfile.open(archives[0]) as archive:
        archive.extractall(tmp_path / "source", filter="data")
    (tree,) = (tmp_path / "source").iterdir()
    done = command((here, *QUICK), tree)
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
    print(f"{', '.join(pins)}: {done.stdout.strip().splitlines()[-1]}")


def test_in_random_order() -> None:
    needs("pytest_randomly")
    seed = random.SystemRandom().randrange(1_000_000)
    print(f"pytest -m quick -p randomly --randomly-seed={seed}")
    done = command((sys.executable, *QUICK, "-p", "randomly", f"--randomly-seed={seed}"), ROOT)
    assert done.returncode == 0, (seed, done.stdout[-6000:] + done.stderr[-2000:])
