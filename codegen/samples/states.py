"""States that samples are taken in: ordinary and small numbers, denormal ones, infinities, and what is no number.

Coordinates are chosen so that the polynomials of the generated C round the sines and cosines of all angles correctly,
as any good library does; then all that computes them has the same bits.
"""

from __future__ import annotations

import numpy as np

from ..kernels.derived import is_direction
from ..kernels.equations import Equations
from ..kernels.signatures import SIGNATURES, shapes
from ..program.ir import Instruction, Program, select
from .arithmetic import Arithmetic, Array
from .rounding import telling_lanes
from .sines import polynomials
from .stored import ROUNDED, STATES

Angle = tuple[Instruction, ...]

READ = (
    "v",
    "a",
    "u",
    "wrench",
    "multipliers",
)  # arrays of numbers that may be anything
_CANDIDATES = 128  # numbers that coordinates are chosen from
_SOLVED = 3  # rows of a chart
_SLOPE = 2.0**-5  # of a chart, at most: what it changes coordinates by leaves its columns independent
_SMALL = 2.0**-12
_TINY = {"float64": 2.0**-1040, "float32": 2.0**-140}  # denormal, and so are its products with ordinary numbers


def sample_inputs(equations: Equations, arithmetic: Arithmetic) -> tuple[dict[str, Array], bool]:
    """Return arrays (size, states) that kernels read, by name; and whether all angles have bits for sure."""
    rng, dtype, size = np.random.default_rng(1), arithmetic.dtype, shapes(equations.model)
    wanted = {array for name in (*equations.kernels, *equations.programs) for array in SIGNATURES[name].reads}
    tiny = _TINY[str(dtype)]
    q, exact = _coordinates(equations, arithmetic, rng)
    inputs, many = {"q": q}, {"q": _other_coordinates(equations, q, rng)}
    for name in sorted(x for x in wanted if x in size and (x in READ or is_direction(x))):
        x = _numbers(rng, int(np.prod(size[name])), 1)[:, 0]
        columns = (x, _numbers(rng, x.size, 1)[:, 0] * _SMALL, x * tiny, np.copysign(np.inf, x), x * np.nan)
        inputs[name] = np.stack(columns, axis=1).astype(dtype)
        many[name] = _numbers(rng, x.size, _CANDIDATES).astype(dtype)
    described = [*equations.model.parameters.values(), *(0.0 for _ in equations.model.turning)]
    values = np.array(described).astype(dtype)[:, None]
    h = arithmetic.run(equations.setup, {"p": values}, rounding=False).get("h", values)
    if "chart" in wanted:
        inputs["chart"], many["chart"] = _charts(equations, arithmetic, {"q": q[:, :1], "h": h})
    lanes = telling_lanes(list(equations.programs.values()), {**many, "h": h}, arithmetic, ROUNDED)
    return {name: np.concatenate([array, many[name][:, lanes]], axis=1) for name, array in inputs.items()}, exact


def _charts(equations: Equations, arithmetic: Arithmetic, state: dict[str, Array]) -> list[Array]:
    """Choose one chart (size, states) for all states and candidates: rows of J with independent columns."""
    size = shapes(equations.model)
    (m, n), (whole,) = size["constraint_rows"], size["chart"]
    J = arithmetic.run(equations.programs["constraint_jacobian"], state, rounding=False)["out"][:, 0].reshape(m, n)
    left, chart = J.astype(np.float64), np.zeros((whole, 1), arithmetic.dtype)
    chart[n + m + 1 :] = _numbers(np.random.default_rng(2), whole - n - m - 1, 1) * _SLOPE
    for _ in range(_SOLVED):
        row, column = divmod(int(np.abs(left).argmax()), n)
        if not abs(left[row, column]) > 1e-3:
            break
        chart[column], chart[n + row] = 1.0, 1.0
        left -= np.outer(left[:, column], left[row] / left[row, column])
    return [np.repeat(chart, count, axis=1) for count in (len(STATES) - ROUNDED, _CANDIDATES)]


def sample_parameters(values: Array, dtype: np.dtype[np.floating]) -> Array:
    """Return parameters (size, states); those of the first state are the description's."""
    tiny = _TINY[str(dtype)]
    columns = (values, values * _SMALL, np.sign(values) * tiny, values * np.inf, values * np.nan)
    parameters: Array = (
        np.stack([*columns, *[values] * ROUNDED], axis=1).reshape(len(values), len(STATES)).astype(dtype)
    )
    return parameters


def _numbers(rng: np.random.Generator, size: int, count: int) -> Array:
    """Draw numbers (size, count) of both signs, between 1/4 and 1 in size."""
    numbers: Array = rng.uniform(0.25, 1.0, (size, count)) * rng.choice((-1.0, 1.0), (size, count))
    return numbers


def _coordinates(equations: Equations, arithmetic: Arithmetic, rng: np.random.Generator) -> tuple[Array, bool]:
    n, dtype, exact = equations.model.size, arithmetic.dtype, True
    candidates = np.concatenate(
        [
            _numbers(rng, n, _CANDIDATES),
            _numbers(rng, n, _CANDIDATES) * _SMALL,
            _numbers(rng, n, 1) * _TINY[str(dtype)],
        ],
        axis=1,
    ).astype(dtype)
    good, shared = np.ones(candidates.shape, np.bool_), list[tuple[Program, list[int]]]()
    for angle in _angles(equations):
        arrays = {i.leaf[0] for i in angle if i.op == "input"}
        if arrays != {"q"}:
            exact = False  # nobody knows which parameters there will be
            continue
        places = [i.leaf[1] for i in angle if i.op == "input"]
        program = Program("angle", angle, {("out", 0): len(angle) - 1})
        if len(places) > 1:
            shared.append((program, places))
            continue
        good[places[0]] &= _rounded_alike(program, arithmetic, candidates)
    q = np.zeros((n, len(STATES) - ROUNDED), dtype)
    for i in range(n):
        for state, begin in enumerate((0, _CANDIDATES)):
            suitable = np.flatnonzero(good[i, begin : begin + _CANDIDATES])
            exact &= suitable.size > 0
            q[i, state] = candidates[i, begin + (suitable[0] if suitable.size else 0)]
        q[i, 2] = candidates[i, -1] if good[i, -1] else q[i, 0]
        q[i, 3:] = q[i, 0], np.nan
    return q, exact and _chosen_together(q, shared, arithmetic, candidates, good)


def _rounded_alike(program: Program, arithmetic: Arithmetic, q: Array) -> Array:
    """Say of columns of coordinates (n, columns) whether polynomials have the library's bits for an angle."""
    angles = arithmetic.run(program, {"q": q}, rounding=False)["out"][0]
    pairs = zip(arithmetic.turn(angles), polynomials(angles), strict=True)
    alike = [(one == other) & (np.signbit(one) == np.signbit(other)) for one, other in pairs]
    return np.asarray(alike[0] & alike[1])


def _chosen_together(
    q: Array, angles: list[tuple[Program, list[int]]], arithmetic: Arithmetic, candidates: Array, good: Array
) -> bool:
    """Choose coordinates (n, states) anew where angles of several of them are not rounded alike; False if none are.

    Args:
        angles: programs of these angles, and the coordinates of each.
        candidates, good: numbers to choose from, (n, candidates), and which of them suit angles of one coordinate.
    """
    for state, begin in enumerate((0, _CANDIDATES)):
        for trial in range(_CANDIDATES):
            wrong = [i for x, places in angles if not _rounded_alike(x, arithmetic, q[:, [state]])[0] for i in places]
            if not wrong:
                break
            for i in sorted(set(wrong)):
                suitable = np.flatnonzero(good[i, begin : begin + _CANDIDATES])
                if suitable.size:
                    q[i, state] = candidates[i, begin + suitable[(trial * (i + 1) + 1) % suitable.size]]
        else:
            return False
    for _ in angles:  # of denormal numbers, products vanish, and sines of zeros have the sign that the polynomial gives
        for program, places in angles:
            if not _rounded_alike(program, arithmetic, q[:, [2]])[0]:
                q[places, 2] = q[places, 0]
    q[:, 3] = q[:, 0]
    return all(_rounded_alike(program, arithmetic, q[:, [2]])[0] for program, _ in angles)


def _other_coordinates(equations: Equations, q: Array, rng: np.random.Generator) -> Array:
    """Draw candidates (n, candidates) that differ in the coordinates of which nobody takes a sine."""
    taken = {i.leaf[1] for angle in _angles(equations) for i in angle if i.op == "input" and i.leaf[0] == "q"}
    others = _numbers(rng, len(q), _CANDIDATES).astype(q.dtype)
    for place in taken:
        others[place] = q[place, 0]
    return others


def _angles(equations: Equations) -> set[Angle]:
    """Return instructions of all angles whose sines are taken, one for each."""
    return {
        select("angle", program.instructions, {("out", 0): index}, {}).instructions
        for program in equations.programs.values()
        for index in {i.args[0] for i in program.instructions if i.op in ("sin", "cos")}
    }
