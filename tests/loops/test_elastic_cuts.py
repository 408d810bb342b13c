"""Cut joints whose coordinates have forces, and couplings: against other cuts of the same mechanism, and laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.steps.tolerances import coordinate_sizes
from eomgen.description.load import robot_from_toml
from eomgen.robot.model import build_model
from eomgen.robot.value import ANGULAR, COORDINATES, LINEAR, Coordinate, Loop, Robot
from eomgen.state.springs import any_spring, fastest_rates, line_rates
from tests.support.added_forces import check_slopes
from tests.support.builds import Build
from tests.support.joint_table import joint_table, link_table, loop_table
from tests.support.random_robots import Array, State, random_placement, random_robot, random_state, seeds, with_offsets
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")

LINK = """
[[links]]
name = "{}"
mass = {}
com = [{}, 0.02, 0.01]
inertia = {{ xx = 0.002, yy = 0.01, zz = 0.012, xy = 0.0003 }}
"""
HEAD = f"""
name = "linkage"
gravity = [0.0, -9.81, 0.0]
driven = ["motor.gamma"]

{joint_table("motor", "base", "crank", "revolute")}

{joint_table("pin", "crank", "coupler", "revolute")}
placement = {{ xyz = [0.2, 0.0, 0.0] }}
"""
SIX = """
x = { stiffness = 1e4, damping = 3.0, cubic = 1e6 }
y = { stiffness = 1.5e4, damping = 1.0, clearance = 1e-4 }
z = { stiffness = 2e4, damping = 2.0 }
alpha = { stiffness = 1e3, damping = 0.1 }
beta = { stiffness = 2e3, friction = { coulomb = 0.3 } }
gamma = { stiffness = 5.0, damping = 0.01, preload = 0.2 }
"""
CUT_THERE = f"""
{joint_table("pivot", "base", "rocker", "revolute")}
placement = {{ xyz = [0.5, 0.0, 0.0] }}

{loop_table("cut", "coupler", "rocker", "revolute")}
placements = [{{ xyz = [0.5, 0.0, 0.0] }}, {{ xyz = [0.4, 0.0, 0.0] }}]
"""
CUT_ELSEWHERE = f"""
{joint_table("hinge", "coupler", "rocker", "revolute")}
placement = {{ xyz = [0.5, 0.0, 0.0] }}
SIX
{loop_table("cut", "base", "rocker", "revolute")}
placements = [{{ xyz = [0.5, 0.0, 0.0] }}, {{ xyz = [-0.4, 0.0, 0.0] }}]
"""
AT = np.array([0.5, 0.13, 1.36]), np.array([0.4, -0.3, 0.2])  # coordinates and velocities of the first linkage


def springs(names: Sequence[str] = COORDINATES, **numbers: float) -> str:
    """Lines of coordinates with these numbers each."""
    table = ", ".join(f"{key} = {x}" for key, x in numbers.items())
    return "".join(f"{name} = {{ {table} }}\n" for name in names)


def linkages(six: str = SIX) -> tuple[Robot, Robot]:
    """A four-bar linkage whose elastic joint is cut, and the same one cut at a rigid pivot."""
    links = LINK.format("crank", 0.4, 0.1) + LINK.format("coupler", 1.0, 0.25)
    here = HEAD + links + LINK.format("rocker", 0.8, 0.2) + CUT_THERE + six
    elsewhere = HEAD + links + LINK.format("rocker", 0.8, -0.2) + CUT_ELSEWHERE.replace("SIX", six)
    return robot_from_toml(here), robot_from_toml(elsewhere)


def states(other: eomgen.Kernel, rng: np.random.Generator) -> tuple[Array, Array, Array, Array]:
    """A state of the second linkage with its joint a little out of place, and the same one of the first."""
    guess = np.concatenate([[0.5, 0.13], 1e-3 * rng.normal(size=3), 2e-2 * rng.normal(size=2), [1.2]])
    q = closed(other, guess)
    J = other.functions.constraint_jacobian(q)
    rates = rng.normal(size=8)
    v = rates - np.linalg.lstsq(J, J @ rates, rcond=None)[0]
    R = other.frame_pose(q, "rocker")[:3, :3]
    spin = (other.frame_jacobian(q, "rocker") @ v)[5]
    return q, v, np.array([q[0], q[1], np.arctan2(R[1, 0], R[0, 0])]), np.array([v[0], v[1], spin])


def closed(kernel: eomgen.Kernel, q: Array) -> Array:
    for _ in range(20):
        J, g = kernel.functions.constraint_jacobian(q), kernel.functions.constraint(q)
        q = q - np.linalg.lstsq(J, g, rcond=None)[0]
    assert np.abs(kernel.functions.constraint(q)).max() < 1e-13
    return q


@pytest.mark.parametrize("seed", [1, 2])
def test_another_cut_of_the_same_mechanism(seed: int, built: Build) -> None:
    """Accelerations and energies do not depend on which joint is cut: the elastic one, or a rigid one."""
    kernel, other = (built(robot) for robot in linkages())
    assert (kernel.constraints, len(other.constraints)) == ((), 5)
    qb, vb, qa, va = states(other, np.random.default_rng(seed))
    u = np.array([1.0, 0.4])
    a = kernel.forward_dynamics(qa, va, np.append(u, 0.0))
    b = other.forward_dynamics(qb, vb, np.append(u, np.zeros(6)))
    assert np.abs(a[:2] - b[:2]).max() <= 1e-10 * np.abs(b).max()
    assert np.allclose(kernel.energy(qa, va), other.energy(qb, vb), rtol=1e-12)
    several = kernel.forward_dynamics(np.stack([qa] * 9), np.stack([va] * 9), np.append(u, 0.0))
    assert np.array_equal(several, np.stack([a] * 9))


def test_derivatives_of_forces_in_a_cut(built: Build) -> None:
    """Those of the residual are complex steps; at rest the forces are the potential energy's slope."""
    s, h = State(*AT, np.array([1.0, 2.0, -1.0]), np.zeros(3)), 1e-7
    for robot in (linkages()[0], linkages(springs(stiffness=1e3))[0]):
        check_slopes(robot, s)
    kernel, q = built(robot, "energy", "generalized_force"), s.q
    slope = [(kernel.energy(q + h * e, 0 * q)[1] - kernel.energy(q - h * e, 0 * q)[1]) / (2 * h) for e in np.eye(3)]
    assert np.allclose(slope, -kernel.generalized_force(q, 0 * q), rtol=1e-6, atol=1e-4)


@pytest.mark.soak
def test_rising_stiffness_leads_to_the_rigid_joint(built: Build) -> None:
    """A linearly implicit step from rest with an ever stiffer cut joint: rates come to those of the rigid one."""
    rigid = built(linkages("")[0])
    q = closed(rigid, np.array([0.5, 0.13, 1.36]))
    u = np.array([1.0, 0.4, 0.0])
    wanted = rigid.rollout(q, 0 * q, u, 1e-3, 1, method="implicit")[1][-1]
    off = []
    for k in (1e6, 1e8, 1e10):
        kernel = built(linkages(springs(COORDINATES[:5], stiffness=k, damping=k * 1e-3))[0])
        found = kernel.rollout(q, 0 * q, u, 1e-3, 1, method="implicit")[1][-1]
        off.append(float(np.abs(found - wanted).max() / np.abs(wanted).max()))
    assert off[0] > 50 * off[1] > 2500 * off[2]
    assert off[2] < 1e-4


def test_an_implicit_step_is_the_linear_system(built: Build) -> None:
    """(M + h C + h^2 K) a = ... with the slopes of the cut joint's laws along their rows."""
    K, C = np.array([1e5, 2e5, 1e5, 1e3, 2e3]), np.array([10.0, 0.0, 5.0, 1.0, 0.0])
    laws = zip(COORDINATES, K, C, strict=False)
    kernel = built(linkages("".join(springs([name], stiffness=k, damping=c) for name, k, c in laws))[0])
    (q, v), u, h = AT, np.array([1.0, 0.4, 0.0]), 1e-3

    def e(q: Array) -> Array:
        X = kernel.functions.cut_poses(q)[0]
        return np.array([*X[:3, 3], np.arctan2(-X[1, 2], X[2, 2]), np.arcsin(X[0, 2])])

    J = np.transpose([(e(q + 1e-6 * d) - e(q - 1e-6 * d)) / 2e-6 for d in np.eye(3)])
    M = kernel.mass_matrix(q) + J.T @ np.diag(h * C + h * h * K) @ J
    now = -J.T @ (K * e(q) + C * (J @ v))
    others = kernel.generalized_force(q, v) - now - kernel.bias_force(q, v)
    wanted = np.linalg.solve(M, u + others - J.T @ (K * (e(q) + h * (J @ v)) + C * (J @ v)))
    found = (kernel.rollout(q, v, u, h, 1, method="implicit")[1][1] - v) / h
    assert np.allclose(found, wanted, rtol=1e-8, atol=1e-8 * np.abs(wanted).max())


ARM = f"""
name = "pair"
COUPLING

{link_table("one", 1.0, (0.3, 0.0, 0.0), (0.01, 0.04, 0.05))}

{link_table("two", 0.5, (0.2, 0.0, 0.0), (0.01, 0.02, 0.03))}

{joint_table("a", "base", "one", "revolute")}

{joint_table("b", "base", "two", "revolute")}
placement = {{ xyz = [0.0, 1.0, 0.0] }}
"""


def coupled(extra: str) -> Robot:
    text = f'[[couplings]]\nname = "gear"\nof = "b.gamma"\nto = {{ "a.gamma" = -2.0 }}\noffset = 0.1\n{extra}'
    return robot_from_toml(ARM.replace("COUPLING", text))


def test_a_rigid_gear_without_loops(built: Build) -> None:
    """Two arms by a gear of ratio -2 move like one: an inertia of I1 + 4 I2 about the first axis."""
    robot = coupled("")
    kernel = built(replace(robot, couplings=(replace(robot.couplings[0], is_constraint=True),)))
    assert kernel.constraints == ("gear",)
    q, u = np.array([0.3, 0.1 - 2 * 0.3]), np.array([0.5, 0.0])
    a = kernel.forward_dynamics(q, np.zeros(2), u)
    M, force = kernel.mass_matrix(q), kernel.generalized_force(q, np.zeros(2)) + u
    ways = np.array([1.0, -2.0])
    assert np.allclose(a, ways * (ways @ force) / (ways @ M @ ways), rtol=1e-12)
    lam = kernel.constraint_forces(q, np.zeros(2), u)
    assert np.allclose(M @ a, force + kernel.functions.constraint_jacobian(q).T @ lam, rtol=1e-12, atol=1e-12)
    with pytest.raises(eomgen.errors.LoopError, match=r"gear is open: gear is left with 0\.1 rad"):
        kernel.forward_dynamics(q + [0.0, 0.1], np.zeros(2), u)
    led = built(robot)
    assert (led.constraints, led.coordinates, led.couplings) == ((), ("a.gamma",), ("gear",))
    assert led.followers([0.3])["b.gamma"][0] == pytest.approx(q[1])
    assert np.allclose(led.forward_dynamics([0.3], [0.0], [0.5]), a[0], rtol=1e-12)
    assert np.allclose(led.constraint_forces([0.3], [0.0], [0.5]), lam, rtol=1e-12)


def test_an_elastic_gear_with_backlash_and_a_ratio_that_is_tuned(built: Build) -> None:
    kernel = built(
        replace(
            coupled("stiffness = 200.0\nclearance = 0.01\ndamping = 0.5"), tunable=("couplings.gear.ratio.a.gamma",)
        )
    )
    assert kernel.constraints == ()
    u, v = np.zeros(2), np.array([0.1, 0.0])

    def torque(q: Array) -> Array:
        bare = kernel.replaced(parameters={"couplings.gear.stiffness": 0.0, "couplings.gear.damping": 0.0})
        return kernel.generalized_force(q, v) - bare.generalized_force(q, v)

    inside, beyond = np.array([0.3, -0.5]), np.array([0.3, -0.45])
    assert np.allclose(torque(inside), [-0.5 * 2.0 * 0.2, -0.5 * 0.2])  # the damper alone, along (2, 1)
    assert np.allclose(torque(beyond) - torque(inside), -200.0 * 0.04 * np.array([2.0, 1.0]), rtol=1e-2)
    kernel.parameters["couplings.gear.ratio.a.gamma"] = -1.0
    assert np.allclose(torque(inside)[0], torque(inside)[1])
    assert np.isfinite(kernel.forward_dynamics(inside, v, u)).all()


def test_forces_and_rows_of_cut_joints(built: Build) -> None:
    """Deviations are those of the cut's pose; forces along their rows are the generalized force; rates bound them."""
    kernel = built(linkages()[0])
    assert kernel.cut_laws == tuple(f"cut.{name}" for name in COORDINATES)
    q, v = AT
    found, rows = kernel.functions.cut_forces(q, v), kernel.functions.cut_jacobian(q)
    pose = kernel.functions.cut_poses(q)[0]
    assert np.allclose(found[:3, 0], pose[:3, 3], atol=1e-15)
    on_second = -found[:, 1].reshape(2, 3) @ pose[:3, :3]  # one angle alone is not 0
    assert np.allclose(kernel.loop_reactions(q, v, np.zeros_like(v))[0], on_second.ravel())
    bare = kernel.replaced(parameters=dict.fromkeys([x for x in kernel.parameters if x.startswith("loops")], 1e-9))
    assert np.allclose(-rows.T @ found[:, 1], kernel.generalized_force(q, v) - bare.generalized_force(q, v), atol=1e-6)
    stiffness, damping = line_rates(kernel, q)
    assert np.allclose(stiffness, stiffness.T)
    assert np.linalg.eigvalsh(stiffness).min() > -1e-6
    assert np.linalg.eigvalsh(damping).min() > -1e-6
    assert any_spring(kernel)
    assert fastest_rates(kernel, q)[0] > 100.0


HALF = 1.5707963267948966


def cut(kind: str, beta: float, angles: Sequence[str], along: float = 0.0, home: str = "", more: str = "") -> Robot:
    """One link that slides or turns, and an elastic cut joint to the base; ``along`` turns the joint's axis about x."""
    text = cart(kind, beta, along, home, more)
    return robot_from_toml(text + springs([*LINEAR, *angles], stiffness=100.0, damping=1.0))


def cart(kind: str, beta: float = 0.0, along: float = 0.0, home: str = "", more: str = "") -> str:
    return f"""
name = "pole"
gravity = [0.0, 0.0, 0.0]
home = {{ {home} }}
{link_table("cart", 1.0, (0.05, 0.0, 0.0), (0.01, 0.01, 0.01))}
{joint_table("joint", "base", "cart", kind)}
placement = {{ rpy = [{along}, 0.0, 0.0] }}
{more}
{loop_table("weld", "base", "cart", "fixed")}
placements = [{{}}, {{ rpy = [0.0, {beta}, 0.0] }}]
"""


def guide(laws: str = "") -> Robot:
    """A cart on a slide with offsets, and a weld to the base."""
    more = "z = { damping = 2.0 }\noffset = { alpha = 0.01, x = 1e-3 }"
    return robot_from_toml(cart("prismatic", more=more) + laws)


def test_coordinates_of_a_cut_that_only_offsets_move(built: Build) -> None:
    """Their forces change with nothing, and all derivatives are those of the others; Radau takes such steps."""
    kernel = built(guide(springs(stiffness=300.0, damping=1.0)))
    q, v, u = np.array([0.1]), np.array([0.2]), np.array([0.3])
    K, B, M = kernel.residual_jacobian(q, v, u)
    assert np.allclose([K, B, M], np.reshape([300.0, 3.0, 1.0], (3, 1, 1)), rtol=1e-14)
    by = kernel.forward_dynamics_jacobian(q, v, u)
    assert np.allclose(by, np.reshape([-300.0, -3.0, 1.0], (3, 1, 1)), rtol=1e-14)
    motion = eomgen.integration.integrate(kernel, q, v, 0.1, method="scipy:Radau", rtol=1e-9, atol=1e-12)
    w, d = np.sqrt(300.0 - 1.5**2), 1.5
    t = motion.t[-1]
    wanted = np.exp(-d * t) * (q[0] * np.cos(w * t) + (v[0] + d * q[0]) / w * np.sin(w * t))
    assert abs(motion.q[-1, 0] - wanted) < 1e-8


def test_a_rigid_cut_that_an_offset_keeps_open_names_it(built: Build) -> None:
    """Those alone that change what is left: alpha turns no row of x, and no coordinate takes either up."""
    kernel = built(guide(), "constraint", "constraint_jacobian", "mass_matrix", "cut_poses")
    wanted = r"weld\.alpha is left with 0\.01 rad.*other offsets: 'joints\.joint\.offset\.alpha = 0\.01'$"
    refused(eomgen.errors.LoopError, wanted, kernel.assemble, [0.1])
    kernel.parameters["joints.joint.offset.alpha"] = 0.0
    refused(eomgen.errors.LoopError, r"weld\.x is left with 0\.001 m.*offset\.x = 0\.001'$", kernel.assemble, [0.1])
    kernel.parameters["joints.joint.offset.x"] = 0.0
    assert abs(kernel.assemble([0.1])[0]) < 1e-12


@pytest.mark.parametrize("seed", seeds(4700, 4, 40))
def test_derivatives_of_random_trees_with_offsets_and_elastic_cuts(seed: int) -> None:
    """Angles that offsets turn and no coordinate has are in loops' forces; by complex steps of the residual."""
    rng = np.random.default_rng(seed)
    robot = with_offsets(random_robot(seed, joints=(1, 3), max_size=5, tree=True), seed)
    draws = zip(COORDINATES, rng.uniform(1.0, 9.0, (6, 2)).tolist(), strict=True)
    law = {name: Coordinate(stiffness=k, damping=c) for name, (k, c) in draws}
    places = random_placement(rng), random_placement(rng)
    robot = replace(robot, loops=(Loop("weld", (robot.base, robot.links[-1].name), "fixed", places, coordinates=law),))
    check_slopes(robot, random_state(robot, seed))


@pytest.mark.parametrize("angles", [ANGULAR, ("beta",)])
@pytest.mark.parametrize(("beta", "said"), [(HALF, "90"), (-HALF, "-90"), (1.5707963, "90")])
def test_frames_that_stay_at_the_pole(beta: float, said: str, angles: tuple[str, ...], built: Build) -> None:
    with pytest.raises(eomgen.errors.DescriptionError, match=rf"loops\.weld: its frames stay at beta = {said} degrees"):
        built(cut("prismatic", beta, angles), "forward_dynamics")


@pytest.mark.parametrize("beta", [HALF - 1e-3, HALF + 1e-5])
def test_frames_that_stay_beside_the_pole(beta: float, built: Build) -> None:
    """The angles that nothing turns hold nothing back."""
    kernel = built(cut("prismatic", beta, ANGULAR), "forward_dynamics")
    assert kernel.forward_dynamics([0.1], [0.0], [0.0])[0] == pytest.approx(-10.0, rel=1e-12)


def test_frames_that_stay_without_tables_of_angles(built: Build) -> None:
    kernel = built(cut("prismatic", HALF, ()), "tree_forward_dynamics")
    assert kernel.forward_dynamics([0.1], [0.0], [0.0], cut=True)[0] == pytest.approx(-10.0, rel=1e-12)


@pytest.mark.parametrize(
    ("home", "at_the_pole"), [("", True), ('"joint.gamma" = 1e-5', False), ('"joint.gamma" = 0.3', False)]
)
def test_a_home_at_the_pole(home: str, at_the_pole: bool, built: Build) -> None:
    """Only steps that the tolerance chooses refer to what is there."""
    robot = cut("revolute", HALF, ANGULAR, along=-HALF, home=home)
    kernel = built(robot, "forward_dynamics", "rollout")
    assert np.isfinite(kernel.forward_dynamics([0.3], [0.1], [0.0])).all()
    assert np.isfinite(kernel.rollout([0.3], [0.1], [0.0], 1e-4, 3, method="implicit")[0]).all()
    if at_the_pole:
        with pytest.raises(
            eomgen.errors.InputError, match=r"pole: home puts loops\.weld at beta = \+-90 degrees.*another home"
        ):
            coordinate_sizes(build_model(robot))
        refused(eomgen.errors.InputError, r"loops\.weld at beta", built, robot, "adaptive_rollout")
    else:
        assert np.isfinite(coordinate_sizes(build_model(robot))).all()
        adaptive = built(robot, "adaptive_rollout")
        assert np.isfinite(adaptive.rollout([0.3], [0.1], [0.0], duration=1e-3, samples=2, method="tsit5")[0]).all()


def test_a_home_at_the_pole_of_angles_that_nothing_moves() -> None:
    """A slide, whose offset turns the frames there: no size follows from them."""
    robot = cut("prismatic", 0.0, ANGULAR)
    turned = cut("prismatic", 0.0, ANGULAR, more=f"offset = {{ beta = {HALF} }}")
    assert turned != robot
    for wanted, found in zip(coordinate_sizes(build_model(robot)), coordinate_sizes(build_model(turned)), strict=True):
        assert np.allclose(found, wanted, rtol=1e-12)


def test_states_at_the_pole(built: Build) -> None:
    """Where frames come to it, the loop and the state are named."""
    robot = cut("revolute", HALF, ANGULAR, along=-HALF, home='"joint.gamma" = 0.3')
    kernel = built(robot, "forward_dynamics", "cut_forces", "cut_poses", "energy")
    said = r"pole: loop weld is at beta = \+-90 degrees, where its alpha and gamma turn about one axis"
    with pytest.raises(eomgen.errors.SingularError, match=rf"forward_dynamics: {said}; allowed: poses beside it"):
        kernel.forward_dynamics([0.0], [0.1], [0.0])
    with pytest.raises(eomgen.errors.SingularError, match=rf"cut_forces: {said} in state \(1, 0\);"):
        kernel.functions.cut_forces(np.array([[[0.3], [0.2]], [[0.0], [0.1]]]), np.zeros(1))
    assert np.isfinite(kernel.forward_dynamics([1e-6], [0.1], [0.0])).all()
