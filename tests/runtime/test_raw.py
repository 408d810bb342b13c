"""The raw interface of kernels: pointers in, a status out, and addresses that C can call."""

from __future__ import annotations

import re
from collections.abc import Callable

import cffi
import numpy as np
import pytest

import eomgen
from eomgen.codegen.c.library import library_types
from eomgen.codegen.kernels import signatures
from eomgen.errors import ArrayError, InputError, LoopError, UnknownNameError
from eomgen.export.wasm.layout import layouts, of_c
from eomgen.kernel import Kernel
from eomgen.kernel.stepping.input_signals import DriveData, Gains, InputSignals, LinkWrench, Signal, Track, jump_times
from eomgen.kernel.stepping.packed_inputs import STRUCTS, PackedInputs
from eomgen.robot.model import build_model
from eomgen.runtime.bound import frame_number
from tests.support.builds import Build
from tests.support.random_robots import random_robot, with_random_loops
from tests.support.refusals import refused

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

CLOSED = {"forward_dynamics", "forward_dynamics_jacobian", "constraint_forces"} | {
    f"{name}{ending}" for name in ("inverse_dynamics", "reactions", "loop_reactions") for ending in ("", "_under_load")
}
DERIVATIVES = (  # of many
    *("energy_tangent", "energy_parameter_tangent", "forward_dynamics_adjoint", "energy_hessian"),
    *("energy_jet1", "external_force_jet1"),
)
Q, V = np.array([0.02, 0.4]), np.array([0.3, -0.5])


@pytest.fixture
def kernel(built: Build) -> Kernel:
    return built(eomgen.load_robot("one_link"))


@pytest.mark.parametrize("dtype", ["float64", pytest.param("float32", marks=pytest.mark.soak)])
def test_every_function_does_what_its_call_does(dtype: str, built: Build) -> None:
    """One state and a batch, beside a checked call of the same name."""
    robot = with_random_loops(random_robot(901, joints=(2, 2), max_size=3, tree=True), 901, ("revolute",))
    known = signatures.available(build_model(robot))
    names = [name for name in known if name in DERIVATIVES or name not in signatures.DERIVATIVES]
    kernel = built(robot, *names, dtype=dtype)
    raw, rng, seen = kernel.raw, np.random.default_rng(1), set()
    for name, function in raw.functions.items():
        arrays = [rng.uniform(-0.5, 0.5, (3, *raw.shapes[label])).astype(dtype) for label in function.reads]
        extra = (len(kernel.frames) - 1,) if function.is_framed else ()
        one, many = (np.full((count, *raw.shapes[function.writes]), np.nan, dtype) for count in (1, 3))
        pointer = kernel.parameters.setup.pointer(function.library)
        status = function.code(pointer, *(raw.view(x[0]) for x in arrays), *extra, raw.view(one))
        steps = [item for x in arrays for item in (raw.view(x), x[0].size)]
        pointer = kernel.parameters.setup.pointer(function.where(batch=True))
        said = function.batch(3, pointer, *steps, *extra, raw.view(many))
        if name in CLOSED:  # the loop is open here
            assert kernel.n < status <= raw.statuses
            assert said == status - 1
            with pytest.raises(LoopError, match=rf"^{name.removesuffix('_under_load')}: .* is open in state 0"):
                kernel.calls.run(name, None, arrays, extra)
            continue
        assert (status, said) == (0, -1), name
        expected = kernel.calls.run(name, None, arrays, extra)
        assert np.array_equal(many, expected), name
        assert np.array_equal(one[0], kernel.calls.run(name, None, [x[0] for x in arrays], extra)), name
        assert function.kernel in kernel.operations
        seen.add(function.kind)
    assert seen == {"program", "tangent", "adjoint", "hessian", "jet", "composed", "frames"}


def test_functions_of_every_kind(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"), "energy", "energy_tangent", "kinematics", "rollout")
    kinds = {name: function.kind for name, function in kernel.raw.functions.items()}
    assert kinds == {
        "energy": "program",
        "energy_tangent": "tangent",
        "frame_pose": "frames",
        "frame_jacobian": "frames",
    }
    assert (kernel.raw.rollout.name, kernel.raw.rollout.kind) == ("rollout", "rollout")
    assert built(eomgen.load_robot("one_link"), "energy").raw.rollout is None


def test_an_address_can_be_called(kernel: Kernel) -> None:
    """By another library of cffi, with the address of what the parameters give."""
    ffi = cffi.FFI()
    call = ffi.cast("int (*)(const double *, const double *, double *)", kernel.raw.address("mass_matrix"))
    many = "long long (*)(size_t, const double *, const double *, size_t, double *)"
    batch = ffi.cast(many, kernel.raw.address("mass_matrix", batch=True))
    h = ffi.cast("double *", kernel.parameters.setup.address(kernel.raw.function("mass_matrix").library))
    found, two = np.empty((2, 2)), np.empty((2, 2, 2))
    assert call(h, ffi.from_buffer("double[]", Q), ffi.from_buffer("double[]", found)) == 0
    assert np.array_equal(found, kernel.mass_matrix(Q))
    assert batch(2, h, ffi.from_buffer("double[]", np.array([Q, V])), 2, ffi.from_buffer("double[]", two)) == -1
    assert np.array_equal(two, kernel.mass_matrix(np.array([Q, V])))
    assert kernel.raw.address("rollout") != kernel.raw.address("rollout", batch=True)
    with pytest.raises(UnknownNameError, match="one_link was built without the kernel kinematics; built: mass_matrix,"):
        kernel.raw.address("kinematics")


def test_a_rollout_by_its_pointers(kernel: Kernel) -> None:
    raw, u, ends = kernel.raw, np.array([0.1, -0.2]), np.empty((2, 2, 2))
    drive = raw.rollout.library.drive(u=raw.view(u))
    arrays = [raw.view(x) for x in (Q, V)]
    pointer = kernel.parameters.setup.pointer(raw.rollout.library)
    assert raw.rollout.code(pointer, *arrays, drive, 1e-3, 5, 5, 0, raw.view(ends[0]), raw.view(ends[1])) == -1
    q, v = kernel.rollout(Q, V, u, 1e-3, 5, every=5)
    assert np.array_equal(ends, [q, v])


def test_what_parameters_give_is_replaced_as_a_whole(kernel: Kernel) -> None:
    before, library = kernel.parameters.setup, kernel.raw.function("mass_matrix").library
    mine = kernel.replaced()
    assert mine.parameters.setup is before
    computed = before.computed(library).copy()
    mine.parameters["joints.joint1.x.stiffness"] = 3.0
    assert mine.parameters.setup is not before
    assert np.array_equal(before.computed(library), computed)
    assert 3.0 in mine.parameters.setup.values
    after = mine.parameters.setup
    assert after.address(library) == after.computed(library).ctypes.data
    assert kernel.parameters.setup is before


def test_frames_have_numbers(kernel: Kernel) -> None:
    assert [frame_number(kernel.frames, name) for name in kernel.frames] == list(range(len(kernel.frames)))
    refused(UnknownNameError, r"frame: 'tpc' is unknown; did you mean 'tcp'\?", frame_number, kernel.frames, "tpc")


@pytest.mark.parametrize(
    ("make", "threads", "checks"),
    [
        (lambda kernel: kernel.replaced(threads=3), 3, True),
        (lambda kernel: kernel.replaced(checks=False), 1, False),
        (lambda kernel: kernel.replaced(checks=False).replaced(threads=2), 2, False),
        (lambda kernel: kernel.replaced(threads=2).replaced(checks=False).replaced(), 2, False),
    ],
)
def test_another_kernel_of_the_same_code(
    make: Callable[[Kernel], Kernel], threads: int, checks: bool, kernel: Kernel
) -> None:
    """It has threads, checks and parameters of its own; the first one stays as it is."""
    other = make(kernel)
    assert (other.threads, other.checks) == (threads, checks)
    assert (kernel.threads, kernel.checks) == (1, True)
    assert other.raw is kernel.raw
    if not checks:
        assert np.isnan(other.mass_matrix([np.nan, np.nan])).any()
    refused(ArrayError, "nan", kernel.mass_matrix, [np.nan, np.nan])
    before = kernel.generalized_force(Q, V)
    other.parameters["joints.joint1.x.stiffness"] = 1.0
    assert np.array_equal(kernel.generalized_force(Q, V), before)
    assert not np.array_equal(other.generalized_force(Q, V), before)
    many = np.random.default_rng(3).uniform(-1.0, 1.0, (2000, 2))
    assert np.array_equal(other.mass_matrix(many), kernel.mass_matrix(many))
    other.threads, other.checks = 4, True
    assert (kernel.threads, kernel.checks) == (1, True)


@pytest.mark.parametrize("number", [0, -1, 1.5, True, "2", None, -(10**5000)], ids=lambda x: str(type(x)))
def test_threads_that_cannot_be(number: object, kernel: Kernel) -> None:
    if number is not None:
        refused(InputError, "threads: .* is not a number of threads", kernel.replaced, threads=number)
    refused(InputError, "threads: .* is not a number of threads", setattr, kernel, "threads", number)
    refused(InputError, "checks", kernel.replaced, checks=number if isinstance(number, str) else 1)


FUNCTIONS = re.compile(r"\(\*(\w+)\)\(")
OWN = {"mechanism", "work", "h", "batch_h", "force_turned"}  # of functions, or filled by themselves


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_every_field_of_the_structures_is_in_the_table(dtype: str) -> None:
    """A new field of eom.h is packed, or is a function, its h, or what OWN names."""
    functions = set(FUNCTIONS.findall(library_types(dtype)))
    beside = OWN | functions | {f"{name}_h" for name in functions} | {"frame_h", "force_h"}
    for struct, fields in STRUCTS.items():
        _, places = layouts(dtype)[of_c(struct, dtype)]
        assert set(fields) <= set(places), struct
        left = {name for name in places if name not in fields and name not in beside}
        assert not {name for name in left if not re.fullmatch(r"(force|pose)_(back|along|by)_h|(back|along)_h", name)}


def test_what_is_packed_reads_back() -> None:
    kernel = eomgen.build("one_link")
    inner = Signal(np.array([0.0, 2.0]), np.array([[[0.1], [0.4]]]))
    signal = Signal(np.array([0.0, 1.0, 3.0]), np.arange(6.0).reshape(2, 3, 1), profile=inner)
    gains = Gains(np.array([30.0]), np.array([2.0]))
    drive = DriveData(None, Track(signal, np.array([1])), np.array([5.0]), gains, effort=np.array([np.inf, 7.0]))
    push = LinkWrench(0, Signal.constant(np.arange(6.0)), np.array([0.1, 0.2, 0.3]), 0.25, np.inf, True)
    library = kernel.raw.function("adaptive_rollout").library
    loads = InputSignals(drive, [push], first=-2.0)
    packed, stops = PackedInputs(library, kernel.calls, loads), jump_times(loads).tolist()
    inputs = packed.pointer
    control, wrench, null = inputs.control, inputs.wrench[0], library.ffi.NULL
    assert (inputs.torque, inputs.model, inputs.given, inputs.work) == (null, null, null, null)
    assert (inputs.first, inputs.last, inputs.wrenches, inputs.stops) == (-2.0, np.inf, 1, len(stops))
    assert [inputs.stop[i] for i in range(len(stops))] == stops
    assert {-2.0, 0.25} <= set(stops)
    assert [inputs.effort[i] for i in range(2)] == [np.inf, 7.0]
    assert (control.ratio[0], control.kp[0], control.kd[0], control.program.place[0]) == (5.0, 30.0, 2.0, 1)
    spline = control.program.signal
    assert (spline.pieces, spline.degree, spline.columns) == (2, 2, 1)
    assert [spline.coefficient[i] for i in range(6)] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert [spline.knot[i] for i in range(3)] == [0.0, 1.0, 3.0]
    assert (spline.profile.pieces, spline.profile.degree, spline.profile.profile) == (1, 1, null)
    assert (wrench.t0, wrench.t1, wrench.link, wrench.turns) == (0.25, np.inf, 0, 1)
    assert list(wrench.arm) == [0.1, 0.2, 0.3]
    assert wrench.frame == list(kernel.frames).index(kernel.links[0])
    assert wrench.signal.columns == 6
