"""What a call from Python costs beside its C: looks at arrays, the way through cffi; Pinocchio called the same way."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from time import perf_counter_ns
from typing import Any

import numpy as np
from numpy.typing import NDArray

import eomgen
from eomgen.bench.beside import processor_name
from eomgen.bench.clock import Timed

from .cases import Case, case
from .measure import BATCH_STATES, READS, SIZES, STATES, Disagreement, states
from .ours import Textbook
from .report import Call

Array = NDArray[np.float64]

ROBOT = "UR5"
MANY = f"Python, per state of {BATCH_STATES}"
KERNELS = ("inverse_dynamics", "mass_matrix", "forward_dynamics")
SAMPLE = 2e6  # ns that one sample takes at least
TOLERANCE = 1e-8  # greatest relative difference of results


def python_calls(rounds: int) -> tuple[Call, ...]:
    """Least times of a robot's kernels in C, and called from Python with one state and with many.

    Raises:
        MissingPeer: the robot is of example-robot-data, which is not installed.
        Disagreement: Pinocchio, where it can be imported, gives other results.
    """
    chosen = case(ROBOT)
    kernel = eomgen.build(chosen.robot, kernels=KERNELS, native=True)
    bare, peers, textbook = kernel.with_checks(False), _pinocchio(chosen), Textbook(chosen.robot)
    found = []
    for name in KERNELS:
        few, many = (_arrays(chosen, name, count) for count in (STATES, BATCH_STATES))
        ways: dict[str, Callable[[], object]] = {
            "Python": _one_by_one(getattr(kernel, name), few),
            "Python, without checks": _one_by_one(getattr(bare, name), few),
            MANY: partial(getattr(kernel, name), *many),
        }
        if name in peers:
            _compare(name, getattr(kernel, name), peers[name], few)
            ways["Pinocchio from Python"] = _one_by_one(peers[name], few)
        out = np.zeros(SIZES[name](kernel.n) if name in SIZES else kernel.n)
        h = kernel.parameters.setup.address(kernel.raw.function(name).library)
        timed = Timed(kernel.raw.address(name), h, int(out.ctypes.data))
        in_c = textbook.yardstick.stopwatch.time([timed], len(few), few, rounds)
        ns = {way: least / (BATCH_STATES if way == MANY else STATES) for way, least in _least(ways, rounds).items()}
        found.append(Call(chosen.title, processor_name(), name, {"C": float(in_c.min()), **ns}))
    return tuple(found)


def _arrays(chosen: Case, kernel: str, count: int) -> list[Array]:
    given = states(chosen.robot, count)
    return [given[name] for name in READS[kernel]]


def _one_by_one(function: Callable[..., object], arrays: Sequence[Array]) -> Callable[[], object]:
    """One call for each state; the rows are views that exist before anything is timed."""
    rows = [tuple(row) for row in zip(*arrays, strict=True)]

    def call() -> None:
        for row in rows:
            function(*row)

    return call


def _least(ways: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Least time of each over the rounds, in which they take turns, ns: what interrupts a process is no part of it."""
    again = {way: max(1, round(SAMPLE / max(_ns(code, 1), 1.0))) for way, code in ways.items()}
    found = dict.fromkeys(ways, float("inf"))
    for _ in range(rounds):
        for way, code in ways.items():
            found[way] = min(found[way], _ns(code, again[way]))
    return found


def _ns(code: Callable[[], object], again: int) -> float:
    begin = perf_counter_ns()
    for _ in range(again):
        code()
    return (perf_counter_ns() - begin) / again


def _pinocchio(chosen: Case) -> Mapping[str, Callable[..., Array]]:
    """Its functions of the same robot by kernel; none where it cannot be imported."""
    try:
        import pinocchio
    except ImportError:
        return {}
    model: Any = pinocchio.buildModelFromUrdf(str(chosen.urdf))
    data: Any = model.createData()
    return {
        "inverse_dynamics": lambda q, v, a: pinocchio.rnea(model, data, q, v, a),
        "mass_matrix": lambda q: pinocchio.crba(model, data, q),
        "forward_dynamics": lambda q, v, u: pinocchio.aba(model, data, q, v, u),
    }


def _compare(name: str, ours: Callable[..., Array], theirs: Callable[..., Array], arrays: Sequence[Array]) -> None:
    for row in zip(*arrays, strict=True):
        one, other = np.array(ours(*row)), np.array(theirs(*row))
        if name == "mass_matrix":  # of theirs the upper triangle counts
            one, other = np.triu(one), np.triu(other)
        if not np.abs(one - other).max() <= TOLERANCE * max(float(np.abs(one).max()), 1e-300):
            raise Disagreement(f"{ROBOT}: {name} from Python differs from Pinocchio's; nothing is timed")
