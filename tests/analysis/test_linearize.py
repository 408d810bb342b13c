"""A, B, C, D by differences of Pinocchio's dynamics; SciPy's responses and zero-order hold; shared options."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import scipy.integrate
import scipy.signal
from scipy.integrate import solve_ivp

import eomgen
from eomgen.analysis import StateOptions, compliance_map, deflection, linearize, modes, modes_along, response
from eomgen.analysis.discrete import zero_order_hold
from eomgen.analysis.frequency import h1, transfer_function
from eomgen.analysis.options import KERNELS, StateKeywords, prepared
from eomgen.analysis.ports import per_time
from eomgen.description.load import robot_from_toml
from eomgen.errors import ArrayError, InputError, UnknownNameError
from eomgen.integration.solve import integrate
from eomgen.robot.coordinates import force_unit_of, unit_of
from eomgen.robot.model import build_model
from eomgen.simulation.run import simulate
from tests.oracles.by_singular_values import ClosedLoops
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.commands import command, errors_of, facts
from tests.support.elastic_robots import random_elastic
from tests.support.optional import needs
from tests.support.oscillators import DAMPING, LOOP, MASS, STIFFNESS, chain
from tests.support.random_robots import Array, random_robot, random_state, seeds
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")

PARTS = ("x", "y", "z", "rx", "ry", "rz")
FORCES = ("fx", "fy", "fz", "mx", "my", "mz")


def slopes(function: object, at: Array, h: float = 1e-6) -> Array:
    columns = [(function(at + h * e) - function(at - h * e)) / (2 * h) for e in np.eye(len(at))]
    return np.array(columns).T


@pytest.mark.parametrize("seed", seeds(0, 1, 8))
def test_about_a_motion_of_random_robots(seed: int, built: Build) -> None:
    """All of A, B, C, D at a state with rates: by differences of Pinocchio's articulated body algorithm."""
    robot = random_robot(seed, joints=(2, 3), tree=seed % 2 == 0, types=("revolute", "prismatic", "fixed", "free"))
    oracle, kernel, s = PinocchioOracle(robot), built(robot, *KERNELS), random_state(robot, seed)
    n = kernel.n
    if np.linalg.cond(oracle.mass_matrix(s.q)) > 1e6:
        pytest.skip("a rod at a tip: differences say nothing")
    inputs = (*kernel.coordinates, *(f"tcp.{part}" for part in FORCES))
    outputs = (*kernel.coordinates, *(f"tcp.{part}" for part in PARTS))
    options = {"v": s.v, "u": s.u, "inputs": inputs, "outputs": outputs, "kernel": kernel}
    found = linearize(robot, s.q, **options)
    y = np.concatenate([s.q, s.v])

    def motion(x: Array) -> Array:
        return np.concatenate([x[n:], oracle.forward_dynamics(x[:n], x[n:], s.u)])

    expected = slopes(motion, y)
    assert pytest.approx(expected, rel=1e-5, abs=1e-6 * np.abs(expected).max()) == found.A
    assert found.a == pytest.approx(motion(y)[n:], rel=1e-8, abs=1e-8)
    minv = np.linalg.inv(oracle.mass_matrix(s.q))
    forces = np.hstack([np.eye(n), oracle.frame_jacobian(s.q, "tcp").T])
    assert pytest.approx(np.vstack([0 * (minv @ forces), minv @ forces]), abs=1e-8 * np.abs(minv).max()) == found.B
    seen = np.vstack([np.eye(n), oracle.frame_jacobian(s.q, "tcp")])
    assert pytest.approx(np.hstack([seen, 0 * seen]), abs=1e-10) == found.C
    rates = linearize(robot, s.q, kind="velocity", **options)

    def twist(x: Array) -> Array:
        return np.concatenate([x[n:], oracle.frame_jacobian(x[:n], "tcp") @ x[n:]])

    assert pytest.approx(slopes(twist, y), abs=1e-7) == rates.C
    assert not found.D.any()
    assert not rates.D.any()
    again = linearize(robot, s.q, v=s.v, a=found.a, inputs=inputs, outputs=outputs, kernel=kernel)
    assert pytest.approx(found.A, rel=1e-9, abs=1e-9 * np.abs(found.A).max()) == again.A
    assert again.u == pytest.approx(s.u, abs=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_poles_are_the_modes(seed: int, built: Build) -> None:
    robot = random_elastic(seed)
    kernel = built(robot, *KERNELS)
    options = {"drives": "pd", "kp": 700.0, "kd": 5.0, "kernel": kernel, "loads": {"tcp": [5.0, 4, 3, 2, 1, 0]}}
    found, known = linearize(robot, **options), modes(robot, **options)
    poles = np.linalg.eigvals(found.A)
    for s in known.eigenvalues:
        assert np.abs(poles - s).min() < 1e-7 * abs(s)
    assert found.states[: kernel.n] == kernel.coordinates
    assert found.states[kernel.n :] == tuple(f"{name}.rate" for name in kernel.coordinates)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", ["displacement", "velocity", "acceleration"])
@pytest.mark.filterwarnings("ignore:Badly conditioned filter", "ignore:invalid value encountered:RuntimeWarning")
def test_responses_are_scipys(seed: int, kind: str, built: Build) -> None:
    """scipy.signal takes the matrices as they are; freqresp of each input and output is the response.

    SciPy goes through polynomials, which cost it digits; the resolvent C (s - A)^-1 B + D does not.
    """
    robot = random_elastic(seed)
    kernel, driven = built(robot, *KERNELS), build_model(robot).driven
    inputs = [*(kernel.coordinates[i] for i in driven), "tcp.fx", "tcp.my"]
    outputs = [kernel.coordinates[-1], "tcp.y", "tcp.rz"]
    options = {"drives": "pd", "kp": 500.0, "kd": 4.0, "kernel": kernel, "kind": kind}
    hertz = np.geomspace(0.3, 300.0, 40)
    found = response(robot, inputs, outputs, hertz, **options)
    largest = np.abs(found.H).max()
    system = scipy.signal.StateSpace(*linearize(robot, inputs=inputs, outputs=outputs, **options).matrices)
    for i, x in enumerate(inputs):
        for j, y in enumerate(outputs):
            single = scipy.signal.StateSpace(system.A, system.B[:, [i]], system.C[[j]], system.D[[j]][:, [i]])
            _, expected = scipy.signal.freqresp(single, 2 * np.pi * hertz)
            assert np.abs(found.of(y, x) - expected).max() < 1e-4 * max(float(np.abs(expected).max()), 1e-4 * largest)
    resolvents = np.linalg.inv(2j * np.pi * hertz[:, np.newaxis, np.newaxis] * np.eye(len(system.A)) - system.A)
    exact = system.C @ resolvents @ system.B + system.D
    assert np.abs(found.H - exact).max() < 1e-9 * largest


def test_control_takes_the_matrices() -> None:
    control = needs("control")
    found = linearize(chain(3, damping=DAMPING), inputs=["tcp.fx"], outputs=["tcp.x"])
    poles = control.ss(*found.matrices).poles()
    assert np.sort_complex(poles) == pytest.approx(np.sort_complex(np.linalg.eigvals(found.A)))


def test_one_mass_has_its_closed_form() -> None:
    """H = 1 / (k - m w^2 + i w d); velocity and acceleration times i w and -w^2."""
    hertz = np.array([0.0, 1.0, 17.0, 20.13, 200.0])
    w = 2 * np.pi * hertz
    expected = 1.0 / (STIFFNESS - MASS * w**2 + 1j * w * DAMPING)
    for kind, factor in (("displacement", 1.0), ("velocity", 1j * w), ("acceleration", -(w**2))):
        found = response(chain(1, damping=DAMPING), ["tcp.fx", "j1.x"], ["tcp.x", "tcp.y"], hertz, kind=kind)
        assert found.of("tcp.x", "tcp.fx") == pytest.approx(factor * expected, rel=1e-12)
        assert found.of("tcp.x", "j1.x") == pytest.approx(factor * expected, rel=1e-12)
        assert not found.of("tcp.y", "tcp.fx").any()


@pytest.mark.soak
def test_a_long_harmonic_simulation_swings_as_the_response_says() -> None:
    """The whole, nonlinear worn-free arm under a small harmonic force, after its transient has died away."""
    robot = eomgen.load_robot("shaken_arm")
    joints = tuple(replace(j, coordinates={} if j.name == "mount" else j.coordinates) for j in robot.joints)
    robot = replace(robot, name="standing_arm", joints=joints)
    pose, gains = {"waist": 0.3, "shoulder": 0.4, "elbow": 0.7}, {"drives": "pd", "kp": 400.0, "kd": 20.0}
    hertz, size = 4.0, 0.2
    outputs = ["tcp.x", "tcp.z", "shoulder.beta"]
    found = response(robot, ["tcp.fz"], outputs, [hertz], pose, **gains)
    kernel = eomgen.build(robot)
    rest = linearize(robot, pose, **gains)
    driven, target, held = list(build_model(robot).driven), rest.q, rest.u

    def drive(t: float, q: Array, v: Array) -> Array:
        u = held + kernel.frame_jacobian(q, "tcp")[2] * size * np.sin(2 * np.pi * hertz * t)
        u[driven] -= 400.0 * (q - target)[driven] + 20.0 * v[driven]
        return u

    options = {"method": "scipy:Radau", "rtol": 1e-8, "output_step": 1 / 400}
    motion = integrate(kernel, target, np.zeros(kernel.n), 4.0, drive=drive, **options)
    last = motion.t >= 2.0 - 1e-9  # eight periods
    t, q = motion.t[last][:-1], motion.q[last][:-1]
    tool = kernel.frame_pose(q, "tcp")[:, :3, 3] - kernel.frame_pose(target, "tcp")[:3, 3]
    signals = (tool[:, 0], tool[:, 2], q[:, kernel.coordinates.index("shoulder.beta")])
    for name, values in zip(outputs, signals, strict=True):
        amplitude = 2j * np.mean(values * np.exp(-2j * np.pi * hertz * t)) / size  # of a sine
        assert amplitude == pytest.approx(found.of(name, "tcp.fz")[0], rel=2e-3)


@pytest.mark.soak
def test_h1_of_noise_is_the_response() -> None:
    """A linear oscillator under band-limited noise, integrated exactly by SciPy; noise in the motion averages out."""
    robot = chain(1, damping=30.0)
    model = linearize(robot, inputs=["tcp.fx"], outputs=["tcp.x"])
    rng, rate = np.random.default_rng(0), 1000.0
    b, a = scipy.signal.butter(4, 100.0, fs=rate)
    force = scipy.signal.lfilter(b, a, rng.standard_normal(200_000))
    t = np.arange(len(force)) / rate
    _, motion, _ = scipy.signal.lsim(scipy.signal.StateSpace(*model.matrices), force, t)
    motion = motion + 0.02 * motion.std() * rng.standard_normal(len(t))
    hertz, H, coherence = h1(t, force, motion, segment=4000)
    band = (hertz > 5.0) & (hertz < 50.0)
    expected = response(robot, ["tcp.fx"], ["tcp.x"], hertz[band]).of("tcp.x", "tcp.fx")
    assert np.abs(H[band] - expected).max() < 0.04 * np.abs(expected).max()
    assert np.median(np.abs(H[band] / expected - 1.0)) < 0.02
    assert coherence[band].min() > 0.5
    assert (coherence <= 1.0 + 1e-12).all()


def test_reciprocity_of_an_undamped_structure(built: Build) -> None:
    """Maxwell and Betti: without loads from one point to another is as from the other to the one."""
    robot = replace(random_elastic(3), gravity=(0.0, 0.0, 0.0))
    frames = ["tcp", robot.links[0].name]
    inputs, outputs = ([f"{frame}.{part}" for frame in frames] for part in ("fx", "x"))
    found = response(robot, inputs, outputs, [3.0, 40.0], kernel=built(robot, *KERNELS))
    assert pytest.approx(np.swapaxes(found.H, 1, 2), rel=1e-10, abs=1e-18) == found.H


@pytest.mark.soak
def test_loops_have_one_state_per_freedom(built: Build) -> None:
    """The slider-crank's A about its state of rest drives a nonlinear simulation's first second."""
    robot = robot_from_toml(LOOP)
    found = linearize(robot, {"turn.gamma": 2.5, "pin.gamma": -3.2, "guide.x": 0.25}, fixed=[], inputs=["turn.gamma"])
    assert len(found.states) == 2
    loops = ClosedLoops(eomgen.build(robot))
    name = found.states[0]
    index = loops.kernel.coordinates.index(name)
    push = 1e-3
    q0 = loops.consistent_positions(found.q + push * np.eye(3)[index], held=[name])
    motion = integrate(loops.kernel, q0, np.zeros(3), 0.3, step=1e-3)
    expected = [scipy.linalg.expm(found.A * t)[0, 0] * push for t in motion.t]
    assert np.abs(motion.of(name) - found.q[index] - expected).max() < 5e-3 * push
    rest = dict(zip(found.coordinates, found.q, strict=True))
    moved = [linearize(robot, rest, fixed=[], loads={"crank": [0] * 5 + [x]}) for x in (0.05, -0.05)]
    place = [loops.kernel.frame_pose(entry.q, "slider")[:3, 3] for entry in moved]
    frame = linearize(robot, rest, fixed=[], inputs=["turn.gamma"], outputs=["slider.x"])
    static = -frame.C @ np.linalg.solve(frame.A, frame.B)
    assert (place[0] - place[1])[0] / 0.1 == pytest.approx(static[0, 0], rel=1e-3)


def test_input_that_is_refused() -> None:
    robot = eomgen.load_robot("one_link")
    zero, resonance = np.zeros(2), np.sqrt(STIFFNESS / MASS) / (2 * np.pi)
    for call, kind, words in (
        (lambda: linearize(robot, kind="jerk"), InputError, "allowed: displacement, velocity, acceleration"),
        (lambda: linearize(robot, u=zero), InputError, "allowed: with v"),
        (lambda: linearize(robot, v=zero), InputError, "v and a, or v and u"),
        (lambda: linearize(robot, v=zero, a=zero, u=zero), InputError, "v and a, or v and u"),
        (lambda: linearize(robot, v=[1.0], a=zero), ArrayError, "v: expected float64"),
        (lambda: linearize(robot, v=[1.0, 0.0], a=zero, kind="acceleration"), InputError, "accelerations at rest"),
        (lambda: linearize(robot, inputs=["joint1.y"]), UnknownNameError, r"input: 'joint1\.y' is unknown.*tcp"),
        (lambda: linearize(robot, outputs=["tcp.fx"]), UnknownNameError, r"output: 'tcp\.fx'"),
        (lambda: linearize(robot, inputs=["joint1.gamma"], drives="locked"), InputError, "gamma does not move"),
        (lambda: response(robot, ["tcp.fx"], ["tcp.x"], []), ArrayError, "frequencies"),
        (lambda: response(robot, ["tcp.fx"], ["tcp.x"], [-1.0]), ArrayError, "frequencies"),
        (lambda: response(chain(1), ["tcp.fx"], ["tcp.x"], [resonance]), InputError, "inf"),
        (lambda: h1([0, 1, 2], [1, 2, 3], [1, 2]), ArrayError, "one shape"),
        (lambda: h1([0, 1, 3], [1, 2, 3], [1, 2, 3]), InputError, "constant step"),
        (lambda: h1([0, 1, 2], [1, 2, np.nan], [1, 2, 3]), ArrayError, "force: .* not finite"),
        (lambda: h1([0, 1, 2], [1, 2, 3], ["1", "2", "3"]), ArrayError, "motion: .*; allowed: finite numbers"),
        (lambda: h1(np.arange(9.0), np.ones(9), np.ones(9), segment=20), InputError, "segment: 20"),
    ):
        refused(kind, words, call)


def test_units() -> None:
    assert per_time(unit_of("tcp.rz"), "velocity") == "rad/s"
    assert per_time(unit_of("joint1.gamma"), "displacement") == "rad"
    assert per_time(unit_of("tcp.z"), "acceleration") == "m/s^2"
    names = ("joint1.gamma", "joint1.x", "tcp.fx", "tcp.mz")
    assert [force_unit_of(name) for name in names] == ["N m", "N", "N", "N m"]


@pytest.mark.soak
def test_commands(tmp_path: Path) -> None:
    pose = ("--pose", "elbow=0.5", "shoulder=0.2")
    plain = facts("linearize", "shaken_arm", *pose, "--to", "tcp.x", "-o", tmp_path / "arm.npz")
    direct = linearize(eomgen.load_robot("shaken_arm"), {"elbow": 0.5, "shoulder": 0.2}, outputs=["tcp.x"])
    with np.load(tmp_path / "arm.npz") as saved:
        for name in "ABCD":
            assert np.array_equal(saved[name], getattr(direct, name))
            assert plain[name] == getattr(direct, name).tolist()
        assert tuple(saved["states"]) == direct.states
    ports = ("--input", "tcp.fz", "waist.gamma", "--to", "tcp.z", "shoulder.beta", "--kind", "acceleration")
    gains = ("--drives", "pd", "--kp", 300, "--kd", "waist.gamma=3", "--points", 20)
    for name in ("r.csv", "r.npz", "r.svg"):
        assert "m/s^2 per N" in command("response", "shaken_arm", *pose, *ports, *gains, "-o", tmp_path / name)
    table = np.loadtxt(tmp_path / "r.csv", delimiter=",", skiprows=1)
    with np.load(tmp_path / "r.npz") as saved:
        assert table[:, 1] + 1j * table[:, 2] == pytest.approx(saved["H"][:, 0, 0], rel=1e-15)
    assert "frequency, Hz" in (tmp_path / "r.svg").read_text()
    robot = eomgen.load_robot("one_link")
    result = simulate(robot, duration=0.2)
    path, motion = result.save(tmp_path / "trajectory.npz"), result.trajectory
    plain = facts("linearize", "one_link", "--along", path, "--time", 0.1)
    k = int(np.abs(motion.t - 0.1).argmin())
    assert plain["A"] == linearize(robot, motion.q[k], v=motion.v[k], u=motion.u[k]).A.tolist()
    for words, said in (
        (("linearize", "one_link", "--along", path, "--time", 3), "allowed: 0 to 0.2"),
        (("linearize", "one_link", "--along", path, "--pose", 1), "both given"),
        (("linearize", "one_link", "-o", "a.csv"), "ends in .npz"),
        (("response", "one_link", "--frequencies", 5, 1), "0 < from < to"),
        (("response", "one_link", "-o", "a.txt"), "ends in .csv, .npz, .svg"),
    ):
        assert said in errors_of(*words)


# Bode responses and zero-order hold


@pytest.mark.parametrize("seed", range(6))
def test_random_systems_are_those_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    states, inputs, outputs = 2 * rng.integers(1, 5), rng.integers(1, 4), rng.integers(1, 4)
    A = rng.normal(size=(states, states)) * 10.0 ** rng.uniform(-1, 2)
    B, C, D = (rng.normal(size=x) for x in ((states, inputs), (outputs, states), (outputs, inputs)))
    dt = 10.0 ** rng.uniform(-3, -1)
    held = zero_order_hold(A, B, dt)
    expected = scipy.signal.cont2discrete((A, B, C, D), dt, method="zoh")
    for found, other in zip(held, expected, strict=False):
        assert np.abs(found - other).max() <= 1e-12 * np.abs(other).max()
    hertz = np.geomspace(0.1, 50.0, 9)
    H = transfer_function(A, B, C, D, hertz)
    for i in range(inputs):
        for o in range(outputs):
            _, single = scipy.signal.freqresp((A, B[:, [i]], C[[o]], D[[o]][:, [i]]), 2.0 * np.pi * hertz)
            assert np.abs(H[:, o, i] - single).max() <= 1e-9 * np.abs(single).max()


@pytest.mark.filterwarnings("ignore:Badly conditioned filter coefficients")
def test_of_a_robot() -> None:
    about = linearize(eomgen.load_robot("shaken_arm"), {"elbow": 0.5}, outputs=["tcp.x", "elbow.gamma"])
    bode = about.bode("elbow.gamma", ["tcp.x"])
    assert bode.inputs == ("elbow.gamma",)
    assert bode.outputs == ("tcp.x",)
    assert bode.H.shape == bode.magnitude.shape == bode.phase.shape == (400, 1, 1)
    A, B, C, D = about.matrices
    own = np.abs(np.linalg.eigvals(A)) / (2.0 * np.pi)
    ends = 0.1 * own[own > 1e-6 * own.max()].min(), 10.0 * own.max()
    assert bode.frequencies[[0, -1]] == pytest.approx(ends)
    assert np.ptp(np.diff(np.log(bode.frequencies))) < 1e-9
    i, o = about.inputs.index("elbow.gamma"), about.outputs.index("tcp.x")
    w, decibels, degrees = scipy.signal.bode((A, B[:, [i]], C[[o]], D[[o]][:, [i]]), 2.0 * np.pi * bode.frequencies)
    assert np.abs(w / 2.0 / np.pi - bode.frequencies).max() < 1e-9 * w.max()
    assert np.abs(20.0 * np.log10(bode.magnitude[:, 0, 0]) - decibels).max() < 1e-6
    turns = (np.degrees(bode.phase[:, 0, 0]) - degrees) / 360.0
    assert np.abs(turns - np.round(turns[0])).max() < 1e-6
    hertz = [1.0, 7.0]
    same = response("shaken_arm", ["elbow.gamma"], ["tcp.x"], hertz, {"elbow": 0.5}, drives="free")
    assert np.abs(about.bode("elbow.gamma", "tcp.x", hertz).H - same.H).max() <= 1e-8 * np.abs(same.H).max()

    dt = 2e-3
    discrete = about.discretize(dt)
    assert discrete.matrices[4] == dt
    for found, other in zip(discrete.matrices, scipy.signal.cont2discrete(about.matrices, dt)[:4], strict=False):
        assert np.abs(found - other).max() <= 1e-11 * max(1.0, np.abs(other).max())
    x, held = np.zeros(len(A)), np.random.default_rng(0).normal(size=(5, B.shape[1]))
    state = x
    for w_k in held:
        state = discrete.A @ state + discrete.B @ w_k
        moved = solve_ivp(lambda t, y, w_k=w_k: A @ y + B @ w_k, (0.0, dt), x, rtol=1e-11, atol=1e-14, method="Radau")
        x = moved.y[:, -1]
    assert np.abs(state - x).max() <= 1e-7 * np.abs(x).max()
    assert json.loads(json.dumps(discrete.as_dict()))["dt"] == dt
    assert "every 0.002 s" in str(discrete)
    inputs, outputs, largest = discrete.lines()[1:]
    assert inputs == f"  inputs: {', '.join(about.inputs)}"
    assert outputs == "  outputs: tcp.x, elbow.gamma (displacement)"
    growth = np.exp(dt * np.linalg.eigvals(A).real.max())
    assert float(largest.split()[2]) == pytest.approx(growth, rel=1e-5)


NO_TIMES = (0.0, -1.0, np.nan, np.inf, "fast", None, True)


def test_what_systems_refuse() -> None:
    about = linearize(eomgen.load_robot("one_link"), outputs=["joint1.gamma"])
    zero, one = np.zeros((1, 1)), np.eye(1)
    for call, kind, words in (
        *((lambda dt=dt: about.discretize(dt), InputError, "dt: .*allowed: a time above 0") for dt in NO_TIMES),
        (
            lambda: about.bode("joint1.gama"),
            UnknownNameError,
            r"input: 'joint1\.gama' is not in this system; did you mean",
        ),
        (lambda: about.bode(outputs=["tcp"]), UnknownNameError, "output: 'tcp' is not in this system; known: joint1"),
        (lambda: about.bode(3), InputError, "inputs: 3; allowed: a sequence of names"),
        (lambda: about.bode(frequencies=[-1.0]), ArrayError, "frequencies"),
        (lambda: transfer_function(zero, one, one, zero, np.zeros(1)), InputError, "bode: infinite at 0 Hz"),
    ):
        refused(kind, words, call)


# Options that all analyses about a state share


ANALYSES = {
    "modes": modes,
    "modes_along": lambda robot, **options: modes_along(robot, [{}], **options),
    "deflection": deflection,
    "response": lambda robot, **options: response(robot, ["joint1.x"], ["joint1.x"], [1.0], **options),
    "linearize": linearize,
    "compliance_map": lambda robot, **options: compliance_map(robot, [0, 0, 0], [1, 0, 0], [0, 1, 0], **options),
}
REFUSED = {
    "drives": ("soft", "drives: 'soft' is unknown; allowed: locked, free, pd"),
    "kp": (1.0, "kp and kd are gains of drives 'pd'"),
    "fixed": (["elbow"], "fixed: 'elbow' is unknown"),
    "loads": ({"hand": [0.0] * 6}, "frame: 'hand' is unknown"),
    "parameters": ({"gravity.w": 1.0}, "gravity.w"),
}


@pytest.mark.parametrize("option", REFUSED)
@pytest.mark.parametrize("analysis", ANALYSES)
def test_every_analysis_checks_every_option(analysis: str, option: str) -> None:
    value, message = REFUSED[option]
    refused(eomgen.InputError, message, ANALYSES[analysis], "one_link", **{option: value})


@pytest.mark.parametrize("analysis", ANALYSES)
def test_an_option_that_there_is_not_is_named(analysis: str) -> None:
    refused(TypeError, "unexpected keyword argument 'drive'", ANALYSES[analysis], "one_link", drive="pd")


def test_keywords_are_the_options() -> None:
    assert [field.name for field in fields(StateOptions)] == list(StateKeywords.__annotations__)


def test_a_kernel_serves_many_analyses() -> None:
    arm = prepared("one_link", parameters={"gravity.y": 0.0})
    again = prepared("one_link", kernel=arm.kernel, loads={"link1": [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]})
    assert again.kernel is arm.kernel
    assert again.kernel.parameters["gravity.y"] == 0.0
    assert again.loads["link1"].tolist() == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    with pytest.raises(eomgen.InputError, match="parameters and kernel are both set"):
        prepared("one_link", kernel=arm.kernel, parameters={"gravity.y": 0.0})
