"""What is shipped: the wheel against the tree, one version, light imports."""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

import eomgen
from release.pythons import PYTHONS
from tests.support.archives import ROOT

PLACES = {
    "src/eomgen": "eomgen",
    "codegen": "eomgen/codegen",
    "templates": "eomgen/templates",
}  # in the tree, in the wheel
SHIPPED = (".py", ".c", ".h", ".csv", ".toml", ".json", ".jinja", ".typed", ".mjs", ".js", ".css", ".txt")


@pytest.fixture(scope="module")
def wheel(archives: tuple[Path, Path]) -> Path:
    return archives[1]


@pytest.mark.soak
def test_the_source_distribution_holds_what_is_kept_under_version_control(archives: tuple[Path, Path]) -> None:
    """All of it but .gitignore: tests, documentation and examples too."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a clone")
    listed = subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True)
    expected = {name for name in listed.stdout.splitlines() if (ROOT / name).is_file()} - {".gitignore"}
    with tarfile.open(archives[0]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames() if archive.getmember(name).isfile()}
    assert {"tests/conftest.py", "docs/theory.md", "Makefile", ".ci/run", "CITATION.cff"} <= expected
    made = {name for name in names if ".egg-info/" in name} | {"PKG-INFO", "setup.cfg"}
    assert names - made == expected


@pytest.mark.soak
def test_an_index_can_show_them(archives: tuple[Path, Path]) -> None:
    command = [sys.executable, "-m", "twine", "check", "--strict", *map(str, archives)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    assert result.stdout.count("PASSED") == 2


def test_to_make_them_takes_two_tools(tmp_path: Path) -> None:
    """In an empty environment ``make wheel`` installs what builds and checks, and nothing that is built."""
    if shutil.which("make") is None:
        pytest.skip("there is no make here")
    command = ["make", "-n", "wheel", f"VENV={tmp_path / 'venv'}"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    (words,) = [shlex.split(line) for line in done.stdout.splitlines() if " pip install " in line]
    installed = [word for word in words[words.index("install") + 1 :] if not word.startswith("-")]
    assert [re.split("[<>=]", word)[0] for word in installed] == ["build", "twine"]


def test_the_classifiers_name_the_pythons_that_tests_install_it_for(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        metadata = archive.read(f"eomgen-{eomgen.__version__}.dist-info/METADATA").decode()
    found = re.findall(r"^Classifier: Programming Language :: Python :: (3\.\d+)$", metadata, re.MULTILINE)
    assert tuple(found) == PYTHONS
    assert f"\nRequires-Python: >={PYTHONS[0]}\n" in metadata


def test_the_wheel_holds_what_the_tree_holds(wheel: Path) -> None:
    """Nothing is forgotten and nothing left over; file by file the same bytes."""
    expected = {}
    for folder, place in PLACES.items():
        for path in (ROOT / folder).rglob("*"):
            if path.is_file() and path.suffix in SHIPPED:
                expected[f"{place}/{path.relative_to(ROOT / folder).as_posix()}"] = path.read_bytes()
    with zipfile.ZipFile(wheel) as archive:
        found = {name: archive.read(name) for name in archive.namelist() if ".dist-info/" not in name}
    assert sorted(found) == sorted(expected)
    assert found == expected
    assert {"eomgen/py.typed", "eomgen/templates/kernel/kernel.c.jinja", "eomgen/robots/one_link.toml"} <= set(found)


def test_metadata_of_the_wheel(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        folder = f"eomgen-{eomgen.__version__}.dist-info"
        metadata = archive.read(f"{folder}/METADATA").decode()
        assert archive.read(f"{folder}/entry_points.txt").decode().split() == [
            "[console_scripts]",
            "eomgen",
            "=",
            "eomgen.cli:main",
        ]
        assert any(name.endswith("LICENSE") for name in archive.namelist())
    assert f"\nVersion: {eomgen.__version__}\n" in metadata
    required = re.findall(r"^Requires-Dist: ([A-Za-z0-9_-]+)(?!.*extra ==)", metadata, re.MULTILINE)
    assert {"sympy", "numpy", "jinja2", "cffi", "setuptools"} <= set(required)
    assert not {"scipy", "matplotlib", "pytest", "pin"} & set(required)


@pytest.mark.soak
def test_the_wheel_works_by_itself(wheel: Path, tmp_path: Path) -> None:
    """Unpacked somewhere else, it derives, renders, compiles and runs."""
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    code = """
        import json
        import eomgen, eomgen.codegen, eomgen.templates
        kernel = eomgen.build(eomgen.load_robot("one_link"), kernels=("mass_matrix",), flags=("-O0",))
        print(json.dumps([eomgen.__file__, eomgen.codegen.__file__, kernel.mass_matrix([0.0, 0.0])[0, 0]]))
    """
    package, generator, mass = run(code, PYTHONPATH=str(tmp_path / "site"), EOMGEN_CACHE_DIR=str(tmp_path / "cache"))
    assert package == str(tmp_path / "site" / "eomgen" / "__init__.py")
    assert generator == str(tmp_path / "site" / "eomgen" / "codegen" / "__init__.py")
    assert mass == 1.0


def run(code: str, **variables: str) -> list[object]:
    lines = [line[8:] for line in code.strip("\n").splitlines()]
    command, environment = [sys.executable, "-c", "\n".join(lines)], {**os.environ, **variables}
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    answer: list[object] = json.loads(result.stdout)
    return answer


def test_the_version_is_written_once() -> None:
    assert importlib.metadata.version("eomgen") == eomgen.__version__
    text = re.escape(eomgen.__version__)
    files = [ROOT / "pyproject.toml"]
    files += [path for folder in (*PLACES, "tests") for path in (ROOT / folder).rglob("*") if path.suffix in SHIPPED]
    files = [path for path in files if "results" not in path.parts]  # kept results say what wrote them
    found = [path.name for path in files if re.search(rf"(?<![\d.]){text}(?![\d.])", path.read_text(encoding="utf-8"))]
    assert found == ["_version.py"]
