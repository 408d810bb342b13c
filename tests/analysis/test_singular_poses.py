"""Poses of loops at which the rank of their constraint drops, and loops that are redundant in every pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eomgen.analysis import deflection, modes
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError
from eomgen.robot.value import Robot

pytestmark = pytest.mark.usefixtures("unoptimised")


def parallelogram() -> Robot:
    """Cranks of 0.5 m a metre apart and a coupler of 1 m, all on one line at q = 0; springs about there."""
    text = 'name = "parallelogram"\ngravity = [0.0, 0.0, 0.0]\n'
    for name, length in (("left", 0.5), ("coupler", 1.0), ("right", 0.5)):
        inertia = "{ xx = 0.001, yy = 0.02, zz = 0.02 }"
        text += f'[[links]]\nname = "{name}"\nmass = 1.0\ncom = [{length / 2}, 0.0, 0.0]\ninertia = {inertia}\n'
    for parent, child, x in (("base", "left", 0.0), ("left", "coupler", 0.5), ("base", "right", 1.0)):
        text += f'[[joints]]\nname = "{child}_pin"\nparent = "{parent}"\nchild = "{child}"\ntype = "revolute"\n'
        text += f"placement = {{ xyz = [{x}, 0.0, 0.0] }}\ngamma = {{ stiffness = 50.0 }}\n"
    return robot_from_toml(
        text + '[[loops]]\nname = "closing"\nlinks = ["coupler", "right"]\ntype = "revolute"\n'
        "placements = [{ xyz = [1.0, 0.0, 0.0] }, { xyz = [0.5, 0.0, 0.0] }]\n"
    )


@pytest.mark.parametrize("analysis", [modes, deflection])
def test_a_flat_parallelogram_is_refused(analysis: object) -> None:
    """It may go on as a parallelogram or as its opposite: two motions to first order, of which neither is a sum."""
    robot = parallelogram()
    free = {"held": [], **({"drives": "free"} if analysis is modes else {"drives": "pd", "kp": 10.0})}
    with pytest.raises(InputError, match=r"loop closing is singular: the rank of the constraints drops to 1, .* the 2"):
        analysis(robot, np.zeros(3), **free)  # type: ignore[operator]


def test_the_same_loop_beside_it_has_one_mode() -> None:
    """Flat loops are redundant in every pose, three of five constraints here: no reason to refuse."""
    robot = parallelogram()
    found = modes(leaning(robot), [0.6, -0.6, 0.6], held=[], drives="free")
    assert len(found.eigenvalues) == 1
    assert abs(found.eigenvalues[0]) > 1.0


def leaning(robot: Robot) -> Robot:
    """The same with springs that rest at 0.6 rad."""
    joints = [
        replace(joint, coordinates={"gamma": replace(joint.coordinates["gamma"], preload=-50.0 * rest)})
        for joint, rest in zip(robot.joints, (0.6, -0.6, 0.6), strict=True)
    ]
    return replace(robot, name="leaning", joints=tuple(joints))
