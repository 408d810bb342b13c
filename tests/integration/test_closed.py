"""Motions of mechanisms with closed loops: energy, the work of drives, drift, and a published benchmark."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.arrays import Index
from eomgen.errors import ArrayError, InputError, LoopError
from eomgen.integration import integrate
from eomgen.integration.closed import ClosedSystem
from eomgen.loops.chart import Chart
from eomgen.robot.value import Coordinate, Robot
from tests.oracles.by_singular_values import ClosedLoops
from tests.support.builds import Build
from tests.support.linkages import KERNELS
from tests.support.random_robots import Array
from tests.support.refusals import refused

pytestmark = pytest.mark.quick


@pytest.fixture
def example(built: Build) -> object:
    return lambda name: ClosedLoops(built(eomgen.load_robot(name), *KERNELS))


@pytest.mark.parametrize(
    ("name", "guess", "duration"),
    [("four_bar", [0.5, 0.2, 1.2], 3.0), pytest.param("bennett", [1.0, 1.5, -1.0], 10.0, marks=pytest.mark.soak)],
)
def test_energy_stays_and_nothing_drifts(example, name: str, guess: list[float], duration: float) -> None:  # type: ignore[no-untyped-def]
    loops = example(name)
    q = loops.consistent_positions(guess, held=["joint1.gamma"])
    result = integrate(loops.kernel, q, np.zeros(3), duration, method="rk4", step=2e-3, output_step=0.1)
    assert result.info["gap"] <= 1e-12
    assert result.info["gap_rate"] <= 1e-9
    assert result.info["redundant"] == 3
    assert np.ptp(result.energy.sum(axis=1)) <= 1e-6 * result.energy[:, 0].max()


def test_a_driven_mechanism_takes_the_work_of_its_drive(example) -> None:  # type: ignore[no-untyped-def]
    """A constant torque adds itself times the angle; halving the step divides the error by 16."""
    loops = example("four_bar")
    q = loops.consistent_positions([0.5, 0.2, 1.2], held=["joint1.gamma"])
    errors, ends = [], []
    for step in (4e-3, 2e-3, 5e-4):
        result = integrate(
            loops.kernel,
            q,
            np.zeros(3),
            0.3,
            drive=lambda t, q, v: [4.0, 0.0, 0.0],
            method="rk4",
            step=step,
            output_step=0.3,
        )
        energy = result.energy.sum(axis=1)
        ends.append(result.q[-1])
        errors.append(abs(energy[-1] - energy[0] - 4.0 * (result.q[-1, 0] - q[0])))
    assert errors[-1] <= 1e-8
    assert ends[-1][0] - q[0] > 2.0
    ratio = np.abs(ends[0] - ends[2]).max() / np.abs(ends[1] - ends[2]).max()
    assert 11.0 <= ratio <= 24.0


@pytest.mark.soak
def test_every_method_keeps_the_balance_of_energy(example) -> None:  # type: ignore[no-untyped-def]
    """A fast crank under a constant torque, by default tolerances; nothing drifts, whatever the steps."""
    kernel = example("four_bar").kernel
    q = kernel.assemble([1.0, -0.5, 1.0])
    for method in ("auto", "scipy:RK45", "scipy:Radau", "scipy:BDF", "scipy:LSODA"):
        motion = integrate(kernel, q, np.zeros(3), 0.3, drive=lambda t, q, v: [20.0, 0.0, 0.0], method=method)
        energy, turned = motion.energy.sum(axis=1), motion.q[:, 0] - q[0]
        assert turned[-1] >= 2.0 * np.pi
        assert np.abs(energy - energy[0] - 20.0 * turned).max() <= 1e-5 * 20.0 * turned[-1]
        assert motion.info["gap"] <= 1e-12
        assert motion.info["gap_rate"] <= 1e-11


class Law:
    """Drives that depend on all coordinates and rates; with their slopes if these are asked for."""

    def __init__(self, n: int, exact: bool) -> None:
        rng = np.random.default_rng(5)
        self.by_q, self.by_v = rng.uniform(-3.0, 3.0, (2, n, n))
        if exact:
            self.slopes = lambda t, q, v: (self.by_q * np.cos(q), self.by_v)

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        return self.by_q @ np.sin(q) + self.by_v @ v


def with_moved_pivot(name: str) -> Robot:
    """Return a mechanism whose third joint has a prescribed coordinate along x."""
    robot, given = eomgen.load_robot(name), Coordinate(prescribed=True)
    joints = [replace(joint, coordinates={**joint.coordinates, "x": given}) for joint in robot.joints[2:3]]
    return replace(robot, name=f"moved_{name}", joints=(*robot.joints[:2], *joints, *robot.joints[3:]))


@pytest.mark.parametrize("name", ["four_bar", pytest.param("gough", marks=pytest.mark.soak)])
@pytest.mark.parametrize("exact", [True, False])
def test_jacobians_are_slopes_of_the_derivatives(name: str, exact: bool, built: Build) -> None:
    """Along the loops, with drives, wrenches, dampers and a prescribed coordinate; with the kernel's slopes and not."""
    robot = with_moved_pivot(name)
    slopes = ("forward_dynamics_jacobian",) if exact else ()
    kernel = built(robot, *KERNELS, "external_force", *slopes)
    rng, home = np.random.default_rng(2), np.array([robot.home.get(x, 0.0) for x in kernel.coordinates])
    q, wrench = kernel.assemble(home), rng.uniform(-5.0, 5.0, (len(kernel.links), 6))
    place, rate = kernel.coordinates.index(kernel.prescribed[0]), np.array([0.3])
    v = rng.uniform(-1.0, 1.0, kernel.n)
    v[place] = rate[0]
    v = kernel.project_velocity(q, v, kernel.prescribed)
    motion = lambda t: (q[[place]] + t * rate, rate, 0.0 * rate)  # noqa: E731
    system = ClosedSystem(kernel, Law(kernel.n, exact), wrench, motion)
    y = system.begin(0.0, q, v)
    y += 0.01
    steps = 1e-5 * np.eye(y.size)
    expected = np.array([system.derivative(0.1, y + h) - system.derivative(0.1, y - h) for h in steps]).T / 2e-5
    found = system.jacobian(0.1, y)
    assert system.counts["jacobians"] == 1
    assert np.abs(found - expected).max() <= (1e-7 if exact else 1e-4) * np.abs(expected).max()


def test_prescribed_accelerations_move_the_others(built: Build) -> None:
    """By as much as they do where singular values solve the constraint, with them in place of drives."""
    robot = with_moved_pivot("four_bar")
    kernel = built(robot, *KERNELS, "external_force")
    home, rest = np.array([robot.home.get(x, 0.0) for x in kernel.coordinates]), np.zeros(kernel.n)
    q, place = kernel.assemble(home), kernel.coordinates.index("joint3.x")

    def accelerations(prescribed: float) -> tuple[Index, Array]:
        motion = lambda t: (q[[place]], np.zeros(1), np.array([prescribed]))  # noqa: E731
        system = ClosedSystem(kernel, None, None, motion)
        slopes = system.derivative(0.0, system.begin(0.0, q, rest))
        return system.chart.free, slopes[slopes.size // 2 :]

    (free, moved), (_, still) = accelerations(2.0), accelerations(0.0)
    u = rest + 2.0 * (np.arange(kernel.n) == place)
    loops = ClosedLoops(kernel)
    change = loops.forward_dynamics(q, rest, u).a - loops.forward_dynamics(q, rest, rest).a
    np.testing.assert_allclose(moved - still, change[free], rtol=1e-9)
    assert np.abs(change[free]).min() > 0.1


def test_a_chart_follows_one_state_and_many(example) -> None:  # type: ignore[no-untyped-def]
    """Rates and accelerations are those of the constraint; what is open, singular or no number is said."""
    kernel = example("four_bar").kernel
    q = kernel.assemble([1.0, -0.5, 1.0])
    chart, rng = Chart(kernel, q), np.random.default_rng(1)
    guesses = q + rng.uniform(-0.1, 0.1, (5, 3))
    v, a = rng.uniform(-1.0, 1.0, (2, 5, 3))
    many = chart.follow(guesses, v, a)
    assert np.abs(kernel.functions.constraint(many.q)).max() <= 1e-12
    J, bias = kernel.functions.constraint_jacobian(many.q), kernel.functions.constraint_bias(many.q, many.v)
    assert np.abs(np.einsum("tmn,tn->tm", J, many.v)).max() <= 1e-14
    assert np.abs(np.einsum("tmn,tn->tm", J, many.a) + bias).max() <= 1e-13
    assert np.array_equal(many.q[:, chart.rest], guesses[:, chart.rest])
    for i in range(5):
        one = chart.follow(guesses[i], v[i], a[i])
        for found, expected in zip(one, many, strict=True):
            assert np.array_equal(found, expected[i])
    refused(LoopError, r"loop joint4 comes open", chart.follow, q + [0.0, 0.0, 2.5], near=True)
    refused(ArrayError, r"q: .*joint1\.gamma", chart.follow, q * [np.nan, 1.0, 1.0])
    refused(ArrayError, r"v: .*joint1\.gamma", chart.follow, q, q * [np.inf, 1.0, 1.0])


def test_methods_that_cannot_keep_loops_closed_are_refused(example) -> None:  # type: ignore[no-untyped-def]
    kernel = example("four_bar").kernel
    with pytest.raises(
        InputError, match="four_bar has loops or couplings, which 'CVODE' does not keep closed; allowed: auto"
    ):
        integrate(kernel, kernel.assemble([0.5, 0.2, 1.2]), np.zeros(3), 0.1, method="CVODE")


def test_other_coordinates_become_independent_where_that_is_better(example) -> None:  # type: ignore[no-untyped-def]
    """The rocker passes its dead points, where it says nothing of the crank."""
    kernel = example("four_bar").kernel
    q = kernel.assemble([0.5, 0.2, 1.2], fixed=["joint1.gamma"])
    v = kernel.project_velocity(q, [10.0, 0.0, 0.0], fixed=["joint1.gamma"])
    motion = integrate(kernel, q, v, 1.0)
    rates = motion.v[:, 2]
    assert (rates[1:] * rates[:-1] < 0.0).sum() >= 2
    assert np.ptp(motion.energy.sum(axis=1)) <= 1e-6 * motion.energy[:, 0].max()
    chart = Chart(kernel, q)
    chart.use(q, chart.assemble(q[np.newaxis])[1][0])
    assert chart.moved() is None


ANDREWS = ("beta", "theta", "gamma", "phi", "delta", "omega", "epsilon")  # in the order of the test set


# F. Mazzia, C. Magherini, Test Set for IVP Solvers, release 2.4: initial values, and the solution at 0.03 s by PSIDE.
ANDREWS_START = [
    -0.0617138900142764496,
    0.0,
    0.455279819163070380,
    0.222668390165885885,
    0.487364979543842550,
    -0.222668390165885885,
    1.23054744454982120,
]


ANDREWS_END = [
    15.81077119629904,
    -15.75637105984298,
    0.04082224013073101,
    -0.5347301163226948,
    0.5244099658805304,
    0.5347301163226948,
    1.048080741042263,
]


ANDREWS_RATES = [1139.920302151208, -1424.379294994111, 11.03291221937134, 19.29337464421385, 0.5735699284790808]


@pytest.mark.soak
def test_andrews_squeezing_mechanism(built: Build) -> None:
    """Seven bodies, three loops through one pin with nine redundant constraints, a spring, 1100 rad/s at the end."""
    loops = ClosedLoops(built(eomgen.load_robot("andrews"), *KERNELS))
    places = [loops.kernel.coordinates.index(f"{name}.gamma") for name in ANDREWS]
    q, u = np.zeros(7), np.zeros(7)
    q[places], u[places[0]] = ANDREWS_START, 0.033
    found = loops.forward_dynamics(q, np.zeros(7), u)
    assert np.abs(found.a[places[:2]] - [14222.4439199541387, -10666.8329399655854]).max() <= 1e-8
    assert np.abs(found.a[places[2:]]).max() <= 1e-8
    assert (found.redundancy.mobility, len(found.redundancy.redundant)) == (1, 9)
    q = loops.kernel.assemble(q)  # it is given to 1e-15
    motion = integrate(loops.kernel, q, np.zeros(7), 0.03, drive=lambda t, q, v: u, rtol=1e-10, output_step=0.01)
    assert np.abs(motion.q[-1][places] - ANDREWS_END).max() <= 1e-8
    rates = np.array(ANDREWS_RATES)
    assert (np.abs(motion.v[-1][places[:5]] - rates) <= 1e-8 * rates.max()).all()
    assert motion.info["gap"] <= 1e-12
    energy = motion.energy.sum(axis=1)
    turned = motion.q[-1, places[0]] - q[places[0]]
    assert abs(energy[-1] - energy[0] - 0.033 * turned) <= 1e-8 * energy[-1]
