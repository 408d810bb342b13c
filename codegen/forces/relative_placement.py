"""The six coordinates of a frame b as seen from a frame a, and the rows of their rates.

b is T(x, y, z) . Rx(alpha) . Ry(beta) . Rz(gamma) as seen from a, eq. (3).  With R the rotation of b as seen from a,

    beta = atan2(R02, c),    alpha = atan2(-R12, R22),    gamma = atan2(-R01, R00),    c = cos(beta) = |(R12, R22)|,

and the rates of the angles are the relative angular velocity along the dual vectors of their axes.
"""

from __future__ import annotations

from collections.abc import Sequence

from eomgen.errors import DescriptionError
from eomgen.robot.geometry import ANGULAR, LINEAR

from ..tree.constraints import Direction, FramePair
from ..tree.spatial import Scalar, Vec, add, dot, is_zero, scale
from .element import POLE
from .scalar_functions import Functions

Relative = tuple[Scalar, Direction, tuple[Scalar, Scalar] | None, dict[int, Scalar]]


def coordinates_of(pair: FramePair, names: Sequence[str], f: Functions) -> dict[str, Relative]:
    """Give some of the six coordinates by name: value (m, rad), direction, its sine and cosine, and its row by q.

    Sine and cosine are those of alpha and beta, None of the others.

    Raises:
        DescriptionError: angles are asked for, nothing turns the frames against each other, and beta is at +-pi/2.
    """
    values, directions, turns = list[Scalar](), list[Direction](), dict[str, tuple[Scalar, Scalar] | None]()
    angles = _angles(pair, f) if any(name in ANGULAR for name in names) else {}
    for name in names:
        if name in LINEAR:
            axis = pair.axes_a[LINEAR.index(name)]
            values.append(dot(axis, pair.distance))
            directions.append(Direction(axis, is_rotation=False))
        else:
            value, vector, turns[name] = angles[name]
            values.append(value)
            directions.append(Direction(vector, is_rotation=True))
    return {
        name: (value, direction, turns.get(name), {index: arm for index, arm in row.items() if not is_zero(arm)})
        for name, value, direction, row in zip(names, values, directions, pair.jacobian_rows(directions), strict=True)
    }


def cosine_of(pair: FramePair, f: Functions) -> Scalar:
    """Return the cosine of beta, from 0 on, of the second frame as seen from the first."""
    R = pair.pose().rotation
    return f.sqrt(R[1][2] * R[1][2] + R[2][2] * R[2][2])


def _angles(pair: FramePair, f: Functions) -> dict[str, tuple[Scalar, Vec, tuple[Scalar, Scalar] | None]]:
    """Return alpha, beta, gamma of b as seen from a, and their axes' dual vectors, in the common body's axes.

    Of alpha and beta with sine and cosine.

    Raises:
        DescriptionError: nothing turns the frames against each other, and beta is at +-pi/2.
    """
    x, y, z = pair.axes_a
    R = pair.pose().rotation
    cosine = cosine_of(pair, f)
    if isinstance(cosine, float) and cosine < POLE:
        raise DescriptionError(
            f"its frames stay at beta = {'-' if R[0][2] < 0.0 else ''}90 degrees to each other, where alpha and gamma"
            " turn about one axis; allowed: placements whose frames are turned otherwise, or no tables of alpha, beta"
            " and gamma",
            where=pair.where,
            source=pair.source,
        )
    inverse = 1.0 / cosine
    sin_alpha, cos_alpha, sin_beta = -1.0 * (R[1][2] * inverse), R[2][2] * inverse, R[0][2]
    behind_y = add(scale(cos_alpha, y), scale(sin_alpha, z))
    behind_z = scale(inverse, add(scale(-1.0 * sin_alpha, y), scale(cos_alpha, z)))
    return {
        "alpha": (f.atan2(-1.0 * R[1][2], R[2][2]), add(x, scale(-1.0 * sin_beta, behind_z)), (sin_alpha, cos_alpha)),
        "beta": (f.atan2(sin_beta, cosine), behind_y, (sin_beta, cosine)),
        "gamma": (f.atan2(-1.0 * R[0][1], R[0][0]), behind_z, None),
    }
