"""A kernel in one state: motors behind gears, stiffness of springs, static equilibrium.

Uses runtime, kernel and robot.
"""

from .drives import drives_at_rest
from .equilibrium import static_equilibrium
from .springs import coordinate_sizes, stiffness_matrix, stiffnesses
from .vectors import state_vector

__all__ = [
    "coordinate_sizes",
    "drives_at_rest",
    "state_vector",
    "static_equilibrium",
    "stiffness_matrix",
    "stiffnesses",
]
