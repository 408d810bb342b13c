"""Motors behind transmissions, eliminated before the tree: their rows of the equations of motion are scalars.

With d the transmission's slope in a linearly implicit step (0 in forward dynamics) and c = 1 / ratio, the rows of a
motor m and its principal coordinate p are

    (J + c^2 d) a_m - c d a_p = r_m,        (M a)_p + d a_p - c d a_m = r_p,

and taking a_m out of the second leaves the tree with d J / (J + c^2 d) on its diagonal and c d r_m / (J + c^2 d) more
on its right side: two springs in series, nothing cancels however stiff the transmission is.  A prescribed motor leaves
d, and c d a_m.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from eomgen.robot.model import Model

from ..tree.bound import Bound
from ..tree.spatial import Scalar, is_zero
from .rows import Response


@dataclass(frozen=True)
class _Row:
    """a_m = free + gain a_p, where the pivot is positive."""

    free: Scalar
    gain: Scalar
    pivot: Scalar


class Rotors:
    """The motors' rows; ``armature`` and ``drives`` (n,) are those of the tree that is left."""

    def __init__(
        self,
        model: Model,
        bound: Bound,
        armature: Sequence[Scalar],
        drives: Sequence[Scalar],
        slopes: Mapping[int, Scalar],
    ) -> None:
        """Take the motors out.

        Args:
            armature: of every coordinate, (n,), a motor's with its share of an implicit step.
            drives: right sides, (n,); of a prescribed coordinate its acceleration.
            slopes: d by the index of the motor; 0 where it is absent.
        """
        self.bound, self.armature, self.drives = bound, list(armature), list(drives)
        self.rows: dict[int, _Row] = {}
        self.prescribed = prescribed = frozenset(model.prescribed)
        for motor, between in bound.transmissions.items():
            p, inertia, slope = between.principal, armature[motor], slopes.get(motor, 0.0)
            across = slope * between.inverse_ratio
            pivot = inertia + across * between.inverse_ratio
            inverse = 1.0 / pivot
            held = motor in prescribed
            row = _Row(drives[motor], 0.0, 1.0) if held else _Row(drives[motor] * inverse, across * inverse, pivot)
            self.rows[motor] = row
            self.armature[p] = self.armature[p] + (slope if held else slope * (inertia * inverse))
            if p not in prescribed:  # there the right side is the acceleration itself
                self.drives[p] = self.drives[p] + across * row.free

    def respond(self, push: list[Scalar], response: Response) -> None:
        """Eliminate motors at rest under drives ``push``, (n,), to which what comes through to the joints is added."""
        for motor, row in self.rows.items():
            if motor not in self.prescribed and not is_zero(push[motor]):
                response.put(motor, push[motor], push[motor] * (1.0 / row.pivot))
                p = self.bound.transmissions[motor].principal
                push[p] = push[p] + row.gain * push[motor]

    def released(self, free: Mapping[int, Scalar], accelerations: list[Scalar]) -> None:
        """Write the accelerations of motors at rest, of what ``respond`` left, into those of the tree."""
        for motor, row in self.rows.items():
            if motor not in self.prescribed:
                p = self.bound.transmissions[motor].principal
                accelerations[motor] = free.get(motor, 0.0) + row.gain * accelerations[p]

    def release(self, accelerations: list[Scalar], pivots: list[tuple[Scalar, Scalar]]) -> None:
        """Put the motors' accelerations and pivots, with what they are compared to, into those of the tree."""
        for motor, row in self.rows.items():
            accelerations[motor] = row.free + row.gain * accelerations[self.bound.transmissions[motor].principal]
            pivots[motor] = (row.pivot, row.pivot)
