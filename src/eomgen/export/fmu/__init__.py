"""FMUs (functional mock-up units), FMI 2.0 and 3.0: variables, XML, C, archive.

Uses what export uses.
"""

from ...lazily import imports_when_used

with imports_when_used(globals()):
    from .pack import export_fmu as export_fmu
