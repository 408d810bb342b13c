"""Results of fits of stiffness and damping: values with intervals, warnings, and their table."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from ...errors import InputError, UnknownNameError
from ...names import component_name, parameter_name, show
from ...results.kinds import Kind, Saved, declare
from ...robot.coordinates import number_name
from ...robot.elements.joint_damping import JointDamping
from ...robot.elements.joint_stiffness import JointStiffness
from ...robot.elements.matrices import ROUND_OFF
from ...shown import Plotting, Shown, interval
from ...tabular import Rows, TableColumn, Tabular
from ..estimating import SOLVED

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
    coordinate, m or rad, as its samples show it.  owner: "joints", "links" of modes (J, J s), or of what is cut or
    coupled "loops", "couplings".
    """

    coordinate: str
    stiffness: Estimate | None
    damping: Estimate | None
    noise: float
    owner: str = "joints"


@dataclass(frozen=True)
class FittedEntry:
    """An estimate for one entry of a matrix, "x.beta"; described with what a coordinate's own table says."""

    entry: str
    estimate: Estimate


@dataclass(frozen=True)
class FittedMatrix:
    """The stiffness or damping matrix of a joint, with estimates for its entries.

    joint: name of the joint, of the loop joint or of the bushing between two frames, as ``owner`` says: "joints",
    "loops" or "bushings".
    key: "stiffness" (N/m, N/rad, N m/rad) or "damping" (times s).  coordinates: of its rows, n of "x" to "gamma".
    entries: those that were found.  matrix: (n, n), with what the description says where nothing was found.
    taken_in: coordinates whose own tables' stiffness (or damping) is in it, and goes where the matrix is described.
    open: entries that were looked for and are not determined; in the matrix they are as described.
    lowest: eigenvalue of the matrix scaled by its diagonal, with its standard error: negative where the matrix is none
    that a joint can have; nothing is cut off.
    """

    joint: str
    key: str
    coordinates: tuple[str, ...]
    entries: tuple[FittedEntry, ...]
    matrix: tuple[tuple[float, ...], ...]
    taken_in: tuple[str, ...]
    open: tuple[str, ...]
    lowest: float
    lowest_error: float
    owner: str = "joints"

    @property
    def name(self) -> str:
        """Its name in messages, "joint2.stiffness"."""
        return component_name(self.joint, self.key)

    @property
    def is_definite(self) -> bool:
        """Whether no motion has a negative energy, up to round-off: whether a description takes it."""
        positive = all(row[i] >= 0.0 for i, row in enumerate(self.matrix))
        return positive and self.lowest >= -ROUND_OFF * len(self.coordinates)

    def __getitem__(self, entry: str) -> Estimate:
        """Return the estimate for an entry, "x.beta"; UnknownNameError if it was not found."""
        known = {x.entry: x.estimate for x in self.entries}
        if entry not in known:
            raise UnknownNameError(f"{self.name}: {show(entry)} was not found; found: {', '.join(known)}")
        return known[entry]

    def element(self) -> JointStiffness | JointDamping:
        """Return it as a joint of a ``Robot`` has it, as its stiffness or damping.

        Raises:
            InputError: it is not positive semidefinite.
        """
        if not self.is_definite:
            raise InputError(f"{self.name}: is not positive semidefinite; allowed: a matrix that a joint can have")
        kind = JointStiffness if self.key == KEYS[0] else JointDamping
        return kind.of(self.matrix, self.coordinates)


@dataclass(frozen=True)
class FittedNumber:
    """An estimate for a run-time parameter, by its name: "joints.joint1.gamma.friction.coulomb"."""

    name: str
    estimate: Estimate


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
    """Fitted coordinates, matrices and parameters, warnings about what could not be fitted, notes about the method.

    status: "converged", or what has not.
    """

    robot: str
    confidence: float
    fitted: tuple[FittedCoordinate, ...]
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    matrices: tuple[FittedMatrix, ...] = ()
    numbers: tuple[FittedNumber, ...] = ()
    status: str = SOLVED

    def __getitem__(self, coordinate: str) -> FittedCoordinate:
        """Return the result of one coordinate; UnknownNameError if it was not fitted."""
        names = [entry.coordinate for entry in self.fitted]
        if coordinate not in names:
            raise UnknownNameError(f"fit: {coordinate!r} was not fitted; fitted: {', '.join(names) or 'none'}")
        return self.fitted[names.index(coordinate)]

    def matrix(self, joint: str, key: str = "stiffness") -> FittedMatrix:
        """Return the matrix of a joint, its stiffness or "damping"; UnknownNameError if it was not fitted.

        Args:
            joint: name of the joint, loop joint or bushing; "loops.cut" where joints of several kinds have that name.
            key: of the matrix.
        """
        for entry in self.matrices:
            if key == entry.key and joint in (entry.joint, component_name(entry.owner, entry.joint)):
                return entry
        known = ", ".join(entry.name for entry in self.matrices) or "none"
        raise UnknownNameError(f"fit: {component_name(joint, key)} was not fitted; fitted: {known}")

    @property
    def title(self) -> str:
        """Name of the table, with the robot's name."""
        what = "numbers by the output-error method" if self.numbers else "stiffness and damping by least squares"
        return f"{self.robot}: {what}"

    @property
    def estimates(self) -> dict[str, Estimate]:
        """Estimates by the names of their parameters, "joint2.x.stiffness" and "joint2.stiffness.x.beta".

        Those of ``numbers`` have the whole name of the run-time parameter.
        """
        pairs = [(entry.coordinate, key, getattr(entry, key)) for entry in self.fitted for key in KEYS]
        found = {component_name(owner, key): estimate for owner, key, estimate in pairs if estimate is not None}
        names = [matrix.name for matrix in self.matrices]
        for x in self.matrices:  # joints of several kinds may have one name
            name = x.name if names.count(x.name) == 1 else component_name(x.owner, x.name)
            found |= {f"{name}.{entry.entry}": entry.estimate for entry in x.entries}
        return found | {number.name: number.estimate for number in self.numbers}

    @property
    def parameters(self) -> dict[str, float]:
        """Fitted values that a kernel takes, by parameter name: those that it may have, and whole matrices.

        Of matrices those that are positive semidefinite, with 0 for what they take in of tables; entries that the
        description does not have are parameters only where they are ``tunable``.
        """
        parameters = {}
        for entry in self.fitted:
            for key in KEYS:
                estimate = getattr(entry, key)
                if estimate is not None and estimate.value >= 0.0:
                    parameters[number_name(entry.owner, entry.coordinate, key)] = estimate.value
        for found in self.matrices:
            if found.is_definite:
                taken_in = {parameter_name(found.owner, found.joint, name, found.key): 0.0 for name in found.taken_in}
                values = {parameter_name(found.owner, found.name, x.entry): x.estimate.value for x in found.entries}
                parameters |= values | taken_in
        return parameters | {number.name: number.estimate.value for number in self.numbers}

    def as_rows(self) -> Rows:
        """Return a row per fitted parameter: value, standard error, interval, what is described; SI units."""
        estimates = self.estimates
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
        lines, width = [self.title, ""], max(34, *(len(name) + 2 for name in ("", *self.estimates)))
        lines.append(f"{'parameter':<{width}}{'value':>12}{'std. error':>12}{share:>26}{'described':>12}")
        for name, estimate in self.estimates.items():
            span = interval(estimate.low, estimate.high, 5)
            row = f"{estimate.value:>12.5g}{estimate.standard_error:>12.2g}  {span:>24}{estimate.described:>12.5g}"
            lines.append(f"{name:<{width}}{row}")
        lines += ["", *(f"warning: {text}" for text in self.warnings), *(f"note: {text}" for text in self.notes)]
        return lines


load_fit = declare(Kind("fit", FitResult, ending=".json"))
"""Read the result that ``FitResult.save`` wrote; InputError says what in the file is wrong."""
