"""Time integration of a kernel: steps, solvers, contacts, closed loops.

Uses runtime, kernel, robot, state and loops; never the generator or the pipeline, so that it builds nothing behind
your back.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from ..kernel.stepping.methods import METHODS as METHODS
    from .contacts import Contact as Contact
    from .plan import choose_method as choose_method
    from .reference_motions import GlobalError as GlobalError
    from .reference_motions import global_error as global_error
    from .resting import Rest as Rest
    from .resting import rests as rests
    from .solve import integrate as integrate
    from .trajectory import Trajectory as Trajectory
    from .until import Until as Until
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
