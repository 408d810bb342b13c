"""The packages: who may import whom, how many modules share a folder, what the facade shows."""

from __future__ import annotations

import ast
import importlib.util
import json
import os
import py_compile
import re
import rlcompleter
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

import eomgen
from release.packages import link_package, packages, with_packages
from tests.support import first_words
from tests.support.soak import soaked

ROOT = Path(__file__).parents[2]
PLACES = {"src/eomgen": "eomgen", "codegen": "eomgen.codegen", "templates": "eomgen.templates"}
MOST_MODULES, MOST_WORDS = 16, 1500
SUBPACKAGES = (  # that users reach through the facade
    *(
        "analysis",
        "control",
        "description",
        "identification",
        "integration",
        "loops",
        "motion",
        "pictures",
        "robot",
        "scenario",
    ),
    *("simulation", "sweep"),
)


def modules() -> Iterator[tuple[str, Path]]:
    """Full name and file of every module of the tree."""
    for place, package in PLACES.items():
        for path in sorted((ROOT / place).rglob("*.py")):
            parts = path.relative_to(ROOT / place).with_suffix("").parts
            yield ".".join((package, *parts)).removesuffix(".__init__"), path


MODULES = dict(modules())


@dataclass(frozen=True)
class Parsed:
    """What tests look at of a module: its docstring, imports, functions and classes."""

    docstring: str
    imports: tuple[ast.Import | ast.ImportFrom, ...]
    defined: frozenset[str]


@cache
def parsed(path: Path) -> Parsed:
    """Parse a module once for all tests; whole trees would take much memory."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return Parsed(
        ast.get_docstring(tree) or "",
        tuple(node for node in ast.walk(tree) if isinstance(node, (ast.Import, ast.ImportFrom))),
        frozenset(node.name for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))),
    )


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
    links = link_package(tmp_path / "links")
    shutil.copytree(links / "eomgen", tmp_path / "eomgen", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


LAYERS = "A package uses packages of lower layers only"
BROKEN = [
    ("robot/value/robot.py", "from eomgen.pipeline import build", LAYERS),
    ("runtime/calls.py", "from eomgen.robot.value import Robot", "What a generated package carries"),
    ("integration/solve.py", "from eomgen.codegen.c.source import Source", "An integration builds nothing"),
    ("errors.py", "import matplotlib", "import eomgen brings neither"),
    ("cli/shared/reading.py", "from eomgen.cli.bench import COMMANDS", "No group of commands uses another"),
]
FURTHER = [
    ("loops/closed.py", "from eomgen.integration.solve import integrate", LAYERS),
    ("codegen/tree/bound.py", "from eomgen.codegen.c import sources", "The generator goes one way"),
    ("runtime/calls.py", "import scipy", "What a generated package carries"),
    ("robot/geometry.py", "from .value import Robot", "No modules or packages use each other in a circle"),
    ("surprise.py", "", LAYERS),
    ("cli/bench.py", "from eomgen.cli.cache import COMMANDS", "No group of commands uses another"),
    ("cli/surprise.py", "", "No group of commands uses another"),
]


@pytest.mark.parametrize(("module", "line", "contract"), soaked([*BROKEN, *FURTHER], BROKEN[:2]))
def test_an_import_of_a_higher_layer_is_seen(module: str, line: str, contract: str, copy: Path) -> None:
    path = copy / "eomgen" / module
    path.write_text((path.read_text(encoding="utf-8") if path.exists() else "") + f"\n{line}\n", encoding="utf-8")
    done = lint(copy)
    assert done.returncode == 1, done.stdout + done.stderr
    assert re.search(rf"{contract}.*BROKEN|Modules missing from layers: .*surprise", done.stdout), done.stdout


def test_every_package_uses_lower_layers(copy: Path) -> None:
    done = lint(copy)
    assert done.returncode == 0, done.stdout + done.stderr
    assert " 0 broken" in done.stdout


def test_no_package_is_crowded() -> None:
    for place in ("src/eomgen", "codegen"):
        for folder in {path.parent for path in (ROOT / place).rglob("*.py")}:
            assert len(list(folder.glob("*.py"))) - 1 <= MOST_MODULES, folder


def test_every_package_says_what_it_is_for() -> None:
    """In two to four lines, in its ``__init__.py``."""
    for name, path in MODULES.items():
        if path.name == "__init__.py" and name != "eomgen":
            text = parsed(path).docstring
            assert 1 <= len(text.splitlines()) <= 4, name


def package_of(module: str) -> str:
    """The package, ``eomgen.robot`` or ``eomgen.codegen.tree``, that a module is in; "" for the root's."""
    package = ".".join(module.split(".")[: 3 if module.startswith("eomgen.codegen.") else 2])
    return package if package != "eomgen" and package in MODULES and MODULES[package].name == "__init__.py" else ""


def imported(module: str, path: Path) -> Iterator[str]:
    """Full names of what a module imports from."""
    package = module.split(".") if path.name == "__init__.py" else module.split(".")[:-1]
    for node in parsed(path).imports:
        if isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            yield ".".join([*above, node.module] if node.module else above)
        else:
            yield from (alias.name for alias in node.names)


def test_every_package_says_what_it_uses() -> None:
    """Behind "Uses" in its ``__init__.py`` are all packages that its modules import from."""
    seen = 0
    for module, path in MODULES.items():
        package = package_of(module)
        text = parsed(MODULES[package]).docstring if package else ""
        said = set(re.findall(r"\w+", text.partition("Uses ")[2]))
        for name in imported(module, path):
            other = package_of(name)
            if package and other not in ("", package, "eomgen.codegen") and "all packages" not in text:
                assert other.rpartition(".")[2] in said, f"{module} imports from {other}, which {package} does not name"
                seen += 1
    assert seen > 300


def test_no_private_name_is_imported() -> None:
    for name, path in MODULES.items():
        for node in parsed(path).imports:
            if isinstance(node, ast.ImportFrom) and (node.level or (node.module or "").startswith("eomgen")):
                private = [alias.name for alias in node.names if alias.name.startswith("_")]
                assert set(private) <= {"__version__", "_version"}, (name, private)


def test_no_module_has_the_name_of_what_is_in_it() -> None:
    """A package that re-exported ``modes`` from a module ``modes`` would have one name for two things."""
    for name, path in MODULES.items():
        assert name.rpartition(".")[2] not in parsed(path).defined, name


def test_the_page_of_the_architecture_is_short() -> None:
    """It has at most 1,500 words, the only table is that of the packages, and files that it names exist."""
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert len(page.split()) <= MOST_WORDS
    assert len(re.findall(r"(?m)^\|[-:|]+\|$", page)) == 1
    named = re.findall(r"`((?:src|codegen|templates|tests)/[\w/.]+)`", page)
    assert len(named) > 30
    assert [name for name in named if not (ROOT / name).exists()] == []


# The facade


def test_the_facade_shows_what_it_has() -> None:
    assert sorted(eomgen.__all__) == eomgen.__all__
    assert len(set(eomgen.__all__)) == len(eomgen.__all__)
    assert set(eomgen.__all__) <= set(dir(eomgen))
    for name in eomgen.__all__:
        assert getattr(eomgen, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        eomgen.nothing  # noqa: B018


@pytest.mark.parametrize("package", ["", *SUBPACKAGES])
def test_tab_completes_public_names_alone(package: str) -> None:
    """No module or helper that a package imports for itself, however many of them are imported by now."""
    module = importlib.import_module(f"eomgen.{package}".rstrip("."))
    own = {name for name in dir(module) if not name.startswith("__")}
    assert own == {name for name in (*module.__all__, *(() if package else SUBPACKAGES)) if not name.startswith("__")}


def test_packages_are_reached_through_the_facade() -> None:
    """``eomgen.analysis`` needs no import of its own, and is in what Tab completes."""
    code = f"""
import sys
import eomgen
names = {set(SUBPACKAGES)!r}
assert names <= set(dir(eomgen)) - set(eomgen.__all__)
assert not any("eomgen." + name in sys.modules for name in names)
assert all(getattr(eomgen, name) is sys.modules["eomgen." + name] for name in names)
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_packages_that_threads_import_at_once_stay_lazy() -> None:
    """No import that a package puts off is made."""
    code = f"""
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
names = ["eomgen." + name for name in {SUBPACKAGES!r}]
with ThreadPoolExecutor(len(names)) as pool:
    found = dict(zip(names, pool.map(import_module, names)))
assert not {{"eomgen.robot.value", "eomgen.pictures.robot", "eomgen.errors", "numpy"}} & set(sys.modules)
assert all(getattr(package, name) is not None for package in found.values() for name in package.__all__)
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_each_name_that_type_checkers_see_is_there_at_run_time() -> None:
    """Names are found in the text of packages, whatever the form of their imports."""
    seen = 0
    for name, path in MODULES.items():
        if path.name == "__init__.py" and "lazy_names(" in path.read_text(encoding="utf-8"):
            imports = [node for node in parsed(path).imports if node.col_offset > 0]
            names = [alias.asname for node in imports for alias in node.names]
            own = {x for x in dir(importlib.import_module(name)) if x[:2] != "__"}
            assert own == {x for x in names if x != "__version__"}, name
            assert len(set(names)) == len(names), name
            seen += len(names)
    assert seen > 250


def test_packages_in_a_zip_file_find_their_names(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "some.zip", "w") as archive:
        for name in ("lazily", "loops"):
            path, text = MODULES[f"eomgen.{name}"], MODULES[f"eomgen.{name}"].read_text(encoding="utf-8")
            archive.writestr(path.relative_to(ROOT / "src").as_posix(), text.replace("\n", "\r\n"))
        archive.writestr("eomgen/__init__.py", "")
        archive.writestr("eomgen/loops/equilibrium.py", "closed_equilibrium = 1")
    code = "import eomgen.loops as x; assert x.closed_equilibrium == 1 and x.__all__[-1] == 'redundancy'"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "some.zip")}
    subprocess.run([sys.executable, "-S", "-c", code], check=True, env=environment)


def test_a_package_without_source_says_so(tmp_path: Path) -> None:
    (tmp_path / "bare").mkdir()
    source = tmp_path / "source.py"
    source.write_text("from eomgen.lazily import lazy_names\nlazy_names(__name__)\n", encoding="ascii")
    py_compile.compile(str(source), str(tmp_path / "bare" / "__init__.pyc"))
    done = subprocess.run([sys.executable, "-c", "import bare"], cwd=tmp_path, capture_output=True, text=True)
    assert re.search(r"ImportError: bare: .*__init__.pyc holds no source; allowed: packages with ", done.stderr)


def test_tab_completes_the_facade() -> None:
    matches = rlcompleter.Completer({"eomgen": eomgen}).attr_matches("eomgen.")
    found = {match.removeprefix("eomgen.").rstrip("()") for match in matches}
    assert {name for name in eomgen.__all__ if not name.startswith("_")} <= found
    assert not {"Any", "annotations", "import_module"} & found


@pytest.mark.soak
def test_type_checkers_see_all_of_the_facade(tmp_path: Path) -> None:
    """Every name has a type, and a name that is not there is an error."""
    names = [name for name in eomgen.__all__ if name != "__version__"] + list(SUBPACKAGES)
    lines = ["import eomgen", *(f"reveal_type(eomgen.{name})" for name in names), "eomgen.nothing"]
    (tmp_path / "user.py").write_text("\n".join(lines) + "\n", encoding="ascii")
    command = [sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml"), "user.py"]
    environment = {**os.environ, "MYPYPATH": str(link_package(tmp_path / "links"))}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    types = dict(re.findall(r'^user.py:(\d+): note: Revealed type is "(.*)"$', done.stdout, re.MULTILINE))
    assert [types[str(line)] for line in range(2, len(names) + 2) if types[str(line)] == "Any"] == []
    assert types[str(names.index("build") + 2)].endswith("-> eomgen.kernel.complete.Kernel")
    said = [line for line in done.stdout.splitlines() if ": error: " in line or line.startswith("Found")]
    assert [line for line in said if ": note: " not in line] == [
        f'user.py:{len(lines)}: error: Module has no attribute "nothing"  [attr-defined]',
        "Found 1 error in 1 file (checked 1 source file)",
    ]


def test_the_facade_stays_what_it_is_after_all_modules_are_imported() -> None:
    """No package or module takes the place of a function: ``eomgen.build`` is callable before and after."""
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
heavy = ("numpy", "sympy", "scipy", "matplotlib", "cffi", "jinja2", "setuptools", "rich", "casadi", "jax", "torch")
print(json.dumps([name for name in heavy if name in sys.modules]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == []


def test_the_packages_of_the_wheel_are_those_of_the_tree() -> None:
    """``make packages`` writes the list."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    names = packages()
    assert names == sorted(name for name, path in MODULES.items() if path.name == "__init__.py")
    assert text == with_packages(text, names), "make packages"
    assert [name for name in names if importlib.util.find_spec(name) is None] == []


def test_a_list_of_packages_is_written_anew(tmp_path: Path) -> None:
    for place in PLACES:
        for folder in ("", "deep", "deep/deeper"):
            (tmp_path / place / folder).mkdir(parents=True, exist_ok=True)
            (tmp_path / place / folder / "__init__.py").touch()
    inner = ("", ".deep", ".deep.deeper")
    assert packages(tmp_path) == sorted(package + name for package in PLACES.values() for name in inner)
    before = '[tool.setuptools]\npackages = [\n  "gone",\n]\ninclude-package-data = false\n'
    after = before.replace('"gone"', '"eomgen",\n  "eomgen.codegen"')
    assert with_packages(before, ["eomgen", "eomgen.codegen"]) == after


def test_links_make_one_package_of_the_source(tmp_path: Path) -> None:
    """Every module of the tree and no other; a folder of links that was there before is replaced."""
    for _ in range(2):
        links = link_package(tmp_path / "links")
        (links / "eomgen" / "gone.py").touch()
    (links / "eomgen" / "gone.py").unlink()
    found = [Path(folder, name) for folder, _, names in os.walk(links, followlinks=True) for name in names]
    assert sorted(x.resolve() for x in found if x.suffix == ".py") == sorted(MODULES.values())


def test_docstrings_that_lean_on_what_stands_before_are_seen() -> None:
    """Whose first word is "Of", "What", "Where" or of that kind; ``make lint`` refuses them."""
    text = '"""Arms."""\nclass A:\n    """Of x."""\n    def f(self):\n        """Where it is.\n\n        More."""\n'
    assert list(first_words.leaning(text)) == [(2, "A", "Of x."), (4, "f", "Where it is.")]
    assert len(list(first_words.modules())) > 500
    assert "-m tests.support.first_words" in (ROOT / "Makefile").read_text(encoding="utf-8")
