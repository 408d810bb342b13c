"""Control of robots: feed-forward, observers and prediction, in Python and as C.

Uses runtime, robot and description.
"""

from ..lazily import imports_when_used

with imports_when_used(globals()):
    from .sensing import Measurement as Measurement
    from .sensing import parse_sensors as parse_sensors
