"""Loops that are open where they should be closed, as errors say it.

A generated package carries a copy of this file.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import LoopError
from .raw import RawKernel


def open_loop(raw: RawKernel, name: str, row: int, place: str, gap: float) -> LoopError:
    """The error that says that a function was asked about a state in which a loop is open, or opening.

    Args:
        raw: the functions.
        name: the function.
        row: of the constraint; as many more as there are constraints where its rate is meant.
        place: what follows, such as " in state 3".
        gap: m or rad, or per second.
    """
    component, loop, is_rate = _component(raw, row)
    unit = _unit(component) + ("/s" if is_rate else "")
    what = "is opening" if is_rate else "is open"
    allowed = "v of kernel.close_rates" if is_rate else "q of kernel.close"
    return LoopError(
        f"{name}: {raw.name}: {_kind(component)} {loop} {what}{place}: {component} is left with {gap:.3g} {unit};"
        f" allowed: {allowed}, or cut=True for the open tree",
        loop=loop,
        gap=gap,
    )


def left_open(raw: RawKernel, gaps: NDArray[Any], what: str, allowed: str, per: str = "") -> LoopError:
    """The error that names the loop with the greatest of the gaps.

    Args:
        raw: the functions.
        gaps: of all components of the constraint, (constraints,): m or rad, or their derivatives by time.
        what, allowed: what is wrong with the loop, and what would not be.
        per: "" or the unit of time that the gaps are by, such as "/s".
    """
    worst = int(np.abs(gaps).argmax())
    component, loop, _ = _component(raw, worst)
    gap = float(abs(gaps[worst]))
    return LoopError(
        f"{raw.name}: {_kind(component)} {loop} {what}: {component} is left with {gap:.3g} {_unit(component)}{per};"
        f" allowed: {allowed}",
        loop=loop,
        gap=gap,
    )


def stays_open(raw: RawKernel, row: int) -> str:
    """Say which loop a step could not close again."""
    component, loop, _ = _component(raw, row)
    return f"{_kind(component)} {loop} does not stay closed at {component}"


def _component(raw: RawKernel, row: int) -> tuple[str, str, bool]:
    """Name of the constraint of a row, its loop, and whether the row is that of its rate."""
    names = raw.libraries.meta["constraints"]
    component = names[row % len(names)]
    return component, component.partition(".")[0], row >= len(names)


def _kind(component: str) -> str:
    return "loop" if "." in component else "coupling"


def _unit(component: str) -> str:
    return "m" if component.rpartition(".")[2] in ("x", "y", "z") else "rad"
