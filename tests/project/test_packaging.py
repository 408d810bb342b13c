"""What is shipped: the wheel against the tree, one version, light imports, optional packages, and ``make release``."""

from __future__ import annotations

import ast
import importlib.metadata
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

import eomgen
import release.__main__ as checks
from eomgen.errors import InputError
from eomgen.optional import PACKAGES, NotInstalledError, optional_import
from release.pythons import PYTHONS
from tests.support.archives import ROOT
from tests.support.refusals import refused

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


def test_a_missing_package_is_named_with_what_installs_it() -> None:
    with (
        pytest.raises(InputError) as caught,
        optional_import("SciPy", "figures of sand need", "water works"),
    ):
        raise ModuleNotFoundError("no sand")
    advice = 'pip install scipy, or pip install "eomgen[sim]"'
    assert str(caught.value) == f"figures of sand need SciPy, which is not installed: {advice}; water works"


def test_a_package_that_is_there_but_broken_is_not_called_missing() -> None:
    with (
        pytest.raises(NotInstalledError, match=r"SciPy, which cannot be imported \(libsand\.so: not found\): pip"),
        optional_import("SciPy", "figures of sand need"),
    ):
        raise ImportError("libsand.so: not found")


def test_other_errors_are_not_hidden() -> None:
    with pytest.raises(ZeroDivisionError), optional_import("SciPy", "sums need"):
        1 / 0  # noqa: B018


@pytest.mark.parametrize("package", PACKAGES)
def test_the_extra_installs_the_package(package: str) -> None:
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    name, extra = PACKAGES[package]
    assert name in [re.split("[<>=; ]", requirement)[0] for requirement in groups[extra]]
    assert name.partition("[")[0] == package.partition(" ")[0].lower()


def test_every_package_that_functions_ask_for_is_known() -> None:
    asked = set()
    for path in (ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "optional_import":
                assert isinstance(node.args[0], ast.Constant)
                asked.add(node.args[0].value)
    assert asked == set(PACKAGES)


NAMES = ("CHANGELOG.md", "CITATION.cff", "release/conda/recipe.yaml", "src/eomgen/_version.py")


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the files that name the version."""
    for name in NAMES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    monkeypatch.setattr(checks, "ROOT", tmp_path)
    return tmp_path


def test_all_files_name_one_version() -> None:
    assert checks.consistent_version() == re.findall(r'"(.+)"', (ROOT / NAMES[3]).read_text(encoding="utf-8"))[-1]


@pytest.mark.parametrize("name", NAMES[:3])
def test_another_version_is_refused(name: str, tree: Path) -> None:
    version = checks.consistent_version()
    text = (tree / name).read_text(encoding="utf-8")
    (tree / name).write_text(text.replace(version, "9.9.9", 1), encoding="utf-8")
    refused(checks.Refused, f"{re.escape(name)}: names 9.9.9; expected {re.escape(version)}", checks.consistent_version)


def test_a_changelog_without_a_date_and_other_dates_are_refused(tree: Path) -> None:
    changelog = (tree / "CHANGELOG.md").read_text(encoding="utf-8")
    for date, message in (("unreleased", "CHANGELOG.md: names no version"), ("2001-01-01", "expected one date")):
        changed = re.sub(r"\(\d{4}-\d\d-\d\d\)", f"({date})", changelog, count=1)
        (tree / "CHANGELOG.md").write_text(changed, encoding="utf-8")
        refused(checks.Refused, message, checks.consistent_version)


def test_a_tree_with_changes_is_refused(tree: Path) -> None:
    subprocess.run(["git", "init", "-q", str(tree)], check=True)
    refused(checks.Refused, r"not clean:\n\?\? CHANGELOG.md", checks.clean_tree)


def test_pythons_that_are_asked_for_must_be_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks, "unpack_debian", lambda version: None)
    refused(checks.Refused, r"Python 2\.0 is not installed", checks.interpreters, ["2.0"], required=True)


def test_versions_that_were_not_tested_are_named(
    tree: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tested = list[str]()
    archives = (tree / "CHANGELOG.md", tree / "CITATION.cff")
    monkeypatch.setattr(checks, "clean_tree", lambda: None)
    monkeypatch.setattr(checks, "build", lambda *_: archives)
    monkeypatch.setattr(checks, "interpreter", {"3.11": "a", "3.13": "b"}.get)
    monkeypatch.setattr(checks, "unpack_debian", {"3.14": "c"}.get)
    monkeypatch.setattr(checks, "check_python", lambda version, *_: tested.append(version))
    monkeypatch.setattr(sys, "argv", ["release"])
    assert checks.main() == 0
    assert tested == ["3.11", "3.13", "3.14"]
    assert "tested with Python 3.11, 3.13, 3.14; not tested: 3.12." in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", ["release", "--pythons", "3.11", "3.12"])
    assert checks.main() == 1
    assert "Python 3.12 is not installed" in capsys.readouterr().err


def test_the_recipe_for_conda_needs_what_the_package_needs() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    recipe = (ROOT / "release/conda/recipe.yaml").read_text(encoding="utf-8")
    run = recipe.partition("  run:\n")[2].partition("\ntests:")[0]
    found = {line.split("#")[0].strip(" -").replace(" ", "") for line in run.splitlines() if line.strip()}
    needed = {entry.partition(";")[0].strip() for entry in project["dependencies"]}
    assert found == needed | {f"python{project['requires-python']}", "c-compiler"}
    assert "eomgen = eomgen.cli:main" in recipe
