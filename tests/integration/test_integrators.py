"""SciPy's and SUNDIALS' integrators on kernels: Jacobians, tolerances, contacts, failures."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError, IntegrationStopped, UnknownNameError
from eomgen.integration.solve import integrate
from eomgen.integration.system import System
from eomgen.motion.point_to_point import Harmonic
from eomgen.robot.value import Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.run import run_scenario
from tests.support.builds import Build
from tests.support.random_robots import random_robot, random_state
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

KERNELS = (
    "forward_dynamics",
    "inverse_dynamics",
    "residual_jacobian",
    "mass_matrix",
    "energy",
    "external_force",
)


def stiff_rod(stiffness: float, damping: float) -> Robot:
    """one_link with another spring."""
    robot = eomgen.load_robot("one_link")
    joint = robot.joints[0]
    spring = replace(joint.coordinates["x"], stiffness=stiffness, damping=damping)
    return replace(robot, joints=(replace(joint, coordinates={**joint.coordinates, "x": spring}),))


def in_a_gap(gap: float, stiffness: float) -> Robot:
    """A mass of 2 kg that slides in a clearance."""
    return robot_from_toml(
        f"""
name = "slider"
gravity = [0.0, 0.0, 0.0]
[[links]]
name = "mass"
mass = 2.0
[[joints]]
name = "rail"
parent = "base"
child = "mass"
type = "prismatic"
z = {{ stiffness = {stiffness}, clearance = {gap}, smoothing = 1e-9 }}
"""
    )


@pytest.mark.soak
def test_a_stiff_joint_costs_few_residual_calls(built: Build) -> None:
    """1e8 N/m, damped: at most 2000 residual calls for 2 s at rtol 1e-8, and an error below 1e-6 rad."""
    kernel = built(stiff_rod(1e8, 2e4), *KERNELS)
    q0, zero = [0.0, 0.3], np.zeros(2)
    reference = integrate(kernel, q0, zero, 2.0, method="Radau", rtol=1e-12)
    found = integrate(kernel, q0, zero, 2.0, method="IDA", rtol=1e-8)
    assert found.info["evaluations"] <= 2000
    assert np.abs(found.of("joint1.gamma") - reference.of("joint1.gamma")).max() <= 1e-6
    short = [
        integrate(kernel, q0, zero, 0.05, method="IDA", rtol=1e-8, atol=atol, output_step=0.05).info["evaluations"]
        for atol in (None, 1e-15)  # of each coordinate's size, or the finest of them for all
    ]
    assert short[1] > 3 * short[0]


@pytest.mark.parametrize("method", soaked(["Radau", "BDF", "LSODA", "CVODE", "IDA", "DOP853"], ["LSODA", "IDA"]))
def test_all_methods_find_the_same_motion(method: str, built: Build) -> None:
    rng = np.random.default_rng(12)
    robot = random_robot(rng, joints=(2, 3), types=("revolute", "prismatic"))
    kernel, s = built(robot, *KERNELS), random_state(robot, rng)

    def drive(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return s.u * np.sin(5.0 * t) - 3.0 * v

    wrench = rng.normal(size=(len(kernel.links), 6))
    options = {"drive": drive, "wrench": wrench, "output_step": 0.02}
    reference = integrate(kernel, s.q, s.v, 0.2, method="DOP853", rtol=1e-11, **options)  # type: ignore[arg-type]
    found = integrate(kernel, s.q, s.v, 0.2, method=method, rtol=1e-8, **options)  # type: ignore[arg-type]
    scale = np.ptp(reference.q, axis=0) + 1e-9
    assert np.abs((found.q - reference.q) / scale).max() <= 1e-4
    assert found.method == method


@pytest.mark.parametrize("seed", soaked(range(4), (1,)))
@pytest.mark.parametrize("exact", ["residual_jacobian", "forward_dynamics_jacobian", None])
def test_jacobians_equal_differences(seed: int, exact: str | None, built: Build) -> None:
    """Of y' and of F, with drives, wrenches and prescribed coordinates, from the kernel's derivatives and without."""
    rng = np.random.default_rng(800 + seed)
    robot = random_robot(rng, joints=(2, 3))
    if seed % 2:
        joint = robot.joints[0]
        name = next(iter(joint.coordinates))
        given = {**joint.coordinates, name: replace(joint.coordinates[name], prescribed=True)}
        robot = replace(robot, joints=(replace(joint, coordinates=given), *robot.joints[1:]))
    names = tuple(name for name in KERNELS if name != "residual_jacobian")
    names += () if exact is None else (exact,)
    kernel, s = built(robot, *names), random_state(robot, rng)
    n, gain = kernel.n, rng.normal(size=(kernel.n, 2 * kernel.n))

    def drive(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return gain @ np.concatenate([q, v])

    given_motion = Harmonic([0.1], [1.0]) if kernel.prescribed else None
    system = System(kernel, drive, rng.normal(size=(len(kernel.links), 6)), given_motion)
    y, slopes, c = np.concatenate([s.q, s.v]), np.concatenate([s.v, s.a]), 3.7
    found, whole = system.jacobian(0.1, y), system.residual_jacobian(0.1, y, slopes, c)
    for i in range(2 * n):
        h = 1e-5
        step = np.zeros(2 * n)
        step[i] = h
        column = (system.derivative(0.1, y + step) - system.derivative(0.1, y - step)) / (2 * h)
        assert np.abs(found[:, i] - column).max() <= 1e-5 * max(1.0, np.abs(found).max())
        column = system.residual(0.1, y + step, slopes + c * step) - system.residual(0.1, y - step, slopes - c * step)
        assert np.abs(whole[:, i] - column / (2 * h)).max() <= 1e-5 * max(1.0, np.abs(whole).max())


def test_a_drives_own_slopes_are_taken(built: Build) -> None:
    kernel = built(stiff_rod(1e4, 1.0), *KERNELS)

    class Proportional:
        calls = 0

        def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
            return -5.0 * q

        def slopes(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            Proportional.calls += 1
            return -5.0 * np.eye(2), np.zeros((2, 2))

    y = np.array([0.001, 0.3, 0.1, -0.2])
    found = System(kernel, Proportional(), None).jacobian(0.0, y)
    assert Proportional.calls == 1
    by_differences = System(kernel, lambda t, q, v: -5.0 * q, None).jacobian(0.0, y)
    assert np.abs(found - by_differences).max() <= 1e-6 * np.abs(found).max()


@pytest.mark.parametrize("method", ["DOP853", "Radau", "IDA", "CVODE", "rk4"])
def test_contacts_of_a_sliding_mass(method: str, built: Build) -> None:
    """Constant speed in the gap, half a period of sqrt(k / m) at its end."""
    gap, stiffness, speed = 0.01, 2e5, 0.4
    kernel = built(in_a_gap(gap, stiffness), *KERNELS)
    found = integrate(kernel, [0.0], [speed], 0.1, method=method, rtol=1e-9, step=2e-5)
    swing = np.pi / np.sqrt(stiffness / 2.0)
    hits = [gap / speed, gap / speed + swing, 3 * gap / speed + swing, 3 * gap / speed + 2 * swing]
    assert [(c.side, c.closes) for c in found.contacts] == [(1, True), (1, False), (-1, True), (-1, False)]
    assert np.abs(np.array([c.t for c in found.contacts]) - hits).max() <= 2e-6
    assert np.abs(np.abs([c.rate for c in found.contacts]) - speed).max() <= 1e-4 * speed
    assert {c.coordinate for c in found.contacts} == {"rail.z"}


def test_no_clearance_has_no_contacts(built: Build) -> None:
    kernel = built(stiff_rod(1e4, 1.0), *KERNELS)
    assert integrate(kernel, [0.0, 0.3], [0.0, 0.0], 0.1).contacts == ()


@pytest.mark.parametrize("method", ["IDA", "CVODE"])
def test_what_stops_a_motion_is_said(method: str, built: Build) -> None:
    kernel = built(stiff_rod(1e4, 1.0), *KERNELS)

    def drive(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.full(2, np.nan if t > 0.05 else 0.0)

    with pytest.raises(IntegrationStopped, match=rf"t = 0\.0[45].*{method} cannot go on") as caught:
        integrate(kernel, [0.0, 0.3], [0.0, 0.0], 0.1, drive=drive, method=method)
    assert np.isfinite(caught.value.q).all()
    assert 0.04 <= caught.value.t <= 0.051


@pytest.mark.parametrize("method", ["IDA", "CVODE", "Radau", "DOP853"])
def test_a_mistake_of_the_input_is_not_met_by_shorter_steps(method: str, built: Build) -> None:
    """It has its own name, and ends the motion where it is made, though a ValueError of the state does not."""
    kernel, calls = built(stiff_rod(1e4, 1.0), *KERNELS), [0]

    def drive(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        if t > 0.05:
            calls[0] += 1
            raise UnknownNameError("no table of that name")
        return np.zeros(2)

    with pytest.raises(InputError, match=r"no table of that name"):
        integrate(kernel, [0.0, 0.3], [0.0, 0.0], 0.1, drive=drive, method=method)
    assert calls == [1]


def test_without_scikit_sundae_the_install_line_is_named(built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sksundae.ida", None)
    with pytest.raises(InputError, match=r'IDA needs scikit-sundae, which is not installed: .*"eomgen\[sim\]"'):
        integrate(built(stiff_rod(1e4, 1.0), *KERNELS), [0.0, 0.3], [0.0, 0.0], 0.1, method="IDA")


@pytest.mark.soak
def test_a_simulation_says_when_its_clearances_closed(tmp_path: Path) -> None:
    """In its summary and in its file, where the piece of a payload's arrival does not lose them."""
    scenario = scenario_from_toml(
        'duration = 0.3\n[motion]\ntype = "point_to_point"\n'
        '[[payloads]]\nlink = "fore"\nmass = 0.1\npoint = [0.1, 0, 0]\nt0 = 0.1\n'
    )
    result = run_scenario(eomgen.load_robot("worn_arm"), scenario)
    assert {contact.coordinate for contact in result.trajectory.contacts} <= {"shoulder.x", "shoulder.y"}
    closed = [
        contact for contact in result.trajectory.contacts if contact.closes and contact.coordinate == "shoulder.y"
    ]
    line = f"clearance of shoulder.y: closed {len(closed)} times, first at {closed[0].t:.4f} s"
    assert any(line in text for text in result.summary_lines())
    assert eomgen.load_result(result.save(tmp_path / "r.npz")).trajectory.contacts == result.trajectory.contacts
