"""Functional mock-up units of mechanisms with closed loops, run by fmpy, against the kernel and SciPy."""

from __future__ import annotations

from collections.abc import Callable
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eomgen
from eomgen.kernel.complete import Kernel
from eomgen.runtime.raw import Array
from tests.support.builds import Build
from tests.support.fmu_units import (
    VERSIONS,
    Export,
    Unit,
    check_derivatives,
    exchanged,
    fmpy,
    knowns,
    states,
)
from tests.support.soak import soaked

KERNELS = (
    *("forward_dynamics", "constraint_forces", "constraint", "constraint_jacobian", "constrained_dynamics"),
    *("kinematics", "energy", "external_force", "settling", "rollout"),
)
CLOSING = 0.01  # s
DRIVE = np.array([2.0, 0.0, 0.0])
RATE = 3.0  # rad/s, of the crank
Linkage = Callable[..., Unit]


@pytest.fixture
def linkage(exported: Export) -> Linkage:
    """``linkage(version, method)``: the four-bar's unit."""
    return lambda version=3, method="rk4": exported(eomgen.load_robot("four_bar"), version, method=method)


@pytest.fixture(scope="module")
def kernel(built: Build) -> Kernel:
    return built(eomgen.load_robot("four_bar"), *KERNELS)


def start(kernel: Kernel) -> tuple[Array, Array]:
    """Home with the crank turning, closed."""
    robot = eomgen.load_robot("four_bar")
    q = np.array([robot.home[name] for name in kernel.coordinates])
    J = kernel.functions.constraint_jacobian(q)[:2, :]
    v = np.array([RATE, *np.linalg.solve(J[:, 1:], -J[:, 0] * RATE)])
    return q, v


def gap(kernel: Kernel, q: Array, v: Array) -> float:
    rates = kernel.functions.constraint_jacobian(q) @ v
    return float(max(np.abs(kernel.functions.constraint(q)).max(), np.abs(rates).max()))


@pytest.mark.parametrize("version", VERSIONS)
def test_the_description_says_what_is_closed_and_how(version: int, linkage: Linkage, kernel: Kernel) -> None:
    unit = linkage(version)
    host = unit.host()
    assert fmpy.validation.validate_fmu(str(unit.path)) == []
    root = ElementTree.parse(unit.folder / "modelDescription.xml").getroot()
    assert "stabilised ordinary differential" in root.attrib["description"]
    variables = {x.name: x for x in host.description.modelVariables}
    assert [variables[f"q.{name}"].initial for name in kernel.coordinates] == ["approx"] * 3
    starts = [float(variables[f"q.{name}"].start) for name in kernel.coordinates]
    np.testing.assert_allclose(starts, start(kernel)[0], atol=1e-12)
    assert float(variables["solver.closing"].start) == CLOSING
    assert variables["constraint.joint4.x"].unit == "N"
    assert not host.names("reaction.")


@pytest.mark.parametrize("version", VERSIONS)
def test_outputs_are_the_kernels(version: int, linkage: Linkage, kernel: Kernel) -> None:
    host = linkage(version).host()
    q, v = start(kernel)
    u, wrench = np.array([1.0, -0.5, 0.3]), np.random.default_rng(1).uniform(-5.0, 5.0, (3, 6))
    host.set(knowns(host), np.concatenate([q, v, u, wrench.ravel()]))
    a = kernel.forward_dynamics(q, v, u, wrench=wrench)
    pose = kernel.frame_pose(q, "tcp")
    np.testing.assert_allclose(host.get(host.names("a.")), a, rtol=1e-11)
    forces = kernel.constraint_forces(q, v, u, wrench=wrench)
    np.testing.assert_allclose(host.get(host.names("constraint.")), forces, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(host.get([f"pose.tcp.{x}" for x in "xyz"]), pose[:3, 3], atol=1e-14)
    np.testing.assert_allclose(host.get(host.names("energy.")), kernel.energy(q, v), rtol=1e-12)


@pytest.mark.parametrize("version", VERSIONS)
def test_initialization_closes_near_what_is_set(version: int, linkage: Linkage, kernel: Kernel) -> None:
    q = start(kernel)[0]
    host = linkage(version).host()
    names = states(host)
    host.start(names, [*(q + [0.1, -0.05, 0.08]), RATE, 0.0, 0.0])
    found = host.get(names)
    assert gap(kernel, found[:3], found[3:]) < 1e-12
    assert 0.0 < np.abs(found[:3] - q).max() < 0.2
    assert np.abs(found[3:]).min() > 0.1
    other = linkage(version).host()
    with pytest.raises(fmpy.fmi1.FMICallException):
        other.start(other.names("q."), [0.0, 0.0, 0.0])  # stretched out, where nothing moves along the gap
    assert "joint4" in other.messages[-1]
    assert "does not close" in other.messages[-1] or "cannot be inverted" in other.messages[-1]


@pytest.mark.parametrize(("version", "method"), soaked([(2, "rk4"), (3, "rk4"), (3, "implicit")], {(3, "implicit")}))
def test_co_simulation_stays_closed_and_is_the_rollout(
    version: int, method: str, linkage: Linkage, kernel: Kernel
) -> None:
    q, v = start(kernel)
    host = linkage(version, method).host(stepping=True)
    names = states(host)
    host.start([*names, *host.names("u."), "solver.step"], [*q, *v, *DRIVE, 1e-3])
    worst, steps = 0.0, 100
    for k in range(steps):
        host.step(k * 0.02, 0.02)
        found = host.get(names)
        worst = max(worst, gap(kernel, found[:3], found[3:]))
    wanted = kernel.rollout(q, v, DRIVE, 1e-3, 20 * steps, method=method)
    print(f"co-simulation, {method}: gaps within {worst:.1e}")
    assert worst < 1e-9
    assert np.abs(found[:3] - q).max() > 1.0
    np.testing.assert_allclose(found, np.concatenate([wanted[0][-1], wanted[1][-1]]), rtol=1e-9, atol=1e-9)


@pytest.mark.soak
def test_stages_of_redundant_loops_are_closed(exported: Export) -> None:
    """Bennett's linkage keeps its energy, and moves, in equal steps of 1 ms."""
    unit = exported(eomgen.load_robot("bennett"))
    host = unit.host(stepping=True).start(["v.joint1.gamma"], [2.0])
    energies = [host.get(host.names("energy."))]
    for k in range(100):
        host.step(0.02 * k, 0.02)
        energies.append(host.get(host.names("energy.")))
    kinetic = np.array(energies)[:, 0]
    assert np.ptp(kinetic) > 5.0
    assert np.ptp(np.sum(energies, axis=1)) < 1e-8 * np.ptp(kinetic)


@pytest.mark.parametrize("version", VERSIONS)
def test_model_exchange_keeps_gaps_small(version: int, linkage: Linkage, kernel: Kernel) -> None:
    """And gaps that are there go away: the states of an integrator that is not told of any constraint."""
    q, v = start(kernel)
    x, unit = np.concatenate([q, v]), linkage(version)
    found = exchanged(unit, x, DRIVE, 2.0, rtol=1e-8, atol=1e-8, max_step=0.01)
    worst = max(gap(kernel, y[:3], y[3:]) for y in found.T)
    wanted = kernel.rollout(q, v, DRIVE, 1e-4, 20_000)
    print(f"model exchange: gaps within {worst:.1e}")
    assert worst < 1e-6
    np.testing.assert_allclose(found[:, -1], np.concatenate([wanted[0][-1], wanted[1][-1]]), atol=1e-4)
    away = x + np.array([1e-3, -2e-3, 1e-3, 0.0, 0.1, 0.0])
    host = unit.host().start()
    host.to_continuous_time()
    host.set(host.names("u."), DRIVE)

    def rates(t: float, x: Array) -> Array:
        host.set_states(x)
        return host.rates()

    found = solve_ivp(rates, (0.0, 20 * CLOSING), away, method="DOP853", rtol=1e-9, atol=1e-10).y[:, -1]
    assert gap(kernel, away[:3], away[3:]) > 1e-3
    assert gap(kernel, found[:3], found[3:]) < 1e-6


@pytest.mark.parametrize("version", VERSIONS)
def test_directional_derivatives_are_exact_where_loops_are_open_too(
    version: int, linkage: Linkage, kernel: Kernel
) -> None:
    q, v = start(kernel)
    x = np.concatenate([q + 1e-3, v, DRIVE, np.random.default_rng(version).uniform(-1.0, 1.0, 18)])
    check_derivatives(linkage(version), x, 1e-4, version)
