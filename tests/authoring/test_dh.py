"""Descriptions from tables of Denavit-Hartenberg parameters, against products of matrices that know nothing of them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.authoring import dh_file_text, robot_from_dh, write_dh_file
from eomgen.authoring.check import check_file
from eomgen.errors import InputError
from eomgen.robot.value import Robot
from tests.support import makers
from tests.support.commands import command, errors_of
from tests.support.description_samples import homogeneous, link_poses
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

TYPES = ("revolute", "prismatic")


def pose(convention: str, row: Mapping[str, Any], x: float) -> np.ndarray:
    """The step of a row, its coordinate at x, by the convention's own product."""
    angle, along = row["theta"], row["d"]
    angle, along = (angle + x, along) if row.get("type") == "revolute" else (angle, along + x)
    first, second = makers.about_z(angle, along), makers.about_x(row["alpha"], row["a"])
    return first @ second if convention == "classic" else second @ first


def random_rows(rng: np.random.Generator, count: int, flange: bool) -> list[dict[str, Any]]:
    """Rows with every number, in no special pose; right angles among them."""
    rows: list[dict[str, Any]] = []
    for i in range(count + flange):
        numbers = {key: float(rng.choice([0.0, rng.uniform(-1.0, 1.0)])) for key in ("a", "d")}
        numbers |= {key: float(rng.choice([0.0, math.pi / 2, rng.uniform(-3.0, 3.0)])) for key in ("alpha", "theta")}
        kind = "fixed" if i == count else TYPES[int(rng.integers(2))]
        rows.append({"type": kind, **numbers})
        if kind != "fixed":
            M = rng.normal(size=(3, 3))
            J = M @ M.T * 0.01
            tensor = np.trace(J) * np.eye(3) - J
            rows[-1] |= {"joint": f"j{i}", "mass": float(rng.uniform(0.5, 5.0))}
            rows[-1] |= dict(zip(("com_x", "com_y", "com_z"), rng.uniform(-0.2, 0.2, 3).tolist(), strict=True))
            places = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
            rows[-1] |= {key: float(tensor[place]) for key, place in places.items()}
    return rows


def as_csv(rows: Sequence[Mapping[str, Any]], path: Path, *, metric: bool) -> Path:
    """The rows as a file, in m and rad or in mm and degrees."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    names = {"a": "a_mm", "d": "d_mm", "alpha": "alpha_deg", "theta": "theta_deg"} if not metric else {}
    scale = {"a": 1e3, "d": 1e3, "alpha": 180.0 / math.pi, "theta": 180.0 / math.pi} if not metric else {}

    def cell(row: Mapping[str, Any], key: str) -> str:
        value = row.get(key, "")
        return repr(value * scale.get(key, 1.0)) if isinstance(value, float) else str(value)

    lines = ["# by hand", ", ".join(names.get(key, key) for key in columns), ""]
    lines += [",".join(cell(row, key) for key in columns) for row in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def check_against(robot: Robot, rows: Sequence[Mapping[str, Any]], convention: str, q: np.ndarray) -> None:
    """Pose of the tool, and centres of mass and inertia tensors in the base, are those of the table's own frames."""
    frame, frames = np.eye(4), []
    for row, x in zip(rows, [*q, 0.0], strict=False):
        frame = frame @ pose(convention, row, x)
        frames.append(frame)
    poses = link_poses(robot, q)
    (tool,) = robot.frames
    np.testing.assert_allclose(poses[tool.link] @ homogeneous(tool.placement), frames[-1], atol=1e-12)
    for link, row, table in zip(robot.links, rows, frames, strict=False):
        com = table @ [row["com_x"], row["com_y"], row["com_z"], 1.0]
        np.testing.assert_allclose(poses[link.name] @ [*link.com, 1.0], com, atol=1e-12)
        tensor = [[row["ixx"], row["ixy"], row["ixz"]], [row["ixy"], row["iyy"], row["iyz"]]]
        tensor.append([row["ixz"], row["iyz"], row["izz"]])
        xx, yy, zz, xy, xz, yz = link.inertia
        ours = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        R, S = poses[link.name][:3, :3], table[:3, :3]
        np.testing.assert_allclose(R @ ours @ R.T, S @ np.array(tensor) @ S.T, atol=1e-12)
        assert link.mass == row["mass"]


@pytest.mark.parametrize("convention", ["classic", "modified"])
@pytest.mark.parametrize("seed", range(8))
def test_any_table(convention: str, seed: int, tmp_path: Path) -> None:
    """Of both conventions, from rows and files in both units; revolute and prismatic, with and without a flange."""
    rng = np.random.default_rng(seed)
    rows = random_rows(rng, 1 + seed % 6, flange=bool(seed % 2))
    metric = as_csv(rows, tmp_path / "metric.csv", metric=True)
    other = as_csv(rows, tmp_path / "other.csv", metric=False)
    for table in (rows, metric, other):
        robot = robot_from_dh("arm", table, convention)
        assert [joint.name for joint in robot.joints] == [row["joint"] for row in rows if row["type"] != "fixed"]
        for _ in range(3):
            check_against(robot, rows, convention, rng.uniform(-3.0, 3.0, len(robot.joints)))
    assert robot_from_dh("arm", metric, convention) == robot_from_dh("arm", rows, convention)


def test_a_makers_table_as_it_stands() -> None:
    """The UR5e's: the built-in robot, but for tensors that the table does not give, and limits."""
    keys = ("theta", "d", "a", "alpha", "mass", "com_x", "com_y", "com_z")
    rows = [dict(zip(keys, (*row[:5], *row[5]), strict=True)) for row in makers.UR5E]
    text = dh_file_text("ur5e", rows, "classic")
    assert "assumed: the inertia of the links of 'joint1'" in text
    assert "assumed: the mass" not in text
    robot, built_in = robot_from_dh("ur5e", rows, "classic"), eomgen.load_robot("ur5e")
    assert [joint.placement for joint in robot.joints] == [joint.placement for joint in built_in.joints]
    assert [(link.mass, link.com) for link in robot.links] == [(link.mass, link.com) for link in built_in.links]


def test_masses_that_are_assumed(tmp_path: Path) -> None:
    """They are said to be so, and the file is without faults; angles keep the unit of the table."""
    path = tmp_path / "arm.toml"
    table = tmp_path / "table.csv"
    table.write_text(
        "joint,a_mm,alpha_deg,d,theta,lower_deg,upper_deg\nhip,89.159,90,0,\u2212pi/2,-90,90\n,0,,0.3,,,\n"
    )
    path.write_text(dh_file_text("arm", table, "modified"), encoding="ascii")
    text = path.read_text(encoding="ascii")
    assert "assumed: the mass of the links of 'hip', 'joint2'" in text
    assert "dh = { a = 0.089159, alpha_deg = 90.0, d = 0.0, theta = -1.5707963267948966 }" in text
    found = check_file(path)
    assert not found.errors
    assert not found.notes
    assert eomgen.load_robot(path).joints[0].limits == (-math.pi / 2, math.pi / 2)


BAD: dict[str, tuple[str, str]] = {
    "empty": ("# nothing\n", "is empty; allowed: a header of joint, type, a,"),
    "column": ("a,alfa\n1,2\n", "table.csv:1: there is no column 'alfa'; did you mean 'alpha'?"),
    "cells": ("a,d\n1,2,3\n", "table.csv:2: has 3 cells; allowed: 2"),
    "number": ("# x\na,d\n1,two\n", "table.csv:3: d: got 'two'; allowed: a number"),
    "infinite": ("a,d\n1,inf\n", "table.csv:2: d: got 'inf'; allowed: a number"),
    "two units": ("a,a_mm\n1,1000\n", "a stands in two units"),
    "column twice": ("a,a\n1,1\n", "a column is there twice"),
    "type": ("type,a\nhinge,1\n", "type: got 'hinge'"),
    "name": ("joint,a\n1st,1\n", "joint: got '1st'"),
    "names": ("joint,a\nj,1\nj,1\n", "table.csv:2: joint: 'j' is there twice"),
    "fixed before": ("type,a\nfixed,1\nrevolute,1\n", "table.csv:2: type: got 'fixed'; allowed: in the last row"),
    "fixed alone": ("type,a\nfixed,1\n", "one and more that move"),
    "mass of a flange": ("type,a,mass\nrevolute,1,1\nfixed,1,1\n", "table.csv:3: mass of a fixed row"),
    "half a range": ("a,lower\n1,-1\n", "limits: allowed: lower and upper"),
    "range": ("a,lower,upper\n1,1,-1\n", "limits: allowed: lower and upper, lower <= upper"),
    "degrees along": ("type,lower_deg,upper_deg\nprismatic,-1,1\n", "has limits in m"),
    "centre without mass": ("a,com_x\n1,1\n", "com_x stands without mass"),
    "two numbers": ("a,d\n1 2,3\n", "table.csv:2: a: got '1 2'; allowed: a number"),
    "other digits": ("a,d\n1_0,3\n", "table.csv:2: a: got '1_0'; allowed: a number"),
    "large": ("a,mass\n1e30,1e30\n", "table.csv:2: a: got '1e30'; allowed: a number of magnitude up to 1e+08"),
    "overflow": ("alpha\n1/1e400\n", "table.csv:2: alpha: got '1/1e400'; allowed: a number"),
    "no divisor": ("alpha\npi/0\n", "table.csv:2: alpha: got 'pi/0'; allowed: a number"),
    "mass": ("a,mass\n1,-1\n", "table.csv:2: mass: got -1; allowed: a number that is at least 0"),
    "quote": ('a,d\n1,"2\n5"\n3,4\n', "table.csv:2: a quote is not closed"),
    "long cell": (f"a,d\n1,{'2' * 200_000}\n", "table.csv:2: is no CSV (field larger"),
    "line of a page": ("a,d\n1,2\u20283,4\n", "table.csv:2: has 3 cells; allowed: 2"),
    "half a tensor": ("a,mass,ixx\n1,1,1\n", "iyy is missing; allowed: ixx, iyy and izz"),
}


@pytest.mark.parametrize("case", BAD)
def test_refusals(case: str, tmp_path: Path) -> None:
    text, said = BAD[case]
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    refused(InputError, re.escape(said), dh_file_text, "arm", path, "modified")


def test_conventions_names_and_rows_of_other_things() -> None:
    for arguments, said in (
        (("arm", [{"a": 1.0}], "craig"), r"convention: got 'craig'; allowed: classic, which is Rz\(theta\)"),
        (("my arm", [{"a": 1.0}], "classic"), "got the name 'my arm'"),
        (("arm", [{"a": 1.0}, {"alpa": 1.0}], "classic"), "row 2: there is no column 'alpa'"),
        (("arm", [{"a": 10**5000}], "modified"), "row 1: a: got an integer of 16610 bits"),
        (("arm", [{"a": np.ones(2)}], "modified"), "row 1: a: got array"),
        (("arm", [{"joint": 10**5000}], "modified"), "row 1: joint: got 'an integer of"),
        (("arm", [{5: 1.0}], "modified"), "row 1: there is no column 5"),
    ):
        refused(InputError, said, dh_file_text, *arguments)
    refused(InputError, "xx", robot_from_dh, "arm", [{"mass": 1.0, "ixx": 1.0, "iyy": 0.1, "izz": 0.1}], "classic")


def test_from_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rows = random_rows(np.random.default_rng(1), 3, flange=True)
    as_csv(rows, Path("table.csv"), metric=True)
    words = ("new", "arm", "--dh", "table.csv")
    assert "--dh is given without --convention" in errors_of(*words)
    assert "--convention is given without --dh" in errors_of("new", "arm", "--convention", "classic")
    assert command(*words, "--convention", "classic") == "wrote arm.toml\n"
    check_against(eomgen.load_robot(tmp_path / "arm.toml"), rows, "classic", np.array([0.3, -0.7, 1.1]))
    assert "is there already" in errors_of(*words, "--convention", "classic")


def test_numbers_as_tables_have_them() -> None:
    """Fractions of pi, signs that are typeset, spaces; degrees stay as they are."""
    texts = {"pi": math.pi, "-pi/2": -math.pi / 2, "+3 pi / 4": 0.75 * math.pi, "2*pi/3": 2 * math.pi / 3, "1/8": 0.125}
    for text, value in (texts | {"\u22121e-3 ": -1e-3, "\u03c0": math.pi, ".5": 0.5, "5.": 5.0}).items():
        assert f"theta = {value!r} " in dh_file_text("arm", [{"theta": text}], "modified")
    assert "alpha_deg = 1e-13," in dh_file_text("arm", [{"alpha_deg": "1e-13"}], "modified")


def test_inertias_of_bodies_without_mass_are_not_assumed() -> None:
    text = dh_file_text("arm", [{"a": 1.0, "mass": 0.0}, {"a": 1.0}], "modified")
    assert "assumed: the inertia of the links of 'joint2', that" in text


@pytest.mark.parametrize("name", ["t\u00e4ble.csv", "a\nname = 'x'.csv"])
def test_names_of_tables_that_are_no_words(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The description is ASCII, and the name a part of its comment."""
    monkeypatch.chdir(tmp_path)
    Path(name).write_text("a\n1\n", encoding="ascii")
    assert write_dh_file("arm", name, "classic") == Path("arm.toml")
    assert not check_file("arm.toml").errors
    refused(InputError, "is there already", write_dh_file, "arm", name, "classic")
