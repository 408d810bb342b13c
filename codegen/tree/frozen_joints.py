"""The one place where the program begins: joints as what SymPy has left of them.

``freeze`` gives a joint's step as rows of plain factors of 1, sine and cosine (``eomgen.codegen.joint.freezing`` takes
them from SymPy), and ``geometry`` evaluates these rows on any scalar along the tree.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce

from eomgen.robot.model import Model

from ..joint.facts import FrozenStep
from ..joint.kept import KEPT
from .bound import Bound
from .spatial import ZERO, Mat, Scalar, Vec, add, mat3, matvec, transpose, vec3


def freeze(coordinate: str) -> FrozenStep:
    """Step of one coordinate ("x" ... "gamma") without SymPy."""
    return KEPT.steps[coordinate]


@dataclass(frozen=True)
class Rotation:
    """One rotation of a joint: index in q, axis, sine and cosine, and the 3x3 matrix R of eq. (3)."""

    index: int
    axis: int
    sin: Scalar
    cos: Scalar
    matrix: Mat


@dataclass(frozen=True)
class JointGeometry:
    """A joint at its q: ``turn`` is R_B, ``offset`` the origin after the translations, in the parent body's axes.

    ``translations`` are (index in q, axis); ``rotations`` follow in the order alpha, beta, gamma.
    """

    turn: Mat
    offset: Vec
    translations: tuple[tuple[int, int], ...]
    rotations: tuple[Rotation, ...]

    def inwards(self, x: Vec) -> Vec:
        """Turn a vector of the axes in front of all rotations into those behind them."""
        return reduce(lambda y, turn: matvec(transpose(turn.matrix), y), self.rotations, x)

    def outwards(self, x: Vec) -> Vec:
        """Turn a vector of the axes behind all rotations into those in front of them."""
        return reduce(lambda y, turn: matvec(turn.matrix, y), reversed(self.rotations), x)


def unit(axis: int, length: Scalar = 1.0) -> Vec:
    """Return a vector along an axis."""
    return vec3(length if i == axis else 0.0 for i in range(3))


def geometry(
    model: Model,
    bound: Bound,
    q: Sequence[Scalar],
    sincos: Callable[[Scalar], tuple[Scalar, Scalar]],
) -> list[JointGeometry]:
    """Evaluate every joint's transform at q, elementary step by elementary step."""
    joints = []
    for body, numbers in zip(model.bodies, bound.bodies, strict=True):
        steps = [(index, freeze(name)) for index, name in zip(body.indices, body.active, strict=True)]
        shift = ZERO
        rotations = []
        for index, frozen in steps:
            if frozen.is_rotation:
                sin, cos = sincos(q[index] + bound.angle_offsets[index])
                rotations.append(Rotation(index, frozen.axis, sin, cos, _evaluate(frozen, sin, cos)))
            else:
                shift = add(shift, unit(frozen.axis, q[index]))
        turn = numbers.placement.rotation
        offset = add(matvec(turn, shift), numbers.placement.origin)
        translations = tuple((index, frozen.axis) for index, frozen in steps if not frozen.is_rotation)
        joints.append(JointGeometry(turn, offset, translations, tuple(rotations)))
    return joints


def _evaluate(frozen: FrozenStep, sin: Scalar, cos: Scalar) -> Mat:
    return mat3([one + s * sin + co * cos for one, s, co in row] for row in frozen.rotation)
