"""Stops: contacts at which a coordinate ends, against a law with branches, SciPy, and the account of energy."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

from eomgen.description.load import robot_from_toml
from eomgen.export.fmu.variables import make_layout, step_variable
from eomgen.integration.contacts import Contact
from eomgen.integration.plan import choose_method
from eomgen.integration.solve import integrate
from eomgen.integration.steps import fixed_step
from eomgen.pipeline.costs import robot_info
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Coupling, Joint, Link, Loop, Motor, Robot
from eomgen.state.springs import coordinate_sizes, law_numbers, stiffnesses, stops
from tests.codegen.forces.test_laws import slider
from tests.oracles.force_laws import resistance
from tests.support.builds import Build
from tests.support.joint_table import joint_table, link_table
from tests.support.methods import method_of
from tests.support.random_robots import Array

STOPS = {
    "stops.stiffness": 4e3,
    "stops.damping": 6.0,
    "stops.restitution_damping": 0.3,
    "stops.smoothing": 2e-3,
    "stops.lower": -0.1,
    "stops.upper": 0.2,
}
NAMES = ("forward_dynamics", "inverse_dynamics", "mass_matrix", "energy", "forward_dynamics_jacobian")


def stopped(name: str = "slider", **numbers: Any) -> Robot:
    """A mass of 2 kg between stops; a number that is None is left out."""
    given = {key: x for key, x in {**STOPS, **{f"stops.{k}": x for k, x in numbers.items()}}.items() if x is not None}
    return slider(name=name, further=given)


def law_of(robot: Robot) -> Coordinate:
    return robot.joints[0].coordinates["z"]


@pytest.mark.parametrize("end", ["lower", "upper"])
def test_it_sets_in_without_a_jump_and_never_pulls(end: str, built: Build) -> None:
    """At any rate, with dampers of both kinds, at both ends; what they take is never given."""
    kernel = built(stopped(damping=300.0, restitution_damping=2.0), "generalized_force", "energy")
    side, at = (1.0, 0.2) if end == "upper" else (-1.0, -0.1)
    for rate in (-50.0, -1.0, 1.0, 50.0):
        x = np.linspace(0.0, 1e-2, 10_001)[:, None]
        push = -side * kernel.generalized_force(at + side * x, np.full_like(x, side * rate))
        assert push.min() >= 0.0
        assert push[0, 0] == 0.0
        steepest = 4e3 + 50.0 / 2e-3 * (300.0 + 2.0 * 4e3 * 1e-2) + 2.0 * 4e3 * 50.0
        assert np.abs(np.diff(push[:, 0])).max() <= steepest * 1e-6
        elastic = -side * kernel.generalized_force(at + side * x, 0.0 * x)
        assert ((push - elastic) * rate).min() >= 0.0
    assert kernel.generalized_force([0.05], [50.0]) == 0.0


def test_a_bouncing_mass_is_scipys(built: Build) -> None:
    """At both ends, with gravity along the rail: own equations of motion, events where stops are met."""
    robot = replace(stopped(), gravity=(0.0, 0.0, -3.0))
    kernel, given = built(robot, *NAMES, "rollout"), law_of(robot)

    def rate(_: float, y: Array) -> list[float]:
        return [y[1], -3.0 - resistance(given, y[0], y[1]) / 2.0]

    def meets(_: float, y: Array) -> float:
        return float((y[0] - 0.2) * (y[0] + 0.1))

    expected = solve_ivp(
        rate, (0.0, 1.0), [0.0, 3.0], method="DOP853", rtol=1e-11, atol=1e-13, max_step=1e-3, events=meets
    )
    found = integrate(kernel, np.zeros(1), np.array([3.0]), 1.0, rtol=1e-9)
    assert found.method == "scipy:Radau"
    assert found.q[-1, 0] == pytest.approx(expected.y[0, -1], abs=1e-7)
    assert found.v[-1, 0] == pytest.approx(expected.y[1, -1], abs=1e-5)
    assert {c.side for c in found.contacts} == {1, -1}
    assert {c.kind for c in found.contacts} == {"stop"}
    assert [c.t for c in found.contacts] == pytest.approx(list(expected.t_events[0]), abs=1e-7)
    assert [c.closes for c in found.contacts] == [i % 2 == 0 for i in range(len(found.contacts))]
    q, v = kernel.rollout(np.zeros(1), np.array([3.0]), np.zeros(1), dt=1e-5, steps=100_000, every=100_000)
    assert q[-1, 0] == pytest.approx(expected.y[0, -1], abs=1e-6)
    assert v[-1, 0] == pytest.approx(expected.y[1, -1], abs=1e-4)


def test_energy(built: Build) -> None:
    """Without damping a mass bounces for ever; with it energy never grows, and what is lost is the dampers' work."""
    kernel = built(stopped(damping=None, restitution_damping=None), "rollout", "energy", "forward_dynamics")
    q, v = kernel.rollout(np.zeros(1), np.array([2.0]), np.zeros(1), dt=2e-5, steps=100_000, every=50)
    energy = kernel.energy(q, v).sum(axis=1)
    assert np.abs(energy / energy[0] - 1.0).max() <= 1e-8
    assert q.min() < -0.1
    assert q.max() > 0.2
    robot = stopped()
    kernel = built(robot, "rollout", "energy", "forward_dynamics", "generalized_force")
    q, v = kernel.rollout(np.zeros(1), np.array([2.0]), np.zeros(1), dt=1e-5, steps=40_000)
    energy = kernel.energy(q, v).sum(axis=1)
    assert np.diff(energy).max() <= 1e-10 * energy[0]
    assert energy[-1] < 0.5 * energy[0]
    taken = (kernel.generalized_force(q, v) - kernel.generalized_force(q, 0.0 * v)) * v
    assert float(np.trapezoid(taken[:, 0], dx=1e-5)) == pytest.approx(energy[-1] - energy[0], rel=1e-5)


def test_rest_on_a_stop(built: Build) -> None:
    """The penetration carries the weight: m g = k (x - w / 2)."""
    robot = replace(stopped(damping=200.0), gravity=(0.0, 0.0, -10.0))
    found = integrate(built(robot, *NAMES), np.zeros(1), np.zeros(1), 3.0)
    assert found.q[-1, 0] == pytest.approx(-0.1 - 20.0 / 4e3 - 1e-3, abs=1e-7)
    assert abs(found.v[-1, 0]) < 1e-6


def test_one_end_is_open(built: Build) -> None:
    kernel = built(stopped("upper_alone", lower=None), *NAMES, "generalized_force")
    assert kernel.generalized_force([-100.0], [-5.0]) == 0.0
    assert kernel.generalized_force([0.3], [0.0])[0] < 0.0
    assert stops(law_numbers(kernel)) == {"rail.z": (-np.inf, 0.2)}
    found = integrate(kernel, np.zeros(1), np.array([-2.0]), 1.0)
    assert found.contacts == ()
    assert not any("lower" in name for name in kernel.parameters)


def test_stops_are_moved_while_it_runs(built: Build) -> None:
    kernel = built(stopped(), *NAMES, "generalized_force").replaced(parameters={"joints.rail.z.stops.upper": 0.5})
    assert kernel.generalized_force([0.4], [1.0]) == 0.0
    kernel.parameters.update({"joints.rail.z.stops.stiffness": 100.0, "joints.rail.z.stops.damping": 0.0})
    assert kernel.generalized_force([0.601], [0.0]) == pytest.approx([-100.0 * 0.1])
    assert kernel.generalized_force([-0.201], [0.0]) == pytest.approx([100.0 * 0.1])
    found = integrate(kernel, np.zeros(1), np.array([1.0]), 0.6)
    assert [(c.side, c.t) for c in found.contacts] == [(1, pytest.approx(0.5, abs=1e-5))]


def test_implicit_steps_of_any_stiffness(built: Build) -> None:
    """A thousand times too long for an explicit method: no impact gives speed, and a pressed mass stays on its stop.

    It rests where the way of its acceleration in a step is less than the stop's onset can follow.
    """
    kernel = built(stopped(stiffness=1e11, smoothing=1e-4), "rollout", "forward_dynamics")
    q, v = kernel.rollout(np.zeros(1), np.array([3.0]), np.zeros(1), dt=1e-3, steps=2000, method="implicit")
    assert np.abs(v).max() <= 3.0
    assert q.max() <= 0.2 + 3e-3
    assert q.min() >= -0.1 - 3e-3
    q, v = kernel.rollout(np.zeros(1), np.zeros(1), np.array([50.0]), dt=1e-3, steps=5000, method="implicit")
    assert np.abs(q[1000:] - 0.2).max() <= 50.0 / 2.0 * 1e-6
    kernel.parameters["joints.rail.z.stops.stiffness"] = 1e9
    q, v = kernel.rollout(np.zeros(1), np.zeros(1), np.array([50.0]), dt=1e-3, steps=5000, method="implicit")
    assert q[-1, 0] == pytest.approx(0.2 + np.sqrt(2.0 * 1e-4 * 50.0 / 1e9), abs=1e-12)
    assert abs(v[-1, 0]) < 1e-10


def test_what_counts_as_its_stiffness(built: Build) -> None:
    """Methods and steps follow it; sizes do not, and between its stops nothing holds a coordinate."""
    robot = stopped()
    kernel = built(robot, *NAMES)
    assert choose_method(kernel) == "scipy:Radau"
    assert stiffnesses(kernel) == [0.0]
    assert coordinate_sizes(kernel, np.zeros(1))[0] == [1.0]
    assert not law_of(robot).has_stiffness
    stiff = kernel.replaced(parameters={"joints.rail.z.stops.stiffness": 2e10})
    assert fixed_step(stiff, np.zeros(1), None, np.array([0.0, 1.0])) == pytest.approx(0.5e-5)
    none = kernel.replaced(parameters={"joints.rail.z.stops.stiffness": 0.0, "joints.rail.z.stops.damping": 0.0})
    assert choose_method(none) == "scipy:DOP853"


@pytest.mark.skipif(importlib.util.find_spec("sksundae") is None, reason="scikit-sundae is not installed")
@pytest.mark.parametrize("method", ["CVODE", "IDA"])
def test_events_of_sundials(method: str, built: Build) -> None:
    kernel = built(stopped(), *NAMES, "residual", "residual_jacobian")
    found = integrate(kernel, np.zeros(1), np.array([2.0]), 0.5, method=method, rtol=1e-8)
    assert [(c.side, c.closes) for c in found.contacts] == [(1, True), (1, False), (-1, True), (-1, False)]
    assert found.contacts[0] == Contact(pytest.approx(0.1), "rail.z", 1, True, pytest.approx(2.0), "stop")


def geared(*, joint: dict[str, float] | None = None, shaft: dict[str, float] | None = None, name: str) -> Robot:
    motor = Motor(0.02, 10.0, Coordinate(300.0, 2.0), further=shaft or {})
    link = Link("arm", 1.0, (0.0, 0.0, 0.0), (0.5, 0.5, 0.5, 0.0, 0.0, 0.0))
    given = {"gamma": Coordinate(further=joint or {})}
    return Robot(
        name, (0.0, 0.0, 0.0), (link,), (Joint("j", "base", "arm", "revolute", coordinates=given, motor=motor),)
    )


TURNED = {key: value for key, value in STOPS.items() if key != "stops.lower"} | {"stops.upper": 0.5}


def test_stops_of_a_joint_behind_a_motor(built: Build) -> None:
    """The joint's stop holds the joint alone: its motor winds the transmission up."""
    kernel = built(geared(joint=TURNED, name="stopped_joint"), *NAMES, "rollout")
    q, _ = kernel.rollout(np.zeros(2), np.zeros(2), np.array([0.0, 6.0]), dt=2e-3, steps=8000, method="implicit")
    assert q[-1, 0] == pytest.approx(0.5 + 60.0 / 4e3 + 1e-3, abs=1e-5)
    assert q[-1, 1] / 10.0 - q[-1, 0] == pytest.approx(60.0 / 300.0, abs=1e-4)


def test_stops_of_a_shaft(built: Build) -> None:
    """In rad and N m at the shaft; the contact is the motor's own, not the transmission's."""
    robot = geared(shaft={**TURNED, "stops.upper": 5.0}, name="stopped_shaft")
    kernel = built(robot, *NAMES)
    assert kernel.inverse_dynamics([0.51, 5.1], np.zeros(2), np.zeros(2)) == pytest.approx([0.0, 4e3 * (0.1 - 1e-3)])
    assert kernel.parameters["joints.j.motor.stops.upper"] == 5.0
    found = integrate(kernel, np.zeros(2), np.array([3.0, 30.0]), 0.4)
    assert found.contacts[0].coordinate == "j.motor"
    assert (found.contacts[0].side, found.contacts[0].kind) == (1, "stop")
    layout = make_layout(build_model(robot), step_variable(1e-3), (0.0, 0.0)).variables
    units = {x.name.rpartition(".")[2]: x.unit for x in layout if ".stops." in x.name}
    assert units == {
        "stiffness": "N.m/rad", "damping": "N.m.s/rad", "restitution_damping": "s/rad", "smoothing": "rad",
        "upper": "rad",
    }  # fmt: skip
    assert any("stops.stiffness 4000" in line for line in robot_info(robot).lines())


def test_cut_joints_and_couplings_have_them(built: Build) -> None:
    """Between what they join, as any law: the same force as in a joint."""
    rails = tuple(Joint(f"rail{i}", "base", f"block{i}", "prismatic", coordinates={"z": Coordinate()}) for i in (1, 2))
    links = tuple(Link(f"block{i}", 1.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)) for i in (1, 2))
    robot = Robot("pair", (0.0, 0.0, 0.0), links, rails)
    table = Coordinate(further=STOPS)
    both = {name: Coordinate() for name in ("x", "y", "alpha", "beta", "gamma")}
    loop = Loop("cut", ("block1", "block2"), "fixed", coordinates={**both, "z": table})
    coupled = Coupling("ends", "rail2.z", {"rail1.z": 1.0}, law=table)
    for made in (replace(robot, name="cut", loops=(loop,)), replace(robot, name="coupled", couplings=(coupled,))):
        kernel = built(made, "inverse_dynamics", "forward_dynamics", "mass_matrix", "energy")
        for s, v in ((0.25, 0.4), (-0.13, -2.0), (0.1, 1.0)):
            force = resistance(table, s, v)
            found = kernel.inverse_dynamics([0.3, 0.3 + s], [0.0, v], np.zeros(2), cut=True)
            assert found == pytest.approx([-force, force], rel=1e-12, abs=1e-12)
        assert choose_method(kernel) == "scipy:Radau"


W, GAP, K, C = float(np.float32(1e-6)), 2.0**-5, 2.0**10, 0.25  # m, m, N/m, s/m: exact in any precision
KNOTS = {-2.0: -7.0, -1.0: -7.0, 0.0: 0.0, 1.0: 7.0, 2.0: 7.0}  # in units of W: N
CONTACT = f"stiffness = {K}, clearance = {GAP}, smoothing = {W}, restitution_damping = {C}"
SLIDES = {
    "clearance": "{ " + CONTACT + " }",
    "stops": f"{{ stops = {{ stiffness = {K}, damping = 1.5, restitution_damping = {C}, smoothing = {W}, "
    f"lower = {-GAP}, upper = {GAP} }} }}",
    "stiffness_negative": f"{{ stiffness = {K}, stiffness_negative = {2.0**40} }}",
    "stiffness_positive": f"{{ stiffness = {2.0**40}, stiffness_negative = {K} }}",
    "curve": f"{{ curve = {[[W * x, force] for x, force in KNOTS.items()]} }}",
}
EPS = float(np.finfo(np.float32).eps)
CONTACTS = ("generalized_force", "residual_jacobian", "energy")


def body(name: str, kind: str) -> str:
    """Return a link and its joint to the base, behind which the joint's laws may stand."""
    link = link_table(f"{name}_body", 1.0, inertia=(1.0, 1.0, 1.0))
    return f"{link}\n{joint_table(name, 'base', f'{name}_body', kind)}\n"


def slides() -> Robot:
    """A slide for every law, without gravity."""
    text = "".join(body(name, "prismatic") + f"z = {law}\n" for name, law in SLIDES.items())
    return robot_from_toml(f'name = "slides"\ngravity = [0.0, 0.0, 0.0]\n{text}')


def everywhere() -> Robot:
    """The same contact in a joint, a journal with a length, a coupling, a cut joint, its journal and a cable."""
    radial = f"radial = {{ {CONTACT}, length = 0.5, friction = {{ coefficient = 0.125, smoothing = 0.125 }} }}\n"
    cut = radial.replace("length = 0.5, ", "")
    six = "".join(f"{name} = {{}}\n" for name in ("x", "y", "alpha", "beta"))
    return robot_from_toml(
        'name = "everywhere"\ngravity = [0.0, 0.0, 0.0]\n'
        + body("pin", "revolute") + six + radial
        + body("one", "prismatic") + f"x = {{ {CONTACT} }}\ny = {{}}\n"
        + body("two", "prismatic")
        + f'[[couplings]]\nname = "belt"\nof = "one.z"\nto = {{ "two.z" = 2.0 }}\n{CONTACT.replace(", ", chr(10))}\n'
        + '[[loops]]\nname = "cut"\nlinks = ["base", "one_body"]\ntype = "fixed"\n'
        + f"x = {{}}\ny = {{}}\nz = {{ {CONTACT} }}\nalpha = {{ stiffness = 1.0 }}\nbeta = {{ stiffness = 1.0 }}\n"
        + f"gamma = {{ stiffness = 1.0 }}\n{cut}"
        + '[[springs]]\nname = "cable"\nlinks = ["base", "two_body"]\npoints = [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]\n'
        + f"free_length = 0.5\nstiffness = {K}\ntension_only = true\nsmoothing = {W}\n"
    )  # fmt: skip


def deep(s: Array, v: Array) -> tuple[Array, Array, Array]:
    """Force towards positive s of the contact at its positive end, d_dot and its energy, in long double."""
    x = np.abs(s.astype(np.longdouble)) - GAP
    d = np.where(x < W, x * x / (2 * W), x - np.longdouble(W) / 2)
    energy = np.where(x < W, x**3 / (6 * W), d * d / 2 + np.longdouble(W) ** 2 / 24)
    inside = x <= 0.0
    rate = np.sign(s) * v.astype(np.longdouble) * np.clip(x / W, 0, 1)
    return np.where(inside, 0, K * d), rate, np.where(inside, 0, K * energy)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_they_have_all_digits(dtype: str, built: Build) -> None:
    """Forces, slopes and energies of both sides against branches in long double, at all depths."""
    kernel = built(slides(), *CONTACTS, dtype=dtype)
    depths = np.concatenate([W * np.array([-1e3, 0.25, 0.5, 1.0, 1.5, 3.0]), np.geomspace(1e-5, 8.0, 40)])
    s = np.concatenate([GAP + depths, -GAP - depths]).astype(dtype)
    rng = np.random.default_rng(0)
    v = rng.uniform(-8.0, 8.0, len(s)).astype(dtype)
    q, rates = (np.repeat(x[:, np.newaxis], kernel.n, axis=1) for x in (s, v))
    found = -kernel.generalized_force(q, rates)
    by_q, by_v, _ = kernel.residual_jacobian(q, rates, np.zeros_like(q))
    elastic, rate, energy = deep(s, v)
    side, slope = np.sign(s), np.clip((np.abs(s.astype(np.longdouble)) - GAP) / W, 0, 1)
    raised = np.maximum(1 + C * rate, 0)
    pushes = np.maximum(elastic * (1 + C * rate) + 1.5 * rate, 0)
    soft = [np.where(s > 0, a, b) for a, b in ((K, 2.0**40), (2.0**40, K))]
    wanted = {
        "clearance": (side * elastic * raised, elastic * C * slope * (raised > 0)),
        "stops": (side * pushes, (elastic * C + 1.5) * slope * (pushes > 0)),
        "stiffness_negative": (soft[0] * s, 0.0 * s),
        "stiffness_positive": (soft[1] * s, 0.0 * s),
        "curve": (PchipInterpolator(*zip(*KNOTS.items(), strict=True))(np.clip(s / W, -2.0, 2.0)), 0.0 * s),
    }
    allowed = 16 * float(np.finfo(dtype).eps)
    deviation = np.abs(s.astype(np.longdouble)) / np.maximum(np.abs(np.abs(s) - GAP), W)  # of the penetration's digits
    for i, (name, (force, damping)) in enumerate(wanted.items()):
        tolerance = allowed * np.maximum(np.abs(force), 1e-30) * (1 + deviation)
        np.testing.assert_array_less(np.abs(found[:, i] - force), tolerance + 1e-30, err_msg=name)
        if name in ("clearance", "stops"):
            tolerance = allowed * (np.abs(damping) + K * W) * (1 + deviation)
            np.testing.assert_array_less(np.abs(by_v[:, i, i] - damping), tolerance, err_msg=name)
    for i in (2, 3):
        np.testing.assert_array_equal(by_q[:, i, i], soft[i - 2])
    stored = kernel.energy(q * (np.arange(kernel.n) < 2), 0.0 * q)[:, 1]
    curve = allowed * 7.0 * W  # that of the curve is a difference of what it has here and at 0
    np.testing.assert_array_less(np.abs(stored - 2 * energy), 3 * allowed * energy * (1 + deviation) + curve)


@pytest.mark.soak
def test_so_they_have_in_journals_couplings_cut_joints_and_cables(built: Build) -> None:
    """Single precision against double: forces 0.3 m deep, with the slopes that derivatives have there."""
    names = (*CONTACTS, "spring_forces", "cut_forces")
    single, double = (built(everywhere(), *names, dtype=dtype) for dtype in ("float32", "float64"))
    rng = np.random.default_rng(1)
    q = (rng.uniform(0.15, 0.4, (60, double.n)) * rng.choice([-1.0, 1.0], (60, double.n))).astype(np.float32)
    v = rng.uniform(-2.0, 2.0, q.shape).astype(np.float32)
    for name, args in (
        ("generalized_force", (q, v)),
        ("residual_jacobian", (q, v, 0 * v)),
        ("spring_forces", (q, v)),
        ("cut_forces", (q, v)),
        ("energy", (q, v)),
    ):
        found, wanted = (
            method_of(kernel, name)(*(x.astype(kernel.dtype) for x in args)) for kernel in (single, double)
        )
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=64 * EPS * np.abs(wanted).max(), err_msg=name)
        assert np.abs(wanted).max() > 100.0
