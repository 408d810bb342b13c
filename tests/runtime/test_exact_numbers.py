"""Whole numbers that a float cannot hold, and numbers beyond all floats: refused by name, never rounded in silence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import ArrayError, InputError
from tests.support.builds import Build

pytestmark = pytest.mark.usefixtures("unoptimised")

ODD = 2**53 + 1
STIFFNESS = "joints.joint1.x.stiffness"


@pytest.fixture(scope="module")
def kernel(built: Build) -> eomgen.Kernel:
    return built(eomgen.load_robot("one_link"))


@pytest.fixture(scope="module")
def single(built: Build) -> eomgen.Kernel:
    return built(eomgen.load_robot("one_link"), dtype="float32")


@pytest.mark.parametrize(
    "value",
    [
        np.array([0, ODD]),
        np.array([0, -ODD]),
        np.array([[0, 1], [2, ODD]]),
        np.array([0, 2**63 + 1], np.uint64),
        [0, ODD],
        [0.5, ODD],
        [[0.5, 1], [1, ODD]],
        (0, 2**63 + 1),
        np.array([0, np.iinfo(np.int64).max]),
    ],
    ids=str,
)
def test_what_would_be_rounded_is_refused(value: Any, kernel: eomgen.Kernel) -> None:
    with pytest.raises(ArrayError, match=r"^v: -?\d+ is a whole number that float64 cannot hold exactly$"):
        kernel.energy([0.0, 0.0], value)


@pytest.mark.parametrize(
    "value",
    [
        np.array([2**53, -(2**60)]),
        np.array([0, np.iinfo(np.int64).min]),
        np.array([0, 2**63], np.uint64),
        [0.5, 2**60],
        [0.1, 1e300],
        np.array([True, False]),
        np.array([0, 2**31 - 1], np.int32),
    ],
    ids=str,
)
def test_what_is_held_exactly_is_taken(value: Any, kernel: eomgen.Kernel) -> None:
    kernel = kernel.with_checks(False)
    assert np.array_equal(kernel.energy([0.0, 0.0], value), kernel.energy([0.0, 0.0], np.array(value, np.float64)))


def test_single_precision_holds_fewer(single: eomgen.Kernel) -> None:
    with pytest.raises(ArrayError, match=r"^q: 16777217 is a whole number that float32 cannot hold exactly$"):
        single.mass_matrix([0, 2**24 + 1])
    single.mass_matrix([0, 2**24])
    single.mass_matrix([0.1, 0.3])  # Python's fractions are rounded, as they always are


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (10**400, r"an integer of 1329 bits is beyond float64; at most 1\.8e\+308 is allowed"),
        (ODD, "9007199254740993 is a number that float64 cannot hold exactly"),
        (np.uint64(2**63 + 1), "cannot hold exactly"),
        (np.longdouble(1) / 3, "cannot hold exactly"),
        (True, "true is not a number"),
    ],
    ids=["huge", "odd", "uint64", "longdouble", "bool"],
)
def test_parameters(value: Any, message: str, kernel: eomgen.Kernel) -> None:
    if isinstance(value, np.longdouble) and np.finfo(np.longdouble).nmant == 52:
        pytest.skip("long double is double here")
    parameters = kernel.with_parameters().parameters
    name = next(iter(parameters))
    before = dict(parameters)
    with pytest.raises(InputError, match=rf"^parameters: {name} = .*{message}$"):
        parameters[name] = value
    assert dict(parameters) == before
    parameters[name] = np.float32(3)
    assert parameters[name] == 3.0


def test_a_parameter_beyond_single_precision(single: eomgen.Kernel) -> None:
    parameters = single.with_parameters().parameters
    name = next(iter(parameters))
    with pytest.raises(InputError, match=r"= 1e\+300 is beyond float32; at most 3\.4e\+38 is allowed$"):
        parameters[name] = 1e300
    parameters[name] = 0.1  # as Python's fractions are


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"steps": 2**62}, r"steps = 4611686018427387904 is not a whole number from 1 to 2305843009213693952$"),
        ({"steps": 10**400}, "steps = an integer of 1329 bits is not a whole number from 1 to"),
        ({"every": 2**63}, "every = 9223372036854775808 is not a whole number from 1 to"),
        ({"steps": 2**50}, r"1125899906842625 states to be stored take twice 1\.8e\+07 GB, more than there is"),
        ({"dt": 10**400}, "dt = an integer of 1329 bits is not a length of time"),
        ({"dt": 1j}, "dt = 1j is not a length of time"),
        ({"kp": 10**400, "target": [0.0, 0.0]}, "kp: expected float64 of shape"),
        ({"kp": "2", "target": [0.0, 0.0]}, "kp: expected float64 of shape"),
        ({"q0": [[0.0, 1.0], [0.0]]}, "q0: expected float64 of shape"),
        ({"method": "e" * 500}, "method 'eee.*' is unknown; allowed: rk4, implicit, rosenbrock, tsit5"),
    ],
    ids=lambda x: str(x)[:30],
)
def test_numbers_of_rollouts(changed: dict[str, Any], message: str, kernel: eomgen.Kernel) -> None:
    how: dict[str, Any] = {"q0": [0.0, 0.0], "v0": [0.0, 0.0], "u": [0.0, 0.0], "dt": 1e-3, "steps": 3, **changed}
    with pytest.raises(InputError, match=message):
        kernel.rollout(**how)


def test_single_precision_has_no_step_that_it_cannot_hold(single: eomgen.Kernel) -> None:
    for dt in (1e-300, 1e300):
        with pytest.raises(InputError, match=r"1\.18e-38, the least above 0 that float32 holds, to 1e\+30 is allowed"):
            single.rollout([0.0, 0.0], [0.0, 0.0], [0.0, 0.0], dt, 3)


def test_threads(kernel: eomgen.Kernel) -> None:
    with pytest.raises(InputError, match="threads: an integer of 16610 bits is not a number of threads"):
        kernel.with_threads(-(10**5000))
