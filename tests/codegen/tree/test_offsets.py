"""Constant offsets of joints: against Pinocchio with the same constants, as parameters, and their sensitivities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.analysis.sensitivity import offset_sensitivity
from eomgen.bench.beside import bench
from eomgen.codegen.closed_form.trace import closed_form
from eomgen.codegen.joint.zeros import zero_map
from eomgen.description.load import robot_from_toml
from eomgen.errors import ArrayError, DescriptionError, InputError, UnknownNameError
from eomgen.robot.model import build_model
from eomgen.robot.value import ANGULAR, COORDINATES, Robot
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.closeness import distance
from tests.support.joint_table import joint_table, link_table
from tests.support.random_robots import random_robot, random_state, seeds, with_offsets

TYPES = ("revolute", "prismatic", "fixed", "free")
KERNELS = (
    "inverse_dynamics",
    "mass_matrix",
    "coriolis_matrix",
    "christoffel",
    "kinematics",
    "forward_dynamics",
    "residual_jacobian",
)


@pytest.mark.parametrize("seed", seeds(1200, 1, 16))
def test_random_robots_are_pinocchios(seed: int, built: Build) -> None:
    """Offsets in all coordinates, active or not, in front of, between and behind those that move; welds as well."""
    robot = with_offsets(random_robot(seed, joints=(2, 4), tree=seed % 2 == 0, types=TYPES), seed)
    kernel, oracle, s = built(robot, *KERNELS), PinocchioOracle(robot), random_state(robot, seed)
    assert distance(kernel.inverse_dynamics(s.q, s.v, s.a), oracle.inverse_dynamics(s.q, s.v, s.a)) < 1e-11
    assert distance(kernel.mass_matrix(s.q), oracle.mass_matrix(s.q)) < 1e-11
    C, size = kernel.coriolis_matrix(s.q, s.v), np.abs(kernel.mass_matrix(s.q)).max()
    assert np.abs(C - oracle.coriolis_matrix(s.q, s.v)).max() < 1e-11 * size
    assert np.abs(np.einsum("svw,w->sv", kernel.christoffel(s.q), s.v) - C).max() < 1e-11 * size
    for frame in kernel.frames:
        assert distance(kernel.frame_pose(s.q, frame), oracle.frame_pose(s.q, frame)) < 1e-12
    assert distance(kernel.frame_jacobian(s.q, "tcp"), oracle.frame_jacobian(s.q, "tcp")) < 1e-11
    condition = float(np.linalg.cond(oracle.mass_matrix(s.q)))
    if condition < 1e10:  # no rod at a tip
        a = kernel.forward_dynamics(s.q, s.v, s.u)
        assert distance(a, oracle.forward_dynamics(s.q, s.v, s.u)) < max(1e-11, 100 * condition * np.finfo(float).eps)
    by_q, _, _ = kernel.residual_jacobian(s.q, s.v, s.a)
    step = 1e-6
    change = step * np.random.default_rng(seed).standard_normal(kernel.n)
    slope = kernel.inverse_dynamics(s.q + change, s.v, s.a) - kernel.inverse_dynamics(s.q - change, s.v, s.a)
    assert distance(by_q @ change, slope / 2) < 1e-7


@pytest.mark.parametrize("seed", seeds(1220, 1, 4))
def test_offsets_are_parameters(seed: int, built: Build) -> None:
    """One kernel with its offsets changed equals the kernel of another description."""
    plain = random_robot(seed, joints=(2, 3), types=TYPES)
    one, two = with_offsets(plain, seed), with_offsets(plain, seed)
    values = {f"joints.{j.name}.offset.{c}": x for j in two.joints for c, x in zip(COORDINATES, j.offset, strict=True)}
    values = {name: 1.5 * x - 0.1 for name, x in values.items() if x is not None}
    joints = tuple(replace(j, offset=tuple(None if x is None else 1.5 * x - 0.1 for x in j.offset)) for j in two.joints)
    kernel, other = built(one, "inverse_dynamics"), built(replace(two, joints=joints), "inverse_dynamics")
    assert set(values) == {name for name in kernel.parameters if ".offset." in name}
    for name, value in values.items():
        kernel.parameters[name] = value
    s = random_state(plain, seed)
    assert distance(kernel.inverse_dynamics(s.q, s.v, s.a), other.inverse_dynamics(s.q, s.v, s.a)) < 1e-12


def test_an_offset_that_is_tunable_begins_at_zero(built: Build) -> None:
    plain = random_robot(1230, joints=(2, 2), types=("revolute",), rigid=True)
    name = "joints.joint1.offset.alpha"
    kernel, reference = built(replace(plain, tunable=(name,)), "inverse_dynamics"), built(plain, "inverse_dynamics")
    s = random_state(plain, 1)
    assert kernel.parameters[name] == 0.0
    assert distance(kernel.inverse_dynamics(s.q, s.v, s.a), reference.inverse_dynamics(s.q, s.v, s.a)) < 1e-13
    kernel.parameters[name] = 0.2
    assert distance(kernel.inverse_dynamics(s.q, s.v, s.a), reference.inverse_dynamics(s.q, s.v, s.a)) > 1e-3


@pytest.mark.parametrize("seed", seeds(1232, 0, 3))
def test_closed_form_and_textbook_know_offsets(seed: int, built: Build) -> None:
    """Of translations and active angles; another one is refused, not forgotten."""
    robot = with_offsets(random_robot(seed, joints=(2, 2), max_size=4), seed, active_angles=True)
    s = random_state(robot, seed)
    form = closed_form(build_model(robot))
    values = dict(zip(form.q, s.q, strict=True))
    M = np.array(form.mass_matrix.subs(values).evalf(30), dtype=float)
    assert distance(built(robot, "mass_matrix").mass_matrix(s.q), M) < 1e-11
    assert bench(robot, repeat=1, kernels=("inverse_dynamics", "mass_matrix", "forward_dynamics")).error < 1e-9
    joint = next(j for j in robot.joints if j.coordinates)
    locked = next((i for i, c in enumerate(COORDINATES) if c in ANGULAR and c not in joint.coordinates), None)
    if locked is not None:
        offset = (*joint.offset[:locked], 0.1, *joint.offset[locked + 1 :])
        joints = tuple(replace(j, offset=offset) if j is joint else j for j in robot.joints)
        with pytest.raises(InputError, match=rf"joints\.{joint.name}\.offset\.{COORDINATES[locked]}: the closed form"):
            closed_form(build_model(replace(robot, joints=joints)))


def test_an_offset_ends_a_coaxial_zero() -> None:
    """z and gamma of a joint share an axis, unless an angle stands between them."""
    text = f"""
name = "slide"
{link_table("a", 1.0, (0.1, 0.2, 0.3), (0.1, 0.1, 0.1))}
{joint_table("j", "base", "a", "revolute")}
z = {{}}
"""
    assert not zero_map(build_model(robot_from_toml(text))).mass_matrix.mask[0, 1]
    assert zero_map(build_model(robot_from_toml(text + "offset = { alpha = 0.1 }\n"))).mass_matrix.mask[0, 1]


@pytest.mark.parametrize("seed", seeds(1240, 1, 4))
def test_sensitivity_is_the_slope_of_the_pose(seed: int, built: Build) -> None:
    robot = with_offsets(random_robot(seed, joints=(2, 4), tree=seed % 2 == 0, types=TYPES), seed)
    every = tuple(f"joints.{j.name}.offset.{c}" for j in robot.joints for c in COORDINATES)
    kernel, s = built(replace(robot, tunable=every), "kinematics"), random_state(robot, seed)
    names, slopes = offset_sensitivity(robot, s.q, "tcp")
    assert sorted(names) == sorted(every)
    assert slopes.shape == (6, len(every))
    at, step = kernel.frame_pose(s.q, "tcp"), 1e-6
    for name, slope in zip(names, slopes.T, strict=True):
        before = kernel.parameters[name]
        kernel.parameters[name] = before + step
        up = kernel.frame_pose(s.q, "tcp")
        kernel.parameters[name] = before - step
        down = kernel.frame_pose(s.q, "tcp")
        kernel.parameters[name] = before
        change = (up - down) / (2 * step)
        W = change[:3, :3] @ at[:3, :3].T
        found = [*change[:3, 3], W[2, 1], W[0, 2], W[1, 0]]
        assert np.abs(slope - found).max() < 1e-8, name
    many = offset_sensitivity(robot, np.tile(s.q, (3, 1)), "tcp")[1]
    assert np.abs(many[2] - slopes).max() < 1e-14


@pytest.mark.soak
def test_sensitivity_follows_parameters() -> None:
    robot = eomgen.load_robot("puma560")
    q, name = np.full(6, 0.3), "joints.joint2.offset.alpha"
    with_it = robot_with(robot, "joint2", alpha=0.2)
    expected = offset_sensitivity(with_it, q, "tcp")[1]
    found = offset_sensitivity(robot_with(robot, "joint2", alpha=0.0), q, "tcp", parameters={name: 0.2, "other": 1.0})[
        1
    ]
    assert np.abs(found - expected).max() < 1e-14


def robot_with(robot: Robot, joint: str, **offsets: float) -> Robot:
    offset = tuple(offsets.get(name) for name in COORDINATES)
    return replace(robot, joints=tuple(replace(j, offset=offset) if j.name == joint else j for j in robot.joints))


def test_refusals() -> None:
    robot = eomgen.load_robot("puma560")
    with pytest.raises(ArrayError, match=r"q: expected shape \(6,\) or \(N, 6\), got \(5,\)"):
        offset_sensitivity(robot, np.zeros(5), "tcp")
    with pytest.raises(ArrayError, match=r"^q: 'home'; allowed: finite numbers of shape \(6,\) or \(N, 6\)$"):
        offset_sensitivity(robot, "home", "tcp")  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match="tcpp"):
        offset_sensitivity(robot, np.zeros(6), "tcpp")
    text = 'name = "r"\n[[links]]\nname = "a"\nmass = 1.0\n[[joints]]\nname = "j"\nparent = "base"\nchild = "a"\n'
    with pytest.raises(DescriptionError, match=r"joints\.j\.offset.*'delta'"):
        robot_from_toml(text + 'type = "revolute"\noffset = { delta = 1.0 }')
    with pytest.raises(DescriptionError, match=r"joints\.j\.offset\.x"):
        robot_from_toml(text + 'type = "revolute"\noffset = { x = "much" }')
