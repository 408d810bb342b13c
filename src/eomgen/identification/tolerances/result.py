"""Effects of tolerances on a tool's pose: covariances, regions, worst cases, shares by contribution."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...arrays import Array, Index
from ...errors import InputError, UnknownNameError
from ...names import listed, nearest_or_all, show
from ...results.contents import plain_fields
from ...results.kinds import Saved
from ...robot.coordinates import MOTIONS
from ...shown import Plotting, Shown
from ...tabular import Rows as TableRows
from ...tabular import TableColumn, Tabular
from .allocation import Allocation, allocated
from .bending import BendingExact
from .contributions import Exact
from .correlations import groups_of, plain_correlations, root_of
from .regions import ellipsoids
from .table import Tolerance

PARTS = {"position": slice(0, 3), "orientation": slice(3, 6)}  # components of a motion
_MOST_DRAWN = 10_000_000
_SHOWN = 12  # contributions in the text
_NOTHING = 1e-12  # of the variances without their signs: round-off


@dataclass(frozen=True, kw_only=True)
class ToleranceResult(Plotting, Shown, Tabular, Saved, plot="plot_tolerance"):
    """Accuracy of a frame at N poses, by tolerances of K parameters, to first order.

    Attributes:
        robot, frame: names.
        coordinates, q: names of the coordinates, (k,), and the poses, (N, k), m or rad.
        t: times of the poses, s, (N,), where they are samples of a motion.
        names, units: of the K parameters.
        described: what the description says, (K,); NaN where that is no number.
        deviations: standard deviations, (K,); of a bound that of a uniform distribution, bound / sqrt(3).
        bounds: what worst cases go up to, (K,); of a deviation three of them.
        correlation: coefficients of correlation, (K, K); ones on the diagonal, zeros beside it by default.
        sensitivities: motion of the frame per unit of a parameter, (N, 6, K): x, y, z (m), rx, ry, rz (rad), base.
        covariance: of the frame's motion, (N, 6, 6).
        confidence: of regions.
        radius: of spheres that hold the frame's displacement, or rotation vector, with that probability: "position" (m)
            and "orientation" (rad), (N,).
        direction: half the interval that holds, with that probability, the component along the direction in which it is
            greatest, by the same names, (N,).
        worst: worst case of every component, sum of |S_i| t_i, (N, 6), whatever is correlated.
        farthest: worst displacement (m) and rotation vector (rad), to first order, by the same names, (N,).
        worst_pose: index of the pose with the greatest worst displacement.
        exact_worst: worst displacement that the exact model has there, at the vertices of the main contributors, m.
        shares: of the trace of the covariance, mean over the poses, by the same names, (K,); they add up to 1.  Of the
            common term of two correlated parameters each has half, so that a share may be negative: one that
            compensates.
        nonlinearity: by how much the exact model is off a linear one with one parameter at its bound, or all at the
            worst vertex, as a share of the worst displacement or rotation; the greatest.
        notes: remarks, warnings among them.
        exact, tolerances: the exact model and the table.
    """

    robot: str
    frame: str
    coordinates: tuple[str, ...]
    q: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    described: Array
    deviations: Array
    bounds: Array
    correlation: Array
    sensitivities: Array
    covariance: Array
    confidence: float
    radius: dict[str, Array]
    direction: dict[str, Array]
    worst: Array
    farthest: dict[str, Array]
    worst_pose: int
    exact_worst: float
    shares: dict[str, Array]
    nonlinearity: float
    notes: tuple[str, ...]
    t: Array | None = None
    exact: Exact | BendingExact = field(repr=False)
    tolerances: tuple[Tolerance, ...] = field(repr=False)

    @property
    def standard_deviations(self) -> Array:
        """Standard deviations of the six components, (N, 6), m and rad."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=1, axis2=2), 0.0))

    def ellipsoids(self, part: str = "position") -> tuple[Array, Array]:
        """Return principal half-axes (N, 3), m or rad, and their directions (N, 3, 3), of ellipsoids around the poses.

        They hold the displacement, or the rotation vector, with the probability ``confidence``; base frame.

        Raises:
            InputError: another name than "position" or "orientation".
        """
        return ellipsoids(self.covariance[:, _at(part), _at(part)], self.confidence)

    def share(self, name: str, part: str = "position") -> float:
        """Return the share of one parameter in the variance.

        Raises:
            UnknownNameError: the table has no such parameter.
            InputError: another name than "position" or "orientation".
        """
        if name not in self.names:
            raise UnknownNameError(f"tolerance: {name!r} has none{nearest_or_all(name, self.names)}")
        _at(part)
        return float(self.shares[part][self.names.index(name)])

    @property
    def by_share(self) -> Index:
        """Indices of the parameters, (K,), the greatest share first, of position or orientation, whatever its sign."""
        largest = np.maximum(*(np.abs(self.shares[name]) for name in PARTS))
        return np.argsort(-largest, kind="stable")

    def sample(self, count: int, *, pose: int = 0, seed: int = 0) -> Array:
        """Return motions of the frame by the exact model, (count, 6), m and rad, of random deviations at one pose.

        Deviations are correlated as the table has it.

        Raises:
            InputError: the count, the pose or the seed cannot be used.
        """
        check_whole("count", count, 1, _MOST_DRAWN)
        check_whole("pose", pose, 0, len(self.q) - 1)
        check_whole("seed", seed, 0, 2**63)
        rng = np.random.default_rng(seed)
        drawn = np.empty((len(self.names), count))
        is_normal = np.array([entry.bound is None for entry in self.tolerances])
        for k in range(len(self.names)):
            drawn[k] = rng.standard_normal(count) if is_normal[k] else rng.uniform(-1.0, 1.0, count)
        if self.correlated:
            drawn = root_of(self.correlation) @ drawn
        drawn *= np.where(is_normal, self.deviations, self.bounds)[:, np.newaxis]
        return self.exact.motions(drawn, np.full(count, pose, dtype=np.intp))

    @property
    def correlated(self) -> tuple[tuple[str, ...], ...]:
        """Names of parameters that are correlated with each other, by groups; () where all are independent."""
        return tuple(tuple(self.names[k] for k in group) for group in groups_of(self.correlation))

    @property
    def positions(self) -> Array:
        """Positions of the frame at the poses, without deviations, (N, 3), m, in the base frame."""
        return self.exact.poses(np.zeros((len(self.names), len(self.q))), np.arange(len(self.q)))[1]

    def allocate(self, accuracy: float) -> Allocation:
        """Return tolerances to tighten, at least cost, so that the radius of position is at most this at all poses.

        Raises:
            InputError: the accuracy is no positive number, what is fixed alone makes it impossible, or tolerances are
                correlated: the radius is then no sum over them.
        """
        if self.correlated:
            what = listed(name for group in self.correlated for name in group)
            raise InputError(f"accuracy: {what} are correlated; allowed: tables of independent tolerances")
        return allocated(
            self.names,
            self.units,
            np.where([entry.bound is not None for entry in self.tolerances], self.bounds, self.deviations),
            self.sensitivities[:, :3] * self.deviations,
            np.array([entry.cost for entry in self.tolerances]),
            np.array([entry.is_fixed for entry in self.tolerances]),
            accuracy,
            self.confidence,
        )

    def as_rows(self) -> TableRows:
        """Return a row per parameter: standard deviation, bound, shares of variance."""
        columns = [TableColumn("deviation", "SI", self.deviations), TableColumn("bound", "SI", self.bounds)]
        columns += [TableColumn(f"{name}_share", "1", self.shares[name]) for name in PARTS]
        names = np.array(self.names, dtype=object)
        return TableRows("name", "", names, columns, {"robot": self.robot, "frame": self.frame})

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {
            **plain_fields(self, "correlation", "sensitivities", "exact", "tolerances"),
            "described": [float(value) if np.isfinite(value) else None for value in self.described],
            "correlations": plain_correlations(self.names, self.correlation),
            "components": list(MOTIONS),
            "standard_deviations": self.standard_deviations.tolist(),
            "shares": {kind: dict(zip(self.names, x.tolist(), strict=True)) for kind, x in self.shares.items()},
        }

    def lines(self) -> list[str]:
        """Return tables for people: accuracy over the poses, and shares of contributions."""
        count = len(self.q)
        linked = sum(map(len, self.correlated))
        which = f" ({linked} correlated)" if linked else ""
        lines = [f"{self.robot}, {self.frame}: {len(self.names)} tolerances{which} at {count} pose{'s' * (count != 1)}"]
        lines.append("")
        share = f"{100 * self.confidence:g} % coverage"
        lines.append(f"{'':<14}{share:>14}{'largest half-axis':>18}{'worst case':>14}")
        several = ("",) if count == 1 else (" mean", " max")
        for space, unit in zip(PARTS, ("mm", "mrad"), strict=True):
            for kind in several:
                function = np.max if kind == " max" else np.mean
                values = [1e3 * float(function(x[space])) for x in (self.radius, self.direction, self.farthest)]
                head = space if kind != " max" else ""
                row = f"{values[0]:>14.4g}{values[1]:>18.4g}{values[2]:>14.4g}"
                lines.append(f"{head:<14}{row}  {unit}{kind}")
        lines += ["", f"worst position by the exact model at the vertices: {1e3 * self.exact_worst:.4g} mm"]
        width = max(len(name) for name in self.names) + 2
        lines += ["", f"{'share of variance':<{width}}{'position':>12}{'orientation':>14}{'deviation':>14}  unit"]
        order = self.by_share
        for k in order[:_SHOWN]:
            parts = [100.0 * float(self.shares[space][k]) for space in PARTS]
            row = f"{parts[0]:>10.1f} %{parts[1]:>12.1f} %{self.deviations[k]:>14.3g}"
            lines.append(f"{self.names[k]:<{width}}{row}  {self.units[k]}")
        if len(order) > _SHOWN:
            rest = [100.0 * float(self.shares[space][order[_SHOWN:]].sum()) for space in PARTS]
            lines.append(f"{f'{len(order) - _SHOWN} others':<{width}}{rest[0]:>10.1f} %{rest[1]:>12.1f} %")
        return lines + [""] * bool(self.notes) + [f"note: {note}" for note in self.notes]


def _at(part: str) -> slice:
    if part not in PARTS:
        raise InputError(f"part: {show(part)}; allowed: {', '.join(PARTS)}")
    return PARTS[part]


def check_whole(label: str, value: Any, low: int, high: int) -> None:
    """Raise InputError if a value is no whole number within limits."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not low <= value <= high:
        raise InputError(f"{label}: {show(value)}; allowed: a whole number from {low} to {high}")


def shares_of(scaled: Array, correlation: Array) -> Array:
    """Return every contribution's share in the mean trace of covariances, (K,), of S times deviations, (N, 3, K).

    Of s_i r_ij s_j + s_j r_ji s_i both have half.  All are 0 where nothing moves, or all is compensated.
    """
    if groups_of(correlation):
        variances = (scaled * (scaled @ correlation)).sum(axis=(0, 1))
    else:
        variances = (scaled**2).sum(axis=(0, 1))
    total = float(variances.sum())
    return variances / total if total > _NOTHING * float(np.abs(variances).sum()) else np.zeros(len(variances))
