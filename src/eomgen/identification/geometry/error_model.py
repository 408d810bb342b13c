"""The error model: every parameter is a coordinate of a station times a factor of the row, so that all have one form.

    s = reading + sum over parameters of value * factor(row)

The factor is 1 of an offset, whether the row is of that series of a base's placement, the force (13) in a coordinate of
its compliance, the reading itself of a gain, and so on.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Index
from ...names import component_name, parameter_name
from ...robot.coordinates import UNITS
from ...robot.joint_types import rigid_components
from ...robot.value import COORDINATES, Robot
from .blocks import ENTRY, FORCE, Block, blocks_of
from .loop_constraints import LoopConstraints
from .poses import MeasuredPoses, rows_at
from .stations import Chain, Located, Station, forces_on, jacobian, located

BASE, FRAMES, JOINTS, LOOPS = "base", "frames", "joints", "loops"
TILT = "axis"  # of a prismatic joint: joints.NAME.axis.alpha turns its placement about the local x axis
SECOND = "second"  # of a loop joint: loops.NAME.second.x moves its frame on the second link
SIZES = (1e-3, 3e-3)  # of an offset that is expected: of the reach (1), and rad
PLACEMENT, ZERO, OFFSET, COMPLIANCE, DRIVE = "placement", "zero", "offset", "compliance", "drive"
PASSES = 3  # of loads on what they deflect; each is as exact as the last times the deflection
Place = tuple[int, int]  # station and coordinate
_STEP = 1e-5  # m, rad, of differences of forces
_ROWS = 20_000  # of differences at once


@dataclass(frozen=True)
class ErrorParameter:
    """One unknown parameter of the error model.

    name: such as "joints.joint2.offset.z"; of a compliance that of its stiffness.  kind: one of the five above.
    station, coordinate: what it moves.  factor: "one", "series", "force", "entry" (of K, where the others are of C),
    "gain", "cos", "sin" (with the number of the harmonic behind it, such as "cos2", where that is not 1), "backlash",
    "coupling", "temperature".
    series: the series' number, or of a coupling the station whose reading counts.
    nominal: its value in the description.  size: by how much it is expected to be off.
    other: of a compliance in a matrix, or an entry of K, its second coordinate, whose force moves the first and which
        the first's moves; None of one that stands alone.
    """

    name: str
    kind: str
    station: int
    coordinate: int
    factor: str
    nominal: float
    size: float
    series: int = 0
    other: int | None = None

    @property
    def is_diagonal(self) -> bool:
        """Whether it moves one coordinate alone."""
        return self.other is None or self.other == self.coordinate

    @property
    def unit(self) -> str:
        """Unit of its value."""
        unit = UNITS[COORDINATES[self.coordinate]]
        if self.kind == COMPLIANCE and self.other is not None:
            force = "N" if unit == "m" else "N m"
            return f"{force}/{UNITS[COORDINATES[self.other]]}"
        if self.kind == COMPLIANCE:
            return "N/m" if unit == "m" else "N m/rad"
        if self.factor == "temperature":
            return f"{unit}/K"
        return "1" if self.factor in ("gain", "coupling") else unit


@dataclass(frozen=True)
class Rows:
    """N rows as the error model takes them.

    readings: of the six coordinates of every station, (N, S, 6).  series: (N,).  loads: wrenches by station, (N, 6).
    direction: of the last motion of every station's principal coordinate, (N, S), -1, 0 or 1.
    """

    readings: Array
    series: NDArray[np.int64]
    loads: Mapping[int, Array]
    direction: Array
    temperature: Array | None

    def part(self, chosen: Index) -> Rows:
        """Return those of some of the rows."""
        return rows_at(self, chosen)


@dataclass(frozen=True)
class ErrorModel:
    """Error model of a robot: its stations, their parameters, and first base placements of the series.

    bases: pose of the robot's base before the device by series, (4, 4), in front of the base's six coordinates.
    closing: what closes a mechanism; None of a tree.
    """

    robot: Robot
    chain: Chain
    parameters: tuple[ErrorParameter, ...]
    bases: Mapping[int, Array]
    closing: LoopConstraints | None = None

    @property
    def nominal(self) -> Array:
        """Values in the description, (P,)."""
        return np.array([parameter.nominal for parameter in self.parameters])

    @property
    def sizes(self) -> Array:
        """Expected sizes, (P,)."""
        return np.array([parameter.size for parameter in self.parameters])

    @cached_property
    def blocks(self) -> list[Block]:
        """Groups of coordinates of which entries of K are parameters."""
        return [block for block in blocks_of(self.parameters) if block.of_stiffness]

    @cached_property
    def crossed(self) -> list[tuple[int, int, int]]:
        """Indices of compliances between two coordinates, which move both, with station and second coordinate.

        Behind them those of entries of K, which move all of their block.
        """
        rows = [(i, q.station, q.other, q.coordinate) for i, q in enumerate(self.parameters) if q.factor != ENTRY]
        crossed = [(i, k, other) for i, k, other, c in rows if other is not None and other != c]
        for block in self.blocks:
            crossed += [(at, block.station, c) for at, i, _ in block.pairs for c in block.others(i)]
        return crossed

    def tool_on_link(self, frame: str, link: str) -> Array:
        """Return the pose of a measured frame on its link before its six coordinates, (4, 4)."""
        return np.asarray(np.linalg.inv(self.chain.link_pose[link][1]) @ self._tool(frame).before)

    def _tool(self, frame: str) -> Station:
        return self.chain.stations[self.chain.tools[frame]]

    def indices(self, *kinds: str) -> Index:
        """Return indices of the parameters of these kinds."""
        return np.array([i for i, parameter in enumerate(self.parameters) if parameter.kind in kinds], dtype=np.intp)

    def with_quantities(self, more: Sequence[ErrorParameter]) -> ErrorModel:
        """Return the model with more parameters behind the others."""
        return replace(self, parameters=(*self.parameters, *more))

    def at(self, x: Array, rows: Rows) -> State:
        """Return all stations with these values, (P,), or (P, N) of every row, and the factors of the parameters."""
        factors = self._factors(rows)
        moved = [i for i, parameter in enumerate(self.parameters) if parameter.kind != COMPLIANCE]
        soft = [i for i, parameter in enumerate(self.parameters) if parameter.factor == FORCE]
        bases = np.array([self.bases[k] for k in rows.series.tolist()]).reshape(-1, 4, 4)
        places = [(q.station, q.coordinate) for q in self.parameters]
        crossed = [each for each in self.crossed if self.parameters[each[0]].factor == FORCE]
        blocks, back = [(block, block.compliance(x)) for block in self.blocks], np.zeros((len(factors), 0))
        rigid = rows.readings.copy()
        for i in moved:
            rigid[:, places[i][0], places[i][1]] += x[i] * factors[:, i]
        values, q = self._closed(rigid, rows, bases)
        at = located(self.chain, values, bases)
        for _ in range(PASSES if soft or blocks else 0):
            forces = self.forces(at, rows)
            bent = rigid.copy()
            for i in soft:
                (k, c), second = places[i], self.parameters[i].other
                factors[:, i] = forces[:, k, c if second is None else second]
                bent[:, k, c] += x[i] * factors[:, i]
            back = np.stack([forces[:, k, places[i][1]] for i, k, _ in crossed], axis=1) if crossed else back[:, :0]
            for (i, k, other), factor in zip(crossed, back.T, strict=True):
                bent[:, k, other] += x[i] * factor
            for block, C in blocks:
                places_of, s = list(block.coordinates), block.bend(C, forces)
                bent[:, block.station, places_of] += s
                for i, moves in block.bent(C, s):
                    own = places_of.index(places[i][1])
                    factors[:, i] = moves[:, own]
                    back = np.concatenate([back, np.delete(moves, own, axis=1)], axis=1)
            values, q = self._closed(bent, rows, bases)
            at = located(self.chain, values, bases)
        return State(self, at, factors, q, back, Loaded(x, values, bases, rows))

    def _closed(self, values: Array, rows: Rows, bases: Array) -> tuple[Array, Array]:
        """Return coordinates, (N, S, 6), whose passive ones are made to close loops, and what encoders read of them."""
        if self.closing is None:
            return values, rows.readings
        constants = values - rows.readings
        values = self.closing.closed(self.chain, values, constants, bases)
        return values, values - constants

    def force_slopes(self, loaded: Loaded, q: Array, elastic: Sequence[Place], moved: Sequence[Place]) -> Array:
        """Return changes of forces in elastic coordinates per change of constants of coordinates, (N, elastic, moved).

        They are central differences: a force changes by its square alone within a step.

        q: coordinates without constants, (N, S, 6).
        """
        many, (ks, cs) = len(q), np.array(elastic, dtype=np.intp).T
        slopes = np.empty((many, len(elastic), len(moved)))
        at_once = max(1, _ROWS // (2 * many))
        for first in range(0, len(moved), at_once):
            places = moved[first : first + at_once]
            rows = loaded.rows.part(np.tile(np.arange(many), 2 * len(places)))
            steps = np.zeros((2, len(places), *q.shape))
            for i, (k, c) in enumerate(places):
                steps[:, i, :, k, c] = [[_STEP], [-_STEP]]
            steps = steps.reshape(-1, *q.shape[1:])
            values, bases = (np.tile(x, (2 * len(places), 1, 1)) for x in (loaded.values, loaded.bases))
            values = values + steps
            if self.closing is not None:
                constants = np.tile(loaded.values - q, (2 * len(places), 1, 1)) + steps
                values = self.closing.closed(self.chain, values, constants, bases)
            forces = self.forces(located(self.chain, values, bases), rows)[:, ks, cs]
            plus, minus = forces.reshape(2, len(places), many, len(elastic))
            slopes[:, :, first : first + len(places)] = np.moveaxis((plus - minus) / (2.0 * _STEP), 0, -1)
        return slopes

    def forces(self, located: Located, rows: Rows) -> Array:
        """Return generalized forces of gravity and of loads at all stations' coordinates, (N, S, 6), N and N m.

        Of closed mechanisms they are those of coordinates that passive ones follow.
        """
        forces = forces_on(self.chain, located, np.array(self.robot.gravity), rows.loads)
        return forces if self.closing is None else self.closing.carried(self.chain, located, forces)

    def _factors(self, rows: Rows) -> Array:
        """Return factors of all parameters, (N, P); those of compliances are still 0."""
        factors = np.ones((len(rows.series), len(self.parameters)))
        for i, parameter in enumerate(self.parameters):
            if parameter.factor != "one":
                factors[:, i] = factor_of(parameter, rows)
        return factors


@dataclass(frozen=True)
class Loaded:
    """Origin of a state of an error model: values x of parameters, (P,) or (P, N), coordinates, (N, S, 6), poses of
    bases, (N, 4, 4), and rows.
    """

    x: Array
    values: Array
    bases: Array
    rows: Rows


@dataclass(frozen=True)
class State:
    """Stations of an error model at some values, with what one unit of each parameter does.

    q: coordinates without offsets and deflections, (N, S, 6): what ideal encoders read of passive ones.
    back: factors by which ``ErrorModel.crossed`` move their second coordinates, (N, crossed).
    """

    model: ErrorModel
    located: Located
    factors: Array
    q: Array
    back: Array
    loaded: Loaded

    @cached_property
    def bending(self) -> tuple[list[Place], Array]:
        """Elastic coordinates, and how these bend because a parameter moves loads, per unit of it, (N, elastic, P).

        Loads act at other arms once an offset or a deflection has moved the robot, s = x + C f(s); the factors hold
        f itself alone.
        """
        model = self.model
        soft = {i: q for i, q in enumerate(model.parameters) if q.kind == COMPLIANCE and np.any(self.loaded.x[i])}
        ends = {i: (q.coordinate, q.coordinate if q.other is None else q.other) for i, q in soft.items()}
        elastic = sorted({(q.station, c) for i, q in soft.items() for c in ends[i]})
        if not elastic:
            return [], np.zeros((len(self.q), 0, len(model.parameters)))
        moved = sorted({*elastic, *((q.station, q.coordinate) for q in model.parameters)})
        moved = sorted({*moved, *((k, other) for _, k, other in model.crossed)})
        by_place = model.force_slopes(self.loaded, self.q, elastic, moved)
        column = {place: i for i, place in enumerate(moved)}
        direct = np.zeros((len(self.q), len(moved), len(model.parameters)))
        for i, parameter in enumerate(model.parameters):
            direct[:, column[parameter.station, parameter.coordinate], i] = self.factors[:, i]
        for (i, k, other), factor in zip(model.crossed, self.back.T, strict=True):
            direct[:, column[k, other], i] += factor
        C, row = np.zeros((len(self.q), len(elastic), len(elastic))), {place: i for i, place in enumerate(elastic)}
        for i, parameter in soft.items():
            if parameter.factor == ENTRY:
                continue
            a, b = (row[parameter.station, c] for c in ends[i])
            C[:, a, b] = C[:, b, a] = self.loaded.x[i]
        for block in model.blocks:
            at = [row[block.station, c] for c in block.coordinates]
            C[:, np.array(at)[:, np.newaxis], at] = block.compliance(self.loaded.x)
        own = by_place[:, :, [column[place] for place in elastic]]
        forces = np.linalg.solve(np.eye(len(elastic)) - own @ C, by_place @ direct)
        return elastic, np.asarray(C @ forces)

    def sensitivities(self, tool: int) -> Array:
        """Return the motion of a station per unit of every parameter, (N, 6, P).

        It is a displacement, then a small rotation, in the device's axes.
        """
        before, by_place = jacobian(self.model.chain, self.located, tool)
        place = {station: k for k, station in enumerate(before)}
        chosen = [i for i, parameter in enumerate(self.model.parameters) if parameter.station in place]
        flat = [place[self.model.parameters[i].station] * 6 + self.model.parameters[i].coordinate for i in chosen]
        sensitivities = np.zeros((*by_place.shape[:2], len(self.model.parameters)))
        columns = by_place.reshape(*by_place.shape[:2], -1)
        sensitivities[:, :, chosen] = columns[:, :, flat] * self.factors[:, np.newaxis, chosen]
        for (i, k, other), factor in zip(self.model.crossed, self.back.T, strict=True):
            if k in place:
                sensitivities[:, :, i] += by_place[:, :, place[k], other] * factor[:, np.newaxis]
        elastic, bending = self.bending
        for i, (k, c) in enumerate(elastic):
            if k in place:
                sensitivities += by_place[:, :, place[k], c, np.newaxis] * bending[:, i, np.newaxis]
        if self.model.closing is not None:
            sensitivities += self._through_loops(by_place, before)
        return sensitivities

    def _through_loops(self, by_place: Array, before: Sequence[int]) -> Array:
        """Return the motion of a station by what passive coordinates do per unit of every parameter, (N, 6, P)."""
        model = self.model
        assert model.closing is not None
        by_quantity = self.passive_slopes()
        moving = [(i, before.index(k), c) for i, (k, c) in enumerate(model.closing.passive) if k in before]
        which, at, component = np.array(moving, dtype=np.intp).reshape(-1, 3).T
        return np.asarray(by_place[:, :, at, component] @ by_quantity[:, which])

    def passive_slopes(self) -> Array:
        """Return changes of the passive coordinates, without their offsets, per unit of every parameter, (N, k, P)."""
        model = self.model
        assert model.closing is not None
        follow = model.closing.followed(model.chain, self.located)
        places = [(parameter.station, parameter.coordinate) for parameter in model.parameters]
        ks, cs = np.array(places, dtype=np.intp).T
        slopes = follow[:, :, ks, cs] * self.factors[:, np.newaxis]
        for (i, k, other), factor in zip(model.crossed, self.back.T, strict=True):
            slopes[:, :, i] += follow[:, :, k, other] * factor[:, np.newaxis]
        elastic, bending = self.bending
        for i, (k, c) in enumerate(elastic):
            slopes += follow[:, :, k, c, np.newaxis] * bending[:, i, np.newaxis]
        return np.asarray(slopes)


def factor_of(parameter: ErrorParameter, rows: Rows) -> Array:
    """Return the factor of a parameter in every row, (N,)."""
    reading = rows.readings[:, parameter.station, parameter.coordinate]
    kind = parameter.factor
    if kind == "series":
        return np.asarray(rows.series == parameter.series, dtype=np.float64)
    if kind == "gain":
        return np.asarray(reading)
    if kind.startswith(("cos", "sin")):
        angle = float(kind[3:] or 1.0) * reading
        return np.asarray(np.cos(angle) if kind.startswith("cos") else np.sin(angle))
    if kind == "backlash":
        return np.asarray(rows.direction[:, parameter.station])
    if kind == "coupling":
        return np.asarray(rows.readings[:, parameter.series, parameter.coordinate])
    if kind == "temperature":
        assert rows.temperature is not None
        return np.asarray(rows.temperature - rows.temperature.mean())
    return np.zeros(len(rows.series))


def model_parameters(
    robot: Robot,
    chain: Chain,
    series: Sequence[int],
    known: Mapping[str, bool],
    sizes: tuple[float, float] = SIZES,
) -> Iterator[ErrorParameter]:
    """Yield placements of bases and frames, offsets of all six coordinates of every moving joint, tilts of axes.

    Of loops those of the loop joint's rigid coordinates, and the placement of its frame on the second link.

    Where several parameters do the same, those that come first here stand for all of them.

    known: of every measured frame, whether the description places it.
    sizes: expected ones: a length as a share of the reach, and rad.
    """
    reach = chain.reach
    small, large = (reach * sizes[0], sizes[1]), (reach, 1.0)
    for number in series:
        owner = BASE if len(series) == 1 else parameter_name("series", str(number), BASE)
        for c, name in enumerate(COORDINATES):
            yield ErrorParameter(component_name(owner, name), PLACEMENT, 0, c, "series", 0.0, large[c // 3], number)
    yield from _placements(chain, [frame for frame in chain.tools if not known[frame]], large)
    for k, station in enumerate(chain.stations):
        for c in station.tilts:
            name = parameter_name(JOINTS, station.name, TILT, COORDINATES[c])
            yield ErrorParameter(name, OFFSET, k, c, "one", 0.0, small[1])
        if station.offset is None or not _has_offsets(robot, station):
            continue
        for c in sorted(range(6), key=lambda c: (c != station.principal, c)):
            name = parameter_name(JOINTS, station.name, "offset", COORDINATES[c])
            kind = ZERO if c == station.principal else OFFSET
            yield ErrorParameter(name, kind, k, c, "one", float(station.offset[c]), small[c // 3])
    for loop, (first, _) in zip(robot.loops, chain.cuts, strict=True):
        for condition in rigid_components(loop):
            c = COORDINATES.index(condition.name)
            name, nominal = parameter_name(LOOPS, loop.name, "offset", condition.name), float(loop.offset[c] or 0.0)
            yield ErrorParameter(name, OFFSET, first, c, "one", nominal, small[c // 3])
    for loop, (_, second) in zip(robot.loops, chain.cuts, strict=True):
        for c, kind in enumerate(COORDINATES):
            name = parameter_name(LOOPS, loop.name, SECOND, kind)
            yield ErrorParameter(name, OFFSET, second, c, "one", 0.0, small[c // 3])
    yield from _placements(chain, [frame for frame in chain.tools if known[frame]], small)


def _has_offsets(robot: Robot, station: Station) -> bool:
    """Return whether constants of a joint's coordinates may show: not of one with all six free, as a platform's."""
    if station.principal is not None:
        return True
    joint = station.joint
    return bool(robot.loops) and joint is not None and len(joint.coordinates) < len(COORDINATES)


def _placements(chain: Chain, frames: Sequence[str], size: tuple[float, float]) -> Iterator[ErrorParameter]:
    for frame in frames:
        for c, name in enumerate(COORDINATES):
            key = parameter_name(FRAMES, frame, name)
            yield ErrorParameter(key, PLACEMENT, chain.tools[frame], c, "one", 0.0, size[c // 3])


def drive_terms(model: ErrorModel, rows: Rows) -> Iterator[tuple[ErrorParameter, ...]]:
    """Yield the error terms of drives that rows can show, in groups that come together.

    Gain, eccentricity and so on.  Passive joints, whose coordinates follow from the loops, have none.
    """
    chain, passive = model.chain, () if model.closing is None else model.closing.passive
    joints = [k for k, x in enumerate(chain.stations) if x.principal is not None and (k, x.principal) not in passive]
    moving = [k for k in joints if np.ptp(rows.readings[:, k, chain.stations[k].principal or 0]) > 0.0]
    for k in moving:
        station, c = chain.stations[k], chain.stations[k].principal or 0
        size = SIZES[1] if c >= 3 else SIZES[0] * chain.reach

        def term(key: str, factor: str, size: float, other: int = 0, k: int = k, c: int = c) -> ErrorParameter:
            name = parameter_name(JOINTS, chain.stations[k].name, key)
            return ErrorParameter(name, DRIVE, k, c, factor, 0.0, size, other)

        yield (term("gain", "gain", 1e-3),)
        if c >= 3:
            for key, frequency in _harmonics(station):
                yield term(f"{key}.cos", f"cos{frequency}", size), term(f"{key}.sin", f"sin{frequency}", size)
        if np.ptp(rows.direction[:, k]) > 0.0:
            yield (term("backlash", "backlash", size),)
        for other in moving:
            if other != k and chain.stations[other].principal == c:
                yield (term(f"coupling.{chain.stations[other].name}", "coupling", 1e-3, other),)
        if rows.temperature is not None and np.ptp(rows.temperature) > 0.0:
            for component in (0, 1, 2, *((c,) if c >= 3 else ())):
                drift = 1e-5 * (chain.reach if component < 3 else 1.0)
                name = parameter_name(JOINTS, station.name, "temperature", COORDINATES[component])
                yield (ErrorParameter(name, DRIVE, k, component, "temperature", 0.0, drift),)


def _harmonics(station: Station) -> Iterator[tuple[str, str]]:
    """Yield names of a drive's harmonics, and how often they come in a turn of the joint.

    Two of it, and two of its motor.
    """
    yield "eccentricity", ""
    yield "harmonic2", "2"
    motor = None if station.joint is None else station.joint.motor
    ratio = 1.0 if motor is None else abs(motor.ratio)
    for key, often in (("motor_turn", ratio), ("motor_turn2", 2.0 * ratio)):
        if motor is not None and often not in (1.0, 2.0):
            yield key, repr(often)


def rows_of(chain: Chain, robot: Robot, poses: MeasuredPoses, known: Mapping[str, tuple[int, int, float]]) -> Rows:
    """Return measured poses as the error model takes them.

    known: of every column of coordinates its station, coordinate, and the factor from the column to the coordinate.
    """
    many, count = len(poses.q), len(chain.stations)
    readings = np.zeros((many, count, 6))
    for i, name in enumerate(poses.coordinates):
        at, coordinate, factor = known[name]
        readings[:, at, coordinate] += factor * poses.q[:, i]
    direction = np.zeros((many, count))
    for k, station in enumerate(chain.stations):
        if station.principal is not None:
            direction[:, k] = _directions(readings[:, k, station.principal], poses.series)
    loads = {chain.tools[f]: m.wrench for f, m in poses.frames.items() if f in chain.tools and np.any(m.wrench)}
    return Rows(readings, poses.series, loads, direction, poses.temperature)


def _directions(values: Array, series: NDArray[np.int64]) -> Array:
    """Return the sense of the last motion before each row: -1, 1, or 0 where there was none yet."""
    directions = np.zeros(len(values))
    last: dict[int, tuple[float, float]] = {}
    for row, (number, value) in enumerate(zip(series.tolist(), values.tolist(), strict=True)):
        before, sense = last.get(number, (value, 0.0))
        sense = float(np.sign(value - before)) or sense
        last[number] = value, sense
        directions[row] = sense
    return directions
