"""Array arguments: what is taken, what is converted, and what is refused, each with a message that names it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import ArrayError, InputError, UnknownNameError
from eomgen.runtime.arrays import numbers_in
from tests.support.builds import Build

pytestmark = pytest.mark.usefixtures("unoptimised")

STATES = 3
VECTOR = "expected float64 of shape (2,) or (..., 2)"


@pytest.fixture(scope="module")
def kernel(built: Build) -> eomgen.Kernel:
    """one_link: coordinates joint1.x and joint1.gamma, one link."""
    return built(eomgen.load_robot("one_link"))


@pytest.fixture(scope="module")
def single(built: Build) -> eomgen.Kernel:
    return built(eomgen.load_robot("one_link"), dtype="float32")


Q, V = np.array([0.2, 0.5]), np.array([0.3, -1.0])


def refusal(call: Callable[[], Any], error: type[Exception] = ArrayError) -> str:
    with pytest.raises(error) as caught:
        call()
    assert isinstance(caught.value, InputError)
    return str(caught.value)


@pytest.mark.parametrize(
    ("value", "got"),
    [
        (3.0, "shape ()"),
        (np.zeros(3), "shape (3,)"),
        (np.zeros(0), "shape (0,)"),
        ([], "shape (0,)"),
        (np.zeros((2, 3)), "shape (2, 3)"),
        (np.zeros((1, 2, 3)), "shape (1, 2, 3)"),
        ([[1.0], [1.0, 2.0]], "list ("),
        (None, "dtype object"),
        (np.array([1.0, 2.0], object), "dtype object"),
        (np.zeros(2, complex), "dtype complex128"),
        (np.zeros(2, np.longdouble), "dtype float128"),
        (np.zeros(2, "M8[s]"), "dtype datetime64[s]"),
        (["0.1", "0.2"], "dtype <U3"),
        (b"ab", "dtype |S2"),
        ({"joint1.x": 0.0}, "dtype object"),
        (np.zeros(2, [("x", float)]), "dtype [('x', '<f8')]"),
        (np.ma.array([1.0, 2.0], mask=[False, True]), "a masked array"),
    ],
    ids=str,
)
def test_what_is_no_vector_is_refused(value: Any, got: str, kernel: eomgen.Kernel) -> None:
    """With the argument's name, the expected shape and dtype, and what came."""
    if "float128" in got and np.dtype(np.longdouble) == np.float64:
        pytest.skip("long double is double here")
    for call in (lambda: kernel.mass_matrix(value), lambda: kernel.frame_pose(value, "tcp")):
        message = refusal(call)
        assert message.startswith(f"q: {VECTOR}, got {got}")
    assert refusal(lambda: kernel.inverse_dynamics(Q, V, value)).startswith(f"a: {VECTOR}, got {got}")


def test_columns_of_a_table_are_vectors(kernel: eomgen.Kernel) -> None:
    """Series of pandas have a method ``mask`` and are no masked arrays."""
    pandas = pytest.importorskip("pandas")
    column = pandas.DataFrame({"q": Q})["q"]
    assert np.array_equal(kernel.mass_matrix(column), kernel.mass_matrix(Q))
    assert np.array_equal(numbers_in("q", column, "numbers"), Q)
    with pytest.raises(ArrayError, match=r"^q: .*; allowed: numbers$"):
        numbers_in("q", np.ma.array(Q), "numbers")


@pytest.mark.parametrize(
    "value",
    [
        [1, 2],
        (1.0, 2.0),
        np.array([1, 2]),
        np.array([1, 2], np.uint8),
        np.array([1, 2], np.float16),
        np.array([1, 2], np.float32),
        np.array([1.0, 2.0], ">f8"),
        np.array([1.0, 0.0, 2.0])[::2],
        np.array([2.0, 1.0])[::-1],
        memoryview(np.array([1.0, 2.0])),
        np.array([1.0, 2.0]).view(type("Other", (np.ndarray,), {})),
    ],
    ids=lambda value: f"{type(value).__name__}_{getattr(value, 'dtype', '')}",
)
def test_what_converts_exactly_is_converted(value: Any, kernel: eomgen.Kernel) -> None:
    expected = kernel.mass_matrix(np.array([1.0, 2.0]))
    found = kernel.mass_matrix(value)
    assert np.array_equal(found, expected)
    assert type(found) is np.ndarray
    assert found.dtype == np.float64


def test_unaligned_memory_is_copied(kernel: eomgen.Kernel) -> None:
    raw = np.zeros(17, np.uint8)
    unaligned = raw[1:].view(np.float64)
    unaligned[:] = Q
    assert not unaligned.flags.aligned
    assert np.array_equal(kernel.mass_matrix(unaligned), kernel.mass_matrix(Q))


def test_layout_of_a_batch_does_not_matter(kernel: eomgen.Kernel) -> None:
    q = np.random.default_rng(0).uniform(-1, 1, (5, 2))
    expected = kernel.mass_matrix(q)
    padded = np.zeros((5, 4))
    padded[:, 1:3] = q
    for same in (np.asfortranarray(q), padded[:, 1:3], q.tolist()):
        assert np.array_equal(kernel.mass_matrix(same), expected)
    readonly = q.copy()
    readonly.flags.writeable = False
    assert np.array_equal(kernel.mass_matrix(readonly), expected)


def test_single_precision_kernels_take_what_they_can_hold(single: eomgen.Kernel) -> None:
    expected = single.mass_matrix(np.array([1.0, 2.0], np.float32))
    for value in ([1, 2], [1.0, 2.0], np.array([1, 2], np.int16), np.array([1, 2], np.float16)):
        assert np.array_equal(single.mass_matrix(value), expected)
    for wide in (np.zeros(2), np.zeros(2, np.int64)):
        message = refusal(lambda wide=wide: single.mass_matrix(wide))
        assert f"got dtype {wide.dtype}, which float32 cannot hold exactly" in message
    assert refusal(lambda: single.mass_matrix([1e300, 0.0])) == "q: joint1.x is inf; numbers must be finite"


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_named_by_coordinate(bad: float, kernel: eomgen.Kernel) -> None:
    message = refusal(lambda: kernel.inverse_dynamics(Q, [0.0, bad], V))
    assert message == f"v: joint1.gamma is {bad}; numbers must be finite"
    batch = np.zeros((4, 2))
    batch[2, 0] = bad
    assert refusal(lambda: kernel.mass_matrix(batch)) == f"q: joint1.x in state 2 is {bad}; numbers must be finite"
    wrench = np.zeros((1, 6))
    wrench[0, 4] = bad
    message = refusal(lambda: kernel.residual(Q, V, V, V, wrench=wrench))
    assert message == f"wrench: moment.y of link link1 is {bad}; numbers must be finite"


def test_batches_of_different_length(kernel: eomgen.Kernel) -> None:
    assert (
        refusal(lambda: kernel.bias_force(np.zeros((3, 2)), np.zeros((4, 2)))) == "v: 4 states, but 3 in other arrays"
    )
    wrench, u = np.zeros((4, 1, 6)), np.zeros((3, 2))
    for name, arguments in (
        ("inverse_dynamics", (Q, V, u)),
        ("forward_dynamics", (Q, V, u)),
        ("residual", (Q, V, V, u)),
    ):
        assert "4" in refusal(lambda name=name, arguments=arguments: getattr(kernel, name)(*arguments, wrench=wrench))


def test_an_empty_batch_gives_an_empty_batch(kernel: eomgen.Kernel) -> None:
    none = np.zeros((0, 2))
    assert kernel.mass_matrix(none).shape == (0, 2, 2)
    assert kernel.forward_dynamics(none, none, Q).shape == (0, 2)
    assert kernel.christoffel(none).shape == (0, 2, 2, 2)
    assert kernel.frame_jacobian(none, "tcp").shape == (0, 6, 2)
    assert kernel.residual(none, V, V, V, wrench=np.zeros((1, 6))).shape == (0, 2)


@pytest.mark.parametrize("shape", [(6,), (2, 6), (1, 3), (3, 6), (1, 1, 2, 6)])
def test_wrenches_of_the_wrong_shape(shape: tuple[int, ...], kernel: eomgen.Kernel) -> None:
    for name, arguments in (("generalized_force", (Q, V)), ("external_force", (Q,)), ("forward_dynamics", (Q, V, V))):
        message = refusal(
            lambda name=name, arguments=arguments: getattr(kernel, name)(*arguments, wrench=np.zeros(shape))
        )
        assert message == f"wrench: expected float64 of shape (1, 6) or (..., 1, 6), got shape {shape}"


@pytest.mark.parametrize("name", ["generalized_force", "inverse_dynamics", "residual", "forward_dynamics"])
def test_wrenches_in_batches(name: str, kernel: eomgen.Kernel) -> None:
    """Any mixture of single states and batches, with and without ``out``."""
    rng = np.random.default_rng(1)
    count = {"generalized_force": 2, "inverse_dynamics": 3, "residual": 4, "forward_dynamics": 3}[name]
    arrays, wrench = rng.uniform(-1, 1, (count, STATES, 2)), rng.uniform(-1, 1, (STATES, 1, 6))
    call = getattr(kernel, name)
    expected = [call(*arrays[:, i], wrench=wrench[i]) for i in range(STATES)]
    out = np.empty((STATES, 2))
    assert call(*arrays, wrench=wrench, out=out) is out
    assert np.allclose(out, expected, rtol=1e-13)
    one_state = call(*arrays[:, 1], wrench=wrench, out=out)
    assert one_state is out
    assert np.allclose(out, [call(*arrays[:, 1], wrench=w) for w in wrench], rtol=1e-13)
    expected = [call(*arrays[:, i], wrench=wrench[1]) for i in range(STATES)]
    assert np.allclose(call(*arrays, wrench=wrench[1]), expected, rtol=1e-13)


def test_out_is_written_and_returned(kernel: eomgen.Kernel) -> None:
    out = np.full((2, 2), np.nan)
    assert kernel.mass_matrix(Q, out=out) is out
    assert np.array_equal(out, kernel.mass_matrix(Q))
    tensor = np.full((STATES, 2, 2, 2), np.nan)
    q = np.tile(Q, (STATES, 1))
    assert kernel.christoffel(q, out=tensor) is tensor
    assert np.array_equal(tensor, kernel.christoffel(q))


def test_out_that_cannot_be_written_to(kernel: eomgen.Kernel) -> None:
    readonly = np.zeros((2, 2))
    readonly.flags.writeable = False
    for out, message in (
        ([[0.0, 0.0], [0.0, 0.0]], "out: expected a NumPy array, got list"),
        (np.zeros((2, 3)), "out: expected float64 of shape (2, 2), got float64 of shape (2, 3)"),
        (np.zeros(2), "out: expected float64 of shape (2, 2), got float64 of shape (2,)"),
        (np.zeros((1, 2, 2)), "out: expected float64 of shape (2, 2), got float64 of shape (1, 2, 2)"),
        (np.zeros((2, 2), np.float32), "out: expected float64 of shape (2, 2), got float32 of shape (2, 2)"),
        (np.zeros((2, 2), order="F"), "out: expected a C-contiguous array that can be written, got one that is not"),
        (np.zeros((2, 4))[:, ::2], "out: expected a C-contiguous array that can be written, got one that is not"),
        (readonly, "out: expected a C-contiguous array that can be written, got one that is not"),
    ):
        assert refusal(lambda out=out: kernel.mass_matrix(Q, out=out)) == message
    block = np.zeros((3, 2))
    for out in (block[0], block[1], block.reshape(-1)[1:3]):
        message = refusal(lambda out=out: kernel.bias_force(block[0], block[1], out=out))
        assert message == "out: overlaps an argument; give it separate memory"
    assert kernel.bias_force(block[0], block[1], out=block[2]).base is block


def test_nothing_is_written_when_an_argument_is_refused(kernel: eomgen.Kernel) -> None:
    out = np.full((2, 2), 7.0)
    refusal(lambda: kernel.mass_matrix([0.0, np.nan], out=out))
    assert (out == 7.0).all()


def test_arguments_are_not_changed(kernel: eomgen.Kernel) -> None:
    q, v, u = Q.copy(), V.copy(), V.copy()
    kernel.forward_dynamics(q, v, u, wrench=np.ones((1, 6)))
    kernel.residual(q, v, v, u, wrench=np.ones((1, 6)))
    assert np.array_equal(q, Q)
    assert np.array_equal(v, V)
    assert np.array_equal(u, V)


def test_unknown_frames_and_kernels(kernel: eomgen.Kernel, built: Build) -> None:
    assert kernel.frames == ("tcp", "base", "link1")
    for call in (kernel.frame_pose, kernel.frame_jacobian):
        assert (
            refusal(lambda call=call: call(Q, "tpc"), UnknownNameError)
            == "frame: 'tpc' is unknown; did you mean 'tcp'?"
        )
        assert "known: tcp, base, link1" in refusal(lambda call=call: call(Q, 3), UnknownNameError)
    small = built(eomgen.load_robot("one_link"), "mass_matrix")
    message = refusal(lambda: small.bias_force(Q, V), UnknownNameError)
    assert message == "one_link was built without the kernel bias_force; built: mass_matrix"
    assert "frame_pose" in refusal(lambda: small.frame_pose(Q, "tcp"), UnknownNameError)


def test_unknown_options() -> None:
    robot = eomgen.load_robot("one_link")
    message = refusal(lambda: eomgen.build(robot, kernels=("mass_matrx",)), InputError)
    assert message.startswith("kernels: 'mass_matrx' is unknown; allowed: mass_matrix, ")
    message = refusal(lambda: eomgen.build(robot, dtype="float16"), InputError)
    assert message == "dtype: 'float16' is unknown; allowed: float64, float32"
