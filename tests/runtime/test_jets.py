"""Time derivatives along motions that kernels give in C: one state and many, closed loops, and what is refused."""

from __future__ import annotations

import itertools
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import ArrayError, InputError, LoopError, UnknownNameError
from eomgen.kernel.derivatives.in_time import MOTION
from eomgen.pipeline.options import Options
from eomgen.runtime.levels import BASE
from tests.runtime.test_direct import in_python
from tests.runtime.test_state_laws import ARM
from tests.support.builds import Build
from tests.support.random_robots import random_robot, seeds
from tests.support.refusals import refused
from tests.support.soak import soaked

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

RATES = {"inverse_dynamics": 3, "forward_dynamics": 2, "energy": 2, "mass_matrix": 1, "bias_force": 2}
WHOLE = "import one_link, eomgen; whole = eomgen.Kernel(one_link.kernel.raw.libraries)"


@pytest.fixture(scope="module")
def kernel() -> eomgen.Kernel:
    """Built when it is called: nothing but what a test asks for."""
    return eomgen.build("one_link")


def motion(kernel: eomgen.Kernel, orders: int, *lead: int, seed: int = 1) -> tuple[np.ndarray, ...]:
    """Time derivatives of the coordinates, from order 0 on."""
    rng = np.random.default_rng(seed)
    return tuple(rng.uniform(-0.5, 0.5, (*lead, kernel.n)) for _ in range(orders))


@pytest.mark.parametrize("name", soaked(RATES, ("inverse_dynamics", "forward_dynamics")))
def test_the_first_order_is_the_derivative_along_the_motion(name: str, kernel: eomgen.Kernel) -> None:
    reads = RATES[name]
    moving, u = motion(kernel, reads + 1, 5), motion(kernel, 2, 5, seed=2)
    driven = name == "forward_dynamics"
    series = (*moving, u) if driven else moving
    value, rate = kernel.jet(name, series)
    args = (*moving[:reads], u[0]) if driven else moving[:reads]
    rates = (*moving[1:], u[1]) if driven else moving[1:]
    np.testing.assert_allclose(value, getattr(kernel, name)(*args), rtol=1e-14, atol=1e-14)
    along = kernel.jvp(name, args, rates)
    np.testing.assert_allclose(rate, along, rtol=1e-13, atol=1e-13 * max(1.0, np.abs(along).max()))


def slopes_agree(kernel: eomgen.Kernel, name: str, series: tuple[Any, ...], h: float = 1e-5) -> None:
    """The jet of first order is the function and its difference along a motion."""
    value, slope = kernel.jet(name, series)
    largest = max(1.0, np.abs(value).max())

    def at(t: float) -> np.ndarray:
        q = series[0] + t * series[1]
        if name == "christoffel":
            return np.array(kernel.christoffel(q))
        a, (u, rate) = series[2], series[3]
        return np.array(kernel.forward_dynamics_jacobian(q + t**2 / 2 * a, series[1] + t * a, u + t * rate))

    np.testing.assert_allclose(value, at(0.0), rtol=0.0, atol=1e-11 * largest)
    np.testing.assert_allclose(slope, (at(h) - at(-h)) / (2 * h), rtol=1e-6, atol=1e-6 * largest)


@pytest.mark.parametrize("name", soaked(("forward_dynamics_jacobian", "christoffel"), ("forward_dynamics_jacobian",)))
def test_matrices_of_accelerations_and_christoffel_symbols(name: str, kernel: eomgen.Kernel) -> None:
    (q, v, a), u = motion(kernel, 3), motion(kernel, 2, seed=2)
    slopes_agree(kernel, name, (q, v) if name == "christoffel" else (q, v, a, u))


@pytest.mark.soak
def test_matrices_of_accelerations_of_closed_mechanisms() -> None:
    kernel = eomgen.build("four_bar")
    moving = kernel.close_series((np.array([0.5, 0.2, 1.2]), *motion(kernel, 2)), fixed=["joint1.gamma"])
    slopes_agree(kernel, "forward_dynamics_jacobian", (*moving, motion(kernel, 2, seed=2)))
    with pytest.raises(LoopError, match="loop joint4 is open"):
        kernel.jet("forward_dynamics_jacobian", (moving[0] + 0.1, *moving[1:], motion(kernel, 2, seed=2)))


def test_what_would_be_too_long_is_refused() -> None:
    kernel = eomgen.build("puma560_elastic")
    q, v, a, u, rate = motion(kernel, 5)
    page = (Path(__file__).parents[2] / "docs" / "derivatives.md").read_text(encoding="utf-8")
    for name, series in (("christoffel", (q, v)), ("forward_dynamics_jacobian", (q, v, a, (u, rate)))):
        with pytest.raises(InputError, match=f"{name}_jet1: .* takes some .* operations; allowed: 12000") as caught:
            kernel.jet(name, series)
        assert str(caught.value).split("some ")[1].split()[0] in page


@pytest.mark.parametrize("seed", seeds(0, 1, 12))
def test_forward_dynamics_follow_the_drives_of_a_motion(seed: int) -> None:
    """Drives and their time derivatives make the accelerations of the motion and theirs."""
    kernel = eomgen.build(random_robot(seed, joints=(1, 3), max_size=6, tree=True))
    moving = motion(kernel, 7, 2, seed=seed)
    drives = kernel.jet("inverse_dynamics", moving, 4)
    found = kernel.jet("forward_dynamics", (*moving[:6], drives), 4)
    for k, (one, other) in enumerate(zip(found, moving[2:], strict=True)):
        np.testing.assert_allclose(one, other, atol=1e-8 * 10**k)


def test_frames(kernel: eomgen.Kernel) -> None:
    """Poses, Jacobians and their time derivatives, beside differences along the motion."""
    moving, frame, h = motion(kernel, 3, 3), kernel.frames[-1], 1e-4

    def at(t: float) -> np.ndarray:
        return np.asarray(moving[0] + t * moving[1] + t**2 / 2 * moving[2])

    for name in ("frame_pose", "frame_jacobian"):
        function = getattr(kernel, name)
        value, rate, second = kernel.jet(name, (*moving, frame), 2)
        before, now, there = (function(at(t), frame) for t in (-h, 0.0, h))
        np.testing.assert_array_equal(value, now)
        np.testing.assert_allclose(rate, (there - before) / (2 * h), atol=1e-7)
        np.testing.assert_allclose(second, (there - 2 * now + before) / h**2, atol=1e-6)


def test_one_state_and_many_have_the_same_bits(kernel: eomgen.Kernel) -> None:
    moving = motion(kernel, 5, 2, 19)
    together = kernel.jet("inverse_dynamics", moving, 2)
    assert [x.shape for x in together] == 3 * [(2, 19, kernel.n)]
    for i in (0, 7, 18):
        alone = kernel.jet("inverse_dynamics", tuple(x[1, i] for x in moving), 2)
        for whole, own in zip(together, alone, strict=True):
            np.testing.assert_array_equal(whole[1, i], own)


def test_with_and_without_the_extension_module(kernel: eomgen.Kernel) -> None:
    """Both give the same bits, whatever calls look like, and parameters of a copy are its own."""
    moving, u = motion(kernel, 5), motion(kernel, 3, seed=4)
    plain = in_python(kernel)
    assert kernel.functions.is_direct
    assert not plain.functions.is_direct
    heavier = kernel.replaced(parameters={"joints.joint1.x.stiffness": 9.0})
    for name, series in (("inverse_dynamics", moving), ("forward_dynamics", (*moving[:4], u))):
        wanted = plain.jet(name, series, 2)
        for given in (series, list(series), (*series[:-1], tuple(series[-1])) if name[0] == "f" else series):
            for _ in range(2):
                for one, other in zip(kernel.jet(name, given, 2), wanted, strict=True):
                    np.testing.assert_array_equal(one, other)
        other_way = in_python(heavier).jet(name, series, 2)
        for _ in range(2):
            for one, other in zip(heavier.jet(name, series, 2), other_way, strict=True):
                np.testing.assert_array_equal(one, other)
        assert not np.array_equal(other_way[0], wanted[0])


def test_every_function_fits_the_extension_module(kernel: eomgen.Kernel) -> None:
    """The arrays of all functions, those with loops included; calls of the residual to order 4 have most."""
    for made in (kernel, eomgen.build("four_bar"), eomgen.build("flexible_arm")):
        assert made.functions.is_direct
        for name in made.raw.functions:
            assert type(made._bound[name]).__name__ == "Direct"
    for lead in ((), (7,)):
        series = (*motion(kernel, 7, *lead), motion(kernel, 5, *lead, seed=2))
        wanted = in_python(kernel).jet("residual", series, 4)
        for _ in range(2):
            np.testing.assert_array_equal(kernel.jet("residual", series, 4), wanted)


def test_numbers_of_single_precision() -> None:
    double, single = eomgen.build("one_link"), eomgen.build("one_link", dtype="float32")
    moving = tuple(x.astype(np.float32) for x in motion(double, 5, 4))
    exact = double.jet("inverse_dynamics", tuple(x.astype(np.float64) for x in moving), 2)
    for one, other in zip(single.jet("inverse_dynamics", moving, 2), exact, strict=True):
        assert one.dtype == np.float32
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-5 * np.abs(other).max())


@pytest.mark.parametrize("order", soaked([2, 4], [2]))
def test_closed_mechanisms(order: int) -> None:
    """Series that close loops, drives of such a motion, and the accelerations that they make again."""
    kernel = eomgen.build("four_bar")
    guess = (np.array([0.5, 0.2, 1.2]), *motion(kernel, order + 2))
    moving = kernel.close_series(guess, fixed=["joint1.gamma"])
    for one, other in zip(moving, guess, strict=True):
        assert one[0] == other[0]
    for gap in kernel.jet("constraint", moving, order):
        np.testing.assert_allclose(gap, 0.0, atol=1e-11)
    h = 1e-3  # a step along the motion leaves a gap of an order more than those that vanish
    near = sum(x * h**i / math.factorial(i) for i, x in enumerate(moving))
    assert np.abs(kernel.functions.constraint(near)).max() < 1e2 * h ** (order + 3) + 1e-13
    drives = kernel.jet("inverse_dynamics", moving, order)
    found = kernel.jet("forward_dynamics", (*moving[: order + 2], drives), order)
    for k, (one, other) in enumerate(zip(found, moving[2:], strict=True)):
        np.testing.assert_allclose(one, other, atol=1e-8 * 10**k)
    many = kernel.close_series([np.stack([x, x]) for x in moving])
    np.testing.assert_allclose(many[-1][1], moving[-1], atol=1e-7)
    refused(LoopError, "loop joint4 is open", kernel.jet, "inverse_dynamics", (moving[0] + 0.1, *moving[1:]), 2)
    with pytest.raises(LoopError, match="opens at the rates that are held"):
        kernel.close_series(
            (moving[0], moving[1], moving[2] + 0.1), fixed=["joint1.gamma", "joint2.gamma", "joint3.gamma"]
        )
    with pytest.raises(InputError, match="series: got 1; allowed: 2 to 7 arrays, q, v, a, jerk, snap, crackle, pop"):
        kernel.close_series(guess[:1])


@pytest.mark.soak
def test_series_close_loops_in_batches_of_single_precision() -> None:
    """As those of one state; arrays are of the kernel's type."""
    kernel, double = eomgen.build("four_bar", dtype="float32"), eomgen.build("four_bar")
    guess = (np.tile([0.5, 0.2, 1.2], (3, 1)), *motion(double, 3, 3))
    wanted = double.close_series(guess, fixed=["joint1.gamma"])
    many = kernel.close_series([x.astype(np.float32) for x in guess], fixed=["joint1.gamma"])
    for k, (one, other) in enumerate(zip(many, wanted, strict=True)):
        assert one.shape == (3, 3)
        assert one.dtype == np.float32
        np.testing.assert_allclose(one, other, atol=1e-4 * 10**k)
    for i in range(3):
        alone = double.close_series([x[i] for x in guess], fixed=["joint1.gamma"])
        np.testing.assert_allclose([x[i] for x in wanted], alone, atol=1e-10)
    refused(ArrayError, r"jerk: expected float64 of shape \(3,\)", double.close_series, (*guess[:3], guess[3][:, :2]))


def test_internal_states_move_as_velocities(built: Build) -> None:
    """They are a series of their own; functions that do not depend on them need none."""
    names = "inverse_dynamics_jet1", "inverse_dynamics", "mass_matrix_jet1", "mass_matrix"
    kernel, h = built(robot_from_toml(ARM), *names), 1e-6
    moving, z = motion(kernel, 4), np.random.default_rng(2).uniform(-0.5, 0.5, (2, len(kernel.internal_states)))

    def at(t: float) -> np.ndarray:
        q, v, a = (x + t * dx for x, dx in itertools.pairwise(moving))
        return np.array(kernel.inverse_dynamics(q, v, a, z=z[0] + t * z[1]))

    value, rate = kernel.jet("inverse_dynamics", (*moving, tuple(z)))
    np.testing.assert_allclose(value, at(0.0), rtol=1e-12, atol=1e-12 * np.abs(value).max())
    slope = (at(h) - at(-h)) / (2 * h)
    np.testing.assert_allclose(rate, slope, rtol=1e-5, atol=1e-6 * np.abs(slope).max())
    M, rate = kernel.jet("mass_matrix", moving[:2])
    ahead, behind = (kernel.mass_matrix(moving[0] + t * moving[1]) for t in (h, -h))
    np.testing.assert_allclose(M, kernel.mass_matrix(moving[0]), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(rate, (ahead - behind) / (2 * h), rtol=1e-5, atol=1e-8)
    with pytest.raises(InputError, match=r"series: lacks 'jerk'.*allowed: \(q, v, a, jerk, \(z, z1\)\)"):
        kernel.jet("inverse_dynamics", moving)


@pytest.mark.soak
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_packages_have_those_that_are_named(dtype: str, tmp_path: Path) -> None:
    """In ``eomgen.Kernel`` of its libraries, with the bits of the kernel here, of one state and of a batch."""
    names = ("inverse_dynamics", "inverse_dynamics_jet2")
    eomgen.generate("one_link", tmp_path, Options(names, dtype, flags=("-O0",), levels=(BASE,)))
    kernel = eomgen.build("one_link", dtype=dtype)
    moving = [x.astype(dtype) for x in motion(kernel, 5, 3)]
    np.save(tmp_path / "moving.npy", moving)
    code = (
        f"{WHOLE}; import numpy as np; rows = np.load('moving.npy');"
        "np.save('many', whole.jet('inverse_dynamics', tuple(rows), 2));"
        "np.save('one', whole.jet('inverse_dynamics', tuple(rows[:, 1]), 2))"
    )
    found = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert found.returncode == 0, found.stderr
    wanted = np.array(kernel.jet("inverse_dynamics", moving, 2))
    assert wanted.dtype == dtype
    np.testing.assert_array_equal(np.load(tmp_path / "many.npy"), wanted)
    np.testing.assert_array_equal(np.load(tmp_path / "one.npy"), wanted[:, 1])
    code = f"{WHOLE}; whole.jet('energy', [[0.0, 0.0]] * 5, 2)"
    answer = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert "one_link was built without time derivatives of 'energy' to order 2" in answer.stderr


def test_what_is_wrong_is_named(kernel: eomgen.Kernel) -> None:
    q, v, a, jerk, snap = moving = motion(kernel, 5)
    wrong: list[tuple[tuple[Any, ...], type[Exception], str]] = [
        (("inverse", moving, 2), UnknownNameError, "without time derivatives of 'inverse' to order 2"),
        (("inverse_dynamics", moving, 5), InputError, "order: 5; allowed: 1 to 4"),
        (("inverse_dynamics", moving, True), InputError, "order: true; allowed: 1 to 4"),
        (
            ("inverse_dynamics", moving[:4], 2),
            InputError,
            r"series: lacks 'snap', which inverse_dynamics to order 2 needs",
        ),
        (("inverse_dynamics", q, 2), InputError, r"series: got ndarray; allowed: \(q, v, a, jerk, snap\)"),
        (("forward_dynamics", (q, v, a, v), 1), InputError, r"series of u: got ndarray; allowed: \(u, u1\)"),
        (("forward_dynamics", (q, v, a, (v,)), 1), InputError, r"series of u: got 1; allowed: \(u, u1\)"),
        (("forward_dynamics", (), 1), InputError, r"series: is too short.*got 0; allowed: \(q, v, a, \(u, u1\)\)"),
        (("frame_pose", (q, v), 1), InputError, r"series: lacks 'v', .*; allowed: \(q, v, frame\)"),
        (("frame_pose", (q, v, "nobody"), 1), UnknownNameError, "frame: 'nobody' is unknown"),
        (("inverse_dynamics", (q, v, a, jerk, snap[:1]), 2), ArrayError, r"snap: expected float64 of shape"),
        (("inverse_dynamics", (q, v, a, jerk, snap * np.nan), 2), ArrayError, "snap: .* is nan"),
    ]
    for args, kind, text in wrong:
        for _ in range(2):
            refused(kind, text, kernel.jet, *args)
        kernel.jet("inverse_dynamics", moving, 2)  # which is bound to the extension module meanwhile
    assert MOTION[:5] == ("q", "v", "a", "jerk", "snap")
    refused(InputError, "one_link has nothing to close", kernel.close_series, moving)
