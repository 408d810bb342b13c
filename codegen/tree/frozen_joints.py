"""The one place where programs begin: joints from the numbers that SymPy derived.

``JointFacts`` have each elementary transform of a joint as rows of factors of 1, sine and cosine; ``geometry``
evaluates these rows on any scalar along the tree.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce

from eomgen.robot.geometry import JointStep
from eomgen.robot.model import Model

from ..joint.facts import facts_of
from .bound import Bound
from .spatial import ZERO, Mat, Scalar, Vec, add, mat3, matvec, transpose, vec3


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


Note = Callable[[str], None]


def no_note(_: str) -> None:
    """Discard comments."""


@dataclass(frozen=True)
class PosedTree:
    """A tree where q is: its model, numbers and joints; ``note`` puts a comment in front of the next value."""

    model: Model
    bound: Bound
    joints: Sequence[JointGeometry]
    note: Note = no_note


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
        shift = ZERO
        translations, rotations = [], []
        for index, step in zip(body.indices, facts_of(model, body.active).steps, strict=True):
            if step.is_rotation:
                sin, cos = sincos(q[index] + bound.angle_offsets[index])
                rotations.append(Rotation(index, step.axis, sin, cos, _evaluate(step, sin, cos)))
            else:
                shift = add(shift, unit(step.axis, q[index]))
                translations.append((index, step.axis))
        turn = numbers.placement.rotation
        offset = add(matvec(turn, shift), numbers.placement.origin)
        joints.append(JointGeometry(turn, offset, tuple(translations), tuple(rotations)))
    return joints


def _evaluate(step: JointStep, sin: Scalar, cos: Scalar) -> Mat:
    return mat3([one + s * sin + co * cos for one, s, co in row] for row in step.rotation)
