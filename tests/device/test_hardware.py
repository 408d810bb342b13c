"""Kernels on a device of CUDA that is there; without one all of this is skipped.

The stub of the driver, which other tests have, cannot say what the driver itself answers, nor what code of NVRTC's
computes.
"""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.description import as_robot
from eomgen.device import nvrtc
from eomgen.device.cuda import Cuda
from eomgen.device.driver import Chosen, Driver
from eomgen.errors import ArrayError, InputError
from eomgen.optional import NotInstalledError
from tests.device.fakes import in_tiles
from tests.device.fakes import states as drawn_states
from tests.support.optional import needs
from tests.support.random_robots import random_robot
from tests.support.refusals import refused
from tests.support.simt_runs import Subject

pytestmark = pytest.mark.quick

NAMES = ("inverse_dynamics", "forward_dynamics", "mass_matrix")
BUILTIN = ("one_link", "four_bar", "worn_arm", "ur5", "panda", "shaken_arm", "geared_arm", "bennett", "flexible_arm")
RANDOM = 6
states = partial(drawn_states, count=1000, scale=1.0)


@pytest.fixture(scope="session", autouse=True)
def title() -> str:
    """The device's name."""
    try:
        return Cuda(0, False).title
    except (InputError, NotInstalledError) as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def kernel(built: Any) -> eomgen.Kernel:
    """An arm with what is differentiated."""
    products = ("inverse_dynamics_adjoint", "forward_dynamics_adjoint", "forward_dynamics_jacobian")
    return built("ur5", *NAMES, *products, "rollout", "kinematics")  # type: ignore[no-any-return]


@pytest.fixture(scope="module")
def device(kernel: eomgen.Kernel) -> Any:
    """Its methods there."""
    return kernel.device("cuda")


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("name", [*BUILTIN, *map(str, range(RANDOM))])
def test_all_kernels_have_the_bits_of_the_c(name: str, dtype: str, tmp_path: Path, unoptimised: None) -> None:
    """Numbers are random trees."""
    robot = random_robot(int(name), joints=(2, 4), tree=True, rods=False) if name.isdigit() else as_robot(name)
    answers = list(Subject(robot, dtype, tmp_path).answers(("cuda",)))
    assert [answer for answer in answers if not answer.is_right] == []


def test_rows_tiles_and_outputs(kernel: eomgen.Kernel, device: Any) -> None:
    q, v, a = states(kernel, count=1024)
    expected = kernel.inverse_dynamics(q, v, a)
    lying = [device.put(x) for x in (q, v, a)]
    out = device.put(np.zeros_like(q))
    assert device.inverse_dynamics(*lying, out=out) is out
    assert np.array_equal(device.get(out), expected)
    tiles = device.inverse_dynamics(*(device.put(in_tiles(x)) for x in (q, v, a)))
    assert np.array_equal(device.get(tiles), in_tiles(expected))
    made = device.rk4_rollout(*lying, step=1e-3, steps=20)
    ends = [x[:, -1] for x in kernel.rollout(q, v, a, dt=1e-3, steps=20, method="rk4")]
    assert all(np.array_equal(device.get(x), y) for x, y in zip(made, ends, strict=True))


def test_bound_calls(kernel: eomgen.Kernel, device: Any) -> None:
    torch, arrays = needs("torch", extra="torch"), states(kernel, count=1000)
    q, v, a = (torch.as_tensor(x, device="cuda") for x in arrays)
    call = device.bind("inverse_dynamics", q, v, a)
    for _ in range(3):
        q += 0.1
        made = call()
        assert np.array_equal(made.cpu(), kernel.inverse_dynamics(q.cpu().numpy(), *arrays[1:]))


def test_text_for_the_driver_has_the_same_bits(
    kernel: eomgen.Kernel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PTX of an older processor, as for one that is newer than NVRTC knows."""
    older = (nvrtc.PTX, "--gpu-architecture=compute_80")
    monkeypatch.setattr(nvrtc.Nvrtc, "_target", lambda self, chosen: older)
    device, arrays = kernel.device("cuda"), states(kernel)
    made = device.forward_dynamics(*map(device.put, arrays))
    assert np.array_equal(device.get(made), kernel.forward_dynamics(*arrays))


def test_contracted_products_are_close(kernel: eomgen.Kernel) -> None:
    device, arrays = kernel.device("cuda", contract=True), states(kernel)
    made = device.get(device.inverse_dynamics(*map(device.put, arrays)))
    expected = kernel.inverse_dynamics(*arrays)
    assert not np.array_equal(made, expected)
    assert np.allclose(made, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())


def test_states_that_fail_are_named(kernel: eomgen.Kernel, device: Any) -> None:
    q, v, a = states(kernel)
    bad, far = v.copy(), q.copy()
    bad[735, 1], far[833, 2] = np.nan, 2e6
    name = kernel.coordinates[1]
    with pytest.raises(ArrayError, match=f"^v: {name} in state 735 is nan; numbers must be finite"):
        device.inverse_dynamics(*map(device.put, (q, bad, a)))
    with pytest.raises(ArrayError, match=r"mass_matrix: an angle is farther than 1e\+06 rad; .* in state 833"):
        device.mass_matrix(device.put(far))
    with pytest.raises(ArrayError, match=r"inverse_dynamics: .* in state 0 is -?(inf|nan), out of numbers"):
        device.inverse_dynamics(*map(device.put, (q, np.full_like(v, 1e200), a)))
    refused(ArrayError, r"q: got numpy\.ndarray, which lies on the processor", device.mass_matrix, q)
    refused(InputError, "'cuda:99'; allowed: \"cuda:0", kernel.device, "cuda:99")


def free_memory() -> int:
    """Return the device's bytes that nobody has."""
    library, found = ctypes.CDLL("libcuda.so.1"), (ctypes.c_size_t(), ctypes.c_size_t())
    with Chosen(Driver(), 0).current():
        assert library.cuMemGetInfo_v2(ctypes.byref(found[0]), ctypes.byref(found[1])) == 0
    return found[0].value


def test_nothing_is_left_of_calls(kernel: eomgen.Kernel, device: Any) -> None:
    """Of 5,000 calls, whose results are forgotten; others may take some of the device's memory meanwhile."""
    (q,) = map(device.put, states(kernel, 1, count=100_000))
    device.mass_matrix(q)
    gc.collect()
    before = free_memory()
    for _ in range(5_000):
        device.mass_matrix(q)
    gc.collect()
    assert before - free_memory() < 2_000_000_000  # each result has 29 MB


def test_arrays_are_longer_than_4_gigabytes(kernel: eomgen.Kernel) -> None:
    """Offsets of more than 32 bits: 100 million states."""
    torch = needs("torch", extra="torch")
    if torch.cuda.mem_get_info()[0] < 60e9:
        pytest.skip("the device has less than 60 GB that nobody has")
    count = 100_000_001
    q, v, a = (torch.rand(count, kernel.n, dtype=torch.float64, device="cuda") for _ in range(3))
    made = kernel.device("cuda").inverse_dynamics(q, v, a)
    for part in (slice(0, 100), slice(count - 100, count), slice(89_478_400, 89_478_500)):
        expected = kernel.inverse_dynamics(*(x[part].cpu().numpy() for x in (q, v, a)))
        assert np.array_equal(made[part].cpu().numpy(), expected)
    v[count - 1, 5] = torch.nan
    refused(ArrayError, f"in state {count - 1} is nan", kernel.device("cuda").inverse_dynamics, q, v, a)


def test_arrays_of_cupy(kernel: eomgen.Kernel, device: Any) -> None:
    """On a stream of its own, whose work is waited for without a word."""
    cupy = needs("cupy", extra=None)
    arrays = states(kernel, count=100_000)
    with cupy.cuda.Stream(non_blocking=True):
        made = device.inverse_dynamics(*(cupy.asarray(x) * 1.0 for x in arrays))
        assert isinstance(made, cupy.ndarray)
        assert np.array_equal(cupy.asnumpy(made), kernel.inverse_dynamics(*arrays))
    refused(ArrayError, "q: strides", device.mass_matrix, cupy.asarray(arrays[0])[:, ::-1])


def test_arrays_of_numba(kernel: eomgen.Kernel, device: Any) -> None:
    numba = needs("numba.cuda", extra=None)
    (q,) = states(kernel, 1)
    made = device.mass_matrix(numba.to_device(q))
    assert np.array_equal(made.copy_to_host(), kernel.mass_matrix(q))


def test_tensors_of_pytorch(kernel: eomgen.Kernel, device: Any) -> None:
    """Values, gradients, streams, graphs of torch.compile, and tensors that lie elsewhere."""
    torch = needs("torch", extra="torch")
    from eomgen.adapters.torch import function

    arrays = states(kernel, count=50_000)
    made, stream = function(device, "forward_dynamics"), torch.cuda.Stream()
    with torch.cuda.stream(stream):
        tensors = [(torch.as_tensor(x, device="cuda") * 1.0).requires_grad_() for x in arrays]
        value = made(*tensors)
        slopes = torch.autograd.grad(value.sum(), tensors)
    stream.synchronize()
    assert np.array_equal(value.detach().cpu(), kernel.forward_dynamics(*arrays))
    wanted = kernel.vjp("forward_dynamics", tuple(arrays), np.ones_like(arrays[0]))
    for found, block in zip(slopes, wanted, strict=True):
        assert np.array_equal(found.cpu(), block)
    few = [x[:3].detach().requires_grad_() for x in tensors]
    assert torch.autograd.gradcheck(made, few, eps=1e-6, atol=1e-4, rtol=1e-5)
    refused(ArrayError, "lies on the processor", made, *(x.cpu() for x in few))
    compiled = torch.compile(lambda *x: (2.0 * made(*x)).sum(-1))
    assert torch.allclose(compiled(*tensors), (2.0 * made(*tensors)).sum(-1))  # whose sums are in another order


@pytest.fixture
def doubles() -> Iterator[Any]:
    """JAX in double precision, on the device."""
    jax = needs("jax")
    if jax.default_backend() != "gpu":
        pytest.skip("JAX is not one for CUDA")
    jax.config.update("jax_enable_x64", True)
    yield jax
    jax.config.update("jax_enable_x64", False)


def test_arrays_of_jax(kernel: eomgen.Kernel, device: Any, doubles: Any) -> None:
    """By methods, and by XLA's foreign functions on XLA's stream: jit, grad, vmap and scan."""
    from eomgen.adapters.jax import function

    jax, arrays = doubles, states(kernel, count=10_000)
    q, v, u = map(jax.numpy.asarray, arrays)
    expected = kernel.forward_dynamics(*arrays)
    found = device.forward_dynamics(q, v, u)
    assert isinstance(found, jax.Array)
    assert np.array_equal(found, expected)
    made = function(device, "forward_dynamics")
    assert np.array_equal(jax.jit(made)(q, v, u), expected)
    assert np.array_equal(jax.jit(jax.vmap(made))(q, v, u), expected)
    wanted = kernel.vjp("forward_dynamics", tuple(arrays), np.ones_like(arrays[0]))
    slopes = jax.jit(jax.grad(lambda *x: jax.numpy.sum(made(*x)), (0, 1, 2)))(q, v, u)
    for one, block in zip(slopes, wanted, strict=True):
        assert np.array_equal(one, block)
    ends = jax.jit(lambda q: jax.lax.scan(lambda x, _: (x + 1e-9 * made(x, v, u), None), q, None, 10)[0])(q)
    assert np.allclose((ends - q) / 1e-8, expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())
    with pytest.raises((ValueError, jax.errors.JaxRuntimeError), match="v in state 7 is not finite"):
        jax.block_until_ready(jax.jit(made)(q, v.at[7, 2].set(jax.numpy.nan), u))
