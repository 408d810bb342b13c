"""Bounds of rounding errors of a kernel's outputs, as a printable result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..shown import Shown
from .intervals import Array

PREMISES = (
    "rounding at generation adds at most 1e-12 relative and is not counted",
    "ranges are the caller's, of other inputs the defaults that the result's ranges name, and none is narrowed",
    "IEEE 754 arithmetic with denormal numbers; sines within 3 units in the last place, exp, log, atan2 within 2",
)
_LINES = 12  # outputs that are printed, those with the largest relative bounds first


@dataclass(frozen=True, kw_only=True, repr=False)
class RoundingBound(Shown):
    """Proved bounds of the rounding errors of the outputs of one kernel, over ranges, under ``PREMISES``.

    Attributes:
        robot, kernel: their names.
        dtype: of the numbers that the kernel computes with.
        outputs: names of the outputs, in the order of the flat result.
        bound: (outputs,), largest errors where every operation is rounded, as eomgen compiles by default; in the units
            of the outputs.  Infinite where there is no bound.
        fused: (outputs,), the same where the compiler may fuse products with sums (``--native``), whichever it likes.
        size: (outputs,), largest magnitudes of the outputs in random states of the ranges.
        worst: (outputs,), the instruction that contributes most to each.
        share: (outputs,), its part in the bound, 0 to 1.
        refused: outputs without a bound, with the instruction and the range that say why.
        ranges: (least, largest) by the names of all inputs that are read, parameters at their values left out.
    """

    robot: str
    kernel: str
    dtype: str
    outputs: tuple[str, ...]
    bound: Array
    fused: Array
    size: Array
    worst: tuple[str, ...]
    share: Array
    refused: Mapping[str, str]
    ranges: Mapping[str, tuple[float, float]]

    @property
    def relative(self) -> Array:
        """Bounds by the sizes of the outputs, (outputs,); 0 where an output has no error."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.bound > 0.0, self.bound / self.size, 0.0)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; None for what has no bound."""
        columns = zip(self.outputs, self.bound, self.fused, self.size, self.worst, self.share, strict=True)
        return {
            "robot": self.robot,
            "kernel": self.kernel,
            "dtype": self.dtype,
            "premises": list(PREMISES),
            "ranges": {name: list(ends) for name, ends in self.ranges.items()},
            "outputs": {
                name: {
                    "bound": _plain(bound),
                    "fused": _plain(fused),
                    "size": _plain(size),
                    "worst": worst,
                    "share": float(share),
                    **({"refused": self.refused[name]} if name in self.refused else {}),
                }
                for name, bound, fused, size, worst, share in columns
            },
        }

    def lines(self) -> list[str]:
        """Return a table for the terminal: outputs with the largest relative bounds first."""
        lines = [f"{self.kernel} of {self.robot}, {self.dtype}: rounding errors of {len(self.outputs)} outputs"]
        relative = self.relative
        order = [i for i in np.argsort(-relative, kind="stable") if self.outputs[i] not in self.refused]
        shown = [i for i in order if self.bound[i] > 0.0][:_LINES]
        if shown:
            lines.append(f"{'':28}{'bound':>10}{'fused':>10}{'of size':>10}{'relative':>10}  most by")
        for i in shown:
            figures = "".join(f"{x:10.1e}" for x in (self.bound[i], self.fused[i], self.size[i], relative[i]))
            lines.append(f"{self.outputs[i]:28}{figures}  {self.share[i]:.0%} {self.worst[i]}")
        small = sum(self.bound[i] > 0.0 for i in order) - len(shown)
        if small > 0:
            lines.append(f"{small} outputs more, with smaller relative bounds")
        exact = sum(self.bound[i] == 0.0 for i in order)
        if exact:
            lines.append(f"{exact} outputs without rounding errors")
        for reason, names in _by_reason(self.refused).items():
            more = f" and {len(names) - 1} outputs more" if len(names) > 1 else ""
            lines.append(f"{names[0]}{more}: no bound: {reason}")
        return lines


@dataclass(frozen=True, kw_only=True, repr=False)
class RoundingBounds(Shown):
    """Bounds of several kernels of a robot.

    Attributes:
        kernels: a result for each, by name.
        left_out: kernels without one, with why.
    """

    kernels: Mapping[str, RoundingBound]
    left_out: Mapping[str, str]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "kernels": {name: bound.as_dict() for name, bound in self.kernels.items()},
            "left_out": dict(self.left_out),
        }

    def lines(self) -> list[str]:
        """Return tables for the terminal, one per kernel."""
        lines: list[str] = []
        for bound in self.kernels.values():
            lines += [*bound.lines(), ""]
        lines += [*(f"premise: {text}" for text in PREMISES), ""] if lines else []
        return [*lines, *(f"without bounds, {why}: {', '.join(x)}" for why, x in _by_reason(self.left_out).items())]


def _by_reason(reasons: Mapping[str, str]) -> dict[str, list[str]]:
    """Return names grouped by their reason."""
    grouped: dict[str, list[str]] = {}
    for name, reason in reasons.items():
        grouped.setdefault(reason, []).append(name)
    return grouped


def _plain(number: float) -> float | None:
    return float(number) if np.isfinite(number) else None
