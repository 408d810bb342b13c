"""Functional mock-up units of mechanisms with closed loops, run by fmpy, against the kernel and SciPy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from scipy.integrate import solve_ivp

import eomgen
from eomgen.export.fmu.pack import export_fmu
from eomgen.integration import integrate
from eomgen.runtime.kernel import Array, Kernel
from tests.support.builds import Build
from tests.support.fmu_host import Host
from tests.support.soak import soaked
from tests.support.turning_loops import INTEGRATED, held_at, held_pendulum

KERNELS = (
    *("forward_dynamics", "constraint_forces", "constraint", "constraint_jacobian", "constrained_dynamics"),
    *("kinematics", "energy", "external_force", "settling", "rollout"),
)
VERSIONS = soaked((2, 3), (3,))
CLOSING = 0.01  # s
DRIVE = np.array([2.0, 0.0, 0.0])
RATE = 3.0  # rad/s, of the crank

Unit = Callable[..., Host]


@pytest.fixture(scope="module")
def unit(tmp_path_factory: pytest.TempPathFactory) -> Unit:
    """``unit(version, method, stepping)``: an instance of the four-bar linkage's unit, compiled once."""
    known: dict[tuple[int, str], Path] = {}

    def instance(version: int = 3, method: str = "rk4", *, stepping: bool = False) -> Host:
        if (version, method) not in known:
            folder = tmp_path_factory.mktemp("unit")
            path = export_fmu("four_bar", folder / "a.fmu", version, method=method, flags=("-O0", "-Werror"))
            fmpy.extract(str(path), str(folder / "unpacked"))
            known[version, method] = folder / "unpacked"
        return Host(known[version, method], stepping=stepping)

    return instance


@pytest.fixture(scope="module")
def kernel(built: Build) -> Kernel:
    return built(eomgen.load_robot("four_bar"), *KERNELS)


def start(kernel: Kernel) -> tuple[Array, Array]:
    """Home with the crank turning, closed."""
    robot = eomgen.load_robot("four_bar")
    q = np.array([robot.home[name] for name in kernel.coordinates])
    J = kernel.constraint_jacobian(q)[:2, :]
    v = np.array([RATE, *np.linalg.solve(J[:, 1:], -J[:, 0] * RATE)])
    return q, v


def knowns(host: Host) -> list[str]:
    return [name for kind in ("q.", "v.", "u.", "wrench.") for name in host.names(kind)]


def unknowns(host: Host) -> list[str]:
    return [name for kind in ("der(", "a.", "constraint.", "pose.", "energy.") for name in host.names(kind)]


def gap(kernel: Kernel, q: Array, v: Array) -> float:
    rates = kernel.constraint_jacobian(q) @ v
    return float(max(np.abs(kernel.constraint(q)).max(), np.abs(rates).max()))


@pytest.mark.parametrize("version", VERSIONS)
def test_the_description_says_what_is_closed_and_how(version: int, unit: Unit, kernel: Kernel) -> None:
    host = unit(version)
    folder = Path(host.unit.unzipDirectory)
    assert validate_fmu(str(folder.parent / "a.fmu")) == []
    root = ElementTree.parse(folder / "modelDescription.xml").getroot()
    assert "stabilised ordinary differential" in root.attrib["description"]
    variables = {x.name: x for x in host.description.modelVariables}
    assert [variables[f"q.{name}"].initial for name in kernel.coordinates] == ["approx"] * 3
    starts = [float(variables[f"q.{name}"].start) for name in kernel.coordinates]
    np.testing.assert_allclose(starts, start(kernel)[0], atol=1e-12)
    assert float(variables["solver.closing"].start) == CLOSING
    assert variables["constraint.joint4.x"].unit == "N"
    assert not host.names("reaction.")


@pytest.mark.parametrize("version", VERSIONS)
def test_outputs_are_the_kernels(version: int, unit: Unit, kernel: Kernel) -> None:
    host = unit(version)
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
def test_initialization_closes_near_what_is_set(version: int, unit: Unit, kernel: Kernel) -> None:
    q = start(kernel)[0]
    host = unit(version)
    names = [*host.names("q."), *host.names("v.")]
    host.start(names, [*(q + [0.1, -0.05, 0.08]), RATE, 0.0, 0.0])
    found = host.get(names)
    assert gap(kernel, found[:3], found[3:]) < 1e-12
    assert 0.0 < np.abs(found[:3] - q).max() < 0.2
    assert np.abs(found[3:]).min() > 0.1
    other = unit(version)
    with pytest.raises(FMICallException):
        other.start(other.names("q."), [0.0, 0.0, 0.0])  # stretched out, where nothing moves along the gap
    assert "joint4" in other.messages[-1]
    assert "does not close" in other.messages[-1] or "cannot be inverted" in other.messages[-1]


@pytest.mark.parametrize(("version", "method"), soaked([(2, "rk4"), (3, "rk4"), (3, "implicit")], {(3, "implicit")}))
def test_co_simulation_stays_closed_and_is_the_rollout(version: int, method: str, unit: Unit, kernel: Kernel) -> None:
    q, v = start(kernel)
    host = unit(version, method, stepping=True)
    names = [*host.names("q."), *host.names("v.")]
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
def test_stages_of_redundant_loops_are_closed(tmp_path: Path) -> None:
    """Bennett's linkage keeps its energy, and moves, in equal steps of 1 ms."""
    path = export_fmu("bennett", tmp_path / "a.fmu", 3, method="rk4", step=1e-3, flags=("-O0", "-Werror"))
    fmpy.extract(str(path), str(tmp_path / "unpacked"))
    host = Host(tmp_path / "unpacked", stepping=True).start(["v.joint1.gamma"], [2.0])
    energies = [host.get(host.names("energy."))]
    for k in range(100):
        host.step(0.02 * k, 0.02)
        energies.append(host.get(host.names("energy.")))
    kinetic = np.array(energies)[:, 0]
    assert np.ptp(kinetic) > 5.0
    assert np.ptp(np.sum(energies, axis=1)) < 1e-8 * np.ptp(kinetic)


@pytest.mark.parametrize("version", VERSIONS)
def test_model_exchange_keeps_gaps_small(version: int, unit: Unit, kernel: Kernel) -> None:
    """And gaps that are there go away: the states of an integrator that is not told of any constraint."""
    q, v = start(kernel)
    host = unit(version)
    host.start([*host.names("q."), *host.names("v."), *host.names("u.")], [*q, *v, *DRIVE])
    host.to_continuous_time()

    def rates(t: float, x: Array) -> Array:
        host.set_states(x)
        return host.rates()

    x = np.concatenate([q, v])
    found = solve_ivp(rates, (0.0, 2.0), x, method="DOP853", rtol=1e-8, atol=1e-8, max_step=0.01)
    worst = max(gap(kernel, y[:3], y[3:]) for y in found.y.T)
    wanted = kernel.rollout(q, v, DRIVE, 1e-4, 20_000)
    print(f"model exchange: gaps within {worst:.1e}")
    assert worst < 1e-6
    np.testing.assert_allclose(found.y[:, -1], np.concatenate([wanted[0][-1], wanted[1][-1]]), atol=1e-4)
    away = x + np.array([1e-3, -2e-3, 1e-3, 0.0, 0.1, 0.0])
    found = solve_ivp(rates, (0.0, 20 * CLOSING), away, method="DOP853", rtol=1e-9, atol=1e-10)
    assert gap(kernel, away[:3], away[3:]) > 1e-3
    assert gap(kernel, found.y[:3, -1], found.y[3:, -1]) < 1e-6


@pytest.mark.parametrize("version", VERSIONS)
def test_directional_derivatives_are_exact_where_loops_are_open_too(version: int, unit: Unit, kernel: Kernel) -> None:
    host, twin, rng = unit(version).start(), unit(version), np.random.default_rng(version)
    q, v = start(kernel)
    x = np.concatenate([q, v, DRIVE, rng.uniform(-1.0, 1.0, 18)])
    x[:3] += 1e-3
    names, unknown = knowns(host), unknowns(host)
    host.to_continuous_time()
    host.set_states(x[:6])
    host.set(names[6:], x[6:])

    def at(values: Array) -> Array:
        twin.set(names, values)
        return twin.get(unknown)

    for _ in range(3):
        d, h = rng.uniform(-1.0, 1.0, x.size), 1e-4
        near, far = (at(x + k * h * d) - at(x - k * h * d) for k in (1.0, 2.0))
        wanted = (8.0 * near - far) / (12.0 * h)
        np.testing.assert_allclose(host.derivative(unknown, names, d), wanted, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.soak
@pytest.mark.parametrize("method", soaked(("rk4", "implicit"), ("rk4",)))
def test_steps_turn_free_joints(method: str, tmp_path: Path, built: Build) -> None:
    """A pendulum that a cut holds swings over the poles of its free joint's angles; a wrench acts."""
    path = export_fmu(held_pendulum(), tmp_path / "a.fmu", 3, method=method, flags=("-O0", "-Werror"))
    fmpy.extract(str(path), str(tmp_path / "unpacked"))
    kernel = built(held_pendulum(), *INTEGRATED)
    q, v = held_at(np.array([0.3, 1.2, 0.1]), np.array([2.0, 3.0, 1.0]))
    names = [f"{label}.{name}" for label in "qv" for name in kernel.coordinates]
    host = Host(tmp_path / "unpacked", stepping=True).start([*names, "wrench.body.mz"], [*q, *v, 0.02])
    for step in range(20):
        host.step(0.05 * step, 0.05)
    found, wrench = np.array(host.get(names)), np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.02]])
    expected = integrate(kernel, q, v, 1.0, wrench=wrench, rtol=1e-9, output_step=0.01)
    assert np.abs(np.cos(expected.q[:, 4])).min() < 0.3
    assert np.abs(found[:6] - expected.q[-1]).max() < (1e-7 if method == "rk4" else 5e-2)
    assert np.abs(kernel.constraint(found[:6])).max() < 1e-11
