"""Sweeps of closed mechanisms: every engine finds the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eomgen.sweep import plan_from_toml, run

PLAN = """
samples = 2
seed = 5
record = ["drive_max", "coordinate_end"]
[engine]
type = "{engine}"
[[vary]]
parameter = "links.crank.mass"
normal = {{ mean = 1.0, deviation = 0.2 }}
relative = true
"""
MOTION = {"duration": 0.05, "motion": {"type": "point_to_point"}}


@pytest.mark.soak
def test_engines_agree_on_a_four_bar(tmp_path: Path) -> None:
    found = []
    for engine in ("rollout", "integrate"):
        result = run("four_bar", MOTION, plan_from_toml(PLAN.format(engine=engine)), tmp_path / engine)
        found.append(np.column_stack([result.of(name) for name in result.columns]))
    assert found[0].shape[0] == 2
    assert np.isfinite(found[0]).all()
    assert np.abs(found[0] - found[1]).max() <= 2e-2 * np.abs(found[1]).max()
