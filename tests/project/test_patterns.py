"""Regular expressions take time in proportion to the text, whatever stands in it, and no description is run as code.

Each pattern is taken from the source, and tried, in the ways in which it is used, on texts that its own structure
suggests: what it begins with, then what one of its repeats takes, 20,000 times, then what does not fit. A pattern of
quadratic time takes 2e8 steps for one of them, a linear one 4e4; between them lie 0.3 s of processor time.

What the code may not do at all is read from its text: nothing of a description is run, parsed or unpacked as code.
"""

from __future__ import annotations

import ast
import importlib
import re
import signal
from collections.abc import Callable, Container, Iterator
from functools import cache
from pathlib import Path
from re import _constants as sre  # type: ignore[attr-defined]
from re import _parser as parser  # type: ignore[attr-defined]
from typing import Any

import pytest

from tests.support.fuzzing import ROOT, TooSlowError, late

SOURCES = {"eomgen": "src/eomgen", "eomgen.codegen": "codegen"}  # all that is installed
LENGTH = 20_000
SECONDS = 0.3  # of processor time
METHODS = ("match", "search", "fullmatch", "sub", "subn", "split", "findall", "finditer")
ENDS = ("", "!", "\n", "\0", '"', "0")
UNITS = (*"0a _.,\"'\\\n-([<#:/", "\r\n", '\\"', "0.", '""')
REPEATS = (sre.MAX_REPEAT, sre.MIN_REPEAT, sre.POSSESSIVE_REPEAT)
CLASSES = {sre.CATEGORY_DIGIT: "0", sre.CATEGORY_SPACE: " ", sre.CATEGORY_WORD: "a", sre.CATEGORY_NOT_DIGIT: "a"}
CLASSES |= {sre.CATEGORY_NOT_SPACE: "a", sre.CATEGORY_NOT_WORD: "-"}
HEAVY = {  # modules of whose patterns many are tried, or with long texts
    *("eomgen.identification.calibration.as_toml", "eomgen.forms.toml_place"),
    *("eomgen.forms.toml_text", "eomgen.export.wasm.layout"),
}


def texts_of() -> Iterator[tuple[str, str]]:
    """Module and text of each file."""
    for package, folder in ((name, ROOT / path) for name, path in SOURCES.items()):
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            name = ".".join((package, *(part for part in parts if part != "__init__")))
            yield name, path.read_text(encoding="utf-8")


def literal(node: ast.expr) -> str | bytes | None:
    """The text of a pattern, a word where it holds a value."""
    if isinstance(node, ast.Constant) and isinstance(node.value, (str, bytes)):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "word" for part in node.values)
    return None


def used(name: str, texts: list[str]) -> set[str]:
    """Methods that are called of a compiled pattern; ``match`` where it is handed on."""
    found = {way for text in texts for way in re.findall(rf"\b{name}\.({'|'.join(METHODS)})\b", text)}
    return found or {"match"}


@cache
def patterns() -> dict[tuple[str, str], tuple[re.Pattern[Any], set[str]]]:
    """Patterns of the project by module and text, each with the methods that it is used with."""
    found: dict[tuple[str, str], tuple[re.Pattern[Any], set[str]]] = {}
    files = list(texts_of())
    for module, text in files:
        if not re.search(r"\bre\.", text):
            continue
        tree = ast.parse(text)
        outside = (x for x in tree.body if not isinstance(x, (ast.FunctionDef, ast.ClassDef)))
        top = {id(node) for statement in outside for node in ast.walk(statement)}
        if "re.compile" in text:
            for name, value in vars(importlib.import_module(module)).items():
                several = value if isinstance(value, tuple) else (value,)
                for one in (each for each in several if isinstance(each, re.Pattern)):
                    texts = [text] if name.startswith("_") else [each for _, each in files]
                    found[module, str(one.pattern)] = one, used(name, texts)
        for node in (x for x in ast.walk(tree) if isinstance(x, ast.Call)):
            way = ast.unparse(node.func).removeprefix("re.")
            pattern = literal(node.args[0]) if way in (*METHODS, "compile") and node.args else None
            if f"re.{way}" != ast.unparse(node.func) or pattern is None or (way == "compile" and id(node) in top):
                continue
            flags = re.DOTALL if re.search(r"\bre\.(S|DOTALL)\b", ast.unparse(node)) else 0
            one, ways = found.get((module, str(pattern)), (re.compile(pattern, flags), set()))
            found[module, str(pattern)] = one, ways | {"fullmatch" if way == "compile" else way}
    return found


def sample(items: Any) -> str:
    """A short text that a parsed pattern takes, as far as that can be said from its parts."""
    text = ""
    for kind, value in items:
        if kind is sre.LITERAL:
            text += chr(value)
        elif kind is sre.NOT_LITERAL:
            text += "a" if value != ord("a") else "b"
        elif kind is sre.ANY:
            text += "a"
        elif kind is sre.IN:
            text += one_of(value)
        elif kind is sre.BRANCH:
            text += sample(value[1][0])
        elif kind is sre.SUBPATTERN:
            text += sample(value[-1])
        elif kind in REPEATS:
            text += sample(value[2]) * min(value[0], 20)
        elif kind is sre.ATOMIC_GROUP:
            text += sample(value)
        elif kind is sre.ASSERT and value[0] < 0:
            text += sample(value[1])
    return text


def one_of(value: Any) -> str:
    """A character of a class."""
    if value[0][0] is sre.NEGATE:
        taken = re.compile("[" + "".join(re.escape(one_of([each])) for each in value[1:]) + "]")
        return next((char for char in "a0 -\n" if not taken.match(char)), "~")
    kind, item = value[0]
    if kind is sre.LITERAL:
        return chr(item)
    return chr(item[0]) if kind is sre.RANGE else CLASSES[item]


def repeats(items: Any, before: str = "") -> Iterator[tuple[str, set[str]]]:
    """What stands before each repeat, and texts that its body takes once."""
    for index, (kind, value) in enumerate(items):
        here = before + sample(items[:index])
        if kind in REPEATS:
            units = {sample(body) for body in [value[2], *branches(value[2])]} - {""}
            if value[1] > LENGTH:
                yield here, units
            yield from repeats(value[2], here)
        for part in branches([(kind, value)]):
            yield from repeats(part, here)


def branches(items: Any) -> Iterator[Any]:
    """Patterns inside of a pattern."""
    for kind, value in items:
        if kind is sre.BRANCH:
            yield from value[1]
        elif kind is sre.SUBPATTERN:
            yield value[-1]
        elif kind in (sre.ASSERT, sre.ASSERT_NOT):
            yield value[1]
        elif kind is sre.ATOMIC_GROUP:
            yield value


def hostile(pattern: re.Pattern[Any]) -> Iterator[str]:
    """Texts that may take a pattern long."""
    text = pattern.pattern.decode("latin-1") if isinstance(pattern.pattern, bytes) else pattern.pattern
    items = parser.parse(text, pattern.flags)
    found = list(repeats(items))
    begins = {"", *(before for before, _ in found)}
    for unit in sorted({*UNITS, *begins, sample(items), *(unit for _, some in found for unit in some)} - {""}):
        count = max(LENGTH // len(unit), 1)
        for begin in sorted(begins):
            for end in ENDS:
                yield f"{begin}{unit * count}{end}"


@pytest.fixture
def limited() -> Iterator[None]:
    before = signal.signal(signal.SIGVTALRM, late)
    yield
    signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    signal.signal(signal.SIGVTALRM, before)


def slow(pattern: re.Pattern[Any], ways: set[str]) -> str:
    """The way, and the begin of the text, that takes a pattern too long; "" where there is none."""
    for text in hostile(pattern):
        given = text.encode() if isinstance(pattern.pattern, bytes) else text
        for way in sorted({"search" if way in METHODS[3:] else way for way in ways}):
            if takes_long(getattr(pattern, way), given):
                return f"{way} in {text[:20]!r} ... {text[-10:]!r}"
    return ""


def takes_long(call: Callable[[Any], object], text: Any) -> bool:
    """Whether each of three calls takes more than SECONDS; other processes may slow one of them."""
    for _ in range(3):
        signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
        try:
            call(text)
        except TooSlowError:
            continue
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        return False
    return True


def test_all_patterns_are_found() -> None:
    modules = {module for module, _ in patterns()}
    assert len(patterns()) > 60
    assert {"eomgen.motion.csv_columns", "eomgen.description.xml_text", "eomgen.identifiers", *HEAVY} <= modules


@pytest.mark.soak
@pytest.mark.parametrize("text", [r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)", r"^(a|a)*$", r"(\s*x)*y", r"x.*?y.*?z"])
def test_patterns_of_quadratic_time_are_seen(text: str, limited: None) -> None:
    assert slow(re.compile(text), {"fullmatch", "search"} if "x" in text else {"fullmatch"})


@pytest.mark.soak
@pytest.mark.parametrize("module", ["", *sorted(HEAVY)])
def test_patterns_take_time_in_proportion_to_the_text(module: str, limited: None) -> None:
    """Of one module, or of all others."""
    modules: Container[str] = {module} if module else {name for name, _ in patterns()} - HEAVY
    found = {key: slow(*patterns()[key]) for key in patterns() if key[0] in modules}
    assert {key: where for key, where in found.items() if where} == {}


FILES = sorted(path for folder in ("src/eomgen", "codegen", "templates") for path in (ROOT / folder).rglob("*.py"))

BUILTINS = {"eval", "exec", "compile", "__import__", "execfile", "input", "breakpoint"}
MODULES = {
    *("pickle", "cPickle", "dill", "cloudpickle", "marshal", "shelve", "yaml", "ruamel", "pty", "runpy", "code"),
    *("builtins", "gc"),  # what is set there is set for the whole process
}
CALLS = {  # attributes that are called, of whatever they belong to
    *("system", "popen", "getoutput", "getstatusoutput", "spawnl", "spawnv", "execv", "execl", "execve"),
    *("parse_expr", "parse_latex", "import_module", "exec_module", "read_pickle", "unsafe_load", "S", "sympify"),
}
ALLOWED = {  # file, what is called or caught, and why that is no text of a description, or loses no error
    ("src/eomgen/lazily.py", "import_module"): "modules of a package of eomgen, by its own imports",
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
    ("codegen/closed_form/bending.py", "sympify"): "the same",
    ("src/eomgen/cli/entry.py", "except Exception"): "the last resort, which says that it is our bug",
    ("src/eomgen/runtime/chunking.py", "except BaseException"): "of a thread; the caller raises it",
    ("src/eomgen/threads.py", "except BaseException"): "of a thread; the caller raises it",
}
BROAD = ("Exception", "BaseException")


def caught(node: ast.AST) -> list[str]:
    """What a handler or ``suppress`` takes, whatever error it is; nothing of handlers that end by raising it again."""
    if isinstance(node, ast.ExceptHandler) and ast.unparse(node.body[-1]) != "raise":
        types, way = [node.type] if node.type else [ast.Name("BaseException")], "except"
    elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("suppress"):
        types, way = node.args, "suppress"
    else:
        return []
    names = [name.id for kind in types for name in ast.walk(kind) if isinstance(name, ast.Name)]
    return [f"{way} {name}" for name in names if name in BROAD]


def found(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Calls, imports and handlers that are not allowed without a reason, with their lines."""
    for node in ast.walk(tree):
        yield from ((name, getattr(node, "lineno", 0)) for name in caught(node))
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
        "import builtins",
        "from gc import disable",
        "try: f()\nexcept: pass",
        "try: f()\nexcept (OSError, Exception) as error: log(error)",
        "with contextlib.suppress(Exception): f()",
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
