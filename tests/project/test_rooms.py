"""The rooms of the code: who may import whom, how many modules share a folder, what the facade shows."""

from __future__ import annotations

import ast
import json
import os
import pkgutil
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import eomgen

ROOT = Path(__file__).parents[2]
EOMGEN = Path(eomgen.__path__[0])
PLACES = {"src/eomgen": "eomgen", "codegen": "eomgen.codegen", "templates": "eomgen.templates"}
MOST_MODULES = 16


def modules() -> Iterator[tuple[str, Path]]:
    """Full name and file of every module of the tree."""
    for place, package in PLACES.items():
        for path in sorted((ROOT / place).rglob("*.py")):
            parts = path.relative_to(ROOT / place).with_suffix("").parts
            yield ".".join((package, *parts)).removesuffix(".__init__"), path


MODULES = dict(modules())


def lint(tree: Path) -> subprocess.CompletedProcess[str]:
    """``lint-imports`` on the package in a folder, by the contracts of pyproject.toml."""
    command = [
        str(Path(sys.executable).with_name("lint-imports")),
        "--no-cache",
        "--config",
        str(ROOT / "pyproject.toml"),
    ]
    return subprocess.run(
        command, cwd=tree, env={**os.environ, "PYTHONPATH": str(tree)}, capture_output=True, text=True
    )


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A folder with a copy of the package, which a test may spoil."""
    shutil.copytree(EOMGEN, tmp_path / "eomgen", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


@pytest.mark.parametrize(
    ("module", "line", "contract"),
    [
        ("robot/value.py", "from eomgen.pipeline import build", "A room uses rooms below it only"),
        ("loops/closed.py", "from eomgen.integration.solve import integrate", "A room uses rooms below it only"),
        ("codegen/tree/bound.py", "from eomgen.codegen.c import sources", "The generator goes one way"),
        ("runtime/calls.py", "from eomgen.robot.value import Robot", "What a generated package carries"),
        ("runtime/calls.py", "import scipy", "What a generated package carries"),
        ("integration/solve.py", "from eomgen.codegen.c.source import Source", "An integration builds nothing"),
        ("errors.py", "import matplotlib", "import eomgen brings neither"),
        ("surprise.py", "", "A room uses rooms below it only"),
        ("cli/bench.py", "from eomgen.cli.cache import COMMANDS", "No group of commands uses another"),
        ("cli/shared.py", "from eomgen.cli.bench import COMMANDS", "No group of commands uses another"),
        ("cli/surprise.py", "", "No group of commands uses another"),
    ],
)
def test_an_import_of_the_wrong_room_is_seen(module: str, line: str, contract: str, copy: Path) -> None:
    path = copy / "eomgen" / module
    path.write_text((path.read_text(encoding="utf-8") if path.exists() else "") + f"\n{line}\n", encoding="utf-8")
    done = lint(copy)
    assert done.returncode == 1, done.stdout + done.stderr
    assert re.search(rf"{contract}.*BROKEN|Modules missing from layers: .*surprise", done.stdout), done.stdout


def test_every_room_uses_those_below_it(copy: Path) -> None:
    done = lint(copy)
    assert done.returncode == 0, done.stdout + done.stderr
    assert " 0 broken" in done.stdout


def test_no_room_is_crowded() -> None:
    for place in ("src/eomgen", "codegen"):
        for folder in {path.parent for path in (ROOT / place).rglob("*.py")}:
            assert len(list(folder.glob("*.py"))) - 1 <= MOST_MODULES, folder


def test_every_room_says_what_it_is_for() -> None:
    """In two to four lines, in its ``__init__.py``."""
    for name, path in MODULES.items():
        if path.name == "__init__.py" and name != "eomgen":
            text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
            assert 1 <= len(text.splitlines()) <= 4, name


def test_no_private_name_is_imported() -> None:
    for name, path in MODULES.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.level or (node.module or "").startswith("eomgen")):
                private = [alias.name for alias in node.names if alias.name.startswith("_")]
                assert set(private) <= {"__version__", "_version"}, (name, private)


def test_no_module_has_the_name_of_what_is_in_it() -> None:
    """A room that re-exported ``modes`` from a module ``modes`` would have one name for two things."""
    for name, path in MODULES.items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        defined = {node.name for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
        assert name.rpartition(".")[2] not in defined, name


# The facade


def test_the_facade_shows_what_it_has() -> None:
    assert sorted(eomgen.__all__) == eomgen.__all__
    assert len(set(eomgen.__all__)) == len(eomgen.__all__)
    assert set(eomgen.__all__) <= set(dir(eomgen))
    for name in eomgen.__all__:
        assert getattr(eomgen, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        eomgen.nothing  # noqa: B018


def test_type_checkers_see_all_of_the_facade() -> None:
    tree = ast.parse((ROOT / "src/eomgen/__init__.py").read_text(encoding="utf-8"))
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert set(eomgen.__all__) <= imported


def test_the_facade_stays_what_it_is_after_all_modules_are_imported() -> None:
    """No room or module takes the place of a function: ``eomgen.build`` is callable before and after."""
    code = f"""
import importlib, json, types
import eomgen
wrong = []
for moment in ("before", "after"):
    for name in eomgen.__all__:
        value = getattr(eomgen, name)
        if isinstance(value, types.ModuleType) or (name != "__version__" and not callable(value)):
            wrong.append((moment, name))
    for module in {sorted(set(MODULES) - {"eomgen.__main__"})!r}:
        importlib.import_module(module)
print(json.dumps(wrong))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == []


def test_importing_eomgen_is_light() -> None:
    code = """
import json, sys
import eomgen
heavy = ("numpy", "sympy", "scipy", "matplotlib", "cffi", "jinja2", "setuptools", "rich", "casadi", "jax")
print(json.dumps([name for name in heavy if name in sys.modules]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == []


def test_the_packages_of_the_wheel_are_those_of_the_tree() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    listed = re.findall(r'"([\w.]+)"', re.findall(r"^packages = \[(.*?)\]", text, re.MULTILINE | re.DOTALL)[0])
    assert listed == sorted(name for name, path in MODULES.items() if path.name == "__init__.py")
    found = {module.name for module in pkgutil.walk_packages(eomgen.__path__, "eomgen.") if module.ispkg}
    assert found == set(listed) - {"eomgen"}


def test_the_makefile_sees_every_file(tmp_path: Path) -> None:
    """A file in any folder of a room asks for a new installation, which links file by file."""
    shutil.copy(ROOT / "Makefile", tmp_path)
    for place in PLACES:
        (tmp_path / place / "deep" / "deeper").mkdir(parents=True)

    def files() -> str:
        command = ["make", "-s", "--eval", "show:;@echo $(STAMP)", "show"]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True).stdout

    stamps = {files()}
    for place in PLACES:
        (tmp_path / place / "deep" / "deeper" / "new.py").touch()
        stamps.add(files())
    assert len(stamps) == 1 + len(PLACES)
