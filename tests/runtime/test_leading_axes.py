"""Leading axes of arguments go together as NumPy broadcasts; results gain them."""

from __future__ import annotations

import numpy as np
import pytest

import eomgen
from eomgen.errors import ArrayError
from tests.support.builds import Build
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")

RNG = np.random.default_rng(7)
Q, V, A, U = RNG.uniform(-1, 1, (4, 2, 3, 2))  # (2, 3) states of two coordinates each
W = RNG.uniform(-1, 1, (2, 3, 1, 6))
CALLS = {
    "mass_matrix": 1,
    "bias_force": 2,
    "generalized_force": 2,
    "inverse_dynamics": 3,
    "forward_dynamics": 3,
    "residual": 4,
    "energy": 2,
    "christoffel": 1,
    "reactions": 3,
    "euler_cosines": 1,
}


@pytest.fixture(scope="module")
def kernel(built: Build) -> eomgen.Kernel:
    """one_link: two coordinates, one link."""
    return built(eomgen.load_robot("one_link"))


@pytest.mark.parametrize("name", CALLS)
def test_any_number_of_leading_axes(name: str, kernel: eomgen.Kernel) -> None:
    call, arrays = getattr(kernel, name), (Q, V, A, U)[: CALLS[name]]
    flat = call(*(x.reshape(6, 2) for x in arrays))
    found = call(*arrays)
    assert found.shape == (2, 3, *flat.shape[1:])
    assert np.array_equal(found.reshape(flat.shape), flat)
    out = np.full(found.shape, np.nan)
    assert call(*arrays, out=out) is out
    assert np.array_equal(out, found)
    one = call(*(x[:1, :1] for x in arrays))
    assert one.shape == (1, 1, *flat.shape[1:])
    assert np.array_equal(one[0, 0], flat[0])


@pytest.mark.parametrize("name", [name for name, count in CALLS.items() if count > 1])
@pytest.mark.parametrize("shape", [(1, 2), (1, 1, 2), (3, 2), (2, 1, 2), (2,), (4, 1, 1, 2)])
def test_arguments_broadcast_as_arrays_of_numpy_do(name: str, shape: tuple[int, ...], kernel: eomgen.Kernel) -> None:
    call, others = getattr(kernel, name), (Q, V, A, U)[1 : CALLS[name]]
    q = np.random.default_rng(1).uniform(-1, 1, shape)
    whole = np.broadcast_shapes(q.shape, Q.shape)
    expected = call(np.broadcast_to(q, whole).copy(), *others)
    assert expected.shape[: len(whole) - 1] == whole[:-1]
    assert np.array_equal(call(q, *others), expected)


def test_one_row_beside_many_stands_for_all(kernel: eomgen.Kernel) -> None:
    many, row = V.reshape(6, 2), Q[:1, 0]
    assert row.shape == (1, 2)
    assert np.array_equal(kernel.bias_force(row, many), kernel.bias_force(row[0], many))
    assert kernel.bias_force(row, V[0, 0]).shape == (1, 2)


@pytest.mark.parametrize("name", ["generalized_force", "inverse_dynamics", "residual", "forward_dynamics", "reactions"])
def test_wrenches_broadcast_too(name: str, kernel: eomgen.Kernel) -> None:
    call, arrays = getattr(kernel, name), (Q, V, A, U)[: CALLS[name]]
    each = [[call(*(x[i, k] for x in arrays), wrench=W[i, k]) for k in range(3)] for i in range(2)]
    assert np.allclose(call(*arrays, wrench=W), each, rtol=1e-13)
    same = [[call(*(x[i, k] for x in arrays), wrench=W[i, 0]) for k in range(3)] for i in range(2)]
    assert np.allclose(call(*arrays, wrench=W[:, :1]), same, rtol=1e-13)
    one = [[call(*(x[0, 0] for x in arrays), wrench=W[i, k]) for k in range(3)] for i in range(2)]
    assert np.allclose(call(*(x[0, 0] for x in arrays), wrench=W), one, rtol=1e-13)
    refused(ArrayError, r"leading axes|states, but", call, *arrays, wrench=np.zeros((4, 1, 6)))


def test_frames_blocks_and_derivatives(kernel: eomgen.Kernel) -> None:
    flat = Q.reshape(6, 2)
    assert np.array_equal(kernel.frame_pose(Q, "tcp").reshape(6, 4, 4), kernel.frame_pose(flat, "tcp"))
    assert kernel.frame_jacobian(Q, "tcp").shape == (2, 3, 6, 2)
    for block in kernel.residual_jacobian(Q, V, A, U):
        assert block.shape == (2, 3, 2, 2)
    assert kernel.residual_jacobian(Q[0, 0], V[0, 0], A[0, 0], U)[0].shape == (2, 3, 2, 2)
    assert kernel.forward_dynamics_jacobian(Q, V[0], U[0, 0])[2].shape == (2, 3, 2, 2)
    names = ("joint1", "joint1")
    assert np.array_equal(kernel.blocks(Q).mass[names].reshape(6, 2, 2), kernel.blocks(flat).mass[names])


def test_axes_that_do_not_go_together(kernel: eomgen.Kernel) -> None:
    with pytest.raises(ArrayError, match=r"^v: leading axes \(2,\) do not go together with \(2, 3\) of other arrays$"):
        kernel.bias_force(Q, np.zeros((2, 2)))
    refused(ArrayError, r"^v: 4 states, but 3 in other arrays$", kernel.bias_force, Q[0], np.zeros((4, 2)))
    with pytest.raises(ArrayError, match=r"^out: expected float64 of shape \(2, 3, 2, 2\), got"):
        kernel.mass_matrix(Q, out=np.zeros((6, 2, 2)))
    with pytest.raises(ArrayError, match=r"^q0: expected float64 of shape \(2\) or \(N, 2\), got shape \(2, 3, 2\)$"):
        kernel.rollout(Q, V[0, 0], U[0, 0], 1e-3, 3)
    assert kernel.mass_matrix(np.zeros((0, 3, 2))).shape == (0, 3, 2, 2)
    assert kernel.bias_force(np.zeros((3, 0, 2)), V[0, :1]).shape == (3, 0, 2)
