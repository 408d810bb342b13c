"""Subjects of tolerances, as directions in the parameters of the error model; the exact model of all of them.

x = nominal + D y    but 1 / (k + y) of a stiffness    where y are deviations of what the table names

and of entries of a stiffness matrix the inverse of what they make together.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Index
from ...errors import InputError
from ...names import parameter_name
from ...robot.coordinates import UNITS
from ...robot.elements.joint_stiffness import JOINT_STIFFNESS
from ...robot.value import COORDINATES, Robot
from ..geometry.blocks import Block, blocks_of
from ..geometry.compliances import compliances_of
from ..geometry.error_model import (
    COMPLIANCE,
    DRIVE,
    JOINTS,
    ErrorModel,
    ErrorParameter,
    Rows,
    model_parameters,
)
from ..geometry.loop_constraints import LoopConstraints
from ..geometry.rotations import vectors_of
from ..geometry.stations import Chain, Station

CHUNK = 20_000  # rows that are evaluated at once: 150 MB of a six-axis arm


@dataclass(frozen=True)
class Contribution:
    """One parameter that a table may name.

    described: what the description says, in its unit; None where that is no number.
    parts: indices of parameters of the error model, and by how much each moves per unit; of a stiffness the index of
        its compliance.
    """

    name: str
    unit: str
    described: float | None
    parts: tuple[tuple[int, float], ...]
    is_stiffness: bool = False


def model_of(robot: Robot, chain: Chain, closing: LoopConstraints | None) -> ErrorModel:
    """Return the error model with everything that can be off: placements, offsets, compliances, terms of drives."""
    known = dict.fromkeys(chain.tools, True)
    parameters = list(model_parameters(robot, chain, [0], known))
    if closing is None:
        parameters += compliances_of(chain, robot)
    parameters += _drives(chain)
    return ErrorModel(robot, chain, tuple(parameters), {0: np.eye(4)}, closing)


def _drives(chain: Chain) -> Iterator[ErrorParameter]:
    """Yield the gain of every principal coordinate, eccentricity of those that turn."""
    for k, station in enumerate(chain.stations):
        c = station.principal
        if c is None:
            continue
        terms = [("gain", "gain")]
        terms += [("eccentricity.cos", "cos"), ("eccentricity.sin", "sin")] if c >= 3 else []
        for key, factor in terms:
            yield ErrorParameter(parameter_name(JOINTS, station.name, key), DRIVE, k, c, factor, 0.0, 1.0)


def contributions_of(model: ErrorModel) -> dict[str, Contribution]:
    """Return everything that a table may name, by name."""
    entries = dict[int, float]()
    for block in blocks_of(model.parameters):
        K = block.stiffness(model.nominal)
        entries |= {at: float(K[i, j]) for at, i, j in block.pairs}
    contributions = [_of_parameter(i, parameter, entries.get(i)) for i, parameter in enumerate(model.parameters)]
    index = {parameter.name: i for i, parameter in enumerate(model.parameters)}
    for station in model.chain.stations:
        contributions += _of_joint(station, index)
    return {one.name: one for one in contributions}


def _of_parameter(i: int, parameter: ErrorParameter, entry: float | None) -> Contribution:
    """Return that of a parameter; ``entry``: of a stiffness matrix, the described one."""
    if entry is not None:
        return Contribution(parameter.name, parameter.unit, entry, ((i, 1.0),), parameter.is_diagonal)
    if parameter.kind == COMPLIANCE:
        return Contribution(parameter.name, parameter.unit, 1.0 / parameter.nominal, ((i, 1.0),), True)
    return Contribution(parameter.name, parameter.unit, parameter.nominal, ((i, 1.0),))


def _of_joint(station: Station, index: Mapping[str, int]) -> Iterator[Contribution]:
    """Yield a joint's placement along the axes of its parent, its length, and its clearances."""
    joint = station.joint
    if joint is None or station.principal is None:
        return
    offsets = [index[parameter_name(JOINTS, joint.name, "offset", kind)] for kind in COORDINATES]
    xyz = np.array(joint.placement.xyz)
    turn = np.array(joint.placement.rotation) @ np.array(joint.axis_turn)
    directions = {parameter_name("placement", kind): (np.eye(3)[c], xyz[c]) for c, kind in enumerate(COORDINATES[:3])}
    length = float(np.linalg.norm(xyz))
    if length > 0.0:
        directions["length"] = xyz / length, length
    for key, (along, described) in directions.items():
        parts = tuple(zip(offsets[:3], (turn.T @ along).tolist(), strict=True))
        yield Contribution(parameter_name(JOINTS, joint.name, key), "m", float(described), parts)
    for c, kind in enumerate(COORDINATES):
        coordinate = joint.coordinates.get(kind)
        described = None if coordinate is None else coordinate.clearance
        name = parameter_name(JOINTS, joint.name, kind, "clearance")
        yield Contribution(name, UNITS[kind], described, ((offsets[c], 1.0),))


@dataclass(frozen=True)
class Exact:
    """The exact model of a tool at poses: what K contributions do to it, however large they are.

    rows: of the N poses.  tool: station of the tool.
    """

    model: ErrorModel
    rows: Rows
    tool: int
    contributions: tuple[Contribution, ...]

    @property
    def robot(self) -> Robot:
        """The robot as it is described."""
        return self.model.robot

    @property
    def wrench(self) -> Array | None:
        """Force (N) and moment (N m) on the tool, (6,), base frame; None where there is none."""
        loads = self.rows.loads.get(self.tool)
        return None if loads is None else np.asarray(loads)[0]

    @property
    def is_soft(self) -> bool:
        """Whether loads deflect the robot."""
        return any(parameter.kind == COMPLIANCE for parameter in self.model.parameters)

    def values(self, y: Array) -> Array:
        """Return values of the error model's parameters, (P, M), of deviations of the contributions, (K, M)."""
        x = np.repeat(self.model.nominal[:, np.newaxis], y.shape[1], axis=1)
        blocks = blocks_of(self.model.parameters)
        coupled, changed = {at for block in blocks for at, _, _ in block.pairs}, dict[int, Array]()
        for one, off in zip(self.contributions, y, strict=True):
            for i, factor in one.parts:
                if i in coupled:
                    changed[i] = off
                else:
                    x[i] = 1.0 / (one.described + off) if one.is_stiffness and one.described else x[i] + factor * off
        for block in blocks:
            if changed.keys() & {at for at, _, _ in block.pairs}:
                K = np.repeat(block.stiffness(self.model.nominal)[np.newaxis], y.shape[1], axis=0)
                for at, i, j in block.pairs:
                    K[:, i, j] += changed.get(at, 0.0)
                    K[:, j, i] = K[:, i, j]
                C = self._inverse(block, K)
                for at, i, j in block.pairs:
                    x[at] = C[:, i, j]
        return x

    def _inverse(self, block: Block, K: Array) -> Array:
        """Return inverses of stiffness matrices, (M, n, n); InputError where one of them would not be positive."""
        try:
            np.linalg.cholesky(K)
        except np.linalg.LinAlgError:
            joint = parameter_name(JOINTS, self.model.chain.stations[block.station].name, JOINT_STIFFNESS)
            raise InputError(
                f"tolerance: deviations of its entries make {joint} indefinite; allowed: smaller ones, with which it"
                " resists every motion"
            ) from None
        return np.asarray(np.linalg.inv(K))

    def poses(self, y: Array, chosen: Index) -> tuple[Array, Array]:
        """Return rotation (M, 3, 3) and position (M, 3), m, of the tool, with deviations (K, M), at poses chosen."""
        R, p = np.empty((len(chosen), 3, 3)), np.empty((len(chosen), 3))
        for first in range(0, len(chosen), CHUNK):
            chunk = slice(first, first + CHUNK)
            located = self.model.at(self.values(y[:, chunk]), self.rows.part(chosen[chunk])).located
            R[chunk], p[chunk] = located.R[self.tool], located.p[self.tool]
        return R, p

    def motions(self, y: Array, chosen: Index) -> Array:
        """Return the displacement (m) and rotation vector (rad) of the tool, (M, 6), base frame.

        Arguments as of ``poses``.
        """
        which, places = np.unique(chosen, return_inverse=True)
        R0, p0 = self.poses(np.zeros((len(self.contributions), len(which))), which)
        R, p = self.poses(y, chosen)
        turn = vectors_of(R @ R0[places].transpose(0, 2, 1))
        return np.hstack([p - p0[places], turn])

    def sensitivities(self, sizes: Array) -> Array:
        """Return the motion of the tool per unit of every contribution, (N, 6, K), m and rad.

        Exact where nothing is elastic; else by central differences over a hundredth of the sizes, (K,), because what is
        off moves loads, too.
        """
        count, many = len(self.contributions), len(self.rows.series)
        if not self.is_soft:
            by_quantity = self.model.at(self.model.nominal, self.rows).sensitivities(self.tool)
            D = np.zeros((len(self.model.parameters), count))
            for k, one in enumerate(self.contributions):
                for i, factor in one.parts:
                    D[i, k] += factor
            return np.asarray(by_quantity @ D)
        sensitivities = np.empty((many, 6, count))
        everywhere = np.arange(many)
        for k in range(count):
            y = np.zeros((count, many))
            y[k] = step = 1e-2 * sizes[k] if sizes[k] > 0.0 else 1e-6 * (self.contributions[k].described or 1.0)
            sensitivities[:, :, k] = (self.motions(y, everywhere) - self.motions(-y, everywhere)) / (2.0 * step)
        return sensitivities
