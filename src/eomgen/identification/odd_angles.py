"""Angles of joints that no joint has: degrees for radians, or angles of motors."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..arrays import Array
from ..robot.value import Joint

_ROUND = 4.0 * np.pi  # rad: joints without limits turn no further


def odd_angles_of(source: str, measured: Iterable[tuple[str, Joint, Array]]) -> str:
    """Return a message where joints turn further than they can: degrees, or angles of motors; else "".

    Args:
        source: the file, for the message.
        measured: name for the message, joint and angles, (T,), rad, of what turns.
    """
    wrong, as_degrees = list[str](), True
    for name, joint, values in measured:
        limits = joint.limits
        low, high = limits if limits is not None and limits[0] < limits[1] else (-_ROUND, _ROUND)
        room = 0.5 * max(high - low, 1.0)
        if values.min() < low - room or values.max() > high + room:
            wrong.append(
                f"{name} goes from {values.min():.4g} to {values.max():.4g} rad, allowed: {low:.4g} to {high:.4g}"
            )
            degrees = np.deg2rad(values)
            as_degrees &= bool(degrees.min() >= low - 0.1 * room and degrees.max() <= high + 0.1 * room)
    if not wrong:
        return ""
    cause = "degrees for radians" if as_degrees else "motor angles for joint angles, or degrees for radians"
    return f"{source}: {wrong[0]}: {cause}? allowed: angles of joints in rad"
