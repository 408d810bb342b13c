"""Base parameters from motions of robots that are known: exact samples, noise, standstill, what is refused."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.codegen.tree.regressor import INERTIAL
from eomgen.errors import InputError
from eomgen.identification import base_parameters, identify
from eomgen.identification.consistent import nearest_bodies, numbers_of, pseudo_inertias, with_parameters
from eomgen.identification.dynamics.solve import without_sought
from eomgen.identification.identifiable import TERMS
from eomgen.motion.files import MeasuredMotion, motion_from_columns
from eomgen.robot.value import Coordinate, Friction, Joint, Link, Placement, Robot
from tests.support.builds import Build
from tests.support.random_robots import Array

FRICTION = Friction(coulomb=0.4, viscous=0.1, smoothing=1e-9)
STEP = 2e-3


def arm(**more: float) -> Robot:
    """Two links that swing about crossed axes, with rotors, springs and friction."""
    links = (
        Link("upper", 3.0, (0.1, 0.02, 0.05), (0.02, 0.05, 0.06, 0.001, 0.002, -0.001)),
        Link("fore", 1.5, (0.15, -0.03, 0.02), (0.01, 0.03, 0.03, -0.001, 0.0005, 0.001)),
    )
    first = Coordinate(damping=0.7, armature=0.2, friction=FRICTION)
    second = Coordinate(stiffness=4.0, damping=0.3, armature=0.05, **more)
    joints = (
        Joint("joint1", "base", "upper", "revolute", coordinates={"gamma": first}),
        Joint(
            "joint2",
            "upper",
            "fore",
            "revolute",
            Placement.from_dh(0.3, np.pi / 2, 0.1, 0.0),
            coordinates={"gamma": second},
        ),
    )
    return Robot("arm", (0.0, -9.81, 0.0), links, joints)


def swing(samples: int = 2400) -> tuple[Array, Array, Array, Array]:
    """Times and a motion of two coordinates, with rates and accelerations."""
    t = np.arange(samples) * STEP
    q, v, a = (np.zeros((samples, 2)) for _ in range(3))
    for i, waves in enumerate((((3.0, 0.5, 0.3), (7.0, 0.3, 1.0)), ((4.0, 0.6, 0.0), (9.0, 0.25, 2.0)))):
        for w, size, phase in waves:
            q[:, i] += size * np.sin(w * t + phase)
            v[:, i] += size * w * np.cos(w * t + phase)
            a[:, i] -= size * w * w * np.sin(w * t + phase)
    return t, q, v, a


def measured(kernel: eomgen.Kernel, noise: tuple[float, float] = (0.0, 0.0), *, rates: bool = True) -> MeasuredMotion:
    t, q, v, a = swing()
    rng = np.random.default_rng(3)
    u = kernel.inverse_dynamics(q, v, a) + noise[1] * rng.standard_normal(q.shape)
    q = q + noise[0] * rng.standard_normal(q.shape)
    columns = {"t": t}
    for i, name in enumerate(kernel.coordinates):
        columns |= {name: q[:, i], f"{name}.drive": u[:, i]}
        columns |= {f"{name}.rate": v[:, i], f"{name}.acceleration": a[:, i]} if rates else {}
    return motion_from_columns(columns, kernel.coordinates)


def kernels(robot: Robot, built: Build) -> tuple[eomgen.Kernel, eomgen.Kernel]:
    """Of the robot, and of it without what is sought."""
    bare = without_sought(robot, ("links", "rotors", "viscous", "dry", "offset"))
    return built(robot, "inverse_dynamics"), built(bare, "regressor", "inverse_dynamics")


def test_exact_samples_give_the_description_back(built: Build) -> None:
    """A spring and all inertial numbers are the description's; the spring's force is taken off."""
    robot = arm(preload=0.25)
    whole, bare = kernels(robot, built)
    found = identify(robot, measured(whole), kernel=bare)
    assert np.abs(found.base_values - found.described).max() < 1e-9
    values = dict(zip(found.base_names, found.base_values, strict=True))
    assert values["joint1.gamma.viscous"] == pytest.approx(0.8, abs=1e-9)
    assert values["joint1.gamma.dry"] == pytest.approx(0.4, abs=1e-9)
    assert values["joint2.gamma.offset"] == pytest.approx(0.25, abs=1e-9)
    assert all(entry.held_out < 1e-9 for entry in found.residuals.values())
    assert not any("shows" in text for text in found.warnings)
    assert len(found.base) == 16


@pytest.mark.parametrize("sought", ["viscous", "dry"])
def test_friction_of_which_a_part_is_known(sought: str, built: Build) -> None:
    """The description's other part is taken off, and stays in the robot that comes out."""
    robot, terms = arm(), ("links", "rotors", sought)
    whole = built(robot, "inverse_dynamics")
    motion = measured(whole)
    found = identify(
        robot, motion, terms=terms, kernel=built(without_sought(robot, terms), "regressor", "inverse_dynamics")
    )
    assert np.abs(found.base_values - found.described).max() < 1e-9
    again = built(found.robot, "inverse_dynamics").inverse_dynamics(motion.q, motion.v, motion.a)
    assert np.abs(again - motion.u).max() < 1e-5


def test_noise_stays_within_its_deviations(built: Build) -> None:
    """Rates and accelerations come from the samples; drives are noisy, each by as much as the residuals say."""
    robot = arm()
    whole, bare = kernels(robot, built)
    found = identify(robot, measured(whole, (1e-6, 0.05), rates=False), kernel=bare)
    off = np.abs(found.base_values - found.described) / found.deviations
    assert off.max() < 5.0
    assert np.sqrt(np.mean(off**2)) < 2.0
    assert (found.deviations > 0.0).all()
    for entry in found.residuals.values():
        assert entry.fitted <= entry.held_out < 1.2 * entry.fitted
        assert max(entry.relative) < 0.05
    assert "central differences" in found.notes[0]


def test_standstill_and_motions_that_show_less(built: Build) -> None:
    """While a drive stands still its friction is anything; a joint that never moves shows nothing of its own."""
    robot = arm()
    whole, bare = kernels(robot, built)
    motion = measured(whole)
    assert motion.v is not None
    assert motion.a is not None
    rest = slice(1000, 1600)
    q, v, a, u = (np.array(x) for x in (motion.q, motion.v, motion.a, motion.u))
    q[rest, 0], v[rest, 0], a[rest, 0] = q[1000, 0], 0.0, 0.0
    u[:] = whole.inverse_dynamics(q, v, a)
    u[rest, 0] += 0.3
    found = identify(robot, replace(motion, q=q, v=v, a=a, u=u), kernel=bare)
    assert np.abs(found.base_values - found.described).max() < 1e-9
    assert any("standstill" in note for note in found.notes)
    q, v, a = (np.array(x) for x in (motion.q, motion.v, motion.a))
    q[:, 1], v[:, 1], a[:, 1] = 0.4, 0.0, 0.0
    terms = ("links", "rotors")
    plain = without_sought(robot, ("viscous", "dry", "offset"))
    held, own = built(plain, "regressor", "inverse_dynamics"), replace(motion, q=q, v=v, a=a)
    own = replace(own, u=np.asarray(held.inverse_dynamics(q, v, a)))
    less = identify(plain, own, terms=terms, kernel=held)
    assert less.warnings[0].startswith(f"the motion shows {len(less.base)} of 10 base parameters")
    assert np.abs(less.base_values - less.described).max() < 1e-9


def test_links_are_bodies_near_the_drawing(built: Build) -> None:
    """From a wrong drawing comes a robot that needs the drives of the true one."""
    robot = arm()
    whole, _ = kernels(robot, built)
    links = (
        replace(x, mass=1.2 * x.mass, com=(0.9 * x.com[0], *x.com[1:]), inertia=tuple(1.3 * i for i in x.inertia))
        for x in robot.links
    )
    drawn = replace(robot, links=tuple(links))
    drawing, bare = kernels(drawn, built)
    found = identify(drawn, measured(whole), kernel=bare)
    assert np.linalg.eigvalsh(pseudo_inertias(links_of(found.parameters, ("upper", "fore")))).min() > 0.0
    _, q, v, a = swing()
    true = whole.inverse_dynamics(q, v, a)
    assert np.abs(built(found.robot, "inverse_dynamics").inverse_dynamics(q, v, a) - true).max() < 1e-5
    assert np.abs(drawing.inverse_dynamics(q, v, a) - true).max() > 1.0
    own = built(found.robot, "regressor")
    expected = [found.parameters[name] for name in own.regressor_names]
    assert np.abs(own.regressor_values - expected).max() < 1e-12


def links_of(parameters: dict[str, float], names: tuple[str, ...]) -> Array:
    return np.array([[parameters[f"{name}.{key}"] for key in INERTIAL] for name in names])


@pytest.mark.parametrize("drawn", ["bodies", "rods", "nothing"])
def test_base_values_that_no_body_has(drawn: str, built: Build) -> None:
    """Parameters stay those of bodies, whatever was measured and drawn, and near to what was measured."""
    kernel = built(without_sought(arm(), TERMS), "regressor", "inverse_dynamics")
    base = base_parameters(arm(), kernel=kernel)
    theta = kernel.regressor_values * (drawn != "nothing")
    if drawn == "rods":
        theta[4:10] = theta[14:20] = 0.0
        theta[[7, 9, 17, 19]] = 0.1
    values = base.values(kernel.regressor_values)
    values[base.names.index("fore.ixx - fore.iyy")] = 5.0
    values[-1] = -0.3
    found = nearest_bodies(base, values, np.diag(np.full(len(base), 1e-4)), theta, 0.5)
    assert np.linalg.eigvalsh(pseudo_inertias(found[:20].reshape(2, 10))).min() > 0.0
    assert (found[20:] > 0.0).all()
    kept = np.arange(len(base) - 1)[:2]
    assert np.abs(base.values(found) - values)[kept].max() < 0.3


def test_numbers_of_links_and_back() -> None:
    links = np.random.default_rng(2).uniform(-1.0, 1.0, (3, 10))
    assert np.abs(numbers_of(pseudo_inertias(links)) - links).max() < 1e-14


def test_fixed_links_become_part_of_what_they_hang_on(built: Build) -> None:
    robot = arm()
    weight = Link("weight", 0.5, (0.0, 0.1, 0.0), (0.001, 0.001, 0.001, 0.0, 0.0, 0.0))
    joint = Joint("weld", "fore", "weight", "fixed", Placement.from_dh(0.1, 0.0, 0.2, 0.3))
    loaded = replace(robot, links=(*robot.links, weight), joints=(*robot.joints, joint))
    kernel = built(loaded, "regressor")
    theta = dict(zip(kernel.regressor_names, kernel.regressor_values.tolist(), strict=True))
    found = with_parameters(loaded, theta)
    assert found.link("weight").mass == 0.0
    assert np.abs(built(found, "regressor").regressor_values - kernel.regressor_values).max() < 1e-12


def test_a_result_is_shown(built: Build) -> None:
    robot = arm()
    whole, bare = kernels(robot, built)
    found = identify(robot, measured(whole), kernel=bare)
    text = "\n".join(found.lines())
    assert "16 base parameters by least squares" in text
    assert "joint1.gamma [N m]" in text
    facts = found.as_dict()
    assert facts["values"]["joint1.gamma.dry"] == pytest.approx(0.4)
    assert set(facts["residuals"]["joint2.gamma"]) == {"fitted", "held_out", "drive", "samples", "relative"}


def test_what_is_refused(built: Build) -> None:
    robot = arm()
    whole, bare = kernels(robot, built)
    motion = measured(whole)
    with pytest.raises(InputError, match="terms: 'mass'; allowed: links"):
        identify(robot, motion, terms=("mass",), kernel=bare)
    with pytest.raises(InputError, match=r"spread: 0\.0; allowed: a number above 0"):
        identify(robot, motion, spread=0.0, kernel=bare)
    with pytest.raises(InputError, match=r"no drive is known; allowed: columns such as joint1\.gamma\.drive"):
        identify(robot, replace(motion, driven=()), kernel=bare)
    with pytest.raises(InputError, match="four_bar has loops or elastic couplings; allowed: robots without"):
        identify("four_bar", motion)
    zero = np.zeros_like(motion.q)
    still = replace(motion, q=zero + 0.3, v=zero, a=zero)
    with pytest.raises(InputError, match="stand still too often"):
        identify(robot, still, kernel=bare)


def peak_of(robot: Robot, motion: MeasuredMotion, kernel: eomgen.Kernel, terms: tuple[str, ...]) -> int:
    """Bytes that NumPy and Python have at most while a motion is identified."""
    tracemalloc.start()
    try:
        identify(robot, motion, terms=terms, half=8, shape="lorentzian", kernel=kernel)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("more", [(), pytest.param(("delay", "stribeck"), marks=pytest.mark.soak)])
def test_columns_of_all_samples_are_never_in_memory(more: tuple[str, ...], built: Build) -> None:
    """8000 samples more need some arrays of their own size, (T, n), however many columns there are."""
    robot, (t, q, v, a) = arm(), swing(16000)
    whole, bare = kernels(robot, built)
    u = np.asarray(whole.inverse_dynamics(q, v, a)) + 0.01 * np.random.default_rng(5).standard_normal(q.shape)
    peaks, terms = [], (*TERMS, *more)
    for samples in (8000, 16000):
        columns = {"t": t[:samples]}
        for i, name in enumerate(bare.coordinates):
            columns |= {name: q[:samples, i], f"{name}.rate": v[:samples, i], f"{name}.acceleration": a[:samples, i]}
            columns |= {f"{name}.drive": u[:samples, i]}
        motion = motion_from_columns(columns, bare.coordinates)
        peaks.append(peak_of(robot, motion, bare, terms))
    assert peaks[1] - peaks[0] < 28 * q[8000:].nbytes  # one copy of 16 columns is 16 of these
