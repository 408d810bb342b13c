"""Functions of JAX on devices: XLA's own handlers on the processor, whose memory is that of the stub's device."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.adapters import jax_devices
from eomgen.adapters.jax import function
from eomgen.device import xla
from eomgen.errors import ArrayError, InputError
from tests.device.fakes import COUNT, Stub
from tests.device.fakes import states as drawn_states
from tests.support.optional import needs
from tests.support.refusals import refused

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("doubles")]

jax, jnp = needs("jax"), needs("jax.numpy")

states = partial(drawn_states, scale=1e-2)
REFUSED = (ValueError, jax.errors.JaxRuntimeError)  # by whether a function is compiled


@pytest.fixture
def on_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    """XLA's platform cpu, which has no streams, takes the handler of devices."""
    monkeypatch.setattr(xla, "FLAGS", ("-DEOM_NO_STREAM",))
    monkeypatch.setattr(jax_devices, "HANDLERS", {"cpu": "eomgen_launch"})
    monkeypatch.setattr(jax_devices, "TARGET", "eomgen_stub")


@pytest.mark.usefixtures("on_processor")
def test_values_and_gradients_have_the_bits_of_the_kernel(kernel: eomgen.Kernel, device: Any, stub: Stub) -> None:
    made, (q, v, a) = function(device, "inverse_dynamics"), states(kernel, 3)
    expected, launches = kernel.inverse_dynamics(q, v, a), stub.count("launches")
    assert np.array_equal(made(q, v, a), expected)
    assert stub.count("launches") > launches
    assert np.array_equal(jax.jit(made)(q, v, a), expected)
    assert np.array_equal(jax.jit(jax.vmap(made))(q, v, a), expected)
    weights = np.linspace(-1.0, 1.0, q.size).reshape(q.shape)
    wanted = kernel.vjp("inverse_dynamics", (q, v, a), weights)
    for found, block in zip(
        jax.jit(jax.grad(lambda *x: jnp.sum(weights * made(*x)), (0, 1, 2)))(q, v, a), wanted, strict=True
    ):
        assert np.array_equal(found, block)
    assert stub.count("contexts") == 0


@pytest.mark.usefixtures("on_processor")
def test_batches_are_one_call(kernel: eomgen.Kernel, device: Any, stub: Stub) -> None:
    """Under vmap once or twice, by broadcasting, and inside a scan."""
    made, (q, v, a) = function(device, "inverse_dynamics"), states(kernel, 3)
    nested = jax.vmap(jax.vmap(made, (None, 0, None)), (0, None, None))
    launches = stub.count("launches")
    found = nested(q[:3], v, a[0])
    once = stub.count("launches") - launches
    assert np.array_equal(found[2], kernel.inverse_dynamics(np.tile(q[2], (COUNT, 1)), v, np.tile(a[0], (COUNT, 1))))
    launches = stub.count("launches")
    assert np.array_equal(made(q[:3, None], v, a[0]), found)
    assert stub.count("launches") - launches == once
    assert made(q[:0], v[:0], a[:0]).shape == (0, kernel.n)
    rows = jax.lax.scan(lambda x, _: (x + made(x, v[0], a[0]) * 1e-9, x), jnp.asarray(q[0]), None, 3)[1]
    assert np.allclose(rows[1] - rows[0], kernel.inverse_dynamics(q[0], v[0], a[0]) * 1e-9, atol=1e-17)
    slopes = jax.vmap(jax.jacrev(made, 2))(q, v, a)
    assert np.allclose(slopes, kernel.mass_matrix(q), rtol=1e-12, atol=1e-14)


@pytest.mark.soak
@pytest.mark.usefixtures("on_processor")
def test_second_derivatives(kernel: eomgen.Kernel, device: Any) -> None:
    """Reverse over reverse, against differences of the gradient."""
    made, (q,) = function(device, "mass_matrix"), states(kernel, 1, 1)
    weights = np.random.default_rng(1).uniform(-1.0, 1.0, (kernel.n, kernel.n))
    slope = jax.grad(lambda x: jnp.sum(weights * made(x)) ** 2)
    second = jax.jit(jax.jacrev(slope))(q[0])
    units = 1e-6 * np.eye(kernel.n)
    expected = np.stack([(slope(q[0] + unit) - slope(q[0] - unit)) / 2e-6 for unit in units], axis=-1)
    assert np.allclose(second, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@pytest.mark.usefixtures("on_processor")
def test_parameters_are_those_of_then(kernel: eomgen.Kernel, stub: Stub) -> None:
    own = kernel.replaced()
    device, (q, v, a) = own.device("cuda"), states(own, 3)
    before = function(device, "inverse_dynamics")
    expected = before(q, v, a)
    own.parameters["gravity.y"] = -1.6
    assert np.array_equal(before(q, v, a), own.inverse_dynamics(q, v, a))
    assert not np.array_equal(before(q, v, a), expected)


@pytest.mark.usefixtures("on_processor")
def test_states_that_fail_are_named(kernel: eomgen.Kernel, device: Any, stub: Stub) -> None:
    q, v, a = states(kernel, 3)
    made, bad = function(device, "inverse_dynamics"), v.copy()
    bad[35, 1] = np.nan
    for arrays, said in (
        ((q, bad, a), "inverse_dynamics: v in state 35 is not finite; numbers must be finite"),
        (
            (q + 2e6 * (np.arange(COUNT)[:, None] == 33), v, a),
            r"inverse_dynamics in state 33: an angle is farther than 1e\+06",
        ),
        (
            (q, np.full_like(v, 1e200), a),
            "inverse_dynamics: the result of state 0 is not finite, out of numbers that are",
        ),
    ):
        with pytest.raises(REFUSED, match=said):
            jax.block_until_ready(jax.jit(made)(*arrays))
    quiet = kernel.replaced(checks=False).device("cuda")
    assert not np.isfinite(function(quiet, "inverse_dynamics")(q, bad, a)).all()
    far = jnp.asarray(q[:1])
    stub.library.stub_elsewhere(xla.ctypes.c_void_p(far.unsafe_buffer_pointer()))
    with pytest.raises(REFUSED, match=r"mass_matrix: q lies on another device; allowed: arrays on cuda:0"):
        jax.block_until_ready(function(device, "mass_matrix")(far))
    stub.library.stub_forget_elsewhere()  # addresses are used again
    assert stub.count("contexts") == 0


@pytest.mark.usefixtures("on_processor")
def test_calls_of_nobodys_functions_are_refused(device: Any) -> None:
    """As of an executable that another process compiled, or of a call with other arrays."""
    library = jax_devices._registered(jax, jax_devices.TARGET)
    number, _ = xla.plan_number(library, device, "mass_matrix")
    shapes = tuple(jax.ShapeDtypeStruct(*x) for x in (((3, 2, 2), np.float64), ((4096,), np.uint8)))
    q = jnp.zeros((3, 2))
    for plan, arrays, said in (
        (number + 1, (q,), "a compiled function of another process"),
        (number, (q, q), "a call that is none of its functions"),
        (number, (q[:, :1],), "q has 3 numbers; allowed: 6 of float64 for 3 states"),
        (number, (q.astype(jnp.float32),), "q has 6 numbers; allowed: 6 of float64"),
        (number, (jnp.zeros((90, 2)),), "out has 12 numbers; allowed: 360 of float64 for 90 states"),
    ):
        with pytest.raises(REFUSED, match=said):
            jax.block_until_ready(jax.ffi.ffi_call("eomgen_stub", shapes)(*arrays, plan=np.int64(plan)))


@pytest.mark.usefixtures("on_processor")
def test_nothing_is_left_of_calls_under_jit(kernel: eomgen.Kernel, device: Any, stub: Stub) -> None:
    made, (q,) = jax.jit(function(device, "mass_matrix")), states(kernel, 1)
    jax.block_until_ready(made(q))
    live = ("memory", "events", "modules", "contexts")
    before = [stub.count(what) for what in live]
    for _ in range(200):
        jax.block_until_ready(made(q))
    assert [stub.count(what) for what in live] == before


@pytest.mark.soak
@pytest.mark.usefixtures("on_processor")
@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("robot", ["ur5", "worn_arm"])
def test_arms_have_the_gradients_of_their_kernels(robot: str, dtype: str, built: Any, stub: Stub) -> None:
    kernel = built(robot, "forward_dynamics", "forward_dynamics_adjoint", dtype=dtype)
    made, arrays = function(kernel.device("cuda"), "forward_dynamics"), states(kernel, 3, scale=0.5)
    value, pull = jax.vjp(made, *arrays)
    assert np.array_equal(value, kernel.forward_dynamics(*arrays))
    wanted = kernel.vjp("forward_dynamics", tuple(arrays), np.ones_like(arrays[0]))
    for found, block in zip(pull(jnp.ones_like(value)), wanted, strict=True):
        assert np.array_equal(found, block)


def test_what_is_refused(kernel: eomgen.Kernel, device: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the handlers that XLA has outside tests, too: on the processor they launch nothing."""
    made, q = function(device, "mass_matrix"), jnp.zeros((3, kernel.n))
    with pytest.raises(REFUSED, match="mass_matrix: arrays lie on the processor; allowed: arrays on cuda:0"):
        jax.block_until_ready(made(q))
    for wrong, said in (
        (q.astype(jnp.float32), "q: dtype float32; allowed: float64"),
        (q[:, :1], r"q: shape \(3, 1\); allowed: \(2,\) or \(\.\.\., 2\)"),
        ("three", "q: 'three'; allowed: an array of numbers"),
    ):
        refused(ArrayError, said, made, wrong)
    with pytest.raises(ArrayError, match=r"v: leading axes \(2,\) beside \(3,\); allowed: those of broadcasting"):
        function(device, "inverse_dynamics")(q, q[:2], q)
    refused(InputError, "mass_matrix: got 2 arrays; allowed: q", made, q, q)
    refused(InputError, "rk4_rollout: a rollout, which has no derivatives on devices", function, device, "rk4_rollout")
    jax.config.update("jax_enable_x64", False)
    refused(InputError, "kernel of float64, which JAX has switched off; allowed: jax", made, q)
    jax.config.update("jax_enable_x64", True)
    monkeypatch.delattr(jax, "ffi")
    refused(InputError, r"device: JAX .* has no jax\.ffi; allowed: 0\.5 or newer", function, device, "mass_matrix")
