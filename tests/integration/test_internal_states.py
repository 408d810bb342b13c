"""Integrations of robots whose laws have states: arguments of coordinates alone, steps, bounds, and what is said."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import ArrayError, InputError, IntegrationStopped
from eomgen.integration.plan import stiff_in_real_time, why_stiff
from eomgen.integration.solve import integrate
from eomgen.integration.trajectory import Trajectory, motion_columns
from eomgen.integration.until import Until
from eomgen.kernel.stepping.methods import METHODS, SUNDIALS
from tests.support.bristled import ARM, SERVO
from tests.support.bristles import block, gear_text, rates
from tests.support.builds import Build
from tests.support.drive_reference import DRIVES, servo
from tests.support.refusals import refused

FAST = {"output_step": 0.002}  # a block at 1 m/s: bristles follow within 17 us


@pytest.fixture(scope="module")
def kernel(built: Build) -> eomgen.Kernel:
    return built(block())


@pytest.mark.parametrize("method", [x for x in METHODS if x not in SUNDIALS])
def test_all_methods_agree_at_any_speed(method: Any, kernel: eomgen.Kernel) -> None:
    """Of rk4 by its default step, too, which bristles at this speed make a hundred times shorter than at rest."""
    motion = integrate(kernel, [0.0], [1.0], 0.02, method=method, rtol=1e-7, **FAST)
    exact = integrate(kernel, [0.0], [1.0], 0.02, method="radau", rtol=1e-10, **FAST)
    assert (motion.internal_states, motion.coordinates) == (("slide.z.friction.z",), ("slide.z",))
    assert motion.z is not None
    assert exact.z is not None
    for name in ("q", "v", "z"):
        assert getattr(motion, name) == pytest.approx(getattr(exact, name), rel=1e-4, abs=1e-9)


def test_steps_of_rk4_are_as_short_as_bristles_need(kernel: eomgen.Kernel) -> None:
    fast, slow = (integrate(kernel, [0.0], [v], 0.002, method="rk4", output_step=0.001) for v in (1.0, 1e-6))
    assert fast.info["steps"] > 100
    assert slow.info["steps"] <= 4


@pytest.mark.parametrize("step", [1e-4, 1e-3])
def test_steps_that_are_too_long_are_refused(step: float, kernel: eomgen.Kernel) -> None:
    """A motion with a state beyond its bound is wrong, and finite for a while: it is refused with the state's name."""
    with pytest.raises(
        IntegrationStopped, match=r"slide\.z\.friction\.z is .* cannot exceed 1\.65e-05.*rosenbrock"
    ) as e:
        integrate(kernel, [0.0], [1.0], 0.02, method="rk4", step=step, **FAST)
    stop: IntegrationStopped = e.value
    assert (stop.coordinate, stop.t) == ("slide.z.friction.z", 0.0)
    assert [len(x) for x in (stop.q, stop.v, stop.z)] == [1, 1, 1]
    assert stop.trajectory.z.shape == stop.trajectory.q.shape == (1, 1)
    again = pickle.loads(pickle.dumps(stop))
    assert (again.z == stop.z).all()


def test_rollouts_with_steps_that_are_too_long_are_refused(kernel: eomgen.Kernel) -> None:
    how: dict[str, Any] = {"dt": 1e-4, "steps": 4, "method": "rk4"}
    with pytest.raises(IntegrationStopped, match=r"dt is too long: at t = 0\.0001 s slide\.z\.friction\.z") as alone:
        kernel.rollout([0.0], [1.0], z=[0.0], **how)
    stop: IntegrationStopped = alone.value
    assert (stop.t, stop.coordinate) == (0.0, "slide.z.friction.z")
    assert [x.shape for x in (*stop.stored, stop.stored.z)] == [(5, 1)] * 3
    assert np.isfinite(stop.stored.z[0]).all()
    assert np.isnan(stop.stored.z[1:]).all()
    refused(IntegrationStopped, "of state 1 ", kernel.rollout, [[0.0], [0.0]], [[1e-6], [1.0]], z=[0.0], **how)
    refused(IntegrationStopped, "dt is too long", kernel.rollout, [0.0], [1.0], **how)
    kernel.rollout([0.0], [1e-6], z=[0.0], **how)
    kernel.rollout([0.0], [0.0], z=[1e-3], **how)  # what begins beyond the bound goes back
    kernel.rollout([0.0], [1.0], z=[0.0], **{**how, "method": "implicit"})


def test_derivatives_of_steps_that_are_too_long_are_refused() -> None:
    kernel = eomgen.build(block(), flags=("-O0",))
    state, how = ([0.0], [1.0]), {"dt": 1e-4, "steps": 3, "method": "rk4"}

    def loss(t: Any, q: Any, v: Any, z: Any) -> Any:
        return q[-1].sum(), np.zeros_like(q), np.zeros_like(v), np.zeros_like(z)

    with pytest.raises(IntegrationStopped, match="dt is too long"):
        kernel.rollout_gradient(*state, loss=loss, **how)
    with pytest.raises(IntegrationStopped, match="dt is too long"):
        kernel.rollout_sensitivity(*state, parameters=("joints.slide.z.stiffness",), **how)


def test_arguments_are_of_coordinates(kernel: eomgen.Kernel) -> None:
    """Drives and wrenches see coordinates, records have states behind them, and numbers leave tolerances of z alone."""
    seen: list[Any] = []

    def drive(t: float, q: Any, v: Any) -> Any:
        assert q.shape == v.shape == (1,)
        return [0.5 * np.cos(t)]

    def wrench(t: float, q: Any, v: Any) -> Any:
        assert q.shape == v.shape == (1,)
        return np.zeros((1, 6))

    how: dict[str, Any] = {"method": "scipy:DOP853", "output_step": 0.01, "z0": [1e-6]}
    motion = integrate(
        kernel, [0.0], [0.0], 0.05, drive=drive, wrench=wrench, record=lambda t, y: seen.append(y), atol=1e-9, **how
    )
    assert motion.z[0, 0] == 1e-6
    assert (np.vstack(seen)[:, 2:] == motion.z[1:]).all()
    assert (motion.u[:, 0] == 0.5 * np.cos(motion.t)).all()
    constant = integrate(kernel, [0.0], [0.0], 0.05, drive=[0.5], **{**how, "method": "rosenbrock"})
    assert (constant.u == 0.5).all()
    accurate = {}
    for atol in ([1e-9, 1e-9], [1e-9, 1e-9, 1e-16]):
        accurate[len(atol)] = integrate(kernel, [0.0], [1.0], 0.05, atol=atol, rtol=1e-4, **{**how, "method": "tsit5"})
    assert accurate[3].info["steps"] > accurate[2].info["steps"]
    for wrong, said in (
        ({"atol": [1.0] * 5}, r"\(2,\), with tolerances of internal states \(3,\)"),
        ({"z0": [1.0, 2.0]}, "z0"),
    ):
        refused(ArrayError, said, integrate, kernel, [0.0], [0.0], 0.05, **wrong)
    with pytest.raises(ArrayError, match=r"drive: expected forces of shape \(1,\)"):
        integrate(kernel, [0.0], [0.0], 0.05, drive=lambda t, q, v: [0.0, 0.0])


def test_internal_states_that_have_none_are_refused(built: Build) -> None:
    plain = built(block("coulomb = 1.0"), "forward_dynamics", "energy", "mass_matrix")
    refused(InputError, "z0: no force law of block has internal states", integrate, plain, [0.0], [0.0], 0.1, z0=[0.0])


def test_drives_with_slopes_stay_so(kernel: eomgen.Kernel) -> None:
    class Damper:
        called = 0

        def __call__(self, t: float, q: Any, v: Any) -> Any:
            return -3.0 * np.asarray(v)

        def slopes(self, t: float, q: Any, v: Any) -> Any:
            self.called += 1
            return np.zeros((1, 1)), np.array([[-3.0]])

    damper = Damper()
    motion = integrate(kernel, [0.0], [0.1], 0.05, drive=damper, method="scipy:Radau", output_step=0.05)
    assert damper.called
    other = integrate(
        kernel, [0.0], [0.1], 0.05, drive=lambda t, q, v: -3.0 * v, method="scipy:DOP853", output_step=0.05
    )
    assert motion.v == pytest.approx(other.v, rel=1e-4)


def test_laws_with_states_ask_for_implicit_methods(kernel: eomgen.Kernel) -> None:
    assert "states" in why_stiff(kernel)
    assert stiff_in_real_time(kernel, np.zeros(1))
    automatic, implicit = (
        integrate(kernel, [0.0], [1.0], 0.02, method=method, **FAST).info["evaluations"]
        for method in ("auto", "rosenbrock")
    )
    assert automatic < 2.0 * implicit


def test_motions_end_where_a_state_says_so(kernel: eomgen.Kernel) -> None:
    """Bristles of a block that is pulled steadily bend to 8 um of the 15 at which they yield after 4 s."""
    until = Until.coordinate(kernel, "slide.z.friction.z", 8e-6)
    for method in ("rosenbrock", "scipy:Radau"):
        motion = integrate(kernel, [0.0], [0.0], 9.0, drive=Ramp(), method=method, output_step=0.5, until=until)
        assert motion.t[-1] == pytest.approx(4.0, rel=1e-3), method
    refused(InputError, r"did you mean 'slide\.z\.friction\.z'", Until.coordinate, kernel, "slide.z.friction", 1.0)


class Ramp:
    """0.2 N/s, as a spring pulls that is pulled itself."""

    def __call__(self, t: float, q: Any, v: Any) -> Any:
        return [0.2 * t]

    def load_data(self) -> Any:
        from eomgen.kernel.stepping.input_signals import DriveData, Signal, Track

        return DriveData(torque=Track(Signal(np.array([0.0, 20.0]), np.array([[[0.0], [0.2]]])), np.array([0])))


def test_bristles_hold_until_they_yield(kernel: eomgen.Kernel) -> None:
    """The block of the published experiment sticks until 1.5 N, slips, and sticks again."""
    motion = integrate(kernel, [0.0], [0.0], 14.0, drive=Ramp(), method="radau", output_step=0.01)
    first, second = motion.rests[:2]
    assert (first.coordinate, first.begins) == ("slide.z", 0.0)
    assert first.ends == pytest.approx(7.4, abs=0.1)
    slip = (motion.t > first.ends) & (motion.t < second.begins)
    assert motion.v[slip].max() > 0.1
    held = (motion.t >= second.begins) & (motion.t <= second.ends)
    assert np.ptp(motion.q[held]) < 1e-4
    rate = rates(motion.v[held, 0], motion.z[held, 0])[0]
    assert np.abs(rate).max() < 1e-4


@pytest.mark.parametrize("friction", ["coulomb = 0.3", 'model = "lugre", coulomb = 0.3, bristle_stiffness = 300.0'])
def test_friction_of_followers_holds_them(friction: str, built: Build) -> None:
    """A drive of 0.1 N m does not turn two joints that a gear couples."""
    robot = robot_from_toml(gear_text(f"friction = {{ {friction} }}"))
    kernel = built(robot, "forward_dynamics", "energy", "adaptive_rollout", "mass_matrix", "inverse_dynamics")
    motion = integrate(kernel, [-np.pi / 2.0], [0.0], 1.0, drive=[0.1], method="rosenbrock", output_step=0.01)
    assert {rest.coordinate for rest in motion.rests} == {"j1.gamma", "j2.gamma"}


@pytest.mark.soak
def test_bristles_of_loop_joints_hold() -> None:
    """A four-bar without drive comes to rest where the friction in the pin of its cut holds it."""
    text = (Path(str(eomgen.__file__)).parent / "robots" / "four_bar.toml").read_text()
    pin = 'gamma = { friction = { model = "lugre", coulomb = 20.0, bristle_stiffness = 3e3, bristle_damping = 9.0 } }'
    robot = robot_from_toml(text.replace("[[loops]]\n", f"[[loops]]\n{pin}\n"))
    kernel = eomgen.build(robot, flags=("-O0",))
    assert kernel.internal_states == ("joint4.gamma.friction.z",)
    q = [robot.home[name] for name in kernel.coordinates]
    motion = integrate(kernel, q, [0.0, 0.0, 0.0], 1.0, method="rosenbrock", output_step=0.01)
    assert [rest.coordinate for rest in motion.rests][-1] == "joint4.gamma"
    assert motion.rests[-1].ends == 1.0
    assert motion.z is not None
    assert 3e3 * np.abs(motion.z).max() < 20.0


def test_steps_of_rk4_are_as_short_as_drives_need(built: Build) -> None:
    """Filters, integrals and the current of a servo drive: a winding and its controller follow within 0.25 ms."""
    kernel = built(servo(DRIVES["cascade"][0]))
    ends = []
    for method in ("radau", "rk4"):
        motion = integrate(kernel, [0.1], [0.0], 0.1, drive=[0.5], method=method, rtol=1e-8, output_step=0.01)
        ends.append(np.r_[motion.q[-1], motion.v[-1], motion.z[-1]])
    assert ends[1] == pytest.approx(ends[0], rel=1e-5, abs=1e-6)
    assert motion.info["steps"] > 200


@pytest.mark.parametrize(("text", "expected"), [(ARM, None), (SERVO, ("N m", "N", "N m", "rad"))])
def test_drives_of_prescribed_coordinates_are_forces(text: str, expected: Any, built: Build) -> None:
    """What kernels take there is an acceleration; motions have the force that it needs."""
    robot = robot_from_toml(text.replace('name = "j1"\n', 'name = "j1"\nprescribed = ["gamma"]\n'))
    kernel = built(robot, "mass_matrix")
    rows, rates, inputs = (np.zeros((2, size)) for size in (kernel.n, kernel.calls.rates, kernel.calls.inputs))
    motion = Trajectory(np.arange(2.0), rows, rates, inputs, np.zeros((2, 2)), kernel.coordinates, "rk4").apart(kernel)
    assert kernel.inputs["j1.gamma"].unit == "rad/s^2"
    assert motion.input_units == expected
    assert motion_columns(motion)["j1.gamma.drive"][0] == "N m"
