"""A thousand random robots of up to 36 coordinates: oracles, laws, every form of the generator, and motions."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eomgen.codegen.kernels.equations import derive
from eomgen.integration.solve import integrate
from eomgen.integration.trajectory import Trajectory
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, PRINCIPAL, Coordinate, Joint, Robot
from tests.support.builds import Build
from tests.support.figures import Figures
from tests.support.many_descriptions import check_descriptions, check_forms, check_oracles
from tests.support.many_laws import CHECKS
from tests.support.many_motion import momenta
from tests.support.many_robots import FORMS, ROBOTS, Subject, many_robot, named, run, size_of, subject
from tests.support.random_robots import random_robot
from tests.support.soak import soaked

EVERYTHING: tuple[Callable[[Subject, Figures], None], ...] = (
    check_oracles,
    check_forms,
    check_descriptions,
    *CHECKS,
)
BLOCK = 20
QUICK = (9, 20, 29, 32, 55, 59, 62, 66)  # small ones, one of every form


def check(number: int, built: Build, figures: Figures, cache: Path) -> None:
    """Everything about one robot; what was compiled for it is removed."""
    robot = many_robot(number)
    with named(f"robot {number}"):
        s = subject(number, built)
        shutil.rmtree(cache)
        figures.count("robots")
        figures.count(f"robots, {s.form}")
        figures.count("states", len(s.q))
        figures.count("coordinates", s.model.size)
        for law in EVERYTHING:
            law(s, figures)
    assert s.robot == robot, "a check has changed the robot"


@pytest.mark.parametrize("number", soaked(QUICK, QUICK[::3]))
def test_a_few_robots(number: int, built: Build, figures: Figures, empty_cache: Path) -> None:
    check(number, built, figures, empty_cache)


@pytest.mark.soak
@pytest.mark.parametrize("first", range(0, ROBOTS, BLOCK))
def test_a_thousand_robots(first: int, built: Build, figures: Figures, empty_cache: Path) -> None:
    for number in range(first, first + BLOCK):
        check(number, built, figures, empty_cache)


@pytest.mark.soak
def test_the_thousand_have_all_that_there_is() -> None:
    """Sizes, branches, joints of 0 to 6 coordinates; and the quick ones have every form."""
    robots = [many_robot(number) for number in range(ROBOTS)]
    joints = [joint for robot in robots for joint in robot.joints]
    sizes = Counter(sum(len(joint.coordinates) for joint in robot.joints) for robot in robots)
    assert set(sizes) == set(range(1, 37))
    assert sizes[36] >= 5
    assert {len(joint.coordinates) for joint in joints} == set(range(7))
    assert {joint.type for joint in joints} == {"revolute", "prismatic", "fixed", "free"}
    branched = [len({joint.parent for joint in robot.joints}) < len(robot.joints) for robot in robots]
    assert 200 <= np.count_nonzero(branched) <= 600
    assert {number % len(FORMS) for number in QUICK} == set(range(len(FORMS)))


DURATION = 10.0  # s
DRIFT, MOMENTUM = 1e-9, 1e-10
NAMES = ("forward_dynamics", "energy", "mass_matrix")


def sprung(seed: int, damping: bool, floating: bool = False) -> Robot:
    """A random robot whose deviations and slides have springs, its turns about z none; no drives.

    floating: weightless, on a free joint without springs and dampers, which makes its base a body of its own.
    """
    rng = np.random.default_rng([2028, seed])
    robot = random_robot(
        rng, joints=(1, 4), max_size=9, tree=seed % 2 == 0, forces=False, rods=False, name=f"motion{seed}"
    )

    def coordinate(joint: Joint, name: str, old: Coordinate) -> Coordinate:
        turns = name == PRINCIPAL.get(joint.type) == "gamma"
        stiffness = None if turns else float(rng.uniform(100.0, 500.0))
        return replace(old, stiffness=stiffness, damping=float(rng.uniform(0.2, 3.0)) if damping else None)

    joints = [
        replace(joint, coordinates={name: coordinate(joint, name, old) for name, old in joint.coordinates.items()})
        for joint in robot.joints
    ]
    if not floating:
        return replace(robot, joints=tuple(joints))
    hull = replace(robot.links[0], name="hull")
    free = Joint("floating", robot.base, "hull", "free", coordinates=dict.fromkeys(COORDINATES, Coordinate()))
    carried = [replace(j, parent="hull") if j.parent == robot.base else j for j in joints]
    links, gravity = (hull, *robot.links), (0.0, 0.0, 0.0)
    return replace(robot, name=f"floating{seed}", gravity=gravity, links=links, joints=(free, *carried))


def motion(robot: Robot, seed: int, built: Build, floating: bool = False) -> Trajectory:
    """Ten seconds from a random state, by DOP853 at a relative tolerance of 1e-12."""
    kernel, rng = built(robot, *NAMES), np.random.default_rng([2029, seed])
    q, v = rng.uniform(-0.2, 0.2, kernel.n), rng.uniform(-0.5, 0.5, kernel.n)
    if floating:
        v[3:6] *= 0.2  # in ten seconds beta does not come to +-pi/2
    return integrate(kernel, q, v, DURATION, method="scipy:DOP853", rtol=1e-12, atol=1e-14, output_step=0.02)


def check_energy(seed: int, built: Build, figures: Figures) -> None:
    found = motion(sprung(seed, damping=False), seed, built)
    total, size = found.energy.sum(axis=1), np.abs(found.energy).max()
    assert found.energy[:, 0].max() > 1e-3, "nothing moves"
    figures.count("motions")
    figures.count("evaluations", found.info["evaluations"])
    figures.at_most("energy drift / greatest energy", float(np.abs(total - total[0]).max() / size), DRIFT)


def check_damped_energy(seed: int, built: Build, figures: Figures) -> None:
    """What an output step may show of a rise is the integrator's error alone."""
    found = motion(sprung(seed, damping=True), seed, built)
    total, size = found.energy.sum(axis=1), np.abs(found.energy).max()
    figures.count("motions")
    figures.at_most("rise of damped energy / greatest energy", float(np.diff(total).max() / size), 1e-12)
    figures.at_most("damped energy at the end - at the beginning", float(total[-1] - total[0]), -1e-6)


def check_momentum(seed: int, built: Build, figures: Figures) -> None:
    """Linear and angular momentum of a robot that floats, with and without dampers between its links."""
    robot = sprung(seed, damping=seed % 3 == 0, floating=True)
    found, model = motion(robot, seed, built, floating=True), build_model(robot)
    kinematics = derive(model, "kinematics")
    held = momenta(model, lambda _, q: run(kinematics, model, {"q": q}), found.q, found.v)
    assert np.abs(found.q[-1, :3] - found.q[0, :3]).max() > 0.01, "it does not float"
    figures.count("motions")
    for name, part in (("linear", held[..., :3]), ("angular", held[..., 3:])):
        total, terms = part.sum(axis=1), np.abs(part).sum(axis=1)  # of the links, whose momenta may cancel
        change = float(size_of(total - total[0]).max() / terms.max())
        figures.at_most(f"change of {name} momentum / sum of the links' momenta", change, MOMENTUM)


Check = Callable[[int, Build, Figures], None]
ENERGIES: tuple[Check, ...] = (check_energy, check_damped_energy, check_momentum)


@pytest.mark.parametrize("check", ENERGIES)
@pytest.mark.parametrize("seed", [1])
def test_a_motion(check: Check, seed: int, built: Build, figures: Figures, empty_cache: Path) -> None:
    check(seed, built, figures)


@pytest.mark.soak
@pytest.mark.parametrize("check", ENERGIES)
@pytest.mark.parametrize("seed", range(100, 140))
def test_forty_motions(check: Check, seed: int, built: Build, figures: Figures, empty_cache: Path) -> None:
    check(seed, built, figures)
