"""Plans of sweeps: refusals with file and key, and samples that are distributed as they should be."""

from __future__ import annotations

import csv
import re
import subprocess
import sys
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from eomgen.description.load import load_robot, robot_from_toml
from eomgen.errors import DescriptionError, InputError
from eomgen.robot.parameter_names import expand_tunable
from eomgen.scenario.load import load_scenario
from eomgen.simulation.run import run_scenario
from eomgen.sweep.design import Design, quantile
from eomgen.sweep.driver import prepare, run
from eomgen.sweep.keys import DESIGNS, ENGINES, RECORDS
from eomgen.sweep.plan import Distribution, load_plan, plan_from_toml
from eomgen.sweep.result import SweepResult, sensitivity_of
from tests.support.bad_files import GRID
from tests.support.commands import command
from tests.support.optional import needs
from tests.support.refusals import refused
from tests.support.sliders import RELEASE, SLIDER, STIFF, slider

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

ROOT = Path(__file__).parents[2]

UNFIT = {  # plans that are good and do not fit slider and RELEASE
    f"[[vary]]\nparameter = 'joints.rail.z.stifness'\n{GRID}": ("vary[0].parameter", "did you mean", "stiffness"),
    f"[[vary]]\nscenario = 'motion.duration'\n{GRID}": ("vary[0].scenario", "motion"),
    f"[[vary]]\nscenario = 'duration.0'\n{GRID}": ("vary[0].scenario", "has no parts"),
    f"[[vary]]\nparameter = 'gravity.x'\nrelative = true\n{GRID}": ("vary", "gravity.x", "multiples"),
    f"{STIFF}{GRID}[[vary]]\nparameter = 'joints.*.*.stiffness'\n{GRID}": ("vary", "more than one entry"),
    f"record = ['tracking_max']\n{STIFF}{GRID}": ("record", "tracking_max", "no reference"),
}


@pytest.mark.parametrize("text", UNFIT)
def test_plans_that_do_not_fit(text: str) -> None:
    caught = refused(DescriptionError, "", prepare, slider(), RELEASE, plan_from_toml(text, source="p.toml"))
    for part in ("p.toml", *UNFIT[text]):
        assert part in str(caught)


@pytest.mark.parametrize("key", ["beam.E", "beam.density", "modal_damping"])
def test_what_modes_follow_from_is_no_parameter(key: str) -> None:
    plan = plan_from_toml(f"[[vary]]\nparameter = 'links.upper.{key}'\n{GRID}")
    said = rf"vary\[0\]\.parameter: 'links\.upper\.{key}': the modes of upper follow from it, .*Robot\.with_value"
    refused(DescriptionError, said, prepare, "flexible_arm", {"duration": 0.1}, plan)


@pytest.mark.soak
def test_what_rollouts_cannot_do_is_integrated_or_refused() -> None:
    """Prescribed motions are part of rollouts; methods in Python are not."""
    change = "record = ['tool_deviation_max']\n[[vary]]\nparameter = 'gravity.z'\ngrid = { values = [-9.8, -9.9] }\n"
    rolled = plan_from_toml("engine = { type = 'rollout' }\n" + change)
    _, _, notes = prepare(load_robot("shaken_arm"), "shaken_platform", rolled)
    assert notes == ("each sample by the integrator of the scenario, side by side in C",)
    scenario = {**RELEASE, "integrator": {"method": "rk4"}}
    change = f"record = ['coordinate_end']\n{STIFF}{GRID}"
    with pytest.raises(DescriptionError, match=r'engine.type.*"rollout": integrator.method: rk4 integrates in Python'):
        prepare(slider(), scenario, plan_from_toml("engine = { type = 'rollout' }\n" + change))
    _, _, notes = prepare(slider(), scenario, plan_from_toml(change))
    assert "rollouts cannot: integrator.method" in notes[0]


def test_motions_that_end_early_are_integrated(tmp_path: Path) -> None:
    """Each sample ends where its coordinate passes the value; rollouts would go on to the duration."""
    scenario = {**RELEASE, "until": {"coordinate": "rail", "value": 0.099}}
    text = f"record = ['coordinate_end']\n{STIFF}{GRID}"
    with pytest.raises(DescriptionError, match=r"engine.type.*until: motions that end before"):
        prepare(slider(), scenario, plan_from_toml("engine = { type = 'rollout' }\n" + text))
    found = run(slider(), scenario, plan_from_toml(text), tmp_path)
    assert found.of("coordinate_end.rail.z") == pytest.approx([0.099, 0.099], abs=1e-9)
    assert "rollouts cannot: until" in found.lines()[1]


def test_a_payload_and_its_link_do_not_change_both() -> None:
    plan = plan_from_toml(f"[[vary]]\nparameter = 'links.mass.mass'\n{GRID}")
    with pytest.raises(DescriptionError, match=r"payload.*payloads\.0\.mass"):
        prepare(slider(), {**RELEASE, "payloads": [{"link": "mass", "mass": 1.0, "point": [0, 0, 0]}]}, plan)


def test_energies_of_payloads_are_balanced(tmp_path: Path) -> None:
    scenario = {**RELEASE, "payloads": [{"link": "mass", "mass": 1.0, "point": [0, 0, 0], "t0": 0.1}]}
    text = f"engine = {{ type = 'rollout' }}\nrecord = ['energy_residue']\n{STIFF}{GRID}"
    assert run(slider(), scenario, plan_from_toml(text), tmp_path).of("energy_residue").max() < 1e-4


# Samples


def test_latin_hypercubes_are_stratified() -> None:
    """Of N draws one is in each of N equal parts of every distribution; parts of two numbers are not paired."""
    count = 500
    kinds = [Distribution("uniform", low=-1.0, high=3.0), Distribution("normal", mean=2.0, deviation=0.5)]
    design = Design([*kinds, *kinds], count, 3, "latin_hypercube")
    values = np.array([design.values(i) for i in range(count)])
    shares = np.stack([stats.uniform(-1.0, 4.0).cdf(values[:, 0]), stats.norm(2.0, 0.5).cdf(values[:, 1])], axis=1)
    for column in shares.T:
        assert sorted(np.floor(column * count).astype(int)) == list(range(count))
    assert abs(np.corrcoef(values.T) - np.eye(4)).max() < 4.0 / np.sqrt(count)
    random = Design(kinds, count, 3, "random")
    drawn = np.array([random.values(i)[0] for i in range(count)])
    assert len(set(np.floor((drawn + 1.0) / 4.0 * count))) < count  # what is not stratified has gaps
    assert values[:, 0].mean() == pytest.approx(1.0, abs=4.0 / count)


@pytest.mark.parametrize(
    ("distribution", "reference"),
    [
        (Distribution("uniform", low=-1.0, high=3.0), stats.uniform(-1.0, 4.0)),
        (Distribution("normal", mean=2.0, deviation=0.5), stats.norm(2.0, 0.5)),
        (Distribution("normal", (), 1.8, 2.1, 2.0, 0.5), stats.truncnorm(-0.4, 0.2, 2.0, 0.5)),
        (Distribution("normal", (), 4.0, None, 2.0, 0.5), stats.truncnorm(4.0, np.inf, 2.0, 0.5)),
        (Distribution("normal", (), None, -1.0, 2.0, 0.5), stats.truncnorm(-np.inf, -6.0, 2.0, 0.5)),
    ],
)
def test_distributions_against_scipy(distribution: Distribution, reference: object) -> None:
    shares = np.array([1e-12, 1e-6, 0.01, 0.3, 0.5, 0.9, 0.999, 1.0 - 1e-9])
    found = [quantile(distribution, u) for u in shares]
    assert found == pytest.approx(reference.ppf(shares), rel=1e-7)
    design = Design([distribution], 4000, 11, "random")
    values = np.array([design.values(i)[0] for i in range(4000)])
    assert stats.kstest(values, reference.cdf).pvalue > 1e-3
    if distribution.low is not None:
        assert values.min() >= distribution.low
    if distribution.high is not None:
        assert values.max() <= distribution.high


def test_samples_depend_on_seed_and_index_alone() -> None:
    kinds = [Distribution("uniform", low=0.0, high=1.0), Distribution("grid", (1.0, 2.0, 3.0))]
    design = Design([*kinds, Distribution("grid", (5.0, 6.0))], 10, 1, "random")
    assert len(design) == 60
    backwards = [design.values(i) for i in reversed(range(60))][::-1]
    assert backwards == [design.values(i) for i in range(60)]
    assert [row[1:] for row in backwards[::10]] == list(product((1.0, 2.0, 3.0), (5.0, 6.0)))
    assert [row[0] for row in backwards[:10]] == [row[0] for row in backwards[10:20]]  # the same draws at every point
    longer = Design(kinds, 20, 1, "random")
    assert [longer.values(i)[0] for i in range(10)] == [row[0] for row in backwards[:10]]
    assert Design(kinds, 10, 2, "random").values(0)[0] != backwards[0][0]
    assert len({row[0] for row in backwards}) == 10


def test_patterns_draw_every_parameter_for_itself() -> None:
    text = SLIDER.replace("[[joints]]", "[[joints]]\nx = { stiffness = 4e5 }")
    vary = "[[vary]]\nparameter = 'joints.rail.*.stiffness'\nrelative = true\nuniform = { low = 0.5, high = 2.0 }\n"
    job, design, _ = prepare(robot_from_toml(text), RELEASE, plan_from_toml(f"samples = 3\n{vary}"))
    assert [(x.name, x.unit) for x in job.dimensions] == [
        ("joints.rail.x.stiffness", 4e5),
        ("joints.rail.z.stiffness", 800.0),
    ]
    a, b = design.values(0)
    assert a != b
    assert job.parameters((a, b)) == {x.name: u * (x.unit or 0) for x, u in zip(job.dimensions, (a, b), strict=True)}


# Results


def test_sensitivities_of_a_linear_model_and_a_curve() -> None:
    """y = 3 a - b + noise: coefficients times deviations over that of y; ranks against SciPy's, with ties."""
    rng = np.random.default_rng(5)
    x = np.stack([rng.normal(1.0, 2.0, 4000), rng.uniform(-1.0, 1.0, 4000), rng.integers(0, 4, 4000) * 1.0], axis=1)
    y = 3.0 * x[:, 0] - x[:, 1] + rng.normal(0.0, 1.0, 4000)
    found = sensitivity_of(("a", "b", "c"), x, y)
    assert found.regression == pytest.approx(np.array([6.0, -1.0 / np.sqrt(3.0), 0.0]) / y.std(), abs=0.02)
    assert found.r_squared == pytest.approx(1.0 - 1.0 / y.var(), abs=0.01)
    assert found.spearman == pytest.approx([stats.spearmanr(column, y).statistic for column in x.T], abs=1e-12)
    assert found.ranking[:2] == [0, 1]
    steep = sensitivity_of(("a", "b", "c"), x, np.exp(4.0 * x[:, 1]) + 0.0 * x[:, 0])
    assert steep.spearman[1] == pytest.approx(1.0)
    assert steep.r_squared < 0.9
    assert steep.ranking[0] == 1
    assert np.isnan(sensitivity_of(("a",), np.ones((5, 1)), np.arange(5.0)).regression[0])


def test_tables_and_summary(tmp_path: Path) -> None:
    parquet = needs("pyarrow.parquet")
    plan = plan_from_toml(f"record = ['coordinate_end']\n{STIFF}grid = {{ values = [-1.0, 300.0, 500.0, 900.0] }}\n")
    result = run(slider(), RELEASE, plan, tmp_path / "out")
    with result.save_table(tmp_path / "t.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    table = parquet.read_table(result.save_table(tmp_path / "t.parquet")).to_pydict()
    assert [float(row["joints.rail.z.stiffness"]) for row in rows] == [-1.0, 300.0, 500.0, 900.0]
    ends = result.of("coordinate_end.rail.z")
    assert [float(row["coordinate_end.rail.z"]) for row in rows[1:]] == ends[1:].tolist()
    assert table["coordinate_end.rail.z"][1:] == ends[1:].tolist()
    assert "negative" in rows[0]["error"]
    assert table["error"] == [row["error"] for row in rows]
    good = np.sort(ends[1:])
    assert result.percentiles("coordinate_end.rail.z", (0, 50, 100)) == pytest.approx(good)
    facts = result.as_dict()
    assert facts["failed"] == 1
    assert facts["columns"]["coordinate_end.rail.z"]["percentiles"]["50"] == pytest.approx(good[1])
    refused(InputError, "no table", result.save_table, tmp_path / "t.xls")
    refused(InputError, "did you mean", result.of, "coordinate_end.rail.x")


def test_the_command(tmp_path: Path) -> None:
    plan = f"record = ['coordinate_end']\nsamples = 20\n{STIFF}uniform = {{ low = 300.0, high = 900.0 }}\n"
    release, out = "duration = 0.3\n[initial]\nq = { rail = 0.1 }\n", tmp_path / "out"
    for name, text in (("r.toml", SLIDER), ("s.toml", release), ("p.toml", plan)):
        (tmp_path / name).write_text(text)
    words = ("sweep", tmp_path / "r.toml", "--scenario", tmp_path / "s.toml", "--plan", tmp_path / "p.toml", "-o", out)
    said = command(*words)
    assert "20 samples, 0 failed" in said
    assert "joints.rail.z.stiffness" in said
    for name in ("distribution.png", "sensitivity.png"):
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    assert SweepResult.load(out).complete
    assert "threads: 0" in command(*words, "--threads", 0, code=1)
    assert "--dask" in command(*words, "--threads", 2, "--dask", "tcp://127.0.0.1:1", code=1)


@pytest.mark.soak
def test_the_page_is_true(tmp_path: Path) -> None:
    """Blocks of docs/sweep.md run, its tables have all names, and the example plan fits the example scenario."""
    page = (ROOT / "docs" / "sweep.md").read_text(encoding="utf-8")
    for block in re.findall(r"```python\n(.*?)```", page, re.S):
        subprocess.run([sys.executable, "-c", block], check=True, capture_output=True, cwd=tmp_path)
    for name in (*RECORDS, *DESIGNS, *ENGINES, "grid", "uniform", "normal"):
        short = re.sub(r"^tool_deviation(?=_(rms|end))", "", name)
        assert f"`{short}" in page or f'"{name}"' in page, name
    example = load_plan(ROOT / "examples" / "reach_tolerances.toml")
    assert example.samples == 10_000
    scenario = load_scenario(str(ROOT / "examples" / "reach.toml"))
    robot = load_robot("puma560_elastic")
    for entry in example.vary:
        assert expand_tunable(robot, [entry.parameter or ""])
    assert scenario.duration == 1.0


@pytest.mark.soak
def test_a_thousand_samples_of_36_coordinates(tmp_path: Path) -> None:
    """A tenth of the example: percentiles settle as samples become many, the nominal tool deviation is among them."""
    robot, reach = load_robot("puma560_elastic"), ROOT / "examples" / "reach.toml"
    plan = replace(load_plan(ROOT / "examples" / "reach_tolerances.toml"), samples=1000)
    result = run(robot, reach, plan, tmp_path)
    assert result.complete
    assert not result.errors
    first = replace(result, index=result.index[:500], samples=result.samples[:500], record=result.record[:500])
    for column in ("tool_deviation_max", "tool_deviation_rms"):
        assert result.percentiles(column, (50, 95)) == pytest.approx(first.percentiles(column, (50, 95)), rel=0.02)
    nominal = np.linalg.norm(run_scenario(robot, load_scenario(str(reach))).tool_deviation, axis=1).max()
    low, high = result.percentiles("tool_deviation_max", (1, 99))
    assert low < nominal < high
