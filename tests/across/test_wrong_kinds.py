"""Arguments in all forms that public functions take; of other kinds they are refused by the argument's name."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import InputError, UnknownNameError
from eomgen.identification import fit, forces, identify
from eomgen.motion import read_motion
from eomgen.pictures import View, plot_sweep
from eomgen.scenario import load_scenario
from eomgen.simulation import load_result, load_stream, run_scenario
from eomgen.sweep import load_plan, plan_from_toml, run
from tests.support.good_files import ROLLOUTS
from tests.support.optional import needs
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")

SCENARIO = 'duration = 0.02\n[motion]\ntype = "point_to_point"\ngoal = { joint1 = 0.1 }\n'
VALUES = {"duration": 0.02, "motion": {"type": "point_to_point", "goal": {"joint1": 0.1}}}
WRONG = (3, 1.5, None, b"one_link", ["one_link"], np.zeros(3), object())
ROBOT = eomgen.load_robot("one_link")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("files")
    (place / "s.toml").write_text(SCENARIO)
    (place / "p.toml").write_text(ROLLOUTS)
    return place


def test_a_scenario_is_a_value_a_path_or_a_dict(folder: Path) -> None:
    path = folder / "s.toml"
    given: list[Any] = [load_scenario(path), path, str(path), VALUES]
    results = [run_scenario("one_link", scenario) for scenario in given]
    for result in results[1:]:
        assert result.trajectory.q.tobytes() == results[0].trajectory.q.tobytes()
    with pytest.raises(InputError, match=r"^there is no scenario 'puma560_circl'.*; allowed: "):
        run_scenario("one_link", "puma560_circl")


def test_a_plan_is_a_value_or_a_path_and_figures_go_to_a_folder_of_any_form(folder: Path) -> None:
    needs("matplotlib")
    given: list[Any] = [plan_from_toml(ROLLOUTS), folder / "p.toml", str(folder / "p.toml")]
    results = [run("one_link", VALUES, plan, str(folder / f"out{k}"), threads=1) for k, plan in enumerate(given)]
    for result in results[1:]:
        assert result.record.tobytes() == results[0].record.tobytes()
    for place in (folder / "figures", str(folder / "figures")):
        assert [path.parent for path in plot_sweep(results[0], place)] == [folder / "figures"] * 2


CALLS: dict[str, tuple[str, Callable[[Any], object]]] = {
    "load_robot": ("robot|description|source", eomgen.load_robot),
    "build": ("robot", eomgen.build),
    "simulate": ("robot", eomgen.simulate),
    "run_scenario": ("scenario", lambda x: run_scenario(ROBOT, x)),
    "load_scenario": ("scenario", load_scenario),
    "load_plan": ("plan", load_plan),
    "run, plan": ("plan", lambda x: run(ROBOT, VALUES, x, "unused")),
    "run, scenario": ("scenario", lambda x: run(ROBOT, x, plan_from_toml(ROLLOUTS), "unused")),
    "run, output": ("output", lambda x: run(ROBOT, VALUES, plan_from_toml(ROLLOUTS), x)),
    "load_result": ("path", eomgen.load_result),
    "load_result of a simulation": ("path", load_result),
    "read_motion": ("motion", lambda x: read_motion(x, ("joint1.x", "joint1.gamma"))),
    "forces": ("motion", lambda x: forces(ROBOT, x)),
    "fit": ("motion", lambda x: fit(ROBOT, x)),
    "identify": ("motion", lambda x: identify(ROBOT, x)),
    "plot_sweep": ("folder|result", lambda x: plot_sweep(x, x)),
}


@pytest.mark.parametrize("call", CALLS)
def test_what_is_of_another_kind_is_refused_by_the_name_of_its_argument(call: str) -> None:
    name, function = CALLS[call]
    for wrong in WRONG:
        refused(InputError, rf"^({name}): .*; allowed: ", function, wrong)


def test_the_table_names_functions_that_there_are() -> None:
    packages = (eomgen, eomgen.scenario, eomgen.sweep, eomgen.motion, eomgen.identification, eomgen.pictures)
    for name in (re.split("[, ]", call)[0] for call in CALLS):
        assert any(name in package.__all__ and inspect.isfunction(getattr(package, name)) for package in packages), name


def test_views_are_of_results() -> None:
    needs("viser")
    for wrong in (ROBOT, "one_link", None):
        with pytest.raises(InputError, match=r"^result: got a value of type \w+; allowed: a SimulationResult"):
            View(wrong)  # type: ignore[arg-type]


def test_names_of_joints_links_and_kernels() -> None:
    refused(UnknownNameError, r"^joint: 'joint9' is unknown; did you mean 'joint1'", ROBOT.joint, "joint9")
    refused(KeyError, r"^link: 'lnk1' is unknown; did you mean 'link1'", ROBOT.link, "lnk1")
    with pytest.raises(UnknownNameError, match=r"^joint: 3 is unknown"):
        ROBOT.joint(3)  # type: ignore[arg-type]
    for kernels in ("mass_matrix", 3, np.float64(1.0)):
        with pytest.raises(InputError, match=r"^kernels: .*; allowed: a sequence of names"):
            eomgen.build("one_link", kernels=kernels)  # type: ignore[arg-type]
    refused(InputError, r"^kernels: 'mass_matrx' is unknown", eomgen.build, "one_link", kernels=["mass_matrx"])
    assert set(eomgen.build("one_link", kernels=iter(["energy"])).raw.functions) >= {"energy"}  # type: ignore[arg-type]


def test_folders_where_files_are_expected(tmp_path: Path) -> None:
    for load in (eomgen.load_result, load_result, load_stream):
        refused(InputError, "; allowed: ", load, tmp_path)


def test_results_print_what_commands_print(capsys: pytest.CaptureFixture[str]) -> None:
    result = run_scenario("one_link", VALUES)
    print(result)
    assert capsys.readouterr().out == "\n".join(result.summary_lines()) + "\n"
    assert repr(result).startswith("SimulationResult(robot='one_link', ")
    assert "\n" not in repr(result)
    found = eomgen.analysis.modes("one_link")
    assert str(found) == "\n".join(found.lines())
    assert str(result.series("joint1.x")) == repr(result.series("joint1.x"))
