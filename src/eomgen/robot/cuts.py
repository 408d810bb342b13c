"""Components of the constraint g(q) = 0 of a loop, which the loop joint (cut) blocks, by its type.

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
    """A loop joint (cut): its type, and its coordinates that have a force."""

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
_SINGLE = {
    component.name: component for component in (*_AXES_PARALLEL, *_CROSS)
}  # each vanishes with one angle of Rx Ry Rz

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


def rigid_components(loop: Cut) -> tuple[Component, ...]:
    """Return the components of a loop's constraint: those that its type blocks, without coordinates that have a force.

    Where an angle has a force beside rigid angles, each of these has the component that vanishes with it alone while
    beta is within pi / 2: sin(alpha) cos(beta), sin(beta), cos(beta) sin(gamma).
    """
    rigid = tuple(component for component in CUTS[loop.type] if component.name not in loop.coordinates)
    if sum(component.name in _SINGLE for component in rigid) == len(_SINGLE):
        return rigid
    return tuple(_SINGLE.get(component.name, component) for component in rigid)
