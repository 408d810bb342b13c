"""Coulomb friction of links in a feed-forward: it reverses over a velocity, since motors behind springs cannot jump."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from ..errors import InputError
from ..robot.value import Coordinate, Joint, Robot

SLOW = 0.02  # of a coordinate's highest velocity: over which Coulomb friction of links reverses in the feed-forward


def with_smooth_friction(
    robot: Robot, fastest: Mapping[str, float], smoothing: float | None
) -> tuple[Robot, dict[str, float]]:
    """Return the robot whose Coulomb friction reverses over higher velocities, and these by coordinate.

    Args:
        robot: with friction of joints.
        fastest: highest velocities of the coordinates whose friction counts, m/s or rad/s, by name.
        smoothing: the velocity, m/s or rad/s; None for a part SLOW of the highest.

    Raises:
        InputError: Coulomb friction in loops or couplings, which has no such velocity.
    """
    return softened(robot, {name: smoothing or SLOW * rate for name, rate in fastest.items() if rate})


def softened(links: Robot, widths: Mapping[str, float]) -> tuple[Robot, dict[str, float]]:
    """Return the robot whose Coulomb friction reverses over these velocities, by coordinate, and those that are new.

    Raises:
        InputError: Coulomb friction in loops or couplings, which has no such velocity.
    """
    for where, law in _laws_between(links):
        if _is_coulomb(law):
            raise InputError(
                f"{where}.friction: Coulomb friction there makes drives jump; allowed for feed-forward: viscous one"
            )
    widest: dict[str, float] = {}

    def soft(joint: Joint, name: str, law: Coordinate) -> Coordinate:
        whole = f"{joint.name}.{name}"
        width = widths.get(whole, 0.0)
        if law.friction is None or not _is_coulomb(law) or width <= (law.friction.smoothing or 0.0):
            return law
        widest[whole] = width
        return replace(law, friction=replace(law.friction, smoothing=width))

    joints = tuple(
        replace(joint, coordinates={name: soft(joint, name, law) for name, law in joint.coordinates.items()})
        for joint in links.joints
    )
    return (replace(links, name=links.name[:42] + "_smooth", joints=joints) if widest else links), widest


def coulomb_frictions(links: Robot) -> list[str]:
    """Return names of coordinates with Coulomb friction."""
    return [
        f"{joint.name}.{name}" for joint in links.joints for name, law in joint.coordinates.items() if _is_coulomb(law)
    ]


def smoothing_notes(widest: Mapping[str, float]) -> list[str]:
    """Return a line for each coordinate whose friction reverses over a velocity, m/s or rad/s."""
    return [f"Coulomb friction of {name} reverses over {width:.3g} rad/s or m/s" for name, width in widest.items()]


def _laws_between(robot: Robot) -> Iterable[tuple[str, Coordinate]]:
    for loop in robot.loops:
        yield from ((f"loops.{loop.name}.{name}", law) for name, law in loop.coordinates.items())
    yield from ((f"couplings.{x.name}", x.law) for x in robot.couplings if x.law is not None)


def _is_coulomb(law: Coordinate) -> bool:
    friction = law.friction
    return friction is not None and bool(friction.coulomb or friction.static or friction.coefficient)
