"""Methods of kernels through the extension module beside the same methods in Python: equal to the bit, in all they say.

``kernel.NAME.__wrapped__`` is the method in Python.
"""

from __future__ import annotations

import copy
import gc
import inspect
import pickle
import pydoc
import threading
import tracemalloc
import weakref
from collections.abc import Callable
from dataclasses import replace
from types import MethodType
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import ArrayError, InputError, SingularError
from eomgen.pipeline import direct_calls
from eomgen.robot.value import Robot
from eomgen.runtime import Kernel
from eomgen.runtime.direct import Face
from eomgen.runtime.pieces import states_at_once
from tests.support.builds import Build
from tests.support.random_robots import random_robot, some_prescribed, with_random_loops
from tests.support.random_springs import with_springs

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
        self.names = [name for name in self.entries if name in vars(kernel)]

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

        method = getattr(type(kernel), name)
        for label, parameter in list(inspect.signature(method).parameters.items())[1:]:
            if label in entry["reads"] or label == "u":
                value = array(kernel.raw.shapes[label])
                if label not in entry["reads"] and rng.random() < 0.5:
                    continue
            elif label == "frame":
                value = rng.choice([*kernel.frames, "tpc", ""]) if rng.random() < 0.8 else rng.choice([0, None, 1.5])
                value = str(value) if isinstance(value, str) else value
            elif label == "out":
                if rng.random() < 0.5:
                    continue
                kind = str(rng.choice(list(OUTS))) if rng.random() < fresh else batch
                shape = kernel.raw.shapes[entry["writes"]]
                value = OUTS[kind](np.full(shape, 7.0, kernel.dtype), positional or [None])
                said.append(f"out: {kind}")
            elif label == "wrench":
                if rng.random() < 0.7:
                    continue
                value = None if rng.random() < 0.5 else array(kernel.raw.shapes["wrench"])
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
    return type(value), value.dtype, value.shape, value.strides, flags, base, value.tobytes()


ROBOTS: dict[str, Callable[[], Robot]] = {
    "one_link": lambda: eomgen.load_robot("one_link"),
    "a tree": lambda: with_springs(random_robot(31, joints=(2, 2), tree=True), 31),
    "loops": lambda: with_random_loops(random_robot(901, joints=(3, 3), tree=True), 901, ("revolute",)),
    "prescribed": lambda: some_prescribed(random_robot(33, joints=(2, 2)), 33),
}


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("robot", ROBOTS)
def test_both_faces_say_the_same(robot: str, dtype: str, built: Build) -> None:
    kernel = built(ROBOTS[robot](), dtype=dtype)
    calls, direct = Calls(kernel, 5), 0
    assert set(calls.names) == {x for x in calls.entries if hasattr(Kernel, x)} - {"rollout"} - {"external_reactions"}
    assert len(calls.names) > 12
    for name in calls.names:
        for number in range(120):
            kernel.checks, kernel.threads = number % 5 != 0, 1 + number % 2
            positional, keywords, said = calls.one(name, number)
            again = calls.one(name, number)
            found = outcome(getattr(kernel, name), positional, keywords)
            expected = outcome(getattr(kernel, name).__wrapped__, again[0], again[1])
            assert found == expected, (name, number, said, found[0], expected[0])
            direct += kernel.is_direct
    assert direct


def test_plain_calls_do_not_go_through_python(built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """And all others do."""
    kernel = built(eomgen.load_robot("one_link"))
    wrench = np.zeros(kernel.raw.shapes["wrench"])
    given = {"q": Q, "v": V, "a": U, "u": U, "wrench": wrench, "frame": "tcp"}
    methods = [x for x in kernel.raw.functions if hasattr(Kernel, x)]
    arguments = {}
    for name in methods:
        labels = inspect.signature(getattr(kernel, name)).parameters.values()
        arguments[name] = [given[x.name] for x in labels if x.kind is not inspect.Parameter.KEYWORD_ONLY]
        getattr(kernel, name)(*arguments[name])
    asked: list[str] = []

    def refuse(calls: Any, name: str, *rest: Any, **keywords: Any) -> Array:
        asked.append(name)
        return np.zeros(2)

    monkeypatch.setattr("eomgen.runtime.calls.Calls.run", refuse)
    for name in methods:
        shape = kernel.raw.shapes[kernel.raw.functions[name].writes]
        getattr(kernel, name)(*arguments[name])
        getattr(kernel, name)(*arguments[name], out=np.empty(shape))
        many = [np.stack([x] * N) if isinstance(x, np.ndarray) else x for x in arguments[name]]
        getattr(kernel, name)(*many)
        getattr(kernel, name)(many[0], *arguments[name][1:], out=np.empty((N, *shape)))
    assert not asked
    kernel.mass_matrix(Q.tolist())
    kernel.bias_force(Q, np.array([np.nan, 0.0]))
    kernel.christoffel(np.zeros((states_at_once(kernel.raw.functions["christoffel"].operations) + 1, 2)))
    with kernel_threads(kernel, 2):
        kernel.mass_matrix(np.zeros((512, 2)))
        kernel.mass_matrix(np.zeros((511, 2)))
    assert asked == ["mass_matrix", "bias_force", "christoffel", "mass_matrix"]


class kernel_threads:
    """A kernel with so many threads, for a block."""

    def __init__(self, kernel: Kernel, number: int) -> None:
        self.kernel, self.number = kernel, number

    def __enter__(self) -> None:
        self.kernel.threads = self.number

    def __exit__(self, *_: object) -> None:
        self.kernel.threads = 1
