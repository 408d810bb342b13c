"""Calls that move a generated package's robot in every way: run by themselves, so that a sanitizer can watch them.

``python watched_calls.py FOLDER NAME RESULTS`` imports NAME from FOLDER, moves states that STATES holds by the whole
kernel of its libraries, and writes what comes back to RESULTS.  States of a batch have the bits that they have alone:
that is checked.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import eomgen
from eomgen.errors import IntegrationStopped

Array = NDArray[Any]
STATES = "states.npz"  # beside the package: q, v and u, (N, n) each, and z, (N, m); the first CALM are slow
CALM = 3
METHODS = ("rk4", "implicit", "rosenbrock", "tsit5", "radau")
FIXED = ("rk4", "implicit")
WAYS = {"rk4": "explicit", "implicit": "implicit", "rosenbrock": "rosenbrock", "tsit5": "explicit"}
CALLS = ("forward_dynamics", "inverse_dynamics", "forward_dynamics_jacobian")


def ways_to_move(kernel: Any, n: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """Names and arguments of rollouts: every method that the package has, without gains and with them."""
    driven = np.zeros(n)
    driven[list(kernel.raw.libraries.meta["driven"])] = 1.0
    gains = {"kp": 3.0 * driven, "kd": 0.2 * driven, "target": 0.1 * driven}
    has_radau = "radau_rollout" in kernel.raw.rollouts
    for method, controlled in product(METHODS if has_radau else METHODS[:-1], (False, True)):
        how: dict[str, Any] = {"dt": 1e-4, "steps": 6, "every": 2}
        if method not in FIXED:
            how = {"duration": 0.3, "samples": 2, "rtol": 1e-4}
        yield f"{method}{'_held' if controlled else ''}", {"method": method, **how, **(gains if controlled else {})}


def loss(t: Array, *states: Array) -> tuple[Any, ...]:
    """A sum of squares with its derivatives."""
    return float(sum((x * x).sum() for x in states)), *(2.0 * x for x in states)


def rolled(kernel: Any, q: Array, v: Array, u: Array, z: Array, **how: Any) -> Array:
    """States of a rollout, (..., 2n + m), or as far as it went."""
    try:
        found = kernel.rollout(q, v, u, z=z, **how)
    except IntegrationStopped as error:
        found = error.stored
    arrays = (*found, found.z) if z.size else found
    return np.concatenate([x.reshape(*q.shape[:-1], -1, x.shape[-1]) for x in arrays], axis=-1)


def moved(kernel: Any, q: Array, v: Array, u: Array, z: Array) -> dict[str, Array]:
    """Return all that the calls return, by names of calls."""
    found: dict[str, Array] = {}
    for name, how in ways_to_move(kernel, q.shape[1]):
        count = CALM if how["method"] in FIXED else len(q)  # where a state of such a batch fails, all of it ends
        many = found[name] = rolled(kernel, q[:count], v[:count], u[:count], z[:count], **how)
        for i in range(count):
            alone = rolled(kernel, q[i], v[i], u[i], z[i], **how)
            here = many[i]
            if how["method"] in FIXED:  # whose batch ends where the first of its states does
                reached = ~np.isnan(here).any(axis=-1)
                alone, here = alone[reached], here[reached]
            assert np.array_equal(here, alone, equal_nan=True), f"{name}: state {i} has other bits in a batch"
        calm = tuple(x[:CALM] for x in (q, v, u, z))
        found |= {f"{name}_{key}": x for key, x in differentiated(kernel, calm, how).items()}
    q, v, u, z = (x[:CALM] for x in (q, v, u, z))
    if kernel.constraints:  # states are nearly closed: the end of a step is closed
        q, v = (x[:, -1] for x in kernel.rollout(q, v, u, 1e-9, 1))
    for name in CALLS:
        if name in kernel.raw.functions:
            call = getattr(kernel if hasattr(kernel, name) else kernel.functions, name)
            results = called(call, q, v, u, z=z)
            for i in range(len(q)):
                alone = called(call, q[i], v[i], u[i], z=z[i])
                assert all(np.array_equal(x[i], y) for x, y in zip(results, alone, strict=True)), f"{name}: state {i}"
            found |= {f"{name}_{k}": x for k, x in enumerate(results)}
    return found


def called(call: Callable[..., Any], *state: Array, z: Array) -> tuple[Array, ...]:
    """Call a function and return its arrays."""
    found = call(*state, z=z)
    return found if isinstance(found, tuple) else (found,)


def differentiated(kernel: Any, state: tuple[Array, ...], how: Mapping[str, Any]) -> dict[str, Array]:
    """Return derivatives of a rollout by names, where the package has them."""
    found: dict[str, Array] = {}
    way, n, (*state_and_u, z) = WAYS.get(how["method"], "no"), state[0].shape[-1], state
    if f"{way}_gradient" in kernel.raw.gradients:
        value, by = kernel.rollout_gradient(*state_and_u, loss=loss, z=z, **how)
        found |= {"value": np.array(value), **{f"by_{key}": np.asarray(x) for key, x in by.items()}}
    if f"{way}_sensitivity" in kernel.raw.gradients:
        along = {"q": np.zeros((2, n)), "v": np.eye(2, n)}
        found["rates"] = np.concatenate(kernel.rollout_sensitivity(*state_and_u, along=along, z=z, **how)[1], axis=-1)
    return found


def main(folder: str, name: str, results: str) -> None:
    """Move the package's robot and write what comes back."""
    sys.path.insert(0, folder)
    kernel = eomgen.Kernel(importlib.import_module(name).kernel.raw.libraries)
    with np.load(Path(folder) / STATES) as states:
        np.savez(results, **moved(kernel, *(states[key] for key in "qvuz")))


if __name__ == "__main__":
    main(*sys.argv[1:])
