"""Derivatives that kernels give in C: one state and many, by states and parameters, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import ArrayError, InputError, LoopError, UnknownNameError
from tests.support.builds import Build
from tests.support.refusals import refused
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

ENDINGS = ("tangent", "adjoint", "parameter_tangent", "parameter_adjoint", "hessian")
FUNCTIONS = ("inverse_dynamics", "forward_dynamics", "energy", "frame_pose", "frame_jacobian")
KERNELS = tuple(f"{name}_{ending}" for name in FUNCTIONS for ending in ENDINGS)


@pytest.fixture(scope="module")
def kernel() -> eomgen.Kernel:
    """Built when it is called: nothing but what a test asks for."""
    return eomgen.build("one_link")


def arguments(kernel: eomgen.Kernel, name: str, *lead: int) -> tuple[Any, ...]:
    """States, and a frame where the function takes one."""
    rng = np.random.default_rng(3)
    arrays = [rng.uniform(-0.5, 0.5, (*lead, kernel.n)) for _ in range({"energy": 2}.get(name, 3))]
    return (arrays[0], kernel.frames[-1]) if name.startswith("frame_") else tuple(arrays)


@pytest.mark.parametrize("name", soaked(FUNCTIONS, ("forward_dynamics",)))
def test_derivatives_agree_with_each_other_and_with_differences(name: str, kernel: eomgen.Kernel) -> None:
    """In states with two leading axes, as NumPy's rules have it."""
    args, rng = arguments(kernel, name, 2, 3), np.random.default_rng(5)
    arrays = [x for x in args if not isinstance(x, str)]
    function, rest = getattr(kernel, name), args[len(arrays) :]
    rates = [rng.uniform(-1.0, 1.0, x.shape) for x in arrays]
    value = function(*args)
    weights = rng.uniform(-1.0, 1.0, value.shape)
    inner = tuple(range(2, value.ndim))
    along, gradient = kernel.jvp(name, args, rates), kernel.vjp(name, args, weights)
    assert along.shape == value.shape
    assert [x.shape for x in gradient] == [x.shape for x in arrays]
    wanted = (along * weights).sum(axis=inner)
    found = sum((x * rate).sum(axis=-1) for x, rate in zip(gradient, rates, strict=True))
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * np.abs(weights * along).max())
    h, size = 1e-6, np.abs(value).max() + np.abs(along).max()
    there, before = (function(*(x + s * h * d for x, d in zip(arrays, rates, strict=True)), *rest) for s in (1, -1))
    np.testing.assert_allclose(along, (there - before) / (2 * h), atol=1e-8 * size)
    second = kernel.hessian(name, args, weights)
    assert second.shape == (2, 3, *(2 * [len(arrays) * kernel.n]))
    np.testing.assert_array_equal(second, np.swapaxes(second, -1, -2))
    ends = []
    for s in (1, -1):
        moved = [x + s * h * d for x, d in zip(arrays, rates, strict=True)]
        ends.append(np.concatenate(kernel.vjp(name, (*moved, *rest), weights), axis=-1))
    turned = np.einsum("...ij,...j->...i", second, np.concatenate(rates, axis=-1))
    np.testing.assert_allclose(turned, (ends[0] - ends[1]) / (2 * h), atol=1e-8 * (1 + np.abs(ends[0]).max()))


def test_one_state_and_many_have_the_same_bits(kernel: eomgen.Kernel) -> None:
    args = arguments(kernel, "inverse_dynamics", 19)
    weights = np.random.default_rng(1).uniform(-1.0, 1.0, (19, kernel.n))
    together = kernel.vjp("inverse_dynamics", args, weights, tuple(kernel.parameters))
    hessians = kernel.hessian("inverse_dynamics", args, weights)
    for i in (0, 7, 18):
        alone = kernel.vjp("inverse_dynamics", [x[i] for x in args], weights[i], tuple(kernel.parameters))
        for whole, own in zip(together, alone, strict=True):
            np.testing.assert_array_equal(whole[i], own)
        np.testing.assert_array_equal(hessians[i], kernel.hessian("inverse_dynamics", [x[i] for x in args], weights[i]))


@pytest.mark.soak
@pytest.mark.parametrize("name", soaked(["forward_dynamics", "energy", "frame_pose"], ["energy"]))
def test_by_parameters(name: str, kernel: eomgen.Kernel) -> None:
    """The Jacobian's columns are differences, and the reverse sweep's weighted rows of it."""
    args, names = arguments(kernel, name, 4), tuple(kernel.parameters)
    function = getattr(kernel, name)
    value = function(*args)
    found = kernel.parameter_jacobian(name, args, names)
    assert found.shape == (*value.shape, len(names))
    np.testing.assert_array_equal(found, kernel.parameter_jacobian(name, args))
    weights = np.random.default_rng(2).uniform(-1.0, 1.0, value.shape)
    by = kernel.vjp(name, args, weights, names)[-1]
    wanted = (found * weights[..., None]).sum(axis=tuple(range(1, value.ndim)))
    np.testing.assert_allclose(by, wanted, rtol=1e-10, atol=1e-12)
    for k, parameter in enumerate(names):
        x = kernel.parameters[parameter]
        h = 1e-5 * max(1.0, abs(x))
        there, before = (function_of(kernel, name, args, parameter, x + s * h) for s in (1, -1))
        np.testing.assert_allclose(found[..., k], (there - before) / (2 * h), atol=1e-7 * (1 + np.abs(value).max()))
        rates = [np.zeros_like(y) for y in args if not isinstance(y, str)]
        np.testing.assert_allclose(
            kernel.jvp(name, args, rates, parameters={parameter: 1.0}), found[..., k], rtol=1e-12
        )


def function_of(kernel: eomgen.Kernel, name: str, args: tuple[Any, ...], parameter: str, value: float) -> np.ndarray:
    """A function's result with another value of a parameter."""
    return np.asarray(getattr(kernel.with_parameters({parameter: value}), name)(*args))


def test_hessians_of_chosen_parameters_and_names(kernel: eomgen.Kernel) -> None:
    args = arguments(kernel, "energy")
    one, two = tuple(kernel.parameters)[:2]
    both = kernel.parameter_jacobian("energy", args, (two, one))
    np.testing.assert_array_equal(both[:, 0], kernel.parameter_jacobian("energy", args, (two,))[:, 0])
    assert kernel.parameter_jacobian("energy", args, ()).shape == (2, 0)


@pytest.mark.soak
def test_closed_mechanisms(built: Build) -> None:
    """Derivatives where loops are closed, and an open state is refused as by the function itself."""
    kernel = eomgen.build("four_bar")
    q = kernel.assemble([0.5, 0.2, 1.2])
    v, rng = kernel.project_velocity(q, [1.0, 0.0, 0.0]), np.random.default_rng(0)
    u, weights = rng.uniform(-1.0, 1.0, (2, kernel.n))
    by = kernel.forward_dynamics_jacobian(q, v, u)
    for found, matrix in zip(kernel.vjp("forward_dynamics", (q, v, u), weights), by, strict=True):
        np.testing.assert_allclose(found, weights @ matrix, rtol=1e-7, atol=1e-7 * np.abs(by).max())
    refused(LoopError, "loop joint4 is open", kernel.vjp, "forward_dynamics", (q + 0.1, v, u), weights)


def test_what_is_wrong_is_named(kernel: eomgen.Kernel) -> None:
    q, v, a = arguments(kernel, "inverse_dynamics")
    refused(UnknownNameError, "without derivatives of 'inverse'", kernel.vjp, "inverse", (q, v, a), a)
    refused(InputError, r"energy: got 3 arguments; allowed: \(q, v\)", kernel.jvp, "energy", (q, v, a), (q, v))
    refused(InputError, "tangents: got 1; allowed: one for each of q, v", kernel.jvp, "energy", (q, v), (q,))
    refused(ArrayError, r"cotangent: expected float64 of shape \(2,\)", kernel.vjp, "energy", (q, v), np.zeros(3))
    refused(ArrayError, r"cotangent.*\[1\] is nan", kernel.vjp, "energy", (q, v), [0.0, np.nan])
    refused(UnknownNameError, "parameters: 'mass' is unknown", kernel.vjp, "energy", (q, v), [1.0, 0.0], ("mass",))
    refused(InputError, "every name once", kernel.vjp, "energy", (q, v), [1.0, 0.0], 2 * tuple(kernel.parameters)[:1])
    with pytest.raises(InputError, match=r"'gravity\.x'; allowed: a sequence of names"):
        kernel.parameter_jacobian("energy", (q, v), "gravity.x")
    refused(UnknownNameError, "frame: 'hand' is unknown", kernel.jvp, "frame_pose", (q, "hand"), (q,))
    refused(InputError, r"frame_pose: got 1 arguments; allowed: \(q, frame\)", kernel.jvp, "frame_pose", (q,), (q,))


def test_derivatives_are_there_on_request_alone(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"), "energy", "energy_adjoint")
    q = np.zeros(2)
    assert len(kernel.vjp("energy", (q, q), [1.0, 1.0])) == 2
    refused(UnknownNameError, "without the kernel energy_hessian", kernel.hessian, "energy", (q, q), [1.0, 1.0])
    refused(UnknownNameError, "without the kernel energy_tangent", kernel.jvp, "energy", (q, q), (q, q))
