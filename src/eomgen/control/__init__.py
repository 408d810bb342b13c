"""Control of robots: feed-forward, observers and prediction, in Python and as C.

Uses runtime, robot, results, description, state, motion, scenario, codegen (c), templates, pipeline and simulation.
"""

from ..lazily import imports_when_used

with imports_when_used(globals()):
    from .elastic_feedforward import feedforward as feedforward
    from .feedforward_result import FeedForward as FeedForward
    from .inversion.result import StableInversion as StableInversion
    from .inversion.solve import stable_inversion as stable_inversion
    from .momentum_observer import MomentumObserver as MomentumObserver
    from .sensing import Measurement as Measurement
    from .sensing import parse_sensors as parse_sensors
