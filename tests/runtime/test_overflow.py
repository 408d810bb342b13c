"""Finite numbers that lead beyond what the dtype holds: refused by name, as NaN in arguments is."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import ArrayError, SingularError
from tests.support.builds import Build
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")

Q, V = np.array([0.2, 0.5]), np.array([0.3, -1.0])
FAST = np.array([0.3, 1e200])
END = r"and float64 ends at 1\.8e\+308"


@pytest.fixture(scope="module")
def shared(built: Build) -> eomgen.Kernel:
    """one_link: coordinates joint1.x and joint1.gamma, one link."""
    return built(eomgen.load_robot("one_link"))


@pytest.fixture
def kernel(shared: eomgen.Kernel) -> eomgen.Kernel:
    return shared.with_parameters()


@pytest.mark.parametrize(
    ("name", "arrays", "entry", "coordinate"),
    [
        ("bias_force", (Q, FAST), r"joint1\.x is -?inf", "joint1.x"),
        ("inverse_dynamics", (Q, FAST, V), r"joint1\.x is (-?inf|nan)", "joint1.x"),
        ("forward_dynamics", (Q, FAST, V), r"joint1\.x is (-?inf|nan)", "joint1.x"),
        ("residual", (Q, FAST, V, V), r"joint1\.x is (-?inf|nan)", "joint1.x"),
        ("energy", (Q, FAST), r"\[0\] is inf", ""),
        ("reactions", (Q, FAST, V), r"\[0, \d\] is (-?inf|nan)", ""),
    ],
)
def test_results_that_are_not_finite_are_refused(
    name: str, arrays: tuple[Any, ...], entry: str, coordinate: str, kernel: eomgen.Kernel
) -> None:
    """With the kernel, the entry, and the largest of the numbers that it came from."""
    largest = r"the largest is joint1\.gamma = 1e\+200 in v"
    with pytest.raises(
        ArrayError, match=f"^{name}: {entry}, out of numbers that are finite; {largest}, {END}$"
    ) as caught:
        getattr(kernel, name)(*arrays)
    assert caught.value.coordinate == coordinate
    kernel.checks = False
    assert not np.isfinite(getattr(kernel, name)(*arrays)).all()


def test_in_batches_the_state_is_named(kernel: eomgen.Kernel) -> None:
    """The largest number is that of the same state."""
    v = np.tile(V, (700, 1))
    v[431, 1], v[650, 0] = 1e200, 1e201
    for threads in (1, 2):
        kernel.threads = threads
        refused(ArrayError, r"^energy: \[0\] in state 431 is inf, .* joint1\.gamma = 1e\+200 in v", kernel.energy, Q, v)
    refused(ArrayError, r"^energy: \[0\] in state \(4, 31\) is inf,", kernel.energy, Q, v.reshape(7, 100, 2))
    with pytest.raises(ArrayError, match=r"^residual_jacobian: \[\d\] joint1\.x joint1\.\w+ in state 1 is"):
        kernel.residual_jacobian(Q, [V, FAST * 1e107], V)


def test_what_wrenches_add_is_looked_at(kernel: eomgen.Kernel) -> None:
    wrench = np.array([[1.7e308, 1.7e308, 0.0, 0.0, 0.0, 1.7e308]])
    for name, count in (("external_force", 1), ("generalized_force", 2), ("inverse_dynamics", 3)):
        arrays = (Q, V, V)[:count]
        with pytest.raises(ArrayError, match=r"external_force: joint1\.\w+ is (-?inf|nan).* = 1\.7e\+308 in wrench"):
            getattr(kernel, name)(*arrays, wrench=wrench)
    a = np.array([1.5e308, 0.0]) / kernel.mass_matrix(Q)[0, 0]
    push = np.array([[-1e308, 0.0, 0.0, 0.0, 0.0, 0.0]])
    with pytest.raises(ArrayError, match=r"^inverse_dynamics: joint1\.x is inf.* the largest is "):
        kernel.inverse_dynamics(Q, V, a, wrench=push)


def test_single_precision_ends_earlier(built: Build) -> None:
    single = built(eomgen.load_robot("one_link"), dtype="float32")
    with pytest.raises(ArrayError, match=r"in v, and float32 ends at 3\.4e\+38$"):
        single.energy(Q.astype(np.float32), np.array([0.0, 1e25], np.float32))


def test_a_singular_mass_matrix_is_still_named_as_such(built: Build) -> None:
    robot = eomgen.load_robot("one_link")
    point = replace(robot.links[0], mass=0.0, inertia=(0.0,) * 6)
    kernel = built(replace(robot, name="no_mass", links=(point,)), "forward_dynamics")
    refused(SingularError, r"joint1\.x", kernel.forward_dynamics, Q, V, V)
