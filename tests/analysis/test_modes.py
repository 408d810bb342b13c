"""Modes: textbook chains, SciPy's eigenvalues of Pinocchio's matrices, loops, motors, flexible links."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from scipy.linalg import eigh

import eomgen
from eomgen.analysis.at_rest import system_at_rest
from eomgen.analysis.frequency import h1
from eomgen.analysis.holding import fixation_of, pose_of
from eomgen.analysis.modal import modes, modes_along
from eomgen.analysis.options import KERNELS, checked_loads, kernel_of
from eomgen.analysis.statics import deflection
from eomgen.analysis.tangent_system import constraint_hessian, frame_hessian
from eomgen.description.load import robot_from_toml
from eomgen.errors import ArrayError, EomgenWarning, InputError, SingularError, UnknownNameError
from eomgen.integration.solve import integrate
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Frame, Joint, Link, Motor, Placement, Robot, Spring
from eomgen.simulation.run import simulate
from tests.oracles.by_singular_values import ClosedLoops
from tests.oracles.pinocchio_models import PinocchioOracle, numerical_tangents
from tests.support.beam_elements import Plane
from tests.support.builds import Build
from tests.support.commands import command, errors_of, facts
from tests.support.elastic_robots import random_elastic
from tests.support.oscillators import DAMPING, LOOP, MASS, STIFFNESS, chain
from tests.support.random_robots import Array, random_robot, seeds
from tests.support.refusals import refused
from tests.support.swinging import NEEDED

pytestmark = pytest.mark.usefixtures("unoptimised")


@pytest.mark.parametrize("n", [1, 3, 7])
def test_chain_of_masses_and_springs(n: int) -> None:
    """Fixed at one end: w_k = 2 sqrt(k/m) sin((2k - 1) pi / (2 (2n + 1))), shapes sin((2k - 1) j pi / (2n + 1))."""
    found = modes(chain(n))
    k, j = np.arange(1, n + 1), np.arange(1, n + 1)
    w = 2.0 * np.sqrt(STIFFNESS / MASS) * np.sin((2 * k - 1) * np.pi / (2 * (2 * n + 1)))
    assert found.frequencies == pytest.approx(w / (2 * np.pi), rel=1e-12)
    assert found.undamped == pytest.approx(w / (2 * np.pi), rel=1e-12)
    assert np.abs(found.damping_ratios).max() < 1e-12
    for mode, shape in zip(k, found.shapes, strict=True):
        place = np.cumsum(shape)  # of the masses: coordinates are relative
        expected = np.sin((2 * mode - 1) * j * np.pi / (2 * n + 1))
        expected /= np.sqrt(MASS * (expected @ expected))
        assert min(np.abs(place - expected).max(), np.abs(place + expected).max()) < 1e-10
    assert found.frame_shapes[:, 0] == pytest.approx(found.shapes.sum(axis=1), abs=1e-12)
    assert np.abs(found.frame_shapes[:, 1:]).max() < 1e-12
    rows = found.as_rows()
    table = {column.name: column.values for column in rows.columns}
    assert rows.values.tolist() == k.tolist()
    assert rows.about == {"robot": found.robot, "frame": "tcp"}
    assert table["frequency"] == pytest.approx(w / (2 * np.pi), rel=1e-12)
    assert table["damped_frequency"] == pytest.approx(w / (2 * np.pi), rel=1e-12)
    assert np.abs(table["eigenvalue"]) == pytest.approx(w, rel=1e-12)
    assert table["tcp.shape"][:, 0] == pytest.approx(table["shape"].sum(axis=1), abs=1e-12)


def test_free_chain_has_a_rigid_mode() -> None:
    """Free at both ends: w_k = 2 sqrt(k/m) sin(k pi / (2 n)), k from 0."""
    n = 5
    with pytest.warns(EomgenWarning, match=r"nothing holds j1\.x"):
        found = modes(chain(n, ends="free-free"))
    w = 2.0 * np.sqrt(STIFFNESS / MASS) * np.sin(np.arange(n) * np.pi / (2 * n))
    assert found.eigenvalues[0] == 0.0
    assert np.isnan(found.damping_ratios[0])
    assert found.frequencies == pytest.approx(w / (2 * np.pi), rel=1e-11)
    assert found.shapes[0] == pytest.approx([1.0 / np.sqrt(n * MASS), 0, 0, 0, 0], abs=1e-11)


@pytest.mark.parametrize("damping", [DAMPING, 2.0 * np.sqrt(STIFFNESS * MASS) * 1.5])
def test_damped_oscillator(damping: float) -> None:
    """s = -d w +- w sqrt(d^2 - 1) below and above critical damping."""
    found = modes(chain(1, damping=damping))
    w, ratio = np.sqrt(STIFFNESS / MASS), damping / (2.0 * np.sqrt(STIFFNESS * MASS))
    roots = np.sort_complex(np.roots([1.0, 2 * ratio * w, w * w]))
    if ratio < 1.0:
        assert found.eigenvalues == pytest.approx([roots[roots.imag > 0][0]], rel=1e-12)
        assert found.damping_ratios == pytest.approx([ratio], rel=1e-12)
        assert found.damped_frequencies == pytest.approx([w * np.sqrt(1 - ratio**2) / (2 * np.pi)], rel=1e-12)
    else:
        assert np.sort_complex(found.eigenvalues) == pytest.approx(roots, rel=1e-12)
        assert found.damping_ratios == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize("seed", seeds(0, 1, 8))
@pytest.mark.parametrize("drives", ["locked", "pd"])
def test_random_robots_against_pinocchio_and_scipy(seed: int, drives: str, built: Build) -> None:
    """Eigenvalues, Rayleigh quotients and mass-normalised shapes, at a loaded state, from Pinocchio's matrices."""
    robot = random_elastic(seed)
    oracle, kernel = PinocchioOracle(robot), built(robot, *KERNELS)
    rng = np.random.default_rng(seed)
    wrench, driven = rng.uniform(-20.0, 20.0, 6), list(build_model(robot).driven)
    gains = {"kp": 900.0, "kd": 7.0} if drives == "pd" else {}
    pose = dict(zip((kernel.coordinates[i] for i in driven), rng.uniform(-1.0, 1.0, len(driven)), strict=True))
    if drives == "locked" and len(driven) == kernel.n:
        pytest.skip("nothing but principal coordinates")
    found = modes(robot, pose, drives=drives, loads={"tcp": wrench}, kernel=kernel, **gains)
    free = [i for i in range(kernel.n) if drives == "pd" or i not in driven]
    bending = [i for i in range(kernel.n) if i not in driven]
    K, D, M = numerical_tangents(oracle, found.q, wrench, "tcp")
    zero = np.zeros(kernel.n)
    left = oracle.inverse_dynamics(found.q, zero, zero) - oracle.frame_jacobian(found.q, "tcp").T @ wrench
    assert np.abs(left[bending]).max(initial=0.0) < 1e-9
    assert [found.q[i] for i in driven] == pytest.approx(list(pose.values()))
    if drives == "pd":
        K[driven, driven] += 900.0
        D[driven, driven] += 7.0
    K, D, M = (part[np.ix_(free, free)] for part in (K, D, M))
    m = len(free)
    A = np.block([[np.zeros((m, m)), np.eye(m)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    expected = scipy.linalg.eigvals(A)
    mine = np.concatenate([found.eigenvalues, found.eigenvalues[found.eigenvalues.imag > 0].conj()])
    assert len(mine) == 2 * m
    for s in expected:
        assert np.abs(mine - s).min() < 1e-6 * max(1.0, abs(s))
    shapes = found.shapes[:, free]
    for s, shape in zip(found.eigenvalues, shapes, strict=True):
        terms = [factor * (shape.conj() @ part @ shape) for factor, part in ((s * s, M), (s, D), (1.0, K))]
        assert terms[0] / (s * s) == pytest.approx(1.0, rel=1e-8)
        assert abs(sum(terms)) < 1e-6 * max(map(abs, terms))
        square = shape @ M @ shape
        assert abs(square.imag) < 1e-8
        assert square.real > -1e-8
    J = oracle.frame_jacobian(found.q, "tcp")
    assert np.abs(found.frame_shapes - found.shapes @ J.T).max() < 1e-9 * np.abs(found.frame_shapes).max()
    pencil = scipy.linalg.eigvalsh(0.5 * (K + K.T), M)
    assert np.sign(found.undamped) * found.undamped**2 * 4 * np.pi**2 == pytest.approx(pencil, rel=1e-5, abs=1e-2)


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(0, 1, 10))
def test_second_derivatives_of_frames_are_those_of_pinocchio(seed: int, built: Build) -> None:
    robot = random_robot(seed, joints=(2, 4), tree=seed % 2 == 0, types=("revolute", "prismatic", "fixed", "free"))
    oracle, kernel = PinocchioOracle(robot), built(robot, *KERNELS)
    q, h = np.random.default_rng(seed).uniform(-1.0, 1.0, kernel.n), 1e-5
    ahead, behind = ([oracle.frame_jacobian(q + sign * h * e, "tcp") for e in np.eye(kernel.n)] for sign in (1, -1))
    numerical = np.moveaxis((np.array(ahead) - np.array(behind)) / (2 * h), 0, -1)
    assert np.abs(frame_hessian(kernel.frame_jacobian(q, "tcp")) - numerical).max() < 1e-8


def test_free_floating_robot_has_six_rigid_modes(built: Build) -> None:
    """Without gravity: one body on springs that carries another; the elastic frequencies are those of two bodies."""
    rng = np.random.default_rng(0)
    spring = {"z": Coordinate(stiffness=5e4)}
    links = tuple(Link(f"b{i}", m, (0.0, 0.0, 0.0), (0.2, 0.3, 0.4, 0.0, 0.0, 0.0)) for i, m in ((1, 3.0), (2, 1.5)))
    joints = (
        Joint("float", "base", "b1", "free", coordinates={c: Coordinate() for c in eomgen.robot.COORDINATES}),
        Joint("spring", "b1", "b2", "fixed", coordinates=spring),
    )
    robot = Robot("floating", (0.0, 0.0, 0.0), links, joints)
    pose = {f"float.{c}": x for c, x in zip(eomgen.robot.COORDINATES, rng.uniform(-0.8, 0.8, 6), strict=True)}
    with pytest.warns(EomgenWarning, match="nothing holds float"):
        found = modes(robot, pose)
    assert np.array_equal(found.eigenvalues[:6], np.zeros(6))
    assert found.frequencies[6:] == pytest.approx([np.sqrt(5e4 * (1 / 3.0 + 1 / 1.5)) / (2 * np.pi)], rel=1e-10)
    M = built(robot, "mass_matrix").mass_matrix(found.q)
    assert found.shapes.conj() @ M @ found.shapes.T == pytest.approx(np.eye(7), abs=1e-9)


def test_friction_makes_a_slow_pole_and_no_rigid_mode() -> None:
    """A heavily damped weak spring: s = -k/d far below the stiff mode's round-off in frequency."""
    robot = chain(2)
    weak = {"x": Coordinate(stiffness=1e-3, damping=1e3)}
    robot = replace(robot, joints=(replace(robot.joints[0], coordinates=weak), robot.joints[1]))
    found = modes(robot)
    assert found.eigenvalues[0] == pytest.approx(-1e-3 / 1e3, rel=1e-6)
    assert len(found.eigenvalues) == 3


def test_play_is_said_and_contact_is_stiff() -> None:
    """worn_arm rests on the lower end of its bearing: y is stiff, x floats."""
    with pytest.warns(EomgenWarning, match=r"shoulder\.x floats in its clearance"):
        found = modes(eomgen.load_robot("worn_arm"))
    y = found.q[found.coordinates.index("shoulder.y")]
    # k d with d = x - w / 2 carries the weight of all links (3.7 kg)
    assert 2e6 * (-y - 1e-4 - 0.5e-5) == pytest.approx(3.7 * 9.81, rel=1e-9)
    assert found.eigenvalues[0] == 0.0
    assert np.abs(found.shapes[0]).argmax() == found.coordinates.index("shoulder.x")


@pytest.mark.parametrize("held", [[], ["turn.gamma"]])
def test_slider_crank_is_an_oscillator_of_one_coordinate(held: list[str], built: Build) -> None:
    """Energy over the crank angle alone: frequency and damping from the second derivative of V and the inertia.

    With the crank held at the state a constant torque does it, and the mode is about that state.
    """
    robot = robot_from_toml(LOOP)
    found = modes(robot, {"turn.gamma": 0.9, "pin.gamma": -1.3, "guide.x": 0.4}, fixed=held, drives="free")
    kernel = built(robot, "energy", "mass_matrix")

    def place(angle: float) -> Array:
        other = np.arcsin(-0.2 * np.sin(angle) / 0.4)
        return np.array([angle, other - angle, 0.2 * np.cos(angle) + 0.4 * np.cos(other)])

    angle, h = float(found.q[0]), 1e-4
    assert found.q == pytest.approx(place(angle), abs=1e-10)
    V = [float(kernel.energy(place(angle + d * h), np.zeros(3))[1]) for d in (-1, 0, 1)]
    if held:
        assert angle == pytest.approx(0.9)
    else:
        assert abs(V[2] - V[0]) / (2 * h) < 1e-5
    rate = (place(angle + h) - place(angle - h)) / (2 * h)
    inertia = rate @ kernel.mass_matrix(found.q) @ rate
    stiffness, damping = (V[0] - 2 * V[1] + V[2]) / h**2, 8.0 * rate[2] ** 2
    roots = np.roots([inertia, damping, stiffness])
    mine = np.concatenate([found.eigenvalues, found.eigenvalues[found.eigenvalues.imag > 0].conj()])
    assert np.sort_complex(mine) == pytest.approx(np.sort_complex(roots), rel=1e-4)
    assert (stiffness > 0.0) == (not held)
    index = [found.coordinates.index(name) for name in ("turn.gamma", "pin.gamma", "guide.x")]
    assert (found.shapes[0][index] / found.shapes[0][index[0]]).real == pytest.approx(rate, abs=1e-6)


def test_constraint_hessian_is_the_derivative_of_the_jacobian() -> None:
    kernel = kernel_of(eomgen.load_robot("bennett"))
    q, h = np.array([0.4, -0.8, 1.1]), 1e-5
    J = kernel.functions.constraint_jacobian
    slopes = [(J(q + h * e) - J(q - h * e)) / (2 * h) for e in np.eye(3)]
    assert np.abs(constraint_hessian(kernel, q) - np.moveaxis(np.array(slopes), 0, -1)).max() < 1e-9


def test_redundant_loops_do_not_change_the_mode() -> None:
    """The four-bar linkage hangs down and swings; its redundant constraints leave one mode, as energies say."""
    robot = eomgen.load_robot("four_bar")
    found = modes(robot, {"joint1.gamma": 1.0, "joint2.gamma": 1.5, "joint3.gamma": 2.0}, fixed=[], drives="free")
    assert len(found.eigenvalues) == 1
    rate = found.shapes[0].real / found.shapes[0].real[0]
    kernel = eomgen.build(robot)
    loops = ClosedLoops(kernel)
    h = 1e-3
    V = []
    for d in (-1, 0, 1):
        q = loops.consistent_positions(found.q + d * h * rate, held=["joint1.gamma"])
        V.append(float(kernel.energy(q, np.zeros(3))[1]))
    w2 = (V[0] - 2 * V[1] + V[2]) / h**2 / (rate @ kernel.mass_matrix(found.q) @ rate)
    assert found.frequencies[0] == pytest.approx(np.sqrt(w2) / (2 * np.pi), rel=1e-4)


def test_tracks_cross_without_being_exchanged() -> None:
    """A beam whose load slides out, f = sqrt(k / (I + m z^2)) / 2 pi, beside an oscillator of one frequency."""
    beam = {"beta": Coordinate(stiffness=400.0)}
    masses, inertia = (("arm", 1.0), ("load", 2.0), ("other", 1.0)), (0.05, 0.05, 0.05, 0.0, 0.0, 0.0)
    links = tuple(Link(name, mass, (0.0, 0.0, 0.0), inertia) for name, mass in masses)
    joints = (
        Joint("bend", "base", "arm", "fixed", coordinates=beam),
        Joint("slide", "arm", "load", "prismatic", coordinates={"z": Coordinate()}),
        Joint("side", "base", "other", "fixed", coordinates={"x": Coordinate(stiffness=700.0)}),
    )
    robot = Robot("crossing", (0.0, 0.0, 0.0), links, joints)
    z = np.linspace(0.1, 1.0, 10)
    found = modes_along(robot, z[:, np.newaxis])
    falling = np.sqrt(400.0 / (0.1 + 2.0 * z**2)) / (2 * np.pi)
    constant = np.full(10, np.sqrt(700.0) / (2 * np.pi))
    assert falling[0] > constant[0]
    assert falling[-1] < constant[-1]
    expected = np.array([constant, falling]).T
    assert found.values("frequencies") == pytest.approx(expected, rel=1e-10)
    assert set(found.tracks[:, 0]) == {0, 1}
    assert "modes over 10 poses" in found.lines()[0]


def test_input_that_is_refused() -> None:
    robot = eomgen.load_robot("one_link")
    kernel = kernel_of(robot)
    for options, kind, words in (
        ({"drives": "loose"}, InputError, "allowed: locked, free, pd"),
        ({"drives": "pd"}, InputError, r"kp: drives 'pd' need it.*joint1\.gamma"),
        ({"drives": "pd", "kp": -1.0}, InputError, "at least 0"),
        ({"drives": "pd", "kp": {"joint1.x": 1.0}}, UnknownNameError, "has no drive"),
        ({"kp": 1.0}, InputError, "drives are 'locked'"),
        ({"fixed": ["joint9"]}, UnknownNameError, "fixed: 'joint9' is unknown"),
        ({"pose": [1.0, 2.0, 3.0]}, ArrayError, "expected 1 numbers"),
        ({"pose": [np.nan]}, InputError, "not finite"),
        ({"pose": {"joint2": 1.0}}, UnknownNameError, "pose: 'joint2'"),
        ({"loads": {"hand": [0] * 6}}, UnknownNameError, "'hand' is unknown"),
        ({"loads": {"tcp": [1.0]}}, ArrayError, "wrench at tcp"),
        ({"frame": "hand"}, UnknownNameError, "'hand' is unknown"),
        ({"parameters": {"gravity.w": 1.0}}, UnknownNameError, "gravity.w"),
        ({"parameters": {"gravity.x": 1.0}, "kernel": kernel}, InputError, "both set"),
    ):
        refused(kind, words, modes, robot, **options)
    refused(InputError, "poses: none; allowed", modes_along, robot, [])
    refused(InputError, "has not the coordinates", modes, eomgen.load_robot("shaken_arm"), kernel=kernel)
    pulled = {"tcp": [5.0, 1.0, 0.0, 0.0, 0.0, 0.0]}
    fixation = fixation_of(robot, kernel, "free", fixed=[])
    kernel.parameters["joints.joint1.x.stiffness"] = 0.0
    q, dead = pose_of(robot, kernel, None), checked_loads(kernel, pulled)
    refused(eomgen.IntegrationError, r"joint1\.x stays out of balance", system_at_rest, kernel, q, fixation, dead)


def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "scipy"]:
        monkeypatch.setitem(sys.modules, name, None)
    refused(InputError, r'pip install "eomgen\[sim\]"', modes_along, chain(2), [[0.0, 0.0]])
    refused(InputError, r'pip install "eomgen\[sim\]"', h1, [0, 1, 2], [1, 2, 3], [1, 2, 3])
    assert len(modes(chain(2)).eigenvalues) == 2  # NumPy alone


def test_command(tmp_path: Path) -> None:
    plain = facts("modes", "shaken_arm", "--pose", "elbow=0.5", "shoulder=0.2")
    direct = modes(eomgen.load_robot("shaken_arm"), {"elbow": 0.5, "shoulder": 0.2})
    assert [mode["frequency"] for mode in plain["modes"]] == pytest.approx(list(direct.frequencies))
    figure = tmp_path / "modes.svg"
    ends = ("--end-pose", 0.1, 1.0, 0.3, "--points", 4, "--drives", "pd", "--kp", 900)
    assert "over 4 poses" in command("modes", "shaken_arm", *ends, "-o", figure)
    assert "natural frequency, Hz" in figure.read_text()
    result = simulate(eomgen.load_robot("one_link"), duration=0.1)
    path = result.save(tmp_path / "trajectory.npz")
    plain = facts("modes", "one_link", "--along", path, "--points", 3)
    assert np.array(plain["q"])[:, 1] == pytest.approx(result.program_q[[0, 500, 1000], 0])
    # with the angle locked the rod's spring carries all of its mass, 1 kg, wherever it is
    assert plain["frequencies"] == pytest.approx(np.full((3, 1), np.sqrt(1e4) / (2 * np.pi)))
    command("modes", "one_link", "-o", figure)
    assert "shapes of the lowest modes" in figure.read_text()
    for words, said in (
        (("ur5", "--along", path, "--drives", "free"), "has not the coordinates of ur5"),
        (("one_link", "--pose", "x"), "is not a number"),
        (("one_link", "--end-pose", 1, "-o", "a.txt"), "ends in .svg"),
        (("one_link", "--set", "gravity.x"), "NAME=VALUE"),
        (("one_link", "--end-pose", 1, "--points", 0), "1 or more"),
    ):
        assert said in errors_of("modes", *words)


def test_inertia_that_is_missing_is_named() -> None:
    """A thin rod about its own axis; masses from grams to tons are no reason."""
    robot = eomgen.load_robot("one_link")
    joint = replace(robot.joints[0], type="fixed", coordinates={"alpha": Coordinate(stiffness=5.0)})
    refused(SingularError, r"joint1\.alpha: it moves no inertia", modes, replace(robot, joints=(joint,)))
    pair = chain(2)
    heavy, light = replace(pair.links[0], mass=1e5), replace(pair.links[1], mass=1e-4)
    found = modes(replace(pair, links=(heavy, light)))
    assert found.frequencies == pytest.approx(np.sqrt([STIFFNESS / 1e5, STIFFNESS / 1e-4]) / (2 * np.pi), rel=1e-6)


# Motors and springs between points


def geared() -> Robot:
    """A rod of 1 m and 3 kg behind a gear, turning about a vertical axis."""
    link = Link("rod", 3.0, (0.5, 0.0, 0.0), (0.0, 0.25, 0.25, 0.0, 0.0, 0.0))
    motor = Motor(2e-4, 80.0, Coordinate(stiffness=5e3))
    hinge = Joint("hinge", "base", "rod", "revolute", coordinates={"gamma": Coordinate()}, motor=motor)
    frames = (Frame("tip", "rod", Placement((1.0, 0.0, 0.0))),)
    return Robot("geared_rod", (0.0, 0.0, -9.81), (link,), (hinge,), frames)


def test_a_locked_motor_leaves_the_gears_resonance() -> None:
    """sqrt(k / J) with the motor locked; sqrt(k (1 / J + 1 / (J_m N^2))) and a rigid turn with it free."""
    robot, J, k, rotor = geared(), 1.0, 5e3, 2e-4 * 80.0**2
    locked = modes(robot, drives="locked")
    assert np.abs(locked.frequencies - np.sqrt(k / J) / (2 * np.pi)).max() <= 1e-10
    free = np.sort(modes(robot, drives="free").frequencies)
    assert np.abs(free - [0.0, np.sqrt(k * (1 / J + 1 / rotor)) / (2 * np.pi)]).max() <= 1e-9


def test_a_gear_gives_way_under_a_load() -> None:
    """A force across the rod's tip winds the gear up by F l / k; the motor stays at ratio times the pose."""
    found = deflection(geared(), 0.4, frame="tip", loads={"tip": [-10 * np.sin(0.4), 10 * np.cos(0.4), 0, 0, 0, 0]})
    gamma, motor = found.q
    assert found.coordinates == ("hinge.gamma", "hinge.motor")
    assert abs(motor - 80.0 * 0.4) <= 1e-12
    wound = gamma - 0.4
    assert 0.9 * 10.0 / 5e3 <= wound <= 10.0 / 5e3


def test_springs_between_points_hold_what_has_no_spring(built: Build) -> None:
    """A passive slider between two springs swings at sqrt(2 k / m), in the modes as in time."""
    robot = eomgen.load_robot("one_link")
    (joint,) = robot.joints
    joint = replace(joint, type="fixed", coordinates={"x": replace(joint.coordinates["x"], stiffness=None)})
    pulls = tuple(
        Spring(f"pull{i}", ("base", "link1"), ((end, 0.0, 0.0), (0.0, 0.0, 0.0)), stiffness=300.0, free_length=0.2)
        for i, end in enumerate((0.5, -0.5))
    )
    robot = replace(robot, joints=(joint,), springs=pulls, name="between", gravity=(0.0, 0.0, 0.0), tunable=())
    mass = robot.links[0].mass
    expected = np.sqrt(2 * 300.0 / mass) / (2 * np.pi)
    found = modes(robot)
    assert np.abs(found.frequencies - expected).max() <= 1e-9
    kernel = built(robot, *NEEDED)
    swing = integrate(kernel, [1e-4], [0.0], 1.0 / expected, rtol=1e-9)
    assert abs(swing.q[-1, 0] - 1e-4) <= 1e-8


# Flexible links


ELEMENTS, HUB, PAYLOAD = 12, (1.0, 0.1), (0.1, 0.0005)  # of each link; kg and kg m^2 of the elbow's hub and the load


def by_elements() -> np.ndarray:
    """Frequencies of flexible_arm in its plane with locked drives, Hz: its elbow is at 90 degrees.

    The upper arm bends, and the forearm, clamped to its tip, goes along with that and bends itself; neither stretches.
    """
    beam = eomgen.load_robot("flexible_arm").links[0].beam
    along, second = beam.density * beam.A, beam.density * beam.Iz
    plane = Plane(beam.E * beam.Iz, beam.shear[0] * beam.G * beam.A, along, second, beam.length)
    M1, K1 = plane.matrices(ELEMENTS)
    rows, element = 2 * ELEMENTS, plane.element(ELEMENTS)
    M2, K2 = np.zeros((2, rows + 2, rows + 2))
    for k in range(ELEMENTS):
        at = slice(2 * k, 2 * k + 4)
        M2[at, at] += element[0]
        K2[at, at] += element[1]
    M2[-2, -2] += PAYLOAD[0]
    M2[-1, -1] += PAYLOAD[1]
    # of the forearm's root only the rotation, that of the upper arm's tip
    M, K = np.zeros((2, 2 * rows, 2 * rows))
    M[:rows, :rows], K[:rows, :rows] = M1, K1
    shared = np.arange(rows - 1, 2 * rows)
    M[np.ix_(shared, shared)] += M2[1:, 1:]
    K[np.ix_(shared, shared)] += K2[1:, 1:]
    M[rows - 2, rows - 2] += HUB[0] + along * beam.length + PAYLOAD[0]
    M[rows - 1, rows - 1] += HUB[1]
    return np.sqrt(eigh(K, M, eigvals_only=True)) / (2.0 * np.pi)


def test_assembled_frequencies_are_those_of_finite_elements() -> None:
    """Six modes: both static shapes of each link, two eigenmodes of the forearm."""
    found = modes("flexible_arm")
    assert found.frequencies[:4] == pytest.approx(by_elements()[:4], rel=1e-4)


def test_energies_say_which_link_bends() -> None:
    """Potential energy is that of modal stiffness, without gravity in the plane; rigid bodies have kinetic alone."""
    robot = eomgen.load_robot("flexible_arm")
    for drives, rigid in (("locked", 0), ("free", 2)):
        found = modes(robot, drives=drives)
        bending = ((x, k, kind) for x in robot.links if x.modes for k, kind in enumerate(x.modes.names))
        K = {f"{x.name}.{kind}": x.modes.K[k][k] for x, k, kind in bending}
        stored = np.abs(found.shapes) ** 2 * [K.get(name, 0.0) for name in found.coordinates]
        shares = stored[rigid:] / stored[rigid:].sum(axis=1, keepdims=True)
        assert found.strain_energy[rigid:] == pytest.approx(shares, abs=1e-9)
        assert not found.strain_energy[:rigid].any()
        assert found.kinetic_energy.sum(axis=1) == pytest.approx(1.0, abs=1e-12)
        by_owner = found.by_owner()
        assert list(by_owner) == ["shoulder", "upper.modes", "elbow", "forearm.modes"]
        assert sum(by_owner.values())[rigid:] == pytest.approx(1.0)
    plain = found.as_dict()["modes"][2]
    assert plain["strain_energy"]["upper.modes"] == pytest.approx(by_owner["upper.modes"][2])
    assert "upper.modes 100 %" in found.lines()[5]
    assert "elbow 100 %" in found.lines()[3]
    refused(InputError, "energy: 'potential'; allowed: strain_energy, kinetic_energy", found.by_owner, "potential")
