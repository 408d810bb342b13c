"""Methods of kernels through the extension module and without it: equal to the bit, in all they say."""

from __future__ import annotations

import copy
import gc
import inspect
import pickle
import pydoc
import sys
import threading
import tracemalloc
import weakref
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import ArrayError, SingularError
from eomgen.kernel import Kernel
from eomgen.kernel.declared_methods import DeclaredFunctions
from eomgen.kernel.functions import Functions
from eomgen.pipeline.direct_calls import LateBinding
from eomgen.robot.value import Robot
from eomgen.runtime.chunking import states_at_once
from tests.support.bending_mixtures import mixture
from tests.support.bristled import bristled_arm, served_arm
from tests.support.bristles import bristle_linkage
from tests.support.builds import Build
from tests.support.methods import method_of
from tests.support.random_robots import random_robot, some_prescribed, with_random_loops
from tests.support.random_springs import with_springs
from tests.support.refusals import refused

Array = np.ndarray[Any, Any]
Q, V, U = np.array([0.02, 0.4]), np.array([0.3, -0.5]), np.array([1.0, 2.0])
N = 4  # states of a batch


class Mine(np.ndarray[Any, Any]):
    """A subclass of arrays."""


def _misaligned(x: Array) -> Array:
    held = np.zeros(x.nbytes + 1, np.uint8)[1:].view(x.dtype).reshape(x.shape)
    held[...] = x
    return held


def _with(x: Array, number: float) -> Array:
    found = x.copy()
    found.reshape(-1)[found.size // 2] = number
    return found


def _read_only(x: Array) -> Array:
    x.flags.writeable = False
    return x


KINDS: dict[str, Callable[[Array], Any]] = {  # of arguments, made of a plain one
    "plain": lambda x: x,
    "a list": lambda x: x.tolist(),
    "a tuple": lambda x: tuple(x.tolist()),
    "single precision": lambda x: x.astype(np.float32),
    "double precision": lambda x: x.astype(np.float64),
    "whole numbers": lambda x: (10 * x).astype(np.int64),
    "a stride": lambda x: np.repeat(x, 2, axis=-1)[..., ::2],
    "backwards": lambda x: x[::-1],
    "Fortran's order": np.asfortranarray,
    "read only": _read_only,
    "other bytes": lambda x: x.astype(x.dtype.newbyteorder()),
    "a subclass": lambda x: x.view(Mine),
    "masked": lambda x: np.ma.masked_array(x, mask=np.zeros(x.shape, bool)),
    "no axes": lambda x: x.reshape(-1)[0].reshape(()),
    "one more": lambda x: np.concatenate([x, x[..., :1]], axis=-1),
    "one state as a batch": lambda x: x[np.newaxis],
    "a batch": lambda x: np.stack([(1.0 - 0.1 * i) * x for i in range(N)]),
    "a list of states": lambda x: np.stack([x, x]).tolist(),
    "another batch": lambda x: np.stack([x] * (N + 1)),
    "an empty batch": lambda x: np.zeros((0, *x.shape), x.dtype),
    "two leading axes": lambda x: np.stack([np.stack([x, x]), np.stack([x, 0.5 * x])]),
    "a batch with a stride": lambda x: np.stack([x] * (2 * N))[::2],
    "a batch with NaN": lambda x: _with(np.stack([x] * N), np.nan),
    "NaN": lambda x: _with(x, np.nan),
    "infinity": lambda x: _with(x, -np.inf),
    "large": lambda x: _with(x, float(np.finfo(x.dtype).max)),
    "misaligned": _misaligned,
    "None": lambda x: None,
    "text": lambda x: "tcp",
    "complex": lambda x: x.astype(complex),
    "truth": lambda x: x > 0,
    "whole numbers that are rounded": lambda x: [2**60 + 1] * x.size,
}
OUTS: dict[str, Callable[[Array, list[Any]], Any]] = {  # of results and the arguments
    "plain": lambda x, given: x,
    "a batch": lambda x, given: np.stack([x] * N),
    "None": lambda x, given: None,
    "a list": lambda x, given: x.tolist(),
    "single precision": lambda x, given: x.astype(np.float32),
    "a stride": lambda x, given: np.repeat(x, 2, axis=-1)[..., ::2],
    "read only": lambda x, given: _read_only(x),
    "misaligned": lambda x, given: _misaligned(x),
    "a subclass": lambda x, given: x.view(Mine),
    "one more": lambda x, given: np.concatenate([x, x], axis=0),
    "part of another": lambda x, given: np.stack([x, x])[1],
    "an argument": lambda x, given: given[0],
    "overlapping": lambda x, given: _overlapping(x, given),
}


def _overlapping(x: Array, given: list[Any]) -> Array:
    """A result and the first argument in one piece of memory, the last number of one the first of the other."""
    if not isinstance(given[0], np.ndarray) or given[0].dtype != x.dtype or not given[0].size:
        return x
    whole = np.zeros(x.size + given[0].size - 1, x.dtype)
    whole[: given[0].size] = given[0].ravel()
    given[0] = whole[: given[0].size].reshape(given[0].shape)
    return whole[given[0].size - 1 :].reshape(x.shape)


class Calls:
    """Random calls of the methods of a kernel, each made twice: for the extension module and for Python."""

    def __init__(self, kernel: Kernel, seed: int) -> None:
        self.kernel, self.seed = kernel, seed
        self.entries = kernel.raw.libraries.meta["functions"]
        self.names = [
            name for name in self.entries if (hasattr(Kernel, name) or hasattr(Functions, name)) and name != "rollout"
        ]

    def one(self, name: str, number: int) -> tuple[list[Any], dict[str, Any], list[str]]:
        """Arguments of a call, the same for the same numbers in memory of their own, and what they are."""
        rng = np.random.default_rng([self.seed, self.names.index(name), number])
        kernel, entry, said = self.kernel, self.entries[name], []
        positional: list[Any] = []
        keywords: dict[str, Any] = {}
        fresh = 0.4 if number % 2 else 0.05  # of arguments that are not plain
        batch = "a batch" if rng.random() < 0.25 else "plain"

        def array(shape: tuple[int, ...], calm: bool = False) -> Any:
            x = rng.uniform(-0.5, 0.5, shape).astype(kernel.dtype)
            kind = str(rng.choice(list(KINDS))) if rng.random() < fresh and not calm else batch
            said.append(kind)
            return KINDS[kind](x)

        for label, parameter in inspect.signature(method_of(kernel, name)).parameters.items():
            if label in entry["reads"] or label == "u":
                value = array(kernel.raw.shapes[label])
                if rng.random() < (0.5 if label not in entry["reads"] else 0.1 if label == "z" else 0.0):
                    continue
            elif label == "frame":
                value = rng.choice([*kernel.frames, "tpc", ""]) if rng.random() < 0.8 else rng.choice([0, None, 1.5])
                value = str(value) if isinstance(value, str) else value
            elif label == "out":
                if rng.random() < 0.5:
                    continue
                kind = str(rng.choice(list(OUTS))) if rng.random() < fresh else batch
                shape = returned_shape(kernel, entry["writes"])
                value = OUTS[kind](np.full(shape, 7.0, kernel.dtype), positional or [None])
                said.append(f"out: {kind}")
            elif label == "wrench":
                if rng.random() < 0.5:
                    continue
                value = None if rng.random() < 0.2 else array(kernel.raw.shapes["wrench"])
            else:
                value = [True, False, 1, "yes", None][int(rng.integers(5))]
                if rng.random() < 0.3:
                    continue
                said.append(f"{label}={value!r}")
            if parameter.kind is inspect.Parameter.KEYWORD_ONLY or keywords or rng.random() < 0.15:
                keywords[label] = value
            else:
                positional.append(value)
        turned = list(keywords.items())
        rng.shuffle(turned)  # type: ignore[arg-type]
        keywords = dict(turned)
        slip = rng.random()
        if slip < 0.02:
            keywords["qq"] = 1
        elif slip < 0.04 and positional:
            positional.pop()
        elif slip < 0.06:
            positional.append(positional[-1] if positional else Q)
        elif slip < 0.08 and positional:
            keywords["q"] = positional[0]
        return positional, keywords, said


def in_python(kernel: Kernel) -> Kernel:
    """Return the same kernel, with separate parameters, whose calls go through Python."""
    other = kernel.replaced()
    other._bound = DeclaredFunctions(other.calls)
    other.functions = Functions(other._bound)
    return other


def returned_shape(kernel: Kernel, writes: str) -> tuple[int, ...]:
    """Return the shape of an array as methods return it: without internal states behind the coordinates."""
    shape, axes = kernel.raw.shapes[writes], kernel.calls.arrays.axes_with_states(writes)
    return (*shape[: len(shape) - axes], *(kernel.calls.n,) * axes)


def is_direct(kernel: Kernel, name: str) -> bool:
    return type(kernel._bound[name]).__name__ == "Direct"


def outcome(method: Callable[..., Any], positional: list[Any], keywords: dict[str, Any]) -> tuple[Any, ...]:
    """All that can be seen of a call: the result, or the error; and what became of its arguments."""
    with np.errstate(all="ignore"):
        try:
            found: Any = shown(method(*positional, **keywords))
        except Exception as error:
            found = (type(error), str(error), getattr(error, "coordinate", None))
    return found, [shown(x) for x in (*positional, *keywords.values())]


def shown(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(shown(x) for x in value)
    if not isinstance(value, np.ndarray):
        return repr(value)
    base = None if value.base is None else (type(value.base), getattr(value.base, "shape", None))
    flags = (value.flags.c_contiguous, value.flags.writeable, value.flags.aligned, value.flags.owndata)
    about = (type(value), value.dtype, value.shape, value.strides, flags, base)
    if value.dtype.kind == "f":  # of two numbers that are none a sum has the sign of either, as the compiler likes it
        value = np.where(np.isnan(value), value.dtype.type(np.nan), value)
    return (*about, value.tobytes())


ROBOTS: dict[str, Callable[[], Robot]] = {
    "one_link": lambda: eomgen.load_robot("one_link"),
    "a tree": lambda: with_springs(random_robot(31, joints=(2, 2), tree=True), 31),
    "loops": lambda: with_random_loops(random_robot(901, joints=(3, 3), tree=True), 901, ("revolute",)),
    "prescribed": lambda: some_prescribed(random_robot(33, joints=(2, 2)), 33),
    "bending": lambda: mixture(34, ("laws", "prescribed", "springs"), (2, 2)).robot,
    "bristles": bristled_arm,
    "a servo drive": served_arm,
    "loops with bristles": bristle_linkage,
}
SLOW = ("a tree", "loops", "bending", "a servo drive", "loops with bristles")


@pytest.mark.parametrize("calls", [25, pytest.param(400, marks=pytest.mark.soak)])
@pytest.mark.parametrize(
    ("robot", "dtype"),
    [
        *((robot, "float64") for robot in ROBOTS if robot not in SLOW),
        *(pytest.param(robot, "float64", marks=pytest.mark.soak) for robot in SLOW),
        *(pytest.param(robot, "float32", marks=pytest.mark.soak) for robot in ROBOTS),
    ],
)
def test_both_bindings_say_the_same(robot: str, dtype: str, calls: int, built: Build) -> None:
    at_once = () if (robot, dtype) == ("one_link", "float64") else ("all",)  # one: each kernel when it is called first
    kernel = built(ROBOTS[robot](), *at_once, dtype=dtype)
    made, direct = Calls(kernel, 5), 0
    assert len(made.names) > 12
    for name in made.names:
        for number in range(calls):
            kernel.checks, kernel.threads = number % 5 != 0, 1 + number % 2
            positional, keywords, said = made.one(name, number)
            again = made.one(name, number)
            found = outcome(method_of(kernel, name), positional, keywords)
            expected = outcome(method_of(in_python(kernel), name), again[0], again[1])
            assert found == expected, (name, number, said, found[0], expected[0])
            direct += kernel.functions.is_direct and is_direct(kernel, name)
    assert direct


def test_plain_calls_do_not_go_through_python(built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """And all others do."""
    kernel = built(eomgen.load_robot("one_link"))
    wrench = np.zeros(kernel.raw.shapes["wrench"])
    given = {"q": Q, "v": V, "a": U, "u": U, "wrench": wrench, "frame": "tcp", "z": None}
    methods = [x for x in kernel.raw.functions if x in {*dir(Kernel), *dir(Functions)}]
    arguments = {}
    for name in methods:
        labels = inspect.signature(method_of(kernel, name)).parameters.values()
        arguments[name] = [given[x.name] for x in labels if x.kind is not inspect.Parameter.KEYWORD_ONLY]
        wrenched = {"wrench": wrench} if kernel.raw.functions[name].wrench else {}
        method_of(kernel, name)(*arguments[name], **wrenched)
        several = [np.stack([x] * N) if isinstance(x, np.ndarray) else x for x in arguments[name]]
        method_of(kernel, name)(*several, **wrenched)
    asked: list[str] = []

    def refuse(calls: Any, name: str, *rest: Any, **keywords: Any) -> Array:
        asked.append(name)
        return np.zeros(2)

    monkeypatch.setattr("eomgen.runtime.calls.Calls.run", refuse)
    for name in methods:
        shape = kernel.raw.shapes[kernel.raw.functions[name].writes]
        method_of(kernel, name)(*arguments[name])
        method_of(kernel, name)(*arguments[name], out=np.empty(shape))
        if kernel.raw.functions[name].wrench:
            method_of(kernel, name)(*arguments[name], wrench=wrench)
            method_of(kernel, name)(*arguments[name], wrench=np.stack([wrench] * N))
        many = [np.stack([x] * N) if isinstance(x, np.ndarray) else x for x in arguments[name]]
        method_of(kernel, name)(*many)
        method_of(kernel, name)(many[0], *arguments[name][1:], out=np.empty((N, *shape)))
    assert not asked
    kernel.mass_matrix(Q.tolist())
    kernel.bias_force(Q, np.array([np.nan, 0.0]))
    kernel.christoffel(np.zeros((states_at_once(kernel.raw.functions["christoffel"].operations) + 1, 2)))
    kernel.threads = 2
    kernel.mass_matrix(np.zeros((512, 2)))
    kernel.mass_matrix(np.zeros((511, 2)))
    assert asked == ["mass_matrix", "bias_force", "christoffel", "mass_matrix"]


WRONG_Z: dict[str, Callable[[Array], Any]] = {
    "None": lambda z: None,
    "a list": lambda z: z.tolist(),
    "NaN": lambda z: _with(z, np.nan),
    "one more": lambda z: np.append(z, z[..., :1], axis=-1),
    "another dtype": lambda z: z.astype(np.float32 if z.dtype == np.float64 else np.float64),
    "another batch": lambda z: np.stack([z] * (N + 1)),
}


@pytest.mark.parametrize("dtype", ["float64", pytest.param("float32", marks=pytest.mark.soak)])
@pytest.mark.parametrize(
    "robot", ["bristles", "a servo drive", pytest.param("loops with bristles", marks=pytest.mark.soak)]
)
def test_internal_states(robot: str, dtype: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where loops are closed, too: z by its name or place, missing or wrong; results without rates of z."""
    names = ["forward_dynamics", "inverse_dynamics", "generalized_force", "residual", "energy", "reactions"]
    names += ["forward_dynamics_jacobian", "residual_jacobian"]
    kernel, rng = built(ROBOTS[robot](), "all", dtype=dtype), np.random.default_rng(7)
    plain, n, wrench = in_python(kernel), kernel.calls.n, rng.normal(size=kernel.raw.shapes["wrench"]).astype(dtype)
    arrays = {x: (0.1 * rng.normal(size=n)).astype(dtype) for x in "qvau"}
    if kernel.constraints:
        arrays |= {"q": kernel.assemble(kernel.home).astype(dtype), "v": np.zeros(n, dtype), "a": np.zeros(n, dtype)}
    arrays["z"] = (1e-5 * rng.normal(size=kernel.raw.shapes["z"])).astype(dtype)
    many = {x: np.stack([array] * N) for x, array in arrays.items()}
    many |= {x: array * np.linspace(0.5, 1.0, N, dtype=dtype)[:, np.newaxis] for x, array in many.items() if x in "uz"}
    for name in names:
        function = kernel.raw.functions[name]
        shape = returned_shape(kernel, function.writes)
        for source in (arrays, many):
            given, z = [source[x] for x in function.arguments], {"z": source["z"]}
            calls = [(given, z), (given, {"z": arrays["z"]}), ([arrays[x] for x in function.arguments], z), (given, {})]
            calls += [(given, {"z": change(source["z"])}) for change in WRONG_Z.values()]
            calls += [(given, {**z, "out": np.full((*given[0].shape[:-1], *shape), 7.0, dtype)})]
            calls += [(given, {**z, "forces": arrays["z"]}), ([*given, source["z"]], {})]
            calls += [(given, {**z, "wrench": wrench})] if function.wrench else []
            for number, (values, options) in enumerate(calls):
                found, expected = (outcome(getattr(x, name), values, options) for x in (kernel, plain))
                assert found == expected, (name, number, found[0], expected[0])
        with monkeypatch.context() as patch:
            patch.setattr("eomgen.runtime.calls.Calls.run", None)
            for source in (arrays, many):
                getattr(kernel, name)(*(source[x] for x in function.arguments), z=source["z"])


@pytest.mark.parametrize("direct", [True, False])
def test_a_method_can_be_pickled_and_copied(direct: bool) -> None:
    kernel = eomgen.build("one_link", kernels=("generalized_force",), flags=("-O0",))
    kernel.parameters["gravity.y"] = -1.0
    kernel.checks, kernel.threads = False, 2
    expected = kernel.generalized_force(Q, V)
    method: Any = (kernel if direct else in_python(kernel)).generalized_force
    for found in (
        pickle.loads(pickle.dumps(method)),
        copy.copy(method),
        copy.deepcopy(method),
        pickle.loads(pickle.dumps(kernel)).generalized_force,
    ):
        assert type(found).__name__ == "Direct"
        assert np.array_equal(found(Q, V), expected)
        calls = found.__wrapped__.__self__
        assert (calls.parameters["gravity.y"], calls.checks, calls.threads) == (-1.0, False, 2)


@pytest.mark.parametrize("direct", [True, False])
def test_a_method_shows_itself_as_that_of_the_class(direct: bool, built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"))
    method: Any = (kernel if direct else in_python(kernel)).forward_dynamics
    shown: Any = Kernel.forward_dynamics
    assert type(method).__name__ == ("Direct" if direct else "CalledInPython")
    assert list(inspect.signature(shown).parameters)[1:] == list(inspect.signature(method).parameters)
    for name in ("__doc__", "__name__", "__qualname__", "__module__", "__annotations__"):
        assert getattr(method, name) == getattr(shown, name), name
    assert repr(method) == f"<forward_dynamics of {kernel.name}>"
    assert inspect.isroutine(method)
    told = pydoc.plain(pydoc.render_doc(method))
    assert "Return accelerations, (n,), m/s^2 or rad/s^2, under the drives u." in told
    assert "forward_dynamics(q:'ArrayLike'" in "".join(told.split())  # from Python 3.13 on in several lines
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = method.nothing
    assert np.array_equal(shown(kernel, Q, V, U), method(Q, V, U))

    class Holder:
        call = method

    assert np.array_equal(Holder().call(Q, V, U), method(Q, V, U))  # as a bound method, no self


@pytest.mark.parametrize("direct", [True, False])
def test_wrong_calls_raise_as_in_python(direct: bool, built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"))
    method: Any = (kernel if direct else in_python(kernel)).forward_dynamics
    given = {"q": Q, "v": V, "u": U}
    assert np.array_equal(method(**given), method(Q, V, U))
    assert np.array_equal(method(Q, u=U, v=V), method(Q, V, U))
    cases: tuple[tuple[str, tuple[Any, ...], dict[str, Any]], ...] = (
        ("missing 1 required positional argument: 'u'", (Q, V), {}),
        ("takes from 4 to 5 positional arguments but 6 were given", (Q, V, U, None, None), {}),
        ("got multiple values for argument 'q'", (Q, V, U), {"q": Q}),
        ("got an unexpected keyword argument 'wrenches'", (Q, V, U), {"wrenches": None}),
    )
    for message, positional, keywords in cases:
        with pytest.raises(TypeError, match=message):
            method(*positional, **keywords)


def test_methods_of_a_subclass_are_its_own(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"))

    class Louder(Kernel):
        def mass_matrix(self, q: Any, *, out: Any = None) -> Any:
            return 2.0 * super().mass_matrix(q, out=out)

    louder = Louder(kernel.raw.libraries, None, kernel._binding)
    assert louder.functions.is_direct
    assert np.array_equal(louder.mass_matrix(Q), 2.0 * kernel.mass_matrix(Q))
    assert np.array_equal(louder.replaced().mass_matrix(Q), 2.0 * kernel.mass_matrix(Q))
    assert is_direct(louder, "bias_force")


def test_kernels_go_with_their_last_reference(built: Build) -> None:
    """Without the search for cycles; a method keeps what it needs."""
    first = built(eomgen.load_robot("one_link"))
    expected = first.forward_dynamics(Q, V, U)
    gc.collect()
    gc.disable()
    try:
        kernel = first.replaced()
        method, gone = kernel.forward_dynamics, weakref.ref(kernel)
        kernel.mass_matrix(Q)
        del kernel
        assert gone() is None
        kept = weakref.ref(method.__wrapped__.__self__)  # type: ignore[attr-defined]
        assert np.array_equal(method(Q, V, U), expected)
        del method
        assert kept() is None

        def work() -> None:
            for number in range(200):
                kernel = first.replaced(parameters={"gravity.y": float(number)})
                kernel.mass_matrix(Q)
                kernel.forward_dynamics(Q, V, U, out=np.empty(2))
                kernel.residual_jacobian(Q, V, U)
                kernel.frame_pose(Q, "tcp")
                with pytest.raises(ArrayError):
                    kernel.energy(Q, V * np.nan)
                kernel.mass_matrix(np.zeros((3, 2)))

        work()
        tracemalloc.start()
        before = tracemalloc.get_traced_memory()[0]
        work()
        work()
        assert tracemalloc.get_traced_memory()[0] - before < 100_000  # 400 kernels have more than a kilobyte each
    finally:
        tracemalloc.stop()
        gc.enable()
    kernel = first.replaced()
    kernel.itself = kernel.mass_matrix  # type: ignore[attr-defined]
    kernel.parameters.around = kernel  # type: ignore[attr-defined]
    gone = weakref.ref(kernel)
    del kernel
    gc.collect()
    assert gone() is None


def test_a_reference_from_before_the_code_is_there(empty_cache: Any) -> None:
    kernel = eomgen.build("one_link", flags=("-O0",))
    assert kernel.functions.is_direct
    method, other = kernel._bound["mass_matrix"], kernel.replaced()._bound["mass_matrix"]
    assert not method.is_armed  # type: ignore[attr-defined]
    refused(ArrayError, "q: expected float64 of shape", method, np.zeros(3))
    expected = method(Q)
    assert method.is_armed  # type: ignore[attr-defined]
    assert other.is_armed  # type: ignore[attr-defined]
    assert np.array_equal(method(Q), expected)
    assert np.array_equal(other(Q), expected)
    assert not kernel._bound["bias_force"].is_armed  # type: ignore[attr-defined]
    with pytest.raises(TypeError, match="takes 2 positional arguments but 3 were given"):
        method(Q, None)


def test_kernels_from_before_the_module(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"))
    binding = LateBinding()
    early = Kernel(kernel.raw.libraries, None, binding)
    copied, method = early.replaced(parameters={"gravity.y": -3.0}), early.forward_dynamics
    early.checks, state = False, early.parameters.state
    assert not early.functions.is_direct
    module = kernel._binding.module
    assert module is not None
    binding.settle(module)
    assert early.functions.is_direct
    assert copied.functions.is_direct
    assert not early.checks
    assert copied.parameters["gravity.y"] == -3.0
    state.assign(list(early.parameters).index("gravity.y"), -2.0)  # of a thread that was just about to
    assert early.parameters["gravity.y"] == -2.0
    assert np.array_equal(early.forward_dynamics(Q, V, U), method(Q, V, U))
    late = Kernel(kernel.raw.libraries, None, binding)
    assert late.functions.is_direct
    never = Kernel(kernel.raw.libraries)
    assert not never.functions.is_direct
    assert np.array_equal(never.forward_dynamics(Q, V, U), late.forward_dynamics(Q, V, U))
    binding = LateBinding()
    unlucky = Kernel(kernel.raw.libraries, None, binding)
    binding.settle(None)
    assert not unlucky.functions.is_direct
    assert not unlucky.replaced().functions.is_direct


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_an_assignment_is_seen_by_the_next_call(dtype: str, built: Build) -> None:
    robot = eomgen.load_robot("one_link")
    kernel = built(robot, dtype=dtype)
    q, v, u = (x.astype(dtype) for x in (Q, V, U))
    plain = Kernel(kernel.raw.libraries)
    for number, name in enumerate(["gravity.x", "joints.joint1.x.stiffness", "gravity.y"] * 3):
        copied = kernel.replaced()
        before = kernel.forward_dynamics(q, v, u)
        value = kernel.parameters[name] * 1.25 + 0.1
        if number % 2:
            kernel.parameters[name] = plain.parameters[name] = value
        else:
            kernel.parameters.update({name: value})
            plain.parameters.update({name: value})
        assert dict(kernel.parameters) == dict(plain.parameters)
        after = kernel.forward_dynamics(q, v, u)
        assert np.array_equal(after, plain.forward_dynamics(q, v, u))
        assert np.array_equal(copied.forward_dynamics(q, v, u), before)
        assert not np.array_equal(after, before)
    assert np.array_equal(kernel.parameters.setup.values, plain.parameters.setup.values)


def test_long_calls_let_other_threads_run(built: Build) -> None:
    """A batch that takes long is computed without the interpreter's lock."""
    kernel = built(eomgen.load_robot("one_link"))
    many = np.zeros((states_at_once(kernel.raw.functions["christoffel"].operations), 2))
    counted, begin, over = [0], threading.Event(), threading.Event()

    def count() -> None:
        begin.wait()
        counted[0] += 1
        over.wait()

    kernel.christoffel(Q)
    interval = sys.getswitchinterval()
    other = threading.Thread(target=count)
    other.start()
    sys.setswitchinterval(100.0)  # nobody gives the lock away but who wants to
    try:
        begin.set()
        kernel.christoffel(many)
        found = counted[0]
    finally:
        over.set()
        sys.setswitchinterval(interval)
        other.join()
    assert found == 1


def test_singular_states_are_named(built: Build) -> None:
    robot = eomgen.load_robot("one_link")
    link = replace(robot.links[-1], mass=0.0, inertia=(0.0,) * 6)
    kernel = built(replace(robot, links=(*robot.links[:-1], link)), "forward_dynamics", "mass_matrix")
    for q in (Q, np.stack([Q, Q])):
        for out in (None, np.empty(q.shape)):
            found = refused(SingularError, "", kernel.forward_dynamics, q, V, U, out=out)
            with pytest.raises(SingularError) as expected:
                in_python(kernel).forward_dynamics(q, V, U, out=out)
            assert str(found) == str(expected.value)
