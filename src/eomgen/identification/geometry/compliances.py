"""Compliances of the error model: of single coordinates, and of those of a joint that a stiffness matrix couples.

Deflections are linear in compliances, s = C f, and a coordinate that nothing bends has a row of 0 in C; so that C is
what is fitted, and K = C^-1 what is said.  Both are matrices between the same groups of coordinates.  Where some
entries of K stay as they are, those of K are parameters, s = K^-1 f.

Coordinates of a loop joint act at the frame on its first link: what it deviates by moves that frame, and the force
there is the one that the loop passes on.
"""

from __future__ import annotations

from collections.abc import Collection, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...names import component_name, listed, parameter_name
from ...robot.elements.joint_stiffness import JOINT_STIFFNESS, JointStiffness
from ...robot.elements.matrices import matrix_of
from ...robot.joint_types import CUTS
from ...robot.value import COORDINATES, MOTOR, Robot
from .blocks import ENTRY, FORCE
from .error_model import COMPLIANCE, JOINTS, LOOPS, ErrorParameter
from .stations import Chain

Pairs = Collection[tuple[str, str]]
Couplings = Mapping[tuple[str, str], Pairs]  # pairs of coordinates by "joints" or "loops" and their names
_NO_INVERSE = 1e-12  # of a matrix scaled by its diagonal: an eigenvalue that is less is 0
_SEEN = 0.1  # of a direction's largest share, from which on its coordinates are named


@dataclass(frozen=True)
class Chosen:
    """Names of unknowns that are asked for beside those of the description.

    motors: names of those whose transmissions count; None: all.  coordinates: that count without a stiffness, too.
    couplings: entries of matrices; of a joint that has some, all others stay as they are.  fixed: names of parameters
    that stay, or their beginnings.
    """

    motors: Container[str] | None = None
    coordinates: Collection[str] = ()
    couplings: Couplings = field(default_factory=dict)
    fixed: Sequence[str] = ()

    def seeks(self, owner: str, joint: str, one: str, other: str) -> bool:
        """Return whether an entry of a joint's matrix is sought: all are where none of the joint is asked for."""
        if is_below(parameter_name(owner, joint, JOINT_STIFFNESS, one, other), self.fixed):
            return False
        pairs = self.couplings.get((owner, joint), ())
        by_name = one == other and component_name(joint, one) in self.coordinates
        return not pairs or (one, other) in pairs or by_name

    def stays(self, parameter: ErrorParameter) -> bool:
        """Return whether a parameter keeps its described value."""
        if parameter.factor == ENTRY:
            owner, joint, _, one, other = parameter.name.split(".")
            return not self.seeks(owner, joint, one, other)
        return is_below(parameter.name, self.fixed)


def is_below(name: str, beginnings: Sequence[str]) -> bool:
    """Return whether a parameter's name is one of these, or below one."""
    return any(name == prefix or name.startswith(f"{prefix}.") for prefix in beginnings)


@dataclass(frozen=True)
class _Elastic:
    """A joint, or a loop joint, and the station at which it deflects.

    bending: coordinates that may.  single: name and stiffness of tables of these, and of its transmission's.
    held: the coordinate of a drive, which nothing else holds.
    """

    owner: str
    name: str
    station: int
    bending: tuple[int, ...]
    single: Mapping[int, tuple[str, float]]
    stiffness: JointStiffness | None
    held: int | None = None

    def groups(self, chosen: Chosen) -> list[list[int]]:
        """Return coordinates that matrices couple, in groups that hang together; a drive holds its coordinate."""
        described = [] if self.stiffness is None else [key.split(".") for key in self.stiffness.entries]
        asked = chosen.couplings.get((self.owner, self.name), ())
        groups: list[set[int]] = []
        for pair in ([COORDINATES.index(name) for name in pair] for pair in (*described, *asked)):
            if self.held in pair or not set(pair) <= set(self.bending):
                continue
            joined = set(pair).union(*(group for group in groups if group & set(pair)))
            groups = [group for group in groups if not group & joined] + [joined]
        return sorted(map(sorted, groups))


def compliances_of(
    chain: Chain, robot: Robot, chosen: Chosen | None = None, rigid: Collection[tuple[int, int]] = ()
) -> Iterator[ErrorParameter]:
    """Yield compliances of deviations and transmissions, in m/N, rad/N and rad/(N m), by the names of the stiffness.

    Of a matrix whose entries are not all sought, all entries of the coordinates that hang together: of K.

    Args:
        chain: of the robot.
        robot: that has the loop joints.
        chosen: what counts beside what is described.
        rigid: stations and coordinates that do not bend.

    Raises:
        InputError: a described matrix, with the tables beside it, has no inverse, or some of its entries are sought
            alone where it does not hold a coordinate.
    """
    chosen = Chosen() if chosen is None else chosen
    for joint in _elastic(chain, robot, chosen):
        k = joint.station
        groups = [[c for c in group if (k, c) not in rigid] for group in joint.groups(chosen)]
        coupled = {c for group in groups for c in group}
        for c in joint.bending:
            name = component_name(joint.name, COORDINATES[c])
            key, stiffness = joint.single.get(c, (name, 0.0))
            if c not in coupled and (k, c) not in rigid and (stiffness or name in chosen.coordinates):
                nominal = 1.0 / stiffness if stiffness else 0.0
                yield ErrorParameter(
                    parameter_name(joint.owner, key, "stiffness"), COMPLIANCE, k, c, FORCE, nominal, nominal
                )
        for group in groups:
            yield from _of_group(joint, group, chosen)


def _elastic(chain: Chain, robot: Robot, chosen: Chosen) -> Iterator[_Elastic]:
    """Yield joints that may deflect, in the order of their stations, then loop joints by what their type blocks."""
    for k, station in enumerate(chain.stations):
        joint, single = station.joint, dict[int, tuple[str, float]]()
        if joint is None:
            continue
        for c, kind in enumerate(COORDINATES):
            coordinate, motor = joint.coordinates.get(kind), component_name(joint.name, MOTOR)
            if c != station.principal and coordinate is not None:
                single[c] = component_name(joint.name, kind), coordinate.stiffness or 0.0
            elif c == station.principal and joint.motor and (chosen.motors is None or motor in chosen.motors):
                single[c] = motor, joint.motor.transmission.stiffness or 0.0
        held = station.principal if station.principal not in single else None
        yield _Elastic(JOINTS, joint.name, k, tuple(range(6)), single, joint.stiffness, held)
    for loop, (first, _) in zip(robot.loops, chain.cuts, strict=True):
        bending = tuple(sorted(COORDINATES.index(x.name) for x in CUTS[loop.type]))
        tables = {c: loop.coordinates[COORDINATES[c]] for c in bending if COORDINATES[c] in loop.coordinates}
        single = {c: (component_name(loop.name, COORDINATES[c]), x.stiffness or 0.0) for c, x in tables.items()}
        yield _Elastic(LOOPS, loop.name, first, bending, single, loop.stiffness)


def _of_group(joint: _Elastic, group: Sequence[int], chosen: Chosen) -> Iterator[ErrorParameter]:
    """Yield the compliances of coordinates of a joint that hang together, or entries of K where some of them stay."""
    names = [COORDINATES[c] for c in group]
    entries = {} if joint.stiffness is None else joint.stiffness.entries
    K = np.array(matrix_of(entries, names)).reshape(len(group), len(group))
    K += np.diag([joint.single.get(c, ("", 0.0))[1] for c in group])
    C, elastic = np.zeros_like(K), np.diagonal(K) > 0.0
    if elastic.any():
        own = np.ix_(elastic, elastic)
        soft = [x for x, bends in zip(names, elastic, strict=True) if bends]
        C[own] = _inverse(parameter_name(joint.owner, joint.name, JOINT_STIFFNESS), soft, K[own])
    pairs = [(i, j) for i in range(len(group)) for j in range(i, len(group))]
    is_whole = all(chosen.seeks(joint.owner, joint.name, names[i], names[j]) for i, j in pairs)
    if not (is_whole or elastic.all()):
        rigid = [component_name(joint.name, x) for x, bends in zip(names, elastic, strict=True) if not bends]
        raise InputError(
            f"stiffness: some entries of {component_name(joint.name, JOINT_STIFFNESS)} are sought, and nothing holds"
            f" {listed(rigid)} in the description; allowed: all entries between {', '.join(names)}, or a stiffness to"
            " begin with"
        )
    values, factor = (C, FORCE) if is_whole else (K, ENTRY)
    for i, j in pairs:
        name = parameter_name(joint.owner, joint.name, JOINT_STIFFNESS, names[i], names[j])
        size = float(np.sqrt(values[i, i] * values[j, j]))
        yield ErrorParameter(
            name, COMPLIANCE, joint.station, group[i], factor, float(values[i, j]), size, other=group[j]
        )


def _inverse(matrix: str, names: Sequence[str], K: Array) -> Array:
    size = np.sqrt(np.diagonal(K))
    values, vectors = np.linalg.eigh(K / np.outer(size, size))
    if values[0] <= _NO_INVERSE * len(K):
        shares = np.abs(vectors[:, 0])
        direction = [x for x, share in zip(names, shares, strict=True) if share >= _SEEN * shares.max()]
        raise InputError(
            f"{matrix}: nothing holds a motion along {listed(direction)}"
            " together, and loads deflect it without end; allowed: a matrix that has an inverse"
        )
    C = np.asarray(((vectors / values) @ vectors.T) / np.outer(size, size))
    return np.asarray(0.5 * (C + C.T))
