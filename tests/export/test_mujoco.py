"""Robots that are written for MuJoCo: dynamics, motions of one second, what is refused, and the way back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.cli.entry import main
from eomgen.description.load import robot_from_mjcf
from eomgen.errors import EomgenWarning, InputError
from eomgen.export.mujoco import LEAST, left_out, mjcf
from eomgen.export.mujoco_balls import positions
from eomgen.kernel.complete import Kernel
from eomgen.robot.elements.joint_damping import JointDamping
from eomgen.robot.value import ANGULAR, COORDINATES, LINEAR, Coordinate, Coupling, Friction, Placement, Robot
from tests.oracles.mjcf import MjcfOracle
from tests.oracles.mujoco_models import MujocoRobot
from tests.support.builds import Build
from tests.support.figures import Figures
from tests.support.optional import OptionalModule
from tests.support.random_motors import with_motors
from tests.support.random_robots import random_robot, seeds
from tests.support.random_springs import with_springs
from tests.support.refusals import refused
from tests.support.small_robots import free_body

pytestmark = pytest.mark.quick

mujoco = OptionalModule("mujoco")

KERNELS = ("mass_matrix", "inverse_dynamics", "energy")


def expressible(seed: int) -> Robot:
    """Rods, welded links, turned axes, offsets, preloads, cubic and viscous terms, motors, springs: what MuJoCo has."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, joints=(2, 3), tree=seed % 2 == 0, max_coordinates=4, name=f"written{seed}")
    joints = []
    for joint in robot.joints:
        given = {name: _more(rng, coordinate) for name, coordinate in joint.coordinates.items()}
        offset = tuple(float(rng.uniform(-0.3, 0.3)) if rng.random() < 0.4 else None for _ in COORDINATES)
        joints.append(replace(joint, coordinates=given, offset=offset))
    robot = replace(robot, joints=tuple(joints))
    if any(joint.type in ("revolute", "prismatic") for joint in joints):
        robot = with_motors(robot, seed, ("plain",))
        joints = [replace(j, motor=j.motor and replace(j.motor, friction=None)) for j in robot.joints]
    return with_springs(replace(robot, joints=tuple(joints)), seed, ("linear", "zero damped"))


def _more(rng: np.random.Generator, given: Coordinate) -> Coordinate:
    kind = rng.random()
    if given.stiffness and kind < 0.3:
        return replace(given, preload=float(rng.uniform(-5, 5)))
    if kind < 0.6:
        return replace(given, cubic=float(rng.uniform(0, 50)), friction=Friction(0.0, viscous=0.5))
    return given


@pytest.mark.parametrize("seed", seeds(0, 1, 60))
def test_random_robots_move_as_written(seed: int, built: Build, figures: Figures) -> None:
    """And as they are read again."""
    robot = expressible(seed)
    assert left_out(robot) == []
    kernel, oracle = built(robot, *KERNELS), MujocoRobot(robot)
    first = None
    for i in range(5):
        q = np.random.default_rng(i).uniform(-0.5, 0.5, kernel.n)
        v, a = np.random.default_rng(seed + i).uniform(-1, 1, (2, kernel.n))
        M, force = oracle.mass_matrix(q), oracle.inverse_dynamics(q, v, a)
        figures.at_most("M", float(np.abs(kernel.mass_matrix(q) - M).max() / np.abs(M).max()), 1e-10)
        found = np.abs(kernel.inverse_dynamics(q, v, a) - force).max() / np.abs(force).max()
        figures.at_most("inverse dynamics", float(found), 1e-10)
        ours, theirs = kernel.energy(q, v), oracle.energy(q, v)
        first = first or (ours, theirs)
        found = np.abs((ours - first[0]) - (theirs - first[1])).max() / max(1.0, np.abs(theirs).max())
        figures.at_most("energy", float(found), 1e-10)


def hung(names: tuple[str, ...], damping: JointDamping, **changes: object) -> Robot:
    """A body on a joint of these coordinates."""
    body = free_body()
    table = {name: Coordinate() for name in names}
    joint = replace(body.joints[0], type="fixed", coordinates=table, damping=damping)
    return replace(body, name="hung", joints=(replace(joint, **changes),))


@pytest.mark.parametrize("names", [ANGULAR, COORDINATES], ids=["ball", "slides and ball"])
def test_damping_of_a_joint_becomes_a_balls(names: tuple[str, ...], built: Build) -> None:
    """Slides before it where the body moves, too, with a damping of their own; poses in turned axes."""
    robot = hung(names, JointDamping(0.5 if len(names) > 3 else None, 0.3))
    assert left_out(robot) == []
    kernel, oracle = built(robot, "inverse_dynamics"), MjcfOracle(mjcf(robot, 1e-3, actuators=True), robot)
    q, v, a = np.random.default_rng(3).uniform(-1, 1, (3, kernel.n))
    force = oracle.inverse_dynamics(q, v, a)
    assert np.abs(kernel.inverse_dynamics(q, v, a) - force).max() < 1e-10 * np.abs(force).max()
    assert oracle.model.nu == len(names) - 3
    turn = Placement.from_rpy((0.0, 0.0, 0.0), (0.4, -0.3, 0.2)).rotation
    robot = replace(robot, joints=(replace(robot.joints[0], axis_turn=turn),))
    kernel, model = built(robot, "kinematics"), mujoco.MjModel.from_xml_string(mjcf(robot, 1e-3))
    data = mujoco.MjData(model)
    data.qpos[:] = positions(robot, q)
    mujoco.mj_forward(model, data)
    pose, body = kernel.frame_pose(q, "body"), model.body("body").id
    assert np.abs(pose[:3, :3] - data.xmat[body].reshape(3, 3)).max() < 1e-12
    assert np.abs(pose[:3, 3] - data.xpos[body]).max() < 1e-12


def test_what_a_balls_damping_cannot_be_is_said() -> None:
    """Something else acts on an angle; two angles whose axes stay as they are need no ball."""
    whole = JointDamping(angular=0.3)
    held = {**dict.fromkeys(ANGULAR, Coordinate()), "beta": Coordinate(stiffness=1.0)}
    note = "joints.free.damping.angular: on each angle by itself"
    assert left_out(hung(ANGULAR, whole, coordinates=held)) == [note]
    assert left_out(hung(ANGULAR, whole, offset=(None,) * 5 + (0.1,))) == [note]
    assert left_out(hung(("alpha", "beta"), whole)) == []
    refused(InputError, "on each angle by itself", mjcf, hung(ANGULAR, whole, coordinates=held), 1e-3)
    assert 'damping="0.3"' in mjcf(hung(ANGULAR, whole, coordinates=held), 1e-3, approximate=True)


def expressed(name: str) -> Robot:
    """A built-in robot with what MuJoCo has of it."""
    robot = eomgen.load_robot(name)
    joints = []
    for joint in robot.joints:
        if joint.motor is not None:
            spring = replace(joint.motor.transmission, clearance=None, restitution_damping=None, smoothing=None)
            friction = joint.motor.friction and Friction(0.0, viscous=joint.motor.friction.viscous)
            joint = replace(joint, motor=replace(joint.motor, transmission=spring, friction=friction))
        joints.append(joint)
    springs = tuple(spring for spring in robot.springs if not spring.tension_only)
    return replace(robot, joints=tuple(joints), springs=springs)


MOTIONS = [
    pytest.param("puma560_elastic", 5e-5, 400, marks=pytest.mark.soak),
    pytest.param("puma560_elastic", 5e-5, 20_000, marks=pytest.mark.soak),
    ("geared_arm", 2e-4, 5_000),
    pytest.param("balanced_arm", 5e-5, 20_000, marks=pytest.mark.soak),
    pytest.param("one_link", 1e-4, 10_000, marks=pytest.mark.soak),
    ("two_arms", 1e-4, 200),
    pytest.param("two_arms", 1e-4, 10_000, marks=pytest.mark.soak),
]


@pytest.mark.parametrize(("name", "step", "steps"), MOTIONS)
def test_motions_are_mujocos(name: str, step: float, steps: int, built: Build, figures: Figures) -> None:
    """The same method with the same step, 1 s where it is not too long: what differs is round-off."""
    robot = expressed(name)
    kernel = built(robot, "rollout", "forward_dynamics")
    rng = np.random.default_rng(1)
    q, v = np.zeros(kernel.n), rng.uniform(-0.1, 0.1, kernel.n)
    u = rng.uniform(-1.0, 1.0, kernel.n)
    theirs = MujocoRobot(robot, step).trajectory(q, v, u, steps=steps, every=steps // 10)
    ours = np.hstack(kernel.rollout(q, v, u, step, steps, every=steps // 10))
    scale = np.abs(theirs).max(axis=0)
    assert np.isfinite(theirs).all()
    assert scale.max() > 1e-2
    figures.at_most("of each coordinate's greatest value", float((np.abs(ours - theirs) / scale).max()), 1e-9)


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(5, 1, 20))
def test_the_way_back(seed: int, built: Build) -> None:
    """A robot that is written and read again has the same coordinates and dynamics.

    But for motors, and for offsets of angles that do not move: behind them, axes are no longer orthogonal.
    """
    robot, joints = expressible(seed), []
    for joint in robot.joints:
        kept = (
            value if name in joint.coordinates or name in LINEAR else None
            for name, value in zip(COORDINATES, joint.offset, strict=True)
        )
        joints.append(replace(joint, motor=None, offset=tuple(kept)))
    robot = replace(robot, joints=tuple(joints))
    again = robot_from_mjcf(mjcf(robot, 1e-3))
    one, other = built(robot, *KERNELS), built(again, *KERNELS)
    assert other.coordinates == one.coordinates
    assert {frame.name for frame in robot.frames} < {frame.name for frame in again.frames}  # and the springs' ends
    rng = np.random.default_rng(seed)
    for _ in range(5):
        q, v, a = rng.uniform(-0.5, 0.5, (3, one.n))
        for ours, theirs in (
            (one.mass_matrix(q), other.mass_matrix(q)),
            (one.inverse_dynamics(q, v, a), other.inverse_dynamics(q, v, a)),
        ):
            assert np.abs(ours - theirs).max() <= 1e-11 * np.abs(ours).max()


def test_what_mujoco_lacks_is_refused_by_name_or_left_out_with_a_warning(tmp_path: Path) -> None:
    expected = {
        "worn_arm": ["joints.shoulder.x.clearance", "joints.shoulder.gamma.friction", "joints.gear.gamma.curve"],
        "geared_arm": ["joints.elbow.motor.clearance", "joints.waist.motor.friction"],
        "balanced_arm": ["springs.stop.smoothing", "springs.stop.damping"],
        "shaken_arm": ["prescribed"],
        "four_bar": ["loops."],
    }
    for name, parts in expected.items():
        robot = eomgen.load_robot(name)
        found = left_out(robot)
        for part in parts:
            assert any(part in line for line in found), (name, found)
        refused(InputError, r"MuJoCo has no equal for .*allowed: .*--approximate", mjcf, robot, 1e-3)
        mujoco.MjModel.from_xml_string(mjcf(robot, 1e-3, approximate=True, actuators=True))
        with pytest.warns(EomgenWarning) as caught:
            eomgen.export_mjcf(robot, tmp_path / "a.xml", step=1e-3, approximate=True)
        assert len(caught) == len(found)
    refused(InputError, "allowed: RK4", mjcf, eomgen.load_robot("one_link"), 1e-3, "rk4")
    refused(InputError, "allowed: a finite number", mjcf, eomgen.load_robot("one_link"), -1.0)
    robot = eomgen.load_robot("puma560")
    links = (replace(robot.links[0], inertia=(1.0, 1.0, 9.0, 0.0, 0.0, 0.0)), *robot.links[1:])
    refused(InputError, r"links\..*no body can have", mjcf, replace(robot, links=links), 1e-3)


def test_what_is_in_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "arm.xml"
    assert main(["export", "one_link", "--mjcf", "-o", str(path)]) == 0
    assert f"wrote {path}" in capsys.readouterr().out
    model = mujoco.MjModel.from_xml_path(str(path))
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    assert model.opt.timestep <= 1e-3
    names = [model.joint(i).name for i in range(model.njnt)]
    assert names == [model.actuator(i).name for i in range(model.nu)] == ["joint1.x", "joint1.gamma"]
    assert min(model.body("link1").inertia) >= LEAST  # of a thin rod
    assert main(["export", "worn_arm", "--mjcf", "-o", str(tmp_path)]) == 1
    assert "joints.shoulder.x.clearance" in capsys.readouterr().err
    assert main(["export", "worn_arm", "--mjcf", "--approximate", "--step", "1e-4", "-o", str(tmp_path)]) == 0
    assert "note: joints.shoulder.x.clearance" in capsys.readouterr().err
    frame = eomgen.load_robot("worn_arm").frames[0]
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "worn_arm.xml")).site(frame.name).pos == pytest.approx(
        frame.placement.xyz
    )


def test_a_moment_below_zero_by_round_off_is_written() -> None:
    """As iCub has it: 1 kg, 0.1 m away from the joint, with a product of inertia of 2e-13 kg m^2 and no moment."""
    robot = eomgen.load_robot("one_link")
    links = (replace(robot.links[0], com=(0.1, 0.0, 0.0), inertia=(0.0, 0.0, 0.0, 0.0, 2e-13, 0.0)), *robot.links[1:])
    model = mujoco.MjModel.from_xml_string(mjcf(replace(robot, links=links), 1e-3))
    assert np.allclose(model.body_inertia[1], 0.0, atol=1e-12)


def home_of(model: mujoco.MjModel) -> np.ndarray:
    return np.array(model.key("home").qpos)


def follow(robot: Robot, kernel: Kernel, u: np.ndarray, duration: float, step: float) -> tuple[float, float, float]:
    """How far MuJoCo's motion from home gets from the rollout, the largest gap, and the largest way, m or rad."""
    model = mujoco.MjModel.from_xml_string(mjcf(robot, step, approximate=True, actuators=True))
    data = mujoco.MjData(model)
    q0, steps = home_of(model), round(duration / step)
    data.qpos[:], data.ctrl[:] = q0, u
    q, _ = kernel.rollout(q0, np.zeros(kernel.n), u, step, steps)
    off = gap = 0.0
    for k in range(1, steps + 1):
        mujoco.mj_step(model, data)
        off = max(off, float(np.abs(data.qpos - q[k]).max()))
        gap = max(gap, float(np.abs(kernel.functions.constraint(np.array(data.qpos))).max()))
    return off, gap, float(np.abs(q - q0).max())


def test_loops_move_nearly_as_here(built: Build) -> None:
    """A hinge of the four-bar linkage by two pairs of points: soft, but near."""
    robot = eomgen.load_robot("four_bar")
    kernel = built(robot, "rollout", "constraint")
    found = [follow(robot, kernel, np.array([2.0, 0.0, 0.0]), 0.5, step) for step in (1e-3, 2e-4)]
    print("from ours, gap, way:", *(f"{x:.1e}" for values in found for x in values))
    assert found[1][2] > 1.0
    assert found[0][0] < 7.5e-6  # 7e-6 and 2e-7 in docs/mjcf.md
    assert found[1][0] < 2.5e-7
    assert found[1][1] < 1e-6


def forward(robot: Robot, q: np.ndarray | None = None) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The robot in MuJoCo at coordinates, or at its closed home."""
    model = mujoco.MjModel.from_xml_string(mjcf(robot, 1e-3, approximate=True))
    data = mujoco.MjData(model)
    data.qpos[:] = home_of(model) if q is None else q
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("kind", ["revolute", "spherical", "fixed"])
def test_offsets_of_cut_joints_are_in_the_file(kind: str) -> None:
    """MuJoCo's constraint is closed where ours is, and open elsewhere."""
    robot = eomgen.load_robot("four_bar")
    angle = 0.0
    if kind == "fixed":  # at home, the only pose in which it closes
        angle = robot.home["joint1.gamma"] + robot.home["joint2.gamma"] - robot.home["joint3.gamma"]
    loop = replace(robot.loops[0], type=kind, offset=(0.02 * (kind != "fixed"), None, None, None, None, angle))
    robot = replace(robot, loops=(loop,))
    model, data = forward(robot)
    assert data.nefc == {"revolute": 6, "spherical": 3, "fixed": 6}[kind]
    assert np.abs(data.efc_pos).max() < 1e-9
    _, data = forward(robot, home_of(model) + 0.1)
    assert np.abs(data.efc_pos).max() > 1e-2


def test_couplings_are_in_the_file(built: Build) -> None:
    """Wherever the reference position is; elastic ones as exact springs."""
    robot = eomgen.load_robot("ur5")
    a, b, c, d, e, _ = (f"{joint.name}.gamma" for joint in robot.joints if joint.coordinates)
    joints = [replace(j, offset=(*j.offset[:5], 0.2)) if f"{j.name}.gamma" == a else j for j in robot.joints]
    couplings = (
        Coupling("gear", b, {a: -0.5}, 0.1),
        Coupling("still", d, {}, 0.3),
        Coupling("both", c, {a: 0.5, b: 0.25}, -0.05),
        Coupling("belt", e, {a: 0.5}, -0.2, Coordinate(stiffness=50.0, damping=0.1)),
    )
    robot = replace(robot, joints=tuple(joints), couplings=couplings, driven=None)
    kernel = built(robot.with_constraints(), "constraint", "settling")
    q = np.random.default_rng(0).uniform(-0.5, 0.5, kernel.n)
    model, data = forward(robot, q)
    np.testing.assert_allclose(np.sort(data.efc_pos[:3]), np.sort(kernel.functions.constraint(q)), atol=1e-12)
    np.testing.assert_allclose(kernel.functions.constraint(home_of(model)), 0.0, atol=1e-11)
    stretch = q[4] - 0.5 * q[0] + 0.2
    np.testing.assert_allclose(data.qfrc_spring, [25.0 * stretch, 0.0, 0.0, 0.0, -50.0 * stretch, 0.0], atol=1e-11)
    assert [note for note in left_out(robot) if "belt" in note] == []


def test_joints_that_mujoco_cannot_close_stay_open_and_are_named() -> None:
    robot = eomgen.load_robot("four_bar")
    robot = replace(robot, loops=(replace(robot.loops[0], type="cylindrical"),))
    assert left_out(robot) == ["loops.joint4: left open (MuJoCo has no cylindrical joint among its constraints)"]
    assert forward(robot)[1].nefc == 0
