"""Tolerances of robots whose links bend: sags of the textbook, robots whose beams are made anew, samples, files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.analysis import deflection
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError
from eomgen.identification import load_tolerance, tolerance
from eomgen.identification.tolerances.solve import tolerance_quantities
from eomgen.robot.value import Robot

pytestmark = pytest.mark.usefixtures("unoptimised")

LENGTH, LOAD, GRAVITY = 1.5, 5.0, 9.81
BOOM = """
name = "boom"
gravity = [0.0, 0.0, -9.81]
[[links]]
name = "tube"
beam = { length = 1.5, E = 7e10, G = 2.63e10, density = 2700.0, section = { tube = [0.06, 0.05] }, modes = { z = 2 } }
[[links]]
name = "load"
mass = 5.0
inertia = { xx = 0.01, yy = 0.01, zz = 0.01 }
[[joints]]
name = "slew"
parent = "base"
child = "tube"
type = "revolute"
[[joints]]
name = "flange"
parent = "tube"
node = "tip"
child = "load"
type = "fixed"
[[frames]]
name = "tcp"
link = "load"
"""
E, DENSITY = "links.tube.beam.E", "links.tube.beam.density"
TABLE = {
    E: {"deviation": 0.003, "relative": True},
    DENSITY: {"deviation": 0.02, "relative": True},
    "joints.slew.offset.gamma": {"deviation": 1e-5},
}


def boom() -> Robot:
    return robot_from_toml(BOOM)


def sags(robot: Robot) -> tuple[float, float]:
    """Sag of the tip by the load and by the beam's own weight, S. P. Timoshenko, m."""
    beam = robot.links[0].beam
    assert beam is not None
    bend, shear = beam.E * beam.Iy, beam.shear[1] * beam.G * beam.A
    own = GRAVITY * beam.mass * (LENGTH**3 / (8 * bend) + LENGTH / (2 * shear))
    return GRAVITY * LOAD * (LENGTH**3 / (3 * bend) + LENGTH / shear), own


def test_sags_and_shares_are_those_of_the_textbook(tmp_path: Path) -> None:
    """The sag is in inverse proportion to E, with G, and its own part in proportion to the density."""
    robot = boom()
    beam = robot.links[0].beam
    assert beam is not None
    found = tolerance(robot, TABLE, poses=[[0.3], [0.0]])
    by_load, own = sags(robot)
    S = dict(zip(found.names, found.sensitivities[1].T, strict=True))
    assert beam.E * S[E][2] == pytest.approx(by_load + own, rel=1e-5)
    assert beam.density * S[DENSITY][2] == pytest.approx(-own, rel=1e-5)
    assert S["joints.slew.offset.gamma"][1] == pytest.approx(LENGTH, rel=1e-4)
    assert found.standard_deviations[1][2] == pytest.approx(np.hypot(0.003 * (by_load + own), 0.02 * own), rel=1e-5)
    drawn = found.sample(200, pose=1)
    assert drawn.std(axis=0)[1:3] == pytest.approx(found.standard_deviations[1][1:3], rel=0.2)
    again = load_tolerance(found.save(tmp_path / "found.json"))
    assert np.array_equal(again.sensitivities, found.sensitivities)
    assert again.names == found.names


def test_what_may_be_named() -> None:
    """Offsets, stiffness of modes, E and density, with their units; nothing else, and no loops."""
    units = tolerance_quantities(boom())
    modes = {f"links.tube.modes.{k}.stiffness": "J" for k in (1, 2)}
    offsets = {f"joints.slew.offset.{kind}": "m" if kind in "xyz" else "rad" for kind in eomgen.robot.COORDINATES}
    assert units == {**modes, **offsets, E: "N/m^2", DENSITY: "kg/m^3"}
    with pytest.raises(DescriptionError, match=r"links\.load\.mass"):
        tolerance(boom(), {"links.load.mass": {"deviation": 0.1}})
    instead = r"goes with E, so that modes keep their shapes; allowed: links\.tube\.beam\.E, or "
    with pytest.raises(DescriptionError, match=rf"links\.tube\.beam\.G: {instead}links\.tube\.modes\.1\.stiffness$"):
        tolerance(boom(), {"links.*.beam.G": {"deviation": 0.1}})
    twisted = robot_from_toml(BOOM.replace("modes = { z = 2 }", "modes = { y = 1, z = 2, torsion = 1, axial = 1 }"))
    twist = rf"{instead}'links\.tube\.modes\.4\.stiffness', in proportion to G alone"
    with pytest.raises(DescriptionError, match=twist):
        tolerance(twisted, {"links": {"tube": {"beam": {"G": {"deviation": 0.1}}}}})
    loop = """
[[loops]]
name = "bearing"
links = ["base", "load"]
type = "spherical"
x = {}
placements = [{ xyz = [1.5, 0.0, 0.0] }, {}]
"""
    with pytest.raises(InputError, match=r"links\.tube\.modes: .* known of trees, and loops\.bearing closes a loop"):
        tolerance(robot_from_toml(BOOM + loop), TABLE)


@pytest.mark.soak
def test_robots_whose_beams_are_made_anew_move_as_said() -> None:
    """E with G, and the density, a part higher: the difference of deflections of two robots that are built."""
    robot = boom()
    beam = robot.links[0].beam
    assert beam is not None
    found = tolerance(
        robot, {E: {"bound": 7e8}, DENSITY: {"bound": 27.0}, "links.tube.modes.1.stiffness": {"bound": 1.0}}
    )
    before = deflection(robot).deflection
    y = np.zeros((3, 1))
    for name, changes in (
        (E, {"links.tube.beam.E": 1.01 * beam.E, "links.tube.beam.G": 1.01 * beam.G}),
        (DENSITY, {"links.tube.beam.density": 1.01 * beam.density}),
    ):
        y[:] = 0.0
        y[found.names.index(name)] = {E: 7e8, DENSITY: 27.0}[name]
        moved = found.exact.motions(y, np.zeros(1, dtype=np.intp))[0]
        after = deflection(robot.with_values(changes)).deflection
        assert moved == pytest.approx(after - before, abs=1e-4 * np.abs(moved).max())
