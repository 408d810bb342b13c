"""Components of the constraint g(q) = 0 of a loop, which the cut joint blocks, by its type.

Frame a stands on the first link of the loop, frame b on the second; p (m) is the origin of b and R the rotation of b,
both seen from a.  z is the joint's axis, and the normal of a planar one; a universal joint turns about x of a and y of
b.  Every component is a coordinate of p or a sum of entries of R, so that it is smooth on the whole motion, and its
gradients are independent wherever the joint is closed.  This file imports nothing of eomgen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol


class Cut(Protocol):
    """A joint that is cut: its type, and its coordinates that have a force."""

    @property
    def type(self) -> str:
        """One of CUTS."""

    @property
    def coordinates(self) -> Mapping[str, object]:
        """Properties by x, y, z, alpha, beta, gamma."""


@dataclass(frozen=True)
class Component:
    """One component of a constraint: p[axis], or the sum of factor R[i][j] over ``products`` (factor, i, j).

    ``name`` is the direction that is blocked: x, y, z (m), or alpha, beta, gamma about x, y, z of a (the sine of the
    angle, near closure the angle itself, rad).
    """

    name: str
    axis: int | None = None
    products: tuple[tuple[float, int, int], ...] = ()


_X, _Y, _Z = (Component(name, axis) for axis, name in enumerate("xyz"))
_AXES_PARALLEL = (Component("alpha", products=((-1.0, 1, 2),)), Component("beta", products=((1.0, 0, 2),)))
_NO_TURN = (  # sine of the angle of R times its axis
    Component("alpha", products=((0.5, 2, 1), (-0.5, 1, 2))),
    Component("beta", products=((0.5, 0, 2), (-0.5, 2, 0))),
    Component("gamma", products=((0.5, 1, 0), (-0.5, 0, 1))),
)
_CROSS = (Component("gamma", products=((-1.0, 0, 1),)),)
_SINGLE = {part.name: part for part in (*_AXES_PARALLEL, *_CROSS)}  # each vanishes with one angle of Rx Ry Rz

CUTS: Mapping[str, tuple[Component, ...]] = {
    "revolute": (_X, _Y, _Z, *_AXES_PARALLEL),
    "prismatic": (_X, _Y, *_NO_TURN),
    "cylindrical": (_X, _Y, *_AXES_PARALLEL),
    "universal": (_X, _Y, _Z, *_CROSS),
    "spherical": (_X, _Y, _Z),
    "planar": (_Z, *_AXES_PARALLEL),
    "fixed": (_X, _Y, _Z, *_NO_TURN),
}

# Products of axes vanish for opposite axes, too: a closed joint has this sum of (factor, i, j) above 0.
UPRIGHT: Mapping[str, tuple[tuple[float, int, int], ...]] = {
    **dict.fromkeys(("revolute", "cylindrical", "planar"), ((1.0, 2, 2),)),
    **dict.fromkeys(("prismatic", "fixed"), ((1.0, 0, 0), (1.0, 1, 1), (1.0, 2, 2))),
}


def rigid_parts(loop: Cut) -> tuple[Component, ...]:
    """The components of a loop's constraint: what its type blocks, without coordinates that have a force.

    Where an angle has one beside angles that are rigid, each of these has the component that vanishes with it alone
    while beta is within a quarter of a turn: sin(alpha) cos(beta), sin(beta), cos(beta) sin(gamma).
    """
    kept = tuple(part for part in CUTS[loop.type] if part.name not in loop.coordinates)
    if sum(part.name in _SINGLE for part in kept) == len(_SINGLE):
        return kept
    return tuple(_SINGLE.get(part.name, part) for part in kept)
