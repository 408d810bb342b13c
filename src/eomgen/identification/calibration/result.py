"""Results of calibrations: values with standard deviations, linearly dependent ones, residuals; predictions; files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from ...arrays import Array
from ...errors import InputError, UnknownNameError
from ...motion.measured_numbers import ALLOWED_DIVISOR, is_divisor
from ...names import kind_of, listed, nearest_or_all, show, split_component
from ...optional import optional_import
from ...results.contents import Contents, plain_fields
from ...results.kinds import Kind, Saved, declare
from ...results.stored import Stored
from ...robot.coordinates import UNITS
from ...robot.value import Robot
from ...shown import Plotting, Shown, interval, prefixed
from ...tabular import Rows as TableRows
from ...tabular import TableColumn, Tabular
from ..estimating import SOLVED
from ..geometry.error_model import ErrorModel, Rows
from ..geometry.observations import ENCODER, ORIENTATION, POSITION
from .as_toml import FittedParameters, write_toml
from .as_urdf import write_urdf
from .diagnosing import Diagnosis
from .identifiability import unidentifiable_rows
from .model_record import model_from_record, record_of_model
from .predicting import readings_from, refuse_open
from .variants import NO_GAIN, VARIANTS, Gain, Gains
from .written import TOML, URDF

Residuals = Mapping[str, Mapping[str, Mapping[str, float]]]


@dataclass(frozen=True, kw_only=True)
class CalibrationResult(Plotting, Shown, Tabular, Saved, plot="plot_calibration"):
    """Calibration of a robot by measured poses.

    Attributes:
        robot: the robot's name.
        frames: link of every measured frame.
        rows: of the file.
        names, units: of the P parameters: transforms of bases ("base.x") and of measured frames ("frames.tcp.x"),
            offsets ("joints.joint2.offset.z"), stiffness, terms of drives.
        values: what the description would say, (P,), m, rad, N/m, N m/rad; of dependent ones the least change.
        described: what it says, (P,); NaN where it says nothing.
        deviations: standard deviations, (P,).
        confidence: of intervals.
        rank: independent combinations that the poses show; rank_above_noise: those above their noise.
        merged: why a parameter is not identifiable, by name.
        weak: poorly observable directions, which show less than their noise, with their standard deviations.
        residuals: by variant ("placement", "zeros", "full", "prior"), then "fitted" and "held_out", then "position" (m)
            and "orientation" (rad): rms of components; and "fitted_norm" and "held_out_norm": rms of vectors, such as
            the distance of two points.
        variant: the one that values are of.
        noise: standard deviations by what was measured, such as "tcp.position", known or estimated; m or rad.
        is_noise_known: whether they were known before the fit.
        freedoms: degrees of freedom of the residuals.
        chi2: reduced chi-square, where the noise is known; else None.
        prior: the size that was chosen for the prior, in expected sizes; None without folds.
        gains: over placement alone, held out, by variant, then "position" and "orientation"; none without folds.
        mistrusted: rows that the loss down-weights as outliers, to less than half, with their weights.
        notes: remarks and warnings.
        diagnosis: what residuals show: outlying rows, correlation from row to row, drift, patterns along joints.
        model, x, covariance: the error model, its values and their covariance, for ``predict``.
        source: the file of poses.
        written: residuals, as in ``residuals``, by format ("toml", "urdf"): of what ``to_toml`` and ``to_urdf`` write
            where a description cannot have all terms, such as those of drives.  Its offsets are fitted without these.
        written_values: values and standard deviations that files of these formats have, (F, 2, P).
        is_explained: whether what is left of the poses is small beside the robot, fitted and held out; what is not
            explained is written as a description only if that is forced.
        status: "converged", or which fits have not, of values or of what is written: they are written only if forced.
    """

    robot: str
    frames: Mapping[str, str]
    rows: int
    names: tuple[str, ...]
    units: tuple[str, ...] = field(repr=False)
    values: Annotated[Array, Stored(("P",), "SI", unknown=True)]
    described: Annotated[Array, Stored(("P",), "SI", unknown=True)] = field(repr=False)
    deviations: Annotated[Array, Stored(("P",), "SI", unknown=True)]
    confidence: float = field(repr=False)
    rank: int
    rank_above_noise: int
    merged: Mapping[str, str]
    weak: tuple[tuple[str, float], ...]
    residuals: Residuals
    variant: str
    noise: Mapping[str, float]
    is_noise_known: bool = field(repr=False)
    freedoms: float = field(repr=False)
    chi2: float | None
    prior: float | None
    gains: Gains
    mistrusted: tuple[tuple[int, float], ...]
    notes: tuple[str, ...]
    diagnosis: Annotated[Diagnosis, Stored(otherwise=Diagnosis())] = field(repr=False)
    model: ErrorModel = field(repr=False)
    x: Annotated[Array, Stored(("X",), "SI")] = field(repr=False)
    covariance: Annotated[Array, Stored(("X", "X"), "SI")] = field(repr=False)
    source: str = ""
    is_explained: Annotated[bool, Stored(otherwise=True)] = True
    status: Annotated[str, Stored(otherwise=SOLVED)] = SOLVED
    written: Annotated[Residuals, Stored(otherwise={})] = field(default_factory=dict)
    written_values: Annotated[Array, Stored(("F", 2, "W"), "SI", unknown=True, otherwise=np.zeros((0, 2, 0)))] = field(
        default_factory=lambda: np.zeros((0, 2, 0)), repr=False
    )

    def __getitem__(self, name: str) -> float:
        """Return the value of a parameter; UnknownNameError if there is none of that name."""
        if name not in self.names:
            raise UnknownNameError(f"calibrate: {name!r} was not fitted{nearest_or_all(name, self.names)}")
        return float(self.values[self.names.index(name)])

    @property
    def gain(self) -> Gain | None:
        """The full fit's gain over placement alone, in positions where there are any; None without folds."""
        of_full = self.gains.get("full", {})
        return of_full.get(POSITION, of_full.get(ORIENTATION))

    @property
    def quantile(self) -> float:
        """Standard deviations in half an interval: normal where the noise is known, else Student's t."""
        with optional_import("SciPy", "intervals need"):
            from scipy.special import ndtri, stdtrit
        share = 0.5 + 0.5 * self.confidence
        return float(ndtri(share) if self.is_noise_known else stdtrit(max(self.freedoms, 1.0), share))

    def intervals(self) -> tuple[Array, Array]:
        """Return ends of the intervals of all values, (P,) each."""
        half = self.quantile * self.deviations
        return self.values - half, self.values + half

    def predict(self, q: ArrayLike, frame: str, *, series: int | None = None) -> tuple[Array, Array]:
        """Return poses of a measured frame at other configurations, without loads, and their uncertainty.

        Args:
            q: coordinates of the calibrated robot, (n,) or (N, n), m or rad: those of its joints' coordinates.  Of a
                closed mechanism those of its drives alone, (d,) or (N, d), will do: loops are closed, from the
                description's home on, or from the passive coordinates in q.
            frame: a measured one.
            series: number of the series whose device looks; None: poses in the robot's base frame.

        Returns:
            poses, (4, 4) or (N, 4, 4), and covariances of displacement and small rotation, (6, 6) or (N, 6, 6), m and
            rad; NaN where nothing could be checked and the noise is not known.

        Raises:
            UnknownNameError: no measured frame, or no series, of that name.
            ArrayError: q has a wrong shape or is not finite.
            InputError: the loops of the calibrated robot do not close there.
        """
        chain = self.model.chain
        if frame not in chain.tools:
            raise UnknownNameError(f"predict: {frame!r} was not measured{nearest_or_all(frame, chain.tools)}")
        if series is not None and series not in self.model.bases:
            raise UnknownNameError(f"predict: there is no series {series!r}; known: {sorted(self.model.bases)}")
        coordinates = np.asarray(q, dtype=np.float64)
        readings = readings_from(self.model, coordinates)
        number = min(self.model.bases) if series is None else series
        many = len(readings)
        rows = Rows(readings, np.full(many, number), {}, np.zeros(readings.shape[:2]), np.zeros(many))
        state = self.model.at(self.x, rows)
        refuse_open(self.model, state)
        S = state.sensitivities(chain.tools[frame])
        poses = np.tile(np.eye(4), (many, 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = state.located.R[chain.tools[frame]], state.located.p[chain.tools[frame]]
        if series is None:
            turn, origin = state.located.R[0].transpose(0, 2, 1), state.located.p[0]
            arm = poses[:, :3, 3] - origin
            poses[:, :3, :3], poses[:, :3, 3] = turn @ poses[:, :3, :3], np.einsum("nij,nj->ni", turn, arm)
            S[:, :, [i for i, parameter in enumerate(self.model.parameters) if parameter.station == 0]] = 0.0
            S = np.concatenate([turn @ S[:, :3], turn @ S[:, 3:]], axis=1)
        covariance = S @ self.covariance @ S.transpose(0, 2, 1)
        if not (self.is_noise_known or self.diagnosis.is_checked):
            covariance = np.full_like(covariance, np.nan)
        lead = coordinates.shape[:-1]
        return poses.reshape(*lead, 4, 4), covariance.reshape(*lead, 6, 6)

    @property
    def calibrated(self) -> Robot:
        """The robot with offsets, stiffness and placements of frames, calibrated."""
        return self._fitted(TOML).calibrated

    def _fitted(self, form: str) -> FittedParameters:
        """Return the parameters that a description in a format has."""
        forms = list(self.written)
        arrays = self.written_values[forms.index(form)] if form in forms else (self.values, self.deviations)
        values, deviations = (dict(zip(self.names, array.tolist(), strict=True)) for array in arrays)
        units = dict(zip(self.names, self.units, strict=True))
        return FittedParameters(self.model.robot, self.model.chain, self.frames, values, deviations, units)

    def _refuse_unexplained(self, force: bool) -> None:
        if self.status != SOLVED and not force:
            raise InputError(
                f"{self.source or self.robot}: the calibration has not converged, and is not written as a description:"
                f" {self.status}; allowed: other poses, fewer parameters (fixed), another loss, or --force (force=True)"
            )
        if not (self.is_explained or force):
            raise InputError(
                f"{self.source or self.robot}: the calibration does not explain what was measured, and is not written"
                " as a description; allowed: poses that it explains (notes say what was tried), or --force (force=True)"
            )

    def to_toml(self, path: Path | str, *, force: bool = False) -> Path:
        """Write the description with calibrated values, standard deviations as comments, and return the path.

        Args:
            path: of the file.
            force: whether to write what does not explain the poses, or has not converged.

        Raises:
            InputError: the fit has not converged, the poses are not explained, the robot's file cannot be read any
                more, is not written so that it can be changed, or the file cannot be written.
        """
        self._refuse_unexplained(force)
        return write_toml(self._fitted(TOML), Path(path))

    def to_urdf(self, path: Path | str, *, force: bool = False) -> Path:
        """Write a URDF with calibrated origins (and axes of prismatic joints), and return the path.

        Args:
            path: of the file.
            force: whether to write what does not explain the poses, or has not converged.

        Raises:
            InputError: the fit has not converged, the poses are not explained, the robot has what a URDF cannot say,
                or a file cannot be read or written.
        """
        self._refuse_unexplained(force)
        return write_urdf(self._fitted(URDF), Path(path))

    def as_rows(self) -> TableRows:
        """Return a row per parameter: value, standard deviation, what is described; SI units."""
        columns = [
            TableColumn(key, "SI", getattr(self, f"{key}s" if key != "described" else key))
            for key in ("value", "deviation", "described")
        ]
        merged = np.array([self.merged.get(name, "") for name in self.names], dtype=object)
        columns.append(TableColumn("merged", "", merged))
        return TableRows("name", "", np.array(self.names, dtype=object), columns, {"robot": self.robot})

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {
            **plain_fields(self, "frames", "model", "x", "covariance", "source", "written_values"),
            **{name: _known(getattr(self, name)) for name in ("values", "described", "deviations")},
            "weak": [{"direction": text, "deviation": value} for text, value in self.weak],
            "gain": None if self.gain is None else _gain_values(self.gain),
            "gains": {name: {kind: _gain_values(x) for kind, x in of.items()} for name, of in self.gains.items()},
            "mistrusted": [{"row": row, "weight": weight} for row, weight in self.mistrusted],
            "diagnosis": {
                **plain_fields(self.diagnosis),
                "outlying": [{"row": row, "size": size} for row, size in self.diagnosis.outlying],
            },
        }

    def lines(self) -> list[str]:
        """Return tables for people: residuals, values, what is not identifiable."""
        rank = f"rank {self.rank}, {self.rank_above_noise} above the noise"
        lines = [f"{self.robot}: {self.rows} poses, {rank}, {self.status}", ""]
        lines += self._residual_lines()
        lines += ["", *self.summary_lines()] if any(self.residuals["full"]["held_out"]) else self.summary_lines()
        width = max(len(name) for name in self.names) + 2
        lines += ["", f"{'parameter':<{width}}{'value':>14}{'std. deviation':>16}{'described':>14}  unit"]
        for i, name in enumerate(self.names):
            if name not in self.merged:
                before = "" if np.isnan(self.described[i]) else f"{self.described[i]:.7g}"
                deviation = "unknown" if np.isnan(self.deviations[i]) else f"{self.deviations[i]:.2g}"
                row = f"{self.values[i]:>14.7g}{deviation:>16}{before:>14}  {self.units[i]}"
                lines.append(f"{name:<{width}}{row}")
        if self.merged:
            lines += ["", "not identifiable; their values are those of the least change:"]
            lines += [f"{name:<{width}}{why}" for name, why in unidentifiable_rows(self.merged)]
        if self.weak:
            lines += ["", "poorly observable: standard deviation of the first, along the direction"]
            lines += [f"{value:>10.2g}  {text}" for text, value in self.weak]
        if self.mistrusted:
            rows = ", ".join(f"{row} ({weight:.2f})" for row, weight in self.mistrusted[:12])
            lines += ["", f"rows down-weighted as outliers, with their weights: {rows}"]
        return lines + ["", *(f"note: {note}" for note in self.notes)]

    def summary_lines(self) -> list[str]:
        """Return lines about the gains over placement alone, reduced chi-square, and the noise."""
        lines = self._gain_lines() if any(self.residuals["full"]["held_out"]) else []
        lines += [f"reduced chi-square {self.chi2:.3g}"] if self.chi2 is not None else []
        known = "known" if self.is_noise_known else "estimated"
        return lines + [f"noise of {name}: {_shown(value, name)}, {known}" for name, value in self.noise.items()]

    def _residual_lines(self) -> list[str]:
        kinds = [kind for kind in (POSITION, ORIENTATION) if kind in self.residuals["full"]["fitted"]]
        units = {POSITION: "mm", ORIENTATION: "mrad"}
        lines = [f"{'rms of residuals':<18}" + "".join(f"{f'{k} [{units[k]}]':>24}{'held out':>20}" for k in kinds)]
        lines.append(f"{'':<18}" + f"{'per axis':>14}{'norm':>10}{'per axis':>10}{'norm':>10}" * len(kinds))
        tables = {name: self.residuals[name] for name in VARIANTS if name in self.residuals}
        tables |= {f"in the .{form}": table for form, table in self.written.items()}
        for name, table in tables.items():
            row = ""
            for kind in kinds:
                for split, width in (("fitted", 14), ("fitted_norm", 10), ("held_out", 10), ("held_out_norm", 10)):
                    value = table.get(split, {}).get(kind)
                    row += f"{'' if value is None else f'{1e3 * value:.4g}':>{width}}"
            lines.append(f"{name:<18}{row}".rstrip())
        return lines

    def _gain_lines(self) -> list[str]:
        """Return the verdict, and by how much every variant is better or worse than placement alone."""
        if not self.gains:
            return ["gain: too few poses to say"]
        better, worse = list[str](), list[str]()
        lines = []
        for name, gains in self.gains.items():
            parts = []
            for kind, gain in gains.items():
                better += [f"{name} in {kind}"] if gain.is_significant else []
                worse += [f"{name} in {kind}"] if gain.is_loss else []
                parts.append(f"{kind} {gain.ratio:.3g} ({interval(gain.low, gain.high)})")
            lines.append(f"  over {name + ':':<8} {', '.join(parts)}")
        head = f"gain: {', '.join(better)}" if better else f"{NO_GAIN} over placement alone"
        head += f"; worse than placement alone: {', '.join(worse)}" if worse else ""
        share = f"{100 * self.confidence:g} % intervals"
        return [head, f"error that placement alone leaves, held out, as a multiple ({share}):", *lines]


def _gain_values(gain: Gain) -> dict[str, Any]:
    return {**vars(gain), "is_significant": gain.is_significant}


def _known(values: Array) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in values.tolist()]


def _shown(value: float, name: str) -> str:
    owner, kind = split_component(name)
    is_turn = kind == ORIENTATION or (kind == ENCODER and UNITS[kind_of(owner)] == "rad")
    return prefixed(value, "rad" if is_turn else "m", 4)


def _gains(file: Contents) -> Gains:
    """Return gains by variant and kind.

    Files of before have that of the full one alone, of positions where there are any.
    """
    if "gains" in file.plain:
        gains: Gains = file.value(Mapping[str, Mapping[str, Gain]], "gains")
        return gains
    gain = file.value(Gain | None, "gain")
    kind = next(kind for kind in (POSITION, ORIENTATION) if kind in file.plain["residuals"]["full"]["fitted"])
    return {} if gain is None else {"full": {kind: gain}}


def _rebuild(file: Contents) -> dict[str, Any]:
    return {"gains": _gains(file), "model": model_from_record(file, file.value(Mapping[str, str], "frames"))}


def _sizes(result: CalibrationResult) -> dict[str, int]:
    many, forms = len(result.names), len(result.written)
    return {"P": many, "X": len(result.model.parameters), "F": forms} | ({"W": many} if forms else {})


def _check(result: CalibrationResult, path: str) -> None:
    many = len(result.names)
    for key, good, allowed in (
        ("names", many > 0, "one or more"),
        ("units", len(result.units) == many, f"{many}, one for each of names"),
        ("confidence", 0.0 < result.confidence < 1.0, "a number between 0 and 1"),
        ("variant", result.variant in VARIANTS, listed(VARIANTS)),
        ("residuals", _is_whole(result.residuals), "fitted and held_out of the variants, full among them"),
        ("noise", all(map(is_divisor, result.noise.values())), f"of each, {ALLOWED_DIVISOR}"),
    ):
        if not good:
            raise InputError(f"{path}: {key}: got {show(str(getattr(result, key)))}; allowed: {allowed}")


def _is_whole(residuals: Residuals) -> bool:
    """Return whether residuals have all that lines say of them."""
    parts = [residuals[name] for name in VARIANTS if name in residuals]
    kinds = set(residuals.get("full", {}).get("fitted", {}))
    known, norms = {"fitted", "held_out"}, {"fitted_norm", "held_out_norm"}
    return "full" in residuals and all(
        known <= set(table) <= known | norms and kinds.issubset(table["fitted"]) for table in parts
    )


load_calibration = declare(
    Kind(
        "calibration",
        CalibrationResult,
        rebuilt=("gains", "model"),
        record=lambda result: {"gains": result.gains, **record_of_model(result.model, result.frames)},
        rebuild=_rebuild,
        sizes=_sizes,
        check=_check,
        is_finite=False,
    )
)
"""Read the result that ``CalibrationResult.save`` wrote; InputError says what in the file is wrong."""
