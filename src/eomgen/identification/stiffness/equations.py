"""Equations of stiffness and damping along a measured motion, linear in what is sought: of trees and of mechanisms."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import RANK, Array
from ...errors import InputError
from ...kernel.complete import Kernel
from ...motion.files import MeasuredMotion
from ...names import component_name, listed
from ...robot.coordinates import LINKS, index_of, number_name
from ...robot.model import Model
from ...robot.value import COORDINATES
from ...state.springs import cut_numbers, law_numbers
from .frame_pairs import FramePair
from .least_squares import Noise, System
from .matrix_entries import OF_JOINTS, Entry, MatrixNumbers
from .matrix_fitting import shares_of
from .result import KEYS

MOVES = 1e-9  # of the largest derivative of deviations: coordinates with less do not move them
TIMES = 16  # samples that say what noise does on average, where directions change along the motion


@dataclass(frozen=True)
class Sought:
    """A coordinate whose parameters are looked for: of a joint, a link's mode, a loop joint or an elastic coupling.

    owner: "joints", "links", "loops" or "couplings".  columns: places in KEYS.
    """

    owner: str
    name: str
    columns: tuple[int, ...]

    def parameter(self, column: int) -> str:
        """Name of the parameter in ``Kernel.parameters``."""
        return number_name(self.owner, self.name, KEYS[column])

    @property
    def in_tree(self) -> bool:
        """Whether it is a coordinate of the tree."""
        return self.owner in (OF_JOINTS, LINKS)


@dataclass(frozen=True)
class Equations:
    """Equations of the coordinates and entries sought, and what each of their columns is of, with its place in KEYS."""

    sought: tuple[Sought, ...]
    places: tuple[tuple[Sought | Entry, int], ...]
    system: System


@dataclass(frozen=True)
class Moved:
    """A motion with its loops closed, and the drives that are known, (T, n) each.

    half: of the filter that they have passed.  weights: of that filter by order of the derivative, (3, w).  following:
    names of the coordinates that follow from the others.  pairs: frames of loop joints and bushings, by "loops" or
    "bushings" and their names.
    """

    q: Array
    v: Array
    a: Array
    u: Array
    half: int
    weights: Array
    following: tuple[str, ...]
    pairs: Mapping[tuple[str, str], FramePair]


def known_rows(model: Model, kernel: Kernel, motion: MeasuredMotion) -> list[str]:
    """Return names of a tree's coordinates whose equation of motion has no unknown force."""
    unknown = {kernel.coordinates[i] for i in model.driven} | set(kernel.prescribed)
    return [x for x in kernel.coordinates if x in motion.measured and (x in motion.driven or x not in unknown)]


def of_tree(
    kernel: Kernel,
    model: Model,
    motion: MeasuredMotion,
    moved: Moved,
    sought: Sequence[Sought],
    entries: Sequence[Entry],
    between: set[str],
    noise: dict[str, float],
) -> Iterator[Equations]:
    """Yield the equation of every coordinate of a tree by itself, those of joints with matrices together.

    Those of all coordinates that move a bushing whose entries are sought, ``between``, are one system.
    """
    together = [x for x in known_rows(model, kernel, motion) if x in between]
    if together:
        beside = [x for x in sought if x.name in between]
        inside = [x for x in entries if x.owner != OF_JOINTS or between.intersection(x.ends)]
        N = _single_motions(kernel, together, moved)
        yield _together(kernel, motion, moved, (*beside, *inside), N, noise)
        sought, entries = [x for x in sought if x not in beside], [x for x in entries if x not in inside]
    y = moved.u - np.asarray(kernel.inverse_dynamics(moved.q, moved.v, moved.a))
    M = kernel.mass_matrix(moved.q)
    inertia = np.diagonal(M, axis1=1, axis2=2).mean(axis=0)
    numbers = law_numbers(kernel)
    ends = {name for entry in entries for name in entry.ends}
    for item in sought:
        if item.name in ends:
            continue
        i = kernel.coordinates.index(item.name)
        columns = np.stack([moved.q[:, i], moved.v[:, i]], axis=1)
        right = y[:, i] + columns @ np.array([numbers[item.name].get(key, 0.0) for key in KEYS])
        shares = np.eye(2).reshape(2, 1, 1, 2)
        sigma, own = np.array([noise[item.name]]), inertia[[i]].reshape(1, 1)
        measured = Noise(sigma, shares, own, moved.weights, motion.v is None)
        wanted = np.isin(np.arange(len(KEYS)), item.columns)
        system = System(columns[:, np.newaxis], right[:, np.newaxis], measured, wanted)
        yield Equations((item,), tuple((item, column) for column in range(len(KEYS))), system)
    mean = M.mean(axis=0) if entries else M[0]
    tree = _Tree(kernel.coordinates, known_rows(model, kernel, motion), y, mean, noise)
    for joint in dict.fromkeys(entry.joint for entry in entries):
        own_entries = [entry for entry in entries if entry.joint == joint]
        own_ends = {name for entry in own_entries for name in entry.ends}
        beside = [item for item in sought if item.name in own_ends]
        yield _of_joint(kernel, motion, moved, tree, own_entries, beside)


@dataclass(frozen=True)
class _Tree:
    """Parts of all equations of a tree: names, rows that can be written, forces y, (T, n), inertia, (n, n), noise."""

    coordinates: tuple[str, ...]
    rows: Sequence[str]
    y: Array
    inertia: Array
    noise: dict[str, float]


def _of_joint(
    kernel: Kernel,
    motion: MeasuredMotion,
    moved: Moved,
    tree: _Tree,
    entries: Sequence[Entry],
    beside: Sequence[Sought],
) -> Equations:
    """Return the equations of a joint's coordinates, in units of the root of their kinetic energy."""
    numbers, laws = MatrixNumbers.of(kernel), law_numbers(kernel)
    ends = {name for entry in entries for name in entry.ends}
    moving = [name for name in tree.coordinates if name in ends and name in motion.measured]
    rows = [name for name in moving if name in tree.rows]
    places: list[tuple[Sought | Entry, int]] = [(entry, entry.column) for entry in entries]
    shares = [shares_of(entry, numbers.lag(entry), rows, moving) for entry in entries]
    described = [numbers.described(entry) for entry in entries]
    for item in beside:
        for column in item.columns if item.name in rows else ():
            places.append((item, column))
            shares.append(np.zeros((len(rows), len(moving), 2)))
            shares[-1][rows.index(item.name), moving.index(item.name), column] = 1.0
            described.append(laws[item.name].get(KEYS[column], 0.0))
    i, j = index_of(tree.coordinates, rows), index_of(tree.coordinates, moving)
    weights = 1.0 / np.sqrt(np.maximum(np.diagonal(tree.inertia)[i], 1e-12 * np.diagonal(tree.inertia).max()))
    both, weighed = np.stack([moved.q[:, j], moved.v[:, j]], axis=2), np.array(shares) * weights[:, None, None]
    columns = np.einsum("tkd,pfkd->tfp", both, weighed, optimize=True)
    right = tree.y[:, i] * weights + columns @ np.array(described)
    sigma = np.array([tree.noise[name] for name in moving])
    inertia = tree.inertia[np.ix_(i, j)] * weights[:, None]
    measured = Noise(sigma, weighed, inertia, moved.weights, motion.v is None)
    return Equations(tuple(x for x in beside if x.name in rows), tuple(places), System(columns, right, measured))


def of_mechanism(
    kernel: Kernel,
    model: Model,
    motion: MeasuredMotion,
    moved: Moved,
    sought: Sequence[Sought | Entry],
    noise: dict[str, float],
) -> Equations:
    """Return the equations of all coordinates of a mechanism, along the motions that are left to it."""
    N = _free_motions(kernel, model, motion, moved)
    return _together(kernel, motion, moved, sought, N, {} if kernel.constraints else noise)


def _together(
    kernel: Kernel,
    motion: MeasuredMotion,
    moved: Moved,
    sought: Sequence[Sought | Entry],
    N: Array,
    noise: dict[str, float],
) -> Equations:
    """Return equations along motions N, (T, n, f); noise of measured coordinates is taken off where it is given."""
    y = kernel.inverse_dynamics(moved.q, moved.v, moved.a, cut=bool(kernel.constraints or kernel.cut_laws))
    y = moved.u - np.asarray(y)
    numbers = {**law_numbers(kernel), **cut_numbers(kernel)}
    of_matrices, pairs = MatrixNumbers.of(kernel), dict[tuple[str, str], Deviations]()
    places: list[tuple[Sought | Entry, int]] = [(item, column) for item in sought for column in item.columns]
    columns = np.empty((*N.shape[::2], len(places)))
    measured = index_of(kernel.coordinates, [name for name in kernel.coordinates if name in motion.measured])
    some = np.linspace(0, len(N) - 1, TIMES).round().astype(np.intp)
    shares = np.zeros((len(places), len(some) * N.shape[2], len(measured), 2))
    for place, (item, column) in enumerate(places):
        if isinstance(item, Entry):
            where = item.owner, "" if item.owner == OF_JOINTS else item.joint
            if where not in pairs:
                pairs[where] = deviations_of(kernel, moved, *where)
            terms, lag = [(pairs[where].of(row), pairs[where].of(by)) for row, by in item.pairs], of_matrices.lag(item)
            described = of_matrices.described(item)
        else:
            own, lag = deviation_of(kernel, moved, item), 0.0
            terms, described = [(own, own)], numbers[item.name].get(KEYS[column], 0.0)
        x = np.zeros_like(y)
        for (_, _, rows), (s, rate, by_rows) in terms:
            x += (rate if column else s + lag * rate)[:, np.newaxis] * rows
            along = np.einsum("tnf,tn->tf", N[some], rows[some]).ravel()
            share = along[:, np.newaxis] * np.repeat(by_rows[some][:, measured], N.shape[2], axis=0)
            shares[place, :, :, column] += share
            shares[place, :, :, 1] += lag * share
        y = y + described * x
        columns[:, :, place] = np.einsum("tnf,tn->tf", N, x)
    system = System(columns, np.einsum("tnf,tn->tf", N, y))
    if noise:
        inertia = np.einsum("tnf,tnk->tfk", N[some], np.asarray(kernel.mass_matrix(moved.q[some]))[:, :, measured])
        sigma = np.array([noise[kernel.coordinates[i]] for i in measured])
        size = 1.0 / np.sqrt(len(some))  # sums over these samples are means
        weights = moved.weights if moved.half else np.array([[1.0], [0.0], [0.0]])
        flat = inertia.reshape(-1, len(measured))
        system = System(
            system.columns, system.right, Noise(sigma, size * shares, size * flat, weights, motion.v is None)
        )
    of_coordinates = tuple(item for item in sought if not isinstance(item, Entry))
    return Equations(of_coordinates, tuple(places), system)


Deviation = tuple[Array, Array, Array]  # of one coordinate: itself, its rate, (T,) each, and its derivatives, (T, n)


@dataclass(frozen=True)
class Deviations:
    """Coordinates that matrices are between, by name: s, rates and derivatives by q, (T, k), (T, k) and (T, k, n)."""

    names: tuple[str, ...]
    s: Array
    rates: Array
    rows: Array

    def of(self, name: str) -> Deviation:
        """Return those of one coordinate."""
        i = self.names.index(name)
        return self.s[:, i], self.rates[:, i], self.rows[:, i]


def deviations_of(kernel: Kernel, moved: Moved, owner: str, name: str = "") -> Deviations:
    """Return the coordinates of the joints of a tree, or the six of a loop joint or a bushing, along a motion."""
    if owner == OF_JOINTS:
        rows = np.broadcast_to(np.eye(kernel.n), (*moved.q.shape, kernel.n))
        return Deviations(kernel.coordinates, moved.q, moved.v, rows)
    s, rows = moved.pairs[owner, name].deviations(kernel, moved.q)
    names = tuple(component_name(name, kind) for kind in COORDINATES)
    return Deviations(names, s, np.einsum("tkn,tn->tk", rows, moved.v), rows)


def deviation_of(kernel: Kernel, moved: Moved, item: Sought) -> Deviation:
    """Return deviation and rate of a coordinate, (T,) each, and its derivatives by all coordinates, (T, n)."""
    if item.in_tree:
        return deviations_of(kernel, moved, OF_JOINTS).of(item.name)
    i = kernel.cut_laws.index(item.name)
    rows = np.asarray(kernel.functions.cut_jacobian(moved.q))[:, i]
    return (
        np.asarray(kernel.functions.cut_forces(moved.q, moved.v))[:, i, 0],
        np.einsum("tn,tn->t", rows, moved.v),
        rows,
    )


def moved_by(kernel: Kernel, moved: Moved, entries: Sequence[Entry]) -> set[str]:
    """Return names of the coordinates that move frames of loop joints and bushings of which entries are."""
    names = set[str]()
    for owner, name in dict.fromkeys((entry.owner, entry.joint) for entry in entries if entry.owner != OF_JOINTS):
        size = np.abs(deviations_of(kernel, moved, owner, name).rows).max(axis=(0, 1))
        names |= {x for x, at in zip(kernel.coordinates, size.tolist(), strict=True) if at > MOVES * size.max()}
    return names


def _single_motions(kernel: Kernel, rows: Sequence[str], moved: Moved) -> Array:
    """Return motions of single coordinates, of kinetic energies as large as one another, (T, n, rows)."""
    inertia = np.diagonal(kernel.mass_matrix(moved.q), axis1=1, axis2=2).mean(axis=0)
    size = 1.0 / np.sqrt(np.maximum(inertia, 1e-12 * inertia.max()))
    chosen = (np.eye(kernel.n) * size)[:, index_of(kernel.coordinates, rows)]
    return np.broadcast_to(chosen, (len(moved.q), *chosen.shape))


def _free_motions(kernel: Kernel, model: Model, motion: MeasuredMotion, moved: Moved) -> Array:
    """Return motions along which neither loops, couplings nor unknown drives do work, (T, n, f).

    Lengths are measured by kinetic energy.  The null space's projector is smooth over time; it is seen from the
    directions that it has most of on average.

    Raises:
        InputError: there are none.
    """
    names = kernel.coordinates
    unknown = {names[i] for i in model.driven}.difference(motion.driven) | set(kernel.prescribed)
    units = np.eye(kernel.n)[[name in unknown for name in names]]
    rows = np.broadcast_to(units, (len(moved.q), *units.shape))
    if kernel.constraints:
        rows = np.concatenate([kernel.functions.constraint_jacobian(moved.q), rows], axis=1)
    inertia = np.diagonal(kernel.mass_matrix(moved.q), axis1=1, axis2=2).mean(axis=0)
    size = 1.0 / np.sqrt(np.maximum(inertia, 1e-12 * inertia.max()))
    scaled = rows * size
    projector = np.eye(kernel.n) - np.linalg.pinv(scaled, rcond=RANK) @ scaled
    left = round(float(np.trace(projector, axis1=1, axis2=2).max()))
    if not left:
        raise InputError(
            f"fit: {kernel.name}: the drives of {listed(sorted(unknown.difference(kernel.prescribed)))} are not known,"
            " and they hold all else; allowed: their drives as columns NAME.drive"
        )
    _, directions = np.linalg.eigh(projector.mean(axis=0))
    return np.asarray(size[:, np.newaxis] * (projector @ directions[:, -left:]))
