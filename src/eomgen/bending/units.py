"""Units that finite elements come in: those of length and mass by a name, with seconds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .finite_elements import FiniteElements

SI = "m"
_INCH, _POUND_FORCE = 0.0254, 4.4482216152605  # m, N: exact
WORDS = "m (m, kg, s), mm (mm, t, s), mm-kg-s or inch-lbf-s (mass: lbf s^2 / inch)"
UNITS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {  # name -> of length in m, of mass in kg; forces follow: N, N, mN and lbf
        SI: (1.0, 1.0),
        "mm": (1e-3, 1e3),
        "mm-kg-s": (1e-3, 1.0),
        "inch-lbf-s": (_INCH, _POUND_FORCE / _INCH),  # lbf s^2 / inch
    }
)


def in_si(elements: FiniteElements, units: str) -> FiniteElements:
    """Return finite elements in m, kg, s and N: lengths and entries by their directions.

    Args:
        elements: in other units.
        units: a name of ``UNITS``.
    """
    length, mass = UNITS[units]
    if length == mass == 1.0:
        return elements
    import numpy as np
    from scipy.sparse import diags_array

    is_rotation = (elements.dofs[:, 0] >= 0) & (elements.dofs[:, 1] > 2)
    by_row = diags_array(np.where(is_rotation, length, 1.0))

    def scaled(matrix: Any) -> Any:
        return (mass * (by_row @ matrix @ by_row)).tocsr()

    faces = tuple(replace(face, place=length * face.place) for face in elements.interfaces)
    stress = {name: scaled(matrix) for name, matrix in elements.stress.items()}
    return replace(
        elements,
        nodes=length * elements.nodes,
        M=scaled(elements.M),
        K=scaled(elements.K),
        interfaces=faces,
        stress=stress,
    )
