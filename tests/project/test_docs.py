"""The documentation keeps its promises: its blocks run and print what they say, the site builds without a warning."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import os
import pydoc
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from urllib.parse import unquote, urlsplit

import pytest

import eomgen
from tests.support.browser import open_page
from tests.support.doc_blocks import blocks_of, run_page
from tests.support.optional import module_of
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
OWN_TESTS = {
    "scenario.md": "simulation/test_simulate.py",
    "sweep.md": "sweep/test_sweep_plan.py",
    "embed.md": "codegen/c/test_embed.py",
    "howto/simulink.md": "codegen/c/test_host_pages.py",
    "howto/ros2_control.md": "codegen/c/test_host_pages.py",
}
ELSEWHERE = {name: test for name, test in OWN_TESTS.items() if (DOCS / name).exists()}  # these ask more of their blocks
VOID = {
    "br",
    "hr",
    "img",
    "input",
    "link",
    "meta",
    "mspace",
    "path",
    "rect",
    "circle",
    "col",
}  # elements without an end
GALLERY = "one_link puma560_elastic four_bar"  # pictures that pages show, and a closed mechanism
HOWTO = (
    *(
        "accuracy",
        "beam_link",
        "closed_loop",
        "compensate",
        "elastic_urdf",
        "excite",
        "gantry",
        "harmonic_drive",
        "identify",
        "platform",
        "stable_inversion",
        "sweep",
    ),
    *("tolerance", "tool_path"),
)
SLOW = (
    *(
        "adapters.md",
        "analysis.md",
        "comparison.md",
        "derivatives.md",
        "fmu.md",
        "live.md",
        "python.md",
        "sensors.md",
        "wasm.md",
        "start.md",
        "global_error.md",
        "mjcf.md",
        "kalman_filters.md",
    ),
    *("for/calibration.md", "for/control.md", "for/multibody.md"),
    *(f"howto/{name}.md" for name in HOWTO),
)  # for make soak: some take 10 s
NOTEBOOKS = "none"  # shown without outputs; test_notebooks.py runs them
PAGES = sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))


@pytest.fixture(scope="module")
def hooks() -> ModuleType:
    return module_of(DOCS / "hooks.py")


@pytest.mark.parametrize(
    "name",
    [pytest.param(x, marks=pytest.mark.soak(most=50)) if x in SLOW else x for x in PAGES if x not in ELSEWHERE],
)
def test_blocks_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CFLAGS", "-O0")  # changes no number that pages show
    monkeypatch.setattr(sys, "path", list(sys.path))
    before = set(sys.modules)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    run_page(DOCS / name, tmp_path)
    for module in set(sys.modules) - before:
        if str(tmp_path) in str(getattr(sys.modules[module], "__file__", "")):
            del sys.modules[module]  # a generated package


def test_other_pages_have_tests_of_their_own() -> None:
    for name, test in ELSEWHERE.items():
        assert f'"{name}"' in (ROOT / "tests" / test).read_text(encoding="utf-8")
        assert blocks_of((DOCS / name).read_text(encoding="utf-8"))


def test_pages_say_which_paper() -> None:
    """Where a page first speaks of the paper, its title and its source stand beside that."""
    checked = []
    for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        text = " ".join(page.read_text(encoding="utf-8").split())
        first = re.search(r"\b[Tt]he paper\b", text)
        if first is None:
            continue
        around = text[: first.start() + 400]
        assert "Mathematics Model for 6-DOF Joints Manipulation Robots" in around, page
        assert "Mathematics 2021, 9(21), 2828" in around, page
        checked.append(page.name)
    assert {"README.md", "theory.md", "errata.md", "multibody.md"} <= set(checked)
    assert "2021, 9(21), 2828" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_long_commands_are_understood() -> None:
    """Those of pages whose blocks are run elsewhere: their options exist, and so do the files that they name."""
    from eomgen.cli.entry import make_parser

    commands = 0
    for name in ELSEWHERE:
        for block in blocks_of((DOCS / name).read_text(encoding="utf-8")):
            for line in re.findall(r"^\$ eomgen .*", block.text, re.MULTILINE) if block.language == "console" else ():
                words = shlex.split(line.removeprefix("$ eomgen "))
                make_parser().parse_args(words)
                commands += 1
                for word in words:
                    assert not word.startswith("examples/") or (ROOT / word).is_file(), line
    assert commands


def test_a_wrong_block_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each kind of block fails where it is wrong."""
    monkeypatch.chdir(tmp_path)
    page = tmp_path / "page.md"
    for text, message in {
        "```python\nprint(1)\n```\n\n```text\n2\n```\n": r"page.md:5: printed is\n1",
        "```python\nprint(unknown)\n```\n": "unknown",
        "```console\n$ eomgen info nothing\n```\n": "status 1",
        "```console\n$ eomgen robots\nnothing\n```\n": "printed is",
        "```console\n$ make demo\n```\n": "make demo",
        '```toml\nname = "a"\nlinks = 1\n```\n': "links",
        "```toml\nduration = -1\n```\n": "duration",
        "```text\n1\n```\n": "nothing was printed",
        "```fortran\n```\n": "fortran",
        "  ```python\n  ```\n": "a fence",
    }.items():
        page.write_text(text, encoding="ascii")
        refused((AssertionError, NameError, eomgen.InputError), message, run_page, page, tmp_path)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the site with a short gallery, built without a warning: pages that are in no menu, links and
    anchors that lead nowhere are warnings."""
    folder = tmp_path_factory.mktemp("docs") / "site"
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1", "EOMGEN_GALLERY": GALLERY, "EOMGEN_NOTEBOOKS": NOTEBOOKS}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.soak
def test_the_site_builds(site: Path) -> None:
    pages = {path.relative_to(site).as_posix(): path.read_text(encoding="utf-8") for path in site.rglob("*.html")}
    for name in (*PAGES, "notebooks/elastic_urdf.md"):
        assert name.replace(".md", ".html") in pages
    lives = {name: pages.pop(name) for name in list(pages) if name.startswith("live/")}
    assert {"live/arm.html", "live/puma560_elastic.html", "live/four_bar.html"} == set(lives)
    shown = {name for page in pages.values() for name in re.findall(r'<iframe src="(live/\w+\.html)#', page)}
    assert shown == set(lives)
    for name, page in pages.items():
        fetched = re.findall(r'<(?:script|link|img|iframe)[^>]*(?:src|href)="((?:https?:)?//[^"]*)"', page)
        assert not fetched, name
        assert "arithmatex" not in page, f"{name}: a formula was left as text"
        begun, ended = (set(re.findall(rf"<{slash}([a-z][a-z0-9]*)", page)) for slash in ("", "/"))
        assert begun - ended <= VOID, f"{name}: text in pointed brackets became an element"
    for style in site.rglob("*.css"):
        assert not re.search(r"url\([\"']?(https?:)?//", style.read_text(encoding="utf-8")), style
    for text in ("inverse_dynamics", "eomgen.SingularError"):
        assert text in pages["reference/api.html"]
    assert pages["equations.html"].count("<math") > 10
    # what a search needs where nothing may be asked for: the index as a script, and workers without a server
    assert (site / "search" / "search_index.js").read_text(encoding="utf-8").startswith("var __index = {")
    for name, page in pages.items():
        (shim,) = re.findall(r'<script src="([^"]*iframe-worker[^"]*)"', page)
        assert name == "404.html" or (site / name).parent.joinpath(shim).resolve().is_file(), name


def test_the_site_is_searched_from_disk(request: pytest.FixtureRequest) -> None:
    with open_page() as found:
        folder = request.getfixturevalue("site")
        found.page.goto((folder / "index.html").as_uri())
        found.page.locator("input.md-search__input").click()
        found.page.keyboard.type("backlash")
        first = found.page.locator("a.md-search-result__link").first
        first.wait_for(timeout=30000)
        assert found.errors == []
        assert all(address.startswith(("file:", "data:", "blob:", "about:")) for address in found.requests)
        assert "backlash" in first.inner_text().lower()
        target = Path(unquote(urlsplit(first.evaluate("link => link.href")).path))
        assert target.is_file()
        assert target.is_relative_to(folder)


def test_generated_pages_are_complete(hooks: ModuleType) -> None:
    """Every command with every option, every robot, every table of the formats with its keys."""
    from eomgen.cli.entry import make_parser

    text = hooks.commands.page()
    for name, _, command in hooks.commands.commands(make_parser()):
        assert f"## eomgen {name}\n" in text
        for action in hooks.commands.arguments(command):
            for option in action.option_strings:
                assert f"`{option}" in text
    assert len(list(hooks.commands.commands(make_parser()))) >= 18
    pages = {name: getattr(hooks.formats, f"{name}_page")() for name in ("description", "scenario", "plan")}
    for key, takes in {
        "stiffness": "a number that is at least 0",
        "type": "revolute, prismatic, fixed, free",
        "inertia": "error, warn, project",
        "ratio": "a finite number .*; not 0",
    }.items():
        assert re.search(rf"\| `{key}` \|[^|]*\| {takes}", pages["description"]), key
    assert re.search(r"\| `duration` \| needed \| a number that is at least 1e-09", pages["scenario"])
    assert re.search(r"\| `bandwidth` \|[^|]*\| a number greater than 0", pages["scenario"])
    assert re.search(r"\| `design` \|[^|]*\| random, latin_hypercube", pages["plan"])
    for name, guide in {"description": "description.md", "scenario": "scenario.md", "plan": "sweep.md"}.items():
        explained = (DOCS / guide).read_text(encoding="utf-8")
        for key in re.findall(r"^\| `(\w+)` \|", pages[name], re.MULTILINE):
            assert re.search(rf"(?<![\w.]){key}(?!\w)", explained), f"{guide} does not mention {key}"
    gallery = hooks.gallery.page(eomgen.builtin_robots())
    for robot in eomgen.builtin_robots():
        assert f"## {robot}\n" in gallery


@pytest.mark.soak
def test_the_whole_gallery_is_drawn(hooks: ModuleType) -> None:
    """The site of the other tests has the pictures of a few robots alone."""
    found = hooks.gallery.figures(eomgen.builtin_robots())
    assert set(found) == {f"{name}{end}" for name in eomgen.builtin_robots() for end in (".png", "_zeros.svg")}
    assert all(content.startswith((b"\x89PNG", b"<?xml")) for content in found.values())


def test_the_build_of_the_site_says_what_it_makes(
    hooks: ModuleType, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    for module, name in ((hooks.api, "pages"), (hooks.gallery, "figures"), (hooks.figures, "figures")):
        monkeypatch.setattr(module, name, lambda *_: {})
    monkeypatch.setattr(hooks.gallery, "page", lambda _: "")
    monkeypatch.setattr(hooks.live, "live_page", str)
    monkeypatch.setattr(hooks.notebooks, "run", hooks.notebooks.read)
    with caplog.at_level("INFO", "mkdocs.plugins.eomgen"):
        hooks.generated(["ur5"], DOCS, ["elastic_urdf"])
    assert [record.getMessage() for record in caplog.records] == [
        "eomgen: reference, and gallery of ur5",
        "eomgen: live page of puma560_elastic",
        "eomgen: live page of ur5",
        "eomgen: live page of arm.toml",
        "eomgen: figures",
        "eomgen: running the notebook elastic_urdf",
    ]


def test_forms_of_links(hooks: ModuleType) -> None:
    for target in ("https://example.org/a_b?c=1&amp;d=2#e", "theory.md", "#anchor", "figures/x.svg"):
        assert not hooks.what_is_wrong("href", target)
    for target in ("http://example.org", "https://example", "https:///x", "ftp://example.org", "https://a.org/b c"):
        assert hooks.what_is_wrong("href", target)
    assert hooks.what_is_wrong("src", "https://example.org/x.js")


def test_links_out_of_the_pages(hooks: ModuleType) -> None:
    page, config = SimpleNamespace(file=SimpleNamespace(src_uri="howto/x.md")), SimpleNamespace(docs_dir=str(DOCS))

    def made(text: str) -> str:
        found: str = hooks.on_page_markdown(text, page, config)
        return found

    assert made("[the plan](../../examples/reach.toml)") == "the plan (`examples/reach.toml` in the repository)"
    assert made("[a](../../examples/notebooks/elastic_urdf.ipynb)") == "[a](../notebooks/elastic_urdf.md)"
    assert made("before <!-- site: [a](reference/api.md),\nb. --> after") == "before [a](reference/api.md),\nb. after"
    assert made("[keys](../description.md#keys)") == "[keys](../description.md#keys)"
    refused(hooks.PluginError, "no file of the repository", made, "[x](../../examples/nothing.toml)")


def test_formulas_become_mathml(hooks: ModuleType) -> None:
    found = hooks.mathematics.with_mathml('<span class="arithmatex">\\(\\dot{q}_1 &lt; \\frac{1}{2}\\)</span>')
    assert found.startswith("<math")
    assert "<mfrac>" in found
    refused(ValueError, "nosuch", hooks.mathematics.with_mathml, '<div class="arithmatex">\\[\\nosuch{x}\\]</div>')


def test_a_page_without_a_place_is_in_the_menu(hooks: ModuleType, tmp_path: Path) -> None:
    for name in ("index.md", "fmu.md", "new.md", "howto/x.md"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("# Page", encoding="ascii")
    nav = [{"Home": "index.md"}, {"How to": []}, {"Guides": [{"A": "a.md"}]}]
    found = hooks.on_config(SimpleNamespace(docs_dir=str(tmp_path), nav=nav)).nav
    assert found == [{"Home": "index.md"}, {"How to": ["fmu.md", "howto/x.md"]}, {"Guides": [{"A": "a.md"}, "new.md"]}]


WORDS = re.compile(r"`([^`\n]+)`")
PATH = re.compile(r"(?:benchmarks|codegen|docs|examples|src|templates|tests)/[\w./]*")


def test_what_pages_name_exists() -> None:
    """Files and folders of the repository, tests, and names of the package, in words set as code."""
    tests = {path: path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py")}
    defined = {path.stem for path in tests} | set(
        re.findall(r"^def (test_\w+)", "\n".join(tests.values()), re.MULTILINE)
    )
    seen = dict.fromkeys(("path", "test", "name"), 0)
    pages = {*DOCS.rglob("*.md"), *(ROOT / name for name in ("README.md", "CONTRIBUTING.md"))}
    for path in pages - {DOCS / "soak.md"}:  # which names the tests of its commit
        text = re.sub(r"^```.*?^```$", "", path.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
        for word in WORDS.findall(text):
            if PATH.fullmatch(word):
                assert (ROOT / word).exists(), f"{path.name}: {word}"
                seen["path"] += 1
            elif re.fullmatch(r"test_\w+(\.py)?", word):
                assert word.removesuffix(".py") in defined, f"{path.name}: {word}"
                seen["test"] += 1
            elif name := re.match(r"eomgen(?:\.[A-Za-z_]\w*)+", word):
                assert located(name[0]), f"{path.name}: {word}"
                seen["name"] += 1
            elif path.name == "theory.md" and re.fullmatch(r"(joint|tree|closed_form)(\.[A-Za-z_]\w*)+(\(\))?", word):
                assert located(f"eomgen.codegen.{word.removesuffix('()')}"), f"{path.name}: {word}"
                seen["name"] += 1
    assert min(seen.values()) > 20, seen


def located(name: str) -> bool:
    """Whether there is something of that full name, a field of a dataclass included."""
    holder, _, last = name.rpartition(".")
    return pydoc.locate(name) is not None or last in getattr(pydoc.locate(holder), "__dataclass_fields__", {})


def test_docstrings_name_arguments_that_there_are(hooks: ModuleType) -> None:
    """Of all functions and methods on the pages of the interface; "q, v: ..." are two."""
    seen = 0
    for name in ("eomgen", *(module for _, modules in hooks.api.PAGES.values() for module in modules)):
        for where, function in functions_of(importlib.import_module(name)):
            allowed = {key.lstrip("*") for key in inspect.signature(function).parameters}
            for argument in arguments_of(inspect.getdoc(function) or ""):
                assert argument in allowed, f"{where}: {argument}"
                seen += 1
    assert seen > 200


def functions_of(module: ModuleType) -> Iterator[tuple[str, Callable[..., object]]]:
    """Public functions of the module and of its classes, with where they stand."""
    for name, found in vars(module).items():
        if name.startswith("_") or not getattr(found, "__module__", "").startswith(module.__name__.split(".")[0]):
            continue
        if inspect.isfunction(found):
            yield f"{module.__name__}.{name}", found
        elif inspect.isclass(found):
            for key, method in vars(found).items():
                method = getattr(method, "__func__", method)
                if inspect.isfunction(method) and not key.startswith("_"):
                    yield f"{module.__name__}.{name}.{key}", method


def arguments_of(text: str) -> list[str]:
    """Names in the section "Args:" of a docstring."""
    section = re.search(r"^Args:\n(.*?)(?=^\S|\Z)", text, re.DOTALL | re.MULTILINE)
    lines = re.findall(r"^    (\w[\w, ]*):", section[1], re.MULTILINE) if section else []
    return [name.strip() for line in lines for name in line.split(",")]
