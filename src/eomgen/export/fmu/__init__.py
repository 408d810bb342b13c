"""FMUs (functional mock-up units), FMI 2.0 and 3.0: variables, XML, C, archive.

Uses what export uses.
"""

from typing import TYPE_CHECKING

from ...lazily import lazy_names

if TYPE_CHECKING:
    from .pack import export_fmu as export_fmu
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
