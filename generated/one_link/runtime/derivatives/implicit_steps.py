"""How far the state after a linearly implicit step is from the one that the step's equations have without rounding."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..calls import Calls
from ..raw import Array
from ..stepping.many_steps import rollout
from ..stepping.options import Control, StepOptions
from ..stepping.rollouts import Inputs
from .equations_of_motion import States, in_chunks, solved
from .extended import EPS, IN_EXTENDED, Extended
from .solution_errors import SolutionErrors

STEP_RESIDUAL = f"step_residual{IN_EXTENDED}"


def bounded_step(calls: Calls, q: ArrayLike, v: ArrayLike, u: ArrayLike, dt: float) -> tuple[Array, SolutionErrors]:
    """Take a step of states under held drives, (n,) or (N, n) each, and bound its errors.

    Args:
        dt: length of the step, s.

    Returns:
        q and v after it, (2, n) or (N, 2, n), and bounds of states (N, 2 n).
    """
    moved = rollout(calls, Inputs(q, v, u, Control()), StepOptions("implicit", dt, 1))
    value = np.stack([x[..., 1, :] for x in moved], axis=-2)

    def states(label: str, array: ArrayLike) -> Array:
        """Return an array of all states, (N, n)."""
        given = calls.array(label, array, (calls.n,))[0]
        return np.ascontiguousarray(np.broadcast_to(given, (*value.shape[:-2], calls.n))).reshape(-1, calls.n)

    arrays = {label: states(label, x) for label, x in (("q", q), ("v", v), ("u", u))}
    arrays["step_length"] = np.full((len(arrays["q"]), 1), dt, calls.dtype)
    end = (np.ascontiguousarray(x).reshape(-1, calls.n) for x in (value[..., 0, :], value[..., 1, :]))
    return value, in_chunks(States(calls, arrays), tuple(end), _step_errors)


def _step_errors(states: States, q: Array, v: Array) -> SolutionErrors:
    """Bound the errors of coordinates and rates, (N, n) each, after a step of some states."""

    def left(points: Array) -> Extended:
        """Return both rows of states at the end, q as it is."""
        return states.run(STEP_RESIDUAL, end_q=np.broadcast_to(q[:, np.newaxis], points.shape), end_v=points)

    rates = solved(lambda points: left(points).at(..., 0, slice(None)), v, states)
    moved, of_moved = left(np.ascontiguousarray(v[:, np.newaxis])).at(slice(None), 0, 1).rounded
    dt = states.arrays["step_length"].astype(np.float64)
    coordinates = (np.abs(moved) + of_moved + dt * rates.bound) * (1.0 + 4.0 * EPS)
    return SolutionErrors(np.concatenate([coordinates, rates.bound], axis=1), rates.proved)
