"""Places at which motions and their drives exceed the limits of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..robot.coordinates import force_unit_of, unit_of
from ..robot.mechanism import effort_of, follower_positions
from ..robot.value import Robot

ROUND_OFF = 1e-6  # of a limit, and of 1 m or rad of a range: what is no more than that beyond it counts as within
SHOWN = 8  # in one line
KINDS = ("position", "speed", "effort")


@dataclass(frozen=True)
class Excess:
    """Largest violation of one limit of a coordinate by a motion.

    kind: of KINDS.  value, limit: in their unit.  at: s, where the motion has times.
    """

    coordinate: str
    kind: str
    value: float
    limit: float
    unit: str
    at: float | None = None

    def text(self) -> str:
        """Return name and figures for a line."""
        when = "" if self.at is None else f" at {self.at:.4g} s"
        return f"{self.coordinate} {self.kind} {self.value:.4g} {self.unit}{when} (limit {self.limit:.4g})"


def limits_known(robot: Robot) -> frozenset[str]:
    """Return the kinds of limits that a robot has, of KINDS."""
    kinds: set[str] = set()
    for joint in robot.joints:
        for limits in map(joint.limits_of, joint.all_coordinates):
            kinds |= {"position"} if (limits.lower, limits.upper) != (None, None) else set()
            kinds |= {kind for kind, x in (("speed", limits.velocity), ("effort", limits.effort)) if x is not None}
    return frozenset(kinds)


def excesses(
    robot: Robot,
    names: Sequence[str],
    *,
    t: Array | None = None,
    q: Array | None = None,
    v: Array | None = None,
    u: Array | None = None,
) -> tuple[Excess, ...]:
    """Return where a motion exceeds the robot's limits, the worst place of each; none within round-off.

    Followers of rigid couplings have limits of position and speed, too.

    Args:
        robot: whose limits hold.
        names: of the coordinates, n.
        t: times, s, (T,), if there are any.
        q, v, u: coordinates, rates and drives, (T, n), m or rad, N or N m; what is left out is not looked at.
    """
    candidates = []
    efforts = dict.fromkeys(names) if u is None else dict(zip(names, u.T, strict=True))
    places, speeds = _columns(robot, names, q), _columns(robot, names, v, rates=True)
    for name in (*names, *(follower for follower in robot.followers if follower not in names)):
        limits, unit = robot.limits_of(name), unit_of(name)
        if name in places and (limits.lower is not None or limits.upper is not None):
            candidates.append(_worst(name, "position", unit, t, places[name], *limits.range))
        for kind, column, limit, unit_there in (
            ("speed", speeds.get(name), limits.velocity, f"{unit}/s"),
            ("effort", efforts.get(name), effort_of(robot, name), force_unit_of(name)),
        ):
            if column is not None and limit is not None:
                candidates.append(_worst(name, kind, unit_there, t, column, -limit, limit))
    return tuple(excess for excess in candidates if excess is not None)


def _columns(robot: Robot, names: Sequence[str], x: Array | None, *, rates: bool = False) -> dict[str, Array]:
    """Return positions, or rates, of coordinates and of their followers by name, (T,) each; none where x is None."""
    if x is None:
        return {}
    columns = dict(zip(names, x.T, strict=True))
    offsets = follower_positions(robot, {}) if rates else {}
    following = follower_positions(robot, columns)
    return columns | {name: value - offsets.get(name, 0.0) + np.zeros(len(x)) for name, value in following.items()}


def _worst(name: str, kind: str, unit: str, t: Array | None, x: Array, low: float, high: float) -> Excess | None:
    """Return the number of a column, (T,), that is farthest beyond its limits; None where all are within."""
    if not x.size:
        return None
    beyond = np.maximum(low - x, x - high)
    worst = int(np.argmax(beyond))
    limit = high if x[worst] > high or kind != "position" else low  # the same in both directions but for positions
    scale = max(abs(limit), 1.0) if kind == "position" else limit
    if not beyond[worst] > ROUND_OFF * scale:
        return None
    return Excess(name, kind, float(x[worst]), float(limit), unit, None if t is None else float(t[worst]))


def excess_notes(what: str, exceeding: Sequence[Excess]) -> tuple[str, ...]:
    """Return one line about all that exceeds limits, or none.

    Args:
        what: subject of the line, "the motion" say.
        exceeding: from ``excesses``.
    """
    if not exceeding:
        return ()
    more = f" and {len(exceeding) - SHOWN} more" if len(exceeding) > SHOWN else ""
    return (f"{what} exceeds limits of the robot: {', '.join(x.text() for x in exceeding[:SHOWN])}{more}",)
