"""Notebooks run as they are, and their pages show what they print and draw."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from tests.project.test_docs import hooks as hooks  # a fixture
from tests.support.optional import needs

pytestmark = pytest.mark.usefixtures("unoptimised")

ROOT = Path(__file__).parents[2]
NAMES = sorted(path.stem for path in (ROOT / "examples" / "notebooks").glob("*.ipynb"))
SEVERAL = 5  # cells that print at least, and as many lines


@pytest.fixture
def notebooks(hooks: ModuleType) -> ModuleType:
    """The generator of their pages, where kernels of Jupyter are installed."""
    needs("nbclient")
    needs("ipykernel")
    found: ModuleType = hooks.notebooks
    return found


def cell(source: str, *outputs: SimpleNamespace, kind: str = "code") -> SimpleNamespace:
    return SimpleNamespace(cell_type=kind, source=source, outputs=outputs)


def output(**data: str) -> SimpleNamespace:
    named = {{"png": "image/png", "html": "text/html", "plain": "text/plain"}[key]: text for key, text in data.items()}
    return SimpleNamespace(output_type="display_data", data=named, metadata={"image/png": {"width": 300}})


def test_they_are_clean(hooks: ModuleType) -> None:
    """In the repository without outputs and counters, and on the page that lists them."""
    assert len(NAMES) == 4
    listed = (ROOT / "docs" / "notebooks.md").read_text(encoding="utf-8")
    for name in NAMES:
        notebook = hooks.notebooks.read(name)
        assert f"](../examples/notebooks/{name}.ipynb)" in listed
        assert notebook.cells[0].source.startswith("# ")
        assert all(not one.outputs and one.execution_count is None for one in notebook.cells if "outputs" in one)


def test_pages_show_outputs(hooks: ModuleType) -> None:
    """What a cell prints in pieces is one block, between other outputs where it was printed."""
    said = [SimpleNamespace(output_type="stream", text=text) for text in ("one\n", "two\n", "\x1b[31mthree\x1b[0m\n")]
    cells = [
        cell("# Title\n\nfirst words", kind="markdown"),
        cell("print()", said[0], said[1], output(png="AAAA", plain="<figure>"), said[2], output(png="AAEC", plain="x")),
        cell("x", output(html="<table></table>", plain="x")),
        cell("1", output(plain="1")),
    ]
    found = hooks.notebooks.page("some", SimpleNamespace(cells=cells))
    page = found.pop("notebooks/some.md")
    parts = ["# Title", "[some.ipynb](some.ipynb)", "first words", "```python\nprint()\n```", "```text\none\ntwo\n```"]
    parts += ["![figure](some_2.png){ width=300 }", "```text\nthree\n```", "![figure](some_2b.png)", "<table></table>"]
    places = [page.index(part) for part in (*parts, "```text\n1\n```")]
    assert places == sorted(places)
    assert found == {"notebooks/some_2.png": b"\0\0\0", "notebooks/some_2b.png": b"\0\1\2"}


@pytest.mark.soak
def test_a_cell_that_fails_is_named(notebooks: ModuleType) -> None:
    from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

    cells = [new_markdown_cell("# Title"), new_code_cell("x = 1"), new_code_cell("y = x\ny / 0"), new_code_cell("z")]
    with pytest.raises(notebooks.NotebookError, match=r"some\.ipynb, cell 3 \(y = x\):\n(.|\n)*ZeroDivisionError"):
        notebooks.run_cells(new_notebook(cells=cells), "some")


@pytest.mark.soak
def test_pages_have_no_lines_of_progress(notebooks: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """Which notebooks of users have: theirs are at a prompt."""
    from nbformat.v4 import new_code_cell, new_notebook

    asked = "from eomgen.progress import is_at_prompt\nprint(is_at_prompt())"
    for scripted, answer in ((notebooks.SCRIPTED, "False\n"), ("pass", "True\n")):
        monkeypatch.setattr(notebooks, "SCRIPTED", scripted)
        notebook = notebooks.run_cells(new_notebook(cells=[new_code_cell(asked)]), "some")
        assert [one.text for one in notebook.cells[0].outputs] == [answer]


@pytest.mark.soak
@pytest.mark.parametrize("name", NAMES)
def test_they_run(name: str, notebooks: ModuleType) -> None:
    """From the first cell to the last, in a process of its own; nothing is warned of, and numbers are numbers."""
    if name == "optimal_control":
        needs("casadi")
    notebook = notebooks.run(name)
    streams = [one for cell in notebook.cells if cell.cell_type == "code" for one in cell.outputs if "text" in one]
    assert [one.text for one in streams if one.name == "stderr"] == []
    printed = "".join(one.text for one in streams)
    assert len(printed.splitlines()) > 2 * SEVERAL
    assert not re.search(r"\bnan\b", printed)
    page = notebooks.page(name, notebook)
    assert page[f"notebooks/{name}.md"].count("\n```text\n") >= SEVERAL
    assert sum(path.endswith(".png") for path in page) >= 2
    CHECKS[name](printed)


def numbers(pattern: str, text: str) -> list[float]:
    found = re.findall(pattern, text)
    assert found, pattern
    return [float(x) for x in found]


def check_elastic_urdf(printed: str) -> None:
    """A sag in proportion to the load; a stiffer gear leaves less of it and lifts the lowest mode."""
    own, twenty, fifty = numbers(r"N down: the fingertips sag by +([\d.]+) um", printed)
    assert abs((fifty - own) / (twenty - own) - 2.5) < 0.01
    before, after = numbers(r"shoulder\.motor\.stiffness x \d: sag +([\d.]+) um", printed)
    assert after < 0.8 * before
    low, high = numbers(r"shoulder\.motor\.stiffness x \d: .* mode +([\d.]+) Hz", printed)
    assert high > 1.05 * low


def check_calibrate_arm(printed: str) -> None:
    """Hidden numbers are found within their intervals, and elsewhere the errors are those of the noise."""
    for low, half, true in re.findall(r"stiffness: (\d+) \+- (\d+) N m/rad, truly (\d+)", printed):
        assert abs(float(low) - float(true)) < 2.0 * float(half)
    rigid, elastic = numbers(r"gears +held out ([\d.]+) mm", printed)
    assert elastic < 0.05 < 3.0 * elastic < rigid
    (inside,) = numbers(r"([\d.]+) % of the components lie", printed)
    assert inside > 90.0
    assert numbers(r"geometry and gears +rms ([\d.]+) mm", printed)[0] < 0.05
    assert "parallel axes" in printed


def check_hexapod_modes(printed: str) -> None:
    """Without the legs' masses frequencies are those by hand, and higher than with them."""

    def row(words: str) -> list[float]:
        (found,) = re.findall(rf"{words} +\[([^\]]*)\]", printed)
        return [float(x) for x in found.split()]

    by_hand, light, home = row("by hand:"), row("without mass:"), row("legs as they are:")
    assert light == pytest.approx(by_hand, abs=0.03)
    assert all(x < y for x, y in zip(home, light, strict=True))
    assert row("of home's:") == pytest.approx([1.0] * 7, abs=0.01)
    assert "mobility 12" in printed


def check_optimal_control(printed: str) -> None:
    """The gradient is the difference quotient; both programs hardly ring, and one of them takes less effort."""
    gradient, quotient = re.findall(r"gradient (-?[\d.]+), difference quotient (-?[\d.]+)", printed)[0]
    assert float(gradient) == pytest.approx(float(quotient), rel=1e-4)
    rows = re.findall(r"^([a-z].*?) +([\d.]+) mm +([\d.]+) mm +([\d.]+) N m +([\d.]+)$", printed, re.MULTILINE)
    ringing, effort = ({name.split()[0]: float(row[k]) for name, *row in rows} for k in (0, 3))
    assert max(ringing["shaped"], ringing["least"]) < 0.05 * ringing["polynomial"]
    assert effort["least"] < 0.8 * min(effort["shaped"], effort["polynomial"])


CHECKS = {
    "elastic_urdf": check_elastic_urdf,
    "calibrate_arm": check_calibrate_arm,
    "hexapod_modes": check_hexapod_modes,
    "optimal_control": check_optimal_control,
}
