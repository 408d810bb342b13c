"""Methods of kernels on devices: the kernel's bits by a stub of the driver, and refusals by name."""

from __future__ import annotations

import ctypes
import gc
import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.simt.setup import setup_values
from eomgen.device import driver, nvrtc
from eomgen.device.dlpack import CPU, CUDA, lent_count
from eomgen.device.driver import Chosen, Driver
from eomgen.device.texts import text_of
from eomgen.errors import ArrayError, BuildError, InputError, LoopError, SingularError
from eomgen.optional import NotInstalledError
from tests.device.fakes import COUNT, TILE, Lent, Lying, Stub, in_tiles, states
from tests.export.test_simt import TOP
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

GOOD = np.zeros((3, 2))


def test_rows_tiles_and_outputs_have_the_bits_of_the_kernel(kernel: eomgen.Kernel, device: Any, stub: Stub) -> None:
    q, v, a = states(kernel)
    expected = kernel.inverse_dynamics(q, v, a)
    made = device.inverse_dynamics(Lying(q), v=Lent(v), a=Lying(a))
    assert np.array_equal(device.get(made), expected)
    assert made.shape == expected.shape
    out = np.zeros_like(expected)
    taken = Lying(out)
    assert device.inverse_dynamics(Lying(q), Lying(v), Lying(a), out=taken) is taken
    assert np.array_equal(out, expected)
    whole = [np.concatenate([x, x])[: 2 * TILE] for x in (q, v, a)]
    tiles = device.inverse_dynamics(*(Lying(in_tiles(x)) for x in whole))
    assert np.array_equal(device.get(tiles), in_tiles(kernel.inverse_dynamics(*whole)))
    matrices = device.mass_matrix(device.put(q))
    assert np.array_equal(device.get(matrices), kernel.mass_matrix(q))
    assert device.mass_matrix(Lying(q[:0])).shape == (0, kernel.n, kernel.n)
    assert stub.count("contexts") == 0


def test_bound_calls_compute_from_what_arrays_hold(kernel: eomgen.Kernel, device: Any, stub: Stub) -> None:
    q, v, a = states(kernel)
    out = np.zeros_like(q)
    call = device.bind("inverse_dynamics", Lying(q), Lying(v), a=Lying(a), out=Lying(out))
    launches = stub.count("launches")
    call()
    assert stub.count("launches") == launches + 3
    assert np.array_equal(out, kernel.inverse_dynamics(q, v, a))
    q[:], v[3, 0] = -q, np.nan
    device.mass_matrix(Lying(np.concatenate([q] * 50)))  # of more memory than the call has
    call()
    assert np.array_equal(out, kernel.replaced(checks=False).inverse_dynamics(q, v, a), equal_nan=True)
    tiles = [Lying(in_tiles(np.concatenate([x, x])[: 2 * TILE])) for x in (q, a, a)]
    made = device.bind("rk4_rollout", *tiles, step=1e-3, steps=4)()
    assert [device.get(x).shape for x in made] == [tiles[0].x.shape] * 2
    expected = device.rk4_rollout(*tiles, step=1e-3, steps=4)
    assert all(np.array_equal(device.get(x), device.get(y)) for x, y in zip(made, expected, strict=True))
    assert device.bind("mass_matrix", Lying(q[:0]))().shape == (0, kernel.n, kernel.n)
    with pytest.raises(ArrayError, match=r"v: 4 states in rows, but 37 in rows in q"):
        device.bind("inverse_dynamics", Lying(q), Lying(v[:4]), Lying(a))
    with pytest.raises(InputError, match="inverse_dynamics: w beside arrays; allowed: out and stream"):
        device.bind("inverse_dynamics", *map(Lying, (q, v, a)), w=1.0)
    Jax = type("Array", (Lying,), {"__module__": "jaxlib"})
    with pytest.raises(ArrayError, match="q: an array of JAX, whose numbers never change; allowed: others"):
        device.bind("mass_matrix", Jax(q))
    assert stub.count("contexts") == 0


def test_bound_calls_give_their_memory_back(kernel: eomgen.Kernel, device: Any, stub: Stub) -> None:
    (q,) = states(kernel, 1)
    device.mass_matrix(Lying(q))
    gc.collect()
    memory = stub.count("memory")
    call = device.bind("mass_matrix", Lying(q))
    assert stub.count("memory") == memory + 2  # the result, and what is between
    del call
    gc.collect()
    assert stub.count("memory") == memory


def test_rollouts_take_numbers_for_all_states(kernel: eomgen.Kernel, device: Any) -> None:
    q, v, u = map(Lying, states(kernel))
    made = device.rk4_rollout(q, v, u, step=1e-3, steps=4)
    expected = kernel.rollout(q.x, v.x, u.x, dt=1e-3, steps=4, method="rk4")
    assert np.array_equal(device.get(made[0]), expected[0][:, -1])
    assert np.array_equal(device.get(made[1]), expected[1][:, -1])
    for numbers, said in (
        ({"step": 1e-3}, "rk4_rollout: step beside arrays; allowed: step, steps"),
        ({"step": -1.0, "steps": 4}, r"step = -1\.0; allowed: a finite number from 0 on"),
        ({"step": 1e-3, "steps": 1.5}, "steps = 1.5; allowed: a whole number from 0 to 2147483647"),
    ):
        refused(InputError, said, device.rk4_rollout, q, v, u, **numbers)
    with pytest.raises(InputError, match="out: got Lying; allowed: a tuple of 2 arrays, q_out, v_out"):
        device.rk4_rollout(q, v, u, step=1e-3, steps=4, out=q)


def test_rollouts_have_controllers(kernel: eomgen.Kernel, device: Any) -> None:
    """As the kernel's rollout under the same gains, which are arrays of each state here."""
    (q, v, u), driven = states(kernel), list(kernel.raw.libraries.meta["driven"])
    gains = {"kp": 50.0, "kd": 2.0, "target": 0.1}
    arrays = {name: Lying(np.full((COUNT, len(driven)), value)) for name, value in gains.items()}
    made = device.rk4_pd_rollout(*map(Lying, (q, v, u)), **arrays, step=1e-3, steps=4)
    target = np.zeros(kernel.n)
    target[driven] = gains.pop("target")
    expected = kernel.rollout(q, v, u, dt=1e-3, steps=4, method="rk4", target=target, **gains)
    for one, other in zip(made, expected, strict=True):
        assert np.array_equal(device.get(one), other[:, -1])


def test_parameters_are_those_of_the_kernel_now(kernel: eomgen.Kernel, stub: Stub) -> None:
    own = kernel.replaced()
    device, arrays = own.device("cuda"), states(own)
    device.inverse_dynamics(*map(Lying, arrays))
    own.parameters["gravity.y"] = -1.6
    made = device.inverse_dynamics(*map(Lying, arrays))
    assert np.array_equal(device.get(made), own.inverse_dynamics(*arrays))
    assert not np.array_equal(device.get(made), kernel.inverse_dynamics(*arrays))


CASES: tuple[tuple[tuple[Any, ...], dict[str, Any], str], ...] = (
    ((Lying(GOOD), Lying(GOOD)), {}, "a missing; allowed: q, v, a"),
    ((Lying(GOOD),) * 4, {}, "4 arrays; allowed: q, v, a"),
    ((Lying(GOOD),) * 3, {"q": Lying(GOOD)}, "q twice; allowed: q, v, a"),
    ((Lying(GOOD),) * 3, {"w": 1.0}, "inverse_dynamics: w beside arrays; allowed: out and stream"),
    ((Lying(GOOD), Lying(np.zeros((3, 3))), Lying(GOOD)), {}, r"v: shape \(3, 3\); allowed: \(N, 2\), or in tiles"),
    ((Lying(GOOD), Lying(np.zeros((4, 2))), Lying(GOOD)), {}, "v: 4 states in rows, but 3 in rows in q"),
    ((Lying(np.zeros((1, 2, 32))), Lying(GOOD), Lying(GOOD)), {}, "v: 3 states in rows, but 32 in tiles in q"),
    ((Lying(GOOD.astype("f4")), Lying(GOOD), Lying(GOOD)), {}, "q: dtype float32; allowed: float64"),
    ((Lying(np.zeros((2, 3)).T), Lying(GOOD), Lying(GOOD)), {}, r"q: strides \(8, 24\) of shape \(3, 2\); allowed"),
    ((GOOD, Lying(GOOD), Lying(GOOD)), {}, "q: got numpy.ndarray, which lies on the processor; allowed"),
    ((3.0, Lying(GOOD), Lying(GOOD)), {}, r"q: got builtins\.float, which lies on the processor; allowed"),
    ((Lent(GOOD, (CPU, 0)), Lying(GOOD), Lying(GOOD)), {}, "q: .*Lent lies on the processor"),
    ((Lent(GOOD, (CUDA, 1)), Lying(GOOD), Lying(GOOD)), {}, "q: the array lies on cuda:1; allowed: cuda:0"),
    ((Lent(GOOD.astype("i4")),) * 3, {}, "q: dtype float32|q: dtype"),
    ((Lying(GOOD),) * 3, {"out": Lying(np.ones((3, 2)), readonly=True)}, "out: the array may not be written"),
    ((Lying(GOOD),) * 3, {"out": Lying(np.ones((2, 2)))}, r"out: shape \(2, 2\); allowed: \(3, 2\)"),
    ((Lying(GOOD),) * 3, {"out": Lying(GOOD)}, "out: shares memory with q; allowed: memory of its own"),
    ((Lying(GOOD),) * 3, {"stream": "fast"}, "stream: 'fast'; allowed: a stream of CuPy, PyTorch or Numba"),
    ((Lying(GOOD),) * 3, {"stream": True}, "stream: true; allowed: a stream"),
)


@pytest.mark.parametrize(("arrays", "others", "said"), CASES)
def test_wrong_arrays_are_refused_by_name(
    device: Any, stub: Stub, arrays: tuple[Any, ...], others: dict[str, Any], said: str
) -> None:
    launches = stub.count("launches")
    refused(InputError, said, device.inverse_dynamics, *arrays, **others)
    assert (stub.count("launches"), stub.count("contexts")) == (launches, 0)


def test_arrays_of_another_device_are_refused(device: Any, stub: Stub) -> None:
    far = np.zeros((3, 2))
    stub.put_elsewhere(far)
    refused(ArrayError, "q: the array lies on cuda:1; allowed: cuda:0", device.mass_matrix, Lying(far))
    stub.library.stub_forget_elsewhere()  # addresses are used again


def test_states_that_fail_are_named(kernel: eomgen.Kernel, device: Any) -> None:
    q, v, a = states(kernel)
    bad = v.copy()
    bad[35, 1] = np.nan
    name = kernel.coordinates[1]
    with pytest.raises(ArrayError, match=f"^v: {name} in state 35 is nan; numbers must be finite") as caught:
        device.inverse_dynamics(Lying(q), Lying(bad), Lying(a))
    assert caught.value.coordinate == name
    far = q.copy()
    far[33] = 2e6
    with pytest.raises(ArrayError, match=r"mass_matrix: an angle is farther than 1e\+06 rad; .* in state 33"):
        device.mass_matrix(Lying(far))
    large = np.full_like(v, 1e200)
    with pytest.raises(ArrayError, match=r"inverse_dynamics: .* in state 0 is -?(inf|nan), out of numbers that are fi"):
        device.inverse_dynamics(Lying(q), Lying(large), Lying(a))
    quiet = kernel.replaced(checks=False).device("cuda")
    assert not np.isfinite(quiet.get(quiet.inverse_dynamics(Lying(q), Lying(bad), Lying(a)))).all()


class Refusing(Lying):
    """An array of a library that says why it lends nothing."""

    error: Exception = RuntimeError("it asks for gradients")

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        raise self.error


class NotLent(Lent):
    """An array of a library whose DLPack is refused."""

    def __dlpack__(self, stream: Any = None) -> Any:
        raise BufferError("it is read-only")


def test_what_other_libraries_refuse_is_passed_on(device: Any) -> None:
    """By the array's name, with the library's error as the cause; other errors stay as they are."""
    with pytest.raises(ArrayError, match=r"^q: it asks for gradients$") as caught:
        device.mass_matrix(Refusing(GOOD))
    assert caught.value.__cause__ is Refusing.error
    with pytest.raises(ArrayError, match=r"^q: .*NotLent gives no DLPack: it is read-only$") as caught:
        device.mass_matrix(NotLent(GOOD))
    assert isinstance(caught.value.__cause__, BufferError)
    broken = Refusing(GOOD)
    broken.error = ZeroDivisionError()
    with pytest.raises(ZeroDivisionError):
        device.mass_matrix(broken)


def test_streams_wait_for_those_that_arrays_are_made_on(kernel: eomgen.Kernel, device: Any, stub: Stub) -> None:
    (q,) = states(kernel, 1)
    device.mass_matrix(Lying(q))
    before = stub.count("waits")
    device.mass_matrix(Lying(q, stream=1))  # the default one, which it works on
    assert stub.count("waits") == before
    device.mass_matrix(Lying(q, stream=5))
    assert stub.count("waits") == before + 1
    lent = Lent(q)
    device.mass_matrix(lent, stream=SimpleNamespace(cuda_stream=9))
    assert lent.streams == [9]
    assert stub.count("waits") > before + 1
    assert stub.count("events") <= 2  # of this object's memory, and of another one


def test_results_are_of_the_library_of_the_first_array(
    kernel: eomgen.Kernel, device: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A library that gives memory is asked for it, and for its stream."""

    class Array(Lying):
        """An array of a library of that name."""

    Array.__module__ = "torch"
    current = SimpleNamespace(is_initialized=lambda: True, current_stream=lambda number: SimpleNamespace(cuda_stream=3))
    made = SimpleNamespace(
        cuda=current, float64="float64", empty=lambda shape, dtype, device: Array(np.empty(shape, dtype))
    )
    monkeypatch.setitem(sys.modules, "torch", made)
    (q,) = states(kernel, 1)
    result = device.mass_matrix(Array(q))
    assert type(result) is Array
    assert np.array_equal(result.x, kernel.mass_matrix(q))


def test_results_are_lent_by_dlpack_and_given_back(device: Any, stub: Stub) -> None:
    memory, lent = stub.count("memory"), lent_count()
    array = device.put(GOOD)
    capsule = array.__dlpack__()
    del array
    assert (stub.count("memory"), lent_count()) == (memory + 1, lent + 1)
    del capsule
    assert (stub.count("memory"), lent_count()) == (memory, lent)


def test_methods_are_the_straight_functions(device: Any) -> None:
    assert {"inverse_dynamics", "forward_dynamics", "rk4_rollout", "frame_poses"} <= set(dir(device))
    assert not {"frame_pose", "integrate", "time_constants"} & set(device.functions)
    with pytest.raises(AttributeError, match=r"device: 'inverse_dynamic' is no method on devices.*inverse_dynamics"):
        device.inverse_dynamic(1)
    with pytest.raises(AttributeError, match="device: 'frame_pose' is no method on devices; did you mean 'frame_po"):
        device.frame_pose(1)
    with pytest.raises(InputError, match="kernels: 'rollout' is no straight-line program, or steps whose number is no"):
        device.rollout(1)
    assert repr(device) == "<one_link on cuda:0, stub 0, float64>"
    refused(InputError, "x: 'three'; allowed: an array of numbers", device.put, "three")


def test_devices_are_refused_by_name(kernel: eomgen.Kernel, stub: Stub, monkeypatch: pytest.MonkeyPatch) -> None:
    for where in ("metal", "cuda:", "cuda:-1", "cuda:x", 3, None):
        refused(InputError, r'device: .*; allowed: "cuda", with a number such as "cuda:1"$', kernel.device, where)
    for where in ("hip", "hip:1", "opencl"):
        refused(InputError, r"; eomgen\.export_simt writes source code for HIP and OpenCL$", kernel.device, where)
    refused(InputError, 'device: \'cuda:2\'; allowed: "cuda:0" to "cuda:1"', kernel.device, "cuda:2")
    refused(InputError, "contract: 1; allowed: True or False", kernel.device, "cuda", contract=1)
    monkeypatch.setattr(nvrtc, "SYSTEM", ("libnone.so",))
    refused(NotInstalledError, r'NVRTC.*not installed .*: pip install "eomgen\[cuda\]"', kernel.device, "cuda")
    monkeypatch.setattr(driver, "LIBRARIES", ("libnone.so",))
    refused(InputError, "device: no driver of CUDA here .*; allowed: a machine with one", kernel.device, "cuda")
    assert stub.count("contexts") == 0


def test_devices_take_their_own_arrays(kernel: eomgen.Kernel, device: Any) -> None:
    """Sums of products are contracted where they are asked to be, as they change the bits."""
    array = device.put(GOOD)
    with device.cuda.session(None, (array,)) as stream:
        view = device.cuda.view("q", array, kernel.dtype, stream)
    assert (view.place, view.shape) == (array.address, GOOD.shape)
    assert device.cuda.contract is False
    assert kernel.device("cuda", contract=True).cuda.contract is True


def test_images_are_cubins_or_for_newer_processors_texts(stub: Stub, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler, chosen = nvrtc.Nvrtc(), Chosen(Driver(), 0)
    try:
        for processor, target in ((90, b"sm_90"), (89, b"compute_80"), (120, b"compute_100")):
            stub.library.stub_processor(processor)
            image = compiler.image("int nothing;", chosen, False)
            assert target in image
            assert image.endswith(b".so\0")  # drivers read texts up to their NUL
        known = stub.compiler.stub_compiled()
        compiler.image("int nothing;", chosen, False)  # from the cache
        assert stub.compiler.stub_compiled() == known
        stub.library.stub_processor(70)
        with pytest.raises(InputError, match=r"stub 0 has compute capability 7, and NVRTC .* compiles for 8 and later"):
            compiler.image("int nothing;", chosen, False)
    finally:
        stub.library.stub_processor(90)
    with pytest.raises(BuildError, match=r"nvrtc --std=c\+\+17 .* --fmad=false .* failed: stub: line 7 is wrong"):
        compiler.image("cannot compile", chosen, False)


def test_little_memory_is_an_error_of_memory(device: Any, stub: Stub) -> None:
    try:
        stub.library.stub_most_bytes(16)
        refused(MemoryError, r"device: cuMemAlloc_v2: out of memory \(2\)", device.put, np.zeros((3, 2)))
    finally:
        stub.library.stub_most_bytes(-1)
    assert stub.count("contexts") == 0


def test_kernels_of_packages_have_no_devices(kernel: eomgen.Kernel) -> None:
    bare = eomgen.Kernel(kernel.raw.libraries)
    with pytest.raises(InputError, match=r"device: one_link is a kernel of a package, .*; allowed: kernels of eomgen"):
        bare.device("cuda")


@pytest.mark.soak
def test_nothing_is_left_of_calls(kernel: eomgen.Kernel, stub: Stub) -> None:
    """After 100,000 calls by either way of lending arrays, and refusals in between, nothing is alive but what was.

    Eight bytes that each call keeps are 720 kB of C's memory; Python's blocks are counted one by one.
    """
    live = ("memory", "events", "modules", "contexts")
    gc.collect()  # what other tests left
    before = [stub.count(what) for what in live], lent_count()
    device, (q,) = kernel.device("cuda"), states(kernel, 1, 2)
    wrong = np.full_like(q, np.inf)

    def run(device: Any, first: int, last: int) -> None:
        for number in range(first, last):
            device.mass_matrix(Lent(q) if number % 2 else Lying(q, stream=5), stream=number % 3)
            if number % 100 == 0:
                refused(ArrayError, "", device.mass_matrix, Lying(wrong))

    def kept() -> tuple[list[int], int, int]:
        gc.collect()
        return [stub.count(what) for what in live], sys.getallocatedblocks(), allocated()

    run(device, 0, 10_000)
    first, blocks, size = kept()
    run(device, 10_000, 100_000)
    last, more_blocks, larger = kept()
    assert last == first
    assert more_blocks < blocks + 500
    assert larger < size + 2**19
    del device
    assert ([stub.count(what) for what in live], lent_count()) == before


class Mallinfo(ctypes.Structure):
    """What glibc says of the memory that it manages, as of mallinfo2(3)."""

    _fields_ = tuple((f"field{i}", ctypes.c_size_t) for i in range(7)) + (
        ("used", ctypes.c_size_t),
        ("f8", ctypes.c_size_t),
        ("f9", ctypes.c_size_t),
    )


def allocated() -> int:
    """Bytes that C has allocated and not freed; 0 where its library does not say."""
    ask = getattr(ctypes.CDLL(None), "mallinfo2", None)
    if ask is None:
        return 0
    ask.restype = Mallinfo
    return int(ask().used)


@pytest.mark.soak
def test_singular_states_and_open_loops_are_named(built: Any, stub: Stub) -> None:
    from eomgen.description.load import robot_from_toml

    top = built(robot_from_toml(TOP), "mass_matrix").device("cuda")
    q = np.array([[0.0, 0.0, 0.0, 0.1, 0.2, 0.3], [0.0, 0.0, 0.0, 0.1, np.pi / 2, 0.3]])
    with pytest.raises(
        SingularError, match=r"forward_dynamics: the mass matrix cannot be inverted at joint1\.\w+ in s"
    ):
        top.forward_dynamics(*map(Lying, (q, np.zeros((2, 6)), np.zeros((2, 6)))))
    bars = built("four_bar", "forward_dynamics", "settling", "cut_poses")
    q, device = bars.assemble(np.array([[0.5, 0.2, 1.2], [0.6, 0.2, 1.2]])), bars.device("cuda")
    v, u = np.zeros(q.shape), np.linspace(0.0, 1.0, q.size).reshape(q.shape)
    made = device.forward_dynamics(*map(Lying, (q, v, u)))
    assert np.array_equal(device.get(made), bars.forward_dynamics(q, v, u))
    with pytest.raises(LoopError, match=r"forward_dynamics: loops are open in state 0 \(\w+\)"):
        device.forward_dynamics(*map(Lying, (q + 0.1, v, u)))


@pytest.mark.soak
@pytest.mark.parametrize("name", ["ur5", "worn_arm", "shaken_arm"])
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_robots_have_the_bits_of_their_kernels(built: Any, stub: Stub, name: str, dtype: str) -> None:
    kernel = built(name, "inverse_dynamics", "forward_dynamics", dtype=dtype)
    device = kernel.device("cuda:0")
    for function in ("inverse_dynamics", "forward_dynamics"):
        arrays = states(kernel)
        assert np.array_equal(
            device.get(getattr(device, function)(*map(Lying, arrays))), getattr(kernel, function)(*arrays)
        )


def test_setup_of_a_text_is_rounded_operation_by_operation(kernel: eomgen.Kernel) -> None:
    """The numbers of parameters alone are finite, and follow them."""
    meta, values = (
        text_of(eomgen.load_robot("one_link"), "inverse_dynamics", "float64").meta,
        kernel.parameters.values(),
    )
    one = setup_values(meta["setup"], list(values), kernel.dtype)
    other = setup_values(meta["setup"], [1.5 * x for x in values], kernel.dtype)
    assert one.tolist() == meta["h"]
    assert one.shape == other.shape == (len(meta["setup"]["h"]) or 1,)
    assert np.isfinite(one).all()
    assert not np.array_equal(one, other)
