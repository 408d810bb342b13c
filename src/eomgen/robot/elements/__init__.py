"""Force elements of joints and between two links, one file a kind: numbers, units, ranges and texts.

Kinds are listed here.
"""

from __future__ import annotations

from collections.abc import Mapping

from .bushing import Bushing
from .element import LinkElement
from .joint_damping import JointDamping
from .joint_element import JointElement, MatrixElement
from .joint_stiffness import JointStiffness
from .journal import Radial
from .spring import Spring

__all__ = ["JOINT_ELEMENTS", "KINDS", "MATRICES", "Bushing", "Element", "JointElement", "LinkElement", "Spring"]

Element = Bushing  # kinds that ``Robot.elements`` holds; springs have another field
KINDS: Mapping[str, type[LinkElement]] = {kind.TABLE: kind for kind in (Spring, Bushing)}
JOINT_ELEMENTS: Mapping[str, type[JointElement]] = {kind.TABLE: kind for kind in (Radial, JointStiffness, JointDamping)}
MATRICES = tuple(table for table, kind in JOINT_ELEMENTS.items() if issubclass(kind, MatrixElement))
