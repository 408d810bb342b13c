"""Equations -> the numbers that a compiled package has to return in random states, and how accurately.

The programs are evaluated in NumPy.  A tolerance of each number is estimated by Monte Carlo arithmetic: the program is
evaluated again with every operation rounded some units in the last place off at random, so that ill-conditioned results
have wide tolerances, and robots of any size and mass tolerances of their own scale.
"""

from __future__ import annotations

import io
import zlib
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eomgen.robot.model import Model

from ..kernels.blocks import row_blocks
from ..kernels.bodies import jacobian_columns
from ..kernels.derivatives.whole import is_joined, whole_program
from ..kernels.equations import Equations
from ..kernels.signatures import SIGNATURES, Function, functions, signatures_of
from ..program.ir import Program, evaluate_lanes
from .contexts import PIVOT_LIMITS

Array = NDArray[Any]

STATES = 2  # of the test of a package before it enters the cache
INPUTS = {"q", "v", "z", "u", "forces"}  # of motions
COPIES = 4  # of each state, rounded at random
UNITS = 8.0  # in the last place that an operation of a copy is off by at most
SAFETY = 16.0  # times the largest deviation of a copy: the tolerance
ROUNDING = 16.0  # units in the last place of a result, or of a sum of results by its terms, that are allowed beside it
STEP = {"float64": 2.0**-200, "float32": 2.0**-60}  # s; so short that velocities change by the accelerations alone
ITERATED = 256.0 * ROUNDING  # eps of velocities behind a step that is solved by iterations
INCREMENT = 2.0**-14  # of coordinates, velocities and forces, for finite differences
DAMPED = {"float64": 1e-6, "float32": 0.1}  # relative error of derivatives where loops are closed
_ROWS = 251  # of random roundings, which instructions take in turn
PASSES, FAILS, UNCERTAIN = 0, 1, 2  # whether a function fails in a state because a pivot vanishes


class Answer(NamedTuple):
    """Expected numbers of a function, (count, lanes), and pivots with their scales, (2 n, lanes), if it solves.

    With ``places``, (count, terms), a number is the sum of the function's results there times ``weights``, (terms,).
    ``error``, (count, lanes), is what the expected numbers themselves are off by.
    """

    numbers: Array
    pivots: Array | None = None
    error: Array | None = None
    places: Array | None = None
    weights: Array | None = None


def pack_expected(equations: Equations) -> bytes:
    """Evaluate what every function of a package has to return, see ``expected_numbers``."""
    stream = io.BytesIO()
    numbers: dict[str, Any] = expected_numbers(equations)
    np.savez(stream, **numbers)
    return zlib.compress(stream.getvalue(), 1)


def read_expected(data: bytes) -> dict[str, Array]:
    """Read the arrays of ``pack_expected`` by name, without SymPy and without the equations."""
    with np.load(io.BytesIO(zlib.decompress(data)), allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def expected_numbers(equations: Equations, states: int = STATES) -> dict[str, Array]:
    """Evaluate what every function of a package has to return in so many random states.

    Returns:
        "p" and "h", (size,): parameters and what is precomputed from them, whose tolerances are "h near", (1, size).
        "q", "v" and so on, (states, size): inputs.  "frames": indices of frames.
        By the name of each function what it returns, (states, count), of a function of a frame (frames, states, count);
        of a rollout the accelerations of its first step from rest.  "NAME near": tolerances.  "NAME status", (states,):
        PASSES, FAILS or UNCERTAIN.  "NAME places" and "NAME weights" as in ``Answer``.
    """
    with np.errstate(all="ignore"):
        found = _Reference(equations, states).arrays()
    return {name: np.asarray(array) for name, array in found.items()}


def within(wanted: Array, near: Array, dtype: str) -> Array:
    """Return by how much a compiled number may differ from one that is wanted; infinite where it is not compared."""
    known, info = np.isfinite(wanted) & np.isfinite(near), np.finfo(dtype)
    return np.where(known, near + ROUNDING * float(info.eps) * np.abs(wanted) + float(info.tiny), np.inf)


class _Reference:
    """Lanes are the states, then copies of the first state, then those of the second one, and so on."""

    def __init__(self, equations: Equations, states: int) -> None:
        self.equations, self.model, self.dtype = equations, equations.model, equations.dtype
        dtype = self.dtype
        rng, copies = np.random.default_rng(1), states * COPIES
        off = UNITS * float(np.finfo(dtype).eps) * rng.uniform(-1.0, 1.0, (_ROWS, copies))
        self.rounding = np.concatenate([np.ones((_ROWS, states)), 1.0 + off], axis=1)
        known = signatures_of(equations.model)
        self.functions = [x for x in functions(equations.kernels, known) if x.kind != "gradient"]
        sizes = equations.interface["shapes"]
        read = sorted({*INPUTS & sizes.keys()} | {array for x in self.functions for array in x.signature.reads})
        self.states = {name: _random(rng, (states, int(np.prod(sizes[name])))).astype(dtype) for name in read}
        values = np.array(list(self.model.parameters.values()))
        values = values * (1.0 + 0.1 * rng.uniform(-1.0, 1.0, values.shape))
        self.p = np.concatenate([values, np.zeros(len(self.model.turning))]).astype(dtype)
        copied = [*range(states), *np.repeat(np.arange(states), COPIES)]
        self.inputs = {name: array[copied].T for name, array in self.states.items()}
        p = np.repeat(self.p[:, np.newaxis], len(copied), axis=1)
        setup = evaluate_lanes(equations.setup, {"p": p}, dtype, rounding=self.rounding)
        self.setup = setup.get("h", np.zeros((0, len(copied)), dtype))
        self.h = self.setup[:, 0]
        self.known: dict[str, dict[str, Array]] = {}

    def arrays(self) -> dict[str, Any]:
        """Return all arrays of ``read_expected``."""
        found: dict[str, Any] = {**self.states, "p": self.p, "h": self.h, "h near": _tolerances(self.setup)[0]}
        frames = found["frames"] = sorted({0, len(self.model.frames) // 2, len(self.model.frames) - 1})
        for function in self.functions:
            if function.is_framed:
                answers = [Answer(FRAMED[function.signature.writes](self, function.kernel, frame)) for frame in frames]
            else:
                answers = [answer for answer in [self._answer(function)] if answer is not None]
            if not answers:
                continue
            numbers, near = ([x[kind] for x in map(_measured, answers)] for kind in (0, 1))
            name, [first, *_] = function.name, answers
            found[name], found[f"{name} near"] = (x if function.is_framed else x[0] for x in (numbers, near))
            found[f"{name} status"] = self._status(first.pivots)
            if first.places is not None:
                found[f"{name} places"], found[f"{name} weights"] = first.places, first.weights
        return found

    def run(self, name: str, **changed: Array) -> dict[str, Array]:
        """Return what a program writes, with some of its inputs changed."""
        if name in self.known and not changed:
            return self.known[name]
        found = self.evaluate(self.equations.programs[name], **changed)
        if not changed:
            self.known[name] = found
        return found

    def evaluate(self, program: Program, **changed: Array) -> dict[str, Array]:
        """Return what a program writes, with some of its inputs changed."""
        inputs = {**self.inputs, **changed, "h": self.h}
        found = evaluate_lanes(program, inputs, self.dtype, rounding=self.rounding)
        found.setdefault("out", np.zeros((0, self.rounding.shape[1]), self.dtype))
        return found

    def accelerations(self, calls: tuple[str, ...], dtype: str, **changed: Array) -> dict[str, Array]:
        """Return what the program of accelerations among ``calls`` writes at changed inputs, in any dtype."""
        name = next(x for x in calls if SIGNATURES[x].solves and SIGNATURES[x].reads == ("q", "v", "u"))
        inputs = {key: array.astype(dtype) for key, array in {**self.inputs, **changed, "h": self.h}.items()}
        found = evaluate_lanes(self.equations.programs[name], inputs, dtype, rounding=self.rounding)
        return {**found, "out": found["out"][: self.model.size]}

    def _answer(self, function: Function) -> Answer | None:
        """Return what a function has to return; None where only the test suite checks it."""
        name, signature = function.name, function.signature
        calls = self.equations.calls.get(name)
        if calls is None:
            found = self.run(name)
            return Answer(found["out"], found.get("pivot"))
        if function.is_rollout:
            return _first_step(self, calls)
        if signature.columns_of:
            return _contracted(self, signature.columns_of)
        if signature.writes == "derivatives":
            return _acceleration_derivatives(self, calls)
        if not is_joined(self.model, name):
            return None
        found = self.evaluate(whole_program(self.model, name, self.equations.programs.__getitem__))
        pivots = (self.run(call).get("pivot") for call in calls if SIGNATURES[call].solves)
        return Answer(found["out"], next(pivots, None))

    def _status(self, pivots: Array | None) -> Array:
        states = _states_of(self.rounding)
        if pivots is None:
            return np.full(states, PASSES)
        limit = pivots.dtype.type(PIVOT_LIMITS[self.dtype])
        fails = ~(pivots[::2] > limit * pivots[1::2]).all(axis=0)
        copies = fails[states:].reshape(states, COPIES)
        certain = (copies == fails[:states, np.newaxis]).all(axis=1)
        return np.where(certain, np.where(fails[:states], FAILS, PASSES), UNCERTAIN)


def _random(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Draw numbers of both signs, between 1/4 and 1 in size."""
    return np.asarray(rng.uniform(0.25, 1.0, shape) * rng.choice((-1.0, 1.0), shape))


def _states_of(lanes: Array) -> int:
    """Count the states of lanes, (..., states and their copies)."""
    return int(lanes.shape[-1]) // (1 + COPIES)


def _measured(answer: Answer) -> tuple[Array, Array]:
    near, states = _tolerances(answer.numbers), _states_of(answer.numbers)
    if answer.error is not None:
        near += np.abs(answer.error[:, :states].T)
    return answer.numbers[:, :states].T, near


def _tolerances(lanes: Array) -> Array:
    """Return tolerances (states, count) of numbers (count, lanes); infinity where a state or a copy is not finite."""
    wide, states = lanes.astype(np.float64), _states_of(lanes)
    copies = wide[:, states:].reshape(len(wide), states, COPIES)
    off = np.abs(copies - wide[:, :states, np.newaxis]).max(axis=2)
    near: Array = SAFETY * np.where(np.isfinite(off), off, np.inf)
    return near.T


def _contracted(of: _Reference, column: str) -> Answer:
    """Contract a tensor with a velocity: what the program of a column gives there, which is linear in it."""
    n, v = len(of.model.coordinates), of.states["v"][0]
    C = of.run(column, v=np.repeat(v[:, np.newaxis], of.rounding.shape[1], axis=1))["out"]
    return Answer(C, places=np.arange(n**3).reshape(n * n, n), weights=v)


def _acceleration_derivatives(of: _Reference, calls: tuple[str, ...]) -> Answer | None:
    """Take the derivative along a direction of all inputs by central differences in double precision.

    Copies are rounded alike on both sides, so that their derivatives differ as those of rounded programs; what the two
    sides themselves are rounded off by, divided by their distance, is added.  Where rows of constraints are redundant
    no random state fulfils them, and what the function returns there is not a derivative.
    """
    n = of.model.size  # of rates
    closing = next((x for x in calls if SIGNATURES[x].writes == "closing"), None)
    if closing is not None and not _rows_are_independent(of, closing):
        return None
    names = [name for name in ("q", "v", "z", "u", "forces") if name in of.states]
    moved = {name: np.asarray(of.states[name][0], np.float64) for name in names}

    def difference(step: float) -> tuple[Array, Array]:
        ahead, back = (
            of.accelerations(calls, "float64", **{x: of.inputs[x] + s * d[:, np.newaxis] for x, d in moved.items()})
            for s in (step, -step)
        )
        return np.asarray((ahead["out"] - back["out"]) / (2.0 * step)), ahead["out"]

    (fine, ahead), (coarse, _) = difference(INCREMENT), difference(2.0 * INCREMENT)
    places = np.arange(3 * n * n).reshape(3, n, n).transpose(1, 0, 2).reshape(n, 3 * n)
    pivots = of.accelerations(calls, of.dtype).get("pivot")
    error = np.abs(fine - coarse)
    sizes = float(np.finfo(np.float64).eps) * (np.abs(ahead) + np.abs(fine))  # of inputs that are rounded, and results
    states = _states_of(ahead)
    error[:, :states] += (_tolerances(ahead).T / SAFETY + sizes[:, :states]) / INCREMENT
    if closing is not None:  # whose matrix is factored with more on its diagonal
        error += DAMPED[of.dtype] * np.abs(fine).max(axis=0)
    return Answer(fine, pivots, error, places, np.concatenate(_columns(of.model, moved)))


def _columns(model: Model, moved: Mapping[Any, Array]) -> Array:
    """Return changes of arrays by the columns of derivatives by q, by v and z, and by u and forces, (3, n + m)."""
    n, columns = len(model.coordinates), np.zeros((3, model.size))
    columns[:, :n] = [moved[name] for name in "qvu"]
    if "z" in moved:
        columns[1, n:] = moved["z"]
    if "forces" in moved:
        columns[2, [states[0] for states in model.drives.values()]] = moved["forces"]
    return columns


def _rows_are_independent(of: _Reference, closing: str) -> bool:
    """Return whether rows of the constraints' Jacobian that do not vanish are independent in all states."""
    n, m, lanes, at = len(of.model.coordinates), len(of.model.constraints), of.rounding.shape[1], 0
    D = of.run(closing, a=np.zeros((n, lanes)), multipliers=np.zeros((m, lanes)))["out"]
    states = _states_of(of.rounding)
    J = np.zeros((states, m, n))
    for block in row_blocks(of.model):
        rows = D[at : at + block.size, :states].T.reshape(states, block.rows, -1)
        J[:, block.first : block.first + block.rows, list(block.columns)] = rows
        at += 3 * block.size + len(block.columns) ** 2
    J[:, :, list(of.model.prescribed)] = 0.0
    return bool((np.linalg.matrix_rank(J) == (J != 0.0).any(axis=2).sum(axis=1)).all())


def _first_step(of: _Reference, calls: tuple[str, ...]) -> Answer | None:
    """Return the accelerations from rest, by which velocities change in a very short step of every method."""
    if of.model.constraints:
        return None  # states are projected onto the constraints first
    rest = {name: np.zeros_like(of.inputs[name]) for name in ("v", "z") if name in of.inputs}
    found = of.accelerations(calls, of.dtype, **rest)
    return Answer(found["out"], found.get("pivot"))


def _frame_pose(of: _Reference, kernel: str, frame: int) -> Array:
    k = of.run(kernel)["out"]
    last = np.zeros((4, k.shape[1]), k.dtype)
    last[3] = 1.0
    return np.concatenate([k[12 * frame : 12 * frame + 12], last])


def _frame_jacobian(of: _Reference, kernel: str, frame: int) -> Array:
    k, n = of.run(kernel)["out"], len(of.model.coordinates)
    out = np.zeros((6, n, k.shape[1]), k.dtype)
    for s, column in jacobian_columns(of.model, k, frame).items():
        for i, entry in enumerate(column):
            out[i, s] = entry
    return out.reshape(6 * n, -1)


FRAMED: Mapping[str, Callable[[_Reference, str, int], Array]] = {  # by the arrays that functions of a frame write
    "pose": _frame_pose,
    "jacobian": _frame_jacobian,
}
