"""Contents of a sweep's folder: the one declaration of sweep.json, and the check of each row against it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ..errors import InputError
from ..forms.plain import value_of
from ..forms.tables import Form
from ..identifiers import is_identifier, is_robot_name
from ..limits import LARGEST_FOUND
from ..motion.exceeding import KINDS
from ..names import listed, show
from .design import Design
from .keys import DESIGNS, DISTRIBUTIONS, MOST_SAMPLES
from .measures import Column
from .plan import Distribution, read_distribution

ROUNDING = 1e-9  # relative: other machines' elementary functions
MOST_STRATA = 1 << 22  # numbers of a Latin hypercube that are drawn anew to compare samples with

_DISTRIBUTION = Form(DISTRIBUTIONS)


@dataclass(frozen=True)
class Varied:
    """A number that varies: "parameter" or "scenario", its name, the nominal value of relative numbers.

    ``distribution``: its index in ``Manifest.distributions``.
    """

    kind: str
    name: str
    relative_to: float | None = None
    distribution: int | None = None


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """Everything of sweep.json; fields with a default are not in folders of format 1."""

    format: int
    key: str
    eomgen: str
    robot: str
    tool: str
    samples: int
    seed: int
    design: str
    varied: tuple[Varied, ...]
    columns: tuple[Column, ...]
    scenario: Mapping[str, Any]
    notes: tuple[str, ...]
    draws: int = 0
    distributions: tuple[Mapping[str, Any], ...] = ()

    @property
    def scale(self) -> tuple[float, ...]:
        """Factors from the numbers of rows to SI units, (d,)."""
        return tuple(1.0 if item.relative_to is None else float(item.relative_to) for item in self.varied)

    def made_by(self) -> Design | None:
        """Return the samples' design; None of older folders, and of one that would take long to draw."""
        if not self.distributions:
            return None
        distributions = _distributions(self, "sweep.json")
        if self.design != "random" and self.draws * len(distributions) > MOST_STRATA:
            return None
        return Design(distributions, self.draws, self.seed, self.design)


def manifest_of(data: Mapping[str, Any], where: str) -> Manifest:
    """Return the manifest of the values of sweep.json.

    Raises:
        InputError: something is missing, unknown, of another type, or does not belong together; begins with ``where``.
    """
    manifest: Manifest = value_of(Manifest, data, where)

    def refuse(key: str, value: object, allowed: str) -> None:
        raise InputError(f"{where}: {key}: got {show(value)}; allowed: {allowed}")

    if not is_robot_name(manifest.robot):
        refuse("robot", manifest.robot, "a robot's name")
    if not is_identifier(manifest.tool):
        refuse("tool", manifest.tool, "a frame's name")
    for item in manifest.varied:
        if item.kind not in ("parameter", "scenario"):
            refuse("varied", item.kind, "parameter, scenario")
    if manifest.design not in DESIGNS:
        refuse("design", manifest.design, ", ".join(DESIGNS))
    if manifest.seed < 0:
        refuse("seed", manifest.seed, "a whole number from 0 on")
    for key, names in (("varied", [x.name for x in manifest.varied]), ("columns", [x.name for x in manifest.columns])):
        if not names or len(set(names)) < len(names):
            raise InputError(f"{where}: {key}: got {listed(names)}; allowed: one or more different names")
    if manifest.samples < 1:
        refuse("samples", manifest.samples, "a whole number from 1 on")
    if manifest.format > 1:
        if not 1 <= manifest.draws <= MOST_SAMPLES:
            refuse("draws", manifest.draws, f"a whole number from 1 to {MOST_SAMPLES}")
        grids = math.prod(len(x.values) for x in _distributions(manifest, where) if x.kind == "grid")
        if manifest.samples != grids * manifest.draws:
            refuse(
                "samples", manifest.samples, f"{grids * manifest.draws}, as many as its distributions and draws make"
            )
    return manifest


def _distributions(manifest: Manifest, where: str) -> list[Distribution]:
    """Return a distribution for each number that varies."""
    tables = (
        _DISTRIBUTION.read(dict(entry), f"distributions[{i}]", where, ())
        for i, entry in enumerate(manifest.distributions)
    )
    known = [read_distribution(table) for table in tables]
    for item in manifest.varied:
        if item.distribution is None or not 0 <= item.distribution < len(known):
            raise InputError(
                f"{where}: varied: {show(item.name)}: got the distribution {show(item.distribution)};"
                f" allowed: 0 to {len(known) - 1}"
            )
    return [known[item.distribution] for item in manifest.varied if item.distribution is not None]


@dataclass(frozen=True)
class SampleRow:
    """Outcome of sample ``index`` with its numbers: the recorded numbers, or an error.

    exceeded: limits of the robot that the motion exceeds, "joint1.gamma speed" say.
    """

    index: int
    sample: tuple[float, ...]
    record: tuple[float, ...] = ()
    error: str = ""
    exceeded: tuple[str, ...] = ()


CheckRow = Callable[[SampleRow], str]


def row_check(manifest: Manifest) -> CheckRow:
    """Return a check of this sweep's rows: what is wrong with a row, and what is allowed; "" where nothing is."""
    design, total = manifest.made_by(), manifest.samples
    varied, columns = len(manifest.varied), len(manifest.columns)

    def check(row: SampleRow) -> str:
        if not 0 <= row.index < total:
            return f"got the index {row.index}; allowed: 0 to {total - 1}"
        if len(row.sample) != varied:
            return f"got {len(row.sample)} numbers of the sample; allowed: {varied}"
        if bool(row.error) == bool(row.record) or (row.record and len(row.record) != columns):
            came = f"{len(row.record)} numbers and the error {show(row.error)}"
            return f"got {came}; allowed: {columns} numbers, or an error"
        for limit in row.exceeded:
            coordinate, _, kind = limit.partition(" ")
            if kind not in KINDS or not all(map(is_identifier, coordinate.split("."))):
                return f"got {show(limit)} among the limits exceeded; allowed: a coordinate, and one of {listed(KINDS)}"
        for name, ours, theirs in zip(
            manifest.varied, row.sample, design.values(row.index) if design else row.sample, strict=True
        ):
            if not abs(ours - theirs) <= ROUNDING * max(abs(ours), abs(theirs)):
                return f"got {ours!r} for {name.name}; allowed: {theirs!r}, which seed and index make"
        return ""

    return check


def finite_or_error(names: tuple[Column, ...], record: tuple[float, ...]) -> str:
    """Say why a record cannot be kept: the first number that is not finite; "" where all are."""
    for column, value in zip(names, record, strict=True):
        if not abs(value) <= LARGEST_FOUND:
            return f"InputError: {column.name} is {value!r}; allowed: a finite number"
    return ""
