"""Pages about results: well-formed, by themselves, escaped, and with the numbers that other sources have."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from datetime import date
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.analysis.modal import modes
from eomgen.errors import InputError
from eomgen.identification import (
    CalibrationResult,
    calibrate,
    load_fit,
    load_poses,
)
from eomgen.pictures.measured.kinds import PAGES
from eomgen.pictures.page import report_of
from eomgen.pictures.report import WARNS, Report, sorted_notes
from eomgen.robot.value import Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.result import SimulationResult
from eomgen.simulation.run import run_scenario
from tests.support.browser import open_page
from tests.support.commands import command, errors_of
from tests.support.extreme_numbers import accuracy_columns, written
from tests.support.measured_poses import chain, trial
from tests.support.measured_results import RESULTS
from tests.support.refusals import refused
from tests.support.small_robots import bending_arm

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

VOID = {"meta", "br", "img", "link", "hr", "input"}
HOSTILE = "<script>alert('x')</script>&amp;\"<img src=x onerror=alert(1)>"
SCENARIO = """
duration = 0.2
output_step = 0.002
[motion]
type = "point_to_point"
goal = { joint1 = 0.2, joint2 = -0.3 }
[[wrenches]]
link = "link2"
force = [1.0, 2.0, 3.0]
t0 = 0.05
t1 = 0.1
"""


@dataclass
class Reader(HTMLParser):
    """What a page has: an error where elements do not match."""

    elements: list[tuple[str, dict[str, str | None]]] = field(default_factory=list)
    cells: list[list[str]] = field(default_factory=list)
    text: str = ""
    stack: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.stack.append(tag)
        if tag == "tr":
            self.cells.append([])
        if tag in ("td", "th"):
            self.cells[-1].append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.stack.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data
        if self.stack and self.stack[-1] in ("td", "th"):
            self.cells[-1][-1] += data


def read(html: str) -> Reader:
    reader = Reader()
    reader.feed(html)
    reader.close()
    assert reader.stack == []
    return reader


@pytest.fixture(scope="module")
def robot() -> Robot:
    return bending_arm()


@pytest.fixture(scope="module")
def result(robot: Robot) -> SimulationResult:
    return run_scenario(robot, scenario_from_toml(SCENARIO))


@pytest.fixture(scope="module")
def page(result: SimulationResult) -> str:
    return report_of(result).html()


def test_the_page_is_well_formed_and_by_itself(page: str) -> None:
    reader = read(page)
    assert page.startswith("<!DOCTYPE html>")
    assert "http" not in re.sub(r"http-equiv", "", page)
    ids = [given["id"] for _, given in reader.elements if "id" in given]
    assert len(ids) == len(set(ids))
    for tag, given in reader.elements:
        assert tag not in ("script", "link", "iframe", "object", "embed", "base", "form"), tag
        assert not any(name.startswith("on") for name in given), given
        for name in ("src", "href", "xlink:href"):
            value = given.get(name)
            assert value is None or value.startswith(("#", "data:image/png;base64,")), value
            if value and value.startswith("#"):
                assert value[1:] in ids
    for target in re.findall(r"url\(([^)]*)\)", page):
        assert target[1:] in ids
    figures = [given["id"] for tag, given in reader.elements if tag == "figure"]
    assert figures == [f"figure-{name}" for name in ("tool", "deviations", "tracking", "energy", "modes", "zeros")]
    assert sum(tag == "svg" for tag, _ in reader.elements) == len(figures)


def test_all_figures_have_one_type_size(page: str) -> None:
    """On the page: points of the figure by the part of the page's width that each of its own widths takes."""
    sizes = {}
    for figure, svg in re.findall(r'<figure id="figure-(\w+)">(.*?)</figure>', page, re.DOTALL):
        (width,) = re.findall(r'<svg [^>]*viewBox="0 0 ([0-9.]+) ', svg)
        (share,) = re.findall(r"<svg [^>]*width:([0-9.]+)%", svg)
        found = {float(x) for x in re.findall(r"font(?:-size)?: (?:[a-z0-9]+ )?([0-9.]+)px", svg)}
        assert found, figure
        sizes |= {(figure, size): size * float(share) / float(width) for size in found}
        assert svg.count("<text") <= len(re.findall(r"font(?:-size)?: ", svg)), figure
    assert len({figure for figure, _ in sizes}) == 6
    assert np.allclose(list(sizes.values()), next(iter(sizes.values())), rtol=1e-3), sizes


def test_the_table_of_coordinates_has_their_springs(page: str, robot: Robot) -> None:
    rows = {row[0]: row[1:] for row in read(page).cells}
    for joint in robot.joints:
        for name, given in joint.coordinates.items():
            row = rows[f"{joint.name}.{name}"]
            assert row[1] == f"{joint.parent} to {joint.child}"
            assert [float(x) if x else None for x in row[3:5]] == [given.stiffness, given.damping]


@pytest.mark.soak
def test_the_tables_have_the_numbers_of_others(page: str, robot: Robot, result: SimulationResult) -> None:
    rows = {row[0]: row[1:] for row in read(page).cells}
    for link in robot.links:
        assert float(rows[link.name][0]) == link.mass
    assert robot.springs
    for spring in robot.springs:
        assert rows[spring.name][1].startswith(spring.links[0])
    kernel = eomgen.build(robot, kernels=("inverse_dynamics", "mass_matrix"))
    for name in ("inverse_dynamics", "mass_matrix"):
        assert [int(x) for x in rows[name][:4]] == [kernel.operations[name][k] for k in ("mul", "add", "div", "sincos")]
    energy = result.trajectory.energy
    assert float(rows["potential energy"][0]) == pytest.approx(energy[-1, 1] - energy[0, 1], rel=1e-5)
    assert float(rows["work of wrenches"][0]) == pytest.approx(result.series("work.wrenches").values[-1], rel=1e-5)
    assert rows["wrenches[0].link"] == ["link2"]
    assert rows["wrenches[0].table.values[0]"] == ["[1, 2, 3, 0, 0, 0]"]
    assert rows["description, SHA-256"] == [result.robot_hash]


@pytest.mark.soak
def test_frequencies_are_those_at_the_programs_poses(
    result: SimulationResult, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    from eomgen.pictures import page_figures as report_figures

    seen = []
    plain = report_figures.plot_tracks
    monkeypatch.setattr(
        report_figures, "plot_tracks", lambda found, path, times: (seen.append((found, times)), plain(found, path))[1]
    )
    report_of(result)
    ((tracked, times),) = seen
    pose = dict(zip(result.program_coordinates, result.program_q[-1], strict=True))
    assert times[-1] == result.trajectory.t[-1]
    expected = modes(robot, pose, drives="locked").frequencies
    assert np.allclose(np.sort(tracked.values("frequencies")[-1]), np.sort(expected), rtol=1e-9)


def test_names_and_notes_are_escaped(result: SimulationResult) -> None:
    scenario = {**result.scenario, "frame": HOSTILE, HOSTILE: HOSTILE}
    hostile = replace(result, robot=HOSTILE, tool=HOSTILE, notes=(HOSTILE, "\udcff"), scenario=scenario)
    text = report_of(hostile, modes=False).html()
    reader = read(text)
    assert not {"script", "img"} & {tag for tag, _ in reader.elements}
    assert reader.text.count(HOSTILE) >= 6


@pytest.mark.soak
def test_without_the_robot_the_page_says_what_is_missing(result: SimulationResult, robot: Robot) -> None:
    old = replace(result, description={}, balance=None)
    found = report_of(old)
    assert any("give its description: --robot" in line for line in found.missing)
    assert any("energy balance" in line for line in found.missing)
    assert [figure.name for figure in found.figures] == ["tool", "deviations", "tracking"]
    rows = {row[0]: row[1:] for row in read(found.html()).cells}
    q = result.trajectory.q[:, 0]
    assert [float(x) for x in rows["joint1.x"][1:3]] == pytest.approx([q.min(), q.max()], rel=1e-5)
    given = report_of(old, robot, modes=False)
    assert [figure.name for figure in given.figures] == ["tool", "deviations", "tracking", "zeros"]
    refused(InputError, "is not what was simulated", report_of, old, eomgen.load_robot("puma560"))


def test_what_cannot_be_drawn_is_said() -> None:
    """No program, no springs."""
    scenario = scenario_from_toml(
        "duration = 0.2\noutput_step = 0.1\n[initial]\nq = { joint1 = 0.4 }\nequilibrium = false"
    )
    missing = report_of(run_scenario(chain(4, "RR"), scenario)).missing
    assert any(line.startswith("tracking errors: there is no reference trajectory") for line in missing)
    assert "frequencies along the reference trajectory: no deviation has a stiffness" in missing


@pytest.mark.soak
def test_command(result: SimulationResult, tmp_path: Path) -> None:
    """The robot's file is gone: a result has what is needed."""
    result.save(tmp_path / "trajectory.npz")
    page, again, figures = (tmp_path / name for name in ("report.html", "x.html", "figures"))
    assert command("report", tmp_path, "--no-modes") == f"wrote {page}\n"
    command("report", tmp_path / "trajectory.npz", "--no-modes", "-o", again)
    assert page.read_bytes() == again.read_bytes()
    command("plot", tmp_path, "-o", figures)
    assert {path.suffix for path in figures.iterdir()} == {".pdf"}
    assert "has no trajectory.npz; allowed: a folder that eomgen simulate wrote" in errors_of("report", figures)
    assert "puma560 is not what was simulated" in errors_of("report", tmp_path, "--robot", "puma560")


def test_a_browser_shows_the_page_without_a_word(page: str, tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text(page, encoding="utf-8")
    with open_page() as found:
        address = (tmp_path / "report.html").as_uri()
        found.page.goto(address)
        assert found.errors == []
        assert found.requests == [address]
        boxes = [element.bounding_box() for element in found.page.query_selector_all("figure > svg")]
        assert len(boxes) == 6
        assert all(box["width"] > 400 and box["height"] > 200 for box in boxes)
        width = found.page.evaluate("document.documentElement.scrollWidth")
        assert width <= 1000


@pytest.mark.soak
def test_the_page_has_its_date_and_amber_is_for_warnings(
    result: SimulationResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1764115200")
    plain, odd = "method: rosenbrock (implicit), it is stiff", "the motion exceeds limits of the robot: joint1.gamma"
    page = report_of(replace(result, notes=(plain, odd)), modes=False)
    assert page.made == "2025-11-26"
    assert odd in page.warnings
    assert odd not in page.notes
    assert plain in page.notes
    text = page.html()
    assert f"Made on 2025-11-26 by eomgen {eomgen.__version__}" in text
    amber = text[text.index('id="warnings"') : text.index('id="notes"')]
    assert odd in amber
    assert plain not in amber
    monkeypatch.delenv("SOURCE_DATE_EPOCH")
    assert report_of(result, modes=False).made == date.today().isoformat()


@pytest.mark.parametrize("epoch", ["99999999999999999", "9" * 5000, "\N{SUPERSCRIPT TWO}", "today"])
def test_dates_that_are_none_are_refused(epoch: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", epoch)
    refused(InputError, "^the environment's SOURCE_DATE_EPOCH is .*; allowed: seconds", Report, "x", (), (), (), ())


def texts_of_notes() -> Iterator[str]:
    """Texts in the source of the packages whose results have notes, with 0 for what is put into them."""
    for room in ("description", "identification", "integration", "motion", "runtime", "simulation", "state"):
        for path in (Path(eomgen.__file__).parent / room).rglob("*.py"):
            nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
            described = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}  # docstrings
            for node in nodes:
                if isinstance(node, ast.JoinedStr):
                    yield "".join(str(x.value) if isinstance(x, ast.Constant) else "0" for x in node.values)
                elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in described:
                    yield node.value


def test_words_by_which_notes_are_warnings_stand_in_notes() -> None:
    """A note in other words would lose its amber without a word."""
    texts = list(texts_of_notes())
    for words in WARNS.pattern.split("|"):
        assert any(re.search(words, text) for text in texts), words
    fine = "no drive was clipped at a sample"
    assert fine in texts
    assert sorted_notes((fine, "drives were clipped: joint1.gamma")) == (
        ("drives were clipped: joint1.gamma",),
        (fine,),
    )


# Results of measurements: each kind has its figures and tables, in Python and on the command line


@cache
def calibration() -> CalibrationResult:
    made = trial(chain(4, "RRP", special=True), 3, 40)
    return calibrate(made.robot, made.poses(), folds=5, loss="huber")


def tables_of(page: Report) -> dict[str, dict[str, tuple[str, ...]]]:
    return {table.title: {row[0]: row[1:] for row in table.rows} for table in page.tables}


PAGED = "accuracy calibration compensation excitation fit forces identification poses tolerance"


@pytest.mark.parametrize("kind", PAGED.split())
def test_every_kind_has_a_page(kind: str, tmp_path: Path) -> None:
    """Well-formed, with figures that are as many as they say, and with what is to be minded."""
    found = RESULTS[kind](tmp_path)
    page = report_of(found)
    reader = read(page.html())
    assert bool(page.figures) == (kind != "forces")
    assert sum(tag == "svg" for tag, _ in reader.elements) == len(page.figures)
    assert page.tables
    assert {*getattr(found, "notes", ())} <= {*page.warnings, *page.notes}


def test_what_has_a_page() -> None:
    assert len(PAGES) == len(PAGED.split()) + 1, "and deflection, with its stress resultants"
    refused(InputError, r"report: got 'dict'; allowed: SimulationResult, .*CalibrationResult", report_of, {})


def test_a_calibration_says_its_numbers() -> None:
    found = calibration()
    page = report_of(found)
    assert [figure.name for figure in page.figures] == ["residuals", "changes"]
    tables = tables_of(page)
    rms = found.residuals["full"]
    shown = tables["Rms of residuals"]["full"]
    assert float(shown[0]) == pytest.approx(1e3 * rms["fitted"]["position"], rel=1e-3)
    assert float(shown[1]) == pytest.approx(1e3 * rms["fitted_norm"]["position"], rel=1e-3)
    assert float(shown[6]) == pytest.approx(1e3 * rms["held_out"]["orientation"], rel=1e-3)
    name = "joints.joint2.offset.gamma"
    value, deviation, low, high = (float(cell) for cell in tables["Values"][name][:4])
    assert value == pytest.approx(found[name], rel=1e-6)
    assert (high - low) / 2.0 == pytest.approx(found.quantile * deviation, rel=0.05)
    assert tables["Values"][name][-1] == "rad"
    assert set(tables["Not identifiable"]) == set(found.merged)
    assert not set(tables["Values"]) & set(found.merged)


def test_fits_and_identified_numbers(tmp_path: Path) -> None:
    fit, identified = (report_of(RESULTS[kind](tmp_path)) for kind in ("fit", "identification"))
    assert tables_of(fit)["Stiffness and damping"]["gear.gamma.stiffness"][:5] == ("1100", "20", "1060", "1140", "1000")
    shown = tables_of(identified)["Residuals of drives, rms"]["joint1.gamma"]
    assert shown == ("N m", "0.1", "0.2", "2.5", "5", "500")
    for page in (fit, identified):
        assert (page.warnings, page.notes) == (("a warning",), ("a note",))


def test_names_are_escaped() -> None:
    hostile = replace(calibration(), robot=HOSTILE, source=HOSTILE, notes=(HOSTILE,))
    reader = read(report_of(hostile).html())
    assert not {"script", "img"} & {tag for tag, _ in reader.elements}
    assert HOSTILE in reader.text


def test_saved_results_are_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A calibration in an .npz, figures of the standard in a .json; what is of no kind is no simulation either."""
    monkeypatch.chdir(tmp_path)
    calibration().save("found.npz")
    assert command("report", "found.npz") == "wrote found.html\n"
    assert "calibration by 40 poses" in Path("found.html").read_text()
    written(Path("measured.csv"), accuracy_columns())
    assert "wrote direct.html" in command("accuracy", "measured.csv", "-o", "figures.json", "--report", "direct.html")
    command("report", "figures.json", "-o", "page.html")
    assert Path("page.html").read_text() == Path("direct.html").read_text()
    said = errors_of("report", "found.npz", "--robot", "one_link")
    assert "found.npz: is no simulation; allowed: --robot with simulations" in said
    np.savez("other.npz", x=np.zeros(3))
    Path("other.json").write_text("[]")
    for name in ("other.npz", "other.json"):
        assert errors_of("report", name).startswith(f"eomgen: {name}: is ")


@pytest.mark.parametrize(("kind", "load"), [("fit", load_fit), ("poses", load_poses)])
def test_fits_and_poses_are_saved_and_reported(kind: str, load: Callable[[Path], Any], tmp_path: Path) -> None:
    """What loads again has the same page; what is of another kind, or damaged, is refused."""
    found = RESULTS[kind](tmp_path)
    path = found.save(tmp_path / f"{kind}.json")
    assert load(path).as_dict() == found.as_dict()
    command("report", path)
    assert path.with_suffix(".html").read_text() == report_of(found).html()
    text = path.read_text()
    for bad, said in (
        (text.replace(f'"kind": "{kind}"', '"kind": "other"'), f"is no result of the kind {kind}"),
        (text.replace('"robot"', '"rabbit"'), "'rabbit' is unknown"),
        (text.replace('"units": [', '"units": ["m",') if kind == "poses" else "{", "units|no JSON"),
    ):
        path.write_text(bad)
        refused(InputError, said, load, path)
    refused(InputError, r"allowed: a path that ends in .json", found.save, tmp_path / "result.txt")
