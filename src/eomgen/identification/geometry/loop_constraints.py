"""Closed mechanisms: passive coordinates follow from those of the drives, in all rows at once, and so do their slopes.

g(q, p) = 0,    dq = -G_q^+ G_p dp    where q are passive coordinates and p everything else
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import RANK, Array, independent_columns, rank_of
from ...errors import InputError
from ...names import component_name, joint_of, kind_of, listed
from ...robot.joint_types import rigid_components
from ...robot.model import Model
from ...robot.value import COORDINATES, MOTOR, Robot
from .blocks import Unknown
from .stations import Chain, Located, cross, jacobian, located

Place = tuple[int, int]  # station and coordinate

CLOSED = 1e-9  # m or rad: closure residuals that are none
_HELD = 1e-6  # m/rad and the like: of closure residuals that a deflection leaves
_STEPS = 30  # from home to a pose
_EACH = 2  # of Newton's method at every step
_LAST = 12  # at the pose itself


@dataclass(frozen=True)
class LoopConstraints:
    """Loops and couplings of a robot, and the coordinates that follow.

    couplings: place of a coordinate, those that it follows with their ratios, and what is added, m or rad.
    kept: indices of the constraints that are independent; others follow from these, or would hinder offsets out of the
        plane of a linkage, which its bearings take up.
    """

    robot: Robot
    passive: tuple[Place, ...]
    couplings: tuple[tuple[Place, tuple[tuple[Place, float], ...], float], ...]
    kept: tuple[int, ...] = ()

    def residuals(self, chain: Chain, at: Located, q: Array) -> Array:
        """Return g of all loops and couplings, (N, m), m and rad, by coordinates without offsets, (N, S, 6)."""
        residuals = []
        for loop, (a, b) in zip(self.robot.loops, chain.cuts, strict=True):
            R_a = at.R[a].transpose(0, 2, 1)
            p, R = np.einsum("nij,nj->ni", R_a, at.p[b] - at.p[a]), R_a @ at.R[b]
            for condition in rigid_components(loop):
                if condition.axis is not None:
                    residuals.append(p[:, condition.axis])
                else:
                    residuals.append(sum((f * R[:, i, j] for f, i, j in condition.products), np.zeros(len(p))))
        for (k, c), others, offset in self.couplings:
            residuals.append(q[:, k, c] - offset - sum((r * q[:, i, j] for (i, j), r in others), np.zeros(len(q))))
        return np.stack([residuals[i] for i in self.kept or range(len(residuals))], axis=1)

    def slopes(self, chain: Chain, at: Located) -> Array:
        """Return derivatives of g by the six coordinates of all stations, (N, m, S, 6)."""
        many, count = at.p.shape[1], len(chain.stations)
        rows = []
        for loop, (a, b) in zip(self.robot.loops, chain.cuts, strict=True):
            J = np.zeros((2, many, 6, count, 6))
            for side, station in enumerate((a, b)):
                before, whole = jacobian(chain, at, station)
                J[side][:, :, before] = whole
            R_a = at.R[a].transpose(0, 2, 1)
            R, arm = R_a @ at.R[b], at.p[b] - at.p[a]
            linear = J[1, :, :3] - J[0, :, :3]
            turned = np.moveaxis(J[0, :, 3:], 1, -1)
            linear = linear - np.moveaxis(cross(turned, arm[:, np.newaxis, np.newaxis]), -1, 1)
            linear = np.einsum("nij,njsc->nisc", R_a, linear)
            angular = np.einsum("nij,njsc->nisc", R_a, J[1, :, 3:] - J[0, :, 3:])
            for condition in rigid_components(loop):
                if condition.axis is not None:
                    rows.append(linear[:, condition.axis])
                    continue
                total = np.zeros((many, count, 6))
                for factor, i, j in condition.products:
                    change = cross(np.moveaxis(angular, 1, -1), R[:, np.newaxis, np.newaxis, :, j])
                    total += factor * change[..., i]
                rows.append(total)
        for (k, c), others, _ in self.couplings:
            row = np.zeros((many, count, 6))
            row[:, k, c] = 1.0
            for (i, j), ratio in others:
                row[:, i, j] = -ratio
            rows.append(row)
        return np.stack([rows[i] for i in self.kept or range(len(rows))], axis=1)

    def closed(self, chain: Chain, values: Array, constants: Array, bases: Array, steps: int = _LAST) -> Array:
        """Return values with passive coordinates that close, (N, S, 6), from those that are near."""
        closed = values.copy()
        ks, cs = np.array(self.passive, dtype=np.intp).T
        for _ in range(steps):
            at = located(chain, closed, bases)
            g = self.residuals(chain, at, closed - constants)
            if np.abs(g).max() < 1e-14:
                break
            G = self.slopes(chain, at)[:, :, ks, cs]
            closed[:, ks, cs] -= np.einsum("nqm,nm->nq", np.linalg.pinv(G, rcond=RANK), g)
        return np.asarray(closed)

    def followed(self, chain: Chain, at: Located) -> Array:
        """Change of the passive coordinates per change of all stations' coordinates by offsets, (N, k, S, 6).

        Couplings are between coordinates, not between offsets: what is added to a coordinate does not move others by
        them.
        """
        ks, cs = np.array(self.passive, dtype=np.intp).T
        G = self.slopes(chain, at)
        inverse = np.linalg.pinv(G[:, :, ks, cs], rcond=RANK)
        loops = sum(len(rigid_components(loop)) for loop in self.robot.loops)
        of_couplings = [row for row, i in enumerate(self.kept or range(G.shape[1])) if i >= loops]
        G[:, of_couplings] = 0.0
        return np.asarray(-np.einsum("nqm,nmsc->nqsc", inverse, G))

    def carried(self, chain: Chain, at: Located, forces: Array) -> Array:
        """Give forces in all stations' coordinates, (N, S, 6), with what acts on the passive ones that follow them."""
        ks, cs = np.array(self.passive, dtype=np.intp).T
        passed_on = np.einsum("nqsc,nq->nsc", self.followed(chain, at), forces[:, ks, cs])
        return np.asarray(forces + passed_on)


def closed_robot(robot: Robot, chain: Chain, compliances: Sequence[Unknown]) -> Robot:
    """Return the robot with loop joints that are rigid in what they deflect by: the deflection moves their frame."""
    places, loops = {(q.station, c) for q in compliances for c in (q.coordinate, q.other)}, []
    for loop, (first, _) in zip(robot.loops, chain.cuts, strict=True):
        kept = {x: y for x, y in loop.coordinates.items() if (first, COORDINATES.index(x)) not in places}
        is_same = len(kept) == len(loop.coordinates)
        loops.append(loop if is_same else replace(loop, coordinates=kept, stiffness=None, damping=None, radial=None))
    return replace(robot, loops=tuple(loops))


def joint_at(chain: Chain, robot: Robot, station: int) -> str:
    """Return the name of the joint at a station, or of the loop joint whose first frame it is."""
    for loop, (first, _) in zip(robot.loops, chain.cuts, strict=True):
        if first == station:
            return loop.name
    return chain.stations[station].name


def held_by_loops(model: Model, chain: Chain, closing: LoopConstraints, places: Sequence[Place]) -> list[Place]:
    """Return the index of some whose deflections passive coordinates cannot take up: loops share them among several."""
    G = _home_slopes(model, chain, replace(closing, kept=()))
    ks, cs = np.array(closing.passive, dtype=np.intp).reshape(-1, 2).T
    free = G[:, ks, cs]
    G[sum(len(rigid_components(loop)) for loop in closing.robot.loops) :] = 0.0  # couplings are between drives' sides
    held = []
    for k, c in places:
        left = G[:, k, c] - free @ (np.linalg.pinv(free, rcond=RANK) @ G[:, k, c])
        if np.abs(left).max(initial=0.0) > _HELD:
            held.append((k, c))
    return held


def closing_of(model: Model, chain: Chain, read: Sequence[Place], source: str) -> LoopConstraints:
    """Return loops and couplings of a robot whose drives are read; what else moves follows.

    Raises:
        InputError: a drive's column is missing, drives do not say where a coordinate is, or nothing closes rigidly.
    """
    robot = model.robot
    station = {s.name: k for k, s in enumerate(chain.stations) if s.joint is not None}

    def place(name: str) -> Place:
        kind = kind_of(name)
        kind = robot.joint(joint_of(name)).principal if kind == MOTOR else kind
        return station[joint_of(name)], COORDINATES.index(kind)

    driven = [model.coordinates[i] for i in (*model.driven, *model.prescribed)]
    missing = [name for name in driven if place(name) not in read]
    if missing:
        raise InputError(f"{source}: the column {missing[0]} is missing; allowed: all drives, {listed(driven)}")
    kept = {place(name) for name in driven}
    passive = []
    for joint in robot.joints:
        coupled = () if joint.stiffness is None else joint.stiffness.held
        for kind, coordinate in joint.coordinates.items():
            at = place(component_name(joint.name, kind))
            if at not in kept and not coordinate.has_stiffness and kind not in coupled:
                passive.append(at)
    couplings = tuple(
        (place(x.of), tuple((place(name), ratio) for name, ratio in x.to.items()), x.offset or 0.0)
        for x in robot.couplings
        if x.law is None
    )
    if not couplings and not any(rigid_components(loop) for loop in robot.loops):
        raise InputError(
            f"{robot.name}: all loops are elastic in all coordinates, so that forces alone say where it stands;"
            " allowed: loops with rigid coordinates"
        )
    if not passive:
        raise InputError(
            f"{robot.name}: springs hold all coordinates but those of drives, so that forces alone say where it stands;"
            " allowed: coordinates that follow from the drives"
        )
    return _independent(model, chain, LoopConstraints(robot, tuple(passive), couplings))


def _independent(model: Model, chain: Chain, closing: LoopConstraints) -> LoopConstraints:
    """Keep independent constraints alone, with drives that say where everything is; see closing_of."""
    slopes = _home_slopes(model, chain, closing)
    places = [
        (k, COORDINATES.index(name)) for k, s in enumerate(chain.stations) if s.joint for name in s.joint.coordinates
    ]
    ks, cs = np.array(places, dtype=np.intp).T
    G = slopes[:, ks, cs]
    kept = tuple(sorted(independent_columns(G.T, rank_of(G))))
    ks, cs = np.array(closing.passive, dtype=np.intp).reshape(-1, 2).T
    if rank_of(slopes[kept, :][:, ks, cs]) < len(closing.passive):
        free = [component_name(chain.stations[k].name, COORDINATES[c]) for k, c in closing.passive]
        raise InputError(
            f"{model.name}: the drives do not say where all of {listed(free)} are; allowed: drives that hold it"
        )
    return replace(closing, kept=kept)


def _home_slopes(model: Model, chain: Chain, closing: LoopConstraints) -> Array:
    """Return derivatives of the constraints where they close from home on, (m, S, 6)."""
    constants, bases = constants_of(chain, model.robot, 1), np.eye(4)[np.newaxis]
    home = closing.closed(chain, _home(chain, model, 1) + constants, constants, bases, 4 * _LAST)
    return np.asarray(closing.slopes(chain, located(chain, home, bases))[0])


def constants_of(chain: Chain, robot: Robot, count: int) -> Array:
    """Return offsets of the description in the six coordinates of all stations, (count, S, 6), m and rad."""
    offsets = np.zeros((count, len(chain.stations), 6))
    for k, station in enumerate(chain.stations):
        if station.offset is not None:
            offsets[:, k] = station.offset
    for (k, _), loop in zip(chain.cuts, robot.loops, strict=True):
        offsets[:, k] = [value or 0.0 for value in loop.offset]
    return offsets


def _home(chain: Chain, model: Model, count: int) -> Array:
    """Return the description's home in the six coordinates of all stations, (count, S, 6), m and rad."""
    home = np.zeros((count, len(chain.stations), 6))
    names = {s.name: k for k, s in enumerate(chain.stations) if s.joint is not None}
    for name, value in zip(model.coordinates, model.home, strict=True):
        if kind_of(name) != MOTOR:
            home[:, names[joint_of(name)], COORDINATES.index(kind_of(name))] = value
    return home


def closed_readings(
    chain: Chain, closing: LoopConstraints, model: Model, readings: Array, places: Sequence[str]
) -> Array:
    """Return readings with passive coordinates that close the described robot, (N, S, 6), from its home on.

    places: file and line of every row, for messages.

    Raises:
        InputError: loops do not close in a row.
    """
    constants, home = constants_of(chain, model.robot, len(readings)), _home(chain, model, len(readings))
    ks, cs = np.array(closing.passive, dtype=np.intp).T
    bases = np.tile(np.eye(4), (len(readings), 1, 1))
    closed = closing.closed(chain, home + constants, constants, bases)
    start = closed - constants
    for share in np.linspace(0.0, 1.0, _STEPS + 1)[1:]:
        before = closed[:, ks, cs]
        closed = start + share * (readings - start) + constants
        closed[:, ks, cs] = before
        closed = closing.closed(chain, closed, constants, bases, _LAST if share == 1.0 else _EACH)
    violations = np.abs(closing.residuals(chain, located(chain, closed, bases), closed - constants)).max(axis=1)
    bad = np.flatnonzero(~(violations < CLOSED))
    if bad.size:
        raise InputError(
            f"{places[int(bad[0])]}: the loops of {model.name} do not close there (by {violations[bad[0]]:.2g});"
            f" allowed: drives at which they close to {CLOSED:g} m or rad"
        )
    return np.asarray(closed - constants)
