"""Refusals of closed mechanisms, in words: loops that are open or opening, and drives that do not hold them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from .raw import DERIVED, Array, RawKernel

Ask = Callable[[str], "Array | None"]  # what a function gives by its diagnosis; None where the kernel has none

LOADED = "_under_load"  # ends the names of functions that methods call where there are wrenches
KINDS = (  # of violations: what it is, per which time, and what is allowed
    ("is open", "", "q of kernel.assemble"),
    ("is opening", "/s", "v of kernel.project_velocity"),
    ("opens at the accelerations", "/s^2", "those of a motion that keeps it closed"),
)


def loop_error(
    raw: RawKernel, name: str, reason: int, place: str, arguments: Mapping[str, Array], ask: Ask
) -> LoopError:
    """Return the error that says why a function refuses a state of a closed mechanism, or a motion.

    Args:
        reason: behind those of the coordinates' pivots, as ``RawKernel.statuses`` counts them.
        place: what follows, such as " in state 3".
        arguments: of the function, for that state alone.
    """
    name = name.removesuffix(LOADED)
    called = raw.functions.get(name)
    tree = ", or cut=True for the open tree" if called and ("cut" in called.takes or called.kind in DERIVED) else ""
    names = raw.libraries.meta["constraints"]
    kind, row = divmod(reason, len(names))
    if kind >= len(KINDS):
        return _not_held(raw, f"{name}: {raw.name}", reason - len(KINDS) * len(names), place, ask, tree)
    what, per, allowed = KINDS[kind]
    component, violation = names[row], _violation(ask, arguments, kind, row)
    loop = component.partition(".")[0]
    return LoopError(
        f"{name}: {raw.name}: {_kind(component)} {loop} {what}{place}: {component} is left with"
        f" {violation:.3g} {_unit(raw, component)}{per}; allowed: {allowed}{tree}",
        loop=loop,
        gap=violation,
    )


def _violation(ask: Ask, arguments: Mapping[str, Array], kind: int, row: int) -> float:
    """Return the size of a component of the constraint, of its rate, or of its acceleration; NaN if unknown."""
    g = ask("gap" if kind == 0 else "gap_rows")
    bias = ask("gap_bias") if kind == 2 else None
    if g is None or (kind == 2 and bias is None):
        return math.nan
    violation = g[row] if kind == 0 else g[row] @ arguments["va"[kind - 1]]
    return abs(float(violation if bias is None else violation + bias[row]))


def _not_held(raw: RawKernel, title: str, i: int, place: str, ask: Ask, tree: str) -> LoopError:
    """Return the error that says that a coordinate without a drive needs a force."""
    meta = raw.libraries.meta
    coordinates, m = meta["coordinates"], len(meta["constraints"])
    driven = [x for k, x in enumerate(coordinates) if k in meta["driven"] or x in meta["prescribed"]]
    drives, jacobian = ask("drives"), ask("gap_rows")
    left = math.nan if drives is None else float(np.abs(drives[len(coordinates) + 5 * m :][: len(coordinates)]).max())
    loop, freedoms = meta["constraints"][0].partition(".")[0], ""
    if jacobian is not None:
        moving = [k for k, x in enumerate(coordinates) if x not in meta["prescribed"]]
        sizes = np.linalg.svd(jacobian[:, moving], compute_uv=False)
        rank = np.count_nonzero(sizes > sizes.max(initial=0.0) * math.sqrt(np.finfo(raw.dtype).eps))
        freedoms = f"{len(moving) - rank} "
        loop = meta["constraints"][int(np.abs(jacobian[:, i]).argmax())].partition(".")[0]
    return LoopError(
        f"{title}: drives at {', '.join(driven) or 'none'} cannot make this motion{place}: {left:.3g} N or N m are left"
        f" at {coordinates[i]}; allowed: drives that hold all {freedoms}degrees of freedom{tree}",
        loop=loop,
        gap=left,
    )


def singular_loop(raw: RawKernel, jacobian: Array, elsewhere: Array) -> str:
    """Say which loop is at a singular pose, and what is allowed.

    Args:
        jacobian: of the constraint there, (m, n).
        elsewhere: at any other state, which shows the rows that vanish in all of them, (m, n).
    """
    meta = raw.libraries.meta
    moving = [k for k, x in enumerate(meta["coordinates"]) if x not in meta["prescribed"]]
    kept = np.flatnonzero(np.abs(elsewhere[:, moving]).max(axis=1) > 0.0)
    left, sizes, _ = np.linalg.svd(jacobian[kept][:, moving])
    shares = np.abs(left[:, sizes.size - 1])
    component = meta["constraints"][kept[int(shares.argmax())]]
    return (
        f"{_kind(component)} {component.partition('.')[0]} is at a singular pose, or within round-off of one, where its"
        f" constraints, independent elsewhere, do not determine its forces ({component}); allowed: poses beside it, or"
        " cut=True for the open tree"
    )


def left_open(raw: RawKernel, violations: NDArray[Any], what: str, allowed: str, per: str = "") -> LoopError:
    """Return the error that names the loop with the greatest constraint violation.

    Args:
        violations: of all components of the constraint, (constraints,): m or rad, or their derivatives by time.
        what, allowed: what is wrong with the loop, and what would not be.
        per: "" or the unit of time that the violations are by, such as "/s".
    """
    worst = int(np.abs(violations).argmax())
    component = raw.libraries.meta["constraints"][worst]
    loop, violation, unit = component.partition(".")[0], float(abs(violations[worst])), _unit(raw, component) + per
    return LoopError(
        f"{raw.name}: {_kind(component)} {loop} {what}: {component} is left with {violation:.3g} {unit};"
        f" allowed: {allowed}",
        loop=loop,
        gap=violation,
    )


def stays_open(raw: RawKernel, row: int) -> str:
    """Say which loop a step could not close again."""
    names = raw.libraries.meta["constraints"]
    component = names[row % len(names)]
    return f"{_kind(component)} {component.partition('.')[0]} does not stay closed at {component}"


def _kind(component: str) -> str:
    return "loop" if "." in component else "coupling"


def _unit(raw: RawKernel, component: str) -> str:
    """Return the unit of a component of the constraint: of a coupling that of the coordinate that follows."""
    name = raw.libraries.meta.get("couplings", {}).get(component, component)
    return "m" if name.rpartition(".")[2] in ("x", "y", "z") else "rad"
