"""Control of robots: feed-forward, observers and prediction, in Python and as C.

Uses runtime, robot, description, codegen (c), templates and pipeline.
"""

from ..lazily import imports_when_used

with imports_when_used(globals()):
    from .momentum_observer import MomentumObserver as MomentumObserver
    from .sensing import Measurement as Measurement
    from .sensing import parse_sensors as parse_sensors
