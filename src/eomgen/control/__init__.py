"""Feed-forward, observers and predictive control, in Python and as C.

Uses runtime, kernel, robot, results, description, state, motion, scenario, codegen (c, kernels), templates, pipeline
and simulation.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from .elastic_feedforward import feedforward as feedforward
    from .feedforward_result import FeedForward as FeedForward
    from .feedforward_source import write_feedforward as write_feedforward
    from .inversion.result import StableInversion as StableInversion
    from .inversion.solve import stable_inversion as stable_inversion
    from .kalman_filter import Observer as Observer
    from .kalman_filter import Uncertainty as Uncertainty
    from .kalman_filter import observer as observer
    from .momentum_observer import MomentumObserver as MomentumObserver
    from .observability import Observability as Observability
    from .observer_source import write_observer as write_observer
    from .sensing import Measurement as Measurement
    from .sensing import parse_sensors as parse_sensors
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
