"""Figures of ISO 9283 as values: their table, their file, and how they differ from what the standard asks for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...forms.plain import value_of
from ...results.contents import Contents
from ...results.kinds import Kind, Saved, declare
from ...shown import Plotting, Shown
from ...tabular import Rows, TableColumn, Tabular

Vector = tuple[float, float, float]

STANDARD = "ISO 9283:1998"


def vector(values: Array) -> Vector:
    """Return three numbers of an array."""
    x, y, z = values.tolist()
    return x, y, z


@dataclass(frozen=True, kw_only=True)
class PoseFigures:
    """Figures of one pose, clause 7.2; m, rad, axes of the base.

    Attributes:
        name: of the pose.
        cycles: number of times that it was attained.
        command, barycentre: positions.
        offset: AP_x, AP_y, AP_z, barycentre less command; accuracy: AP_p, its length.
        mean, deviation: l-bar and S_l of the distances to the barycentre, S_l by n - 1.
        repeatability: RP_l = l-bar + 3 S_l.
        turned: AP_a, AP_b, AP_c: mean angles by which the tool is turned from its command; None without orientations.
        turning: RP_a, RP_b, RP_c: 3 standard deviations of the same angles.
        attained: positions, one for each cycle.
    """

    name: str
    cycles: int
    command: Vector
    barycentre: Vector
    offset: Vector
    accuracy: float
    mean: float
    deviation: float
    repeatability: float
    turned: Vector | None = None
    turning: Vector | None = None
    attained: tuple[Vector, ...] = ()


@dataclass(frozen=True, kw_only=True)
class SpeedFigures:
    """Velocities along a path, clause 8.6, where the command has at least 99 % of its greatest speed.

    command: mean commanded speed, m/s.  accuracy, repeatability: AV and RV, as shares of it (0.01 is 1 %).
    fluctuation: FV, m/s, the greatest of all cycles.
    """

    command: float
    accuracy: float
    repeatability: float
    fluctuation: float


@dataclass(frozen=True, kw_only=True)
class CornerFigures:
    """Deviations at a corner of a path, clause 8.5; m, rad.

    along: length of the commanded path up to it.  angle: by which the path turns there.  rounding: CR, the least
    distance of the attained path from the corner; overshoot: CO, its greatest distance from the path behind the corner
    on the outer side; of both the greatest of all cycles.
    """

    along: float
    angle: float
    cycles: int
    rounding: float
    overshoot: float


@dataclass(frozen=True, kw_only=True)
class PathFigures:
    """Figures of one path, clause 8; m, rad.

    Attributes:
        name: of the path.
        cycles: number of times that it was followed.
        length: of the commanded path.
        points: number of its points that were compared; left_out: of those that not every cycle passes.
        accuracy: AT_p, greatest distance of a barycentre from its commanded point.
        repeatability: RT_p, greatest l-bar + 3 S_l of a point.
        accuracy_at, repeatability_at: lengths along the path where those are.
        turned, turning: AT_a, AT_b, AT_c and RT_a, RT_b, RT_c: greatest of all points; None without orientations.
        speed: velocities; None where times are not known.
        corners: deviations at its corners.
        along, offsets, scatters: by point (points,): length along the path, distance of the barycentre, l-bar + 3 S_l.
    """

    name: str
    cycles: int
    length: float
    points: int
    left_out: int
    accuracy: float
    repeatability: float
    accuracy_at: float
    repeatability_at: float
    turned: Vector | None = None
    turning: Vector | None = None
    speed: SpeedFigures | None = None
    along: tuple[float, ...] = ()
    offsets: tuple[float, ...] = ()
    scatters: tuple[float, ...] = ()
    corners: tuple[CornerFigures, ...] = ()


@dataclass(frozen=True, kw_only=True)
class DistanceFigures:
    """Distance between two poses, clause 7.3; m, rad.

    Attributes:
        poses: names of both.
        cycles: number of cycles that attained both.
        command, mean: distances; accuracy: AD_p, mean less command; repeatability: RD_p = 3 S, by n - 1.
        by_axis, by_axis_repeatability: AD and RD of x, y and z.
        turned, turning: AD and RD of the angles a, b and c between both orientations; None without orientations.
    """

    poses: tuple[str, str]
    cycles: int
    command: float
    mean: float
    accuracy: float
    repeatability: float
    by_axis: Vector
    by_axis_repeatability: Vector
    turned: Vector | None = None
    turning: Vector | None = None


@dataclass(frozen=True, kw_only=True)
class VariationFigures:
    """Variation of a pose that is reached from several directions, clause 7.2.3; m, rad.

    poses: names that it has by direction.  cycles: of each at least.  position: vAP_p, greatest distance between the
    barycentres of two directions; turned: vAP_a, vAP_b, vAP_c, of the mean angles; None without orientations.
    """

    poses: tuple[str, ...]
    cycles: int
    position: float
    turned: Vector | None = None


@dataclass(frozen=True, kw_only=True)
class StopFigures:
    """Stabilization and overshoot at a pose, clauses 7.4 and 7.5.

    band: limit band, m.  time: stabilization time, s, mean of the cycles.  overshoot: the greatest of them, m.
    """

    pose: str
    cycles: int
    band: float
    time: float
    overshoot: float


@dataclass(frozen=True, kw_only=True)
class AccuracyResult(Plotting, Shown, Tabular, Saved, plot="plot_accuracy"):
    """Figures by the definitions of ISO 9283:1998.

    Attributes:
        source: "simulated", "samples of a plan" or "measured".
        robot, frame: names; robot is empty where files do not say it.
        load, rate: load and speed of the test, in words.
        exact: whether cycles repeat themselves because nothing differs between them, so that RP and RT are 0.
        poses, paths, distances, stops: figures of each.
        variations: of poses that are commanded several times, reached from different directions.
        notes: lines about the method, and about what differs from the standard's test.
    """

    source: str
    robot: str
    frame: str
    load: str
    rate: str
    exact: bool
    poses: tuple[PoseFigures, ...]
    paths: tuple[PathFigures, ...]
    distances: tuple[DistanceFigures, ...]
    stops: tuple[StopFigures, ...]
    notes: tuple[str, ...]
    variations: tuple[VariationFigures, ...] = ()

    def summary(self) -> dict[str, Any]:
        """Return the worst of each figure, as plain numbers in SI units; None where there is none."""
        worst = {
            "AP": [item.accuracy for item in self.poses],
            "RP": [item.repeatability for item in self.poses],
            "vAP": [item.position for item in self.variations],
            "AT": [item.accuracy for item in self.paths],
            "RT": [item.repeatability for item in self.paths],
            "CR": [corner.rounding for item in self.paths for corner in item.corners],
            "CO": [corner.overshoot for item in self.paths for corner in item.corners],
            "AD": [abs(item.accuracy) for item in self.distances],
            "RD": [item.repeatability for item in self.distances],
            "stabilization": [item.time for item in self.stops],
            "overshoot": [item.overshoot for item in self.stops],
        }
        return {name: max(values, default=None) for name, values in worst.items()}

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {"standard": STANDARD, "summary": self.summary(), **asdict(self)}

    def as_rows(self) -> Rows:
        """Return a row per figure by its symbol and what it is of: value and unit, SI."""
        figures = list(self._figures())
        columns = [
            TableColumn("of", "", np.array([of for of, _, _, _ in figures], dtype=object)),
            TableColumn("value", "SI", np.array([value for _, _, value, _ in figures], dtype=np.float64)),
            TableColumn("unit", "", np.array([unit for _, _, _, unit in figures], dtype=object)),
        ]
        about = {"robot": self.robot, "frame": self.frame, "source": self.source}
        return Rows("figure", "", np.array([symbol for _, symbol, _, _ in figures], dtype=object), columns, about)

    def _figures(self) -> Iterator[tuple[str, str, float, str]]:
        """Yield every figure: whose it is, symbol, value and unit."""
        for pose in self.poses:
            of = f"pose {pose.name}"
            yield of, "AP_p", pose.accuracy, "m"
            yield from _by_axis(of, "AP", pose.offset, "m")
            yield of, "RP_l", pose.repeatability, "m"
            yield from _by_axis(of, "AP", pose.turned)
            yield from _by_axis(of, "RP", pose.turning)
        for variation in self.variations:
            of = f"poses {' and '.join(variation.poses)}"
            yield of, "vAP_p", variation.position, "m"
            yield from _by_axis(of, "vAP", variation.turned)
        for path in self.paths:
            of = f"path {path.name}"
            yield of, "AT_p", path.accuracy, "m"
            yield of, "RT_p", path.repeatability, "m"
            yield from _by_axis(of, "AT", path.turned)
            yield from _by_axis(of, "RT", path.turning)
            if path.speed is not None:
                yield of, "AV", path.speed.accuracy, "1"
                yield of, "RV", path.speed.repeatability, "1"
                yield of, "FV", path.speed.fluctuation, "m/s"
            for number, corner in enumerate(path.corners, 1):
                yield f"{of}, corner {number}", "CR", corner.rounding, "m"
                yield f"{of}, corner {number}", "CO", corner.overshoot, "m"
        for distance in self.distances:
            of = f"poses {' and '.join(distance.poses)}"
            yield of, "AD_p", distance.accuracy, "m"
            yield of, "RD_p", distance.repeatability, "m"
            yield from _by_axis(of, "AD", distance.by_axis, "m")
            yield from _by_axis(of, "RD", distance.by_axis_repeatability, "m")
            yield from _by_axis(of, "AD", distance.turned)
            yield from _by_axis(of, "RD", distance.turning)
        for stop in self.stops:
            yield f"pose {stop.pose}", "t", stop.time, "s"
            yield f"pose {stop.pose}", "OV", stop.overshoot, "m"

    def lines(self) -> list[str]:
        """Return tables for people: lengths in mm, angles in mrad."""
        name = f"{self.robot}, {self.frame}" if self.robot else self.frame
        lines = [f"{name}: accuracy by the definitions of {STANDARD}, {self.source}"]
        lines += [f"  load: {self.load}", f"  rate: {self.rate}", ""]
        for rows in self.tables().values():
            lines += [*_table(rows), ""] if len(rows) > 1 else []
        return lines + [f"note: {text}" for text in self.notes]

    def tables(self) -> dict[str, Sequence[tuple[str, ...]]]:
        """Return rows of texts by what they are of, the first with what is in the columns.

        Lengths in mm, angles in mrad.
        """
        return {
            "Poses": [
                ("pose", "cycles", "AP mm", "RP mm", "AP a b c mrad", "RP a b c mrad"),
                *((x.name, str(x.cycles), *_accuracy_texts(x)) for x in self.poses),
            ],
            "Reached from several directions": [
                ("poses", "cycles", "vAP mm", "vAP a b c mrad"),
                *(
                    (" - ".join(x.poses), str(x.cycles), _milli(x.position), _angle_text(x.turned))
                    for x in self.variations
                ),
            ],
            "Paths": [
                ("path", "cycles", "AT mm", "RT mm", "AT a b c mrad", "RT a b c mrad", "AV %", "RV %", "FV mm/s"),
                *((x.name, str(x.cycles), *_accuracy_texts(x), *_speed_texts(x.speed)) for x in self.paths),
            ],
            "Corners": [
                ("corner of path", "at mm", "turn deg", "cycles", "CR mm", "CO mm"),
                *((path.name, *_corner_texts(corner)) for path in self.paths for corner in path.corners),
            ],
            "Distances": [
                ("poses", "cycles", "distance mm", "AD mm", "RD mm"),
                *((" - ".join(x.poses), str(x.cycles), *_distance_texts(x)) for x in self.distances),
            ],
            "Stops": [
                ("stop", "cycles", "band mm", "stabilization s", "overshoot mm"),
                *((x.pose, str(x.cycles), _milli(x.band), f"{x.time:.4g}", _milli(x.overshoot)) for x in self.stops),
            ],
        }


def _read(file: Contents) -> AccuracyResult:
    values = dict(file.plain)
    if values.pop("standard", None) != STANDARD:
        raise InputError(f"{file.path}: holds no figures of {STANDARD}; allowed: a file that eomgen accuracy wrote")
    result: AccuracyResult = value_of(AccuracyResult, values, file.path)
    return result


load_accuracy = declare(
    Kind("accuracy", AccuracyResult, ending=".json", record=lambda _: {"standard": STANDARD}, read=_read)
)
"""Read the result that ``AccuracyResult.save`` wrote; InputError says what in the file is wrong."""


def _by_axis(of: str, symbol: str, values: Vector | None, unit: str = "rad") -> Iterator[tuple[str, str, float, str]]:
    for axis, value in zip("xyz" if unit == "m" else "abc", values or (), strict=False):
        yield of, f"{symbol}_{axis}", value, unit


def _table(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Return rows as text, their columns under each other; columns without entries are left out."""
    kept = [i for i in range(len(rows[0])) if any(row[i] for row in rows[1:])]
    widths = [max(len(row[i]) for row in rows) for i in kept]
    return ["  ".join(row[i].rjust(width) for i, width in zip(kept, widths, strict=True)) for row in rows]


def _milli(value: float) -> str:
    return f"{1e3 * value:.4g}"


def _angle_text(angles: Vector | None) -> str:
    return "" if angles is None else " ".join(f"{1e3 * x:.3g}" for x in angles)


def _accuracy_texts(x: PoseFigures | PathFigures) -> tuple[str, ...]:
    return _milli(x.accuracy), _milli(x.repeatability), _angle_text(x.turned), _angle_text(x.turning)


def _speed_texts(x: SpeedFigures | None) -> tuple[str, str, str]:
    if x is None:
        return "", "", ""
    return f"{1e2 * x.accuracy:+.3g}", f"{1e2 * x.repeatability:.3g}", f"{1e3 * x.fluctuation:.3g}"


def _corner_texts(x: CornerFigures) -> tuple[str, ...]:
    angle = f"{np.rad2deg(x.angle):.3g}"
    return f"{1e3 * x.along:.6g}", angle, str(x.cycles), _milli(x.rounding), _milli(x.overshoot)


def _distance_texts(x: DistanceFigures) -> tuple[str, ...]:
    return f"{1e3 * x.command:.6g}", f"{1e3 * x.accuracy:+.4g}", _milli(x.repeatability)
