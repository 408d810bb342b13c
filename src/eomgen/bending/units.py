"""Units that finite elements come in: those of length and mass by a name, with seconds."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

UNITS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {  # name -> of length in m, of mass in kg; forces follow: N in both
        "m": (1.0, 1.0),
        "mm": (1e-3, 1e3),
    }
)
