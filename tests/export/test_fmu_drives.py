"""Functional mock-up units of robots with servo drives, run by fmpy, against the kernel."""

from __future__ import annotations

from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from eomgen.description.load import load_robot
from eomgen.export.fmu.pack import export_fmu
from tests.support.builds import Build
from tests.support.fmu_host import Host

AXIS = Path(__file__).parents[2] / "examples" / "servo_axis.toml"
KERNELS = ("forward_dynamics", "external_force", "kinematics", "energy", "adaptive_rollout")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("unit")
    path = export_fmu(load_robot(AXIS), folder / "a.fmu", 3, method="rosenbrock", flags=("-O0", "-Werror"))
    assert validate_fmu(str(path)) == []
    fmpy.extract(str(path), str(folder / "unpacked"))
    return folder / "unpacked"


def test_inputs_and_states_have_their_units(folder: Path) -> None:
    host = Host(folder)
    variables = {x.name: x for x in host.description.modelVariables}
    assert variables["u.axis.gamma"].unit == "rad"
    assert variables["z.axis.gamma.drive.current"].unit == "A"
    assert variables["z.axis.gamma.drive.integral_current"].unit == "A.s"
    assert "reference of position" in variables["u.axis.gamma"].description


def test_rates_and_directional_derivatives(folder: Path, built: Build) -> None:
    """Wrenches act on the arm beside the drive."""
    host, twin, kernel, rng = Host(folder), Host(folder), built(load_robot(AXIS), *KERNELS), np.random.default_rng(2)
    z = np.array([0.02, 1e-3, 0.4])
    point = np.concatenate([[0.1], [0.2], z, [0.11], rng.uniform(-5.0, 5.0, 6)])
    names = [name for kind in ("q.", "v.", "z.", "u.", "wrench.") for name in host.names(kind)]
    unknown = [name for kind in ("a.", "der(z") for name in host.names(kind)]
    host.set(names, point)
    q, v, u = np.zeros(4), np.r_[0.2, z], np.zeros(4)
    q[0], u[0] = 0.1, 0.11
    wanted = kernel.forward_dynamics(q, v, u, wrench=point[6:].reshape(1, 6))
    np.testing.assert_allclose(host.get(unknown), wanted, rtol=1e-12)

    def at(x: np.ndarray) -> np.ndarray:
        twin.set(names, x)
        return np.asarray(twin.get(unknown))

    host.start(names, point)
    host.to_continuous_time()
    host.set_states(point[: host.states])
    host.set(names[host.states :], point[host.states :])
    h = 1e-5 * rng.uniform(-1.0, 1.0, point.size)
    np.testing.assert_allclose(host.derivative(unknown, names, h), 0.5 * (at(point + h) - at(point - h)), rtol=1e-6)


def test_co_simulation_is_the_rollout(folder: Path, built: Build) -> None:
    host, kernel = Host(folder, stepping=True), built(load_robot(AXIS), *KERNELS)
    names = [name for kind in ("q.", "v.", "z.", "u.") for name in host.names(kind)]
    begin = np.zeros(6)
    begin[5] = 0.05
    host.start(names, begin)
    host.step(0.0, 0.2)
    motion = kernel.rollout([0.0], [0.0], [0.05], duration=0.2, samples=1, method="rosenbrock", z=np.zeros(3))
    found = host.get(names[:5])
    np.testing.assert_allclose(
        found, np.concatenate([motion[0][-1], motion[1][-1], motion.z[-1]]), rtol=1e-3, atol=1e-5
    )
