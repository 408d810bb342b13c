"""Compliances of the error model: of single coordinates, and of those of a joint that a stiffness matrix couples.

Deflections are linear in compliances, s = C f, and a coordinate that nothing bends has a row of 0 in C; so that C is
what is fitted, and K = C^-1 what is said.  Both are matrices between the same groups of coordinates.
"""

from __future__ import annotations

from collections.abc import Collection, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Index
from ...errors import InputError
from ...names import component_name, listed, parameter_name
from ...robot.elements.joint_stiffness import JOINT_STIFFNESS
from ...robot.elements.matrices import entry_name, matrix_of
from ...robot.value import COORDINATES, MOTOR, Joint
from .error_model import COMPLIANCE, JOINTS, ErrorParameter
from .stations import Chain, Station

Couplings = Mapping[str, Collection[tuple[str, str]]]  # pairs of coordinates by joints' names
_NO_INVERSE = 1e-12  # of a matrix scaled by its diagonal: an eigenvalue that is less is 0
_SEEN = 0.1  # of a direction's largest share, from which on its coordinates are named


def compliances_of(
    chain: Chain,
    motors: Container[str] | None = None,
    others: Container[str] = (),
    couplings: Couplings | None = None,
    rigid: Collection[tuple[int, int]] = (),
) -> Iterator[ErrorParameter]:
    """Yield compliances of deviations and transmissions, in m/N, rad/N and rad/(N m), by the names of the stiffness.

    Args:
        chain: of the robot.
        motors: names of those whose transmissions count; None: all.
        others: coordinates without a stiffness that count.
        couplings: pairs that count beside those of described matrices; a group that hangs together has all entries.
        rigid: stations and coordinates that do not bend.

    Raises:
        InputError: a described matrix, with the tables beside it, has no inverse.
    """
    for k, station in enumerate(chain.stations):
        if station.joint is None:
            continue
        single = {c: x for c, x in _single(station, station.joint, motors).items() if (k, c) not in rigid}
        groups = _groups(station, station.joint, (couplings or {}).get(station.joint.name, ()), single)
        groups = [[c for c in group if (k, c) not in rigid] for group in groups]
        coupled = {c for group in groups for c in group}
        for c, kind in enumerate(COORDINATES):
            key, stiffness = single.get(c, (component_name(station.joint.name, kind), None))
            asked = component_name(station.joint.name, kind) in others and (k, c) not in rigid
            if c not in coupled and (stiffness or asked):
                nominal = 1.0 / stiffness if stiffness else 0.0
                name = parameter_name(JOINTS, key, "stiffness")
                yield ErrorParameter(name, COMPLIANCE, k, c, "force", nominal, nominal)
        for group in groups:
            yield from _of_group(k, station.joint, group, single)


def _single(station: Station, joint: Joint, motors: Container[str] | None) -> dict[int, tuple[str, float | None]]:
    """Return the owner and the stiffness of a joint's tables, of deviations and of its transmission, by coordinate."""
    found: dict[int, tuple[str, float | None]] = {}
    for c, kind in enumerate(COORDINATES):
        coordinate, motor = joint.coordinates.get(kind), component_name(joint.name, MOTOR)
        if c != station.principal and coordinate is not None:
            found[c] = component_name(joint.name, kind), coordinate.stiffness
        elif c == station.principal and joint.motor and (motors is None or motor in motors):
            found[c] = motor, joint.motor.transmission.stiffness
    return found


def _groups(
    station: Station, joint: Joint, chosen: Collection[tuple[str, str]], single: Collection[int]
) -> list[list[int]]:
    """Return coordinates that matrices couple, in groups that hang together; a drive holds its coordinate."""
    described = [] if joint.stiffness is None else [key.split(".") for key in joint.stiffness.entries]
    pairs = [[COORDINATES.index(name) for name in pair] for pair in (*described, *chosen)]
    held = station.principal if station.principal not in single else None
    groups: list[set[int]] = []
    for pair in pairs:
        if held in pair:
            continue
        joined = set(pair).union(*(group for group in groups if group & set(pair)))
        groups = [group for group in groups if not group & joined] + [joined]
    return sorted(map(sorted, groups))


def _of_group(
    k: int, joint: Joint, group: Sequence[int], single: Mapping[int, tuple[str, float | None]]
) -> Iterator[ErrorParameter]:
    """Yield the compliances of coordinates of a joint that hang together."""
    names = [COORDINATES[c] for c in group]
    entries = {} if joint.stiffness is None else joint.stiffness.entries
    K = np.array(matrix_of(entries, names)).reshape(len(group), len(group))
    K += np.diag([single.get(c, ("", None))[1] or 0.0 for c in group])
    C, elastic = np.zeros_like(K), np.diagonal(K) > 0.0
    if elastic.any():
        own = np.ix_(elastic, elastic)
        C[own] = _inverse(joint.name, [x for x, soft in zip(names, elastic, strict=True) if soft], K[own])
    for i, one in enumerate(group):
        for j, other in enumerate(group[i:], i):
            name = parameter_name(JOINTS, joint.name, JOINT_STIFFNESS, entry_name(names[i], names[j]))
            size = float(np.sqrt(C[i, i] * C[j, j]))
            yield ErrorParameter(name, COMPLIANCE, k, one, "force", float(C[i, j]), size, other=other)


def _inverse(joint: str, names: Sequence[str], K: Array) -> Array:
    size = np.sqrt(np.diagonal(K))
    values, vectors = np.linalg.eigh(K / np.outer(size, size))
    if values[0] <= _NO_INVERSE * len(K):
        shares = np.abs(vectors[:, 0])
        direction = [x for x, share in zip(names, shares, strict=True) if share >= _SEEN * shares.max()]
        raise InputError(
            f"{parameter_name(JOINTS, joint, JOINT_STIFFNESS)}: nothing holds a motion along {listed(direction)}"
            " together, and loads deflect it without end; allowed: a matrix that has an inverse"
        )
    C = np.asarray(((vectors / values) @ vectors.T) / np.outer(size, size))
    return np.asarray(0.5 * (C + C.T))


@dataclass(frozen=True)
class Block:
    """Compliances of coordinates that hang together: where they stand among the parameters of a model, (n, n)."""

    station: int
    coordinates: tuple[int, ...]
    index: Index

    @property
    def pairs(self) -> list[tuple[int, int, int]]:
        """Index of every parameter, with its row and column."""
        n = len(self.coordinates)
        return [(int(self.index[i, j]), i, j) for i in range(n) for j in range(i, n)]

    def stiffness(self, x: Array) -> Array:
        """Return K of the values of all parameters, (P,); infinite on the diagonal where nothing bends, (n, n)."""
        C = np.asarray(x)[self.index]
        soft = np.diagonal(C) != 0.0
        K = np.diag(np.where(soft, 0.0, np.inf))
        own = np.ix_(soft, soft)
        try:
            K[own] = np.linalg.inv(C[own])
        except np.linalg.LinAlgError:
            K[own] = np.nan
        return K

    def slopes(self, K: Array) -> Array:
        """Return derivatives of the entries of K by those of C, in the order of ``pairs``: dK = -K dC K."""
        pairs = [(i, j) for _, i, j in self.pairs]
        with np.errstate(invalid="ignore"):
            rows = [[-(K[i, a] * K[b, j] + (K[i, b] * K[a, j] if a != b else 0.0)) for a, b in pairs] for i, j in pairs]
        return np.array(rows)


def blocks_of(parameters: Sequence[ErrorParameter]) -> list[Block]:
    """Return the groups of compliances that matrices couple, in the order of the stations."""
    places: dict[tuple[int, int, int], int] = {}
    for i, parameter in enumerate(parameters):
        if parameter.other is not None:
            places[parameter.station, parameter.coordinate, parameter.other] = i
    blocks = []
    first = sorted({(k, a) for k, a, _ in places})
    while first:
        k, a = first[0]
        ends = [{one, other} for station, one, other in places if station == k]
        group = sorted(set[int]().union(*(pair for pair in ends if a in pair)))
        index = np.array([[places[k, min(i, j), max(i, j)] for j in group] for i in group], dtype=np.intp)
        blocks.append(Block(k, tuple(group), index))
        first = [place for place in first if place[0] != k or place[1] not in group]
    return blocks
