"""First files for studies of a robot: they are read, name what the robot has, and say what can be put in besides."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import eomgen
from eomgen.authoring.check import check_file
from eomgen.authoring.studies import plan_file_text, tolerances_file_text
from eomgen.cli import entry as cli
from eomgen.forms.toml_text import parse_toml
from eomgen.identification import tolerance
from eomgen.identification.tolerances.solve import tolerance_quantities
from eomgen.identification.tolerances.table import read_table
from eomgen.robot.parameter_names import expand_tunable
from eomgen.sweep import plan_from_toml
from tests.support.makers import MAKERS

pytestmark = pytest.mark.usefixtures("unoptimised")

NAMES = [name for name in eomgen.builtin_robots() if name not in MAKERS[1:]]
WITHOUT = {  # tolerances
    "hexapod_elastic": "all loops are elastic",
}


@pytest.mark.parametrize("name", NAMES)
def test_plans_name_what_is_there(name: str) -> None:
    """Every parameter once, and none of which nothing is a multiple."""
    robot = eomgen.load_robot(name)
    plan = plan_from_toml(plan_file_text(robot))
    assert plan.samples == 200
    varied = [expand_tunable(robot, [vary.parameter]) for vary in plan.vary]
    assert all(varied)
    flat = [one for names in varied for one in names]
    assert len(set(flat)) == len(flat)
    values = dict(robot.numbers())
    assert all(values[one] for one in flat)


def test_plans_of_links_that_bend() -> None:
    """Their masses are those of their modes, and nodes have none; modal stiffness varies."""
    plan = plan_from_toml(plan_file_text(eomgen.load_robot("flexible_arm")))
    masses = [f"links.{name}.mass" for name in ("shoulder_hub", "elbow_hub", "payload")]
    assert [vary.parameter for vary in plan.vary] == [*masses, "links.*.modes.*.stiffness"]


@pytest.mark.parametrize("name", WITHOUT)
def test_what_has_no_tolerances(name: str) -> None:
    """A mechanism all of whose loops are elastic."""
    with pytest.raises(eomgen.InputError, match=WITHOUT[name]):
        tolerances_file_text(eomgen.load_robot(name))


@pytest.mark.parametrize("name", [name for name in NAMES if name not in WITHOUT])
def test_tables_name_every_quantity(name: str) -> None:
    """Those that are put in are read; with all comments undone, every quantity that there is stands in the table."""
    robot = eomgen.load_robot(name)
    known = tolerance_quantities(robot)
    text = tolerances_file_text(robot)
    whole = re.sub(r'^# (?=")', "", text, flags=re.MULTILINE)
    for form, count in ((text, None), (whole, len(known))):
        path_text = read_text_table(form, known)
        assert count is None or len(path_text) == count
    assert set(read_text_table(text, known)) < set(known)


def read_text_table(text: str, known: dict[str, str]) -> list[str]:
    """Names of the quantities of a table."""
    values = parse_toml(text, "table")
    return [entry.name for entry in read_table(values, tuple(known)).entries]


def test_a_study_from_the_first_file_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a robot in the folder and of a built-in one; schemas lie beside plans; what is there stays."""
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new", "mine"]) == 0
    for robot in ("mine", "ur5e"):
        assert cli.main(["new", robot, "--plan"]) == 0
        assert cli.main(["new", robot, "--tolerances"]) == 0
        assert not check_file(f"{robot}_plan.toml").errors
        found = tolerance(eomgen.load_robot("mine.toml" if robot == "mine" else robot), f"{robot}_tolerances.toml")
        assert found.lines()
    assert (tmp_path / "plan.schema.json").exists()
    capsys.readouterr()
    assert cli.main(["new", "mine", "--plan"]) == 1
    assert "is there already" in capsys.readouterr().err
    assert cli.main(["new", "nothing", "--tolerances"]) == 1
    assert "there is no robot 'nothing'; allowed: the name of a .toml" in capsys.readouterr().err
    assert cli.main(["new", "mine", "--plan", "-o", "here.toml"]) == 0
    assert (tmp_path / "here.toml").exists()
