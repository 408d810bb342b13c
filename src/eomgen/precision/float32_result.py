"""Errors of single precision, as a printable result."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..shown import Shown
from .intervals import Array

_LINES = 6  # outputs of a kernel that are printed, those with the largest relative errors first
_OPERATIONS, _PART = 5, 0.02  # operations that are printed, with such a part at least
SMALL = 1e-10  # of a kernel's largest output: what is smaller vanishes but for rounding


def worst_output(errors: Array, size: Array) -> int | None:
    """Return the place of the largest error by its output's size, of outputs that do not vanish but for rounding."""
    counts = (errors > 0.0) & ~vanishing(size)
    if not counts.any():
        return None
    return int(np.argmax(np.where(counts, errors / np.where(counts, size, 1.0), 0.0)))


def vanishing(size: Array) -> NDArray[np.bool_]:
    """Say of each output whether it vanishes but for rounding, by largest magnitudes."""
    return np.asarray(size <= SMALL * size.max(initial=0.0))


@dataclass(frozen=True, kw_only=True, repr=False)
class Float32Errors(Shown):
    """Errors of a kernel's outputs in single precision, observed against double precision at random states.

    Attributes:
        kernel: its name.
        outputs: names of the outputs, in the order of the flat result.
        units: of the outputs, empty where there is none or it is not known.
        observed: (outputs,), largest errors.
        size: (outputs,), largest magnitudes of the outputs.
        worst: the output with the largest error by its size, or None.
        dominant: parts of operations in the error bound of that output at these states, 0 to 1, the largest first;
            empty where it has no bound.
    """

    kernel: str
    outputs: tuple[str, ...]
    units: tuple[str, ...]
    observed: Array
    size: Array
    worst: str | None
    dominant: Mapping[str, float]

    @property
    def relative(self) -> Array:
        """Observed errors by the sizes of outputs, (outputs,); 0 where an output has no error."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.observed != 0.0, self.observed / self.size, 0.0)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        columns = zip(self.outputs, self.units, self.observed, self.size, strict=True)
        return {
            "outputs": {
                name: {"unit": unit, "observed": float(observed), "size": float(size)}
                for name, unit, observed, size in columns
            },
            "worst": self.worst,
            "dominant": dict(self.dominant),
        }

    def summary(self) -> str:
        """Return one line: the error of the worst output."""
        if self.worst is None:
            return f"{self.kernel}: no error by rounding"
        at = self.outputs.index(self.worst)
        unit = f" {self.units[at]}" if self.units[at] else ""
        seen = f"{self.observed[at]:.1e}{unit} ({self.relative[at]:.0e})"
        return f"{self.kernel}: {self.worst} is off by {seen}, of {self.size[at]:.2g}{unit}"

    def lines(self) -> list[str]:
        """Return a table for the terminal: outputs with the largest relative errors first, and dominant operations."""
        counts = (self.relative > 0.0) & ~vanishing(self.size)
        order = [i for i in np.argsort(-self.relative, kind="stable") if counts[i]]
        lines = [self.summary(), *self._rows(order[:_LINES])]
        if len(order) > _LINES:
            lines.append(f"  {len(order) - _LINES} outputs more, with smaller relative errors")
        named = [(part, name) for name, part in self.dominant.items() if part >= _PART][:_OPERATIONS]
        if named:
            lines.append(f"  dominant operations of {self.worst}: " + "; ".join(f"{x:.0%} {name}" for x, name in named))
        return lines

    def _rows(self, order: Sequence[int]) -> Iterator[str]:
        if order:
            yield f"  {'':38}{'observed':>10}{'of size':>10}{'relative':>10}"
        for i in order:
            name = f"{self.outputs[i]}{f', {self.units[i]}' if self.units[i] else ''}"
            yield f"  {name:38}{self.observed[i]:10.1e}{self.size[i]:10.1e}{self.relative[i]:10.1e}"


@dataclass(frozen=True, kw_only=True, repr=False)
class Float32Advice(Shown):
    """Errors of a robot's kernels in single precision.

    Attributes:
        robot: its name.
        kernels: errors of each, by name.
        left_out: kernels without any, with the reason.
    """

    robot: str
    kernels: Mapping[str, Float32Errors]
    left_out: Mapping[str, str]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "robot": self.robot,
            "kernels": {name: errors.as_dict() for name, errors in self.kernels.items()},
            "left_out": dict(self.left_out),
        }

    def summary_lines(self) -> list[str]:
        """Return a line for each kernel."""
        return [*(errors.summary() for errors in self.kernels.values()), *self._left_out()]

    def lines(self) -> list[str]:
        """Return tables for the terminal, one per kernel."""
        lines = [f"float32 compared with float64, {self.robot}"]
        for errors in self.kernels.values():
            lines += errors.lines()
        return [*lines, *self._left_out()]

    def _left_out(self) -> Iterator[str]:
        yield from (f"{name}: left out, {reason}" for name, reason in self.left_out.items())
