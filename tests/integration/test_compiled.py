"""Integrations in C by loads that are data, beside the same loads in Python and SciPy's methods."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen import InputError, SingularError
from eomgen.integration.plan import IntegratorOptions, turns_of, why_not_in_c
from eomgen.integration.solve import integrate
from eomgen.integration.until import Until
from eomgen.kernel.stepping.input_signals import DriveData, InputSignals, Signal, Track
from eomgen.kernel.stepping.methods import ADAPTIVE as NUMBERS
from eomgen.kernel.stepping.methods import AUTO, IN_C
from eomgen.kernel.stepping.motions import BatchMotion, SingleMotion
from eomgen.kernel.stepping.options import NARROW, NARROW_TURNS, TURNS, ErrorControl, rollout_of
from eomgen.kernel.stepping.packed_inputs import PackedInputs
from eomgen.kernel.stepping.reading_inputs import input_signals
from eomgen.motion.point_to_point import Harmonic, PointToPoint
from eomgen.motion.splines import Columns, Spline, Standstill, signal_of
from eomgen.motion.timetable import TimeTable
from eomgen.progress import no_progress
from eomgen.robot.model import tool_of
from eomgen.robot.value import Coordinate, Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.assembly import Assembly, assemble
from eomgen.simulation.run import plan_of, run_scenario
from tests.support.builds import Build
from tests.support.refusals import refused
from tests.support.sliders import massless_tip
from tests.support.soak import soaked
from tests.support.swinging import MASS, NEEDED, STIFFNESS, oscillator
from tests.support.turning_loops import cranked_plate

DRIVES = {
    "computed_torque": "",
    "pd": "[control]\ntype = 'pd'\nkp = 50.0\nkd = 5.0\n",
    "pd_gravity": "[control]\ntype = 'pd'\nkp = 50.0\nkd = 5.0\ngravity = true\n",
    "via": "[motion]\ntype = 'via'\nspeed = 0.5\npoints = [{ JOINT = 0.1 }, { JOINT = 0.3 }]\n",
}
PUSH = """
[[wrenches]]
link = "{link}"
axes = "{axes}"
point = [0.05, -0.02, 0.1]
t0 = 0.03
t1 = 0.07
rows = [[0.0, 1.0, -2.0, 3.0, 0.1, 0.2, -0.3], [0.05, 4.0, 2.0, 1.0, 0.0, 0.1, 0.2], [0.08, 0, 0, 0, 0, 0, 0]]
"""

ALL = "auto, all in turn"  # with Radau IIA


def polynomial(signal: Signal, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A signal without a profile as NumPy's polynomials say it."""
    k = int(np.clip(np.searchsorted(signal.knots, t, side="right") - 1, 0, len(signal.knots) - 2))
    pieces = [np.polynomial.Polynomial(column) for column in signal.coefficients[k].T]
    x = np.clip(t, signal.knots[0], signal.knots[-1]) - signal.knots[k]
    inside = signal.knots[0] <= t <= signal.knots[-1]
    q = np.array([p(x) for p in pieces])
    v, a = (np.array([p.deriv(order)(x) for p in pieces]) * inside for order in (1, 2))
    return q, v, a


@pytest.mark.parametrize(
    "program",
    [
        PointToPoint(np.array([0.1, -1.0]), np.array([0.7, 2.0]), 0.8, 0.1),
        PointToPoint(np.array([0.1, -1.0]), np.array([0.7, 2.0]), 0.8, 0.1, smooth=4),
        Spline([0.0, 0.2, 0.5, 1.1], [[0.0, 1.0], [0.3, 0.9], [0.2, 0.4], [1.0, -1.0]], at_rest=True),
        Spline([0.0, 0.2, 0.5, 1.1], [[0.0, 1.0], [0.3, 0.9], [0.2, 0.4], [1.0, -1.0]], at_rest=True, smooth=4),
        Spline([0.0, 0.2, 0.5, 0.6, 1.0, 1.1], np.random.default_rng(1).normal(size=(6, 2)), at_rest=False),
        Spline([0.0, 0.2], [[0.0, 1.0], [0.3, 0.9]], at_rest=False),
        Standstill(np.array([0.3, -0.2])),
        Columns(PointToPoint(np.arange(3.0), np.ones(3), 0.5), np.array([2, 0])),
    ],
)
def test_programs_are_polynomials(program: Any) -> None:
    signal = signal_of(program)
    assert signal is not None
    for t in np.linspace(-0.2, 1.3, 61):
        for found, wanted in zip(polynomial(signal, t), program.at(t), strict=True):
            assert found == pytest.approx(wanted, rel=1e-11, abs=1e-11)


@pytest.mark.parametrize("hold", [True, False])
def test_tables_are_polynomials(hold: bool) -> None:
    table = TimeTable(("a", "b"), np.array([0.1, 0.4, 0.5]), np.array([[1.0, 2.0], [3.0, -1.0], [0.0, 5.0]]), hold)
    for t in np.linspace(0.0, 0.7, 50):
        assert polynomial(table.as_signal(), t)[0] == pytest.approx(table.at(t), abs=1e-13)


def assembled(name: str, text: str) -> Assembly:
    robot, scenario = eomgen.load_robot(name), scenario_from_toml(text)
    return assemble(robot, scenario, tool_of(robot, None, "tool"), no_progress)


def loaded(assembly: Assembly, times: np.ndarray, q: np.ndarray, v: np.ndarray) -> SingleMotion:
    data = input_signals(assembly.kernel.calls, assembly.drive, assembly.wrenches, assembly.prescribed)
    atol = np.full(2 * assembly.kernel.n, 1e-8)
    return SingleMotion(assembly.kernel.calls, data, times, q[0], v[0], ErrorControl("tsit5", 1e-8, atol))


def control_of(method: str, rtol: float, atol: np.ndarray) -> ErrorControl:
    """A method, or those of "auto" in turn, without Radau IIA or with it."""
    return ErrorControl(AUTO, rtol, atol, NARROW_TURNS) if method == ALL else ErrorControl(method, rtol, atol)


SHAKEN = "".join(
    f"[[prescribed]]\ntype = 'harmonic'\ncoordinate = 'mount.{name}'\namplitude = 0.0{i + 1}\nfrequency = {i + 2}.0\n"
    f"phase = 0.{i}\noffset = 0.00{i}\n"
    for i, name in enumerate(("x", "y", "z", "alpha", "beta", "gamma"))
)


@pytest.mark.parametrize("robot", soaked(("one_link", "geared_arm", "shaken_arm"), ("one_link", "shaken_arm")))
@pytest.mark.parametrize("drive", DRIVES)
def test_drives_of_c_are_those_of_python(robot: str, drive: str) -> None:
    """In random states at random times, behind gears and on a platform that shakes."""
    first = eomgen.load_robot(robot).rigid().joints[-1].name
    text = "duration = 0.4\n" + (SHAKEN if robot == "shaken_arm" else "") + DRIVES[drive].replace("JOINT", first)
    assembly = assembled(robot, text)
    kernel, rng = assembly.kernel, np.random.default_rng(5)
    times = np.sort(rng.uniform(0.0, 0.4, 12))
    q, v = rng.normal(size=(2, 12, kernel.n))
    given = [kernel.coordinates.index(name) for name in kernel.prescribed]
    found = loaded(assembly, times, q, v).loads.drives(times, q, v)
    for t, x, rate, u in zip(times.tolist(), q, v, found, strict=True):
        if assembly.prescribed is not None:
            motion = assembly.prescribed(t)
            for own, wanted in zip((x[given], rate[given], u[given]), motion, strict=True):
                assert own == pytest.approx(wanted, rel=1e-13, abs=1e-13)
        wanted = assembly.drive(t, x, rate)
        free = np.setdiff1d(np.arange(kernel.n), given)
        assert u[free] == pytest.approx(wanted[free], rel=1e-11, abs=1e-10 * np.abs(wanted).max())


@pytest.mark.parametrize(
    ("robot", "axes"),
    [
        ("one_link", "link"),
        *(pytest.param(robot, "base", marks=pytest.mark.soak) for robot in ("one_link", "shaken_arm")),
    ],
)
def test_wrenches_of_c_are_those_of_python(robot: str, axes: str) -> None:
    """Forces besides the centre of mass that come, change and go, on both integrators, also where motions are given."""
    text = "duration = 0.1\noutput_step = 0.005\n[control]\ntype = 'none'\n" + PUSH.format(link="link1", axes=axes)
    text += SHAKEN if robot == "shaken_arm" else ""
    results = {}
    for method in (*IN_C, "scipy:DOP853"):
        scenario = scenario_from_toml(text + f"[integrator]\nmethod = '{method}'\nrtol = 1e-9\n")
        results[method] = run_scenario(robot, scenario)
    wanted = results["scipy:DOP853"]
    for method in IN_C:
        found = results[method]
        assert found.trajectory.method == method
        assert np.abs(found.trajectory.q - wanted.trajectory.q).max() <= 2e-8
        assert np.abs(found.trajectory.v - wanted.trajectory.v).max() <= 1e-5
        assert found.wrench is not None
        assert np.allclose(found.wrench, wanted.wrench, rtol=1e-6, atol=1e-6)
        assert found.balance.relative_residue <= 1e-5
        works = (r.balance.of("wrenches")[-1] for r in (found, wanted))  # type: ignore[union-attr]
        assert next(works) == pytest.approx(next(works), rel=1e-5)


@pytest.mark.parametrize(
    ("robot", "text"),
    [
        pytest.param("geared_arm", "duration = 0.3\n", marks=pytest.mark.soak),
        pytest.param("shaken_arm", "duration = 0.3\n" + SHAKEN, marks=pytest.mark.soak),
        ("shaken_arm", "duration = 0.3\n" + SHAKEN + "[[wrenches]]\nlink = 'link1'\nforce = [300.0, 100.0, -200.0]\n"),
        pytest.param(
            "four_bar", "duration = 0.3\n[control]\ntype = 'pd'\nkp = 200.0\nkd = 20.0\n", marks=pytest.mark.soak
        ),
        pytest.param(
            "one_link",
            "duration = 0.3\n[[payloads]]\nlink = 'link1'\nmass = 0.4\npoint = [0.1, 0.0, 0.0]\nt0 = 0.1\nt1 = 0.2\n",
            marks=pytest.mark.soak,
        ),
    ],
)
@pytest.mark.parametrize("method", ["tsit5", pytest.param("rosenbrock", marks=pytest.mark.soak)])
def test_simulations_agree_with_scipy(robot: str, text: str, method: str) -> None:
    found, wanted = (
        run_scenario(robot, scenario_from_toml(text + f"[integrator]\nmethod = '{name}'\nrtol = {rtol}\n"))
        for name, rtol in ((method, "1e-8"), ("scipy:Radau", "1e-9"))
    )
    assert found.trajectory.method == method
    scale = np.abs(wanted.trajectory.v).max()
    assert np.abs(found.trajectory.q - wanted.trajectory.q).max() <= 2e-6
    assert np.abs(found.trajectory.v - wanted.trajectory.v).max() <= 2e-4 * max(scale, 1.0)
    assert np.allclose(found.balance.work[-1], wanted.balance.work[-1], rtol=1e-4, atol=1e-4 * wanted.balance.size)
    largest = np.abs(wanted.trajectory.u).max()
    assert np.allclose(found.trajectory.u, wanted.trajectory.u, rtol=2e-3, atol=2e-3 * largest)


@pytest.mark.parametrize("method", IN_C)
def test_a_closed_form(method: str, built: Build) -> None:
    """The oscillator under a constant force, and with an attachment that shakes it by a harmonic motion."""
    kernel = built(oscillator(), *NEEDED, "adaptive_rollout", "radau_rollout")
    motion = integrate(kernel, [0.0], [0.0], 1.0, drive=[5.0], method=method, rtol=1e-9)
    again = integrate(kernel, [0.0], [0.0], 1.0, drive=lambda _t, _q, _v: [5.0], method="scipy:DOP853", rtol=1e-11)
    assert np.abs(motion.q - again.q).max() <= 1e-8
    assert np.abs(motion.v - again.v).max() <= 1e-6
    assert (motion.u == 5.0).all()
    assert {"steps", "rejected", "evaluations", "wall_s"} <= set(motion.info)


@pytest.mark.parametrize("method", IN_C)
def test_samples_may_lie_anywhere(method: str, built: Build) -> None:
    """From a time that is not 0, and thousands of times more densely than the steps."""
    kernel = built(oscillator(), *NEEDED, "adaptive_rollout", "radau_rollout")
    times = np.concatenate([[0.3, 0.30001], np.linspace(0.4, 1.0, 5001)])
    motion = integrate(kernel, [0.1], [0.5], 1.0, times=times, method=method, rtol=1e-7)
    dense = integrate(kernel, [0.1], [0.5], 1.0, times=times, method="scipy:DOP853", rtol=1e-10)
    assert motion.info["steps"] < 4000
    assert np.abs(motion.q - dense.q).max() <= 1e-6
    assert np.abs(motion.v - dense.v).max() <= 1e-4


def test_what_c_cannot_do_is_said(built: Build) -> None:
    """A function that only Python can call, and a kernel without the steps; "auto" takes SciPy's methods then."""
    kernel = built(oscillator(), *NEEDED, "adaptive_rollout", "radau_rollout")
    drive: Callable[..., list[float]] = lambda _t, _q, _v: [1.0]  # noqa: E731
    with pytest.raises(InputError, match=r"'tsit5' integrates in C, but the drive is a function .* auto, scipy:Radau"):
        integrate(kernel, [0.0], [0.0], 0.1, drive=drive, method="tsit5")
    assert integrate(kernel, [0.0], [0.0], 0.1, drive=drive).method == "scipy:Radau"
    assert integrate(kernel, [0.0], [0.0], 0.1).method == "tsit5"
    assert "without adaptive_rollout" in why_not_in_c(built(oscillator(), *NEEDED))
    with pytest.raises(eomgen.ArrayError, match=r"drive: expected float64 of shape \(1,\)"):
        integrate(kernel, [0.0], [0.0], 0.1, drive=[1.0, 2.0])


def test_harmonic_motions_are_data() -> None:
    shake = Harmonic([0.1, 0.2], [2.0, 3.0], [0.1, 0.0])
    wave = shake.load_data().wave
    for t in (0.0, 0.3):
        amplitude, rate, phase, offset = wave.T
        assert offset + amplitude * np.sin(rate * t + phase) == pytest.approx(shake(t)[0], abs=1e-15)


@pytest.mark.parametrize("method", [*IN_C, AUTO, "rk4", "scipy:Radau", "scipy:DOP853"])
def test_a_coordinate_without_inertia_is_named(method: str, built: Build) -> None:
    """Whoever integrates: nothing says that its velocity stays what it is."""
    kernel = built(massless_tip(), *NEEDED, "mass_matrix", "adaptive_rollout", "radau_rollout")
    with pytest.raises(SingularError, match=r"cannot be inverted at k\.gamma"):
        integrate(kernel, [0.3, 0.5], [0.0, -5.0], 0.3, method=method, rtol=1e-6, atol=1e-8)
    text = "duration = 0.3\n[control]\ntype = 'torque'\ncoordinates = ['j.gamma']\nrows = [[0.0, 0.0], [1.0, 0.0]]\n"
    text += f"[initial]\nq = {{ j = 0.3, k = 0.5 }}\nequilibrium = false\n[integrator]\nmethod = '{method}'\n"
    refused(SingularError, r"cannot be inverted at k\.gamma", run_scenario, massless_tip(), scenario_from_toml(text))


@pytest.mark.parametrize("method", IN_C)
def test_a_state_that_cannot_move_is_named(method: str, built: Build) -> None:
    robot = eomgen.load_robot("one_link")
    massless = eomgen.Robot(**{**vars(robot), "name": "massless", "tunable": ("links.link1.mass",)})
    kernel = built(massless, *NEEDED, "adaptive_rollout", "radau_rollout")
    for name in kernel.parameters:
        if name.startswith("links."):
            kernel.parameters[name] = 0.0
    with pytest.raises((SingularError, eomgen.IntegrationError)):
        integrate(kernel, np.zeros(kernel.n), np.ones(kernel.n), 0.1, method=method, atol=1e-6)


@pytest.mark.soak
def test_steps_land_on_what_changes(tmp_path: Path) -> None:
    """A force that sets in: no step crosses it, so that a short push is not missed by steps of any length."""
    text = (
        "duration = 10.0\noutput_step = 1.0\n[control]\ntype = 'torque'\ncoordinates = ['joint1']\n"
        "rows = [[0.0, 0.0], [5.0, 1000.0], [5.001, 0.0]]\ninterpolation = 'hold'\n[integrator]\nmethod = 'tsit5'\n"
    )
    found = run_scenario("puma560", scenario_from_toml(text))
    assert found.balance.of("drives")[-1] > 1e-3


@pytest.mark.parametrize("method", [*IN_C, "auto", "scipy:Radau", "scipy:DOP853", "rk4"])
def test_a_motion_ends_where_a_coordinate_reaches_a_value(method: str, built: Build) -> None:
    """The oscillator passes a place at a time that its closed form knows; samples end there."""
    kernel = built(oscillator(damping=0.0), *NEEDED, "adaptive_rollout", "radau_rollout")
    rate = np.sqrt(STIFFNESS / MASS)
    until = Until.coordinate(kernel, "slide.z", 0.02)
    wanted = np.arccos(0.2) / rate
    options = {"rtol": 1e-9, "output_step": 1e-3, "step": 1e-5 if method == "rk4" else None}
    motion = integrate(kernel, [0.1], [0.0], 1.0, method=method, until=until, **options)  # type: ignore[arg-type]
    assert motion.info["ended_at"] == motion.t[-1] == pytest.approx(wanted, abs=1e-7)
    assert motion.q[-1, 0] == pytest.approx(0.02, abs=1e-8)
    assert motion.t[:-1] == pytest.approx(1e-3 * np.arange(motion.t.size - 1))
    assert np.abs(motion.q[:, 0] - 0.1 * np.cos(rate * motion.t)).max() <= 1e-6
    whole = integrate(kernel, [0.1], [0.0], 0.01, method=method, until=until, **options)  # type: ignore[arg-type]
    assert "ended_at" not in whole.info


@pytest.mark.soak
@pytest.mark.parametrize("method", ["auto", "scipy:Radau"])
def test_a_scenario_ends_where_its_tool_is_at_a_distance(method: str) -> None:
    text = (
        "duration = 0.5\n[until]\nframe = 'tcp'\npoint = [0.0, 0.0, 0.0]\ndistance = {}\n[integrator]\nmethod = '{}'\n"
    )
    robot = eomgen.load_robot("ur5")
    whole = run_scenario(robot, scenario_from_toml("duration = 0.5\n"))
    lengths = np.linalg.norm(whole.pose[:, :3, 3], axis=1)
    wanted = float(lengths[lengths.size // 2])
    found = run_scenario(robot, scenario_from_toml(text.format(wanted, method)))
    first = int(np.flatnonzero((lengths[1:] >= wanted) != (lengths[:-1] >= wanted))[0]) + 1
    assert found.trajectory.t[-1] == pytest.approx(whole.trajectory.t[first], abs=6e-4)
    assert np.linalg.norm(found.pose[-1, :3, 3]) == pytest.approx(wanted, abs=1e-8)
    assert found.balance.relative_residue <= 1e-4
    assert any("reached at" in note for note in found.notes)
    assert np.abs(found.trajectory.q[:-1] - whole.trajectory.q[: found.trajectory.t.size - 1]).max() <= 1e-5


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ("coordinate = 'nose'\nvalue = 1.0", "until: 'nose' is no coordinate; allowed: 'joint1.x'"),
        ("frame = 'nose'\npoint = [0, 0, 0]\ndistance = 1.0", "until: 'nose' is no frame; allowed: "),
        ("coordinate = 'joint1'", "until: .*allowed: coordinate and value, or frame, point and distance"),
        ("coordinate = 'joint1'\nvalue = 1.0\nframe = 'tcp'", "allowed: coordinate and value, or frame"),
        ("frame = 'tcp'\npoint = [0, 0, 0]\ndistance = 0.0", "until.distance"),
    ],
)
def test_ends_that_make_no_sense_are_refused(table: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        run_scenario("one_link", scenario_from_toml(f"duration = 0.1\n[until]\n{table}\n"))


def test_events_at_values_that_are_not_finite_are_refused(built: Build) -> None:
    kernel = built(oscillator(damping=0.0), *NEEDED, "adaptive_rollout", "radau_rollout")
    for number in (np.nan, np.inf):
        with pytest.raises(InputError, match=f"until: value: got {number}; allowed: finite numbers"):
            Until.coordinate(kernel, "slide.z", number)


@pytest.mark.parametrize(
    ("value", "note"),
    [
        (0.02, "joint1.gamma = 0.02 rad reached at {:.6g} s, where the motion ends"),
        (5.0, "joint1.gamma = 5 rad was not reached"),
    ],
)
def test_notes_say_when_a_motion_has_reached_its_end(value: float, note: str) -> None:
    text = "duration = 0.1\n[initial]\nv = {{ joint1 = 1.0 }}\n[control]\ntype = 'none'\n"
    text += "[until]\ncoordinate = 'joint1'\nvalue = {}\n"
    found = run_scenario("one_link", scenario_from_toml(text.format(value)))
    assert note.format(found.trajectory.t[-1]) in found.notes


@pytest.mark.soak
def test_a_batch_under_loads_has_the_bits_of_its_states() -> None:
    """Lanes have times of their own: each state of a batch moves as it does alone, on a platform that shakes."""
    assembly = assembled("shaken_arm", "duration = 0.1\n" + SHAKEN)
    kernel, rng, n = assembly.kernel, np.random.default_rng(3), assembly.kernel.n
    data = input_signals(kernel.calls, assembly.drive, assembly.wrenches, assembly.prescribed)
    times, atol = np.linspace(0.0, 0.1, 6), np.full(2 * n, 1e-9)
    q, v = 0.1 * rng.normal(size=(2, 5, n))
    given = [kernel.coordinates.index(name) for name in kernel.prescribed]
    assert assembly.prescribed is not None
    q[:, given], v[:, given] = assembly.prescribed(0.0)[:2]
    for method, number in NUMBERS.items():
        function, view = kernel.raw.function(rollout_of(method)), kernel.raw.view
        library = function.where(batch=True)
        packed, at = PackedInputs(library, kernel.calls, data), [q.copy(), v.copy()]
        stored, progress = np.empty((2, 5, times.size, n)), library.new_array("progress", 5)
        allowed = library.new("tolerance", rtol=1e-7, atol=view(atol), most=10**6)
        function.batch(
            5,
            kernel.raw.ffi.NULL,
            kernel.parameters.setup.pointer(library),
            0,
            library.drive(u=view(np.zeros(n))),
            packed.pointer,
            0,
            allowed,
            0,
            kernel.raw.ffi.from_buffer("double[]", times),
            times.size - 1,
            number,
            *map(view, (*at, *stored)),
            progress,
        )
        for state in range(5):
            alone = SingleMotion(kernel.calls, data, times, q[state], v[state], ErrorControl(method, 1e-7, atol))
            while not alone.progress.reason:
                alone.go()
            assert progress[state].reason == alone.progress.reason == 1
            assert progress[state].steps == alone.progress.steps
            assert np.array_equal(stored[:, state], alone.samples)


def test_a_drive_with_data_of_its_own_is_a_function(built: Build) -> None:
    """An attribute that somebody else's object has by chance is not taken for loads."""

    class Logging:
        data = np.zeros(3)
        signal = data

        def __call__(self, _t: float, q: np.ndarray, _v: np.ndarray) -> np.ndarray:
            return 0.0 * q

    kernel = built(oscillator(), *NEEDED, "adaptive_rollout", "radau_rollout")
    assert integrate(kernel, [0.1], [0.0], 0.1, drive=Logging()).method == "scipy:Radau"


def test_sundials_goes_on_to_the_duration(built: Build) -> None:
    kernel = built(oscillator(), *NEEDED)
    with pytest.raises(InputError, match="until: CVODE goes on to the duration; allowed: other methods"):
        integrate(kernel, [0.1], [0.0], 0.1, method="CVODE", until=Until.coordinate(kernel, "slide.z", 0.0))


MOVED = "[motion]\ntype = 'point_to_point'\n"
HELD = DRIVES["pd_gravity"]
SWUNG = "[motion]\ntype = 'point_to_point'\ngoal = { hinge = 3.0 }\n"
SHAKEN_BARS = "[[prescribed]]\ntype = 'harmonic'\ncoordinate = 'joint3.x'\namplitude = 0.02\nfrequency = 4.0\n" + MOVED


def bars(label: str) -> Robot:
    """The four-bar linkage: driven at one joint, at all of them, and with a pivot that shakes."""
    robot = eomgen.load_robot("four_bar")
    if label == "plate":
        return cranked_plate()
    if label == "shaken":
        pivot = replace(robot.joints[2], coordinates={"x": Coordinate(prescribed=True), **robot.joints[2].coordinates})
        return replace(robot, name="shaken_bars", joints=(*robot.joints[:2], pivot))
    return robot if label == "driven" else replace(robot, driven=None)


FROM_REST = "phase = 1.5707963267948966\noffset = -0.02\n"  # of the pivot that shakes
PUSHED = "[[wrenches]]\nlink = 'coupler'\nforce = [30.0, -20.0, 0.0]\n"


@pytest.mark.usefixtures("unoptimised")
@pytest.mark.soak
@pytest.mark.parametrize(
    ("label", "text"),
    [
        ("driven", MOVED + PUSHED),
        ("driven", MOVED + "[control]\ntype = 'computed_torque'\n" + PUSHED),
        ("shaken", SHAKEN_BARS.replace("frequency", FROM_REST + "frequency") + HELD + PUSHED),
        ("plate", SWUNG + HELD),
    ],
)
def test_radau_moves_closed_mechanisms_as_tsit5_does(label: str, text: str) -> None:
    found, wanted = (
        run_scenario(
            bars(label), scenario_from_toml(f"duration = 0.3\n{text}[integrator]\nmethod = '{name}'\nrtol = 1e-9\n")
        )
        for name in ("radau", "tsit5")
    )
    assert found.trajectory.method == "radau"
    assert np.ptp(wanted.trajectory.q, axis=0).max() > 0.01
    assert np.abs(found.trajectory.q - wanted.trajectory.q).max() <= 1e-7
    assert np.abs(found.trajectory.v - wanted.trajectory.v).max() <= 1e-6 * max(1.0, np.abs(wanted.trajectory.v).max())
    assert np.allclose(found.balance.work[-1], wanted.balance.work[-1], rtol=1e-5, atol=1e-5 * wanted.balance.size)


@pytest.mark.usefixtures("unoptimised")
@pytest.mark.parametrize(
    ("label", "text"),
    [
        pytest.param("driven", MOVED, marks=pytest.mark.soak),
        ("driven", MOVED + HELD),
        pytest.param("more", "[control]\ntype = 'computed_torque'\n", marks=pytest.mark.soak),
        ("more", HELD),  # three drives, one freedom
        pytest.param("shaken", SHAKEN_BARS, marks=pytest.mark.soak),
        ("shaken", SHAKEN_BARS + HELD),
        pytest.param("plate", SWUNG, marks=pytest.mark.soak),  # whose free joint's angles pass a pole
        pytest.param("plate", SWUNG + HELD, marks=pytest.mark.soak),
    ],
)
def test_drives_of_closed_mechanisms_are_those_of_python(label: str, text: str) -> None:
    """In random states near closure along the way."""
    robot = bars(label)
    scenario = scenario_from_toml("duration = 0.3\n" + text)
    assembly = assemble(robot, scenario, tool_of(robot, None, "tool"), no_progress)
    kernel, rng = assembly.kernel, np.random.default_rng(5)
    assert plan_of(assembly, scenario).in_c
    times = np.sort(rng.uniform(0.0, 0.3, 12))
    q, v = assembly.path.at(times) + 0.02 * rng.normal(size=(12, kernel.n)), rng.normal(size=(12, kernel.n))
    assert label != "plate" or (np.abs(np.cos(q[:, kernel.coordinates.index("pose.beta")])) < 0.4).any()
    found = loaded(assembly, times, q, v).loads.drives(times, q, v)
    free = ~np.isin(kernel.coordinates, kernel.prescribed)
    wanted = np.array([assembly.drive(*state) for state in zip(times.tolist(), q, v, strict=True)])
    assert np.count_nonzero(wanted.any(axis=0)) == (3 if label == "more" else 1)
    assert np.abs(found - wanted)[:, free].max() <= 1e-11 * np.abs(wanted).max()


@pytest.mark.soak
@pytest.mark.usefixtures("unoptimised")
@pytest.mark.parametrize(
    ("label", "text"),
    [
        ("driven", MOVED),
        ("shaken", SHAKEN_BARS),
        ("plate", SWUNG + HELD),
        ("plate", SWUNG),
    ],
)
def test_closed_mechanisms_move_as_by_python(label: str, text: str) -> None:
    """Under computed torque, and PD control with gravity compensation: C by default, Radau on request."""
    text = "duration = 0.3\noutput_step = 0.01\n" + text
    found, wanted = (
        run_scenario(bars(label), scenario_from_toml(text + f"[integrator]\nmethod = '{method}'\nrtol = {rtol}\n"))
        for method, rtol in (("auto", "1e-9"), ("scipy:Radau", "1e-10"))
    )
    assert found.trajectory.method in IN_C
    assert any("stiffness switching between tsit5 and rosenbrock (implicit)" in note for note in found.notes)
    for name, limit in (("q", 1e-8), ("v", 1e-7), ("u", 1e-6)):
        mine, other = (getattr(x.trajectory, name) for x in (found, wanted))
        assert np.abs(mine - other).max() <= limit * max(1.0, np.abs(other).max())
    assert found.balance.relative_residue <= 1e-7
    assert found.trajectory.info["gap"] <= 1e-11


@pytest.mark.usefixtures("unoptimised")
def test_a_mechanism_that_does_not_close_ends_the_motion() -> None:
    """The drives of a state that is far from closed are no numbers, and the error says which loop is open."""
    robot = bars("driven")
    scenario = scenario_from_toml("duration = 0.3\n" + MOVED)
    assembly = assemble(robot, scenario, tool_of(robot, None, "tool"), no_progress)
    q, v = np.array([[1.0, 30.0, -30.0]]), np.zeros((1, 3))
    assert not np.isfinite(loaded(assembly, np.array([0.0, 1.0]), q, v).loads.drives(np.zeros(1), q, v)[0, 0])


@pytest.mark.parametrize("method", soaked([*IN_C, AUTO, ALL], ["rosenbrock", ALL]))
def test_states_with_parameters_and_loads_of_their_own_move_as_alone(method: str) -> None:
    """To the bit: other bearings and masses, other centres of mass that wrenches act on, and others beside it."""
    text = "duration = 0.1\n" + SHAKEN + PUSH.format(link=eomgen.load_robot("shaken_arm").links[-1].name, axes="link")
    whole = assembled("shaken_arm", text)
    rng, n = np.random.default_rng(4), whole.kernel.n
    names = [name for name in whole.kernel.parameters if name.endswith(("stiffness", "mass"))]
    assert names
    given = [whole.kernel.coordinates.index(name) for name in whole.kernel.prescribed]
    times, states = np.linspace(0.0, 0.1, 8), 19
    q, v = 0.02 * rng.normal(size=(2, states, n))
    assert whole.prescribed is not None
    q[:, given], v[:, given] = whole.prescribed(0.0)[:2]
    atol = 10.0 ** rng.uniform(-9.0, -6.0, (states, 2 * n))
    kernels = [
        whole.kernel.replaced(
            parameters={name: whole.kernel.parameters[name] * rng.uniform(0.3, 2.0) for name in names}
        )
        for _ in range(states)
    ]
    loads = [input_signals(kernel.calls, whole.drive, whole.wrenches, whole.prescribed) for kernel in kernels]
    for chosen in (range(states), range(4, 7)):
        some = list(chosen)
        shared = method != AUTO  # loads that are one object
        data = [loads[0] if shared else loads[i] for i in some]
        calls = [kernels[i].calls for i in some]
        motion = BatchMotion(calls, data, times, q[some], v[some], control_of(method, 1e-7, atol[some]))
        while motion.go():
            pass
        for place, i in enumerate(some):
            alone = SingleMotion(kernels[i].calls, data[place], times, q[i], v[i], control_of(method, 1e-7, atol[i]))
            while not alone.progress.reason:
                alone.go()
            assert motion.progress[place].reason == alone.progress.reason == 1
            assert motion.progress[place].steps == alone.progress.steps
            assert motion.turns[place].evaluations == alone.turns.evaluations
            assert motion.turns[place].spans == pytest.approx(alone.turns.spans, rel=1e-12)  # sums over calls
            for found, wanted in zip(motion.samples, alone.samples, strict=True):
                assert np.array_equal(found[place], wanted)


def test_auto_takes_radau_where_stability_holds_the_explicit_method_back(built: Build) -> None:
    """At narrow tolerances, of what is stiff, and where the kernel has it; its motion is as exact as any."""
    kernel = built(oscillator(damping=1e5), *NEEDED, "adaptive_rollout", "radau_rollout")
    state, shake = ([1e-3], [0.0]), {"atol": 1e-13, "output_step": 0.1}
    found = integrate(kernel, *state, 1.0, rtol=NARROW, **shake)
    assert found.method == "radau"
    assert 0.9 < found.info["radau_s"] <= found.info["implicit_s"] <= 1.0
    alone = integrate(kernel, *state, 1.0, rtol=NARROW, method="radau", **shake)
    assert found.q == pytest.approx(alone.q, abs=1e-12)
    assert found.info["evaluations"] > 5 * found.info["steps"]
    wide = integrate(kernel, *state, 1.0, rtol=2.0 * NARROW, **shake)
    assert "radau_s" not in wide.info
    asked = IntegratorOptions(rtol=NARROW)
    without = built(oscillator(damping=1e5), *NEEDED, "adaptive_rollout")
    assert turns_of(kernel, asked) == NARROW_TURNS
    assert turns_of(without, asked) == TURNS
    assert turns_of(eomgen.build("ur5"), asked) == TURNS  # which nothing makes stiff


@pytest.mark.parametrize("method", [*IN_C, AUTO, ALL])
def test_calls_that_end_sooner_change_no_bit(method: str, built: Build) -> None:
    """Where a call begins, what the one before ended with is evaluated again: at the same time to the bit."""
    kernel = built(oscillator(), *NEEDED, "adaptive_rollout", "radau_rollout")
    rising = Signal(np.array([0.0, 1.0]), np.array([[[0.0], [3.0]]]))  # a force by which the last bit of time shows
    loads = InputSignals(DriveData(torque=Track(rising, np.array([0]))))
    times, allowed, found = np.linspace(0.0, 0.4, 41), (1e-10, np.full(2, 1e-12)), []
    for kept in (0, 1, 7):
        motion = SingleMotion(kernel.calls, loads, times, np.zeros(1), np.zeros(1), control_of(method, *allowed), kept)
        while not motion.progress.reason:
            motion.go()
        found.append(motion.samples)
    assert motion.progress.steps >= 50
    assert np.array_equal(found[0], found[1])
    assert np.array_equal(found[0], found[2])
