"""Feed-forward of motions, which the room of control computes."""

from __future__ import annotations

from typing import Any

from ..lazily import from_above


def feedforward(robot: Any, motion: Any, **options: Any) -> Any:
    """Return positions, velocities and torques of drives by which links follow a motion: a ``FeedForward``.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        motion: a scenario, or a reference trajectory with time derivatives.
        **options: of ``eomgen.control.feedforward``, whose errors it has, too.
    """
    return from_above(".control.elastic_feedforward", "feedforward")(robot, motion, **options)
