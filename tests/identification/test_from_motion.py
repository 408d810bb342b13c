"""Forces of measured motions against Pinocchio; stiffness and damping recovered from its noisy simulations."""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.signal import savgol_filter

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError
from eomgen.identification.closed_motions import closed_motion
from eomgen.identification.from_motion import forces
from eomgen.identification.stiffness.result import FitResult
from eomgen.identification.stiffness.solve import fit
from eomgen.motion import write_motion
from eomgen.motion.files import motion_from_columns
from eomgen.motion.smoothing import Differentiator, local_polynomials, noise_deviation
from eomgen.pipeline.mechanisms import mechanism_kernels
from eomgen.robot.model import build_model
from tests.loops.test_elastic_cuts import linkages
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.commands import command, facts
from tests.support.joint_table import joint_table, link_table, loop_table
from tests.support.measurements import columns_of, motion_of
from tests.support.random_robots import random_robot
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]

ARM = f"""
name = "arm"
{link_table("upper", 4.0, (0.3, 0.02, 0.01), (0.02, 0.15, 0.16))}
{link_table("fore", 2.0, (0.2, 0.0, 0.03), (0.01, 0.05, 0.05))}
{joint_table("shoulder", "base", "upper", "revolute")}
x = {{ stiffness = 2e5, damping = 100.0 }}
alpha = {{ stiffness = 400.0, damping = 4.0 }}
gamma = {{ damping = 0.8 }}
{joint_table("elbow", "upper", "fore", "revolute")}
placement = {{ xyz = [0.6, 0.0, 0.0] }}
y = {{ stiffness = 8e4, damping = 70.0 }}
beta = {{ stiffness = 900.0, damping = 2.0 }}
gamma = {{ stiffness = 20.0, damping = 0.3 }}
"""


def smooth_motion(t: Array, n: int, seed: int) -> tuple[Array, Array, Array]:
    """Sums of sines with their exact derivatives, (T, n) each."""
    rng = np.random.default_rng(seed)
    w, phase = rng.uniform(1.0, 8.0, (3, n)), rng.uniform(0.0, 6.0, (3, n))
    size = rng.uniform(0.02, 0.15, (3, n))
    angle = t[:, None, None] * w + phase
    q = (size * np.sin(angle)).sum(axis=1)
    return q, (size * w * np.cos(angle)).sum(axis=1), -(size * w**2 * np.sin(angle)).sum(axis=1)


@pytest.mark.parametrize("seed", range(4))
def test_forces_of_random_robots_are_those_of_pinocchio(seed: int, built: Build) -> None:
    """From samples of the coordinates alone, at uneven times; every force, and every support reaction."""
    robot = random_robot(seed, joints=(2, 3), max_size=8, tree=seed == 2, armature=False)
    oracle, kernel = PinocchioOracle(robot), built(robot, "inverse_dynamics", "reactions")
    t = np.linspace(0.0, 1.0, 401) + 2e-4 * np.random.default_rng(seed).uniform(-1, 1, 401)
    q, v, a = smooth_motion(t, kernel.n, seed)
    found = forces(robot, motion_of(kernel.coordinates, t, q), kernel=kernel)
    rows = range(0, 401, 25)
    expected = np.array([oracle.inverse_dynamics(q[i], v[i], a[i]) for i in rows])
    size = np.abs(expected).max()
    assert np.abs(found.drive[list(rows)] - expected).max() < 2e-4 * size
    assert np.abs(found.spring[list(rows)] + oracle.stiffness * q[list(rows)]).max() < 1e-6 * size
    assert np.abs(found.damper[list(rows)] + oracle.damping * v[list(rows)]).max() < 1e-4 * size
    assert np.allclose(found.required, found.drive + found.spring + found.damper)
    support = np.array([oracle.reactions(q[i], v[i], a[i]) for i in rows])
    assert np.abs(found.reactions[list(rows)] - support).max() < 2e-4 * np.abs(support).max()
    assert "degree 4 through 11 samples" in found.notes[0]


def test_given_rates_and_accelerations_are_taken_as_they_are(built: Build) -> None:
    robot = eomgen.load_robot("one_link")
    kernel, oracle = built(robot, "inverse_dynamics", "reactions"), PinocchioOracle(robot)
    t = np.linspace(0.0, 1.0, 11)
    q, v, a = smooth_motion(t, 1, 0)
    columns = columns_of(("joint1.gamma",), t, q, v, a)
    found = forces(robot, motion_from_columns(columns, kernel.coordinates), kernel=kernel)
    for i in range(11):
        state = (np.array([0.0, row[i, 0]]) for row in (q, v, a))
        assert np.allclose(found.drive[i], oracle.inverse_dynamics(*state), rtol=1e-12, atol=1e-12)
    assert found.notes == ("rates and accelerations: from the file", "not in the file, held at zero: joint1.x")


def test_local_polynomials_are_savitzky_and_golays() -> None:
    t = np.arange(60) * 0.01
    x = np.random.default_rng(0).standard_normal((60, 3))
    found = local_polynomials(t, x, 9, 4)
    for order, values in enumerate(found):
        expected = savgol_filter(x, 9, 4, deriv=order, delta=0.01, axis=0, mode="interp")
        assert np.allclose(values, expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())
    uneven = np.sort(np.random.default_rng(1).uniform(0.0, 1.0, 40))
    cubic = np.polynomial.Polynomial([1.0, -2.0, 3.0, 4.0])
    x, dx, ddx = local_polynomials(uneven, cubic(uneven)[:, None], 7, 3)
    assert np.allclose(x[:, 0], cubic(uneven))
    assert np.allclose(dx[:, 0], cubic.deriv()(uneven))
    assert np.allclose(ddx[:, 0], cubic.deriv(2)(uneven), atol=1e-6)
    for window, degree in ((8, 4), (5, 5), (61, 4), (9, 1)):
        refused(InputError, "allowed", local_polynomials, t, np.zeros((60, 1)), window, degree)


def test_the_filter_keeps_a_linear_law_and_the_noise_is_seen() -> None:
    t = np.arange(400) * 1e-3
    x = np.exp(-3.0 * t) * np.sin(150.0 * t)
    differentiator = Differentiator(10, 1e-3)
    q, v, a = (differentiator(x[:, None], order)[:, 0] for order in range(3))
    assert np.abs(a + 6.0 * v + (150.0**2 + 9.0) * q).max() < 1e-6 * np.abs(a).max()
    noise = np.random.default_rng(0).normal(0.0, [0.1, 0.02], (400, 2))
    assert noise_deviation(x[:, None] + noise) == pytest.approx([0.1, 0.02], rel=0.15)


def drives(t: float) -> list[float]:
    """What motors and shakers give in the arm's six coordinates."""
    shoulder = 12 * np.sin(5 * t) + 25 * np.sin(37 * t) + 10 * np.sin(90 * t)
    elbow = 8 * np.sin(3 * t + 1) + 9 * np.sin(51 * t) + 5 * np.sin(150 * t)
    sweeps = [(15, 20, 25), (6, 5, 8), (10, 30, 30), (6, 5, 13)]
    x, alpha, y, beta = (size * np.sin(w * t + rise * t**2) for size, w, rise in sweeps)
    return [x, alpha, shoulder, y, beta, elbow]


@cache
def experiment() -> tuple[Array, Array, Array]:
    """Times, coordinates and drives of the arm by Pinocchio and SciPy: motors swing it, shakers sweep its joints."""
    oracle = PinocchioOracle(robot_from_toml(ARM))

    def slope(t: float, x: Array) -> Array:
        return np.concatenate([x[6:], oracle.forward_dynamics(x[:6], x[6:], np.array(drives(t)))])

    t = np.arange(12001) * 5e-4
    solution = solve_ivp(slope, (0.0, t[-1]), np.zeros(12), "DOP853", t, rtol=1e-9, atol=1e-12)
    assert solution.success
    return t, solution.y[:6].T, np.array([drives(time) for time in t])


def noisy_fit(seed: int, kernel: eomgen.Kernel, level: float) -> FitResult:
    """The fit to the experiment with white noise: ``level`` of each deviation's spread, 1e-5 rad on the encoders."""
    t, q, u = experiment()
    encoder = np.array([name.endswith("gamma") for name in kernel.coordinates])
    noise = np.where(encoder, 1e-5 if level else 0.0, level * q.std(axis=0))
    samples = q + noise * np.random.default_rng(seed).standard_normal(q.shape)
    return fit(robot_from_toml(ARM), motion_of(kernel.coordinates, t, samples, u=u), kernel=kernel)


def errors(result: FitResult) -> dict[str, float]:
    """Relative error of every parameter."""
    robot = robot_from_toml(ARM)
    found = {}
    for name, value in result.parameters.items():
        _, joint, coordinate, key = name.split(".")
        found[name] = value / getattr(robot.joint(joint).coordinates[coordinate], key) - 1.0
    return found


def test_parameters_are_recovered_from_a_noisy_experiment(built: Build) -> None:
    """Noise of 0.5 percent of each deviation's spread: all within 2 percent, and the intervals hold the truth."""
    kernel = built(robot_from_toml(ARM), "inverse_dynamics", "mass_matrix")
    exact = errors(noisy_fit(0, kernel, 0.0))
    assert len(exact) == 11
    assert max(map(abs, exact.values())) < 1e-3
    held = []
    for seed in range(5):
        result = noisy_fit(seed, kernel, 0.005)
        found = errors(result)
        assert len(found) == 11
        assert max(map(abs, found.values())) < 0.02, found
        for entry in result.fitted:
            for estimate in filter(None, (entry.stiffness, entry.damping)):
                rest = 1e-4 * estimate.described  # what noise does through squares of rates is not in the interval
                held.append(estimate.low - rest <= estimate.described <= estimate.high + rest)
    assert len(held) == 55
    assert np.mean(held) >= 0.87  # 95 percent, less what chance takes from 55 that partly hang together


def test_errors_in_variables_are_taken_off(built: Build) -> None:
    """Noise of 10 percent, mean over seeds: no stiffness is biased by more than 1 percent."""
    kernel = built(robot_from_toml(ARM), "inverse_dynamics", "mass_matrix")
    found = [errors(noisy_fit(seed, kernel, 0.1)) for seed in range(6)]
    for name in ("shoulder.x", "shoulder.alpha", "elbow.y", "elbow.beta"):
        values = [one[f"joints.{name}.stiffness"] for one in found]
        assert abs(np.mean(values)) < 0.01, (name, values)


def test_samples_at_unequal_times_are_resampled(built: Build) -> None:
    """A third of the samples left out at random: with a note, and the numbers of the description."""
    kernel = built(robot_from_toml(ARM), "inverse_dynamics", "mass_matrix")
    t, q, u = experiment()
    kept = np.cumsum(np.random.default_rng(2).choice([1, 2], 2 * len(t) // 3))
    kept = kept[kept < len(t)]
    found = fit(robot_from_toml(ARM), motion_of(kernel.coordinates, t[kept], q[kept], u=u[kept]), kernel=kernel)
    assert max(map(abs, errors(found).values())) < 1e-3
    (note,) = (note for note in found.notes if "resampled" in note)
    assert "intervals from 0.5 to 1 ms, resampled to 0.74" in note


def test_what_cannot_be_fitted_is_said(built: Build) -> None:
    robot = robot_from_toml(ARM)
    kernel = built(robot, "inverse_dynamics", "mass_matrix")
    t, q, u = experiment()
    names = kernel.coordinates
    columns = {"t": t, **dict(zip(names, q.T, strict=True)), "elbow.gamma.drive": u[:, 5]}
    columns["elbow.y"] = 1e-6 * np.random.default_rng(0).standard_normal(len(t))
    del columns["shoulder.x"]
    warnings = "\n".join(fit(robot, motion_from_columns(columns, names), kernel=kernel).warnings)
    assert "shoulder.x was not measured" in warnings
    assert "elbow.y does not move enough" in warnings
    assert "shoulder.gamma is a principal coordinate, and its drive is not known" in warnings
    only = fit(robot, motion_from_columns(columns, names), coordinates=["elbow.gamma"], kernel=kernel)
    assert [entry.coordinate for entry in only.fitted] == ["elbow.gamma"]
    with pytest.raises(InputError, match=r"elbow\.y.*was not fitted"):
        only["elbow.y"]
    short = {name: values[:50] for name, values in columns.items()}
    for given, change, words in (
        (columns, {"coordinates": ["elbow.gama"]}, "elbow.gamma"),
        (columns, {"confidence": 1.0}, "between 0 and 1"),
        (short, {}, "50 samples; a fit needs at least"),
        (columns | {"t": t + 2e-3 * (t > t[99])}, {}, "sample 100 is at .* for a fit: intervals from 0.0001429 to"),
        (columns | {"t": t - 4e-4 * (t > t[99])}, {}, "sample 100 is at .* a file without gaps"),
    ):
        refused(InputError, words, fit, robot, motion_from_columns(given, names), kernel=kernel, **change)


def test_commands(tmp_path: Path) -> None:
    robot, motion = tmp_path / "arm.toml", tmp_path / "m.csv"
    robot.write_text(ARM)
    t, q, u = (x[:2000] for x in experiment())
    write_motion(motion, motion_of(build_model(robot_from_toml(ARM)).coordinates, t, q, u=u))
    target = tmp_path / "out" / "forces.csv"
    said = facts("forces", robot, motion, "-o", target)
    with target.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 2000
    drive = np.array([float(row["elbow.gamma.drive"]) for row in rows])
    assert np.abs(drive - u[:, 5])[20:-20].max() < 0.02 * np.abs(drive).max()
    assert said["coordinates"]["elbow.gamma"]["drive"]["value"] == drive[np.abs(drive).argmax()]
    assert "joint reaction" in command("forces", robot, motion, "-o", tmp_path / "f.npz")
    with np.load(tmp_path / "f.npz") as data:
        assert np.array_equal(data["elbow.gamma.drive"], drive)
    kept = eomgen.load_result(tmp_path / "f.npz")
    assert kept.as_dict() == said
    assert np.array_equal(kept.supports["elbow"][:, 0], [float(row["elbow.reaction.fx"]) for row in rows])
    fitted = {entry["coordinate"]: entry for entry in facts("fit", robot, motion)["fitted"]}
    assert fitted["elbow.gamma"]["stiffness"]["value"] == pytest.approx(20.0, rel=1e-3)
    assert "elbow.gamma.stiffness" in command("fit", robot, motion, "--coordinates", "elbow.gamma")
    assert ".csv, .npz" in command("forces", robot, motion, "-o", tmp_path / "f.txt", code=1)
    assert "window: 4" in command("forces", robot, motion, "--window", 4, code=1)


def turning(t: Array) -> Array:
    """The angle of a crank with its derivatives, (3, T)."""
    return np.array([1.0 + 0.5 * np.sin(8 * t), 4.0 * np.cos(8 * t), -32.0 * np.sin(8 * t)])


def test_a_measured_mechanism_closes() -> None:
    """From the crank alone, or from all coordinates with noise: rates and accelerations of the closed motion."""
    robot = eomgen.load_robot("four_bar")
    model, kernel = build_model(robot), eomgen.build(robot, kernels=mechanism_kernels(robot))
    t = np.linspace(0.0, 0.2, 101)
    crank = turning(t)
    alone = [np.pad(values[:, None], ((0, 0), (0, 2))) for values in crank]
    q, v, a, following = closed_motion(kernel, model, ("joint1.gamma",), *alone)
    assert following == ("joint2.gamma", "joint3.gamma")
    assert np.array_equal(q[:, 0], crank[0])
    # the rocker's pin is 0.5 m from the crank's: |0.5 e_x + 0.4 r - 0.2 c| = 0.5
    away = np.array([0.5, 0.0]) + 0.4 * turned(q[:, 2]) - 0.2 * turned(q[:, 0])
    assert np.linalg.norm(away, axis=1) == pytest.approx(0.5, abs=1e-11)
    assert np.abs(np.diff(q, axis=0)).max() < 0.05
    assert v[1:-1] == pytest.approx((q[2:] - q[:-2]) / (t[2:] - t[:-2])[:, None], abs=2e-3)
    assert a[1:-1] == pytest.approx((v[2:] - v[:-2]) / (t[2:] - t[:-2])[:, None], abs=0.05)
    noise = 1e-4 * np.random.default_rng(1).normal(size=(3, *q.shape))
    near = closed_motion(kernel, model, kernel.coordinates, *(x + e for x, e in zip((q, v, a), noise, strict=True)))
    assert near[3] == ()
    for found, exact, size in zip(near, (q, v, a), (1e-3, 1e-2, 1e-1), strict=False):
        assert np.abs(found - exact).max() < size
    J = kernel.functions.constraint_jacobian(near[0])
    assert np.abs(kernel.functions.constraint(near[0])).max() < 1e-11
    assert np.abs(np.einsum("tmn,tn->tm", J, near[2]) + kernel.functions.constraint_bias(near[0], near[1])).max() < 1e-9
    with pytest.raises(InputError, match=r"'joint1\.gamma'.*'joint3\.gamma' move while what was measured does not"):
        closed_motion(kernel, model, (), *alone)


def turned(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors in the plane, (T, 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.soak
def test_forces_of_a_mechanism_make_its_motion() -> None:
    """Drives at the driven coordinate alone, which accelerate the closed mechanism as it was measured."""
    t = np.linspace(0.0, 0.2, 21)
    names = ("joint1.gamma", "joint2.gamma", "joint3.gamma")
    motion = motion_from_columns(columns_of(names[:1], t, *turning(t)[:, :, None]), names)
    found = forces("four_bar", motion)
    assert not found.drive[:, 1:].any()
    kernel = eomgen.build("four_bar", kernels=("inverse_dynamics",))
    assert found.required == pytest.approx(kernel.inverse_dynamics(found.q, found.v, found.a, cut=True), abs=1e-9)
    assert "joint2.gamma.closing" in found.columns()
    a = eomgen.build("four_bar", kernels=("forward_dynamics",)).forward_dynamics(found.q, found.v, found.drive)
    assert a == pytest.approx(found.a, abs=1e-9)
    assert "they follow from the others: joint2.gamma, joint3.gamma" in found.notes[1]


def rod(name: str, mass: float, com: float) -> str:
    inertia = "inertia = { xx = 0.002, yy = 0.01, zz = 0.012, xy = 0.0003 }"
    return f"{link_table(name, mass, (com, 0.02, 0.01))}\n{inertia}\n"


def pivot(name: str, parent: str, child: str, x: float) -> str:
    return f"{joint_table(name, parent, child, 'revolute')}\nplacement = {{ xyz = [{x}, 0.0, 0.0] }}\n"


def cut(name: str, first: str, second: str, *x: float) -> str:
    places = ", ".join(f"{{ xyz = [{value}, 0.0, 0.0] }}" for value in x)
    return f"{loop_table(name, first, second, 'revolute')}\nplacements = [{places}]\n"


def four_rods(*, cut_at_rocker: bool) -> eomgen.Robot:
    """A four-bar linkage, cut between coupler and rocker, or between rocker and ground; frames of a joint agree."""
    text = 'name = "four_rods"\ngravity = [0.0, -9.81, 0.0]\ndriven = ["motor.gamma"]\n'
    text += rod("crank", 0.4, 0.1) + rod("coupler", 1.0, 0.25)
    text += rod("rocker", 0.8, 0.2 if cut_at_rocker else -0.2)
    text += pivot("motor", "base", "crank", 0.0) + pivot("pin", "crank", "coupler", 0.2)
    if cut_at_rocker:
        text += pivot("pivot", "base", "rocker", 0.5) + cut("hinge", "coupler", "rocker", 0.5, 0.4)
    else:
        text += pivot("hinge", "coupler", "rocker", 0.5) + cut("pivot", "base", "rocker", 0.5, -0.4)
    return robot_from_toml(text)


@pytest.mark.soak
def test_reactions_of_cut_joints_are_those_of_another_cut(tmp_path: Path) -> None:
    """In the plane, where they are unique, each joint bears the same wherever the loop is cut; in files and tables."""
    t = np.linspace(0.0, 0.3, 13)
    found = []
    for there in (True, False):
        robot = four_rods(cut_at_rocker=there)
        names = build_model(robot).coordinates
        guess = {"pin": -0.5, "pivot": 1.2, "hinge": 1.2}
        robot = replace(robot, home={name: guess[name[:-6]] for name in names if name[:-6] in guess})
        columns = columns_of(("motor.gamma",), t, *turning(t)[:, :, None])
        found.append(forces(robot, motion_from_columns(columns, names)))
    mine, other = found
    assert (mine.loops, other.loops) == (("hinge",), ("pivot",))
    for name in ("motor", "pin", "hinge", "pivot"):
        a, b = mine.supports[name], other.supports[name]
        assert np.linalg.norm(a[:, :2], axis=1) == pytest.approx(np.linalg.norm(b[:, :2], axis=1), rel=1e-9)
    assert mine.supports["hinge"][:, :2] == pytest.approx(other.supports["hinge"][:, :2], rel=1e-8, abs=1e-8)
    facts = mine.as_dict()["reactions"]
    assert list(facts) == ["motor", "pin", "pivot", "hinge"]
    assert any(line.startswith("hinge ") for line in mine.lines())
    with open(mine.save(tmp_path / "forces.csv"), newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["hinge.reaction.fy"]) for row in rows] == mine.loop_reactions[:, 0, 1].tolist()
    assert "hinge.reaction" in [column.name for column in mine.as_rows().columns]


@pytest.mark.soak
def test_forces_of_elastic_cuts_close_the_balance() -> None:
    """What is required is what the tree alone would take: the cut joint's laws are a force beside the others."""
    robot = linkages()[0]
    names = build_model(robot).coordinates
    q, v, a = smooth_motion(np.linspace(0.0, 0.3, 5), len(names), 5)
    found = forces(robot, motion_of(names, np.linspace(0.0, 0.3, 5), q, v, a))
    laws = ("stiffness", "damping", "cubic", "clearance", "coulomb", "preload")
    kernel = eomgen.build(robot, kernels=("residual",))
    for name in kernel.parameters:
        if name.startswith("loops.") and name.endswith(laws):
            kernel.parameters[name] = 0.0
    assert np.abs(found.closing).max() > 1.0
    assert found.required == pytest.approx(kernel.residual(q, v, a, 0 * q), abs=1e-9)
