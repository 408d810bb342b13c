"""Drives that are clipped at their efforts: against SciPy, differences and themselves, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eomgen
from eomgen.errors import ArrayError, InputError, UnknownNameError
from eomgen.integration.solve import integrate
from eomgen.kernel.stepping.input_signals import DriveData, Gains, InputSignals, LinkWrench, Signal, Track
from tests.support.builds import Build
from tests.support.random_robots import random_robot, some_prescribed
from tests.support.rollout_cases import CHOSEN, CLOSED, DT, JOINTS, METHODS, STEPS, Case, assembled, case_of

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = np.ndarray


def effort_of(case: Case) -> Array:
    effort: Array = case.options["saturate"]
    return effort


def asked(case: Case, q: Array, v: Array) -> Array:
    """Return drives of all steps in one state before they are clipped, (STEPS, n)."""
    x = case.given
    return np.asarray(x["u"] + x["kp"] * (x["target"] - q) - x["kd"] * v)


@pytest.mark.parametrize("method", METHODS)
def test_against_scipy(method: str, built: Build) -> None:
    """Drives are held over a step, and the controller follows the state within it."""
    case = case_of(built, "clipped", method)
    kernel, x, n, effort = case.kernel, case.given, case.kernel.n, effort_of(case)
    y, wanted = np.concatenate([x["q"], x["v"]]), []
    for k in range(STEPS):

        def rate(_: float, y: Array, k: int = k) -> Array:
            u = np.clip(asked(case, y[:n], y[n:])[k], -effort, effort)
            return np.concatenate([y[n:], kernel.forward_dynamics(y[:n], y[n:], u)])

        y = solve_ivp(rate, (0.0, DT), y, method="DOP853", rtol=1e-10, atol=1e-12, max_step=DT / 4).y[:, -1]
        wanted.append(y[:n])
    if METHODS[method] is CHOSEN:
        case.options["rtol"] = 1e-9
    if method == "implicit":  # of first order
        case.given = {name: np.repeat(value, 16, axis=0) if value.ndim > 1 else value for name, value in x.items()}
        case.options |= {"dt": DT / 16, "steps": 16 * STEPS, "every": 16}
    found, free = (case.call("rollout", **changed)[0][1:] for changed in ({}, {"saturate": None}))
    size = np.abs(free - found).max()
    off = np.abs(np.array(wanted) - found).max()
    assert size > 1e-4
    assert off < {"rk4": 1e-3, "implicit": 0.05}.get(method, 1e-4) * size


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("method", METHODS)
def test_bits_stay_where_nothing_is_clipped(method: str, dtype: str, built: Build) -> None:
    """And many states have those of each alone, in lanes that are clipped beside others that are not."""
    case = case_of(built, "clipped", method, dtype=dtype)
    case.given = {name: value.astype(dtype) for name, value in case.given.items()}
    if METHODS[method] is CHOSEN:
        case.options["rtol"] = 1e-5
    ends = [case.call("rollout", saturate=x) for x in (None, 1e9 * np.ones(case.kernel.n))]
    assert all(np.array_equal(a, b) for a, b in zip(*ends, strict=True))
    q = (case.given["q"] + np.random.default_rng(1).uniform(-0.3, 0.3, (21, case.kernel.n))).astype(dtype)
    shared = {name: x[np.newaxis] for name, x in case.given.items() if x.ndim == 2}
    many = case.call("rollout", q=q, **shared)[0]
    for i in (0, 7, 20):
        assert np.array_equal(case.call("rollout", q=q[i : i + 1], **shared)[0][0], many[i])


@pytest.mark.parametrize("loop", ["clipped", pytest.param("clipped loop", marks=pytest.mark.soak)])
def test_some_drives_of_gradients_are_clipped(loop: str, built: Build) -> None:
    """Whose gradients test_rollout_gradients.py compares with differences."""
    case = case_of(built, loop, "rk4")
    driven = np.isfinite(effort_of(case))
    clipped = np.abs(asked(case, case.given["q"], case.given["v"]))[:, driven] > effort_of(case)[driven]
    assert 0.2 < clipped.mean() < 0.8


@pytest.mark.parametrize("method", METHODS)
def test_slopes_of_what_is_clipped_and_of_what_is_at_its_effort(method: str, built: Build) -> None:
    case = case_of(built, "clipped", method)
    i = int(np.flatnonzero(case.given["kp"])[0])
    u = np.zeros(case.kernel.n)
    u[i] = 2.0
    case.given = {"q": case.given["q"], "v": case.given["v"], "u": u}
    name = case.kernel.coordinates[i]
    clipped, level, free = (case.gradient(saturate=x)[1]["u"][i] for x in ({name: 1.0}, {name: 2.0}, None))
    assert clipped == 0.0
    assert level == pytest.approx(free, rel=1e-12)
    assert free != 0.0


def under_loads(built: Build, method: str) -> Case:
    """Return a rollout under a program that gains follow, a force, and a wrench, which is not clipped."""
    case = case_of(built, "clipped", method)
    place = np.flatnonzero(case.given["kp"])
    m = place.size
    knots = np.linspace(0.0, STEPS * DT, 5)
    samples = np.random.default_rng(8).uniform(-0.3, 0.3, (5, m))
    gains = Gains(np.full(m, 60.0), np.full(m, 1.0))
    drive = DriveData(Track(Signal.constant(np.full(m, 0.5)), place), Track(Signal.through(knots, samples), place))
    drive = DriveData(drive.torque, drive.program, np.ones(m), gains)
    loads = InputSignals(drive, [LinkWrench(0, Signal.constant([3.0, -2.0, 5.0, 0.1, 0.2, -0.3]))])
    case.given = {"q": case.given["q"], "v": case.given["v"], "u": np.zeros(case.kernel.n), "loads": loads}
    case.options["saturate"] = np.where(np.isin(np.arange(case.kernel.n), place), 4.0, np.inf)
    return case


@pytest.mark.parametrize("method", ["rosenbrock", "tsit5"])
def test_loads_are_clipped_without_their_wrenches(method: str, built: Build) -> None:
    """As SciPy integrates them in Python; the works of clipped drives balance."""
    case = under_loads(built, method)
    kernel, n, loads, effort = case.kernel, case.kernel.n, case.given["loads"], effort_of(case)
    program, gains = loads.drive.program, loads.drive.gains
    place, wrench = program.place, np.zeros((len(kernel.links), 6))
    wrench[0] = loads.wrenches[0].signal.coefficients[0, 0]

    def drive(t: float, q: Array, v: Array) -> Array:
        u = np.zeros(n)
        k = int(np.clip(np.searchsorted(program.signal.knots, t, side="right") - 1, 0, 3))
        first, slope = program.signal.coefficients[k]
        x = first + slope * (t - program.signal.knots[k])
        u[place] = 0.5 + gains.kp * (x - q[place]) + gains.kd * (slope - v[place])
        return np.clip(u, -effort, effort)

    def rate(t: float, y: Array) -> Array:
        u = drive(t, y[:n], y[n:]) + kernel.functions.external_force(y[:n], wrench)
        return np.concatenate([y[n:], kernel.forward_dynamics(y[:n], y[n:], u)])

    begin, end = np.concatenate([case.given["q"], case.given["v"]]), STEPS * DT
    wanted = solve_ivp(rate, (0.0, end), begin, method="DOP853", rtol=1e-10, atol=1e-13, max_step=DT / 4).y[:n, -1]
    found, free = (case.call("rollout", rtol=1e-9, works=True, saturate=x) for x in (effort, None))
    size = np.abs(free[0][-1] - found[0][-1]).max()
    assert size > 1e-3
    assert np.abs(found[0][-1] - wanted).max() < 1e-5 * size
    energy = np.diff(kernel.energy(found[0], found[1]).sum(axis=1)[[0, -1]])[0]
    drives, _, wrenches, dissipated = found.works[-1]
    assert abs(drives + wrenches - dissipated - energy) < 1e-6 * np.abs(found.works[-1]).max()
    assert abs(drives - free.works[-1, 0]) > 1e-2 * abs(drives)


@pytest.mark.parametrize("method", METHODS)
def test_gradients_under_loads(method: str, built: Build) -> None:
    """Forwards and backwards agree, and the wrench acts on what is clipped, too."""
    case = under_loads(built, method)
    case.check_sensitivities(1e-9)
    by, free = (case.gradient(saturate=x)[1] for x in (effort_of(case), None))
    assert np.abs(free["q"] - by["q"]).max() > 1e-3 * np.abs(by["q"]).max()
    assert np.abs(by["loads"]["wrench[0]"]).max() > 0.0


def test_a_mechanism_whose_drive_is_clipped(built: Build) -> None:
    """Loops stay closed; Python integrates the same by its own steps."""
    names = ("adaptive_rollout", "forward_dynamics", "generalized_force", "constrained_dynamics", "kinematics")
    kernel = built(eomgen.load_robot("four_bar"), *names, "energy", *CLOSED)
    q = assembled(kernel)["q"]
    v, i = np.zeros(kernel.n), kernel.raw.libraries.meta["driven"][0]
    kp, target = np.zeros(kernel.n), np.full(kernel.n, 3.0)
    kp[i] = 50.0
    effort = {kernel.coordinates[i]: 0.7}
    how = {"kp": kp, "kd": 0.0 * kp, "target": target, "duration": 0.2, "samples": 4, "rtol": 1e-9}
    ends = [kernel.rollout(q, v, method=method, saturate=effort, **how)[0] for method in ("tsit5", "rosenbrock")]
    assert np.abs(ends[0] - ends[1]).max() < 1e-6

    def drive(_: float, q: Array, v: Array) -> Array:
        u = np.zeros(kernel.n)
        u[i] = np.clip(kp[i] * (3.0 - q[i]), -0.7, 0.7)
        return u

    wanted = integrate(kernel, q, v, 0.2, drive=drive, method="scipy:DOP853", rtol=1e-9)
    assert np.abs(wanted.q[-1] - ends[0][-1]).max() < 1e-6
    assert np.abs(wanted.q[-1] - kernel.rollout(q, v, method="tsit5", **how)[0][-1]).max() > 1e-3


def test_what_cannot_be_clipped_is_named(built: Build) -> None:
    case = case_of(built, "clipped", "rk4")
    kernel, state = case.kernel, (case.given["q"], case.given["v"])
    name = kernel.coordinates[int(np.flatnonzero(case.given["kp"])[0])]
    for saturate, kind, message in (
        (True, InputError, "no drive has a limit of its effort"),
        ({}, InputError, "no drive has a limit of its effort"),
        ({"joint9.gamma": 1.0}, UnknownNameError, "there is no coordinate 'joint9.gamma'"),
        ({name: -1.0}, InputError, f"{name} is -1.0; allowed: a number above 0"),
        ({name: float("nan")}, InputError, f"{name} is nan; allowed: a number above 0"),
        ({name: "much"}, InputError, "'much'; allowed: a number above 0"),
        (np.ones(kernel.n + 1), ArrayError, r"numbers of shape"),
        (2.0, ArrayError, "got 2.0; allowed: True, efforts by coordinate"),
    ):
        for method, how in METHODS.items():
            with pytest.raises(kind, match=message):
                kernel.rollout(*state, method=method, saturate=saturate, **({"u": np.zeros(kernel.n)} | how))
    given = built(some_prescribed(random_robot(5, (2, 2), max_size=5, types=JOINTS), 1), "adaptive_rollout")
    what = given.prescribed[0]
    with pytest.raises(InputError, match=f"{what} has 2, but its motion is prescribed; allowed: drives"):
        given.rollout(np.zeros(given.n), np.zeros(given.n), method="tsit5", duration=1.0, saturate={what: 2.0})
    loads = InputSignals(DriveData(effort=np.zeros(kernel.n)))
    with pytest.raises(InputError, match=r"loads: drive\.effort: .* is 0\.0; allowed: a number above 0"):
        kernel.rollout(*state, method="tsit5", duration=1.0, loads=loads)
