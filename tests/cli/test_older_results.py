"""A new result in a folder takes the figures of the older one away; what may be somebody's own stays, and is named."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import eomgen
from eomgen.cli.shared.writing import name_older_pages
from eomgen.files import FIGURE_ENDINGS
from eomgen.pictures import Report, plot_result, plot_tool
from eomgen.results.beside import BESIDE_SIMULATION, PAGE, TRAJECTORY, is_ours
from eomgen.sweep.store import ROWS
from tests.results.test_kept_results import KEPT
from tests.support.commands import run
from tests.support.sliders import SLIDER, STIFF

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

SIMULATE = ("simulate", "one_link", "--duration", "0.1")
REMOVED, NAMED = "note: removed of the older result: ", "note: older than the result beside, maybe of another one: "


def notes(*words: object) -> dict[str, set[str]]:
    """Names of files in the notes of a command, by what each note says."""
    status, _, err = run(*words)
    assert status == 0
    found = (
        (about, line[len(about) :].split(", "))
        for line in err.splitlines()
        for about in (REMOVED, NAMED)
        if line.startswith(about)
    )
    names: dict[str, set[str]] = {REMOVED: set(), NAMED: set()}
    for about, paths in found:
        names[about] |= {Path(path).name for path in paths}
    return names


@pytest.mark.soak
def test_files_of_figures_and_pages_say_who_wrote_them(tmp_path: Path) -> None:
    result = eomgen.load_result(KEPT / "simulation.npz")
    written = [path for ending in FIGURE_ENDINGS for path in plot_result(result, tmp_path, ending)]
    written.append(Report("page", (), (), (), ()).save(tmp_path / PAGE))
    assert {path.suffix for path in written} == {*FIGURE_ENDINGS, ".html"}
    assert {path.name for path in written} <= set(BESIDE_SIMULATION)
    assert all(is_ours(path) for path in written)
    link = tmp_path / "link.png"
    link.symlink_to(tmp_path / "tool.png")
    foreign = tmp_path / "foreign.png"
    foreign.write_bytes((tmp_path / "tool.png").read_bytes().replace(b"Software\0eomgen", b"Software\0others"))
    assert not any(map(is_ours, (link, foreign, tmp_path / "none.png", tmp_path / "text.txt")))


@pytest.mark.soak
def test_a_simulation_removes_what_an_older_one_left(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert notes(*SIMULATE, "-o", str(out)) == {REMOVED: set(), NAMED: set()}
    drawn = {path.name for path in out.glob("*.png")}
    assert {"tool.png", "energy.png"} <= drawn
    own = {"own.png": (out / "tool.png").read_bytes(), "notes.txt": b"mine", PAGE: b"mine", "tool.pdf": b"mine"}
    for name, content in own.items():
        (out / name).write_bytes(content)
    result = eomgen.load_result(out)
    old = {plot_tool(result, out / "tool.svg").name, plot_tool(result, out / "journals.png").name}
    assert notes(*SIMULATE, "-o", str(out)) == {REMOVED: old, NAMED: {PAGE, "tool.pdf"}}
    assert {path.name for path in out.iterdir()} == {TRAJECTORY, *drawn, *own}
    assert notes(*SIMULATE, "-o", str(out), "--no-plots") == {REMOVED: drawn, NAMED: {PAGE, "tool.pdf"}}
    assert {path.name: path.read_bytes() for path in out.iterdir() if path.name != TRAJECTORY} == own


def test_figures_where_no_older_result_was_stay(tmp_path: Path) -> None:
    plot_tool(eomgen.load_result(KEPT / "simulation.npz"), tmp_path / "tool.svg")
    assert notes(*SIMULATE, "-o", str(tmp_path), "--no-plots") == {REMOVED: set(), NAMED: {"tool.svg"}}
    assert (tmp_path / "tool.svg").is_file()


def test_a_sweep_keeps_its_figures_until_samples_are_added(tmp_path: Path) -> None:
    plan = "samples = 5\nrecord = ['coordinate_end']\n" + STIFF + "uniform = { low = 500.0, high = 900.0 }\n"
    texts = {"r.toml": SLIDER, "s.toml": "duration = 0.1\n[initial]\nq = { rail = 0.1 }\n", "p.toml": plan}
    for name, text in texts.items():
        (tmp_path / name).write_text(text, encoding="ascii")
    files, out = [str(tmp_path / name) for name in texts], tmp_path / "out"
    command = ("sweep", files[0], "--scenario", files[1], "--plan", files[2], "-o", str(out), "--threads", "1")
    drawn = {"distribution.png", "sensitivity.png"}
    assert notes(*command) == {REMOVED: set(), NAMED: set()}
    assert notes(*command, "--no-plots") == {REMOVED: set(), NAMED: set()}
    assert drawn <= {path.name for path in out.iterdir()}
    (out / ROWS).write_bytes(b"".join((out / ROWS).read_bytes().splitlines(keepends=True)[:-1]))
    assert notes(*command, "--no-plots") == {REMOVED: drawn, NAMED: set()}
    assert not drawn & {path.name for path in out.iterdir()}


def test_pages_of_older_measured_results_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page, chosen = Report("page", (), (), (), ()).save(tmp_path / "plan.html"), tmp_path / "plan.json"
    os.utime(page, (1e9, 1e9))
    command = ("poses", "ur5", "--count", "6", "--candidates", "30", "-o", str(chosen))
    assert notes(*command) == {REMOVED: set(), NAMED: {"plan.html"}}
    assert notes(*command, "--report", str(page)) == {REMOVED: set(), NAMED: set()}
    page.write_text("mine", encoding="ascii")
    os.utime(page, (1e9, 1e9))
    name_older_pages([chosen])
    assert capsys.readouterr().err == ""
