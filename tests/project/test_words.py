"""The field's words: what users read has none of the phrases refused here, and the glossary is whole."""

from __future__ import annotations

import argparse
import ast
import json
import re
import unicodedata
from collections.abc import Iterator
from pathlib import Path

import pytest

import eomgen
from eomgen.cli.entry import make_parser

ROOT = Path(__file__).parents[2]
REFUSED = {  # a phrase, and what to say
    r"(?<!functional )mock-up units?": "FMU; functional mock-up unit at the first mention of a page",
    r"an URDF": "a URDF",
    r"a FMU": "an FMU",
    r"lets? go from|when (they|it) lets? go": "unactuated from, released",
    r"turns? freely|turning freely": "3-DOF rotation",
    r"loads that are data": "time-signal inputs",
    r"as they really are": "with compliance, backlash and friction",
    r"gives? way|giving way": "compliant, deflects",
    r"corrected programs?": "compensated path",
    r"off its program": "TCP error, tracking error",
    r"states? of rest": "static equilibrium",
    r"steps that the error (chooses|controls)": "adaptive step size",
    r"whichever leads further": "automatic stiffness switching",
    r"drives locked": "actuated joints locked (brakes on)",
    r"least drives": "minimum-norm actuation",
    r"tells? most": "most informative, D-optimal",
    r"support reactions?": "joint reaction wrenches",
    r"base axes": "base frame",
    r"dry friction": "Coulomb friction",
    r"(Gauss and Newton|Savitzky and Golay)": "Gauss-Newton, Savitzky-Golay",
    r"eigenfrequenc(y|ies)": "natural frequency",
    r"[Bb]eside other people's": "comparison with other libraries",
    r"[Ss]peed per error": "work-precision diagrams",
}
PHRASES = {re.compile(rf"(?<![\w-])(?:{phrase})(?![\w-])", re.IGNORECASE): word for phrase, word in REFUSED.items()}
EXPLAINED = {"glossary.md"}  # says which of our words of old stand for which of the field's
SHOWN = re.compile(r"```.*?```|`[^`]*`|\]\([^)]*\)", re.DOTALL)  # names, links, and what is printed


def wrong(text: str) -> list[str]:
    """Say which phrases of a text are refused, and what to say."""
    words = " ".join(text.split())
    return [f"{found[0]!r}: {word}" for phrase, word in PHRASES.items() for found in phrase.finditer(words)]


def pages() -> list[Path]:
    """Pages that people read, but for those that explain the words."""
    found = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "mkdocs.yml")]
    found += [path for path in (ROOT / "docs").rglob("*.md") if path.name not in EXPLAINED]
    return found + sorted((ROOT / "examples").rglob("*.md"))


def literals(path: Path) -> Iterator[tuple[int, str]]:
    """Lines and texts of a module's strings that are no docstrings."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    described = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in described:
            yield node.lineno, node.value


@pytest.mark.parametrize("path", pages(), ids=lambda path: path.relative_to(ROOT).as_posix())
def test_pages(path: Path) -> None:
    assert wrong(SHOWN.sub(" ", path.read_text(encoding="utf-8"))) == []


def test_notebooks() -> None:
    seen = 0
    for path in (ROOT / "examples" / "notebooks").glob("*.ipynb"):
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            if cell["cell_type"] == "markdown":
                assert wrong("".join(cell["source"])) == [], path.name
                seen += 1
    assert seen > 20


def test_messages() -> None:
    seen, bad = 0, []
    for folder in (ROOT / "src" / "eomgen", ROOT / "codegen"):
        for path in folder.rglob("*.py"):
            for line, text in literals(path):
                bad += [f"{path.relative_to(ROOT)}:{line}: {said}" for said in wrong(text)]
                seen += 1
    assert bad == []
    assert seen > 10_000


def test_help() -> None:
    (commands,) = (x for x in make_parser()._actions if isinstance(x, argparse._SubParsersAction))
    assert len(commands.choices) > 30
    for name, parser in {"": make_parser(), **commands.choices}.items():
        assert wrong(parser.format_help()) == [], name


def test_phrases_are_seen() -> None:
    assert wrong("An URDF, and a\nfunctional mock-up unit") == ["'An URDF': a URDF"]
    for text in ("Mock-up units", "it turns freely", "two states of\nrest", "in base axes", "gives way", "an URDF's"):
        assert len(wrong(text)) == 1, text
    for text in ("an FMU", "a URDF", "a program gives ways", "the rest", "in static equilibrium", "dry-friction"):
        assert wrong(text) == [], text


DOCS = Path(__file__).parents[2] / "docs"
GLOSSARY = (DOCS / "glossary.md").read_text(encoding="utf-8")
SOUGHT = (  # what engineers search for; in the column of terms, in any case of letters
    *("hysteresis", "SEA", "series elastic actuator", "flexible joint", "uncertainty", "laser tracker"),
    *("Denavit-Hartenberg", "Simulink", "FMU", "reference trajectory", "locked actuators", "static equilibrium"),
    *("3-DOF rotation", "chart switching", "time-signal inputs", "work integrals", "encoder offsets", "mastering"),
    *("backlash", "clearance", "Coulomb friction", "Stribeck friction", "reflected rotor inertia", "base parameters"),
    *("D-optimal", "joint reaction wrenches", "work-precision", "constraint violation", "loop closure"),
    *("nonlinear effects", "bias", "centroidal momentum", "MISRA", "WebAssembly", "MEX"),
    *("Craig-Bampton", "static condensation", "RBE2", "RBE3"),
)


def rows() -> list[tuple[str, ...]]:
    """The cells of all rows of terms."""
    lines = [line for line in GLOSSARY.splitlines() if line.startswith("| ") and not line.startswith("| term |")]
    return [tuple(cell.strip() for cell in line.removeprefix("|").removesuffix("|").split("|")) for line in lines]


def anchors(page: Path) -> set[str]:
    """The anchors that MkDocs gives a page's headings."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    found = set[str]()
    for heading in re.findall(r"^#+ (.+)$", text, re.MULTILINE):
        words = unicodedata.normalize("NFKD", heading).encode("ascii", "ignore").decode("ascii")
        found.add(re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", words).strip().lower()))
    return found


def wrong_links(text: str) -> list[str]:
    """Links to pages and anchors that are not there."""
    found = []
    for link in re.findall(r"\]\(([^)]+)\)", text):
        name, _, anchor = link.partition("#")
        page = DOCS / (name or "glossary.md")
        if not page.is_file() or (anchor and anchor not in anchors(page)):
            found.append(link)
    return found


def commands() -> dict[str, set[str]]:
    """The options of every command."""
    (group,) = (x for x in make_parser()._actions if isinstance(x, argparse._SubParsersAction))
    return {name: set(command._option_string_actions) for name, command in group.choices.items()}


@pytest.mark.parametrize("term", SOUGHT)
def test_words_of_the_field_are_terms(term: str) -> None:
    word = re.compile(rf"(?<!\w){re.escape(term)}", re.IGNORECASE)
    assert any(word.search(row[0]) for row in rows())


def test_rows_are_whole() -> None:
    for row in rows():
        assert len(row) == 4, row
        term, meaning, where, _ = row
        assert term, row
        assert meaning.endswith("."), row
        assert ". " not in meaning, f"{term}: more than a sentence"
        assert "](" in where or "`" in where, f"{term}: it is nowhere"
    terms = [row[0] for row in rows()]
    assert len(set(terms)) == len(terms) > 90


def test_links_lead_somewhere() -> None:
    assert len(re.findall(r"\]\(", GLOSSARY)) > 80
    assert wrong_links(GLOSSARY) == []
    assert wrong_links("[a](no.md) [b](limits.md#none) [c](limits.md#mechanics)") == ["no.md", "limits.md#none"]


def test_names_are_those_of_the_code() -> None:
    """Methods and attributes of kernels, commands with their options."""
    said = eomgen.Kernel.__doc__ or ""
    names = re.findall(r"`kernel\.(\w+)`", GLOSSARY)
    assert len(names) > 30
    for name in names:
        assert hasattr(eomgen.Kernel, name) or f"\n        {name}: " in said, f"kernel.{name}"
    options = commands()
    for command, words in re.findall(r"`eomgen (\w+)([^`]*)`", GLOSSARY):
        assert command in options
        assert set(re.findall(r"--[\w-]+", words)) <= options[command], f"eomgen {command}{words}"
