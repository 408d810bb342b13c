"""Costs of single precision, as a result that says itself in lines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..names import listed
from ..shown import Shown
from .intervals import Array

_LINES = 6  # outputs of a kernel that are printed, those with the largest relative errors first
_SOURCES, _PART = 5, 0.02  # sources that are printed, with such a part at least
_LOOSE = 1e3  # times what is observed: more is said to be loose
SMALL = 1e-10  # of a kernel's largest output: what is smaller vanishes but for rounding


def worst_output(errors: Array, size: Array) -> int | None:
    """Return the place of the largest error by its output's size, of outputs that do not vanish but for rounding."""
    counts = (errors > 0.0) & np.isfinite(errors) & ~vanishing(size)
    if not counts.any():
        return None
    return int(np.argmax(np.where(counts, errors / np.where(counts, size, 1.0), 0.0)))


def vanishing(size: Array) -> NDArray[np.bool_]:
    """Say of each output whether it vanishes but for rounding, by largest magnitudes."""
    return np.asarray(size <= SMALL * size.max(initial=0.0))


@dataclass(frozen=True, kw_only=True, repr=False)
class Float32Errors(Shown):
    """Errors of a kernel's outputs in single precision, beside the exact result or double precision.

    Attributes:
        kernel: its name.
        outputs: names of the outputs, in the order of the flat result.
        units: of the outputs, empty where there is none or it is not known.
        bound: (outputs,), proved largest errors over the ranges, infinite where there is no bound; not a number where a
            kernel solves equations.
        observed: (outputs,), largest errors beside double precision at random states.
        size: (outputs,), largest magnitudes of the outputs there.
        instruction: (outputs,), the instruction that contributes most to each bound.
        refused: outputs without a bound, with the instruction and the range that say why.
        worst: the output with the largest error by its size, or None.
        sources: what the bound of that output comes from, in the description's names, with parts of 0 to 1.
        of_inputs: what is added to that bound where the states themselves are rounded to single precision.
        operations, in_double: number of the kernel's operations, and of those that are computed in double precision.
        ranges: (least, largest) by the names of all inputs that are read; of kernels with bounds.
    """

    kernel: str
    outputs: tuple[str, ...]
    units: tuple[str, ...]
    bound: Array
    observed: Array
    size: Array
    instruction: tuple[str, ...]
    refused: Mapping[str, str]
    worst: str | None
    sources: Mapping[str, float]
    of_inputs: float
    operations: int
    in_double: int
    ranges: Mapping[str, tuple[float, float]]

    @property
    def relative(self) -> Array:
        """Bounds by the sizes of outputs, (outputs,); 0 where an output has no error."""
        return _ratio(self.bound, self.size)

    @property
    def relative_observed(self) -> Array:
        """Observed errors by sizes, (outputs,)."""
        return _ratio(self.observed, self.size)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; None for what has no bound."""
        columns = zip(self.outputs, self.units, self.bound, self.observed, self.size, self.instruction, strict=True)
        return {
            "outputs": {
                name: {
                    "unit": unit,
                    "bound": _plain(bound),
                    "observed": float(observed),
                    "size": float(size),
                    "worst": instruction,
                    **({"refused": self.refused[name]} if name in self.refused else {}),
                }
                for name, unit, bound, observed, size, instruction in columns
            },
            "worst": self.worst,
            "sources": {name: float(part) for name, part in self.sources.items()},
            "of_inputs": self.of_inputs,
            "operations": self.operations,
            "in_double": self.in_double,
            "ranges": {name: list(ends) for name, ends in self.ranges.items()},
        }

    def facts_of_worst(self) -> dict[str, Any]:
        """Return the errors of the worst output, as plain values for JSON: what a package's metadata holds."""
        if self.worst is None:
            return {"output": None}
        at = self.outputs.index(self.worst)
        return {
            "output": self.worst,
            "unit": self.units[at],
            "bound": _plain(self.bound[at]),
            "observed": float(self.observed[at]),
            "size": float(self.size[at]),
            "of_inputs": self.of_inputs,
            "operations": self.operations,
            "in_double": self.in_double,
            "sources": dict(self._sources()),
        }

    def _sources(self) -> list[tuple[str, float]]:
        return [(name, float(part)) for name, part in self.sources.items() if part >= _PART][:_SOURCES]

    def summary(self) -> str:
        """Return one line: by how much the worst output is off, by the bound and as observed."""
        double = f"; {self.in_double} of {self.operations} operations in double" if self.in_double else ""
        if self.worst is None:
            return f"{self.kernel}: no error by rounding, or none that can be bounded{double}"
        at = self.outputs.index(self.worst)
        unit = f" {self.units[at]}" if self.units[at] else ""
        bound = "" if np.isnan(self.bound[at]) else f"at most {self.bound[at]:.1e}{unit} ({self.relative[at]:.0e}), "
        seen = f"observed {self.observed[at]:.1e}{unit} ({self.relative_observed[at]:.0e})"
        return f"{self.kernel}: {self.worst} is off by {bound}{seen}, of {self.size[at]:.2g}{unit}{double}"

    def lines(self) -> list[str]:
        """Return a table for the terminal: outputs with the largest relative errors first, and what they come from."""
        errors = self.relative_observed if np.isnan(self.bound).all() else self.relative
        counts = np.isfinite(errors) & (errors > 0.0) & ~vanishing(self.size)
        order = [i for i in np.argsort(-errors, kind="stable") if counts[i]]
        lines = [self.summary(), *self._rows(order[:_LINES], errors)]
        if len(order) > _LINES:
            lines.append(f"  {len(order) - _LINES} outputs more, with smaller relative errors")
        named = "; ".join(f"{part:.0%} {name}" for name, part in self._sources())
        if named:
            lines.append(f"  {self.worst} comes from: {named}")
        if self.of_inputs > 0.0 and self.worst is not None:
            unit = self.units[self.outputs.index(self.worst)]
            lines.append(f"  states rounded to float32 add up to {self.of_inputs:.1e}{f' {unit}' if unit else ''}")
        loose = [self.outputs[i] for i in order if self.bound[i] > _LOOSE * self.observed[i] > 0.0]
        if loose:
            lines.append(f"  bounds that wide ranges make loose, narrow them with --range: {listed(loose)}")
        return [*lines, *(f"  {name}: no bound: {reason}" for name, reason in self.refused.items())]

    def _rows(self, order: Sequence[int], errors: Array) -> Iterator[str]:
        if order:
            yield f"  {'':38}{'bound':>10}{'observed':>10}{'of size':>10}{'relative':>10}"
        for i in order:
            name = f"{self.outputs[i]}{f', {self.units[i]}' if self.units[i] else ''}"
            figures = (self.bound[i], self.observed[i], self.size[i], errors[i])
            yield f"  {name:38}" + "".join(f"{'-':>10}" if np.isnan(x) else f"{x:10.1e}" for x in figures)


@dataclass(frozen=True, kw_only=True, repr=False)
class Float32Advice(Shown):
    """Errors of a robot's kernels in single precision.

    Attributes:
        robot: its name.
        kernels: errors of each, by name.
        left_out: kernels without any, with why.
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
        lines = [errors.summary() for errors in self.kernels.values()]
        return [*lines, *(f"{name}: left out, {reason}" for name, reason in self.left_out.items())]

    def lines(self) -> list[str]:
        """Return tables for the terminal, one per kernel."""
        lines = [f"float32 beside exact results, {self.robot}"]
        for errors in self.kernels.values():
            lines += errors.lines()
        return [*lines, *(f"{name}: left out, {reason}" for name, reason in self.left_out.items())]


def _plain(number: float) -> float | None:
    return float(number) if np.isfinite(number) else None


def _ratio(errors: Array, scale: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(errors != 0.0, errors / scale, 0.0)
