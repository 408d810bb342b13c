"""Springs between points where kernels are used: measured motion, fits, simulations, loops, prescribed coordinates."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.analysis.structures import compare
from eomgen.bench.beside import bench
from eomgen.cli import entry as cli
from eomgen.codegen.closed_form.readable import readable_closed_form
from eomgen.codegen.closed_form.trace import closed_form
from eomgen.errors import InputError
from eomgen.identification.from_motion import forces
from eomgen.identification.stiffness.solve import fit
from eomgen.integration.solve import integrate
from eomgen.motion.files import motion_from_columns
from eomgen.pipeline.costs import robot_info
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Robot, Spring
from eomgen.simulation.run import simulate
from tests.oracles.by_singular_values import ClosedLoops
from tests.oracles.springs import SpringOracle, implicit_step
from tests.support.builds import Build
from tests.support.closeness import close
from tests.support.random_robots import random_robot, random_state, seeds
from tests.support.random_springs import sprung, with_springs
from tests.support.soak import soaked

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(2200, 1, 2))
def test_measured_motion(seed: int, built: Build, tmp_path: Path) -> None:
    """Drives, the springs' share of them, tensions and reactions are those of the oracle; columns hold them."""
    robot = sprung(seed, (2, 3), max_size=8, armature=False)
    kernel, oracle = built(robot, "inverse_dynamics", "reactions"), SpringOracle(robot)
    states = [random_state(robot, seed + i) for i in range(5)]
    columns = {"t": np.arange(5.0)}
    for i, name in enumerate(kernel.coordinates):
        for key, field in (("", "q"), (".rate", "v"), (".acceleration", "a")):
            columns[name + key] = np.array([getattr(s, field)[i] for s in states])
    found = forces(robot, motion_from_columns(columns, kernel.coordinates), kernel=kernel)
    drive = np.array([oracle.inverse_dynamics(s.q, s.v, s.a) for s in states])
    assert close(found.drive, drive)
    assert close(found.line, np.array([oracle.external(s.q, s.v) for s in states]))
    assert close(found.required, found.drive + found.spring + found.damper + found.line)
    bare = oracle.bodies
    own = np.array([bare.stiffness * s.q + bare.damping * s.v for s in states])
    assert close(found.required, np.array([bare.inverse_dynamics(s.q, s.v, s.a) for s in states]) - own)
    pairs = np.array([oracle.forces(s.q, s.v) for s in states])
    assert close(np.stack([found.lengths, found.tensions], axis=2), pairs)
    assert close(found.reactions, np.array([oracle.reactions(s.q, s.v, s.a) for s in states]))
    assert any(line.startswith("spring1 ") for line in found.lines())
    with found.save(tmp_path / "forces.csv").open(encoding="ascii", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert float(rows[2]["spring2.tension"]) == found.tensions[2, 1]
    assert float(rows[1][f"{kernel.coordinates[0]}.line"]) == found.line[1, 0]
    worst = np.abs(found.tensions[:, 0]).argmax()
    assert found.as_dict()["springs"]["spring1"]["tension"]["value"] == found.tensions[worst, 0]


def test_fits_know_springs(built: Build) -> None:
    """Stiffness and damping of the joints from a motion under springs; without the springs nothing is found."""
    robot = eomgen.load_robot("balanced_arm")
    robot = replace(robot, springs=robot.springs[:2])
    kernel = built(robot, "rollout", "forward_dynamics")
    t = np.arange(4001) * 1e-3
    u = np.stack([1.5 * np.sin(3.0 * t), 60.0 * np.sin(40.0 * t), np.cos(2.0 * t)], axis=1)
    held = np.repeat(u[:-1], 10, axis=0)
    q, v = kernel.rollout(np.zeros(3), np.zeros(3), held, dt=1e-4, steps=40_000, every=10)
    a = kernel.forward_dynamics(q, v, u)
    columns = {"t": t}
    for i, name in enumerate(kernel.coordinates):
        columns |= {name: q[:, i], f"{name}.rate": v[:, i], f"{name}.acceleration": a[:, i], f"{name}.drive": u[:, i]}
    motion = motion_from_columns(columns, kernel.coordinates)
    found, blind = fit(robot, motion), fit(replace(robot, name="blind", springs=()), motion)
    truth = {"shoulder.gamma": (None, 0.2), "elbow.alpha": (2e4, 2.0), "elbow.gamma": (None, 0.1)}
    for name, (stiffness, damping) in truth.items():
        assert found[name].damping.value == pytest.approx(damping, rel=1e-3)
        if stiffness is not None:
            assert found[name].stiffness.value == pytest.approx(stiffness, rel=1e-3)
    for name in ("shoulder.gamma", "elbow.gamma"):
        estimate = blind[name].damping
        assert estimate.low < 0.0 < estimate.high


@pytest.mark.soak
def test_loops_carry_springs(built: Build) -> None:
    """Accelerations are those with the spring's generalized force as drives; energy stays."""
    robot = eomgen.load_robot("four_bar")
    links = [link.name for link in robot.links]
    spring = Spring("s", ("base", links[1]), ((0.1, 0.5, 0.0), (0.2, 0.1, 0.0)), free_length=0.2, stiffness=80.0)
    sprung_bar = replace(robot, springs=(spring,))
    with_it, without = (
        ClosedLoops(built(r, "constraint", "constraint_jacobian", "constraint_bias", "cut_poses", "mass_matrix",
                          "inverse_dynamics", "energy", "constrained_dynamics", "residual"))
        for r in (sprung_bar, robot)
    )  # fmt: skip
    n = with_it.kernel.n
    q = with_it.consistent_positions(np.array([0.8, *np.zeros(n - 1)]), held=[with_it.kernel.coordinates[0]])
    v = with_it.consistent_velocities(q, np.array([1.0, *np.zeros(n - 1)]), held=[with_it.kernel.coordinates[0]])
    found = with_it.forward_dynamics(q, v, np.zeros(n))
    expected = without.forward_dynamics(q, v, SpringOracle(sprung_bar).external(q, v))
    assert close(found.a, expected.a)
    assert close(found.multipliers, expected.multipliers)
    assert np.abs(found.a - without.forward_dynamics(q, v, np.zeros(n)).a).max() > 0.1
    motion = integrate(with_it.kernel, q, v, 1.0, rtol=1e-9)
    assert np.ptp(motion.energy[:, 0]) > 0.1
    assert np.ptp(motion.energy.sum(axis=1)) <= 1e-8 * np.ptp(motion.energy[:, 0])


def prescribed_robot(seed: int) -> tuple[Robot, np.ndarray]:
    """A random robot with about a third of its coordinates prescribed, and where these are."""
    rng = np.random.default_rng(seed)
    robot = random_robot(seed, joints=(3, 3), tree=seed % 2 == 0)
    joints = []
    for joint in robot.joints:
        table = {k: replace(c, prescribed=bool(rng.random() < 0.35)) for k, c in joint.coordinates.items()}
        joints.append(replace(joint, coordinates=table))
    given = np.array([c.prescribed for j in joints for c in j.coordinates.values()])
    return with_springs(replace(robot, joints=tuple(joints)), seed), given


@pytest.mark.soak
@pytest.mark.parametrize("seed", soaked((2210, 2211, 2212), (2210,)))
def test_prescribed_coordinates(seed: int, built: Build) -> None:
    """Accelerations balance the free rows of the oracle, and linearly implicit steps those of the formula."""
    robot, given = prescribed_robot(seed)
    assert 0 < given.sum() < given.size
    kernel = built(robot, "forward_dynamics", "rollout", "mass_matrix", "bias_force", "generalized_force")
    oracle, s = SpringOracle(robot), random_state(robot, seed)
    a = kernel.forward_dynamics(s.q, s.v, s.u)
    assert np.array_equal(a[given], s.u[given])
    assert close(oracle.inverse_dynamics(s.q, s.v, a)[~given], s.u[~given], 1e-9)
    dt = 0.01
    expected = s.v + dt * implicit_step(robot, kernel, s.q, s.v, s.u, dt, given)
    _, vs = kernel.rollout(s.q, s.v, s.u, dt, 1, method="implicit")
    assert close(vs[-1], expected, 1e-6)


@pytest.mark.soak
def test_simulation_of_the_built_in_arm() -> None:
    """Its drives carry hardly any weight of the upper arm, and the cable ends its reach."""
    robot = eomgen.load_robot("balanced_arm")
    kernel = eomgen.build(robot, kernels=("inverse_dynamics", "forward_dynamics", "energy", "mass_matrix"))
    still = np.zeros(3)
    for angle in np.linspace(-1.5, 1.5, 7):
        q = np.array([angle, 0.0, 2.0])
        weight = 1.5 * 9.81 * 0.12 * np.cos(angle + 2.0)  # of the fore arm about the elbow
        assert kernel.inverse_dynamics(q, still, still)[0] == pytest.approx(weight, abs=1e-9)
    names = list(kernel.springs)
    assert names == ["balance", "tendon", "stop"]
    bent, out = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 0.1])
    assert kernel.functions.spring_forces(bent, still)[2, 1] == 0.0
    assert kernel.functions.spring_forces(out, still)[2, 1] > 1000.0
    motion = integrate(kernel, [0.3, 0.0, 1.2], [0.0, 0.0, -6.0], 0.6)
    pairs = kernel.functions.spring_forces(motion.q, motion.v)
    assert pairs[:, 2, 1].max() > 100.0
    assert pairs[:, 2, 0].max() < 0.63
    energy = motion.energy.sum(axis=1)
    assert np.max(np.diff(energy)) <= 1e-4 * np.ptp(energy)
    result = simulate(robot, duration=0.5)
    assert np.abs(result.tool_deviation).max() < 5e-3
    twin = replace(robot, name="bare_arm", springs=())
    entries = compare([robot, twin], duration=3.0, goal=[1.0, 1.5]).entries
    assert entries[0].drives["shoulder.gamma"] < 0.5 * entries[1].drives["shoulder.gamma"]


def test_information(capsys: pytest.CaptureFixture[str]) -> None:
    facts = robot_info(eomgen.load_robot("balanced_arm"))
    assert "cable stop from base to fore: free_length 0.62, stiffness 2e+05" in "\n".join(facts.lines())
    assert facts.as_dict()["springs"][0] == {
        "name": "balance", "links": ["base", "upper"], "tension_only": False, "stiffness": 392.4,
    }  # fmt: skip
    assert cli.main(["info", "balanced_arm"]) == 0
    assert "spring tendon from upper to fore" in capsys.readouterr().out


def test_what_knows_no_springs_refuses_them(capsys: pytest.CaptureFixture[str]) -> None:
    robot = eomgen.load_robot("balanced_arm")
    model = build_model(robot)
    for derive in (closed_form, readable_closed_form):
        with pytest.raises(InputError, match=r"knows no springs between points \(balance, tendon, stop\)"):
            derive(model)  # type: ignore[operator]
    timed = bench(robot, repeat=1, kernels=("inverse_dynamics",))
    assert "know no springs between points (balance, tendon, stop): kernels are timed alone" in timed.note
    assert timed.error is None
    assert cli.main(["derive", "balanced_arm"]) == 1
    assert "springs between points" in capsys.readouterr().err


def test_a_robot_with_a_spring_alone_integrates_implicitly(built: Build) -> None:
    """auto's choice follows run-time parameters: Radau with the spring, DOP853 once its stiffness is 0."""
    robot = eomgen.load_robot("balanced_arm")
    joints = tuple(
        replace(j, coordinates={k: Coordinate(armature=0.02) for k in j.coordinates if k == "gamma"})
        for j in robot.joints
    )
    kernel = built(
        replace(robot, name="one_spring", joints=joints, springs=robot.springs[:1]),
        "forward_dynamics", "inverse_dynamics", "mass_matrix", "energy",
    )  # fmt: skip
    assert integrate(kernel, [0.1, 0.2], [0.0, 0.0], 0.05).method == "scipy:Radau"
    kernel.parameters["springs.balance.stiffness"] = 0.0
    assert integrate(kernel, [0.1, 0.2], [0.0, 0.0], 0.05).method == "scipy:DOP853"


@pytest.mark.soak
def test_springs_between_links_that_motors_drive(built: Build) -> None:
    """Transmissions and springs couple different coordinates; steps that get shorter go to the exact motion."""
    robot = eomgen.load_robot("geared_arm")
    spring = Spring("balance", ("column", "upper"), ((0.0, 0.0, 0.3), (0.2, 0.0, 0.0)), stiffness=800.0, damping=5.0)
    robot = replace(robot, springs=(spring,), name="balanced_gears")
    kernel = built(robot, "forward_dynamics", "residual", "rollout")
    rng = np.random.default_rng(3)
    q = np.zeros(kernel.n)
    v, u = 0.3 * rng.normal(size=kernel.n), 0.02 * rng.normal(size=kernel.n)
    a = kernel.forward_dynamics(q, v, u)
    assert np.abs(kernel.residual(q, v, a, u)).max() <= 1e-9 * np.abs(a).max()
    exact, _ = kernel.rollout(q, v, u, 1e-5, 2000, every=2000)
    errors = [
        np.abs(kernel.rollout(q, v, u, 0.02 / n, n, method="implicit", every=n)[0][-1] - exact[-1]).max()
        for n in (500, 1000, 2000)
    ]
    assert errors[1] <= 0.6 * errors[0]
    assert errors[2] <= 0.6 * errors[1]
