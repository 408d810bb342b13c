"""The list of all families of forces, in the order of the sums in generated code."""

from __future__ import annotations

from collections.abc import Sequence

from .bushings import Bushings
from .coordinates import CoordinateLaws, ModalCouplings
from .cut_journals import LoopBearingContacts
from .cuts import ElasticLoopCoordinates
from .element import ForceElement
from .internal_states.coordinate_laws import InternalStateLaws
from .internal_states.drives import Drives
from .joint_damping import JointDampers
from .joint_stiffness import JointStiffnesses
from .journals import BearingContacts
from .springs import PointSprings
from .transmissions import Transmissions

ELEMENTS: Sequence[type[ForceElement]] = (
    CoordinateLaws,
    InternalStateLaws,
    Drives,
    Transmissions,
    PointSprings,
    BearingContacts,
    JointStiffnesses,
    JointDampers,
    ElasticLoopCoordinates,
    LoopBearingContacts,
    Bushings,
    ModalCouplings,
)
