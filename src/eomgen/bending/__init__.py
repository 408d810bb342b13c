"""Links that bend: constants of their modes, out of beams, of masses that move with modes, and of files.

Uses npz, files and robot; NumPy alone, SciPy where finite elements are reduced.
"""

from ..lazily import imports_when_used

with imports_when_used(globals()):
    from .reduced_link import ReducedLink as ReducedLink
    from .reducing import LinkSets as LinkSets
    from .reducing import reduce_files as reduce_files
