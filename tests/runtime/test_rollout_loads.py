"""Rollouts under loads that are data: closed forms, the bits of states in any company, works, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import ArrayError, InputError
from eomgen.integration.solve import integrate
from eomgen.motion.point_to_point import Harmonic, PointToPoint
from eomgen.motion.splines import signal_of
from eomgen.runtime.stepping.input_signals import (
    WORKS,
    DriveData,
    Gains,
    InputSignals,
    LinkWrench,
    ModelDrive,
    Signal,
    Track,
    Waves,
)
from eomgen.runtime.stepping.options import ADAPTIVE as METHODS
from eomgen.runtime.stepping.reading_inputs import place_prescribed
from tests.codegen.forces.test_laws import slider
from tests.support.builds import Build
from tests.support.random_robots import Array, random_robot, some_prescribed
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

NAMES = (
    "adaptive_rollout",
    "radau_rollout",
    "rollout",
    "forward_dynamics",
    "mass_matrix",
    "inverse_dynamics",
    "energy",
    "kinematics",
)
LOADED = (*NAMES, "generalized_force", "external_force")
FORCE = np.array([3.0, -10.0, 20.0])  # N, of powers of t


def push(factor: float = 1.0) -> InputSignals:
    """A force on the slider that is a polynomial of time."""
    signal = Signal(np.array([0.0, 2.0]), factor * FORCE.reshape(1, 3, 1))
    return InputSignals(DriveData(torque=Track(signal, np.array([0]))))


def aim(kp: float, kd: float, goal: float = 0.3) -> InputSignals:
    """A law that leads the slider to a place."""
    gains = Gains(np.array([kp]), np.array([kd]))
    return InputSignals(DriveData(program=Track(Signal.constant([goal]), np.array([0])), gains=gains))


@pytest.mark.parametrize("method", METHODS)
def test_a_force_that_is_a_polynomial(method: str, built: Build) -> None:
    """For many states at once, beside a drive that stays, and its work."""
    kernel = built(slider(mass=2.0), *LOADED)
    q0, v0 = np.array([[0.0], [1.0], [-2.0]]), np.array([[0.0], [0.5], [3.0]])
    found = kernel.rollout(q0, v0, [1.0], loads=push(), method=method, duration=1.5, samples=6, rtol=1e-9, works=True)
    t = np.linspace(0.0, 1.5, 7)
    force = np.polynomial.Polynomial(FORCE + [1.0, 0.0, 0.0])
    speed = force.integ() / 2.0
    assert found[1][..., 0] == pytest.approx(v0 + speed(t), abs=5e-8)
    assert found[0][..., 0] == pytest.approx(q0 + v0 * t + speed.integ()(t), abs=5e-8)
    gained = 0.5 * 2.0 * (found[1] ** 2 - v0[:, np.newaxis] ** 2)[..., 0]
    assert found.works[..., WORKS.index("drives")] == pytest.approx(gained, rel=1e-7, abs=1e-7)
    assert (found.works[..., 1:] == 0.0).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", soaked(("float64", "float32"), ("float64",)))
def test_every_state_may_have_loads_of_its_own(dtype: str, method: str) -> None:
    """Forces and laws side by side, in vectors and in threads: the bits, works and steps of a state alone."""
    kernel = eomgen.build(slider(mass=2.0, damping=0.4), kernels=LOADED, dtype=dtype, flags=("-O1", "-Werror"))
    rng = np.random.default_rng(3)
    q, v = rng.uniform(-1.0, 1.0, (2, 37, 1)).astype(dtype)
    loads = [push(float(x)) if i % 3 else aim(50.0 * float(x), 4.0) for i, x in enumerate(rng.uniform(0.5, 2.0, 37))]
    how: dict[str, Any] = {"method": method, "duration": 0.5, "samples": 4, "rtol": 1e-4, "works": True}
    whole = kernel.rollout(q, v, loads=loads, **how)
    assert np.ptp(whole.steps) > 0
    for i in (0, 1, 20, 36):
        alone = kernel.rollout(q[i], v[i], loads=loads[i], **how)
        assert alone.steps == whole.steps[i]
        assert np.array_equal(alone.works, whole.works[i])
        assert all(np.array_equal(x[i], y) for x, y in zip(whole, alone, strict=True))
    one = kernel.rollout(q[0], v[0], loads=loads, **how)  # of one state under many loads
    assert np.array_equal(one[0][0], whole[0][0])
    plain = kernel.rollout(q, v, loads=loads, **{**how, "works": False})
    assert all(np.array_equal(x, y) for x, y in zip(whole, plain, strict=True))
    kernel.threads = 2
    again = kernel.rollout(q, v, loads=loads, **how)
    assert np.array_equal(again.works, whole.works)
    assert all(np.array_equal(x, y) for x, y in zip(whole, again, strict=True))


@pytest.mark.soak
@pytest.mark.parametrize("method", METHODS)
def test_what_integrate_takes_rollouts_take(method: str, built: Build) -> None:
    """Objects and data by the names of ``integrate``: a law, wrenches, and prescribed motions that states begin on."""
    robot = some_prescribed(random_robot(1453, joints=(2, 3), types=("revolute", "prismatic")), 1453)
    kernel = built(robot, *LOADED)
    rng, given = np.random.default_rng(5), [kernel.coordinates.index(name) for name in kernel.prescribed]
    shake = Harmonic(np.full(len(given), 0.1), 3.0, 0.4)
    free = np.setdiff1d(np.arange(kernel.n), given)[:1]
    program = signal_of(PointToPoint(np.zeros(1), np.array([0.2]), 0.08, 0.01))
    assert program is not None
    gains = Gains(np.array([200.0]), np.array([5.0]))

    class Law:
        def load_data(self) -> DriveData:
            return DriveData(program=Track(program, free), gains=gains)

        def __call__(self, t: float, q: Array, v: Array) -> Array:
            raise AssertionError

    loads = {"drive": Law(), "wrench": rng.uniform(-3.0, 3.0, (len(kernel.links), 6)), "prescribed": shake}
    q, v = 0.1 * rng.normal(size=(2, 5, kernel.n))
    how: dict[str, Any] = {"method": method, "rtol": 1e-7}
    found = kernel.rollout(q, v, loads=loads, duration=0.1, samples=4, works=True, **how)
    assert found[0][:, 0, given] == pytest.approx(np.tile(shake(0.0)[0], (5, 1)), abs=1e-15)
    for i in (0, 3):
        alone = kernel.rollout(q[i], v[i], loads=loads, duration=0.1, samples=4, works=True, **how)
        assert all(np.array_equal(x[i], y) for x, y in zip((*found, found.works), (*alone, alone.works), strict=True))
        motion = integrate(kernel, q[i], v[i], 0.1, output_step=0.025, works=True, **how, **loads)  # type: ignore[arg-type]
        assert found[0][i] == pytest.approx(motion.q, abs=1e-5)
        assert found.works[i] == pytest.approx(motion.works, abs=1e-5 * np.abs(motion.works).max())  # type: ignore[arg-type]


def test_states_begin_where_tracks_do(built: Build) -> None:
    """A spline, or a path over a profile, in the place of a wave; each state by its own."""
    robot = some_prescribed(random_robot(1453, joints=(2, 3), types=("revolute", "prismatic")), 1453)
    kernel = built(robot, *LOADED)
    count = len(kernel.prescribed)
    line = Signal(np.array([-1.0, 1.0]), np.array([[[2.0], [3.0], [4.0]]]))  # of t + 1
    path = Signal(
        np.array([0.0, 1.0]), np.array([[[1.0], [2.0]]]), Signal(np.array([-1.0, 1.0]), np.full((1, 2, 1), 0.25))
    )
    waves = Waves(np.tile([0.5, 2.0, 0.3, 0.1], (count, 1)))
    every = [
        InputSignals(),
        *(InputSignals(prescribed=replace(waves, tracks=[Track(x, np.array([0]))])) for x in (line, path)),
    ]
    q, v = np.zeros((3, kernel.n)), np.zeros((3, kernel.n))
    place_prescribed(kernel.calls, every, q, v)
    first, *rest = (kernel.coordinates.index(name) for name in kernel.prescribed)
    assert (q[0] == 0.0).all()
    assert q[1:, first] == pytest.approx([9.0, 2.0])
    assert v[1:, first] == pytest.approx([11.0, 0.5])
    assert q[1:, rest] == pytest.approx(0.1 + 0.5 * np.sin(0.3))
    assert v[1:, rest] == pytest.approx(np.cos(0.3))


BAD: dict[str, tuple[Any, str]] = {
    "kind": ("program", r"loads = \"?'program'\"?; allowed: InputSignals, a mapping from drive, wrench, prescribed"),
    "key": ({"drives": 1}, "'drives' is unknown; allowed: drive, wrench, prescribed"),
    "none": ([], "allowed: loads of one state at least"),
    "callable": ({"drive": print}, r"loads: drive: got .*; allowed: DriveData, or an object whose load_data\(\)"),
    "wrench": ({"wrench": np.zeros((2, 6))}, r"loads: wrench: got (.|\n)*allowed: .*finite numbers of shape \(1, 6\)"),
    "prescribed": ({"prescribed": Harmonic([0.1], 1.0)}, "loads: prescribed: .* no coordinate is prescribed"),
    "place": (
        InputSignals(DriveData(torque=Track(Signal.constant([1.0]), np.array([1])))),
        r"drive\.torque\.place: got .*; allowed: 1 whole numbers among 0",
    ),
    "columns": (
        InputSignals(DriveData(torque=Track(Signal.constant([1.0, 2.0]), np.array([0, 0])))),
        r"drive\.torque\.place: .* each place once",
    ),
    "knots": (
        InputSignals(DriveData(torque=Track(Signal(np.array([1.0, 0.0]), np.ones((1, 1, 1))), np.array([0])))),
        r"drive\.torque\.signal\.knots: got .*; allowed: numbers that increase",
    ),
    "pieces": (
        InputSignals(DriveData(torque=Track(Signal(np.arange(3.0), np.ones((1, 1, 1))), np.array([0])))),
        r"signal\.knots: got .*; allowed: finite numbers of shape \(2,\)",
    ),
    "not finite": (
        InputSignals(DriveData(torque=Track(Signal.constant([np.nan]), np.array([0])))),
        r"signal\.coefficients: .* not finite; allowed: finite numbers of shape \(any, any, any\)",
    ),
    "gains": (
        InputSignals(DriveData(gains=Gains(np.ones(1), np.ones(1)))),
        r"drive\.program: got null; allowed: a Track|drive\.program: got None; allowed: a Track",
    ),
    "kp": (
        replace(aim(1.0, 1.0), drive=replace(aim(1.0, 1.0).drive, gains=Gains(np.ones(2), np.ones(1)))),
        r"drive\.gains\.kp: got .* of shape \(1,\)",
    ),
    "ratio": (
        replace(aim(1.0, 1.0), drive=replace(aim(1.0, 1.0).drive, ratio=np.zeros(1))),
        r"drive\.ratio: got .*; allowed: finite numbers, none 0, of shape \(1,\)",
    ),
    "link": (InputSignals(wrenches=[LinkWrench(1, Signal.constant(np.ones(6)))]), r"wrench\[0\]\.link: .* among 0"),
    "six": (InputSignals(wrenches=[LinkWrench(0, Signal.constant(np.ones(3)))]), r"shape \(any, any, 6\)"),
    "arm": (InputSignals(wrenches=[LinkWrench(0, Signal.constant(np.ones(6)), np.ones(2))]), r"arm: .* shape \(3,\)"),
}


@pytest.mark.parametrize("name", BAD)
def test_loads_that_do_not_fit_are_refused(name: str, built: Build) -> None:
    """C follows them without looking."""
    kernel, (loads, says) = built(slider(mass=2.0), *LOADED), BAD[name]
    with pytest.raises(InputError, match=says):
        kernel.rollout([0.0], [0.0], loads=loads, method="tsit5", duration=0.1)


def test_other_refusals(built: Build) -> None:
    kernel = built(slider(mass=2.0), *LOADED)
    how: dict[str, Any] = {"method": "tsit5", "duration": 0.1}
    with pytest.raises(
        InputError, match=r"loads is given; allowed: dt, steps and every with method='rk4', not .* loads"
    ):
        kernel.rollout([0.0], [0.0], dt=0.1, steps=1, loads=push())
    with pytest.raises(InputError, match="works is given; allowed: dt, steps and every with method='implicit'"):
        kernel.rollout([0.0], [0.0], dt=0.1, steps=1, method="implicit", works=True)
    with pytest.raises(ArrayError, match="2 states in loads, but 3 in other arrays"):
        kernel.rollout(np.zeros((3, 1)), [0.0], loads=[push(), push()], **how)
    model = ModelDrive(kernel.calls, np.array([0]), np.ones(1), np.array([1]), np.array([-1]), 30.0)
    with pytest.raises(InputError, match=r"drive\.model\.column: .* allowed: 1 whole numbers among -1, 0"):
        kernel.rollout([0.0], [0.0], loads=InputSignals(replace(aim(1.0, 1.0).drive, model=model)), **how)
    turning = built(random_robot(1045, joints=(1, 1), types=("free",), armature=False, forces=False), *LOADED)
    zero = np.zeros(turning.n)
    with pytest.raises(InputError, match="works: joint1 has 3-DOF rotation; allowed: other joints"):
        turning.rollout(zero, zero, works=True, **how)


def test_without_drives_a_rollout_needs_none(built: Build) -> None:
    kernel = built(slider(mass=2.0), *LOADED)
    q, v = kernel.rollout([0.0], [2.0], dt=0.1, steps=3)
    assert q[:, 0] == pytest.approx([0.0, 0.2, 0.4, 0.6])
    assert (v == 2.0).all()
