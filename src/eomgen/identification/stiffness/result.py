"""Results of fits of stiffness and damping: values with intervals, warnings, and their table."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from ...errors import UnknownNameError
from ...names import component_name, parameter_name
from ...results.kinds import Kind, Saved, declare
from ...shown import Plotting, Shown, interval
from ...tabular import Rows, TableColumn, Tabular

KEYS = ("stiffness", "damping")


@dataclass(frozen=True)
class Estimate:
    """A fitted value with its standard error and confidence interval.

    described: what the description says.  width: of the filter, s.  unexplained: rms of the residual over rms of y,
    both behind that filter.
    """

    value: float
    standard_error: float
    low: float
    high: float
    described: float
    width: float
    unexplained: float


@dataclass(frozen=True)
class FittedCoordinate:
    """Estimates for one coordinate; None where a parameter is not determined.

    stiffness: N/m or N m/rad; damping: N s/m or N m s/rad.  noise: standard deviation of white noise on the
    coordinate, m or rad, as its samples show it.  owner: "joints", or of what is cut or coupled "loops", "couplings".
    """

    coordinate: str
    stiffness: Estimate | None
    damping: Estimate | None
    noise: float
    owner: str = "joints"


def doubts(entry: FittedCoordinate) -> list[str]:
    """Return warnings about a fitted coordinate."""
    doubts = []
    for key in KEYS:
        estimate: Estimate | None = getattr(entry, key)
        if estimate is None:
            continue
        name = component_name(entry.coordinate, key)
        if estimate.low <= 0.0 <= estimate.high:
            doubts.append(f"{name}: its interval holds zero, so the motion does not determine it")
        elif estimate.value < 0.0:
            doubts.append(f"{name} is negative; is the drive known, and the inertia right?")
        elif estimate.unexplained > 0.5:
            doubts.append(f"{name}: {100 * estimate.unexplained:.0f} % of the force stays unexplained")
    return doubts


@dataclass(frozen=True)
class FitResult(Plotting, Shown, Tabular, Saved, plot="plot_fit"):
    """Fitted coordinates, warnings about what could not be fitted, and notes about the method."""

    robot: str
    confidence: float
    fitted: tuple[FittedCoordinate, ...]
    warnings: tuple[str, ...]
    notes: tuple[str, ...]

    def __getitem__(self, coordinate: str) -> FittedCoordinate:
        """Return the result of one coordinate; UnknownNameError if it was not fitted."""
        names = [entry.coordinate for entry in self.fitted]
        if coordinate not in names:
            raise UnknownNameError(f"fit: {coordinate!r} was not fitted; fitted: {', '.join(names) or 'none'}")
        return self.fitted[names.index(coordinate)]

    @property
    def parameters(self) -> dict[str, float]:
        """Fitted values that a kernel takes, by parameter name: those that are not negative."""
        parameters = {}
        for entry in self.fitted:
            for key in KEYS:
                estimate = getattr(entry, key)
                if estimate is not None and estimate.value >= 0.0:
                    parameters[parameter_name(entry.owner, entry.coordinate, key)] = estimate.value
        return parameters

    def as_rows(self) -> Rows:
        """Return a row per fitted parameter: value, standard error, interval, what is described; SI units."""
        estimates = {
            parameter_name(entry.coordinate, key): getattr(entry, key)
            for entry in self.fitted
            for key in KEYS
            if getattr(entry, key) is not None
        }
        columns = []
        for field in fields(Estimate):
            unit = {"width": "s", "unexplained": "1"}.get(field.name, "SI")
            values = np.array([getattr(estimate, field.name) for estimate in estimates.values()], dtype=np.float64)
            columns.append(TableColumn(field.name, unit, values))
        return Rows("parameter", "", np.array(list(estimates), dtype=object), columns, {"robot": self.robot})

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return asdict(self)

    def lines(self) -> list[str]:
        """Return a table for people."""
        share = f"{100 * self.confidence:g} % interval"
        lines = [f"{self.robot}: stiffness and damping by least squares", ""]
        lines.append(f"{'parameter':<34}{'value':>12}{'std. error':>12}{share:>26}{'described':>12}")
        for entry in self.fitted:
            for key in KEYS:
                estimate = getattr(entry, key)
                if estimate is not None:
                    span = interval(estimate.low, estimate.high, 5)
                    row = (
                        f"{estimate.value:>12.5g}{estimate.standard_error:>12.2g}{span:>26}{estimate.described:>12.5g}"
                    )
                    lines.append(f"{entry.coordinate + '.' + key:<34}{row}")
        lines += ["", *(f"warning: {text}" for text in self.warnings), *(f"note: {text}" for text in self.notes)]
        return lines


load_fit = declare(Kind("fit", FitResult, ending=".json"))
"""Read the result that ``FitResult.save`` wrote; InputError says what in the file is wrong."""
