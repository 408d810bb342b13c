"""Results of sweeps: a table by sample, percentiles of recorded numbers, and their sensitivities."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import InputError, UnknownNameError
from ..files import write_atomically, write_csv
from ..motion.exceeding import SHOWN
from ..names import nearest, show
from ..optional import optional_import
from ..shown import Plotting, Shown, text_of
from ..tabular import Rows, TableColumn, Tabular
from .contents import manifest_of, row_check
from .store import MANIFEST, read_manifest, read_rows

SHARES = (5, 25, 50, 75, 95, 99)  # percentiles that are printed
LINEAR_ENOUGH = 0.9  # R^2 from which regression coefficients are what a ranking goes by


@dataclass(frozen=True)
class Sensitivity(Shown, Tabular):
    """Global sensitivity of a recorded number to the numbers that vary, (d,) each.

    Attributes:
        names: of the numbers that vary.
        regression: standardised regression coefficients: standard deviations of the recorded number per standard
            deviation of a varied one, all others fixed, in the linear model of least squares; NaN where there are no
            more samples than numbers.
        r_squared: share of the variance that this model explains.
        spearman: rank correlations: +-1 where one rises or falls with the other, whatever the curve.
        noise: size below which a rank correlation may be chance: 2 / sqrt(samples - 1).
    """

    names: tuple[str, ...]
    regression: Array
    r_squared: float
    spearman: Array
    noise: float

    def as_rows(self) -> Rows:
        """Return a row per number that varies: its regression coefficient and its rank correlation."""
        columns = [TableColumn(name, "1", getattr(self, name)) for name in ("regression", "spearman")]
        return Rows("varied", "", np.array(self.names, dtype=object), columns)

    @property
    def ranking(self) -> list[int]:
        """Indices of the names by influence: by regression where it explains the variance, else by rank correlation."""
        by = self.regression if self.r_squared >= LINEAR_ENOUGH else self.spearman
        return [int(i) for i in np.argsort(-np.abs(np.nan_to_num(by)), kind="stable")]


@dataclass(frozen=True, kw_only=True)
class SweepResult(Plotting, Shown, Tabular, plot="plot_column"):
    """The samples that a folder has, by index.

    Attributes:
        folder: where they are.
        index: (N,), increasing; all of range(total) once the sweep is complete.
        varied, columns: names of the numbers that vary and of recorded ones; ``units`` by name of the latter.
        samples: (N, d), SI units; absolute, also where the plan was relative.
        record: (N, c); NaN in samples that failed.
        errors: of failed samples, by index.
        total: number of samples of the plan.
        exceeded: number of samples that exceed a limit of the robot, by limits: "joint1.gamma speed", say.
        meta: of the sweep: robot, tool, seed, design, scenario, notes, versions.
    """

    folder: Path
    index: NDArray[np.int64]
    varied: tuple[str, ...]
    columns: tuple[str, ...]
    units: Mapping[str, str]
    samples: Array
    record: Array
    errors: Mapping[int, str]
    total: int
    meta: Mapping[str, Any]
    exceeded: Mapping[str, int] = field(default_factory=dict)

    @staticmethod
    def load(folder: Path | str) -> SweepResult:
        """Load a sweep's folder, also while it is running or after its end by force.

        Checksums are compared, and the samples' numbers with those of seed and index.

        Raises:
            InputError: the folder holds no sweep, or what it holds was changed; says which line.
        """
        folder = Path(folder)
        about = manifest_of(read_manifest(folder), f"{folder / MANIFEST}")
        rows = read_rows(folder, row_check(about), checked=about.format > 1)
        index = np.array(sorted(rows), dtype=np.int64)
        nothing = (float("nan"),) * len(about.columns)
        samples = np.array([rows[i].sample for i in index.tolist()], dtype=np.float64)
        record = np.array([rows[i].record or nothing for i in index.tolist()], dtype=np.float64)
        return SweepResult(
            folder=folder,
            index=index,
            varied=tuple(item.name for item in about.varied),
            columns=tuple(item.name for item in about.columns),
            units=MappingProxyType({item.name: item.unit for item in about.columns}),
            samples=samples.reshape(-1, len(about.varied)) * np.array(about.scale),
            record=record.reshape(-1, len(about.columns)),
            errors=MappingProxyType({i: rows[i].error for i in index.tolist() if rows[i].error}),
            total=about.samples,
            meta=MappingProxyType({item.name: getattr(about, item.name) for item in fields(about)}),
            exceeded=MappingProxyType(Counter(limit for i in index.tolist() for limit in rows[i].exceeded)),
        )

    @property
    def complete(self) -> bool:
        """Whether every sample of the plan is there, failed ones among them."""
        return self.index.size == self.total

    def of(self, column: str) -> Array:
        """Return a recorded number of all samples, (N,); UnknownNameError if there is none of that name."""
        if column not in self.columns:
            raise UnknownNameError(
                f"column: {show(column)} is unknown{nearest(column, self.columns)}; known: {', '.join(self.columns)}"
            )
        return self.record[:, self.columns.index(column)]

    def percentiles(self, column: str, shares: tuple[float, ...] = SHARES) -> Array:
        """Return percentiles of a recorded number over the samples that did not fail, linear between samples."""
        values = self.of(column)
        values = values[np.isfinite(values)]
        percentiles: Array = np.percentile(values, shares) if values.size else np.full(len(shares), np.nan)
        return percentiles

    def sensitivity(self, column: str) -> Sensitivity:
        """Return the sensitivity of a recorded number, over the samples that did not fail."""
        y = self.of(column)
        good = np.isfinite(y)
        return sensitivity_of(self.varied, self.samples[good], y[good])

    def facts(self) -> dict[str, str]:
        """Return names and short texts that ``repr`` and notebooks show."""
        shown = {"robot": show(self.meta["robot"]), "samples": f"{self.index.size} of {self.total}"}
        shown |= {"failed": str(len(self.errors)), "varied": text_of(self.varied), "columns": text_of(self.columns)}
        return shown | {"folder": text_of(self.folder)}

    def as_rows(self) -> Rows:
        """Return a row per sample by its index: numbers that vary, recorded ones, and the error of a failed one."""
        columns = [TableColumn(name, "SI", self.samples[:, i]) for i, name in enumerate(self.varied)]
        columns += [TableColumn(name, self.units[name], self.record[:, i]) for i, name in enumerate(self.columns)]
        texts = np.array([self.errors.get(i, "") for i in self.index.tolist()], dtype=object)
        about = {"robot": str(self.meta["robot"]), "tool": str(self.meta["tool"])}
        return Rows("index", "1", self.index, [*columns, TableColumn("error", "", texts)], about)

    def save_table(self, path: Path | str) -> Path:
        """Write a row for every sample as .csv, or as .parquet where pyarrow is installed.

        Raises:
            InputError: another suffix, pyarrow is not installed, or the file cannot be written.
        """
        path = Path(path)
        rows = self.as_rows()
        columns = {"index": self.index, **{column.name: column.values for column in rows.columns}}
        if path.suffix == ".csv":
            return write_csv(
                path, [columns, *zip(*(values.tolist() for values in columns.values()), strict=True)], read=None
            )
        if path.suffix != ".parquet":
            raise InputError(f"{path}: the suffix {path.suffix!r} is no table; allowed: .csv, .parquet")
        with optional_import("pyarrow", "Parquet needs", ".csv works without"):
            import pyarrow
            from pyarrow import parquet
        return write_atomically(path, lambda stream: parquet.write_table(pyarrow.table(columns), stream), read=None)

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as values that JSON holds."""
        columns = {}
        for column in self.columns:
            ranked = self.sensitivity(column)
            columns[column] = {
                "unit": self.units[column],
                "percentiles": dict(zip(map(str, SHARES), _plain(self.percentiles(column)), strict=True)),
                "r_squared": _plain(np.array([ranked.r_squared]))[0],
                "regression": dict(zip(ranked.names, _plain(ranked.regression), strict=True)),
                "spearman": dict(zip(ranked.names, _plain(ranked.spearman), strict=True)),
            }
        about = {key: self.meta[key] for key in ("robot", "tool", "seed", "design")}
        about["notes"] = list(self.meta["notes"])
        return {
            **about,
            "samples": self.total,
            "done": int(self.index.size),
            "failed": len(self.errors),
            "exceeded": dict(self.exceeded),
            "columns": columns,
        }

    def lines(self) -> list[str]:
        """Return the summary as lines of text."""
        state = "" if self.complete else f", {self.total - self.index.size} of {self.total} not done"
        lines = [f"{self.meta['robot']}: {self.index.size} samples, {len(self.errors)} failed{state}"]
        lines += [f"  {note}" for note in self.meta["notes"]]
        if self.exceeded:
            limits = [f"{limit} in {count}" for limit, count in self.exceeded.items()]
            more = f" and {len(limits) - SHOWN} more" if len(limits) > SHOWN else ""
            lines.append(f"  samples that exceed limits of the robot: {', '.join(limits[:SHOWN])}{more}")
        width = max(map(len, self.columns))
        lines.append(f"  {'percentiles':<{width}}" + "".join(f" {share:>10}" for share in SHARES))
        for column in self.columns:
            numbers = "".join(f" {value:>10.4g}" for value in self.percentiles(column))
            lines.append(f"  {column:<{width}}{numbers} {self.units[column]}")
        column = self.columns[0]
        ranked = self.sensitivity(column)
        lines.append(
            f"  what {column} goes with: regression coefficients (R^2 {ranked.r_squared:.3f}), rank correlations"
            f" (chance: {ranked.noise:.2g})"
        )
        for i in ranked.ranking[:10]:
            lines.append(f"    {ranked.names[i]}: {ranked.regression[i]:+.3f}, {ranked.spearman[i]:+.3f}")
        if ranked.r_squared < LINEAR_ENOUGH:
            lines.append("    a linear model explains too little: ranked by rank correlation, which sees trends alone")
        lines += [f"  sample {i} failed: {text}" for i, text in list(self.errors.items())[:5]]
        return lines


def _plain(values: Array) -> list[float | None]:
    """Return numbers for JSON, None where they are not finite."""
    return [float(x) if np.isfinite(x) else None for x in values]


def sensitivity_of(names: tuple[str, ...], x: Array, y: Array) -> Sensitivity:
    """Return regression and rank correlations of y, (N,), with each column of x, (N, d)."""
    count, d = x.shape
    nothing = np.full(d, np.nan)
    noise = 2.0 / np.sqrt(count - 1) if count > 1 else float("inf")
    if count < 3 or not np.ptp(y) > 0.0:
        return Sensitivity(names, nothing, float("nan"), nothing, noise)
    spread = x.std(axis=0)
    moved = spread > 0.0
    regression, r_squared = nothing.copy(), float("nan")
    if count > moved.sum() + 1:
        a, b = (x[:, moved] - x[:, moved].mean(axis=0)) / spread[moved], (y - y.mean()) / y.std()
        coefficients = np.linalg.lstsq(a, b, rcond=None)[0]
        regression[moved] = coefficients
        r_squared = float(1.0 - ((b - a @ coefficients) ** 2).mean())
    spearman, ranks = nothing.copy(), _ranks(y)
    for i in np.flatnonzero(moved):
        spearman[i] = np.corrcoef(_ranks(x[:, i]), ranks)[0, 1]
    return Sensitivity(names, regression, r_squared, spearman, noise)


def _ranks(values: Array) -> Array:
    """Return ranks from 0 on, the mean rank where values are equal."""
    _, places, counts = np.unique(values, return_inverse=True, return_counts=True)
    ends = np.cumsum(counts)
    ranks: Array = (ends - (counts + 1) / 2.0)[places]
    return ranks
