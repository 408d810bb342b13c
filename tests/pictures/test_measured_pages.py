"""Pages about results of measurements: each kind has its figures and tables, in Python and on the command line."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.cli import entry as cli
from eomgen.errors import InputError
from eomgen.identification import (
    BaseParameters,
    CalibrationResult,
    Estimate,
    FitResult,
    FittedCoordinate,
    IdentifyResult,
    Residuals,
    calibrate,
    load_fit,
    load_poses,
    poses,
    tolerance,
)
from eomgen.pictures import report_of
from eomgen.pictures.report import Report
from tests.pictures.test_report import HOSTILE, read
from tests.support.measured_poses import chain, trial

pytestmark = pytest.mark.usefixtures("unoptimised")

MEASURED = "pose,cycle,tool.x,tool.y,tool.z,tool.command.x,tool.command.y,tool.command.z\n" + "".join(
    f"{pose},{cycle},{0.5 + 1e-4 * cycle},{0.2 * pose},{0.3 - 5e-5 * pose * cycle},0.5,{0.2 * pose},0.3\n"
    for cycle in (1, 2, 3)
    for pose in (1, 2)
)


@cache
def calibration() -> CalibrationResult:
    made = trial(chain(4, "RRP", special=True), 3, 40)
    return calibrate(made.robot, made.poses(), folds=5, loss="huber")


def fitted() -> FitResult:
    found = Estimate(1100.0, 20.0, 1060.0, 1140.0, 1000.0, 0.02, 0.013)
    none = Estimate(0.5, 0.1, 0.3, 0.7, 0.0, 0.02, 0.013)
    return FitResult("arm", 0.95, (FittedCoordinate("gear.gamma", found, none, 1e-6),), ("a warning",), ("a note",))


def identified() -> IdentifyResult:
    base = BaseParameters("arm", ("links",), ("link1.m",), np.array([0]), np.eye(1), ("link1.m",), ())
    value = np.array([2.0])
    robot = eomgen.load_robot("one_link")
    left = {"joint1.gamma": Residuals(0.1, 0.2, 4.0, 500)}
    return IdentifyResult(robot, base, value, 0.01 * value, value, {"link1.m": 2.0}, left, 0.05, ("a warning",), ())


def results() -> dict[str, Any]:
    return {
        "calibration": calibration(),
        "fit": fitted(),
        "identify": identified(),
        "poses": poses("ur5", count=6, candidates=30),
        "tolerance": tolerance("one_link", {"joints.*.offset.x": {"bound": 3e-4}}, random=5),
    }


def tables_of(page: Report) -> dict[str, dict[str, tuple[str, ...]]]:
    return {table.title: {row[0]: row[1:] for row in table.rows} for table in page.tables}


def test_every_kind_has_a_page() -> None:
    """Well-formed, with figures that are as many as they say, and with what is to be minded."""
    for name, found in results().items():
        page = report_of(found)
        reader = read(page.html())
        assert page.figures, name
        assert sum(tag == "svg" for tag, _ in reader.elements) == len(page.figures)
        assert page.tables, name
        for line in getattr(found, "notes", ()):
            assert line in (*page.warnings, *page.notes)
    with pytest.raises(InputError, match=r"report: got 'dict'; allowed: SimulationResult, .*CalibrationResult"):
        report_of({})


def test_a_calibration_says_its_numbers() -> None:
    found = calibration()
    tables = tables_of(report_of(found))
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


def test_fits_and_identified_numbers() -> None:
    tables = tables_of(report_of(fitted()))
    assert tables["Stiffness and damping"]["gear.gamma.stiffness"][:5] == ("1100", "20", "1060", "1140", "1000")
    page = report_of(identified())
    assert tables_of(page)["Residuals of drives, rms"]["joint1.gamma"] == ("N m", "0.1", "0.2", "2.5", "5", "500")
    assert page.warnings == ("a warning",)
    page = report_of(fitted())
    assert (page.warnings, page.notes) == (("a warning",), ("a note",))


def test_names_are_escaped() -> None:
    hostile = replace(calibration(), robot=HOSTILE, source=HOSTILE, notes=(HOSTILE,))
    reader = read(report_of(hostile).html())
    assert not {"script", "img"} & {tag for tag, _ in reader.elements}
    assert HOSTILE in reader.text


def test_saved_results_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A calibration in an .npz, figures of the standard in a .json; what is of no kind is no simulation either."""
    monkeypatch.chdir(tmp_path)
    calibration().save("found.npz")
    assert cli.main(["report", "found.npz"]) == 0
    assert capsys.readouterr().out == "wrote found.html\n"
    assert "calibration by 40 poses" in Path("found.html").read_text()
    Path("measured.csv").write_text(MEASURED)
    assert cli.main(["accuracy", "measured.csv", "-o", "figures.json", "--report", "direct.html"]) == 0
    assert "wrote direct.html" in capsys.readouterr().out
    assert cli.main(["report", "figures.json", "-o", "page.html"]) == 0
    assert Path("page.html").read_text() == Path("direct.html").read_text()
    capsys.readouterr()
    assert cli.main(["report", "found.npz", "--robot", "one_link"]) == 1
    assert "found.npz: is no simulation; allowed: --robot with simulations" in capsys.readouterr().err
    np.savez("other.npz", x=np.zeros(3))
    Path("other.json").write_text("[]")
    for name in ("other.npz", "other.json"):
        assert cli.main(["report", name]) == 1
        assert capsys.readouterr().err.startswith(f"eomgen: {name}: is ")


def test_fits_and_poses_are_saved_and_reported(tmp_path: Path) -> None:
    """What loads again has the same page; what is of another kind, or damaged, is refused."""
    for name, found, load in (("fit", fitted(), load_fit), ("poses", results()["poses"], load_poses)):
        path = found.save(tmp_path / f"{name}.json")
        assert load(path).as_dict() == found.as_dict()
        assert cli.main(["report", str(path)]) == 0
        assert path.with_suffix(".html").read_text() == report_of(found).html()
        text = path.read_text()
        for bad, said in (
            (text.replace(f'"kind": "{name}"', '"kind": "other"'), f"is no result of the kind {name}"),
            (text.replace('"robot"', '"rabbit"'), "'rabbit' is unknown"),
            (text.replace('"units": [', '"units": ["m",') if name == "poses" else "{", "units|no JSON"),
        ):
            path.write_text(bad)
            with pytest.raises(InputError, match=said):
                load(path)
        with pytest.raises(InputError, match=r"allowed: a path that ends in .json"):
            found.save(tmp_path / "result.txt")
