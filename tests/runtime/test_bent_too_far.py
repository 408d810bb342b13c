"""Links that bend farther than modes of second order reach: by how much, and what is said where that happens."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.analysis import linearize
from eomgen.errors import SingularError
from eomgen.pipeline.costs import RobotInfo
from eomgen.robot.model import build_model
from eomgen.robot.value import Link, Robot, deflection_range
from eomgen.runtime.singular import bent_too_far
from tests.support.bending_mixtures import answer
from tests.support.bending_robots import bent
from tests.support.builds import Build
from tests.support.random_robots import random_robot, seeds
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")


def free_link(seed: int, *, second: bool = True) -> tuple[Robot, Link]:
    """Draw a link in space that bends by up to three modes, with nothing on it."""
    robot = random_robot(seed, (1, 1), types=("free",), armature=False, forces=False, rods=False, name="free_link")
    robot = replace(robot, links=robot.links[:1], joints=robot.joints[:1], frames=())
    (link,) = bent(robot, seed, (1, 2, 3), second=second).plain.links
    assert link.modes is not None
    link = replace(link, modes=replace(link.modes, nodes=()))
    return replace(robot, links=(link,)), link


def beyond(robot: Robot, link: Link) -> np.ndarray:
    """Return a state of a free link, (n,), in which its first mode is just beyond its range."""
    model = build_model(robot)
    q = np.zeros(model.size)
    for sign in (1.0, -1.0):
        q[model.coordinates.index(f"{link.name}.mode1")] = 1.01 * sign * deflection_range(link)[0]
        if np.linalg.eigvalsh(answer(robot, "mass_matrix", q=q).reshape(model.size, -1))[0] < 0.0:
            return q
    raise AssertionError(q)


@pytest.mark.parametrize("seed", seeds(0, 3, 40))
def test_ranges_end_where_the_mass_matrix_is_singular(seed: int) -> None:
    """Of a free link, which moves in all ways: a hair before it is positive for both signs, a hair behind for one."""
    robot, link = free_link(seed)
    model, ends = build_model(robot), deflection_range(link)
    assert any(map(math.isfinite, ends))
    for k, end in enumerate(ends):
        amplitudes = [end * x for x in (0.3, 0.999, 1.001)] if math.isfinite(end) else [1.0, 10.0, 100.0]
        least = []
        for amplitude in amplitudes:
            q = np.zeros((2, model.size))
            q[:, model.coordinates.index(f"{link.name}.mode{k + 1}")] = amplitude, -amplitude
            M = [answer(robot, "mass_matrix", q=x).reshape(model.size, -1) for x in q]
            least.append(min(float(np.linalg.eigvalsh(x)[0]) for x in M))
        assert [x > 0.0 for x in least] == [True, True, not math.isfinite(end)]


def test_linear_modes_reach_any_deflection() -> None:
    """Theirs is the energy of particles; a rigid link has no mode."""
    _, link = free_link(0, second=False)
    assert link.modes is not None
    assert set(deflection_range(link)) == {math.inf}
    assert deflection_range(replace(link, modes=None)) == ()


def test_info_has_the_range() -> None:
    info = RobotInfo(build_model(eomgen.load_robot("flexible_arm")), {}, (), {}, {})
    (line,) = (line for line in info.lines() if "modes of upper" in line)
    assert line.startswith("  modes of upper, each by itself, have positive inertia up to 0.0752, 0.0185 (")
    ends = info.as_dict()["bending"]["upper"]["deflection_range"]
    assert ends == pytest.approx([0.0752, 0.0185], rel=5e-3)


def test_a_state_beyond_it_names_link_and_modes(built: Build) -> None:
    """Alone, in a batch and in a rollout; behind a joint that feels it."""
    robot, link = free_link(3)
    kernel, q = built(robot, "mass_matrix", "forward_dynamics", "rollout"), beyond(robot, link)
    zero, place = np.zeros(kernel.n), kernel.coordinates.index(f"{link.name}.mode1")
    said = rf": link {link.name} bends farther than modes of second order reach \({link.name}\.mode1"
    shown = rf" = {q[place]:.4g}, {link.name}\.mode2 = 0"
    refused(SingularError, "cannot be inverted" + said + shown, kernel.forward_dynamics, q, zero, zero)
    refused(SingularError, "inverted in state 1" + said + shown, kernel.forward_dynamics, [zero, q], zero, zero)
    refused(SingularError, "inverted in step 0" + said + shown, kernel.rollout, q, zero, dt=1e-4, steps=2)
    assert np.isfinite(kernel.forward_dynamics(0.5 * q, zero, zero)).all()


def test_only_what_is_the_cause_is_named() -> None:
    """Of two links the one that bends too far, both where each does; nothing of a matrix that is regular or empty."""
    names = ("a.gamma", "a.mode1", "b.gamma", "b.mode1")

    def mass(q: np.ndarray) -> np.ndarray:
        return np.diag([1.0 - q[1] ** 2, 1.0, 1.0 - q[3] ** 2, 1.0])

    q = np.array([0.0, 2.0, 0.0, 0.1])
    said = bent_too_far(mass, q, names, 1e-11)
    assert said is not None
    assert said.startswith("link a bends farther than modes of second order reach (a.mode1 = 2); allowed: ")
    said = bent_too_far(mass, np.array([0.0, 2.0, 0.0, 3.0]), names, 1e-11)
    assert said is not None
    assert said.startswith("links a and b bend farther than modes of second order reach (a.mode1 = 2, b.mode1 = 3)")
    assert bent_too_far(mass, 0.1 * q, names, 1e-11) is None
    assert bent_too_far(lambda q: -np.eye(4), q, names, 1e-11) is None
    assert bent_too_far(lambda q: None, q, names, 1e-11) is None
    assert bent_too_far(mass, q, ("a.gamma", "a.x", "b.gamma", "b.x"), 1e-11) is None


@pytest.mark.soak
def test_a_linear_system_about_it_says_the_same() -> None:
    """About a motion that passes there."""
    robot, link = free_link(3)
    q = beyond(robot, link)
    with pytest.raises(SingularError, match=rf"inverted: link {link.name} bends farther than modes of second order"):
        linearize(robot, q, v=0.0 * q, a=0.0 * q)
