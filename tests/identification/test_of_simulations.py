"""Results of simulations as measured motions: files and results are read, and what drives nothing is left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.identification import fit, forces, identify
from eomgen.motion import read_motion

pytestmark = pytest.mark.usefixtures("unoptimised")

IDLE = "drives that are 0 and drive nothing, left out: joint1.x"


@pytest.fixture(scope="module")
def simulated() -> eomgen.SimulationResult:
    return eomgen.simulate("one_link", duration=0.5)


@pytest.mark.parametrize("ending", [".npz", ".csv", ""])
def test_drives_that_drive_nothing_are_left_out(
    ending: str, simulated: eomgen.SimulationResult, tmp_path: Path
) -> None:
    motion = simulated.save(tmp_path / f"r{ending}") if ending else simulated.motion
    found = identify("one_link", motion, terms=("links",))
    assert found.notes.count(IDLE) == (ending == ".npz")  # other ways do not have them in the first place
    assert found.base_values == pytest.approx(found.described, rel=2e-3, abs=1e-4)
    drives = forces("one_link", motion).drive
    assert np.abs(drives - simulated.trajectory.u).max() < 0.02 * np.abs(simulated.trajectory.u).max()
    fitted = fit("one_link", motion)["joint1.x"]
    assert fitted.stiffness is not None
    assert fitted.stiffness.value == pytest.approx(fitted.stiffness.described, rel=0.01)


def test_a_fit_says_that_there_are_no_drives(simulated: eomgen.SimulationResult, tmp_path: Path) -> None:
    path = simulated.save(tmp_path / "r.csv")
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], *(line.rpartition(",")[0] for line in lines[1:])]) + "\n")
    assert read_motion(path, simulated.trajectory.coordinates).driven == ()
    found = fit("one_link", path)
    such = "no columns such as joint1.gamma.drive; forces that drive joint1.gamma are unknown"
    assert found.warnings[0] == f"the motion has no drives: {such}"
    assert "has no drives" not in "".join(fit("one_link", simulated.motion).warnings)
