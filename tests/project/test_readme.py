"""The README keeps its promises: its blocks run, generated tables are current, commands, extras and files exist."""

import re
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

import eomgen
from eomgen.cli.entry import GROUPS, main, make_parser
from eomgen.description.load import robot_from_toml
from tests.support.doc_blocks import blocks_of, compare
from tests.support.optional import module_of

pytestmark = pytest.mark.usefixtures("unoptimised")

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
GENERATED = (
    "docs/architecture.md",
    "docs/comparison.md",
    "docs/limits.md",
    "docs/stability.md",
    "docs/start.md",
    "docs/theory.md",
)
MOST_LINES = 80  # of the README: what fits a screen or two of a repository browser, picture included


def blocks(language: str) -> list[str]:
    return [block.text for block in blocks_of(README) if block.language == language]


@cache
def script(name: str) -> ModuleType:
    """Import docs/NAME.py."""
    return module_of(ROOT / "docs" / f"{name}.py")


@pytest.mark.parametrize("page", GENERATED)
def test_generated_parts_are_current(page: str) -> None:
    tables = script("tables")
    assert page in tables.PARTS
    assert tables.filled(page) == (ROOT / page).read_text(encoding="utf-8"), "run: make tables"


def test_it_is_short_and_has_no_tables_of_figures() -> None:
    assert len(README.splitlines()) <= MOST_LINES
    assert "<!-- begin of" not in README


def test_the_python_block_prints_what_it_says(tmp_path: Path) -> None:
    """The first result, in five lines."""
    (code,), (wanted,) = blocks("python"), blocks("text")
    assert len(list(filter(None, code.splitlines()))) == 5
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, cwd=tmp_path)
    compare(wanted, done.stdout, "README.md")


def test_the_robot_of_the_walk_is_the_built_in_one() -> None:
    page = (ROOT / "docs" / "walk.md").read_text(encoding="utf-8")
    (text,) = (block.text for block in blocks_of(page) if block.title == "rod.toml")
    rod, one_link = robot_from_toml(text), eomgen.load_robot("one_link")
    assert rod.links == one_link.links
    assert rod.joints == one_link.joints
    assert rod.gravity == one_link.gravity


def test_commands_exist(capsys: pytest.CaptureFixture[str]) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="ascii")
    named = set()
    for block in blocks("console"):
        for line in block.splitlines():
            program, command = line.removeprefix("$ ").split()[:2]
            named.add((program, command))
            if program == "make":
                assert f"\n{command}:" in makefile, line
            else:
                assert program == "eomgen"
                make_parser().parse_args(shlex.split(line, comments=True)[2:])
                with pytest.raises(SystemExit) as ended:
                    main([command, "--help"])
                assert ended.value.code == 0
                assert f"eomgen {command}" in capsys.readouterr().out
    assert {("make", "test"), ("make", "demo"), ("eomgen", "simulate")} <= named


def test_the_page_of_commands_has_them_all() -> None:
    """Every call is understood, and no command is left out; files of the repository exist."""
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    named: dict[str, set[str]] = {}
    for heading, section in re.findall(r"^## (\w+)\n(.*?)(?=^## |\Z)", page, re.DOTALL | re.MULTILINE):
        for line in re.findall(r"^\| `eomgen ([^`]+)` \|", section, re.MULTILINE):
            words = shlex.split(line)
            make_parser().parse_args(words)
            named.setdefault(heading.lower(), set()).add(words[0])
            assert all((ROOT / word).is_file() for word in words if word.startswith("examples/")), line
    assert named == {group.name: set(group.names) for group in GROUPS}
    assert list(named) == [group.name for group in GROUPS]


def test_extras_that_are_installed_exist() -> None:
    """Those of the README and of all pages, in pip's brackets."""
    extras = set(script("tables").EXTRAS)
    seen = set()
    for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        for names in re.findall(r'pip install "(?:eomgen|\.|dist/[\w.-]+)\[([\w,]+)\]"', page.read_text("utf-8")):
            assert set(names.split(",")) <= extras, (page, names)
            seen |= set(names.split(","))
    assert {"sim", "view", "casadi"} <= seen


def dead_ends(page: Path, text: str) -> list[str]:
    """Links and images of a page that lead nowhere in the repository, but for those that the site alone shows."""
    shown = re.sub(r"```.*?```|`[^`]*`|<!--.*?-->", "", text, flags=re.DOTALL)
    targets = re.findall(r"\]\((?!https?:)([^)#\s]+)(?:#[^)]*)?\)|<img[^>]* src=\"([^\"]+)\"", shown)
    return [target for pair in targets for target in pair if target and not (page.parent / target).exists()]


def test_links_and_images_lead_somewhere_in_a_repository_browser() -> None:
    """What `make docs` makes stands where the site alone shows it: in comments that begin with "site:"."""
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]
    pages += (ROOT / "examples").rglob("*.md")
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert dead_ends(page, text) == [], page
    assert sum(page.read_text(encoding="utf-8").count("](") for page in pages) > 200
    wrong = "[a](no.md) ![b](figures/no.svg){ width=3 } [![c](d.svg)](e.md#f) <!-- site: [g](h.md) --> [i](README.md)"
    assert dead_ends(ROOT / "README.md", wrong) == ["no.md", "figures/no.svg", "d.svg", "e.md"]


def test_the_picture_is_what_its_command_draws(tmp_path: Path) -> None:
    """Its texts, numbers on axes among them; lines are as exact as the platform's arithmetic."""
    assert "](docs/picture.svg)" in README
    script("picture").draw(tmp_path / "picture.svg")
    drawn, kept = (path.read_text("utf-8") for path in (tmp_path / "picture.svg", ROOT / "docs" / "picture.svg"))
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", kept)
    assert texts == re.findall(r"<text[^>]*>([^<]*)</text>", drawn), "run: make picture"
    assert any("TCP error" in text for text in texts)


def test_the_loop_of_the_harmonic_drive_is_what_its_command_draws(tmp_path: Path) -> None:
    """As the picture of this page: its texts, numbers on axes among them."""
    hysteresis = script("hysteresis")
    assert f"]({hysteresis.TARGET.name})" in hysteresis.PAGE.read_text("utf-8")
    hysteresis.draw(tmp_path / "loop.svg")
    drawn, kept = (path.read_text("utf-8") for path in (tmp_path / "loop.svg", hysteresis.TARGET))
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", kept)
    assert texts == re.findall(r"<text[^>]*>([^<]*)</text>", drawn), "run: make picture"
    assert "torsion, mrad" in texts
