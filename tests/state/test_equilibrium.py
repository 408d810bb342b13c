"""Static equilibrium, and the sizes that coordinates have under springs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eomgen import ArrayError, IntegrationError, UnknownNameError
from eomgen.integration.plan import choose_method
from eomgen.robot.value import Coordinate
from eomgen.state.equilibrium import static_equilibrium
from eomgen.state.springs import coordinate_sizes, stiffnesses
from tests.support.builds import Build
from tests.support.soak import soaked
from tests.support.swinging import MASS, NEEDED, STIFFNESS, elastic_arm, oscillator


def test_sizes_of_coordinates(built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    sizes, rates = coordinate_sizes(kernel, np.zeros(1))
    assert sizes == pytest.approx(10.0 / 400.0)
    assert rates == pytest.approx(10.0 / 20.0)
    kernel.parameters["joints.slide.z.stiffness"] = 0.0
    assert [x.tolist() for x in coordinate_sizes(kernel, np.zeros(1))] == [[1.0], [1.0]]
    assert not stiffnesses(kernel).any()
    assert choose_method(kernel) == "DOP853"


def test_a_spring_under_gravity_hangs_where_it_must(built: Build) -> None:
    kernel = built(oscillator(gravity=-9.81), *NEEDED)
    q, u = static_equilibrium(kernel, [0.3])
    assert q == pytest.approx(-9.81 * MASS / STIFFNESS, rel=1e-12)
    assert u == [0.0]
    q, _ = static_equilibrium(kernel, [0.0], u=[9.81 * MASS])
    assert q == pytest.approx(0.0, abs=1e-15)
    q, u = static_equilibrium(kernel, [0.3], held=["slide.z"])
    assert q == [0.3]
    assert u == pytest.approx(STIFFNESS * 0.3 + 9.81 * MASS)


@pytest.mark.parametrize("seed", soaked(range(5, 9), (5, 8)))
def test_static_equilibrium_has_no_acceleration(seed: int, built: Build) -> None:
    kernel = built(elastic_arm(seed), *NEEDED, "residual", "external_force")
    zero = np.zeros(kernel.n)
    wrench = np.random.default_rng(seed).uniform(-2.0, 2.0, (len(kernel.links), 6))
    for held in ((), ("joint1.gamma", "joint2.gamma")):
        q, u = static_equilibrium(kernel, zero, wrench=wrench, held=held)
        assert np.abs(kernel.residual(q, zero, zero, u, wrench=wrench)).max() < 1e-11 * 400.0
        assert np.abs(kernel.forward_dynamics(q, zero, u, wrench=wrench)).max() < 1e-8
        free = [name not in held for name in kernel.coordinates]
        assert not u[free].any()
        assert np.abs(q).max() > 1e-3


def test_equilibrium_under_a_drive_that_depends_on_the_state(built: Build) -> None:
    kernel = built(elastic_arm(), *NEEDED)
    q, u = static_equilibrium(kernel, np.zeros(kernel.n), u=lambda q: 1.0 - 50.0 * q)
    assert u == pytest.approx(1.0 - 50.0 * q)
    assert np.abs(kernel.forward_dynamics(q, np.zeros(kernel.n), u)).max() < 1e-8


def test_what_nothing_holds_is_named(built: Build) -> None:
    robot = oscillator(gravity=-9.81)
    loose = replace(robot, joints=(replace(robot.joints[0], coordinates={"x": Coordinate(10.0), "z": Coordinate()}),))
    with pytest.raises(IntegrationError, match=r"nothing holds slide\.z"):
        static_equilibrium(built(loose, *NEEDED), [0.0, 0.0])
    with pytest.raises(UnknownNameError, match=r"held: 'slide\.y' is unknown"):
        static_equilibrium(built(loose, *NEEDED), [0.0, 0.0], held=["slide.y"])
    with pytest.raises(ArrayError, match="u: expected forces of shape"):
        static_equilibrium(built(loose, *NEEDED), [0.0, 0.0], u=lambda _q: np.zeros(5), held=["slide.z"])
