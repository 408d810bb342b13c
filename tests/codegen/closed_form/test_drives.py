"""Closed forms of servo drives beside their equations on floats, and what is printed of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eomgen.codegen.closed_form.readable import readable_closed_form
from eomgen.codegen.closed_form.trace import closed_form
from eomgen.description.load import load_robot, robot_from_toml
from eomgen.robot.model import build_model
from tests.support.drive_reference import AXIS, DAMPING, DRIVES, INERTIA, drive, numbers_of

EXAMPLE = Path(__file__).parents[3] / "examples" / "servo_axis.toml"


@pytest.mark.parametrize("name", DRIVES)
def test_residuals_and_rates_are_those_of_the_equations(name: str) -> None:
    table, _ = DRIVES[name]
    model = build_model(
        robot_from_toml(f"{AXIS}gamma = {{ damping = {DAMPING}, armature = 0.02, drive = {{ {table} }} }}\n")
    )
    function, rng = closed_form(model).function("residual", "rates"), np.random.default_rng(3)
    names = [state.state.name for state in model.states]
    for size in (0.1, 1.0, 10.0):
        s, v, a, u = rng.normal(size=4)
        z = size * rng.normal(size=len(names))
        force, rates, _ = drive(numbers_of(table), s, v, dict(zip(names, z, strict=True)), size * u)
        residual, found = function([s], [v], [a], [size * u], z=z)
        assert residual == pytest.approx([INERTIA * a + DAMPING * v - force], rel=1e-12, abs=1e-12)
        assert found == pytest.approx(
            [rates.get(name, -x) for name, x in zip(names, z, strict=True)], rel=1e-9, abs=1e-9
        )


def test_inputs_and_limits_are_said() -> None:
    form = readable_closed_form(build_model(load_robot(EXAMPLE)))
    text = "\n".join(form.lines())
    assert "D_gamma_1 = reference of position of axis.gamma: rad" in text
    assert "+ 6.0*current_gamma_1" in text
    assert "Max(-3.0, Min(3.0, 15.0*(D_gamma_1 - gamma_1)))" in text
    assert "- D_gamma_1" not in text
    assert any(r"\max" in right and r"\min" in right for block in form.equations() for _, right in block)
