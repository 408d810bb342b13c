"""Loops that are open where they should be closed, as errors say it.

A generated package carries a copy of this file.
"""

from __future__ import annotations

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
    unit = ("m" if component.rpartition(".")[2] in ("x", "y", "z") else "rad") + ("/s" if is_rate else "")
    what = "is opening" if is_rate else "is open"
    allowed = "v of kernel.close_rates" if is_rate else "q of kernel.close"
    return LoopError(
        f"{name}: {raw.name}: loop {loop} {what}{place}: {component} is left with {gap:.3g} {unit}; allowed: {allowed},"
        " or cut=True for the open tree",
        loop=loop,
        gap=gap,
    )


def stays_open(raw: RawKernel, row: int) -> str:
    """Say which loop a step could not close again."""
    component, loop, _ = _component(raw, row)
    return f"loop {loop} does not stay closed at {component}"


def _component(raw: RawKernel, row: int) -> tuple[str, str, bool]:
    """Name of the constraint of a row, its loop, and whether the row is that of its rate."""
    names = raw.libraries.meta["constraints"]
    component = names[row % len(names)]
    return component, component.partition(".")[0], row >= len(names)
