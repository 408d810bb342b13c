"""Limits of what descriptions, scenarios, plans and results may hold, whatever format they come in."""

from __future__ import annotations

from numbers import Real
from typing import Any

LARGEST = 1e30  # numbers beyond it would overflow in products
LARGEST_FOUND = 1e150  # of what was computed: sums of squares stay finite
LARGEST_FINITE = 1.7e308  # of what is only shown
MOST_ENTRIES = 5_000  # links, joints, ...: far beyond what can be derived, and read in a second
MOST_SEGMENTS = 100  # of a beam: 600 coordinates, and far more than its first frequencies need
MOST_MODES = 200  # of a link that bends, out of a file
MOST_INTERFACES = 200  # of such a link, which are names
MOST_SHAPE_NUMBERS = 4_000_000  # of modes at all its interfaces: second orders of 200 modes at 33 of them
MOST_SETS = 10_000  # of nodes, in a file of finite elements
MOST_SET_MEMBERS = 2_000_000  # of all its sets together
MOST_SYSTEMS = 5_000  # of coordinates, in such a file
MOST_MATRICES = 1_000  # in such a file, whether they are read or passed over
MOST_TEXTS = 1_000_000  # of an array
MOST_BEAM_MODES = 12  # of a link that is a beam, in one direction: more are far above what such a link is modelled for
SMALLEST = 1e-30  # of numbers that are not 0 and are divided by: their inverse squares stay finite
MOST_COUNTED = 1_000_000  # points, poses, draws, searches: what an option of a command may ask for


def is_usable(value: Any) -> bool:
    """Whether a value is a number to compute with: 0, or of a magnitude from SMALLEST to LARGEST; no truth value."""
    real = isinstance(value, Real) and not isinstance(value, bool)
    return real and (value == 0 or SMALLEST <= abs(value) <= LARGEST)
