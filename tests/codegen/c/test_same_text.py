"""The generated text is the same to the byte whatever the hash seed, in every Python, and in the committed sample."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

import pytest

import eomgen
from eomgen.codegen.package.compile import carried_files
from eomgen.pipeline.stages import Options, generate
from eomgen.runtime.levels import BASE
from release.packages import link_package
from tests.support.pythons import PYTHONS, interpreter
from tests.support.soak import WHOLE, share

ROOT = Path(__file__).parents[3]
SEEDS = 100
LARGE_EVERY = 25  # seeds that also render 36 coordinates
TEXT = """
import hashlib, json, sys
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.codegen.c.sources import render
from eomgen import load_robot
from eomgen.robot import build_model
found = {}
for name in sys.argv[1:]:
    equations = derive_equations(build_model(load_robot(name)))
    for dtype in ("float64", "float32"):
        source = render(equations, dtype)
        text = chr(0).join((source.header, source.code, source.cdef, source.meta))
        found[f"{name} {dtype}"] = hashlib.sha256(text.encode()).hexdigest()
print(json.dumps(found))
"""
SMALL, LARGE = ("one_link", "worn_arm", "four_bar"), ("puma560_elastic", "gough", "shaken_arm", "geared_arm")
NEEDED = ("sympy", "mpmath", "numpy", "jinja2", "markupsafe", "cffi", "pycparser")  # what could change a text
OTHERS = ("setuptools", "filelock", "platformdirs", "rich")


def digests(python: str, names: tuple[str, ...], seed: int, path: str = "") -> dict[str, str]:
    """Hashes of the texts by robot and dtype, of another process."""
    environment = {**os.environ, "PYTHONHASHSEED": str(seed), "PYTHONPATH": path}
    result = subprocess.run([python, "-c", TEXT, *names], capture_output=True, text=True, check=False, env=environment)
    assert result.returncode == 0, result.stderr
    return dict(json.loads(result.stdout))


@pytest.mark.soak
@pytest.mark.parametrize("part", share(range(4), 1))
def test_a_hundred_hash_seeds(part: int) -> None:
    """Of small robots with every seed, of large ones with some."""
    began, seen = time.perf_counter(), 0
    expected = digests(sys.executable, SMALL + LARGE[:1], 12345)
    for seed in range(part, SEEDS, 4):
        names = SMALL + (LARGE[:1] if seed % LARGE_EVERY == part else ())
        for key, digest in digests(sys.executable, names, seed).items():
            assert digest == expected[key], (seed, key)
            seen += 1
    print(
        f"seeds {part}, {part + 4} ... {SEEDS - 4 + part}: {seen} texts the same, {time.perf_counter() - began:.0f} s"
    )


@pytest.mark.soak
@pytest.mark.parametrize("wanted", PYTHONS if WHOLE else PYTHONS[1:2])
def test_every_python_writes_the_same_text(wanted: str, tmp_path: Path) -> None:
    """With the same SymPy, in an environment of its own; NumPy as near as there is one for that Python."""
    python = interpreter(wanted)
    if python is None:
        pytest.skip(f"there is no Python {wanted} here")
    if sys.version_info[:2] == tuple(map(int, wanted.split("."))):
        pytest.skip("is the Python that runs")
    began = time.perf_counter()
    subprocess.run([python, "-m", "venv", tmp_path / "venv"], check=True, capture_output=True)
    other = str(tmp_path / "venv" / "bin" / "python")
    pinned = [f"{name}=={version(name)}" for name in NEEDED if name != "numpy"]
    exact, near = [f"numpy=={version('numpy')}"], ["numpy>=1.24"]
    install = [other, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--only-binary", ":all:"]
    for numpy in (exact, near):
        done = subprocess.run([*install, *pinned, *numpy, *OTHERS], capture_output=True, text=True)
        if done.returncode == 0:
            break
    if done.returncode != 0:
        pytest.skip(f"packages cannot be installed for Python {wanted}: {done.stderr.strip().splitlines()[-1]}")
    names = SMALL + LARGE
    found, expected = digests(other, names, 0, str(link_package(tmp_path / "links"))), digests(sys.executable, names, 0)
    assert found == expected
    which = subprocess.run([other, "-c", "import numpy; print(numpy.__version__)"], capture_output=True, text=True)
    print(
        f"Python {wanted}, SymPy {version('sympy')}, NumPy {which.stdout.strip()}: {len(found)} texts the same as"
        f" with {sys.version.split()[0]}, {time.perf_counter() - began:.0f} s"
    )


@pytest.mark.soak
def test_another_hash_seed_and_the_tree_as_it_lies(tmp_path: Path) -> None:
    """The short form: one seed, and the package that the long form takes, which nobody has installed."""
    here = digests(sys.executable, SMALL[:1], 0)
    assert digests(sys.executable, SMALL[:1], 1, str(link_package(tmp_path / "links"))) == here
    assert len(here) == 2


def test_the_committed_sample_is_current(tmp_path: Path) -> None:
    """``make sample`` writes it; the compiled module is not committed."""
    made = generate(eomgen.load_robot("one_link"), tmp_path, Options(flags=("-O0",), level=BASE))
    sample = ROOT / "generated" / "one_link"

    def texts(folder: Path) -> dict[str, str]:
        files = (path for path in folder.rglob("*") if path.suffix in (".py", ".c", ".h", ".json"))
        found = {path.relative_to(folder).as_posix(): path.read_text(encoding="ascii") for path in files}
        return {name: re.sub(r"by SymPy [\w.]+", "by SymPy", text) for name, text in found.items()}

    assert texts(sample) == texts(made)
    assert set(texts(sample)) == {*carried_files(), "__init__.py", "one_link.c", "one_link.h", "one_link.json"}
