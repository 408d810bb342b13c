"""Closed forms of robots whose laws have states: forces and rates by z, against compiled kernels."""

from __future__ import annotations

import numpy as np
import pytest

from eomgen.codegen.closed_form.readable import readable_closed_form
from eomgen.codegen.closed_form.trace import closed_form
from eomgen.description.load import robot_from_toml
from eomgen.robot.model import build_model
from tests.support.bristled import bristled_arm
from tests.support.builds import Build

pytestmark = pytest.mark.usefixtures("unoptimised")


def test_they_are_the_kernels(built: Build) -> None:
    robot = bristled_arm()
    form, kernel = closed_form(build_model(robot)), built(robot)
    assert list(map(str, form.z)) == ["z_gamma_1", "z_beta_2"]
    function = form.function("residual", "rates", "kinetic", "potential", "mass_matrix")
    rng = np.random.default_rng(3)
    for _ in range(5):
        q, v, a, u = (0.3 * rng.normal(size=4) for _ in range(4))
        z = 1e-4 * rng.normal(size=2)
        residual, rates, kinetic, potential, M = function(q, v, a, u, z=z)
        assert residual == pytest.approx(kernel.residual(q, v, a, u, z=z), rel=1e-9, abs=1e-9)
        assert rates == pytest.approx(kernel.memory_rates(q, v, z, u), rel=1e-9, abs=1e-12)
        assert (kinetic, potential) == pytest.approx(tuple(kernel.energy(q, v, z=z)), rel=1e-9)
        assert pytest.approx(kernel.mass_matrix(q), rel=1e-9, abs=1e-12) == M


def test_they_are_printed_by_name() -> None:
    form = readable_closed_form(build_model(bristled_arm()))
    lines = form.lines()
    assert "  z_gamma_1 = j1.gamma.friction.z: rad" in lines
    assert lines[-3] == "rates of states of laws"
    assert lines[-1] == "  d/dt z_beta_2 = betadot_2 - 20000.0*z_beta_2*Abs(betadot_2)"
    assert len(form.equations()) == 3
    latex = form.latex()
    assert "% $z_{2}^{\\beta}$ = j2.beta.friction.z: rad" in latex
    assert r"\dot{z_{2}^{\beta}} &= \dot{\beta}_{2} - 20000.0 z_{2}^{\beta} \left|{\dot{\beta}_{2}}\right|" in latex


WOUND = """
name = "wound"
gravity = [0.0, -9.81, 0.0]
[[links]]
name = "arm"
mass = 1.0
com = [0.2, 0.0, 0.0]
inertia = { xx = 0.01, yy = 0.02, zz = 0.02 }
[[joints]]
name = "elbow"
type = "revolute"
parent = "base"
child = "arm"
gamma = { stiffness = 3.0, stops = { stiffness = 50.0, damping = 2.0, lower = -0.1 } }
[joints.motor]
inertia = 1e-2
ratio = 5.0
stiffness = 200.0
damping = 0.1
hysteresis = { stiffness = 300.0, beta = 2.0, gamma = -1.0, n = 1.5, share = 0.4 }
maxwell = [{ stiffness = 100.0, damping = 2.0 }]
"""


def test_each_symbol_is_one_number(built: Build) -> None:
    """Those of laws beside the spring stay numbers, and do not take its symbols."""
    model = build_model(robot_from_toml(WOUND))
    readable, form = readable_closed_form(model), closed_form(model)
    assert list(map(str, form.z)) == ["z_motor_1", "z0_motor_1"]
    symbols = [line.split(" = ")[0].strip() for line in readable.lines() if " = joints." in line]
    assert len(symbols) == len(set(symbols)) == 5
    kernel, rng = built(model.robot), np.random.default_rng(4)
    function = form.function("residual", "rates")
    for _ in range(5):
        q, v, a, u = rng.normal(size=(4, 2))
        z = rng.normal(size=2)
        residual, rates = function(q, v, a, u, z=z)
        assert residual == pytest.approx(kernel.residual(q, v, a, u, z=z), rel=1e-9)
        assert rates == pytest.approx(kernel.memory_rates(q, v, z, u), rel=1e-9)
