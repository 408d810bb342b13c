"""Long work comes in pieces that Ctrl-C can end: the same bits however it is cut, and nothing is written afterwards."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import IntegrationStopped, SingularError
from eomgen.runtime import many_steps
from eomgen.runtime.raw import STAGES, Libraries
from tests.support.builds import Build
from tests.support.refusals import refused
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

NAMES = ("inverse_dynamics", "rollout")
SMALL = 10**9  # operations of a state: a piece is as small as it can be
RNG = np.random.default_rng(3)
Q, V = RNG.uniform(-0.1, 0.1, (2, 37, 2))


@pytest.fixture(autouse=True)
def interrupts() -> Iterator[None]:
    """Python's own answer to Ctrl-C: what runs in the background of a shell begins without it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def kernel() -> eomgen.Kernel:
    """A kernel whose functions can be replaced."""
    return fresh()


def fresh() -> eomgen.Kernel:
    return eomgen.build("one_link", kernels=NAMES, flags=("-O0",))


def cut(kernel: eomgen.Kernel, operations: int, seen: list[int] | None = None, ends_at: int = 0) -> eomgen.Kernel:
    """A kernel whose functions seem to take so many operations; it counts calls, and presses Ctrl-C in one of them."""

    def watched(code: Callable[..., int]) -> Callable[..., int]:
        def call(*arguments: Any) -> int:
            found = code(*arguments)
            if seen is not None:
                seen.append(1)
                if len(seen) == ends_at:
                    signal.raise_signal(signal.SIGINT)
            return found

        return call

    own = kernel.raw.libraries.library("")
    of_stages = max(operations // STAGES, 1)
    counts = {name: {"mul": of_stages if name == "rollout" else operations} for name in own.meta["operations"]}
    libraries = Libraries(own.ffi, own.lib, {**own.meta, "operations": counts})
    library = libraries.library("")
    library.function = lambda name: watched(own.function(name))  # type: ignore[method-assign]
    other = eomgen.Kernel(libraries)
    other.threads = kernel.threads
    return other


@pytest.mark.parametrize("count", [None, 1, 5, 37])
@pytest.mark.parametrize("method", ["rk4", "implicit"])
@pytest.mark.parametrize("dtype", soaked(["float64", "float32"], ["float64"]))
def test_pieces_of_a_rollout_change_no_bit(
    count: int | None, method: str, dtype: str, built: Build, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pieces of one step, of a few, that fill the buffer or do not; drives and targets of every step and state."""
    states = (np.s_[0] if count is None else np.s_[:count],)
    q, v = Q[states].astype(dtype), V[states].astype(dtype)
    for every in (1, 3, 7, 60):
        steps = 53
        over_time = RNG.uniform(-1.0, 1.0, (*q.shape[:-1], steps, 2)).astype(dtype)
        held = over_time[..., 0, :].copy()
        for how in ({"u": over_time}, {"u": held, "kp": 3.0, "kd": 0.1, "target": 0.1 * over_time}):
            arguments = {"method": method, "every": every, **how}
            kernel = built(eomgen.load_robot("one_link"), *NAMES, dtype=dtype)
            whole = kernel.rollout(q, v, dt=1e-3, steps=steps, **arguments)
            for operations, buffer in ((SMALL, 2**15), (10**5, 2**15), (10**5, 64)):
                monkeypatch.setattr(many_steps, "BUFFER", buffer)
                seen: list[int] = []
                found = cut(kernel, operations, seen).rollout(q, v, dt=1e-3, steps=steps, **arguments)
                assert operations < SMALL or len(seen) >= steps
                for x, y in zip(found, whole, strict=True):
                    assert x.tobytes() == y.tobytes()


@pytest.mark.parametrize("threads", [1, 3])
def test_pieces_of_a_batch_change_no_bit(threads: int, kernel: eomgen.Kernel) -> None:
    q, v, a = RNG.uniform(-1, 1, (3, 1999, 2))
    whole = kernel.inverse_dynamics(q, v, a), kernel.inverse_dynamics(q[0], v, a[:1])
    kernel.threads, seen = threads, list[int]()
    kernel = cut(kernel, SMALL, seen)
    found = kernel.inverse_dynamics(q, v, a), kernel.inverse_dynamics(q[0], v, a[:1])
    assert len(seen) >= 2 * 1999 // 16
    assert [x.tobytes() for x in found] == [x.tobytes() for x in whole]


def test_a_rollout_in_pieces_fails_where_it_failed(kernel: eomgen.Kernel) -> None:
    """What was reached of the state that fails is kept, as in one piece."""
    push = np.zeros((20, 2))
    push[1] = 1e300

    def caught(**how: Any) -> IntegrationStopped:
        return refused(IntegrationStopped, "", kernel.rollout, np.tile(Q[0], (20, 1)), V[0], push, 1e-3, 50, **how)

    for every in (1, 4):
        kernel = fresh()
        before = caught(every=every)
        kernel = cut(kernel, 10**5)
        after = caught(every=every)
        assert (str(after), after.t, after.coordinate) == (str(before), before.t, before.coordinate)
        for x, y in zip(after.stored, before.stored, strict=True):
            assert np.array_equal(x[1], y[1], equal_nan=True)


@pytest.mark.parametrize("count", [None, 40])
def test_a_singular_state_is_named_by_its_step(count: int | None, built: Build) -> None:
    robot = eomgen.load_robot("one_link")
    point = replace(robot.links[0], mass=0.0, inertia=(0.0,) * 6)
    kernel = built(replace(robot, name="no_mass", links=(point,)), "rollout")
    q = Q[0] if count is None else np.tile(Q[0], (count, 1))
    for operations in (1, SMALL):
        kernel = cut(kernel, operations)
        refused(SingularError, r"joint1\.x in step 0( of state 0)?;", kernel.rollout, q, V[0], np.zeros(2), 1e-3, 50)


@pytest.mark.parametrize("call", ["rollout", "rollouts", "batch"])
def test_an_interrupt_ends_long_work(call: str, kernel: eomgen.Kernel) -> None:
    """In the piece in which it comes; without pieces it would come behind the last one."""
    seen: list[int] = []
    kernel = cut(kernel, SMALL, seen, ends_at=3)
    many = np.zeros((160_000, 2))
    work = {
        "rollout": lambda: kernel.rollout(Q[0], V[0], V[0], 1e-6, 10**12, every=10**12),
        "rollouts": lambda: kernel.rollout(Q, V, V[0], 1e-6, 10**12, every=10**12),
        "batch": lambda: kernel.inverse_dynamics(many, many, many),
    }
    refused(KeyboardInterrupt, "", work[call])
    assert len(seen) == 3


@pytest.mark.parametrize("call", ["rollouts", "batch"])
def test_an_interrupt_ends_the_work_of_threads(call: str, kernel: eomgen.Kernel) -> None:
    """No thread writes any more when the caller has the exception."""
    seen: list[int] = []
    kernel = cut(kernel, SMALL, seen, ends_at=5)
    kernel.threads = 2
    many, out = np.zeros((1_600_000, 2)), np.full((1_600_000, 2), np.nan)
    work = {
        "rollouts": lambda: kernel.rollout(Q, V, V[0], 1e-6, 10**12, every=10**12),
        "batch": lambda: kernel.inverse_dynamics(many, many, many, out=out),
    }
    refused(KeyboardInterrupt, "", work[call])
    done, written = len(seen), np.isfinite(out).sum()
    assert done < 100_000
    again = kernel.inverse_dynamics(Q, V, V)  # the threads are free
    assert np.isfinite(again).all()
    assert np.isfinite(out).sum() == written < out.size


def test_pieces_are_of_some_size() -> None:
    """Whole vectors, and no fewer than one; spans end where states are stored."""
    from eomgen.runtime.chunking import OPERATIONS, ROUND, states_at_once

    assert states_at_once(OPERATIONS * 5) == states_at_once(OPERATIONS // ROUND) == ROUND
    assert states_at_once(0) == OPERATIONS // ROUND * ROUND
    assert list(many_steps._spans(10, 2, 5)) == [(0, 4), (4, 8), (8, 10)]
    assert list(many_steps._spans(10, 4, 3)) == [(0, 3), (3, 4), (4, 7), (7, 8), (8, 10)]
    assert list(many_steps._spans(3, 50, 7)) == [(0, 3)]
