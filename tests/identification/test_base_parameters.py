"""Base parameters: their numbers for known robots, their formulas, and that they are all that forces can show."""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.errors import EomgenWarning, InputError
from eomgen.identification import BaseParameters, base_parameters
from eomgen.identification.identifiable import TERMS, columns, regrouped
from eomgen.robot.value import Coordinate, Joint, Link, Placement, Robot
from tests.support.builds import Build
from tests.support.description_samples import example_urdfs
from tests.support.random_robots import Array, random_robot

TX40 = (  # a, alpha, d of modified Denavit and Hartenberg frames, m and quarters of a turn
    (0.0, 0, 0.32),
    (0.0, -1, 0.0),
    (0.225, 0, 0.035),
    (0.0, 1, 0.225),
    (0.0, -1, 0.0),
    (0.0, 1, 0.065),
)


def tx40() -> Robot:
    links = tuple(Link(f"link{i}", 1.0, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0)) for i in range(1, 7))
    joints = tuple(
        Joint(
            f"joint{i}",
            f"link{i - 1}" if i > 1 else "base",
            f"link{i}",
            "revolute",
            Placement.from_dh(a, quarters * np.pi / 2, d, 0.0),
            coordinates={"gamma": Coordinate()},
        )
        for i, (a, quarters, d) in enumerate(TX40, 1)
    )
    return Robot("tx40", (0.0, 0.0, -9.81), links, joints)


def example(name: str) -> Robot:
    """A robot of example-robot-data, its fingers fixed."""
    paths: dict[str, Path] = {path.stem: path for path in example_urdfs()}
    if name not in paths:
        pytest.skip("no example-robot-data")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EomgenWarning)
        robot = eomgen.load_robot(paths[name], inertia="warn", urdf_mimic=False)
    joints = (replace(x, type="fixed", coordinates={}) if "finger" in x.name else x for x in robot.joints)
    return replace(robot, joints=tuple(joints))


ROBOTS = {
    "puma560": lambda: eomgen.load_robot("puma560"),
    "ur5": lambda: eomgen.load_robot("ur5"),
    "tx40": tx40,
    "ur10_robot": lambda: example("ur10_robot"),
    "panda": lambda: example("panda"),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_numbers_of_known_robots(name: str, built: Build) -> None:
    """Gravity along the first axis takes two away: no link's weight turns about it."""
    robot = ROBOTS[name]()
    along, across, rotors, friction, static = (43, 45, 48, 69, 12) if name == "panda" else (36, 38, 40, 58, 10)
    kernel = built(robot, "regressor")
    assert len(base_parameters(robot, terms=("links",), kernel=kernel)) == along
    assert len(base_parameters(robot, kernel=kernel)) == rotors
    assert len(base_parameters(robot, terms=TERMS, kernel=kernel)) == friction
    assert len(base_parameters(robot, terms=("links",), static=True, kernel=kernel)) == static
    kernel.parameters["gravity.x"] = 5.0
    assert len(base_parameters(robot, terms=("links",), kernel=kernel)) == across


def test_formulas_of_the_puma(built: Build) -> None:
    """Masses behind a joint act on the link in front of it as a first moment at the joint: 431.8 mm."""
    robot = eomgen.load_robot("puma560")
    found = base_parameters(robot, terms=("links",), kernel=built(robot, "regressor"))
    masses = " ".join(f"+ 0.4318 link{i}.m" for i in (3, 4, 5, 6))
    assert f"link2.mx {masses}" in found.names
    assert "link4.ixx - link4.iyy + link5.iyy" in found.names
    assert "link6.ixx - link6.iyy" in found.names
    assert found.without_effect[:4] == ("link1.m", "link1.mx", "link1.my", "link1.mz")
    assert found.lines()[0] == "puma560: 36 base parameters of 60 (links)"
    assert "36" not in found.lines()[2]
    terms = found.as_dict()["base_parameters"]["link6.ixx - link6.iyy"]
    assert terms == {"link6.ixx": 1.0, "link6.iyy": -1.0}


def residue(robot: Robot, found: BaseParameters, kernel: eomgen.Kernel) -> tuple[float, int]:
    """What combinations leave of forces at random parameters, relative; and the rank of all columns, by their SVD."""
    rng = np.random.default_rng(7)
    q, v, a = rng.uniform(-1.5, 1.5, (3, 80, kernel.n))
    names, W = columns(kernel, q, v, a, found.terms)
    theta = rng.uniform(-1.0, 1.0, len(names))
    left = found.regressor(kernel, q, v, a) @ found.values(theta) - W @ theta
    flat: Array = W.reshape(-1, len(names))
    sizes = np.linalg.norm(flat, axis=0)
    keep = sizes > 1e-9 * sizes.max()
    rank = np.linalg.matrix_rank(flat[:, keep] / sizes[keep], tol=1e-8 * np.sqrt(keep.sum()))
    return float(np.abs(left).max() / np.abs(W @ theta).max()), int(rank)


@pytest.mark.parametrize("seed", [5500, 5501, 5502])
def test_they_are_all_that_forces_show(seed: int, built: Build) -> None:
    robot = random_robot(seed, joints=(2, 4), max_coordinates=2, tree=True, types=("revolute", "prismatic", "fixed"))
    kernel = built(robot, "regressor")
    found = base_parameters(robot, terms=TERMS, kernel=kernel)
    left, rank = residue(robot, found, kernel)
    assert left < 1e-9
    assert rank == len(found)


def test_columns_that_depend_on_others() -> None:
    a, b = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 20))
    places, matrix = regrouped(np.column_stack([0.0 * a, a, 2.0 * a, b, a - 0.5 * b, 1e-12 * b]))
    assert places.tolist() == [1, 3]
    assert matrix[:, :5].tolist() == [[0.0, 1.0, 2.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0, pytest.approx(-0.5, abs=1e-12)]]


def test_what_is_refused(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"), "regressor")
    with pytest.raises(InputError, match=r"terms: 'rotor'; allowed: links, rotors, viscous, dry, offset"):
        base_parameters("one_link", terms=("rotor",), kernel=kernel)
    with pytest.raises(InputError, match="terms: none; allowed"):
        base_parameters("one_link", terms=(), kernel=kernel)
    with pytest.raises(InputError, match=re.escape("terms: rotors: no force of one_link depends on them")):
        base_parameters("one_link", terms=("rotors",), static=True, kernel=kernel)
    with pytest.raises(InputError, match=r"theta: shape \(3,\); allowed: \(11,\)"):
        base_parameters("one_link", kernel=kernel).values(np.zeros(3))
