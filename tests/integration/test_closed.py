"""Motions of mechanisms with closed loops: energy, the work of drives, drift, and a published benchmark."""

from __future__ import annotations

import numpy as np
import pytest

import eomgen
from eomgen.errors import InputError
from eomgen.integration import integrate
from eomgen.loops.chart import Chart
from tests.oracles.by_singular_values import ClosedLoops
from tests.support.builds import Build
from tests.support.linkages import KERNELS


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


def test_every_method_keeps_the_balance_of_energy(example) -> None:  # type: ignore[no-untyped-def]
    """A fast crank under a constant torque, by default tolerances; nothing drifts, whatever the steps."""
    kernel = example("four_bar").kernel
    q = kernel.close([1.0, -0.5, 1.0])
    for method in ("auto", "RK45", "Radau", "BDF", "LSODA"):
        motion = integrate(kernel, q, np.zeros(3), 0.3, drive=lambda t, q, v: [20.0, 0.0, 0.0], method=method)
        energy, turned = motion.energy.sum(axis=1), motion.q[:, 0] - q[0]
        assert turned[-1] >= 2.0 * np.pi
        assert np.abs(energy - energy[0] - 20.0 * turned).max() <= 1e-5 * 20.0 * turned[-1]
        assert motion.info["gap"] <= 1e-12
        assert motion.info["gap_rate"] <= 1e-11


def test_methods_that_cannot_keep_loops_closed_are_refused(example) -> None:  # type: ignore[no-untyped-def]
    kernel = example("four_bar").kernel
    with pytest.raises(
        InputError, match="four_bar has loops or couplings, which 'CVODE' does not keep closed; allowed: auto"
    ):
        integrate(kernel, kernel.close([0.5, 0.2, 1.2]), np.zeros(3), 0.1, method="CVODE")


def test_other_coordinates_become_independent_where_that_is_better(example) -> None:  # type: ignore[no-untyped-def]
    """The rocker passes its dead points, where it says nothing of the crank."""
    kernel = example("four_bar").kernel
    q = kernel.close([0.5, 0.2, 1.2], held=["joint1.gamma"])
    v = kernel.close_rates(q, [10.0, 0.0, 0.0], held=["joint1.gamma"])
    motion = integrate(kernel, q, v, 1.0)
    rates = motion.v[:, 2]
    assert (rates[1:] * rates[:-1] < 0.0).sum() >= 2
    assert np.ptp(motion.energy.sum(axis=1)) <= 1e-6 * motion.energy[:, 0].max()
    chart = Chart(kernel, q)
    chart.use(q, chart.close(q[np.newaxis])[1][0])
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
    q = loops.kernel.close(q)  # it is given to 1e-15
    motion = integrate(loops.kernel, q, np.zeros(7), 0.03, drive=lambda t, q, v: u, rtol=1e-10, output_step=0.01)
    assert np.abs(motion.q[-1][places] - ANDREWS_END).max() <= 1e-8
    rates = np.array(ANDREWS_RATES)
    assert (np.abs(motion.v[-1][places[:5]] - rates) <= 1e-8 * rates.max()).all()
    assert motion.info["gap"] <= 1e-12
    energy = motion.energy.sum(axis=1)
    turned = motion.q[-1, places[0]] - q[places[0]]
    assert abs(energy[-1] - energy[0] - 0.033 * turned) <= 1e-8 * energy[-1]
