"""The built-in arm whose two links bend, beside its published numbers.

A. De Luca, B. Siciliano, "Closed-Form Dynamic Model of Planar Multilink Lightweight Robots", IEEE Transactions on
Systems, Man, and Cybernetics 21 (1991) 826-839.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

import eomgen
from eomgen.pictures import plot_deviations
from eomgen.scenario import scenario_from_toml

pytestmark = pytest.mark.usefixtures("unoptimised")

MODAL_MASS = 0.1  # kg, to which the paper scales its modes: that of the beam
# of each mode of a link, as printed: frequency in Hz; deflection, m, and slope, rad, at the tip; integrals of the
# deflection, and of it times the place along the beam, over the beam's mass, kg m and kg m^2
PRINTED = {
    "upper": ((0.48, 0.186, 0.657, 0.007, 0.002), (1.80, 0.215, -0.560, 0.013, 0.004)),
    "forearm": ((2.18, 0.883, 2.641, 0.033, 0.012), (15.91, -0.069, -10.853, 0.054, 0.016)),
}
ROUNDED = np.array([0.005, 0.0005, 0.0005, 0.0005, 0.0005]) * 1.001  # half of the last digit


@pytest.mark.parametrize("name", PRINTED)
def test_modes_of_each_link_are_those_of_the_paper(name: str) -> None:
    """One link bends alone, with all that it carries, at home; all digits that are printed."""
    robot = eomgen.load_robot("flexible_arm")
    kernel = eomgen.build(robot, kernels=("mass_matrix",))
    own = [i for i, coordinate in enumerate(kernel.coordinates) if coordinate.startswith(f"{name}.mode")]
    modes = next(link.modes for link in robot.links if link.name == name)
    assert {kernel.inputs[kernel.coordinates[i]] for i in own} == {("modal force", "J")}
    squares, shapes = eigh(np.array(modes.K), kernel.mass_matrix(np.array(kernel.home))[np.ix_(own, own)])
    Phi, H0 = np.array(modes.nodes[0].Phi), np.array(modes.H0)
    rows = np.stack([Phi[1], Phi[5], H0[:, 3, 1], H0[:, 0, 1]]) @ shapes * np.sqrt(MODAL_MASS)
    for k, printed in enumerate(PRINTED[name]):
        found = np.array([np.sqrt(squares[k]) / (2.0 * np.pi), *(rows[:, k] * np.sign(rows[0, k] * printed[1]))])
        assert (np.abs(found - printed) <= ROUNDED).all(), (k, found)


@pytest.mark.soak
def test_a_simulation_is_kept_and_drawn(tmp_path: Path) -> None:
    """It begins with a bent link; the result comes back, and has a panel for each link that bends."""
    scenario = scenario_from_toml('duration = 0.05\n[initial]\nq = { "upper.mode1" = 0.01, elbow = 1.0 }')
    result = eomgen.load_result(eomgen.run_scenario("flexible_arm", scenario).save(tmp_path / "result.npz"))
    start = dict(zip(result.trajectory.coordinates, result.trajectory.q[0], strict=True))
    assert start == {**dict.fromkeys(start, 0.0), "upper.mode1": 0.01, "elbow.gamma": 1.0}
    assert abs(result.trajectory.q[-1, 1]) < 0.01
    _, axes = plot_deviations(result)
    assert [x.get_title("left") for x in axes] == ["upper, 1", "forearm, 1"]
    for panel, first, count in zip(axes, (1, 4), (2, 4), strict=True):
        drawn = [np.asarray(line.get_ydata()) for line in panel.lines[:count]]
        assert np.array_equal(np.stack(drawn, axis=1), result.trajectory.q[:, first : first + count])
    with pytest.raises(eomgen.InputError, match=r"initial\.q\.upper: no coordinate of that name"):
        eomgen.run_scenario("flexible_arm", scenario_from_toml("duration = 0.05\n[initial]\nq = { upper = 0.01 }"))
