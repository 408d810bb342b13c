"""Coupled wrists, gains, delays, Stribeck's friction, transmissions; traps; results saved, loaded, drawn, written."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.cli.entry import main
from eomgen.errors import InputError
from eomgen.identification import base_parameters, identify, load_identification
from eomgen.identification.dynamics.further import SHAPES
from eomgen.identification.dynamics.solve import without_sought
from eomgen.identification.identifiable import TERMS
from eomgen.identification.relations import relations_of
from eomgen.loading import load_result
from eomgen.motion.files import MeasuredMotion, motion_from_columns
from eomgen.pictures import report_of
from eomgen.pictures.measured.motions import plot_identification
from eomgen.robot.value import Coordinate, Coupling, Friction, Joint, Link, Motor, Placement, Robot
from tests.support.blind_arms import blind_arm, periodic, record
from tests.support.builds import Build
from tests.support.random_robots import Array

from .test_base_parameters import tx40
from .test_identify import STEP, arm, kernels, measured, swing


def wrist(robot: Robot, first: str, second: str) -> Robot:
    """The robot with a rotor that turns with two joints, and drives the second one."""
    rotor = Link("rotor", 1e-3, (0.0, 0.0, 0.0), (1e-4, 1e-4, 2e-2, 0.0, 0.0, 0.0))
    own = Coordinate(damping=0.2, friction=Friction(coulomb=0.3, smoothing=1e-9))
    joint = Joint("rotor", "base", "rotor", "revolute", coordinates={"gamma": own})
    coupling = Coupling("wrist", "rotor.gamma", {first: 1.0, second: 1.0})
    driven = [f"{x.name}.gamma" for x in robot.joints if f"{x.name}.gamma" != second]
    return replace(
        robot,
        links=(*robot.links, rotor),
        joints=(*robot.joints, joint),
        couplings=(coupling,),
        driven=(*driven, "rotor.gamma"),
    )


def test_a_coupled_wrist_has_three_parameters_more(built: Build) -> None:
    """Rotor, viscous and dry friction of the motor that turns with joints 5 and 6; its offset is that of both."""
    plain = tx40()
    last = replace(plain.joints[-1], coordinates={"gamma": Coordinate(armature=1e-3)})
    robot = wrist(replace(plain, joints=(*plain.joints[:-1], last)), "joint5.gamma", "joint6.gamma")
    kernel = built(robot, "regressor")
    found = base_parameters(robot, terms=TERMS, kernel=kernel)
    assert len(found) == 61
    assert len(base_parameters(robot, terms=("links", "rotors"), kernel=kernel)) == 41
    rotor = "rotor.izz + rotor.gamma.armature"
    assert [name for name in found.names if name.startswith("rotor.")] == [
        rotor,
        "rotor.gamma.viscous",
        "rotor.gamma.dry",
    ]
    a = np.zeros((2, 7))
    a[0, [4, 6]] = a[1, [5, 6]] = 1.0  # of either joint; the rotor turns with it
    own = found.regressor(kernel, np.zeros((2, 7)), np.zeros((2, 7)), a)
    assert own.shape == (2, 6, 61)
    assert own[:, 4:, found.names.index(rotor)].tolist() == [[1.0, 1.0], [1.0, 1.0]]


def wrist_motion(robot: Robot, built: Build) -> MeasuredMotion:
    """Exact samples of the arm with a wrist: the joints' angles, and drives of joint1 and the rotor."""
    relations = relations_of(robot)
    kernel = built(robot, "inverse_dynamics")
    t, *free = swing()
    q, v, a = (x @ relations.matrix.T for x in free)
    along = relations.forces(np.asarray(kernel.inverse_dynamics(q, v, a)))
    drives = along @ np.linalg.inv(relations.matrix[[0, 2]])
    columns: dict[str, Array] = {"t": t}
    for i, name in enumerate(relations.rows):
        columns |= {name: free[0][:, i], f"{name}.rate": free[1][:, i], f"{name}.acceleration": free[2][:, i]}
    columns |= {"joint1.gamma.drive": drives[:, 0], "rotor.gamma.drive": drives[:, 1]}
    return motion_from_columns(columns, kernel.coordinates)


@pytest.mark.soak
def test_a_coupled_wrist_is_identified(built: Build) -> None:
    """Drives of coupled motors act in the rows of both joints; the robot that comes out needs the same drives."""
    robot = wrist(arm(), "joint1.gamma", "joint2.gamma")
    motion = wrist_motion(robot, built)
    bare = built(without_sought(robot, TERMS), "regressor", "inverse_dynamics")
    found = identify(robot, motion, kernel=bare)
    assert np.abs(found.base_values - found.described).max() < 1e-8
    values = dict(zip(found.base_names, found.base_values, strict=True))
    assert values["rotor.gamma.dry"] == pytest.approx(0.3, abs=1e-9)
    assert list(found.residuals) == ["joint1.gamma", "joint2.gamma"]
    assert wrist_motion(found.robot, built).u == pytest.approx(motion.u, abs=1e-4)
    q = np.array(motion.q)
    q[:, 2] = 3.0 * q.sum(axis=1)
    with pytest.raises(InputError, match=r"rotor\.gamma is off by .* from what the coupling wrist makes of"):
        identify(robot, replace(motion, q=q, v=None, a=None, measured=robot_coordinates(robot)), kernel=bare)


def robot_coordinates(robot: Robot) -> tuple[str, ...]:
    return relations_of(robot).coordinates


def bare_kernel(robot: Robot, built: Build, *more: str) -> eomgen.Kernel:
    return built(without_sought(robot, (*TERMS, *more)), "regressor", "inverse_dynamics")


def test_gains_from_a_link_that_is_known(built: Build) -> None:
    """Currents in the place of moments: links that are known are the measure; without them one gain is open."""
    robot = arm()
    whole, bare = kernels(robot, built)
    motion = first_samples(measured(whole, (0.0, 0.01)), 1400)
    currents = replace(motion, u=motion.u / [20.0, 8.0])
    found = identify(robot, currents, terms=(*TERMS, "gains"), known=("fore",), kernel=bare)
    for name, gain in (("joint1.gamma.gain", 20.0), ("joint2.gamma.gain", 8.0)):
        assert abs(found.further[name].value - gain) < 4.0 * found.further[name].deviation < 0.05 * gain
    assert "fore.m" not in found.parameters
    unsprung = replace(robot, joints=(robot.joints[0], replace(robot.joints[1], coordinates={"gamma": Coordinate()})))
    currents = replace(motion, u=(motion.u - motion.q * [0.0, 4.0]) / [20.0, 8.0])  # a known spring is a measure, too
    open_gain = identify(unsprung, currents, terms=(*TERMS, "gains"), kernel=bare_kernel(unsprung, built))
    assert any("joint2.gamma.gain depends linearly on" in text for text in open_gain.warnings)
    ratio = open_gain.further["joint1.gamma.gain"]
    assert abs(ratio.value - 20.0 / 8.0) < 4.0 * ratio.deviation < 0.1
    assert "joint2.gamma.gain" not in open_gain.further


def test_noisy_encoders_have_a_wider_filter(built: Build) -> None:
    """Behind the narrowest filter noise would be most of the accelerations, and columns of it tell nothing."""
    whole, bare = kernels(arm(), built)
    found = identify(arm(), first_samples(measured(whole, (5e-5, 0.02), rates=False), 1400), kernel=bare)
    assert "behind a bell of 25 samples" in found.notes[0]
    values = dict(zip(found.base_names, found.base_values, strict=True))
    assert values["fore.mx"] == pytest.approx(0.225, abs=0.02)


@pytest.mark.parametrize("rates", [False, pytest.param(True, marks=pytest.mark.soak)])
def test_a_delay_of_drives(rates: bool, built: Build) -> None:
    """Drives in the file are 3.3 samples late; and so that noise does not make it, none where there is none."""
    robot = arm()
    whole, bare = kernels(robot, built)
    exact = measured(whole, rates=rates)
    exact = first_samples(exact, 1400)
    t = exact.t
    rng = np.random.default_rng(4)
    for delay in (3.3 * STEP, 0.0):
        late = np.stack([np.interp(t - delay, t, x) for x in exact.u.T], axis=1) + 0.02 * rng.standard_normal(
            (len(t), 2)
        )
        found = identify(robot, replace(exact, u=late), terms=(*TERMS, "delay"), kernel=bare)
        entry = found.further["delay"]
        assert abs(entry.value - delay) < 4.0 * entry.deviation + 1e-5
        assert entry.deviation < 1e-4
        assert entry.unit == "s"


@pytest.mark.soak
def test_stribeck_friction(built: Build) -> None:
    """Static friction and Stribeck's rate of one joint come back; the other shows none."""
    robot = arm()
    rubbing = Friction(coulomb=0.4, static=0.9, stribeck=0.5, smoothing=1e-9)
    first = replace(robot.joints[0], coordinates={"gamma": Coordinate(damping=0.7, armature=0.2, friction=rubbing)})
    robot = replace(robot, joints=(first, robot.joints[1]))
    motion = measured(built(robot, "inverse_dynamics"), (0.0, 0.02))
    found = identify(arm(), motion, terms=(*TERMS, "stribeck"), kernel=bare_kernel(robot, built))
    excess, rate = found.further["joint1.gamma.breakaway"], found.further["joint1.gamma.stribeck"]
    assert abs(excess.value - 0.5) < 4.0 * excess.deviation < 0.3
    assert abs(rate.value - 0.5) < 4.0 * rate.deviation < 0.3
    assert "joint2.gamma: the motion shows no Stribeck friction" in found.warnings
    friction = found.robot.joint("joint1").coordinates["gamma"].friction
    assert friction is not None
    assert friction.stribeck == rate.value
    assert friction.static == pytest.approx(0.9, abs=0.1)
    with pytest.raises(InputError, match="terms: stribeck without dry; allowed: both, or dry alone"):
        identify(robot, motion, terms=("links", "stribeck"), kernel=bare_kernel(robot, built))


def elastic() -> Robot:
    """One link behind a motor."""
    link = Link("arm", 2.0, (0.3, 0.0, 0.0), (0.01, 0.05, 0.05, 0.0, 0.0, 0.0))
    motor = Motor(1e-3, 50.0, Coordinate(stiffness=4000.0, damping=3.0), Friction(coulomb=0.05, smoothing=1e-9))
    joint = Joint("joint1", "base", "arm", "revolute", coordinates={"gamma": Coordinate()}, motor=motor)
    return Robot("elastic", (0.0, -9.81, 0.0), (link,), (joint,))


def test_stiffness_of_transmissions(built: Build) -> None:
    """From the shaft's angle and the joint's; where one is missing, it is named."""
    robot, terms = elastic(), (*TERMS, "transmissions")
    kernel = built(robot, "inverse_dynamics")
    t, q, v, a = swing()
    phi = 0.01 * np.stack([np.sin(5.0 * t), 5.0 * np.cos(5.0 * t), -25.0 * np.sin(5.0 * t)])
    both = [np.stack([x[:, 0], 50.0 * (x[:, 0] + y)], axis=1) for x, y in zip((q, v, a), phi, strict=True)]
    force = np.asarray(kernel.inverse_dynamics(*both))
    columns: dict[str, Array] = {"t": t, "joint1.gamma": both[0][:, 0], "joint1.motor": both[0][:, 1]}
    columns["joint1.motor.drive"] = force[:, 1]
    for suffix, values in ((".rate", both[1]), (".acceleration", both[2])):
        columns |= {f"joint1.gamma{suffix}": values[:, 0], f"joint1.motor{suffix}": values[:, 1]}
    bare = bare_kernel(robot, built, "transmissions")
    balanced = columns | {"joint1.gamma.drive": force[:, 0]}  # what would push the joint besides
    found = identify(robot, motion_from_columns(balanced, kernel.coordinates), terms=terms, kernel=bare)
    assert found.parameters["joint1.motor.stiffness"] == pytest.approx(4000.0, rel=1e-4)
    transmission = found.robot.joint("joint1").motor
    assert transmission is not None
    assert transmission.transmission.damping == pytest.approx(3.0, rel=1e-3)
    only = {name: x for name, x in columns.items() if not name.startswith("joint1.gamma")}
    with pytest.raises(InputError, match=r"transmissions: there is no column joint1\.gamma; allowed: columns of both"):
        identify(robot, motion_from_columns(only, kernel.coordinates), terms=terms, kernel=bare)
    with pytest.raises(InputError, match="transmissions: no joint of arm has a motor"):
        identify(arm(), measured(kernels(arm(), built)[0]), terms=terms, kernel=bare_kernel(arm(), built))


def degrees(motion: MeasuredMotion) -> MeasuredMotion:
    return replace(motion, q=np.rad2deg(motion.q), v=None, a=None)


def with_rates(motion: MeasuredMotion, factor: float) -> MeasuredMotion:
    assert motion.v is not None
    return replace(motion, v=factor * motion.v)


TRAPS: dict[str, tuple[Callable[[MeasuredMotion], MeasuredMotion], str]] = {
    "degrees": (degrees, "joint1.gamma goes from -.* rad, allowed: .*: degrees for radians"),
    "motors": (lambda m: replace(m, q=1e4 * m.q, v=None, a=None), "motor angles for joint angles"),
    "milliseconds": (
        lambda m: replace(m, t=1e3 * m.t, v=None, a=None),
        "samples are 2 s apart, and nothing moves faster than .*: milliseconds for seconds",
    ),
    "rates in degrees": (lambda m: with_rates(m, 57.29578), r"joint1\.gamma\.rate is 57\.3 times .*: rates in degrees"),
    "times in ms, rates in s": (lambda m: replace(m, t=1e3 * m.t), r"rate is 1000 times .*: times in milliseconds"),
    "zero": (lambda m: replace(m, u=m.u * [1.0, 0.0]), r"joint2\.gamma\.drive is 0 in every sample; allowed: measured"),
    "short": (lambda m: first_samples(m, 100), "100 samples; a fit needs at least"),
}


def first_samples(motion: MeasuredMotion, many: int) -> MeasuredMotion:
    there = [key for key in ("t", "q", "v", "a", "u") if getattr(motion, key) is not None]
    return replace(motion, **{key: getattr(motion, key)[:many] for key in there})


@pytest.mark.parametrize("name", TRAPS)
def test_traps(name: str, built: Build) -> None:
    whole, bare = kernels(arm(), built)
    change, message = TRAPS[name]
    with pytest.raises(InputError, match=message):
        identify(arm(), change(measured(whole)), kernel=bare)


def test_a_drive_of_another_sign_is_named(built: Build) -> None:
    whole, bare = kernels(arm(), built)
    motion = measured(whole, (0.0, 0.05))
    found = identify(arm(), replace(motion, u=motion.u * [-1.0, 1.0]), kernel=bare)
    assert any("drive in the other sense leaves" in text for text in found.warnings)


def test_arguments_that_are_refused(built: Build) -> None:
    whole, bare = kernels(arm(), built)
    motion = measured(whole)
    wrong: tuple[tuple[dict[str, Any], str], ...] = (
        ({"known": ("hand",)}, "known: there is no moving link 'hand'; allowed: 'upper', 'fore'"),
        ({"half": -1}, "half: -1; allowed: a whole number from 0"),
        ({"half": 5000}, "2400 samples; a filter of half width 5000 needs at least"),
        ({"terms": ("delays",)}, "terms: 'delays'; allowed: links, .*, stribeck, gains, delay"),
    )
    for options, message in wrong:
        with pytest.raises(InputError, match=message):
            identify(arm(), motion, kernel=bare, **options)


ARM = """name = "arm"
gravity = [0.0, -9.81, 0.0]

[[links]]
name = "upper"   # the first one
mass = 2.0
com = [0.1, 0.0, 0.0]
inertia = { xx = 0.02, yy = 0.05, zz = 0.06 }

[[links]]
name = "fore"
mass = 1.5

[[joints]]
name = "joint1"
parent = "base"
child = "upper"
type = "revolute"
gamma = { stiffness = 2.0, friction = { coulomb = 0.1 } }

[[joints]]
name = "joint2"
parent = "upper"
child = "fore"
type = "revolute"
dh = { a = 0.3, alpha = 1.5707963267948966, d = 0.1, theta = 0.0 }
"""


def test_results_are_saved_loaded_drawn_and_written(built: Build, tmp_path: Path) -> None:
    """The description keeps what was not sought, and is the robot that was found; what is no result is refused."""
    source = tmp_path / "arm.toml"
    source.write_text(ARM, encoding="utf-8")
    robot = eomgen.load_robot(source)
    motion = measured(built(arm(), "inverse_dynamics"), (0.0, 0.05))
    found = identify(robot, motion, terms=(*TERMS, "delay"), kernel=bare_kernel(robot, built))
    again = load_identification(found.save(tmp_path / "found.npz"))
    assert again.lines() == found.lines()
    assert again.as_dict() == found.as_dict()
    assert (again.fitted == found.fitted).all()
    left = [(drive - fit)[kept] for drive, fit, kept in zip(found.drives.T, found.fitted.T, again.kept.T, strict=True)]
    rms = [float(np.sqrt(np.mean(x**2))) for x in left]
    assert rms == pytest.approx([x.fitted for x in found.residuals.values()], rel=1e-3)
    assert "<svg" in plot_identification(again, tmp_path / "found.svg").read_text(encoding="utf-8")
    page = report_of(load_result(tmp_path / "found.npz"))
    assert len(page.figures) == 2
    assert "Further parameters" in [table.title for table in page.tables]
    written = found.to_toml(tmp_path / "better.toml")
    text = written.read_text(encoding="utf-8")
    assert re.search(r"# joint1\.gamma\.dry = 0\.\d+ \+- \S+ N m\n", text)
    assert "the first one" in text
    read = eomgen.load_robot(written)
    assert read.links == found.robot.links
    assert read.joint("joint1").coordinates == found.robot.joint("joint1").coordinates
    assert read.joint("joint1").coordinates["gamma"].stiffness == 2.0
    with pytest.raises(InputError, match=r"output: .*; allowed: a path that ends in .toml"):
        found.to_toml(tmp_path / "better.txt")
    with pytest.raises(InputError, match="has no description to write into"):
        replace(found, robot=arm()).to_toml(tmp_path / "better.toml")
    source.write_text(ARM.replace("mass = 1.5\n", "mass = 1.5\ncom = [\n0.1, 0.0, 0.0]\n"), encoding="utf-8")
    with pytest.raises(InputError, match=r"com is not written in .* so that it can be changed"):
        found.to_toml(tmp_path / "better.toml")
    np.savez(tmp_path / "other.npz", meta=np.array("{}"))
    with pytest.raises(InputError, match="is no result of the kind identification"):
        load_identification(tmp_path / "other.npz")


def test_the_command_writes_what_was_found(built: Build, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Options reach ``identify``; a result, a figure and a description are written."""
    source, record = tmp_path / "one.toml", tmp_path / "one.csv"
    source.write_text(
        'name = "one_link"\n[[links]]\nname = "arm"\nmass = 1.0\ncom = [0.2, 0.0, 0.0]\n'
        "inertia = { xx = 0.01, yy = 0.01, zz = 0.01 }\n[[joints]]\n"
        'name = "joint1"\nparent = "base"\nchild = "arm"\ntype = "revolute"\n'
        "dh = { a = 0, alpha = 1.5, d = 0, theta = 0 }\n",
        encoding="utf-8",
    )
    t, q, v, a = swing(1200)
    drive = 0.3 * a[:, 0] + 2.0 * np.cos(q[:, 0]) + 0.5 * np.sign(v[:, 0])
    names = ("t", "joint1.gamma", "joint1.gamma.rate", "joint1.gamma.acceleration", "joint1.gamma.drive")
    table = np.column_stack([t, q[:, 0], v[:, 0], a[:, 0], drive])
    np.savetxt(record, table, delimiter=",", header=",".join(names), comments="")
    more = ["--half", "0", "--toml", str(tmp_path / "b.toml"), "-o", str(tmp_path / "r.npz")]
    assert main(["identify", str(source), str(record), "--terms", "links", "dry", *more]) == 0
    assert "arm.izz" in capsys.readouterr().out
    found = load_identification(tmp_path / "r.npz")
    assert dict(zip(found.base_names, found.base_values, strict=True))["joint1.gamma.dry"] == pytest.approx(
        0.5, abs=1e-6
    )
    assert found.width == 0.0
    assert eomgen.load_robot(tmp_path / "b.toml").links == found.robot.links
    assert main(["identify", str(source), str(record), "-o", "r.txt"]) == 1
    assert "allowed: a path that ends in .npz" in capsys.readouterr().err


BLIND_TERMS = (*TERMS, "transmissions")
BLIND = [(2, 2e-6), (3, 5e-5), *(pytest.param(seed, 3e-5, marks=pytest.mark.soak) for seed in range(10, 22))]


@pytest.mark.parametrize(("seed", "noise"), BLIND)
def test_transmissions_of_blind_arms_with_noisy_joints(seed: int, noise: float, built: Build) -> None:
    """Rows without a drive are no reason for parameters that are all 0; noise does not make springs soft."""
    arms = blind_arm(seed)
    inverse = built(arms.rigid, "inverse_dynamics").inverse_dynamics
    kernel = built(without_sought(arms.elastic, BLIND_TERMS), "regressor", "inverse_dynamics")
    motion = record(arms, inverse, seed, noise=noise, force_noise=2e-3)
    found = identify(arms.elastic, motion, terms=BLIND_TERMS, kernel=kernel)
    assert (np.abs(found.base_values - found.described) / found.deviations).max() < 4.5
    values = dict(zip(found.base_names, found.base_values, strict=True))
    for i, motor in enumerate(arms.motors):
        assert values[f"joint{i + 1}.motor.stiffness"] == pytest.approx(motor.transmission.stiffness, rel=0.05)
    assert all(max(entry.relative) < 0.05 for entry in found.residuals.values())
    assert any("those of rigid gears" in note for note in found.notes)


@pytest.mark.soak
def test_deflections_that_noise_hides_are_named(built: Build) -> None:
    """A stiff transmission behind coarse encoders keeps the description's number."""
    arms = blind_arm(1, stiffness=(3e5, 1e6))
    inverse = built(arms.rigid, "inverse_dynamics").inverse_dynamics
    kernel = built(without_sought(arms.elastic, BLIND_TERMS), "regressor", "inverse_dynamics")
    motion = record(arms, inverse, 1, noise=2e-4, force_noise=2e-3)
    found = identify(arms.elastic, motion, terms=BLIND_TERMS, kernel=kernel)
    hidden = [text for text in found.warnings if "noise of the angles hides the deflection" in text]
    assert hidden
    name = hidden[0].split(":")[0]
    assert name not in found.parameters


STRIBECK_TERMS = (*TERMS, "stribeck")


@pytest.mark.parametrize(
    ("seed", "shape"),
    [
        pytest.param(1, "gaussian", marks=pytest.mark.soak),
        *(pytest.param(seed, shape, marks=pytest.mark.soak) for seed in (1, 2, 3) for shape in (*SHAPES, "")),
    ],
)
def test_the_shape_of_stribecks_curve_of_blind_arms(seed: int, shape: str, built: Build) -> None:
    """With 2 urad of joint noise: the true shape fits best, truth is within the intervals; without, none is."""
    arms, rng = blind_arm(seed).rigid, np.random.default_rng(seed)
    kernel = built(arms, "inverse_dynamics")
    t, q, v, a = periodic(seed, 3000, 2e-3)
    coulomb, excess, viscous = rng.uniform(1.0, 4.0, 2), rng.uniform(0.8, 2.0, 2), rng.uniform(0.2, 1.0, 2)
    rate = rng.uniform(0.1, 0.3, 2) * np.sqrt(np.mean(v**2, axis=0))
    share = {"gaussian": np.exp(-((v / rate) ** 2)), "lorentzian": 1.0 / (1.0 + (v / rate) ** 2)}.get(shape, 0.0)
    u = kernel.inverse_dynamics(q, v, a) + np.sign(v) * (coulomb + excess * share) + viscous * v
    columns: dict[str, Array] = {"t": t}
    for i, name in enumerate(kernel.coordinates):
        columns[name] = q[:, i] + 2e-6 * rng.standard_normal(len(t))
        columns[f"{name}.drive"] = u[:, i] + 0.05 * rng.standard_normal(len(t))
    bare = built(without_sought(arms, STRIBECK_TERMS), "regressor", "inverse_dynamics")
    found = identify(arms, motion_from_columns(columns, kernel.coordinates), terms=STRIBECK_TERMS, kernel=bare)
    assert not found.contradicted
    if not shape:
        assert not found.further
        assert sum("Stribeck" in text for text in found.warnings) >= 1
        return
    key = "stribeck" if shape == "lorentzian" else shape
    for i, name in enumerate(kernel.coordinates):
        for part, truth in (("breakaway", excess[i]), (key, rate[i])):
            entry = found.further[f"{name}.{part}"]
            assert entry.deviation < 0.5 * truth
            # a jackknife's, of few reversals: 6 of these are as rare as 3.5 where deviations are known
            assert abs(entry.value - truth) < 6.0 * entry.deviation
        friction = found.robot.joint(name.partition(".")[0]).coordinates["gamma"].friction
        assert friction is not None
        assert friction.shape == (None if shape == "lorentzian" else shape)
    (said,) = (text for text in found.notes if text.startswith("friction curves"))
    assert f"; {shape} fits best (sqrt|v|: joint1.gamma " in said


def test_what_blocks_held_out_contradict_is_not_written(built: Build, tmp_path: Path) -> None:
    found = identify(arm(), measured(kernels(arm(), built)[0]), kernel=kernels(arm(), built)[1])
    assert not found.contradicted
    left = found.residuals["joint1.gamma"]
    for wrong in (
        replace(left, held_out=99.0 * left.drive),
        replace(left, fitted=0.1 * left.drive, held_out=0.5 * left.drive),
    ):
        worse = replace(found, residuals={**found.residuals, "joint1.gamma": wrong})
        with pytest.raises(InputError, match=r"arm: nothing is written: of joint1\.gamma's drive .* held out"):
            worse.to_toml(tmp_path / "better.toml")
        assert not (tmp_path / "better.toml").exists()
    with pytest.raises(InputError, match="shape: 'bell'; allowed: lorentzian, gaussian"):
        identify(arm(), measured(kernels(arm(), built)[0]), shape="bell")


def test_saturated_drives_and_jumps_are_named_and_left_out(built: Build) -> None:
    """What a drive could not give, and counts that an encoder lost: by name, and the rest gives the truth."""
    whole, bare = kernels(arm(), built)
    motion = measured(whole, (0.0, 0.01))
    limit = 0.8 * float(motion.u[:, 0].max())
    clipped = replace(motion, u=np.column_stack([np.minimum(motion.u[:, 0], limit), motion.u[:, 1]]))
    found = identify(arm(), clipped, kernel=bare)
    assert any(text.startswith("joint1.gamma.drive stands at") and "saturated" in text for text in found.warnings)
    assert (np.abs(found.base_values - found.described) / found.deviations).max() < 5.0
    assert not any("saturated" in text for text in identify(arm(), motion, kernel=bare).warnings)
    q = np.array(motion.q)
    q[1200:, 1] += 0.01
    jumped = identify(arm(), replace(motion, q=q), kernel=bare)
    assert any(text.startswith("joint2.gamma jumps by 0.0") and "at 2.39" in text for text in jumped.warnings)


@pytest.mark.soak
def test_a_zero_that_is_a_quarter_turn_off_is_named(built: Build) -> None:
    """Of a joint between two others: zeros of the first and the last one are a matter of their links' parameters."""
    robot = arm()
    hand = Link("hand", 2.0, (0.2, 0.05, 0.1), (0.02, 0.03, 0.04, 0.0, 0.001, 0.0))
    placed = Placement.from_dh(0.4, 0.7, 0.05, 0.3)
    wrist3 = Joint("joint3", "fore", "hand", "revolute", placed, coordinates={"gamma": Coordinate()})
    joints = (*(replace(x, coordinates={"gamma": Coordinate()}) for x in robot.joints), wrist3)
    robot = replace(robot, links=(*robot.links, hand), joints=joints)
    kernel = built(robot, "inverse_dynamics")
    t, q, v, a = periodic(5, 2400, 2e-3, 3)
    u = kernel.inverse_dynamics(q, v, a)
    columns: dict[str, Array] = {"t": t}
    for i, name in enumerate(kernel.coordinates):
        columns |= {name: q[:, i] - (np.pi / 2 if i == 1 else 0.0), f"{name}.drive": u[:, i]}
    bare = built(without_sought(robot, TERMS), "regressor", "inverse_dynamics")
    found = identify(robot, motion_from_columns(columns, kernel.coordinates), kernel=bare)
    assert any(text.startswith("joint2.gamma + 90 degrees leaves") for text in found.warnings), found.warnings
