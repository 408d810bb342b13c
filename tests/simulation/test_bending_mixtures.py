"""Simulations of robots whose links bend, with laws, motors, springs, bushings and followers: balances and files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.scenario import scenario_from_toml
from tests.support.bending_mixtures import mixture
from tests.support.random_robots import seeds

pytestmark = [pytest.mark.usefixtures("unoptimised"), pytest.mark.soak]

SCENARIO = """
duration = 0.05
[control]
type = "none"
[integrator]
method = "{}"
rtol = 1e-7
"""
FREE = ("laws", "motors", "offsets", "followers", "springs", "bushings")  # a motion that nobody has to describe


@pytest.mark.parametrize("seed", seeds(900, 0, 24, 4))
def test_energies_balance_and_results_are_read_again(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    robot = mixture(seed, tuple(x for x in FREE if rng.random() < 0.5)).robot
    method = ("rosenbrock", "tsit5", "radau")[seed % 3]
    found = eomgen.run_scenario(robot, scenario_from_toml(SCENARIO.format(method)))
    assert found.balance is not None
    assert found.balance.relative_residue < 1e-5
    again = eomgen.load_result(found.save(tmp_path / "result.npz"))
    assert np.array_equal(again.trajectory.q, found.trajectory.q)  # type: ignore[attr-defined]
    assert np.array_equal(again.trajectory.v, found.trajectory.v)  # type: ignore[attr-defined]
