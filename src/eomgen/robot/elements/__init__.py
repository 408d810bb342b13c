"""Force elements between two links, one file a kind: numbers, units, ranges and texts.  Kinds are listed here."""

from __future__ import annotations

from collections.abc import Mapping

from .bushing import Bushing
from .element import LinkElement
from .spring import Spring

__all__ = ["KINDS", "Bushing", "Element", "LinkElement", "Spring"]

Element = Bushing  # kinds that ``Robot.elements`` holds; springs have a field of their own
KINDS: Mapping[str, type[LinkElement]] = {kind.TABLE: kind for kind in (Spring, Bushing)}
