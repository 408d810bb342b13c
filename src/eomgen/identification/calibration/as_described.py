"""Values of a calibration as a description has them: whole placements, and stiffness instead of compliance."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from ...arrays import Array
from ...names import component_name
from ...robot.elements.joint_stiffness import JOINT_STIFFNESS
from ...robot.elements.matrices import matrix_conflict
from ...robot.value import COORDINATES
from ..geometry.blocks import blocks_of
from ..geometry.error_model import COMPLIANCE, PLACEMENT, ErrorModel
from ..geometry.loop_constraints import joint_at
from ..geometry.rotations import coordinates_of, pose_from

_ROUND_OFF = 1e-9  # of the terms of a variance


def described_values(
    links: Mapping[str, tuple[str, Array]], known: Mapping[str, bool], model: ErrorModel, x: Array, covariance: Array
) -> tuple[Array, Array, Array]:
    """Return values as a description has them, what it says, and standard deviations, (P,) each.

    Placements are whole ones, of the frame on its link and of the base before the device; compliances are stiffnesses.

    Args:
        links: link of every measured frame, and the pose on it that is described.
        known: whether the description has that frame.
        model: of the calibration.
        x: values of all parameters, (P,).
        covariance: of these, (P, P).
    """
    values, described = x.copy(), model.nominal
    variance = np.diagonal(covariance).copy()
    groups: dict[tuple[int, int], list[int]] = {}
    for i, parameter in enumerate(model.parameters):
        if parameter.kind == PLACEMENT:
            groups.setdefault((parameter.station, parameter.series), []).append(i)
        elif parameter.kind == COMPLIANCE and parameter.other is None:
            values[i] = 1.0 / x[i] if x[i] != 0.0 else np.inf
            described[i] = 1.0 / parameter.nominal if parameter.nominal else np.nan
            with np.errstate(invalid="ignore"):  # of what does not bend, and is not identifiable, it is not known
                variance[i] *= values[i] ** 4
    for (station, number), places in groups.items():
        if station == 0:
            before, said = model.bases[number], np.full(6, np.nan)
        else:
            frame = model.chain.stations[station].name
            link, pose = links[frame]
            before = model.tool_on_link(frame, link)
            said = coordinates_of(pose) if known[frame] else np.full(6, np.nan)

        def whole(vector: Array, before: Array = before) -> Array:
            return coordinates_of(before @ pose_from(vector))

        values[places], described[places] = whole(x[places]), said
        slope = _slope(whole, x[places])
        variance[places] = _variances(slope, covariance[np.ix_(places, places)])
    for block in blocks_of(model.parameters):
        if block.of_stiffness:
            continue
        at, row, column = (np.array(each, dtype=np.intp) for each in zip(*block.pairs, strict=True))
        K, before = block.stiffness(x), block.stiffness(model.nominal)
        values[at] = K[row, column]
        described[at] = np.where(np.isfinite(before).all(), before, np.nan)[row, column]
        slope = block.slopes(K)
        with np.errstate(invalid="ignore"):
            variance[at] = _variances(slope, covariance[np.ix_(at, at)])
    if (variance < 0.0).any():
        raise np.linalg.LinAlgError("a variance comes out negative")
    with np.errstate(invalid="ignore"):
        return values, described, np.sqrt(variance)


def _variances(slope: Array, covariance: Array) -> Array:
    """Return variances of functions with these derivatives, (m,), without what is negative by round-off."""
    size = np.einsum("ij,jk,ik->i", np.abs(slope), np.abs(covariance), np.abs(slope))
    variances = np.einsum("ij,jk,ik->i", slope, covariance, slope)
    return np.where((variances < 0.0) & (variances > -_ROUND_OFF * size), 0.0, variances)


def indefinite_notes(model: ErrorModel, x: Array) -> list[str]:
    """Return notes about stiffness matrices that no joint can have; they stay as they were found."""
    notes = []
    for block in blocks_of(model.parameters):
        K = block.stiffness(x)
        names = [COORDINATES[c] for c in block.coordinates]
        if np.isfinite(K).all() and matrix_conflict(K.tolist(), names) is not None:
            joint = component_name(joint_at(model.chain, model.robot, block.station), JOINT_STIFFNESS)
            notes.append(
                f"{joint} between {', '.join(names)} is not positive semidefinite, and no description takes it: the"
                " loads say too little, or are others than the file says"
            )
    return notes


def _slope(function: Callable[[Array], Array], x: Array, step: float = 1e-6) -> Array:
    """Return derivatives of six coordinates by six, (6, 6), by central differences."""
    columns = []
    for i in range(6):
        off = np.zeros(6)
        off[i] = step
        ahead, behind = function(x + off), function(x - off)
        change = ahead - behind
        change[3:] = (change[3:] + np.pi) % (2.0 * np.pi) - np.pi
        columns.append(change / (2.0 * step))
    return np.stack(columns, axis=1)
