"""Derivatives of tsit5's steps on stiff robots: those of the motion, or refused; of other robots never refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError
from eomgen.robot.value import Coordinate, Friction, Joint, Link, Robot
from tests.support.builds import Build
from tests.support.random_robots import Array, random_robot, random_state
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

NAMES = ("forward_dynamics", "forward_dynamics_parameter_adjoint", "adaptive_rollout")
BACK = ("explicit_gradient", "rosenbrock_gradient", "explicit_sensitivity", "rosenbrock_sensitivity")
REFUSED = r"tsit5: \d+ of \d+ steps are near the limit of its stability.*take rosenbrock"


def slider(**forces: Any) -> Robot:
    """A mass of 2 kg on a rail, no gravity."""
    link = Link("block", 2.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    joint = Joint("rail", "base", "block", "prismatic", coordinates={"z": Coordinate(**forces)})
    return Robot("stiff_slider", (0.0, 0.0, 0.0), (link,), (joint,))


def last(t: Array, q: Array, v: Array) -> tuple[float, Array, Array]:
    """The last coordinates, with their derivatives."""
    dq = np.zeros_like(q)
    dq[..., -1, :] = 1.0
    return float(q[..., -1, :].sum()), dq, np.zeros_like(v)


@pytest.fixture(scope="module")
def block(built: Build) -> eomgen.Kernel:
    return built(slider(friction=Friction(coulomb=6.0)), *NAMES, *BACK)


@pytest.mark.parametrize(("speed", "force"), [(0.0, 0.0), (0.0, 3.0), (1e-4, 3.0)])
def test_a_mass_that_friction_holds_is_refused(speed: float, force: float, block: eomgen.Kernel) -> None:
    """Alone, as one of many, and carried forwards; rosenbrock takes it."""
    how: dict[str, Any] = {"duration": 1e-4, "samples": 1}
    with pytest.raises(InputError, match=f"rollout_gradient: {REFUSED}"):
        block.rollout_gradient([0.0], [speed], [force], loss=last, method="tsit5", **how)
    with pytest.raises(InputError, match=f"rollout_gradient: {REFUSED}"):
        block.rollout_gradient([[0.0], [0.0]], [[1.0], [speed]], [force], loss=last, method="tsit5", **how)
    with pytest.raises(InputError, match=f"rollout_sensitivity: {REFUSED}"):
        block.rollout_sensitivity([0.0], [speed], [force], method="tsit5", along={"v": np.eye(1)}, **how)
    _, by = block.rollout_gradient([0.0], [speed], [force], loss=last, method="rosenbrock", **how)
    assert abs(by["v"][0]) < 1e-4


def test_a_mass_that_slides_is_not(block: eomgen.Kernel) -> None:
    value, by = block.rollout_gradient([0.0], [1.0], [3.0], loss=last, method="tsit5", duration=0.1, samples=3)
    assert value == pytest.approx(0.1 - 1.5 * 0.01 / 2, rel=1e-6)
    assert by["q"] == pytest.approx([1.0])
    assert by["v"] == pytest.approx([0.1])


@pytest.mark.parametrize("dtype", soaked(("float64", "float32"), ("float64",)))
def test_refused_or_those_of_the_motion(dtype: str, built: Build) -> None:
    """A damped oscillator of any stiffness, against the exponential of its matrix."""
    kernel = built(slider(stiffness=1.0, damping=1.0), *NAMES, *BACK, dtype=dtype)
    rng, near, refused = np.random.default_rng(5), 0, list[str]()
    rtol = 1e-6 if dtype == "float64" else 1e-4
    for _ in range(60):
        k, c = (float(10.0 ** rng.uniform(0, top)) for top in (8.0, 6.0))
        kernel.parameters["joints.rail.z.stiffness"], kernel.parameters["joints.rail.z.damping"] = k, c
        T = min(0.3, 3000.0 / (c + np.sqrt(k)))
        flow = expm(T * np.array([[0.0, 1.0], [-k / 2.0, -c / 2.0]]))
        start = (rng.uniform(-1.0, 1.0, 2) * [1.0, np.sqrt(k)] * (rng.random() < 0.7)).astype(dtype)
        how: dict[str, Any] = {"method": "tsit5", "duration": T, "samples": 2, "rtol": rtol}
        try:
            _, by = kernel.rollout_gradient(start[:1], start[1:], loss=last, **how)
            _, (dq, dv) = kernel.rollout_sensitivity(start[:1], start[1:], along={"v": np.eye(1, dtype=dtype)}, **how)
        except InputError as error:
            refused.append(str(error))
            continue
        wanted = np.array([flow[0, 0], flow[0, 1], flow[0, 1], flow[1, 1]])
        found = np.array([by["q"][0], by["v"][0], dq[-1, 0, 0], dv[-1, 0, 0]])
        sizes = np.array([1.0, 1.0 / np.sqrt(k), 1.0 / np.sqrt(k), 1.0])
        near += int(k > 1e4)
        assert np.abs((found - wanted) / sizes).max() < 0.1, (k, c, T, found, wanted)
    assert all("near the limit of its stability" in text for text in refused)
    assert 5 <= len(refused) <= 30
    assert near > 5


@pytest.mark.soak
def test_a_motion_that_is_sensitive_by_itself_is_not(built: Build) -> None:
    """A double pendulum whose derivatives grow a thousandfold, at loose and at tight tolerances."""
    text = "".join(
        f'[[links]]\nname = "l{i}"\nmass = 1.0\ncom = [0.5, 0.0, 0.0]\ninertia = {{ xx = 0.01, yy = 0.1, zz = 0.1 }}\n'
        f'[[joints]]\nname = "j{i}"\nparent = "{"base" if i == 1 else "l1"}"\nchild = "l{i}"\ntype = "revolute"\n'
        f"placement = {{ xyz = [{float(i - 1)}, 0.0, 0.0] }}\n"
        for i in (1, 2)
    )
    kernel = built(robot_from_toml(f'name = "double"\ngravity = [0.0, -9.81, 0.0]\n{text}'), *NAMES, *BACK)
    for rtol in (1e-3, 1e-6, 1e-9):
        how: dict[str, Any] = {"method": "tsit5", "duration": 12.0, "samples": 3, "rtol": rtol}
        _, by = kernel.rollout_gradient([2.5, 0.4], [0.0, 0.0], loss=last, **how)
        assert np.abs(by["q"]).max() > 1e3
        kernel.rollout_sensitivity([2.5, 0.4], [0.0, 0.0], along={"q": np.eye(2)}, **how)


def test_contacts_are_not(built: Build) -> None:
    """A mass that bounces between stops: steps across a contact look stiff, and derivatives are those of the motion."""
    numbers = {"stiffness": 1e5, "smoothing": 1e-3, "lower": -0.05, "upper": 0.05}
    kernel = built(slider(further={f"stops.{name}": x for name, x in numbers.items()}), *NAMES, *BACK)
    how: dict[str, Any] = {"method": "tsit5", "duration": 0.5, "samples": 5, "rtol": 1e-9}
    _, by = kernel.rollout_gradient([0.0], [1.0], loss=last, **how)
    h = 1e-6
    ends = [kernel.rollout([0.0], [1.0 + x], method="tsit5", duration=0.5, rtol=1e-12)[0][-1, 0] for x in (h, -h)]
    assert by["v"][0] == pytest.approx((ends[0] - ends[1]) / (2.0 * h), rel=0.05)


def test_long_motions_are_looked_at_part_by_part(monkeypatch: pytest.MonkeyPatch, block: eomgen.Kernel) -> None:
    """Of steps that are not all kept."""
    monkeypatch.setattr("eomgen.runtime.stepping.gradients.KEPT", 100)
    with pytest.raises(InputError, match=REFUSED):
        block.rollout_gradient([0.0], [0.0], [3.0], loss=last, method="tsit5", duration=1e-4, samples=1)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(920, 936))
def test_random_robots_of_any_stiffness(seed: int, built: Build) -> None:
    """Moving and at rest: refused, or as rosenbrock has them."""
    rng = np.random.default_rng(seed)
    robot = random_robot(seed, joints=(1, 2), types=("revolute", "prismatic", "fixed"), max_coordinates=3)
    robot = robot.with_coordinates({joint.name: stiffened(rng, joint.coordinates) for joint in robot.joints})
    kernel, state = built(robot, *NAMES, *BACK), random_state(robot, seed)
    for q, v in ((1e-2 * state.q, 1e-2 * state.v), np.zeros((2, kernel.n))):
        how: dict[str, Any] = {"loss": last, "duration": 1e-3, "samples": 1}
        _, wanted = kernel.rollout_gradient(q, v, method="rosenbrock", rtol=1e-8, **how)
        try:
            _, found = kernel.rollout_gradient(q, v, method="tsit5", **how)
        except InputError as error:
            assert "take rosenbrock" in str(error)  # noqa: PT017
            continue
        np.testing.assert_allclose(found["q"], wanted["q"], atol=0.05 * np.abs(wanted["q"]).max())
        np.testing.assert_allclose(found["v"], wanted["v"], atol=0.05 * np.abs(wanted["v"]).max() + 1e-6)


def stiffened(rng: np.random.Generator, table: Mapping[str, Coordinate]) -> dict[str, Coordinate]:
    """Coordinates with springs and dampers up to a million times as stiff."""
    found = {}
    for name, given in table.items():
        k, c = (10.0 ** rng.uniform(0.0, top) for top in (6.0, 5.0))
        stiffness = None if given.stiffness is None else given.stiffness * k
        found[name] = replace(given, stiffness=stiffness, damping=None if given.damping is None else given.damping * c)
    return found
