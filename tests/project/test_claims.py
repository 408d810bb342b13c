"""Figures of README and docs name the command that made them, and what no longer holds is found."""

from __future__ import annotations

import datetime
import importlib
import re
from pathlib import Path

import pytest

from benchmarks import claims
from benchmarks.claims import Claim, differences, figures, unclaimed

ROOT = Path(__file__).parents[2]
WHOLE = Claim("docs/a.md", "python a.py", datetime.date(2026, 1, 2), "abc", "any", 1)
PAGE = """# Page

It takes 3 ms, twice as long; `1 ms` and $2 ms$ and version 3.12 are none.

```text
5 us
```

| robot | steps | ms |
|---|---|---|
| one | 3 | 4.5 |

| key | default |
|---|---|
| step | 3 |
"""


def known() -> tuple[list[Claim], dict[str, list[str]]]:
    found, waiting, given = claims.read()
    return found, {page: [*waiting.get(page, []), *given.get(page, [])] for page in {*waiting, *given}}


@pytest.mark.parametrize("page", claims.pages())
def test_every_figure_has_a_claim(page: str) -> None:
    assert unclaimed(page, (ROOT / page).read_text(encoding="utf-8"), *known()) == []


def test_claims_are_of_pages_and_commands_that_exist() -> None:
    found, waiting, given = claims.read()
    pages = set(claims.pages())
    assert {claim.page for claim in found} | set(waiting) | set(given) <= pages
    for claim in found:
        words = claim.command.split()
        assert words[0] in {"python", "pytest"}, claim.command
        named = [word for word in words if word.endswith(".py")]
        named += [word.replace(".", "/") for word in words if word.startswith("benchmarks.")]
        assert named or "pytest" in words, claim.command
        for name in named:
            assert any((ROOT / x).exists() for x in (name, f"{name}.py", f"{name}/__main__.py")), claim.command
        headings = claims.sections((ROOT / claim.page).read_text(encoding="utf-8"))
        assert set(claim.exact) <= {*headings, "*"}, claim
        assert re.fullmatch(r"[0-9a-f]{8,}", claim.commit)
        assert datetime.date(2026, 1, 1) < claim.date
        assert claim.minutes > 0


OF_OTHERS = {"libcst", "pinocchio", "mujoco", "casadi", "exudyn", "jax"}  # what a benchmark may ask for by itself


@pytest.mark.parametrize("module", sorted({f"benchmarks.{path.stem}" for path in (ROOT / "benchmarks").glob("*.py")}))
def test_benchmarks_find_what_they_import(module: str) -> None:
    """What has moved since breaks a command that nobody runs for weeks."""
    try:
        importlib.import_module(module)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in OF_OTHERS:
            raise


def test_the_page_of_claims_is_current() -> None:
    assert (ROOT / claims.PAGE).read_text(encoding="utf-8") == claims.table_page(), "run: make tables"


def test_figures_are_found() -> None:
    assert [(figure.line, figure.text) for figure in figures(PAGE)] == [(3, "3 ms"), (9, "| robot | steps | ms |")]
    for text in ("2.5 times as fast", "to 3e-12", "some 5 %", "1,286 operations", "within 2 percent", "takes 0.04 s"):
        assert len(list(figures(text + "\n"))) == 1, text
    for text in ("3.11 or later", "ISO 9283", "in 3 s of motion", "10^-3", "eq. (11)", "v1.2e-3x"):
        assert not list(figures(text + "\n")), text


def test_a_figure_without_a_claim_is_found() -> None:
    assert unclaimed("docs/a.md", PAGE, [WHOLE], {}) == []
    wrong = unclaimed("docs/a.md", PAGE, [], {"docs/a.md": ["takes 3 ms", "not there"]})
    assert wrong == [
        "docs/a.md: docs/claims.toml names 'not there', which the page does not have",
        "docs/a.md:9: '| robot | steps | ms |' has no claim in docs/claims.toml",
    ]
    part = Claim("docs/a.md", "python a.py", WHOLE.date, "abc", "any", 1, parts=("lost",))
    assert "docs/a.md: docs/claims.toml names 'part lost', which the page does not have" in unclaimed(
        "docs/a.md", PAGE, [part], {}
    )


def test_what_no_longer_holds_is_found() -> None:
    here = "# A\n| one | 3.0 | 2e-15 |\nrequired 30: held.\n## Counts\n12 operations\n"
    counted = Claim("docs/a.md", "python a.py", WHOLE.date, "abc", "any", 1, exact=("Counts",))
    assert differences(counted, here, here) == ([], [])
    measured = f"{here}Measured on AMD EPYC, by gcc, in 3\nrounds.\n"
    elsewhere = f"{here}Measured on Intel(R) Xeon(R) Processor, by\ngcc, in 3 rounds.\n"
    broken, beside = differences(WHOLE, measured, elsewhere)
    assert (broken, len(beside)) == ([], 1)
    assert differences(WHOLE, measured, elsewhere.replace("gcc", "clang"))[0]
    slower = here.replace("3.0", "4.0")
    assert differences(counted, here, slower) == ([], ["A: | one | 4.0 | 2e-15 |    was: | one | 3.0 | 2e-15 |"])
    for old, new in (("2e-15", "3e-14"), ("held", "missed"), ("12 op", "13 op"), ("# A\n", "# A\nmore\n")):
        assert differences(counted, here, here.replace(old, new))[0], new


def test_commands_run_in_a_copy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A page that a command writes there is compared with the one here, which stays."""
    repository, copy = tmp_path / "here", tmp_path / "there"
    for folder in (repository, copy):
        (folder / "docs").mkdir(parents=True)
        (folder / "docs" / "a.md").write_text("1 operations\n")
        (folder / "a.py").write_text("open('docs/a.md', 'w').write('2 operations\\n')\n")
    monkeypatch.setattr(claims, "ROOT", repository)
    monkeypatch.setattr(claims, "copied", lambda folder: copy)
    exact = Claim("docs/a.md", "python a.py", WHOLE.date, "abc", "any", 1, exact=("*",))
    assert claims.check([exact])
    assert "python a.py: no longer holds" in capsys.readouterr().out
    assert (repository / "docs" / "a.md").read_text() == "1 operations\n"
    assert not claims.check([WHOLE]), "other numbers stand beside"
    (copy / "a.py").write_text("raise SystemExit(3)")
    assert claims.check([exact])
    assert "status 3" in capsys.readouterr().out
    (copy / "a.py").write_text("raise SystemExit('not measured: no device')")
    assert not claims.check([exact])
    assert capsys.readouterr().out == "python a.py: not measured: no device\n"
    with pytest.raises(ValueError, match="allowed: python, pytest"):
        claims.run("make test", tmp_path)
