"""Array arguments of kernels: which are taken, converted, broadcast or refused, with a message that names them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import ArrayError, InputError, SingularError, UnknownNameError
from eomgen.runtime.arrays import numbers_in
from tests.support.builds import Build
from tests.support.methods import method_of
from tests.support.optional import needs
from tests.support.refusals import refused

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]
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
    caught = refused(error, "", call)
    assert isinstance(caught, InputError)
    return str(caught)


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
    pandas = needs("pandas")
    column = pandas.DataFrame({"q": Q})["q"]
    assert np.array_equal(kernel.mass_matrix(column), kernel.mass_matrix(Q))
    assert np.array_equal(numbers_in("q", column, "numbers"), Q)
    refused(ArrayError, r"^q: .*; allowed: numbers$", numbers_in, "q", np.ma.array(Q), "numbers")


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
        assert "4" in refusal(lambda name=name, arguments=arguments: method_of(kernel, name)(*arguments, wrench=wrench))


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
            lambda name=name, arguments=arguments: method_of(kernel, name)(*arguments, wrench=np.zeros(shape))
        )
        assert message == f"wrench: expected float64 of shape (1, 6) or (..., 1, 6), got shape {shape}"


@pytest.mark.parametrize("name", ["generalized_force", "inverse_dynamics", "residual", "forward_dynamics"])
def test_wrenches_in_batches(name: str, kernel: eomgen.Kernel) -> None:
    """Any mixture of single states and batches, with and without ``out``."""
    rng = np.random.default_rng(1)
    count = {"generalized_force": 2, "inverse_dynamics": 3, "residual": 4, "forward_dynamics": 3}[name]
    arrays, wrench = rng.uniform(-1, 1, (count, STATES, 2)), rng.uniform(-1, 1, (STATES, 1, 6))
    call = method_of(kernel, name)
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


ODD = 2**53 + 1
STIFFNESS = "joints.joint1.x.stiffness"


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
    kernel = kernel.replaced(checks=False)
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
    parameters = kernel.replaced().parameters
    name = next(iter(parameters))
    before = dict(parameters)
    with pytest.raises(InputError, match=rf"^parameters: {name} = .*{message}$"):
        parameters[name] = value
    assert dict(parameters) == before
    parameters[name] = np.float32(3)
    assert parameters[name] == 3.0


def test_a_parameter_beyond_single_precision(single: eomgen.Kernel) -> None:
    parameters = single.replaced().parameters
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
    refused(InputError, message, kernel.rollout, **how)


def test_single_precision_has_no_step_that_it_cannot_hold(single: eomgen.Kernel) -> None:
    for dt in (1e-300, 1e300):
        with pytest.raises(InputError, match=r"1\.18e-38, the least above 0 that float32 holds, to 1e\+30 is allowed"):
            single.rollout([0.0, 0.0], [0.0, 0.0], [0.0, 0.0], dt, 3)


FAST = np.array([0.3, 1e200])
END = r"and float64 ends at 1\.8e\+308"


@pytest.fixture
def own(kernel: eomgen.Kernel) -> eomgen.Kernel:
    return kernel.replaced()


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
    name: str, arrays: tuple[Any, ...], entry: str, coordinate: str, own: eomgen.Kernel
) -> None:
    """With the kernel, the entry, and the largest of the numbers that it came from."""
    largest = r"the largest is joint1\.gamma = 1e\+200 in v"
    caught = refused(
        ArrayError,
        f"^{name}: {entry}, out of numbers that are finite; {largest}, {END}$",
        method_of(own, name),
        *arrays,
    )
    assert caught.coordinate == coordinate
    own.checks = False
    assert not np.isfinite(method_of(own, name)(*arrays)).all()


def test_in_batches_the_state_is_named(own: eomgen.Kernel) -> None:
    """The largest number is that of the same state."""
    v = np.tile(V, (700, 1))
    v[431, 1], v[650, 0] = 1e200, 1e201
    for threads in (1, 2):
        own.threads = threads
        refused(ArrayError, r"^energy: \[0\] in state 431 is inf, .* joint1\.gamma = 1e\+200 in v", own.energy, Q, v)
    refused(ArrayError, r"^energy: \[0\] in state \(4, 31\) is inf,", own.energy, Q, v.reshape(7, 100, 2))
    with pytest.raises(ArrayError, match=r"^residual_jacobian: \[\d\] joint1\.x joint1\.\w+ in state 1 is"):
        own.residual_jacobian(Q, [V, FAST * 1e107], V)


def test_what_wrenches_add_is_looked_at(own: eomgen.Kernel) -> None:
    wrench = np.array([[1.7e308, 1.7e308, 0.0, 0.0, 0.0, 1.7e308]])
    for name, count in (("external_force", 1), ("generalized_force", 2), ("inverse_dynamics", 3)):
        arrays = (Q, V, V)[:count]
        with pytest.raises(ArrayError, match=r"external_force: joint1\.\w+ is (-?inf|nan).* = 1\.7e\+308 in wrench"):
            method_of(own, name)(*arrays, wrench=wrench)
    a = np.array([1.5e308, 0.0]) / own.mass_matrix(Q)[0, 0]
    push = np.array([[-1e308, 0.0, 0.0, 0.0, 0.0, 0.0]])
    with pytest.raises(ArrayError, match=r"^inverse_dynamics: joint1\.x is inf.* the largest is "):
        own.inverse_dynamics(Q, V, a, wrench=push)


def test_single_precision_ends_earlier(built: Build) -> None:
    single = built(eomgen.load_robot("one_link"), dtype="float32")
    with pytest.raises(ArrayError, match=r"in v, and float32 ends at 3\.4e\+38$"):
        single.energy(Q.astype(np.float32), np.array([0.0, 1e25], np.float32))


def test_a_singular_mass_matrix_is_still_named_as_such(built: Build) -> None:
    robot = eomgen.load_robot("one_link")
    point = replace(robot.links[0], mass=0.0, inertia=(0.0,) * 6)
    own = built(replace(robot, name="no_mass", links=(point,)), "forward_dynamics")
    refused(SingularError, r"joint1\.x", own.forward_dynamics, Q, V, V)


RNG = np.random.default_rng(7)
QS, VS, AS, US = RNG.uniform(-1, 1, (4, 2, 3, 2))  # (2, 3) states of two coordinates each
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


@pytest.mark.parametrize("name", CALLS)
def test_any_number_of_leading_axes(name: str, kernel: eomgen.Kernel) -> None:
    call, arrays = method_of(kernel, name), (QS, VS, AS, US)[: CALLS[name]]
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
    call, others = method_of(kernel, name), (QS, VS, AS, US)[1 : CALLS[name]]
    q = np.random.default_rng(1).uniform(-1, 1, shape)
    whole = np.broadcast_shapes(q.shape, QS.shape)
    expected = call(np.broadcast_to(q, whole).copy(), *others)
    assert expected.shape[: len(whole) - 1] == whole[:-1]
    assert np.array_equal(call(q, *others), expected)


def test_one_row_beside_many_stands_for_all(kernel: eomgen.Kernel) -> None:
    many, row = VS.reshape(6, 2), QS[:1, 0]
    assert row.shape == (1, 2)
    assert np.array_equal(kernel.bias_force(row, many), kernel.bias_force(row[0], many))
    assert kernel.bias_force(row, VS[0, 0]).shape == (1, 2)


@pytest.mark.parametrize("name", ["generalized_force", "inverse_dynamics", "residual", "forward_dynamics", "reactions"])
def test_wrenches_broadcast_too(name: str, kernel: eomgen.Kernel) -> None:
    call, arrays = method_of(kernel, name), (QS, VS, AS, US)[: CALLS[name]]
    each = [[call(*(x[i, k] for x in arrays), wrench=W[i, k]) for k in range(3)] for i in range(2)]
    assert np.allclose(call(*arrays, wrench=W), each, rtol=1e-13)
    same = [[call(*(x[i, k] for x in arrays), wrench=W[i, 0]) for k in range(3)] for i in range(2)]
    assert np.allclose(call(*arrays, wrench=W[:, :1]), same, rtol=1e-13)
    one = [[call(*(x[0, 0] for x in arrays), wrench=W[i, k]) for k in range(3)] for i in range(2)]
    assert np.allclose(call(*(x[0, 0] for x in arrays), wrench=W), one, rtol=1e-13)
    refused(ArrayError, r"leading axes|states, but", call, *arrays, wrench=np.zeros((4, 1, 6)))


def test_frames_blocks_and_derivatives(kernel: eomgen.Kernel) -> None:
    flat = QS.reshape(6, 2)
    assert np.array_equal(kernel.frame_pose(QS, "tcp").reshape(6, 4, 4), kernel.frame_pose(flat, "tcp"))
    assert kernel.frame_jacobian(QS, "tcp").shape == (2, 3, 6, 2)
    for block in kernel.residual_jacobian(QS, VS, AS):
        assert block.shape == (2, 3, 2, 2)
    assert kernel.residual_jacobian(QS[0, 0], VS[0, 0], AS)[0].shape == (2, 3, 2, 2)
    assert kernel.forward_dynamics_jacobian(QS, VS[0], US[0, 0])[2].shape == (2, 3, 2, 2)
    names = ("joint1", "joint1")
    assert np.array_equal(kernel.blocks(QS).mass[names].reshape(6, 2, 2), kernel.blocks(flat).mass[names])


def test_axes_that_do_not_go_together(kernel: eomgen.Kernel) -> None:
    with pytest.raises(ArrayError, match=r"^v: leading axes \(2,\) do not go together with \(2, 3\) of other arrays$"):
        kernel.bias_force(QS, np.zeros((2, 2)))
    refused(ArrayError, r"^v: 4 states, but 3 in other arrays$", kernel.bias_force, QS[0], np.zeros((4, 2)))
    with pytest.raises(ArrayError, match=r"^out: expected float64 of shape \(2, 3, 2, 2\), got"):
        kernel.mass_matrix(QS, out=np.zeros((6, 2, 2)))
    with pytest.raises(ArrayError, match=r"^q0: expected float64 of shape \(2\) or \(N, 2\), got shape \(2, 3, 2\)$"):
        kernel.rollout(QS, VS[0, 0], US[0, 0], 1e-3, 3)
    assert kernel.mass_matrix(np.zeros((0, 3, 2))).shape == (0, 3, 2, 2)
    assert kernel.bias_force(np.zeros((3, 0, 2)), VS[0, :1]).shape == (3, 0, 2)
