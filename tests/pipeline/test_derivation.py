"""Derivations beside the compiler: generate and build stop where they differ, and headers say what was derived."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import eomgen
from eomgen.cli.entry import main
from eomgen.codegen.derivation import fresh
from eomgen.codegen.joint.kept import KEPT
from eomgen.errors import DerivationError, InputError
from eomgen.pipeline import stages
from eomgen.pipeline.stages import Options, generate, make_source

pytestmark = pytest.mark.quick

OPTIONS = Options(("mass_matrix",), flags=("-O0",), level="v1")


@pytest.fixture
def wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """A kept table that is not what is derived."""
    facts = replace(KEPT, coaxial=KEPT.coaxial[1:])
    monkeypatch.setattr(fresh, "derived_facts", lambda: facts)


def test_the_header_says_what_was_derived(tmp_path: Path) -> None:
    """Its comment alone is longer than that of the source, and the C is as it was."""
    robot = eomgen.load_robot("one_link")
    made, source = generate(robot, tmp_path, OPTIONS), make_source(robot, OPTIONS)
    text = (made / "one_link.h").read_text(encoding="ascii")
    assert "Derived afresh by SymPy" in text
    assert "2  sharper lemma" in text
    assert text.split("\n */\n")[1:] == source.header.split("\n */\n")[1:]
    assert text.startswith(source.header.split("\n */\n")[0])
    assert all(len(line) <= 120 for line in text.splitlines())
    assert (made / "one_link.c").read_text(encoding="ascii") == source.code


@pytest.mark.usefixtures("wrong")
def test_generate_writes_nothing_where_the_derivation_differs(tmp_path: Path) -> None:
    with pytest.raises(DerivationError, match="joint1, coaxial pairs, x, alpha"):
        generate("one_link", tmp_path, OPTIONS, report=tmp_path / "derivation.html")
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("wrong")
def test_build_stops_where_it_is_asked_to_derive() -> None:
    assert eomgen.build("one_link", kernels=("mass_matrix",)).mass_matrix([0.0, 0.0])[0, 0] == 1.0
    for kernels in ((), ("mass_matrix",)):
        with pytest.raises(DerivationError):
            eomgen.build("one_link", kernels=kernels, derive=True)


def test_build_derives() -> None:
    for kernels in ((), ("mass_matrix",)):
        assert eomgen.build("one_link", kernels=kernels, derive=True).mass_matrix([0.0, 0.0])[0, 0] == 1.0


@pytest.mark.parametrize("ending", [".html", ".tex"])
def test_the_report_of_the_command(ending: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / f"derivation{ending}"
    command = ["generate", "one_link", "-o", str(tmp_path), "--kernels", "mass_matrix", "--level", "v1"]
    assert main([*command, "--report", str(page)]) == 0
    assert f"wrote {page}" in capsys.readouterr().out
    assert "sharper lemma" in page.read_text(encoding="ascii")


def test_links_that_bend_are_generated_without(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """SymPy derives joints alone: a package is as its source; a report, and a build that derives, are refused first."""
    robot = eomgen.load_robot("flexible_arm")
    text = (generate(robot, tmp_path, OPTIONS) / "flexible_arm.h").read_text(encoding="ascii")
    assert text == make_source(robot, OPTIONS).header
    monkeypatch.setattr(stages, "make_source", None)
    with pytest.raises(InputError, match=r"links\.upper\.modes: SymPy .*allowed: robots whose links are rigid"):
        generate(robot, tmp_path, OPTIONS, report=tmp_path / "derivation.html")
    with pytest.raises(InputError, match=r"links\.upper\.modes: SymPy"):
        eomgen.build(robot, kernels=("mass_matrix",), derive=True)


def test_refused_before_anything_is_derived(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match=r"report: .*allowed: .*\.html, \.tex"):
        generate("one_link", tmp_path, OPTIONS, report="derivation.pdf")
    assert main(["generate", "one_link", "--wheel", "--report", "x.html"]) == 1
    assert "--report" in capsys.readouterr().err
