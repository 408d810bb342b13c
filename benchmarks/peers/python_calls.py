"""What a call from Python costs beside its C: looks at arrays, a new result; Pinocchio called the same way."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from time import perf_counter_ns
from typing import Any

import numpy as np
from numpy.typing import NDArray

import eomgen
from eomgen.bench.beside import processor_name
from eomgen.bench.clock import Timed

from .cases import Case, case
from .measure import BATCH_STATES, STATES, Disagreement, states
from .ours import Textbook
from .report import Call

Array = NDArray[np.float64]

ROBOTS = ("UR5", "Talos")
WITHOUT, OUT, MANY = "without checks", "with out", f"per state of {BATCH_STATES}"
FRAMED = ("frame_pose", "frame_jacobian")
READS: Mapping[str, tuple[str, ...]] = {
    "inverse_dynamics": ("q", "v", "a"),
    "mass_matrix": ("q",),
    "forward_dynamics": ("q", "v", "u"),
    "residual_jacobian": ("q", "v", "a"),
    "energy": ("q", "v"),
    "frame_pose": ("q",),
    "frame_jacobian": ("q",),
}
SAMPLE = 2e6  # ns that one sample takes at least
TOLERANCE = 1e-8  # greatest relative difference of results

Way = Callable[..., Any]


def python_calls(rounds: int, robots: Sequence[str] = ROBOTS) -> tuple[Call, ...]:
    """Return least times of robots' kernels in C, and called from Python with one state and with many.

    Raises:
        MissingPeer: a robot is of example-robot-data, which is not installed.
        Disagreement: Pinocchio, where it can be imported, gives other results.
    """
    return tuple(call for robot in robots for call in _calls_of(case(robot), rounds))


def _calls_of(chosen: Case, rounds: int) -> Iterator[Call]:
    kernel = eomgen.build(chosen.robot, kernels=tuple(READS), native=True)
    bare, frame = kernel.replaced(checks=False), kernel.frames[-1]
    peers, textbook = _pinocchio(chosen, frame), Textbook(chosen.robot)
    few, many = states(chosen.robot, STATES), states(chosen.robot, BATCH_STATES)
    for name, reads in READS.items():
        further = (frame,) if name in FRAMED else ()
        arrays = [few[x] for x in reads]
        shape = kernel.raw.shapes[kernel.raw.function(name).writes]
        out = np.zeros(shape)
        ways: dict[str, Callable[[], object]] = {
            "Python": _one_by_one(getattr(kernel, name), arrays, *further),
            WITHOUT: _one_by_one(getattr(bare, name), arrays, *further),
            OUT: _one_by_one(getattr(kernel, name), arrays, *further, out=out),
            MANY: partial(getattr(kernel, name), *(many[x] for x in reads), *further),
        }
        if name in peers:
            _compare(name, getattr(kernel, name), peers[name], arrays, further)
            ways["Pinocchio"] = _one_by_one(peers[name], arrays, *further)
        ns = {way: least / (BATCH_STATES if way == MANY else STATES) for way, least in least(ways, rounds).items()}
        if name not in FRAMED:
            h = kernel.parameters.setup.address(kernel.raw.function(name).library)
            timed = Timed(kernel.raw.address(name), h, int(out.ctypes.data))
            in_c = textbook.yardstick.stopwatch.time([timed], len(arrays), arrays, rounds)
            ns = {"C": float(in_c.min()), **ns}
        yield Call(chosen.title, processor_name(), name, ns)


def _one_by_one(
    function: Way, arrays: Sequence[Array], *further: object, out: Array | None = None
) -> Callable[[], object]:
    """Return one call for each state; the rows are views that exist before anything is timed."""
    rows = [(*row, *further) for row in zip(*arrays, strict=True)]

    def call() -> None:
        for row in rows:
            function(*row)

    def write() -> None:
        for row in rows:
            function(*row, out=out)

    return call if out is None else write


def least(ways: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Return the least time of each over the rounds, in which they take turns, ns.

    What interrupts a process does not count.
    """
    again = {way: max(1, round(SAMPLE / max(_ns(code, 1), 1.0))) for way, code in ways.items()}
    best = dict.fromkeys(ways, float("inf"))
    for _ in range(rounds):
        for way, code in ways.items():
            best[way] = min(best[way], _ns(code, again[way]))
    return best


def _ns(code: Callable[[], object], again: int) -> float:
    begin = perf_counter_ns()
    for _ in range(again):
        code()
    return (perf_counter_ns() - begin) / again


def _pinocchio(chosen: Case, frame: str) -> Mapping[str, Way]:
    """Return its functions of the same robot by kernel, those of frames for this one.

    None where it cannot be imported.
    """
    try:
        import pinocchio
    except ImportError:
        return {}
    model: Any = pinocchio.buildModelFromUrdf(str(chosen.urdf))
    data: Any = model.createData()
    number, axes = model.getFrameId(frame), pinocchio.LOCAL_WORLD_ALIGNED

    def pose(q: Array, _: str) -> Array:
        pinocchio.forwardKinematics(model, data, q)
        return np.asarray(pinocchio.updateFramePlacement(model, data, number).homogeneous)

    return {
        "inverse_dynamics": lambda q, v, a: pinocchio.rnea(model, data, q, v, a),
        "mass_matrix": lambda q: pinocchio.crba(model, data, q),
        "forward_dynamics": lambda q, v, u: pinocchio.aba(model, data, q, v, u),
        "residual_jacobian": lambda q, v, a: pinocchio.computeRNEADerivatives(model, data, q, v, a),
        "energy": lambda q, v: (
            pinocchio.computeKineticEnergy(model, data, q, v),
            pinocchio.computePotentialEnergy(model, data, q),
        ),
        "frame_pose": pose,
        "frame_jacobian": lambda q, _: pinocchio.computeFrameJacobian(model, data, q, number, axes),
    }


def _compare(name: str, ours: Way, theirs: Way, arrays: Sequence[Array], further: tuple[object, ...]) -> None:
    for row in zip(*arrays, strict=True):
        one, other = np.array(ours(*row, *further)), np.array(theirs(*row, *further))
        if name == "mass_matrix":  # of theirs the upper triangle counts
            one, other = np.triu(one), np.triu(other)
        if name == "residual_jacobian":
            one[2], other[2] = np.triu(one[2]), np.triu(other[2])
        if name == "energy":  # theirs is zero elsewhere
            one, other = one[:1], other[:1]
        if not np.abs(one - other).max() <= TOLERANCE * max(float(np.abs(one).max()), 1e-300):
            raise Disagreement(f"{name} from Python differs from Pinocchio's; nothing is timed")
