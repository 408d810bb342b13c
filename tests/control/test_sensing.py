"""Measurement models: readings against Pinocchio and other kernels, exact Jacobians, noise, what is refused by name."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import cffi
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import eomgen
from eomgen.control import Measurement, parse_sensors
from eomgen.description.recorded import robot_from_record
from eomgen.errors import InputError, UnknownNameError
from eomgen.pipeline import Options, make_source
from eomgen.robot import Sensor, build_model, record_of, robot_of
from eomgen.robot.value import MOTOR, PRINCIPAL, Coordinate, Robot
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.bending_mixtures import answer
from tests.support.builds import Build
from tests.support.controllers import compiled
from tests.support.fuzzing import check_message
from tests.support.pendulums import described
from tests.support.random_motors import geared_robot, motor_state
from tests.support.random_robots import Array, random_robot, random_state, seeds
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

HYSTERETIC = described(
    "motor = { inertia = 0.1, ratio = 100, stiffness = 1e4, hysteresis = { stiffness = 1e3, beta = 1e3, gamma = 1e3 } }"
)
ROD = eomgen.load_robot("one_link")
PIECES = (",", ":", " ", "imu", "encoder", "torque", "pose", "tcp", "joint1.gamma", "joint1", "base", "\n", "\x1b")
FUZZ = settings(max_examples=100, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
TREE = random_robot(4, joints=(3, 4), tree=True)


def names(robot: Robot) -> list[str]:
    """All sensors that a robot can carry: at coordinates, on frames, links and the base."""
    frames = build_model(robot).frames
    return [f"{kind}:{x}" for kind in ("encoder", "tachometer", "torque") for x in robot.coordinates] + [
        f"{kind}:{x}" for kind in ("accelerometer", "gyroscope", "imu", "position", "pose") for x in frames
    ]


def read(m: Measurement, q: Array, v: Array, a: Array) -> dict[str, float]:
    """Readings by their names, from the program in Python's arithmetic."""
    values = answer(m.robot, "measurement", q=q, v=v, a=a)
    return dict(zip((name for name, _ in m.readings), values, strict=True))


@pytest.mark.parametrize("seed", seeds(0, 2, 20))
def test_frames_read_what_pinocchio_has(seed: int) -> None:
    """Specific force and angular rate in axes of frames on links and on the base, and poses."""
    robot = random_robot(seed, joints=(2, 4), tree=True)
    state, oracle = random_state(robot, seed), PinocchioOracle(robot)
    q, v, a = state.q, state.v, state.a
    m = Measurement.of(robot, [x for x in names(robot) if x.startswith(("accel", "gyro", "imu", "position", "pose"))])
    found, model = read(m, q, v, a), build_model(robot)
    everywhere = answer(robot, "imu", q=q, v=v, a=a).reshape(-1, 6)
    for frame, imu in zip(model.frames, everywhere, strict=True):
        pose = oracle.frame_pose(q, frame)
        acceleration = oracle.frame_acceleration(q, v, a, frame, "LOCAL")
        force = acceleration[:3] - pose[:3, :3].T @ np.array(robot.gravity)
        expected = np.concatenate([force, oracle.frame_velocity(q, v, frame, "LOCAL")[3:]])
        size = 1.0 + np.abs(expected).max()
        assert np.abs(imu - expected).max() <= 1e-12 * size
        for kind, part in (("imu", expected), ("accelerometer", force), ("gyroscope", expected[3:])):
            read_there = [x for name, x in found.items() if name.startswith(f"{kind}:{frame}.")]
            assert np.abs(np.array(read_there) - part).max() <= 1e-12 * size
        rows = [x for name, x in found.items() if name.startswith(f"pose:{frame}.")]
        assert np.abs(np.array(rows).reshape(3, 4) - pose[:3]).max() <= 1e-12
        origin = [found[f"position:{frame}.{axis}"] for axis in "xyz"]
        assert np.abs(origin - pose[:3, 3]).max() <= 1e-12


@pytest.mark.parametrize("seed", seeds(0, 2, 20))
def test_encoders_on_both_sides_and_torques_of_gears(seed: int) -> None:
    """Torques on the gear's output are reactions along the axis, torques of gears laws of their deflections."""
    robot = geared_robot(seed, joints=(2, 3), kinds=("plain", "cubic"))
    state, model = motor_state(robot, seed), build_model(robot)
    m = Measurement.of(robot, [x for x in names(robot) if x.startswith(("encoder", "tachometer", "torque"))])
    found = read(m, state.q, state.v, state.a)
    reactions = answer(robot, "reactions", q=state.q, v=state.v, a=state.a).reshape(-1, 6)
    passive = answer(robot, "generalized_force", q=state.q, v=state.v)
    for i, name in enumerate(model.coordinates):
        assert found[f"encoder:{name}"] == state.q[i]
        assert found[f"tachometer:{name}"] == state.v[i]
    for body, wrench in zip(model.bodies, reactions, strict=True):
        joint = robot.joint(body.joint)
        if body.active == ("gamma",):
            assert abs(found[f"torque:{joint.name}.gamma"] - wrench[5]) <= 1e-12 * (1.0 + np.abs(wrench).max())
        if joint.motor is None:
            continue
        here = found[f"torque:{joint.name}.{MOTOR}"]
        at, of = (model.coordinates.index(f"{joint.name}.{x}") for x in (MOTOR, PRINCIPAL[joint.type]))
        if joint.motor.friction is None and not joint.motor.further:
            assert abs(passive[at] + here / joint.motor.ratio) <= 1e-12 * (1.0 + abs(here))
        gear = joint.motor.transmission
        k, d = gear.stiffness or 0.0, gear.damping or 0.0
        if gear == Coordinate(stiffness=k, damping=d):
            phi, rate = (x[at] / joint.motor.ratio - x[of] for x in (state.q, state.v))
            assert abs(here - k * phi - d * rate) <= 1e-12 * (1.0 + abs(here))


@pytest.mark.parametrize("seed", seeds(0, 1, 10))
def test_momentum_is_that_of_the_mass_matrix(seed: int) -> None:
    """p = M v, and C^T v, with motors, followers of the modes and whatever else: also the rate of p on a motion."""
    robot = geared_robot(seed, joints=(2, 3))
    s, n = motor_state(robot, seed), build_model(robot).size
    p, work = answer(robot, "generalized_momentum", q=s.q, v=s.v).reshape(2, n)
    M, C = (answer(robot, name, q=s.q, v=s.v).reshape(n, n) for name in ("mass_matrix", "coriolis_matrix"))
    assert np.abs(p - M @ s.v).max() <= 1e-12 * (1.0 + np.abs(p).max())
    assert np.abs(work - C.T @ s.v).max() <= 1e-12 * (1.0 + np.abs(work).max())


def test_jacobians_are_differences_of_innovations(built: Build) -> None:
    """By q, v and a, of several states at once; a pose's three angles are those of its rotation."""
    m = Measurement.of(TREE, ["encoder:" + next(iter(TREE.coordinates)), "pose:tcp", "imu:tcp", "torque:joint1.gamma"])
    kernel = built(m.robot, *m.kernels)
    assert kernel.raw.libraries.meta["readings"] == [name for name, _ in m.readings]
    states = np.random.default_rng(3).uniform(-1.0, 1.0, (3, 2, kernel.n))
    H = m.jacobian(kernel, *states)
    assert [x.shape for x in H] == [(2, len(m.noise), kernel.n)] * 3
    h = 1e-6
    for which, rows in enumerate(H):
        for i in range(kernel.n):
            ahead, behind = states.copy(), states.copy()
            ahead[which, :, i] += h
            behind[which, :, i] -= h
            change = m.innovation(kernel.functions.measurement(*ahead), kernel.functions.measurement(*behind)) / (2 * h)
            assert np.abs(change - rows[..., i]).max() <= 1e-7 * (1.0 + np.abs(rows).max())
    single = m.jacobian(kernel, *states[:, 0])
    assert all(np.array_equal(one, many[0]) for one, many in zip(single, H, strict=True))


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_innovations_and_jacobians_in_c(dtype: str, built: Build, tmp_path: Path) -> None:
    """With all warnings as errors, poses between other sensors; as in Python within round-off."""
    sensors = ["pose:tcp", "imu:tcp", "pose:base", f"encoder:{next(iter(TREE.coordinates))}"]
    m, names = Measurement.of(TREE, sensors), ("measurement", "measurement_adjoint")
    kernel, real = built(m.robot, *names, dtype=dtype), {"float64": "double", "float32": "float"}[dtype]
    source, n = make_source(m.robot, Options(names, dtype, batches=False)), kernel.n
    library, ffi = compiled({**source.files, **m.sources(dtype)}, tmp_path), cffi.FFI()
    ffi.cdef(
        f"void {TREE.name}_setup(const {real} *p, {real} *h);"
        f"void {TREE.name}_innovation(const {real} *measured, const {real} *predicted, {real} *innovation);"
        f"void {TREE.name}_innovation_jacobian(const {real} *h, const {real} *q, const {real} *v, const {real} *a,"
        f" {real} *predicted, {real} *jacobian);"
    )
    code = ffi.dlopen(str(library))
    call = {name: getattr(code, f"{TREE.name}_{name}") for name in ("setup", "innovation", "innovation_jacobian")}

    def at(x: Array) -> object:
        return ffi.from_buffer(f"{real}[]", x)

    h, rng = np.zeros(4096, dtype), np.random.default_rng(6)
    call["setup"](at(np.array([*kernel.parameters.values()], dtype)), at(h))
    q, v, a = rng.uniform(-1.0, 1.0, (3, n)).astype(dtype)
    predicted, jacobian = np.zeros(len(m.readings), dtype), np.zeros((len(m.noise), 3, n), dtype)
    call["innovation_jacobian"](at(h), at(q), at(v), at(a), at(predicted), at(jacobian))
    limit = 1e-13 if dtype == "float64" else 1e-4
    expected = np.stack(m.jacobian(kernel, q, v, a), axis=1)
    assert np.abs(predicted - kernel.functions.measurement(q, v, a)).max() <= limit * (1.0 + np.abs(predicted).max())
    assert np.abs(jacobian - expected).max() <= limit * (1.0 + np.abs(expected).max())
    measured, innovation = m.noisy(predicted, rng).astype(dtype), np.zeros(len(m.noise), dtype)
    call["innovation"](at(measured), at(predicted), at(innovation))
    assert np.abs(innovation - m.innovation(measured, predicted)).max() <= limit * (1.0 + np.abs(predicted).max())


def test_innovations_of_poses_are_angles_and_noise_keeps_rotations() -> None:
    m = Measurement.of(TREE, "pose:tcp,gyroscope:tcp", noise={"pose": 0.01, "gyroscope": 0.5, "pose:tcp.x": 0.2})
    assert m.noise == (0.2, *(0.01,) * 5, *(0.5,) * 3)
    assert m.poses == ((0, 0),)
    assert not m.depends_on_acceleration
    rng, angle = np.random.default_rng(0), 0.3
    exact = np.concatenate([np.eye(3, 4).ravel(), [1.0, 2.0, 3.0]])
    turned = exact.copy()
    turned[:12].reshape(3, 4)[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    found = m.innovation(turned, exact)
    assert np.allclose(found, [0, 0, 0, 0, 0, 2 * np.tan(angle / 2), 0, 0, 0], atol=1e-15)
    assert np.allclose(m.innovation(exact, turned), -found, atol=1e-15)
    y = m.noisy(np.broadcast_to(turned, (20000, 15)), rng)
    R = y[:, :12].reshape(-1, 3, 4)[..., :3]
    assert np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max() <= 1e-14
    deviation = m.innovation(y, turned).std(axis=0)
    assert np.allclose(deviation, m.noise, rtol=0.03)
    assert np.array_equal(turned[9:12], exact[9:12])  # nothing was written to


def test_a_measurement_is_a_value() -> None:
    m = Measurement.of("one_link", "encoder:joint1.gamma, imu:link1", drift={"imu": 1e-3})
    assert pickle.loads(pickle.dumps(m)) == m
    assert m.biased == tuple(range(1, 7))
    assert m.depends_on_acceleration
    assert robot_of(record_of(m.robot)) == m.robot
    assert "sensors" not in record_of(eomgen.load_robot("one_link"))
    assert m.robot.rigid().sensors == ()
    assert [unit for _, unit in m.innovations] == ["rad", *["m/s^2"] * 3, *["rad/s"] * 3]
    assert parse_sensors("pose:tcp") == (Sensor("pose", "tcp"),)
    with pytest.raises(InputError, match=r"measured: got the shape \(3,\); allowed: \(\.\.\., 7\)"):
        m.innovation(np.zeros(3), np.zeros(7))


@pytest.mark.parametrize(
    ("robot", "sensors", "message"),
    [
        ("one_link", "", r"sensors: got ''; allowed: KIND:NAME"),
        ("one_link", [], r"sensors: none is there"),
        ("one_link", "camera:link1", r"'camera' is no sensor"),
        ("one_link", "encodr:joint1.gamma", r"'encodr' is no sensor; allowed: encoder, .*; did you mean 'encoder'"),
        (
            "one_link",
            "encoder:joint1.gama",
            r"'joint1.gama' is no coordinate; allowed: .*; did you mean 'joint1.gamma'",
        ),
        ("one_link", "imu:linc1", r"is no frame or link; allowed: 'tcp', 'link1', 'base'; did you mean 'link1'"),
        ("one_link", "imu:link1,imu:link1", r"imu:link1 stands twice; allowed: every sensor once"),
        ("one_link", [3], r"sensors: got 3; allowed: KIND:NAME"),
        ("four_bar", "torque:joint1.gamma", r"torque:joint1.gamma: loops and couplings carry part of it"),
        ("flexible_arm", "torque:upper.mode1", r"torque:upper.mode1: a mode carries no torque"),
        (HYSTERETIC, "torque:joint1.motor", r"torque:joint1.motor: the gear's law has states"),
    ],
)
def test_what_is_no_sensor_is_refused_by_name(robot: Robot | str, sensors: str, message: str) -> None:
    refused(InputError, message, Measurement.of, robot, sensors)


def test_noise_and_drift_are_refused_by_name() -> None:
    of_rod = "imu:link1,pose:link1"
    for options, error, message in (
        ({"noise": {"imu": 0.0}}, InputError, "imu:link1.fx has 0.0; allowed: above 0"),
        ({"noise": {"imu": -1.0}}, InputError, "imu has -1.0"),
        ({"noise": {"imu:link": 1.0}}, UnknownNameError, "noise: 'imu:link' is not measured; did you mean 'imu:link1'"),
        ({"drift": {"pose": 1.0}}, InputError, "pose:link1 is a pose, which has no bias"),
    ):
        refused(error, message, Measurement.of, "one_link", of_rod, **options)


def test_kernels_refuse_robots_without_sensors_and_sensors_of_nothing() -> None:
    with pytest.raises(InputError, match=r"'measurement' is for robots with sensors \(eomgen.control.Measurement\)"):
        eomgen.build("one_link", kernels=("measurement",))
    robot = replace(eomgen.load_robot("one_link"), sensors=(Sensor("imu", "nowhere"),))
    with pytest.raises(InputError, match=r"sensors of one_link: imu 'nowhere' is no frame or link"):
        answer(robot, "measurement", q=np.zeros(2), v=np.zeros(2), a=np.zeros(2))


@FUZZ
@given(st.text(max_size=40) | st.lists(st.sampled_from(PIECES), max_size=6).map("".join))
def test_any_text_is_sensors_or_refused(text: str) -> None:
    """In printable ASCII, with what is wrong."""
    try:
        m = Measurement.of(ROD, text)
    except InputError as error:
        check_message(error)
        return
    assert ",".join(sensor.name for sensor in m.sensors) == text.replace(" ", "")


def test_records_of_robots_with_sensors_of_nothing_are_refused() -> None:
    record = record_of(Measurement.of(ROD, "imu:tcp").robot)
    assert robot_from_record(record, "run.json").sensors == (Sensor("imu", "tcp"),)
    for key, value, message in (
        ("of", "nowhere", "'nowhere' is no frame or link"),
        ("kind", "eye", "'eye' is no sensor"),
    ):
        wrong = {**record, "sensors": [{"kind": "imu", "of": "tcp", key: value}]}
        refused(InputError, message, robot_from_record, wrong, "run.json")
