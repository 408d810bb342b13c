"""Results at a prompt, in a notebook, as tables of pandas and xarray: short, safe, and with the numbers they have."""

from __future__ import annotations

import copy
import pickle
import sys
from dataclasses import dataclass, fields, is_dataclass, replace
from html.parser import HTMLParser
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.analysis import budget, deflection, linearize, modes, modes_along, response
from eomgen.errors import InputError
from eomgen.identification import Estimate, FitResult, FittedCoordinate, calibrate, forces
from eomgen.motion.files import motion_from_columns
from eomgen.shown import LONGEST, Shown, text_of
from eomgen.sweep.driver import run
from eomgen.sweep.plan import plan_from_toml
from eomgen.tabular import Tabular
from tests.support.good_files import ROLLOUTS
from tests.support.measured_poses import chain, trial
from tests.support.optional import needs
from tests.support.same_values import compare_values

pytestmark = pytest.mark.usefixtures("unoptimised")

HOSTILE = "<script>\x1b[31m&" + "x" * 300
SUBPACKAGES = ("analysis", "control", "identification", "integration", "loops", "motion", "simulation", "sweep")
ARRAYS = ("Array", "NDArray", "Complex")


@pytest.fixture(scope="module")
def simulated() -> eomgen.SimulationResult:
    return eomgen.simulate("one_link", duration=0.05, method="rk4")


@pytest.fixture(scope="module")
def results(simulated: eomgen.SimulationResult, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """One of each kind."""
    t = np.linspace(0.0, 1.0, 40)
    motion = motion_from_columns({"t": t, "joint1.gamma": np.sin(t)}, ("joint1.x", "joint1.gamma"))
    value = Estimate(1e4, 1.0, 9e3, 11e3, 1e4, 0.1, 0.01)
    fitted = FitResult("one_link", 0.95, (FittedCoordinate("joint1.x", value, None, 1e-6),), (), ("a note",))
    scenario = {"duration": 0.02, "motion": {"type": "point_to_point", "goal": {"joint1": 0.1}}}
    swept = run("one_link", scenario, plan_from_toml(ROLLOUTS), tmp_path_factory.mktemp("sweep") / "one", threads=1)
    return {
        "simulation": simulated,
        "trajectory": simulated.trajectory,
        "series": simulated.series("joint1.x"),
        "balance": simulated.balance,
        "modes": modes("one_link"),
        "tracks": modes_along("one_link", [[0.0], [0.5]]),
        "response": response("one_link", ["tcp.fx"], ["tcp.x", "tcp.y"], [1.0, 2.0, 5.0]),
        "state space": linearize("one_link"),
        "deflection": deflection("one_link"),
        "budget": budget(simulated, "one_link"),
        "motion": motion,
        "forces": forces("one_link", motion),
        "fit": fitted,
        "calibration": calibrate(chain(1, "RR"), trial(chain(1, "RR"), 1, 20).poses(), folds=4),
        "sweep": swept,
        "sensitivity": swept.sensitivity("tool_deviation_max"),
    }


def test_results_of_every_kind_are_copied_and_pickled(results: dict[str, Any]) -> None:
    for kind, found in results.items():
        for other in (pickle.loads(pickle.dumps(found)), copy.deepcopy(found)):
            compare_values(found, other, kind)


def test_what_packages_give_and_holds_arrays_is_shown_in_short() -> None:
    found = 0
    for package in SUBPACKAGES:
        module = import_module(f"eomgen.{package}")
        for name in module.__all__:
            given = getattr(module, name)
            if isinstance(given, type) and is_dataclass(given):
                types = {str(field.type).partition("[")[0] for field in fields(given)}
                if types & {*ARRAYS, *(f"{kind} | None" for kind in ARRAYS)}:
                    found += 1
                    assert issubclass(given, Shown), f"{package}.{name}"
    assert found > 10


def test_every_result_is_one_line(results: dict[str, Any]) -> None:
    for name, result in results.items():
        text = repr(result)
        assert text.startswith(f"{type(result).__name__}("), name
        assert text.isascii(), name
        assert text.isprintable(), name
        assert len(text) <= LONGEST + 40, name
        assert "array([" not in text, name
    assert "robot='one_link', coordinates=2, driven=1" in repr(results["simulation"])
    assert "eigenvalues=<array (1,) of complex128>" in repr(results["modes"])
    assert "samples=3 of 3, failed=0" in repr(results["sweep"])


class Cells(HTMLParser):
    """Texts of a table's cells, and its elements."""

    def __init__(self) -> None:
        super().__init__()
        self.tags, self.texts = list[str](), list[str]()

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def test_notebooks_get_a_small_table(results: dict[str, Any]) -> None:
    for name, result in results.items():
        cells = Cells()
        cells.feed(result._repr_html_())
        assert set(cells.tags) <= {"table", "caption", "tbody", "tr", "th", "td"}, name
        facts = result.facts()
        assert cells.texts == [type(result).__name__, *(text for pair in facts.items() for text in pair)], name
        assert len(facts) <= 20, name


def test_names_of_others_are_harmless(simulated: eomgen.SimulationResult) -> None:
    hostile = replace(simulated, robot=HOSTILE, tool=HOSTILE)
    text, page = repr(hostile), hostile._repr_html_()
    assert text.isascii()
    assert text.isprintable()
    assert len(text) < LONGEST + 40
    assert "<script>" not in page
    assert "\x1b" not in page
    many = replace(hostile.trajectory, coordinates=(HOSTILE,) * 50, method=HOSTILE)
    assert repr(many).isprintable()


def test_facts_are_fields_that_are_not_empty() -> None:
    @dataclass(repr=False)
    class Pair(Shown):
        name: str
        size: float
        notes: tuple[str, ...] = ()

    pair = Pair("a<b", 0.25)
    assert pair.facts() == {"name": "'a<b'", "size": "0.25"}
    rows = "<tr><th>name</th><td>&#x27;a&lt;b&#x27;</td></tr><tr><th>size</th><td>0.25</td></tr>"
    assert pair._repr_html_() == f"<table><caption>Pair</caption><tbody>{rows}</tbody></table>"


def test_values_in_short() -> None:
    assert text_of(np.zeros((3, 2))) == "<array (3, 2)>"
    assert text_of(np.zeros(1, dtype=int)) == "<array (1,) of int64>"
    assert text_of(("a", "b", "c", "d", "e")) == "('a', 'b', 'c' and 2 more)"
    assert text_of({"a": 1}) == "<1 entry>"
    assert text_of((1, 2)) == "<2 items>"
    assert text_of(0.1) == text_of(np.float64(0.1)) == "0.1"
    assert text_of(10**400).startswith("an integer of")


# Tables


def test_pandas_has_the_series_with_their_units(simulated: eomgen.SimulationResult) -> None:
    pandas = needs("pandas")
    frame = simulated.to_pandas()
    assert isinstance(frame, pandas.DataFrame)
    assert frame.index.name == "t"
    assert np.array_equal(frame.index, simulated.trajectory.t)
    columns = 0
    for name in simulated.names:
        series = simulated.series(name)
        parts = [name] if series.values.ndim == 1 else [f"{name}.{axis}" for axis in "xyz"]
        assert np.array_equal(frame[parts].to_numpy(), series.values.reshape(series.t.size, -1))
        assert {frame.attrs["units"][part] for part in parts} == {series.unit}
        columns += len(parts)
    assert columns == frame.shape[1]
    assert frame.attrs["robot"] == "one_link"


def test_xarray_has_the_series_with_their_units(simulated: eomgen.SimulationResult) -> None:
    needs("xarray")
    data = simulated.to_xarray()
    assert set(data.data_vars) == set(simulated.names)
    assert np.array_equal(data["t"], simulated.trajectory.t)
    assert data["t"].attrs == {"units": "s"}
    for name in simulated.names:
        series = simulated.series(name)
        assert np.array_equal(data[name], series.values)
        assert data[name].attrs["units"] == series.unit
        assert data[name].dims == (("t",) if series.values.ndim == 1 else ("t", "axis"))
    assert list(data["axis"].values) == ["x", "y", "z"]


def test_every_table_is_the_same_in_both(results: dict[str, Any]) -> None:
    needs("pandas")
    needs("xarray")
    tables = {name: result for name, result in results.items() if isinstance(result, Tabular)}
    assert len(tables) == 11
    for name, result in tables.items():
        rows, frame, data = result.as_rows(), result.to_pandas(), result.to_xarray()
        assert len(frame) == len(rows.values) == data.sizes[rows.index], name
        assert len({column.name for column in rows.columns}) == len(rows.columns) == len(data.data_vars), name
        assert set(frame.attrs["units"]) == {rows.index, *frame.columns}, name
        for column in rows.columns:
            parts = [part for part, _ in column.flat()]
            shown = frame[parts].to_numpy().reshape(column.values.shape)
            np.testing.assert_array_equal(shown, data[column.name].values, err_msg=name)  # NaN where nothing is said


def test_tables_of_what_is_found(results: dict[str, Any]) -> None:
    needs("pandas")
    mode, tracks, fit = (results[name].to_pandas() for name in ("modes", "tracks", "fit"))
    assert np.array_equal(mode["frequency"], results["modes"].frequencies)
    assert np.array_equal(mode["shape.joint1.x"], results["modes"].shapes[:, 0])
    assert np.array_equal(tracks["frequencies.1"], results["tracks"].values("frequencies")[:, 0])
    H = results["response"].to_pandas()
    assert np.array_equal(H["tcp.y from tcp.fx"], results["response"].of("tcp.y", "tcp.fx"))
    assert H.attrs["units"]["tcp.y from tcp.fx"] == "m per N"
    assert fit.loc["joint1.x.stiffness", "value"] == 1e4
    parts = results["budget"].to_pandas()
    names = [f"{name}.x" for name in (*results["budget"].coordinates, "remainder")]
    assert np.allclose(parts[names].sum(axis=1), parts["deviation.x"], atol=1e-15)
    force = results["forces"].to_pandas()
    balance = sum(force[f"joint1.gamma.{part}"] for part in ("drive", "spring", "damper"))
    assert np.allclose(balance, force["joint1.gamma.required"], rtol=1e-9, atol=1e-12)


def test_a_sweep_has_a_row_for_every_sample(results: dict[str, Any], tmp_path: Path) -> None:
    pandas = needs("pandas")
    swept = results["sweep"]
    failed = replace(
        swept, errors={1: "it stopped, early"}, record=np.where([[False], [True], [False]], np.nan, swept.record)
    )
    frame = failed.to_pandas()
    assert list(frame.index) == [0, 1, 2]
    assert np.array_equal(frame["joints.joint1.x.stiffness"], swept.samples[:, 0])
    assert list(frame["error"]) == ["", "it stopped, early", ""]
    assert frame.attrs["units"]["tool_deviation_max"] == "m"
    read = pandas.read_csv(failed.save_table(tmp_path / "t.csv"), index_col="index", keep_default_na=False)
    assert list(read.columns) == list(frame.columns)
    assert np.array_equal(read["joints.joint1.x.stiffness"], frame["joints.joint1.x.stiffness"])


@pytest.mark.parametrize("package", ["pandas", "xarray"])
def test_without_the_package_a_line_says_what_is_missing(
    package: str, simulated: eomgen.SimulationResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(
        InputError, match=rf"^to_{package} needs {package}, which is not installed: pip install {package}, or"
    ):
        getattr(simulated, f"to_{package}")()
