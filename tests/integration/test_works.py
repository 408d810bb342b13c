"""Works that C integrates along with a motion: closed forms, balances with energies, and bits that stay."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen import InputError, IntegrationStopped
from eomgen.errors import UnknownNameError
from eomgen.integration.solve import integrate
from eomgen.integration.trajectory import Trajectory
from eomgen.integration.until import Until
from eomgen.motion.point_to_point import Harmonic
from eomgen.robot.value import Coordinate, Robot
from eomgen.runtime.stepping.input_signals import WORKS
from eomgen.runtime.stepping.options import ADAPTIVE as METHODS
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.run import run_scenario
from tests.support.builds import Build
from tests.support.random_robots import random_robot, random_state, some_prescribed
from tests.support.soak import across
from tests.support.swinging import DAMPING, MASS, NEEDED, STIFFNESS, oscillator

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

NAMES = (*NEEDED, "adaptive_rollout", "radau_rollout", "generalized_force", "external_force", "kinematics")
CLOSED = ("constrained_dynamics", "constraint", "constraint_jacobian", "residual", "cut_poses", "following")


def residue(motion: Trajectory) -> float:
    """Energy that does not balance, by the size of the works and of the energies' ranges."""
    assert motion.works is not None
    total = motion.energy.sum(axis=1)
    found = total - total[0] - motion.works[:, :3].sum(axis=1) + motion.works[:, 3]
    return float(np.abs(found).max() / max(np.abs(motion.works).max(), np.ptp(motion.energy, axis=0).max()))


def same_bits(motion: Trajectory, other: Trajectory) -> bool:
    counts = all(motion.info[name] == other.info[name] for name in ("steps", "rejected"))
    return counts and np.array_equal(motion.q, other.q) and np.array_equal(motion.v, other.v)


@pytest.mark.parametrize("method", METHODS)
def test_a_closed_form(method: str, built: Build) -> None:
    """A damped mass on a spring under a force that stays, at a few samples between the steps."""
    kernel, force = built(oscillator(), *NAMES), 5.0
    times = np.array([0.0, 0.11, 0.35, 0.351, 0.8, 1.0])
    how: dict[str, Any] = {"drive": [force], "times": times, "method": method, "rtol": 1e-8}
    motion = integrate(kernel, [0.0], [0.0], 1.0, works=True, **how)
    plain = integrate(kernel, [0.0], [0.0], 1.0, **how)
    assert plain.works is None
    assert same_bits(motion, plain)
    decay = DAMPING / (2.0 * MASS)
    rate = np.sqrt(STIFFNESS / MASS - decay**2)

    def taken(end: float) -> float:
        """What the damper has taken until then."""
        nodes, weights = np.polynomial.legendre.leggauss(60)
        t = 0.5 * end * (nodes + 1.0)
        v = force / (MASS * rate) * np.exp(-decay * t) * np.sin(rate * t)
        return float(0.5 * end * weights @ (DAMPING * v**2))

    assert motion.works is not None
    assert motion.works[:, WORKS.index("drives")] == pytest.approx(force * motion.q[:, 0], abs=1e-8)
    assert motion.works[:, WORKS.index("dissipated")] == pytest.approx([taken(t) for t in times.tolist()], abs=1e-8)
    assert (motion.works[:, [WORKS.index("prescribed"), WORKS.index("wrenches")]] == 0.0).all()


@pytest.mark.parametrize(("kind", "method"), across(["worn", "prescribed"], [*METHODS, "auto"]))
def test_balances_are_as_good_as_tolerances(kind: str, method: str, built: Build) -> None:
    """Clearances and frictions, or prescribed coordinates among others, under wrenches: at two samples as at many."""
    if kind == "worn":
        from tests.codegen.forces.test_laws import worn  # with the oracle of Pinocchio

        robot, prescribed = worn(1467, (1, 2)), None
    else:
        robot = some_prescribed(random_robot(1453, joints=(2, 3), types=("revolute", "prismatic")), 1453)
    kernel, s = built(robot, *NAMES), random_state(robot, 3)
    if kernel.prescribed:
        prescribed = Harmonic(np.full(len(kernel.prescribed), 0.1), 3.0, 0.4)
    rng = np.random.default_rng(4)
    how: dict[str, Any] = {"drive": s.u, "wrench": rng.uniform(-5.0, 5.0, (len(kernel.links), 6))}
    how |= {"prescribed": prescribed, "method": method, "works": True}
    ends, found = [], []
    for rtol, step in ((1e-5, 0.05), (1e-7, 0.05), (1e-7, 0.0005)):
        motion = integrate(kernel, s.q, s.v, 0.05, rtol=rtol, output_step=step, **how)
        assert motion.works is not None
        found.append(residue(motion))
        ends.append(motion.works[-1])
    assert np.array_equal(ends[1], ends[2])  # steps do not end at samples
    assert found[1] <= 1e-6
    assert found[2] <= 2e-6
    if method != "auto":
        assert found[1] <= max(0.1 * found[0], 1e-9)
    assert (np.abs(ends[1][[WORKS.index("drives"), WORKS.index("wrenches")]]) > 0.0).all()
    assert (ends[1][WORKS.index("prescribed")] != 0.0) == bool(kernel.prescribed)


@pytest.mark.soak
@pytest.mark.parametrize("method", METHODS)
def test_a_mechanism_with_a_prescribed_crank(method: str, built: Build) -> None:
    """What moves the crank does what the energy changes by and what the rocker's damper takes: loops do no work."""
    robot = eomgen.load_robot("four_bar")
    crank, *others = robot.joints
    given = replace(crank, coordinates={"gamma": Coordinate(prescribed=True)})
    damped = replace(others[-1], coordinates={"gamma": Coordinate(damping=0.5)})
    robot = Robot(
        **{**vars(robot), "name": "cranked", "driven": (), "joints": (given, *others[:-1], damped), "home": {}}
    )
    kernel = built(robot, *NAMES, *CLOSED)
    wave = Harmonic([0.6], 1.0, 1.0)
    start, rate, _ = wave(0.0)
    q = kernel.assemble([float(start[0]), *(robot.home.get(x, 0.3) for x in kernel.coordinates[1:])], kernel.prescribed)
    v = kernel.project_velocity(q, [float(rate[0]), 0.0, 0.0], kernel.prescribed)
    motion = integrate(kernel, q, v, 0.2, prescribed=wave, method=method, rtol=1e-7, output_step=0.1, works=True)
    assert motion.works is not None
    assert residue(motion) <= 1e-6
    moved, taken = (abs(motion.works[-1, WORKS.index(name)]) for name in ("prescribed", "dissipated"))
    assert min(moved, taken) > 1e-3
    fine = integrate(kernel, q, v, 0.2, prescribed=wave, method="DOP853", rtol=1e-10, output_step=2e-4)
    power = (fine.u * fine.v)[:, 0]
    assert np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(fine.t)) == pytest.approx(
        motion.works[-1, WORKS.index("prescribed")], rel=1e-4
    )


@pytest.mark.parametrize("method", METHODS)
def test_steps_that_are_too_long_for_powers(method: str, built: Build) -> None:
    """Of a mass that is moved to and fro no number has an error, and steps are as long as can be; works are exact."""
    robot = oscillator(damping=3.0)
    joint = replace(robot.joints[0], coordinates={"z": Coordinate(damping=3.0, prescribed=True)})
    kernel = built(replace(robot, name="moved", joints=(joint,)), *NAMES)
    wave, end = Harmonic([0.2], 1.3, 0.4), 5.0
    times = np.array([0.0, 0.7, 3.0, end])
    motion = integrate(kernel, [0.0], [0.0], end, prescribed=wave, method=method, rtol=1e-8, times=times, works=True)
    amplitude, rate = 0.2, 2.0 * np.pi * 1.3
    assert motion.info["steps"] < 100
    assert motion.works is not None
    angle = 2.0 * (rate * times + 0.4)
    taken = 3.0 * (amplitude * rate) ** 2 * (0.5 * times + (np.sin(angle) - np.sin(0.8)) / (4.0 * rate))
    assert motion.works[:, WORKS.index("dissipated")] == pytest.approx(taken, rel=1e-7)
    assert residue(motion) <= 1e-7


def test_ends_before_the_last_sample(built: Build) -> None:
    """Where a coordinate reaches a value, and where nothing leads on: works of all that is there."""
    kernel = built(oscillator(), *NAMES)
    how: dict[str, Any] = {"drive": [5.0], "method": "tsit5", "rtol": 1e-9, "works": True}
    until = Until.coordinate(kernel, "slide.z", 0.004)
    for step in (0.5, 0.003):
        motion = integrate(kernel, [0.0], [0.0], 1.0, until=until, output_step=step, **how)
        assert motion.works is not None
        assert motion.works[:, 0] == pytest.approx(5.0 * motion.q[:, 0], abs=1e-10)
        assert residue(motion) <= 1e-8
    with pytest.raises(IntegrationStopped) as stop:
        integrate(kernel, [0.0], [0.0], 1e9, **{**how, "drive": [1e300]}, atol=1e-9)
    stopped = stop.value.trajectory
    assert stopped is not None
    assert stopped.works is not None
    assert stopped.works.shape == (stopped.t.size, len(WORKS))


def test_what_cannot_be_integrated_along_is_said(built: Build) -> None:
    kernel = built(oscillator(), *NAMES)
    with pytest.raises(InputError, match="works: oscillator: DOP853 integrates in Python; allowed: integrations in C"):
        integrate(kernel, [0.0], [0.0], 0.1, method="DOP853", works=True)
    with pytest.raises(
        InputError, match="Radau integrates in Python, because the drive is a function that only Python"
    ):
        integrate(kernel, [0.0], [0.0], 0.1, drive=lambda _t, _q, _v: [1.0], works=True)
    with pytest.raises(UnknownNameError, match="without the kernel generalized_force"):
        integrate(built(oscillator(), *NEEDED, "adaptive_rollout"), [0.0], [0.0], 0.1, works=True)


@pytest.mark.soak
@pytest.mark.parametrize("robot", ["geared_arm", "worn_arm"])
def test_a_simulation_balances_at_any_samples(robot: str) -> None:
    """Powers at samples that lie far apart say little of the works in between, which are known all the same."""
    text = "duration = 0.3\n[motion]\ntype = 'point_to_point'\n"
    works = []
    for step in (0.1, 0.01):
        found = run_scenario(robot, scenario_from_toml(f"output_step = {step}\n{text}"))
        assert found.balance is not None
        assert found.balance.relative_residue <= 1e-6
        works.append(found.balance.work[:: round(0.1 / step)])
    assert works[0] == pytest.approx(works[1], rel=1e-9, abs=1e-12)
