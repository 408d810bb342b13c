"""Flexible links: stiffness and damping of modes from motions, masses beside them, and what is of rigid links alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError
from eomgen.identification import (
    base_parameters,
    calibrate,
    compensate,
    excite,
    fit,
    identify,
    poses,
    poses_from_columns,
)
from eomgen.identification.consistent import with_parameters
from eomgen.identification.stiffness.beams import beam_notes
from eomgen.identification.stiffness.output_error import output_error_kernels
from eomgen.identification.stiffness.result import Estimate
from eomgen.kernel.stepping.input_signals import DriveData, InputSignals, Signal, Track
from eomgen.motion.files import MeasuredMotion, motion_from_columns
from eomgen.robot.value import Frame, Robot
from eomgen.scenario.value import Scenario, Section
from tests.support.builds import Build
from tests.support.joint_table import joint_table, link_table
from tests.support.measurements import columns_of
from tests.support.refusals import refused

pytestmark = [pytest.mark.usefixtures("unoptimised")]

KERNELS = ("radau_rollout", "forward_dynamics", "inverse_dynamics", "mass_matrix", "regressor")
TRUE = {"links.arm.modes.1.stiffness": 330.0, "links.arm.modes.1.damping": 0.25}


def boom(E: float = 7e10, modes: str = "{ y = 1 }") -> Robot:
    """Return a beam of aluminium that turns in a plane, upright, with a load at its tip."""
    return robot_from_toml(boom_text(E, E / 2.7, modes))


def boom_text(E: float, G: float, modes: str) -> str:
    return f"""
name = "boom"
gravity = [0.0, -9.81, 0.0]
[[links]]
name = "arm"
modal_damping = 0.02
[links.beam]
length = 1.0
E = {E}
G = {G}
density = 2700.0
section = {{ box = [0.02, 0.01, 0.002] }}
modes = {modes}
{link_table("load", 0.5, inertia=(0.001, 0.001, 0.001))}
{joint_table("slew", "base", "arm", "revolute")}
gamma = {{ armature = 0.05, damping = 0.1 }}
{joint_table("flange", "arm", "load", "fixed")}
node = "tip"
placement = {{ xyz = [0.01, 0.0, 0.02], rpy = [0.2, 0.0, 0.0] }}
"""


@pytest.fixture(scope="module")
def kernel(built: Build) -> eomgen.Kernel:
    return built(boom(), *KERNELS, *output_error_kernels())


def driven(kernel: eomgen.Kernel, duration: float = 0.6, samples: int = 300) -> dict[str, Any]:
    """Return columns of a motion under a torque of the joint: all that a file may have."""
    t = np.linspace(0.0, duration, samples + 1)
    u = np.zeros((t.size, kernel.n))
    u[:, 0] = 5.0 * np.sin(7.0 * t) + 4.0 * np.sin(31.0 * t) + 2.0 * np.sin(68.0 * t)
    loads = InputSignals(DriveData(torque=Track(Signal.through(t, u[:, :1]), np.array([0]))))
    span: dict[str, Any] = {"duration": duration, "samples": samples, "rtol": 1e-11, "atol": 1e-14}
    q, v = kernel.rollout(np.zeros(kernel.n), np.zeros(kernel.n), loads=loads, method="radau", **span)
    a = kernel.forward_dynamics(q, v, u)
    return columns_of(kernel.coordinates, t, q, v, a, u)


@pytest.fixture(scope="module")
def columns(kernel: eomgen.Kernel) -> dict[str, Any]:
    return driven(kernel.replaced(parameters=TRUE))


def some_of(kernel: eomgen.Kernel, columns: dict[str, Any], *names: str, noise: float = 0.0) -> MeasuredMotion:
    """Return some columns as a motion, with white noise as a share of each coordinate's spread."""
    rng, chosen = np.random.default_rng(4), {"t": columns["t"], "slew.gamma.drive": columns["slew.gamma.drive"]}
    for name in names:
        x = columns[name]
        chosen[name] = x + noise * np.std(x) * rng.standard_normal(x.size)
    return motion_from_columns(chosen, kernel.coordinates)


def test_linear_fit(kernel: eomgen.Kernel, columns: dict[str, Any]) -> None:
    """Of modes that were measured, by strain gauges say: forces of a mode are known to be zero."""
    found = fit(boom(), motion_from_columns(columns, kernel.coordinates))
    assert found["arm.mode1"].owner == "links"
    assert found["arm.mode1"].stiffness.value == pytest.approx(330.0, rel=1e-3)
    assert found["arm.mode1"].damping.value == pytest.approx(0.25, rel=1e-2)
    assert found.parameters["links.arm.modes.1.stiffness"] == found.estimates["arm.mode1.stiffness"].value
    assert kernel.replaced(parameters=found.parameters).parameters["links.arm.modes.1.damping"] > 0.24


def test_unmeasured_modes_are_named(kernel: eomgen.Kernel, columns: dict[str, Any]) -> None:
    found = fit(boom(), some_of(kernel, columns, "slew.gamma"))
    said = "was not measured, and counts as zero; parameters are found without, by simulations"
    assert f"arm.mode1 {said}" in found.warnings


def test_notes_on_beams_have_the_values_that_modes_share() -> None:
    """E goes with the stiffness of modes, of two the mean; damping is that of K = 1.1 times the described one."""
    robot, names = boom(modes="{ y = 2 }"), [f"links.arm.modes.{k}" for k in (1, 2)]
    modes = robot.link("arm").modes
    assert modes is not None
    estimates = {}
    for k, name in enumerate(names):
        K, m = modes.K[k][k], modes.masses[k][k]
        for key, described, value in (("stiffness", K, 1.1 * K), ("damping", 1.0, 0.06 * np.sqrt(1.1 * K * m))):
            estimates[f"{name}.{key}"] = Estimate(value, 0.01 * value, 0.0, 0.0, described, 0.0, 0.0)
    assert list(beam_notes(robot, estimates)) == [
        "links.arm.beam.E = 7.7e+10 +- 5.4e+08 N/m^2, by the stiffness of 2 modes, with G in proportion",
        "links.arm.modal_damping = 0.03 +- 0.00021, by the damping of 2 modes",
    ]


@pytest.mark.soak
def test_simulations_find_modes_from_the_joint_alone(kernel: eomgen.Kernel, columns: dict[str, Any]) -> None:
    found = fit(boom(), some_of(kernel, columns, "slew.gamma"), parameters=tuple(TRUE))
    assert max(abs(found.estimates[name].value / x - 1.0) for name, x in TRUE.items()) < 1e-6
    assert found.warnings == ()
    [E] = [note for note in found.notes if "beam.E" in note]
    K = boom().link("arm").modes.K[0][0]
    assert E.startswith(f"links.arm.beam.E = {7e10 * 330.0 / K:.6g} +- ")
    assert any(note.startswith("links.arm.modal_damping = 0.0") for note in found.notes)


@pytest.mark.soak
def test_a_beam_of_another_material(kernel: eomgen.Kernel) -> None:
    """E and modal damping stand in notes as another description has them."""
    motion = some_of(kernel, driven(eomgen.build(boom(7.7e10), kernels=KERNELS)), "slew.gamma", "arm.mode1")
    notes = " ".join(fit(boom(), motion, parameters=tuple(TRUE), kernel=kernel).notes)
    assert "links.arm.beam.E = 7.7e+10 +- " in notes
    assert "links.arm.modal_damping = 0.02 +- " in notes


@pytest.mark.soak
def test_intervals_hold_what_is_true(kernel: eomgen.Kernel, columns: dict[str, Any]) -> None:
    """With noise of 3 percent of the spread of each coordinate, by simulations."""
    held = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        noisy = dict(columns)
        for name in kernel.coordinates:
            noisy[name] = columns[name] + 0.03 * np.std(columns[name]) * rng.standard_normal(columns[name].size)
        found = fit(boom(), some_of(kernel, noisy, *kernel.coordinates), parameters=tuple(TRUE), kernel=kernel)
        held += [found.estimates[name].low <= x <= found.estimates[name].high for name, x in TRUE.items()]
    assert np.mean(held) > 0.85


def test_identify(built: Build) -> None:
    """What is fixed to the tip, the rotor, friction and modes; the beam's own inertia is known."""
    described = boom()
    load = replace(described.link("load"), mass=0.62, com=(0.03, 0.01, 0.0))
    real = replace(described, links=tuple(load if x.name == "load" else x for x in described.links))
    real = with_parameters(real, {"slew.gamma.armature": 0.07, "slew.gamma.viscous": 0.3})
    kernel = built(real, *KERNELS).replaced(parameters=TRUE)
    motion = motion_from_columns(driven(kernel), kernel.coordinates)
    found = identify(described, motion, terms=("links", "rotors", "viscous", "modes"))
    values = dict(zip(found.base_names, found.base_values.tolist(), strict=True))
    assert not any(name.startswith("arm.m") and "mode" not in name for name in found.base.parameters)
    theta = dict(zip(kernel.regressor_names, kernel.regressor_values.tolist(), strict=True))
    truth = {name: theta[name] for name in ("arm_tip.m", "arm_tip.mx", "arm_tip.my", "arm_tip.izz")}
    truth |= {"slew.gamma.armature": 0.07, "slew.gamma.viscous": 0.3}
    truth |= {"arm.mode1.stiffness": 330.0, "arm.mode1.damping": 0.25}
    assert values == pytest.approx(truth, rel=1e-6)
    assert all(left.relative[1] < 1e-6 for left in found.residuals.values())
    assert not found.warnings
    modes = found.robot.link("arm").modes
    assert modes.K[0][0] == pytest.approx(330.0, rel=1e-6)
    again = built(found.robot, "inverse_dynamics")
    q, v, a = np.random.default_rng(1).normal(size=(3, 20, kernel.n))
    drives = kernel.inverse_dynamics(q, v, a)
    assert np.abs(again.inverse_dynamics(q, v, a) - drives).max() < 1e-4 * np.abs(drives).max()
    refused(InputError, r"arm\.mode1\.stiffness: follows from a link's beam", found.to_toml, "identified.toml")


@pytest.mark.soak
def test_identified_loads_are_written(tmp_path: Path) -> None:
    """What stands on a node goes to the first link there, in its own frame."""
    path = tmp_path / "boom.toml"
    path.write_text(boom_text(7e10, 2.6e10, "{ y = 1 }"), encoding="ascii")
    described = eomgen.load_robot(path)
    kernel = eomgen.build(described, kernels=KERNELS)
    load = replace(described.link("load"), mass=0.62, com=(0.03, 0.01, 0.0))
    real = replace(described, links=tuple(load if x.name == "load" else x for x in described.links))
    motion = motion_from_columns(driven(eomgen.build(real, kernels=KERNELS)), kernel.coordinates)
    found = identify(described, motion, terms=("links",))
    written = eomgen.load_robot(found.to_toml(tmp_path / "identified.toml"))
    assert written.link("load").mass == pytest.approx(0.62, rel=1e-4)
    assert written.link("load").com[:2] == pytest.approx((0.03, 0.01), abs=1e-3)
    assert written.link("arm_tip").mass == 0.0
    assert written.link("arm") == described.link("arm")


def test_base_parameters(kernel: eomgen.Kernel) -> None:
    base = base_parameters(boom(), kernel=kernel, terms=("links", "rotors", "modes"))
    found = ["arm_tip.m", "arm_tip.mx", "arm_tip.my", "arm_tip.izz", "slew.gamma.armature"]
    assert list(base.names) == [*found, "arm.mode1.stiffness", "arm.mode1.damping"]
    q, v, a = np.random.default_rng(2).normal(size=(3, kernel.n))
    theta = dict(zip(kernel.regressor_names, kernel.regressor_values.tolist(), strict=True))
    theta |= {f"arm.mode1.{key}": kernel.parameters[f"links.arm.modes.1.{key}"] for key in ("stiffness", "damping")}
    own = [theta[name] for name in base.parameters]
    others = with_parameters(boom(), dict(zip(base.parameters, 1.3 * np.array(own), strict=True)))
    more = eomgen.build(others, kernels=("inverse_dynamics",)).inverse_dynamics(q, v, a)
    more -= kernel.inverse_dynamics(q, v, a)
    assert np.abs(0.3 * base.regressor(kernel, q, v, a) @ base.values(own) - more).max() < 1e-12 * np.abs(more).max()


def test_modes_of_rigid_links_are_refused() -> None:
    refused(InputError, "terms: modes: no link of one_link bends", base_parameters, "one_link", terms=("modes",))


def test_excitation_is_that_of_rigid_links() -> None:
    found = excite(boom(), duration=1.0, harmonics=2, step=2e-3, starts=1)
    assert any("links do not bend" in note for note in found.notes)
    assert found.series.names == ("slew.gamma",)


def test_compensation_lifts_the_tip_by_its_sag() -> None:
    """Of a level beam at rest: the drive gives way, too, by less than a hundredth of that."""
    described = boom(modes="{ y = 3 }")
    level = replace(described, frames=(Frame("tip", "arm_tip"),))
    scenario = Scenario(0.5, output_step=0.02, motion=Section("point_to_point", {"goal": {"slew": 0.1}}))
    found = compensate(level, scenario, frame="tip", mode="static")
    beam = level.link("arm").beam
    weight, load, EI = 9.81 * beam.density * beam.A, 9.81 * 0.5, beam.E * beam.Iz
    sag = load / (3.0 * EI) + weight / (8.0 * EI) + 0.01 * load / (2.0 * EI)
    assert found.corrected[0, 0] - found.program[0, 0] == pytest.approx(sag, rel=1e-2)
    assert found.rank == (1, 1)


PLACES = ("shoulder.gamma", "elbow.gamma", "tcp.x", "tcp.y", "tcp.z")
ROWS = dict(zip(PLACES, np.random.default_rng(0).uniform(-1.0, 1.0, (20, 5)).T, strict=True))


@pytest.mark.parametrize(
    "ask",
    [
        lambda robot: calibrate(robot, poses_from_columns(ROWS, [*ROWS][:2], ["tcp"]), force=True),
        lambda robot: poses(robot, count=10, candidates=50, ranges=dict.fromkeys([*ROWS][:2], (-1.0, 1.0))),
    ],
    ids=["calibrate", "poses"],
)
def test_errors_of_poses(ask: Callable[[Robot], Any]) -> None:
    """The most informative poses and calibrations; of the rigid robot they are known."""
    robot = eomgen.load_robot("flexible_arm")
    refused(eomgen.InputError, r"links\.upper\.modes: .*rigid links alone; allowed: .*rigid\(\)", ask, robot)
    assert ask(robot.rigid())
