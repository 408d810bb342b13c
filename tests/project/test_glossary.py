"""The glossary: its rows are whole, what they link to and name is there, and the field's words are found in it."""

from __future__ import annotations

import argparse
import re
import unicodedata
from pathlib import Path

import pytest

import eomgen
from eomgen.cli.entry import make_parser

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
