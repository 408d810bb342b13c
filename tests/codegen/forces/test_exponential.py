"""An exponential spring in all that is made of a robot: kernels, descriptions, analyses, reports, exports, adapters."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

import eomgen
from eomgen.adapters.mappings import DifferentiableFunction, kernels_for
from eomgen.analysis.holding import fixation_of
from eomgen.authoring.check import check_file
from eomgen.codegen.closed_form.readable import readable_closed_form
from eomgen.description.load import robot_from_toml
from eomgen.errors import ArrayError, DescriptionError, EomgenWarning, InputError
from eomgen.export.fmu.variables import UNITS, make_layout, step_variable
from eomgen.export.mujoco import left_out, mjcf
from eomgen.integration.plan import choose_method
from eomgen.integration.solve import integrate
from eomgen.pipeline.costs import robot_info
from eomgen.robot.model import build_model
from eomgen.robot.record import record_of, robot_hash, robot_of
from eomgen.robot.value import Coordinate, Friction, Motor, Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.assembly import kernels_of
from eomgen.state.springs import coordinate_sizes, stiffnesses
from tests.codegen.forces.test_laws import replaced, slider
from tests.support.builds import Build

F, SCALE = 3.0, 0.05
GIVEN = {"exponential.force": F, "exponential.scale": SCALE}
TEXT = """
name = "slider"
gravity = [0.0, 0.0, 0.0]
[[links]]
name = "block"
mass = 2.0
inertia = { xx = 1.0, yy = 1.0, zz = 1.0 }
[[joints]]
name = "rail"
parent = "base"
child = "block"
type = "prismatic"
z = { LAW }
"""


def described(law: str) -> Robot:
    return robot_from_toml(TEXT.replace("LAW", law))


def test_forces_slopes_and_energy(built: Build) -> None:
    """In many states at once and one by one: the same bits, and those of a formula in NumPy."""
    robot = slider(
        stiffness=40.0,
        damping=0.5,
        preload=1.5,
        cubic=7.0,
        friction=Friction(0.3, None, None, 0.2, 1e-3),
        further=GIVEN,
    )
    kernel = built(robot, "generalized_force", "residual_jacobian", "energy", "inverse_dynamics")
    s, v = np.linspace(-0.4, 0.3, 71)[:, None], np.linspace(-1.0, 1.0, 71)[:, None]
    grown = np.exp(s / SCALE)
    rubbing = 0.3 * v / np.hypot(v, 1e-3) + 0.2 * v
    force = 40.0 * s + 0.5 * v + 1.5 + 7.0 * s**3 + rubbing + F * (grown - 1.0)
    found = kernel.generalized_force(s, v)
    np.testing.assert_allclose(found, -force, rtol=1e-13, atol=1e-13 * np.abs(force).max())
    by_q, by_v, _ = kernel.residual_jacobian(s, v, 0.0 * s)
    np.testing.assert_allclose(by_q[:, 0], 40.0 + 21.0 * s**2 + F / SCALE * grown, rtol=1e-13)
    np.testing.assert_allclose(by_v[:, 0], 0.7 + 0.3e-6 / np.hypot(v, 1e-3) ** 3, rtol=1e-9)
    energy = 20.0 * s**2 + 1.5 * s + 1.75 * s**4 + F * (SCALE * np.expm1(s / SCALE) - s)
    np.testing.assert_allclose(kernel.energy(s, v)[:, 1:], energy, rtol=1e-12, atol=1e-13)
    assert kernel.energy([0.0], [0.0])[1] == 0.0
    assert np.array_equal(found, [kernel.generalized_force(x, y) for x, y in zip(s, v, strict=True)])
    assert np.array_equal(by_q, [kernel.residual_jacobian(x, y, [0.0])[0] for x, y in zip(s, v, strict=True)])


def test_single_precision(built: Build) -> None:
    kernel = built(slider(further=GIVEN), "generalized_force", "forward_dynamics", dtype="float32")
    assert "exponential(" in kernel.source("c")  # of the C library, which takes expf in single precision
    assert "exp(" not in kernel.source("c")
    s = np.linspace(-0.4, 0.3, 19, dtype=np.float32)[:, None]
    found = kernel.generalized_force(s, 0 * s)
    np.testing.assert_allclose(found, -F * np.expm1(s.astype(float) / SCALE), rtol=1e-5, atol=1e-6)
    assert np.array_equal(found, [kernel.generalized_force(x, 0 * x) for x in s])


def test_parameters_are_set_without_compiling(built: Build) -> None:
    kernel = built(slider(further=GIVEN), "generalized_force")
    assert {name: x for name, x in kernel.parameters.items() if "rail" in name} == {
        "joints.rail.z.exponential.force": F,
        "joints.rail.z.exponential.scale": SCALE,
    }
    kernel.parameters.update({"joints.rail.z.exponential.force": 2.0, "joints.rail.z.exponential.scale": 0.1})
    assert kernel.generalized_force([0.1], [0.0]) == pytest.approx([-2.0 * (np.e - 1.0)], rel=1e-14)
    with pytest.raises(InputError, match=r"exponential\.force = -1\.0 is negative; at least 0"):
        kernel.parameters["joints.rail.z.exponential.force"] = -1.0
    with pytest.raises(InputError, match=r"exponential\.scale = 0\.0 is too small; at least 1e-12"):
        kernel.parameters["joints.rail.z.exponential.scale"] = 0.0


def test_energy_is_conserved(built: Build) -> None:
    """A mass that swings between the soft side and the steep one; implicitly it loses, and never gains."""
    kernel = built(slider(further=GIVEN), "rollout", "energy", "forward_dynamics")
    q, v = kernel.rollout(np.zeros(1), np.array([1.0]), np.zeros(1), dt=1e-4, steps=30_000, every=10)
    energy = kernel.energy(q, v).sum(axis=1)
    assert np.max(np.abs(energy - energy[0])) <= 1e-9 * energy[0]
    assert q.min() < -0.2
    assert q.max() > 0.1
    q, v = kernel.rollout(np.zeros(1), np.array([1.0]), np.zeros(1), dt=2e-3, steps=3000, method="implicit")
    energy = kernel.energy(q, v).sum(axis=1)
    assert energy[-1] < energy[0]
    assert energy.max() <= 1.02 * energy[0]


def test_what_counts_as_its_stiffness(built: Build) -> None:
    """That at s = 0, on top of the linear spring's: "auto" is implicit, sizes follow, and it holds its coordinate."""
    robot = slider(further=GIVEN)
    kernel = built(robot, "forward_dynamics", "mass_matrix", "energy", "inverse_dynamics", "forward_dynamics_jacobian")
    assert stiffnesses(kernel) == pytest.approx([F / SCALE])
    assert stiffnesses(built(replaced(robot, stiffness=40.0), "energy")) == pytest.approx([40.0 + F / SCALE])
    assert coordinate_sizes(kernel, np.zeros(1))[0] == pytest.approx([min(1.0, 10.0 * 2.0 / (F / SCALE))])
    assert choose_method(kernel) == "Radau"
    assert robot.joints[0].coordinates["z"].has_stiffness
    deviation = replace(robot, joints=(replace(robot.joints[0], type="fixed"),))
    assert not fixation_of(deviation, built(replace(deviation, name="deviation"), "energy")).still.any()
    kernel.parameters["joints.rail.z.exponential.force"] = 0.0
    assert choose_method(kernel) == "DOP853"


def test_a_simulation(built: Build) -> None:
    """Radau against the static deviation under a constant drive, which a logarithm gives."""
    robot = slider(damping=20.0, further=GIVEN)
    kernel = built(robot, "forward_dynamics", "mass_matrix", "energy", "inverse_dynamics", "forward_dynamics_jacobian")
    found = integrate(kernel, np.zeros(1), np.zeros(1), 8.0, drive=lambda t, q, v: np.full_like(q, 30.0))
    assert found.method == "Radau"
    assert found.q[-1, 0] == pytest.approx(SCALE * np.log(1.0 + 30.0 / F), rel=1e-5)


def test_overflow_is_named(built: Build) -> None:
    kernel = built(
        slider(further=GIVEN), "forward_dynamics", "mass_matrix", "energy", "inverse_dynamics", "generalized_force"
    )
    with pytest.raises(ArrayError, match=r"generalized_force: rail\.z is -inf, out of numbers that are finite"):
        kernel.generalized_force([1000.0 * SCALE], [0.0])
    assert kernel.with_checks(False).generalized_force([1000.0 * SCALE], [0.0]) == [-np.inf]
    assert kernel.generalized_force([-1000.0 * SCALE], [0.0]) == [F]
    with pytest.raises(ArrayError, match=r"forward_dynamics: rail\.z is -inf"):
        integrate(kernel, np.array([1000.0 * SCALE]), np.zeros(1), 0.1, method="DOP853")


def test_descriptions() -> None:
    robot = described("stiffness = 40.0, exponential = { force = 3.0, scale = 0.05 }")
    given = robot.joints[0].coordinates["z"]
    assert given == Coordinate(40.0, further=GIVEN)
    assert given.law() == GIVEN
    assert hash(given) == hash(Coordinate(40.0))  # which need not tell them apart
    assert robot_of(json.loads(json.dumps(record_of(robot)))) == robot
    assert robot_hash(robot) != robot_hash(described("stiffness = 40.0"))
    assert list(build_model(robot).parameters)[3:] == [
        "joints.rail.z.stiffness",
        "joints.rail.z.exponential.force",
        "joints.rail.z.exponential.scale",
    ]


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ("exponential = { force = 3.0 }", r"rail\.z\.exponential: the key 'scale' is missing; allowed: .* m or rad"),
        ("exponential = { scale = 3.0 }", r"rail\.z\.exponential: the key 'force' is missing; allowed: a force"),
        ("exponential = { force = -1, scale = 1 }", r"exponential\.force: got -1; allowed: .* at least 0"),
        ("exponential = { force = 1, scale = 0 }", r"exponential\.scale: got 0; allowed: .* at least 1e-12"),
        ("exponential = { force = 1, scale = -1 }", r"exponential\.scale: got -1; allowed"),
        ("exponential = { force = 1, scale = 1, s = 1 }", r"exponential: unknown key 's'"),
        ("exponential = 3", r"rail\.z\.exponential: got 3; allowed: a table with the keys 'force', 'scale'"),
        (
            "stiffness = 1e5, clearance = 0.1, exponential = { force = 1, scale = 1 }",
            r"z\.exponential: clearance is set, too; allowed: an exponential spring without clearance",
        ),
        (
            "curve = [[0, 0], [1, 1]], exponential = { force = 1, scale = 1 }",
            r"z\.exponential: curve is set, too; allowed: .* without curve, which stands in the place of springs",
        ),
        (
            'role = "locked", exponential = { force = 1, scale = 1 }',
            r"is locked, so that its exponential would do nothing",
        ),
    ],
)
def test_what_is_refused(law: str, message: str, tmp_path: Path) -> None:
    """By readers, and by ``eomgen check`` with the place."""
    with pytest.raises(DescriptionError, match=message):
        described(law)
    path = tmp_path / "slider.toml"
    path.write_text(TEXT.replace("LAW", law), encoding="ascii")
    found = check_file(path)
    assert found.errors
    assert all(f"{path}:" in line for line in found.lines)


def test_numbers_that_python_leaves_out_are_missed() -> None:
    for further, message in (
        ({"exponential.force": 1.0}, r"z\.exponential\.scale: it is missing; allowed: a deviation in m or rad"),
        ({"exponential.scale": 1.0}, r"z\.exponential\.scale: there is no exponential\.force"),
    ):
        with pytest.raises(DescriptionError, match=message):
            build_model(slider(further=further))


def test_texts() -> None:
    """Of ``eomgen info``; the report's tables take the same."""
    lines = robot_info(described("exponential = { force = 3.0, scale = 0.05 }")).lines()
    assert "  exponential.force 3, exponential.scale 0.05" in lines
    assert any(line.startswith("generalized_force") and line.split()[4] == "1" for line in lines)  # an exp


@pytest.mark.parametrize(("linear", "units"), [(True, ["N", "m"]), (False, ["N.m", "rad"])])
def test_units_of_fmi(linear: bool, units: list[str]) -> None:
    robot = slider(further=GIVEN)
    if not linear:
        joint = replace(robot.joints[0], type="revolute", coordinates={"gamma": Coordinate(further=GIVEN)})
        robot = replace(robot, joints=(joint,))
    model = build_model(robot)
    found = [x for x in make_layout(model, step_variable(1e-3), model.home).variables if ".exponential." in x.name]
    assert [(x.unit, x.start, x.minimum) for x in found] == [(units[0], F, 0.0), (units[1], SCALE, 1e-12)]
    assert all(UNITS[x.unit] for x in found)


def test_mujoco_has_no_equal(tmp_path: Path) -> None:
    robot = slider(stiffness=40.0, further=GIVEN)
    assert left_out(robot) == ["joints.rail.z.exponential: left out"]
    with pytest.raises(InputError, match=r"no equal for joints\.rail\.z\.exponential: left out; allowed: without"):
        mjcf(robot, 1e-3)
    with pytest.warns(EomgenWarning, match="exponential: left out"):
        path = eomgen.export_mjcf(robot, tmp_path / "slider.xml", approximate=True)
    assert mujoco.MjModel.from_xml_path(str(path)).jnt_stiffness == [40.0]


def test_transmissions_have_it(built: Build) -> None:
    """It may be a motor's only spring, in units of the joint's side."""
    robot = replace(slider(), joints=(replace(slider().joints[0], motor=Motor(0.1, 50.0, Coordinate(further=GIVEN))),))
    kernel = built(robot, "inverse_dynamics", "forward_dynamics", "energy", "mass_matrix")
    phi = 0.08
    q = np.array([0.3, 50.0 * (0.3 + phi)])
    force = F * np.expm1(phi / SCALE)
    assert kernel.inverse_dynamics(q, [0.0, 0.0], [0.0, 0.0]) == pytest.approx([-force, force / 50.0], rel=1e-13)
    assert kernel.energy(q, [0.0, 0.0])[1] == pytest.approx(F * (SCALE * np.expm1(phi / SCALE) - phi), rel=1e-12)
    assert stiffnesses(kernel) == pytest.approx([F / SCALE, F / SCALE / 2500.0])


def test_closed_form() -> None:
    form = readable_closed_form(build_model(slider(further=GIVEN)))
    assert any("exp(20.0*z_1)" in line for line in form.lines())
    assert "e^{20.0" in form.latex()


def test_bias_without_it(built: Build) -> None:
    """Derivatives of the bias force, which no spring is part of, also where the scale is a micrometre."""
    robot = slider(further={"exponential.force": 5.0, "exponential.scale": 1e-6})
    kernel = built(robot, *kernels_for("bias_force", "generalized_force"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert DifferentiableFunction(kernel, "bias_force").derivatives(np.zeros(1), np.ones(1))[0] == [[0.0]]
        by_q = DifferentiableFunction(kernel, "generalized_force").derivatives(np.zeros(1), np.zeros(1))[0]
    assert by_q == pytest.approx(np.array([[-5e6]]))


def test_scenarios_build_what_its_method_asks_for() -> None:
    implicit, explicit = (scenario_from_toml(f"duration = 1.0\n[integrator]\nmethod = '{x}'") for x in ("Radau", "rk4"))
    robot = slider(further=GIVEN)
    assert "adaptive_rollout" in kernels_of(robot, scenario_from_toml("duration = 1.0"))
    assert set(kernels_of(robot, implicit)) > set(kernels_of(robot, explicit))
