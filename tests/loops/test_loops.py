"""Mechanisms with closed loops: closed-form linkages, Pinocchio, another cut of the same mechanism."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.integration import integrate
from eomgen.kernel.complete import Kernel
from eomgen.robot.value import COORDINATES, Coordinate, Joint, Loop, Placement, Robot
from tests.oracles.by_singular_values import ClosedLoops
from tests.support.builds import Build
from tests.support.joint_table import loop_table
from tests.support.linkages import FREE, KERNELS, bricard, threefold
from tests.support.optional import needs
from tests.support.random_robots import Array, random_link, random_placement, random_robot, random_state, seeds
from tests.support.recuts import placed, pose

pytestmark = pytest.mark.usefixtures("unoptimised")


@pytest.fixture
def example(built: Build) -> object:
    return lambda name: ClosedLoops(built(eomgen.load_robot(name), *KERNELS))


# ---- closed-form linkages


def four_bar(theta: float) -> tuple[float, float]:
    """Angles of coupler and rocker to the ground by the intersection of two circles, the open assembly."""
    a, b, c, d = 0.2, 0.5, 0.4, 0.5
    end = a * np.exp(1j * theta)
    across = d - end
    reach = abs(across)
    angle = np.angle(across) + np.arccos((b * b + reach * reach - c * c) / (2 * b * reach))
    joint = end + b * np.exp(1j * angle)
    return float(angle), float(np.angle(joint - d))


def test_four_bar_equals_freudensteins_equation(example) -> None:  # type: ignore[no-untyped-def]
    a, b, c, d = 0.2, 0.5, 0.4, 0.5
    loops = example("four_bar")
    for theta in np.linspace(-3.0, 3.0, 13):
        coupler, rocker = four_bar(theta)
        guess = [theta, coupler - theta + 0.2, rocker - 0.2]
        q = loops.consistent_positions(guess, held=["joint1.gamma"])
        assert q[0] == theta
        assert np.abs(loops.kernel.functions.constraint(q)).max() <= 1e-12
        left = d / a * np.cos(q[2]) - d / c * np.cos(theta) + (a * a - b * b + c * c + d * d) / (2 * a * c)
        assert abs(left - np.cos(theta - q[2])) <= 1e-11
        v = loops.consistent_velocities(q, [2.0, 0.0, 0.0], held=["joint1.gamma"])
        ratio = a * np.sin(theta - coupler) / (c * np.sin(rocker - coupler))
        assert v[0] == 2.0
        assert abs(v[2] / v[0] - ratio) <= 1e-10


def test_four_bar_accelerates_as_one_coordinate_does(example) -> None:  # type: ignore[no-untyped-def]
    """I(theta) theta'' + I' theta'^2 / 2 + V' = u, from planar geometry alone."""
    loops = example("four_bar")

    def state(theta: float) -> Array:
        coupler, rocker = four_bar(theta)
        crank = 0.2 * np.exp(1j * theta)
        centres = [crank / 2, crank + 0.25 * np.exp(1j * coupler), 0.5 + 0.2 * np.exp(1j * rocker)]
        return np.array([*(z.real for z in centres), *(z.imag for z in centres), theta, coupler, rocker])

    masses = np.array([0.4, 1.0, 0.8])
    weights = np.array([*masses, *masses, *(masses * np.array([0.2, 0.5, 0.4]) ** 2 / 12)])

    def inertia(theta: float) -> float:
        h = 1e-5
        return float(weights @ ((state(theta + h) - state(theta - h)) / (2 * h)) ** 2)

    def potential(theta: float) -> float:
        return float(9.81 * masses @ state(theta)[3:6])

    for theta, rate, drive in ((0.4, 3.0, 0.0), (1.7, -2.0, 0.5), (-2.2, 4.0, -1.0)):
        coupler, rocker = four_bar(theta)
        q = loops.consistent_positions([theta, coupler - theta, rocker], held=["joint1.gamma"])
        v = loops.consistent_velocities(q, [rate, 0.0, 0.0], held=["joint1.gamma"])
        h = 1e-3
        slope, push = ((f(theta + h) - f(theta - h)) / (2 * h) for f in (inertia, potential))
        expected = (drive - slope * rate**2 / 2 - push) / inertia(theta)
        found = loops.forward_dynamics(q, v, [drive, 0.0, 0.0])
        assert abs(found.a[0] - expected) <= 1e-4 * abs(expected)
        assert found.redundancy.mobility == 1
        assert found.redundancy.redundant == ("joint4.z", "joint4.alpha", "joint4.beta")
        assert found.redundancy.undetermined == found.redundancy.redundant


def test_bennetts_linkage(example) -> None:  # type: ignore[no-untyped-def]
    """Bennett (1903): tan(t1/2) tan(t2/2) = sin((b + a)/2) / sin((b - a)/2), opposite angles equal and opposite."""
    loops = example("bennett")
    for theta in (0.3, 1.0, 2.0, 2.9, -1.3):
        q = loops.consistent_positions([theta, np.sign(theta) * 2.2, -theta], held=["joint1.gamma"])
        product = np.sin(np.radians(45)) / np.sin(np.radians(15))
        assert abs(np.tan(q[0] / 2) * np.tan(q[1] / 2) - product) <= 1e-9 * product
        assert abs(q[0] + q[2]) <= 1e-10
        found = loops.redundancy(q)
        assert (found.rank, found.mobility, len(found.redundant)) == (2, 1, 3)


@pytest.mark.soak
def test_bricards_mechanism(built: Build) -> None:
    """cos t + cos p + cos t cos p = 0 closes it; one degree of freedom, one constraint too many; energy over 10 s."""
    loops = ClosedLoops(built(bricard(), *KERNELS))
    for theta in (0.5, 1.0, 1.8):
        signs = [np.array([1, s, 1, s, 1]) * threefold(theta) for s in (1, -1)]
        q = min(signs, key=lambda x: np.abs(loops.kernel.functions.constraint(x)).max())
        assert np.abs(loops.kernel.functions.constraint(q)).max() <= 1e-14
        found = loops.redundancy(q)
        assert (found.rank, found.mobility, len(found.redundant)) == (4, 1, 1)
    result = integrate(loops.kernel, q, np.zeros(5), 10.0, output_step=0.05)
    energy = result.energy.sum(axis=1)
    assert result.info["gap"] <= 1e-12
    assert result.info["gap_rate"] <= 1e-9
    assert result.info["redundant"] == 1
    assert result.energy[:, 0].max() > 5.0
    assert np.ptp(energy) <= 1e-6 * result.energy[:, 0].max()


SLIDER = f"""
name = "slider_crank"
gravity = [0, -9.81, 0]
links = [
  {{ name = "crank", mass = 1, com = [0.1, 0, 0], inertia = {{ xx = 1, yy = 1, zz = 1 }} }},
  {{ name = "rod", mass = 1, com = [0.3, 0, 0], inertia = {{ xx = 1, yy = 1, zz = 1 }} }},
  {{ name = "slider", mass = 2, inertia = {{ xx = 1, yy = 1, zz = 1 }} }},
]
joints = [
  {{ name = "turn", parent = "base", child = "crank", type = "revolute" }},
  {{ name = "pin", parent = "crank", child = "rod", type = "revolute", placement = {{ xyz = [0.2, 0, 0] }} }},
  {{ name = "head", parent = "rod", child = "slider", type = "revolute", placement = {{ xyz = [0.7, 0, 0] }} }},
]
{loop_table("guide", "base", "slider", "prismatic")}
placements = [{{ rpy = [0, 1.5707963267948966, 0] }}, {{ rpy = [0, 1.5707963267948966, 0] }}]
"""


def test_slider_crank(built: Build) -> None:
    """x = r cos t + sqrt(l^2 - r^2 sin^2 t); the guide is a prismatic cut."""
    loops = ClosedLoops(built(robot_from_toml(SLIDER), *KERNELS))
    for theta in np.linspace(-3, 3, 7):
        q = loops.consistent_positions([theta, -theta, 0.0], held=["turn.gamma"])
        stroke = 0.2 * np.cos(theta) + np.sqrt(0.49 - 0.04 * np.sin(theta) ** 2)
        assert abs(loops.kernel.functions.cut_poses(q)[0, 2, 3] - stroke) <= 1e-12
        assert loops.redundancy(q).mobility == 1


@pytest.mark.soak
def test_legs_of_goughs_platform(example) -> None:  # type: ignore[no-untyped-def]
    """Lengths of the legs are |p + R b - a|."""
    loops, robot = example("gough"), eomgen.load_robot("gough")
    pose = [0.1, -0.05, 0.9, 0.1, -0.2, 0.15]
    q = platform_at(loops, pose)
    assert np.array_equal(q[:6], pose)
    X = loops.kernel.frame_pose(q, "platform")
    for i, loop in enumerate(robot.loops):
        ground = np.array(robot.joint(f"universal{i + 1}").placement.xyz)
        tip = X[:3, :3] @ loop.placements[0].xyz + X[:3, 3]
        assert abs(q[8 + 3 * i] - np.linalg.norm(tip - ground)) <= 1e-12
    found = loops.redundancy(q)
    assert (found.rank, found.mobility, found.redundant) == (18, 6, ())


# ---- against others


def closed_at(
    robot: Robot, q: Array, kernel: Kernel, pairs: list[tuple[str, str, str]], rng: np.random.Generator
) -> Robot:
    """The robot with loops (link, link, type) that are closed at q."""
    loops = []
    for i, (a, b, kind) in enumerate(pairs):
        first = random_placement(rng)
        second = np.linalg.inv(kernel.frame_pose(q, b)) @ kernel.frame_pose(q, a) @ pose(first)
        loops.append(Loop(f"loop{i + 1}", (a, b), kind, (first, placed(second))))
    return replace(robot, loops=tuple(loops))


@pytest.mark.parametrize("seed", [*seeds(413, 1, 1), *seeds(400, 0, 13)])
def test_accelerations_and_reactions_equal_pinocchios(seed: int, built: Build) -> None:
    """Loops of spherical and fixed cuts in random robots with springs, dampers and armatures."""
    pin = needs("pinocchio")
    from tests.oracles.pinocchio_models import PinocchioOracle

    rng = np.random.default_rng(seed)
    robot = random_robot(rng, joints=(4, 6), types=("revolute", "fixed", "free"))
    open_kernel, s = built(robot, "kinematics"), random_state(robot, rng)
    names = [robot.base, *(link.name for link in robot.links)]
    leaf, other = names[-1], names[1]
    whole, part = (leaf, "base", "fixed"), (other, "base", "fixed")
    pairs = [[(leaf, "base", "spherical")], [whole], [whole, part]][seed % 3]
    robot = closed_at(robot, s.q, open_kernel, pairs, rng)
    loops, oracle = ClosedLoops(built(robot, *KERNELS)), PinocchioOracle(robot)
    v = loops.consistent_velocities(s.q, s.v)
    found = loops.forward_dynamics(s.q, v, s.u)
    first = len(robot.joints[0].coordinates)  # what holding the first link takes of the constraints on both links
    assert len(found.redundancy.redundant) == (6 - first if len(pairs) == 2 else 0)
    assert found.redundancy.mobility > 0
    cuts, data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for loop in robot.loops:
        kind = pin.ContactType.CONTACT_3D if loop.type == "spherical" else pin.ContactType.CONTACT_6D
        sides = []
        for link, placement in zip(loop.links, loop.placements, strict=True):
            frame = oracle.model.frames[oracle.frame_number(link)]
            sides += [frame.parentJoint, frame.placement * pin.SE3(pose(placement))]
        cuts.append(pin.RigidConstraintModel(kind, oracle.model, *sides, pin.ReferenceFrame.LOCAL))
        data.append(cuts[len(cuts) - 1].createData())
    oracle.model.armature = oracle.armature
    oracle.data = oracle.model.createData()
    pin.initConstraintDynamics(oracle.model, oracle.data, cuts, data)
    settings = pin.ProximalSettings(1e-13, 1e-10, 100)
    force = s.u - oracle.stiffness * s.q - oracle.damping * v
    a = pin.constraintDynamics(oracle.model, oracle.data, s.q, v, force, cuts, data, settings)
    assert np.abs(found.a - a).max() <= 1e-7 * np.abs(a).max()
    if found.redundancy.redundant:
        return  # the reactions are not unique
    reactions = loops.reactions(s.q, found.multipliers)
    for row, one, loop in zip(reactions, data, robot.loops, strict=True):
        wrench = np.array(one.contact_force.vector)  # on the first link, in the cut frame there; the frames coincide
        size = 3 if loop.type == "spherical" else 6
        assert np.abs(row[:size] + wrench[:size]).max() <= 1e-6 * np.abs(wrench).max()


@pytest.mark.parametrize("kind", ["planar", *(pytest.param(kind, marks=pytest.mark.soak) for kind in FREE)])
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.soak
def test_another_cut_of_the_same_mechanism(kind: str, seed: int, built: Build) -> None:
    """A joint that is cut, or kept in the tree with its far link welded to the ground: the same motion and forces."""
    rng = np.random.default_rng(seed)
    chain = random_robot(rng, joints=(7, 7), types=("revolute",), rigid=True, forces=False)
    near, place = chain.joints[-1].child, random_placement(rng)
    ground = replace(random_link(rng, "ground_plate"), com=(0.0, 0.0, 0.0))
    far = Joint("last", near, "ground_plate", "fixed", place, coordinates={name: Coordinate() for name in FREE[kind]})
    whole = replace(chain, name="whole", links=(*chain.links, ground), joints=(*chain.joints, far))
    q = random_state(whole, rng).q * 0.5
    weld = closed_at(whole, q, built(whole, "kinematics"), [("ground_plate", "base", "fixed")], rng)
    plate = placed(built(whole, "kinematics").frame_pose(q, "ground_plate"))
    weld = replace(weld, loops=(Loop("weld", ("ground_plate", "base"), "fixed", (Placement(), plate)),))
    cut = replace(chain, loops=(Loop("cut", (near, "base"), kind, (place, plate)),))
    kept, open_ = (ClosedLoops(built(robot, *KERNELS)) for robot in (weld, cut))
    n = open_.kernel.n
    assert np.abs(open_.kernel.functions.constraint(q[:n])).max() <= 1e-14
    v = kept.consistent_velocities(q, rng.uniform(-1, 1, kept.kernel.n))
    assert np.abs(open_.kernel.functions.constraint_jacobian(q[:n]) @ v[:n]).max() <= 1e-12
    u = np.concatenate([rng.uniform(-1, 1, n), np.zeros(len(FREE[kind]))])
    one, other = kept.forward_dynamics(q, v, u), open_.forward_dynamics(q[:n], v[:n], u[:n])
    assert one.redundancy.mobility == other.redundancy.mobility == n - len(open_.kernel.constraints)
    assert np.abs(one.a[:n] - other.a).max() <= 1e-9 * np.abs(other.a).max()
    weight = np.array(plate.rotation).T @ np.array(whole.gravity) * ground.mass
    expected = kept.reactions(q, one.multipliers)[0] - np.concatenate([weight, np.zeros(3)])
    found = open_.reactions(q[:n], other.multipliers)[0]
    assert np.abs(found - expected).max() <= 1e-8 * np.abs(expected).max()


# ---- laws of mechanics


@pytest.mark.soak
def test_closing_loses_the_energy_of_the_lost_velocity(example) -> None:  # type: ignore[no-untyped-def]
    """Carnot's theorem; and velocities that are consistent already stay."""
    loops = example("gough")
    q = platform_at(loops, [0.0, 0.0, 1.0, 0.1, 0.0, 0.0])
    guess = np.random.default_rng(5).uniform(-1, 1, 24)
    v = loops.consistent_velocities(q, guess)
    M = loops.kernel.mass_matrix(q)
    before, after, lost = (x @ M @ x / 2 for x in (guess, v, guess - v))
    assert abs(before - after - lost) <= 1e-12 * before
    assert after > 0.0
    assert np.abs(loops.consistent_velocities(q, v) - v).max() <= 1e-12


def platform_at(loops: ClosedLoops, pose: list[float]) -> Array:
    return loops.consistent_positions([*pose, *[0.0, 0.0, 1.0] * 6], held=[f"pose.{x}" for x in COORDINATES])
