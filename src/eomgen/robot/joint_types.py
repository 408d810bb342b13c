"""Table of joint types: coordinates, words of other formats, and what a loop joint (cut) of the type blocks.

A loop joint blocks components of a constraint g(q) = 0.  Frame a stands on the first link of the loop, frame b on the
second; p (m) is the origin of b and R the rotation of b, both seen from a.  z is the joint's axis, and the normal of a
planar one; a universal joint turns about x of a and y of b.  Every component is a coordinate of p or a sum of entries
of R, so that it is smooth on the whole motion, and its gradients are independent wherever the joint is closed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

from .geometry import COORDINATES


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

Products = tuple[tuple[float, int, int], ...]  # (factor, i, j) of entries R[i][j]
_Z_AXES: Products = ((1.0, 2, 2),)
_ALL_AXES: Products = ((1.0, 0, 0), (1.0, 1, 1), (1.0, 2, 2))


@dataclass(frozen=True)
class JointType:
    """A row of the table of joint types.

    about: says in a schema which coordinates move.  coordinates: that move in a joint of the tree without tables of
    their own, in canonical order; None where the tree has no joints of this type.  principal: of these, the coordinate
    that drives move and limits bound; "" where there is none.
    blocked: components of a loop joint's constraint; None where loop joints have not this type.  upright: products of
    axes vanish for opposite axes, too, so that the sum of these is above 0 where the joint is closed.
    has_pitch: whether z follows gamma, z = pitch gamma / (2 pi).
    urdf: types of URDF that are read as this one; of those it is written as the first one within limits, and as the
    last one without.  mjcf: joint of MuJoCo that moves as the principal coordinate, or as all.
    equality: constraint of MuJoCo that a loop joint of this type becomes, at ``points``, m along its axis; "" if none.
    """

    about: str = ""
    coordinates: tuple[str, ...] | None = None
    principal: str = ""
    blocked: tuple[Component, ...] | None = None
    upright: Products = ()
    has_pitch: bool = False
    urdf: tuple[str, ...] = ()
    mjcf: str = ""
    equality: str = ""
    points: tuple[float, ...] = (0.0,)


JOINT_TYPES: Mapping[str, JointType] = MappingProxyType(
    {
        "revolute": JointType(
            "principal coordinate gamma",
            ("gamma",),
            "gamma",
            (_X, _Y, _Z, *_AXES_PARALLEL),
            _Z_AXES,
            urdf=("revolute", "continuous"),
            mjcf="hinge",
            equality="connect",
            points=(0.0, 0.1),
        ),
        "prismatic": JointType("z", ("z",), "z", (_X, _Y, *_NO_TURN), _ALL_AXES, urdf=("prismatic",), mjcf="slide"),
        "cylindrical": JointType(blocked=(_X, _Y, *_AXES_PARALLEL), upright=_Z_AXES),
        "universal": JointType(blocked=(_X, _Y, _Z, *_CROSS)),
        "spherical": JointType(blocked=(_X, _Y, _Z), equality="connect"),
        "planar": JointType(blocked=(_Z, *_AXES_PARALLEL), upright=_Z_AXES),
        "fixed": JointType("none", (), "", (_X, _Y, _Z, *_NO_TURN), _ALL_AXES, urdf=("fixed",), equality="weld"),
        "free": JointType("all six", COORDINATES, urdf=("floating",), mjcf="free"),
        "screw": JointType("gamma, which z follows by the pitch", ("z", "gamma"), "gamma", has_pitch=True),
    }
)
OWN_COORDINATES: Mapping[str, tuple[str, ...]] = MappingProxyType(  # of joints of the tree, by their types
    {name: kind.coordinates for name, kind in JOINT_TYPES.items() if kind.coordinates is not None}
)
PRINCIPAL: Mapping[str, str] = MappingProxyType(
    {name: kind.principal for name, kind in JOINT_TYPES.items() if kind.principal}
)
SYNONYMS: Mapping[str, str] = MappingProxyType(  # words of other formats
    {word: name for name, kind in JOINT_TYPES.items() for word in (*kind.urdf, kind.mjcf) if word not in ("", name)}
)
CUTS: Mapping[str, tuple[Component, ...]] = MappingProxyType(  # components that loop joints block, by their types
    {name: kind.blocked for name, kind in JOINT_TYPES.items() if kind.blocked is not None}
)


def rigid_components(loop: Cut) -> tuple[Component, ...]:
    """Return the components of a loop's constraint: those that its type blocks, without coordinates that have a force.

    Where an angle has a force beside rigid angles, each of these has the component that vanishes with it alone while
    beta is within pi / 2: sin(alpha) cos(beta), sin(beta), cos(beta) sin(gamma).
    """
    rigid = tuple(component for component in CUTS[loop.type] if component.name not in loop.coordinates)
    if sum(component.name in _SINGLE for component in rigid) == len(_SINGLE):
        return rigid
    return tuple(_SINGLE.get(component.name, component) for component in rigid)
