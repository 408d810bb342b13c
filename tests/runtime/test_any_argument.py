"""Whatever is given for an argument of a kernel's methods: a result, or an error of eomgen in a line of ASCII."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.description.load import load_robot, robot_from_toml
from eomgen.errors import ArrayError, InputError, IntegrationStopped
from eomgen.integration import global_error, integrate
from eomgen.integration.until import Until
from eomgen.kernel import Kernel
from eomgen.kernel.stepping.input_signals import DriveData, InputSignals, LinkWrench, Signal, Track
from eomgen.motion.point_to_point import Harmonic, PointToPoint
from tests.support.builds import Build
from tests.support.methods import method_of
from tests.support.refusals import refused
from tests.support.sliders import on_rail

WRONG: tuple[Any, ...] = (
    *(np.ones(3), np.array([True, False]), "x", 10**400, np.nan, 1e300, 1e-300, object(), [], {}, -1, {"a": 1}, 2**70),
    *(np.array(["a"]), [[1], [1, 2]], 1j, b"x", True, (), {1: 2}, 2**40 + 0.5, [None], "\x1b[2J"),
)
FIXED, CHOSEN = {"dt": 1e-3, "steps": 3}, {"method": "tsit5", "duration": 1e-2, "samples": 2}
MAPPINGS: dict[str, Callable[[Kernel], str]] = {  # arguments that may be values by name, and such a name
    "wrench": lambda kernel: kernel.frames[0],
    "limits": lambda kernel: kernel.coordinates[0],
}


LAW = 'friction = { model = "lugre", coulomb = 1.0, bristle_stiffness = 1e3 }'  # with a state


@pytest.fixture(scope="module", params=["one_link", "four_bar", "rail"])
def kernel(request: pytest.FixtureRequest, built: Build) -> Kernel:
    return built(robot_from_toml(on_rail(LAW)) if request.param == "rail" else load_robot(request.param), "all")


def calls(kernel: Kernel, steps: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Each method with arguments that it takes."""
    still = np.zeros(len(kernel.coordinates))
    derived = {"name": "mass_matrix", "args": (still,), "tangents": (still,), "cotangent": np.ones((still.size,) * 2)}
    for name in sorted({*dir(type(kernel)), *dir(type(kernel.functions))}):
        method = method_of(kernel, name)
        if name.startswith("_") or not inspect.ismethod(method):
            continue
        parameters = list(inspect.signature(method).parameters.items())
        given: dict[str, Any] = {"frame": kernel.frames[0], "name": kernel.frames[0], "motor": "none"}
        given["z"] = np.zeros(len(kernel.internal_states))
        given |= derived if "args" in dict(parameters) else {}
        given |= {"name": "mass_matrix", "series": (still, still)} if "series" in dict(parameters) else {}
        needed = {key: given.get(key, still) for key, x in parameters if x.default is x.empty and x.kind not in (2, 4)}
        if name.startswith("rollout"):
            needed |= steps
        if name == "inverse_kinematics":
            needed |= {"pose": kernel.frame_pose(kernel.home, kernel.frames[0]), "starts": 1}
        if name == "rollout_gradient":
            needed["loss"] = lambda q, v: (0.0, np.zeros_like(q), np.zeros_like(v))
        yield name, needed


@pytest.mark.parametrize("steps", [FIXED, pytest.param(CHOSEN, marks=pytest.mark.soak)], ids=["fixed", "chosen"])
def test_any_argument_is_taken_or_refused(kernel: Kernel, steps: dict[str, Any]) -> None:
    tried, wrong = 0, list[str]()
    for name, needed in calls(kernel, steps):
        for key, parameter in inspect.signature(method_of(kernel, name)).parameters.items():
            values = () if parameter.kind in (2, 4) else WRONG
            for value in (*values, *({MAPPINGS[key](kernel): x} for x in values if key in MAPPINGS)):
                tried += 1
                given = {k: x.copy() if isinstance(x, np.ndarray) else x for k, x in {**needed, key: value}.items()}
                wrong += wrong_errors(f"{name}: {key}={value!r}", partial(method_of(kernel, name), **given))
    assert tried > 1000
    assert wrong == []


def wrong_errors(what: str, call: Callable[[], object]) -> list[str]:
    """What comes instead of a result or an error of eomgen in a line of ASCII."""
    try:
        call()
    except InputError as error:
        return [] if str(error).isascii() and str(error).isprintable() else [f"{what}: {error!r}"]
    except Exception as error:
        return [f"{what}: {type(error).__name__}: {error}"]
    return []


def test_any_argument_of_a_global_error_is_taken_or_refused() -> None:
    """Of the function, and of tolerances that are asked for as a quantity."""
    kernel = eomgen.build("one_link")
    still = np.zeros(kernel.n)
    motion = integrate(kernel, still, still, 0.02, drive=still)
    known: dict[str, Any] = {"kernel": kernel, "trajectory": motion, "drive": still, "wrench": None, "prescribed": None}
    wrong = []
    for key in known:
        for value in (*WRONG, kernel.calls, motion.q, "one_link", np.full(kernel.n, np.inf)):
            wrong += wrong_errors(f"{key}={value!r}", partial(global_error, **{**known, key: value}))
    for value in (*WRONG, {"tool": "x"}, {"tool": -1.0}, {"gone": 1.0}, {"tool": np.nan}, {1: 1.0}, {"tool": True}):
        wrong += wrong_errors(f"{value!r}", partial(eomgen.simulate, "one_link", duration=0.02, within=value))
    assert wrong == []
    refused(ArrayError, "wrench", global_error, kernel, motion, wrench=np.ones(3))


NO_NUMBERS: tuple[Any, ...] = (
    *([10**400] * 2, ["1", "2"], [1j, 2j], np.ma.array([1.0, 2.0], mask=[True, False]), [[1], [1, 2]], "x", object()),
    *([None, None], {}, [1.0, np.nan]),
)


@pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda value: type(value).__name__)
def test_no_numbers_become_some(value: Any, built: Build) -> None:
    """Texts are not read, imaginary parts and masks not dropped, wherever numbers come in beside a kernel's arrays."""
    kernel, q, v = built(load_robot("one_link"), "all"), np.zeros(2), np.ones(2)
    row = value * 3 if isinstance(value, list) else value
    through = Signal.constant(v)

    def rolled(**options: Any) -> None:
        kernel.rollout(q, q, q, duration=1e-2, **options)

    def driven(torque: Signal = through, place: Any = (0, 1), **options: Any) -> InputSignals:
        return InputSignals(DriveData(torque=Track(torque, place), **options))

    tried: dict[str, Callable[[], Any]] = {
        "q0": lambda: integrate(kernel, value, q, 1e-2),
        "drive": lambda: integrate(kernel, q, q, 1e-2, drive=lambda t, q, v: value),
        "wrench": lambda: integrate(kernel, q, q, 1e-2, wrench=[row]),
        "wrench at t": lambda: integrate(kernel, q, q, 1e-2, wrench=lambda t, q, v: [row]),
        "atol": lambda: integrate(kernel, q, q, 1e-2, atol=row),
        "rollout: atol": lambda: rolled(atol=row),
        "saturate": lambda: rolled(saturate=value),
        "loads: wrench": lambda: rolled(loads={"wrench": [row]}),
        "coefficients": lambda: rolled(loads=driven(Signal(np.array([0.0, 1.0]), row))),
        "knots": lambda: rolled(loads=driven(Signal(row, through.coefficients))),
        "place": lambda: rolled(loads=driven(place=row)),
        "effort": lambda: rolled(loads=driven(effort=value)),
        "first": lambda: rolled(loads=InputSignals(first=value)),
        "t0": lambda: rolled(loads=InputSignals(wrenches=[LinkWrench(0, Signal.constant(np.ones(6)), t0=value)])),
        "start": lambda: PointToPoint(value, v, 1.0),
        "t": lambda: PointToPoint(q, v, 1.0).at(value),
        "times of samples": lambda: Signal.through(row, [[0.0], [1.0]]),
        "samples": lambda: Signal.through([0.0, 1.0], row),
        "times": lambda: integrate(kernel, q, q, 1.0, times=row),
        "point": lambda: Until.distance(kernel, "tcp", row, 1.0),
        "amplitude": lambda: Harmonic(value, 1.0),
        "frequency": lambda: Harmonic(v, value),
        "phase": lambda: Harmonic(v, 1.0, value),
    }
    for call in tried.values():
        caught = refused(InputError, "", call)
        assert str(caught).isascii()
        assert str(caught).isprintable()


def test_lengths_of_time_that_are_none_are_refused_as_such(kernel: Kernel) -> None:
    q = np.zeros(len(kernel.coordinates))
    for dt in (1e300, 10**400, 1.1e30, np.inf):
        with pytest.raises(InputError, match=r"dt = .* is not a length of time; .* to 1e\+30 is allowed"):
            kernel.rollout(q, q, q, dt, 10)
    for duration in (1e300, 10**400, 1.1e30):
        with pytest.raises(InputError, match=r"duration = .* is not a length of time; .* 1e\+30, is allowed"):
            kernel.rollout(q, q, q, duration=duration, samples=2, method="tsit5")
    with pytest.raises(InputError, match=r"1099511627777 samples take .* GB for their times alone"):
        kernel.rollout(q, q, q, duration=1.0, samples=2**40, method="tsit5")


def test_a_step_that_is_too_long_is_not_blamed_on_the_mass_matrix(built: Build) -> None:
    kernel = built(load_robot("puma560"), "rollout", "mass_matrix")
    q = np.full(6, 0.3)
    for dt in (1e25, 1e15, 1e5):
        refused(IntegrationStopped, "shorter dt", kernel.rollout, q, q, q, dt, 10)


def test_results_are_not_written_where_no_number_begins(kernel: Kernel) -> None:
    q = np.zeros(len(kernel.coordinates))
    held = np.zeros(8 * q.size**2 + 1, np.uint8)
    out = held[1:].view(np.float64).reshape(q.size, q.size)
    assert not out.flags.aligned
    refused(ArrayError, "out: expected an array that is aligned for float64", kernel.mass_matrix, q, out=out)
    assert not held.any()
