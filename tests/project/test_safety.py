"""What the code may not do, read from its text: nothing of a description is run, parsed or unpacked as code."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = sorted(path for folder in ("src/eomgen", "codegen", "templates") for path in (ROOT / folder).rglob("*.py"))

BUILTINS = {"eval", "exec", "compile", "__import__", "execfile", "input", "breakpoint"}
MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "marshal", "shelve", "yaml", "ruamel", "pty", "runpy", "code"}
CALLS = {  # attributes that are called, of whatever they belong to
    *("system", "popen", "getoutput", "getstatusoutput", "spawnl", "spawnv", "execv", "execl", "execve"),
    *("parse_expr", "parse_latex", "import_module", "exec_module", "read_pickle", "unsafe_load", "S", "sympify"),
}
ALLOWED = {  # file, what is called, and why that is no text of a description
    ("src/eomgen/lazily.py", "import_module"): "modules of a package of eomgen, by its table of names",
    ("src/eomgen/runtime/__init__.py", "import_module"): "modules of this package, by its table of names",
    (
        "src/eomgen/description/macros.py",
        "import_module",
    ): "ROS's index of packages, where ROS is; xacro imports it, too",
    ("src/eomgen/runtime/direct.py", "import_module"): "the one extension module that lies beside it",
    ("src/eomgen/pipeline/load.py", "exec_module"): "the extension module of a package whose hash was checked",
    ("src/eomgen/pipeline/load.py", "compile"): "declarations of a package without Python's headers; hash checked too",
    ("src/eomgen/pipeline/load.py", "exec"): "the same",
    ("src/eomgen/adapters/jax.py", "compile"): "a module that was rendered just now: numbers, and names as literals",
    ("src/eomgen/adapters/jax.py", "exec"): "the same",
    ("codegen/closed_form/trace.py", "sympify"): "numbers and expressions, which the test below makes sure of",
    ("codegen/closed_form/exact_numbers.py", "sympify"): "the same",
}


def found(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Calls and imports that are not allowed without a reason, with their lines."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            names = [alias.name for alias in node.names]
            modules = [node.module or ""] if isinstance(node, ast.ImportFrom) else names
            yield from ((name, node.lineno) for name in modules if name.split(".")[0] in MODULES)
            yield from ((name, node.lineno) for name in names if name in {*CALLS, *BUILTINS} - {"compile"})
        if not isinstance(node, ast.Call):
            continue
        name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
        keywords = {keyword.arg: keyword.value for keyword in node.keywords}
        if (name in CALLS and ast.unparse(node.func) != "platform.system") or (
            name in BUILTINS and isinstance(node.func, ast.Name)
        ):
            yield name, node.lineno
        if "shell" in keywords:
            yield "shell", node.lineno
        if (
            ast.unparse(node.func) in ("np.load", "numpy.load")
            and ast.unparse(keywords.get("allow_pickle", ast.Constant(True))) != "False"
        ):
            yield "np.load", node.lineno
        if name == "Environment" and ast.unparse(keywords.get("undefined", ast.Constant(None))) != (
            "jinja2.StrictUndefined"
        ):
            yield "Environment", node.lineno


@cache
def calls_of(path: Path) -> list[tuple[str, int]]:
    return list(found(ast.parse(path.read_text(encoding="utf-8"))))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_nothing_is_run_that_was_read(path: Path) -> None:
    file = path.relative_to(ROOT).as_posix()
    calls = calls_of(path)
    assert not [call for call in calls if (file, call[0]) not in ALLOWED]


def test_every_exception_is_needed() -> None:
    used = {(path.relative_to(ROOT).as_posix(), name) for path in FILES for name, _ in calls_of(path)}
    assert used == set(ALLOWED)
    assert len(FILES) > 120


@pytest.mark.parametrize(
    "text",
    [
        "eval(x)",
        "import pickle",
        "from yaml import load",
        "subprocess.run(x, shell=True)",
        "os.system(x)",
        "sp.S(x)",
        "from sympy import sympify",
        "np.load(path)",
        "np.load(path, allow_pickle=True)",
        "jinja2.Environment(loader=x)",
        "importlib.import_module(name)",
    ],
)
def test_what_is_looked_for_is_found(text: str) -> None:
    assert list(found(ast.parse(text)))


def test_no_text_becomes_an_expression(monkeypatch: pytest.MonkeyPatch) -> None:
    """sympify of a string would run it: in all that a closed form takes, none comes."""
    import sympy as sp

    import eomgen
    from eomgen.codegen.closed_form import trace
    from eomgen.codegen.closed_form.readable import readable_closed_form
    from eomgen.robot.model import build_model

    came: set[type] = set()
    plain = sp.sympify

    def watched(value: object, *arguments: object, **options: object) -> object:
        came.add(type(value))
        return plain(value, *arguments, **options)

    monkeypatch.setattr(trace.sp, "sympify", watched)
    for numbers in (False, True):
        readable_closed_form(build_model(eomgen.load_robot("one_link")), numbers=numbers)
    assert came
    assert not any(issubclass(kind, (str, bytes)) for kind in came)
