"""Bounds of rounding errors of methods that solve equations, by their names."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from ..calls import Calls
from ..raw import Array
from .equations_of_motion import (
    States,
    closed_accelerations,
    closed_drives,
    in_chunks,
    linear_errors,
    tree_accelerations,
)
from .extended import EPS, IN_EXTENDED, Extended, distance
from .solution_errors import SolutionErrors

Bounds = SolutionErrors
Arrays = Mapping[str, Array]


def _is_closed(calls: Calls) -> bool:
    return bool(calls.raw.libraries.meta.get("constraints"))


def _constrained(calls: Calls, arrays: Arrays) -> Array:
    """Return accelerations and multipliers of a closed mechanism, (N, n + m)."""
    args = [arrays[x] for x in "qvu"]
    if "constrained_dynamics" in calls.raw.functions:
        return calls.run("constrained_dynamics", None, args)[:, : calls.n + calls.raw.shapes["multipliers"][0]]
    return np.concatenate([calls.run(name, None, args) for name in ("forward_dynamics", "constraint_forces")], axis=1)


def _accelerations(calls: Calls, name: str, arrays: Arrays, value: Array) -> Bounds:
    """Bound accelerations, with loops closed or of a tree."""
    states = States(calls, arrays)
    if not _is_closed(calls) or name.startswith("tree_"):
        return in_chunks(states, (value,), tree_accelerations)
    solution = _constrained(calls, arrays)
    found = in_chunks(states, (solution,), closed_accelerations)
    return Bounds(found.bound[:, : calls.n], found.proved)


def _multipliers(calls: Calls, name: str, arrays: Arrays, value: Array) -> Bounds:
    """Bound constraint forces under drives."""
    solution = _constrained(calls, arrays)
    found = in_chunks(States(calls, arrays), (solution,), closed_accelerations)
    return Bounds(found.bound[:, calls.n :], found.proved)


def _driving(calls: Calls, arrays: Arrays) -> tuple[Array, Bounds]:
    """Return drives of a closed mechanism's motion and its multipliers, (N, n + m), with their bounds."""
    still = np.zeros(calls.n, calls.dtype)
    solution = calls.run("constrained_drives", None, [*(arrays[x] for x in "qva"), still])
    n, m = calls.n, calls.raw.shapes["multipliers"][0]
    u, multipliers = solution[:, :n], solution[:, n : n + m]
    return solution[:, : n + m], in_chunks(States(calls, arrays), (u, multipliers), closed_drives)


def _drives(calls: Calls, name: str, arrays: Arrays, value: Array) -> Bounds:
    """Bound drives of a closed mechanism's motion."""
    _, found = _driving(calls, arrays)
    return Bounds(found.bound[:, : calls.n], found.proved)


def _reactions(calls: Calls, name: str, arrays: Arrays, value: Array) -> Bounds:
    """Bound joint reaction wrenches, or those of cut joints, of a closed mechanism's motion."""
    solution, found = _driving(calls, arrays)
    n = calls.n
    tree, function = ("tree_reactions", "closing_reactions") if name == "reactions" else ("", "loop_wrenches")
    parts = []
    for place, states in States(calls, arrays).chunks():
        multipliers = solution[place, np.newaxis, n:]
        m = multipliers.shape[2]
        points = np.broadcast_to(np.eye(m, dtype=calls.dtype), (states.count, m, m))
        of_cuts, columns, zero = (
            _flat(states.run(f"{function}{IN_EXTENDED}", multipliers=np.ascontiguousarray(x)))
            for x in (multipliers, points, np.zeros_like(multipliers))
        )
        exact = of_cuts
        if tree:
            of_tree = _flat(states.run(f"{tree}{IN_EXTENDED}"))
            exact = of_cuts - Extended(-of_tree.high, -of_tree.low, of_tree.bound)
        own = distance(value[place].reshape(states.count, -1), exact.at(slice(None), 0))
        more = linear_errors(columns, zero, found.bound[place, n:])
        parts.append((own + more) * (1.0 + EPS))
    return Bounds(np.concatenate(parts), found.proved)


def _flat(found: Extended) -> Extended:
    """Return results of points, (N, P, rows, 6), as (N, P, results)."""
    return Extended(*(x.reshape(*x.shape[:2], -1) for x in found))


SOLVED: Mapping[str, Callable[[Calls, str, Arrays, Array], Bounds]] = {
    "forward_dynamics": _accelerations,
    "tree_forward_dynamics": _accelerations,
    "constraint_forces": _multipliers,
    "inverse_dynamics": _drives,
    "reactions": _reactions,
    "loop_reactions": _reactions,
}
