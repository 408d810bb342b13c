"""Measured curves of a force over a deviation or an elongation."""

from __future__ import annotations

from .laws import SMALLEST

Curve = tuple[tuple[float, float], ...]  # (deviation, force)
POINTS = (2, 64)  # fewest and most points of a curve


def curve_conflict(curve: Curve, what: str = "deviation") -> tuple[str, str] | None:
    """The key and the message of what is wrong with a curve's points; None if nothing is.  ``what``: its abscissa."""
    fewest, most = POINTS
    if not fewest <= len(curve) <= most:
        return "curve", f"got {len(curve)} points; allowed: {fewest} to {most}"
    for i in range(1, len(curve)):
        if curve[i][0] - curve[i - 1][0] < SMALLEST:
            return "curve", (
                f"point {i} has the {what} {curve[i][0]!r} after {curve[i - 1][0]!r}; "
                f"allowed: {what}s that rise by at least {SMALLEST:g}"
            )
    return None
